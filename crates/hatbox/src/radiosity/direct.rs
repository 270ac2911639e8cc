//! Light straight from lamps, exactly, at points: functions on elements do not follow the edges of shadows.
//!
//! The irradiance of a solution is, on each element, the projection of what arrives. Of the light of lamps the projection is
//! taken out, and the light itself is put in:
//!
//! E(x) + Σ_l [∫ B_l G V dA − Σ_k N_k(x) (Δ⁻¹ S_cl b_l)_k],
//!
//! l running over the cells that shine, c being the cell of x. Both terms are integrated here, from the solution alone.
//! Reflected light is left as it is: it has no edges to speak of. [`gathered`](super::gathered) makes all light afresh, at
//! the nodes, which takes as many visits as there are pairs of cells and nodes; this takes one per point and lamp.

use super::{Solution, Sources};
use crate::assemble::{Accuracy, Panel, mass};
use crate::element::{Element, MAX_DOFS};
use crate::linalg::BlockDiagonal;
use crate::quadrature::sequence::hash;

/// Of the light of a lamp on a cell, this much may be missed by the projection that is taken out.
const TOLERANCE: f64 = 1e-3;

/// What the lamps of a solved scene send to points, beside what its functions say that they do.
pub struct Direct<'a> {
    lamps: Sources<'a>,
    mass_inverse: Option<BlockDiagonal>,
    accuracy: Accuracy,
}

/// The light of the lamps on one cell as functions of it: coefficients, band after band.
pub struct Projected(Vec<f64>);

impl<'a> Direct<'a> {
    /// Finds the lamps.
    pub fn new(solution: &'a Solution) -> Self {
        let mass_inverse = mass(&solution.scene, &solution.space).inverse();
        // Cells without area have no projections: nothing is put in the place of what cannot be taken out.
        let lamps = Sources::of(solution, |strength| strength > 1.0 && mass_inverse.is_some());
        Self { lamps, mass_inverse, accuracy: Accuracy::new(TOLERANCE, solution.scene.mesh.area()) }
    }

    /// Δ⁻¹ Σ_l S_cl b_l on a cell.
    pub fn projected(&self, cell: usize) -> Projected {
        let Sources { solution, cells, panels, strengths, .. } = &self.lamps;
        let space = &solution.space;
        let panel = Panel::of_cell(&solution.scene.mesh, space, cell);
        let (bands, dofs) = (solution.bands(), panel.element.dofs());
        let mut arrived = vec![0.0; bands * dofs];
        let lamps = cells.iter().zip(panels).zip(strengths).filter(|((of, _), _)| **of != cell);
        for ((&lamp, source), &strength) in lamps {
            let block = self.lamps.views().pair_block([&panel, source], [strength, 1.0], &self.accuracy);
            for (band, arrived) in arrived.chunks_exact_mut(dofs).enumerate() {
                let b = &solution.radiosity.band(band)[space.range(lamp)];
                for (arrived, row) in arrived.iter_mut().zip(block.values().chunks_exact(b.len())) {
                    *arrived += row.iter().zip(b).map(|(s, b)| s * b).sum::<f64>();
                }
            }
        }
        let Some(inverse) = &self.mass_inverse else { return Projected(vec![0.0; bands * dofs]) };
        let inverse = inverse.block(0, cell);
        let rows = inverse.chunks_exact(dofs);
        let of = |arrived: &[f64]| rows.clone().map(|row| row.iter().zip(arrived).map(|(m, s)| m * s).sum()).collect();
        Projected(arrived.chunks_exact(dofs).flat_map(|arrived| -> Vec<f64> { of(arrived) }).collect())
    }

    /// What is to be added to the irradiance at a point of a cell (reference coordinates), per band: [`light`](Self::light)
    /// less what functions have of it.
    pub fn correction(&self, cell: usize, at: [f64; 2], projected: &Projected, seed: u64) -> Vec<f64> {
        let element = self.lamps.solution.space.element(cell);
        let functions: [f64; MAX_DOFS] = element.values(at);
        let known = |band: usize| projected.band(band, element).iter().zip(functions).map(|(c, n)| c * n).sum::<f64>();
        self.light(cell, at, seed).into_iter().enumerate().map(|(band, light)| light - known(band)).collect()
    }

    /// ∫ B G V dA over the lamps at a point of a cell (reference coordinates), per band. `seed` chooses the rays where too much
    /// stands between for shadows to be cut out.
    pub fn light(&self, cell: usize, at: [f64; 2], seed: u64) -> Vec<f64> {
        self.lamps.irradiance(cell, at, hash(seed, cell as u64))
    }
}

impl Projected {
    /// The coefficients of one band; `element` is that of the cell.
    pub fn band(&self, band: usize, element: &Element) -> &[f64] {
        &self.0[band * element.dofs()..(band + 1) * element.dofs()]
    }
}

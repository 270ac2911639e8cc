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

use super::Gather;
use super::Solution;
use super::system::strengths;
use crate::assemble::{Accuracy, Panel, mass};
use crate::exchange::Views;
use crate::linalg::BlockDiagonal;
use crate::quadrature::sequence::hash;
use crate::visibility::{Bvh, Occluders};
use glam::DVec3;

/// Of the light of a lamp on a cell, this much may be missed by the projection that is taken out.
const TOLERANCE: f64 = 1e-3;
/// How far a point is moved into its cell, relative to the way to the middle: on an edge the plane of the other face is
/// seen from neither side.
pub(super) const INWARD: f64 = 1e-4;

/// What the lamps of a solved scene send to points, beside what its functions say that they do.
pub struct Direct<'a> {
    solution: &'a Solution,
    /// The cells that shine.
    cells: Vec<usize>,
    panels: Vec<Panel>,
    strengths: Vec<f64>,
    occluders: Occluders,
    blockers: Bvh,
    mass_inverse: Option<BlockDiagonal>,
    accuracy: Accuracy,
}

/// The light of the lamps on one cell as functions of it: coefficients, band after band.
pub struct Projected(Vec<f64>);

impl<'a> Direct<'a> {
    /// Finds the lamps.
    pub fn new(solution: &'a Solution) -> Self {
        let (scene, space) = (&solution.scene, &solution.space);
        let all = strengths(scene);
        // Cells without area have no projections: nothing is put in the place of what cannot be taken out.
        let mass_inverse = mass(scene, space).inverse();
        let cells: Vec<usize> = (0..all.len()).filter(|&cell| all[cell] > 1.0 && mass_inverse.is_some()).collect();
        Self {
            panels: cells.iter().map(|&cell| Panel::of_cell(&scene.mesh, space, cell)).collect(),
            strengths: cells.iter().map(|&cell| all[cell]).collect(),
            cells,
            occluders: Occluders::new(&scene.surfaces),
            blockers: Bvh::of_surfaces(&scene.surfaces),
            mass_inverse,
            accuracy: Accuracy::new(TOLERANCE, scene.mesh.area()),
            solution,
        }
    }

    fn views(&self) -> Views<'_> {
        Views { occluders: &self.occluders, blockers: &self.blockers }
    }

    /// Δ⁻¹ Σ_l S_cl b_l on a cell.
    pub fn projected(&self, cell: usize) -> Projected {
        let space = &self.solution.space;
        let panel = Panel::of_cell(&self.solution.scene.mesh, space, cell);
        let (bands, dofs) = (self.solution.bands(), panel.element.dofs());
        let mut arrived = vec![0.0; bands * dofs];
        let lamps = self.cells.iter().zip(&self.panels).zip(&self.strengths).filter(|((of, _), _)| **of != cell);
        for ((&lamp, source), &strength) in lamps {
            let block = self.views().pair_block([&panel, source], [strength, 1.0], &self.accuracy);
            for (band, arrived) in arrived.chunks_exact_mut(dofs).enumerate() {
                let b = &self.solution.radiosity.band(band)[space.range(lamp)];
                for (arrived, row) in arrived.iter_mut().zip(block.values().chunks_exact(b.len())) {
                    *arrived += row.iter().zip(b).map(|(s, b)| s * b).sum::<f64>();
                }
            }
        }
        let Some(inverse) = &self.mass_inverse else { return Projected(vec![0.0; bands * dofs]) };
        let rows = inverse.block(0, cell).chunks_exact(dofs);
        let of = |arrived: &[f64]| rows.clone().map(|row| row.iter().zip(arrived).map(|(m, s)| m * s).sum()).collect();
        Projected(arrived.chunks_exact(dofs).flat_map(|arrived| -> Vec<f64> { of(arrived) }).collect())
    }

    /// What is to be added to the irradiance at a point of a cell (reference coordinates), per band. `seed` chooses the
    /// rays where too much stands between for shadows to be cut out.
    pub fn correction(&self, cell: usize, at: [f64; 2], projected: &Projected, seed: u64) -> Vec<f64> {
        let mesh = &self.solution.scene.mesh;
        let patch = mesh.patch(cell);
        let x: DVec3 = patch.point(at).lerp(patch.center(), INWARD);
        let gather = Gather {
            panels: &self.panels,
            cells: Some(&self.cells),
            views: self.views(),
            strengths: &self.strengths,
            solution: self.solution,
        };
        let mut light = gather.irradiance(x, patch.normal(), mesh.cells[cell].surface, hash(seed, cell as u64));
        let element = self.solution.space.element(cell);
        let functions = element.values(at);
        for (light, coefficients) in light.iter_mut().zip(projected.0.chunks_exact(element.dofs())) {
            *light -= coefficients.iter().zip(functions).map(|(c, n)| c * n).sum::<f64>();
        }
        light
    }
}

//! A bound of the error of B̃ that holds, whatever points an estimate may have missed.
//!
//! With r = B⁰ + R K B̃ − B̃ the error is (I − RK)⁻¹ r. K is symmetric, and what arrives at a point of surfaces that shine with 1 is
//! at most 1, so that ‖K‖ ≤ 1 in L2 (I. Schur's test), and
//!
//! ```text
//! ‖B − B̃‖ ≤ ‖r‖ / (1 − ρ),     ρ the greatest reflectance
//! ```
//!
//! ‖r‖ is bounded on receivers, which are cells or parts of them. On each, K B̃ is a linear function and a number by which it is
//! wrong at the most, anywhere (`enclosure`); visibility is proven, and what is not proven to be seen or hidden may be either
//! (`sight`). Receivers whose share of the bound is greatest are quartered until that gains little. So r = q + d with a
//! polynomial q and |d| ≤ w on each, and ‖r‖ ≤ ‖q‖ + ‖w‖.
//!
//! In a scene that is closed by its topology the form factors from every point sum to 1, so that K B̃ = β + K (B̃ − β) for any
//! number β: of what is hardly known, only differences from β matter, the median of B̃.
//!
//! What is taken for granted: that faces are as planar as the scene takes them for, since cells that the visibility code has merged into
//! one polygon (to 1e-7 of its size) are one plane here; that faces that a shaft touches by less than 1e-9 of its size do not block
//! it; and that a mesh which is a closed surface has the winding number in front of each part that three rays agree about.
//! Rounding is not bounded step by step: the result has 1e-6 added.
//!
//! Lower and upper bounds of radiosity are due to D. Lischinski, B. Smits and D. Greenberg (*Bounds and error estimates for
//! radiosity*, SIGGRAPH 1994), who bound form factors between constants. They are of order h; a linear function on each
//! receiver makes it h², where nothing is hidden. Tried and dropped: pieces that touch a receiver one by one between 0 and what their
//! half-space sends, which grows with their number.

mod contour;
mod enclosure;
mod piece;
mod sight;
mod surroundings;

use crate::assemble::Panel;
use crate::element::{Basis, Polynomial};
use crate::exchange::{Geometry, Views, is_sealed};
use crate::mesh::Patch;
use crate::progress::{Interrupted, Progress, Stage};
use crate::quadrature::rule;
use crate::radiosity::Solution;
use crate::scene::{Material, Scene};
use crate::visibility::{Bvh, Occluders};
use contour::Place;
use enclosure::Enclosed;
use glam::DVec3;
use piece::{evaluate, quarters};
use rayon::prelude::*;
use sight::{Sight, Watcher};
use std::sync::{Arc, OnceLock};
use surroundings::Surroundings;

/// Bands that are looked at together.
const LANES: usize = 4;
// The bound holds whatever these are: they are where more work was seen to gain little on the scenes of the project.
/// Terms of an irradiance are looked at more closely if they may be wrong by more than this part of what the residual may be.
const FINE: f64 = 0.005;
/// The receivers are quartered in each round that have this part of what quartering may gain.
const GREATEST: f64 = 0.6;
/// A round that gains less than this part of the bound is the last, once there are so many receivers for each cell; there are no
/// more than the second number, and no more than fit into these bytes.
const LEAST_GAIN: f64 = 0.1;
const RECEIVERS: [usize; 2] = [4, 64];
const MEMORY: usize = 1 << 30;
/// What rounding may add.
const ROUNDING: f64 = 1e-6;

/// A bound of ‖B − B̃‖/‖B̃ − B⁰‖, the worst band's, and what it is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Certificate {
    /// The bound.
    pub relative: f64,
    /// The bound of ‖r‖/‖B̃ − B⁰‖ in that band.
    pub residual: f64,
    /// The greatest reflectance in that band.
    pub reflectance: f64,
    /// Parts of cells on which it was bounded.
    pub receivers: usize,
}

/// Why there is no bound.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CertifyError {
    /// Reflectance or exitance vary on a material.
    #[error(
        "the error can only be certified where reflectance and exitance are uniform, and those of material `{0}` are not"
    )]
    Varying(String),
    /// A cell's functions are no polynomials.
    #[error("the error can only be certified on triangles and parallelograms, and cell {0} is another quad")]
    Warped(usize),
    /// A surface reflects everything: there is no bound.
    #[error("the error can only be certified where all surfaces absorb, and material `{0}` reflects everything")]
    Lossless(String),
    /// The solution has a value that is no number.
    #[error("the solution is no number on cell {0}")]
    NoNumber(usize),
    /// Nothing is reflected in a band although something should be.
    #[error("the solution has no reflected light in band {0} that an error could be relative to")]
    Dark(usize),
    /// What receivers see would not fit into memory.
    #[error("{0} cells are too many to certify the error on: each may see each")]
    TooMany(usize),
    /// The work was asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// Whether the error of solutions of a scene can be bounded, as far as that is known before they are: elements that do not come from
/// refinement to a tolerance have the shapes of the faces.
///
/// # Errors
/// [`CertifyError`], but for [`CertifyError::Interrupted`].
pub fn certifiable(scene: &Scene, basis: &Basis, refined: bool) -> Result<(), CertifyError> {
    for first in (0..scene.bands).step_by(LANES) {
        materials(scene, first)?;
    }
    let warped = |&cell: &usize| !scene.mesh.patch(cell).is_affine();
    let polynomial = refined || basis.triangle.degree == 0;
    let found = (0..scene.mesh.cells.len()).filter(|_| !polynomial).find(warped);
    found.map_or(Ok(()), |cell| Err(CertifyError::Warped(cell)))
}

/// Bounds the error of a solution.
///
/// # Errors
/// [`CertifyError`].
pub fn certify(solution: &Solution, progress: &dyn Progress) -> Result<Certificate, CertifyError> {
    let (scene, cells) = (&solution.scene, solution.space.cells());
    if cells.saturating_mul(cells / 8) > MEMORY / 2 {
        return Err(CertifyError::TooMany(cells));
    }
    let blockers = Arc::new(Bvh::of_surfaces(&scene.surfaces));
    let (occluders, panels) = (Occluders::new(&scene.surfaces), OnceLock::new());
    let geometry = Geometry::new(scene, &solution.space, &blockers, &panels);
    let views = Views { occluders: &occluders, blockers: &blockers };
    let mut certificates = Vec::with_capacity(solution.bands());
    for first in (0..solution.bands()).step_by(LANES) {
        let light = Light::new(solution, first)?;
        certificates.extend(Bounding::new(&light, &geometry, views)?.certificates(progress)?);
    }
    let worst = certificates.into_iter().max_by(|a, b| a.relative.total_cmp(&b.relative));
    Ok(worst.unwrap_or(Certificate { relative: 0.0, residual: 0.0, reflectance: 0.0, receivers: 0 }))
}

/// A solution in some of its bands. Lanes beyond the bands are dark.
struct Light<'a> {
    solution: &'a Solution,
    first: usize,
    bands: usize,
    /// Of each material: exitance and reflectance.
    materials: Vec<[[f64; LANES]; 2]>,
}

/// A cell or a part of one, on which the residual is bounded.
struct Receiver {
    panel: usize,
    patch: Patch,
    /// Where nothing is reflected nobody looks.
    sight: Option<Sight>,
    /// In each lane ∫q² and ∫(|q| + w)², the latter from above.
    squares: [[f64; 2]; LANES],
}

impl<'a> Light<'a> {
    fn new(solution: &'a Solution, first: usize) -> Result<Self, CertifyError> {
        let bands = LANES.min(solution.bands() - first);
        Ok(Self { solution, first, bands, materials: materials(&solution.scene, first)? })
    }

    fn material(&self, cell: usize) -> [[f64; LANES]; 2] {
        self.materials[self.solution.scene.mesh.cells[cell].material as usize]
    }

    /// B̃ on each cell as a polynomial of its plane, in each lane.
    fn functions(&self, panels: &[Panel]) -> Result<Vec<[Polynomial; LANES]>, CertifyError> {
        let of = |(cell, panel): (usize, &Panel)| {
            let mut functions = [[0.0; 6]; LANES];
            for (lane, function) in functions.iter_mut().enumerate().take(self.bands) {
                let coefficients = &self.solution.radiosity.band(self.first + lane)[self.solution.space.range(cell)];
                if coefficients.iter().any(|c| !c.is_finite()) {
                    return Err(CertifyError::NoNumber(cell));
                }
                *function = panel.polynomial(coefficients).ok_or(CertifyError::Warped(cell))?;
            }
            Ok(functions)
        };
        panels.iter().enumerate().map(of).collect()
    }

    /// ‖B̃ − B⁰‖ in each lane.
    fn norms(&self, panels: &[Panel], functions: &[[Polynomial; LANES]]) -> [f64; LANES] {
        let mut squares = [0.0; LANES];
        for (cell, panel) in panels.iter().enumerate() {
            let [exitance, _] = self.material(cell);
            let reflected = raised(&functions[cell], exitance.map(|b| -b));
            for lane in 0..LANES {
                squares[lane] += integral(&panel.patch, |x| evaluate(&reflected[lane], panel.plane(), x).powi(2));
            }
        }
        squares.map(f64::sqrt)
    }
}

/// Exitance and reflectance of each material in some bands; of those that no cell has, nothing.
fn materials(scene: &Scene, first: usize) -> Result<Vec<[[f64; LANES]; 2]>, CertifyError> {
    let mut used = vec![false; scene.materials.len()];
    scene.mesh.cells.iter().for_each(|cell| used[cell.material as usize] = true);
    let of = |(material, used): (&Material, bool)| {
        let mut uniform = [[0.0; LANES]; 2];
        let quantities = [&material.exitance, &material.reflectance];
        for (values, quantity) in uniform.iter_mut().zip(quantities).filter(|_| used) {
            for (value, band) in values.iter_mut().zip(first..scene.bands) {
                // Files of solutions have no number for what varies.
                let known = quantity.uniform(band).filter(|value| value.is_finite());
                *value = known.ok_or_else(|| CertifyError::Varying(material.name.clone()))?;
            }
        }
        let absorbs = uniform[1].iter().all(|&reflectance| reflectance < 1.0);
        if absorbs { Ok(uniform) } else { Err(CertifyError::Lossless(material.name.clone())) }
    };
    scene.materials.iter().zip(used).map(of).collect()
}

/// Polynomials and numbers.
fn raised(functions: &[Polynomial; LANES], by: [f64; LANES]) -> [Polynomial; LANES] {
    let mut raised = *functions;
    raised.iter_mut().zip(by).for_each(|(f, by)| f[0] += by);
    raised
}

/// In each lane a value that half of the area is below, and half above.
fn medians(panels: &[Panel], functions: &[[Polynomial; LANES]]) -> [f64; LANES] {
    let half = 0.5 * panels.iter().map(Panel::area).sum::<f64>();
    std::array::from_fn(|lane| {
        let value = |cell: usize| evaluate(&functions[cell][lane], panels[cell].plane(), panels[cell].center);
        let mut cells: Vec<(f64, usize)> = (0..panels.len()).map(|cell| (value(cell), cell)).collect();
        cells.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut area = 0.0;
        let found = cells.iter().find(|(_, cell)| {
            area += panels[*cell].area();
            area >= half
        });
        found.map_or(0.0, |(value, _)| *value)
    })
}

/// The integral over a patch, exact for polynomials of degree 4 on triangles and parallelograms.
fn integral(patch: &Patch, f: impl Fn(DVec3) -> f64) -> f64 {
    let (rule, whole) = (rule(patch.shape(), 5), patch.shape().reference_area());
    let points = rule.points.iter().zip(&rule.weights);
    points.map(|(&at, weight)| weight * whole * patch.jacobian(at) * f(patch.point(at))).sum()
}

/// The residual of a solution, being bounded.
struct Bounding<'a> {
    light: &'a Light<'a>,
    panels: &'a [Panel],
    views: Views<'a>,
    functions: Vec<[Polynomial; LANES]>,
    /// What K is not asked about: K B̃ = base + K (B̃ − base).
    base: [f64; LANES],
    surroundings: Surroundings,
    norms: [f64; LANES],
}

impl<'a> Bounding<'a> {
    fn new(light: &'a Light<'a>, geometry: &Geometry<'a>, views: Views<'a>) -> Result<Self, CertifyError> {
        let panels = geometry.panels();
        let functions = light.functions(panels)?;
        let base = if is_sealed(geometry) { medians(panels, &functions) } else { [0.0; LANES] };
        let sent: Vec<_> = functions.iter().map(|f| raised(f, base.map(|base| -base))).collect();
        let surroundings = Surroundings::new(panels, &sent, views.occluders);
        let norms = light.norms(panels, &functions);
        Ok(Self { light, panels, views, functions, base, surroundings, norms })
    }

    /// Of each band.
    fn certificates(&self, progress: &dyn Progress) -> Result<Vec<Certificate>, CertifyError> {
        let receivers = self.receivers(progress)?;
        let bounds = self.total(&receivers, 1);
        let of_lane = |lane: usize| {
            if self.norms[lane] == 0.0 && receivers.iter().any(|receiver| receiver.squares[lane][1] > 0.0) {
                return Err(CertifyError::Dark(self.light.first + lane));
            }
            let reflectance = self.light.materials.iter().map(|[_, r]| r[lane]).fold(0.0, f64::max);
            let residual = (1.0 + ROUNDING) * bounds[lane] + ROUNDING;
            let relative = residual / (1.0 - reflectance);
            Ok(Certificate { relative, residual, reflectance, receivers: receivers.len() })
        };
        (0..self.light.bands).map(of_lane).collect()
    }

    /// ‖q‖ (0) or ‖q‖ + ‖w‖ (1) relative to the light, in each lane.
    fn total(&self, receivers: &[Receiver], which: usize) -> [f64; LANES] {
        let square = |lane: usize| receivers.iter().map(|receiver| receiver.squares[lane][which]).sum::<f64>();
        std::array::from_fn(|lane| self.relative(square(lane).sqrt(), lane))
    }

    fn relative(&self, value: f64, lane: usize) -> f64 {
        if self.norms[lane] > 0.0 { value / self.norms[lane] } else { 0.0 }
    }

    /// Quarters receivers until that gains little.
    fn receivers(&self, progress: &dyn Progress) -> Result<Vec<Receiver>, Interrupted> {
        let cells: Vec<_> = (0..self.panels.len()).filter(|&cell| self.panels[cell].area() > 0.0).collect();
        let [least, most] = RECEIVERS.map(|times| times * cells.len());
        let whole = |&cell: &usize| (cell, self.panels[cell].patch, None);
        let mut receivers = self.looked_from(cells.iter().map(whole).collect(), 1.0, progress)?;
        let mut bound = greatest(self.total(&receivers, 1));
        loop {
            let (split, mut kept) = self.marked(receivers);
            // Four parts of a receiver see no more than four times what it does.
            let bytes = |some: &[Receiver]| {
                some.iter().filter_map(|receiver| receiver.sight.as_ref()).map(Sight::bytes).sum::<usize>()
            };
            let too_many = kept.len() + 4 * split.len() > most || bytes(&kept) + 5 * bytes(&split) > MEMORY;
            if split.is_empty() || too_many {
                kept.extend(split);
                return Ok(kept);
            }
            let parts = split.iter().flat_map(|r| quarters(&r.patch).map(|part| (r.panel, part, r.sight.as_ref())));
            kept.extend(self.looked_from(parts.collect(), bound, progress)?);
            receivers = kept;
            let before = std::mem::replace(&mut bound, greatest(self.total(&receivers, 1)));
            if receivers.len() >= least && bound > (1.0 - LEAST_GAIN) * before {
                return Ok(receivers);
            }
        }
    }

    /// Those that have most of what may be gained, and the others.
    fn marked(&self, receivers: Vec<Receiver>) -> (Vec<Receiver>, Vec<Receiver>) {
        let gain = |receiver: &Receiver| -> f64 {
            let of = |(lane, [least, most]): (usize, &[f64; 2])| self.relative(self.relative(most - least, lane), lane);
            receiver.squares.iter().enumerate().map(of).sum()
        };
        let mut order: Vec<(f64, usize)> = receivers.iter().map(gain).zip(0..).collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let all: f64 = order.iter().map(|(gain, _)| gain).sum();
        let (mut taken, mut is_marked) = (0.0, vec![false; receivers.len()]);
        for (gain, receiver) in order {
            if taken >= GREATEST * all || gain == 0.0 {
                break;
            }
            taken += gain;
            is_marked[receiver] = true;
        }
        let (marked, others): (Vec<_>, Vec<_>) = receivers.into_iter().zip(is_marked).partition(|(_, marked)| *marked);
        let plain = |receivers: Vec<(Receiver, bool)>| receivers.into_iter().map(|(receiver, _)| receiver).collect();
        (plain(marked), plain(others))
    }

    /// Receivers from cells, parts of them, and what those are known to see; the residual may be about `bound`.
    fn looked_from(
        &self,
        parts: Vec<(usize, Patch, Option<&Sight>)>,
        bound: f64,
        progress: &dyn Progress,
    ) -> Result<Vec<Receiver>, Interrupted> {
        let stage = Stage::begin(progress, "bounding the error", parts.len() as u64);
        let area: f64 = self.panels.iter().map(Panel::area).sum();
        // Where nothing is reflected there is nothing to be relative to.
        let fine = self.norms.map(|norm| if norm > 0.0 { FINE * bound * norm / area.sqrt() } else { f64::INFINITY });
        let of = |(panel, patch, sight): (usize, Patch, Option<&Sight>)| {
            progress.advance(1);
            if progress.interrupted() { Err(Interrupted) } else { Ok(self.receiver(panel, patch, sight, fine)) }
        };
        let receivers = parts.into_par_iter().map(of).collect();
        drop(stage);
        receivers
    }

    fn receiver(&self, index: usize, patch: Patch, known: Option<&Sight>, fine: [f64; LANES]) -> Receiver {
        let panel = &self.panels[index];
        let [exitance, reflectance] = self.light.material(index);
        let looks = !panel.covered && reflectance.iter().any(|&r| r > 0.0);
        let (arriving, sight) = looks.then(|| self.arriving(panel, &patch, known, fine)).unzip();
        let (arriving, center) = (arriving.unwrap_or_default(), patch.center());
        let squares = std::array::from_fn(|lane| {
            let residual = |x: DVec3| {
                let arrives = arriving.value[lane] + arriving.gradient[lane].dot(x - center);
                exitance[lane] + reflectance[lane] * arrives - evaluate(&self.functions[index][lane], panel.plane(), x)
            };
            let square = integral(&patch, |x| residual(x).powi(2));
            let rest = reflectance[lane] * arriving.rest[lane] * patch.area().sqrt();
            [square, (square.sqrt() + rest).powi(2)]
        });
        Receiver { panel: index, patch, sight, squares }
    }

    /// What arrives on a part of a panel, and what that sees, if more of the panel is known to see so much.
    fn arriving(&self, panel: &Panel, patch: &Patch, known: Option<&Sight>, fine: [f64; LANES]) -> (Enclosed, Sight) {
        let place = Place {
            center: patch.center(),
            normal: panel.normal(),
            corners: patch.corners(),
            radius: patch.radius(),
            flat: self.surroundings.flat,
        };
        let watcher =
            Watcher::new(&self.surroundings, self.views, place, self.views.occluders.of_surface(panel.surface));
        let sight = known.map_or_else(|| Sight::new(&watcher), |known| known.of_part(&watcher));
        let mut arriving = Enclosed::new(&watcher, &sight, self.panels, fine);
        arriving.value.iter_mut().zip(self.base).for_each(|(value, base)| *value += base);
        (arriving, sight)
    }
}

fn greatest(values: [f64; LANES]) -> f64 {
    values.into_iter().fold(0.0, f64::max)
}

/// The least and the greatest of some numbers.
fn range(numbers: impl Iterator<Item = f64>) -> [f64; 2] {
    numbers.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], x| [lo.min(x), hi.max(x)])
}

#[cfg(test)]
mod tests;

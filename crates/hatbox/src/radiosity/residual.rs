//! How wrong the solution is: the residual of the continuous equation, at points that the solver never saw.
//!
//! r = B⁰ + R K B̃ − B̃ vanishes for the true radiosity, and ‖B − B̃‖ ≤ (‖r‖ + ρ δ ‖B̃‖)/(1 − ρ), where δ bounds the error of
//! the operator. The norm of r is estimated from area-weighted random points, at each of which the irradiance is
//! gathered afresh, with its own rays; so visibility, quadrature, discretisation and the solver are all in it. For
//! 1 − ρ stands the emitted over the leaving power, by which this scene amplifies light on the whole; a bright cavity in a
//! dark scene amplifies its own errors more. What is reported is *estimated*, not certified.

use super::{Shown, Solution, System};
use crate::element::Shape;
use crate::exchange::Exchange;
use crate::progress::{Interrupted, Progress};
use crate::quadrature::sequence::{hash, point};
use crate::solve::Info;
use rayon::prelude::*;

/// An estimate of ‖B − B̃‖/‖B̃ − B⁰‖ and of what it is made of. The norm is that of the reflected light: emitters are often
/// hundreds of times brighter than what they light, and their own exitance is exact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorEstimate {
    /// The estimated relative L2 error of the reflected light, the worst band's.
    pub relative: f64,
    /// ‖r‖/‖B̃ − B⁰‖: the discretisation's part (with the operator's own errors seen at the points).
    pub residual: f64,
    /// Emitted over leaving power, 1 − ρ for the scene as a whole: what the residual is divided by.
    pub absorption: f64,
    /// Relative error of the operator's row sums, as estimated when it was built.
    pub operator: f64,
    /// Relative residual that the solver left.
    pub solver: f64,
}

/// Estimates the error of a solution from its residual at `points` points.
///
/// # Errors
/// [`Interrupted`].
pub fn estimate_error(
    system: &System,
    solution: &Solution,
    info: &Info,
    points: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<ErrorEstimate, Interrupted> {
    let seed = hash(seed, 0x0065_7272_6f72);
    let mesh = &system.scene.mesh;
    let mut ends = Vec::with_capacity(mesh.cells.len());
    let mut area = 0.0;
    for cell in 0..mesh.cells.len() {
        area += mesh.patch(cell).area();
        ends.push(area);
    }
    progress.begin("estimating the error", points as u64);
    let samples: Result<Vec<Vec<[f64; 2]>>, Interrupted> = (0..points)
        .into_par_iter()
        .map(|k| {
            progress.advance(1);
            if progress.interrupted() {
                Err(Interrupted)
            } else {
                Ok(residual_at(system, solution, &ends, k as u32, seed))
            }
        })
        .collect();
    let samples = samples?;
    progress.end();
    let bands = solution.bands();
    let norm = |band: usize, which: usize| samples.iter().map(|s| s[band][which].powi(2)).sum::<f64>().sqrt();
    let relative = |band: usize| if norm(band, 1) > 0.0 { norm(band, 0) / norm(band, 1) } else { 0.0 };
    let residual = (0..bands).map(relative).fold(0.0, f64::max);
    let energy = system.energy(solution);
    let share =
        |band: usize| if energy.leaving[band] > 0.0 { energy.emitted[band] / energy.leaving[band] } else { 1.0 };
    let absorption = (0..bands).map(share).fold(1.0, f64::min);
    Ok(ErrorEstimate {
        relative: residual / absorption.max(1e-3),
        residual,
        absorption,
        operator: system.operator_error(solution),
        solver: info.residual,
    })
}

/// (r, B̃ − B⁰) per band at the k-th random point.
fn residual_at(system: &System, solution: &Solution, ends: &[f64], k: u32, seed: u64) -> Vec<[f64; 2]> {
    let p = point(seed, k);
    let target = p[0] * ends.last().copied().unwrap_or(0.0);
    let cell = ends.partition_point(|&end| end <= target).min(ends.len().saturating_sub(1));
    let patch = system.scene.mesh.patch(cell);
    let at = match patch.shape() {
        Shape::Triangle => [p[2].sqrt() * (1.0 - p[1]), p[2].sqrt() * p[1]],
        Shape::Quad => [p[1], p[2]],
    };
    let set = hash(seed, u64::from(k));
    let e = system.exchange.irradiance(cell, at, &solution.radiosity, set).unwrap_or_else(|| {
        let surface = system.scene.mesh.cells[cell].surface;
        system.gather(solution).irradiance(patch.point(at), patch.normal(), surface, set)
    });
    let material = system.scene.material(cell);
    let site = system.scene.site(cell, at);
    let of = |(band, e): (usize, &f64)| {
        let b = solution.evaluate(Shown::Radiosity, cell, at, band);
        let (b0, r) = (material.exitance.at(&site, band), material.reflectance.at(&site, band));
        [b0 + r * e - b, b - b0]
    };
    e.iter().enumerate().map(of).collect()
}

//! Means of the residual over parts of the scene: what is left of it for reflection to multiply.
//!
//! Parts are cells of one material that look the same way. What is known of the residual everywhere, g − B̃, is integrated; only
//! the rest is left to points. (From points alone the means were noise: in a dark room beside a bright one, a few points of
//! the bright one said that ten times as much was wrong as was.)

use super::System;
use super::residual::Sample;
use crate::linalg::{LinearOperator, MultiVector};
use crate::mesh::Mesh;

/// A part of the scene with fewer points than this has no mean.
const LEAST_POINTS: usize = 6;
/// Directions of normals that tell parts apart: ± each axis.
const DIRECTIONS: usize = 6;

/// What is summed over a part, per band.
#[derive(Clone, Default)]
struct Part {
    points: usize,
    /// Of the cells.
    area: f64,
    /// Integral of what is known.
    known: Vec<f64>,
    /// Of the points.
    sampled_area: f64,
    /// Of the points, of what is not known.
    rest: Vec<f64>,
}

impl Part {
    fn mean(&self, band: usize) -> f64 {
        if self.points < LEAST_POINTS {
            0.0
        } else {
            self.known[band] / self.area + self.rest[band] / self.sampled_area
        }
    }
}

/// For each cell the mean of the residual over its part of the scene, as a function of the broken space. `known` is g − B̃.
pub(super) fn part_means(system: &System, areas: &[f64], samples: &[Sample], known: &MultiVector) -> MultiVector {
    let (space, bands) = (&system.space, known.bands());
    let part_of = parts(&system.scene.mesh);
    let count = part_of.iter().max().map_or(0, |&last| last + 1);
    let mut parts = vec![Part { known: vec![0.0; bands], rest: vec![0.0; bands], ..Part::default() }; count];
    let integrals = system.mass().times(known);
    for cell in 0..space.cells() {
        let part = &mut parts[part_of[cell]];
        part.area += areas[cell];
        for (band, sum) in part.known.iter_mut().enumerate() {
            *sum += integrals.band(band)[space.range(cell)].iter().sum::<f64>();
        }
    }
    for sample in samples {
        let part = &mut parts[part_of[sample.cell]];
        part.points += 1;
        part.sampled_area += sample.area;
        for (sum, [first, second, _, known]) in part.rest.iter_mut().zip(&sample.bands) {
            *sum += sample.area * (0.5 * (first + second) - known);
        }
    }
    let mut means = MultiVector::zeros(space.broken_dofs(), bands);
    for cell in 0..space.cells() {
        for band in 0..bands {
            means.band_mut(band)[space.range(cell)].fill(parts[part_of[cell]].mean(band));
        }
    }
    means
}

/// The part of the scene that each cell belongs to: its material and the axis that its normal is closest to.
fn parts(mesh: &Mesh) -> Vec<usize> {
    let key = |cell: usize| {
        let normal = mesh.patch(cell).normal();
        let axis = (0..3).max_by(|&i, &j| normal[i].abs().total_cmp(&normal[j].abs())).unwrap_or(0);
        mesh.cells[cell].material as usize * DIRECTIONS + 2 * axis + usize::from(normal[axis] > 0.0)
    };
    (0..mesh.cells.len()).map(key).collect()
}

//! Means over parts of the scene of what a solution does not know of its residual: the errors of its operator, for
//! reflection to multiply.
//!
//! Parts are cells of one material that look the same way.

use super::System;
use super::residual::Sample;
use crate::linalg::MultiVector;
use crate::mesh::Mesh;

/// A part of the scene with fewer points than this has no mean.
const LEAST_POINTS: usize = 6;
/// Directions of normals that tell parts apart: ± each axis.
const DIRECTIONS: usize = 6;

/// What the points of a part sum up to.
#[derive(Clone)]
struct Part {
    points: usize,
    area: f64,
    /// Integral of r − (g − B̃), per band.
    rest: Vec<f64>,
}

/// For each cell the mean of r − (g − B̃) over its part of the scene, as a function of the broken space.
pub(super) fn part_means(system: &System, samples: &[Sample], bands: usize) -> MultiVector {
    let space = &system.space;
    let part_of = parts(&system.scene.mesh);
    let count = part_of.iter().max().map_or(0, |&last| last + 1);
    let mut parts = vec![Part { points: 0, area: 0.0, rest: vec![0.0; bands] }; count];
    for sample in samples {
        let part = &mut parts[part_of[sample.cell]];
        part.points += 1;
        part.area += sample.area;
        for (sum, [first, second, _, known]) in part.rest.iter_mut().zip(&sample.bands) {
            *sum += sample.area * (0.5 * (first + second) - known);
        }
    }
    let mut means = MultiVector::zeros(space.broken_dofs(), bands);
    for cell in 0..space.cells() {
        let part = &parts[part_of[cell]];
        if part.points < LEAST_POINTS {
            continue;
        }
        for band in 0..bands {
            means.band_mut(band)[space.range(cell)].fill(part.rest[band] / part.area);
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

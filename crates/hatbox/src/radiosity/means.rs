//! Means over parts of the scene of what a solution does not know of its residual: the errors of its operator, for
//! reflection to multiply.
//!
//! Parts are cells of one material that look the same way.

use super::System;
use super::residual::Sample;
use crate::linalg::MultiVector;
use crate::mesh::Mesh;

/// A part of the scene with fewer points than this has no mean; points count as many as if all stood for the same area.
const LEAST_POINTS: f64 = 6.0;
/// Directions of normals that tell parts apart: ± each axis.
const DIRECTIONS: usize = 6;

/// What the points of a part sum up to.
#[derive(Clone)]
struct Part {
    area: f64,
    /// The sum of the squares of what the points stand for.
    square: f64,
    /// Integral of r − (g − B̃), per band.
    rest: Vec<f64>,
}

/// For each cell the mean of r − (g − B̃) over its part of the scene, as a function of the broken space.
pub(super) fn part_means(system: &System, samples: &[Sample], bands: usize) -> MultiVector {
    let space = &system.space;
    let part_of = parts(&system.scene.mesh);
    let count = part_of.iter().max().map_or(0, |&last| last + 1);
    let mut parts = vec![Part { area: 0.0, square: 0.0, rest: vec![0.0; bands] }; count];
    for sample in samples {
        let part = &mut parts[part_of[sample.cell]];
        part.area += sample.area;
        part.square += sample.area * sample.area;
        for (sum, [first, second, _, known]) in part.rest.iter_mut().zip(&sample.bands) {
            *sum += sample.area * (0.5 * (first + second) - known);
        }
    }
    let mut means = MultiVector::zeros(space.broken_dofs(), bands);
    for cell in 0..space.cells() {
        let part = &parts[part_of[cell]];
        // That of a few points that stand for nearly all of the part would be noise, however many others there are.
        if part.area * part.area < LEAST_POINTS * part.square || part.area == 0.0 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::Shape;
    use crate::mesh::Cell;
    use crate::progress::Silent;
    use crate::radiosity::Options;
    use crate::scene::{Material, Physics, Scene};
    use glam::DVec3;

    /// Two triangles of a square.
    fn system() -> System {
        let mesh = Mesh {
            vertices: [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec(),
            cells: [[0, 1, 2, 2], [0, 2, 3, 3]]
                .map(|vertices| Cell { shape: Shape::Triangle, vertices, material: 0, group: 0, surface: 0 })
                .to_vec(),
            groups: vec![String::new()],
            ..Mesh::default()
        };
        let scene = Scene::new(mesh, vec![Material::diffuse("floor", 0.5)], Physics::Light, None).expect("valid");
        let options = Options { refinement: crate::mesh::Refinement::None, ..Options::default() };
        System::build(&scene, &options, &Silent).expect("built")
    }

    /// A point with two residuals about 0.5, of which 0.2 is known.
    fn sample(cell: usize, area: f64) -> Sample {
        Sample { cell, area, bands: vec![[0.4, 0.6, 0.0, 0.2]] }
    }

    #[test]
    fn the_mean_is_what_is_not_known_of_the_residual() {
        let samples: Vec<Sample> = (0..8).map(|k| sample(k % 2, 0.5)).collect();
        let means = part_means(&system(), &samples, 1);
        assert!(means.as_slice().iter().all(|mean| (mean - 0.3).abs() < 1e-15), "{means:?}");
    }

    /// A hundred points crowd where there is error: what two others stand for is nearly all of the part.
    #[test]
    fn a_mean_that_two_points_decide_is_none() {
        let crowd = (0..100).map(|_| sample(0, 1e-4));
        let samples: Vec<Sample> = crowd.chain([sample(1, 0.5), sample(1, 0.5)]).collect();
        assert!(part_means(&system(), &samples, 1).as_slice().iter().all(|&mean| mean == 0.0));
    }
}

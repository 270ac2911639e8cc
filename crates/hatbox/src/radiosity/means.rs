//! Means over parts of the scene of what a solution does not know of its residual: the errors of its operator, for
//! reflection to multiply.
//!
//! Parts are cells of one material that look the same way and are in focus, or not. What is wrong is taken to be the same share of the
//! light everywhere in a part: walls of a bright room and of a dark one are often one part, and the same number of lx on both was
//! tens of times what the dark one has.

use super::System;
use super::residual::Sample;
use crate::linalg::{LinearOperator, MultiVector};
use crate::mesh::Mesh;

/// A part of the scene with fewer points than this has no mean, and with as few in the light no share; points count as many as if all
/// stood for the same area, or light.
const LEAST_POINTS: f64 = 6.0;
/// Directions of normals that tell parts apart: ± each axis.
const DIRECTIONS: usize = 6;

/// What the points of a part sum up to.
#[derive(Clone)]
struct Part {
    area: f64,
    /// The sum of the squares of what the points stand for.
    square: f64,
    /// Per band the integrals of r − (g − B̃) and of the reflected light, and the sum of the squares of what the points stand for
    /// of the latter.
    rest: Vec<[f64; 3]>,
}

/// As a function of the broken space, the reflected light times the mean of r − (g − B̃) over each part of the scene relative to that
/// of the light; where that mean is more than the light's, or few points decide what the light's is, the mean itself.
pub(super) fn part_means(
    system: &System,
    samples: &[Sample],
    light: &MultiVector,
    within: Option<&[bool]>,
) -> MultiVector {
    let (space, mesh, bands) = (&system.space, &system.scene.mesh, light.bands());
    let integrals = system.mass().times(light);
    let part_of = parts(mesh, within);
    let count = part_of.iter().max().map_or(0, |&last| last + 1);
    let mut parts = vec![Part { area: 0.0, square: 0.0, rest: vec![[0.0; 3]; bands] }; count];
    for sample in samples {
        let (part, area) = (&mut parts[part_of[sample.cell]], mesh.patch(sample.cell).area());
        part.area += sample.area;
        part.square += sample.area * sample.area;
        for (band, [first, second, _, known]) in sample.bands.iter().enumerate() {
            let light = integrals.band(band)[space.range(sample.cell)].iter().sum::<f64>() / area;
            part.rest[band][0] += sample.area * (0.5 * (first + second) - known);
            part.rest[band][1] += sample.area * light;
            part.rest[band][2] += (sample.area * light).powi(2);
        }
    }
    let mut means = MultiVector::zeros(space.broken_dofs(), bands);
    for cell in 0..space.cells() {
        let part = &parts[part_of[cell]];
        // That of a few points that stand for nearly all of the part would be noise, however many others there are.
        if part.area * part.area < LEAST_POINTS * part.square || part.area == 0.0 {
            continue;
        }
        for (band, &[rest, of_light, square]) in part.rest.iter().enumerate() {
            let (here, range) = (means.band_mut(band), space.range(cell));
            if rest.abs() < of_light && of_light * of_light >= LEAST_POINTS * square {
                let lit = &light.band(band)[range.clone()];
                here[range].iter_mut().zip(lit).for_each(|(mean, light)| *mean = rest / of_light * light);
            } else {
                here[range].fill(rest / part.area);
            }
        }
    }
    means
}

/// The part of the scene that each cell belongs to: its material, the axis that its normal is closest to, and whether the error is
/// asked of it.
fn parts(mesh: &Mesh, within: Option<&[bool]>) -> Vec<usize> {
    let key = |cell: usize| {
        let normal = mesh.patch(cell).normal();
        let axis = (0..3).max_by(|&i, &j| normal[i].abs().total_cmp(&normal[j].abs())).unwrap_or(0);
        let way = mesh.cells[cell].material as usize * DIRECTIONS + 2 * axis + usize::from(normal[axis] > 0.0);
        2 * way + usize::from(within.is_some_and(|within| within[cell]))
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

    /// Light that is the same all over each triangle.
    fn lit(values: [f64; 2]) -> MultiVector {
        MultiVector::from_fn(6, 1, |row, _| values[row / 3])
    }

    /// A point with two residuals about 0.5, of which 0.2 is known.
    fn sample(cell: usize, area: f64) -> Sample {
        Sample { cell, area, light: None, bands: vec![[0.4, 0.6, 0.0, 0.2]] }
    }

    #[test]
    fn the_mean_is_what_is_not_known_of_the_residual() {
        let samples: Vec<Sample> = (0..8).map(|k| sample(k % 2, 0.5)).collect();
        let means = part_means(&system(), &samples, &lit([0.0, 0.2]), None);
        assert!(means.as_slice().iter().all(|mean| (mean - 0.3).abs() < 1e-15), "{means:?}");
    }

    /// The dark half of a part was taken to be wrong by as many lx as the bright one.
    #[test]
    fn what_is_not_known_is_the_same_share_of_bright_and_of_dark_light() {
        let samples: Vec<Sample> = (0..8).map(|k| sample(k % 2, 0.5)).collect();
        let means = part_means(&system(), &samples, &lit([4.0, 2.0]), None);
        for (mean, share) in means.as_slice().iter().zip([4.0, 4.0, 4.0, 2.0, 2.0, 2.0]) {
            assert!((mean - 0.1 * share).abs() < 1e-15, "{means:?}");
        }
    }

    /// What a few points in bright light are wrong by says nothing of the rest.
    #[test]
    fn a_share_that_two_points_decide_is_none() {
        let bright = (0..2).map(|_| Sample { cell: 0, area: 0.5, light: None, bands: vec![[50.2, 50.2, 0.0, 0.2]] });
        let samples: Vec<Sample> =
            bright.chain((0..8).map(|_| Sample { cell: 1, area: 0.5, light: None, bands: vec![[0.2; 4]] })).collect();
        let means = part_means(&system(), &samples, &lit([1e4, 1.0]), None);
        assert!(means.as_slice().iter().all(|mean| (mean - 10.0).abs() < 1e-12), "{means:?}");
    }

    /// By the bright one's share, what a dark focus misses of its light was hardly anything.
    #[test]
    fn what_is_not_known_in_a_focus_is_measured_there() {
        let samples: Vec<Sample> = (0..16)
            .map(|k| Sample {
                cell: k % 2,
                area: 0.5,
                light: None,
                bands: vec![if k % 2 == 0 { [0.0; 4] } else { [0.05, 0.05, 0.0, 0.0] }],
            })
            .collect();
        let means = part_means(&system(), &samples, &lit([1e4, 0.1]), Some(&[false, true]));
        for (mean, expected) in means.as_slice().iter().zip([0.0, 0.0, 0.0, 0.05, 0.05, 0.05]) {
            assert!((mean - expected).abs() < 1e-15, "{means:?}");
        }
    }

    /// A hundred points crowd where there is error: what two others stand for is nearly all of the part.
    #[test]
    fn a_mean_that_two_points_decide_is_none() {
        let crowd = (0..100).map(|_| sample(0, 1e-4));
        let samples: Vec<Sample> = crowd.chain([sample(1, 0.5), sample(1, 0.5)]).collect();
        assert!(part_means(&system(), &samples, &lit([0.0; 2]), None).as_slice().iter().all(|&mean| mean == 0.0));
    }
}

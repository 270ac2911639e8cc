//! Noise in what lamps send, averaged where it is no more than noise.
//!
//! What arrives from lamps is not joined: shadows have edges. Where a lamp is seen through slats, each cell sees as much of it as
//! its few points happen to, and what joins cells would average that: of irradiance that was written behind slats the error was
//! twice that of the radiosity, which is joined. Two halves of the points tell how much noise there is, and a cell takes the
//! joined function where that is within it. A border of a shadow is far more than the noise of the cells that it passes through.

use crate::linalg::{BlockDiagonal, LinearOperator, MultiVector};
use crate::mesh::Mesh;
use crate::space::FunctionSpace;
use std::collections::BTreeMap;

/// What changes by no more than so many times its noise is noise: of a few coefficients, two random numbers that are alike differ
/// by more in one case of twenty.
const DEVIATIONS: f64 = 3.0;

/// A broken function, with the joined one in its place on cells where they differ by no more than the noise; what each material
/// receives is kept.
pub(super) fn denoised(
    mesh: &Mesh,
    space: &FunctionSpace,
    mass: &BlockDiagonal,
    [mut broken, joined]: [MultiVector; 2],
    noise: &MultiVector,
) -> MultiVector {
    let mut change = joined.clone();
    change.add_scaled(-1.0, &broken);
    let weighted = [&change, noise, &broken, &joined].map(|function| mass.times(function));
    for band in 0..broken.bands() {
        let square = |function: &MultiVector, weighted: &MultiVector, cell: usize| -> f64 {
            let pairs = function.band(band)[space.range(cell)].iter().zip(&weighted.band(band)[space.range(cell)]);
            pairs.map(|(f, w)| f * w).sum()
        };
        let is_noise = |&cell: &usize| {
            let most = DEVIATIONS.powi(2) * square(noise, &weighted[1], cell);
            most > 0.0 && square(&change, &weighted[0], cell) <= most
        };
        let cells: Vec<usize> = (0..space.cells()).filter(is_noise).collect();
        let integral = |of: usize, cell: usize| weighted[of].band(band)[space.range(cell)].iter().sum::<f64>();
        let mut received: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
        for &cell in &cells {
            let sums = received.entry(mesh.cells[cell].material).or_default();
            *sums = [sums[0] + integral(2, cell), sums[1] + integral(3, cell)];
        }
        for cell in cells {
            let [before, after] = received[&mesh.cells[cell].material];
            let factor = if before > 0.0 && after > 0.0 { before / after } else { 1.0 };
            let range = space.range(cell);
            let places = broken.band_mut(band)[range.clone()].iter_mut().zip(&joined.band(band)[range]);
            places.for_each(|(place, value)| *place = factor * value);
        }
    }
    broken
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::mass;
    use crate::element::{ALL, Shape};
    use crate::mesh::Cell;
    use crate::scene::{Material, Physics, Scene};
    use glam::DVec3;

    /// Four squares in a row. The joined function is what the broken one would be without noise, but for the last square, where
    /// they differ by a shadow.
    #[test]
    fn noise_is_averaged_and_shadows_are_not_and_power_is_kept() {
        let vertices = (0..5).flat_map(|x| [0.0, 1.0].map(|y| DVec3::new(f64::from(x), y, 0.0))).collect();
        let square = |k: u32| [2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1];
        let cell = |k| Cell { shape: Shape::Quad, vertices: square(k), material: 0, group: 0, surface: k };
        let mesh = Mesh { vertices, cells: (0..4).map(cell).collect(), groups: vec![String::new()], ..Mesh::default() };
        let scene = Scene::new(mesh, vec![Material::diffuse("floor", 0.5)], Physics::Light, None).expect("valid");
        let space = FunctionSpace::broken(&scene.mesh, &ALL[0]).expect("an element");
        let of = |values: [f64; 4]| MultiVector::from_bands(1, values.to_vec()).expect("four cells");
        let (broken, joined) = (of([1.02, 0.99, 1.0, 0.0]), of([1.0, 1.0, 1.0, 0.5]));
        let found =
            denoised(&scene.mesh, &space, &mass(&scene, &space), [broken, joined], &of([0.02, 0.02, 0.0, 0.05]));
        let kept = f64::midpoint(1.02, 0.99);
        for (found, expected) in found.band(0).iter().zip([kept, kept, 1.0, 0.0]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }
}

//! How strongly the light of each cell counts, before anything is solved.

use crate::exchange::{self, Arriving};
use crate::scene::Scene;
use crate::visibility::Bvh;

/// Surfaces are taken to absorb this share of what arrives at the least.
const LEAST_ABSORBED: f64 = 0.05;

/// The exitance of each cell over the mean irradiance that the scene's power makes, as far as it arrives anywhere: nearly all
/// light of a sun does not, and what does falls on others.
pub(crate) fn strengths(scene: &Scene, blockers: &Bvh) -> Vec<f64> {
    let cells = scene.mesh.cells.len();
    let exitance = |cell: usize| {
        let site = scene.site(cell, [1.0 / 3.0, 1.0 / 3.0]);
        (0..scene.bands).map(|band| scene.material(cell).exitance.at(&site, band)).sum::<f64>()
    };
    let absorbed = |cell: usize| {
        let site = scene.site(cell, [1.0 / 3.0, 1.0 / 3.0]);
        (0..scene.bands).map(|b| 1.0 - scene.material(cell).reflectance.at(&site, b)).sum::<f64>() / scene.bands as f64
    };
    let areas: Vec<f64> = (0..cells).map(|cell| scene.mesh.patch(cell).area()).collect();
    let powers: Vec<f64> = (0..cells).map(|cell| areas[cell] * exitance(cell)).collect();
    let Arriving { fraction, elsewhere } = exchange::arriving(scene, blockers, &powers);
    let receives = |cell: &usize| !elsewhere || powers[*cell] == 0.0;
    let sum = |of: &dyn Fn(usize) -> f64| (0..cells).filter(receives).map(of).sum::<f64>();
    let [sink, area] = [sum(&|cell| areas[cell] * absorbed(cell)), sum(&|cell| areas[cell])];
    let mean = fraction * powers.iter().sum::<f64>() / sink.max(LEAST_ABSORBED * area);
    (0..cells).map(|cell| if mean > 0.0 { (exitance(cell) / mean).max(1.0) } else { 1.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::Shape;
    use crate::mesh::{Cell, Mesh};
    use crate::scene::{Material, Physics, Quantity};
    use glam::DVec3;
    use std::f64::consts::PI;

    /// A square of a metre, and a lamp with so long an edge so high above it.
    fn strength(edge: f64, height: f64) -> f64 {
        let square = |s: f64, z: f64| [(-s, -s), (s, -s), (s, s), (-s, s)].map(|(x, y)| DVec3::new(x, y, z));
        let cell = |vertices, surface| Cell { shape: Shape::Quad, vertices, material: surface, group: 0, surface };
        let mesh = Mesh {
            vertices: [square(0.5, 0.0), square(0.5 * edge, height)].concat(),
            cells: vec![cell([0, 1, 2, 3], 0), cell([4, 7, 6, 5], 1)],
            groups: vec![String::new()],
            ..Mesh::default()
        };
        let lamp = Material { exitance: Quantity::gray(7.0), ..Material::diffuse("lamp", 0.0) };
        let scene =
            Scene::new(mesh, vec![Material::diffuse("ground", 0.0), lamp], Physics::Light, None).expect("valid");
        strengths(&scene, &Bvh::of_surfaces(&scene.surfaces))[1]
    }

    /// B⁰/E = π h²/A where nothing is reflected, for lamps that are small beside the ground and large.
    #[test]
    fn a_far_lamp_is_as_strong_as_it_is_bright_over_what_it_gives() {
        for (edge, height) in [(1.0, 30.0), (10.0, 1e3), (100.0, 1e4)] {
            let exact = PI * height * height / (edge * edge);
            let found = strength(edge, height);
            assert!((found / exact - 1.0).abs() < 0.05, "{edge} {height}: {found} {exact}");
        }
    }
}

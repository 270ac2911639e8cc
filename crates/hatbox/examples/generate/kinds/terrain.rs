//! A field of craters as a grid of triangles, lit by a low sun, a glowing square far away; open all around.

use super::{Face, Inside, Material, Model, chance, matte};
use glam::DVec3;

/// Metres along a side.
const SIDE: f64 = 200.0;
const CRATERS: usize = 60;

pub(super) fn make(elements: usize) -> Model {
    let n = (((elements / 2) as f64).sqrt().round() as usize).max(2);
    let at = |i: usize, k: usize| {
        let (x, z) = (SIDE * i as f64 / n as f64, SIDE * k as f64 / n as f64);
        DVec3::new(x, height(x, z), z)
    };
    let mut ground: Vec<Face> = Vec::with_capacity(2 * n * n);
    for k in 0..n {
        for i in 0..n {
            let [a, b, c, d] = [at(i, k), at(i, k + 1), at(i + 1, k + 1), at(i + 1, k)];
            ground.extend([[a, b, c, c], [a, c, d, d]]);
        }
    }
    // A box whose one side shines, so that its back is not seen.
    let sun = DVec3::new(-330.0, 150.0, 100.0);
    let around = Inside::new(sun - DVec3::splat(12.0), sun + DVec3::splat(12.0));
    let mut dark: Vec<Face> = super::block(sun - DVec3::splat(12.0), sun + DVec3::splat(12.0), 0.0);
    let bright = around.walls[1].whole();
    dark.retain(|face| face.iter().any(|p| p.x < sun.x + 11.0));
    let [a, b, c, d] = bright;
    let light = Material { name: "sun", reflectance: [0.0; 3], radiance: [4e6, 3.8e6, 3.5e6] };
    Model {
        parts: vec![
            (matte("dust", [0.2, 0.19, 0.17]), ground),
            (light, vec![[a, d, c, b]]),
            (matte("black", [0.0; 3]), dark),
        ],
        eye: DVec3::new(195.0, 45.0, 195.0),
        target: DVec3::new(90.0, 0.0, 90.0),
        closed: false,
    }
}

/// Bowls with raised rims, the large ones first.
fn height(x: f64, z: f64) -> f64 {
    (0..CRATERS)
        .map(|k| {
            let radius = 30.0 / (1.0 + 0.3 * k as f64);
            let (dx, dz) = (x - SIDE * chance(11, k), z - SIDE * chance(12, k));
            let r2 = (dx * dx + dz * dz) / (radius * radius);
            0.45 * radius * (1.3 * (-2.0 * (r2.sqrt() - 1.0).powi(2) * 4.0).exp() * 0.4 - (-2.5 * r2 * r2).exp())
        })
        .sum()
}

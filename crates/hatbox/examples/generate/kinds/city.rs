//! A city block: houses of several steps on a ground, under an overcast sky, which is a glowing box around everything.

use super::{Inside, Model, Sheet, chance, matte, standing};
use glam::DVec3;

const LOT: f64 = 20.0;
/// Triangles of a house.
const PER_HOUSE: usize = 36;

pub(super) fn make(elements: usize) -> Model {
    let n = (((elements / PER_HOUSE) as f64).sqrt().round() as usize).max(2);
    let side = LOT * n as f64;
    let inside = Inside::new(DVec3::ZERO, DVec3::new(side, 80.0, side));
    let mut stone = Vec::new();
    let mut brick = Vec::new();
    for k in 0..n * n {
        let corner = DVec3::new((k % n) as f64, 0.0, (k / n) as f64) * LOT + DVec3::new(4.0, 0.0, 4.0);
        let faces = if chance(4, k) < 0.5 { &mut stone } else { &mut brick };
        let mut base = corner;
        let mut width = 12.0;
        for step in 0..3 {
            let height = 4.0 + 10.0 * chance(5 + step, k);
            faces.extend(standing(base, base + DVec3::new(width, height, width)));
            base += DVec3::new(1.5, height, 1.5);
            width -= 3.0;
        }
    }
    let sky = inside.walls.iter().map(Sheet::whole).chain([inside.ceiling.whole()]).collect();
    Model {
        parts: vec![
            (matte("street", [0.25, 0.25, 0.25]), vec![inside.floor.whole()]),
            (matte("stone", [0.6, 0.57, 0.5]), stone),
            (matte("brick", [0.5, 0.3, 0.22]), brick),
            (super::Material { name: "sky", reflectance: [0.0; 3], radiance: [2200.0, 2600.0, 3200.0] }, sky),
        ],
        eye: DVec3::new(2.0, 25.0, 2.0),
        target: DVec3::new(side / 2.0, 4.0, side / 2.0),
        closed: true,
    }
}

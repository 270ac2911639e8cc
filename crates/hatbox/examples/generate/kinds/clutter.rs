//! A closed box with a lamp, full of small blocks in the air, each turned at random and apart from the others.

use super::{Inside, Model, Sheet, block, chance, lamp, matte};
use glam::DVec3;

const SIDE: f64 = 4.0;

pub(super) fn make(elements: usize) -> Model {
    let blocks = (elements / 12).max(1);
    let n = ((blocks as f64).cbrt().ceil() as usize).max(1);
    let pitch = SIDE / (n + 1) as f64;
    let mut colours: [Vec<super::Face>; 3] = Default::default();
    for k in 0..blocks {
        let cell = DVec3::new((k % n) as f64, (k / n % n) as f64, (k / n / n) as f64) + 1.0;
        // The half diagonal is 0.43 of the pitch at the most, whatever the angle.
        let half = DVec3::new(chance(21, k), chance(22, k), chance(23, k)) * 0.15 + 0.1;
        let (center, half) = (cell * pitch, half * pitch);
        let angle = 0.05 + 1.4 * chance(24, k);
        colours[k % 3].extend(block(center - half, center + half, angle));
    }
    let inside = Inside::new(DVec3::ZERO, DVec3::splat(SIDE));
    let at = [1.6, 2.4];
    let [red, green, gray] = colours;
    Model {
        parts: vec![
            (matte("walls", [0.7; 3]), inside.walls.iter().map(Sheet::whole).collect()),
            (matte("floor", [0.6, 0.5, 0.4]), vec![inside.floor.whole()]),
            (matte("ceiling", [0.8; 3]), inside.ceiling.around(at, at)),
            (lamp([6000.0; 3]), vec![inside.ceiling.part(at, at)]),
            (matte("red", [0.7, 0.2, 0.15]), red),
            (matte("green", [0.2, 0.55, 0.25]), green),
            (matte("gray", [0.5; 3]), gray),
        ],
        eye: DVec3::new(0.15, 2.6, 0.1),
        target: DVec3::new(2.4, 1.8, 2.6),
        closed: true,
    }
}

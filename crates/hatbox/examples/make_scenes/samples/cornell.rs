//! The Cornell box as Cornell measured it: geometry in millimetres, reflectances and radiance as RGB.
//!
//! The front is open, the walls are one-sided, and the red wall is not quite plane (as measured), so that it bends
//! along the diagonal from its first to its third corner.

use super::glb::{Camera, Material, Part, Scene};

const WHITE: usize = 0;
const RED: usize = 1;
const GREEN: usize = 2;
const LIGHT: usize = 3;

const MATERIALS: [Material; 4] = [
    Material::matte("white", [0.725, 0.71, 0.68]),
    Material::matte("red", [0.63, 0.065, 0.05]),
    Material::matte("green", [0.14, 0.45, 0.091]),
    Material { name: "light", reflectance: [0.0; 3], radiance: [17.0, 12.0, 4.0] },
];

/// Corners of a quad in millimetres, counter-clockwise from the side that is lit.
type Quad = [[f64; 3]; 4];

const FLOOR: [Quad; 1] = [[[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]]];

const CEILING: [Quad; 4] = [
    [[0.0, 548.8, 0.0], [556.0, 548.8, 0.0], [556.0, 548.8, 227.0], [0.0, 548.8, 227.0]],
    [[0.0, 548.8, 332.0], [556.0, 548.8, 332.0], [556.0, 548.8, 559.2], [0.0, 548.8, 559.2]],
    [[0.0, 548.8, 227.0], [213.0, 548.8, 227.0], [213.0, 548.8, 332.0], [0.0, 548.8, 332.0]],
    [[343.0, 548.8, 227.0], [556.0, 548.8, 227.0], [556.0, 548.8, 332.0], [343.0, 548.8, 332.0]],
];

const BACK: [Quad; 1] = [[[549.6, 0.0, 559.2], [0.0, 0.0, 559.2], [0.0, 548.8, 559.2], [556.0, 548.8, 559.2]]];

const RIGHT: [Quad; 1] = [[[0.0, 0.0, 559.2], [0.0, 0.0, 0.0], [0.0, 548.8, 0.0], [0.0, 548.8, 559.2]]];

const LEFT: [Quad; 1] = [[[552.8, 0.0, 0.0], [549.6, 0.0, 559.2], [556.0, 548.8, 559.2], [556.0, 548.8, 0.0]]];

const LAMP: [Quad; 1] = [[[343.0, 548.8, 227.0], [343.0, 548.8, 332.0], [213.0, 548.8, 332.0], [213.0, 548.8, 227.0]]];

const SHORT_BLOCK: [Quad; 5] = block([[130.0, 65.0], [82.0, 225.0], [240.0, 272.0], [290.0, 114.0]], 165.0);

const TALL_BLOCK: [Quad; 5] = block([[423.0, 247.0], [265.0, 296.0], [314.0, 456.0], [472.0, 406.0]], 330.0);

/// Top and sides of a block that stands on the floor on these (x, z).
const fn block(base: [[f64; 2]; 4], height: f64) -> [Quad; 5] {
    let [a, b, c, d] = base;
    let top = [at(a, height), at(b, height), at(c, height), at(d, height)];
    [top, side(a, b, height), side(b, c, height), side(c, d, height), side(d, a, height)]
}

const fn at([x, z]: [f64; 2], y: f64) -> [f64; 3] {
    [x, y, z]
}

const fn side(a: [f64; 2], b: [f64; 2], height: f64) -> Quad {
    [at(a, 0.0), at(b, 0.0), at(b, height), at(a, height)]
}

/// The scene in metres, with the camera of the published pictures.
pub(super) fn scene() -> Scene {
    let parts: [(&'static str, usize, &[Quad]); 8] = [
        ("floor", WHITE, &FLOOR),
        ("ceiling", WHITE, &CEILING),
        ("back", WHITE, &BACK),
        ("green_right", GREEN, &RIGHT),
        ("red_left", RED, &LEFT),
        ("light", LIGHT, &LAMP),
        ("short_block", WHITE, &SHORT_BLOCK),
        ("tall_block", WHITE, &TALL_BLOCK),
    ];
    let metres = |quad: &Quad| quad.map(|corner| corner.map(|mm| mm / 1000.0));
    let part =
        |(name, material, quads): (_, _, &[Quad])| Part { name, material, quads: quads.iter().map(metres).collect() };
    Scene {
        materials: MATERIALS.to_vec(),
        parts: parts.map(part).into(),
        // Focal length 35 mm, picture 25 mm × 25 mm.
        camera: Camera { eye: [0.278, 0.273, -0.8], fov_y: 2.0 * (0.0125_f64 / 0.035).atan(), aspect_ratio: 1.0 },
    }
}

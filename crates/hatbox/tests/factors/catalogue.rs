//! The catalogue at every tolerance, as quads and as triangles, with and without occluders.

use crate::closed_forms::{hinged, parallel, perpendicular};
use crate::{FLOOR, Part, Quad, between_parts, level, meshes};
use glam::DVec3;
use hatbox::view_factors::{Between, Options, ViewFactors};
use std::f64::consts::TAU;

const TOLERANCES: [f64; 4] = [1e-2, 1e-4, 1e-6, 1e-8];

fn grouped(parts: &[Part], tolerance: f64) -> ViewFactors {
    between_parts(parts, &Options { tolerance, between: Between::Groups, ..Options::default() })
}

/// Every quad as two triangles.
fn split(parts: &[Part]) -> Vec<Part> {
    let halves = |face: &Vec<[f64; 3]>| match face[..] {
        [a, b, c, d] => vec![vec![a, b, c], vec![a, c, d]],
        _ => vec![face.clone()],
    };
    parts.iter().map(|part| part.iter().flat_map(halves).collect()).collect()
}

/// The factor from the first to the second part is what it should be, to the tolerance, whatever the rest hides.
#[track_caller]
fn assert_factor(name: &str, parts: &[Part], exact: f64) {
    for (kind, parts) in [("quads", parts.to_vec()), ("triangles", split(parts))] {
        for tolerance in TOLERANCES {
            let found = grouped(&parts, tolerance);
            let error = (found.get(0, 1) - exact).abs();
            assert!(error <= tolerance * exact, "{name} as {kind} at {tolerance:e}: {} for {exact}", found.get(0, 1));
        }
    }
}

fn quads(all: &[Quad]) -> Vec<Part> {
    all.iter().map(|quad| vec![quad.to_vec()]).collect()
}

#[test]
fn parallel_rectangles() {
    for (gap, exact) in [(1.0, 0.199_824_895_698_387), (0.5, 0.415_253_283_577_147), (0.1, 0.826_994_522_397_257)] {
        assert!((parallel([0., 1.], [0., 1.], [0., 1.], [0., 1.], gap) - exact).abs() < 1e-14);
        assert_factor("C-11", &quads(&[FLOOR, level([0., 1.], [0., 1.], gap, false)]), exact);
    }
    let offset = level([0.5, 2.], [1., 1.5], 1., false);
    assert_factor("C-13", &quads(&[FLOOR, offset]), 0.058_720_926_649_154);
}

#[test]
fn perpendicular_rectangles() {
    for (height, exact) in [(1.0, 0.200_043_776_075_403), (2.0, 0.232_852_602_795_362)] {
        let wall = [[0., 0., 0.], [0., 1., 0.], [0., 1., height], [0., 0., height]];
        assert_factor("C-14", &quads(&[FLOOR, wall]), exact);
    }
    for (x, xi, eta) in [([0.5, 1.5], [0.2, 0.9], [0.3, 2.0]), ([0.0, 1.0], [0.0, 1.0], [1.0, 2.0])] {
        let floor = level(x, [0., 1.], 0., true);
        let wall = [[0., eta[0], xi[0]], [0., eta[1], xi[0]], [0., eta[1], xi[1]], [0., eta[0], xi[1]]];
        assert_factor("C-15", &quads(&[floor, wall]), perpendicular(x, [0., 1.], xi, eta) / (x[1] - x[0]));
    }
}

#[test]
fn squares_at_an_angle() {
    let known = [
        (30.0, 0.619_028_323_090_803),
        (45.0, 0.483_347_695_478_878),
        (60.0, 0.370_905_321_150_051),
        (120.0, 0.086_615_001_118_276),
        (135.0, 0.048_309_447_801_818),
        (150.0, 0.021_345_325_412_689),
    ];
    for (degrees, exact) in known {
        assert!((hinged(f64::to_radians(degrees)) - exact).abs() < 1e-13, "{degrees}°");
    }
    // At 179° the factor is below what the tolerance of a row asks for; `pairs` tests such angles.
    for degrees in [5.0, 30.0, 45.0, 60.0, 90.0, 120.0, 135.0, 150.0_f64] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let wall = [[0., 0., 0.], [0., 1., 0.], [cos, 1., sin], [cos, 0., sin]];
        assert_factor(&format!("C-16 {degrees}°"), &quads(&[FLOOR, wall]), hinged(degrees.to_radians()));
    }
}

#[test]
fn squares_with_a_sheet_between() {
    for (name, x, y, z, exact) in [
        ("half", [0., 0.5], [0., 1.], 0.5, 0.099_912_447_849_194),
        ("quarter", [0., 0.5], [0., 0.5], 0.5, 0.149_868_671_773_790),
        ("centred", [0.25, 0.75], [0.25, 0.75], 0.75, 0.115_620_602_132),
    ] {
        assert_factor(name, &quads(&[FLOOR, level([0., 1.], [0., 1.], 1., false), level(x, y, z, true)]), exact);
    }
    // The receiver holds the whole shadow.
    let (side, sheet) = ([-0.3, 1.3], [0.4, 0.6]);
    let exact = parallel([0., 1.], [0., 1.], side, side, 1.0) - parallel([0., 1.], [0., 1.], sheet, sheet, 0.5);
    let scene = [FLOOR, level(side, side, 1., false), level(sheet, sheet, 0.5, true)];
    assert_factor("shadow", &quads(&scene), exact);
}

/// All that goes through the aperture in a screen across a box arrives behind it.
#[test]
fn an_aperture_in_an_opaque_screen() {
    let ([x0, x1], [y0, y1]) = ([0.3, 0.6], [0.2, 0.7]);
    let screen = [
        level([0., x0], [0., 1.], 0.5, false),
        level([x1, 1.], [0., 1.], 0.5, false),
        level([x0, x1], [0., y0], 0.5, false),
        level([x0, x1], [y1, 1.], 0.5, false),
    ];
    let behind = meshes::CUBE[1..].iter().map(|wall| wall.map(|[x, y, z]| [x, y, 0.5 + 0.5 * z]).to_vec()).collect();
    let parts = [vec![FLOOR.to_vec()], behind, screen.map(|quad| quad.to_vec()).to_vec()];
    let exact = parallel([0., 1.], [0., 1.], [x0, x1], [y0, y1], 0.5);
    assert_factor("aperture", &parts, exact);
}

/// The points of a regular polygon at a height.
fn ring(corners: usize, radius: f64, z: f64) -> Vec<[f64; 3]> {
    let at = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / corners as f64).sin_cos();
        [radius * cos, radius * sin, z]
    };
    (0..corners).map(at).collect()
}

/// The faces between two rings; they look up, or inwards if the second is above the first.
fn band(from: &[[f64; 3]], to: &[[f64; 3]]) -> Part {
    let n = from.len();
    (0..n).map(|k| vec![from[k], to[k], to[(k + 1) % n], from[(k + 1) % n]]).collect()
}

fn reversed(part: Part) -> Part {
    part.into_iter().map(|face| face.into_iter().rev().collect()).collect()
}

/// A fan over a ring that looks up.
fn disk(ring: &[[f64; 3]]) -> Part {
    let n = ring.len();
    (0..n).map(|k| vec![[0., 0., ring[0][2]], ring[k], ring[(k + 1) % n]]).collect()
}

fn area(part: &Part) -> f64 {
    let triangle = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
        let [a, b, c] = [a, b, c].map(DVec3::from);
        0.5 * (b - a).cross(c - a).length()
    };
    part.iter().flat_map(|face| (2..face.len()).map(|k| triangle(face[0], face[k - 1], face[k]))).sum()
}

/// A faceted shape's factor tends to the smooth one with the square of the facets' size: halving it quarters the error, to
/// terms of the next even order.
#[track_caller]
fn assert_convergence(name: &str, factor: impl Fn(usize) -> f64, coarse: usize, exact: f64) {
    let [first, second] = [coarse, 2 * coarse].map(|n| factor(n) - exact);
    let ratio = first / second;
    assert!((ratio - 4.0).abs() < 0.4, "{name}: errors {first:e}, {second:e}");
    let extrapolated = (4.0 * second - first) / 3.0;
    assert!(extrapolated.abs() < 0.1 * second.abs(), "{name}: {extrapolated:e}");
}

#[test]
fn coaxial_disks() {
    for (r1, r2, h) in [(1.0_f64, 1.0_f64, 1.0_f64), (1.0, 0.5, 0.7)] {
        let s = 1.0 + (h * h + r2 * r2) / (r1 * r1);
        let exact = 0.5 * (s - (s * s - 4.0 * r2 * r2 / (r1 * r1)).sqrt());
        let factor = |n| {
            let parts = [disk(&ring(n, r1, 0.0)), reversed(disk(&ring(n, r2, h)))];
            grouped(&parts, 1e-7).get(0, 1)
        };
        assert_convergence("C-40/41", factor, 12, exact);
    }
}

#[test]
fn spherical_caps_see_themselves() {
    let beta = 1.1_f64;
    let cap = |n: usize, rows: usize| {
        let at = |k: usize| {
            let (sin, cos) = (beta * k as f64 / rows as f64).sin_cos();
            ring(n, sin, -cos)
        };
        let mut part = disk(&at(1)).into_iter().map(|f| vec![[0., 0., -1.], f[1], f[2]]).collect::<Part>();
        (1..rows).for_each(|k| part.extend(band(&at(k), &at(k + 1))));
        part
    };
    // What leaves the facets for none of them leaves through the polygon of the rim.
    let part = cap(12, 3);
    let exact = 1.0 - area(&disk(&ring(12, beta.sin(), 0.0))) / area(&part);
    for tolerance in TOLERANCES {
        let found = grouped(std::slice::from_ref(&part), tolerance).get(0, 0);
        assert!((found - exact).abs() <= tolerance, "{tolerance:e}: {found} for {exact}");
    }
    let factor = |n: usize| grouped(&[cap(n, n / 4)], 1e-5).get(0, 0);
    assert_convergence("cap", factor, 16, 0.5 * (1.0 - beta.cos()));
}

#[test]
fn cylinders_see_themselves() {
    let lateral = |n: usize| {
        let part = band(&ring(n, 1.0, 0.0), &ring(n, 1.0, 2.0));
        grouped(&[part], 1e-6).get(0, 0)
    };
    assert_convergence("cylinder", lateral, 10, 0.585_786_437_626_905);
}

#[test]
fn concentric_cylinders() {
    let parts = |n: usize| {
        let [low, high] = [0.0, 2.0].map(|z| (ring(n, 1.0, z), ring(n, 2.0, z)));
        let ends = [band(&low.0, &low.1), reversed(band(&high.0, &high.1))].concat();
        [band(&low.1, &high.1), reversed(band(&low.0, &high.0)), ends]
    };
    let found = grouped(&parts(12), 1e-4);
    assert!(found.is_closed(), "{}", found.escape);
    assert!(found.check().max_row_sum_error <= 1e-4, "{}", found.check().max_row_sum_error);
    let factor = |n: usize, to: usize| grouped(&parts(n), 1e-4).get(0, to);
    assert_convergence("C-91", |n| factor(n, 1), 10, 0.337_106_027_518_950);
    assert_convergence("C-92", |n| factor(n, 0), 10, 0.228_481_018_987_999);
}

/// Of a convex body in a closed convex shell: all that leaves the body reaches the shell.
#[test]
fn concentric_spheres() {
    let sphere = |radius: f64| -> Part {
        let mesh = meshes::icosphere(1);
        let cell = |cell: &hatbox::mesh::Cell| {
            cell.corners().iter().map(|&v| (radius * mesh.vertices[v as usize]).to_array()).collect()
        };
        mesh.cells.iter().map(cell).collect()
    };
    let parts = [sphere(0.5), reversed(sphere(1.0))];
    let ratio = area(&parts[0]) / area(&parts[1]);
    for tolerance in [1e-2, 1e-3] {
        let found = grouped(&parts, tolerance);
        for (i, j, exact) in [(0, 0, 0.0), (0, 1, 1.0), (1, 0, ratio), (1, 1, 1.0 - ratio)] {
            let error = (found.get(i, j) - exact).abs();
            assert!(error <= tolerance, "{tolerance:e}: F_{i}{j} = {} for {exact}", found.get(i, j));
        }
    }
}

//! Pair integrals against closed forms: the unoccluded view factors, from a single element per surface.

#![expect(clippy::float_cmp, reason = "what cannot be seen is exactly 0")]

#[allow(dead_code, reason = "other tests use the rest")]
mod closed_forms;

use glam::{DMat3, DVec3};
use hatbox::assemble::{Accuracy, Block, Panel, Sight, pair_block};
use hatbox::element::{ALL, Basis, Shape};
use hatbox::mesh::Patch;
use std::f64::consts::PI;

type Corners = [DVec3; 4];

/// Panels over the given corners (a triangle repeats its last); corners at the same place get the same index.
fn panels(all: &[Corners], basis: &Basis) -> Vec<Panel> {
    let mut seen: Vec<DVec3> = Vec::new();
    let mut index = |p: DVec3| {
        let found = seen.iter().position(|&q| q.distance(p) < 1e-12).unwrap_or(seen.len());
        if found == seen.len() {
            seen.push(p);
        }
        found as u32
    };
    let mut panel = |(k, corners): (usize, &Corners)| {
        let shape = if corners[2] == corners[3] { Shape::Triangle } else { Shape::Quad };
        let element = basis.element(shape).expect("an element for the shape");
        Panel::new(Patch::new(shape, *corners), element, corners.map(&mut index), k as u32)
    };
    all.iter().enumerate().map(&mut panel).collect()
}

fn block(a: &Panel, b: &Panel, tolerance: f64) -> Block {
    pair_block(a, b, Sight::Clear, [1.0; 2], &Accuracy::new(tolerance, a.area() + b.area()))
}

fn view_factor(a: Corners, b: Corners, tolerance: f64) -> f64 {
    let panels = panels(&[a, b], &ALL[0]);
    block(&panels[0], &panels[1], tolerance).sum() / panels[0].area()
}

fn area(q: Corners) -> f64 {
    Patch::new(Shape::Quad, q).area()
}

/// A rectangle in a plane z = const, facing up or down.
fn level(x: [f64; 2], y: [f64; 2], z: f64, up: bool) -> Corners {
    let mut c = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])].map(|(x, y)| DVec3::new(x, y, z));
    if !up {
        c.reverse();
    }
    c
}

fn floor() -> Corners {
    level([0.0, 1.0], [0.0, 1.0], 0.0, true)
}

/// A rectangle that shares the floor's edge on the x axis, raised by the angle φ, facing the floor.
fn hinged(phi: f64, height: f64) -> Corners {
    let (s, c) = phi.sin_cos();
    let up = DVec3::new(0.0, c, s) * height;
    [DVec3::ZERO, up, up + DVec3::X, DVec3::X]
}

fn check(name: &str, a: Corners, b: Corners, exact: f64) {
    for tolerance in [1e-3, 1e-5, 1e-7] {
        let there = view_factor(a, b, tolerance);
        let back = view_factor(b, a, tolerance) * area(b) / area(a);
        for value in [there, back] {
            assert!(
                (value - exact).abs() <= 5.0 * tolerance * exact.max(0.01),
                "{name}, {tolerance:e}: {value} {exact}"
            );
        }
    }
}

#[test]
fn parallel_unit_squares_c11() {
    for (h, exact) in [(1.0, 0.199_824_895_698_387), (0.5, 0.415_253_283_577_147), (0.1, 0.826_994_522_397_257)] {
        check("C-11", floor(), level([0.0, 1.0], [0.0, 1.0], h, false), exact);
    }
}

#[test]
fn parallel_rectangles_with_an_offset_c13() {
    check("C-13", floor(), level([0.5, 2.0], [1.0, 1.5], 1.0, false), 0.058_720_926_649_154);
}

#[test]
fn squares_sharing_an_edge_c14_c16() {
    for (degrees, height, exact) in [
        (30.0, 1.0, 0.619_028_323_090_803),
        (45.0, 1.0, 0.483_347_695_478_878),
        (60.0, 1.0, 0.370_905_321_150_051),
        (90.0, 1.0, 0.200_043_776_075_403),
        (90.0, 2.0, 0.232_852_602_795_362),
        (120.0, 1.0, 0.086_615_001_118_276),
        (135.0, 1.0, 0.048_309_447_801_818),
        (150.0, 1.0, 0.021_345_325_412_689),
    ] {
        check(&format!("C-16 {degrees}°"), floor(), hinged(f64::to_radians(degrees), height), exact);
    }
}

#[test]
fn perpendicular_rectangles_apart_c15() {
    // A in the plane z = 0: x ∈ [x₁, x₂], y ∈ [0, 1]; B in the plane x = 0: z ∈ [ξ₁, ξ₂], y ∈ [η₁, η₂].
    for (x, xi, eta) in [([0.5, 1.5], [0.2, 0.9], [0.3, 2.0]), ([0.0, 1.0], [0.0, 1.0], [1.0, 2.0])] {
        let a = level(x, [0.0, 1.0], 0.0, true);
        let at = |y: f64, z: f64| DVec3::new(0.0, y, z);
        let b = [at(eta[0], xi[0]), at(eta[1], xi[0]), at(eta[1], xi[1]), at(eta[0], xi[1])];
        check("C-15", a, b, closed_forms::perpendicular(x, [0.0, 1.0], xi, eta) / area(a));
    }
}

#[test]
fn a_panel_does_not_see_itself_its_plane_or_its_back() {
    let back = level([0.0, 1.0], [0.0, 1.0], 0.0, false);
    let neighbour = level([1.0, 2.0], [0.0, 1.0], 0.0, true);
    let behind = level([0.0, 1.0], [0.0, 1.0], -1.0, true);
    for other in [floor(), back, neighbour, behind] {
        assert_eq!(view_factor(floor(), other, 1e-6), 0.0);
    }
}

#[test]
fn a_source_that_crosses_the_horizon_counts_with_its_visible_part() {
    // A wall half sunk below the floor gives what its upper half gives.
    let wall = |z: f64, x: f64| {
        let at = |y: f64, z: f64| DVec3::new(x, y, z);
        [at(0.0, z), at(1.0, z), at(1.0, 1.0), at(0.0, 1.0)]
    };
    for x in [-0.5, 0.0] {
        let (whole, half) = (view_factor(floor(), wall(-1.0, x), 1e-7), view_factor(floor(), wall(0.0, x), 1e-7));
        assert!((whole - half).abs() < 2e-7, "{whole} {half}");
    }
}

/// ∬N_i N_j G of every basis, summed over i and j, is ∬G: every rule integrates every element.
#[test]
fn blocks_of_all_bases_sum_to_the_same_exchange() {
    let split = |q: Corners| vec![[q[0], q[1], q[2], q[2]], [q[0], q[2], q[3], q[3]]];
    for (name, b) in [
        ("far", level([0.0, 1.0], [3.0, 4.0], 4.0, false)),
        ("near", level([0.2, 1.4], [0.0, 1.0], 0.2, false)),
        ("trapezium", [(0.2, 0.0), (0.5, 1.0), (1.0, 1.0), (1.4, 0.0)].map(|(x, y)| DVec3::new(x, y, 0.4))),
        ("right angle", hinged(PI / 2.0, 1.0)),
        ("acute angle", hinged(PI / 6.0, 1.0)),
    ] {
        let exact = view_factor(floor(), b, 1e-8);
        for basis in &ALL {
            let parts = |q| if basis.quad.is_some() { vec![q] } else { split(q) };
            let (on_a, on_b) = (parts(floor()), parts(b));
            let panels = panels(&[on_a.clone(), on_b].concat(), basis);
            let (first, second) = panels.split_at(on_a.len());
            let pairs = first.iter().flat_map(|s| second.iter().map(move |t| (s, t)));
            let total: f64 = pairs.map(|(s, t)| block(s, t, 1e-6).sum()).sum();
            assert!((total - exact).abs() < 3e-6, "{name}, {}: {total} {exact}", basis.name);
        }
    }
}

/// Entries of a block, not only their sum: the transform for touching panels against the closed form, which is used
/// when the same panels' corners are given different indices.
#[test]
fn two_rules_for_the_same_pair_give_the_same_entries() {
    for basis in [&ALL[1], &ALL[3]] {
        for degrees in [60.0, 90.0, 130.0f64] {
            let (a, b) = (floor(), hinged(degrees.to_radians(), 1.0));
            let triangle = |q: Corners, ids: [u32; 4]| {
                Panel::new(Patch::new(Shape::Triangle, [q[0], q[1], q[2], q[2]]), basis.triangle, ids, 0)
            };
            let a = triangle(a, [0, 1, 2, 2]);
            let b = [b[3], b[0], b[1], b[1]];
            let touching = block(&a, &triangle(b, [1, 0, 3, 3]), 1e-6);
            let apart = block(&a, &triangle(b, [4, 5, 6, 6]), 1e-6);
            for (t, n) in touching.values().iter().zip(apart.values()) {
                assert!((t - n).abs() < 3e-6, "{} {degrees}°: {t} {n}", basis.name);
            }
        }
    }
}

#[test]
fn exchange_is_invariant_under_rigid_motion_and_scaling() {
    let (a, b) = (floor(), hinged(1.2, 1.5));
    let exact = view_factor(a, b, 1e-8);
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.7);
    for (scale, shift) in [(1.0, DVec3::new(3.0, -2.0, 5.0)), (1e-3, DVec3::ZERO), (1e4, DVec3::splat(1e5))] {
        let moved = |q: Corners| q.map(|p| turn * p * scale + shift);
        let element = ALL[0].element(Shape::Quad).expect("constant quads");
        let panel = |q, ids| Panel::new(Patch::new(Shape::Quad, moved(q)), element, ids, 0);
        let (a, b) = (panel(a, [0, 1, 2, 3]), panel(b, [0, 4, 5, 1]));
        let f = block(&a, &b, 1e-8).sum() / a.area();
        assert!((f - exact).abs() < 1e-7, "scale {scale}: {f} {exact}");
    }
}

//! Slivers, almost coplanar and crossing panels, and scenes of any size anywhere.

#![expect(clippy::float_cmp, reason = "what cannot be seen is exactly 0")]

use crate::closed_forms::{hinged, perpendicular};
use crate::{kernel, panel};
use glam::{DMat3, DVec3};
use hatbox::assemble::{Accuracy, Block, Panel, Sight, pair_block};
use hatbox::element::{ALL, Shape};
use hatbox::mesh::Patch;
use hatbox::quadrature::gauss_legendre;
use std::f64::consts::PI;

const TOLERANCES: [f64; 4] = [1e-2, 1e-4, 1e-6, 1e-8];
/// Width of a sliver of unit length.
const SLIVER: f64 = 1e-6;

/// A panel with a constant function; of three corners the last is repeated.
fn constant(corners: &[DVec3]) -> Panel {
    let shape = if corners.len() == 3 { Shape::Triangle } else { Shape::Quad };
    let last = corners.len() - 1;
    panel([0, 1, 2, 3].map(|k: usize| corners[k.min(last)]), ALL[0].element(shape).expect("constants"))
}

fn clear(a: &Panel, b: &Panel, tolerance: f64) -> Block {
    pair_block(a, b, Sight::Clear, [1.0; 2], &Accuracy::new(tolerance, a.area() + b.area()))
}

fn points(corners: &[[f64; 3]]) -> Vec<DVec3> {
    corners.iter().map(|&p| DVec3::from(p)).collect()
}

/// The pair and its reverse have a value to within the tolerance, and the error is within the estimate.
#[track_caller]
fn assert_area(name: &str, a: &[DVec3], b: &[DVec3], exact: f64, known_to: f64) {
    let (a, b) = (constant(a), constant(b));
    let mean = a.area() * b.area() / (a.area() + b.area());
    for tolerance in TOLERANCES {
        for (from, to) in [(&a, &b), (&b, &a)] {
            let block = clear(from, to, tolerance);
            let (error, allowed) = ((block.sum() - exact).abs(), tolerance * exact.max(mean) + known_to * exact);
            assert!(error <= allowed, "{name}, {tolerance:e}: {} instead of {exact}", block.sum());
            let reported = block.quadrature_error + known_to * exact + 1e-14 * mean;
            assert!(error <= reported, "{name}, {tolerance:e}: error {error:e}, reported {reported:e}");
        }
    }
}

/// The unit square and one that shares its edge on the y axis.
fn hinge(phi: f64) -> [Vec<DVec3>; 2] {
    let (sin, cos) = phi.sin_cos();
    let floor = points(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
    [floor, points(&[[0., 0., 0.], [0., 1., 0.], [cos, 1., sin], [cos, 0., sin]])]
}

#[test]
fn squares_at_any_angle_have_their_factor() {
    assert!((hinged(PI / 2.0) - 0.200_043_776_075_403).abs() < 1e-14, "{}", hinged(PI / 2.0));
    assert!((hinged(PI / 6.0) - 0.619_028_323_090_803).abs() < 1e-13, "{}", hinged(PI / 6.0));
    for degrees in [1.0, 5.0, 20.0, 75.0, 105.0, 170.0, 179.0_f64] {
        let [a, b] = hinge(degrees.to_radians());
        assert_area(&format!("{degrees}°"), &a, &b, hinged(degrees.to_radians()), 1e-12);
    }
}

/// What two panels exchange that are almost one plane grows with the square of the angle, and is never negative.
#[test]
fn almost_coplanar_squares_exchange_almost_nothing() {
    for angle in [1e-3, 1e-4, 1e-5, 1e-6, 1e-7] {
        let [a, b] = hinge(PI - angle);
        let (exact, [a, b]) = (hinged(PI - angle), [constant(&a), constant(&b)]);
        for tolerance in TOLERANCES {
            let block = clear(&a, &b, tolerance);
            let allowed = tolerance * exact.max(0.5);
            assert!(
                block.sum() >= 0.0 && (block.sum() - exact).abs() <= allowed,
                "{angle:e}: {} {exact:e}",
                block.sum()
            );
        }
    }
    // One right above the other, but farther than what counts as lying in its plane.
    for gap in [1e-3, 1e-4, 1e-5, 1e-6, 5e-7] {
        let floor = points(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
        let lid = points(&[[0., 0., gap], [0., 1., gap], [1., 1., gap], [1., 0., gap]]);
        let block = clear(&constant(&floor), &constant(&lid), 1e-6);
        // What is lost is a part of a strip of the gap's width along the rim.
        assert!(block.sum() <= 1.0 + 1e-6 && block.sum() >= 1.0 - 4.0 * gap - 1e-6, "{gap:e}: {}", block.sum());
    }
}

/// ∬ of the kernel between two straight slivers, by a product of rules along them; widths at the ends of the axes.
fn between_lines(a: [DVec3; 2], width_a: [f64; 2], n: DVec3, b: [DVec3; 2], width_b: [f64; 2], m: DVec3) -> f64 {
    let rule = gauss_legendre(60);
    let lerp = |w: [f64; 2], t: f64| w[0] + t * (w[1] - w[0]);
    let (of_a, of_b) = (a[0].distance(a[1]), b[0].distance(b[1]));
    let mut sum = 0.0;
    for (&(s, u), &(t, v)) in rule.iter().flat_map(|p| rule.iter().map(move |q| (p, q))) {
        let g = kernel(a[0].lerp(a[1], s), n, b[0].lerp(b[1], t), m);
        sum += u * v * of_a * of_b * lerp(width_a, s) * lerp(width_b, t) * g;
    }
    sum
}

#[test]
fn slivers_facing_each_other_exchange_what_lines_do() {
    let w = SLIVER;
    let strip = points(&[[0., 0., 0.], [1., 0., 0.], [1., w, 0.], [0., w, 0.]]);
    let over = points(&[[0.2, 0., 0.6], [0.2, w, 0.6], [1.2, w, 0.6], [1.2, 0., 0.6]]);
    let wedge = points(&[[0., 0., 0.], [1., 0., 0.], [1., w, 0.]]);
    let needle = points(&[[0.2, 0., 0.6], [0.2, w, 0.6], [1.2, 0., 0.6]]);
    let axis = [DVec3::ZERO, DVec3::X];
    let upper = [DVec3::new(0.2, 0.0, 0.6), DVec3::new(1.2, 0.0, 0.6)];
    for (name, a, b, wa, wb) in [
        ("strips", &strip, &over, [w, w], [w, w]),
        ("strip and triangle", &strip, &needle, [w, w], [w, 0.0]),
        ("triangles", &wedge, &needle, [0.0, w], [w, 0.0]),
    ] {
        let exact = between_lines(axis, wa, DVec3::Z, upper, wb, -DVec3::Z);
        // What the widths do is of the second order.
        assert_area(name, a, b, exact, 1e-9);
    }
}

#[test]
fn slivers_sharing_their_long_edge_exchange_what_strips_without_end_do() {
    let w = SLIVER;
    let a = points(&[[0., 0., 0.], [0., 1., 0.], [-w, 1., 0.], [-w, 0., 0.]]);
    for degrees in [30.0, 90.0, 150.0_f64] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let b = points(&[[0., 1., 0.], [0., 0., 0.], [-w * cos, 0., w * sin], [-w * cos, 1., w * sin]]);
        let (a, b) = (constant(&a), constant(&b));
        assert!(a.normal().z.abs() > 0.5);
        let crossed = w * (1.0 - (0.5 * degrees.to_radians()).sin());
        let found = if a.normal().z > 0.0 { clear(&a, &b, 1e-4) } else { clear(&flipped(&a), &flipped(&b), 1e-4) };
        // The ends take away a part of about the aspect.
        assert!(
            (found.sum() - crossed).abs() <= 1e-4 * crossed + 10.0 * w * crossed,
            "{degrees}°: {} {crossed}",
            found.sum()
        );
    }
}

fn flipped(panel: &Panel) -> Panel {
    let mut corners = panel.patch.corners().to_vec();
    corners.reverse();
    constant(&corners)
}

/// Two triangles of a sliver exchange what the sliver does, whichever diagonal cuts it.
#[test]
fn slivers_cut_into_triangles_exchange_the_same() {
    let w = SLIVER;
    let a = points(&[[0., 0., 0.], [1., 0., 0.], [1., w, 0.], [0., w, 0.]]);
    for b in [
        points(&[[0., 0., 0.], [0., 0., 0.5], [1., 0., 0.5], [1., 0., 0.]]),
        points(&[[0., 0., 0.], [0., 0., w], [1., 0., w], [1., 0., 0.]]),
        points(&[[0., -0.5, 0.2], [0., 0.5, 0.2], [1., 0.5, 0.2], [1., -0.5, 0.2]]),
    ] {
        let whole = clear(&constant(&a), &constant(&b), 1e-8).sum();
        for turn in [0, 1] {
            let cut = |q: &[DVec3]| [0, 2].map(|k| [0, 1, 2].map(|c| q[(k + c + turn) % 4]));
            let pairs = cut(&a).into_iter().flat_map(|s| cut(&b).map(|t| (s, t)));
            let sum: f64 = pairs.map(|(s, t)| clear(&constant(&s), &constant(&t), 1e-8).sum()).sum();
            assert!(whole > 0.0 && (sum - whole).abs() <= 1e-7 * whole, "{sum:e} {whole:e}");
        }
    }
}

/// Panels that go through each other exchange what their parts in front of each other do.
#[test]
fn interpenetrating_squares_exchange_what_their_visible_parts_do() {
    let floor = points(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
    let wall = |z: f64| points(&[[0.5, 0.2, z], [0.5, 0.8, z], [0.5, 0.8, 1.], [0.5, 0.2, 1.]]);
    let exact = perpendicular([0.0, 0.5], [0.0, 1.0], [0.0, 1.0], [0.2, 0.8]);
    assert_area("through", &floor, &wall(-1.0), exact, 1e-10);
    let tilted = |z: f64| points(&[[0.5 + z, 0.2, z], [0.5 + z, 0.8, z], [1.5, 0.8, 1.], [1.5, 0.2, 1.]]);
    let (whole, upper) = (constant(&tilted(-0.4)), constant(&tilted(0.0)));
    let (a, b) = (clear(&constant(&floor), &whole, 1e-8).sum(), clear(&constant(&floor), &upper, 1e-8).sum());
    assert!((a - b).abs() <= 2e-8 * b.max(0.1), "{a} {b}");
}

#[test]
fn backs_exchange_nothing() {
    let front = points(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
    for gap in [0.0, 1e-9, 1e-3, 1.0] {
        let back = points(&[[0., 0., -gap], [0., 1., -gap], [1., 1., -gap], [1., 0., -gap]]);
        for tolerance in TOLERANCES {
            assert_eq!(clear(&constant(&front), &constant(&back), tolerance).sum(), 0.0);
        }
    }
}

/// Factors know no unit: from micrometres to megametres they are the same to rounding, with and without a blocker.
#[test]
fn factors_do_not_know_the_unit() {
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.7);
    let [floor, wall] = hinge(1.2);
    let lid = points(&[[0.1, 0., 0.7], [0.1, 1., 0.7], [1.1, 1., 0.7], [1.1, 0., 0.7]]);
    let sheet = points(&[[0.3, 0.2, 0.3], [0.8, 0.3, 0.3], [0.6, 0.9, 0.4]]);
    let factors = |scale: f64, shift: DVec3| {
        let moved = |q: &[DVec3]| q.iter().map(|&p| turn * p * scale + shift * scale).collect::<Vec<_>>();
        let [a, b, c] = [&floor, &wall, &lid].map(|q| constant(&moved(q)));
        let sheet = moved(&sheet);
        let accuracy = Accuracy::new(1e-4, 10.0 * scale * scale);
        let hidden = |x, y| pair_block(x, y, Sight::Behind(&[&sheet]), [1.0; 2], &accuracy).sum();
        let clear = |x, y| pair_block(x, y, Sight::Clear, [1.0; 2], &accuracy).sum();
        [clear(&a, &b), clear(&a, &c), hidden(&a, &c), hidden(&a, &b)].map(|area| area / (scale * scale))
    };
    let plain = factors(1.0, DVec3::ZERO);
    assert!(plain[2] < 0.9 * plain[1] && plain[2] > 0.0, "{plain:?}");
    for scale in [1e-6, 1e-3, 1e3, 1e6] {
        for (found, plain) in factors(scale, DVec3::ZERO).iter().zip(plain) {
            assert!((found - plain).abs() <= 1e-9, "{scale:e}: {found} {plain}");
        }
    }
    // So far away coordinates have ten digits.
    for (found, plain) in factors(1.0, DVec3::new(1e6, -1e6, 1e6)).iter().zip(plain) {
        assert!((found - plain).abs() <= 1e-8, "far away: {found} {plain}");
    }
}

/// A gap that is narrower than the distance of any fixed points lets through what it must, and a slat as narrow takes it
/// away.
#[test]
fn a_grazing_sliver_is_not_overlooked() {
    let floor = constant(&points(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]));
    let lid = constant(&points(&[[0., 0., 1.], [0., 1., 1.], [1., 1., 1.], [1., 0., 1.]]));
    let whole = clear(&floor, &lid, 1e-10).sum();
    for width in [1e-2, 1e-3, 1e-4] {
        let slat = |from: f64, to: f64| points(&[[from, -1., 0.5], [to, -1., 0.5], [to, 2., 0.5], [from, 2., 0.5]]);
        // Off the points of any symmetric rule.
        let at = 0.413_7;
        let [narrow, left, right] = [slat(at, at + width), slat(-1.0, at), slat(at + width, 2.0)];
        for tolerance in [1e-2, 1e-3, 1e-4, 1e-5] {
            let accuracy = Accuracy::new(tolerance, 6.0);
            let block = |polygons: &[&[DVec3]]| pair_block(&floor, &lid, Sight::Behind(polygons), [1.0; 2], &accuracy);
            let (through, stopped) = (block(&[&left, &right]), block(&[&narrow]));
            let exact = through_a_slot(at, width);
            let error = (through.sum() - exact).abs();
            assert!(error <= through.quadrature_error + 1e-9, "{width:e} {tolerance:e}: {error:e}, gap {exact:e}");
            let error = (stopped.sum() - (whole - exact)).abs();
            assert!(error <= stopped.quadrature_error + 1e-9, "{width:e} {tolerance:e}: {error:e}, slat {exact:e}");
        }
    }
}

/// What passes from floor to lid between x = at and at + width half-way up: by x and x', the lines of sight of which go
/// through the slot, with the integral along y in closed form.
fn through_a_slot(at: f64, width: f64) -> f64 {
    // G = 1/(π r⁴), and ∬ dy dy'/(s² + (y − y')²)² = atan(1/s)/s³. Coordinates are the place in the slot t = (x + x')/2 and
    // d = x' − x, with a Jacobian of 1.
    let rule = gauss_legendre(24);
    let over = |t: f64| {
        let most = 2.0 * t.min(1.0 - t);
        let term = |d: f64| {
            let s = (1.0 + d * d).sqrt();
            (1.0 / s).atan() / s.powi(3) / PI
        };
        2.0 * most * rule.iter().map(|&(x, w)| w * term(x * most)).sum::<f64>()
    };
    width * rule.iter().map(|&(x, w)| w * over(at + x * width)).sum::<f64>()
}

/// Two neighbours on a sphere whose corners a file has rounded to seven digits: each is bent by rounding, so that a sliver of one
/// is in front of the other, with an edge of no length. That edge touched its neighbour at both ends, and was taken for it:
/// 0.84 of the light went from one to the other.
#[test]
fn neighbours_on_a_rounded_sphere_do_not_see_each_other() {
    let corners = points(&[
        [2.807_265, 1.565_74, 2.098_204],
        [2.716_844, 1.523_705, 2.144_275],
        [2.7429, 1.523_705, 2.186_794],
        [2.825, 1.565_74, 2.127_145],
        [2.775_286, 1.523_705, 2.224_714],
        [2.847_044, 1.565_74, 2.152_956],
    ]);
    let quad = |k: [u32; 4]| {
        let element = ALL[0].element(Shape::Quad).expect("constants");
        Panel::new(Patch::new(Shape::Quad, k.map(|k| corners[k as usize])), element, k, k[1])
    };
    let (a, b) = (quad([0, 1, 2, 3]), quad([3, 2, 4, 5]));
    for tolerance in TOLERANCES {
        for (from, to) in [(&a, &b), (&b, &a)] {
            let factor = clear(from, to, tolerance).sum() / from.area();
            assert!((0.0..1e-6).contains(&factor), "{tolerance:e}: {factor}");
        }
    }
}

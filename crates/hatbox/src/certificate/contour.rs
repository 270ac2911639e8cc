//! What a polygon sends to a receiver, edge by edge, with its gradient and what both leave.
//!
//! A polygon of exitance 1 whose corners run counter-clockwise about its normal, which nothing hides and which lies in front of the
//! receiver's plane, sends to a point x of normal n
//!
//! ```text
//! F(x) = (1/2π) Σ_edges ∫ w·ρ/|ρ|² dl,     ρ = y − x,     w = n × t,     t the direction of the edge
//! ```
//!
//! (Lambert's formula as a line integral.) φ(ρ) = ρ/|ρ|² is the inversion at the unit sphere: |φ| = 1/|ρ|, |φ'| = 1/|ρ|² and
//! |φ''| = 2/|ρ|³, from which what a linear function leaves of F within a receiver is bounded.

use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, TAU};

/// Where light arrives: a part of a plane about a point.
#[derive(Debug, Clone)]
pub(super) struct Place<'a> {
    pub(super) center: DVec3,
    pub(super) normal: DVec3,
    pub(super) corners: &'a [DVec3],
    /// No corner is farther from the center.
    pub(super) radius: f64,
    /// What is no farther from the plane lies in it.
    pub(super) flat: f64,
}

/// A function of the place x: `value` + `gradient`·(x − center), wrong by no more than `rest`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Local {
    pub(super) value: f64,
    pub(super) gradient: DVec3,
    pub(super) rest: f64,
}

impl Local {
    pub(super) fn add(&mut self, other: Self) {
        self.value += other.value;
        self.gradient += other.gradient;
        self.rest += other.rest;
    }
}

/// The part of F that belongs to the edge from `a` to `b`; nothing is known of it (`rest` is infinite) where the receiver reaches the
/// edge, or an end of an edge in its own plane.
pub(super) fn edge(place: &Place<'_>, a: DVec3, b: DVec3) -> Local {
    let (from, to) = (a - place.center, b - place.center);
    let length = from.distance(to);
    if length == 0.0 {
        return Local::default();
    }
    let t = (to - from) / length;
    let (s1, s2) = (from.dot(t), to.dot(t));
    let across = from - s1 * t;
    let (d, w) = (across.length(), place.normal.cross(t));
    let (d1, d2) = (from.length_squared(), to.length_squared());
    let height = w.dot(across);
    let angle = (d * length).atan2(from.dot(to));
    let flat = [from, to].iter().all(|end| end.dot(place.normal).abs() <= place.flat);
    // ∫dl/D, ∫s dl/D² and the difference of s/D at the ends, with D = |ρ|².
    let over = if d > 1e-12 * length { angle / d } else { (1.0 / s1 - 1.0 / s2).abs() };
    let (odd, ends) = (0.5 * (1.0 / d1 - 1.0 / d2), s2 / d2 - s1 / d1);
    let along = if flat || d == 0.0 { w } else { across * (height / (d * d)) };
    // In the receiver's plane w is along what leads across, and the first term vanishes without cancellation.
    let aside = if flat { DVec3::ZERO } else { (along - w) * over };
    let gradient = aside + along * ends + 2.0 * height * odd * t;
    let rest = if flat { flat_rest(place, [a, b], w, [d1, d2]) } else { rest(place.radius, [s1, s2], [d1, d2], d, w) };
    Local { value: height * over / TAU, gradient: gradient / TAU, rest }
}

/// ½r² max|F''| of an edge in the receiver's own plane: F = ±angle/2π there, a harmonic function with poles at the ends.
fn flat_rest(place: &Place<'_>, [a, _]: [DVec3; 2], w: DVec3, squares: [f64; 2]) -> f64 {
    let beyond = |sign: f64| place.corners.iter().all(|&corner| sign * w.dot(a - corner) >= -place.flat);
    let pole = |square: f64| {
        let nearest = square.sqrt() - place.radius;
        if nearest > 0.0 { 1.0 / (nearest * nearest) } else { f64::INFINITY }
    };
    if !beyond(1.0) && !beyond(-1.0) {
        return f64::INFINITY;
    }
    0.5 * place.radius.powi(2) * (pole(squares[0]) + pole(squares[1])) / TAU
}

/// ½r² ∫ |w| 2/|ρ|³ dl / 2π of another edge.
fn rest(radius: f64, [s1, s2]: [f64; 2], [d1, d2]: [f64; 2], d: f64, w: DVec3) -> f64 {
    let (r1, r2) = (d1.sqrt(), d2.sqrt());
    let nearest = if s1 < 0.0 && s2 > 0.0 { d } else { r1.min(r2) };
    if nearest <= radius {
        return f64::INFINITY;
    }
    // ∫ds/D^(3/2): the difference of s/√D over d², without cancellation.
    let cubes = if s1 < 0.0 && s2 > 0.0 {
        (s2 / r2 - s1 / r1) / (d * d)
    } else {
        let (near, far) = (s1.abs().min(s2.abs()), s1.abs().max(s2.abs()));
        let (r_near, r_far) = (r1.min(r2), r1.max(r2));
        (far - near) * (far + near) / (r_near * r_far * (far * r_near + near * r_far))
    };
    let shrunk = (1.0 - radius / nearest).powi(3);
    0.5 * radius.powi(2) * w.length() * 2.0 * cubes / shrunk / TAU
}

/// ½r² max|F''| of a source of that area at that distance at the least: |G''| ≤ 6/π|ρ|⁴.
pub(super) fn far_rest(radius: f64, area: f64, nearest: f64) -> f64 {
    if nearest > 0.0 { 3.0 * FRAC_1_PI * area * radius.powi(2) / nearest.powi(4) } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{Moments, Plane};
    use crate::mesh::polygon::area_vector;
    use crate::quadrature::sequence::{hash, point};

    fn at(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }

    /// A wall on the floor's edge, and a triangle in the air, with receivers of the floor in front of both.
    fn cases() -> impl Iterator<Item = (Vec<DVec3>, DVec3)> {
        let wall = vec![at(0.0, 0.0, 1.0), at(1.0, 0.0, 1.0), at(1.0, 0.0, 0.0), at(0.0, 0.0, 0.0)];
        let air = vec![at(-0.4, 0.7, 0.8), at(0.3, 1.3, 0.9), at(0.5, 0.3, 1.4)];
        let receivers = [at(0.4, 0.5, 0.0), at(0.7, 0.2, 0.0), at(0.1, 0.8, 0.0), at(1.8, 0.4, 0.0)];
        [wall, air].into_iter().flat_map(move |polygon| receivers.map(|x| (polygon.clone(), x)))
    }

    fn local(polygon: &[DVec3], corners: &[DVec3], center: DVec3) -> Local {
        let radius = corners.iter().map(|corner| corner.distance(center)).fold(0.0, f64::max);
        let place = Place { center, normal: DVec3::Z, corners, radius, flat: 1e-12 };
        let mut sum = Local::default();
        (0..polygon.len()).for_each(|k| sum.add(edge(&place, polygon[k], polygon[(k + 1) % polygon.len()])));
        sum
    }

    fn exact(polygon: &[DVec3], x: DVec3) -> f64 {
        let plane = Plane::new(polygon[0], area_vector(polygon).normalize());
        let corners: Vec<_> = polygon.iter().map(|&corner| plane.project(corner)).collect();
        Moments::new(&plane, &corners, x, DVec3::Z, 0).values[0]
    }

    #[test]
    fn edges_sum_to_the_form_factor_and_its_slope() {
        for (polygon, x) in cases() {
            let (found, step) = (local(&polygon, &[x], x), 1e-4);
            assert!((found.value - exact(&polygon, x)).abs() < 1e-12, "{x}: {} {}", found.value, exact(&polygon, x));
            for way in [DVec3::X, DVec3::Y] {
                let slope = (exact(&polygon, x + way * step) - exact(&polygon, x - way * step)) / (2.0 * step);
                assert!((found.gradient.dot(way) - slope).abs() < 1e-6, "{x}: {} {slope}", found.gradient.dot(way));
            }
        }
    }

    #[test]
    fn a_linear_function_errs_by_no_more_than_its_rest() {
        let mut known = 0;
        for (case, (polygon, center)) in cases().enumerate() {
            for size in [0.02, 0.1, 0.3] {
                let corners = [at(-1.0, -0.6, 0.0), at(1.0, -0.6, 0.0), at(0.0, 1.2, 0.0)].map(|c| center + size * c);
                let found = local(&polygon, &corners, center);
                known += u32::from(found.rest < 0.05);
                for k in 0..50 {
                    let [u, v, ..] = point(hash(7, case as u64), k);
                    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                    let x = corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v;
                    let error = (found.value + found.gradient.dot(x - center) - exact(&polygon, x)).abs();
                    assert!(error <= found.rest + 1e-12, "{center} {size}: {error} > {}", found.rest);
                }
            }
        }
        assert!(known > 10, "most receivers are small enough for it to mean something: {known}");
    }

    #[test]
    fn what_is_left_falls_with_the_square_of_the_size() {
        for (polygon, center) in cases() {
            let rest = |size: f64| local(&polygon, &[center + size * DVec3::X, center - size * DVec3::X], center).rest;
            assert!(rest(0.01) > 0.0 && rest(0.005) <= 0.25 * rest(0.01), "{center}: {} {}", rest(0.005), rest(0.01));
        }
    }
}

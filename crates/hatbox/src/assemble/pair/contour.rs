//! Two polygons of constant exitance, by integrals along their edges.
//!
//! By Stokes' theorem ∬G = (1/2π) ∮∮ ln r dx·dy, each boundary counter-clockwise about its own normal (E. M. Sparrow,
//! "A new and simpler formulation for radiative angle factors", J. Heat Transfer 85, 1963). The integral of ln r along a
//! segment is elementary, so one numerical integral per pair of edges is left, of a function that is smooth unless the
//! edges are close. Where they touch, that one is elementary as well: with the common end at the origin ln r splits
//! into ln u + ln ρ(v) in r = u ρ(v). So neighbours, which are the hardest pairs for rules on areas, are the easiest here.
//! Far from each other the sum cancels; Gauss rules on areas belong there.

use super::{Accuracy, Block, Region};
use crate::assemble::Panel;
use crate::quadrature::gauss_legendre;
use arrayvec::ArrayVec;
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Gauss orders along an edge.
const ORDERS: [usize; 4] = [4, 6, 10, 16];
/// Parts of an edge at the most.
const MAX_PARTS: usize = 1000;
/// See [`Edge::errors`]: about twice the most that was met among random pairs of edges.
const BOUND: f64 = 12.0;
/// What two sums may differ by from rounding alone, relative to their terms.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

static RULES: LazyLock<[Vec<(f64, f64)>; ORDERS.len()]> = LazyLock::new(|| ORDERS.map(gauss_legendre));

/// The block of two panels with constant functions.
pub(super) fn block(a: &Panel, on_a: &Region, b: &Panel, on_b: &Region, accuracy: &Accuracy) -> Block {
    let mut block = Block::zeros(a, b);
    // The sum is not known yet; the least that it may err by is. A second round has the budget of the sum.
    let mut budget = accuracy.budget(a, b, 0.0);
    for _ in 0..2 {
        let [value, error] = integral(on_a.corners(), on_b.corners(), budget);
        (block.values[0], block.quadrature_error) = (value.max(0.0), error);
        let needed = accuracy.budget(a, b, value);
        if error <= needed {
            break;
        }
        budget = 0.25 * needed;
    }
    block
}

/// (1/2π) ∮∮ ln r dx·dy and its error.
fn integral(a: &[DVec3], b: &[DVec3], budget: f64) -> [f64; 2] {
    let edges = |polygon: &[DVec3]| -> Vec<Edge> {
        (0..polygon.len()).filter_map(|k| Edge::new(polygon[k], polygon[(k + 1) % polygon.len()])).collect()
    };
    let (a, b) = (edges(a), edges(b));
    let share = 2.0 * PI * budget / (a.len() * b.len()) as f64;
    let mut sum = [0.0; 2];
    for (e, f) in a.iter().flat_map(|e| b.iter().map(move |f| (e, f))) {
        let cosine = e.direction.dot(f.direction);
        if cosine.abs() > 1e-15 {
            let [value, error] = e.with(f, share / cosine.abs());
            sum[0] += cosine * value;
            sum[1] += cosine.abs() * error;
        }
    }
    sum.map(|s| s / (2.0 * PI))
}

/// A directed segment.
#[derive(Clone, Copy)]
struct Edge {
    start: DVec3,
    direction: DVec3,
    length: f64,
}

impl Edge {
    fn new(start: DVec3, end: DVec3) -> Option<Self> {
        let length = start.distance(end);
        (length > 0.0).then(|| Self { start, direction: (end - start) / length, length })
    }

    fn at(&self, s: f64) -> DVec3 {
        self.start + self.direction * (s * self.length)
    }

    fn end(&self) -> DVec3 {
        self.start + self.direction * self.length
    }

    /// ∫ ln|x − y| ds over the segment's points y.
    fn logarithm(&self, x: DVec3) -> f64 {
        let to = self.start - x;
        let s0 = to.dot(self.direction);
        let s1 = s0 + self.length;
        let d = to.cross(self.direction).length();
        let primitive = |s: f64| {
            let r2 = s * s + d * d;
            if r2 > 0.0 { s * (0.5 * r2.ln() - 1.0) } else { 0.0 }
        };
        primitive(s1) - primitive(s0) + d * (self.length * d).atan2(d * d + s0 * s1)
    }

    /// ∬ ln r over two segments, and its error.
    fn with(&self, other: &Self, budget: f64) -> [f64; 2] {
        let (mine, others) = ([self.start, self.end()], [other.start, other.end()]);
        let touch = |p: DVec3, q: DVec3| p.distance_squared(q) <= 1e-28 * (self.length + other.length).powi(2);
        let shared: ArrayVec<(usize, usize), 4> =
            [(0, 0), (0, 1), (1, 0), (1, 1)].into_iter().filter(|&(i, j)| touch(mine[i], others[j])).collect();
        match shared[..] {
            [] => self.apart(other, budget),
            [.., last] if shared[0].0 != last.0 && shared[0].1 != last.1 => {
                [self.length * self.length * (self.length.ln() - 1.5), 0.0]
            }
            // One end, or an edge that clipping has left, so short that both of its ends are there.
            [(i, j), ..] => [self.at_a_corner(mine[1 - i], other, others[1 - j]), 0.0],
        }
    }

    /// The segments start at one point and end at `p` and `q`: −ab/2 + ½(a ∫ln|p − y| + b ∫ln|x − q|).
    fn at_a_corner(&self, p: DVec3, other: &Self, q: DVec3) -> f64 {
        let (a, b) = (self.length, other.length);
        0.5 * (a * other.logarithm(p) + b * self.logarithm(q) - a * b)
    }

    /// Segments without a common end: the shorter one numerically, where the function is smoother.
    fn apart(&self, other: &Self, budget: f64) -> [f64; 2] {
        let (outer, inner) = if self.length <= other.length { (self, other) } else { (other, self) };
        let mut sum = [0.0; 2];
        let (mut stack, mut parts) = (vec![(0.0, 1.0)], 0);
        let singular = outer.singularities(inner);
        while let Some((from, to)) = stack.pop() {
            let scale = (to - from) * outer.length * inner.length;
            // No part can be better than rounding lets it be.
            let share = (budget * (to - from)).max(ROUNDING * scale * (1.0 + inner.length.ln().abs()));
            let errors = outer.errors(from, to, &singular);
            let order = errors.iter().position(|&error| error <= share);
            parts += 1;
            if order.is_some() || parts >= MAX_PARTS {
                let order = order.unwrap_or(ORDERS.len() - 1);
                let value = outer.part(inner, from, to, &RULES[order]);
                sum[0] += value;
                // Edges of slivers cancel to the last digits.
                sum[1] += errors[order] + f64::EPSILON * value.abs();
            } else {
                let middle = f64::midpoint(from, to);
                stack.extend([(from, middle), (middle, to)]);
            }
        }
        sum
    }

    /// ∬ ln r over the part of this segment between two parameters and another segment, by a rule.
    fn part(&self, inner: &Self, from: f64, to: f64, rule: &[(f64, f64)]) -> f64 {
        let at = |s: f64| inner.logarithm(self.at(from + s * (to - from)));
        (to - from) * self.length * rule.iter().map(|&(s, w)| w * at(s)).sum::<f64>()
    }

    /// Where what a point of this segment receives from another is not analytic, as places along this one and beside it: the
    /// foot of each end and its distance, and the foot of the common perpendicular if it meets the other segment.
    fn singularities(&self, other: &Self) -> ArrayVec<[f64; 2], 3> {
        let mut found: ArrayVec<[f64; 2], 3> = ArrayVec::new();
        for end in [other.start, other.end()] {
            let to = end - self.start;
            found.push([to.dot(self.direction), to.cross(self.direction).length()]);
        }
        let (u, v, w) = (self.direction, other.direction, self.start - other.start);
        let (cosine, normal) = (u.dot(v), u.cross(v));
        let sine = normal.length();
        // The distance from the other's line, √(g² + sin² (s − s₀)²), is zero at s₀ ± i g/sin. For parallel edges that is no
        // number, or infinite, and what is no number is not between the ends.
        let foot = (cosine * v.dot(w) - u.dot(w)) / (sine * sine);
        let across = (v.dot(w) - cosine * u.dot(w)) / (sine * sine);
        if across > 0.0 && across < other.length {
            found.push([foot, w.dot(normal).abs() / (sine * sine)]);
        }
        found
    }

    /// Bounds of the error of each of the [`RULES`] on the part between two parameters: of n points about
    /// [`BOUND`] L² ρ^(−2n)/n², with ρ of the ellipse of Bernstein around the part that goes through the nearest singularity
    /// (P. Davis, P. Rabinowitz, *Methods of Numerical Integration*, 1984). Two rules that agree say little: where ρ is
    /// near 1, as for the long edges of a flat box, both were wrong by more than their difference.
    fn errors(&self, from: f64, to: f64, singularities: &[[f64; 2]]) -> [f64; ORDERS.len()] {
        let (middle, half) = (self.length * f64::midpoint(from, to), 0.5 * self.length * (to - from));
        let ellipse = |&[along, beside]: &[f64; 2]| {
            let (x, y) = ((along - middle) / half, beside / half);
            let axis = 0.5 * ((x + 1.0).hypot(y) + (x - 1.0).hypot(y));
            axis + (axis * axis - 1.0).max(0.0).sqrt()
        };
        let rho = singularities.iter().map(ellipse).fold(f64::INFINITY, f64::min);
        ORDERS.map(|n| BOUND * (2.0 * half / n as f64).powi(2) * rho.powi(-2 * n as i32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(z: f64, up: bool) -> [DVec3; 4] {
        let [a, b, c, d] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z));
        if up { [a, b, c, d] } else { [a, d, c, b] }
    }

    #[test]
    fn parallel_and_hinged_squares_have_their_catalogued_factors() {
        for (gap, exact) in [(1.0, 0.199_824_895_698_387), (0.5, 0.415_253_283_577_147), (0.1, 0.826_994_522_397_257)] {
            let [value, error] = integral(&square(0.0, true), &square(gap, false), 1e-13);
            assert!((value - exact).abs() < 1e-12 && error < 1e-12, "{gap}: {value} ± {error}");
        }
        for (degrees, exact) in
            [(30.0_f64, 0.619_028_323_090_803), (90.0, 0.200_043_776_075_403), (150.0, 0.021_345_325_412_689)]
        {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let hinged = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(y, s)| DVec3::new(s * cos, y, s * sin));
            let [value, error] = integral(&square(0.0, true), &hinged, 1e-13);
            assert!((value - exact).abs() < 1e-12 && error < 1e-12, "{degrees}: {value} ± {error}");
        }
    }

    #[test]
    fn a_budget_below_rounding_ends_at_rounding() {
        let square =
            |h: f64| [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(y, s)| DVec3::new(0.0, h * y, h * s));
        for h in [1e-5, 1.0] {
            let floor = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(h * x, h * y, 0.0));
            let [value, error] = integral(&floor, &square(h), 0.0);
            let exact = 0.200_043_776_075_403 * h * h;
            assert!((value - exact).abs() < 1e-11 * h * h && error < 1e-10 * h * h, "{h}: {value} ± {error}");
            assert!((value - exact).abs() <= error + 1e-14 * h * h, "{h}: {value} ± {error}");
        }
    }

    #[test]
    fn edges_that_touch_need_no_rule() {
        let (a, b) = (DVec3::new(0.3, 0.1, 0.0), DVec3::new(0.2, -0.9, 0.4));
        let (e, f) = (Edge::new(DVec3::ZERO, a).expect("long"), Edge::new(b, DVec3::ZERO).expect("long"));
        let [exact, _] = e.with(&f, 0.0);
        let [numeric, error] = e.apart(&f, 1e-11);
        assert!((exact - numeric).abs() < 1e-10, "{exact} {numeric} ± {error}");
        let back = Edge::new(a, DVec3::ZERO).expect("long");
        let [exact, _] = e.with(&back, 0.0);
        let [numeric, error] = e.apart(&back, 1e-9);
        assert!((exact - numeric).abs() < 1e-8, "{exact} {numeric} ± {error}");
    }

    #[test]
    fn edges_that_lie_across_or_along_each_other_are_integrated_all_the_same() {
        let e = Edge::new(DVec3::ZERO, DVec3::X).expect("long");
        let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        for (from, to) in [
            (at(0.3, 0.0), at(2.0, 0.0)),
            (at(-0.5, 0.0), at(1.5, 0.0)),
            (at(0.4, 0.0), at(0.4, 1.5)),
            (at(0.4, -1.0), at(0.6, 1.0)),
            (at(-0.2, 1e-9), at(1.4, -1e-9)),
        ] {
            let f = Edge::new(from, to).expect("long");
            let [exact, error] = e.apart(&f, 1e-9);
            assert!(exact.is_finite() && error < 1e-6, "{from} {to}: {exact} ± {error}");
            for budget in [1e-1, 1e-3, 1e-5] {
                let [value, error] = e.apart(&f, budget);
                assert!((value - exact).abs() <= error + 1e-6, "{from} {to}, {budget}: {value} ± {error}, {exact}");
                assert!(error <= 1.01 * budget, "{from} {to}, {budget}: {error}");
            }
        }
    }

    #[test]
    fn the_a_priori_errors_bound_those_of_the_rules() {
        let mut worst = [0.0_f64; ORDERS.len()];
        for set in 0..1000 {
            let number = |k: u32| crate::quadrature::sequence::point(set, k);
            let ([b, gap, along, place], [x, y, z, kind]) = (number(0), number(1));
            let e = Edge { start: DVec3::ZERO, direction: DVec3::X, length: 1.0 };
            let oblique = DVec3::new(x - 0.5, y - 0.5, z - 0.5).normalize_or(DVec3::Y);
            let direction = [DVec3::X, DVec3::Y, oblique][(3.0 * kind) as usize];
            let beside = DVec3::new(0.0, y - 0.5, z - 0.5).normalize_or(DVec3::Y) * 10_f64.powf(3.0 * gap - 2.5);
            let length = 20_f64.powf(b);
            let near = DVec3::X * (2.0 * along - 0.5) + beside;
            let f = Edge { start: near - direction * (length * place), direction, length };
            let errors = e.errors(0.0, 1.0, &e.singularities(&f));
            let parts = || (0..64).map(|k| (f64::from(k) / 64.0, f64::from(k + 1) / 64.0));
            let exact: f64 = parts().map(|(from, to)| e.part(&f, from, to, &RULES[ORDERS.len() - 1])).sum();
            for ((worst, rule), error) in worst.iter_mut().zip(&*RULES).zip(errors) {
                let found = (e.part(&f, 0.0, 1.0, rule) - exact).abs();
                *worst = worst.max((found - 1e-11).max(0.0) / error);
            }
        }
        assert!(worst.iter().all(|&worst| worst < 1.0) && worst[0] > 0.1, "{worst:?}");
    }
}

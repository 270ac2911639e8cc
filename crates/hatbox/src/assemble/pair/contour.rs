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
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::LazyLock;

/// Gauss orders along an edge; each is checked by the next.
const ORDERS: [usize; 4] = [4, 6, 10, 16];
/// Parts of an edge at the most.
const MAX_PARTS: usize = 1000;
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
        let shared: Vec<(usize, usize)> =
            [(0, 0), (0, 1), (1, 0), (1, 1)].into_iter().filter(|&(i, j)| touch(mine[i], others[j])).collect();
        match shared[..] {
            [] => self.apart(other, budget),
            [(i, j)] => [self.at_a_corner(mine[1 - i], other, others[1 - j]), 0.0],
            _ => [self.length * self.length * (self.length.ln() - 1.5), 0.0],
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
        while let Some((from, to)) = stack.pop() {
            let scale = (to - from) * outer.length * inner.length;
            // No part can be better than rounding lets it be.
            let share = (budget * (to - from)).max(ROUNDING * scale * (1.0 + inner.length.ln().abs()));
            let [value, error] = outer.part(inner, from, to, share);
            parts += 1;
            if error <= share || parts >= MAX_PARTS {
                sum[0] += value;
                sum[1] += error;
            } else {
                let middle = f64::midpoint(from, to);
                stack.extend([(from, middle), (middle, to)]);
            }
        }
        sum
    }

    /// The part of this segment between two parameters, by the first of the orders that agrees with the one before.
    fn part(&self, inner: &Self, from: f64, to: f64, budget: f64) -> [f64; 2] {
        let scale = (to - from) * self.length;
        let rule = |rule: &[(f64, f64)]| -> f64 {
            scale * rule.iter().map(|&(s, w)| w * inner.logarithm(self.at(from + s * (to - from)))).sum::<f64>()
        };
        let mut value = rule(&RULES[0]);
        let mut error = f64::INFINITY;
        for gauss in &RULES[1..] {
            let better = rule(gauss);
            (value, error) = (better, (better - value).abs());
            if error <= budget {
                break;
            }
        }
        [value, error]
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
}

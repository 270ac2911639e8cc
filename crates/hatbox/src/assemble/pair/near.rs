//! Pairs too near for Gauss rules: the inner integral in closed form, the outer by an adaptive rule.
//!
//! The inner function is the irradiance from a whole polygon, bounded everywhere, even on the polygon's own edges; the
//! outer rule only has to resolve its kinks. So this rule is right for any position of the pair, touching or not, and
//! is what every other rule falls back to.

use super::gauss::{Nodes, product};
use super::region::{POLYGON, triangle_area};
use super::{Accuracy, Block, Region};
use crate::assemble::Panel;
use crate::element::{MAX_DOFS, Shape};
use crate::kernel::Moments;
use crate::quadrature::rule;
use arrayvec::ArrayVec;
use glam::{DVec2, DVec3};

/// Degrees of the outer rule, the one that checks it first.
const OUTER: [usize; 2] = [5, 8];
/// Subdivisions of the outer panel at the most: what is left then is 4^-12 of its area.
const MAX_DEPTH: usize = 12;
/// Pieces of the outer panel at the most.
const MAX_PIECES: usize = 4096;

/// The block by closed form where there is one, by subdivision otherwise.
pub(super) fn block(a: &Panel, on_a: &Region, b: &Panel, on_b: &Region, accuracy: &Accuracy) -> Block {
    let budget = |sum: f64| accuracy.budget(a, b, sum);
    // The larger element inside, where a closed form exists.
    let b_inside = b.functions.is_some() && (a.functions.is_none() || a.area() <= b.area());
    if b_inside {
        let inner = Inner::new(b, on_b.corners());
        Outer { panel: a, source: b, at: &|x| inner.at(x, a.normal()), degrees: &OUTER, guard: 0.0, most: MAX_PIECES }
            .integrate(on_a, &budget)
    } else if a.functions.is_some() {
        let inner = Inner::new(a, on_a.corners());
        let outer = Outer {
            panel: b,
            source: a,
            at: &|x| inner.at(x, b.normal()),
            degrees: &OUTER,
            guard: 0.0,
            most: MAX_PIECES,
        };
        outer.integrate(on_b, &budget).transposed()
    } else {
        subdivided(a, on_a, b, on_b, accuracy)
    }
}

/// x ↦ ∫N_k(y) G(x, y) dA(y) over a part of a panel.
pub(super) struct Inner<'a> {
    panel: &'a Panel,
    polygon: ArrayVec<DVec2, POLYGON>,
}

impl<'a> Inner<'a> {
    /// `corners` are those of the part, a polygon of the panel's plane.
    pub(super) fn new(panel: &'a Panel, corners: &[DVec3]) -> Self {
        Self { panel, polygon: corners.iter().map(|&corner| panel.plane.project(corner)).collect() }
    }

    pub(super) fn at(&self, x: DVec3, normal: DVec3) -> [f64; MAX_DOFS] {
        let functions = self.panel.functions.as_ref().unwrap_or(&[[0.0; 6]; MAX_DOFS]);
        let functions = &functions[..self.panel.element.dofs()];
        let degree = match self.panel.element.degree {
            0 => 0,
            // ξη is of degree 2.
            _ if functions.iter().any(|f| f[3..].iter().any(|&c| c != 0.0)) => 2,
            degree => degree,
        };
        let moments = Moments::new(&self.panel.plane, &self.polygon, x, normal, degree);
        let mut values = [0.0; MAX_DOFS];
        for (value, function) in values.iter_mut().zip(functions) {
            *value = moments.integrate(function);
        }
        values
    }
}

/// The outer integral, over the panel that receives.
pub(super) struct Outer<'a> {
    pub(super) panel: &'a Panel,
    pub(super) source: &'a Panel,
    /// What a point receives from each function of the source.
    pub(super) at: &'a dyn Fn(DVec3) -> [f64; MAX_DOFS],
    /// Degrees of the rules: each is checked by the one before, and the first that agrees is taken.
    pub(super) degrees: &'a [usize],
    /// How much of the difference from the mean of the corners counts as an error, for functions that may be zero at all
    /// nodes of a rule and yet not zero.
    pub(super) guard: f64,
    /// Pieces of the receiver at the most.
    pub(super) most: usize,
}

/// A triangle or a parallelogram of the outer panel: origin + ξ u + η v for ξ, η of the reference cell.
#[derive(Clone, Copy)]
struct Cut {
    shape: Shape,
    origin: DVec3,
    u: DVec3,
    v: DVec3,
}

impl Cut {
    fn triangle([a, b, c]: [DVec3; 3]) -> Self {
        Self { shape: Shape::Triangle, origin: a, u: b - a, v: c - a }
    }

    /// The whole panel if it is a parallelogram, else the triangles of the region.
    fn of(panel: &Panel, region: &Region) -> Vec<Self> {
        if let (true, &[a, b, _, d]) = (region.whole && panel.patch.is_affine(), region.corners()) {
            return vec![Self { shape: Shape::Quad, origin: a, u: b - a, v: d - a }];
        }
        region.triangles().map(Self::triangle).collect()
    }

    fn area(&self) -> f64 {
        self.u.cross(self.v).length() * self.shape.reference_area()
    }

    /// The four that the midpoints of the edges make.
    fn quarters(&self) -> [Self; 4] {
        let (u, v) = (0.5 * self.u, 0.5 * self.v);
        let part = |origin: DVec3, sign: f64| Self { origin, u: sign * u, v: sign * v, ..*self };
        let o = self.origin;
        let last = match self.shape {
            Shape::Triangle => part(o + u + v, -1.0),
            Shape::Quad => part(o + u + v, 1.0),
        };
        [part(o, 1.0), part(o + u, 1.0), part(o + v, 1.0), last]
    }
}

/// A part of the outer panel with its integral and the error of that.
struct Piece {
    cut: Cut,
    depth: usize,
    block: Block,
}

impl Outer<'_> {
    /// Splits the piece with the largest error until the sum of the errors is within the budget.
    pub(super) fn integrate(&self, region: &Region, budget: &dyn Fn(f64) -> f64) -> Block {
        let least = budget(0.0) / self.panel.area().max(f64::MIN_POSITIVE);
        let share = |cut: &Cut| 0.5 * least * cut.area();
        let mut pieces: Vec<Piece> =
            Cut::of(self.panel, region).into_iter().map(|cut| self.piece(cut, 0, share(&cut))).collect();
        loop {
            let mut total = Block::zeros(self.panel, self.source);
            for piece in &pieces {
                total.accumulate(&piece.block);
            }
            let budget = budget(total.sum());
            if total.quadrature_error <= budget || pieces.len() >= self.most {
                return total;
            }
            // Every piece with more than its share of the budget is split in this round.
            let limit = budget / (2.0 * pieces.len() as f64);
            let (split, mut kept): (Vec<_>, Vec<_>) =
                pieces.into_iter().partition(|p| p.block.quadrature_error > limit && p.depth < MAX_DEPTH);
            if split.is_empty() {
                return total;
            }
            for Piece { cut, depth, .. } in split {
                kept.extend(cut.quarters().map(|cut| self.piece(cut, depth + 1, share(&cut))));
            }
            pieces = kept;
        }
    }

    /// The first of the rules that agrees with the one before to within the budget, or the last.
    fn piece(&self, cut: Cut, depth: usize, budget: f64) -> Piece {
        let mut block = self.rule(&cut, self.degrees[0]);
        let corners = (self.guard > 0.0).then(|| self.near_corners(&cut));
        // Rules of few points agree with the corners and with the middle, too, where there is nothing to be found. Both are
        // asked: the corners and a rule of four points agree about any step between the points.
        let check = |at_corners: Block| block.distance(&at_corners).max(block.distance(&self.rule(&cut, 0)));
        block.quadrature_error = corners.map_or(f64::INFINITY, check);
        for &degree in &self.degrees[1..] {
            if block.quadrature_error <= budget {
                break;
            }
            let better = self.rule(&cut, degree);
            let guard = corners.map_or(0.0, |at_corners| self.guard * better.distance(&at_corners));
            block = Block { quadrature_error: better.distance(&block) + guard, ..better };
        }
        Piece { cut, depth, block }
    }

    fn rule(&self, cut: &Cut, degree: usize) -> Block {
        let rule = rule(cut.shape, degree);
        self.nodes(cut, &rule.points, &rule.weights)
    }

    /// The mean of points at the corners, but not on the edges, where a blocker may stand that hides nothing from them.
    fn near_corners(&self, cut: &Cut) -> Block {
        const IN: f64 = 0.005;
        const OUT: f64 = 1.0 - IN;
        match cut.shape {
            Shape::Triangle => self.nodes(cut, &[[IN, IN], [OUT - IN, IN], [IN, OUT - IN]], &[1.0 / 3.0; 3]),
            Shape::Quad => self.nodes(cut, &[[IN, IN], [OUT, IN], [OUT, OUT], [IN, OUT]], &[0.25; 4]),
        }
    }

    /// Σ_p w_p N(x_p) (inner at x_p)ᵀ.
    fn nodes(&self, cut: &Cut, points: &[[f64; 2]], weights: &[f64]) -> Block {
        let mut block = Block::zeros(self.panel, self.source);
        let area = cut.area();
        for (&[u, v], weight) in points.iter().zip(weights) {
            let x = cut.origin + cut.u * u + cut.v * v;
            block.add(weight * area, &self.panel.values(x), &(self.at)(x));
        }
        block
    }
}

/// The four triangles that the midpoints of the edges cut a triangle into.
pub(super) fn quarters(&[a, b, c]: &[DVec3; 3]) -> [[DVec3; 3]; 4] {
    let (ab, bc, ca) = (a.midpoint(b), b.midpoint(c), c.midpoint(a));
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
}

/// Pairs of triangles are halved until Gauss rules agree: for shape functions that are no polynomials.
fn subdivided(a: &Panel, on_a: &Region, b: &Panel, on_b: &Region, accuracy: &Accuracy) -> Block {
    let mut stack: Vec<_> = on_a.triangles().flat_map(|s| on_b.triangles().map(move |t| (s, t, 0))).collect();
    let mut total = Block::zeros(a, b);
    // A pair may err by its share of the areas, which keeps the sum within the budget of the pair of panels.
    let whole = on_a.area() * on_b.area();
    let rough: f64 = stack.iter().map(|(s, t, _)| triangle_pair(a, s, b, t).sum()).sum();
    let budget = accuracy.budget(a, b, rough);
    while let Some((s, t, depth)) = stack.pop() {
        let block = triangle_pair(a, &s, b, &t);
        let share = budget * (triangle_area(&s) * triangle_area(&t) / whole).sqrt();
        if block.quadrature_error <= share || depth >= MAX_DEPTH || stack.len() > MAX_PIECES {
            total.accumulate(&block);
        } else if triangle_area(&s) >= triangle_area(&t) {
            stack.extend(quarters(&s).map(|s| (s, t, depth + 1)));
        } else {
            stack.extend(quarters(&t).map(|t| (s, t, depth + 1)));
        }
    }
    total
}

/// A pair of triangles by Gauss rules of two degrees.
pub(super) fn triangle_pair(a: &Panel, s: &[DVec3; 3], b: &Panel, t: &[DVec3; 3]) -> Block {
    let [mut block, check] =
        OUTER.map(|degree| product(&Nodes::on_triangle(a, s, degree), &Nodes::on_triangle(b, t, degree), a, b));
    block.quadrature_error = block.distance(&check);
    block
}

//! Pairs too near for Gauss rules: the inner integral in closed form, the outer by an adaptive rule.
//!
//! The inner function is the irradiance from a whole polygon, bounded everywhere, even on the polygon's own edges; the
//! outer rule only has to resolve its kinks. So this rule is right for any position of the pair, touching or not, and
//! is what every other rule falls back to.

use super::gauss::{Nodes, product};
use super::outer::Outer;
use super::region::{POLYGON, triangle_area};
use super::{Accuracy, Block, Region};
use crate::assemble::Panel;
use crate::element::MAX_DOFS;
use crate::kernel::Moments;
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
        Outer {
            panel: a,
            source: b,
            at: &|x| inner.at(x, a.normal()),
            degrees: &OUTER,
            shadows: None,
            most: MAX_PIECES,
        }
        .integrate(on_a, &budget)
    } else if a.functions.is_some() {
        let inner = Inner::new(a, on_a.corners());
        let outer = Outer {
            panel: b,
            source: a,
            at: &|x| inner.at(x, b.normal()),
            degrees: &OUTER,
            shadows: None,
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

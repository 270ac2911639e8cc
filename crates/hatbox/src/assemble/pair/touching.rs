//! Panels that share an edge, by singularity-removing transforms.
//!
//! They are for shapes that are no needles: with those, two orders in a row may agree and both be wrong. Of 600 random pairs that
//! share an edge, down to a hundred times as long as wide, 116 erred by more than they may at 10 %, and 17 at 1 % (the test of
//! triangles that touch counts them if needles are let in: `cargo test --release -p hatbox --test pairs touch_err`). A closed-form
//! inner integral with an adaptive outer rule ([`near`]) has fewer than one in a hundred. It takes all pairs that share but a
//! corner, where there is hardly a singularity to be removed; along a common edge of well-shaped triangles a transform's error falls
//! exponentially with its order, and the adaptive rule's does not. Pairs without a closed form (bilinear on two trapezia) have
//! nothing but transforms, needles or not.
//!
//! That needles begin at a quarter is a guess: above it, fewer than one pair in a hundred errs by more than it may.

use super::{Accuracy, Block, Region, near};
use crate::assemble::Panel;
use crate::element::MAX_DOFS;
use crate::kernel::geometric;
use crate::quadrature::transform::{Contact, TouchingRule, touching_rule};
use glam::DVec3;
use std::sync::OnceLock;

/// The orders that are tried; each is checked by the next.
const ORDERS: [usize; 6] = [3, 5, 7, 9, 12, 16];
/// Largest total degree of N_i N_j.
const MAX_DEGREE: usize = 4;

/// A rule that is made when it is first asked for.
type Lazy = OnceLock<TouchingRule>;

/// Rules by contact, total degree of the shape functions and order.
static RULES: [[[Lazy; ORDERS.len()]; MAX_DEGREE + 1]; 2] =
    [const { [const { [const { OnceLock::new() }; ORDERS.len()] }; MAX_DEGREE + 1] }; 2];

fn rule(contact: Contact, degree: usize, order: usize) -> &'static TouchingRule {
    RULES[contact as usize][degree][order].get_or_init(|| touching_rule(contact, degree, ORDERS[order]))
}

/// Triangles that are less high than this fraction of their longest edge are needles.
const NEEDLE: f64 = 0.25;

/// Whether two panels have a corner in common.
pub(super) fn shares_a_corner(a: &Panel, b: &Panel) -> bool {
    let corners = |p: &Panel| p.patch.corners().len();
    a.vertices[..corners(a)].iter().any(|v| b.vertices[..corners(b)].contains(v))
}

/// The block of two whole panels that touch: triangle by triangle.
pub(super) fn block(a: &Panel, b: &Panel, accuracy: &Accuracy) -> Block {
    let mut total = Block::zeros(a, b);
    for s in a.patch.triangles() {
        for t in b.patch.triangles() {
            total.accumulate(&triangles(a, s, b, t, accuracy));
        }
    }
    total
}

/// A triangle of each panel, given by its corners' places in the panel.
fn triangles(a: &Panel, s: &[usize; 3], b: &Panel, t: &[usize; 3], accuracy: &Accuracy) -> Block {
    let shared: Vec<(usize, usize)> =
        (0..9).map(|k| (k / 3, k % 3)).filter(|&(i, j)| a.vertices[s[i]] == b.vertices[t[j]]).collect();
    let points = |panel: &Panel, corners: [usize; 3]| corners.map(|k| panel.patch.corners()[k]);
    // The shared corners first, in the same order in both.
    let first = |triangle: &[usize; 3], lead: &[usize]| {
        let rest = (0..3).filter(|k| !lead.contains(k));
        let order: Vec<usize> = lead.iter().copied().chain(rest).collect();
        std::array::from_fn(|k| triangle[order[k]])
    };
    let (on_a, on_b): (Vec<_>, Vec<_>) = shared.iter().copied().unzip();
    let (sa, tb) = (points(a, first(s, &on_a)), points(b, first(t, &on_b)));
    let only_way = a.functions.is_none() && b.functions.is_none();
    let transformed = match shared.len() {
        1 if only_way => transformed(Contact::Vertex, a, &sa, b, &tb, accuracy),
        2 if only_way || !(is_needle(&sa) || is_needle(&tb)) => transformed(Contact::Edge, a, &sa, b, &tb, accuracy),
        _ => None,
    };
    transformed.unwrap_or_else(|| near::block(a, &Region::of(&points(a, *s)), b, &Region::of(&points(b, *t)), accuracy))
}

fn is_needle(&[a, b, c]: &[DVec3; 3]) -> bool {
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    (b - a).cross(c - a).length() < NEEDLE * longest * longest
}

/// The order is raised until two in a row agree within the budget; `None` if they never do (an acute dihedral angle, a
/// sliver).
fn transformed(
    contact: Contact,
    a: &Panel,
    s: &[DVec3; 3],
    b: &Panel,
    t: &[DVec3; 3],
    accuracy: &Accuracy,
) -> Option<Block> {
    let degree = [a, b].map(polynomial_degree).iter().sum::<usize>();
    let mut previous = apply(rule(contact, degree, 0), a, s, b, t);
    for order in 1..ORDERS.len() {
        let mut block = apply(rule(contact, degree, order), a, s, b, t);
        block.quadrature_error = block.distance(&previous);
        if block.quadrature_error <= accuracy.budget(a, b, block.sum()) {
            return Some(block);
        }
        previous = block;
    }
    None
}

/// Total degree of the shape functions along a line of the panel.
fn polynomial_degree(panel: &Panel) -> usize {
    let quadratic = panel.element.functions.iter().any(|f| f[3..].iter().any(|&c| c != 0.0));
    if quadratic { 2 } else { panel.element.degree }
}

/// Σ_k w_k N(x_k) N(y_k)ᵀ G(x_k, y_k).
fn apply(rule: &TouchingRule, a: &Panel, s: &[DVec3; 3], b: &Panel, t: &[DVec3; 3]) -> Block {
    let mut block = Block::zeros(a, b);
    let areas = super::region::triangle_area(s) * super::region::triangle_area(t);
    let point = |triangle: &[DVec3; 3], w: &[f64; 3]| triangle[0] * w[0] + triangle[1] * w[1] + triangle[2] * w[2];
    for ((u, v), weight) in rule.first.iter().zip(&rule.second).zip(&rule.weights) {
        let (x, y) = (point(s, u), point(t, v));
        let g = areas * weight * geometric(x, a.normal(), y, b.normal());
        let row: [f64; MAX_DOFS] = b.values(y).map(|n| g * n);
        block.add(1.0, &a.values(x), &row);
    }
    block
}

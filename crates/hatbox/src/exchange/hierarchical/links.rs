//! Which clusters exchange light through a link, and the links' coefficients.
//!
//! Pairs of planes are met from the top of their trees. A pair of clusters is linked if it is proven to see each other
//! fully, lies in front of each other and interpolation of G between them is accurate enough: that is measured, at the
//! corners and centres of both. Otherwise the larger one is divided, as long as the pair carries a share of the light
//! that is worth it. What is left, near, weak or partly hidden, is the rays'.

use super::basis::{Basis, MOST_POINTS};
use super::tree::{Cluster, Rectangle, Tree};
use crate::exchange::dense::{Between, Views};
use crate::kernel::geometric;
use std::f64::consts::FRAC_1_PI;

/// Clusters whose radii are more than this part of their distance are not tried.
const NEAR: f64 = 1.5;
/// Errors count relative to at least this share of the light of a cell.
const SHARE: f64 = 0.01;

/// Two clusters that see each other, and G between their points: rows of the first, columns of the second.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) clusters: [u32; 2],
    pub(super) kernel: Vec<f32>,
}

/// How far links may be wrong, and which are worth having.
#[derive(Debug, Clone, Copy)]
pub(super) struct Demands {
    /// Relative error of a link.
    pub(super) error: f64,
    /// The least part of a cell's light that is looked at.
    pub(super) weakest: f64,
}

/// Looks for links.
pub(super) struct Search<'a> {
    pub(super) tree: &'a Tree,
    pub(super) basis: &'a Basis,
    pub(super) views: Views<'a>,
    pub(super) demands: Demands,
    /// The basis at the corners and the centre of a rectangle.
    pub(super) probes: [([f64; 2], [f64; MOST_POINTS]); 5],
}

/// The corners and the centre of a rectangle, and the functions there.
pub(super) fn probes(basis: &Basis) -> [([f64; 2], [f64; MOST_POINTS]); 5] {
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [0.0, 0.0]].map(|at| (at, basis.values(at)))
}

impl Search<'_> {
    /// Adds the links between two clusters and what is below them.
    pub(super) fn meet(&self, pair: [u32; 2], inherited: Between<'_>, found: &mut Vec<Link>) {
        let [a, b] = pair.map(|k| &self.tree.clusters[k as usize]);
        let heights = [heights(&a.rectangle, &b.rectangle), heights(&b.rectangle, &a.rectangle)];
        let flat = self.tree.nothing;
        if heights.iter().any(|[_, most]| *most <= flat) || strength(a, b, heights) < self.demands.weakest {
            return;
        }
        let mut list = Vec::new();
        let between = if let Between::Nothing = inherited {
            inherited
        } else {
            let bodies = [a, b].map(|cluster| cluster.rectangle.body(flat));
            let Some(between) = self.views.between(bodies.each_ref(), [u32::MAX; 2], inherited, &mut list) else {
                return;
            };
            between
        };
        let whole = matches!(between, Between::Nothing) && heights.iter().all(|[least, _]| *least >= -flat);
        if let Some(kernel) = whole.then(|| self.kernel(a, b)).flatten() {
            found.push(Link { clusters: pair, kernel });
            return;
        }
        let divide_first =
            !a.children.is_empty() && (b.children.is_empty() || a.rectangle.radius() >= b.rectangle.radius());
        if divide_first {
            a.children.clone().for_each(|child| self.meet([child, pair[1]], between, found));
        } else {
            b.children.clone().for_each(|child| self.meet([pair[0], child], between, found));
        }
    }

    /// G at the points of both, if interpolating it is accurate enough.
    fn kernel(&self, a: &Cluster, b: &Cluster) -> Option<Vec<f32>> {
        let (first, second) = (&a.rectangle, &b.rectangle);
        let distance = first.center.distance(second.center);
        if first.radius() + second.radius() > NEAR * distance {
            return None;
        }
        let n = self.basis.len();
        let g = |x: [f64; 2], y: [f64; 2]| geometric(first.point(x), first.normal, second.point(y), second.normal);
        let mut kernel = Vec::with_capacity(n * n);
        for i in 0..n {
            let x = self.basis.point(i);
            kernel.extend((0..n).map(|j| g(x, self.basis.point(j)) as f32));
        }
        let (mut square, mut sum) = (0.0, 0.0);
        for (y, on_y) in &self.probes {
            let mut column = [0.0; MOST_POINTS];
            for (value, row) in column.iter_mut().zip(kernel.chunks_exact(n)) {
                *value = row.iter().zip(on_y).map(|(g, l)| f64::from(*g) * l).sum();
            }
            for (x, on_x) in &self.probes {
                let exact = g(*x, *y);
                let found: f64 = column[..n].iter().zip(on_x).map(|(g, l)| g * l).sum();
                square += (found - exact) * (found - exact);
                sum += exact;
            }
        }
        let count = (self.probes.len() * self.probes.len()) as f64;
        let allowed = self.demands.error * (sum / count).max(SHARE / a.area.max(b.area));
        ((square / count).sqrt() <= allowed).then_some(kernel)
    }
}

/// The least and the greatest height of the second's corners above the first.
fn heights(first: &Rectangle, second: &Rectangle) -> [f64; 2] {
    second.corners().iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], corner| {
        let height = first.normal.dot(*corner - first.center);
        [lo.min(height), hi.max(height)]
    })
}

/// About the greatest part of the light of a point of one of them that comes from the other.
fn strength(a: &Cluster, b: &Cluster, [[_, above_a], [_, above_b]]: [[f64; 2]; 2]) -> f64 {
    let d2 = a.rectangle.center.distance_squared(b.rectangle.center);
    let reach = a.rectangle.radius() + b.rectangle.radius();
    if d2 <= reach * reach {
        return 1.0;
    }
    let cosines = (above_a * above_b / d2).min(1.0);
    FRAC_1_PI * a.area.max(b.area) * cosines / d2
}

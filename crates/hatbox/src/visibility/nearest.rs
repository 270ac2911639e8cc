use super::bvh::{Bvh, STACK};
use super::exact::Triangle;
use super::node::{LEAF_BIT, parts};
use glam::DVec3;

/// The point of some triangles that is nearest to a given one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// The point.
    pub point: DVec3,
    /// Index of its triangle in the input.
    pub triangle: u32,
    /// How far it is.
    pub distance: f64,
    /// Weights of the second and third corner; that of the first is 1 − their sum.
    pub barycentric: [f64; 2],
}

impl Bvh {
    /// The point nearest to `point` on the triangles whose index `accept` takes; `None` if there are none.
    ///
    /// Of points equally far, the one of the first triangle of the input.
    pub fn nearest_point(&self, point: DVec3, accept: impl Fn(u32) -> bool) -> Option<Nearest> {
        let mut best: Option<Nearest> = None;
        if self.nodes.is_empty() || !point.is_finite() {
            return best;
        }
        let local = self.frame.to_local(point).to_array().map(|x| x as f32);
        let mut stack = [(0.0_f32, 0_u32); STACK];
        let mut pending = 1;
        while pending > 0 {
            pending -= 1;
            let (_, node) = stack[pending];
            let node = &self.nodes[node as usize];
            let squares = node.distances_squared(local);
            let first = pending;
            for (lane, square) in squares.into_iter().enumerate() {
                let child = node.child[lane];
                let farther = best.is_some_and(|best| self.frame.least_distance(square, point) > best.distance);
                if child == u32::MAX || farther {
                    continue;
                }
                if child & LEAF_BIT == 0 {
                    stack[pending] = (square, child);
                    pending += 1;
                    sink(&mut stack[first..pending]);
                } else {
                    parts(child).for_each(|part| self.nearer(point, part, &accept, &mut best));
                }
            }
        }
        best
    }

    /// Replaces `best` by the nearest point of a leaf's triangles if that is nearer.
    fn nearer(&self, point: DVec3, leaf: usize, accept: &impl Fn(u32) -> bool, best: &mut Option<Nearest>) {
        for Triangle { corners, index: triangle, .. } in self.blocks.triangles(leaf) {
            if !accept(triangle) {
                continue;
            }
            let barycentric = nearest_weights(point, corners);
            let [a, b, c] = corners;
            let at = a + (b - a) * barycentric[0] + (c - a) * barycentric[1];
            let distance = at.distance(point);
            if best.is_none_or(|best| (distance, triangle) < (best.distance, best.triangle)) {
                *best = Some(Nearest { point: at, triangle, distance, barycentric });
            }
        }
    }
}

/// Puts the last entry where it belongs among the others, which run from the farthest to the nearest.
#[inline(always)]
fn sink(stack: &mut [(f32, u32)]) {
    let mut k = stack.len() - 1;
    while k > 0 && stack[k - 1].0 < stack[k].0 {
        stack.swap(k - 1, k);
        k -= 1;
    }
}

/// Weights of the second and third corner at the point of a triangle nearest to `p`: the best of the foot of the
/// perpendicular, if that is inside, and the nearest points of the edges.
///
/// Comparing four true distances costs a little more than deciding by signs of products of edges (Ericson, *Real-Time
/// Collision Detection*, 5.1.5), but signs are noise on slivers and distances are not.
fn nearest_weights(p: DVec3, corners: [DVec3; 3]) -> [f64; 2] {
    let [a, b, c] = corners;
    let on_edge = |p0: DVec3, p1: DVec3| {
        let along = (p - p0).dot(p1 - p0) / (p1 - p0).length_squared();
        if along > 0.0 { along.min(1.0) } else { 0.0 }
    };
    let (ab, ac, bc) = (on_edge(a, b), on_edge(a, c), on_edge(b, c));
    let normal = (b - a).cross(c - a);
    let foot =
        [normal.dot((p - a).cross(c - a)), normal.dot((b - a).cross(p - a))].map(|w| w / normal.length_squared());
    let inside = foot[0] >= 0.0 && foot[1] >= 0.0 && foot[0] + foot[1] <= 1.0;
    let candidates = [[ab, 0.0], [0.0, ac], [1.0 - bc, bc], if inside { foot } else { [ab, 0.0] }];
    let square = |[v, w]: &[f64; 2]| (a + (b - a) * *v + (c - a) * *w).distance_squared(p);
    candidates.into_iter().min_by(|x, y| square(x).total_cmp(&square(y))).unwrap_or_default()
}

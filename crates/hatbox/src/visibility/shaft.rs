use super::build::WIDTH;
use super::bvh::{Bvh, STACK};
use super::node::{Frame, LEAF_BIT, Node, parts};
use crate::mesh::polygon::area_vector;
use arrayvec::ArrayVec;
use glam::DVec3;

/// What a triangle may reach into a shaft, relative to the shaft's size, and still only touch it. Planes through the
/// corners of small polygons are known no better.
const TOUCH: f64 = 1e-9;
/// Error of the f32 test of boxes, in normalised coordinates, with room to spare.
const BOX_ERROR: f32 = 4e-6;

/// The union of all segments between two convex bodies, planar polygons or boxes: their convex hull, as half-spaces.
///
/// The facets of the hull of two convex bodies are planes through an edge of one and a corner of the other that have
/// both bodies on one side, and facets of the bodies themselves where the other body lies on one side of them. Polygons
/// that see each other and have been clipped at each other's horizon are such, so their shaft stays in front of both.
/// The box around both is added: it culls nodes early and settles axis-parallel rooms exactly. The shafts between boxes
/// of Haines and Wallace (1991) are looser; for two polygons the hull is as cheap.
///
/// Every half-space is moved out until it contains all corners as f64 sees them, so the volume is conservative. What
/// touches it from outside, up to 1e-9 of its size, does not block.
#[derive(Debug, Clone)]
pub struct Shaft {
    /// Coordinates are relative to this corner, so that a scene far from the origin loses nothing.
    origin: DVec3,
    /// Corners of the first body, then of the second.
    corners: ArrayVec<DVec3, { 2 * MAX_CORNERS }>,
    /// Number of corners of the first.
    first: usize,
    /// (n, d): n·x ≤ d in the shaft, |n| = 1.
    planes: ArrayVec<(DVec3, f64), MAX_PLANES>,
    touch: f64,
}

/// Most corners of a body.
const MAX_CORNERS: usize = 8;
/// More planes than this are left out, which makes the shaft larger and stays right.
const MAX_PLANES: usize = 40;

/// One end of a shaft.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    corners: ArrayVec<DVec3, MAX_CORNERS>,
    flat: bool,
}

impl Body {
    /// A convex planar polygon of up to eight corners, in order either way.
    ///
    /// # Panics
    /// If it has no corners or more.
    pub fn polygon(corners: &[DVec3]) -> Self {
        assert!(!corners.is_empty(), "polygons have corners");
        Self { corners: corners.iter().copied().collect(), flat: true }
    }

    /// The axis-parallel box between two corners.
    pub fn cuboid(lo: DVec3, hi: DVec3) -> Self {
        let corner = |k: usize| {
            let pick = |axis: usize| if k >> axis & 1 == 0 { lo[axis] } else { hi[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        };
        Self { corners: (0..8).map(corner).collect(), flat: false }
    }

    /// Its corners.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners
    }

    /// Its edges as places of corners.
    fn edges(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let (flat, count) = (self.flat, self.corners.len());
        let polygon = (0..count).map(move |k| [k, (k + 1) % count]).filter(move |_| flat);
        let cuboid = (0..8_usize).flat_map(|k| [1, 2, 4].map(|bit| [k, k | bit])).filter(move |[p, q]| !flat && p != q);
        polygon.chain(cuboid)
    }
}

/// What a shaft was found to contain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShaftResult {
    /// Nothing: the polygons see each other fully.
    Empty,
    /// The triangles listed may block, and no others.
    Candidates,
    /// More than the limit; the list is not complete.
    TooMany,
}

impl Shaft {
    /// The shaft between two convex planar polygons, corners in order around each, either way.
    ///
    /// # Panics
    /// If a polygon has no corners, or more than eight.
    pub fn new(a: &[DVec3], b: &[DVec3]) -> Self {
        Self::between(&Body::polygon(a), &Body::polygon(b))
    }

    /// The shaft between two bodies.
    pub fn between(a: &Body, b: &Body) -> Self {
        let mut shaft = Self::around(a, b);
        shaft.tighten(a, b);
        shaft
    }

    /// The box around two bodies: larger than their shaft, and quickly made.
    pub fn around(a: &Body, b: &Body) -> Self {
        let origin = a.corners[0];
        let corners: ArrayVec<DVec3, _> = a.corners.iter().chain(&b.corners).map(|&corner| corner - origin).collect();
        let size = corners.iter().map(|c| c.length()).fold(0.0, f64::max);
        let greatest = a.corners.iter().chain(&b.corners).map(|c| c.abs().max_element()).fold(0.0, f64::max);
        let touch = TOUCH * size + 16.0 * f64::EPSILON * greatest;
        let (lo, hi) = corners.iter().fold((DVec3::ZERO, DVec3::ZERO), |(lo, hi), &c| (lo.min(c), hi.max(c)));
        let axes = [(DVec3::X, lo.x, hi.x), (DVec3::Y, lo.y, hi.y), (DVec3::Z, lo.z, hi.z)];
        let planes = axes.into_iter().flat_map(|(axis, lo, hi)| [(axis, hi), (-axis, -lo)]).collect();
        Self { origin, corners, first: a.corners.len(), planes, touch }
    }

    /// The corners of both polygons, relative to the origin.
    fn polygons(&self) -> [&[DVec3]; 2] {
        let (a, b) = self.corners.split_at(self.first);
        [a, b]
    }

    /// Adds the facets of the hull of the two bodies, which are those the shaft was made of.
    pub fn tighten(&mut self, a: &Body, b: &Body) {
        // The faces of a cuboid are facets of the box around both, where they are any.
        let normals = self.polygons().map(|polygon| area_vector(polygon).normalize_or_zero());
        for (body, normal) in [a, b].into_iter().zip(normals) {
            if body.flat {
                self.push_cap(normal);
            }
        }
        let (first, count) = (self.first, self.corners.len());
        for (own, body, other) in [(0, a, first..count), (first, b, 0..first)] {
            for [p, q] in body.edges() {
                let edge = self.corners[own + q] - self.corners[own + p];
                for at in other.clone() {
                    self.push_facet(edge.cross(self.corners[at] - self.corners[own + p]), own + p);
                }
            }
        }
    }

    /// Adds the planes of a normal that support both polygons on the same side. `at` is a corner of the edge that they go
    /// through; most go through the midst of the other polygon, which is therefore asked first.
    fn push_facet(&mut self, normal: DVec3, at: usize) {
        let length = normal.length();
        let ([a, b], slack) = (self.polygons(), self.touch * length);
        let (own, other) = if at < self.first { (a, b) } else { (b, a) };
        let (theirs, height) = (range(other, normal), normal.dot(self.corners[at]));
        if theirs[0] < height - slack && theirs[1] > height + slack {
            return;
        }
        let ours = range(own, normal);
        for side in [1, 0] {
            if length > 0.0 && (ours[side] - theirs[side]).abs() <= slack {
                self.push(if side == 1 { normal } else { -normal } / length);
            }
        }
    }

    /// Adds the plane of a polygon if both polygons lie on one side of it.
    fn push_cap(&mut self, normal: DVec3) {
        for normal in [normal, -normal] {
            let [a, b] = self.polygons().map(|polygon| range(polygon, normal));
            let flat = |[lo, hi]: [f64; 2]| hi - lo <= self.touch;
            if (flat(a) && a[0] >= b[1] - self.touch) || (flat(b) && b[0] >= a[1] - self.touch) {
                self.push(normal);
            }
        }
    }

    /// Adds the half-space of a unit normal that just contains all corners.
    fn push(&mut self, normal: DVec3) {
        let [_, offset] = range(&self.corners, normal);
        if normal != DVec3::ZERO && !self.planes.iter().any(|(n, _)| n.dot(normal) > 1.0 - 1e-15) {
            // A plane more than there is room for would only make the shaft smaller.
            let _ = self.planes.try_push((normal, offset));
        }
    }

    /// Whether a planar polygon with that unit normal may block part of the view; if not, it is proven to touch the shaft at
    /// most.
    pub fn may_block(&self, polygon: &[DVec3], normal: DVec3) -> bool {
        // In a convex room every wall has the whole shaft on one side.
        let below = normal.dot(self.origin - polygon[0]);
        let heights: ArrayVec<f64, { 2 * MAX_CORNERS }> = self.corners.iter().map(|&x| normal.dot(x) + below).collect();
        let [lo, hi] = extremes(heights.iter().copied());
        if lo >= -self.touch || hi <= self.touch {
            return false;
        }
        let outside =
            |(n, d): &(DVec3, f64)| polygon.iter().all(|&corner| n.dot(corner - self.origin) >= d - self.touch);
        !self.planes.iter().any(outside) && !self.passes_an_edge(polygon, normal, &heights)
    }

    /// Whether a plane through an edge of a convex polygon has the polygon on one side and the shaft on the other. Between
    /// two convex bodies there is such a plane, or a facet of one of them, or they meet; `heights` are those of the shaft's
    /// corners over the polygon's plane.
    ///
    /// With a the distance of a corner x of the shaft from the edge, inwards in the polygon's plane, and b its height, the
    /// plane is a = m b, and x is to have a ≤ m b, and the polygon's own corners a ≥ m b: that they do is not taken for
    /// granted, since an edge that is short enough has any direction, and large polygons are flat only to rounding.
    fn passes_an_edge(&self, polygon: &[DVec3], normal: DVec3, heights: &[f64]) -> bool {
        let far = polygon.iter().map(|corner| corner.abs().max_element()).fold(0.0, f64::max);
        let slack = self.touch.max(16.0 * f64::EPSILON * far);
        (0..polygon.len()).any(|k| {
            let (from, edge) = (polygon[k] - self.origin, polygon[(k + 1) % polygon.len()] - polygon[k]);
            let inwards = normal.cross(edge);
            let touch = slack * inwards.length();
            let (mut least, mut greatest) = (f64::NEG_INFINITY, f64::INFINITY);
            for (x, &b) in self.corners.iter().zip(heights) {
                let a = inwards.dot(*x - from) - touch;
                if b.abs() > self.touch {
                    let slope = a / b;
                    if b > 0.0 { least = least.max(slope) } else { greatest = greatest.min(slope) }
                } else if a > 0.0 {
                    return false;
                }
            }
            let slope = if least > 0.0 { least } else { greatest.min(0.0) };
            let is_beyond = |&corner: &DVec3| {
                let y = corner - self.origin - from;
                inwards.dot(y) >= slope * normal.dot(y) - touch
            };
            least <= greatest && touch > 0.0 && polygon.iter().all(is_beyond)
        })
    }

    /// Whether a convex planar polygon with that unit normal blocks every segment of the shaft.
    ///
    /// It does if it lies strictly between the two polygons, its plane farther than `least` from the corners of either, and
    /// each segment from a corner to a corner crosses it strictly inside: the projection of one polygon onto its plane from any
    /// point of the other is the convex hull of the projected corners.
    pub fn fully_blocked_by(&self, blocker: &[DVec3], normal: DVec3, least: f64) -> bool {
        let least = least.max(self.touch);
        let height = |corner: DVec3| normal.dot(corner + self.origin - blocker[0]);
        let inside = |x: DVec3| {
            (0..blocker.len()).all(|k| {
                let (p, edge) = (blocker[k] - self.origin, blocker[(k + 1) % blocker.len()] - blocker[k]);
                edge.cross(x - p).dot(normal) > self.touch * edge.length()
            })
        };
        let [a, b] = self.polygons();
        a.iter().all(|&p| {
            b.iter().all(|&q| {
                let (hp, hq) = (height(p), height(q));
                let sides_differ = hp.abs() > least && hq.abs() > least && (hp > 0.0) != (hq > 0.0);
                sides_differ && inside(p + (q - p) * (hp / (hp - hq)))
            })
        })
    }

    /// The planes in the normalised coordinates of a tree, moved out by the error of testing them in f32.
    fn local_planes(&self, frame: Frame) -> Vec<([f32; 3], f32)> {
        let shift = self.origin - frame.center;
        let local = |&(n, d): &(DVec3, f64)| {
            let offset = (d + n.dot(shift)) / frame.size;
            (n.to_array().map(|x| x as f32), offset as f32 + BOX_ERROR * (1.0 + offset.abs() as f32))
        };
        self.planes.iter().map(local).collect()
    }
}

/// The least and the greatest of the corners along a direction.
fn range(polygon: &[DVec3], direction: DVec3) -> [f64; 2] {
    extremes(polygon.iter().map(|corner| direction.dot(*corner)))
}

/// The least and the greatest.
fn extremes(numbers: impl Iterator<Item = f64>) -> [f64; 2] {
    numbers.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], x| {
        [if x < lo { x } else { lo }, if x > hi { x } else { hi }]
    })
}

impl Bvh {
    /// Puts the triangles that may block the shaft, except those of the surfaces of `skip`, into `out`, at most `limit`.
    ///
    /// [`ShaftResult::Empty`] is a proof: no segment between the polygons is occluded.
    pub fn shaft_candidates(&self, shaft: &Shaft, skip: &[u32; 2], out: &mut Vec<u32>, limit: usize) -> ShaftResult {
        out.clear();
        let planes = shaft.local_planes(self.frame);
        let complete = self.visit(
            |node| {
                let mut mask = u32::MAX >> (32 - WIDTH);
                for &(normal, offset) in &planes {
                    mask = node.below(mask, normal, offset);
                    if mask == 0 {
                        break;
                    }
                }
                mask
            },
            |index, id, triangle| {
                if skip.contains(&id) || !shaft.may_block(triangle, area_vector(triangle).normalize_or_zero()) {
                    return true;
                }
                out.push(index);
                out.len() <= limit
            },
        );
        if !complete {
            out.truncate(limit);
            return ShaftResult::TooMany;
        }
        if out.is_empty() { ShaftResult::Empty } else { ShaftResult::Candidates }
    }

    /// Calls `visit` with the index of every triangle whose box meets the box from `lo` to `hi`.
    ///
    /// The boxes are those of the tree, rounded outward by about 1e-7 of the scene: triangles that only come near may be
    /// among them.
    pub fn overlapping(&self, lo: DVec3, hi: DVec3, mut visit: impl FnMut(u32)) {
        let bounds = self.frame.bounds(&[lo, hi]);
        let meets = |triangle: &[DVec3; 3]| {
            let [a, b, c] = triangle;
            a.min(*b).min(*c).cmple(hi).all() && a.max(*b).max(*c).cmpge(lo).all()
        };
        self.visit(
            |node| node.overlaps(&bounds),
            |index, _, triangle| {
                if meets(triangle) {
                    visit(index);
                }
                true
            },
        );
    }

    /// Walks the children that `select` keeps and calls `take` with index, id and corners of their triangles until that
    /// returns false; returns whether it never did.
    fn visit(&self, select: impl Fn(&Node) -> u32, mut take: impl FnMut(u32, u32, &[DVec3; 3]) -> bool) -> bool {
        let mut stack = [0_u32; STACK];
        let mut pending = usize::from(!self.nodes.is_empty());
        while pending > 0 {
            pending -= 1;
            let node = &self.nodes[stack[pending] as usize];
            let mut mask = select(node);
            while mask != 0 {
                let child = node.child[mask.trailing_zeros() as usize];
                mask &= mask - 1;
                if child & LEAF_BIT == 0 {
                    stack[pending] = child;
                    pending += 1;
                    continue;
                }
                for triangle in parts(child).flat_map(|part| self.blocks.triangles(part)) {
                    if !take(triangle.index, triangle.id, &triangle.corners) {
                        return false;
                    }
                }
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quadrature::sequence::{hash, unit};

    /// What of a polygon is in a shaft, up to what may touch it.
    fn inside(shaft: &Shaft, polygon: &[DVec3]) -> Vec<DVec3> {
        let cut = |polygon: Vec<DVec3>, &(n, d): &(DVec3, f64)| {
            let below = |p: DVec3| d - 2.0 * shaft.touch - n.dot(p - shaft.origin);
            let corners = (0..polygon.len()).flat_map(|k| {
                let (p, q) = (polygon[k], polygon[(k + 1) % polygon.len()]);
                let (from, to) = (below(p), below(q));
                let crossing =
                    (from < 0.0 && to > 0.0 || from > 0.0 && to < 0.0).then(|| p + (q - p) * (from / (from - to)));
                (from >= 0.0).then_some(p).into_iter().chain(crossing)
            });
            corners.collect()
        };
        shaft.planes.iter().fold(polygon.to_vec(), cut)
    }

    /// Between convex bodies the candidates are those that reach into the shaft, and no others.
    #[test]
    fn what_may_block_is_what_reaches_into_the_shaft() {
        let point = |k: u64| DVec3::from_array([0, 1, 2].map(|axis| unit(hash(k, axis)) - 0.5));
        let (mut beside, mut by_an_edge) = (0, 0);
        for round in 0..5000 {
            let corners = |k: u64, size: f64, center: DVec3| -> Vec<DVec3> {
                let (u, v) = (point(100 * round + k) * size, point(100 * round + k + 1) * size);
                [u + v, u - v, -u - v, v - u].map(|p| center + p).to_vec()
            };
            let (a, b) = (corners(0, 0.4, DVec3::ZERO), corners(2, 0.4, DVec3::X));
            let wall = corners(4, 1.5, DVec3::X * 0.5 + point(100 * round + 6) * 1.4);
            let shaft = Shaft::new(&a, &b);
            let reaches = inside(&shaft, &wall).len() >= 3;
            assert_eq!(shaft.may_block(&wall, area_vector(&wall).normalize()), reaches, "{a:?} {b:?} {wall:?}");
            let facets = shaft.planes.iter().any(|(n, d)| wall.iter().all(|&p| n.dot(p - shaft.origin) >= *d));
            beside += usize::from(!reaches);
            by_an_edge += usize::from(!reaches && !facets);
        }
        assert!(beside < 4500 && by_an_edge > 100, "{beside} {by_an_edge}");
    }

    /// Floor and ceiling on both sides of the inner edge of an L-shaped room, which the view passes at a distance.
    #[test]
    fn a_view_past_the_edge_of_a_wall_is_clear() {
        let square = |x: f64, y: f64, z: f64| {
            [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]].map(|[u, v]| DVec3::new(x + u, y + v, z))
        };
        let shaft = Shaft::new(&square(1.0, 0.5, 1.0), &square(0.5, 1.0, 0.0));
        for along in [DVec3::X, DVec3::Y] {
            let edge = DVec3::new(1.0, 1.0, 0.0);
            let wall = [edge, edge + along, edge + along + DVec3::Z, edge + DVec3::Z];
            assert!(!shaft.may_block(&wall, area_vector(&wall).normalize()), "{along}");
        }
    }
}

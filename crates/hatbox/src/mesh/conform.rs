//! Making T-junctions conforming: a vertex in the middle of another cell's edge becomes a corner of that cell.
//!
//! Modelled scenes are full of them (the ceiling of the Cornell box is four pieces around the lamp, which meet the
//! walls and each other anywhere). Repairing them once, before anything is subdivided, spares every later step the
//! hanging node; the price is a few more cells. A cell that takes in vertices is cut into the triangles whose smallest
//! angle is as large as it can be without moving or adding a vertex.

use super::box_tree::{Bounds, BoxTree};
use super::corner::{Builder, Corner};
use super::{Cell, Mesh, Topology};
use glam::DVec3;
use rayon::prelude::*;

/// New diagonals may themselves run through vertices, so the repair is repeated; each round makes smaller triangles of
/// the same vertices, and one or two are enough.
const ROUNDS: usize = 8;

/// Up to this many corners the best triangulation is searched in full, O(n³); larger polygons are halved first.
const FULL_SEARCH: usize = 40;

/// A triangulation whose worst triangle has a smallest angle with a sine below this is no triangulation.
const FLAT: f64 = 1e-9;

impl Mesh {
    /// Inserts every vertex that lies within `tolerance` (metres) of the interior of an edge into the cells at that edge,
    /// and tells how many edges were split. Material, group and surface of a cell pass to its pieces, which take its
    /// place; texture coordinates and normals are interpolated along the edge. The mesh must be welded with the same
    /// tolerance, and its quads convex.
    #[must_use]
    pub fn conformed(&self, tolerance: f64) -> (Self, usize) {
        let mut mesh = self.clone();
        let mut total = 0;
        for _ in 0..ROUNDS {
            let Some((next, split)) = mesh.conformed_once(tolerance) else { break };
            (mesh, total) = (next, total + split);
        }
        (mesh, total)
    }

    /// One round; `None` if there is nothing to split.
    fn conformed_once(&self, tolerance: f64) -> Option<(Self, usize)> {
        let topology = Topology::new(self);
        let hanging = self.hanging_vertices(&topology, tolerance);
        if hanging.iter().all(Vec::is_empty) {
            return None;
        }
        let mut builder = Builder::like(self);
        let mut taken = vec![false; topology.edges()];
        for (index, cell) in self.cells.iter().enumerate() {
            let corners = &self.corners(index)[..cell.shape.corners()];
            let edges: Vec<usize> = (0..corners.len()).map(|k| topology.edge(index, k)).collect();
            let polygon = self.with_hanging(corners, &edges, &hanging);
            let triangles = if polygon.len() > corners.len() { triangulate(&polygon) } else { None };
            let Some(triangles) = triangles else {
                builder.push(cell, corners);
                continue;
            };
            for triangle in triangles {
                builder.push(cell, &triangle.map(|k| polygon[k]));
            }
            for edge in edges {
                taken[edge] |= !hanging[edge].is_empty();
            }
        }
        let split = taken.into_iter().filter(|&t| t).count();
        (split > 0).then(|| (builder.finish(), split))
    }

    /// For each edge, the vertices in its interior, in order from its first vertex.
    pub(crate) fn hanging_vertices(&self, topology: &Topology, tolerance: f64) -> Vec<Vec<u32>> {
        let points: Vec<Bounds> = self.vertices.iter().map(|&v| (v, v)).collect();
        let mut used: Vec<u32> = self.cells.iter().flat_map(Cell::corners).copied().collect();
        used.sort_unstable();
        used.dedup();
        let tree = BoxTree::new(&points, used);
        let on_edge = |edge| {
            let [a, b] = topology.vertices(edge);
            let (from, to) = (self.vertices[a as usize], self.vertices[b as usize]);
            let mut found = Vec::new();
            let near = |b: &Bounds| segment_meets(from, to, b, tolerance);
            tree.visit(near, |v| {
                let t = position_on(from, to, self.vertices[v as usize], tolerance);
                found.extend(t.filter(|_| v != a && v != b).map(|t| (t, v)));
            });
            found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            found.into_iter().map(|(_, v)| v).collect()
        };
        (0..topology.edges()).into_par_iter().map(on_edge).collect()
    }

    /// The corners of a cell and the vertices on its edges, in order around it.
    fn with_hanging(&self, corners: &[Corner], edges: &[usize], hanging: &[Vec<u32>]) -> Vec<Corner> {
        let mut polygon: Vec<Corner> = Vec::with_capacity(corners.len());
        for (k, from) in corners.iter().enumerate() {
            let to = &corners[(k + 1) % corners.len()];
            polygon.push(*from);
            let length2 = from.position.distance_squared(to.position);
            let on = &hanging[edges[k]];
            for i in 0..on.len() {
                let vertex = on[if from.vertex < to.vertex { i } else { on.len() - 1 - i }];
                let position = self.vertices[vertex as usize];
                // Within the tolerance of two edges at a sharp corner: it goes to one of them.
                if polygon.iter().chain(corners).all(|c| c.vertex != vertex) {
                    let t = (position - from.position).dot(to.position - from.position) / length2;
                    polygon.push(from.between(to, t, vertex, position));
                }
            }
        }
        polygon
    }
}

/// How far along the segment a point lies, as a fraction, if it is in its interior.
pub(super) fn position_on(from: DVec3, to: DVec3, point: DVec3, tolerance: f64) -> Option<f64> {
    let along = to - from;
    let t = (point - from).dot(along) / along.length_squared();
    let inside = t > 0.0 && t < 1.0 && point.distance(from) > tolerance && point.distance(to) > tolerance;
    (inside && point.distance(from + along * t) <= tolerance).then_some(t)
}

/// Whether a segment passes a box no further than `tolerance` away (in the maximum norm).
pub(super) fn segment_meets(from: DVec3, to: DVec3, (lo, hi): &Bounds, tolerance: f64) -> bool {
    let (lo, hi) = (*lo - tolerance, *hi + tolerance);
    let along = to - from;
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for axis in 0..3 {
        if along[axis] == 0.0 {
            if from[axis] < lo[axis] || from[axis] > hi[axis] {
                return false;
            }
        } else {
            let (s, t) = ((lo[axis] - from[axis]) / along[axis], (hi[axis] - from[axis]) / along[axis]);
            (enter, leave) = (enter.max(s.min(t)), leave.min(s.max(t)));
        }
    }
    enter <= leave
}

/// The triangles of a convex polygon, some of whose corners may be straight, with the largest smallest angle; `None` if
/// it has no area.
fn triangulate(polygon: &[Corner]) -> Option<Vec<[usize; 3]>> {
    let points: Vec<DVec3> = polygon.iter().map(|c| c.position).collect();
    let normal: DVec3 = points.windows(2).map(|w| (w[0] - points[0]).cross(w[1] - points[0])).sum();
    let mut triangles = Vec::with_capacity(points.len() - 2);
    let all: Vec<usize> = (0..points.len()).collect();
    cut(&points, normal.try_normalize()?, &all, &mut triangles).then_some(triangles)
}

/// Triangulates the polygon with the given corners; false if that needs a flat triangle.
fn cut(points: &[DVec3], normal: DVec3, corners: &[usize], triangles: &mut Vec<[usize; 3]>) -> bool {
    let n = corners.len();
    if n <= FULL_SEARCH {
        return best_triangulation(points, normal, corners, triangles);
    }
    // The shortest diagonal that halves the corners and leaves area on both of its sides.
    let at = |i: usize| points[corners[i % n]];
    let area = |from: usize, to: usize| -> f64 {
        (from..to).map(|i| (at(i) - at(from)).cross(at(i + 1) - at(from)).dot(normal)).sum()
    };
    let length2 = |i: usize| at(i).distance_squared(at(i + n / 2));
    let halves = |&i: &usize| area(i, i + n / 2).min(area(i + n / 2, i + n)) > FLAT * length2(i);
    let best = (0..n).filter(halves).min_by(|&a, &b| length2(a).total_cmp(&length2(b)));
    let Some(i) = best else { return best_triangulation(points, normal, corners, triangles) };
    let part = |from: usize, to: usize| -> Vec<usize> { (from..=to).map(|k| corners[k % n]).collect() };
    cut(points, normal, &part(i, i + n / 2), triangles) && cut(points, normal, &part(i + n / 2, i + n), triangles)
}

/// Dynamic programming over the diagonals: the best smallest angle of the corners i to j is that of the best triangle on
/// the chord ij and of the polygons on its other two sides.
fn best_triangulation(points: &[DVec3], normal: DVec3, corners: &[usize], triangles: &mut Vec<[usize; 3]>) -> bool {
    let n = corners.len();
    let mut best = vec![f64::INFINITY; n * n];
    let mut apex = vec![0; n * n];
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            let quality = |k: usize| {
                let triangle = [corners[i], corners[k], corners[j]].map(|c| points[c]);
                smallest_sine(triangle, normal).min(best[i * n + k]).min(best[k * n + j])
            };
            let (k, value) = (i + 1..j)
                .map(|k| (k, quality(k)))
                .reduce(|a, b| if b.1 > a.1 { b } else { a })
                .unwrap_or((i + 1, f64::NEG_INFINITY));
            (best[i * n + j], apex[i * n + j]) = (value, k);
        }
    }
    let mut chords = vec![(0, n - 1)];
    while let Some((i, j)) = chords.pop() {
        if j > i + 1 {
            let k = apex[i * n + j];
            triangles.push([corners[i], corners[k], corners[j]]);
            chords.extend([(k, j), (i, k)]);
        }
    }
    best[n - 1] > FLAT
}

/// The sine of the smallest angle of a triangle, negative if it is turned over.
fn smallest_sine([a, b, c]: [DVec3; 3], normal: DVec3) -> f64 {
    let [x, y, z] = [a.distance(b), b.distance(c), c.distance(a)];
    // The smallest angle lies between the two longest edges.
    let product = (x * y).max(y * z).max(z * x);
    (b - a).cross(c - a).dot(normal) / product
}

//! Splitting cells along the lines in which others stand on them or pass through them.
//!
//! A block that stands on a floor throws the floor under it into the dark, and the light on the floor jumps along the
//! block's feet. No function of the floor's own mesh can jump there, so the floor must have edges there. Each cell is
//! cut along its contacts by a constrained Delaunay triangulation; the points in which contacts end and cross are welded
//! over the whole mesh before any cell is cut, so that what touches shares its vertices afterwards.

use super::box_tree::{self, Bounds, BoxTree, overlap};
use super::conform::{position_on, segment_meets};
use super::corner::{Builder, Corner};
use super::layers::Layers;
use super::weld::distinct;
use super::{Cell, Mesh, Patch};
use crate::element::Shape;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use spade::{ConstrainedDelaunayTriangulation, HasPosition, Point2, PositionInTriangulation, Triangulation};

/// A segment.
pub type Line = [DVec3; 2];

/// Lines that are closer to parallel than this (as a sine) are not asked where they cross; their ends tell where they
/// meet.
const PARALLEL: f64 = 1e-9;
/// Triangles are needles if the sine of an angle is less than this; one beside a short edge gets a corner that sees the edge
/// under an angle of which this is the half's tangent.
const NEEDLE: f64 = 0.26;
/// Edges of so many tolerances are none that a triangle should be as small as.
const SHORTEST: f64 = 100.0;
/// Points are added in so many rounds, and so many times the points that there are, at the most.
const ROUNDS: usize = 12;
const MOST_ADDED: usize = 4;

/// Whether points are added where triangles would be needles. Beside the foot of a chair they streak a floor with light; along
/// the border of a shadow, across which alone the light varies, they are what is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Needles {
    Avoided,
    Kept,
}

/// What a cell is to be cut along.
struct Cut {
    cell: usize,
    lines: Vec<Line>,
    crossings: Vec<DVec3>,
}

/// A mesh whose cells are split.
pub(crate) struct Split {
    pub(crate) mesh: Mesh,
    /// How many cells were.
    pub(crate) cells: usize,
    /// The pieces that were left out, each with the cell that it was a piece of.
    pub(crate) hidden: Vec<(Cell, [DVec3; 4])>,
}

/// The same with vertices for points.
struct Net {
    cell: usize,
    lines: Vec<[u32; 2]>,
    crossings: Vec<u32>,
}

impl Mesh {
    /// Splits every cell along the lines in which cells of other planes touch it or pass through it, and tells how many
    /// cells were split. Lines no longer than `tolerance` (metres) and lines that run along the cell's own edges do not
    /// count. Material, group and surface of a cell pass to its triangles, which take its place; texture coordinates and
    /// normals are interpolated.
    ///
    /// The mesh must be [welded](Self::welded) and [conforming](Self::conformed) with the same tolerance, and its quads
    /// convex. So is the result: where a cell stands on another, they share vertices and edges. Without contacts it is
    /// the mesh itself.
    #[must_use]
    pub fn split_at_contacts(&self, tolerance: f64) -> (Self, usize) {
        let Split { mesh, cells, .. } = self.split_at_contacts_and(&Layers::default(), tolerance);
        (mesh, cells)
    }

    /// The same, and along the outlines of what lies on a face; pieces of which nothing is seen are left out.
    pub(crate) fn split_at_contacts_and(&self, layers: &Layers, tolerance: f64) -> Split {
        self.split_at(&self.cuts(layers, tolerance), layers, tolerance, Needles::Avoided)
    }

    /// Splits cells along segments of their planes, each given with the index of its cell, as far as they lie in it, and
    /// tells how many cells were split. The rest is as for [contacts](Self::split_at_contacts).
    #[must_use]
    pub fn split_along(&self, lines: &[(usize, Line)], tolerance: f64) -> (Self, usize) {
        let mut inside: Vec<(usize, Line)> = lines
            .iter()
            .filter_map(|&(cell, line)| Some((cell, clipped(&self.patch(cell), line, tolerance)?)))
            .collect();
        inside.sort_by_key(|&(cell, _)| cell);
        let cut = |lines: &[(usize, Line)]| {
            let cell = lines[0].0;
            let lines: Vec<Line> = lines.iter().map(|&(_, line)| line).collect();
            Cut { cell, crossings: crossings(&Frame::of(&self.patch(cell)), &lines), lines }
        };
        let cuts: Vec<Cut> = inside.chunk_by(|a, b| a.0 == b.0).map(cut).collect();
        let Split { mesh, cells, .. } = self.split_at(&cuts, &Layers::default(), tolerance, Needles::Kept);
        (mesh, cells)
    }

    fn split_at(&self, cuts: &[Cut], layers: &Layers, tolerance: f64, needles: Needles) -> Split {
        let unchanged = || Split { mesh: self.clone(), cells: 0, hidden: Vec::new() };
        if cuts.is_empty() && layers.faces() == 0 {
            return unchanged();
        }
        let (mesh, nets) = self.with_points_of(cuts, tolerance);
        let mut builder = Builder::like(&mesh);
        let mut nets = nets.iter().peekable();
        let (mut split, mut hidden) = (0, Vec::new());
        for (index, cell) in mesh.cells.iter().enumerate() {
            let net = nets.next_if(|net| net.cell == index);
            let cut = net.and_then(|net| mesh.triangulated_along(net, tolerance, needles, &mut builder));
            split += usize::from(cut.is_some());
            let whole = mesh.corners(index);
            let whole = std::iter::once(&whole[..cell.shape.corners()]).filter(|_| cut.is_none());
            for corners in cut.iter().flatten().map(|triangle| &triangle[..]).chain(whole) {
                let positions = [0, 1, 2, 3].map(|k| corners[k.min(corners.len() - 1)].position);
                let shape = if corners.len() == 3 { Shape::Triangle } else { Shape::Quad };
                // Before edges of others are cut at their corners.
                let hides = || layers.hide(cell.surface, &Patch::new(shape, positions), tolerance);
                if layers.are_on(cell.surface) && hides() {
                    hidden.push((*cell, positions));
                } else {
                    builder.push(cell, corners);
                }
            }
        }
        if split == 0 && hidden.is_empty() {
            return unchanged();
        }
        let (mesh, _) = builder.finish().without_unused_vertices().conformed(tolerance);
        Split { mesh, cells: split, hidden }
    }

    /// The cells that others touch, in order, each with its lines.
    fn cuts(&self, layers: &Layers, tolerance: f64) -> Vec<Cut> {
        let patches: Vec<Patch> = (0..self.cells.len()).into_par_iter().map(|cell| self.patch(cell)).collect();
        let boxes: Vec<Bounds> = patches.iter().map(|p| box_tree::bounds(p.corners().iter().copied())).collect();
        let tree = BoxTree::new(&boxes, (0..self.cells.len() as u32).collect());
        let of = |&cell: &u32| {
            let cell = cell as usize;
            let (lo, hi) = boxes[cell];
            let around = (lo - tolerance, hi + tolerance);
            let near = |b: &Bounds| overlap(&around, b);
            let mut found: Vec<(u32, Line)> = Vec::new();
            tree.visit(near, |other| {
                if other as usize != cell && near(&boxes[other as usize]) {
                    let line = contact_line(&patches[cell], &patches[other as usize], tolerance);
                    found.extend(line.map(|line| (other, line)));
                }
            });
            found.sort_unstable_by_key(|&(other, _)| other);
            let mut lines: Vec<Line> = found.into_iter().map(|(_, line)| line).collect();
            lines.extend(layers.outlines(self.cells[cell].surface, &patches[cell], tolerance));
            (!lines.is_empty()).then(|| Cut { cell, crossings: crossings(&Frame::of(&patches[cell]), &lines), lines })
        };
        let mut cuts: Vec<Cut> = tree.items().par_iter().filter_map(of).collect();
        cuts.sort_unstable_by_key(|cut| cut.cell);
        cuts
    }

    /// The mesh with a vertex for every point of the cuts; points within the tolerance of each other share one.
    fn with_points_of(&self, cuts: &[Cut], tolerance: f64) -> (Self, Vec<Net>) {
        let mut mesh = self.clone();
        for cut in cuts {
            mesh.vertices.extend(cut.lines.iter().flatten().chain(&cut.crossings));
        }
        let merged = mesh.merged_vertices(tolerance);
        let mut points = &merged[self.vertices.len()..];
        let net = |cut: &Cut| {
            let (ends, others) = points.split_at(2 * cut.lines.len());
            let (crossings, rest) = others.split_at(cut.crossings.len());
            points = rest;
            Net { cell: cut.cell, lines: ends.as_chunks().0.to_vec(), crossings: crossings.to_vec() }
        };
        let nets = cuts.iter().map(net).collect();
        (mesh, nets)
    }

    /// The triangles of a cell that has the lines of the net among their edges, with vertices that the mesh to be built gets for
    /// them; `None` if there is nothing to cut.
    fn triangulated_along(
        &self,
        net: &Net,
        tolerance: f64,
        needles: Needles,
        builder: &mut Builder,
    ) -> Option<Vec<[Corner; 3]>> {
        let corners = &self.corners(net.cell)[..self.cells[net.cell].shape.corners()];
        let mut vertices: Vec<u32> = corners.iter().map(|corner| corner.vertex).collect();
        let edges: Vec<[u32; 2]> =
            (0..corners.len()).map(|k| [vertices[k], vertices[(k + 1) % corners.len()]]).collect();
        vertices.extend(net.lines.iter().flatten().chain(&net.crossings));
        vertices.sort_unstable();
        vertices.dedup();
        let positions: Vec<DVec3> = vertices.iter().map(|&v| self.vertices[v as usize]).collect();
        let local = |lines: &[[u32; 2]]| -> Vec<[usize; 2]> {
            lines.iter().map(|ends| ends.map(|v| vertices.partition_point(|&u| u < v))).collect()
        };
        let boundary = pieces(&local(&edges), &positions, tolerance);
        let mut inner = pieces(&local(&net.lines), &positions, tolerance);
        inner.retain(|piece| boundary.binary_search(piece).is_err());
        if inner.is_empty() {
            return None;
        }
        let frame = Frame::of(&self.patch(net.cell));
        let flat: Vec<DVec2> = positions.iter().map(|&p| frame.flat(p)).collect();
        let (added, triangles) = delaunay(&flat, boundary.iter().chain(&inner), tolerance, needles)?;
        let added: Vec<Corner> = added.into_iter().map(|p| self.corner_at(net.cell, builder, frame.point(p))).collect();
        let corner = |k: usize| match vertices.get(k) {
            None => added[k - vertices.len()],
            Some(&vertex) => {
                let own = corners.iter().find(|corner| corner.vertex == vertex);
                own.copied().unwrap_or_else(|| self.corner_within(net.cell, vertex, self.vertices[vertex as usize]))
            }
        };
        let mut triangles: Vec<[Corner; 3]> = triangles.into_iter().map(|t| t.map(corner)).collect();
        // Vertices beside an edge by the last bits leave flat triangles on it.
        triangles.retain(|triangle| distinct(triangle, tolerance).is_some());
        (triangles.len() > 1).then_some(triangles)
    }

    /// The corner of a part of a cell at a new vertex within the cell.
    fn corner_at(&self, cell: usize, builder: &mut Builder, position: DVec3) -> Corner {
        self.corner_within(cell, builder.vertex(position), position)
    }
}

/// Plane coordinates on a cell, counter-clockwise like its corners.
struct Frame {
    origin: DVec3,
    axes: [DVec3; 2],
}

impl Frame {
    fn of(patch: &Patch) -> Self {
        let corners = patch.corners();
        let x = (corners[1] - corners[0]).normalize_or_zero();
        Self { origin: corners[0], axes: [x, patch.normal().cross(x)] }
    }

    fn flat(&self, p: DVec3) -> DVec2 {
        let [x, y] = self.axes.map(|axis| (p - self.origin).dot(axis));
        DVec2::new(x, y)
    }

    fn point(&self, p: DVec2) -> DVec3 {
        self.origin + self.axes[0] * p.x + self.axes[1] * p.y
    }
}

/// The line in which b meets the inside of a, unless both lie in one plane.
fn contact_line(a: &Patch, b: &Patch, tolerance: f64) -> Option<Line> {
    let over_a = heights(a, b, tolerance);
    let corners = over_a[..b.corners().len()].iter();
    let (above, below) = (corners.clone().any(|&h| h > 0.0), corners.clone().any(|&h| h < 0.0));
    let on = corners.filter(|&&h| h == 0.0).count();
    let reaches = (above && below) || ((above || below) && on > 1);
    if !reaches || heights(b, a, tolerance)[..a.corners().len()].iter().all(|&h| h == 0.0) {
        return None;
    }
    let along = a.normal().cross(b.normal());
    let points = section(b, &over_a);
    let order = |p: &&DVec3, q: &&DVec3| p.dot(along).total_cmp(&q.dot(along));
    let (first, last) = (points.iter().min_by(order)?, points.iter().max_by(order)?);
    clipped(a, [*first, *last], tolerance)
}

/// The heights of b's corners over the plane of a, with no difference made within the tolerance of it.
fn heights(a: &Patch, b: &Patch, tolerance: f64) -> [f64; 4] {
    let mut heights = [0.0; 4];
    for (height, corner) in heights.iter_mut().zip(b.corners()) {
        let h = (corner - a.corners()[0]).dot(a.normal());
        *height = if h.abs() <= tolerance { 0.0 } else { h };
    }
    heights
}

/// The points of a cell's boundary at height zero.
fn section(cell: &Patch, heights: &[f64; 4]) -> Vec<DVec3> {
    let corners = cell.corners();
    let mut points = Vec::with_capacity(corners.len());
    for (k, &from) in corners.iter().enumerate() {
        let next = (k + 1) % corners.len();
        let (h, h_next) = (heights[k], heights[next]);
        if h == 0.0 {
            points.push(from);
        } else if h * h_next < 0.0 {
            points.push(from.lerp(corners[next], h / (h - h_next)));
        }
    }
    points
}

/// The part of a line in a cell's plane that lies in the cell, if it is longer than the tolerance and does not run along
/// one of the edges.
pub(super) fn clipped(cell: &Patch, mut line: Line, tolerance: f64) -> Option<Line> {
    let corners = cell.corners();
    // What is cut off at one edge may leave no more than what runs along another, so that is looked at again.
    for k in (0..corners.len()).chain(0..corners.len()) {
        let inward = cell.normal().cross(corners[(k + 1) % corners.len()] - corners[k]).normalize_or_zero();
        let [h, g] = line.map(|p| (p - corners[k]).dot(inward));
        if h.max(g) <= tolerance {
            return None;
        }
        let [p, q] = line;
        // An end that is on the edge within the tolerance stays what it is, usually a vertex.
        if h < -tolerance {
            line[0] = p.lerp(q, h / (h - g));
        } else if g < -tolerance {
            line[1] = q.lerp(p, g / (g - h));
        }
    }
    (line[0].distance(line[1]) > tolerance).then_some(line)
}

/// The points in which lines cross.
fn crossings(frame: &Frame, lines: &[Line]) -> Vec<DVec3> {
    let boxes: Vec<Bounds> = lines.iter().map(|&line| box_tree::bounds(line)).collect();
    let tree = BoxTree::new(&boxes, (0..lines.len() as u32).collect());
    let flat: Vec<[DVec2; 2]> = lines.iter().map(|line| line.map(|p| frame.flat(p))).collect();
    let mut points = Vec::new();
    for (i, [from, to]) in lines.iter().enumerate() {
        let near = |b: &Bounds| overlap(b, &boxes[i]);
        tree.visit(near, |j| {
            if (j as usize) < i {
                points.extend(crossing(flat[i], flat[j as usize]).map(|t| from.lerp(*to, t)));
            }
        });
    }
    points
}

/// How far along the first line another crosses it, as a fraction.
fn crossing([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> Option<f64> {
    let (u, v) = (b - a, d - c);
    let sine = u.perp_dot(v);
    if sine.abs() <= PARALLEL * u.length() * v.length() {
        return None;
    }
    let (s, t) = ((c - a).perp_dot(v) / sine, (c - a).perp_dot(u) / sine);
    let within = 0.0..=1.0;
    (within.contains(&s) && within.contains(&t)).then_some(s)
}

/// Lines between points cut at the points that lie on them, sorted, each once and from the lower index to the higher.
fn pieces(lines: &[[usize; 2]], points: &[DVec3], tolerance: f64) -> Vec<[usize; 2]> {
    let boxes: Vec<Bounds> = points.iter().map(|&p| (p, p)).collect();
    let tree = BoxTree::new(&boxes, (0..points.len() as u32).collect());
    let mut pieces = Vec::with_capacity(lines.len());
    for &[from, to] in lines.iter().filter(|[from, to]| from != to) {
        let (start, end) = (points[from], points[to]);
        let mut stops = vec![(0.0, from), (1.0, to)];
        let near = |b: &Bounds| segment_meets(start, end, b, tolerance);
        tree.visit(near, |k| {
            let t = position_on(start, end, points[k as usize], tolerance);
            stops.extend(t.map(|t| (t, k as usize)));
        });
        stops.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        pieces.extend(stops.windows(2).map(|w| [w[0].1.min(w[1].1), w[0].1.max(w[1].1)]));
    }
    pieces.sort_unstable();
    pieces.dedup();
    pieces
}

/// A point that knows its number, if it was given one.
struct Node {
    at: Point2<f64>,
    index: Option<usize>,
}

impl HasPosition for Node {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        self.at
    }
}

impl From<Point2<f64>> for Node {
    fn from(at: Point2<f64>) -> Self {
        Self { at, index: None }
    }
}

/// The constrained Delaunay triangulation of points, counter-clockwise, and points that were added to them, numbered
/// after them, where triangles would have been needles otherwise; `None` if points are not finite. Where lines cross
/// between the points, the first stays.
fn delaunay<'a>(
    points: &[DVec2],
    lines: impl Iterator<Item = &'a [usize; 2]>,
    tolerance: f64,
    needles: Needles,
) -> Option<(Vec<DVec2>, Vec<[usize; 3]>)> {
    let mut triangulation = ConstrainedDelaunayTriangulation::<Node>::new();
    let mut handles = Vec::with_capacity(points.len());
    for (index, p) in points.iter().enumerate() {
        let at = spade::mitigate_underflow(Point2::new(p.x, p.y));
        handles.push(triangulation.insert(Node { at, index: Some(index) }).ok()?);
    }
    for &[from, to] in lines {
        // Two vertices above each other are one point here.
        if handles[from] != handles[to] {
            triangulation.try_add_constraint(handles[from], handles[to]);
        }
    }
    if needles == Needles::Avoided {
        without_needles(&mut triangulation, tolerance);
    }
    let mut added = Vec::new();
    let numbers: Vec<usize> = triangulation
        .vertices()
        .map(|vertex| {
            let Node { at, index } = *vertex.data();
            index.unwrap_or_else(|| {
                added.push(DVec2::new(at.x, at.y));
                points.len() + added.len() - 1
            })
        })
        .collect();
    let triangles = triangulation.inner_faces().map(|face| face.vertices().map(|vertex| numbers[vertex.index()]));
    Some((added, triangles.collect()))
}

/// Adds points beside the short edges of needles: where they do not crowd the corners of the triangle that they fall into, nor
/// come near those of its edges that are lines. Edges of a few tolerances are left alone.
///
/// It is the refinement of J. Ruppert (1995) with the off-centers of A. Üngör (2004), but lines are not cut: other cells share
/// them. (That of `spade` was tried; it gives up in flat triangles that rounding leaves at borders.)
fn without_needles(triangulation: &mut ConstrainedDelaunayTriangulation<Node>, tolerance: f64) {
    let most = (1 + MOST_ADDED) * triangulation.num_vertices();
    for _ in 0..ROUNDS {
        let found: Vec<(DVec2, f64)> = triangulation
            .inner_faces()
            .filter_map(|face| beside_needle(face.positions().map(|p| DVec2::new(p.x, p.y))))
            .collect();
        let mut added = false;
        for (p, apart) in found {
            let at = Point2::new(p.x, p.y);
            let has_room = triangulation.num_vertices() < most && apart > SHORTEST * tolerance;
            if has_room && is_free(triangulation, at, apart) {
                added |= triangulation.insert(Node::from(at)).is_ok();
            }
        }
        if !added {
            return;
        }
    }
}

/// Where a point would make a better triangle with the shortest edge of a needle, and how long that edge is.
fn beside_needle(corners: [DVec2; 3]) -> Option<(DVec2, f64)> {
    let length = |k: usize| corners[k].distance(corners[(k + 1) % 3]);
    let shortest = (0..3).min_by(|&j, &k| length(j).total_cmp(&length(k)))?;
    let [a, b, c] = [0, 1, 2].map(|k| corners[(shortest + k) % 3]);
    let (edge, sides) = (b - a, (c - a).length() * (c - b).length());
    let sine = (c - a).perp_dot(c - b).abs() / sides;
    if sine.is_nan() || sine >= NEEDLE {
        return None;
    }
    // No farther than the centre of the circle through the corners.
    let height = (0.5 * edge.length() * (1.0 - sine * sine).sqrt() / sine).min(0.5 * edge.length() / NEEDLE);
    let towards = edge.perp().normalize_or_zero();
    Some((0.5 * (a + b) + towards * height, edge.length()))
}

/// Whether a point lies in a triangle, is so far apart from its corners, and sees none of its edges that are lines under an
/// obtuse angle.
fn is_free(triangulation: &ConstrainedDelaunayTriangulation<Node>, at: Point2<f64>, apart: f64) -> bool {
    let PositionInTriangulation::OnFace(face) = triangulation.locate(at) else { return false };
    let p = DVec2::new(at.x, at.y);
    triangulation.face(face).adjacent_edges().iter().all(|edge| {
        let [from, to] = edge.positions().map(|q| DVec2::new(q.x, q.y) - p);
        from.length() >= apart && (!edge.is_constraint_edge() || from.dot(to) >= 0.0)
    })
}

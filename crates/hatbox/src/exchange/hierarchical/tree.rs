//! The cells of each plane in a tree of rectangles.
//!
//! Only cells in one plane are clustered: there a cluster has one normal, neither sees nor hides itself, and its functions
//! are polynomials of two variables. All clusters of a plane share its axes, so that polynomials pass between them
//! exactly, axis by axis.

use crate::mesh::Patch;
use crate::visibility::Body;
use glam::{DVec2, DVec3};
use std::collections::HashMap;
use std::ops::Range;

/// Cells of a leaf at the most.
const LEAF: usize = 8;
/// Fewer coplanar cells than this are no tree.
const FEWEST: usize = 4;
/// Planes are the same if normals and distances agree to so many steps of their size.
const STEPS: f64 = 1e7;
/// How far a corner may lie from its plane, relative to the scene.
const FLAT: f64 = 1e-6;

/// The corners of a rectangle.
const CORNERS: [[f64; 2]; 4] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];

/// A cell's place in no tree.
pub(super) const NOWHERE: u32 = u32::MAX;

/// A rectangle around cells of one plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rectangle {
    pub(super) center: DVec3,
    /// From the centre to the middles of two sides.
    pub(super) half: [DVec3; 2],
    pub(super) normal: DVec3,
}

impl Rectangle {
    pub(super) fn point(&self, at: [f64; 2]) -> DVec3 {
        self.center + self.half[0] * at[0] + self.half[1] * at[1]
    }

    /// The coordinates of a point, from −1 to 1 inside.
    pub(super) fn locate(&self, point: DVec3) -> [f64; 2] {
        self.half.map(|half| half.dot(point - self.center) / half.length_squared())
    }

    pub(super) fn corners(&self) -> [DVec3; 4] {
        CORNERS.map(|at| self.point(at))
    }

    pub(super) fn radius(&self) -> f64 {
        (self.half[0] + self.half[1]).length()
    }

    /// The rectangle as the end of a shaft: smaller, and lifted off its plane, by a length that is nothing. Files hold
    /// single-precision coordinates, so that coplanar faces and the walls that it ends at would else be in the way.
    pub(super) fn body(&self, nothing: f64) -> Body {
        let inset = self.half.map(|half| 1.0 - (nothing / half.length()).min(0.5));
        let at = |[x, y]: [f64; 2]| self.point([x * inset[0], y * inset[1]]) + self.normal * nothing;
        Body::polygon(&CORNERS.map(at))
    }
}

/// Cells that follow each other in the order.
#[derive(Debug)]
pub(super) struct Cluster {
    /// Places in the order.
    pub(super) range: Range<u32>,
    /// Empty for a leaf. Children come later in the list than their parent.
    pub(super) children: Range<u32>,
    pub(super) rectangle: Rectangle,
    /// Area of its cells.
    pub(super) area: f64,
}

/// The trees of a scene.
#[derive(Debug, Default)]
pub(super) struct Tree {
    /// The cell at each place.
    pub(super) order: Vec<u32>,
    /// The place of each cell, or [`NOWHERE`].
    pub(super) place: Vec<u32>,
    pub(super) clusters: Vec<Cluster>,
    /// The clusters of each plane: the first is its root.
    pub(super) planes: Vec<Range<u32>>,
    /// A length that is nothing: [`FLAT`] of the scene's size.
    pub(super) nothing: f64,
}

impl Tree {
    /// Over the cells that `take` accepts.
    pub(super) fn new(cells: usize, patch: &dyn Fn(usize) -> Patch, take: &dyn Fn(usize) -> bool) -> Self {
        let mut tree = Self { place: vec![NOWHERE; cells], ..Self::default() };
        let (groups, size) = planes(cells, patch, take);
        tree.nothing = FLAT * size;
        for group in groups {
            let mut members: Vec<Member> = Vec::with_capacity(group.len());
            let first = patch(group[0] as usize);
            let frame = Frame::new(&first);
            members.extend(group.iter().map(|&cell| Member::new(cell, &patch(cell as usize), &frame)));
            let start = tree.clusters.len() as u32;
            tree.divide(&mut members, &frame);
            tree.planes.push(start..tree.clusters.len() as u32);
        }
        for (place, &cell) in tree.order.iter().enumerate() {
            tree.place[cell as usize] = place as u32;
        }
        tree
    }

    /// Adds a cluster of the members, and those below it.
    fn divide(&mut self, members: &mut [Member], frame: &Frame) {
        let root = self.clusters.len();
        self.push(members, frame);
        let mut stack = vec![(root, 0..members.len())];
        let offset = self.order.len() as u32;
        while let Some((at, range)) = stack.pop() {
            if range.len() > LEAF {
                let part = &mut members[range.clone()];
                let middle = range.start + halve(part);
                let first = self.clusters.len();
                for half in [range.start..middle, middle..range.end] {
                    self.push(&members[half.clone()], frame);
                    stack.push((self.clusters.len() - 1, half));
                }
                self.clusters[at].children = first as u32..first as u32 + 2;
            }
            self.clusters[at].range = offset + range.start as u32..offset + range.end as u32;
        }
        self.order.extend(members.iter().map(|member| member.cell));
    }

    fn push(&mut self, members: &[Member], frame: &Frame) {
        let area = members.iter().map(|member| member.area).sum();
        self.clusters.push(Cluster { range: 0..0, children: 0..0, rectangle: frame.around(members), area });
    }

    pub(super) fn bytes(&self) -> usize {
        4 * (self.order.len() + self.place.len()) + size_of_val(&*self.clusters)
    }
}

/// A cell in the coordinates of its plane.
struct Member {
    cell: u32,
    area: f64,
    middle: DVec2,
    low: DVec2,
    high: DVec2,
}

impl Member {
    fn new(cell: u32, patch: &Patch, frame: &Frame) -> Self {
        let corners = || patch.corners().iter().map(|&corner| frame.project(corner));
        let (low, high) =
            (corners().fold(DVec2::INFINITY, DVec2::min), corners().fold(DVec2::NEG_INFINITY, DVec2::max));
        Self { cell, area: patch.area(), middle: frame.project(patch.center()), low, high }
    }
}

/// The coordinates of a plane.
struct Frame {
    origin: DVec3,
    axes: [DVec3; 2],
    normal: DVec3,
}

impl Frame {
    /// Along the longest edge of a cell: most faces are rectangles.
    fn new(patch: &Patch) -> Self {
        let (corners, normal) = (patch.corners(), patch.normal());
        let edge = |k: usize| corners[(k + 1) % corners.len()] - corners[k];
        // Of a halved rectangle the longest edge is the diagonal.
        let axis = if corners.len() == 3 {
            let square = (0..3).min_by(|&i, &j| {
                let angle = |k: usize| edge(k).normalize_or_zero().dot(edge((k + 1) % 3).normalize_or_zero()).abs();
                angle(i).total_cmp(&angle(j))
            });
            edge(square.unwrap_or(0))
        } else {
            edge(0)
        };
        let e1 = axis.normalize_or(normal.any_orthonormal_vector());
        Self { origin: corners[0], axes: [e1, normal.cross(e1)], normal }
    }

    fn project(&self, point: DVec3) -> DVec2 {
        let p = point - self.origin;
        DVec2::new(self.axes[0].dot(p), self.axes[1].dot(p))
    }

    fn around(&self, members: &[Member]) -> Rectangle {
        let low = members.iter().map(|member| member.low).fold(DVec2::INFINITY, DVec2::min);
        let high = members.iter().map(|member| member.high).fold(DVec2::NEG_INFINITY, DVec2::max);
        let (middle, half) = (low.midpoint(high), 0.5 * (high - low));
        let center = self.origin + self.axes[0] * middle.x + self.axes[1] * middle.y;
        Rectangle { center, half: [self.axes[0] * half.x, self.axes[1] * half.y], normal: self.normal }
    }
}

/// Sorts the members along the longer side and returns where to divide them.
fn halve(members: &mut [Member]) -> usize {
    let low = members.iter().map(|member| member.middle).fold(DVec2::INFINITY, DVec2::min);
    let high = members.iter().map(|member| member.middle).fold(DVec2::NEG_INFINITY, DVec2::max);
    let axis = usize::from((high - low).y > (high - low).x);
    let middle = members.len() / 2;
    members.select_nth_unstable_by(middle, |a, b| a.middle[axis].total_cmp(&b.middle[axis]).then(a.cell.cmp(&b.cell)));
    middle
}

/// The cells of each plane and side, in ascending order of their first, and the size of the scene.
fn planes(cells: usize, patch: &dyn Fn(usize) -> Patch, take: &dyn Fn(usize) -> bool) -> (Vec<Vec<u32>>, f64) {
    let taken = || (0..cells).filter(|&cell| take(cell));
    let lo = taken().map(|cell| patch(cell).center()).fold(DVec3::INFINITY, DVec3::min);
    let hi = taken().map(|cell| patch(cell).center()).fold(DVec3::NEG_INFINITY, DVec3::max);
    let (middle, size) = (lo.midpoint(hi), lo.distance(hi).max(f64::MIN_POSITIVE));
    let mut number = HashMap::new();
    let mut planes: Vec<Vec<u32>> = Vec::new();
    for cell in taken() {
        let patch = patch(cell);
        let n = patch.normal();
        let round = |x: f64| (x * STEPS).round() as i64;
        let key = [round(n.x), round(n.y), round(n.z), round(n.dot(patch.center() - middle) / size)];
        let plane = *number.entry(key).or_insert(planes.len());
        if plane == planes.len() {
            planes.push(Vec::new());
        }
        planes[plane].push(cell as u32);
    }
    planes.retain(|plane| plane.len() >= FEWEST && is_flat(plane, patch, FLAT * size));
    (planes, size)
}

fn is_flat(plane: &[u32], patch: &dyn Fn(usize) -> Patch, height: f64) -> bool {
    let first = patch(plane[0] as usize);
    let above = |corner: &DVec3| first.normal().dot(*corner - first.corners()[0]).abs();
    plane.iter().all(|&cell| patch(cell as usize).corners().iter().all(|corner| above(corner) <= height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::Shape;

    /// A floor of n × n unit squares, and a lone one above it.
    fn patch(n: usize, cell: usize) -> Patch {
        let (x, y) = ((cell % n) as f64, (cell / n) as f64);
        let height = if cell < n * n { 0.0 } else { 2.0 };
        let at = |dx: f64, dy: f64| DVec3::new(x + dx, y + dy, height);
        Patch::new(Shape::Quad, [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)])
    }

    #[test]
    fn every_cell_of_a_plane_lies_in_its_clusters_and_single_cells_in_none() {
        let n = 13;
        let tree = Tree::new(n * n + 1, &|cell| patch(n, cell), &|_| true);
        assert_eq!((tree.planes.len(), tree.order.len()), (1, n * n));
        assert_eq!(tree.place[n * n], NOWHERE);
        for cluster in &tree.clusters {
            let cells = &tree.order[cluster.range.start as usize..cluster.range.end as usize];
            assert!((cluster.area - cells.len() as f64).abs() < 1e-9);
            assert!(cluster.children.is_empty() == (cells.len() <= LEAF));
            for &cell in cells {
                for &corner in patch(n, cell as usize).corners() {
                    assert!(cluster.rectangle.locate(corner).iter().all(|x| x.abs() <= 1.0 + 1e-12));
                }
            }
        }
    }
}

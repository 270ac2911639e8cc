//! Faces that lie on others and look the same way: a rug that is drawn into its floor, a poster, a face that is there twice.
//!
//! Both would send and receive light as if the other were not there, and together twice what there is. Of two layers one is
//! seen, and nobody says which; what lies on what is told by sizes. All that one object has of one material in a plane lies on what
//! is larger, of faces of these the smaller on the larger, and of two alike the later on the earlier.
//!
//! Faces that look opposite ways in one plane are another matter: a box on a floor, or two sides of a wall. Who sees what is
//! found where light is exchanged.

use super::box_tree::{self, Bounds, BoxTree};
use super::contact::{Line, clipped};
use super::intersect::share_plane;
use super::{Mesh, Patch};
use glam::DVec3;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::{HashMap, HashSet};

/// Planes are told apart by numbers: normals by thousandths, distances by so many tolerances. (Planes that are taken for two
/// by rounding change no more than who of two lies on whom.)
const NORMAL: f64 = 1e3;
const DISTANCE: f64 = 1e3;
/// No plane that is likely has such numbers that rounding would tell it apart from itself.
const UNLIKELY: f64 = 0.372_1;

/// Which sides of a face send and receive light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lit {
    /// None: it only blocks light.
    Neither,
    /// The front.
    Front,
    /// Both.
    Both,
}

/// What lies on the faces of a mesh.
#[derive(Debug, Default)]
pub(crate) struct Layers {
    on: HashMap<u32, Pile>,
}

/// What lies on a face.
#[derive(Debug)]
struct Pile {
    /// Which sides of the face are lit.
    below: Lit,
    /// The faces that lie on it, and whether both of their sides are lit.
    layers: Vec<(Patch, bool)>,
    tree: BoxTree,
    boxes: Vec<Bounds>,
    /// Their edges, but for those between two that are alike.
    outline: Vec<Line>,
}

impl Pile {
    fn new(mesh: &Mesh, below: Lit, layers: Vec<(u32, Patch, bool)>) -> Self {
        let edges_of = |&(face, _, both): &(u32, Patch, bool)| {
            let of = mesh.cells[face as usize].corners().to_vec();
            (0..of.len()).map(move |k| ([of[k], of[(k + 1) % of.len()]], both))
        };
        let edges: HashSet<([u32; 2], bool)> = layers.iter().flat_map(edges_of).collect();
        let is_border = |&&([u, v], both): &&([u32; 2], bool)| !edges.contains(&([v, u], both));
        let mut outline: Vec<[u32; 2]> = edges.iter().filter(is_border).map(|&(ends, _)| ends).collect();
        outline.sort_unstable();
        let boxes: Vec<Bounds> =
            layers.iter().map(|(_, patch, _)| box_tree::bounds(patch.corners().iter().copied())).collect();
        Self {
            below,
            tree: BoxTree::new(&boxes, (0..layers.len() as u32).collect()),
            boxes,
            layers: layers.into_iter().map(|(_, patch, both)| (patch, both)).collect(),
            outline: outline.into_iter().map(|ends| ends.map(|v| mesh.vertices[v as usize])).collect(),
        }
    }

    /// Whether something lies on the side to which `normal` points, at a point that is on no outline.
    fn covers(&self, point: DVec3, normal: DVec3, tolerance: f64) -> bool {
        let around = (point - tolerance, point + tolerance);
        let mut found = false;
        self.tree.visit(
            |b| box_tree::overlap(b, &around),
            |k| {
                let (patch, both) = &self.layers[k as usize];
                let looks_alike = *both || patch.normal().dot(normal) > 0.0;
                found |= looks_alike
                    && box_tree::overlap(&self.boxes[k as usize], &around)
                    && holds(patch, point, tolerance);
            },
        );
        found
    }
}

impl Layers {
    /// What lies on what in a welded mesh whose [surfaces](super::Cell::surface) are its cells.
    pub(crate) fn of(mesh: &Mesh, tolerance: f64, lit: impl Fn(u32) -> Lit + Sync) -> Self {
        let faces = mesh.cells.len();
        let patches: Vec<Patch> = (0..faces).into_par_iter().map(|cell| mesh.patch(cell)).collect();
        let lit: Vec<Lit> = mesh.cells.iter().map(|cell| lit(cell.material)).collect();
        let ranks = ranks(mesh, &patches, tolerance);
        let boxes: Vec<Bounds> = patches.iter().map(|p| box_tree::bounds(p.corners().iter().copied())).collect();
        let tree = BoxTree::new(&boxes, (0..faces as u32).filter(|&f| lit[f as usize] != Lit::Neither).collect());
        let of = |&face: &u32| {
            let below = face as usize;
            let (lo, hi) = boxes[below];
            let near = |b: &Bounds| box_tree::overlap(b, &(lo - tolerance, hi + tolerance));
            let mut found = Vec::new();
            tree.visit(near, |other| {
                let above = other as usize;
                let look_alike = || {
                    let alike = patches[below].normal().dot(patches[above].normal()) > 0.0;
                    alike || lit[below] == Lit::Both || lit[above] == Lit::Both
                };
                let lies_on = ranks[above] > ranks[below] && near(&boxes[above]) && look_alike();
                if lies_on && share_plane(&patches[below], &patches[above], tolerance) {
                    found.push((other, patches[above], lit[above] == Lit::Both));
                }
            });
            found.sort_unstable_by_key(|&(other, ..)| other);
            (!found.is_empty()).then(|| (face, Pile::new(mesh, lit[below], found)))
        };
        Self { on: tree.items().par_iter().filter_map(of).collect() }
    }

    /// The faces that others lie on.
    pub(crate) fn faces(&self) -> usize {
        self.on.len()
    }

    /// Whether others lie on a face.
    pub(crate) fn are_on(&self, face: u32) -> bool {
        self.on.contains_key(&face)
    }

    /// The outlines of what lies on a face, as far as they run through a cell of it.
    pub(super) fn outlines(&self, face: u32, cell: &Patch, tolerance: f64) -> Vec<Line> {
        let edges = self.on.get(&face).into_iter().flat_map(|pile| &pile.outline);
        edges.filter_map(|&edge| clipped(cell, edge, tolerance)).collect()
    }

    /// Whether something lies on the side of a piece of a face to which `normal` points; the piece is on one side of all outlines.
    pub(crate) fn cover(&self, face: u32, piece: &Patch, normal: DVec3, tolerance: f64) -> bool {
        self.on.get(&face).is_some_and(|pile| pile.covers(piece.center(), normal, tolerance))
    }

    /// Whether nothing of a piece of a face is seen: something lies on each side that is lit.
    pub(super) fn hide(&self, face: u32, piece: &Patch, tolerance: f64) -> bool {
        let normal = piece.normal();
        self.on.get(&face).is_some_and(|pile| {
            let is_under = |normal: DVec3| pile.covers(piece.center(), normal, tolerance);
            is_under(normal) && (pile.below != Lit::Both || is_under(-normal))
        })
    }
}

/// Who lies on whom if they share a plane: the greater.
fn ranks(mesh: &Mesh, patches: &[Patch], tolerance: f64) -> Vec<(Reverse<u64>, Reverse<u64>, usize)> {
    let part = |face: usize| (mesh.cells[face].group, mesh.cells[face].material, plane(&patches[face], tolerance));
    let mut areas: HashMap<_, f64> = HashMap::new();
    for (face, patch) in patches.iter().enumerate() {
        *areas.entry(part(face)).or_default() += patch.area();
    }
    // The bits of positive numbers are in their order.
    let of =
        |(face, patch): (usize, &Patch)| (Reverse(areas[&part(face)].to_bits()), Reverse(patch.area().to_bits()), face);
    patches.iter().enumerate().map(of).collect()
}

/// Numbers that tell the plane of a face, whichever way it looks.
fn plane(patch: &Patch, tolerance: f64) -> [i64; 4] {
    let normal = patch.normal();
    let way = normal.to_array().into_iter().find(|x| x.abs() > UNLIKELY / 2.0).unwrap_or(1.0).signum();
    let distance = normal.dot(patch.corners()[0]) / (DISTANCE * tolerance.max(f64::MIN_POSITIVE));
    let [x, y, z] = normal.to_array().map(|x| x * NORMAL);
    [x, y, z, distance].map(|number| (way * number + UNLIKELY).floor() as i64)
}

/// Whether a point in the plane of a convex polygon lies in it, or on its border: there may be another behind.
fn holds(patch: &Patch, point: DVec3, tolerance: f64) -> bool {
    let corners = patch.corners();
    (0..corners.len()).all(|k| {
        let (from, to) = (corners[k], corners[(k + 1) % corners.len()]);
        patch.normal().dot((to - from).cross(point - from)) >= -tolerance * from.distance(to)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::Shape;
    use crate::mesh::Cell;

    /// A square of side 1 for the floor and one of side ½ on it, each a part of its own; its front looks up if `up`.
    fn rug(up: bool) -> Mesh {
        let square = |a: f64, b: f64| [(a, a), (b, a), (b, b), (a, b)].map(|(x, y)| DVec3::new(x, y, 0.0));
        let cell = |vertices, part| Cell { shape: Shape::Quad, vertices, material: part, group: part, surface: part };
        let on_it = if up { [4, 5, 6, 7] } else { [4, 7, 6, 5] };
        Mesh {
            vertices: [square(0.0, 1.0), square(0.25, 0.75)].concat(),
            cells: vec![cell([0, 1, 2, 3], 0), cell(on_it, 1)],
            groups: vec!["floor".to_owned(), "rug".to_owned()],
            ..Mesh::default()
        }
    }

    /// A small triangle about (x, ½).
    fn piece(x: f64) -> Patch {
        let at = |dx: f64, dy: f64| DVec3::new(x + dx, 0.5 + dy, 0.0);
        Patch::new(Shape::Triangle, [at(0.0, 0.0), at(0.03, 0.0), at(0.0, 0.03), at(0.0, 0.03)])
    }

    #[test]
    fn the_smaller_part_lies_on_the_larger_if_sides_that_are_lit_share_a_plane() {
        for (up, lit, lies) in [
            (true, [Lit::Front, Lit::Front], true),
            (false, [Lit::Front, Lit::Front], false),
            (false, [Lit::Front, Lit::Both], true),
            (true, [Lit::Front, Lit::Neither], false),
        ] {
            let layers = Layers::of(&rug(up), 1e-9, |material| lit[material as usize]);
            assert_eq!(layers.are_on(0), lies, "{up} {lit:?}");
            assert!(!layers.are_on(1));
            assert_eq!(layers.cover(0, &piece(0.5), DVec3::Z, 1e-9), lies);
            assert!(!layers.cover(0, &piece(0.1), DVec3::Z, 1e-9));
        }
    }

    /// A piece may have its middle on the edge between two layers.
    #[test]
    fn layers_hold_what_lies_between_them() {
        let mut mesh = rug(true);
        let [a, b, c, d] = mesh.cells[1].vertices;
        let half = |vertices| Cell { shape: Shape::Triangle, vertices, ..mesh.cells[1] };
        let halves = [half([a, b, c, c]), Cell { surface: 2, ..half([a, c, d, d]) }];
        mesh.cells.splice(1.., halves);
        let layers = Layers::of(&mesh, 1e-9, |_| Lit::Front);
        assert_eq!(layers.outlines(0, &mesh.patch(0), 1e-9).len(), 4, "the diagonal is no border");
        for k in 1..20 {
            let at =
                |dx: f64, dy: f64| DVec3::new(0.26 + 0.02 * f64::from(k) + dx, 0.26 + 0.02 * f64::from(k) + dy, 0.0);
            let piece = Patch::new(Shape::Quad, [at(0.01, 0.0), at(0.01, 0.01), at(0.0, 0.01), at(0.0, 0.0)]);
            assert!(layers.hide(0, &piece, 1e-9), "{k}");
        }
    }

    #[test]
    fn a_poster_with_one_side_leaves_the_back_of_a_wall_alone() {
        let layers = Layers::of(&rug(true), 1e-9, |material| [Lit::Both, Lit::Front][material as usize]);
        let covers = |normal| layers.cover(0, &piece(0.5), normal, 1e-9);
        assert!(covers(DVec3::Z) && !covers(-DVec3::Z) && !layers.hide(0, &piece(0.5), 1e-9));
    }

    /// What counts is how much there is of a material in the plane, not how large its faces are.
    #[test]
    fn a_panel_lies_on_the_small_faces_of_its_own_object() {
        let mut mesh = rug(true);
        mesh.groups.truncate(1);
        mesh.cells[1].group = 0;
        mesh.cells.remove(0);
        let floor = |i: u32, j: u32| {
            let at = |i, j| DVec3::new(f64::from(i) / 8.0, f64::from(j) / 8.0, 0.0);
            [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]
        };
        for corners in (0..64).map(|k| floor(k / 8, k % 8)) {
            let first = mesh.vertices.len() as u32;
            let vertices = [first, first + 1, first + 2, first + 3];
            let surface = mesh.cells.len() as u32;
            mesh.vertices.extend(corners);
            mesh.cells.push(Cell { shape: Shape::Quad, vertices, material: 0, group: 0, surface });
        }
        let layers = Layers::of(&mesh, 1e-9, |_| Lit::Front);
        assert_eq!(layers.faces(), 16, "those under the panel");
        assert!(!layers.are_on(0));
    }
}

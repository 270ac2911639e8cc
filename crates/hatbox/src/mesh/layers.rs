//! Faces that lie on others and look the same way: a rug that is drawn into its floor, a poster, a face that is there twice.
//!
//! Both would send and receive light as if the other were not there, and together twice what there is. Of two layers one is
//! seen, and nobody says which; what lies on what is told by sizes. What belongs to the smaller part lies on what belongs to
//! the larger, within a part the smaller face on the larger, and of two alike the later on the earlier.
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
use std::collections::HashMap;

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
    /// For each face on which others lie these, and whether both of their sides are lit.
    on: HashMap<u32, Vec<(Patch, bool)>>,
}

impl Layers {
    /// What lies on what in a welded mesh whose [surfaces](super::Cell::surface) are its cells.
    pub(crate) fn of(mesh: &Mesh, tolerance: f64, lit: impl Fn(u32) -> Lit + Sync) -> Self {
        let faces = mesh.cells.len();
        let patches: Vec<Patch> = (0..faces).into_par_iter().map(|cell| mesh.patch(cell)).collect();
        let lit: Vec<Lit> = mesh.cells.iter().map(|cell| lit(cell.material)).collect();
        let ranks = ranks(mesh, &patches);
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
                    found.push(above);
                }
            });
            found.sort_unstable();
            let layers = found.into_iter().map(|above| (patches[above], lit[above] == Lit::Both));
            Some((face, layers.collect::<Vec<_>>())).filter(|(_, layers)| !layers.is_empty())
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
        let edges = |(patch, _): &(Patch, bool)| {
            let (corners, count) = (patch.corners().to_vec(), patch.corners().len());
            (0..count).map(move |k| [corners[k], corners[(k + 1) % count]])
        };
        let layers = self.on.get(&face).into_iter().flatten();
        layers.flat_map(edges).filter_map(|edge| clipped(cell, edge, tolerance)).collect()
    }

    /// Whether something lies on the side of a face to which `normal` points, at a point that is on no outline.
    pub(crate) fn cover(&self, face: u32, point: DVec3, normal: DVec3) -> bool {
        let covers = |(patch, both): &(Patch, bool)| (*both || patch.normal().dot(normal) > 0.0) && holds(patch, point);
        self.on.get(&face).is_some_and(|layers| layers.iter().any(covers))
    }
}

/// Who lies on whom if they share a plane: the greater. By the areas of parts and of faces, and by the order in the file.
fn ranks(mesh: &Mesh, patches: &[Patch]) -> Vec<(Reverse<u64>, Reverse<u64>, usize)> {
    let mut parts = vec![0.0; mesh.groups.len()];
    for (cell, patch) in mesh.cells.iter().zip(patches) {
        parts[cell.group as usize] += patch.area();
    }
    // The bits of positive numbers are in their order.
    let of = |(face, patch): (usize, &Patch)| {
        let part: f64 = parts[mesh.cells[face].group as usize];
        (Reverse(part.to_bits()), Reverse(patch.area().to_bits()), face)
    };
    patches.iter().enumerate().map(of).collect()
}

/// Whether a point in the plane of a convex polygon lies in it.
fn holds(patch: &Patch, point: DVec3) -> bool {
    let corners = patch.corners();
    (0..corners.len()).all(|k| {
        let (from, to) = (corners[k], corners[(k + 1) % corners.len()]);
        patch.normal().dot((to - from).cross(point - from)) >= 0.0
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

    #[test]
    fn the_smaller_part_lies_on_the_larger_if_sides_that_are_lit_share_a_plane() {
        for (up, lit, lies) in [
            (true, [Lit::Front, Lit::Front], true),
            (false, [Lit::Front, Lit::Front], false),
            (false, [Lit::Front, Lit::Both], true),
            (true, [Lit::Front, Lit::Neither], false),
        ] {
            let layers = Layers::of(&rug(up), 1e-9, |material| lit[material as usize]);
            let [inside, outside] = [0.5, 0.1].map(|x| DVec3::new(x, 0.5, 0.0));
            assert_eq!(layers.are_on(0), lies, "{up} {lit:?}");
            assert!(!layers.are_on(1));
            assert_eq!(layers.cover(0, inside, DVec3::Z), lies);
            assert!(!layers.cover(0, outside, DVec3::Z));
        }
    }

    #[test]
    fn a_poster_with_one_side_leaves_the_back_of_a_wall_alone() {
        let layers = Layers::of(&rug(true), 1e-9, |material| [Lit::Both, Lit::Front][material as usize]);
        let inside = DVec3::new(0.5, 0.5, 0.0);
        assert!(layers.cover(0, inside, DVec3::Z) && !layers.cover(0, inside, -DVec3::Z));
    }
}

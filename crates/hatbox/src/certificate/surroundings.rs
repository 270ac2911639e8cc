//! What may send light: cells by their planes, each plane with a tree over its cells.

use super::LANES;
use super::piece::Piece;
use crate::assemble::Panel;
use crate::element::{Polynomial, Shape};
use crate::mesh::Patch;
use crate::visibility::Occluders;
use arrayvec::ArrayVec;
use glam::DVec3;
use std::collections::HashMap;
use std::ops::Range;

/// Steps in which the components of normals are compared.
const SAME_WAY: f64 = 1e-6;
/// What is nearer to a plane than this part of the scene's diagonal lies in it, and what rounding of coordinates may hide.
const FLAT: f64 = 1e-9;
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// A cell that sends.
#[derive(Debug)]
pub(super) struct Leaf {
    pub(super) panel: usize,
    pub(super) piece: Piece,
    pub(super) functions: [Polynomial; LANES],
    /// The leaf of the same group beyond each edge, if there is one.
    pub(super) neighbours: ArrayVec<Option<usize>, 4>,
}

/// A rectangle around some leaves of a group, or a leaf.
#[derive(Debug)]
pub(super) struct Node {
    pub(super) patch: Patch,
    pub(super) leaves: Range<usize>,
    pub(super) children: Option<[usize; 2]>,
}

/// Cells in one plane that look the same way and are parts of one occluder.
#[derive(Debug)]
pub(super) struct Group {
    pub(super) occluder: u32,
    pub(super) normal: DVec3,
    pub(super) origin: DVec3,
    /// The first is the root.
    pub(super) nodes: Vec<Node>,
}

impl Group {
    pub(super) fn leaves(&self) -> Range<usize> {
        self.nodes[0].leaves.clone()
    }
}

/// All that sends.
#[derive(Debug)]
pub(super) struct Surroundings {
    /// In the order of their leaves.
    pub(super) groups: Vec<Group>,
    pub(super) leaves: Vec<Leaf>,
    /// What is nearer to a plane than this lies in it.
    pub(super) flat: f64,
}

impl Surroundings {
    /// Of panels with polynomials on them, in their planes' coordinates.
    pub(super) fn new(panels: &[Panel], functions: &[[Polynomial; LANES]], occluders: &Occluders) -> Self {
        let corners = || panels.iter().flat_map(|panel| panel.patch.corners()).copied();
        let (lo, hi) = corners().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), c| (lo.min(c), hi.max(c)));
        let greatest = lo.abs().max(hi.abs()).max_element();
        let flat = if greatest.is_finite() { FLAT * lo.distance(hi) + ROUNDING * greatest } else { 0.0 };
        let mut surroundings = Self { groups: Vec::new(), leaves: Vec::new(), flat };
        for (occluder, mut members) in by_plane(panels, occluders) {
            let first = &panels[members[0]];
            let outline = occluders.polygon(occluder);
            let along = (outline[1] - outline[0]).normalize_or(first.normal().any_orthonormal_vector());
            let start = surroundings.leaves.len();
            let mut tree = Tree { panels, axes: [along, first.normal().cross(along)], nodes: Vec::new() };
            tree.add(&mut members, start);
            surroundings.groups.push(Group {
                occluder,
                normal: first.normal(),
                origin: first.patch.corners()[0],
                nodes: tree.nodes,
            });
            surroundings.leaves.extend(leaves(panels, functions, &members, start));
        }
        surroundings
    }

    /// The group that a leaf belongs to.
    pub(super) fn group_of(&self, leaf: usize) -> &Group {
        &self.groups[self.groups.partition_point(|group| group.leaves().end <= leaf)]
    }
}

/// The panels that see anything, by occluder and normal, in the order of the first of each.
fn by_plane(panels: &[Panel], occluders: &Occluders) -> Vec<(u32, Vec<usize>)> {
    let mut places: HashMap<(u32, [i64; 3]), usize> = HashMap::new();
    let mut planes: Vec<(u32, Vec<usize>)> = Vec::new();
    let seeing = panels.iter().enumerate().filter(|(_, panel)| !panel.covered && panel.area() > 0.0);
    for (index, panel) in seeing {
        let way = panel.normal().to_array().map(|x| (x / SAME_WAY).round() as i64);
        let occluder = occluders.of_surface(panel.surface);
        let place = *places.entry((occluder, way)).or_insert_with(|| {
            planes.push((occluder, Vec::new()));
            planes.len() - 1
        });
        planes[place].1.push(index);
    }
    planes
}

/// The leaves of the panels of a plane, of which the first is number `start`.
fn leaves(panels: &[Panel], functions: &[[Polynomial; LANES]], members: &[usize], start: usize) -> Vec<Leaf> {
    let sides = |panel: &Panel| {
        let (n, vertices) = (panel.patch.corners().len(), panel.vertices);
        (0..n).map(move |k| [vertices[k], vertices[(k + 1) % n]])
    };
    // An edge that is there twice is no border between two leaves.
    let mut edges: HashMap<[u32; 2], Option<usize>> = HashMap::new();
    for (k, &member) in members.iter().enumerate() {
        for side in sides(&panels[member]) {
            edges.entry(side).and_modify(|leaf| *leaf = None).or_insert(Some(start + k));
        }
    }
    let leaf = |&member: &usize| {
        let panel = &panels[member];
        Leaf {
            panel: member,
            piece: Piece::new(panel.patch, panel.plane(), &functions[member]),
            functions: functions[member],
            neighbours: sides(panel).map(|[p, q]| edges.get(&[q, p]).copied().flatten()).collect(),
        }
    };
    members.iter().map(leaf).collect()
}

/// A tree that is being built.
struct Tree<'a> {
    panels: &'a [Panel],
    /// Two axes of the plane at right angles.
    axes: [DVec3; 2],
    nodes: Vec<Node>,
}

impl Tree<'_> {
    /// Adds a node of these panels, which are put into the tree's order; gives its place.
    fn add(&mut self, members: &mut [usize], start: usize) -> usize {
        let (patch, wide) = self.around(members);
        let place = self.nodes.len();
        self.nodes.push(Node { patch, leaves: start..start + members.len(), children: None });
        if members.len() > 1 {
            let along = |panel: &usize| self.axes[usize::from(!wide)].dot(self.panels[*panel].center);
            members.sort_by(|a, b| along(a).total_cmp(&along(b)).then(a.cmp(b)));
            let half = members.len() / 2;
            let (left, right) = members.split_at_mut(half);
            self.nodes[place].children = Some([self.add(left, start), self.add(right, start + half)]);
        }
        place
    }

    /// A rectangle around panels, or one alone, and whether it reaches farther along the first axis.
    fn around(&self, members: &[usize]) -> (Patch, bool) {
        if let [only] = members {
            return (self.panels[*only].patch, true);
        }
        let origin = self.panels[members[0]].patch.corners()[0];
        let corners = || members.iter().flat_map(|&member| self.panels[member].patch.corners());
        let reach = self.axes.map(|axis| super::range(corners().map(|&corner| axis.dot(corner - origin))));
        let at = |u: usize, v: usize| origin + self.axes[0] * reach[0][u] + self.axes[1] * reach[1][v];
        let [width, height] = reach.map(|[lo, hi]| hi - lo);
        (Patch::new(Shape::Quad, [at(0, 0), at(1, 0), at(1, 1), at(0, 1)]), width >= height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::ALL;

    #[test]
    fn an_edge_that_is_there_twice_is_no_border_between_leaves() {
        let square = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        let panel = |corners: [usize; 3]| {
            let [a, b, c] = corners;
            let patch = Patch::new(Shape::Triangle, [a, b, c, c].map(|k| square[k]));
            Panel::new(patch, ALL[0].triangle, [a, b, c, c].map(|k| k as u32), 0)
        };
        let panels = [[0, 1, 2], [0, 2, 3], [0, 2, 3]].map(panel);
        let across = |members: &[usize]| leaves(&panels, &[[[0.0; 6]; LANES]; 3], members, 7)[0].neighbours.clone();
        assert_eq!(across(&[0, 1])[..], [None, None, Some(8)]);
        assert_eq!(across(&[0, 1, 2])[..], [None; 3]);
    }
}

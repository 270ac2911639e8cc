//! Local refinement without hanging nodes: triangles halved at their longest edges.
//!
//! A marked triangle has all of its edges halved. So that its neighbours stay triangles whose edges meet end to end, a
//! triangle of which any edge is halved has its longest edge halved too, and so on until nothing is missing; then each is
//! bisected, first at the longest edge (M.-C. Rivara, "Algorithms for refining triangular grids suitable for adaptive and
//! multigrid techniques", Int. J. Numer. Meth. Eng. 20, 1984). Lengths grow along the way, so it ends; angles stay above
//! half of the smallest there was.
//!
//! Hanging nodes in C would spare the neighbours, whose number is small. In return nothing above the mesh knows of
//! refinement: joining, baking and exporting see an ordinary mesh, without cracks in a renderer; both sides of a sheet
//! and every face that meets at an edge are cut at the same points.

use super::corner::{Builder, Corner};
use super::{Mesh, Topology};
use crate::element::Shape;

/// A refined mesh and where it comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Bisected {
    /// The mesh: the vertices of the old one and new ones after them, the pieces of a cell in its place.
    pub mesh: Mesh,
    /// For each cell, that of the old mesh which it is a piece of.
    pub parents: Vec<u32>,
}

/// The vertex in the middle of an edge of the old mesh, if the edge is halved.
struct Halves {
    topology: Topology,
    middle: Vec<Option<u32>>,
}

impl Mesh {
    /// Halves all edges of the marked cells, and of their neighbours as few as it takes to leave no hanging node. The
    /// mesh must consist of triangles ([`triangulated`](Self::triangulated)); quads stay as they are.
    #[must_use]
    pub fn bisected(&self, marked: &[bool]) -> Bisected {
        let topology = Topology::new(self);
        let halved = self.edges_to_halve(&topology, marked);
        let mut builder = Builder::like(self);
        let middle = |edge: usize| {
            let [a, b] = topology.vertices(edge).map(|v| self.vertices[v as usize]);
            halved[edge].then(|| builder.vertex(a.midpoint(b)))
        };
        let middle = (0..topology.edges()).map(middle).collect();
        let halves = Halves { topology, middle };
        let mut parents = Vec::with_capacity(2 * self.cells.len());
        for (index, cell) in self.cells.iter().enumerate() {
            let corners = self.corners(index);
            if cell.shape == Shape::Quad {
                builder.push(cell, &corners);
                parents.push(index as u32);
                continue;
            }
            for piece in self.pieces(index, &corners, &halves) {
                builder.push(cell, &piece);
                parents.push(index as u32);
            }
        }
        Bisected { mesh: builder.finish(), parents }
    }

    /// The edges of marked cells, and the longest edge of every triangle that has an edge halved.
    fn edges_to_halve(&self, topology: &Topology, marked: &[bool]) -> Vec<bool> {
        let mut halved = vec![false; topology.edges()];
        let mut queue = Vec::new();
        let mut halve = |edge: usize, queue: &mut Vec<usize>| {
            if !std::mem::replace(&mut halved[edge], true) {
                queue.push(edge);
            }
        };
        let triangle = |cell: usize| self.cells[cell].shape == Shape::Triangle;
        for cell in (0..self.cells.len()).filter(|&cell| marked[cell] && triangle(cell)) {
            (0..3).for_each(|k| halve(topology.edge(cell, k), &mut queue));
        }
        while let Some(edge) = queue.pop() {
            for side in topology.sides(edge).iter().filter(|side| triangle(side.cell as usize)) {
                let cell = side.cell as usize;
                halve(topology.edge(cell, self.longest(topology, cell)), &mut queue);
            }
        }
        halved
    }

    /// The longest edge of a triangle; of equally long ones, that with the greatest index.
    fn longest(&self, topology: &Topology, cell: usize) -> usize {
        let key = |k: usize| {
            let edge = topology.edge(cell, k);
            let [a, b] = topology.vertices(edge).map(|v| self.vertices[v as usize]);
            (a.distance_squared(b), edge)
        };
        (0..3).max_by(|&i, &j| key(i).partial_cmp(&key(j)).unwrap_or(std::cmp::Ordering::Equal)).unwrap_or(0)
    }

    /// The one to four triangles that a triangle becomes.
    fn pieces(&self, cell: usize, corners: &[Corner; 4], halves: &Halves) -> Vec<[Corner; 3]> {
        let middle = |k: usize| {
            let (a, b) = (&corners[k % 3], &corners[(k + 1) % 3]);
            let vertex = halves.middle[halves.topology.edge(cell, k % 3)]?;
            Some(a.between(b, 0.5, vertex, a.position.midpoint(b.position)))
        };
        let k = self.longest(&halves.topology, cell);
        let [a, b, c] = [k, k + 1, k + 2].map(|i| corners[i % 3]);
        let Some(foot) = middle(k) else { return vec![[a, b, c]] };
        let mut pieces = Vec::with_capacity(4);
        match middle(k + 2) {
            Some(m) => pieces.extend([[a, foot, m], [m, foot, c]]),
            None => pieces.push([a, foot, c]),
        }
        match middle(k + 1) {
            Some(m) => pieces.extend([[foot, b, m], [foot, m, c]]),
            None => pieces.push([foot, b, c]),
        }
        pieces
    }
}

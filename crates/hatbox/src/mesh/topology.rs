//! Which cells meet at which edges.
//!
//! An edge is a pair of vertices, so a mesh must be welded before its topology means anything. Any number of cells may
//! meet at an edge (a wall ends on a floor; a sheet has two sides): nothing here assumes a manifold.

use super::Mesh;

/// A cell at one of its edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Side {
    /// Index of the cell.
    pub cell: u32,
    /// Which of its edges: from corner `edge` to the next.
    pub edge: u8,
    /// Whether the cell runs through it from the vertex of lower index to the higher.
    pub forward: bool,
}

/// The edges of a mesh and the cells at each, both in a fixed order: edges by their vertices, cells by their index.
#[derive(Debug, Clone, PartialEq)]
pub struct Topology {
    vertices: Vec<[u32; 2]>,
    offsets: Vec<u32>,
    sides: Vec<Side>,
    cell_edges: Vec<[u32; 4]>,
}

impl Topology {
    /// The topology of a mesh. An edge with both ends at one vertex is listed like any other.
    pub fn new(mesh: &Mesh) -> Self {
        let mut uses = Vec::with_capacity(4 * mesh.cells.len());
        for (index, cell) in mesh.cells.iter().enumerate() {
            let corners = cell.corners();
            for (edge, &from) in corners.iter().enumerate() {
                let to = corners[(edge + 1) % corners.len()];
                let side = Side { cell: index as u32, edge: edge as u8, forward: from < to };
                uses.push(([from.min(to), from.max(to)], side));
            }
        }
        uses.sort_unstable_by_key(|(vertices, side)| (*vertices, side.cell, side.edge));
        let mut topology = Self {
            vertices: Vec::new(),
            offsets: Vec::new(),
            sides: Vec::with_capacity(uses.len()),
            cell_edges: vec![[u32::MAX; 4]; mesh.cells.len()],
        };
        for (vertices, side) in uses {
            if topology.vertices.last() != Some(&vertices) {
                topology.vertices.push(vertices);
                topology.offsets.push(topology.sides.len() as u32);
            }
            let edge = topology.vertices.len() - 1;
            topology.cell_edges[side.cell as usize][usize::from(side.edge)] = edge as u32;
            topology.sides.push(side);
        }
        topology.offsets.push(topology.sides.len() as u32);
        topology
    }

    /// Number of edges.
    pub fn edges(&self) -> usize {
        self.vertices.len()
    }

    /// The ends of an edge, the lower index first.
    pub fn vertices(&self, edge: usize) -> [u32; 2] {
        self.vertices[edge]
    }

    /// The cells at an edge.
    pub fn sides(&self, edge: usize) -> &[Side] {
        &self.sides[self.offsets[edge] as usize..self.offsets[edge + 1] as usize]
    }

    /// The edge from corner `k` of a cell to the next.
    ///
    /// # Panics
    /// If the cell has no such corner.
    pub fn edge(&self, cell: usize, k: usize) -> usize {
        let edge = self.cell_edges[cell][k];
        assert_ne!(edge, u32::MAX, "cell {cell} has no edge {k}");
        edge as usize
    }

    /// Edges where a surface ends: only one cell is there. A two-sided sheet is closed by its own back.
    pub fn open_edges(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.edges()).filter(|&edge| self.sides(edge).len() == 1)
    }
}

impl Mesh {
    /// The angle between the normals of two cells, in radians: 0 where a surface goes on flat, π between the two sides
    /// of a sheet. The dihedral angle on the lit side of cells that meet at an edge is π minus this if they fold
    /// towards each other, π plus this otherwise.
    pub fn normal_angle(&self, a: usize, b: usize) -> f64 {
        let (m, n) = (self.patch(a).normal(), self.patch(b).normal());
        m.cross(n).length().atan2(m.dot(n))
    }

    /// The dihedral angle between two cells that meet at an edge, measured in front of their lit sides, in radians:
    /// π if they are coplanar, π/2 in the corner of a room, 3π/2 at the edge of a box seen from outside.
    pub fn dihedral_angle(&self, a: usize, b: usize) -> f64 {
        let bend = self.normal_angle(a, b);
        let (a, b) = (self.patch(a), self.patch(b));
        let folds_towards = a.normal().dot(b.center() - a.center()) > 0.0;
        std::f64::consts::PI + if folds_towards { -bend } else { bend }
    }
}

/// Sets that grow together. Each is named by its least member, so the result does not depend on the order of joining.
#[derive(Debug)]
pub(crate) struct UnionFind(Vec<u32>);

impl UnionFind {
    /// `n` sets of one member.
    pub(crate) fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    /// The least member of the set of `i`.
    pub(crate) fn find(&mut self, i: usize) -> usize {
        let mut i = i as u32;
        while self.0[i as usize] != i {
            let parent = self.0[i as usize];
            self.0[i as usize] = self.0[parent as usize];
            i = parent;
        }
        i as usize
    }

    /// Makes the sets of `a` and `b` one.
    pub(crate) fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }
}

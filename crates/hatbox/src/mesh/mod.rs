//! Surfaces as planar cells: triangles and quads over welded vertices.
//!
//! A [`Mesh`] is geometry and nothing else; what a cell is made of is a number that [`crate::scene`] understands. Its
//! cells are always planar (a warped quad is split where it is read) and one-sided: the corners run counter-clockwise
//! when seen from the side that sends and receives light. A two-sided sheet is two cells with the same
//! [`surface`](Cell::surface).

mod bisect;
mod box_tree;
mod conform;
mod contact;
mod corner;
mod diagnose;
mod grade;
mod intersect;
mod layers;
mod patch;
pub(crate) mod polygon;
mod refine;
mod topology;
mod weld;

pub use bisect::Bisected;
pub use contact::Line;
pub(crate) use contact::Split;
pub(crate) use corner::{Builder, Corner};
pub use diagnose::{Example, Finding, FindingKind, Severity, diagnose, diagnose_room, diagnose_sheets};
pub(crate) use layers::{Layers, Lit};
pub use patch::Patch;
pub use refine::{MAX_CELLS, RefineError, Refinement};
pub(crate) use topology::UnionFind;
pub use topology::{Side, Topology};
pub use weld::RELATIVE_TOLERANCE;

use crate::element::Shape;
use glam::{DVec2, DVec3};

/// One planar triangle or quad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// Triangle or quad.
    pub shape: Shape,
    /// Indices of the corners; a triangle repeats its last.
    pub vertices: [u32; 4],
    /// Index of the material.
    pub material: u32,
    /// Index into [`Mesh::groups`].
    pub group: u32,
    /// The face of the input that this cell is a part of. Cells of one face lie in one plane, do not see each other and
    /// do not cast shadows on each other; the two sides of a sheet share it.
    pub surface: u32,
}

impl Cell {
    /// The corners' indices.
    pub fn corners(&self) -> &[u32] {
        &self.vertices[..self.shape.corners()]
    }
}

/// Planar cells over shared vertices, with what the file said about their corners.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Positions in metres.
    pub vertices: Vec<DVec3>,
    /// The cells.
    pub cells: Vec<Cell>,
    /// Names of the parts (objects, nodes).
    pub groups: Vec<String>,
    /// Texture coordinates of each cell's corners; empty if the mesh has none.
    pub uvs: Vec<[DVec2; 4]>,
    /// Normals of each cell's corners as the file gave them (creases are split normals); empty if it gave none.
    pub normals: Vec<[DVec3; 4]>,
}

impl Mesh {
    /// The geometry of one cell.
    pub fn patch(&self, cell: usize) -> Patch {
        let Cell { shape, vertices, .. } = self.cells[cell];
        Patch::new(shape, vertices.map(|v| self.vertices[v as usize]))
    }

    /// The texture coordinates at a point of a cell; zero if the mesh has none.
    pub fn uv(&self, cell: usize, at: [f64; 2]) -> DVec2 {
        let Some(corners) = self.uvs.get(cell) else { return DVec2::ZERO };
        let weights = self.cells[cell].shape.corner_weights(at);
        corners.iter().zip(weights).map(|(&uv, w)| uv * w).sum()
    }

    /// Sum of the cells' areas; a two-sided sheet counts twice.
    pub fn area(&self) -> f64 {
        (0..self.cells.len()).map(|cell| self.patch(cell).area()).sum()
    }

    /// The smallest box around the vertices, as (least, greatest) corner.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        self.vertices.iter().fold(empty, |(lo, hi), &v| (lo.min(v), hi.max(v)))
    }
}

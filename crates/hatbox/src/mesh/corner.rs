//! Cells taken apart into corners and put together again.
//!
//! Everything that changes a mesh (welding, splitting, refining) makes new cells out of old ones. A [`Corner`] carries
//! all that is known at one corner, so that none of those steps can forget the texture coordinates or the normals.

use super::{Cell, Mesh};
use crate::element::Shape;
use glam::{DVec2, DVec3};

/// One corner of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corner {
    /// Index of the vertex.
    pub(crate) vertex: u32,
    /// Where the vertex is.
    pub(crate) position: DVec3,
    /// Texture coordinates; zero if the mesh has none.
    pub(crate) uv: DVec2,
    /// The file's normal; zero if the mesh has none.
    pub(crate) normal: DVec3,
}

impl Corner {
    /// The corner at a vertex on the edge from `self` to `other`, a fraction t along it.
    pub(crate) fn between(&self, other: &Self, t: f64, vertex: u32, position: DVec3) -> Self {
        let normal = (self.normal * (1.0 - t) + other.normal * t).normalize_or_zero();
        Self { vertex, position, uv: self.uv * (1.0 - t) + other.uv * t, normal }
    }
}

/// A mesh under construction out of the cells of another.
#[derive(Debug)]
pub(crate) struct Builder {
    mesh: Mesh,
    has_uvs: bool,
    has_normals: bool,
}

impl Builder {
    /// The vertices and groups of `mesh`, and no cells yet.
    pub(crate) fn like(mesh: &Mesh) -> Self {
        let empty = Mesh { vertices: mesh.vertices.clone(), groups: mesh.groups.clone(), ..Mesh::default() };
        Self { mesh: empty, has_uvs: !mesh.uvs.is_empty(), has_normals: !mesh.normals.is_empty() }
    }

    /// Adds a vertex and gives its index.
    pub(crate) fn vertex(&mut self, position: DVec3) -> u32 {
        self.mesh.vertices.push(position);
        (self.mesh.vertices.len() - 1) as u32
    }

    /// Adds a cell with these three or four corners; material, group and surface are those of `like`.
    pub(crate) fn push(&mut self, like: &Cell, corners: &[Corner]) {
        let shape = if corners.len() == 3 { Shape::Triangle } else { Shape::Quad };
        let four = [0, 1, 2, 3].map(|k| corners[k.min(corners.len() - 1)]);
        self.mesh.cells.push(Cell { shape, vertices: four.map(|c| c.vertex), ..*like });
        if self.has_uvs {
            self.mesh.uvs.push(four.map(|c| c.uv));
        }
        if self.has_normals {
            self.mesh.normals.push(four.map(|c| c.normal));
        }
    }

    /// The mesh.
    pub(crate) fn finish(self) -> Mesh {
        self.mesh
    }
}

impl Mesh {
    /// The corners of a cell; a triangle repeats its last.
    pub(crate) fn corners(&self, cell: usize) -> [Corner; 4] {
        let vertices = self.cells[cell].vertices;
        std::array::from_fn(|k| Corner {
            vertex: vertices[k],
            position: self.vertices[vertices[k] as usize],
            uv: self.uvs.get(cell).map_or(DVec2::ZERO, |uvs| uvs[k]),
            normal: self.normals.get(cell).map_or(DVec3::ZERO, |normals| normals[k]),
        })
    }

    /// The corner of a part of a cell at a vertex within the cell.
    pub(crate) fn corner_within(&self, cell: usize, vertex: u32, position: DVec3) -> Corner {
        let weights = self.cells[cell].shape.corner_weights(self.patch(cell).locate(position));
        let corners = self.corners(cell);
        let weighted = || corners.iter().zip(weights);
        let normal = weighted().map(|(corner, w)| corner.normal * w).sum::<DVec3>().normalize_or_zero();
        Corner { vertex, position, uv: weighted().map(|(corner, w)| corner.uv * w).sum(), normal }
    }

    /// Every quad split into two triangles along its diagonal 0–2; the two follow each other in the quad's place.
    #[must_use]
    pub fn triangulated(&self) -> Self {
        let mut builder = Builder::like(self);
        for (index, cell) in self.cells.iter().enumerate() {
            let [a, b, c, d] = self.corners(index);
            builder.push(cell, &[a, b, c]);
            if cell.shape == Shape::Quad {
                builder.push(cell, &[a, c, d]);
            }
        }
        builder.finish()
    }
}

use super::ReadError;
use super::polygon::{Piece, crosses_itself, pieces};
use crate::element::Shape;
use crate::mesh::{Cell, Mesh, Patch};
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};
use std::collections::HashMap;
use std::path::Path;

/// A triangle or quad of the input; triangles repeat their last corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    pub(super) shape: Shape,
    pub(super) vertices: [u32; 4],
    pub(super) uvs: Option<[DVec2; 4]>,
    pub(super) normals: Option<[DVec3; 4]>,
    pub(super) material: u32,
    pub(super) group: u32,
}

/// Collects faces into a mesh in which either all cells have texture coordinates (normals), or none has.
#[derive(Debug, Default)]
pub(super) struct MeshBuilder {
    mesh: Mesh,
    groups: HashMap<String, u32>,
    has_uvs: bool,
    has_normals: bool,
    flat: usize,
    /// How many faces cross themselves, and where the first is.
    crossing: Option<(usize, String)>,
}

/// Faces whose area is less than this times the square of their longest edge have none but rounding's.
const NO_AREA: f64 = 1e-12;

impl MeshBuilder {
    /// Adds a position in metres and returns its index.
    pub(super) fn vertex(&mut self, position: DVec3) -> u32 {
        self.mesh.vertices.push(position);
        self.mesh.vertices.len() as u32 - 1
    }

    /// The group of that name.
    pub(super) fn group(&mut self, name: &str) -> u32 {
        if let Some(&index) = self.groups.get(name) {
            return index;
        }
        let index = self.mesh.groups.len() as u32;
        self.mesh.groups.push(name.to_owned());
        self.groups.insert(name.to_owned(), index);
        index
    }

    /// The cells that a polygon is cut into, as places of corners. One that crosses itself is remembered by its `place` in the file.
    pub(super) fn cut(&mut self, corners: &[DVec3], place: impl FnOnce() -> String) -> Vec<(Shape, [usize; 4])> {
        if crosses_itself(corners) {
            self.crossing.get_or_insert_with(|| (0, place())).0 += 1;
        }
        let cell = |piece| match piece {
            Piece::Triangle([a, b, c]) => (Shape::Triangle, [a, b, c, c]),
            Piece::Quad(quad) => (Shape::Quad, quad),
        };
        pieces(corners).into_iter().map(cell).collect()
    }

    /// Adds a face, unless it has no area.
    pub(super) fn face(&mut self, face: Face) {
        let patch = Patch::new(face.shape, face.vertices.map(|v| self.mesh.vertices[v as usize]));
        let longest = patch.longest_edge();
        if patch.area() <= NO_AREA * longest * longest {
            self.flat += 1;
            return;
        }
        let Face { shape, vertices, material, group, .. } = face;
        self.mesh.cells.push(Cell { shape, vertices, material, group, surface: 0 });
        self.mesh.uvs.push(face.uvs.unwrap_or_default());
        self.mesh.normals.push(face.normals.unwrap_or_default());
        self.has_uvs |= face.uvs.is_some();
        self.has_normals |= face.normals.is_some();
    }

    /// The mesh; `warnings` learns of faces without area, and of those that cross themselves.
    pub(super) fn finish(mut self, file: &Path, warnings: &mut Vec<String>) -> Result<Mesh, ReadError> {
        if self.mesh.cells.is_empty() {
            let reason = match self.flat {
                0 => "the scene is empty: it has no faces".to_owned(),
                flat => format!("the scene is empty: none of its {flat} faces has an area"),
            };
            return Err(ReadError::new(file, "", reason, "export at least one triangle or quad"));
        }
        if self.flat > 0 {
            warnings.push(format!("{}: {} faces have no area and were left out", file.display(), self.flat));
        }
        if let Some((count, place)) = &self.crossing {
            let they = if *count == 1 { "1 face crosses itself" } else { &*format!("{count} faces cross themselves") };
            warnings.push(format!(
                "{}, {place}: {they}, like a bow tie, and no triangles are what it is meant to be; give its corners in the order \
                 in which they lie around it",
                file.display()
            ));
        }
        if self.mesh.vertices.len() > u32::MAX as usize {
            return Err(ReadError::new(file, "", "it has more than 2^32 vertices", "split the scene"));
        }
        if !self.has_uvs {
            self.mesh.uvs.clear();
        }
        if !self.has_normals {
            self.mesh.normals.clear();
        }
        Ok(self.mesh)
    }
}

/// The matrix that keeps normals upright: the inverse transpose up to a positive factor, which is the cofactor matrix,
/// so that a flattening transform does no harm. Mirrored, it turns normals around as the swapped corners do.
pub(super) fn normal_matrix(transform: &DMat4) -> DMat3 {
    let [a, b, c] = [transform.x_axis, transform.y_axis, transform.z_axis].map(DVec4::truncate);
    let sign = if transform.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b)) * sign
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_stay_upright_under_a_mirroring_shear() {
        let matrix = DMat4::from_scale(DVec3::new(-2.0, 1.0, 0.5)) * DMat4::from_rotation_x(0.7);
        let (u, v) = (DVec3::new(1.0, 0.2, 0.0), DVec3::new(-0.3, 1.0, 2.0));
        let moved = normal_matrix(&matrix) * u.cross(v);
        // The mirrored triangle has its corners swapped: v before u.
        let expected = matrix.transform_vector3(v).cross(matrix.transform_vector3(u));
        assert!((moved.normalize() - expected.normalize()).length() < 1e-12);
    }
}

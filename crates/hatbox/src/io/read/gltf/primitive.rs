//! Triangles of a primitive, moved to where its node is.

use super::Reader;
use super::material::UvSource;
use crate::element::Shape;
use crate::io::read::ReadError;
use crate::io::read::builder::{Face, normal_matrix};
use glam::{DMat4, DVec2, DVec3};
use gltf_json::mesh::{Mode, Primitive, Semantic};
use gltf_json::validation::Checked;
use gltf_json::{Accessor, Index};

const REMEDY: &str = "export the file again";

/// The attributes of a primitive's vertices, moved; normals and texture coordinates are empty if it has none.
struct Vertices {
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
    uvs: Vec<DVec2>,
}

impl Vertices {
    /// A triangle of these vertices, of which `indices` are those in the mesh.
    fn face(&self, [a, b, c]: [usize; 3], [i, j, k]: [u32; 3], material: u32, group: u32) -> Face {
        let corners = [a, b, c, c];
        Face {
            shape: Shape::Triangle,
            vertices: [i, j, k, k],
            uvs: (!self.uvs.is_empty()).then(|| corners.map(|corner| self.uvs[corner])),
            normals: (!self.normals.is_empty()).then(|| corners.map(|corner| self.normals[corner])),
            material,
            group,
        }
    }
}

impl Reader<'_> {
    /// Adds the triangles of a primitive.
    pub(super) fn primitive(
        &mut self,
        primitive: &Primitive,
        transform: &DMat4,
        group: u32,
        place: &str,
    ) -> Result<(), ReadError> {
        let Checked::Valid(mode) = primitive.mode else {
            return Err(self.document.error(place, "its mode is unknown", REMEDY));
        };
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            self.warnings.push(self.document.warning(place, "its points or lines are ignored"));
            return Ok(());
        }
        self.warn_of_ignored_attributes(primitive, place);
        let material = self.palette.material(primitive.material, place)?;
        let vertices = self.vertices(primitive, transform, self.palette.uv_source(material), place)?;
        let corners = self.corners(primitive, vertices.positions.len(), place)?;
        let mirrored = transform.determinant() < 0.0;
        // Vertices are added when a triangle uses them: primitives often share one long array.
        let mut added = vec![None; vertices.positions.len()];
        for [a, b, c] in triangles(mode, &corners) {
            let triangle = if mirrored { [a, c, b] } else { [a, b, c] };
            for corner in triangle {
                let position = vertices.positions[corner];
                if !position.is_finite() {
                    let reason = format!("the position of vertex {corner} is not finite: {position}");
                    return Err(self.document.error(place, reason, "repair the mesh (or its node's transform)"));
                }
                added[corner].get_or_insert_with(|| self.builder.vertex(position));
            }
            let indices = triangle.map(|corner| added[corner].unwrap_or_default());
            self.builder.face(vertices.face(triangle, indices, material, group));
        }
        Ok(())
    }

    fn warn_of_ignored_attributes(&mut self, primitive: &Primitive, place: &str) {
        if primitive.attributes.keys().any(|key| matches!(key, Checked::Valid(Semantic::Colors(_)))) {
            self.warnings.push(self.document.warning(place, "its vertex colours are ignored"));
        }
        if primitive.targets.as_ref().is_some_and(|targets| !targets.is_empty()) {
            self.warnings.push(self.document.warning(place, "its morph targets are ignored"));
        }
    }

    fn vertices(
        &self,
        primitive: &Primitive,
        transform: &DMat4,
        uv_source: UvSource,
        place: &str,
    ) -> Result<Vertices, ReadError> {
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let Some(positions) = attribute(Semantic::Positions) else {
            return Err(self.document.error(place, "it has no POSITION attribute", REMEDY));
        };
        let positions = self.document.read::<3>(positions, &format!("{place}, POSITION"))?;
        let count = positions.len();
        let normals = self.optional::<3>(attribute(Semantic::Normals), count, &format!("{place}, NORMAL"))?;
        let uv_place = format!("{place}, TEXCOORD_{}", uv_source.set);
        let uvs = self.optional::<2>(attribute(Semantic::TexCoords(uv_source.set)), count, &uv_place)?;
        let to_normal = normal_matrix(transform);
        let normal = |n| (to_normal * DVec3::from_array(n)).try_normalize().unwrap_or_default();
        Ok(Vertices {
            positions: positions.into_iter().map(|p| transform.transform_point3(DVec3::from_array(p))).collect(),
            normals: normals.into_iter().map(normal).collect(),
            uvs: uvs.into_iter().map(|uv| uv_source.apply(DVec2::from_array(uv))).collect(),
        })
    }

    /// An attribute that may be missing, but else has a value per vertex.
    fn optional<const N: usize>(
        &self,
        index: Option<Index<Accessor>>,
        count: usize,
        place: &str,
    ) -> Result<Vec<[f64; N]>, ReadError> {
        let values = index.map_or(Ok(Vec::new()), |index| self.document.read::<N>(index, place))?;
        if index.is_some() && values.len() != count {
            let reason = format!("it has {} values for {count} vertices", values.len());
            return Err(self.document.error(place, reason, REMEDY));
        }
        Ok(values)
    }

    /// The vertices of the primitive in order, each known to be there.
    fn corners(&self, primitive: &Primitive, count: usize, place: &str) -> Result<Vec<usize>, ReadError> {
        let Some(indices) = primitive.indices else { return Ok((0..count).collect()) };
        let corners = self.document.read::<1>(indices, &format!("{place}, indices"))?;
        let corners: Vec<usize> = corners.into_iter().map(|[index]| index as usize).collect();
        if let Some((k, corner)) = corners.iter().enumerate().find(|&(_, &corner)| corner >= count) {
            let reason = format!("index {k} is {corner}, but there are only {count} vertices");
            return Err(self.document.error(&format!("{place}, indices"), reason, "repair the mesh"));
        }
        Ok(corners)
    }
}

/// The triangles of a list, strip or fan (glTF 2.0, § 3.7.2.1).
fn triangles(mode: Mode, corners: &[usize]) -> Vec<[usize; 3]> {
    match mode {
        Mode::TriangleStrip => {
            let turned = |(k, t): (usize, &[usize])| [t[0], t[1 + k % 2], t[2 - k % 2]];
            corners.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => match corners {
            [center, rim @ ..] => rim.windows(2).map(|edge| [edge[0], edge[1], *center]).collect(),
            [] => Vec::new(),
        },
        _ => corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_orientation() {
        let corners = [0, 1, 2, 3, 4];
        assert_eq!(triangles(Mode::TriangleStrip, &corners), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(triangles(Mode::TriangleFan, &corners), [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
        assert_eq!(triangles(Mode::Triangles, &corners), [[0, 1, 2]]);
        assert!(triangles(Mode::TriangleStrip, &corners[..2]).is_empty());
    }
}

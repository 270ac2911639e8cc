//! PLY, ASCII and binary: vertices and polygons. It knows no materials: everything is gray, until a scene file says
//! otherwise.

use super::builder::{Face, MeshBuilder};
use super::{RawScene, ReadError, files};
use glam::DVec3;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use std::path::Path;

/// Any element of the file: a vertex uses the position, a face the corners.
#[derive(Default)]
struct Record {
    position: DVec3,
    /// `None` if an index is negative.
    corners: Option<Vec<u32>>,
}

impl PropertyAccess for Record {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let number = || match property {
            Property::Double(value) => Some(value),
            ref other => other.to_f32_lossy().map(f64::from),
        };
        match name {
            "x" => self.position.x = number().unwrap_or(f64::NAN),
            "y" => self.position.y = number().unwrap_or(f64::NAN),
            "z" => self.position.z = number().unwrap_or(f64::NAN),
            "vertex_indices" | "vertex_index" => self.corners = property.to_u32_list(),
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// Reads a `.ply`.
pub(super) fn read(file: &Path) -> Result<RawScene, ReadError> {
    let bytes = files::read(file)?;
    let ply = Parser::<Record>::new().read_ply(&mut bytes.as_slice()).map_err(|error| {
        // What was found and where; the parser's own state comes after it.
        let text = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        let text = text.split(" Error: ").next().unwrap_or_default();
        ReadError::new(file, "", format!("it is no PLY, or cut off ({text})"), "export the file again")
    })?;
    let records = |element| ply.payload.get(element).map_or(&[][..], Vec::as_slice);
    let (vertices, faces) = (records("vertex"), records("face"));
    let mut builder = MeshBuilder::default();
    for vertex in vertices {
        builder.vertex(vertex.position);
    }
    let stem = file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let group = builder.group(&stem);
    for (k, face) in faces.iter().enumerate() {
        let corners = corners(file, k, face, vertices)?;
        let points: Vec<DVec3> = corners.iter().map(|&corner| vertices[corner as usize].position).collect();
        for (shape, picked) in builder.cut(&points, || format!("face {k}")) {
            let vertices = picked.map(|k| corners[k]);
            builder.face(Face { shape, vertices, uvs: None, normals: None, material: 0, group });
        }
    }
    RawScene::without_materials(file, builder)
}

/// The corners of a face, each with a finite position.
fn corners<'a>(file: &Path, k: usize, face: &'a Record, vertices: &[Record]) -> Result<&'a [u32], ReadError> {
    let error = |reason: String| Err(ReadError::new(file, format!("face {k}"), reason, "repair the mesh"));
    let Some(corners) = &face.corners else {
        return error("it has no list of vertex indices, or one of them is negative".to_owned());
    };
    for &corner in corners {
        match vertices.get(corner as usize) {
            None => return error(format!("it names vertex {corner}, but there are {}", vertices.len())),
            Some(Record { position, .. }) if !position.is_finite() => {
                return error(format!("the position of vertex {corner} is not finite: {position}"));
            }
            Some(_) => {}
        }
    }
    Ok(corners)
}

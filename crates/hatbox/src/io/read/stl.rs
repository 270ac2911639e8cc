//! STL, ASCII and binary: triangles and nothing else. Everything is gray, until a scene file says otherwise. Its normals
//! are not read: they are those of the triangles, and often left zero.

use super::builder::{Face, MeshBuilder};
use super::{RawScene, ReadError, files};
use crate::element::Shape;
use glam::DVec3;
use std::io::Cursor;
use std::path::Path;

/// Bytes before the triangles of a binary file, and of each triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// Reads an `.stl`.
pub(super) fn read(file: &Path) -> Result<RawScene, ReadError> {
    let mut bytes = files::read(file)?;
    // Some programs begin binary files with the word that marks ASCII ones.
    if is_binary(&bytes) {
        bytes[..80].fill(0);
    }
    let broken = |place: String, error: &std::io::Error| {
        ReadError::new(file, place, format!("it is no STL, or cut off ({error})"), "export the file again")
    };
    let mut cursor = Cursor::new(bytes);
    let triangles = stl_io::create_stl_reader(&mut cursor).map_err(|error| broken(String::new(), &error))?;
    let mut builder = MeshBuilder::default();
    let stem = file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let group = builder.group(&stem);
    for (k, triangle) in triangles.enumerate() {
        let triangle = triangle.map_err(|error| broken(format!("triangle {k}"), &error))?;
        let corners = triangle.vertices.map(|corner| DVec3::from_array(corner.0.map(f64::from)));
        if let Some(corner) = corners.iter().find(|corner| !corner.is_finite()) {
            let reason = format!("a corner is not finite: {corner}");
            return Err(ReadError::new(file, format!("triangle {k}"), reason, "repair the mesh"));
        }
        let [a, b, c] = corners.map(|corner| builder.vertex(corner));
        builder.face(Face {
            shape: Shape::Triangle,
            vertices: [a, b, c, c],
            uvs: None,
            normals: None,
            material: 0,
            group,
        });
    }
    RawScene::without_materials(file, builder)
}

/// Whether the file is as long as the count of a binary one says.
fn is_binary(bytes: &[u8]) -> bool {
    let count = bytes.get(80..HEADER).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    count.is_some_and(|count| bytes.len() == HEADER + TRIANGLE * count as usize)
}

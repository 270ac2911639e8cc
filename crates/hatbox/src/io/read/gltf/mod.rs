//! glTF 2.0, as `.gltf` and `.glb`: geometry, diffuse colour, emission and the camera of its default scene.
//!
//! | glTF | here |
//! |---|---|
//! | baseColorFactor × texture × (1 − metallic) | R, linear |
//! | π × emissiveFactor × texture × emissiveStrength | B⁰ (glTF's emission is a radiance) |
//! | doubleSided | two-sided |
//! | nodes with a mesh | groups, by name |
//! | triangles, strips, fans; sparse, normalized and quantized attributes | cells |
//! | first perspective camera | camera |
//!
//! A node that mirrors its mesh turns the triangles around, so that their fronts stay outside. Vertex colours are *not*
//! read: a file that this program wrote carries there a picture of its solution.
//!
//! Only the JSON structures of `gltf-json` are used, and every index in them is looked up with a check: the file decides
//! about nothing that could end in a panic.

mod accessor;
mod container;
mod material;
mod primitive;

use super::builder::MeshBuilder;
use super::{RawScene, ReadError, files};
use crate::scene::{Camera, Physics};
use glam::{DMat4, DQuat, DVec3, Vec3};
use gltf_json::{Index, Node, Root, root::Get};
use std::collections::HashSet;
use std::fmt::Debug;
use std::path::Path;

/// Reads a `.gltf` or `.glb`.
pub(super) fn read(file: &Path) -> Result<RawScene, ReadError> {
    let bytes = files::read(file)?;
    let (json, binary) = container::split(file, &bytes)?;
    let root = container::parse(file, json)?;
    let buffers = container::buffers(file, &root, binary)?;
    let document = Document { file, root, buffers };
    let mut reader = Reader {
        document: &document,
        builder: MeshBuilder::default(),
        palette: material::Palette::new(&document),
        camera: None,
        warnings: document.ignored_extensions(),
    };
    reader.scene()?;
    let Reader { builder, palette, camera, mut warnings, .. } = reader;
    let mesh = builder.finish(file, &mut warnings)?;
    let materials = palette.finish(&mut warnings);
    let warnings = files::without_repeats(warnings);
    Ok(RawScene { mesh, materials, physics: Physics::Light, camera, warnings, guessed: Vec::new() })
}

/// A parsed file with its bytes.
struct Document<'a> {
    file: &'a Path,
    root: Root,
    buffers: Vec<Vec<u8>>,
}

impl Document<'_> {
    fn error(&self, place: &str, reason: impl Into<String>, remedy: &str) -> ReadError {
        ReadError::new(self.file, place, reason, remedy)
    }

    fn warning(&self, place: &str, text: &str) -> String {
        format!("{}: {place}: {text}", self.file.display())
    }

    /// What an index of the file stands for.
    fn get<T: Debug>(&self, index: Index<T>, place: &str) -> Result<&T, ReadError>
    where
        Root: Get<T>,
    {
        self.root.get(index).ok_or_else(|| {
            let reason = format!("it refers to {index:?}, which the file does not have");
            self.error(place, reason, "export the file again")
        })
    }

    fn ignored_extensions(&self) -> Vec<String> {
        let ignored = self.root.extensions_used.iter().filter(|name| !container::EXTENSIONS.contains(&name.as_str()));
        ignored
            .map(|name| self.warning("extensionsUsed", &format!("{name} is not supported and was ignored")))
            .collect()
    }
}

/// What has been read so far.
struct Reader<'a> {
    document: &'a Document<'a>,
    builder: MeshBuilder,
    palette: material::Palette<'a>,
    camera: Option<Camera>,
    warnings: Vec<String>,
}

impl Reader<'_> {
    /// Walks the default scene's nodes, parents before children.
    fn scene(&mut self) -> Result<(), ReadError> {
        let document = self.document;
        let scene = document.get(document.root.scene.unwrap_or(Index::new(0)), "scene")?;
        let mut todo: Vec<_> = scene.nodes.iter().rev().map(|&node| (node, DMat4::IDENTITY)).collect();
        let mut seen = HashSet::new();
        while let Some((index, above)) = todo.pop() {
            let place = format!("node {}", index.value());
            if !seen.insert(index.value()) {
                let reason = "the node has two parents, or is its own ancestor";
                return Err(document.error(&place, reason, "export the file again"));
            }
            let node = document.get(index, &place)?;
            let place = node.name.as_ref().map_or(place, |name| format!("node `{name}`"));
            let transform = above * local_transform(node);
            self.node(index, node, &transform, &place)?;
            let children = node.children.iter().flatten().rev();
            todo.extend(children.map(|&child| (child, transform)));
        }
        Ok(())
    }

    fn node(&mut self, index: Index<Node>, node: &Node, transform: &DMat4, place: &str) -> Result<(), ReadError> {
        if let Some(camera) = node.camera {
            self.camera(camera, transform, place)?;
        }
        let Some(mesh) = node.mesh else { return Ok(()) };
        let mesh = self.document.get(mesh, place)?;
        if node.skin.is_some() {
            let text = "its skin is ignored, and its place and size may be wrong; export it with its pose applied";
            self.warnings.push(self.document.warning(place, text));
        }
        let name = node.name.as_ref().or(mesh.name.as_ref());
        let name = name.map_or_else(|| format!("node {}", index.value()), String::clone);
        let group = self.builder.group(&name);
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let mesh_name = mesh.name.as_ref().map_or(String::new(), |name| format!(", mesh `{name}`"));
            self.primitive(primitive, transform, group, &format!("{place}{mesh_name}, primitive {k}"))?;
        }
        Ok(())
    }

    /// Takes the first perspective camera.
    fn camera(&mut self, index: Index<gltf_json::Camera>, transform: &DMat4, place: &str) -> Result<(), ReadError> {
        let Some(perspective) = &self.document.get(index, place)?.perspective else {
            self.warnings.push(self.document.warning(place, "its camera is not a perspective one and is ignored"));
            return Ok(());
        };
        let eye = transform.w_axis.truncate();
        let direction = |axis: DVec3| transform.transform_vector3(axis).try_normalize();
        let (forward, up) = (direction(DVec3::NEG_Z), direction(DVec3::Y));
        if let (None, Some(forward), Some(up), true) = (self.camera, forward, up, eye.is_finite()) {
            self.camera = Some(Camera { eye, target: eye + forward, up, fov_y: f64::from(perspective.yfov) });
        }
        Ok(())
    }
}

/// The transform of a node in its parent.
fn local_transform(node: &Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return DMat4::from_cols_array(&matrix.map(f64::from));
    }
    let vector = |v: Option<[f32; 3]>, default| v.map_or(default, |v| Vec3::from(v).as_dvec3());
    let rotation = node.rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q.0.map(f64::from)));
    DMat4::from_scale_rotation_translation(
        vector(node.scale, DVec3::ONE),
        if rotation.length() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY },
        vector(node.translation, DVec3::ZERO),
    )
}

//! Baked light as binary glTF.
//!
//! Each group of the scene is a node with one primitive per material. Its vertices carry the light twice: as the
//! float32 attribute `_RADIOSITY` (or `_IRRADIANCE`), physical and unclamped, and as `COLOR_0`, the exposed picture of
//! it between 0 and 1 that any viewer shows, the materials being white and unlit (`KHR_materials_unlit`). Three bands
//! are a VEC3, one band is a scalar; of any other number each band k is a scalar `_RADIOSITY_k`, and `COLOR_0` is the
//! gray of their mean. The exposure that was used stands in `asset.extras.hatbox`.

use crate::bake::{Baked, Exposure, Part, bake, rgb};
use crate::io::atomic::{self, AtomicError};
use crate::linalg::MultiVector;
use crate::radiosity::{Shown, Solution};
use crate::scene::{Camera, Physics, Scene};
use glam::{DMat3, DQuat, DVec3};
use gltf_json::validation::Checked::{self, Valid};
use gltf_json::validation::USize64;
use gltf_json::{self as json, Index, accessor, buffer, extensions, material, mesh, scene};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;

/// Writes a solution's triangles with their light to a `.glb` file, exposed automatically unless told otherwise.
///
/// # Errors
/// [`AtomicError`] if the file cannot be written (there is none then), or would exceed the 4 GiB of the format.
pub fn save(solution: &Solution, shown: Shown, exposure: Option<Exposure>, path: &Path) -> Result<(), AtomicError> {
    let exposure = exposure.unwrap_or_else(|| Exposure::automatic(solution, shown));
    let baked = bake(solution, shown);
    let mut writer = Writer::default();
    writer.asset(&solution.scene, shown, exposure);
    writer.materials(&solution.scene);
    for parts in baked.parts.chunk_by(|a, b| a.group == b.group) {
        writer.group(&solution.scene.mesh.groups[parts[0].group as usize], parts, &baked, shown, exposure);
    }
    if let Some(camera) = &solution.scene.camera {
        writer.camera(camera);
    }
    atomic::write(path, |file| writer.finish(file))
}

#[derive(Default)]
struct Writer {
    root: json::Root,
    bytes: Vec<u8>,
    nodes: Vec<Index<json::Node>>,
}

impl Writer {
    fn asset(&mut self, scene: &Scene, shown: Shown, exposure: Exposure) {
        let (quantity, unit) = match (shown, scene.physics) {
            (Shown::Radiosity, Physics::Light) => ("radiosity", "lm/m2"),
            (Shown::Irradiance, Physics::Light) => ("irradiance", "lx"),
            (Shown::Radiosity, Physics::Heat) => ("radiosity", "W/m2"),
            (Shown::Irradiance, Physics::Heat) => ("irradiance", "W/m2"),
        };
        let notes = serde_json::json!({
            "hatbox": { "quantity": quantity, "unit": unit, "exposure": exposure.scale }
        });
        self.root.asset = json::Asset {
            generator: Some(concat!("hatbox ", env!("CARGO_PKG_VERSION")).to_owned()),
            extras: serde_json::value::to_raw_value(&notes).ok(),
            ..json::Asset::default()
        };
    }

    fn materials(&mut self, scene: &Scene) {
        let unlit = extensions::material::Material {
            unlit: Some(extensions::material::Unlit {}),
            ..extensions::material::Material::default()
        };
        let material = |named: &crate::scene::Material| json::Material {
            name: Some(named.name.clone()),
            // What viewers that do not know the extension fall back to: white and rough.
            pbr_metallic_roughness: material::PbrMetallicRoughness {
                metallic_factor: material::StrengthFactor(0.0),
                ..material::PbrMetallicRoughness::default()
            },
            extensions: Some(unlit.clone()),
            ..json::Material::default()
        };
        self.root.materials = scene.materials.iter().map(material).collect();
        if !self.root.materials.is_empty() {
            self.root.extensions_used.push("KHR_materials_unlit".to_owned());
        }
    }

    fn group(&mut self, name: &str, parts: &[Part], baked: &Baked, shown: Shown, exposure: Exposure) {
        let primitives = parts.iter().map(|part| self.primitive(part, baked, shown, exposure)).collect();
        let mesh = self.root.push(json::Mesh {
            extensions: None,
            extras: None,
            name: Some(name.to_owned()),
            primitives,
            weights: None,
        });
        self.node(json::Node { mesh: Some(mesh), name: Some(name.to_owned()), ..json::Node::default() });
    }

    fn primitive(&mut self, part: &Part, baked: &Baked, shown: Shown, exposure: Exposure) -> mesh::Primitive {
        let vertices = || part.vertices.clone();
        let mut attributes = BTreeMap::new();
        let mut add = |semantic, accessor| attributes.insert(Valid(semantic), accessor);
        add(mesh::Semantic::Positions, self.positions(&baked.positions[vertices()]));
        add(mesh::Semantic::Normals, self.floats(vertices().map(|v| baked.normals[v].as_vec3().to_array())));
        if !baked.uvs.is_empty() {
            let uvs = vertices().map(|v| baked.uvs[v].as_vec2().to_array());
            add(mesh::Semantic::TexCoords(0), self.floats(uvs));
        }
        let values = |v: usize| baked.values.iter_bands().map(|band| band[v]).collect::<Vec<_>>();
        let colors = vertices().map(|v| exposure.color(rgb(&values(v))).map(|c| c as f32));
        add(mesh::Semantic::Colors(0), self.floats(colors));
        attributes.extend(self.values(vertices(), &baked.values, shown));
        let first = part.vertices.start as u32;
        let indices = baked.triangles[part.triangles.clone()].iter().flatten().map(|index| index - first);
        mesh::Primitive {
            attributes,
            extensions: None,
            extras: None,
            indices: Some(self.indices(indices)),
            material: Some(Index::new(part.material)),
            mode: Valid(mesh::Mode::Triangles),
            targets: None,
        }
    }

    /// The physical values, as the attributes that the module's documentation names.
    fn values(
        &mut self,
        vertices: Range<usize>,
        values: &MultiVector,
        shown: Shown,
    ) -> Vec<(Checked<mesh::Semantic>, Index<json::Accessor>)> {
        let name = match shown {
            Shown::Radiosity => "RADIOSITY",
            Shown::Irradiance => "IRRADIANCE",
        };
        let semantic = |name: String| Valid(mesh::Semantic::Extras(name));
        let value = |band: usize, vertex: usize| to_f32(values.band(band)[vertex]);
        match values.bands() {
            1 => vec![(semantic(name.to_owned()), self.floats(vertices.map(|v| [value(0, v)])))],
            3 => vec![(semantic(name.to_owned()), self.floats(vertices.map(|v| [0, 1, 2].map(|b| value(b, v)))))],
            n => {
                let band = |b| (semantic(format!("{name}_{b}")), self.floats(vertices.clone().map(|v| [value(b, v)])));
                (0..n).map(band).collect()
            }
        }
    }

    /// Positions must state their bounds, as the rounded numbers that are stored.
    fn positions(&mut self, positions: &[DVec3]) -> Index<json::Accessor> {
        let rounded: Vec<_> = positions.iter().map(|p| p.as_vec3()).collect();
        let bound = |pick: fn(glam::Vec3, glam::Vec3) -> glam::Vec3| {
            rounded.iter().copied().reduce(pick).map(|v| serde_json::json!(v.to_array()))
        };
        let (min, max) = (bound(glam::Vec3::min), bound(glam::Vec3::max));
        let index = self.floats(rounded.iter().map(glam::Vec3::to_array));
        let accessor = &mut self.root.accessors[index.value()];
        (accessor.min, accessor.max) = (min, max);
        index
    }

    fn floats<const N: usize>(&mut self, rows: impl Iterator<Item = [f32; N]>) -> Index<json::Accessor> {
        let start = self.bytes.len();
        rows.flatten().for_each(|value| self.bytes.extend_from_slice(&value.to_le_bytes()));
        let type_ = match N {
            1 => accessor::Type::Scalar,
            2 => accessor::Type::Vec2,
            _ => accessor::Type::Vec3,
        };
        self.accessor(start, 4 * N, type_, accessor::ComponentType::F32, buffer::Target::ArrayBuffer)
    }

    fn indices(&mut self, indices: impl Iterator<Item = u32>) -> Index<json::Accessor> {
        let start = self.bytes.len();
        indices.for_each(|index| self.bytes.extend_from_slice(&index.to_le_bytes()));
        let (scalar, u32) = (accessor::Type::Scalar, accessor::ComponentType::U32);
        self.accessor(start, 4, scalar, u32, buffer::Target::ElementArrayBuffer)
    }

    /// An accessor, with a view of its own, of the bytes written since `start`.
    fn accessor(
        &mut self,
        start: usize,
        size: usize,
        type_: accessor::Type,
        component: accessor::ComponentType,
        target: buffer::Target,
    ) -> Index<json::Accessor> {
        let length = self.bytes.len() - start;
        let view = self.root.push(buffer::View {
            buffer: Index::new(0),
            byte_length: USize64::from(length),
            byte_offset: Some(USize64::from(start)),
            byte_stride: None,
            name: None,
            target: Some(Valid(target)),
            extensions: None,
            extras: None,
        });
        self.root.push(json::Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: USize64::from(length / size),
            component_type: Valid(accessor::GenericComponentType(component)),
            extensions: None,
            extras: None,
            type_: Valid(type_),
            min: None,
            max: None,
            name: None,
            normalized: false,
            sparse: None,
        })
    }

    /// The camera, if it looks anywhere: glTF cameras look along −z with +y up.
    fn camera(&mut self, camera: &Camera) {
        let back = (camera.eye - camera.target).normalize_or_zero();
        let right = camera.up.cross(back).normalize_or_zero();
        if back == DVec3::ZERO || right == DVec3::ZERO {
            return;
        }
        let turn = DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back)).as_quat().normalize();
        let perspective = json::camera::Perspective {
            aspect_ratio: None,
            yfov: camera.fov_y as f32,
            zfar: None,
            znear: (1e-3 * camera.eye.distance(camera.target)) as f32,
            extensions: None,
            extras: None,
        };
        let index = self.root.push(json::Camera {
            name: None,
            orthographic: None,
            perspective: Some(perspective),
            type_: Valid(json::camera::Type::Perspective),
            extensions: None,
            extras: None,
        });
        self.node(json::Node {
            camera: Some(index),
            name: Some("camera".to_owned()),
            rotation: Some(scene::UnitQuaternion(turn.to_array())),
            translation: Some(camera.eye.as_vec3().to_array()),
            ..json::Node::default()
        });
    }

    fn node(&mut self, node: json::Node) {
        let index = self.root.push(node);
        self.nodes.push(index);
    }

    /// The container: a header, the JSON padded with spaces and the bytes, in little-endian 32-bit lengths.
    fn finish(mut self, file: &mut impl Write) -> io::Result<()> {
        if !self.bytes.is_empty() {
            self.root.buffers.push(json::Buffer {
                byte_length: USize64::from(self.bytes.len()),
                name: None,
                uri: None,
                extensions: None,
                extras: None,
            });
        }
        let scene = json::Scene { extensions: None, extras: None, name: None, nodes: self.nodes };
        self.root.scene = Some(self.root.push(scene));
        let mut text = json::serialize::to_vec(&self.root)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let chunks = [(b"JSON", &text), (b"BIN\0", &self.bytes)];
        let chunks = &chunks[..if self.bytes.is_empty() { 1 } else { 2 }];
        let length: usize = 12 + chunks.iter().map(|(_, bytes)| 8 + bytes.len()).sum::<usize>();
        let length = u32::try_from(length).map_err(|_| io::Error::other("a .glb file holds no more than 4 GiB"))?;
        file.write_all(b"glTF\x02\0\0\0")?;
        file.write_all(&length.to_le_bytes())?;
        for (kind, bytes) in chunks {
            file.write_all(&(bytes.len() as u32).to_le_bytes())?;
            file.write_all(*kind)?;
            file.write_all(bytes)?;
        }
        Ok(())
    }
}

/// The nearest finite number of single precision: infinities are not allowed in glTF.
fn to_f32(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN, f32::MAX)
}

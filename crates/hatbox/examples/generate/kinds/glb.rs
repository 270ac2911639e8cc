//! A model as binary glTF: one mesh for each material, positions and indices.

use super::{Material, Model};
use glam::{DMat3, DQuat};
use serde_json::{Value, json};

impl Model {
    /// The file.
    pub(crate) fn to_glb(&self) -> Vec<u8> {
        let mut binary = Binary::default();
        let parts: Vec<_> = self.parts.iter().filter(|(_, faces)| !faces.is_empty()).collect();
        let meshes: Vec<Value> = parts
            .iter()
            .enumerate()
            .map(|(index, (material, faces))| {
                let [positions, indices] = binary.add(faces);
                let primitive = json!({"attributes": {"POSITION": positions}, "indices": indices, "material": index});
                json!({"name": material.name, "primitives": [primitive]})
            })
            .collect();
        let mut nodes: Vec<Value> =
            parts.iter().enumerate().map(|(k, (material, _))| json!({"name": material.name, "mesh": k})).collect();
        nodes.push(self.camera());
        let root = json!({
            "asset": {"version": "2.0", "generator": "hatbox generate"},
            "extensionsUsed": ["KHR_materials_emissive_strength"],
            "scene": 0,
            "scenes": [{"nodes": (0..nodes.len()).collect::<Vec<_>>()}],
            "nodes": nodes,
            "meshes": meshes,
            "materials": parts.iter().map(|(material, _)| described(material)).collect::<Vec<_>>(),
            "cameras": [{"type": "perspective", "perspective": {"yfov": 0.9, "aspectRatio": 1.333, "znear": 0.01}}],
            "accessors": binary.accessors,
            "bufferViews": binary.views,
            "buffers": [{"byteLength": binary.bytes.len()}],
        });
        container(root.to_string().into_bytes(), binary.bytes)
    }

    /// glTF's cameras look along −z.
    fn camera(&self) -> Value {
        let back = (self.eye - self.target).normalize();
        let right = glam::DVec3::Y.cross(back).normalize();
        let turn = DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back));
        json!({"name": "camera", "camera": 0, "translation": self.eye.to_array(), "rotation": turn.to_array()})
    }
}

fn described(material: &Material) -> Value {
    let [r, g, b] = material.reflectance;
    let strongest = material.radiance.into_iter().fold(0.0, f32::max);
    let mut described = json!({
        "name": material.name,
        "pbrMetallicRoughness": {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0},
    });
    if strongest > 0.0 {
        described["emissiveFactor"] = json!(material.radiance.map(|value| value / strongest));
        described["extensions"] = json!({"KHR_materials_emissive_strength": {"emissiveStrength": strongest}});
    }
    described
}

#[derive(Default)]
struct Binary {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Binary {
    /// Adds faces; the accessors of their positions and indices.
    fn add(&mut self, faces: &[super::Face]) -> [usize; 2] {
        let (mut positions, mut indices) = (Vec::new(), Vec::new());
        let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
        let mut count = 0_u32;
        for face in faces {
            let corners = if face[2] == face[3] { &face[..3] } else { &face[..] };
            for corner in corners {
                let corner = corner.as_vec3().to_array();
                low = std::array::from_fn(|k| low[k].min(corner[k]));
                high = std::array::from_fn(|k| high[k].max(corner[k]));
                positions.extend(corner.iter().flat_map(|x| x.to_le_bytes()));
            }
            for k in 1..corners.len() as u32 - 1 {
                indices.extend([count, count + k, count + k + 1].iter().flat_map(|i| i.to_le_bytes()));
            }
            count += corners.len() as u32;
        }
        let number = indices.len() / 4;
        let positions = self.accessor(positions, json!({"componentType": 5126, "count": count, "type": "VEC3"}));
        self.accessors[positions]["min"] = json!(low);
        self.accessors[positions]["max"] = json!(high);
        [positions, self.accessor(indices, json!({"componentType": 5125, "count": number, "type": "SCALAR"}))]
    }

    fn accessor(&mut self, part: Vec<u8>, mut accessor: Value) -> usize {
        accessor["bufferView"] = json!(self.views.len());
        self.views.push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": part.len()}));
        self.bytes.extend(part);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

/// Header and chunks, padded to multiples of four bytes.
fn container(mut json: Vec<u8>, mut binary: Vec<u8>) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let length = 12 + 8 + json.len() + 8 + binary.len();
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((length as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", binary)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

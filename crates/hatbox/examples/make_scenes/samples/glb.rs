//! Quads, materials and a camera as binary glTF.

use gltf_json::accessor::{ComponentType, GenericComponentType, Type};
use gltf_json::buffer::{Stride, Target, View};
use gltf_json::extensions::material::{EmissiveStrength, EmissiveStrengthFactor};
use gltf_json::material::{EmissiveFactor, PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor};
use gltf_json::mesh::{Mode, Primitive, Semantic};
use gltf_json::validation::Checked::Valid;
use gltf_json::validation::USize64;
use gltf_json::{Accessor, Buffer, Extras, Index, Mesh, Node, Root, Value};

/// A diffuse surface.
#[derive(Clone, Copy)]
pub(super) struct Material {
    pub(super) name: &'static str,
    pub(super) reflectance: [f32; 3],
    /// In W/(m² sr) or cd/m².
    pub(super) radiance: [f32; 3],
}

impl Material {
    pub(super) const fn matte(name: &'static str, reflectance: [f32; 3]) -> Self {
        Self { name, reflectance, radiance: [0.0; 3] }
    }
}

/// A node: quads of one material, corners in metres and counter-clockwise from the lit side.
pub(super) struct Part {
    pub(super) name: &'static str,
    pub(super) material: usize,
    pub(super) quads: Vec<[[f64; 3]; 4]>,
}

/// A pinhole that looks along +z, with y up.
pub(super) struct Camera {
    pub(super) eye: [f64; 3],
    pub(super) fov_y: f64,
    pub(super) aspect_ratio: f64,
}

/// What becomes one file.
pub(super) struct Scene {
    pub(super) materials: Vec<Material>,
    pub(super) parts: Vec<Part>,
    pub(super) camera: Camera,
}

/// The binary chunk: positions and normals of all parts, then indices.
#[derive(Default)]
struct Binary {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    indices: Vec<u16>,
}

/// Bytes of a position or normal.
const VECTOR: usize = 12;

impl Scene {
    /// The file.
    pub(super) fn to_glb(&self) -> Vec<u8> {
        let (mut root, mut binary) = (Root::default(), Binary::default());
        root.asset.generator = Some("hatbox make_scenes".to_owned());
        root.materials = self.materials.iter().map(material).collect();
        root.extensions_used = vec!["KHR_materials_emissive_strength".to_owned()];
        let mut nodes: Vec<_> = self.parts.iter().map(|part| add_part(&mut root, &mut binary, part)).collect();
        nodes.push(add_camera(&mut root, &self.camera));
        let scene = gltf_json::Scene { nodes, name: None, extensions: None, extras: Extras::default() };
        root.scene = Some(root.push(scene));
        let chunk = binary.finish(&mut root);
        let json = gltf_json::serialize::to_vec(&root).expect("these structures are JSON");
        container(json, chunk)
    }
}

fn material(material: &Material) -> gltf_json::Material {
    let [r, g, b] = material.reflectance;
    let strongest = material.radiance.into_iter().fold(0.0, f32::max);
    let strength = EmissiveStrength { emissive_strength: EmissiveStrengthFactor(strongest) };
    let emits = strongest > 0.0;
    gltf_json::Material {
        name: Some(material.name.to_owned()),
        pbr_metallic_roughness: PbrMetallicRoughness {
            base_color_factor: PbrBaseColorFactor([r, g, b, 1.0]),
            metallic_factor: StrengthFactor(0.0),
            ..Default::default()
        },
        emissive_factor: EmissiveFactor(material.radiance.map(|value| if emits { value / strongest } else { 0.0 })),
        extensions: emits.then_some(gltf_json::extensions::material::Material {
            emissive_strength: Some(strength),
            ..Default::default()
        }),
        ..Default::default()
    }
}

fn add_part(root: &mut Root, binary: &mut Binary, part: &Part) -> Index<Node> {
    let (first_vertex, first_index) = (binary.positions.len(), binary.indices.len());
    for quad in &part.quads {
        let base = (binary.positions.len() - first_vertex) as u16;
        binary.positions.extend(quad.map(|corner| corner.map(|x| x as f32)));
        binary.normals.extend([normal(quad); 4]);
        binary.indices.extend([0, 1, 2, 0, 2, 3].map(|k| base + k));
    }
    let positions = &binary.positions[first_vertex..];
    let bound = |pick: fn(f32, f32) -> f32| {
        let corner = positions.iter().copied().reduce(|a, b| std::array::from_fn(|k| pick(a[k], b[k])));
        corner.map(|corner| Value::from(corner.to_vec()))
    };
    let (min, max, vertices) = (bound(f32::min), bound(f32::max), positions.len());
    let vectors = |view| accessor(view, first_vertex * VECTOR, vertices, ComponentType::F32, Type::Vec3);
    let positions = root.push(Accessor { min, max, ..vectors(0) });
    let normals = root.push(vectors(1));
    let count = binary.indices.len() - first_index;
    let indices = root.push(accessor(2, first_index * 2, count, ComponentType::U16, Type::Scalar));
    let primitive = Primitive {
        attributes: [(Valid(Semantic::Positions), positions), (Valid(Semantic::Normals), normals)].into(),
        indices: Some(indices),
        material: Some(Index::new(part.material as u32)),
        mode: Valid(Mode::Triangles),
        targets: None,
        extensions: None,
        extras: Extras::default(),
    };
    let name = Some(part.name.to_owned());
    let mesh = Mesh {
        primitives: vec![primitive],
        name: name.clone(),
        weights: None,
        extensions: None,
        extras: Extras::default(),
    };
    let mesh = Some(root.push(mesh));
    root.push(Node { mesh, name, ..Default::default() })
}

/// The unit normal, from the diagonals.
fn normal(quad: &[[f64; 3]; 4]) -> [f32; 3] {
    let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let (a, b) = (minus(quad[2], quad[0]), minus(quad[3], quad[1]));
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let length = cross.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Adding zero turns −0 into 0.
    cross.map(|x| (x / length) as f32 + 0.0)
}

fn accessor(view: u32, offset: usize, count: usize, component: ComponentType, kind: Type) -> Accessor {
    Accessor {
        buffer_view: Some(Index::new(view)),
        byte_offset: Some(USize64::from(offset)),
        count: USize64::from(count),
        component_type: Valid(GenericComponentType(component)),
        type_: Valid(kind),
        min: None,
        max: None,
        name: None,
        normalized: false,
        sparse: None,
        extensions: None,
        extras: Extras::default(),
    }
}

fn add_camera(root: &mut Root, camera: &Camera) -> Index<Node> {
    let perspective = gltf_json::camera::Perspective {
        aspect_ratio: Some(camera.aspect_ratio as f32),
        yfov: camera.fov_y as f32,
        znear: 0.01,
        zfar: None,
        extensions: None,
        extras: Extras::default(),
    };
    let index = root.push(gltf_json::Camera {
        name: None,
        orthographic: None,
        perspective: Some(perspective),
        type_: Valid(gltf_json::camera::Type::Perspective),
        extensions: None,
        extras: Extras::default(),
    });
    root.push(Node {
        camera: Some(index),
        name: Some("camera".to_owned()),
        translation: Some(camera.eye.map(|x| x as f32)),
        // glTF's cameras look along −z: half a turn about y.
        rotation: Some(gltf_json::scene::UnitQuaternion([0.0, 1.0, 0.0, 0.0])),
        ..Default::default()
    })
}

impl Binary {
    /// The bytes, described in `root` as one buffer with three views.
    fn finish(self, root: &mut Root) -> Vec<u8> {
        let floats = |vectors: &[[f32; 3]]| vectors.iter().flatten().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>();
        let indices = self.indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let mut bytes = Vec::new();
        for (part, stride, target) in [
            (floats(&self.positions), Some(Stride(VECTOR)), Target::ArrayBuffer),
            (floats(&self.normals), Some(Stride(VECTOR)), Target::ArrayBuffer),
            (indices, None, Target::ElementArrayBuffer),
        ] {
            root.push(View {
                buffer: Index::new(0),
                byte_length: USize64::from(part.len()),
                byte_offset: Some(USize64::from(bytes.len())),
                byte_stride: stride,
                name: None,
                target: Some(Valid(target)),
                extensions: None,
                extras: Extras::default(),
            });
            bytes.extend(part);
        }
        root.push(Buffer {
            byte_length: USize64::from(bytes.len()),
            name: None,
            uri: None,
            extensions: None,
            extras: Extras::default(),
        });
        bytes
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

use super::{Files, assert_close, material, png, rgb};
use glam::{DVec2, DVec3};
use hatbox::io::{RawScene, ReadError};
use serde_json::{Value, json};
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// A quad in the plane z = 0 as separate vertices, then indices 0 1 2, 0 2 3 as u16, then four texture coordinates.
fn binary() -> Vec<u8> {
    let positions: [f32; 12] = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.];
    let uvs: [f32; 8] = [0., 1., 1., 1., 1., 0., 0., 0.];
    let mut bytes: Vec<u8> = positions.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes.extend(uvs.iter().flat_map(|x| x.to_le_bytes()));
    bytes
}

/// A glTF of one node with that quad; tests change what they are about.
pub(crate) fn document() -> Value {
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "sheet" }],
        "meshes": [{ "name": "quad", "primitives": [
            { "attributes": { "POSITION": 0, "TEXCOORD_0": 2 }, "indices": 1, "material": 0 }
        ] }],
        "materials": [{ "name": "paint", "pbrMetallicRoughness": {
            "baseColorFactor": [0.8, 0.6, 0.4, 1.0], "metallicFactor": 0.0
        } }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR" },
            { "bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 12 },
            { "buffer": 0, "byteOffset": 60, "byteLength": 32 }
        ],
        "buffers": [{ "byteLength": 92, "uri": "a%20b.bin" }]
    })
}

pub(crate) fn try_read(document: &Value, more: &[(&str, &[u8])]) -> Result<RawScene, ReadError> {
    let (json, binary) = (document.to_string().into_bytes(), binary());
    let mut files: Vec<(&str, &[u8])> = vec![("a.gltf", &json), ("a b.bin", &binary)];
    files.extend(more);
    Files::new(&files).read("a.gltf")
}

fn read(document: &Value) -> RawScene {
    try_read(document, &[]).expect("right")
}

fn normals(scene: &RawScene) -> Vec<DVec3> {
    (0..scene.mesh.cells.len()).map(|k| scene.mesh.patch(k).normal()).collect()
}

#[test]
fn a_plain_document_is_read_as_it_stands() {
    let scene = read(&document());
    assert_eq!(scene.warnings, [""; 0]);
    assert_eq!(normals(&scene), [DVec3::Z; 2]);
    assert_eq!(scene.mesh.groups, ["sheet"]);
    assert_eq!(scene.mesh.uvs[1][..3], [DVec2::new(0., 1.), DVec2::new(1., 0.), DVec2::new(0., 0.)]);
    assert_eq!(scene.mesh.vertices.len(), 4);
    assert_close(rgb(&material(&scene, "paint").reflectance, 0.0, 0.0), [0.8, 0.6, 0.4], 1e-7);
}

#[test]
fn nodes_move_their_children_and_mirrors_keep_the_fronts() {
    let mut document = document();
    document["scenes"][0]["nodes"] = json!([1]);
    document["nodes"] = json!([
        { "mesh": 0, "scale": [1, 1, -2] },
        { "children": [0, 2], "translation": [0, 0, 5], "rotation": [0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2] },
        { "mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1] }
    ]);
    let scene = read(&document);
    // A quarter turn about y takes z to x. Mirrored in its own plane's normal, the sheet faces the other way; mirrored
    // within its plane, it does not.
    let expected = [DVec3::NEG_X, DVec3::NEG_X, DVec3::X, DVec3::X];
    for (found, expected) in normals(&scene).into_iter().zip(expected) {
        assert!((found - expected).length() < 1e-6, "{found}");
    }
    let corner = scene.mesh.patch(2).corners()[1];
    assert!([DVec3::new(0., 1., 3.), DVec3::new(0., 0., 3.)].iter().any(|c| (corner - *c).length() < 1e-6), "{corner}");
    assert_eq!(scene.mesh.groups, ["quad"], "a node without a name takes its mesh's");
}

#[test]
fn strips_fans_and_sparse_accessors_are_triangles_too() {
    let mut fan = document();
    fan["meshes"][0]["primitives"][0] = json!({ "attributes": { "POSITION": 0 }, "mode": 6, "material": 0 });
    assert_eq!(normals(&read(&fan)), [DVec3::Z; 2]);

    let mut strip = document();
    strip["meshes"][0]["primitives"][0]["mode"] = json!(5);
    strip["accessors"][1]["count"] = json!(3);
    assert_eq!(normals(&read(&strip)), [DVec3::Z]);

    // The third u16 of the indices says which vertex deviates (2), the second position to where (1, 0, 0).
    let mut sparse = document();
    sparse["accessors"][0]["sparse"] = json!({
        "count": 1, "indices": { "bufferView": 1, "byteOffset": 4, "componentType": 5123 }, "values": { "bufferView": 0, "byteOffset": 12 }
    });
    let scene = read(&sparse);
    assert_eq!((scene.mesh.cells.len(), scene.mesh.area()), (1, 0.5), "the other triangle has become flat");
    assert!(scene.warnings.iter().any(|warning| warning.contains("no area")), "{:?}", scene.warnings);
}

#[test]
fn points_vertex_colours_and_unknown_extensions_are_left_out_with_a_warning() {
    let mut document = document();
    document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(0);
    let points = json!({ "attributes": { "POSITION": 0 }, "mode": 0 });
    document["meshes"][0]["primitives"].as_array_mut().expect("a list").push(points);
    document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    let warnings = read(&document).warnings;
    for part in ["KHR_lights_punctual", "vertex colours", "points or lines"] {
        assert!(warnings.iter().any(|warning| warning.contains(part) && warning.contains("a.gltf")), "{warnings:?}");
    }
    assert_eq!(warnings.len(), 3);
}

#[test]
fn reflectance_and_emission_follow_the_specification() {
    let mut document = document();
    document["materials"][0] = json!({
        "name": "paint", "doubleSided": true,
        "pbrMetallicRoughness": {
            "baseColorFactor": [1.0, 0.5, 1.0, 1.0], "metallicFactor": 0.5,
            "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 1 }
        },
        "emissiveFactor": [1.0, 0.5, 0.0], "emissiveTexture": { "index": 0 },
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 10.0 } }
    });
    document["textures"] = json!([{ "source": 0, "sampler": 0 }, { "source": 1, "sampler": 0 }]);
    document["samplers"] = json!([{ "wrapS": 33071, "wrapT": 33071 }]);
    document["images"] = json!([{ "uri": "color.png" }, { "uri": "metal.png" }]);
    let (color, metal) = (png(2, &[[188, 188, 188], [255, 255, 0]]), png(2, &[[9, 9, 0], [9, 9, 255]]));
    let scene = try_read(&document, &[("color.png", &color), ("metal.png", &metal)]).expect("right");
    assert_eq!(scene.warnings, [""; 0]);
    let paint = material(&scene, "paint");
    assert!(paint.two_sided);
    let half = 0.502_886;
    assert_close(rgb(&paint.reflectance, 0.25, 0.5), [half, 0.5 * half, half], 1e-5);
    assert_close(rgb(&paint.reflectance, 0.75, 0.5), [0.5, 0.25, 0.0], 1e-5);
    assert_close(rgb(&paint.exitance, 0.75, 0.5), [10.0 * PI, 5.0 * PI, 0.0], 1e-6);
    assert_close(rgb(&paint.exitance, -3.0, 0.5), [10.0 * PI * half, 5.0 * PI * half, 0.0], 1e-5);
}

#[test]
fn all_metal_and_no_material_are_warned_of() {
    let mut metal = document();
    metal["materials"][0]["pbrMetallicRoughness"] = json!({});
    let scene = read(&metal);
    assert_close(rgb(&material(&scene, "paint").reflectance, 0.0, 0.0), [0.0; 3], 1e-15);
    assert!(scene.warnings[0].contains("metal") && scene.warnings[0].contains("`paint`"), "{:?}", scene.warnings);

    let mut bare = document();
    bare["meshes"][0]["primitives"][0]["material"] = Value::Null;
    let scene = read(&bare);
    assert_close(rgb(&scene.materials[0].reflectance, 0.0, 0.0), [0.5; 3], 1e-15);
    assert!(scene.warnings[0].contains("no material") && scene.warnings[0].contains("`sheet`"), "{:?}", scene.warnings);
}

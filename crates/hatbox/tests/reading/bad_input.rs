//! Whatever is wrong gives one error that names the file, the place and the remedy; and nothing panics.

use super::{Files, geometry, gltf, sample, samples};
use hatbox::io::{ReadError, read_raw};
use proptest::prelude::*;
use serde_json::{Value, json};

/// Asserts that the text names the file, the place and the remedy.
#[track_caller]
fn assert_says(error: &ReadError, parts: &[&str]) {
    let text = error.to_string();
    for part in parts.iter().chain([&error.remedy.as_str()]) {
        assert!(!part.is_empty() && text.contains(part), "`{part}` is not in: {text}");
    }
}

#[test]
fn files_that_are_no_scene() {
    for (name, content, parts) in [
        ("a.glb", None, ["a.glb", "cannot be read", "check the path"]),
        ("a.obj", None, ["a.obj", "cannot be read", "check the path"]),
        ("a.toml", None, ["a.toml", "cannot be read", "check the path"]),
        ("a.xyz", Some(&b"1"[..]), ["a.xyz", "extension", ".glb"]),
        ("a.glb", Some(b"garbage"), ["a.glb", "line 1", "export"]),
        ("a.glb", Some(b"glTF\x02\0\0\0\xff\xff\0\0"), ["a.glb", "cut off", "again"]),
        ("a.gltf", Some(b"{ \"asset\": }"), ["a.gltf", "line 1 column", "export"]),
        ("a.obj", Some(b"\x00\xff garbage\nmore\n"), ["a.obj", "empty", "export"]),
        ("a.obj", Some(b""), ["a.obj", "empty", "export"]),
        ("a.ply", Some(b"garbage"), ["a.ply", "no PLY", "export"]),
        ("a.stl", Some(b"garbage"), ["a.stl", "no STL", "export"]),
        ("a.stl", Some(b"solid x\nfacet normal 0 0 0\nouter loop\nvertex 1 2"), ["a.stl", "triangle 0", "export"]),
        ("a.stl", Some(b"solid x\nendsolid x\n"), ["a.stl", "empty", "export"]),
        ("a.toml", Some(b"garbage"), ["a.toml", "line 1", "correct"]),
        ("a.toml", Some(b"\xff"), ["a.toml", "UTF-8", "save"]),
    ] {
        let named: Vec<_> = content.map(|content| (name, content)).into_iter().collect();
        let error = Files::new(&named).read(name).expect_err(name);
        assert_says(&error, &parts);
        assert!(!error.to_string().contains("ParseError"), "the parser's own state is nobody's business: {error}");
    }
}

#[test]
fn obj_errors_name_the_line_and_the_object() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\no lid\n";
    for (statements, parts) in [
        ("f 1 2 4", ["line 5", "`lid`", "vertex 4"]),
        ("f 1 2 0", ["line 5", "`lid`", "vertex 0, but they count from 1"]),
        ("f 1 2 -4", ["line 5", "`lid`", "vertex -4"]),
        ("f 1/1 2/1 3/1", ["line 5", "`lid`", "texture coordinate 1"]),
        ("f 1//9 2//9 3//9", ["line 5", "`lid`", "normal 9"]),
        ("f 1 2 x", ["line 5", "`lid`", "`x`"]),
        ("f 1 2 99999999999999999999", ["line 5", "`lid`", "99999"]),
        ("f 1 2", ["line 5", "`lid`", "2 corners"]),
        ("v nan 0 0\nf 1 2 4", ["line 6", "`lid`", "not finite"]),
        ("v 1e999 0 0\nf 1 2 4", ["line 6", "`lid`", "not finite"]),
        ("v 1 two 3", ["line 5", "`two`", "number"]),
        ("v 1 2", ["line 5", "`v`", "2 numbers"]),
    ] {
        let obj = format!("{triangle}{statements}\n");
        let error = Files::new(&[("a.obj", obj.as_bytes())]).read("a.obj").expect_err(statements);
        assert_says(&error, &["a.obj"]);
        assert_says(&error, &parts);
    }
}

#[test]
fn mtl_errors_name_the_line_and_the_material() {
    let obj = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl wall\nf 1 2 3\n";
    for (statement, parts) in [
        ("Kd 0.5 1.4 0.5", ["line 2", "1.4", "Kd"]),
        ("Kd -0.1", ["line 2", "-0.1", "Kd"]),
        ("Kd 0.1 0.2", ["line 2", "2 numbers", "Kd"]),
        ("Kd spectral file.rfl", ["line 2", "spectrum", "Kd"]),
        ("Ke inf", ["line 2", "inf", "Ke"]),
        ("map_Kd gone.png", ["line 2", "gone.png", "`wall`"]),
        ("map_Kd a.obj", ["line 2", "PNG", "`wall`"]),
    ] {
        let mtl = format!("newmtl wall\n{statement}\n");
        let error = Files::new(&[("a.obj", obj), ("a.mtl", mtl.as_bytes())]).read("a.obj").expect_err(statement);
        assert_says(&error, &["a.mtl"]);
        assert_says(&error, &parts);
    }
}

/// What is changed in the plain document, to what, and what the error must name.
type Change = (&'static str, Value, [&'static str; 2]);

fn changes() -> Vec<Change> {
    let paint = "/materials/0/pbrMetallicRoughness";
    let at = |detail| ["node `sheet`, mesh `quad`, primitive 0", detail];
    let texture = json!({ "baseColorTexture": { "index": 0 } });
    vec![
        (paint, json!({ "baseColorFactor": [0.5, 1.4, 0.5, 1.0] }), ["material `paint`", "1.4"]),
        (paint, json!({ "metallicFactor": -1.0 }), ["material `paint`", "metallicFactor"]),
        (paint, texture, ["material `paint`, texture 0", "does not have"]),
        ("/materials/0/emissiveFactor", json!([-1.0, 0.0, 0.0]), ["material `paint`", "-1"]),
        ("/buffers/0/uri", json!("gone.bin"), ["buffer 0", "gone.bin"]),
        ("/buffers/0/uri", json!("data:;base64,@@"), ["buffer 0", "base64"]),
        ("/buffers/0/uri", json!("https://example.org/a.bin"), ["buffer 0", "not a file"]),
        ("/buffers/0/uri", Value::Null, ["buffer 0", "no uri"]),
        ("/buffers/0/byteLength", json!(1000), ["buffer 0", "92 of"]),
        ("/bufferViews/0/byteLength", json!(u64::MAX), at("beyond")),
        ("/bufferViews/1/byteLength", json!(2), at("beyond")),
        ("/accessors/0/type", json!("VEC2"), at("2 numbers")),
        ("/accessors/0/componentType", json!(7), at("type is unknown")),
        ("/accessors/0/count", json!(3), at("TEXCOORD_0")),
        ("/accessors/0/count", json!(u64::MAX), at("POSITION")),
        ("/accessors/0/byteOffset", json!(u64::MAX), at("beyond")),
        ("/bufferViews/0/byteStride", json!(u32::MAX), at("beyond")),
        ("/accessors/1/bufferView", json!(2), at("indices")),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(77), at("does not have")),
        ("/meshes/0/primitives/0/material", json!(7), at("does not have")),
        ("/meshes/0/primitives/0/mode", json!(77), at("mode")),
        ("/meshes/0/primitives", json!([]), ["empty", "export"]),
        ("/nodes/0/children", json!([0]), ["node 0", "ancestor"]),
        ("/nodes/0/mesh", json!(3), ["node `sheet`", "does not have"]),
        ("/scene", json!(1), ["scene", "does not have"]),
        ("/extensionsRequired", json!(["KHR_draco_mesh_compression"]), ["KHR_draco", "without compression"]),
    ]
}

#[test]
fn gltf_errors_name_the_node_the_primitive_or_the_material() {
    for (pointer, value, parts) in changes() {
        let mut document = gltf::document();
        let (parent, key) = pointer.rsplit_once('/').expect("a pointer has a slash");
        document.pointer_mut(parent).expect("it is there")[key] = value;
        let error = gltf::try_read(&document, &[]).expect_err(pointer);
        assert_says(&error, &["a.gltf"]);
        assert_says(&error, &parts);
    }
}

#[test]
fn a_position_in_gltf_that_is_not_a_number_is_an_error() {
    let mut glb = std::fs::read(sample("cornell-box.glb")).expect("it is there");
    let json_length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let first = 20 + json_length + 8;
    glb[first..first + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let error = Files::new(&[("a.glb", &glb)]).read("a.glb").expect_err("NaN");
    assert_says(&error, &["a.glb", "node `floor`, mesh `floor`, primitive 0", "vertex 0", "NaN"]);
}

#[test]
fn scene_file_errors_underline_the_value() {
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl white\nf 1 2 3\n";
    for (text, underlined, parts) in [
        ("colour = 1", "colour", ["line 3", "unknown field `colour`"]),
        ("[material.white]\nreflectence = 1", "reflectence", ["line 4", "expected one of `reflectance`"]),
        ("[material.white]\nreflectance = [0.5, 1.4]", "[0.5, 1.4]", ["line 4", "1.4"]),
        ("[material.white]\nreflectance = []", "[]", ["line 4", "empty"]),
        ("[material.white]\nreflectance = 'red'", "'red'", ["line 4", "expected a number"]),
        ("[material.white]\nexitance = -1", "-1", ["line 4", "exitance of -1"]),
        ("[material.white]\nexitance = 1\nradiance = 2", "2", ["line 5", "both exitance and radiance"]),
        ("[material.white]\nemissivity = 0.5", "0.5", ["line 4", "physics = \"heat\""]),
        ("[material.white]\ntemperature = 300", "300", ["line 4", "physics = \"heat\""]),
        ("[material.white]\nsides = 'three'", "'three'", ["line 4", "`one`"]),
        ("[material.whit]", "whit", ["line 3", "did you mean `white`?"]),
        ("[material.glass]", "glass", ["line 3", "the meshes have `white`"]),
        ("[material.white]\nreflectance = { file = 'gone.png' }", "{ file = 'gone.png' }", ["line 4", "gone.png"]),
        ("[[mesh]]\nfile = 'gone.obj'", "'gone.obj'", ["line 4", "gone.obj"]),
        ("[[mesh]]\nfile = 'a.toml'", "'a.toml'", ["line 4", "cannot be a mesh"]),
        ("unit = 'furlong'", "'furlong'", ["line 3", "m, cm, mm, km, ft, in"]),
        ("scale = [1, 0, 1]", "[1, 0, 1]", ["line 3", "scaled"]),
        ("translate = [nan, 0, 0]", "[nan, 0, 0]", ["line 3", "finite"]),
        ("rotate = { axis = [0, 0, 0], degrees = 9 }", "[0, 0, 0]", ["line 3", "direction"]),
        ("material = '*'", "'*'", ["line 3", "no name of a material"]),
        ("[camera]\neye = [0, 0, 0]\ntarget = [0, 2, 0]\nfov = 40", "[0, 2, 0]", ["line 5", "up direction"]),
        ("[camera]\neye = [0, 0, 0]\ntarget = [0, 0, 1]\nfov = 180", "180", ["line 6", "180°"]),
    ] {
        let toml = format!("[[mesh]]\nfile = 'a.obj'\n{text}\n");
        let error = Files::new(&[("a.obj", obj), ("a.toml", toml.as_bytes())]).read("a.toml").expect_err(text);
        assert_says(&error, &["a.toml"]);
        assert_says(&error, &parts);
        let snippet = error.snippet.as_ref().expect("it can be underlined");
        assert_eq!(&snippet.text[snippet.span.clone()], underlined, "{error}");
    }
}

#[test]
fn a_scene_file_without_meshes_is_empty() {
    let error = Files::new(&[("a.toml", b"unit = 'm'")]).read("a.toml").expect_err("empty");
    assert_says(&error, &["a.toml", "empty", "[[mesh]]"]);
}

#[test]
fn every_cut_of_a_glb_is_an_error() {
    let glb = std::fs::read(sample("cornell-box.glb")).expect("it is there");
    for length in (0..glb.len()).step_by(97) {
        let error = Files::new(&[("a.glb", &glb[..length])]).read("a.glb").expect_err("cut off");
        assert_says(&error, &["a.glb"]);
    }
}

#[test]
fn ply_errors_name_the_face() {
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    for (payload, parts) in [
        ("0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", ["face 0", "vertex 7"]),
        ("0 0 0\n1 0 0\n0 1 0\n3 0 1 -2\n", ["face 0", "negative"]),
        ("1e999 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", ["face 0", "not finite"]),
        ("nan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", ["Line 10", "nan"]),
        ("0 0 0\n1 0 0\n0 1 0\n", ["a.ply", "cut off"]),
    ] {
        let ply = format!("{header}{payload}");
        let error = Files::new(&[("a.ply", ply.as_bytes())]).read("a.ply").expect_err(payload);
        assert_says(&error, &["a.ply"]);
        assert_says(&error, &parts);
    }
}

proptest! {
    /// Whatever bytes are changed, reading ends with a scene or an error.
    #[test]
    fn damaged_files_do_not_panic(
        which in 0_usize..8,
        damage in prop::collection::vec((0.0..1.0_f64, any::<u8>()), 1..8),
    ) {
        let mut files = samples::all();
        files.extend([("a.ply", geometry::PLY.to_vec()), ("a.stl", geometry::stl())]);
        let (name, mut bytes) = files.swap_remove(which);
        for (at, byte) in damage {
            let at = (at * bytes.len() as f64) as usize;
            bytes[at] = byte;
        }
        let files = Files::new(&[(name, &bytes)]);
        let _ = read_raw(&files.path(name));
    }
}

use super::{Files, assert_close, material, png, rgb};
use glam::DVec3;
use hatbox::io::read::EXAMPLE;
use hatbox::scene::{Physics, STEFAN_BOLTZMANN};
use std::path::Path;

const OBJ: &[u8] =
    b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\no floor\nusemtl floor\nf 1 2 3 4\no stove\nusemtl stove\nf 1 4 3\n";

fn read(toml: &str) -> hatbox::io::RawScene {
    let picture = png(1, &[[255, 0, 188]]);
    let files = Files::new(&[("box.obj", OBJ), ("floor.png", &picture), ("scene.toml", toml.as_bytes())]);
    files.read("scene.toml").expect("right")
}

#[test]
fn the_example_shows_every_key_and_is_right() {
    let scene = read(EXAMPLE);
    assert_eq!(scene.physics, Physics::Heat);
    assert_eq!(scene.mesh.groups, ["floor", "stove", "second floor", "second stove"]);
    let floor = material(&scene, "floor");
    assert_close(rgb(&floor.reflectance, 0.5, 0.5), [0.9, 0.0, 0.9 * 0.502_886], 1e-5);
    assert_close(rgb(&floor.exitance, 0.5, 0.5), [10.0; 3], 1e-15);
    let stove = material(&scene, "stove");
    assert_close(rgb(&stove.reflectance, 0.0, 0.0), [0.1; 3], 1e-12);
    assert_close(rgb(&stove.exitance, 0.0, 0.0), [0.9 * STEFAN_BOLTZMANN * 400.0_f64.powi(4); 3], 1e-12);
    let camera = scene.camera.expect("it has one");
    assert!((camera.eye - DVec3::new(0.5, 0.5, 2.5)).length() < 1e-12);
    assert!((camera.fov_y.to_degrees() - 40.0).abs() < 1e-12);
}

#[test]
fn meshes_are_scaled_turned_and_moved_in_their_units() {
    let scene = read(EXAMPLE);
    // 1 cm, and 2 × 1 mm.
    let area = |k: usize| scene.mesh.patch(k).area();
    assert!((area(0) - 1e-4).abs() < 1e-15 && (area(2) - 4e-6).abs() < 1e-15);
    // The corner (1, 1, 0) mm, doubled, turned about y by 90° to −z, and moved by 300 cm.
    let corner = scene.mesh.patch(2).corners()[2];
    assert!((corner - DVec3::new(3.0, 0.002, -0.002)).length() < 1e-12, "{corner}");
}

#[test]
fn a_mirrored_mesh_keeps_its_front() {
    let toml = "[[mesh]]\nfile = 'box.obj'\nscale = [1, 1, -1]\n[[mesh]]\nfile = 'box.obj'\nscale = [-2, 1, 1]\n";
    let scene = read(toml);
    assert_eq!(scene.mesh.patch(0).normal(), DVec3::NEG_Z);
    assert_eq!(scene.mesh.patch(2).normal(), DVec3::Z);
    assert!((scene.mesh.area() - 1.5 - 3.0).abs() < 1e-12);
}

/// All faces of all PLY and STL files were of one material.
#[test]
fn meshes_without_materials_are_given_one_each() {
    let stl = b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n";
    let toml = "[[mesh]]\nfile = 'a.stl'\nmaterial = 'wall'\n[[mesh]]\nfile = 'a.stl'\ntranslate = [0, 0, 1]\n\
        material = 'lamp'\n[[mesh]]\nfile = 'box.obj'\nmaterial = 'paint'\n[material.lamp]\nexitance = 5\n[material.wall]\n\
        reflectance = 0.2\n";
    let files = Files::new(&[("box.obj", OBJ), ("a.stl", stl), ("scene.toml", toml.as_bytes())]);
    let scene = files.read("scene.toml").expect("right");
    let of = |cell: usize| &scene.materials[scene.mesh.cells[cell].material as usize];
    let found = [0, 1, 2, 3].map(|cell| (of(cell).name.as_str(), of(cell).reflectance.uniform(0)));
    assert_eq!(found, [("wall", Some(0.2)), ("lamp", Some(0.5)), ("paint", Some(0.5)), ("paint", Some(0.5))]);
    assert_eq!(of(1).exitance.uniform(0), Some(5.0));
    let warned = |name: &str| scene.warnings.iter().filter(|text| text.contains(name)).count();
    assert_eq!(["`lamp`", "`paint`", "`wall`", "no materials"].map(warned), [1, 1, 0, 0], "{:?}", scene.warnings);
}

#[test]
fn a_temperature_for_all_uses_the_emissivity_of_each() {
    let toml = "physics = 'heat'\n[[mesh]]\nfile = 'box.obj'\n[material.'*']\ntemperature = 300\nsides = 'two'\n\
        [material.stove]\nemissivity = [0.2, 0.4]\n[material.floor]\nreflectance = { file = 'floor.png', srgb = false }\n";
    let scene = read(toml);
    let black = STEFAN_BOLTZMANN * 300.0_f64.powi(4);
    let stove = material(&scene, "stove");
    assert_close(rgb(&stove.exitance, 0.0, 0.0), [0.2 * black, 0.4 * black, 0.4 * black], 1e-12);
    assert!(stove.two_sided);
    let floor = material(&scene, "floor");
    assert_close(rgb(&floor.exitance, 0.5, 0.5), [0.0, black, (1.0 - 188.0 / 255.0) * black], 1e-6);
    assert_eq!(floor.exitance.bands(), 3);
}

#[test]
fn faces_without_sides_only_block() {
    let scene = read("[[mesh]]\nfile = 'box.obj'\n[material.stove]\nsides = 'none'\n");
    assert!(material(&scene, "stove").blocks_only && !material(&scene, "floor").blocks_only);
    let hatbox::io::RawScene { mesh, materials, physics, .. } = scene;
    let built = hatbox::scene::Scene::new(mesh, materials, physics, None).expect("a scene");
    assert_eq!((built.surfaces.len(), built.mesh.cells.len()), (2, 1));
}

#[test]
fn the_guide_shows_every_key() {
    let guide = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../book/scene-files.md");
    let text = std::fs::read_to_string(guide).expect("a file of the repository");
    assert!(text.contains(EXAMPLE.trim_end()), "copy example.toml into book/scene-files.md");
}

/// The mesh has no `.mtl`; what the scene file says of a material is not assumed.
#[test]
fn nothing_is_said_to_be_assumed_that_the_scene_file_gives() {
    let mesh = "[[mesh]]\nfile = \"box.obj\"\n";
    let said = |text: &str| read(&format!("{mesh}{text}")).warnings;
    assert_eq!(said("").len(), 2, "{:?}", said(""));
    let [stove] = &said("[material.floor]\nreflectance = 0.2\n")[..] else { panic!("the stove's") };
    assert!(stove.contains("`stove`") && stove.contains("assumed"), "{stove}");
    assert_eq!(said("[material.\"*\"]\nreflectance = 0.2\n"), [""; 0]);
    assert_eq!(said("[material.\"*\"]\nexitance = 2.0\n").len(), 2, "the reflectance is still assumed");
}

//! The scenes that come with the project are what their generator makes, and closed where they are meant to be.

use super::{assert_close, data, material, rgb, sample, samples};
use glam::DVec3;
use hatbox::io::{RawScene, read_raw};
use std::collections::HashMap;
use std::f64::consts::PI;

fn read(name: &str) -> RawScene {
    let scene = read_raw(&sample(name)).expect("a sample scene is right");
    assert_eq!(scene.warnings, [""; 0], "{name}");
    scene
}

#[test]
fn the_files_are_what_the_generator_makes() {
    let files = samples::all();
    for (name, bytes) in &files {
        let found = std::fs::read(sample(name)).expect("run `cargo run -p hatbox --example make_scenes`");
        assert!(found == *bytes, "{name} differs: run `cargo run -p hatbox --example make_scenes`");
    }
    let folder = std::fs::read_dir(sample("")).expect("the folder is there");
    assert_eq!(folder.count(), files.len(), "a file in scenes/ has no generator");
}

#[test]
fn the_cornell_box_is_the_published_one() {
    let (glb, obj) = (read("cornell-box.glb"), read_raw(&data("cornell.obj")).expect("right"));
    assert_eq!((glb.mesh.cells.len(), obj.mesh.cells.len()), (38, 38));
    let (area, published) = (glb.mesh.area(), obj.mesh.area() * 1e-6);
    assert!((area / published - 1.0).abs() < 1e-6, "{area} m² instead of {published}");
    for name in ["white", "red", "green", "light"] {
        let (found, expected) = (material(&glb, name), material(&obj, name));
        assert_close(rgb(&found.reflectance, 0.0, 0.0), rgb(&expected.reflectance, 0.0, 0.0), 1e-6);
        assert_close(rgb(&found.exitance, 0.0, 0.0), rgb(&expected.exitance, 0.0, 0.0), 1e-6);
        assert!(!found.two_sided);
    }
    assert_close(rgb(&material(&glb, "light").exitance, 0.0, 0.0), [17.0 * PI, 12.0 * PI, 4.0 * PI], 1e-6);
    let groups = ["floor", "ceiling", "back", "green_right", "red_left", "light", "short_block", "tall_block"];
    assert_eq!(glb.mesh.groups, groups);
}

#[test]
fn the_cornell_box_faces_inwards_its_blocks_outwards_and_its_camera_the_back() {
    let scene = read("cornell-box.glb");
    let block_centers =
        [("short_block", DVec3::new(0.186, 0.08, 0.169)), ("tall_block", DVec3::new(0.368, 0.16, 0.351))];
    let room = DVec3::new(0.278, 0.274, 0.28);
    for (k, cell) in scene.mesh.cells.iter().enumerate() {
        let group = scene.mesh.groups[cell.group as usize].as_str();
        let patch = scene.mesh.patch(k);
        let block = block_centers.iter().find(|(name, _)| *name == group);
        let inwards = patch.normal().dot(block.map_or(room, |&(_, center)| center) - patch.center()) > 0.0;
        assert_eq!(inwards, block.is_none(), "cell {k} of {group}");
        assert!(scene.mesh.normals[k][0].dot(patch.normal()) > 0.999, "the stored normal of cell {k}");
    }
    let camera = scene.camera.expect("it has one");
    assert!((camera.eye - DVec3::new(0.278, 0.273, -0.8)).length() < 1e-6);
    assert!((camera.target - camera.eye - DVec3::Z).length() < 1e-6 && (camera.up - DVec3::Y).length() < 1e-6);
    assert!((camera.fov_y.to_degrees() - 39.3).abs() < 0.05);
}

/// Asserts that every edge is met by its reverse, so that nothing leaks, and returns the volume enclosed by
/// inward-facing cells.
fn closed_volume(scene: &RawScene) -> f64 {
    let mut edges: HashMap<[[u64; 3]; 2], i32> = HashMap::new();
    let mut volume = 0.0;
    for k in 0..scene.mesh.cells.len() {
        let patch = scene.mesh.patch(k);
        volume -= patch.area() * patch.normal().dot(patch.center()) / 3.0;
        let corners: Vec<_> = patch.corners().iter().map(|c| c.to_array().map(f64::to_bits)).collect();
        for (i, &from) in corners.iter().enumerate() {
            let to = corners[(i + 1) % corners.len()];
            *edges.entry([from, to]).or_default() += 1;
            *edges.entry([to, from]).or_default() -= 1;
        }
    }
    assert!(edges.values().all(|&balance| balance == 0), "an edge is open");
    volume
}

#[test]
fn the_rooms_and_the_cube_are_closed_and_face_inwards() {
    let room = 4.0 * 2.6 * 4.0;
    for (name, expected) in [
        ("two-rooms.glb", 2.0 * room + 0.2 * 0.9 * 2.1),
        ("two-rooms-walled.glb", 2.0 * room),
        ("cube.obj", 1.0),
        ("cube.toml", 1.0),
    ] {
        let volume = closed_volume(&read(name));
        assert!((volume / expected - 1.0).abs() < 1e-6, "{name}: {volume} m³ instead of {expected}");
    }
}

#[test]
fn only_the_first_room_has_a_lamp() {
    let scene = read("two-rooms.glb");
    let lit: Vec<_> = (0..scene.mesh.cells.len())
        .filter(|&k| !scene.materials[scene.mesh.cells[k].material as usize].exitance.is_zero())
        .collect();
    let (area, east) = lit.iter().fold((0.0, 0.0_f64), |(area, east), &k| {
        let patch = scene.mesh.patch(k);
        (area + patch.area(), patch.corners().iter().fold(east, |east, c| east.max(c.x)))
    });
    assert!((area - 0.9).abs() < 1e-6 && east < 4.0, "{area} m² of lamp up to x = {east}");
}

#[test]
fn the_cube_is_the_reference_case_and_its_scene_file_overrides_it() {
    let cube = read("cube.obj");
    assert_eq!(cube.mesh.cells.len(), 6, "quads stay quads");
    assert_eq!(cube.mesh.groups.len(), 6);
    assert_close(rgb(&material(&cube, "ceiling").exitance, 0.0, 0.0), [1.0; 3], 1e-15);
    assert_close(rgb(&material(&cube, "white").reflectance, 0.0, 0.0), [0.5; 3], 1e-15);
    let brighter = read("cube.toml");
    for name in ["ceiling", "white"] {
        assert_close(rgb(&material(&brighter, name).reflectance, 0.0, 0.0), [0.8; 3], 1e-15);
    }
    assert_close(rgb(&material(&brighter, "ceiling").exitance, 0.0, 0.0), [1.0; 3], 1e-15);
    assert!(material(&brighter, "white").exitance.is_zero());
}

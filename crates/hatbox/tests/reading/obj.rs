use super::{Files, assert_close, material, png, rgb};
use glam::{DVec2, DVec3};
use hatbox::element::Shape;
use std::f64::consts::PI;

#[test]
fn quads_stay_polygons_are_cut_and_lines_are_skipped() {
    let obj = b"v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nv 1 2 0\n\
        o house\nf 1 2 3 4\ng roof\nf -3 -1 -2\no both\nf 1 2 3 5 4\nl 1 2\n";
    let files = Files::new(&[("house.obj", obj)]);
    let scene = files.read("house.obj").expect("right");
    let shapes: Vec<_> = scene.mesh.cells.iter().map(|cell| cell.shape).collect();
    assert_eq!(shapes, [Shape::Quad, Shape::Triangle, Shape::Triangle, Shape::Triangle, Shape::Triangle]);
    assert_eq!(scene.mesh.groups, ["house", "roof", "both"]);
    assert!((scene.mesh.area() - (2.0 + 1.0 + 3.0)).abs() < 1e-12);
    assert!((0..5).all(|k| scene.mesh.patch(k).normal() == DVec3::Z), "cutting keeps the orientation");
    let told = scene.warnings.iter().any(|warning| warning.contains("line 12") && warning.contains("`l`"));
    assert!(told, "{:?}", scene.warnings);
}

#[test]
fn a_byte_order_mark_is_no_part_of_a_text() {
    let mtl = b"\xEF\xBB\xBFnewmtl red\nKd 0.5 0.1 0.1\n";
    let obj = b"\xEF\xBB\xBFmtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n";
    let toml = b"\xEF\xBB\xBF[[mesh]]\nfile = \"a.obj\"\n";
    let files = Files::new(&[("a.obj", obj), ("a.mtl", mtl), ("a.toml", toml)]);
    for name in ["a.obj", "a.toml"] {
        let scene = files.read(name).expect("right");
        assert_eq!(scene.warnings, [""; 0], "{name}");
        assert_close(rgb(&material(&scene, "red").reflectance, 0.0, 0.0), [0.5, 0.1, 0.1], 1e-15);
    }
}

#[test]
fn corners_keep_their_normals_and_texture_coordinates() {
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.75\nvt 1\nvn 0 0 3\nf 1/1/1 2/2/1 3/1/1\nf 1 2 3\n";
    let scene = Files::new(&[("a.obj", obj)]).read("a.obj").expect("right");
    assert_eq!(scene.mesh.uvs[0][..2], [DVec2::new(0.25, 0.25), DVec2::new(1.0, 1.0)], "v runs down");
    assert_eq!(scene.mesh.normals, [[DVec3::Z; 4], [DVec3::ZERO; 4]]);
}

#[test]
fn materials_are_kd_times_its_map_and_pi_ke() {
    let mtl = b"newmtl tiles\nKd 0.5 1 1\nmap_Kd two tiles.png\nKe 1 2 3\n\nnewmtl gray\nKd 0.25\n";
    let obj = b"mtllib my materials.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl tiles\nf 1 2 3\nusemtl gray\nf 3 2 1\n";
    let tiles = png(2, &[[255, 255, 255], [0, 188, 255]]);
    let files = Files::new(&[("a.obj", obj), ("my materials.mtl", mtl), ("two tiles.png", &tiles)]);
    let scene = files.read("a.obj").expect("right");
    assert_eq!(scene.warnings, [""; 0]);
    let tiles = material(&scene, "tiles");
    assert_close(rgb(&tiles.reflectance, 0.25, 0.5), [0.5, 1.0, 1.0], 1e-6);
    assert_close(rgb(&tiles.reflectance, 0.75, 0.5), [0.0, 0.502_886, 1.0], 1e-5);
    assert_close(rgb(&tiles.exitance, 0.0, 0.0), [PI, 2.0 * PI, 3.0 * PI], 1e-15);
    assert_close(rgb(&material(&scene, "gray").reflectance, 0.0, 0.0), [0.25; 3], 1e-15);
}

#[test]
fn what_has_no_material_is_gray_with_a_warning() {
    let obj = b"mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl brick\nf 3 2 1\n";
    let scene = Files::new(&[("a.obj", obj)]).read("a.obj").expect("a missing .mtl is no error");
    assert_eq!(scene.warnings.len(), 3, "{:?}", scene.warnings);
    for (warning, part) in scene.warnings.iter().zip(["gone.mtl", "`default`", "`brick`"]) {
        assert!(warning.contains(part) && warning.contains("a.obj"), "{warning}");
    }
    assert_close(rgb(&material(&scene, "brick").reflectance, 0.0, 0.0), [0.5; 3], 1e-15);
}

//! Formats that know no materials.

use super::{Files, assert_close, rgb};
use glam::DVec3;
use hatbox::element::Shape;

pub(crate) const PLY: &[u8] = b"ply\nformat ascii 1.0\ncomment a house\nelement vertex 5\nproperty double x\n\
    property double y\nproperty double z\nproperty uchar red\nelement face 2\n\
    property list uchar int vertex_indices\nend_header\n\
    0 0 0 9\n2 0 0 9\n2 1 0.0 9\n0 1 0 9\n1 2 0 9\n4 0 1 2 3\n5 0 1 2 4 3\n";

const CORNERS: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// A binary STL that begins like an ASCII one.
pub(crate) fn stl() -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes[..6].copy_from_slice(b"solid ");
    bytes.extend(1_u32.to_le_bytes());
    bytes.extend([0; 12]);
    bytes.extend(CORNERS.iter().flatten().flat_map(|x| x.to_le_bytes()));
    bytes.extend([0; 2]);
    bytes
}

#[test]
fn ply_keeps_quads_and_cuts_polygons() {
    let scene = Files::new(&[("house.ply", PLY)]).read("house.ply").expect("right");
    assert_eq!(scene.mesh.cells[0].shape, Shape::Quad);
    assert_eq!(scene.mesh.groups, ["house"]);
    assert!((scene.mesh.area() - 5.0).abs() < 1e-12);
    assert_close(rgb(&scene.materials[0].reflectance, 0.0, 0.0), [0.5; 3], 1e-15);
    assert!(scene.warnings[0].contains("house.ply") && scene.warnings[0].contains("no materials"));
}

#[test]
fn stl_is_read_as_text_and_as_bytes_whatever_its_header_says() {
    let vertices = CORNERS.map(|[x, y, z]| format!("vertex {x} {y} {z}\n")).concat();
    let text = format!("solid a\nfacet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\nendsolid a\n");
    for content in [text.as_bytes(), &stl()] {
        let scene = Files::new(&[("a.stl", content)]).read("a.stl").expect("right");
        assert_eq!(scene.mesh.cells.len(), 1);
        assert_eq!((scene.mesh.area(), scene.mesh.patch(0).normal()), (1.0, DVec3::Z));
    }
}

/// Their triangles were taken for the face, without a word.
#[test]
fn faces_that_cross_themselves_are_named() {
    let corners = ["0 0 0", "1 0 0", "0 1 0", "1 1 0", "2 3 0"];
    let obj = |face: &str| {
        let vertices = corners.map(|corner| format!("v {corner}\n")).concat();
        format!("o kite\n{vertices}f 1 2 3\n{face}\n{face}\n")
    };
    let ply = |count: usize, face: &str| {
        let header = format!(
            "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z"
        );
        format!(
            "{header}\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n{}\n{face}\n",
            corners[..count].join("\n")
        )
    };
    for (name, text, crossing) in [
        ("bow.obj", obj("f 1 2 3 4"), "line 8 (object `kite`): 2 faces cross themselves"),
        ("star.obj", obj("f 1 2 3 4 5"), "line 8 (object `kite`): 2 faces cross themselves"),
        ("bow.ply", ply(4, "4 0 1 2 3"), "face 0: 1 face crosses itself"),
        (
            "upright.obj",
            "v 0 0 0\nv 1 0 0\nv 0 0 1\nv 1 0 1\nf 1 2 3 4\n".to_owned(),
            "line 5 (object `upright`): 1 face",
        ),
        ("house.obj", obj("f 1 2 4 5 3"), ""),
        ("square.ply", ply(4, "4 0 1 3 2"), ""),
    ] {
        let scene = Files::new(&[(name, text.as_bytes())]).read(name).expect("right");
        let told = scene.warnings.iter().find(|warning| warning.contains("cross"));
        assert_eq!(told.is_some(), !crossing.is_empty(), "{name}: {:?}", scene.warnings);
        assert!(told.is_none_or(|told| told.contains(crossing)), "{name}: {told:?}");
    }
}

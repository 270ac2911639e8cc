//! A hard shadow.

use glam::DVec3;
use hatbox::mesh::Mesh;
use hatbox::scene::{Material, Physics, Quantity, Scene};

/// Half the edge of the lamp, which is a metre above the floor.
pub(crate) const LAMP: f64 = 0.05;
/// Half the edge of the sheet, and its height.
pub(crate) const SHEET: [f64; 2] = [0.33, 0.3];
/// R of the floor.
pub(crate) const FLOOR: f64 = 0.5;
/// B⁰ of the lamp.
pub(crate) const EXITANCE: f64 = 100.0;

/// A floor under a small lamp, with a sheet between them that throws a hard shadow. All light on the floor is the lamp's:
/// what the floor reflects is absorbed.
pub(crate) fn scene() -> Scene {
    let mut mesh = Mesh::default();
    let square = |z: f64, s: f64, up: bool| {
        let corners = [(-s, -s), (s, -s), (s, s), (-s, s)].map(|(x, y)| DVec3::new(x, y, z));
        if up { corners } else { [corners[0], corners[3], corners[2], corners[1]] }
    };
    super::face(&mut mesh, &square(0.0, 1.0, true), 0);
    super::face(&mut mesh, &square(SHEET[1], SHEET[0], true), 2);
    super::face(&mut mesh, &square(1.0, LAMP, false), 1);
    let lamp = Material { exitance: Quantity::gray(EXITANCE), ..Material::diffuse("lamp", 0.0) };
    let materials = vec![Material::diffuse("floor", FLOOR), lamp, Material::diffuse("sheet", 0.0)];
    Scene::new(mesh, materials, Physics::Light, None).expect("valid")
}

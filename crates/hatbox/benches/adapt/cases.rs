//! The scenes, and where the truth about each is from.

#[path = "../../tests/meshes/mod.rs"]
#[expect(dead_code, reason = "not every mesh is needed here")]
mod meshes;

use crate::Result;
use crate::truth::Truth;
use glam::DVec3;
use hatbox::adapt::Focus;
use hatbox::io::read_scene;
use hatbox::mesh::Mesh;
use hatbox::scene::{Material, Physics, Quantity, Scene};
use std::path::Path;

/// A scene with its truth.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) scene: fn() -> Result<Scene>,
    pub(crate) truth: fn(&Scene) -> Result<Truth>,
    /// Whether all bases are compared on it.
    pub(crate) ladder: bool,
}

pub(crate) const CASES: [Case; 5] = [
    Case { name: "cube", scene: || sample("cube.toml"), truth: Truth::gathered, ladder: false },
    Case {
        name: "Cornell box",
        scene: || sample("../crates/hatbox/tests/data/cornell.obj"),
        truth: Truth::of_the_cornell_box,
        ladder: true,
    },
    Case { name: "two rooms", scene: || sample("two-rooms.glb"), truth: Truth::gathered, ladder: false },
    Case { name: "sheet in a room", scene: sheet_in_a_room, truth: Truth::gathered, ladder: false },
    Case { name: "hard shadow", scene: hard_shadow, truth: Truth::gathered, ladder: true },
];

fn sample(name: &str) -> Result<Scene> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    Ok(read_scene(&folder.join(name))?.0)
}

/// The second of the two rooms.
const DARK_ROOM: [DVec3; 2] = [DVec3::new(4.2, -1.0, -1.0), DVec3::new(9.0, 4.0, 5.0)];

pub(crate) fn dark_room() -> Focus {
    Focus::Box(DARK_ROOM[0], DARK_ROOM[1])
}

pub(crate) fn is_in_the_dark_room(p: DVec3) -> bool {
    p.cmpge(DARK_ROOM[0]).all() && p.cmple(DARK_ROOM[1]).all()
}

fn scene(mesh: Mesh, materials: Vec<Material>) -> Result<Scene> {
    Ok(Scene::new(mesh, materials, Physics::Light, None)?)
}

fn lamp(exitance: f64) -> Material {
    Material { exitance: Quantity::gray(exitance), ..Material::diffuse("lamp", 0.0) }
}

fn square(s: f64, z: f64, up: bool) -> [DVec3; 4] {
    let corners = [(-s, -s), (s, -s), (s, s), (-s, s)].map(|(x, y)| DVec3::new(x, y, z));
    if up { corners } else { [corners[0], corners[3], corners[2], corners[1]] }
}

/// A glowing ceiling, and a sheet in the middle of the room that throws a wide penumbra.
fn sheet_in_a_room() -> Result<Scene> {
    let mut mesh = meshes::room(DVec3::ONE, |_| false);
    mesh.cells[1].material = 1;
    let middle = DVec3::new(0.5, 0.5, 0.0);
    meshes::face(&mut mesh, &square(0.2, 0.4, true).map(|p| p + middle), 2);
    let sheet = Material { two_sided: true, ..Material::diffuse("sheet", 0.3) };
    scene(mesh, vec![Material::diffuse("walls", 0.5), lamp(1.0), sheet])
}

/// A floor, a small lamp, and a sheet between them: the shadow's border is a hundredth of the floor wide. Nothing but the
/// floor reflects, so that the truth is the lamp's direct light.
fn hard_shadow() -> Result<Scene> {
    let mut mesh = Mesh::default();
    meshes::face(&mut mesh, &square(1.0, 0.0, true), 0);
    meshes::face(&mut mesh, &square(0.33, 0.3, true), 2);
    meshes::face(&mut mesh, &square(0.02, 1.0, false), 1);
    scene(mesh, vec![Material::diffuse("floor", 0.5), lamp(100.0), Material::diffuse("sheet", 0.0)])
}

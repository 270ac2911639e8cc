//! Closed rooms with things in them, of one material.

use super::{CUBE, face};
use glam::DVec3;
use hatbox::mesh::Mesh;
use hatbox::scene::{Material, Physics, Scene};

/// A quad's four corners.
pub(crate) type Corners = [DVec3; 4];

/// A parallelogram as n × n faces.
pub(crate) fn grid(mesh: &mut Mesh, [a, b, _, d]: Corners, n: usize) {
    let at = |i: usize, j: usize| a + (b - a) * (i as f64 / n as f64) + (d - a) * (j as f64 / n as f64);
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        face(mesh, &[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)], 0);
    }
}

/// The faces of a box from corner to corner, seen from inside.
pub(crate) fn cuboid(from: DVec3, to: DVec3) -> Vec<Corners> {
    CUBE.iter().map(|quad| quad.map(|p| from + DVec3::from(p) * (to - from))).collect()
}

/// The same faces seen from the other side.
pub(crate) fn outwards(faces: Vec<Corners>) -> Vec<Corners> {
    faces.into_iter().map(|[a, b, c, d]| [a, d, c, b]).collect()
}

/// An L-shaped room, [0,2] × [0,1] and [0,1] × [1,2] with a height of 1, as unit squares.
pub(crate) fn l_room() -> Vec<Corners> {
    let floor_plan = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)];
    let inside = |x: f64, y: f64| floor_plan.contains(&(x, y));
    let mut faces = Vec::new();
    for (x, y) in floor_plan {
        let from = DVec3::new(x, y, 0.0);
        let walls = cuboid(from, from + DVec3::ONE);
        let neighbours = [(x, y - 1.0), (x, y + 1.0), (x - 1.0, y), (x + 1.0, y)];
        faces.extend(&walls[..2]);
        faces.extend(walls[2..].iter().zip(neighbours).filter(|(_, (x, y))| !inside(*x, *y)).map(|(wall, _)| *wall));
    }
    faces
}

/// Every face as n × n.
pub(crate) fn divided(faces: &[Corners], n: usize) -> Scene {
    let mut mesh = Mesh::default();
    for &corners in faces {
        grid(&mut mesh, corners, n);
    }
    scene(mesh)
}

/// A scene of one material.
pub(crate) fn scene(mesh: Mesh) -> Scene {
    Scene::new(mesh, vec![Material::diffuse("wall", 0.5)], Physics::Light, None).expect("a valid room")
}

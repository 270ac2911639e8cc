//! What stands in rooms.

use super::face;
use glam::DVec3;
use hatbox::mesh::Mesh;

/// Adds the faces of a body, seen from outside: those of the unit cube, each point of which is moved somewhere.
pub(crate) fn body(mesh: &mut Mesh, faces: &[[[f64; 3]; 4]], moved: impl Fn(DVec3) -> DVec3) {
    for corners in faces {
        let mut corners = corners.map(|p| moved(DVec3::from(p)));
        corners.reverse();
        face(mesh, &corners, 0);
    }
}

/// Adds both sides of a sheet.
pub(crate) fn sheet(mesh: &mut Mesh, mut corners: [DVec3; 4]) {
    face(mesh, &corners, 0);
    corners.reverse();
    face(mesh, &corners, 0);
}

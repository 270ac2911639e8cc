//! Whether a scene is closed by its topology: then no rays need look for a way out.
//!
//! If two cells meet at each edge and run through it in opposite directions, the mesh is a closed surface, and every point
//! of space that is not on it has a winding number w, which is 0 far away and greater by one in front of a face than
//! behind it. In front of all faces that hang together it is the same. Where it is 1 in front of all of them, no ray from
//! a front can get away, which would take it to w = 0 without a crossing, and none can meet a back, behind which w = 0.
//!
//! A ray from a part that hangs together counts w: the fronts that it crosses, less the backs. Through an edge it may count
//! twice, so three rays must agree. Two things are taken for granted, as the scene makes them to its tolerance: that cells meet
//! where their vertices are one, and that parts do not cross each other, since crossing faces are cut and then have edges of four.
//! Sheets of two sides are left to rays: their sides hang together and have different numbers in front of them.

use super::Geometry;
use super::closure::{cosine_ray, receiving_sides};
use crate::mesh::{Mesh, Topology, UnionFind};
use crate::quadrature::sequence::{hash, point};
use std::cell::Cell;

/// Rays that have to agree.
const RAYS: u32 = 3;

/// Whether the topology says that light from every cell only meets fronts of cells.
pub(crate) fn is_sealed(geometry: &Geometry<'_>) -> bool {
    let mesh = &geometry.scene.mesh;
    // What only blocks light has no cells; sheets have two.
    if receiving_sides(geometry.scene).iter().any(|&sides| sides != [true, false]) {
        return false;
    }
    parts(mesh).is_some_and(|cells| cells.into_iter().all(|cell| winding(geometry, cell) == Some(1)))
}

/// One cell of each part of a closed surface that hangs together; `None` if the mesh is no closed surface.
fn parts(mesh: &Mesh) -> Option<Vec<usize>> {
    let topology = Topology::new(mesh);
    let mut parts = UnionFind::new(mesh.cells.len());
    for edge in 0..topology.edges() {
        let [a, b] = topology.sides(edge) else { return None };
        if a.forward == b.forward || a.cell == b.cell {
            return None;
        }
        parts.join(a.cell as usize, b.cell as usize);
    }
    Some((0..mesh.cells.len()).filter(|&cell| parts.find(cell) == cell).collect())
}

/// The winding number in front of a cell; `None` if rays do not agree about it.
fn winding(geometry: &Geometry<'_>, cell: usize) -> Option<i64> {
    let (patch, surface) = (geometry.scene.mesh.patch(cell), geometry.scene.mesh.cells[cell].surface);
    let along = |k: u32| {
        let (origin, direction) = cosine_ray(&patch, point(hash(0x7365_616c, cell as u64), k));
        let count = Cell::new(0);
        // No crossing is taken, so that all are offered.
        let passed = |id: u32, front: bool| {
            if id != surface {
                count.set(count.get() + if front { 1 } else { -1 });
            }
            false
        };
        let hit = geometry.blockers.closest_hit(origin, direction, f64::INFINITY, passed);
        debug_assert!(hit.is_none(), "nothing was taken");
        count.get()
    };
    let first = along(0);
    (1..RAYS).all(|k| along(k) == first).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::super::closure::measured;
    use super::*;
    use crate::element::{ALL, Shape};
    use crate::mesh::Cell as Face;
    use crate::progress::Silent;
    use crate::scene::{Material, Physics, Scene};
    use crate::space::FunctionSpace;
    use crate::visibility::Bvh;
    use glam::DVec3;
    use std::sync::{Arc, OnceLock};

    /// A box from corner to corner, its lit sides inside or outside, without the faces of `left_out`.
    fn add_box(mesh: &mut Mesh, [from, to]: [f64; 2], inside: bool, left_out: &[usize]) {
        const FACES: [[usize; 4]; 6] =
            [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
        let at = |k: usize| DVec3::new((k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2) as f64) * (to - from) + from;
        for (k, mut face) in FACES.into_iter().enumerate().filter(|(k, _)| !left_out.contains(k)) {
            if !inside {
                face.reverse();
            }
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(face.map(at));
            let vertices = [0, 1, 2, 3].map(|k| first + k);
            let group = u32::from(k == 0);
            mesh.cells.push(Face { shape: Shape::Quad, vertices, material: 0, group, surface: 0 });
        }
    }

    /// Whether a scene is sealed; if it is, rays have to agree.
    fn sealed(boxes: &[([f64; 2], bool, &[usize])], material: Material) -> bool {
        let mut mesh = Mesh { groups: vec!["a".into(), "b".into()], ..Mesh::default() };
        for &(corners, inside, left_out) in boxes {
            add_box(&mut mesh, corners, inside, left_out);
        }
        let scene = Scene::new(mesh, vec![material], Physics::Light, None).expect("a scene");
        let space = FunctionSpace::broken(&scene.mesh, &ALL[0]).expect("a space");
        let (panels, blockers) = (OnceLock::new(), Arc::new(Bvh::of_surfaces(&scene.surfaces)));
        let geometry = Geometry::new(&scene, &space, &blockers, &panels);
        let sealed = is_sealed(&geometry);
        let lost = measured(&geometry, 4096, 0, &Silent).expect("not interrupted");
        assert!(!sealed || lost.iter().all(|&lost| lost == 0.0), "rays get out of {boxes:?}");
        sealed
    }

    #[test]
    fn rooms_are_sealed_and_what_is_open_inside_out_or_nested_is_not() {
        let gray = || Material::diffuse("gray", 0.5);
        let (room, table, hall) =
            (([0.0, 1.0], true, &[][..]), ([0.3, 0.6], false, &[][..]), ([-1.0, 2.0], true, &[][..]));
        assert!(sealed(&[room], gray()), "a room");
        assert!(sealed(&[room, table], gray()), "with something floating in it");
        assert!(sealed(&[room, ([3.0, 4.0], true, &[])], gray()), "two rooms apart");
        assert!(!sealed(&[([0.0, 1.0], true, &[4])], gray()), "a wall is missing");
        assert!(!sealed(&[([0.0, 1.0], false, &[])], gray()), "seen from outside");
        assert!(!sealed(&[room, ([0.3, 0.6], false, &[2])], gray()), "the table is a bowl: its inside is a back");
        assert!(!sealed(&[hall, room], gray()), "a room in a hall: from the hall its backs are seen");
        assert!(!sealed(&[room, ([1.3, 1.6], false, &[])], gray()), "the table stands outside");
    }

    /// Each plate is a closed surface of a front and a back, and from either front nearly all is the other's front.
    #[test]
    fn two_plates_close_together_are_not_sealed() {
        let below = ([0.0, 1.0], true, &[1, 2, 3, 4, 5][..]);
        let above = ([0.001, 1.001], false, &[1, 2, 3, 4, 5][..]);
        assert!(!sealed(&[below, above], Material { two_sided: true, ..Material::diffuse("sheet", 0.5) }));
        let thin = ([0.0, 1.0], false, &[1, 2, 3, 4, 5][..]);
        assert!(!sealed(&[thin, ([0.0, 1.0], true, &[1, 2, 3, 4, 5])], Material::diffuse("gray", 0.5)));
    }

    #[test]
    fn a_room_of_two_sided_walls_has_an_outside() {
        let room = ([0.0, 1.0], true, &[][..]);
        assert!(!sealed(&[room], Material { two_sided: true, ..Material::diffuse("sheet", 0.5) }));
    }
}

//! Whether nothing can leave a scene, proven by its topology: where that succeeds, no rays need look for a way out.
//!
//! If two cells meet at each edge and run through it in opposite directions, the mesh is a closed surface, and every point
//! of space that is not on it has a winding number w, which is 0 far away and greater by one in front of a face than
//! behind it. In front of all faces that hang together it is the same. Where it is 1 in front of all of them, no ray from
//! a front can get away, which would take it to w = 0 without a crossing, and none can meet a back, behind which w = 0.
//!
//! One ray per part that hangs together counts w: the fronts that it crosses, less the backs. Whether a ray through an edge
//! counts once is not known, so three rays must agree.

use super::Geometry;
use super::closure::{cosine_ray, receiving_sides};
use crate::mesh::{Mesh, Topology, UnionFind};
use crate::quadrature::sequence::{hash, point};
use std::cell::Cell;

/// Rays that have to agree.
const RAYS: u32 = 3;

/// Whether it is proven that light from every cell only meets fronts of cells.
pub(super) fn is_sealed(geometry: &Geometry<'_>) -> bool {
    let mesh = &geometry.scene.mesh;
    // What only blocks light has no cells.
    if !receiving_sides(geometry.scene).iter().all(|&[front, _]| front) {
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

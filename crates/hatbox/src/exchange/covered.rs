//! Cells that something lies on.
//!
//! Where a wardrobe stands on a floor and against a wall, what it covers of both is within it, and nothing stands between the
//! one and the other but the wardrobe's own bottom and back, which lie in their planes. No shaft holds a polygon in
//! the plane of its end, and whether a ray from there meets it is a matter of rounding: the floor would see the wall. So a cell
//! that is covered sees nothing, by decree, and a room is closed if nothing escapes from the other cells.

use crate::assemble::FLAT;
use crate::mesh::Patch;
use crate::mesh::polygon::area_vector;
use crate::scene::Scene;
use crate::visibility::Bvh;
use glam::DVec3;
use rayon::prelude::*;

/// Corners are asked for this far from the centre: right on the outline of what covers a cell, rounding decides.
const INSIDE: f64 = 0.98;
/// Normals of what covers a cell are opposite to its own to this cosine.
const OPPOSITE: f64 = -1.0 + 1e-9;

/// For each cell whether faces that look the other way lie on all of it.
pub(super) fn covered(scene: &Scene, blockers: &Bvh) -> Vec<bool> {
    // Few faces touch any other, and those without contacts need not be looked at cell by cell.
    let touched = |(id, surface): (usize, &crate::scene::Surface)| {
        let (corners, normal) = (surface.corners(), area_vector(surface.corners()).normalize_or_zero());
        [normal, -normal].iter().any(|&normal| !lying_on(corners, normal, id as u32, blockers).is_empty())
    };
    let touched: Vec<bool> = scene.surfaces.par_iter().enumerate().map(touched).collect();
    let of = |cell: usize| {
        let surface = scene.mesh.cells[cell].surface;
        touched[surface as usize] && is_covered(&scene.mesh.patch(cell), surface, blockers)
    };
    (0..scene.mesh.cells.len()).into_par_iter().map(of).collect()
}

fn is_covered(patch: &Patch, surface: u32, blockers: &Bvh) -> bool {
    let (corners, normal, center) = (patch.corners(), patch.normal(), patch.center());
    let covers = lying_on(corners, normal, surface, blockers);
    let is_under = |p: DVec3| covers.iter().any(|triangle| is_within(p, triangle, -normal));
    is_under(center) && corners.iter().all(|&corner| is_under(center.lerp(corner, INSIDE)))
}

/// The triangles of other faces that lie in the plane of a polygon, near it, and look the other way.
fn lying_on(corners: &[DVec3], normal: DVec3, surface: u32, blockers: &Bvh) -> Vec<[DVec3; 3]> {
    let lo = corners.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let hi = corners.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let flat = FLAT * lo.distance(hi);
    let mut found = Vec::new();
    blockers.overlapping(lo - flat, hi + flat, |index| {
        let Some((triangle, id)) = blockers.triangle(index) else { return };
        let level = || triangle.iter().all(|corner| normal.dot(corner - corners[0]).abs() <= flat);
        if id != surface && area_vector(&triangle).normalize_or_zero().dot(normal) < OPPOSITE && level() {
            found.push(triangle);
        }
    });
    found
}

/// Whether a point of the plane of a triangle with this normal lies in it.
fn is_within(p: DVec3, triangle: &[DVec3; 3], normal: DVec3) -> bool {
    (0..3).all(|k| normal.dot((triangle[(k + 1) % 3] - triangle[k]).cross(p - triangle[k])) >= 0.0)
}

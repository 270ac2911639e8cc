//! Cells that something lies on.
//!
//! Where a wardrobe stands on a floor and against a wall, what it covers of both is within it, and nothing stands between the
//! one and the other but the wardrobe's own bottom and back, which lie in their planes. No shaft holds a polygon in
//! the plane of its end, and whether a ray from there meets it is a matter of rounding: the floor would see the wall. So a cell
//! that is covered sees nothing, by decree, and a room is closed if nothing escapes from the other cells.
//!
//! Two faces that look opposite ways in one plane need not be two bodies that touch: they may be the two sides of a sheet, or of
//! a wall between two rooms. Where bodies touch, one side of the plane is the inside of one of them, where rays meet nothing
//! but unlit sides of faces.

use super::closure::{cosine_ray, receiving_sides};
use crate::assemble::FLAT;
use crate::mesh::Patch;
use crate::mesh::polygon::area_vector;
use crate::quadrature::sequence::{hash, point};
use crate::scene::{Scene, Surface};
use crate::visibility::Bvh;
use glam::DVec3;
use rayon::prelude::*;

/// Corners are asked for this far from the centre: right on the outline of what covers a cell, rounding decides.
const INSIDE: f64 = 0.98;
/// Normals of what covers a cell are opposite to its own to this cosine.
const OPPOSITE: f64 = -1.0 + 1e-9;
/// Rays that tell the inside of a body.
const RAYS: u32 = 16;

/// For each cell whether it lies between two bodies that touch.
pub(super) fn covered(scene: &Scene, blockers: &Bvh) -> Vec<bool> {
    // Few faces touch any other, and those without contacts need not be looked at cell by cell.
    let touched = |(id, surface): (usize, &Surface)| {
        let (corners, normal) = (surface.corners(), area_vector(surface.corners()).normalize_or_zero());
        [normal, -normal].iter().any(|&normal| !lying_on(corners, normal, id as u32, blockers).is_empty())
    };
    let touched: Vec<bool> = scene.surfaces.par_iter().enumerate().map(touched).collect();
    let receives = receiving_sides(scene);
    let of = |cell: usize| {
        let (patch, surface) = (scene.mesh.patch(cell), scene.mesh.cells[cell].surface);
        touched[surface as usize] && Contact { patch: &patch, surface, blockers, receives: &receives }.covers(cell)
    };
    (0..scene.mesh.cells.len()).into_par_iter().map(of).collect()
}

/// A cell on which others may lie.
struct Contact<'a> {
    patch: &'a Patch,
    surface: u32,
    blockers: &'a Bvh,
    /// Whether front and back of each face receive light.
    receives: &'a [[bool; 2]],
}

impl Contact<'_> {
    fn covers(&self, cell: usize) -> bool {
        let (corners, normal, center) = (self.patch.corners(), self.patch.normal(), self.patch.center());
        let covers = lying_on(corners, normal, self.surface, self.blockers);
        let is_under = |p: DVec3| covers.iter().any(|(_, triangle)| is_within(p, triangle, -normal));
        is_under(center)
            && corners.iter().all(|&corner| is_under(center.lerp(corner, INSIDE)))
            && [1.0, -1.0].iter().any(|&side| self.is_within_a_body(cell, side, &covers))
    }

    /// Whether rays to the front (1) or to the back (−1) of the cell all meet sides of faces that receive no light, those in its
    /// own plane apart: it is the inside of something.
    fn is_within_a_body(&self, cell: usize, side: f64, covers: &[(u32, [DVec3; 3])]) -> bool {
        let apart = |id: u32| id != self.surface && covers.iter().all(|(cover, _)| *cover != id);
        let first = |from: DVec3, towards: DVec3, lit: bool| {
            let counts = |id: u32, front: bool| apart(id) && self.receives[id as usize][usize::from(!front)] == lit;
            self.blockers.closest_hit(from, towards, f64::INFINITY, counts).map(|hit| hit.t)
        };
        let flat = FLAT * self.patch.longest_edge();
        (0..RAYS).all(|k| {
            let (from, direction) = cosine_ray(self.patch, point(hash(0x636f_7665, cell as u64), k));
            let dark = first(from, side * direction, false);
            // Where bodies touch each other, the inside of the one and the outside of the other are met together.
            dark.is_some_and(|dark| first(from, side * direction, true).is_none_or(|lit| dark <= lit + flat))
        })
    }
}

/// The triangles of other faces that lie in the plane of a polygon, near it, and look the other way, and their faces.
fn lying_on(corners: &[DVec3], normal: DVec3, surface: u32, blockers: &Bvh) -> Vec<(u32, [DVec3; 3])> {
    let lo = corners.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let hi = corners.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let flat = FLAT * lo.distance(hi);
    let mut found = Vec::new();
    blockers.overlapping(lo - flat, hi + flat, |index| {
        let Some((triangle, id)) = blockers.triangle(index) else { return };
        let level = || triangle.iter().all(|corner| normal.dot(corner - corners[0]).abs() <= flat);
        if id != surface && area_vector(&triangle).normalize_or_zero().dot(normal) < OPPOSITE && level() {
            found.push((id, triangle));
        }
    });
    found
}

/// Whether a point of the plane of a triangle with this normal lies in it.
fn is_within(p: DVec3, triangle: &[DVec3; 3], normal: DVec3) -> bool {
    (0..3).all(|k| normal.dot((triangle[(k + 1) % 3] - triangle[k]).cross(p - triangle[k])) >= 0.0)
}

//! Cells that something lies on.
//!
//! Where a wardrobe stands on a floor and against a wall, what it covers of both is within it, and nothing stands between the
//! one and the other but the wardrobe's own bottom and back, which lie in their planes. No shaft holds a polygon in
//! the plane of its end, and whether a ray from there meets it is a matter of rounding: the floor would see the wall. So a cell
//! that is covered sees nothing, by decree, and a room is closed if nothing escapes from the other cells.
//!
//! Two faces that look opposite ways in one plane need not be two bodies that touch: they may be the two sides of a sheet, or of
//! a wall between two rooms. Where bodies touch, one side of the plane is the inside of one of them, where rays meet
//! unlit sides of faces, and lit ones only together with them, where others touch it. (Who meets both everywhere is in a room whose
//! walls are two faces without thickness.) So a cell is covered if that is so in front of it, or if it is so behind it and rays from
//! its front meet nothing that is lit: the bottom of a box, which looks out of the room.
//!
//! Where more faces look one way than the other in a plane, as under a sheet of two faces that lies on a floor, one of those is
//! seen and none of the fewer, unless they do see something (a face may be there twice by mistake).
//!
//! Of faces that look the same way one is left (`mesh::layers`); the others still count as layers.
//!
//! What touches is told to the tolerance with which the scene was welded, whatever the size of the cells.

use super::closure::{cosine_ray, receiving_sides};
use crate::mesh::Patch;
use crate::mesh::polygon::area_vector;
use crate::quadrature::sequence::{hash, point};
use crate::scene::{Scene, Surface};
use crate::visibility::{Bvh, Hit};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Corners are asked for this far from the centre: right on the outline of what covers a cell, rounding decides.
const INSIDE: f64 = 0.98;
/// Normals of what lies in a cell's plane are its own or the opposite to about this cosine: small cells have less accurate ones.
const ALIGNED: f64 = 0.999;
/// Rays that tell the inside of a body.
const RAYS: u32 = 16;

/// For each cell whether it lies between two bodies that touch.
pub(super) fn covered(scene: &Scene, blockers: &Bvh) -> Vec<bool> {
    let (receives, flat) = (receiving_sides(scene), scene.mesh.tolerance());
    let hidden = Bvh::of_surfaces(&scene.hidden);
    let contact = |patch, surface| Contact { patch, surface, blockers, hidden: &hidden, receives: &receives, flat };
    // Few faces touch any other, and those without contacts need not be looked at cell by cell.
    let touched = |(id, surface): (usize, &Surface)| {
        let normal = area_vector(surface.corners()).normalize_or_zero();
        [normal, -normal].iter().any(|&n| !contact(surface.patch(n), id as u32).level(-1.0).is_empty())
    };
    let touched: Vec<bool> = scene.surfaces.par_iter().enumerate().map(touched).collect();
    let of = |cell: usize| {
        let surface = scene.mesh.cells[cell].surface;
        touched[surface as usize] && contact(scene.mesh.patch(cell), surface).is_covered(cell)
    };
    (0..scene.mesh.cells.len()).into_par_iter().map(of).collect()
}

/// A cell on which others may lie.
struct Contact<'a> {
    patch: Patch,
    surface: u32,
    blockers: &'a Bvh,
    /// What was left out under other faces.
    hidden: &'a Bvh,
    /// Whether front and back of each face receive light.
    receives: &'a [[bool; 2]],
    /// A length that is none.
    flat: f64,
}

/// What a ray meets first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Met {
    Nothing,
    Lit,
    Unlit,
    /// Both together.
    Both,
}

impl Contact<'_> {
    fn is_covered(&self, cell: usize) -> bool {
        let (covers, center) = (self.level(-1.0), self.patch.center());
        let is_under = |p: DVec3| covers.iter().any(|(_, triangle)| self.touches(p, triangle));
        if !is_under(center) || !self.patch.corners().iter().all(|&corner| is_under(center.lerp(corner, INSIDE))) {
            return false;
        }
        // Layers in one plane: the outermost of those that are more on one side is seen.
        let [here, others] = [&self.level(1.0), &covers].map(|faces| self.faces_at(center, faces));
        // The other side of a sheet is a layer that looks the other way.
        let own = usize::from(self.receives[self.surface as usize] == [true, true]);
        let more = (1 + here.len()).cmp(&(others.len() + own));
        // A room of walls without thickness, each of two faces, has both everywhere.
        let all_unlit =
            |met: &[Met]| met.contains(&Met::Unlit) && met.iter().all(|&met| matches!(met, Met::Unlit | Met::Both));
        let apart: BTreeSet<u32> = covers.iter().map(|(id, _)| *id).chain([self.surface]).collect();
        let before = self.look(cell, 1.0, &apart);
        let is_shut = || more.is_lt() || all_unlit(&self.look(cell, -1.0, &apart));
        all_unlit(&before) || (!more.is_gt() && !before.contains(&Met::Lit) && is_shut())
    }

    /// The faces that a point lies on.
    fn faces_at(&self, p: DVec3, level: &[(u32, [DVec3; 3])]) -> BTreeSet<u32> {
        level.iter().filter(|(_, triangle)| self.touches(p, triangle)).map(|(id, _)| *id).collect()
    }

    /// What rays to the front (1) or to the back (−1) of the cell meet beside what is in its own plane. Where two bodies
    /// touch, the inside of the one and the outside of the other are met together from within the one.
    fn look(&self, cell: usize, side: f64, apart: &BTreeSet<u32>) -> Vec<Met> {
        let met = |k: u32| {
            let (from, towards) = cosine_ray(&self.patch, point(hash(0x636f_7665, cell as u64), k));
            let [lit, unlit] = [true, false].map(|lit| {
                let receives = |id: u32, front: bool| self.receives[id as usize][usize::from(!front)];
                let counts = |id: u32, front: bool| receives(id, front) == lit && !apart.contains(&id);
                self.blockers.closest_hit(from, side * towards, f64::INFINITY, counts)
            });
            match (lit, unlit) {
                (None, None) => Met::Nothing,
                (Some(_), None) => Met::Lit,
                (Some(lit), Some(unlit)) if (unlit.t - lit.t) * self.steepness(&unlit, towards) > self.flat => Met::Lit,
                (Some(lit), Some(unlit)) if (lit.t - unlit.t) * self.steepness(&lit, towards) <= self.flat => Met::Both,
                (_, Some(_)) => Met::Unlit,
            }
        };
        (0..RAYS).map(met).collect()
    }

    /// The cosine at which a direction meets a triangle: two planes that are no length apart are met far apart at a grazing one.
    fn steepness(&self, hit: &Hit, towards: DVec3) -> f64 {
        let normal =
            self.blockers.triangle(hit.triangle).map(|(triangle, _)| area_vector(&triangle).normalize_or_zero());
        normal.map_or(1.0, |normal| normal.dot(towards).abs())
    }

    /// The triangles of other faces near the cell, in its plane, that look its way (1) or the other way (−1), and their faces.
    ///
    /// They lie in one plane if the smaller of the two lies in that of the larger, which is known better.
    fn level(&self, way: f64) -> Vec<(u32, [DVec3; 3])> {
        let (corners, normal, center) = (self.patch.corners(), self.patch.normal(), self.patch.center());
        let lo = corners.iter().copied().fold(DVec3::INFINITY, DVec3::min) - self.flat;
        let hi = corners.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max) + self.flat;
        let mut found = Vec::new();
        // What was left out has numbers that no other face has.
        for (faces, first) in [(self.blockers, 0), (self.hidden, self.receives.len() as u32)] {
            faces.overlapping(lo, hi, |index| {
                let Some((triangle, id)) = faces.triangle(index) else { return };
                let other = area_vector(&triangle).normalize_or_zero();
                let is_near = |n: DVec3, d: DVec3| n.dot(d).abs() <= self.flat;
                let is_level = || {
                    is_near(other, center - triangle[0])
                        || triangle.iter().all(|&corner| is_near(normal, corner - center))
                };
                if first + id != self.surface && way * other.dot(normal) > ALIGNED && is_level() {
                    found.push((first + id, triangle));
                }
            });
        }
        found
    }

    /// Whether a point lies on a triangle.
    fn touches(&self, p: DVec3, triangle: &[DVec3; 3]) -> bool {
        let normal = area_vector(triangle).normalize_or_zero();
        let is_inside = |k: usize| {
            let (from, to) = (triangle[k], triangle[(k + 1) % 3]);
            normal.dot((to - from).cross(p - from)) >= -self.flat * from.distance(to)
        };
        normal.dot(p - triangle[0]).abs() <= self.flat && (0..3).all(is_inside)
    }
}

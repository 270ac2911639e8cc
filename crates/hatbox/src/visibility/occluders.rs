//! What may stand in the way, as few large convex polygons.
//!
//! Rays ask for triangles; proofs and exact shadows want the opposite, polygons as large as can be: a wall of a thousand
//! faces has one shadow. Faces that lie in one plane and share an edge are merged as long as the union stays convex.
//! Collinear corners vanish, so that merged polygons may have corners on each other's edges: their shadows are areas, and
//! a crack without area is no light. Rays go on to the faces themselves, whose edges are watertight.

use super::build::range;
use super::{Bvh, Shaft, ShaftResult};
use crate::mesh::RELATIVE_TOLERANCE;
use crate::mesh::polygon::area_vector;
use crate::scene::Surface;
use glam::DVec3;

/// Convex planar polygons that together cover the opaque faces of a scene.
#[derive(Debug, Clone)]
pub struct Occluders {
    corners: Vec<DVec3>,
    /// Where each polygon's corners start, and the end.
    starts: Vec<u32>,
    /// Unit normals; none where a polygon has no area.
    normals: Vec<DVec3>,
    /// The polygon that each face is a part of.
    of_surface: Vec<u32>,
    tree: Bvh,
    /// What is no farther from a polygon lies on it.
    flat: f64,
}

impl Occluders {
    /// Of faces.
    pub fn new(surfaces: &[Surface]) -> Self {
        let merged = super::merge::merged(surfaces);
        let (mut corners, mut starts) = (Vec::new(), vec![0]);
        let (mut triangles, mut ids) = (Vec::new(), Vec::new());
        for (id, polygon) in merged.polygons.iter().enumerate() {
            corners.extend_from_slice(polygon);
            starts.push(corners.len() as u32);
            for k in 1..polygon.len() - 1 {
                triangles.push([polygon[0], polygon[k], polygon[k + 1]]);
                ids.push(id as u32);
            }
        }
        let normals = merged.polygons.iter().map(|polygon| area_vector(polygon).normalize_or_zero()).collect();
        let (lo, hi) = range(corners.iter().copied());
        let flat = if lo.is_finite() { RELATIVE_TOLERANCE * lo.distance(hi) } else { 0.0 };
        Self { corners, starts, normals, of_surface: merged.of_surface, tree: Bvh::new(&triangles, &ids), flat }
    }

    /// Number of polygons.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The corners of a polygon, in order around it.
    pub fn polygon(&self, index: u32) -> &[DVec3] {
        &self.corners[self.starts[index as usize] as usize..self.starts[index as usize + 1] as usize]
    }

    /// Whether a polygon may block part of a shaft; if not, it is proven to touch it at most.
    pub fn may_block(&self, shaft: &Shaft, index: u32) -> bool {
        shaft.may_block(self.polygon(index), self.normals[index as usize])
    }

    /// Whether a polygon blocks every segment of a shaft, on neither end of which it lies: cells that were joined to something a
    /// little below their face are not hidden by that face.
    pub fn blocks_fully(&self, shaft: &Shaft, index: u32) -> bool {
        shaft.fully_blocked_by(self.polygon(index), self.normals[index as usize], self.flat)
    }

    /// The polygon that a face is a part of; `u32::MAX` if there is no such face.
    pub fn of_surface(&self, surface: u32) -> u32 {
        self.of_surface.get(surface as usize).copied().unwrap_or(u32::MAX)
    }

    /// Puts the polygons that may block the shaft, except those of `skip`, into `out`, in ascending order.
    ///
    /// [`ShaftResult::Empty`] is a proof: no segment between the ends is occluded. [`ShaftResult::TooMany`] leaves a list
    /// that is not complete: the polygons have more than `limit` triangles in the shaft.
    pub fn candidates(&self, shaft: &Shaft, skip: &[u32; 2], out: &mut Vec<u32>, limit: usize) -> ShaftResult {
        let found = self.tree.shaft_candidates(shaft, skip, out, limit);
        for candidate in out.iter_mut() {
            *candidate = self.tree.triangle(*candidate).map_or(u32::MAX, |(_, polygon)| polygon);
        }
        out.sort_unstable();
        out.dedup();
        found
    }
}

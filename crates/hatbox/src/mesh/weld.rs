//! Welding: vertices at one place become one vertex.
//!
//! Files duplicate vertices wherever a texture or a normal jumps, and some share nothing at all. Radiosity does not jump
//! there, so what belongs together is decided by position; what the file said about a corner stays with the corner. The
//! vertices are sorted into a hash grid and each one joins the first earlier one within the tolerance, so that the result
//! depends on the order of the vertices and on nothing else.

use super::corner::{Builder, Corner};
use super::{Cell, Mesh, box_tree};
use arrayvec::ArrayVec;
use glam::{DVec3, I64Vec3};
use rustc_hash::FxHashMap;

/// The welding tolerance relative to the diagonal of the bounding box. Files store positions as `f32` (relative
/// precision 6e-8), often after a transformation; this is a dozen times coarser.
pub const RELATIVE_TOLERANCE: f64 = 1e-6;
/// Corners that merging moves by more than this part of the shortest edge, and farther than files in single precision are off after
/// a transformation or two, are worth a word.
const VISIBLE: f64 = 1e-5;
const ROUNDING: f64 = 4e-7;

impl Mesh {
    /// The diagonal of the box around the finite vertices, in metres; zero without any.
    pub fn diagonal(&self) -> f64 {
        let finite = self.vertices.iter().copied().filter(|v| v.is_finite());
        let (lo, hi) = box_tree::bounds(finite);
        if lo.is_finite() { lo.distance(hi) } else { 0.0 }
    }

    /// [`RELATIVE_TOLERANCE`] times the [diagonal](Self::diagonal), in metres.
    pub fn tolerance(&self) -> f64 {
        RELATIVE_TOLERANCE * self.diagonal()
    }

    /// Merges vertices that are no more than `tolerance` (metres) apart, and tells how many cells were dropped because
    /// nothing is left of them: those with fewer than three different corners, or no higher than the tolerance. A quad
    /// with one repeated corner becomes a triangle. Vertices that no cell uses are left out.
    #[must_use]
    pub fn welded(&self, tolerance: f64) -> (Self, usize) {
        self.welded_as(&self.merged_vertices(tolerance), tolerance)
    }

    /// The same, if it is known which vertices are merged.
    pub(crate) fn welded_as(&self, merged: &[u32], tolerance: f64) -> (Self, usize) {
        let mut builder = Builder::like(self);
        let mut dropped = 0;
        for (index, cell) in self.cells.iter().enumerate() {
            let corners = self.corners(index).map(|corner| {
                let vertex = merged[corner.vertex as usize];
                Corner { vertex, position: self.vertices[vertex as usize], ..corner }
            });
            match distinct(&corners[..cell.shape.corners()], tolerance) {
                Some(corners) => builder.push(cell, &corners),
                None => dropped += 1,
            }
        }
        (builder.finish().without_unused_vertices(), dropped)
    }

    /// For each vertex the first one that it is merged with (itself, if it is the first). Vertices that are not finite
    /// are never merged.
    pub(crate) fn merged_vertices(&self, tolerance: f64) -> Vec<u32> {
        let (origin, _) = box_tree::bounds(self.vertices.iter().copied().filter(|v| v.is_finite()));
        // Buckets much larger than the tolerance: then nearly every search looks into one.
        let size = (16.0 * tolerance).max(1e-12 * self.diagonal()).max(f64::MIN_POSITIVE);
        let bucket = |p: DVec3| ((p - origin) / size).floor().as_i64vec3();
        let mut heads: FxHashMap<I64Vec3, u32> = FxHashMap::default();
        let mut next = vec![u32::MAX; self.vertices.len()];
        let mut merged: Vec<u32> = (0..self.vertices.len() as u32).collect();
        for (index, &position) in self.vertices.iter().enumerate().filter(|(_, v)| v.is_finite()) {
            let mut first = u32::MAX;
            for key in buckets(bucket(position - tolerance), bucket(position + tolerance)) {
                let mut candidate = heads.get(&key).copied().unwrap_or(u32::MAX);
                while candidate != u32::MAX {
                    if self.vertices[candidate as usize].distance(position) <= tolerance {
                        first = first.min(candidate);
                    }
                    candidate = next[candidate as usize];
                }
            }
            if first == u32::MAX {
                let head = heads.entry(bucket(position)).or_insert(u32::MAX);
                next[index] = std::mem::replace(head, index as u32);
            } else {
                merged[index] = first;
            }
        }
        merged
    }

    /// Corners of cells that merging moves by more than rounding of coordinates explains, and by more than shows on the cell.
    pub(crate) fn moved_corners(&self, merged: &[u32], tolerance: f64) -> usize {
        let at = |vertex: u32| self.vertices[vertex as usize];
        let of = |cell: &Cell| {
            let corners = cell.corners();
            let edges = corners.iter().zip(corners.iter().cycle().skip(1)).map(|(&a, &b)| at(a).distance(at(b)));
            // What is no longer than the tolerance vanishes, which is told elsewhere.
            let size = edges.filter(|&edge| edge > tolerance).fold(f64::INFINITY, f64::min);
            let is_moved = |&&vertex: &&u32| {
                let (from, to) = (at(vertex), at(merged[vertex as usize]));
                from.distance(to) > (VISIBLE * size).max(ROUNDING * from.abs().max_element())
            };
            corners.iter().filter(is_moved).count()
        };
        self.cells.iter().map(of).sum()
    }

    /// Leaves out the vertices that no cell uses; the others keep their order.
    pub(crate) fn without_unused_vertices(mut self) -> Self {
        let mut renumbered = vec![u32::MAX; self.vertices.len()];
        for &vertex in self.cells.iter().flat_map(Cell::corners) {
            renumbered[vertex as usize] = 0;
        }
        let mut kept = Vec::new();
        for (new, &position) in renumbered.iter_mut().zip(&self.vertices).filter(|(new, _)| **new == 0) {
            *new = kept.len() as u32;
            kept.push(position);
        }
        self.vertices = kept;
        for cell in &mut self.cells {
            cell.vertices = cell.vertices.map(|v| renumbered[v as usize]);
        }
        self
    }
}

fn buckets(lo: I64Vec3, hi: I64Vec3) -> impl Iterator<Item = I64Vec3> {
    let plane = move |x| (lo.y..=hi.y).flat_map(move |y| (lo.z..=hi.z).map(move |z| I64Vec3::new(x, y, z)));
    (lo.x..=hi.x).flat_map(plane)
}

/// The corners without repetitions; `None` if they span no area.
pub(super) fn distinct(corners: &[Corner], tolerance: f64) -> Option<ArrayVec<Corner, 4>> {
    let mut kept: ArrayVec<Corner, 4> = ArrayVec::new();
    for corner in corners {
        if kept.last().is_none_or(|last| last.vertex != corner.vertex) {
            kept.push(*corner);
        }
    }
    if kept.len() > 1 && kept[0].vertex == kept[kept.len() - 1].vertex {
        kept.pop();
    }
    let repeats = (0..kept.len()).any(|i| kept[..i].iter().any(|c| c.vertex == kept[i].vertex));
    let high = || height(&kept) > tolerance;
    (kept.len() >= 3 && !repeats && high()).then_some(kept)
}

/// Twice the area of the polygon over its longest edge: the height of a triangle.
fn height(corners: &[Corner]) -> f64 {
    let from = corners[0].position;
    let edges = || corners.iter().zip(corners.iter().cycle().skip(1)).map(|(a, b)| (a.position, b.position));
    let area_vector: DVec3 = edges().map(|(a, b)| (a - from).cross(b - from)).sum();
    area_vector.length() / edges().map(|(a, b)| a.distance(b)).fold(0.0, f64::max)
}

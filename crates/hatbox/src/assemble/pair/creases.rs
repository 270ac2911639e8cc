//! Where what a receiver sees of a source is not smooth.
//!
//! Walking over the receiver, the outline of the visible part changes its shape where a corner of one polygon, source or
//! blocker, passes an edge of another, and where a blocker is seen edge-on. Those are straight lines: the shadows of edges
//! in the light of corners, and of corners in the light of edges (the EV events of visual events: Z. Gigus, J. Malik,
//! "Computing the aspect graph for line drawings of polyhedral objects", IEEE PAMI 12, 1990). Three edges that cross in
//! one point as seen from the receiver (EEE events) make curves; those are left to quartering.

use super::outer::Crease;
use crate::mesh::polygon::area_vector;
use glam::DVec3;

/// A line through two points whose heights differ by less than this, relative to the greatest height, meets the receiver's
/// plane too far away to matter.
const LEVEL: f64 = 1e-6;

/// The plane of a receiver, and a circle around the receiver in it.
pub(super) struct Ground {
    pub(super) center: DVec3,
    pub(super) radius: f64,
    pub(super) normal: DVec3,
}

impl Ground {
    /// The creases within the circle.
    pub(super) fn creases<'a>(&self, source: &'a [DVec3], blockers: impl Iterator<Item = &'a [DVec3]>) -> Vec<Crease> {
        let outlines: Vec<&[DVec3]> = std::iter::once(source).chain(blockers).collect();
        let mut creases = Vec::new();
        for (k, first) in outlines.iter().enumerate() {
            for second in &outlines[..k] {
                self.cast_all(first, second, &mut creases);
                self.cast_all(second, first, &mut creases);
            }
        }
        creases.extend(outlines[1..].iter().filter_map(|blocker| self.edge_on(blocker)));
        creases
    }

    fn height(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.center)
    }

    /// Shadows of the edges of one outline by the corners of another.
    fn cast_all(&self, corners: &[DVec3], outline: &[DVec3], creases: &mut Vec<Crease>) {
        for &corner in corners {
            let mut from = outline[outline.len() - 1];
            for &to in outline {
                for above in [false, true] {
                    creases.extend(self.cast(corner, [from, to], above).filter(|crease| self.is_near(crease)));
                }
                from = to;
            }
        }
    }

    /// Where the lines through a corner and an edge meet the ground: the part of the edge below the corner, or above it.
    fn cast(&self, corner: DVec3, edge: [DVec3; 2], above: bool) -> Option<Crease> {
        let height = self.height(corner);
        let heights = edge.map(|p| self.height(p));
        let least = LEVEL * heights[0].max(heights[1]).max(height);
        let drop = heights.map(|h| if above { h - height } else { height - h });
        // The part of the edge whose lines come down.
        let end = |k: usize| {
            let (here, there) = (drop[k], drop[1 - k]);
            let p = if here >= least { edge[k] } else { edge[k].lerp(edge[1 - k], (least - here) / (there - here)) };
            corner + (p - corner) * (height / (height - self.height(p)))
        };
        (drop[0] > least || drop[1] > least).then(|| [end(0), end(1)])
    }

    /// The line in which the plane of a blocker meets the ground.
    fn edge_on(&self, blocker: &[DVec3]) -> Option<Crease> {
        let normal = area_vector(blocker).try_normalize()?;
        let along = normal.cross(self.normal).try_normalize()?;
        // Down the ground's steepest way to the blocker's plane.
        let down = self.normal.cross(along);
        let foot = self.center + down * (normal.dot(blocker[0] - self.center) / normal.dot(down));
        let crease = [foot - along * self.radius, foot + along * self.radius];
        self.is_near(&crease).then_some(crease)
    }

    fn is_near(&self, [from, to]: &Crease) -> bool {
        let along = *to - *from;
        let t = ((self.center - *from).dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        self.center.distance_squared(*from + along * t) <= self.radius * self.radius
    }
}

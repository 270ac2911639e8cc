//! The part of a panel that another can see: clipping at the horizon.

use crate::mesh::{Patch, polygon};
use arrayvec::ArrayVec;
use glam::DVec3;

/// Two patches that see each other but for what stands between: each cut at the other's horizon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facing {
    pub(crate) first: Region,
    pub(crate) second: Region,
}

impl Facing {
    /// `None` if the patches face away from each other or lie in one plane.
    pub fn new(first: &Patch, second: &Patch) -> Option<Self> {
        let size = first.longest_edge() + second.longest_edge();
        Some(Self { first: Region::visible(first, second, size)?, second: Region::visible(second, first, size)? })
    }

    /// The two polygons.
    pub fn polygons(&self) -> [&[DVec3]; 2] {
        [self.first.corners(), self.second.corners()]
    }
}

/// Corners of a planar convex polygon that is cut and cut again.
pub(crate) type Polygon = ArrayVec<DVec3, POLYGON>;

/// Most corners of such a polygon: a cut adds one at the most.
pub(crate) const POLYGON: usize = 14;

/// The part of a convex polygon where a linear function is positive. A polygon that is full loses a corner's sliver.
pub(crate) fn clip(corners: &[DVec3], height: impl Fn(DVec3) -> f64) -> Polygon {
    let mut part = Polygon::new();
    polygon::clip(corners, height, |corner| _ = part.try_push(corner));
    part
}

/// [`clip`] by the heights of the corners, into a polygon whose memory is there.
pub(super) fn clip_at(corners: &[DVec3], height: impl Fn(usize) -> f64, part: &mut Polygon) {
    part.clear();
    polygon::clip_at(corners, height, |corner| _ = part.try_push(corner));
}

/// Whether a point lies between the sides of a convex polygon, seen along its normal, about which its corners are
/// counter-clockwise.
fn within(p: DVec3, polygon: &[DVec3], normal: DVec3) -> bool {
    edges(polygon).all(|[from, to]| normal.cross(to - from).dot(p - from) >= 0.0)
}

fn edges(polygon: &[DVec3]) -> impl Iterator<Item = [DVec3; 2]> + '_ {
    (0..polygon.len()).map(|k| [polygon[k], polygon[(k + 1) % polygon.len()]])
}

/// The distance of a point from a convex planar polygon with that unit normal.
pub(super) fn distance(p: DVec3, polygon: &[DVec3], normal: DVec3) -> f64 {
    if within(p, polygon, normal) {
        return normal.dot(p - polygon[0]).abs();
    }
    let to_edge = |[from, to]: [DVec3; 2]| {
        let along = to - from;
        let t = ((p - from).dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        p.distance(from + along * t)
    };
    edges(polygon).map(to_edge).fold(f64::INFINITY, f64::min)
}

/// A planar convex polygon: a panel, or what is left of it in front of another panel's plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Region {
    corners: [DVec3; MAX_CORNERS],
    len: usize,
    /// Nothing was cut off.
    pub(crate) whole: bool,
}

const MAX_CORNERS: usize = 6;

/// Corners closer to a plane than this fraction of the pair's size lie in it: the rounding of single precision, in which
/// files hold coordinates. Walls that are flat in the file stay flat for the light, and slivers of a millionth of their
/// length still have two sides.
pub(crate) const FLAT: f64 = 1.2e-7;

impl Region {
    /// The part of `patch` in front of the plane of `other`, `None` if there is none. `size` is that of the pair.
    fn visible(patch: &Patch, other: &Patch, size: f64) -> Option<Self> {
        Self::above(patch, other.corners()[0], other.normal(), FLAT * size)
    }

    /// The part of `patch` above the horizon of a point with a normal, `None` if there is none.
    pub(crate) fn in_front(patch: &Patch, x: DVec3, n: DVec3) -> Option<Self> {
        Self::above(patch, x, n, FLAT * patch.longest_edge())
    }

    fn above(patch: &Patch, origin: DVec3, normal: DVec3, flat: f64) -> Option<Self> {
        let corners = patch.corners();
        let mut heights = [0.0; 4];
        for (height, &corner) in heights.iter_mut().zip(corners) {
            *height = normal.dot(corner - origin);
        }
        let heights = &heights[..corners.len()];
        if heights.iter().all(|&h| h <= flat) {
            return None;
        }
        if heights.iter().all(|&h| h >= -flat) {
            return Some(Self::of(corners));
        }
        Some(Self::clip(corners, |corner| normal.dot(corner - origin)))
    }

    /// The whole polygon.
    pub(crate) fn of(corners: &[DVec3]) -> Self {
        let mut region = Self { corners: [DVec3::ZERO; MAX_CORNERS], len: corners.len(), whole: true };
        region.corners[..corners.len()].copy_from_slice(corners);
        region
    }

    /// The part where a linear function is positive.
    fn clip(corners: &[DVec3], height: impl Fn(DVec3) -> f64) -> Self {
        let mut region = Self { corners: [DVec3::ZERO; MAX_CORNERS], len: 0, whole: false };
        polygon::clip(corners, height, |corner| region.push(corner));
        region
    }

    fn push(&mut self, corner: DVec3) {
        self.corners[self.len] = corner;
        self.len += 1;
    }

    /// The corners, in the panel's order.
    pub(crate) fn corners(&self) -> &[DVec3] {
        &self.corners[..self.len]
    }

    /// Whether a point of its plane lies in it, its corners being counter-clockwise about the normal.
    pub(crate) fn contains(&self, point: DVec3, normal: DVec3) -> bool {
        within(point, self.corners(), normal)
    }

    /// The triangles of a fan from corner 0.
    pub(crate) fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        (1..self.len.saturating_sub(1)).map(|k| [self.corners[0], self.corners[k], self.corners[k + 1]])
    }

    /// The area.
    pub(crate) fn area(&self) -> f64 {
        polygon::area(self.corners())
    }

    /// The point that the unit square's (u, v) is mapped to, uniformly in area.
    pub(crate) fn sample(&self, u: f64, v: f64) -> DVec3 {
        let mut left = u * self.area();
        let mut point = self.corners[0];
        for t in self.triangles() {
            let area = triangle_area(&t);
            let inside = left <= area;
            let fraction = if area > 0.0 { (left / area).min(1.0) } else { 0.0 };
            // Lines from corner 0: the fraction of the triangle's area before a line is its place on the far edge.
            let root = v.sqrt();
            point = t[0] * (1.0 - root) + (t[1] * (1.0 - fraction) + t[2] * fraction) * root;
            if inside {
                break;
            }
            left -= area;
        }
        point
    }
}

/// The area of a triangle in space.
pub(crate) fn triangle_area([a, b, c]: &[DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_cover_a_region_uniformly() {
        let square = Region::of(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]);
        let n = 64;
        let grid = (0..n * n).map(|k| (f64::from(k % n) + 0.5, f64::from(k / n) + 0.5));
        let points: Vec<_> = grid.map(|(u, v)| square.sample(u / f64::from(n), v / f64::from(n))).collect();
        let count = points.len() as f64;
        let mean = points.iter().copied().sum::<DVec3>() / count;
        let moment = points.iter().map(|p| p.x * p.y).sum::<f64>() / count;
        assert!(mean.distance(DVec3::new(0.5, 0.5, 0.0)) < 1e-3, "{mean}");
        assert!((moment - 0.25).abs() < 1e-3, "{moment}");
    }

    #[test]
    fn a_region_contains_the_points_of_its_samples_and_not_those_beyond_its_edges() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];
        let square = Region::of(&corners);
        for k in 0..100 {
            let (u, v) = (f64::from(k % 10) / 9.0, f64::from(k / 10) / 9.0);
            let inside = DVec3::new(u, v, 0.0);
            assert!(square.contains(inside, DVec3::Z));
            let outside = inside + (inside - DVec3::new(0.5, 0.5, 0.0)).normalize() * 1.5;
            assert!(!square.contains(outside, DVec3::Z), "{outside}");
        }
    }

    #[test]
    fn clipping_keeps_the_part_in_front() {
        let corners = [DVec3::new(0.0, 0.0, -1.0), DVec3::new(1.0, 0.0, -1.0), DVec3::new(1.0, 0.0, 3.0)];
        let region = Region::clip(&corners, |corner| corner.z);
        assert!(!region.whole);
        assert!((region.area() - 2.0 * (0.75f64).powi(2)).abs() < 1e-15, "{}", region.area());
        assert!(region.corners().iter().all(|c| c.z >= 0.0));
    }
}

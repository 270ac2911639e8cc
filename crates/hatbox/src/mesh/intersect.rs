//! Whether two triangles cross or cover each other, by more than a tolerance.
//!
//! Walls that stand on a floor and neighbours along an edge touch, and must not be reported; so every comparison here
//! asks for more than the tolerance.

use super::Patch;
use glam::DVec3;

/// Planes are not one if the sine of the angle between them is more than this, however small what lies in them.
const PARALLEL: f64 = 0.05;

/// How two triangles lie to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Contact {
    /// Each goes through the other's plane, and they meet along a segment.
    Crossing,
    /// They lie in one plane, facing the same way, and share area.
    Overlapping,
    /// They lie in one plane, facing opposite ways, and share area.
    BackToBack,
}

type Triangle = [DVec3; 3];

/// How two triangles meet, if they do by more than `tolerance`.
pub(super) fn contact(a: &Triangle, b: &Triangle, tolerance: f64) -> Option<Contact> {
    let (m, n) = (normal(a), normal(b));
    let (of_a, of_b) = (a.map(|p| (p - b[0]).dot(n)), b.map(|p| (p - a[0]).dot(m)));
    let flat = |heights: &[f64; 3]| heights.iter().all(|h| h.abs() <= tolerance);
    if flat(&of_a) && flat(&of_b) {
        let facing = if m.dot(n) > 0.0 { Contact::Overlapping } else { Contact::BackToBack };
        return share_area(a, m, b, n, tolerance).then_some(facing);
    }
    let passes = |heights: &[f64; 3]| heights.iter().any(|&h| h > tolerance) && heights.iter().any(|&h| h < -tolerance);
    if !passes(&of_a) || !passes(&of_b) {
        return None;
    }
    let line = m.cross(n).normalize_or_zero();
    let ((a0, a1), (b0, b1)) = (interval(a, &of_a, line), interval(b, &of_b, line));
    (a1.min(b1) - a0.max(b0) > tolerance).then_some(Contact::Crossing)
}

/// Whether two faces lie in one plane and share area.
pub(super) fn share_plane(a: &Patch, b: &Patch, tolerance: f64) -> bool {
    let parts = |patch: &Patch| {
        let corners = patch.corners().to_vec();
        patch.triangles().iter().map(move |triangle| triangle.map(|k| corners[k]))
    };
    let in_one_plane = |a: &Triangle, b: &Triangle| {
        matches!(contact(a, b, tolerance), Some(Contact::Overlapping | Contact::BackToBack))
    };
    a.normal().cross(b.normal()).length() < PARALLEL && parts(a).any(|a| parts(b).any(|b| in_one_plane(&a, &b)))
}

fn normal([a, b, c]: &Triangle) -> DVec3 {
    (b - a).cross(c - a).normalize_or_zero()
}

/// The part of the line of two planes that lies in a triangle, given its corners' heights over the other plane.
fn interval(corners: &Triangle, heights: &[f64; 3], line: DVec3) -> (f64, f64) {
    let crossings = (0..3).map(|k| (k, (k + 1) % 3)).filter(|&(i, j)| (heights[i] > 0.0) != (heights[j] > 0.0));
    let at = crossings.map(|(i, j)| {
        let t = heights[i] / (heights[i] - heights[j]);
        corners[i].lerp(corners[j], t).dot(line)
    });
    at.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), s| (lo.min(s), hi.max(s)))
}

/// Whether two triangles in one plane cannot be separated by a line along one of their edges.
fn share_area(a: &Triangle, m: DVec3, b: &Triangle, n: DVec3, tolerance: f64) -> bool {
    let axes =
        |t: &Triangle, normal: DVec3| [0, 1, 2].map(|k: usize| normal.cross(t[(k + 1) % 3] - t[k]).normalize_or_zero());
    let extent = |t: &Triangle, axis: DVec3| {
        let s = t.map(|p| p.dot(axis));
        (s[0].min(s[1]).min(s[2]), s[0].max(s[1]).max(s[2]))
    };
    axes(a, m).into_iter().chain(axes(b, n)).all(|axis| {
        let ((a0, a1), (b0, b1)) = (extent(a, axis), extent(b, axis));
        a1.min(b1) - a0.max(b0) > tolerance
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOOR: Triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];

    fn moved(by: DVec3, points: Triangle) -> Triangle {
        points.map(|p| p + by)
    }

    #[test]
    fn what_crosses_is_told_from_what_touches() {
        let wall = [DVec3::ZERO, DVec3::X, DVec3::Z];
        let inside = DVec3::new(0.1, 0.3, 0.0);
        for (height, expected) in [(-0.2, Some(Contact::Crossing)), (0.0, None), (-1e-9, None), (0.1, None)] {
            let wall = moved(inside + DVec3::Z * height, wall);
            assert_eq!(contact(&FLOOR, &wall, 1e-6), expected, "{height}");
            assert_eq!(contact(&wall, &FLOOR, 1e-6), expected, "{height}");
        }
        // In each other's planes, but apart.
        assert_eq!(contact(&FLOOR, &moved(DVec3::new(2.0, 0.3, -0.2), wall), 1e-6), None);
    }

    #[test]
    fn what_covers_is_told_from_what_adjoins() {
        let neighbour = [DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        assert_eq!(contact(&FLOOR, &neighbour, 1e-6), None);
        assert_eq!(contact(&FLOOR, &moved(DVec3::X * -0.1, neighbour), 1e-6), Some(Contact::Overlapping));
        let [a, b, c] = moved(DVec3::X * -0.1, neighbour);
        assert_eq!(contact(&FLOOR, &[a, c, b], 1e-6), Some(Contact::BackToBack));
        assert_eq!(contact(&FLOOR, &moved(DVec3::Z * 0.1, FLOOR), 1e-6), None);
    }
}

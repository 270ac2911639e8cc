//! Planar convex polygons in space, as corners in order.

use glam::DVec3;

/// Twice the area times the normal about which the corners run counter-clockwise (M. E. Newell's method).
pub(crate) fn area_vector(corners: &[DVec3]) -> DVec3 {
    let from = corners[0];
    corners.windows(2).map(|edge| (edge[0] - from).cross(edge[1] - from)).sum()
}

/// The area.
pub(crate) fn area(corners: &[DVec3]) -> f64 {
    if corners.len() < 3 { 0.0 } else { 0.5 * area_vector(corners).length() }
}

/// Hands over the corners of the part where a linear function is positive (I. Sutherland, G. Hodgman, "Reentrant polygon
/// clipping", CACM 17, 1974): at most one more than there were.
#[inline]
pub(crate) fn clip(corners: &[DVec3], height: impl Fn(DVec3) -> f64, keep: impl FnMut(DVec3)) {
    clip_at(corners, |k| height(corners[k]), keep);
}

/// [`clip`] by the heights of the corners.
#[inline]
pub(crate) fn clip_at(corners: &[DVec3], height: impl Fn(usize) -> f64, mut keep: impl FnMut(DVec3)) {
    let Some(&last) = corners.last() else { return };
    let (mut from, mut h_from) = (last, height(corners.len() - 1));
    for (k, &corner) in corners.iter().enumerate() {
        let h = height(k);
        if (h > 0.0 && h_from < 0.0) || (h < 0.0 && h_from > 0.0) {
            keep(from.lerp(corner, h_from / (h_from - h)));
        }
        if h >= 0.0 {
            keep(corner);
        }
        (from, h_from) = (corner, h);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_and_the_rest_have_the_area_of_the_whole() {
        let at = |x: f64, y: f64| DVec3::new(x, 0.5 * x + y, 2.0 - y);
        let pentagon = [at(0.0, 0.0), at(2.0, -0.3), at(2.5, 1.0), at(1.0, 1.9), at(-0.2, 1.0)];
        for (normal, offset) in [(DVec3::X, 1.1), (DVec3::new(0.3, -0.8, 0.5), 0.7), (DVec3::Y, 9.0), (DVec3::Z, 2.0)] {
            let part = |sign: f64| {
                let mut part = Vec::new();
                clip(&pentagon, |p| sign * (normal.dot(p) - offset), |corner| part.push(corner));
                area(&part)
            };
            assert!((part(1.0) + part(-1.0) - area(&pentagon)).abs() < 1e-14, "{normal}");
        }
        assert!(
            area_vector(&pentagon).normalize().dot((at(1.0, 0.0) - at(0.0, 0.0)).cross(at(0.0, 1.0) - at(0.0, 0.0)))
                > 0.0
        );
    }
}

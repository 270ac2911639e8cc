//! A flat polygon without parts of it.

use crate::io::read::polygon::{Piece, pieces};
use crate::mesh::polygon::{self, area_vector};
use glam::DVec3;

/// Distances below this, relative to the size of the polygon, are rounding.
const ROUNDING: f64 = 1e-9;

/// Whether every corner of a part lies in a convex polygon, up to a distance.
pub(super) fn contains(polygon: &[DVec3], part: &[DVec3], tolerance: f64) -> bool {
    outward(polygon).all(|(origin, out)| part.iter().all(|corner| (*corner - origin).dot(out) <= tolerance))
}

/// What is left of a polygon if parts of it are taken out: polygons with the same front.
pub(super) fn without<'a>(polygon: &[DVec3], parts: impl Iterator<Item = &'a [DVec3]>) -> Vec<Vec<DVec3>> {
    let mut left = vec![polygon.to_vec()];
    for part in parts {
        for piece in pieces(part) {
            let convex: Vec<DVec3> = match piece {
                Piece::Triangle(corners) => corners.iter().map(|&k| part[k]).collect(),
                Piece::Quad(corners) => corners.iter().map(|&k| part[k]).collect(),
            };
            left = left.into_iter().flat_map(|polygon| subtract(polygon, &convex)).collect();
        }
    }
    left
}

/// A convex polygon without another: for each edge of the other, what lies beyond it.
fn subtract(polygon: Vec<DVec3>, part: &[DVec3]) -> Vec<Vec<DVec3>> {
    let size = polygon.iter().map(|corner| corner.distance(polygon[0])).fold(0.0, f64::max);
    let mut rest = polygon.clone();
    let mut beyond = Vec::new();
    for (origin, out) in outward(part) {
        let height = |corner: DVec3| {
            let height = (corner - origin).dot(out);
            if height.abs() <= ROUNDING * size { 0.0 } else { height }
        };
        beyond.extend(clipped(&rest, height));
        match clipped(&rest, |corner| -height(corner)) {
            Some(inside) => rest = inside,
            // They share no area.
            None => return vec![polygon],
        }
    }
    beyond
}

/// For each edge a point of it, and the direction in the plane that leads out across it.
fn outward(polygon: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> {
    let edges = || polygon.iter().zip(polygon.iter().cycle().skip(1));
    let normal = area_vector(polygon);
    edges().map(move |(&a, &b)| (a, (b - a).cross(normal).normalize_or_zero()))
}

/// The part of a convex polygon where a linear function is positive, if it has an area.
fn clipped(polygon: &[DVec3], height: impl Fn(DVec3) -> f64) -> Option<Vec<DVec3>> {
    if polygon.iter().all(|&corner| height(corner) <= 0.0) {
        return None;
    }
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    polygon::clip(polygon, height, |corner| kept.push(corner));
    Some(kept)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, y: f64, side: f64) -> Vec<DVec3> {
        [(x, y), (x + side, y), (x + side, y + side), (x, y + side)].map(|(x, y)| DVec3::new(x, y, 1.0)).to_vec()
    }

    fn area(polygon: &[DVec3]) -> f64 {
        let edges = polygon.iter().zip(polygon.iter().cycle().skip(1));
        edges.map(|(&a, &b)| 0.5 * (a - polygon[0]).cross(b - polygon[0]).z).sum()
    }

    #[test]
    fn what_is_left_has_the_rest_of_the_area_and_the_same_front() {
        let wall = square(0.0, 0.0, 4.0);
        let mut backward = square(2.0, 2.0, 2.0);
        backward.reverse();
        let parts = [square(0.5, 1.0, 1.0), backward];
        let left = without(&wall, parts.iter().map(Vec::as_slice));
        assert!(left.iter().all(|polygon| area(polygon) > 0.0), "{left:?}");
        assert!((left.iter().map(|polygon| area(polygon)).sum::<f64>() - 11.0).abs() < 1e-12);
        for (inside, at) in [(false, [1.0, 1.5]), (false, [3.0, 3.0]), (true, [1.0, 3.0]), (true, [3.0, 0.5])] {
            let point = DVec3::new(at[0], at[1], 1.0);
            let holders = left.iter().filter(|polygon| contains(polygon, &[point], 0.0)).count();
            assert_eq!(holders, usize::from(inside), "{point}");
        }
        let beside = square(5.0, 0.0, 1.0);
        assert_eq!(without(&wall, [beside.as_slice()].into_iter()), [square(0.0, 0.0, 4.0)]);
        assert!(without(&wall, [wall.as_slice()].into_iter()).is_empty());
    }
}

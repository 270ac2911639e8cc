//! Polygons of any shape into triangles and convex quads.

use glam::{DVec2, DVec3};

/// Which corners of a polygon make a cell of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Piece {
    Triangle([usize; 3]),
    Quad([usize; 4]),
}

/// Triangles and convex quads stay as they are; everything else is triangulated by cutting off ears.
pub(super) fn pieces(corners: &[DVec3]) -> Vec<Piece> {
    match corners.len() {
        0..3 => Vec::new(),
        3 => vec![Piece::Triangle([0, 1, 2])],
        n => {
            let flat = project(corners);
            let convex = (0..n).all(|k| turn(flat[(k + n - 1) % n], flat[k], flat[(k + 1) % n]) > 0.0);
            if n == 4 && convex { vec![Piece::Quad([0, 1, 2, 3])] } else { cut_ears(&flat) }
        }
    }
}

/// Whether two edges of a polygon cross each other; that corners touch edges (as a bridge to a hole does) is no crossing.
pub(super) fn crosses_itself(corners: &[DVec3]) -> bool {
    let n = corners.len();
    if n < 4 {
        return false;
    }
    let flat = project(corners);
    let edge = |k: usize| [flat[k], flat[(k + 1) % n]];
    let apart = |[a, b]: [DVec2; 2], [p, q]: [DVec2; 2]| turn(a, b, p) * turn(a, b, q) < 0.0;
    (0..n).any(|i| (i + 2..n).any(|j| apart(edge(i), edge(j)) && apart(edge(j), edge(i))))
}

/// Area vectors shorter than this part of the widest triangle's are rounding.
const EVEN: f64 = 1e-9;

/// The corners in the plane of their mean normal (Newell's), counter-clockwise.
fn project(corners: &[DVec3]) -> Vec<DVec2> {
    let origin = corners[0];
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    let crosses = edges.map(|(&a, &b)| (a - origin).cross(b - origin));
    let (normal, widest) = crosses.fold((DVec3::ZERO, DVec3::ZERO), |(sum, widest): (DVec3, DVec3), cross| {
        (sum + cross, if cross.length_squared() > widest.length_squared() { cross } else { widest })
    });
    // The two wings of a bow tie may sum to nothing, or to rounding.
    let normal = if normal.length() > EVEN * widest.length() { normal } else { widest };
    let (x, y) = normal.try_normalize().unwrap_or(DVec3::Z).any_orthonormal_pair();
    corners.iter().map(|&c| DVec2::new((c - origin).dot(x), (c - origin).dot(y))).collect()
}

/// Twice the signed area of a triangle.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

fn contains([a, b, c]: [DVec2; 3], p: DVec2) -> bool {
    turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0
}

/// Ear clipping. Where no ear is left (the polygon crosses itself), the next corner is cut off regardless.
fn cut_ears(flat: &[DVec2]) -> Vec<Piece> {
    let mut rest: Vec<usize> = (0..flat.len()).collect();
    let mut cut = Vec::with_capacity(flat.len() - 2);
    while rest.len() > 3 {
        let n = rest.len();
        let around = |k: usize| [rest[(k + n - 1) % n], rest[k], rest[(k + 1) % n]];
        let is_ear = |&k: &usize| {
            let ear = around(k);
            let [a, b, c] = ear.map(|i| flat[i]);
            let others = rest.iter().filter(|i| !ear.contains(i));
            // A corner that merely touches one of the ear's (a bridge to a hole) is no obstacle.
            let blocks = |p: DVec2| p != a && p != b && p != c && contains([a, b, c], p);
            turn(a, b, c) > 0.0 && !others.into_iter().any(|&i| blocks(flat[i]))
        };
        let k = (0..n).find(is_ear).unwrap_or(1);
        cut.push(Piece::Triangle(around(k)));
        rest.remove(k);
    }
    cut.push(Piece::Triangle([rest[0], rest[1], rest[2]]));
    cut
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[DVec3]) -> f64 {
        let piece_area = |piece: &Piece| match *piece {
            Piece::Triangle(t) => 0.5 * (corners[t[1]] - corners[t[0]]).cross(corners[t[2]] - corners[t[0]]).length(),
            Piece::Quad(q) => 0.5 * (corners[q[2]] - corners[q[0]]).cross(corners[q[3]] - corners[q[1]]).length(),
        };
        pieces(corners).iter().map(piece_area).sum()
    }

    fn tilted(points: &[[f64; 2]]) -> Vec<DVec3> {
        let (x, y) = DVec3::new(0.3, -0.5, 0.8).normalize().any_orthonormal_pair();
        points.iter().map(|p| x * p[0] + y * p[1] + DVec3::ONE).collect()
    }

    #[test]
    fn convex_quads_stay_and_concave_ones_do_not() {
        let square = tilted(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        assert_eq!(pieces(&square), [Piece::Quad([0, 1, 2, 3])]);
        let dart = tilted(&[[0.0, 0.0], [2.0, 0.0], [0.5, 0.5], [0.0, 2.0]]);
        assert_eq!(pieces(&dart).len(), 2);
        assert!((area(&dart) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn ears_cover_an_l_shape_once() {
        let corner = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]];
        for shift in 0..corner.len() {
            let mut turned = corner;
            turned.rotate_left(shift);
            assert!((area(&tilted(&turned)) - 5.0).abs() < 1e-12, "first corner {shift}");
        }
    }

    #[test]
    fn a_polygon_that_crosses_itself_still_ends() {
        let bow = tilted(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0], [0.5, 2.0]]);
        assert_eq!(pieces(&bow).len(), 3);
    }
}

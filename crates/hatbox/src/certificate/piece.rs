//! Convex parts of cells, and what polynomials on them come to.

use super::LANES;
use crate::element::{Polynomial, monomials};
use crate::kernel::Plane;
use crate::mesh::polygon;
use arrayvec::ArrayVec;
use glam::DVec3;

/// The corners of a triangle or a convex quad.
pub(super) type Corners = ArrayVec<DVec3, 4>;

/// A part of a cell with a polynomial on it for each lane.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub(super) corners: Corners,
    pub(super) center: DVec3,
    pub(super) radius: f64,
    pub(super) area: f64,
    pub(super) mean: [f64; LANES],
    /// The length of the gradient g in the middle c, and ∫ g·(y − c) (y − c) dA.
    pub(super) slope: [f64; LANES],
    pub(super) moment: [DVec3; LANES],
    /// What mean and gradient may leave.
    pub(super) curved: [f64; LANES],
}

impl Piece {
    pub(super) fn new(corners: Corners, plane: &Plane, functions: &[Polynomial; LANES]) -> Self {
        let (center, radius) = middle(&corners);
        let area = polygon::area(&corners);
        let at = plane.project(center);
        let mut piece = Self {
            center,
            radius,
            area,
            mean: functions.map(|f| mean(&f, plane, &corners, center)),
            slope: [0.0; LANES],
            moment: [DVec3::ZERO; LANES],
            curved: [0.0; LANES],
            corners,
        };
        for (lane, f) in functions.iter().enumerate() {
            let across = [f[1] + 2.0 * f[3] * at.x + f[4] * at.y, f[2] + f[4] * at.x + 2.0 * f[5] * at.y];
            let gradient = plane.axes[0] * across[0] + plane.axes[1] * across[1];
            let curvature = (4.0 * f[3] * f[3] + 2.0 * f[4] * f[4] + 4.0 * f[5] * f[5]).sqrt();
            piece.slope[lane] = gradient.length();
            piece.moment[lane] = area * second_moment(&piece.corners, center, gradient);
            // ½|H|r² about the middle, and as much by which the mean differs from the value there.
            piece.curved[lane] = curvature * radius * radius;
        }
        piece
    }

    /// How far a value may be from the mean.
    pub(super) fn deviation(&self) -> [f64; LANES] {
        std::array::from_fn(|lane| self.slope[lane] * self.radius + self.curved[lane])
    }
}

/// The mean of the corners, and the greatest distance of one from it.
pub(super) fn middle(corners: &[DVec3]) -> (DVec3, f64) {
    let center = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let radius = corners.iter().map(|corner| corner.distance(center)).fold(0.0, f64::max);
    (center, radius)
}

/// The mean of a polynomial of degree 2, exact on triangles and parallelograms.
fn mean(f: &Polynomial, plane: &Plane, corners: &[DVec3], center: DVec3) -> f64 {
    let n = corners.len();
    let middles: f64 = (0..n).map(|k| evaluate(f, plane, corners[k].midpoint(corners[(k + 1) % n]))).sum();
    if n == 3 { middles / 3.0 } else { evaluate(f, plane, center) / 3.0 + middles / 6.0 }
}

/// The mean of g·(y − c) (y − c) over a triangle or a parallelogram.
fn second_moment(corners: &[DVec3], center: DVec3, gradient: DVec3) -> DVec3 {
    let square = |v: DVec3| v * v.dot(gradient);
    if corners.len() == 3 {
        corners.iter().map(|&corner| square(corner - center) / 12.0).sum()
    } else {
        (1..3).map(|k| square(0.5 * (corners[k] - corners[k - 1])) / 3.0).sum()
    }
}

/// The value at a point of the plane.
pub(super) fn evaluate(f: &Polynomial, plane: &Plane, point: DVec3) -> f64 {
    let at = plane.project(point);
    f.iter().zip(monomials([at.x, at.y])).map(|(c, m)| c * m).sum()
}

/// The four parts that the middles of the edges cut a triangle or a quad into.
pub(super) fn quarters(corners: &Corners) -> [Corners; 4] {
    let n = corners.len();
    let middle = |k: usize| corners[k % n].midpoint(corners[(k + 1) % n]);
    let center = corners.iter().sum::<DVec3>() / n as f64;
    std::array::from_fn(|k| match (n, k) {
        (3, 3) => [middle(0), middle(1), middle(2)].into_iter().collect(),
        (3, _) => [corners[k], middle(k), middle(k + 2)].into_iter().collect(),
        _ => [corners[k], middle(k), center, middle(k + 3)].into_iter().collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::Shape;
    use crate::mesh::Patch;
    use crate::quadrature::rule;

    fn shapes() -> [(Shape, Corners); 2] {
        let at = |x: f64, y: f64| DVec3::new(x, 0.5 * x + y, 2.0 - y);
        let triangle = [at(0.1, 0.0), at(1.2, 0.2), at(0.4, 0.9)].into_iter().collect();
        let parallelogram = [at(0.0, 0.0), at(1.0, 0.1), at(1.3, 0.8), at(0.3, 0.7)].into_iter().collect();
        [(Shape::Triangle, triangle), (Shape::Quad, parallelogram)]
    }

    #[test]
    fn means_and_moments_are_those_of_the_polynomial_and_bounds_hold() {
        let f = [0.3, -1.0, 2.0, 0.7, -0.4, 0.2];
        for (shape, corners) in shapes() {
            let patch = Patch::new(shape, std::array::from_fn(|k| corners[k.min(corners.len() - 1)]));
            let plane = Plane::new(corners[0], patch.normal());
            let piece = Piece::new(corners, &plane, &[f; LANES]);
            let rule = rule(shape, 4);
            let points = || rule.points.iter().map(|&at| patch.point(at)).zip(&rule.weights);
            let mean: f64 = points().map(|(y, w)| w * evaluate(&f, &plane, y)).sum();
            assert!((piece.mean[0] - mean).abs() < 1e-13 && (piece.area - patch.area()).abs() < 1e-14, "{shape:?}");
            // Without its curvature, the function's own first moment.
            let straight = [f[0], f[1], f[2], 0.0, 0.0, 0.0];
            let flat = Piece::new(piece.corners.clone(), &plane, &[straight; LANES]);
            let moment: DVec3 =
                points().map(|(y, w)| patch.area() * w * evaluate(&straight, &plane, y) * (y - flat.center)).sum();
            assert!((flat.moment[0] - moment).length() < 1e-13, "{shape:?}: {} {moment}", flat.moment[0]);
            for (y, _) in points() {
                assert!((evaluate(&f, &plane, y) - mean).abs() <= piece.deviation()[0], "{shape:?}");
            }
        }
    }

    #[test]
    fn quarters_are_the_whole() {
        for (_, corners) in shapes() {
            let parts = quarters(&corners).map(|part| polygon::area_vector(&part));
            assert!((parts.iter().sum::<DVec3>() - polygon::area_vector(&corners)).length() < 1e-14);
            assert!(parts.iter().all(|part| (*part - parts[0]).length() < 1e-14), "they are alike: {parts:?}");
        }
    }
}

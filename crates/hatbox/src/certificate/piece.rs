//! Convex parts of cells, and what polynomials on them come to.

use super::LANES;
use crate::element::{Polynomial, Shape, monomials};
use crate::kernel::Plane;
use crate::mesh::Patch;
use glam::DVec3;

/// A part of a cell with a polynomial on it for each lane.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    pub(super) patch: Patch,
    pub(super) center: DVec3,
    pub(super) radius: f64,
    pub(super) mean: [f64; LANES],
    /// The length of the gradient g in the middle c, and ∫ g·(y − c) (y − c) dA.
    pub(super) slope: [f64; LANES],
    pub(super) moment: [DVec3; LANES],
    /// What mean and gradient may leave.
    pub(super) curved: [f64; LANES],
}

impl Piece {
    pub(super) fn new(patch: Patch, plane: &Plane, functions: &[Polynomial; LANES]) -> Self {
        let (center, radius) = (patch.center(), patch.radius());
        let at = plane.project(center);
        let mut piece = Self {
            patch,
            center,
            radius,
            mean: functions.map(|f| mean(&f, plane, patch.corners(), center)),
            slope: [0.0; LANES],
            moment: [DVec3::ZERO; LANES],
            curved: [0.0; LANES],
        };
        for (lane, f) in functions.iter().enumerate() {
            let across = [f[1] + 2.0 * f[3] * at.x + f[4] * at.y, f[2] + f[4] * at.x + 2.0 * f[5] * at.y];
            let gradient = plane.axes[0] * across[0] + plane.axes[1] * across[1];
            let curvature = (4.0 * f[3] * f[3] + 2.0 * f[4] * f[4] + 4.0 * f[5] * f[5]).sqrt();
            piece.slope[lane] = gradient.length();
            piece.moment[lane] = patch.area() * second_moment(patch.corners(), center, gradient);
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
pub(super) fn quarters(patch: &Patch) -> [Patch; 4] {
    let (corners, center) = (patch.corners(), patch.center());
    let n = corners.len();
    let middle = |k: usize| corners[k % n].midpoint(corners[(k + 1) % n]);
    std::array::from_fn(|k| {
        let part = match (patch.shape(), k) {
            (Shape::Triangle, 3) => [middle(0), middle(1), middle(2), middle(2)],
            (Shape::Triangle, _) => [corners[k], middle(k), middle(k + 2), middle(k + 2)],
            (Shape::Quad, _) => [corners[k], middle(k), center, middle(k + 3)],
        };
        Patch::new(patch.shape(), part)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quadrature::rule;

    fn shapes() -> [Patch; 2] {
        let at = |x: f64, y: f64| DVec3::new(x, 0.5 * x + y, 2.0 - y);
        let triangle = [at(0.1, 0.0), at(1.2, 0.2), at(0.4, 0.9), at(0.4, 0.9)];
        let parallelogram = [at(0.0, 0.0), at(1.0, 0.1), at(1.3, 0.8), at(0.3, 0.7)];
        [Patch::new(Shape::Triangle, triangle), Patch::new(Shape::Quad, parallelogram)]
    }

    #[test]
    fn means_and_moments_are_those_of_the_polynomial_and_bounds_hold() {
        let f = [0.3, -1.0, 2.0, 0.7, -0.4, 0.2];
        for patch in shapes() {
            let (shape, plane) = (patch.shape(), Plane::new(patch.corners()[0], patch.normal()));
            let piece = Piece::new(patch, &plane, &[f; LANES]);
            let rule = rule(shape, 4);
            let points = || rule.points.iter().map(|&at| patch.point(at)).zip(&rule.weights);
            let mean: f64 = points().map(|(y, w)| w * evaluate(&f, &plane, y)).sum();
            assert!((piece.mean[0] - mean).abs() < 1e-13, "{shape:?}");
            // Without its curvature, the function's own first moment.
            let straight = [f[0], f[1], f[2], 0.0, 0.0, 0.0];
            let flat = Piece::new(patch, &plane, &[straight; LANES]);
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
        for patch in shapes() {
            for part in quarters(&patch) {
                assert!((part.area() - 0.25 * patch.area()).abs() < 1e-14 && part.normal().dot(patch.normal()) > 0.999);
                assert!(part.corners().iter().all(|&corner| {
                    let [x, y] = patch.locate(corner);
                    x.min(y) > -1e-12 && patch.shape() == Shape::Quad || x + y < 1.0 + 1e-12
                }));
            }
        }
    }
}

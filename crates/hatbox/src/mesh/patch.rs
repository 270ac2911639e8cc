use crate::element::Shape;
use glam::DVec3;

/// The geometry of one planar cell: the map from reference coordinates to space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    shape: Shape,
    corners: [DVec3; 4],
    normal: DVec3,
    area: f64,
}

impl Patch {
    /// From the corners, counter-clockwise from the lit side; a triangle repeats its last.
    pub fn new(shape: Shape, corners: [DVec3; 4]) -> Self {
        let [a, b, c, d] = corners;
        // Half the cross product of the diagonals is the area vector of a quad; for a triangle d = c.
        let area_vector = 0.5 * (c - a).cross(d - b);
        let area_vector = if shape == Shape::Triangle { 0.5 * (b - a).cross(c - a) } else { area_vector };
        let area = area_vector.length();
        let normal = if area > 0.0 { area_vector / area } else { DVec3::ZERO };
        Self { shape, corners, normal, area }
    }

    /// Triangle or quad.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The corners.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners[..self.shape.corners()]
    }

    /// The unit normal on the lit side; zero if the cell has no area.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// The area.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// The mean of the corners.
    pub fn center(&self) -> DVec3 {
        let corners = self.corners();
        corners.iter().sum::<DVec3>() / corners.len() as f64
    }

    /// The greatest distance of a corner from the center.
    pub fn radius(&self) -> f64 {
        let center = self.center();
        self.corners().iter().map(|c| c.distance(center)).fold(0.0, f64::max)
    }

    /// The length of the longest edge.
    pub fn longest_edge(&self) -> f64 {
        let corners = self.corners();
        (0..corners.len()).map(|k| corners[k].distance(corners[(k + 1) % corners.len()])).fold(0.0, f64::max)
    }

    /// The point of reference coordinates ξ.
    pub fn point(&self, at: [f64; 2]) -> DVec3 {
        let weights = self.shape.corner_weights(at);
        self.corners.iter().zip(weights).map(|(&corner, w)| corner * w).sum()
    }

    /// The Jacobian of the map, dA/dξdη: constant unless the patch is a quad that is no parallelogram.
    pub fn jacobian(&self, [x, y]: [f64; 2]) -> f64 {
        match self.shape {
            Shape::Triangle => 2.0 * self.area,
            Shape::Quad => {
                let [a, b, c, d] = self.corners;
                let dx = (b - a) * (1.0 - y) + (c - d) * y;
                let dy = (d - a) * (1.0 - x) + (c - b) * x;
                dx.cross(dy).dot(self.normal)
            }
        }
    }

    /// Whether the map is affine: a triangle, or a parallelogram to the precision of files (1e-6 of its size).
    pub fn is_affine(&self) -> bool {
        self.is_affine_to(1e-6)
    }

    /// Whether it is a triangle, or a parallelogram to so much of its size.
    pub fn is_affine_to(&self, tolerance: f64) -> bool {
        let [a, b, c, d] = self.corners;
        self.shape == Shape::Triangle || (a - b + c - d).length() <= tolerance * (c - a).length()
    }

    /// The reference coordinates of a point of the patch's plane (Newton's method on quads, exact on affine ones).
    pub fn locate(&self, point: DVec3) -> [f64; 2] {
        let [a, b, c, d] = self.corners;
        let (mut x, mut y) = (0.0, 0.0);
        let steps = if self.is_affine() { 1 } else { 20 };
        for _ in 0..steps {
            let (dx, dy) = match self.shape {
                Shape::Triangle => (b - a, c - a),
                Shape::Quad => ((b - a) * (1.0 - y) + (c - d) * y, (d - a) * (1.0 - x) + (c - b) * x),
            };
            let r = point - self.point([x, y]);
            let det = dx.cross(dy).dot(self.normal);
            if det == 0.0 {
                break;
            }
            x += r.cross(dy).dot(self.normal) / det;
            y += dx.cross(r).dot(self.normal) / det;
        }
        [x, y]
    }

    /// The two triangles of a quad along its diagonal 0–2, or the triangle itself, as corner indices.
    pub fn triangles(&self) -> &'static [[usize; 3]] {
        match self.shape {
            Shape::Triangle => &[[0, 1, 2]],
            Shape::Quad => &[[0, 1, 2], [0, 2, 3]],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trapezoid() -> Patch {
        let at = |x: f64, y: f64| DVec3::new(x, 0.3 * x + y, 2.0 - x);
        Patch::new(Shape::Quad, [at(0.0, 0.0), at(2.0, 0.0), at(1.5, 1.0), at(0.25, 1.0)])
    }

    #[test]
    fn locate_undoes_point() {
        let triangle = Patch::new(Shape::Triangle, [DVec3::X, DVec3::Y, DVec3::Z, DVec3::Z]);
        for patch in [trapezoid(), triangle] {
            for at in [[0.1, 0.2], [0.5, 0.45], [0.0, 1.0]] {
                let back = patch.locate(patch.point(at));
                assert!((back[0] - at[0]).abs() + (back[1] - at[1]).abs() < 1e-12, "{at:?} {back:?}");
            }
        }
    }

    #[test]
    fn the_jacobian_integrates_to_the_area() {
        // Bilinear in each variable: the midpoint rule is exact.
        let patch = trapezoid();
        assert!((patch.jacobian([0.5, 0.5]) - patch.area()).abs() < 1e-14);
        assert!(!patch.is_affine());
    }
}

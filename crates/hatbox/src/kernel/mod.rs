//! The kernel G of the radiosity equation, and its integrals over a polygon in closed form.
//!
//! G(x, y) = cosθ_x cosθ_y / (π |x − y|²), with both cosines cut off at zero: a surface neither sends nor receives
//! behind itself. Visibility is not in here; it belongs to quadrature nodes ([`crate::visibility`]).

mod clausen;
mod closed_form;

pub use closed_form::{Moments, Plane};

use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, TAU};

/// G(x, y) in 1/m² for unit normals `nx` and `ny`; 0 where either point is behind the other's horizon.
pub fn geometric(x: DVec3, nx: DVec3, y: DVec3, ny: DVec3) -> f64 {
    let d = y - x;
    let r2 = d.length_squared();
    let (at_x, at_y) = (nx.dot(d).max(0.0), (-ny.dot(d)).max(0.0));
    if r2 > 0.0 { FRAC_1_PI * at_x * at_y / (r2 * r2) } else { 0.0 }
}

/// Axes at right angles about a unit normal.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    axes: [DVec3; 3],
}

impl Frame {
    /// Whose last axis is the normal.
    pub fn about(normal: DVec3) -> Self {
        let e1 = normal.any_orthonormal_vector();
        Self { axes: [e1, normal.cross(e1), normal] }
    }

    /// The direction, distributed like the cosine with the normal, of two uniform numbers: a point of the disc, lifted onto
    /// the hemisphere.
    #[inline]
    pub fn cosine(&self, s: f64, t: f64) -> DVec3 {
        let (radius, (sin, cos)) = (s.sqrt(), (TAU * t).sin_cos());
        self.axes[0] * (radius * cos) + self.axes[1] * (radius * sin) + self.axes[2] * (1.0 - s).sqrt()
    }
}

/// Points of one plane with their weights, coordinates apart, as the inner loops want them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Points {
    /// First coordinates.
    pub x: Vec<f64>,
    /// Second coordinates.
    pub y: Vec<f64>,
    /// Third coordinates.
    pub z: Vec<f64>,
    /// Quadrature weights in m².
    pub weight: Vec<f64>,
}

impl Points {
    /// None, with memory for so many.
    pub fn with_capacity(count: usize) -> Self {
        let room = || Vec::with_capacity(count);
        Self { x: room(), y: room(), z: room(), weight: room() }
    }

    /// Adds a point.
    pub fn push(&mut self, point: DVec3, weight: f64) {
        self.x.push(point.x);
        self.y.push(point.y);
        self.z.push(point.z);
        self.weight.push(weight);
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.weight.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.weight.is_empty()
    }

    /// Point `k`.
    pub fn at(&self, k: usize) -> DVec3 {
        DVec3::new(self.x[k], self.y[k], self.z[k])
    }
}

/// `out[k] = w_k G(x, y_k)` for every point y_k of a plane of normal `ny`.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
pub fn weighted_row(x: DVec3, nx: DVec3, y: &Points, ny: DVec3, out: &mut [f64]) {
    let n = out.len();
    let (ys, zs, ws) = (&y.y[..n], &y.z[..n], &y.weight[..n]);
    for (k, px) in y.x[..n].iter().enumerate() {
        let (dx, dy, dz) = (px - x.x, ys[k] - x.y, zs[k] - x.z);
        let r2 = dx * dx + dy * dy + dz * dz;
        let at_x = (nx.x * dx + nx.y * dy + nx.z * dz).max(0.0);
        let at_y = (-(ny.x * dx + ny.y * dy + ny.z * dz)).max(0.0);
        out[k] = FRAC_1_PI * ws[k] * at_x * at_y / (r2 * r2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_row_is_the_kernel_times_the_weights() {
        let mut points = Points::default();
        for k in 0..13 {
            let t = f64::from(k);
            points.push(DVec3::new(0.1 * t, (0.7 * t).sin(), 1.0), 0.5 + t);
        }
        let (x, nx, ny) = (DVec3::new(0.2, 0.1, -0.3), DVec3::new(0.6, 0.0, 0.8), DVec3::NEG_Z);
        let mut row = vec![0.0; points.len()];
        weighted_row(x, nx, &points, ny, &mut row);
        for (k, value) in row.iter().enumerate() {
            let expected = points.weight[k] * geometric(x, nx, points.at(k), ny);
            assert!((value - expected).abs() <= 1e-14 * expected, "{k}: {value} {expected}");
        }
    }

    #[test]
    fn the_kernel_is_symmetric_and_zero_behind_the_horizon() {
        let (x, y) = (DVec3::ZERO, DVec3::new(0.5, 0.0, 2.0));
        let (n, m) = (DVec3::Z, DVec3::new(0.0, 0.6, -0.8));
        assert!((geometric(x, n, y, m) - geometric(y, m, x, n)).abs() < 1e-16);
        assert_eq!(geometric(x, -n, y, m), 0.0);
        assert_eq!(geometric(x, n, y, -m), 0.0);
    }
}

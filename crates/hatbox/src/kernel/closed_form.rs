//! Irradiance from a polygon whose exitance is a polynomial of degree ≤ 2, in closed form.
//!
//! With ρ the position in the source plane seen from the foot of the receiver's perpendicular, H its length, D = ρ² + H²,
//! the kernel towards a receiver of normal n = g + n_m m is G = H (g·ρ − H n_m) / (π D²), and the moments of G follow
//! from the tensors ∫ρ…ρ/D² by the divergence theorem, ∂(1/D) = −2ρ/D². Everything is elementary but
//! K = ∫1/D dA = Σ ½∫ d ln(1 + (d²+s²)/H²)/(d²+s²) ds, a dilogarithm per edge end; the sum of the zeroth moments is
//! Lambert's formula. Gauss points for K were tried: 16 to 32 per edge cost more and lose digits near edges.
//!
//! The formulas are exact for any convex or concave polygon on the front side of the receiver; they cancel in the far
//! field, where Gauss rules belong. Source: J. H. Lambert, *Photometria* (1760) for the constant; P. Schröder,
//! P. Hanrahan, "On the form factor between two polygons" (SIGGRAPH 1993) for where the dilogarithm enters.

use super::clausen::im_dilogarithm;
use crate::element::Polynomial;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_1_PI, PI};

/// An orthonormal frame in the plane of a source polygon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// A point of the plane.
    pub origin: DVec3,
    /// Unit vectors e₁, e₂ in the plane and the unit normal m = e₁ × e₂.
    pub axes: [DVec3; 3],
}

impl Plane {
    /// The frame at `origin` with normal `normal` (a unit vector).
    pub fn new(origin: DVec3, normal: DVec3) -> Self {
        let e1 = normal.any_orthonormal_vector();
        Self { origin, axes: [e1, normal.cross(e1), normal] }
    }

    /// In-plane coordinates of (the projection of) a point.
    pub fn project(&self, point: DVec3) -> DVec2 {
        let d = point - self.origin;
        DVec2::new(d.dot(self.axes[0]), d.dot(self.axes[1]))
    }
}

/// The integrals of G against (1, ρ₁, ρ₂, ρ₁², ρ₁ρ₂, ρ₂²) over a polygon, ρ being the in-plane position relative to the
/// foot of the receiver point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// In-plane coordinates of the foot of the receiver.
    pub foot: DVec2,
    /// The six integrals; those above the requested degree are zero.
    pub values: [f64; 6],
}

impl Moments {
    /// The moments up to `degree` at the receiver `x` with unit normal `n`, for a polygon in `plane` with corners
    /// `polygon` (in-plane coordinates, counter-clockwise about the plane's normal).
    ///
    /// The polygon must not cross the receiver's horizon; clip it first. Zero if `x` is not in front of the plane.
    pub fn new(plane: &Plane, polygon: &[DVec2], x: DVec3, n: DVec3, degree: usize) -> Self {
        let foot = plane.project(x);
        let height = (x - plane.origin).dot(plane.axes[2]);
        let mut values = [0.0; 6];
        if height > 0.0 {
            let [e1, e2, m] = plane.axes;
            let (g, nm) = (DVec2::new(n.dot(e1), n.dot(e2)), n.dot(m));
            let tensors = Tensors::new(polygon, foot, height, degree, g);
            let count = [1, 3, 6][degree.min(2)];
            values[..count].copy_from_slice(&tensors.moments(g, nm, height)[..count]);
        }
        Self { foot, values }
    }

    /// ∫ p G over the polygon for a polynomial p of the in-plane coordinates, given on (1, x, y, x², xy, y²).
    pub fn integrate(&self, p: &Polynomial) -> f64 {
        let (f, m) = (self.foot, &self.values);
        let value = p[0] + f.x * (p[1] + p[3] * f.x + p[4] * f.y) + f.y * (p[2] + p[5] * f.y);
        let slope_x = p[1] + 2.0 * p[3] * f.x + p[4] * f.y;
        let slope_y = p[2] + p[4] * f.x + 2.0 * p[5] * f.y;
        value * m[0] + slope_x * m[1] + slope_y * m[2] + p[3] * m[3] + p[4] * m[4] + p[5] * m[5]
    }
}

/// ∫dA/D², ∫ρᵢ/D², ∫ρᵢρⱼ/D² and gₖ∫ρᵢρⱼρₖ/D².
#[derive(Default)]
struct Tensors {
    zeroth: f64,
    first: DVec2,
    second: [f64; 3],
    third: [f64; 3],
}

impl Tensors {
    fn new(polygon: &[DVec2], foot: DVec2, height: f64, degree: usize, g: DVec2) -> Self {
        let mut t = Self::default();
        // K enters only through g and the second moments; a receiver parallel to the source needs it for degree 2 alone.
        let needs_k = degree >= 2 || (degree == 1 && g.length_squared() > 0.0);
        let mut k = 0.0;
        // ½∮ν ln D ds = ∫ρ/D dA
        let mut first_over_d = DVec2::ZERO;
        for (i, &corner) in polygon.iter().enumerate() {
            let Some(edge) = Edge::new(corner - foot, polygon[(i + 1) % polygon.len()] - foot, height) else {
                continue;
            };
            let Edge { u, nu, d, a, .. } = edge;
            t.zeroth += d * a / (2.0 * height * height);
            t.first -= 0.5 * a * nu;
            if degree == 0 {
                continue;
            }
            let lambda = edge.lambda();
            // ∫ρⱼ/D ds along the edge
            let line = d * a * nu + lambda * u;
            t.second[0] -= 0.5 * nu.x * line.x;
            t.second[1] -= 0.5 * nu.x * line.y;
            t.second[2] -= 0.5 * nu.y * line.y;
            if needs_k {
                k += edge.k(height);
            }
            if degree >= 2 {
                first_over_d += 0.5 * edge.log_integral() * nu;
                edge.add_third(&mut t.third, lambda, g);
            }
        }
        t.second[0] += 0.5 * k;
        t.second[2] += 0.5 * k;
        if degree >= 2 {
            // +½(δᵢⱼ pₖ + δᵢₖ pⱼ) gₖ with p = ∫ρ/D, symmetric in i and j only in sum with the edges' terms.
            t.third[0] += 0.5 * (g.dot(first_over_d) + g.x * first_over_d.x);
            t.third[1] += 0.5 * g.x * first_over_d.y;
            t.third[2] += 0.5 * (g.dot(first_over_d) + g.y * first_over_d.y);
        }
        t
    }

    /// ∫ρ…ρ G = (H/π)(g·T_{+1} − H n_m T).
    fn moments(&self, g: DVec2, nm: f64, height: f64) -> [f64; 6] {
        let scale = FRAC_1_PI * height;
        let hn = height * nm;
        let [s11, s12, s22] = self.second;
        [
            g.dot(self.first) - hn * self.zeroth,
            g.x * s11 + g.y * s12 - hn * self.first.x,
            g.x * s12 + g.y * s22 - hn * self.first.y,
            self.third[0] - hn * s11,
            self.third[1] - hn * s12,
            self.third[2] - hn * s22,
        ]
        .map(|m| scale * m)
    }
}

/// One edge in the frame (ν, u): points are d ν + s u with s from s₀ to s₁.
struct Edge {
    u: DVec2,
    nu: DVec2,
    d: f64,
    s: [f64; 2],
    /// d² + H²
    q2: f64,
    /// ∫ds/D
    a: f64,
}

impl Edge {
    fn new(from: DVec2, to: DVec2, height: f64) -> Option<Self> {
        let length = from.distance(to);
        if length == 0.0 {
            return None;
        }
        let u = (to - from) / length;
        // Outward for a counter-clockwise polygon.
        let nu = DVec2::new(u.y, -u.x);
        let d = nu.dot(from);
        let s = [u.dot(from), u.dot(to)];
        let q2 = d * d + height * height;
        let q = q2.sqrt();
        let a = ((s[1] - s[0]) * q).atan2(q2 + s[0] * s[1]) / q;
        Some(Self { u, nu, d, s, q2, a })
    }

    /// ∫s/D ds = ½ ln(D₁/D₀).
    fn lambda(&self) -> f64 {
        let [s0, s1] = self.s;
        let [d0, d1] = [s0, s1].map(|s| s * s + self.q2);
        let growth = (s1 - s0) * (s1 + s0) / d0;
        // Exact for short edges; where D falls to nothing, beside a corner, 1 + growth would be rounded to nothing, too.
        if growth > -0.5 { 0.5 * growth.ln_1p() } else { 0.5 * (d1 / d0).ln() }
    }

    /// ∫ln D ds.
    fn log_integral(&self) -> f64 {
        let primitive = |s: f64| s * (s * s + self.q2).ln() - 2.0 * s;
        primitive(self.s[1]) - primitive(self.s[0]) + 2.0 * self.q2 * self.a
    }

    /// ½∫ d ln(1 + (d²+s²)/H²)/(d²+s²) ds. With s = |d| tan φ it is ½∫ln(1 + k²/cos²φ) dφ, k = |d|/H, and
    /// cos²φ + k² = |1 + q e^{2iφ}|²/(4q) for q = (√(1+k²) − k)², whose logarithm integrates to Im Li₂(−q e^{2iφ}).
    fn k(&self, height: f64) -> f64 {
        if self.d == 0.0 {
            return 0.0;
        }
        let k = self.d.abs() / height;
        let root_q = 1.0 / ((1.0 + k * k).sqrt() + k);
        let q = root_q * root_q;
        let primitive = |s: f64| {
            let phi = s.atan2(self.d.abs());
            let theta = 2.0 * phi + PI;
            0.5 * (-2.0 * phi * root_q.ln() - im_dilogarithm(q, theta) + im_dilogarithm(1.0, theta))
        };
        self.d.signum() * (primitive(self.s[1]) - primitive(self.s[0]))
    }

    /// −½νᵢ gₖ∫ρⱼρₖ/D ds, added to the components 11, 12, 22.
    fn add_third(&self, third: &mut [f64; 3], lambda: f64, g: DVec2) {
        let Self { u, nu, d, s, q2, a } = *self;
        let (g_nu, g_u) = (g.dot(nu), g.dot(u));
        let squared = s[1] - s[0] - q2 * a;
        let line = (d * d * a * g_nu + d * lambda * g_u) * nu + (d * lambda * g_nu + squared * g_u) * u;
        third[0] -= 0.5 * nu.x * line.x;
        third[1] -= 0.5 * nu.x * line.y;
        third[2] -= 0.5 * nu.y * line.y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::geometric;
    use crate::quadrature::gauss_legendre;

    /// Brute force: the polygon fanned from its corner 0, each triangle cut into n² by collapsed Gauss rules.
    fn brute(plane: &Plane, polygon: &[DVec2], x: DVec3, n: DVec3, p: impl Fn(DVec2) -> f64) -> f64 {
        let gauss = gauss_legendre(60);
        let [e1, e2, m] = plane.axes;
        let mut sum = 0.0;
        for k in 1..polygon.len() - 1 {
            let (a, b, c) = (polygon[0], polygon[k], polygon[k + 1]);
            let area = 0.5 * (b - a).perp_dot(c - a);
            for (&(s, ws), &(t, wt)) in gauss.iter().flat_map(|s| gauss.iter().map(move |t| (s, t))) {
                let at = a + (b - a) * s * (1.0 - t) + (c - a) * s * t;
                let y = plane.origin + e1 * at.x + e2 * at.y;
                sum += 2.0 * area * s * ws * wt * p(at) * geometric(x, n, y, m);
            }
        }
        sum
    }

    fn plane() -> Plane {
        Plane::new(DVec3::new(0.3, -0.2, 1.0), DVec3::new(0.36, 0.48, 0.8))
    }

    #[test]
    fn moments_match_brute_force() {
        let polygon = [(0.0, 0.0), (1.1, -0.2), (1.4, 0.7), (0.3, 1.2)].map(|(x, y)| DVec2::new(x, y));
        let plane = plane();
        let [e1, e2, m] = plane.axes;
        let basis: [fn(DVec2) -> f64; 6] = [|_| 1.0, |p| p.x, |p| p.y, |p| p.x * p.x, |p| p.x * p.y, |p| p.y * p.y];
        for (foot, height, normal) in [
            ((0.4, 0.5), 0.7, -m),
            ((-0.8, 0.5), 0.5, (e1 - 0.3 * m).normalize()),
            ((2.5, -0.3), 0.3, (-e1 + 0.4 * e2 + 0.02 * m).normalize()),
            ((0.5, 2.0), 0.9, (-e2 - m).normalize()),
        ] {
            let x = plane.origin + e1 * foot.0 + e2 * foot.1 + m * height;
            let moments = Moments::new(&plane, &polygon, x, normal, 2);
            for (k, function) in basis.iter().enumerate() {
                let exact = moments.integrate(&std::array::from_fn(|i| f64::from(u8::from(i == k))));
                let sum = brute(&plane, &polygon, x, normal, function);
                assert!((exact - sum).abs() < 1e-12, "moment {k} at {foot:?}: {exact} {sum}");
            }
            for degree in 0..2 {
                let lower = Moments::new(&plane, &polygon, x, normal, degree);
                for k in 0..[1, 3][degree] {
                    assert!((lower.values[k] - moments.values[k]).abs() < 1e-15, "degree {degree}");
                }
                assert!(lower.values[[1, 3][degree]..].iter().all(|&m| m == 0.0), "degree {degree}");
            }
        }
    }

    #[test]
    fn a_receiver_close_to_the_source_sees_half_space() {
        let polygon = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec2::new(x, y));
        let plane = plane();
        for height in [1e-3, 1e-6, 1e-9] {
            let x = plane.origin + plane.axes[2] * height;
            let moments = Moments::new(&plane, &polygon, x, -plane.axes[2], 2);
            assert!((moments.values[0] - 1.0).abs() < 4.0 * height * height + 1e-15, "{height}");
            assert!(moments.values[3].abs() < 20.0 * height * height * (1.0 - height.ln()), "{height}");
        }
    }

    /// A point of the wall that meets the source in an edge, a rounding error away from the edge and a billionth along
    /// it from a corner, as creases of shadows leave them.
    #[test]
    fn a_receiver_beside_a_corner_gets_a_number() {
        let plane = Plane { origin: DVec3::ZERO, axes: [DVec3::X, DVec3::Y, DVec3::Z] };
        for corners in [[(0.0, 0.0), (18.0, 0.0), (9.0, 10.0)], [(0.0, 0.0), (-9.0, 10.0), (-18.0, 0.0)]] {
            let polygon = corners.map(|(x, y)| DVec2::new(x, y));
            let at = |along: f64, height: f64| {
                let x = DVec3::new(along, -1e-14, height);
                Moments::new(&plane, &polygon, x, DVec3::Y, 2)
            };
            for along in [-4e-9, -1e-12, 0.0, 1e-12, 4e-9] {
                for height in [1e-9, 1e-14, 1e-20] {
                    let moments = at(along, height);
                    assert!(moments.values.iter().all(|value| value.is_finite()), "{along} {height}: {moments:?}");
                    assert!((0.0..=0.5).contains(&moments.values[0]), "{along} {height}: {moments:?}");
                }
            }
        }
    }

    #[test]
    fn a_point_behind_the_source_receives_nothing() {
        let polygon = [DVec2::ZERO, DVec2::X, DVec2::Y];
        let plane = plane();
        let x = plane.origin - plane.axes[2];
        assert_eq!(Moments::new(&plane, &polygon, x, plane.axes[2], 2).values, [0.0; 6]);
    }
}

//! Closed forms of exchange areas A F, numbered as in J. R. Howell's catalogue.

use hatbox::quadrature::gauss_legendre;
use std::f64::consts::{FRAC_PI_4, PI};

/// The sum over the ends of four ranges, with alternating signs.
fn alternating(ranges: [[f64; 2]; 4], primitive: impl Fn([f64; 4]) -> f64) -> f64 {
    let term = |k: usize| {
        let sign = if k.count_ones().is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * primitive(std::array::from_fn(|n| ranges[n][k >> n & 1]))
    };
    (0..16).map(term).sum()
}

/// C-13: parallel rectangles x × y and ξ × η at a distance.
pub(crate) fn parallel(x: [f64; 2], y: [f64; 2], xi: [f64; 2], eta: [f64; 2], z: f64) -> f64 {
    let z2 = z * z;
    let primitive = |[x, y, xi, eta]: [f64; 4]| {
        let (a, b) = (y - eta, x - xi);
        let (p, q) = ((b * b + z2).sqrt(), (a * a + z2).sqrt());
        let log = 0.5 * z2 * (a * a + b * b + z2).ln();
        (a * p * (a / p).atan() + b * q * (b / q).atan() - log) / (2.0 * PI)
    };
    alternating([x, y, xi, eta], primitive)
}

/// C-15: x × y in the plane z = 0, η × ξ (along y and z) in the plane x = 0.
pub(crate) fn perpendicular(x: [f64; 2], y: [f64; 2], xi: [f64; 2], eta: [f64; 2]) -> f64 {
    let primitive = |[x, xi, y, eta]: [f64; 4]| {
        let (c2, d) = (x * x + xi * xi, y - eta);
        let c = c2.sqrt();
        let log = if c2 + d * d > 0.0 { 0.25 * (c2 - d * d) * (c2 + d * d).ln() } else { 0.0 };
        let atan = if c > 0.0 { d * c * (d / c).atan() } else { 0.0 };
        (atan - log) / (2.0 * PI)
    };
    alternating([x, xi, y, eta], primitive).abs()
}

/// C-16: unit squares that share an edge at an angle, as an integral over one angle of smooth terms: along the edge
/// ∬ dz dz'/r⁴ = atan(1/s)/s³, and the distance from the edge is integrated in polar coordinates.
pub(crate) fn hinged(phi: f64) -> f64 {
    const PIECES: u32 = 400;
    let rule = gauss_legendre(16);
    let integrand = |theta: f64| {
        let sigma = (1.0 - (2.0 * theta).sin() * phi.cos()).sqrt();
        let far = 1.0 / theta.cos();
        let radial = far * (1.0 / (far * sigma)).atan() + (far * sigma).powi(2).ln_1p() / (2.0 * sigma);
        theta.sin() * theta.cos() * radial / sigma.powi(3)
    };
    let width = FRAC_PI_4 / f64::from(PIECES);
    let piece = |k: u32| rule.iter().map(|&(x, w)| w * integrand((f64::from(k) + x) * width)).sum::<f64>();
    2.0 * phi.sin().powi(2) / PI * width * (0..PIECES).map(piece).sum::<f64>()
}

//! Im Li₂ in the unit disk: the one function in the closed forms that is not elementary.

use std::f64::consts::PI;

/// B₂ₖ/(2k+1)! for k = 1, 2, …: the coefficients of Li₂ in powers of u = −ln(1−z).
const BERNOULLI: [f64; 11] = [
    2.777_777_777_777_778e-2,
    -2.777_777_777_777_778e-4,
    4.724_111_866_969_01e-6,
    -9.185_773_074_661_964e-8,
    1.897_886_998_897_1e-9,
    -4.064_761_645_144_225_6e-11,
    8.921_691_020_456_453e-13,
    -1.993_929_586_072_107_4e-14,
    4.518_980_029_619_918e-16,
    -1.035_651_761_218_125e-17,
    2.395_218_621_026_187e-19,
];

/// Im Li₂(r e^{iθ}) for 0 ≤ r ≤ 1, to about 1e-15. For r = 1 this is Clausen's function Cl₂(θ).
///
/// Li₂(z) = u − u²/4 + Σ B₂ₖ u^{2k+1}/(2k+1)! with u = −ln(1−z), after Li₂(z) = π²/6 − ln z ln(1−z) − Li₂(1−z) has
/// moved arguments with Re z > ½ away from the branch point 1 (L. Lewin, *Polylogarithms and Associated Functions*,
/// North-Holland 1981, chapter 1).
pub(super) fn im_dilogarithm(r: f64, theta: f64) -> f64 {
    let (re, im) = (r * theta.cos(), r * theta.sin());
    if im == 0.0 {
        return 0.0;
    }
    // ln(1 − z)
    let (a, b) = (0.5 * ((1.0 - re) * (1.0 - re) + im * im).ln(), (-im).atan2(1.0 - re));
    if re <= 0.5 {
        return im_series(-a, -b);
    }
    let reduced = theta - (theta / (2.0 * PI)).round() * 2.0 * PI;
    // Li₂(1 − z) has u = −ln z; its argument lies in the left half of the disk.
    let (c, d) = (r.ln(), reduced);
    -(c * b + d * a) - im_series(-c, -d)
}

/// The imaginary part of the series at u = a + ib.
fn im_series(a: f64, b: f64) -> f64 {
    let (a2, b2) = (a * a - b * b, 2.0 * a * b);
    let (mut re, mut im) = (0.0, 0.0);
    for c in BERNOULLI.iter().rev() {
        (re, im) = (c + re * a2 - im * b2, re * b2 + im * a2);
    }
    // u (1 + u² Σ) − u²/4
    let (p, q) = (1.0 + re * a2 - im * b2, re * b2 + im * a2);
    a * q + b * p - 0.25 * b2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_the_power_series() {
        for r in [0.0_f64, 0.1, 0.5, 0.8, 0.95] {
            for k in -12..=12 {
                let theta = 0.37 * f64::from(k);
                let sum: f64 = (1..1500).map(|n| r.powi(n) * (f64::from(n) * theta).sin() / f64::from(n * n)).sum();
                let value = im_dilogarithm(r, theta);
                assert!((value - sum).abs() < 4e-15, "r = {r}, θ = {theta}: {value} {sum}");
            }
        }
    }

    #[test]
    fn on_the_unit_circle_it_is_clausens_function() {
        // Catalan's constant and Gieseking's constant.
        assert!((im_dilogarithm(1.0, PI / 2.0) - 0.915_965_594_177_219).abs() < 1e-15);
        assert!((im_dilogarithm(1.0, PI / 3.0) - 1.014_941_606_409_653_7).abs() < 1e-15);
        assert!((im_dilogarithm(1.0, -PI / 3.0) + 1.014_941_606_409_653_7).abs() < 1e-15);
    }
}

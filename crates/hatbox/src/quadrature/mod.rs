//! Quadrature on reference cells, and the point sets for integrals that are not smooth.
//!
//! Triangles use the Xiao–Gimbutas rules up to degree 14 (tabulated in `tables.rs`; the crate that publishes them all
//! takes two minutes to compile), quads tensor Gauss–Legendre. Weights sum to 1, so that a rule is a mean over the cell
//! and the area enters where the integral is written down. [`transform`] removes the singularity of touching
//! triangles, [`sequence`] has the scrambled low-discrepancy points of sampled visibility.

pub mod sequence;
mod tables;
pub mod transform;

use crate::element::Shape;
use std::sync::LazyLock;

/// Points and weights on a reference cell; the weights sum to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    /// Polynomials up to this (total) degree are integrated exactly.
    pub degree: usize,
    /// Reference coordinates.
    pub points: Vec<[f64; 2]>,
    /// Positive weights.
    pub weights: Vec<f64>,
}

/// The smallest tabulated rule that is exact to `degree`, or the largest there is.
pub fn rule(shape: Shape, degree: usize) -> &'static Rule {
    let rules = &RULES[shape as usize];
    rules.iter().find(|rule| rule.degree >= degree).unwrap_or(&rules[rules.len() - 1])
}

/// Degree of the largest rule.
pub const MAX_DEGREE: usize = 14;

static RULES: LazyLock<[Vec<Rule>; 2]> = LazyLock::new(|| [triangle_rules(), quad_rules()]);

fn triangle_rules() -> Vec<Rule> {
    let rule = |&(degree, rows): &(usize, &[[f64; 3]])| Rule {
        degree,
        points: rows.iter().map(|row| [row[0], row[1]]).collect(),
        weights: rows.iter().map(|row| row[2]).collect(),
    };
    tables::TRIANGLE.iter().map(rule).collect()
}

fn quad_rules() -> Vec<Rule> {
    let rule = |n: usize| {
        let gauss = gauss_legendre(n);
        let pairs = || gauss.iter().flat_map(|a| gauss.iter().map(move |b| (a, b)));
        Rule {
            degree: 2 * n - 1,
            points: pairs().map(|(a, b)| [a.0, b.0]).collect(),
            weights: pairs().map(|(a, b)| a.1 * b.1).collect(),
        }
    };
    (1..=MAX_DEGREE.div_ceil(2) + 1).map(rule).collect()
}

/// The n-point Gauss–Legendre rule on \[0, 1\] as (point, weight), by Newton's method on the Legendre polynomial.
pub fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    let node = |i: usize| {
        let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..100 {
            let (value, derivative) = legendre(n, x);
            slope = derivative;
            let step = value / derivative;
            x -= step;
            if step.abs() < 1e-16 {
                break;
            }
        }
        (f64::midpoint(1.0, x), 1.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..n).map(node).collect()
}

/// P_n and its derivative at x, by the three-term recurrence.
fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut previous, mut current) = (1.0, x);
    for k in 2..=n {
        let k = k as f64;
        (previous, current) = (current, ((2.0 * k - 1.0) * x * current - (k - 1.0) * previous) / k);
    }
    (current, n as f64 * (x * current - previous) / (x * x - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ∫ξᵃηᵇ over the reference cell, divided by its area.
    fn mean_of_monomial(shape: Shape, a: usize, b: usize) -> f64 {
        let factorial = |n: usize| (1..=n).map(|k| k as f64).product::<f64>();
        match shape {
            Shape::Triangle => 2.0 * factorial(a) * factorial(b) / factorial(a + b + 2),
            Shape::Quad => 1.0 / ((a + 1) as f64 * (b + 1) as f64),
        }
    }

    #[test]
    fn every_rule_is_exact_to_its_degree() {
        for shape in Shape::ALL {
            for rule in &RULES[shape as usize] {
                for (a, b) in (0..=rule.degree).flat_map(|a| (0..=rule.degree - a).map(move |b| (a, b))) {
                    let mean: f64 = rule
                        .points
                        .iter()
                        .zip(&rule.weights)
                        .map(|(p, w)| w * p[0].powi(a as i32) * p[1].powi(b as i32))
                        .sum();
                    let exact = mean_of_monomial(shape, a, b);
                    assert!((mean - exact).abs() < 2e-14, "{shape:?} degree {} on ξ^{a} η^{b}", rule.degree);
                }
            }
        }
    }

    #[test]
    fn gauss_legendre_is_exact_to_twice_its_points() {
        for n in 1..=24 {
            let rule = gauss_legendre(n);
            for k in 0..2 * n {
                let sum: f64 = rule.iter().map(|&(x, w)| w * x.powi(k as i32)).sum();
                assert!((sum - 1.0 / (k + 1) as f64).abs() < 1e-14, "n = {n}, x^{k}: {sum}");
            }
        }
    }

    #[test]
    fn a_rule_of_at_least_the_asked_degree_is_found() {
        for shape in Shape::ALL {
            for degree in 0..=MAX_DEGREE {
                assert!(rule(shape, degree).degree >= degree);
            }
        }
    }
}

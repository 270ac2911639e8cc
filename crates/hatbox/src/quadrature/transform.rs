//! Rules for two triangles that touch, in which the kernel's singularity has been transformed away.
//!
//! S. A. Sauter, C. Schwab, *Boundary Element Methods* (Springer 2011), §5.2: the four-dimensional domain is cut into
//! regions (5 for a common edge, 2 for a common vertex), each mapped to the unit hypercube so that the Jacobian cancels
//! the singularity. The radiosity kernel is homogeneous of degree −2 on planar triangles, so along the *radial*
//! coordinates (ξ, and η₁ for an edge) what remains is a polynomial: a few points are exact there, and only the other
//! directions need the order n. That anisotropy saves a factor of n² (edge) or n (vertex) over the textbook's rule.

use super::gauss_legendre;

/// How two triangles touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Contact {
    /// They share corner 0.
    Vertex,
    /// They share corners 0 and 1, in this order in both.
    Edge,
}

/// Points on both triangles, as the weights of their corners, and quadrature weights that sum to 1.
#[derive(Debug, Clone, Default)]
pub struct TouchingRule {
    /// Corner weights on the first triangle.
    pub first: Vec<[f64; 3]>,
    /// Corner weights on the second triangle.
    pub second: Vec<[f64; 3]>,
    /// Quadrature weights.
    pub weights: Vec<f64>,
}

/// The rule of order `n` for integrands p·G, where p is a polynomial of total degree `degree` in both points.
pub fn touching_rule(contact: Contact, degree: usize, n: usize) -> TouchingRule {
    // Radial integrands: ξ³·ξ⁻²·ξ^degree, and for an edge η₁²·η₁⁻²·η₁^degree.
    let radial = gauss_legendre((degree + 2).div_ceil(2));
    let across = gauss_legendre((degree + 1).div_ceil(2).max(1));
    let smooth = gauss_legendre(n);
    let first_eta = if contact == Contact::Edge { &across } else { &smooth };
    let mut rule = TouchingRule::default();
    for &(xi, w0) in &radial {
        for &(e1, w1) in first_eta {
            for &(e2, w2) in &smooth {
                for &(e3, w3) in &smooth {
                    let weight = 4.0 * w0 * w1 * w2 * w3 * xi.powi(3);
                    match contact {
                        Contact::Edge => rule.push_edge(xi, e1, e2, e3, weight * e1 * e1),
                        Contact::Vertex => rule.push_vertex(xi, e1, e2, e3, weight * e2),
                    }
                }
            }
        }
    }
    rule
}

impl TouchingRule {
    /// The five regions of a common edge (Sauter–Schwab, equation 5.2.26 ff.).
    fn push_edge(&mut self, xi: f64, e1: f64, e2: f64, e3: f64, weight: f64) {
        let e12 = e1 * e2;
        let e123 = e12 * e3;
        self.push([1.0, e1 * e3], [1.0 - e12, e1 * (1.0 - e2)], xi, weight);
        let weight = weight * e2;
        self.push([1.0, e1], [1.0 - e123, e12 * (1.0 - e3)], xi, weight);
        self.push([1.0 - e12, e1 * (1.0 - e2)], [1.0, e123], xi, weight);
        self.push([1.0 - e123, e12 * (1.0 - e3)], [1.0, e1], xi, weight);
        self.push([1.0 - e123, e1 * (1.0 - e2 * e3)], [1.0, e12], xi, weight);
    }

    /// The two regions of a common vertex.
    fn push_vertex(&mut self, xi: f64, e1: f64, e2: f64, e3: f64, weight: f64) {
        self.push([1.0, e1], [e2, e2 * e3], xi, weight);
        self.push([e2, e2 * e3], [1.0, e1], xi, weight);
    }

    /// Adds ξ·x, ξ·y, given on the triangle 0 ≤ x₂ ≤ x₁ ≤ 1 with corner 0 at the origin and corner 1 at (1, 0).
    fn push(&mut self, x: [f64; 2], y: [f64; 2], xi: f64, weight: f64) {
        let corners = |p: [f64; 2]| [1.0 - xi * p[0], xi * (p[0] - p[1]), xi * p[1]];
        self.first.push(corners(x));
        self.second.push(corners(y));
        self.weights.push(weight);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_touching_rule_integrates_polynomials_over_both_triangles() {
        // The mean of λ₂ μ₁ over two triangles is 1/9: a rule for degree 2 with the kernel integrates it to order n.
        for contact in [Contact::Vertex, Contact::Edge] {
            let rule = touching_rule(contact, 4, 6);
            let total: f64 = rule.weights.iter().sum();
            assert!((total - 1.0).abs() < 1e-13, "{contact:?}: {total}");
            let mean: f64 =
                (0..rule.weights.len()).map(|k| rule.weights[k] * rule.first[k][2] * rule.second[k][1]).sum();
            assert!((mean - 1.0 / 9.0).abs() < 1e-13, "{contact:?}: {mean}");
        }
    }

    #[test]
    fn points_stay_inside_their_triangles() {
        for contact in [Contact::Vertex, Contact::Edge] {
            let rule = touching_rule(contact, 2, 5);
            for point in rule.first.iter().chain(&rule.second) {
                assert!(point.iter().all(|&w| (0.0..=1.0).contains(&w)), "{point:?}");
            }
        }
    }
}

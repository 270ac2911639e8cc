//! From values at the points of a cell to coefficients of its functions: least squares.
//!
//! e minimises Σ_r w_r (Σ_k e_k N_k(x_r) − v_r)² + λ ‖e − mean(e)‖². Its normal matrix is the *sampled* Gram matrix
//! Σ w N Nᵀ, not ∫N Nᵀ: a constant then comes back exactly whatever the points are, so that row sums close, and no fit is
//! larger than what it is fitted to. The second term is worth one ray. It does not see constants, and it decides what
//! the rays leave open when most of them went to a lamp.
//!
//! Where n and the number of bands are known when the loops are compiled, they are unrolled.

#![expect(clippy::inline_always, reason = "loops must be compiled where their lengths are known")]

use crate::element::{Element, MAX_DOFS};
use crate::mesh::Patch;
use crate::quadrature::rule;

pub(super) type Matrix = [[f64; MAX_DOFS]; MAX_DOFS];

/// ∫N_i N_j over a patch divided by its area.
pub(super) fn mean_mass(element: &Element, patch: Option<&Patch>) -> Matrix {
    let rule = rule(element.shape, 2 * element.degree + 2);
    let mut mass = [[0.0; MAX_DOFS]; MAX_DOFS];
    let mut total = 0.0;
    for (&at, weight) in rule.points.iter().zip(&rule.weights) {
        let weight = weight * patch.map_or(1.0, |patch| patch.jacobian(at));
        add_outer(&mut mass, weight, &element.values(at));
        total += weight;
    }
    mass.map(|row| row.map(|entry| entry / total))
}

/// M − (M1)(M1)ᵀ: the squared distance from the mean.
pub(super) fn variance(mass: &Matrix) -> Matrix {
    let mean = mass.map(|row| row.iter().sum::<f64>());
    std::array::from_fn(|i| std::array::from_fn(|j| mass[i][j] - mean[i] * mean[j]))
}

/// G += w N Nᵀ.
#[inline(always)]
pub(super) fn add_outer(gram: &mut Matrix, weight: f64, functions: &[f64]) {
    for (row, n) in gram.iter_mut().zip(functions) {
        for (entry, m) in row.iter_mut().zip(functions) {
            *entry += weight * n * m;
        }
    }
}

/// The Cholesky factor of the first n rows of a positive definite matrix.
pub(super) fn factor(mut a: Matrix, n: usize) -> Matrix {
    factor_in_place(&mut a, n);
    a
}

/// The same in place of the matrix: cells are so many that copies count.
#[inline(always)]
pub(super) fn factor_in_place(a: &mut Matrix, n: usize) {
    for j in 0..n {
        let pivot = a[j][j] - a[j][..j].iter().map(|x| x * x).sum::<f64>();
        a[j][j] = pivot.max(1e-300).sqrt();
        for i in j + 1..n {
            let product: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            a[i][j] = (a[i][j] - product) / a[j][j];
        }
    }
}

/// Solves L Lᵀ x = b in place, for every band; b holds the bands of each row side by side.
#[inline(always)]
pub(super) fn solve(l: &Matrix, n: usize, bands: usize, b: &mut [f64]) {
    for i in 0..n {
        for band in 0..bands {
            let known: f64 = (0..i).map(|k| l[i][k] * b[k * bands + band]).sum();
            b[i * bands + band] = (b[i * bands + band] - known) / l[i][i];
        }
    }
    for i in (0..n).rev() {
        for band in 0..bands {
            let known: f64 = (i + 1..n).map(|k| l[k][i] * b[k * bands + band]).sum();
            b[i * bands + band] = (b[i * bands + band] - known) / l[i][i];
        }
    }
}

/// Which rays are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Take {
    All,
    FirstHalf,
    SecondHalf,
}

impl Take {
    /// Of so many.
    pub(super) fn of(self, k: usize) -> std::ops::Range<usize> {
        match self {
            Self::All => 0..k,
            Self::FirstHalf => 0..k / 2,
            Self::SecondHalf => k / 2..k,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::{ALL, Shape};

    #[test]
    fn a_constant_is_fitted_exactly_by_any_points() {
        for basis in &ALL {
            let Some(element) = basis.element(Shape::Triangle) else { continue };
            let n = element.dofs();
            let mass = mean_mass(element, None);
            let mut gram = variance(&mass).map(|row| row.map(|entry| 0.1 * entry));
            let mut right = vec![0.0; n];
            for at in [[0.1, 0.2], [0.3, 0.3]] {
                let functions = element.values(at);
                add_outer(&mut gram, 0.5, &functions);
                right.iter_mut().zip(functions).for_each(|(b, f)| *b += 0.5 * 3.0 * f);
            }
            solve(&factor(gram, n), n, 1, &mut right);
            assert!(right.iter().all(|e| (e - 3.0).abs() < 1e-12), "{}: {right:?}", element.name);
        }
    }
}

//! ‖Δ^-½ S Δ^-½‖: whether the fixed point contracts.
//!
//! No surface receives more light than all of them send: the norm is at most 1, and an operator that exceeds it by more
//! than its own error has been integrated wrongly. It is estimated by Arnoldi's method on Δ⁻¹S in the inner product of
//! Δ (Lanczos' where S is symmetric); the greatest singular value of the projected matrix is the greatest gain that the
//! Krylov space knows, a lower bound that is tight after few steps, because the greatest gain belongs to the smooth
//! functions the space begins with.

use super::Exchange;
use crate::linalg::{LinearOperator, MultiVector, dot};
use crate::progress::{Interrupted, Progress};
use crate::quadrature::sequence::{hash, unit};

/// The greatest gain ‖Δ⁻¹S x‖/‖x‖, in the norm of Δ, over a Krylov space of that many steps: a lower bound of the norm.
///
/// # Errors
/// [`Interrupted`].
pub fn norm(
    exchange: &dyn Exchange,
    mass: &dyn LinearOperator,
    mass_inverse: &dyn LinearOperator,
    steps: usize,
    progress: &dyn Progress,
) -> Result<f64, Interrupted> {
    // Smooth, so that it is close to the greatest; not quite, so that no eigenvector is left out.
    let noise = |row: usize| unit(hash(0x006e_6f72, row as u64));
    let start = MultiVector::from_fn(exchange.rows(), 1, |row, _| 1.0 + 0.2 * (noise(row) - 0.5));
    let product = |x: &MultiVector, y: &MultiVector| dot(x.band(0), y.band(0));
    let mut basis: Vec<(MultiVector, MultiVector)> = Vec::with_capacity(steps + 1);
    let mut next = start;
    let mut columns: Vec<Vec<f64>> = Vec::with_capacity(steps);
    loop {
        let mut weighted = mass.times(&next);
        let length = product(&next, &weighted).max(0.0).sqrt();
        if let Some(column) = columns.last_mut() {
            column.push(length);
        }
        if columns.len() == steps || length <= 1e-12 {
            return Ok(greatest_singular_value(&columns));
        }
        for entry in next.as_mut_slice().iter_mut().chain(weighted.as_mut_slice()) {
            *entry /= length;
        }
        let mut image = mass_inverse.times(&exchange.times_watched(&next, progress)?);
        basis.push((next, weighted));
        let mut column = Vec::with_capacity(basis.len() + 1);
        for (vector, weighted) in &basis {
            let share = product(&image, weighted);
            image.add_scaled(-share, vector);
            column.push(share);
        }
        columns.push(column);
        next = image;
    }
}

/// The greatest singular value of an upper Hessenberg matrix given by its columns: power iteration on HᵀH.
fn greatest_singular_value(columns: &[Vec<f64>]) -> f64 {
    let rows = columns.iter().map(Vec::len).max().unwrap_or(0);
    let mut x = vec![1.0; columns.len()];
    let mut value = 0.0;
    for _ in 0..200 {
        let mut image = vec![0.0; rows];
        for (column, x) in columns.iter().zip(&x) {
            image.iter_mut().zip(column).for_each(|(y, h)| *y += h * x);
        }
        let length = dot(&x, &x).sqrt();
        if length == 0.0 {
            break;
        }
        value = dot(&image, &image).sqrt() / length;
        let back: Vec<f64> = columns.iter().map(|column| column.iter().zip(&image).map(|(h, y)| h * y).sum()).collect();
        let length = dot(&back, &back).sqrt();
        if length == 0.0 {
            break;
        }
        x = back.into_iter().map(|entry| entry / length).collect();
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn singular_values_of_a_known_matrix() {
        // [[3, 0], [4, 5]] has the singular values √45 and √5.
        let value = greatest_singular_value(&[vec![3.0, 4.0], vec![0.0, 5.0]]);
        assert!((value - 45.0_f64.sqrt()).abs() < 1e-12, "{value}");
        assert_eq!(greatest_singular_value(&[]), 0.0);
    }
}

use super::residual;
use crate::linalg::{Csr, MultiVector};
use rayon::prelude::*;
use std::borrow::Cow;

/// Rows of a piece of work.
const ROWS: usize = 1 << 13;
/// Bands that stand side by side.
const LANES: usize = 4;
/// More steps than this are not made.
const MOST_STEPS: u32 = 100;
/// The error that single precision is asked for at a time, relative to what there was: some digits more than it has would do.
const SINGLE: f64 = 1e-5;

/// A symmetric positive definite matrix A, and what is known of D⁻¹ A, D being its diagonal.
#[derive(Debug, Clone, Copy)]
pub struct Scaled<'a> {
    /// A.
    pub matrix: &'a Csr,
    /// The numbers of D⁻¹.
    pub inverse_diagonal: &'a [f64],
    /// Between which its eigenvalues lie, both positive.
    pub spectrum: [f64; 2],
}

/// Approximates the solution of A x = b by Chebyshev's semi-iteration (Golub and Varga 1961): so many steps that the error is
/// `tolerance` of that of x = 0 in the norm of A. What `x` held before does not matter. It begins with b over the sums of
/// the rows' absolute values, which is never worse than 0, and exact for constants where no number of A is negative.
///
/// It has no inner products, so that a step is one pass over matrix and vectors, and it is linear in b, but for rounding: the way to invert
/// mass matrices, whose spectra are known (A. Wathen and T. Rees, "Chebyshev semi-iteration in preconditioning for problems
/// including the mass matrix", ETNA 34, 2009). Vectors are of single precision, which is half as much to read and to write; where
/// more is asked for, what is left is solved for again (iterative refinement; N. Higham, "Accuracy and Stability of Numerical
/// Algorithms", 2002, §12). The error is not what it should be where eigenvalues lie outside the spectrum,
/// and grows if some exceed the sum of its ends, or where it takes more than a hundred steps: [`cg()`](super::cg()) sees the true
/// residual, and goes on from there.
///
/// # Panics
/// If the dimensions of the arguments do not match.
pub fn chebyshev(a: &Scaled<'_>, rhs: &MultiVector, x: &mut MultiVector, tolerance: f64) {
    assert_eq!((x.rows(), x.bands()), (rhs.rows(), rhs.bands()), "vectors of the same size");
    let (mut asked, mut rest) = (tolerance, Cow::Borrowed(rhs));
    x.as_mut_slice().fill(0.0);
    loop {
        match rhs.bands() {
            1 => add_by_lanes::<1>(a, &rest, x, asked.max(SINGLE)),
            _ => add_by_lanes::<LANES>(a, &rest, x, asked.max(SINGLE)),
        }
        if asked >= SINGLE {
            break;
        }
        asked /= SINGLE;
        rest = Cow::Owned(residual(a.matrix, rhs, x));
    }
}

/// Adds the solution, so many bands at a time.
fn add_by_lanes<const L: usize>(a: &Scaled<'_>, rhs: &MultiVector, x: &mut MultiVector, tolerance: f64) {
    let [least, greatest] = a.spectrum;
    let (middle, half) = (0.5 * (greatest + least), 0.5 * (greatest - least));
    for first in (0..rhs.bands()).step_by(L) {
        let bands: [Option<&[f64]>; L] =
            std::array::from_fn(|lane| (first + lane < rhs.bands()).then(|| rhs.band(first + lane)));
        let scales = bands.map(|band| band.map_or(1.0, |band| scale(a, band)));
        let of_row =
            |row| std::array::from_fn(|lane| bands[lane].map_or(0.0, |b: &[f64]| b[row] / scales[lane]) as f32);
        let b: Vec<[f32; L]> = (0..rhs.rows()).into_par_iter().with_min_len(ROWS).map(of_row).collect();
        let begun = |(row, b): (usize, &[f32; L])| {
            let sum: f64 = a.matrix.row(row).map(|(_, value)| value.abs()).sum();
            b.map(|b| (f64::from(b) / sum) as f32)
        };
        let mut solution: Vec<[f32; L]> = b.par_iter().enumerate().with_min_len(ROWS).map(begun).collect();
        let mut before: Vec<[f32; L]> = solution.par_iter().copied().with_min_len(ROWS).collect();
        let (mut rho, mut shares) = (half / middle, [0.0, 1.0 / middle]);
        for _ in 0..steps(a.spectrum, tolerance) {
            advance(a, shares, [&b, &solution], &mut before);
            std::mem::swap(&mut solution, &mut before);
            let last = rho;
            rho = half / (2.0 * middle - half * last);
            shares = [rho * last, if half > 0.0 { 2.0 * rho / half } else { 0.0 }];
        }
        for (lane, scale) in scales.into_iter().enumerate().take(rhs.bands() - first) {
            let numbers = solution.par_iter().with_min_len(ROWS);
            let places = x.band_mut(first + lane).par_iter_mut().zip(numbers);
            places.for_each(|(x, numbers)| *x += scale * f64::from(numbers[lane]));
        }
    }
}

/// What b is divided by, so that single precision has room for what it makes: the greatest number of D⁻¹ b.
fn scale(a: &Scaled<'_>, b: &[f64]) -> f64 {
    let greater = |a: f64, b: f64| if a > b { a } else { b };
    let all = b.par_iter().zip(a.inverse_diagonal).with_min_len(ROWS).map(|(b, d)| (b * d).abs());
    let most = all.reduce(|| 0.0, greater);
    if most > 0.0 { most } else { 1.0 }
}

/// The least k with 2 qᵏ ≤ tolerance, q = (√κ − 1)/(√κ + 1).
fn steps([least, greatest]: [f64; 2], tolerance: f64) -> u32 {
    let root = (greatest / least).sqrt();
    let rate = (root - 1.0) / (root + 1.0);
    let steps = (0.5 * tolerance).ln() / rate.ln();
    if rate > 0.0 { steps.ceil().clamp(1.0, f64::from(MOST_STEPS)) as u32 } else { 1 }
}

/// x₊ = x + α (x − x₋) + β D⁻¹ (b − A x), in the place of x₋.
fn advance<const L: usize>(
    a: &Scaled<'_>,
    [again, along]: [f64; 2],
    [b, x]: [&[[f32; L]]; 2],
    before: &mut [[f32; L]],
) {
    before.par_chunks_mut(ROWS).enumerate().for_each(|(part, before)| {
        for (row, before) in (part * ROWS..).zip(before) {
            let [mut rest, here] = [b[row], x[row]].map(|numbers| numbers.map(f64::from));
            for (column, value) in a.matrix.row(row) {
                rest.iter_mut().zip(x[column]).for_each(|(rest, x)| *rest -= value * f64::from(x));
            }
            let weight = along * a.inverse_diagonal[row];
            for lane in 0..L {
                let step = again * (here[lane] - f64::from(before[lane])) + weight * rest[lane];
                before[lane] = (here[lane] + step) as f32;
            }
        }
    });
}

use crate::linalg::{Csr, MultiVector};
use rayon::prelude::*;

/// Rows of a piece of work.
const ROWS: usize = 1 << 13;
/// Bands that stand side by side.
const LANES: usize = 4;
/// More steps than this are not made at a time.
const MOST_STEPS: u32 = 100;
/// The error that single precision is asked for at a time, relative to what there was: it has two digits more.
const SINGLE: f64 = 1e-5;
/// So many times: double precision has no more digits.
const MOST_TIMES: u32 = 4;

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
/// and grows if some exceed the sum of its ends, or where five digits take more than a hundred steps: [`cg()`](super::cg()) sees the
/// true residual, and goes on from there.
///
/// # Panics
/// If the dimensions of the arguments do not match.
pub fn chebyshev(a: &Scaled<'_>, rhs: &MultiVector, x: &mut MultiVector, tolerance: f64) {
    assert_eq!((x.rows(), x.bands()), (rhs.rows(), rhs.bands()), "vectors of the same size");
    for first in (0..rhs.bands()).step_by(LANES) {
        match rhs.bands() {
            1 => by_lanes::<1>(a, rhs, x, first, tolerance),
            _ => by_lanes::<LANES>(a, rhs, x, first, tolerance),
        }
    }
}

/// Bands from this one on.
fn by_lanes<const L: usize>(a: &Scaled<'_>, rhs: &MultiVector, x: &mut MultiVector, first: usize, tolerance: f64) {
    let bands = first..(first + L).min(rhs.bands());
    bands.clone().for_each(|band| x.band_mut(band).fill(0.0));
    let times = times(tolerance);
    let each = tolerance.powf(1.0 / f64::from(times)).max(SINGLE);
    let mut scales: Vec<f64> = bands.clone().map(|band| scale(a, rhs.band(band))).collect();
    for time in 0..times {
        let left = |row: usize| {
            let mut left = [0.0; L];
            for ((left, band), scale) in left.iter_mut().zip(bands.clone()).zip(&scales) {
                let known = if time > 0 { a.matrix.row_times(row, x.band(band)) } else { 0.0 };
                *left = (a.inverse_diagonal[row] * (rhs.band(band)[row] - known) / scale) as f32;
            }
            left
        };
        let found = approximate(a, left, each);
        for ((lane, band), scale) in bands.clone().enumerate().zip(&mut scales) {
            let places = x.band_mut(band).par_iter_mut().zip(found.par_iter().with_min_len(ROWS));
            places.for_each(|(x, found)| *x += *scale * f64::from(found[lane]));
            *scale *= each;
        }
    }
}

/// What b is divided by, so that single precision has room for all, whatever their unit: the greatest number of D⁻¹ b.
fn scale(a: &Scaled<'_>, b: &[f64]) -> f64 {
    let numbers = b.par_iter().zip(a.inverse_diagonal).with_min_len(ROWS).map(|(b, d)| (b * d).abs());
    let greatest = numbers.reduce(|| 0.0, |a, b| if a > b { a } else { b });
    if greatest > 0.0 { greatest } else { 1.0 }
}

/// How often single precision is asked for its digits, to get to a tolerance.
fn times(tolerance: f64) -> u32 {
    // But for rounding.
    let times = (tolerance.ln() / SINGLE.ln() - 1e-6).ceil();
    (times as u32).clamp(1, MOST_TIMES)
}

/// Approximates the solution, given D⁻¹ b row by row.
fn approximate<const L: usize>(
    a: &Scaled<'_>,
    right: impl Fn(usize) -> [f32; L] + Sync + Send,
    tolerance: f64,
) -> Vec<[f32; L]> {
    let rows = || (0..a.inverse_diagonal.len()).into_par_iter().with_min_len(ROWS);
    let b: Vec<[f32; L]> = rows().map(right).collect();
    let begun = |row: usize| {
        let sum: f64 = a.matrix.row(row).map(|(_, value)| value.abs()).sum();
        b[row].map(|b| (f64::from(b) / (sum * a.inverse_diagonal[row])) as f32)
    };
    let mut solution: Vec<[f32; L]> = rows().map(begun).collect();
    let mut before: Vec<[f32; L]> = rows().map(|row| solution[row]).collect();
    let [least, greatest] = a.spectrum;
    let (middle, half) = (0.5 * (greatest + least), 0.5 * (greatest - least));
    let (mut rho, mut shares) = (half / middle, [0.0, 1.0 / middle]);
    for _ in 0..steps(a.spectrum, tolerance) {
        advance(a, shares, [&b, &solution], &mut before);
        std::mem::swap(&mut solution, &mut before);
        let last = rho;
        rho = half / (2.0 * middle - half * last);
        shares = [rho * last, if half > 0.0 { 2.0 * rho / half } else { 0.0 }];
    }
    solution
}

/// The least k with 2 qᵏ ≤ tolerance, q = (√κ − 1)/(√κ + 1).
fn steps([least, greatest]: [f64; 2], tolerance: f64) -> u32 {
    let root = (greatest / least).sqrt();
    let rate = (root - 1.0) / (root + 1.0);
    let steps = (0.5 * tolerance).ln() / rate.ln();
    if rate > 0.0 { steps.ceil().clamp(1.0, f64::from(MOST_STEPS)) as u32 } else { 1 }
}

/// x₊ = x + α (x − x₋) + β (D⁻¹ b − D⁻¹ A x), in the place of x₋.
fn advance<const L: usize>(
    a: &Scaled<'_>,
    [again, along]: [f64; 2],
    [b, x]: [&[[f32; L]]; 2],
    before: &mut [[f32; L]],
) {
    before.par_chunks_mut(ROWS).enumerate().for_each(|(part, before)| {
        for (row, before) in (part * ROWS..).zip(before) {
            let [b, here] = [b[row], x[row]].map(|numbers| numbers.map(f64::from));
            let mut product = [0.0; L];
            for (column, value) in a.matrix.row(row) {
                product.iter_mut().zip(x[column]).for_each(|(product, x)| *product += value * f64::from(x));
            }
            for lane in 0..L {
                let rest = b[lane] - a.inverse_diagonal[row] * product[lane];
                let step = again * (here[lane] - f64::from(before[lane])) + along * rest;
                before[lane] = (here[lane] + step) as f32;
            }
        }
    });
}

#[cfg(test)]
mod tests {
    #[test]
    fn digits_are_asked_for_as_often_as_it_takes_and_no_more_than_there_are() {
        for (tolerance, times) in [
            (1.0, 1),
            (1e-4, 1),
            (1e-5, 1),
            (1e-6, 2),
            (1e-10, 2),
            (1e-13, 3),
            (1e-30, 4),
            (0.0, 4),
            (-1.0, 1),
            (f64::NAN, 1),
        ] {
            assert_eq!(super::times(tolerance), times, "{tolerance:e}");
        }
    }
}

use crate::linalg::{Csr, MultiVector, Number};
use rayon::prelude::*;

/// Rows of a piece of work.
const ROWS: usize = 1 << 13;
/// Bands that stand side by side.
const LANES: usize = 4;
/// More steps than this are not made.
const MOST_STEPS: u32 = 100;
/// Single precision is kept to where no more than this is asked for: half as much memory to read and to write.
const SINGLE: f64 = 1e-5;
/// Numbers between which single precision keeps all its digits, and their products with a few others do.
const HELD: [f64; 2] = [1e-30, 1e30];

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
/// including the mass matrix", ETNA 34, 2009). The error is not what it should be where eigenvalues lie outside the spectrum,
/// and grows if some exceed the sum of its ends, or where it takes more than a hundred steps: [`cg()`](super::cg()) sees the true
/// residual, and goes on from there.
///
/// # Panics
/// If the dimensions of the arguments do not match.
pub fn chebyshev(a: &Scaled<'_>, rhs: &MultiVector, x: &mut MultiVector, tolerance: f64) {
    assert_eq!((x.rows(), x.bands()), (rhs.rows(), rhs.bands()), "vectors of the same size");
    match (tolerance >= SINGLE && is_held(a, rhs), rhs.bands()) {
        (true, 1) => by_lanes::<1, f32>(a, rhs, x, tolerance),
        (true, _) => by_lanes::<LANES, f32>(a, rhs, x, tolerance),
        (false, 1) => by_lanes::<1, f64>(a, rhs, x, tolerance),
        (false, _) => by_lanes::<LANES, f64>(a, rhs, x, tolerance),
    }
}

/// Whether single precision has room for the greatest numbers of b and D⁻¹ b in each band.
fn is_held(a: &Scaled<'_>, rhs: &MultiVector) -> bool {
    rhs.iter_bands().all(|band| {
        let both = band.par_iter().zip(a.inverse_diagonal).with_min_len(ROWS).map(|(b, d)| [b.abs(), (b * d).abs()]);
        let most = both.reduce(|| [0.0; 2], |a, b| std::array::from_fn(|k| if a[k] > b[k] { a[k] } else { b[k] }));
        most.iter().all(|&most| most == 0.0 || (HELD[0]..HELD[1]).contains(&most))
    })
}

/// So many bands at a time.
fn by_lanes<const L: usize, T: Number>(a: &Scaled<'_>, rhs: &MultiVector, x: &mut MultiVector, tolerance: f64) {
    let [least, greatest] = a.spectrum;
    let (middle, half) = (0.5 * (greatest + least), 0.5 * (greatest - least));
    for first in (0..rhs.bands()).step_by(L) {
        let of_row = |row: usize| {
            let of_lane = |lane| if first + lane < rhs.bands() { rhs.band(first + lane)[row] } else { 0.0 };
            std::array::from_fn(|lane| T::nearest(of_lane(lane)))
        };
        let b: Vec<[T; L]> = (0..rhs.rows()).into_par_iter().with_min_len(ROWS).map(of_row).collect();
        let begun = |(row, b): (usize, &[T; L])| {
            let sum: f64 = a.matrix.row(row).map(|(_, value)| value.abs()).sum();
            b.map(|b| T::nearest(b.into() / sum))
        };
        let mut solution: Vec<[T; L]> = b.par_iter().enumerate().with_min_len(ROWS).map(begun).collect();
        let mut before: Vec<[T; L]> = solution.par_iter().copied().with_min_len(ROWS).collect();
        let (mut rho, mut shares) = (half / middle, [0.0, 1.0 / middle]);
        for _ in 0..steps(a.spectrum, tolerance) {
            advance(a, shares, [&b, &solution], &mut before);
            std::mem::swap(&mut solution, &mut before);
            let last = rho;
            rho = half / (2.0 * middle - half * last);
            shares = [rho * last, if half > 0.0 { 2.0 * rho / half } else { 0.0 }];
        }
        for lane in 0..L.min(rhs.bands() - first) {
            let numbers = solution.par_iter().with_min_len(ROWS);
            x.band_mut(first + lane).par_iter_mut().zip(numbers).for_each(|(x, numbers)| *x = numbers[lane].into());
        }
    }
}

/// The least k with 2 qᵏ ≤ tolerance, q = (√κ − 1)/(√κ + 1).
fn steps([least, greatest]: [f64; 2], tolerance: f64) -> u32 {
    let root = (greatest / least).sqrt();
    let rate = (root - 1.0) / (root + 1.0);
    let steps = (0.5 * tolerance).ln() / rate.ln();
    if rate > 0.0 { steps.ceil().clamp(1.0, f64::from(MOST_STEPS)) as u32 } else { 1 }
}

/// x₊ = x + α (x − x₋) + β D⁻¹ (b − A x), in the place of x₋.
fn advance<const L: usize, T: Number>(
    a: &Scaled<'_>,
    [again, along]: [f64; 2],
    [b, x]: [&[[T; L]]; 2],
    before: &mut [[T; L]],
) {
    before.par_chunks_mut(ROWS).enumerate().for_each(|(part, before)| {
        for (row, before) in (part * ROWS..).zip(before) {
            let (mut rest, here) = (b[row].map(Into::into), x[row].map(Into::into));
            for (column, value) in a.matrix.row(row) {
                rest.iter_mut().zip(x[column]).for_each(|(rest, x)| *rest -= value * x.into());
            }
            let weight = along * a.inverse_diagonal[row];
            for lane in 0..L {
                let step = again * (here[lane] - before[lane].into()) + weight * rest[lane];
                before[lane] = T::nearest(here[lane] + step);
            }
        }
    });
}

//! Row sums made right, without harm to reciprocity.
//!
//! The rows of `a_ij = A_i F_ij` are to sum to `t_i = A_i (1 − escape_i)`, which in a closed scene is exactly A_i. In an open
//! one rays have measured what escapes: a sum that they do not contradict stays as it is, any other is to be the nearest that
//! they do not. Entries that are zero stay zero, none becomes negative, and the matrix stays symmetric:
//!
//! | method | a_ij becomes |
//! |---|---|
//! | scaling | `d_i a_ij d_j` with d > 0 (R. Sinkhorn, 1964, in its symmetric form) |
//! | least squares | `a_ij max(0, 1 + λ_i + λ_j)`, which minimises `Σ (change of a_ij)² / a_ij` |
//!
//! An entry that something hides in part is never raised above what it would be if nothing did: it is capped there, and
//! the others make up for it. In both methods one fixed-point iteration finds d or λ: its error is multiplied by
//! ½ (I − P) each time, where P is the matrix of the factors.

use super::Surface;
use super::check::greatest;
use super::matrix::{Correction, Gain, Matrix};
use crate::progress::{Interrupted, Progress, Stage};
use rayon::prelude::*;
use std::collections::HashMap;

/// Rounds of the fixed-point iteration, at the most.
const ROUNDS: usize = 200;
/// Without progress for so many rounds there will be none: there is no such matrix.
const PATIENCE: usize = 10;
/// Errors of row sums that are rounding.
const ROUNDING: f64 = 4.0 * f64::EPSILON;
/// How often caps are looked for and the rest balanced again.
const CAP_ROUNDS: usize = 3;
/// A pair whose exchange area differs by less than this from the unobstructed one is clear.
const CLEAR: f64 = 1e-9;

/// A pair, lesser index first, and what its exchange area may be at the most.
type Cap = ((u32, u32), f64);

/// What an exchange area would be if nothing stood in the way.
pub(super) type Bound<'a> = &'a (dyn Fn(usize, usize) -> f64 + Sync);

/// How row sums are made right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ClosureMethodKind {
    /// Not at all: their errors show the accuracy.
    #[default]
    None,
    /// `d_i a_ij d_j`.
    Scaling,
    /// The smallest change, each weighted with the inverse of its entry.
    LeastSquares,
}

/// A closure as users meet it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClosureMethod {
    /// The word that selects it.
    pub name: &'static str,
    /// One line for help and documentation.
    pub summary: &'static str,
    /// What it is.
    pub kind: ClosureMethodKind,
}

/// Every closure.
pub const CLOSURES: [ClosureMethod; 3] = [
    ClosureMethod {
        name: "none",
        summary: "row sums stay as computed; their error measures the accuracy",
        kind: ClosureMethodKind::None,
    },
    ClosureMethod {
        name: "scaling",
        summary: "multiply rows and columns by the same positive numbers",
        kind: ClosureMethodKind::Scaling,
    },
    ClosureMethod {
        name: "least-squares",
        summary: "the smallest change of A F, relative to its entries",
        kind: ClosureMethodKind::LeastSquares,
    },
];

impl ClosureMethodKind {
    /// The word that selects it.
    pub fn name(self) -> &'static str {
        CLOSURES.iter().find(|method| method.kind == self).map_or("", |method| method.name)
    }
}

/// What a closure did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closed {
    /// How.
    pub method: ClosureMethodKind,
    /// The greatest difference between the sum of a row and what it should be, before.
    pub error_before: f64,
    /// The same, after: not rounding where no matrix with these zeros and caps has such sums.
    pub error_after: f64,
    /// The greatest relative change of a factor.
    pub largest_change: f64,
    /// Number of pairs that were kept at their unobstructed value.
    pub capped: usize,
}

/// What must not be exceeded.
#[derive(Clone, Copy)]
pub(super) struct Limits<'a> {
    /// The exchange areas if nothing stood in the way.
    pub(super) bound: Bound<'a>,
    /// As they were integrated, to tell what is clear; if not given, those that are to be changed.
    pub(super) integrated: Option<&'a Matrix>,
}

/// Makes the rows sum to `targets`, in m², which are no more than their areas.
pub(super) fn close(
    matrix: &mut Matrix,
    surfaces: &[Surface],
    targets: &[f64],
    method: ClosureMethodKind,
    limits: Option<Limits<'_>>,
    progress: &dyn Progress,
) -> Result<Closed, Interrupted> {
    let before = sums(matrix, surfaces);
    let targets = targets.iter().zip(surfaces).map(|(target, surface)| target / surface.area).collect();
    let problem = Problem { surfaces, targets, before };
    let n = matrix.len();
    let gain = match method {
        ClosureMethodKind::LeastSquares => Gain::Sum(vec![0.0; n]),
        _ => Gain::Product(vec![1.0; n]),
    };
    matrix.correction = Some(Correction { gain, caps: HashMap::new(), shrink: vec![1.0; n] });
    let stage = Stage::begin(progress, "closure", (ROUNDS * CAP_ROUNDS) as u64);
    for _ in 0..CAP_ROUNDS {
        problem.balance(matrix, progress)?;
        let Some(limits) = limits else { break };
        let caps = raised_too_far(matrix, limits, progress)?;
        if caps.is_empty() {
            break;
        }
        // After the last round, the rows that these belong to sum to a little less than they should.
        if let Some(correction) = &mut matrix.correction {
            correction.caps.extend(caps);
        }
    }
    problem.shrink(matrix);
    drop(stage);
    Ok(Closed {
        method,
        error_before: problem.error(&problem.before),
        error_after: problem.error(&sums(matrix, surfaces)),
        largest_change: largest_change(matrix),
        capped: matrix.correction.as_ref().map_or(0, |correction| correction.caps.len()),
    })
}

/// What the sums of the rows of F are, and should be.
struct Problem<'a> {
    surfaces: &'a [Surface],
    targets: Vec<f64>,
    before: Vec<f64>,
}

impl Problem<'_> {
    fn error(&self, sums: &[f64]) -> f64 {
        greatest(sums.iter().zip(&self.targets).map(|(sum, target)| (sum - target).abs()))
    }

    /// The fixed-point iteration.
    fn balance(&self, matrix: &mut Matrix, progress: &dyn Progress) -> Result<(), Interrupted> {
        let mut errors: Vec<f64> = Vec::new();
        for round in 0..ROUNDS {
            if progress.interrupted() {
                return Err(Interrupted);
            }
            let sums = sums(matrix, self.surfaces);
            errors.push(self.error(&sums));
            let stalls = round >= PATIENCE && errors[round] > 0.9 * errors[round - PATIENCE];
            if errors[round] <= ROUNDING || errors[round].is_nan() || stalls {
                break;
            }
            self.step(matrix, &sums);
            progress.advance(1);
        }
        Ok(())
    }

    fn step(&self, matrix: &mut Matrix, sums: &[f64]) {
        let Some(correction) = &mut matrix.correction else { return };
        let rows = sums.iter().zip(&self.targets).zip(&self.before).enumerate();
        match &mut correction.gain {
            Gain::Product(d) => rows
                .filter(|(_, ((sum, _), _))| **sum > 0.0)
                .for_each(|(i, ((sum, target), _))| d[i] *= (target / sum).sqrt()),
            Gain::Sum(lambda) => rows
                .filter(|(_, (_, before))| **before > 0.0)
                .for_each(|(i, ((sum, target), before))| lambda[i] += (target - sum) / (2.0 * before)),
        }
    }

    /// Takes away what makes a row sum to more than one, if only by rounding.
    fn shrink(&self, matrix: &mut Matrix) {
        let mut margin = f64::EPSILON;
        for _ in 0..20 {
            let sums = sums(matrix, self.surfaces);
            let Some(correction) = &mut matrix.correction else { return };
            let over: Vec<usize> = (0..sums.len()).filter(|&i| sums[i] > 1.0).collect();
            if over.is_empty() {
                return;
            }
            for i in over {
                correction.shrink[i] *= (1.0 - margin) / sums[i];
            }
            margin *= 4.0;
        }
    }
}

/// Σ_j F_ij for every row.
pub(super) fn sums(matrix: &Matrix, surfaces: &[Surface]) -> Vec<f64> {
    let sum = |i: usize| matrix.entries(i).iter().map(|(_, exchanged)| exchanged / surfaces[i].area).sum();
    (0..matrix.len()).into_par_iter().map(sum).collect()
}

/// The pairs of which something hides a part, but which are now above what they would be if nothing did, with that value.
fn raised_too_far(matrix: &Matrix, limits: Limits<'_>, progress: &dyn Progress) -> Result<Vec<Cap>, Interrupted> {
    let integrated = limits.integrated.unwrap_or(matrix);
    let of_row = |i: usize| {
        if progress.interrupted() {
            return Err(Interrupted);
        }
        let cap = |(j, value): (u32, f64)| {
            let before = matrix.uncorrected(i, j as usize);
            if (j as usize) < i || value <= before {
                return None;
            }
            let most = (limits.bound)(i, j as usize);
            let clear = (integrated.uncorrected(i, j as usize) - most).abs() <= CLEAR * most;
            // What there was stays, should it be above the bound by an error of quadrature.
            (!clear && value > most.max(before)).then(|| ((i as u32, j), most.max(before)))
        };
        Ok(matrix.entries(i).into_iter().filter_map(cap).collect::<Vec<_>>())
    };
    let rows: Vec<Vec<_>> = (0..matrix.len()).into_par_iter().map(of_row).collect::<Result<_, _>>()?;
    Ok(rows.into_iter().flatten().collect())
}

/// The greatest relative change of an entry.
fn largest_change(matrix: &Matrix) -> f64 {
    let of_row = |i: usize| {
        let changes =
            matrix.entries(i).into_iter().map(|(j, value)| (value / matrix.uncorrected(i, j as usize) - 1.0).abs());
        greatest(changes)
    };
    let rows: Vec<f64> = (0..matrix.len()).into_par_iter().map(of_row).collect();
    greatest(rows)
}

#[cfg(test)]
mod tests {
    use super::super::matrix::Areas;
    use super::*;
    use crate::progress::Silent;

    /// Four surfaces of area 1, each of which sees the three others equally, but with 3 % lost on the way; surfaces 0 and
    /// 1 see each other past a small obstacle.
    fn lossy() -> (Matrix, Vec<Surface>) {
        let surface =
            |name: &str| Surface { name: name.to_owned(), area: 1.0, emittance: 1.0, escape: 0.0, escape_error: 0.0 };
        let third = |k: usize| if k / 4 == k % 4 { 0.0 } else { 0.97 / 3.0 };
        let areas = Areas::Table((0..16).map(third).collect());
        (Matrix::new(areas, 4), ["a", "b", "c", "d"].map(surface).into())
    }

    fn closed(method: ClosureMethodKind, bound: Bound<'_>) -> (Matrix, Closed) {
        let (mut matrix, surfaces) = lossy();
        let limits = Limits { bound, integrated: None };
        let closed = close(&mut matrix, &surfaces, &[1.0; 4], method, Some(limits), &Silent).expect("not interrupted");
        (matrix, closed)
    }

    const METHODS: [ClosureMethodKind; 2] = [ClosureMethodKind::Scaling, ClosureMethodKind::LeastSquares];

    #[test]
    fn what_is_obstructed_stays_below_the_unobstructed_and_the_others_make_up_for_it() {
        let unobstructed = 0.327;
        let bound = |i: usize, j: usize| if i + j == 1 { unobstructed } else { 0.97 / 3.0 };
        for method in METHODS {
            let (matrix, closed) = closed(method, &bound);
            assert_eq!((closed.capped, matrix.get(0, 1).to_bits()), (1, unobstructed.to_bits()), "{closed:?}");
            assert!(closed.error_after < 1e-13, "{closed:?}");
            assert!(matrix.get(2, 3) > 0.97 / 3.0 && matrix.get(0, 2) > 1.0 / 3.0);
            assert!((0..4).all(|i| matrix.get(i, i) == 0.0));
        }
    }

    #[test]
    fn what_is_clear_may_grow() {
        for method in METHODS {
            let (matrix, closed) = closed(method, &|_, _| 0.97 / 3.0);
            assert_eq!(closed.capped, 0);
            assert!((matrix.get(0, 1) - 1.0 / 3.0).abs() < 1e-13 && closed.error_after < 1e-13);
            assert!((closed.largest_change - 0.03 / 0.97).abs() < 1e-12, "{closed:?}");
        }
    }

    #[test]
    fn where_everything_is_capped_the_error_is_reported() {
        // All that can be had is 1 % of the 3 %.
        let bound = |_: usize, _: usize| 0.98 / 3.0;
        for method in METHODS {
            let (matrix, closed) = closed(method, &bound);
            assert_eq!(closed.capped, 6);
            assert!((closed.error_before - 0.03).abs() < 1e-12 && (closed.error_after - 0.02).abs() < 1e-12);
            assert!((matrix.get(0, 1) - 0.98 / 3.0).abs() < 1e-15);
        }
    }

    #[test]
    fn every_closure_has_a_name() {
        for method in CLOSURES {
            assert_eq!(method.kind.name(), method.name);
        }
    }
}

//! Linear solvers for several bands at once.
//!
//! Streaming the exchange operator from memory costs far more than anything done with vectors, so all bands go in lock
//! step: each iteration applies the operator *once* to a [`MultiVector`] that holds one direction per band. Bands share
//! nothing else. Each has its own Krylov space or recurrence and its own convergence, since a red wall and a blue one
//! make systems of different spectra; a band that has converged is frozen (its direction is zero) and is not touched
//! again. A block Krylov method, which searches the joint space of all bands, was dropped: the operator may differ from
//! band to band (a reflectance per band), and then no joint space exists.
//!
//! Whatever a recurrence believes, [`gmres()`] and [`cg()`] return only when the *true* residual, computed from the
//! solution itself, has passed the tolerance; [`search()`] has no recurrence, and [`chebyshev()`] promises nothing. Sums run
//! in a fixed order: the same input gives the same bits.
//!
//! The solvers know operators and vectors and nothing of light. [`ALL`] lists them for whoever lets a user choose.

mod cg;
mod chebyshev;
mod gmres;
mod neumann;
mod search;

pub use cg::cg;
pub use chebyshev::{Scaled, chebyshev};
pub use gmres::gmres;
pub use neumann::neumann;
pub use search::{SearchSpace, search};

use crate::linalg::{LinearOperator, MultiVector, each};
use crate::progress::{Interrupted, Progress};

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Params {
    /// Greatest relative residual ‖b − A x‖₂ / ‖b‖₂ allowed in every band.
    pub tolerance: f64,
    /// Greatest number of iterations: passes of the operator that extend the search.
    pub max_iterations: usize,
    /// Number of basis vectors after which [`gmres()`] starts afresh; its memory is this many vectors.
    pub restart: usize,
}

impl Default for Params {
    /// 1e-10 in 1000 iterations, restart 50.
    fn default() -> Self {
        Self { tolerance: 1e-10, max_iterations: 1000, restart: 50 }
    }
}

/// What a solver did.
#[derive(Debug, Clone, PartialEq)]
pub struct Info {
    /// Iterations of the slowest band.
    pub iterations: usize,
    /// The greatest relative residual of all bands.
    pub residual: f64,
    /// The iteration in which each band converged.
    pub converged: Vec<usize>,
}

/// Why there is no solution.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// The iterations ran out; the argument holds the last iterate.
    #[error("not converged after {iterations} iterations: the relative residual is still {residual:.1e}")]
    NotConverged {
        /// Iterations done.
        iterations: usize,
        /// The greatest relative residual of all bands.
        residual: f64,
    },
    /// The method cannot go on: the operator is singular, not positive definite where it must be, or not finite.
    #[error("the solver broke down in band {band}: the operator is singular, indefinite or not finite")]
    Breakdown {
        /// The first band in which it happened.
        band: usize,
    },
    /// The work was asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// The methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// [`gmres()`].
    Gmres,
    /// [`cg()`].
    Cg,
    /// [`neumann()`].
    Neumann,
}

/// One method as users meet it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Solver {
    /// The word that selects it.
    pub name: &'static str,
    /// One line for help and documentation.
    pub summary: &'static str,
    /// Which function it is.
    pub kind: Kind,
}

/// Every solver.
pub const ALL: &[Solver] = &[
    Solver {
        name: "gmres",
        summary: "GMRES, for every system; about 15 iterations at reflectance 0.99",
        kind: Kind::Gmres,
    },
    Solver { name: "cg", summary: "conjugate gradients, for symmetric systems; the least memory", kind: Kind::Cg },
    Solver { name: "neumann", summary: "bounce by bounce, for looking at them; slow when bright", kind: Kind::Neumann },
];

/// The bookkeeping that all methods share: scales, the count of iterations and when each band was done.
struct Watch<'a> {
    params: Params,
    progress: &'a dyn Progress,
    /// The norm that the residual of each band is relative to.
    scales: Vec<f64>,
    iterations: usize,
    /// The iteration in which each band converged, if it has.
    closed: Vec<Option<usize>>,
}

impl<'a> Watch<'a> {
    fn new(scales: Vec<f64>, params: Params, progress: &'a dyn Progress) -> Self {
        progress.begin("solving", params.max_iterations as u64);
        let closed = vec![None; scales.len()];
        Self { params, progress, scales, iterations: 0, closed }
    }

    /// Begins an iteration; `residuals` are the norms that would be reported if there is none left.
    fn tick(&mut self, residuals: &[f64]) -> Result<(), SolveError> {
        if self.progress.interrupted() {
            return Err(Interrupted.into());
        }
        if self.iterations >= self.params.max_iterations {
            let residual = self.worst(residuals);
            return Err(SolveError::NotConverged { iterations: self.iterations, residual });
        }
        self.iterations += 1;
        self.progress.advance(1);
        Ok(())
    }

    /// Which bands are still open; notes when the others closed, and forgets it where a closed one has opened again.
    fn open(&mut self, residuals: &[f64]) -> Vec<bool> {
        for ((closed, &residual), &scale) in self.closed.iter_mut().zip(residuals).zip(&self.scales) {
            let accepted = residual <= self.params.tolerance * scale;
            *closed = accepted.then(|| closed.unwrap_or(self.iterations));
        }
        self.closed.iter().map(Option::is_none).collect()
    }

    /// The greatest relative residual; a band without a right-hand side counts as solved when it is exactly zero.
    fn worst(&self, residuals: &[f64]) -> f64 {
        let relative = |(&r, &scale): (&f64, &f64)| if scale > 0.0 { r / scale } else { r };
        residuals.iter().zip(&self.scales).map(relative).fold(0.0, f64::max)
    }

    fn info(&self, residuals: &[f64]) -> Info {
        let converged = self.closed.iter().map(|closed| closed.unwrap_or(self.iterations)).collect();
        Info { iterations: self.iterations, residual: self.worst(residuals), converged }
    }
}

impl Drop for Watch<'_> {
    fn drop(&mut self) {
        self.progress.end();
    }
}

/// Bands with a zero right-hand side have the solution zero, whatever the guess.
fn clear_dark_bands(rhs: &MultiVector, x: &mut MultiVector) {
    for band in 0..rhs.bands() {
        if rhs.band(band).iter().all(|&b| b == 0.0) {
            x.band_mut(band).fill(0.0);
        }
    }
}

/// `b − A x`.
fn residual(a: &dyn LinearOperator, rhs: &MultiVector, x: &MultiVector) -> MultiVector {
    let mut r = rhs.clone();
    // A guess of nothing needs no product.
    if x.as_slice().iter().any(|&x| x != 0.0) {
        r.add_scaled(-1.0, &a.times(x));
    }
    r
}

/// The first band whose norm is not finite is a breakdown.
fn check_finite(norms: &[f64]) -> Result<(), SolveError> {
    match norms.iter().position(|n| !n.is_finite()) {
        Some(band) => Err(SolveError::Breakdown { band }),
        None => Ok(()),
    }
}

/// `y += factor · x`.
fn add_scaled(y: &mut [f64], factor: f64, x: &[f64]) {
    each(y, x, |y, x| *y += factor * x);
}

#[cfg(test)]
mod tests;

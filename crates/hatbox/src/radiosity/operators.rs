//! The operators of the system, put together from mass, reflectance, exchange and continuity.

use super::products::Product;
use crate::exchange::Exchange;
use crate::linalg::{BlockDiagonal, Csr, Diagonal, LinearOperator, MultiVector, each};
use crate::progress::{Interrupted, Progress, Silent};
use crate::solve::{Params, Scaled, SolveError, cg, chebyshev};
use crate::space::FunctionSpace;
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Rows of a piece of work, of which a near cache has room: a multiple of what most elements have, so that blocks stay whole where all are alike.
const ROWS: usize = 3 << 10;

/// C, Cᵀ and CᵀΔC; where nothing is joined, C is the identity.
#[derive(Clone)]
pub(super) struct Join {
    matrices: Option<[Arc<Csr>; 3]>,
}

impl Join {
    pub(super) fn of(space: &FunctionSpace, mass: &BlockDiagonal) -> Self {
        let matrices = space.shared_continuity().map(|c| {
            let transpose = c.transpose();
            let joined = congruent(c, &transpose, mass);
            [Arc::clone(c), Arc::new(transpose), Arc::new(joined)]
        });
        Self { matrices }
    }

    /// C x: broken coefficients of a joined function.
    pub(super) fn spread<'a>(&self, x: Cow<'a, MultiVector>) -> Cow<'a, MultiVector> {
        match &self.matrices {
            Some([c, ..]) => Cow::Owned(c.times(&x)),
            None => x,
        }
    }

    /// Cᵀ x: integrals against the joined functions.
    pub(super) fn collect<'a>(&self, x: Cow<'a, MultiVector>) -> Cow<'a, MultiVector> {
        match &self.matrices {
            Some([_, transpose, _]) => Cow::Owned(transpose.times(&x)),
            None => x,
        }
    }

    pub(super) fn unknowns(&self, broken: usize) -> usize {
        self.matrices.as_ref().map_or(broken, |[c, ..]| c.cols())
    }
}

/// CᵀΔC.
fn congruent(c: &Csr, transpose: &Csr, mass: &BlockDiagonal) -> Csr {
    let row = |i: usize| {
        let mut entries: Vec<(u32, f64)> = Vec::new();
        for (k, left) in transpose.row(i) {
            let (first, numbers) = mass.row(0, k);
            for (l, number) in numbers.enumerate() {
                for (j, right) in c.row(first + l) {
                    let value = left * number * right;
                    match entries.iter_mut().find(|(column, _)| *column as usize == j) {
                        Some((_, entry)) => *entry += value,
                        None => entries.push((j as u32, value)),
                    }
                }
            }
        }
        entries.sort_unstable_by_key(|&(column, _)| column);
        entries
    };
    let rows: Vec<Vec<(u32, f64)>> = (0..transpose.rows()).into_par_iter().map(row).collect();
    Csr::from_rows(c.cols(), rows)
}

/// CᵀΔC as an operator.
#[derive(Clone, Copy)]
pub(super) struct Mass<'a> {
    pub(super) join: &'a Join,
    pub(super) mass: &'a BlockDiagonal,
}

impl Mass<'_> {
    fn matrix(&self) -> &dyn LinearOperator {
        match &self.join.matrices {
            Some([.., joined]) => &**joined,
            None => self.mass,
        }
    }

    /// ∫N² of each function.
    fn diagonal(&self) -> Vec<f64> {
        let own = |k: usize| {
            let (first, mut numbers) = self.mass.row(0, k);
            numbers.nth(k - first).unwrap_or(0.0)
        };
        match &self.join.matrices {
            Some([.., joined]) => joined.diagonal(),
            None => (0..self.mass.rows()).map(own).collect(),
        }
    }

    /// The products of rows from this one on with a column.
    fn rows_times(&self, first: usize, x: &[f32], y: &mut [f64]) {
        match &self.join.matrices {
            Some([.., joined]) => (first..).zip(y).for_each(|(row, y)| *y = joined.row_times(row, x)),
            None => self.mass.rows_times(0, first, x, y),
        }
    }
}

impl LinearOperator for Mass<'_> {
    fn rows(&self) -> usize {
        self.matrix().rows()
    }
    fn cols(&self) -> usize {
        self.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        self.matrix().apply(x, y);
    }
    fn times_owned(&self, x: MultiVector) -> MultiVector {
        self.matrix().times_owned(x)
    }
}

/// An approximation of (CᵀΔC)⁻¹ that costs nothing.
pub(super) enum RoughInverse {
    /// Exact, where nothing is joined.
    Blocks(BlockDiagonal),
    /// The inverse of the diagonal of the joined matrix. With it that has its eigenvalues in `spectrum`, unless nodes hang: those
    /// functions are joined with shares.
    Diagonal { joined: Arc<Csr>, inverse: Diagonal, spectrum: [f64; 2], hanging: bool },
}

impl RoughInverse {
    pub(super) fn new(join: &Join, [mass, inverse]: [&BlockDiagonal; 2]) -> Self {
        match &join.matrices {
            Some([c, _, joined]) => Self::Diagonal {
                hanging: (0..c.rows()).into_par_iter().any(|row| c.row(row).count() > 1),
                joined: Arc::clone(joined),
                inverse: Diagonal(joined.diagonal().into_iter().map(|d| 1.0 / d).collect()),
                spectrum: mass.scaled_spectrum(),
            },
            None => Self::Blocks(inverse.clone()),
        }
    }
}

/// (CᵀΔC)⁻¹, by Chebyshev's iteration where it is no block matrix, and by conjugate gradients for what that leaves where nodes hang.
///
/// It is the preconditioner of the equation: with the inverse of the diagonal alone the solver has to invert the mass matrix,
/// too, at the price of a product with S each time. To add what the equation gives on a thousand clusters of cells was tried
/// and dropped, since it saved few steps: what is left after a step is as rough as the noise of the rays.
pub(super) struct InverseMass<'a> {
    pub(super) rough: &'a RoughInverse,
    /// Relative residual.
    pub(super) tolerance: f64,
}

impl LinearOperator for InverseMass<'_> {
    fn rows(&self) -> usize {
        match self.rough {
            RoughInverse::Blocks(inverse) => inverse.rows(),
            RoughInverse::Diagonal { joined, .. } => joined.rows(),
        }
    }
    fn cols(&self) -> usize {
        self.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        match self.rough {
            RoughInverse::Blocks(inverse) => inverse.apply(x, y),
            RoughInverse::Diagonal { joined, inverse, spectrum, hanging } => {
                let scaled = Scaled { matrix: joined, inverse_diagonal: &inverse.0, spectrum: *spectrum };
                chebyshev(&scaled, x, y, self.tolerance);
                if !hanging {
                    return;
                }
                let params = Params { tolerance: self.tolerance, max_iterations: 200, ..Params::default() };
                // Rounding may keep it from the last digit; what is reached is what can be.
                let _ = cg(&**joined, inverse, x, y, &params, &Silent);
            }
        }
    }
    fn times_owned(&self, x: MultiVector) -> MultiVector {
        match self.rough {
            RoughInverse::Blocks(inverse) => inverse.times_owned(x),
            RoughInverse::Diagonal { .. } => self.times(&x),
        }
    }
}

/// What arrives from a function: S C, or Cᵀ S C, where linear triangles are joined a sixth of the numbers.
pub(super) struct Arriving<'a> {
    join: &'a Join,
    exchange: &'a dyn Exchange,
    /// Whether it is collected: tested with the joined functions instead of the broken ones.
    collected: bool,
    /// Hears of products that take long.
    progress: &'a dyn Progress,
    /// Whether it has interrupted one, of which nothing arrives.
    interrupted: AtomicBool,
}

impl<'a> Arriving<'a> {
    pub(super) fn new(join: &'a Join, exchange: &'a dyn Exchange, collected: bool, progress: &'a dyn Progress) -> Self {
        Self { join, exchange, collected, progress, interrupted: AtomicBool::new(false) }
    }

    /// What a solver has made of products, be it an error, unless one was interrupted: that is nothing then.
    pub(super) fn unless_interrupted<T>(&self, found: Result<T, SolveError>) -> Result<T, SolveError> {
        if self.interrupted.load(Ordering::Relaxed) { Err(Interrupted.into()) } else { found }
    }
}

impl LinearOperator for Arriving<'_> {
    fn rows(&self) -> usize {
        let broken = self.exchange.rows();
        if self.collected { self.join.unknowns(broken) } else { broken }
    }
    fn cols(&self) -> usize {
        self.join.unknowns(self.exchange.cols())
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        *y = self.times(x);
    }
    fn times(&self, x: &MultiVector) -> MultiVector {
        let arriving = match &self.join.matrices {
            Some([c, transpose, _]) if self.collected => self.exchange.times_joined([c, transpose], x, self.progress),
            _ => self.exchange.times_watched(&self.join.spread(Cow::Borrowed(x)), self.progress),
        };
        arriving.unwrap_or_else(|Interrupted| {
            self.interrupted.store(true, Ordering::Relaxed);
            MultiVector::zeros(self.rows(), x.bands())
        })
    }
}

/// What is reflected of what arrives.
pub(super) enum Reflection {
    /// R of each joined function and band: where R does not vary on what is joined, Cᵀ M_R Δ⁻¹ s = R Cᵀ s. For what is
    /// collected.
    Joined(MultiVector),
    /// M_R Δ⁻¹, for what is not.
    Broken(BlockDiagonal),
}

/// F̂ = Cᵀ M_R Δ⁻¹ S C.
#[derive(Clone, Copy)]
pub(super) struct Transport<'a> {
    pub(super) join: &'a Join,
    /// [`Arriving`], collected as `reflection` wants it.
    pub(super) seen: &'a dyn LinearOperator,
    pub(super) reflection: &'a Reflection,
}

impl Transport<'_> {
    /// F̂ x from what arrives of x.
    fn of(&self, mut seen: MultiVector) -> MultiVector {
        match self.reflection {
            Reflection::Joined(reflectance) => {
                multiply(&mut seen, reflectance);
                seen
            }
            Reflection::Broken(blocks) => self.join.collect(Cow::Owned(blocks.times_owned(seen))).into_owned(),
        }
    }

    /// Rows of F̂ x of one band from this one on, from what arrives of x.
    fn rows_times(&self, band: usize, first: usize, seen: &[f32], y: &mut [f64]) {
        match (self.reflection, &self.join.matrices) {
            (Reflection::Joined(reflectance), _) => {
                let reflectance = &of_band(reflectance, band)[first..];
                y.iter_mut().zip(reflectance).zip(&seen[first..]).for_each(|((y, r), &s)| *y = r * f64::from(s));
            }
            (Reflection::Broken(blocks), None) => blocks.rows_times(band, first, seen, y),
            (Reflection::Broken(blocks), Some([_, transpose, _])) => {
                let of = |(k, share)| share * blocks.row_times(band, k, seen);
                (first..).zip(y).for_each(|(row, y)| *y = transpose.row(row).map(of).sum());
            }
        }
    }
}

impl LinearOperator for Transport<'_> {
    fn rows(&self) -> usize {
        self.join.unknowns(self.seen.rows())
    }
    fn cols(&self) -> usize {
        self.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        *y = self.of(self.seen.times(x));
    }
}

/// D^(−1/2) (Δ − F̂), where D is the diagonal of Δ: what is left of a row is an integral, which is the greater the larger the
/// element. Divided by the roots of ∫N², the 2-norm of what is left is about the L2 norm of the function that it is
/// made of (between the roots of the greatest and the least eigenvalue of D⁻¹Δ). Without, a room beside a wide ground was left
/// unsolved.
pub(super) struct Equation<'a> {
    pub(super) transport: Transport<'a>,
    mass: Mass<'a>,
    /// The roots of D.
    pub(super) roots: Arc<[f64]>,
}

impl<'a> Equation<'a> {
    pub(super) fn new(mass: Mass<'a>, transport: Transport<'a>) -> Self {
        Self { transport, mass, roots: mass.diagonal().into_iter().map(f64::sqrt).collect() }
    }

    /// The operator on functions x of one band, from each and what arrives of it, and the sum of its rows, each times its root of
    /// D, before they are rounded. Some rows of all functions at a time, so that the matrix is read once.
    pub(super) fn of_band(&self, band: usize, products: &[Arc<Product>]) -> Vec<(Vec<f32>, f64)> {
        let mut all = vec![vec![0.0; self.rows()]; products.len()];
        let mut pieces: Vec<_> = all.iter_mut().map(|column| column.chunks_mut(ROWS)).collect();
        let parts = (0..self.rows().div_ceil(ROWS)).map(|_| pieces.iter_mut().filter_map(Iterator::next).collect());
        let parts: Vec<Vec<&mut [f32]>> = parts.collect();
        let of_piece = |(part, (piece, product)): (usize, (&mut [f32], &Arc<Product>))| {
            let first = part * ROWS;
            let [mut own, mut reflected] = [(); 2].map(|()| vec![0.0; piece.len()]);
            self.mass.rows_times(first, &product.x, &mut own);
            self.transport.rows_times(band, first, &product.image, &mut reflected);
            let rest = || own.iter().zip(&reflected).map(|(own, reflected)| own - reflected);
            for ((value, rest), root) in piece.iter_mut().zip(rest()).zip(&self.roots[first..]) {
                *value = (rest / root) as f32;
            }
            rest().sum::<f64>()
        };
        let of_part = |(part, pieces): (usize, Vec<_>)| -> Vec<f64> {
            pieces.into_iter().zip(products).map(|piece| of_piece((part, piece))).collect()
        };
        // In order, so that it is the same on any number of threads.
        let sums: Vec<Vec<f64>> = parts.into_par_iter().enumerate().map(of_part).collect();
        let sum = |k: usize| sums.iter().map(|of_part| of_part[k]).sum();
        all.into_iter().enumerate().map(|(k, column)| (column, sum(k))).collect()
    }

    /// The right side D^(−1/2) F̂ β from what arrives of the emission β.
    pub(super) fn first_bounce(&self, seen: MultiVector) -> MultiVector {
        self.scaled(self.transport.of(seen))
    }

    fn scaled(&self, mut y: MultiVector) -> MultiVector {
        for_rows(&mut y, &self.roots, |y, root| *y /= root);
        y
    }
}

impl LinearOperator for Equation<'_> {
    fn rows(&self) -> usize {
        self.mass.rows()
    }
    fn cols(&self) -> usize {
        self.mass.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        let mut rest = self.mass.times(x);
        rest.add_scaled(-1.0, &self.transport.times(x));
        *y = self.scaled(rest);
    }
}

/// The inverse mass for the rows of an [`Equation`]: Δ⁻¹ D^(1/2).
pub(super) struct ScaledInverse<'a> {
    pub(super) inverse: InverseMass<'a>,
    pub(super) roots: &'a [f64],
}

impl LinearOperator for ScaledInverse<'_> {
    fn rows(&self) -> usize {
        self.inverse.rows()
    }
    fn cols(&self) -> usize {
        self.inverse.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        *y = self.times_owned(x.clone());
    }
    fn times_owned(&self, mut x: MultiVector) -> MultiVector {
        for_rows(&mut x, self.roots, |x, root| *x *= root);
        self.inverse.times_owned(x)
    }
}

/// Cᵀ(Δ − √R S √R)C, for R constant on every element: symmetric and positive definite.
///
/// With b = β + √R c, where β is the emission's projection, Δb = b⁰ + R S b becomes this operator on c, with the right
/// side Cᵀ√R S β; no division by R is needed, so black surfaces are allowed.
pub(super) struct Symmetric<'a> {
    pub(super) mass: Mass<'a>,
    pub(super) exchange: &'a dyn Exchange,
    /// √R for each broken coefficient and band.
    pub(super) root: &'a MultiVector,
}

impl Symmetric<'_> {
    /// Cᵀ √R S x for broken coefficients x.
    pub(super) fn reflected(&self, x: &MultiVector) -> MultiVector {
        let mut y = self.exchange.times(x);
        multiply(&mut y, self.root);
        self.mass.join.collect(Cow::Owned(y)).into_owned()
    }

    /// √R C c.
    pub(super) fn scaled(&self, c: &MultiVector) -> MultiVector {
        let mut x = self.mass.join.spread(Cow::Borrowed(c)).into_owned();
        multiply(&mut x, self.root);
        x
    }
}

impl LinearOperator for Symmetric<'_> {
    fn rows(&self) -> usize {
        self.mass.rows()
    }
    fn cols(&self) -> usize {
        self.mass.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        self.mass.apply(x, y);
        y.add_scaled(-1.0, &self.reflected(&self.scaled(x)));
    }
}

/// Changes each entry by the number of its row.
fn for_rows(x: &mut MultiVector, numbers: &[f64], change: impl Fn(&mut f64, f64) + Sync) {
    for band in 0..x.bands() {
        each(x.band_mut(band), numbers, &change);
    }
}

/// Multiplies entry by entry.
fn multiply(x: &mut MultiVector, by: &MultiVector) {
    for band in 0..x.bands() {
        each(x.band_mut(band), of_band(by, band), |x, b| *x *= b);
    }
}

/// One band of numbers; what has one band goes with any number of columns.
fn of_band(numbers: &MultiVector, band: usize) -> &[f64] {
    numbers.band(band.min(numbers.bands() - 1))
}

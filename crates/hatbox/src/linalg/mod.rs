//! Vectors with several bands, and the operators that act on them.
//!
//! A solve carries several right-hand sides at once (bands, suns, light groups), and the exchange operator is expensive
//! to stream from memory, so the unit of work is the [`MultiVector`]: all columns go through one pass of an operator.
//! Small dense blocks and sparse rows are all that the finite elements need; large dense matrices belong to
//! [`crate::exchange`], Krylov methods to [`crate::solve`].

mod block_diagonal;
mod csr;
mod fit;
mod multivector;
mod number;

pub use block_diagonal::{BlockDiagonal, DiagonalBlock};
pub use csr::Csr;
pub(crate) use fit::Columns;
pub use multivector::MultiVector;
pub(crate) use multivector::{dot, each};
pub(crate) use number::Number;

/// A linear map applied to all columns of a [`MultiVector`] in one pass.
///
/// The map may differ from column to column (a reflectance per band); columns never mix.
pub trait LinearOperator: Sync {
    /// Number of rows, the length of a result column.
    fn rows(&self) -> usize;
    /// Number of columns, the length of an argument column.
    fn cols(&self) -> usize;
    /// `y = A x`; what `y` held before does not matter.
    fn apply(&self, x: &MultiVector, y: &mut MultiVector);

    /// `A x` in a new vector.
    fn times(&self, x: &MultiVector) -> MultiVector {
        let mut y = MultiVector::zeros(self.rows(), x.bands());
        self.apply(x, &mut y);
        y
    }

    /// `A x`, in the memory of x where the operator can.
    fn times_owned(&self, x: MultiVector) -> MultiVector {
        self.times(&x)
    }
}

/// The identity, where an operator is asked for and nothing is to be done.
#[derive(Debug, Clone, Copy)]
pub struct Identity(pub usize);

impl LinearOperator for Identity {
    fn rows(&self) -> usize {
        self.0
    }
    fn cols(&self) -> usize {
        self.0
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        y.clone_from(x);
    }
}

/// A diagonal matrix, the same for all bands.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagonal(pub Vec<f64>);

impl LinearOperator for Diagonal {
    fn rows(&self) -> usize {
        self.0.len()
    }
    fn cols(&self) -> usize {
        self.0.len()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        for band in 0..x.bands() {
            let y = y.band_mut(band);
            y.copy_from_slice(x.band(band));
            each(y, &self.0, |y, d| *y *= d);
        }
    }
}

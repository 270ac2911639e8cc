//! Small factors dropped, and the others made up for them, so that the matrix is sparse and the rows sum to what they did.

use super::closure::{self, ClosureMethodKind, Limits};
use super::matrix::{Areas, Matrix};
use super::{Closed, Surface};
use crate::linalg::Csr;
use crate::progress::{Interrupted, Progress};
use rayon::prelude::*;

/// Entries of a row, each with its column.
type Entries = Vec<(u32, f64)>;

/// What a threshold did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thinned {
    /// The threshold.
    pub threshold: f64,
    /// Number of factors that were dropped: two for each pair of different surfaces.
    pub dropped: usize,
    /// Number of factors that are left.
    pub kept: usize,
    /// The most that a row lost, as a part of what leaves its surface, before the others made up for it.
    pub largest_loss: f64,
    /// How they made up for it; its errors are against the row sums before anything was dropped, or 1
    /// where a sum was greater.
    pub closure: Closed,
}

/// Drops both factors of a pair if neither reaches the threshold, that is if A_i F_ij is below the threshold times the
/// lesser area, and gives the rest the row sums that the whole had.
pub(super) fn thin(
    matrix: &mut Matrix,
    surfaces: &[Surface],
    threshold: f64,
    method: ClosureMethodKind,
    limits: Option<Limits<'_>>,
    progress: &dyn Progress,
) -> Result<Thinned, Interrupted> {
    let area = |i: usize| surfaces[i].area;
    // No row is to sum to more than one, even if it did.
    let sums = closure::sums(matrix, surfaces);
    let targets: Vec<f64> = sums.iter().zip(surfaces).map(|(sum, surface)| sum.min(1.0) * surface.area).collect();
    let split = |i: usize| -> (Entries, Entries) {
        let kept = |&(j, exchanged): &(u32, f64)| exchanged >= threshold * area(i).min(area(j as usize));
        matrix.entries(i).into_iter().partition(kept)
    };
    let rows: Vec<_> = (0..matrix.len()).into_par_iter().map(split).collect();
    let dropped = rows.iter().map(|(_, dropped)| dropped.len()).sum();
    let loss = |(i, (_, dropped)): (usize, &(_, Entries))| {
        dropped.iter().map(|(_, exchanged)| exchanged).sum::<f64>() / area(i)
    };
    let largest_loss = super::check::greatest(rows.iter().enumerate().map(loss));
    let sparse = Csr::from_rows(matrix.len(), rows.into_iter().map(|(kept, _)| kept));
    let kept = sparse.stored();
    let whole = std::mem::replace(matrix, Matrix::new(Areas::Sparse(sparse), surfaces.len()));
    let limits = limits.map(|limits| Limits { integrated: Some(&whole), ..limits });
    let closure = closure::close(matrix, surfaces, &targets, method, limits, progress)?;
    Ok(Thinned { threshold, dropped, kept, largest_loss, closure })
}

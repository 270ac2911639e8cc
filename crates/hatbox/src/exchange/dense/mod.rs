//! All pairs, stored: the reference for every other operator.
//!
//! S is symmetric, so only the blocks on and above the diagonal are kept, each cell's rows in one run: 4 n² bytes for n
//! unknowns in f64. (f32 would halve that and cap the row sums at seven digits; closed scenes balance power to nine.)
//! A product reads every coefficient once and uses it twice, for all bands.
//!
//! Rows and columns are in the order of a tree over the cells, so that what is integrated together lies together.

mod build;
mod facts;
mod panorama;
mod sums;
mod table;
mod views;

pub use facts::RowFacts;
pub use panorama::Panorama;
pub(crate) use views::Between;
pub use views::{PointRow, Viewpoint, Views};

use super::{Exchange, ExchangeError, Geometry, Params, Statistics};
use crate::assemble::Panel;
use crate::linalg::{LinearOperator, MultiVector};
use crate::progress::Progress;
use rayon::prelude::*;
use std::ops::Range;
use table::Table;

/// A product is cut into this many runs of rows, each with its own result, added in order: fixed, so that sums do not
/// depend on the number of threads.
const RUNS: usize = 32;

/// The upper triangle of S.
#[derive(Debug)]
pub struct Dense {
    /// The place of each cell.
    place: Vec<u32>,
    /// First unknown of the cell at each place, and their number.
    offsets: Vec<usize>,
    /// The unknown of the space at each place of the matrix.
    unknowns: Vec<u32>,
    /// For each place, its rows from its own first column on.
    table: Table,
    /// See [`Exchange::row_errors`].
    row_errors: Vec<f64>,
    statistics: Statistics,
}

impl Dense {
    /// The word that selects it.
    pub const NAME: &'static str = "dense";

    /// Bytes that the coefficients of so many unknowns take.
    pub const fn bytes(unknowns: usize) -> usize {
        unknowns.saturating_mul(unknowns + 1) / 2 * size_of::<f64>()
    }

    /// Integrates all pairs.
    ///
    /// # Errors
    /// [`ExchangeError::TooLarge`] before any work if the memory would not do, [`ExchangeError::Interrupted`].
    pub fn new(geometry: &Geometry<'_>, params: &Params, progress: &dyn Progress) -> Result<Self, ExchangeError> {
        let unknowns = geometry.space.broken_dofs();
        let bytes = Self::bytes(unknowns);
        if bytes > params.memory {
            return Err(ExchangeError::TooLarge { unknowns, bytes, limit: params.memory });
        }
        Ok(build::build(geometry, params, progress)?)
    }

    /// An operator of nothing yet, in an order.
    fn empty(panels: &[Panel], order: &[u32]) -> Self {
        let mut first = vec![0_u32];
        for panel in panels {
            first.push(first[first.len() - 1] + panel.element.dofs() as u32);
        }
        let mut place = vec![0; order.len()];
        let (mut offsets, mut unknowns) = (vec![0], Vec::new());
        for (k, &cell) in order.iter().enumerate() {
            place[cell as usize] = k as u32;
            unknowns.extend(first[cell as usize]..first[cell as usize + 1]);
            offsets.push(unknowns.len());
        }
        Self {
            place,
            offsets,
            unknowns,
            table: Table::new([].into_iter()),
            row_errors: Vec::new(),
            statistics: Statistics::default(),
        }
    }

    /// Numbers in the rows of each place.
    fn lengths(&self) -> impl Iterator<Item = usize> + '_ {
        let all = self.unknowns.len();
        self.offsets.windows(2).map(move |pair| (pair[1] - pair[0]) * (all - pair[0]))
    }

    /// The sum of the block of two cells, A_i F_ij for the constants' view factor: by symmetry either way round.
    pub fn exchange_area(&self, i: usize, j: usize) -> f64 {
        let [i, j] = self.places(i, j);
        let width = self.rows() - self.offsets[i];
        let columns = self.offsets[j] - self.offsets[i]..self.offsets[j + 1] - self.offsets[i];
        self.table.row(i).chunks_exact(width).map(|row| row[columns.clone()].iter().sum::<f64>()).sum()
    }

    /// The exchange areas of some cells with all others, by cell: rows of the symmetric matrix, one after the other.
    ///
    /// Half of a row is a column of the triangle, whose numbers lie far apart; those of neighbours lie side by side.
    ///
    /// # Panics
    /// If `out` does not have a place for each cell in each row.
    pub fn fill_exchange_rows(&self, cells: Range<usize>, out: &mut [f64]) {
        let n = self.place.len();
        assert_eq!(out.len(), cells.len() * n, "a place for each cell in each row");
        if out.is_empty() {
            return;
        }
        if self.unknowns.len() == n {
            self.fill_columns(cells.clone(), out);
            for (cell, row) in cells.zip(out.chunks_exact_mut(n)) {
                let place = self.place[cell] as usize;
                for (s, &other) in self.table.row(place).iter().zip(&self.unknowns[place..]) {
                    row[other as usize] = *s;
                }
            }
            return;
        }
        for (cell, row) in cells.zip(out.chunks_exact_mut(n)) {
            for (other, out) in row.iter_mut().enumerate() {
                *out = self.exchange_area(cell, other);
            }
        }
    }

    /// The parts of these rows that are columns of the triangle, down to the diagonal; one unknown a cell.
    fn fill_columns(&self, cells: Range<usize>, out: &mut [f64]) {
        let n = self.place.len();
        let mut rows: Vec<(usize, &mut [f64])> =
            self.place[cells].iter().map(|&place| place as usize).zip(out.chunks_exact_mut(n)).collect();
        rows.sort_unstable_by_key(|&(place, _)| place);
        let mut first = 0;
        for (before, &other) in self.unknowns.iter().enumerate() {
            first += rows[first..].iter().take_while(|&&(place, _)| place <= before).count();
            let row = self.table.row(before);
            for (place, out) in &mut rows[first..] {
                out[other as usize] = row[*place - before];
            }
            if first == rows.len() {
                break;
            }
        }
    }

    /// The places of two cells, the lesser first.
    fn places(&self, i: usize, j: usize) -> [usize; 2] {
        let (i, j) = (self.place[i] as usize, self.place[j] as usize);
        [i.min(j), i.max(j)]
    }

    /// Adds what the rows at a range of places contribute to y = S x, in one band.
    fn apply_rows(&self, places: Range<usize>, x: &[f64], y: &mut [f64]) {
        for place in places {
            let (first, end) = (self.offsets[place], self.offsets[place + 1]);
            for (k, row) in self.table.row(place).chunks_exact(x.len() - first).enumerate() {
                // The diagonal block is zero: a planar cell does not see itself.
                let off = end - first;
                y[first + k] += symmetric_row(&row[off..], &x[end..], x[first + k], &mut y[end..]);
            }
        }
    }
}

/// Returns s·x and adds xi s to y: both uses of a row of the upper triangle.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn symmetric_row(s: &[f64], x: &[f64], xi: f64, y: &mut [f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let (s8, s_rest) = s.as_chunks::<8>();
    let (x8, x_rest) = x[..s.len()].as_chunks::<8>();
    let (y8, y_rest) = y[..s.len()].as_chunks_mut::<8>();
    for ((s, x), y) in s8.iter().zip(x8).zip(y8) {
        for lane in 0..8 {
            lanes[lane] += s[lane] * x[lane];
            y[lane] += xi * s[lane];
        }
    }
    let mut sum: f64 = lanes.iter().sum();
    for ((s, x), y) in s_rest.iter().zip(x_rest).zip(y_rest) {
        sum += s * x;
        *y += xi * s;
    }
    sum
}

impl LinearOperator for Dense {
    fn rows(&self) -> usize {
        self.offsets[self.offsets.len() - 1]
    }

    fn cols(&self) -> usize {
        self.rows()
    }

    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        let cells = self.table.len();
        // Equal shares of the triangle: row c has a length of about n − c.
        let bound = |run: usize| {
            let left = 1.0 - run as f64 / RUNS as f64;
            (cells as f64 * (1.0 - left.sqrt())).round() as usize
        };
        let mut ordered = MultiVector::zeros(x.rows(), x.bands());
        for band in 0..x.bands() {
            let from = x.band(band);
            for (to, &unknown) in ordered.band_mut(band).iter_mut().zip(&self.unknowns) {
                *to = from[unknown as usize];
            }
        }
        let x = &ordered;
        let parts: Vec<MultiVector> = (0..RUNS)
            .into_par_iter()
            .map(|run| {
                let mut part = MultiVector::zeros(x.rows(), x.bands());
                for place in bound(run)..bound(run + 1) {
                    for band in 0..x.bands() {
                        self.apply_rows(place..place + 1, x.band(band), part.band_mut(band));
                    }
                }
                part
            })
            .collect();
        let mut sum = MultiVector::zeros(x.rows(), x.bands());
        for part in &parts {
            sum.add_scaled(1.0, part);
        }
        for band in 0..x.bands() {
            let to = y.band_mut(band);
            for (from, &unknown) in sum.band(band).iter().zip(&self.unknowns) {
                to[unknown as usize] = *from;
            }
        }
    }
}

impl Exchange for Dense {
    fn kind(&self) -> &'static str {
        Self::NAME
    }

    fn statistics(&self) -> Statistics {
        self.statistics
    }

    fn row_errors(&self) -> Option<&[f64]> {
        Some(&self.row_errors)
    }

    fn join_exchanging(&self, join: &mut dyn FnMut(usize, usize)) -> bool {
        let mut cells = vec![0; self.place.len()];
        self.place.iter().enumerate().for_each(|(cell, &place)| cells[place as usize] = cell);
        for (place, &cell) in cells.iter().enumerate() {
            let (row, first) = (self.table.row(place), self.offsets[place]);
            let width = self.rows() - first;
            for (other, range) in cells.iter().zip(self.offsets.windows(2)).skip(place + 1) {
                let columns = range[0] - first..range[1] - first;
                if row.chunks_exact(width).any(|row| row[columns.clone()].iter().any(|&s| s != 0.0)) {
                    join(cell, *other);
                }
            }
        }
        true
    }
}

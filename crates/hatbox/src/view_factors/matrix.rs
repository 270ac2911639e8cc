//! The exchange areas `A_i F_ij`: a symmetric matrix, stored in one of several ways, and what a closure does to it.

use crate::exchange::{Dense, Exchange};
use crate::linalg::Csr;
use std::collections::HashMap;
use std::ops::Range;

/// Where the exchange areas come from.
#[derive(Debug)]
pub(super) enum Areas {
    /// Between elements, as integrated.
    Elements(Dense),
    /// Row after row.
    Table(Vec<f64>),
    /// What is left after dropping small ones.
    Sparse(Csr),
}

/// What is done to the exchange areas, entry by entry; the same for (i, j) and (j, i).
#[derive(Debug, Clone)]
pub(super) struct Correction {
    pub(super) gain: Gain,
    /// Entries (lesser index first) that may not grow beyond a value.
    pub(super) caps: HashMap<(u32, u32), f64>,
    /// Factors of at most 1 for rows and columns, after everything else.
    pub(super) shrink: Vec<f64>,
}

/// By what an entry is multiplied.
#[derive(Debug, Clone)]
pub(super) enum Gain {
    /// d_i d_j
    Product(Vec<f64>),
    /// 1 + λ_i + λ_j, or 0 if that is negative
    Sum(Vec<f64>),
}

impl Correction {
    pub(super) fn gain(&self, i: usize, j: usize) -> f64 {
        match &self.gain {
            Gain::Product(d) => d[i] * d[j],
            Gain::Sum(lambda) => (1.0 + (lambda[i] + lambda[j])).max(0.0),
        }
    }

    fn apply(&self, i: usize, j: usize, exchanged: f64) -> f64 {
        let mut value = exchanged * self.gain(i, j);
        if !self.caps.is_empty()
            && let Some(&cap) = self.caps.get(&(i.min(j) as u32, i.max(j) as u32))
            && value > cap
        {
            value = cap;
        }
        value * (self.shrink[i] * self.shrink[j])
    }
}

/// The exchange areas and their correction.
#[derive(Debug)]
pub(super) struct Matrix {
    pub(super) areas: Areas,
    pub(super) correction: Option<Correction>,
    len: usize,
}

impl Matrix {
    pub(super) fn new(areas: Areas, len: usize) -> Self {
        Self { areas, correction: None, len }
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// `A_i F_ij`.
    pub(super) fn get(&self, i: usize, j: usize) -> f64 {
        self.corrected(i, j, self.uncorrected(i, j))
    }

    /// `A_i F_ij` without the correction.
    pub(super) fn uncorrected(&self, i: usize, j: usize) -> f64 {
        match &self.areas {
            Areas::Elements(dense) => dense.exchange_area(i, j),
            Areas::Table(values) => values[i * self.len + j],
            Areas::Sparse(matrix) => matrix.get(i, j),
        }
    }

    fn corrected(&self, i: usize, j: usize, exchanged: f64) -> f64 {
        match &self.correction {
            // Nothing becomes of nothing; and what is not a number must stay one that is not.
            Some(correction) if exchanged != 0.0 => correction.apply(i, j, exchanged),
            _ => exchanged,
        }
    }

    /// `A_i F_ij` for all j, for some i: row after row.
    pub(super) fn fill_rows(&self, rows: Range<usize>, out: &mut [f64]) {
        self.fill_uncorrected(rows.clone(), out);
        if self.correction.is_some() {
            for (i, row) in rows.zip(out.chunks_exact_mut(self.len)) {
                for (j, value) in row.iter_mut().enumerate() {
                    *value = self.corrected(i, j, *value);
                }
            }
        }
    }

    fn fill_uncorrected(&self, rows: Range<usize>, out: &mut [f64]) {
        match &self.areas {
            Areas::Elements(dense) => dense.fill_exchange_rows(rows, out),
            Areas::Table(values) => out.copy_from_slice(&values[rows.start * self.len..rows.end * self.len]),
            Areas::Sparse(matrix) => {
                out.fill(0.0);
                for (i, row) in rows.zip(out.chunks_exact_mut(self.len)) {
                    for (j, value) in matrix.row(i) {
                        row[j] = value;
                    }
                }
            }
        }
    }

    /// The entries of a row that are not zero, each with its column.
    pub(super) fn entries(&self, i: usize) -> Vec<(u32, f64)> {
        self.entries_of(i..i + 1).into_iter().flatten().collect()
    }

    /// The entries of some rows that are not zero, each with its column.
    pub(super) fn entries_of(&self, rows: Range<usize>) -> Vec<Vec<(u32, f64)>> {
        let nonzero = |&(_, value): &(u32, f64)| value != 0.0;
        if let Areas::Sparse(matrix) = &self.areas {
            let entry = |i: usize| matrix.row(i).map(move |(j, value)| (j as u32, self.corrected(i, j, value)));
            return rows.map(|i| entry(i).filter(nonzero).collect()).collect();
        }
        let mut whole = vec![0.0; rows.len() * self.len];
        self.fill_rows(rows, &mut whole);
        let of = |row: &[f64]| row.iter().enumerate().map(|(j, &value)| (j as u32, value)).filter(nonzero).collect();
        whole.chunks_exact(self.len).map(of).collect()
    }

    /// Bytes it takes.
    pub(super) fn bytes(&self) -> usize {
        match &self.areas {
            Areas::Elements(dense) => dense.statistics().bytes,
            Areas::Table(values) => size_of_val(values.as_slice()),
            Areas::Sparse(matrix) => matrix.stored() * (size_of::<u32>() + size_of::<f64>()),
        }
    }
}

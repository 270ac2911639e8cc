//! The exchange areas `A_i F_ij`: a symmetric matrix, stored in one of several ways, and what a closure does to it.

use crate::exchange::{Dense, Exchange};
use crate::linalg::Csr;
use std::collections::HashMap;

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

    /// `A_i F_ij` for all j.
    pub(super) fn fill_row(&self, i: usize, row: &mut [f64]) {
        self.fill_uncorrected(i, row);
        if self.correction.is_some() {
            for (j, value) in row.iter_mut().enumerate() {
                *value = self.corrected(i, j, *value);
            }
        }
    }

    fn fill_uncorrected(&self, i: usize, row: &mut [f64]) {
        match &self.areas {
            Areas::Elements(dense) => dense.fill_exchange_row(i, row),
            Areas::Table(values) => row.copy_from_slice(&values[i * self.len..(i + 1) * self.len]),
            Areas::Sparse(matrix) => {
                row.fill(0.0);
                for (j, value) in matrix.row(i) {
                    row[j] = value;
                }
            }
        }
    }

    /// The entries of a row that are not zero, each with its column.
    pub(super) fn entries(&self, i: usize) -> Vec<(u32, f64)> {
        let nonzero = |&(_, value): &(u32, f64)| value != 0.0;
        if let Areas::Sparse(matrix) = &self.areas {
            return matrix.row(i).map(|(j, value)| (j as u32, self.corrected(i, j, value))).filter(nonzero).collect();
        }
        let mut row = vec![0.0; self.len];
        self.fill_row(i, &mut row);
        row.into_iter().enumerate().map(|(j, value)| (j as u32, value)).filter(nonzero).collect()
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

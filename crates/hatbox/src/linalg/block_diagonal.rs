use super::{LinearOperator, MultiVector};
use rayon::prelude::*;
use std::ops::Range;

/// Blocks of a thread at the least.
const LEAST_BLOCKS: usize = 1 << 12;

/// A matrix of small square blocks on the diagonal, one per element; either one set for all bands or one per band.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockDiagonal {
    /// First row of each block, and the number of rows at the end.
    offsets: Vec<usize>,
    /// Where the numbers of each block start, and their count at the end.
    starts: Vec<usize>,
    /// For each band, all blocks row by row.
    bands: Vec<Vec<f64>>,
}

impl BlockDiagonal {
    /// Blocks whose rows start at `offsets` (its last entry is the number of rows), all zero; `bands` is 1 where all
    /// bands share the same blocks.
    ///
    /// # Panics
    /// If `offsets` is empty.
    pub fn zeros(offsets: &[usize], bands: usize) -> Self {
        assert!(!offsets.is_empty(), "offsets end with the number of rows");
        let mut starts = vec![0];
        for pair in offsets.windows(2) {
            let n = pair[1] - pair[0];
            starts.push(starts[starts.len() - 1] + n * n);
        }
        let numbers = starts[starts.len() - 1];
        Self { offsets: offsets.to_vec(), starts, bands: vec![vec![0.0; numbers]; bands] }
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.starts.len() - 1
    }

    /// One block, row by row.
    pub fn block(&self, band: usize, block: usize) -> &[f64] {
        let band = band.min(self.bands.len() - 1);
        &self.bands[band][self.starts[block]..self.starts[block + 1]]
    }

    /// One block, to write.
    pub fn block_mut(&mut self, band: usize, block: usize) -> &mut [f64] {
        &mut self.bands[band][self.starts[block]..self.starts[block + 1]]
    }

    /// The inverse; `None` if a block is not symmetric positive definite.
    pub fn inverse(&self) -> Option<Self> {
        let mut inverse = self.clone();
        for band in &mut inverse.bands {
            for (block, range) in self.starts.windows(2).enumerate() {
                let n = self.offsets[block + 1] - self.offsets[block];
                invert(&mut band[range[0]..range[1]], n)?;
            }
        }
        Some(inverse)
    }

    /// The rows of some blocks.
    fn apply_some(&self, band: usize, blocks: Range<usize>, x: &[f64], y: &mut [f64]) {
        let start = self.offsets[blocks.start];
        for block in blocks {
            let rows = self.offsets[block]..self.offsets[block + 1];
            let values = self.block(band, block).chunks_exact(rows.len());
            for (y, row) in y[rows.start - start..rows.end - start].iter_mut().zip(values) {
                *y = row.iter().zip(&x[rows.clone()]).map(|(a, x)| a * x).sum();
            }
        }
    }

    /// The entries as (row, column, value), for one band.
    pub fn triplets(&self, band: usize) -> impl Iterator<Item = (u32, u32, f64)> + '_ {
        (0..self.blocks()).flat_map(move |block| {
            let (first, n) = (self.offsets[block], self.offsets[block + 1] - self.offsets[block]);
            let values = self.block(band, block);
            (0..n * n).map(move |k| ((first + k / n) as u32, (first + k % n) as u32, values[k]))
        })
    }
}

impl LinearOperator for BlockDiagonal {
    fn rows(&self) -> usize {
        self.offsets[self.offsets.len() - 1]
    }
    fn cols(&self) -> usize {
        self.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        for band in 0..x.bands() {
            let (x, mut rest) = (x.band(band), y.band_mut(band));
            let mut parts = Vec::with_capacity(self.blocks().div_ceil(LEAST_BLOCKS));
            for first in (0..self.blocks()).step_by(LEAST_BLOCKS) {
                let blocks = first..(first + LEAST_BLOCKS).min(self.blocks());
                let (part, after) = rest.split_at_mut(self.offsets[blocks.end] - self.offsets[blocks.start]);
                parts.push((blocks, part));
                rest = after;
            }
            parts.into_par_iter().for_each(|(blocks, y)| self.apply_some(band, blocks, x, y));
        }
    }
}

/// Inverts a symmetric positive definite n × n matrix in place (Cholesky: A = L Lᵀ, A⁻¹ = L⁻ᵀ L⁻¹).
fn invert(a: &mut [f64], n: usize) -> Option<()> {
    for j in 0..n {
        let pivot = a[j * n + j] - (0..j).map(|k| a[j * n + k] * a[j * n + k]).sum::<f64>();
        if pivot <= 0.0 || !pivot.is_finite() {
            return None;
        }
        a[j * n + j] = pivot.sqrt();
        for i in j + 1..n {
            let s: f64 = (0..j).map(|k| a[i * n + k] * a[j * n + k]).sum();
            a[i * n + j] = (a[i * n + j] - s) / a[j * n + j];
        }
    }
    for j in 0..n {
        a[j * n + j] = 1.0 / a[j * n + j];
        for i in j + 1..n {
            let s: f64 = (j..i).map(|k| a[i * n + k] * a[k * n + j]).sum();
            a[i * n + j] = -s / a[i * n + i];
        }
    }
    for i in 0..n {
        for j in 0..=i {
            let s: f64 = (i..n).map(|k| a[k * n + i] * a[k * n + j]).sum();
            a[i * n + j] = s;
        }
        for j in 0..i {
            a[j * n + i] = a[i * n + j];
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_times_its_inverse_is_the_identity() {
        let mut blocks = BlockDiagonal::zeros(&[0, 1, 4], 1);
        blocks.block_mut(0, 0)[0] = 4.0;
        blocks.block_mut(0, 1).copy_from_slice(&[2.0, 1.0, 0.5, 1.0, 3.0, 1.0, 0.5, 1.0, 4.0]);
        let x = MultiVector::from_fn(4, 2, |row, band| (row + 3 * band) as f64 + 1.0);
        let back = blocks.inverse().expect("positive definite").times(&blocks.times(&x));
        for (a, b) in x.as_slice().iter().zip(back.as_slice()) {
            assert!((a - b).abs() < 1e-13, "{a} {b}");
        }
    }

    #[test]
    fn an_indefinite_block_has_no_inverse() {
        let mut blocks = BlockDiagonal::zeros(&[0, 2], 1);
        blocks.block_mut(0, 0).copy_from_slice(&[1.0, 2.0, 2.0, 1.0]);
        assert!(blocks.inverse().is_none());
    }
}

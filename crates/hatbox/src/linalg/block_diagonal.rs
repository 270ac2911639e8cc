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
    /// Rows of every block, where they are alike.
    size: Option<usize>,
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
        let sizes = || offsets.windows(2).map(|pair| pair[1] - pair[0]);
        let size = sizes().next().filter(|&first| sizes().all(|size| size == first));
        Self { offsets: offsets.to_vec(), starts, size, bands: vec![vec![0.0; numbers]; bands] }
    }

    /// The identity, with blocks whose rows start at `offsets`, the same for all bands.
    ///
    /// # Panics
    /// If `offsets` is empty.
    pub fn identity(offsets: &[usize]) -> Self {
        let mut identity = Self::zeros(offsets, 1);
        for (block, rows) in offsets.windows(2).enumerate() {
            let n = rows[1] - rows[0];
            identity.block_mut(0, block).iter_mut().step_by(n + 1).for_each(|entry| *entry = 1.0);
        }
        identity
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
        let numbers = &self.bands[band.min(self.bands.len() - 1)];
        let alike = self.size.filter(|size| [1, 3].contains(size)).unwrap_or(0);
        let x_here = &x[start..self.offsets[blocks.end]];
        let numbers_here = &numbers[self.starts[blocks.start]..self.starts[blocks.end]];
        match alike {
            1 => y.iter_mut().zip(numbers_here.iter().zip(x_here)).for_each(|(y, (a, x))| *y = a * x),
            3 => apply_alike::<3, 9>(numbers_here, x_here, y),
            _ => {
                for block in blocks {
                    let rows = self.offsets[block]..self.offsets[block + 1];
                    let values = numbers[self.starts[block]..self.starts[block + 1]].chunks_exact(rows.len());
                    for (y, row) in y[rows.start - start..rows.end - start].iter_mut().zip(values) {
                        *y = row.iter().zip(&x[rows.clone()]).map(|(a, x)| a * x).sum();
                    }
                }
            }
        }
    }

    /// The product with another of the same blocks; one set for all bands goes with each of several.
    ///
    /// # Panics
    /// If the blocks differ in size.
    #[must_use]
    pub fn product(&self, other: &Self) -> Self {
        assert_eq!(self.offsets, other.offsets, "blocks of the same sizes");
        let bands = self.bands.len().max(other.bands.len());
        let mut product = Self::zeros(&self.offsets, bands);
        for (band, numbers) in product.bands.iter_mut().enumerate() {
            let mut places = Vec::with_capacity(self.blocks());
            let mut rest = &mut numbers[..];
            for pair in self.starts.windows(2) {
                let (place, after) = rest.split_at_mut(pair[1] - pair[0]);
                places.push(place);
                rest = after;
            }
            places.into_par_iter().with_min_len(LEAST_BLOCKS).enumerate().for_each(|(block, place)| {
                let n = self.offsets[block + 1] - self.offsets[block];
                let (a, b) = (self.block(band, block), other.block(band, block));
                for (k, entry) in place.iter_mut().enumerate() {
                    let (row, column) = (k / n, k % n);
                    *entry = (0..n).map(|j| a[row * n + j] * b[j * n + column]).sum();
                }
            });
        }
        product
    }

    /// The sum with another of the same blocks and as many bands.
    ///
    /// # Panics
    /// If the blocks differ in size, or the bands in number.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        assert_eq!((&self.offsets, self.bands.len()), (&other.offsets, other.bands.len()), "blocks of the same sizes");
        let mut sum = self.clone();
        let numbers = sum.bands.iter_mut().flatten().zip(other.bands.iter().flatten());
        numbers.for_each(|(entry, other)| *entry += other);
        sum
    }

    /// The numbers of one row, and the column of the first.
    pub fn row(&self, band: usize, row: usize) -> (usize, &[f64]) {
        let block = self.offsets.partition_point(|&offset| offset <= row) - 1;
        let (first, n) = (self.offsets[block], self.offsets[block + 1] - self.offsets[block]);
        (first, &self.block(band, block)[(row - first) * n..(row - first + 1) * n])
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

/// y = A x for blocks of N rows and M = N² numbers.
fn apply_alike<const N: usize, const M: usize>(numbers: &[f64], x: &[f64], y: &mut [f64]) {
    let blocks = numbers.as_chunks::<M>().0.iter().zip(x.as_chunks::<N>().0);
    for (y, (a, x)) in y.as_chunks_mut::<N>().0.iter_mut().zip(blocks) {
        for (i, y) in y.iter_mut().enumerate() {
            *y = (0..N).map(|j| a[i * N + j] * x[j]).sum();
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
    fn a_product_applies_one_factor_after_the_other() {
        for sizes in [&[0, 3, 6][..], &[0, 1, 2], &[0, 2, 5]] {
            let numbered = |bands: usize, factor: f64| {
                let mut blocks = BlockDiagonal::zeros(sizes, bands);
                for (k, number) in blocks.bands.iter_mut().flatten().enumerate() {
                    *number = (factor * (k + 1) as f64).sin();
                }
                blocks
            };
            let (a, b) = (numbered(2, 1.3), numbered(1, 0.7));
            let x = MultiVector::from_fn(a.rows(), 2, |row, band| (row + 7 * band) as f64);
            let (once, twice) = (a.product(&b).times(&x), a.times(&b.times(&x)));
            for (once, twice) in once.as_slice().iter().zip(twice.as_slice()) {
                assert!((once - twice).abs() < 1e-12, "{once} {twice}");
            }
        }
    }

    #[test]
    fn an_indefinite_block_has_no_inverse() {
        let mut blocks = BlockDiagonal::zeros(&[0, 2], 1);
        blocks.block_mut(0, 0).copy_from_slice(&[1.0, 2.0, 2.0, 1.0]);
        assert!(blocks.inverse().is_none());
    }
}

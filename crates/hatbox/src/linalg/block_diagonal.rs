use super::{LinearOperator, MultiVector, Number};
use rayon::prelude::*;
use std::ops::Range;

/// Powers of a small matrix, of whose eigenvalues a few digits are wanted.
const POWERS: usize = 50;
/// Blocks of a piece of work.
const LEAST_BLOCKS: usize = 1 << 12;

/// A matrix of small square blocks on the diagonal, one per element; either one set for all bands or one per band.
///
/// A block is a matrix times a number, and blocks may share the matrix: the mass matrices of all triangles of a basis are one
/// matrix times their areas, and take 12 bytes each whatever the basis. Blocks of their own take their numbers besides.
#[derive(Debug, Clone)]
pub struct BlockDiagonal {
    /// First row of each block, and the number of rows at the end.
    offsets: Vec<u32>,
    /// Rows of every block, where they are alike.
    size: Option<usize>,
    /// Matrices that blocks share.
    shared: Vec<Vec<f64>>,
    bands: Vec<Blocks>,
}

/// What a block is made of.
#[derive(Debug, Clone, PartialEq)]
pub enum DiagonalBlock {
    /// One of the matrices that are given, times a number.
    Multiple(usize, f64),
    /// Numbers of its own, row by row.
    Own(Vec<f64>),
}

/// The blocks of one band.
#[derive(Debug, Clone)]
struct Blocks {
    /// For each block, the index of its matrix: of those that are shared first, then of those that blocks have for themselves.
    kinds: Vec<u32>,
    /// For each block, what that is multiplied by.
    factors: Vec<f64>,
    /// Where the numbers of each of these start and the last ones end, and the numbers.
    starts: Vec<usize>,
    own: Vec<f64>,
}

impl Blocks {
    fn none() -> Self {
        Self { kinds: Vec::new(), factors: Vec::new(), starts: vec![0], own: Vec::new() }
    }

    /// Adds a block, if so many matrices are shared.
    fn push(&mut self, shared: usize, block: DiagonalBlock) {
        let (kind, factor) = match block {
            DiagonalBlock::Multiple(kind, factor) => (kind, factor),
            DiagonalBlock::Own(numbers) => {
                self.own.extend(numbers);
                self.starts.push(self.own.len());
                (shared + self.starts.len() - 2, 1.0)
            }
        };
        self.kinds.push(kind as u32);
        self.factors.push(factor);
    }
}

impl BlockDiagonal {
    /// Blocks whose rows start at `offsets` (its last entry is the number of rows), as `block(band, k)` says, which may name
    /// some of the `matrices`; `bands` is 1 where all bands share the same blocks.
    ///
    /// # Panics
    /// If `offsets` is empty, or a block has not as many numbers as its rows ask for.
    pub fn new(
        offsets: &[usize],
        bands: usize,
        matrices: Vec<Vec<f64>>,
        block: impl Fn(usize, usize) -> DiagonalBlock + Sync,
    ) -> Self {
        assert!(!offsets.is_empty(), "offsets end with the number of rows");
        let (count, sizes) = (offsets.len() - 1, || offsets.windows(2).map(|pair| pair[1] - pair[0]));
        let band = |band: usize| {
            let mut blocks = Blocks::none();
            // As many at a time as keep all threads at work: blocks wait as they are, and may be large.
            let at_once = LEAST_BLOCKS * rayon::current_num_threads();
            for first in (0..count).step_by(at_once) {
                let some = first..(first + at_once).min(count);
                let made: Vec<DiagonalBlock> = some.into_par_iter().map(|k| block(band, k)).collect();
                for block in made {
                    blocks.push(matrices.len(), block);
                }
            }
            blocks
        };
        let bands: Vec<Blocks> = (0..bands).map(band).collect();
        let size = sizes().next().filter(|&first| sizes().all(|size| size == first));
        let offsets = offsets.iter().map(|&offset| offset as u32).collect();
        let made = Self { offsets, size, shared: matrices, bands };
        let square = |band| sizes().enumerate().all(|(k, n)| made.of(band, k).0.len() == n * n);
        assert!((0..made.bands.len()).all(square), "square blocks");
        made
    }

    /// The identity, with blocks whose rows start at `offsets`, the same for all bands.
    ///
    /// # Panics
    /// If `offsets` is empty.
    pub fn identity(offsets: &[usize]) -> Self {
        let identity = |n: usize| (0..n * n).map(|k| f64::from(u8::from(k % (n + 1) == 0))).collect();
        let size = |block: usize| offsets[block + 1] - offsets[block];
        let most = (0..offsets.len().saturating_sub(1)).map(size).max().unwrap_or(0);
        let matrices = (0..=most).map(identity).collect();
        Self::new(offsets, 1, matrices, |_, block| DiagonalBlock::Multiple(size(block), 1.0))
    }

    /// The least and the greatest eigenvalue of D⁻¹ A of any block A with the diagonal D. They bound those of matrices that
    /// positive definite blocks are added up to, so that unknowns meet (A. Wathen, "Realistic eigenvalue bounds for the
    /// Galerkin mass matrix", IMA J. Numer. Anal. 7, 1987).
    pub(crate) fn scaled_spectrum(&self) -> [f64; 2] {
        let own = |band: &Blocks| -> Vec<[f64; 2]> {
            band.starts.par_windows(2).map(|ends| scaled_spectrum(&band.own[ends[0]..ends[1]])).collect()
        };
        let used = |kind: &usize| self.bands.iter().any(|band| band.kinds.contains(&(*kind as u32)));
        let shared = (0..self.shared.len()).filter(used).map(|kind| scaled_spectrum(&self.shared[kind]));
        let all = shared.chain(self.bands.iter().flat_map(own));
        all.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]).unwrap_or([1.0; 2])
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.offsets.len() - 1
    }

    /// One block, row by row.
    pub fn block(&self, band: usize, block: usize) -> Vec<f64> {
        let (matrix, factor) = self.of(band, block);
        matrix.iter().map(|number| factor * number).collect()
    }

    /// The inverse; `None` if a block is not symmetric positive definite.
    pub fn inverse(&self) -> Option<Self> {
        let inverted = |matrix: &Vec<f64>| {
            let mut inverse = matrix.clone();
            invert(&mut inverse).map(|()| inverse)
        };
        // One that no block uses may have none.
        let shared: Vec<Option<Vec<f64>>> = self.shared.iter().map(inverted).collect();
        let mut bands = self.bands.clone();
        for band in &mut bands {
            let used = |kind: &u32| shared.get(*kind as usize).is_none_or(Option::is_some);
            let definite = |factor: &f64| *factor > 0.0 && factor.is_finite();
            if !(band.kinds.iter().all(used) && band.factors.iter().all(definite)) {
                return None;
            }
            band.factors.iter_mut().for_each(|factor| *factor = 1.0 / *factor);
            let mut rest = &mut band.own[..];
            let mut places = Vec::with_capacity(band.starts.len());
            for ends in band.starts.windows(2) {
                let (place, after) = rest.split_at_mut(ends[1] - ends[0]);
                places.push(place);
                rest = after;
            }
            places.into_par_iter().try_for_each(invert)?;
        }
        let shared = shared.into_iter().map(Option::unwrap_or_default).collect();
        Some(Self { offsets: self.offsets.clone(), size: self.size, shared, bands })
    }

    /// The product with another of the same blocks; one set for all bands goes with each of several.
    ///
    /// # Panics
    /// If the blocks differ in size.
    #[must_use]
    pub fn product(&self, other: &Self) -> Self {
        assert_eq!(self.offsets, other.offsets, "blocks of the same sizes");
        let pairs = self.shared.iter().flat_map(|a| other.shared.iter().map(move |b| (a, b)));
        let of_pair = |(a, b): (&Vec<f64>, &Vec<f64>)| if a.len() == b.len() { multiplied(a, b) } else { Vec::new() };
        let bands = self.bands.len().max(other.bands.len());
        Self::new(&self.starts_of_rows(), bands, pairs.map(of_pair).collect(), |band, block| {
            let ((a, x), (b, y)) = (self.of(band, block), other.of(band, block));
            match (self.shared_by(band, block), other.shared_by(band, block)) {
                (Some(i), Some(j)) => DiagonalBlock::Multiple(i * other.shared.len() + j, x * y),
                _ => DiagonalBlock::Own(multiplied(a, b).into_iter().map(|entry| x * y * entry).collect()),
            }
        })
    }

    /// The sum with another of the same blocks and as many bands; each block has numbers of its own then.
    ///
    /// # Panics
    /// If the blocks differ in size, or the bands in number.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        assert_eq!((&self.offsets, self.bands.len()), (&other.offsets, other.bands.len()), "blocks of the same sizes");
        Self::new(&self.starts_of_rows(), self.bands.len(), Vec::new(), |band, block| {
            let (a, b) = (self.block(band, block), other.block(band, block));
            DiagonalBlock::Own(a.iter().zip(b).map(|(a, b)| a + b).collect())
        })
    }

    /// The numbers of one row, and the column of the first.
    pub fn row(&self, band: usize, row: usize) -> (usize, impl Iterator<Item = f64> + '_) {
        let block = self.block_of(row);
        let rows = self.rows_of(block);
        let (matrix, factor) = self.of(band, block);
        let place = (row - rows.start) * rows.len();
        (rows.start, matrix[place..place + rows.len()].iter().map(move |number| factor * number))
    }

    /// The product of one row with a column.
    pub(crate) fn row_times<T: Number>(&self, band: usize, row: usize, x: &[T]) -> f64 {
        let (first, numbers) = self.row(band, row);
        numbers.zip(&x[first..]).map(|(number, &x)| number * x.into()).sum()
    }

    /// The products of rows from this one on with a column.
    pub(crate) fn rows_times<T: Number>(&self, band: usize, first: usize, x: &[T], y: &mut [f64]) {
        let rows = first..first + y.len();
        let blocks = self.block_of(rows.start)..self.block_of(rows.end);
        if (self.offsets[blocks.start] as usize, self.offsets[blocks.end] as usize) == (rows.start, rows.end) {
            self.apply_some(band, blocks, &x[rows], y);
        } else {
            rows.zip(y).for_each(|(row, y)| *y = self.row_times(band, row, x));
        }
    }

    /// The entries as (row, column, value), for one band.
    pub fn triplets(&self, band: usize) -> impl Iterator<Item = (u32, u32, f64)> + '_ {
        (0..self.blocks()).flat_map(move |block| {
            let (rows, (matrix, factor)) = (self.rows_of(block), self.of(band, block));
            let at = move |k: usize| (rows.start + k / rows.len(), rows.start + k % rows.len());
            let entry = move |(k, number): (usize, &f64)| (at(k).0 as u32, at(k).1 as u32, factor * number);
            matrix.iter().enumerate().map(entry)
        })
    }

    /// The block of a row; their number for the row after the last.
    fn block_of(&self, row: usize) -> usize {
        match self.size {
            Some(size) => row / size,
            None => self.offsets.partition_point(|&offset| offset as usize <= row) - 1,
        }
    }

    /// The matrix of a block, row by row, and its factor.
    fn of(&self, band: usize, block: usize) -> (&[f64], f64) {
        let blocks = &self.bands[band.min(self.bands.len() - 1)];
        let (kind, factor) = (blocks.kinds[block] as usize, blocks.factors[block]);
        let own = |k: usize| &blocks.own[blocks.starts[k]..blocks.starts[k + 1]];
        (self.shared.get(kind).map_or_else(|| own(kind - self.shared.len()), Vec::as_slice), factor)
    }

    /// The index of the matrix of a block, if others share it.
    fn shared_by(&self, band: usize, block: usize) -> Option<usize> {
        let kind = self.bands[band.min(self.bands.len() - 1)].kinds[block] as usize;
        (kind < self.shared.len()).then_some(kind)
    }

    fn starts_of_rows(&self) -> Vec<usize> {
        self.offsets.iter().map(|&offset| offset as usize).collect()
    }

    fn rows_of(&self, block: usize) -> Range<usize> {
        self.offsets[block] as usize..self.offsets[block + 1] as usize
    }

    /// The rows of some blocks, from the part of x that they act on.
    fn apply_some<T: Number>(&self, band: usize, blocks: Range<usize>, x: &[T], y: &mut [f64]) {
        let of_band = &self.bands[band.min(self.bands.len() - 1)];
        match &self.shared[..] {
            // Nothing to look for.
            [matrix] if of_band.own.is_empty() => {
                self.apply_these(of_band.factors[blocks].iter().map(|&factor| (&matrix[..], factor)), x, y);
            }
            _ => self.apply_these(blocks.map(|block| self.of(band, block)), x, y),
        }
    }

    fn apply_these<'a, T: Number>(&self, blocks: impl Iterator<Item = (&'a [f64], f64)>, x: &[T], y: &mut [f64]) {
        match self.size {
            Some(1) => apply_alike::<1, T>(blocks, x, y),
            Some(3) => apply_alike::<3, T>(blocks, x, y),
            _ => {
                let mut place = 0;
                for (matrix, factor) in blocks {
                    let n = matrix.len().isqrt();
                    let here = place..place + n;
                    for (y, row) in y[here.clone()].iter_mut().zip(matrix.chunks_exact(n)) {
                        *y = factor * row.iter().zip(&x[here.clone()]).map(|(a, &x)| a * x.into()).sum::<f64>();
                    }
                    place += n;
                }
            }
        }
    }

    /// Calls `act` for pieces of y, band by band: the band, the blocks, their rows, those of y.
    fn in_pieces(&self, y: &mut MultiVector, act: impl Fn(usize, Range<usize>, Range<usize>, &mut [f64]) + Sync) {
        let blocks = |part: usize| part * LEAST_BLOCKS..((part + 1) * LEAST_BLOCKS).min(self.blocks());
        let row = |block: usize| self.offsets[block] as usize;
        let ends = (0..self.blocks().div_ceil(LEAST_BLOCKS)).map(|part| row(blocks(part).end));
        y.parts_until(ends).into_par_iter().enumerate().for_each(|(part, y)| {
            let blocks = blocks(part);
            for (band, y) in y.into_iter().enumerate() {
                act(band, blocks.clone(), row(blocks.start)..row(blocks.end), y);
            }
        });
    }
}

impl LinearOperator for BlockDiagonal {
    fn rows(&self) -> usize {
        self.offsets[self.offsets.len() - 1] as usize
    }
    fn cols(&self) -> usize {
        self.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        self.in_pieces(y, |band, blocks, rows, y| self.apply_some(band, blocks, &x.band(band)[rows], y));
    }
    fn times_owned(&self, mut x: MultiVector) -> MultiVector {
        self.in_pieces(&mut x, |band, blocks, _, x| {
            let before = x.to_vec();
            self.apply_some(band, blocks, &before, x);
        });
        x
    }
}

/// y = A x for blocks of N rows.
fn apply_alike<'a, const N: usize, T: Number>(blocks: impl Iterator<Item = (&'a [f64], f64)>, x: &[T], y: &mut [f64]) {
    let places = y.as_chunks_mut::<N>().0.iter_mut().zip(x.as_chunks::<N>().0);
    for ((matrix, factor), (y, x)) in blocks.zip(places) {
        for (y, row) in y.iter_mut().zip(matrix.as_chunks::<N>().0) {
            *y = factor * row.iter().zip(x).map(|(a, &x)| a * x.into()).sum::<f64>();
        }
    }
}

/// The least and the greatest eigenvalue of D^-½ A D^-½, to a few digits, by powers of it and of what is left of the greatest.
fn scaled_spectrum(a: &[f64]) -> [f64; 2] {
    let n = a.len().isqrt();
    let scaled: Vec<f64> = (0..n * n).map(|k| a[k] / (a[k / n * (n + 1)] * a[k % n * (n + 1)]).sqrt()).collect();
    let most = greatest_eigenvalue(&scaled);
    let rest: Vec<f64> = scaled.iter().enumerate().map(|(k, s)| if k % (n + 1) == 0 { most - s } else { -s }).collect();
    [most - greatest_eigenvalue(&rest), most]
}

/// The greatest eigenvalue of a positive semidefinite matrix.
fn greatest_eigenvalue(a: &[f64]) -> f64 {
    let n = a.len().isqrt();
    // Orthogonal to no eigenvector of a cell's symmetries.
    let mut x: Vec<f64> = (1..=n).map(|k| (k as f64).sqrt()).collect();
    let (mut image, mut value) = (vec![0.0; n], 0.0);
    for _ in 0..POWERS {
        let length = x.iter().map(|x| x * x).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        for (image, row) in image.iter_mut().zip(a.chunks_exact(n)) {
            *image = row.iter().zip(&x).map(|(a, x)| a * x / length).sum();
        }
        value = x.iter().zip(&image).map(|(x, y)| x * y / length).sum();
        std::mem::swap(&mut x, &mut image);
    }
    value
}

/// A B, row by row.
fn multiplied(a: &[f64], b: &[f64]) -> Vec<f64> {
    let n = a.len().isqrt();
    let entry = |k: usize| (0..n).map(|j| a[k / n * n + j] * b[j * n + k % n]).sum();
    (0..n * n).map(entry).collect()
}

/// Inverts a symmetric positive definite matrix in place (Cholesky: A = L Lᵀ, A⁻¹ = L⁻ᵀ L⁻¹).
fn invert(a: &mut [f64]) -> Option<()> {
    let n = a.len().isqrt();
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

    /// Blocks of different numbers, of which every second is a multiple of one matrix where they are alike.
    fn numbered(offsets: &[usize], bands: usize, seed: f64) -> BlockDiagonal {
        let size = |block: usize| offsets[block + 1] - offsets[block];
        let numbers = |n: usize, of: f64| -> Vec<f64> {
            (0..n * n).map(|k| (seed * (of + k as f64)).sin() + if k % (n + 1) == 0 { 4.0 } else { 0.0 }).collect()
        };
        let symmetric = |n: usize, of: f64| -> Vec<f64> {
            let a = numbers(n, of);
            (0..n * n).map(|k| a[k] + a[k % n * n + k / n]).collect()
        };
        let matrices: Vec<Vec<f64>> = (0..4).map(|n| symmetric(n, 0.5)).collect();
        BlockDiagonal::new(offsets, bands, matrices, |band, block| {
            if block % 2 == 0 {
                DiagonalBlock::Multiple(size(block), 0.3 + band as f64)
            } else {
                DiagonalBlock::Own(symmetric(size(block), (10 * block + band) as f64))
            }
        })
    }

    /// Alike with loops of known length, alike without, and not alike.
    const SIZES: [&[usize]; 4] = [&[0, 3, 6, 9], &[0, 1, 2, 3], &[0, 2, 4, 6], &[0, 2, 5, 6]];

    fn some(rows: usize) -> MultiVector {
        MultiVector::from_fn(rows, 2, |row, band| (row + 7 * band) as f64 + 1.0)
    }

    fn assert_equal(a: &MultiVector, b: &MultiVector) {
        for (a, b) in a.as_slice().iter().zip(b.as_slice()) {
            assert!((a - b).abs() < 1e-11, "{a} {b}");
        }
    }

    #[test]
    fn a_matrix_times_its_inverse_is_the_identity() {
        for sizes in SIZES {
            let (a, x) = (numbered(sizes, 1, 1.3), some(sizes[3]));
            assert_equal(&x, &a.inverse().expect("positive definite").times(&a.times(&x)));
            assert_equal(&x, &BlockDiagonal::identity(sizes).times(&x));
        }
    }

    #[test]
    fn products_in_place_and_row_by_row_are_those_of_the_bands() {
        for sizes in SIZES {
            let (a, x) = (numbered(sizes, 3, 1.3), some(sizes[3]));
            let of = |band: usize, x: &[f64]| {
                let one = BlockDiagonal::new(sizes, 1, Vec::new(), |_, block| DiagonalBlock::Own(a.block(band, block)));
                one.times(&MultiVector::from_bands(1, x.to_vec()).expect("one band")).into_vec()
            };
            let expected =
                MultiVector::from_bands(2, [of(0, x.band(0)), of(1, x.band(1))].concat()).expect("two bands");
            // From the first row, and from one in the middle of a block where there is one.
            for (band, first) in [(0, 0), (1, 1)] {
                let mut rows = vec![0.0; x.rows() - first];
                a.rows_times(band, first, x.band(band), &mut rows);
                for (found, expected) in rows.iter().zip(&expected.band(band)[first..]) {
                    assert!((found - expected).abs() < 1e-11, "{found} {expected}");
                }
            }
            assert_equal(&a.times_owned(x), &expected);
        }
    }

    #[test]
    fn multiples_of_one_matrix_are_applied_like_blocks_of_their_own() {
        for size in 1..=4 {
            let (offsets, factors) = ([0, size, 2 * size, 3 * size], [1.0, 0.5, -2.0]);
            let matrix: Vec<f64> = (1..=size * size).map(|k| k as f64).collect();
            let own = |_, k: usize| DiagonalBlock::Own(matrix.iter().map(|m| factors[k] * m).collect());
            let own = BlockDiagonal::new(&offsets, 1, Vec::new(), own);
            let multiple = |_, k: usize| DiagonalBlock::Multiple(0, factors[k]);
            let multiples = BlockDiagonal::new(&offsets, 1, vec![matrix.clone()], multiple);
            let x = some(3 * size);
            assert_equal(&multiples.times(&x), &own.times(&x));
            let mut middle = vec![0.0; size];
            multiples.rows_times(0, size, x.band(0), &mut middle);
            assert_eq!(middle, own.times(&x).band(0)[size..2 * size]);
        }
    }

    #[test]
    fn a_product_applies_one_factor_after_the_other_and_a_sum_both() {
        for sizes in SIZES {
            let (a, b, c) = (numbered(sizes, 2, 1.3), numbered(sizes, 1, 0.7), numbered(sizes, 2, 0.4));
            let x = some(sizes[3]);
            assert_equal(&a.product(&b).times(&x), &a.times(&b.times(&x)));
            let mut both = a.times(&x);
            both.add_scaled(1.0, &c.times(&x));
            assert_equal(&a.plus(&c).times(&x), &both);
        }
    }

    #[test]
    fn rows_blocks_and_triplets_have_the_numbers_that_are_applied() {
        for sizes in SIZES {
            let (a, x) = (numbered(sizes, 2, 1.3), some(sizes[3]));
            for band in 0..2 {
                let of = |(first, numbers): (usize, Vec<f64>)| -> f64 {
                    numbers.iter().enumerate().map(|(k, a)| a * x.band(band)[first + k]).sum()
                };
                let by_rows = (0..sizes[3]).map(|row| a.row(band, row)).map(|(first, row)| of((first, row.collect())));
                let by_blocks = (0..a.blocks()).flat_map(|block| {
                    let (rows, numbers) = (sizes[block]..sizes[block + 1], a.block(band, block));
                    numbers.chunks_exact(rows.len()).map(|row| of((rows.start, row.to_vec()))).collect::<Vec<_>>()
                });
                let mut by_triplets = vec![0.0; sizes[3]];
                a.triplets(band).for_each(|(i, j, a)| by_triplets[i as usize] += a * x.band(band)[j as usize]);
                let applied = a.times(&x);
                for found in [by_rows.collect(), by_blocks.collect(), by_triplets] {
                    let [found, applied] = [found, applied.band(band).to_vec()]
                        .map(|numbers| MultiVector::from_bands(1, numbers).expect("one band"));
                    assert_equal(&found, &applied);
                }
            }
        }
    }

    /// The bounds of Wathen's table: linear and quadratic triangles, bilinear squares.
    #[test]
    fn scaled_mass_matrices_have_known_spectra() {
        let linear = vec![2.0, 1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 1.0, 2.0];
        let bilinear = vec![4.0, 2.0, 1.0, 2.0, 2.0, 4.0, 2.0, 1.0, 1.0, 2.0, 4.0, 2.0, 2.0, 1.0, 2.0, 4.0];
        let quadratic = vec![
            6.0, -1.0, -1.0, 0.0, -4.0, 0.0, -1.0, 6.0, -1.0, 0.0, 0.0, -4.0, -1.0, -1.0, 6.0, -4.0, 0.0, 0.0, 0.0,
            0.0, -4.0, 32.0, 16.0, 16.0, -4.0, 0.0, 0.0, 16.0, 32.0, 16.0, 0.0, -4.0, 0.0, 16.0, 16.0, 32.0,
        ];
        // Corners row by row instead of around.
        let rows = vec![4.0, 2.0, 2.0, 1.0, 2.0, 4.0, 1.0, 2.0, 2.0, 1.0, 4.0, 2.0, 1.0, 2.0, 2.0, 4.0];
        let known = [(linear, 0.5, 2.0), (bilinear, 0.25, 2.25), (rows, 0.25, 2.25), (quadratic, 0.3924, 2.0598)];
        for (matrix, least, greatest) in known {
            let size = matrix.len().isqrt();
            for own in [false, true] {
                let block = |_, _| {
                    if own { DiagonalBlock::Own(matrix.clone()) } else { DiagonalBlock::Multiple(0, 3.0) }
                };
                let shared = if own { Vec::new() } else { vec![matrix.clone()] };
                let [a, b] = BlockDiagonal::new(&[0, size], 1, shared, block).scaled_spectrum();
                assert!((a - least).abs() < 1e-4 && (b - greatest).abs() < 1e-4, "{size}: {a} {b}");
            }
        }
    }

    #[test]
    fn many_blocks_are_applied_in_pieces_as_few_are() {
        let blocks = LEAST_BLOCKS + 3;
        let offsets: Vec<usize> = (0..=blocks).map(|block| block + block / 2).collect();
        let a = BlockDiagonal::new(&offsets, 1, Vec::new(), |_, block| {
            let n = offsets[block + 1] - offsets[block];
            DiagonalBlock::Own((0..n * n).map(|k| (block * n * n + k) as f64).collect())
        });
        let x = MultiVector::from_fn(offsets[blocks], 3, |row, band| (row % 17 + band) as f64);
        let applied = a.times(&x);
        for band in 0..3 {
            let mut found = vec![0.0; offsets[blocks]];
            a.triplets(0).for_each(|(i, j, a)| found[i as usize] += a * x.band(band)[j as usize]);
            assert_eq!(found, applied.band(band));
        }
    }

    #[test]
    fn what_is_not_positive_definite_has_no_inverse() {
        let own =
            |numbers: [f64; 4]| BlockDiagonal::new(&[0, 2], 1, Vec::new(), |_, _| DiagonalBlock::Own(numbers.to_vec()));
        assert!(own([1.0, 2.0, 2.0, 1.0]).inverse().is_none());
        for factor in [0.0, -1.0, f64::NAN] {
            let zero = BlockDiagonal::new(&[0, 1], 1, vec![vec![1.0]], |_, _| DiagonalBlock::Multiple(0, factor));
            assert!(zero.inverse().is_none(), "{factor}");
        }
    }
}

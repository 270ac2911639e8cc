use super::Number;
use rayon::prelude::*;

/// Numbers of a thread at the least, and those of a partial sum.
const LEAST_NUMBERS: usize = 1 << 15;

/// `rows` × `bands` numbers, each band contiguous: the coefficients of one function per band.
#[derive(Debug, PartialEq)]
pub struct MultiVector {
    rows: usize,
    bands: usize,
    data: Vec<f64>,
}

impl Clone for MultiVector {
    /// By all threads: of a million rows most of it is waiting for pages.
    fn clone(&self) -> Self {
        let mut copy = Self::zeros(self.rows, self.bands);
        each(&mut copy.data, &self.data, |y, x| *y = x);
        copy
    }

    fn clone_from(&mut self, other: &Self) {
        if self.data.len() == other.data.len() {
            (self.rows, self.bands) = (other.rows, other.bands);
            each(&mut self.data, &other.data, |y, x| *y = x);
        } else {
            *self = other.clone();
        }
    }
}

impl MultiVector {
    /// All zeros.
    pub fn zeros(rows: usize, bands: usize) -> Self {
        Self { rows, bands, data: vec![0.0; rows * bands] }
    }

    /// Every row of band `b` holds `values[b]`.
    pub fn uniform(rows: usize, values: &[f64]) -> Self {
        Self::from_fn(rows, values.len(), |_, band| values[band])
    }

    /// Entry (row, band) holds `value(row, band)`.
    pub fn from_fn(rows: usize, bands: usize, value: impl Fn(usize, usize) -> f64) -> Self {
        let mut data = Vec::with_capacity(rows * bands);
        for band in 0..bands {
            data.extend((0..rows).map(|row| value(row, band)));
        }
        Self { rows, bands, data }
    }

    /// Takes band after band, each of `data.len() / bands` rows; `None` if that does not divide.
    pub fn from_bands(bands: usize, data: Vec<f64>) -> Option<Self> {
        (bands > 0 && data.len().is_multiple_of(bands)).then(|| Self { rows: data.len() / bands, bands, data })
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.bands
    }

    /// One band.
    pub fn band(&self, band: usize) -> &[f64] {
        &self.data[band * self.rows..(band + 1) * self.rows]
    }

    /// One band, to write.
    pub fn band_mut(&mut self, band: usize) -> &mut [f64] {
        &mut self.data[band * self.rows..(band + 1) * self.rows]
    }

    /// A copy of one band.
    #[must_use]
    pub fn one_band(&self, band: usize) -> Self {
        Self { rows: self.rows, bands: 1, data: self.band(band).to_vec() }
    }

    /// Some bands, of each number what `of` makes of its band and itself.
    #[must_use]
    pub(crate) fn some(&self, bands: &[usize], of: impl Fn(usize, f64) -> f64 + Sync) -> Self {
        let mut some = Self::zeros(self.rows, bands.len());
        let columns = some.data.par_chunks_mut(self.rows.max(1)).zip(bands);
        columns.for_each(|(column, &band)| each(column, self.band(band), |y, x| *y = of(band, x)));
        some
    }

    /// The bands, one after the other.
    pub fn iter_bands(&self) -> impl Iterator<Item = &[f64]> {
        (0..self.bands).map(|band| self.band(band))
    }

    /// All numbers, band after band.
    pub fn as_slice(&self) -> &[f64] {
        &self.data
    }

    /// All numbers, band after band, handed over.
    pub fn into_vec(self) -> Vec<f64> {
        self.data
    }

    /// All numbers, band after band, to write.
    pub fn as_mut_slice(&mut self) -> &mut [f64] {
        &mut self.data
    }

    /// So many rows of all bands at a time: what works on rows reads what it needs of them once for all bands.
    pub(super) fn parts_mut(&mut self, rows: usize) -> Vec<Vec<&mut [f64]>> {
        let all = self.rows;
        self.parts_until((1..=all.div_ceil(rows)).map(|part| (part * rows).min(all)))
    }

    /// The parts of all bands that end at these rows.
    pub(super) fn parts_until(&mut self, ends: impl IntoIterator<Item = usize>) -> Vec<Vec<&mut [f64]>> {
        let mut rest: Vec<&mut [f64]> = self.data.chunks_exact_mut(self.rows.max(1)).collect();
        let (mut parts, mut start) = (Vec::new(), 0);
        for end in ends {
            let part = rest.iter_mut().map(|band| band.split_off_mut(..end - start).unwrap_or_default());
            parts.push(part.collect());
            start = end;
        }
        parts
    }

    /// `self += factor · other`.
    pub fn add_scaled(&mut self, factor: f64, other: &Self) {
        debug_assert_eq!((self.rows, self.bands), (other.rows, other.bands));
        each(&mut self.data, &other.data, |a, b| *a += factor * b);
    }

    /// `self *= factor`.
    pub fn scale(&mut self, factor: f64) {
        self.data.par_chunks_mut(LEAST_NUMBERS).for_each(|part| part.iter_mut().for_each(|x| *x *= factor));
    }

    /// `Σ_i self_i other_i` for each band.
    pub fn dot(&self, other: &Self) -> Vec<f64> {
        (0..self.bands).into_par_iter().map(|band| dot(self.band(band), other.band(band))).collect()
    }

    /// The Euclidean norm of each band.
    pub fn norms(&self) -> Vec<f64> {
        self.dot(self).into_iter().map(f64::sqrt).collect()
    }
}

/// Changes every number of `a` by the one of `b` in its place.
pub(crate) fn each(a: &mut [f64], b: &[f64], change: impl Fn(&mut f64, f64) + Sync) {
    let some = |(a, b): (&mut [f64], &[f64])| a.iter_mut().zip(b).for_each(|(a, &b)| change(a, b));
    if a.len() <= LEAST_NUMBERS {
        some((a, b));
    } else {
        a.par_chunks_mut(LEAST_NUMBERS).zip(b.par_chunks(LEAST_NUMBERS)).for_each(some);
    }
}

/// `Σ a_i b_i` in a fixed order, so that the same input gives the same bits on any number of threads.
pub(crate) fn dot<A: Number, B: Number>(a: &[A], b: &[B]) -> f64 {
    let parts = a.par_chunks(LEAST_NUMBERS).zip(b.par_chunks(LEAST_NUMBERS));
    if a.len() <= LEAST_NUMBERS {
        dot_part(a, b)
    } else {
        parts.map(|(a, b)| dot_part(a, b)).collect::<Vec<f64>>().iter().sum()
    }
}

/// The same of a part, in eight interleaved sums.
fn dot_part<A: Number, B: Number>(a: &[A], b: &[B]) -> f64 {
    let mut lanes = [0.0; 8];
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    for (x, y) in a8.iter().zip(b8) {
        for lane in 0..8 {
            lanes[lane] += x[lane].into() * y[lane].into();
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(&x, &y)| x.into() * y.into()).sum();
    lanes.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_product_has_all_its_pieces() {
        let length = 3 * LEAST_NUMBERS + 5;
        let [a, b] = [7, 11].map(|modulus| (0..length).map(|k| (k % modulus) as f64).collect::<Vec<f64>>());
        let sum: usize = (0..length).map(|k| (k % 7) * (k % 11)).sum();
        assert_eq!(dot(&a, &b), sum as f64);
    }
}

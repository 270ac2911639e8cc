use super::{LinearOperator, MultiVector, Number};
use rayon::prelude::*;
use std::ops::Range;

/// Rows of a piece of work.
const ROWS: usize = 1 << 13;

/// A sparse matrix in compressed rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Csr {
    cols: usize,
    offsets: Vec<usize>,
    indices: Vec<u32>,
    values: Vec<f64>,
    /// Whether each row is one entry, which is 1: what joins functions where no nodes hang.
    picks: bool,
}

impl Csr {
    /// Builds the matrix from (row, column, value) triplets in any order; entries that meet are added.
    ///
    /// # Panics
    /// If a triplet lies outside `rows` × `cols`.
    pub fn from_triplets(rows: usize, cols: usize, mut triplets: Vec<(u32, u32, f64)>) -> Self {
        assert!(triplets.iter().all(|t| (t.0 as usize) < rows && (t.1 as usize) < cols), "triplet outside the matrix");
        // A stable sort keeps the order of entries that meet, so that their sum is reproducible.
        triplets.sort_by_key(|t| (t.0, t.1));
        let (mut offsets, mut indices, mut values) = (vec![0; rows + 1], Vec::new(), Vec::new());
        let mut last = None;
        for (row, col, value) in triplets {
            if last == Some((row, col)) {
                *values.last_mut().expect("an entry was just pushed") += value;
            } else {
                indices.push(col);
                values.push(value);
                offsets[row as usize + 1] += 1;
                last = Some((row, col));
            }
        }
        for row in 0..rows {
            offsets[row + 1] += offsets[row];
        }
        Self::new(cols, offsets, indices, values)
    }

    fn new(cols: usize, offsets: Vec<usize>, indices: Vec<u32>, values: Vec<f64>) -> Self {
        let picks = offsets.iter().enumerate().all(|(row, &start)| start == row)
            && values.iter().all(|v| v.to_bits() == 1.0_f64.to_bits());
        Self { cols, offsets, indices, values, picks }
    }

    /// Builds the matrix from the entries (column, value) of each row, columns ascending.
    ///
    /// # Panics
    /// If columns do not ascend or lie outside the matrix.
    pub fn from_rows(cols: usize, rows: impl IntoIterator<Item = Vec<(u32, f64)>>) -> Self {
        let (mut offsets, mut indices, mut values) = (vec![0], Vec::new(), Vec::new());
        for row in rows {
            assert!(row.is_sorted_by(|a, b| a.0 < b.0), "columns must ascend");
            assert!(row.last().is_none_or(|last| (last.0 as usize) < cols), "entry outside the matrix");
            indices.extend(row.iter().map(|entry| entry.0));
            values.extend(row.iter().map(|entry| entry.1));
            offsets.push(values.len());
        }
        Self::new(cols, offsets, indices, values)
    }

    /// One entry; 0 where none is stored.
    pub fn get(&self, row: usize, col: usize) -> f64 {
        let range = self.range(row);
        let place = self.indices[range.clone()].binary_search(&(col as u32));
        place.map_or(0.0, |place| self.values[range.start + place])
    }

    /// The entries (column, value) of one row, columns ascending.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.range(row);
        self.indices[range.clone()].iter().zip(&self.values[range]).map(|(&col, &value)| (col as usize, value))
    }

    /// The product of one row with a column.
    pub(crate) fn row_times<T: Number>(&self, row: usize, x: &[T]) -> f64 {
        if self.picks {
            x[self.indices[row] as usize].into()
        } else {
            self.row(row).map(|(col, value)| value * x[col].into()).sum()
        }
    }

    /// Adds so many times one row to y.
    pub(crate) fn add_row(&self, row: usize, times: f64, y: &mut [f64]) {
        if self.picks {
            y[self.indices[row] as usize] += times;
        } else {
            self.row(row).for_each(|(col, value)| y[col] += value * times);
        }
    }

    /// Number of stored entries.
    pub fn stored(&self) -> usize {
        self.values.len()
    }

    fn range(&self, row: usize) -> Range<usize> {
        self.offsets[row]..self.offsets[row + 1]
    }

    /// The transpose.
    #[must_use]
    pub fn transpose(&self) -> Self {
        let mut offsets = vec![0; self.cols + 1];
        for &col in &self.indices {
            offsets[col as usize + 1] += 1;
        }
        for col in 0..self.cols {
            offsets[col + 1] += offsets[col];
        }
        let (mut indices, mut values) = (vec![0; self.stored()], vec![0.0; self.stored()]);
        let mut next = offsets.clone();
        for row in 0..self.rows() {
            for (col, value) in self.row(row) {
                let place = next[col];
                (indices[place], values[place]) = (row as u32, value);
                next[col] += 1;
            }
        }
        Self::new(self.rows(), offsets, indices, values)
    }

    /// The diagonal.
    pub fn diagonal(&self) -> Vec<f64> {
        (0..self.rows()).map(|i| self.row(i).find(|&(col, _)| col == i).map_or(0.0, |(_, value)| value)).collect()
    }
}

impl LinearOperator for Csr {
    fn rows(&self) -> usize {
        self.offsets.len() - 1
    }
    fn cols(&self) -> usize {
        self.cols
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        y.parts_mut(ROWS).into_par_iter().enumerate().for_each(|(part, mut y)| {
            for place in 0..y.first().map_or(0, |band| band.len()) {
                let row = part * ROWS + place;
                for (y, x) in y.iter_mut().zip(x.iter_bands()) {
                    y[place] = self.row_times(row, x);
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What picks numbers, and what does not though it has as many entries: one is not 1, or a row has two and another none.
    #[test]
    fn rows_are_multiplied_and_added_alike_whether_they_pick_or_not() {
        let (x, times) = ([2.0_f32, 3.0, 5.0], [7.0, 11.0, 13.0]);
        for (rows, product, sum) in [
            ([vec![(2, 1.0)], vec![(0, 1.0)], vec![(2, 1.0)]], [5.0, 2.0, 5.0], [11.0, 0.0, 20.0]),
            ([vec![(2, 1.0)], vec![(0, 0.5)], vec![(2, 1.0)]], [5.0, 1.0, 5.0], [5.5, 0.0, 20.0]),
            ([vec![(0, 1.0), (2, 1.0)], vec![], vec![(1, 1.0)]], [7.0, 0.0, 3.0], [7.0, 13.0, 7.0]),
        ] {
            let matrix = Csr::from_rows(3, rows);
            let mut y = [0.0; 3];
            times.iter().enumerate().for_each(|(row, &times)| matrix.add_row(row, times, &mut y));
            assert_eq!((std::array::from_fn(|row| matrix.row_times(row, &x)), y), (product, sum));
        }
    }
}

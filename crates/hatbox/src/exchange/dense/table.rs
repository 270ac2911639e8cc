//! The upper triangle in memory, row after row.
//!
//! It is by far the largest thing there is, and the first touch of its memory in pages of 4 kB takes a part of the time that
//! shows; so it is one array in large pages.

use crate::visibility::Pages;
use std::ops::Range;

/// Rows of numbers that are zero at first.
#[derive(Debug)]
pub(super) struct Table {
    values: Pages<f64>,
    /// Where the row of each place starts, and the end.
    starts: Vec<usize>,
}

/// The rows of a range of places, to be filled.
pub(super) struct Part<'a> {
    pub(super) range: Range<usize>,
    values: &'a mut [f64],
    starts: &'a [usize],
}

impl Table {
    /// Rows of these lengths.
    pub(super) fn new(lengths: impl Iterator<Item = usize>) -> Self {
        let mut starts = vec![0];
        for length in lengths {
            starts.push(starts[starts.len() - 1] + length);
        }
        Self { values: Pages::zeroed(starts[starts.len() - 1]), starts }
    }

    /// Number of rows.
    pub(super) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.values)
    }

    pub(super) fn row(&self, place: usize) -> &[f64] {
        &self.values[self.starts[place]..self.starts[place + 1]]
    }

    /// The rows of ranges of places that follow each other from the first place to the last.
    pub(super) fn parts(&mut self, ranges: impl Iterator<Item = Range<usize>>) -> Vec<Part<'_>> {
        let (starts, mut rest) = (&self.starts, &mut self.values[..]);
        let part = |range: Range<usize>| {
            let length = starts[range.end] - starts[range.start];
            let (values, after) = std::mem::take(&mut rest).split_at_mut(length);
            rest = after;
            Part { starts: &starts[range.start..=range.end], range, values }
        };
        ranges.map(part).collect()
    }
}

impl Part<'_> {
    pub(super) fn row_mut(&mut self, place: usize) -> &mut [f64] {
        let (k, first) = (place - self.range.start, self.starts[0]);
        &mut self.values[self.starts[k] - first..self.starts[k + 1] - first]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_rows_of_the_table() {
        let mut table = Table::new([3, 0, 2, 1].into_iter());
        for mut part in table.parts([0..1, 1..4].into_iter()) {
            for place in part.range.clone() {
                part.row_mut(place).fill(place as f64 + 1.0);
            }
        }
        let rows: Vec<&[f64]> = (0..table.len()).map(|place| table.row(place)).collect();
        assert_eq!(rows, [&[1.0; 3][..], &[], &[3.0; 2], &[4.0]]);
        assert_eq!(table.bytes(), 48);
    }
}

//! What a product is applied to: coefficients as rays want to read them.
//!
//! The bands of a coefficient stand side by side, in whole registers, in large pages. Coefficients that are numbers of single
//! precision, as those of a search are, are kept as such: less memory to read, and the same bits. If all cells have as many,
//! those of a cell that fit into a line of the cache begin where none but they are in it (in large pages, which are what lines
//! matter for): 48 bytes one after the other would lie in two lines every other time.

#![expect(clippy::inline_always, reason = "loops must be compiled where their lengths are known")]

use super::cells::Cells;
use super::lamps::Lamps;
use super::rays::Hit;
use super::spots::Spots;
use crate::linalg::Number;
use crate::visibility::{Pages, prefetch};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Numbers of a register.
pub(super) const REGISTER: usize = 4;
/// Groups whose bands are set side by side at a time: few enough for the nearest cache.
const TURNED: usize = 64;
/// Bytes of a line of the cache.
const LINE: usize = 64;

/// Places for so many bands: whole registers, unless it is one.
pub(super) fn lanes_for(bands: usize) -> usize {
    if bands == 1 { 1 } else { bands.next_multiple_of(REGISTER) }
}

/// Where numbers stand: coefficients in groups, those of a cell if all cells have as many, else one by one.
#[derive(Debug, Clone, Copy)]
struct Layout {
    /// Coefficients of a group.
    group: usize,
    /// Places for the bands of a coefficient; those beyond the bands hold zeros.
    lanes: usize,
    /// Places from group to group.
    stride: usize,
}

impl Layout {
    fn new<T>(cells: &Cells, lanes: usize) -> Self {
        let (alike, group) = (cells.alike().is_some(), cells.alike().unwrap_or(1));
        // Without groups, coefficients of a cell follow each other.
        Self { group, lanes, stride: if alike { stride::<T>(group * lanes) } else { lanes } }
    }

    fn place(&self, dof: usize) -> usize {
        dof / self.group * self.stride + dof % self.group * self.lanes
    }
}

/// Places from group to group if all cells have so many numbers.
#[inline(always)]
const fn stride<T>(numbers: usize) -> usize {
    if numbers * size_of::<T>() <= LINE { numbers.next_power_of_two() } else { numbers }
}

/// Coefficients with the bands of each side by side.
pub(super) struct Coefficients<T> {
    layout: Layout,
    values: Pages<T>,
    means: Vec<f64>,
}

/// The same, to be read.
#[derive(Clone, Copy)]
pub(super) struct Source<'a, T> {
    layout: Layout,
    pub(super) values: &'a [T],
    /// For each lamp, its mean in every lane.
    pub(super) means: &'a [f64],
}

impl<T: Number> Coefficients<T> {
    /// What has these coefficients by number and band, with so many places for bands, and whether all of them are such numbers; if
    /// not, some are left out.
    pub(super) fn new(
        cells: &Cells,
        lamps: &Lamps,
        [bands, lanes]: [usize; 2],
        value: impl Fn(usize, usize) -> f64 + Sync,
    ) -> (Self, bool) {
        let exact = AtomicBool::new(true);
        let layout = Layout::new::<T>(cells, lanes);
        let Layout { group, stride, .. } = layout;
        let mut values: Pages<T> = Pages::zeroed(cells.unknowns().div_ceil(group) * stride);
        values.par_chunks_mut(stride.max(1) * TURNED).enumerate().for_each(|(part, values)| {
            if !exact.load(Ordering::Relaxed) {
                return;
            }
            let mut all = true;
            for band in 0..bands {
                for (k, values) in values.chunks_exact_mut(stride).enumerate() {
                    for (function, place) in values[band..].iter_mut().step_by(lanes).take(group).enumerate() {
                        let value = value((part * TURNED + k) * group + function, band);
                        *place = T::nearest(value);
                        // What is not a number is not single, but is itself.
                        all &= (*place).into().to_bits() == value.to_bits();
                    }
                }
            }
            exact.fetch_and(all, Ordering::Relaxed);
        });
        let means = lamps.means(cells, [bands, lanes], |dof, band| values[layout.place(dof) + band].into());
        (Self { layout, values, means }, exact.into_inner())
    }

    pub(super) fn source(&self) -> Source<'_, T> {
        Source { layout: self.layout, values: &self.values, means: &self.means }
    }
}

#[cfg(test)]
impl<'a, T> Source<'a, T> {
    /// Coefficients that are known one by one, of cells that all have so many.
    pub(super) fn of_known(values: &'a [T], lanes: usize, group: usize) -> Self {
        Self { layout: Layout { group, lanes, stride: stride::<T>(group * lanes) }, values, means: &[] }
    }
}

impl<T: Number> Source<'_, T> {
    /// Places for the bands of a coefficient; those beyond the bands hold zeros.
    pub(super) fn lanes(&self) -> usize {
        self.layout.lanes
    }

    /// Where the coefficients of a cell begin and how many numbers they are.
    #[inline(always)]
    pub(super) fn place<const N: usize, const B: usize>(&self, cells: &Cells, cell: usize) -> Range<usize> {
        if N > 0 {
            return self.known_place::<N, B>(cell);
        }
        let range = cells.range(cell);
        let start = self.layout.place(range.start);
        start..start + range.len() * if B > 0 { B } else { self.layout.lanes }
    }

    /// The same, if all cells have N functions.
    #[inline(always)]
    pub(super) fn known_place<const N: usize, const B: usize>(&self, cell: usize) -> Range<usize> {
        let start = cell * if B > 0 { stride::<T>(N * B) } else { self.layout.stride };
        start..start + N * if B > 0 { B } else { self.layout.lanes }
    }

    /// Asks for the coefficients of a cell that rays will read, so that the memory has them on their way.
    #[inline(always)]
    pub(super) fn ask_for<const N: usize, const B: usize>(&self, place: Range<usize>) {
        prefetch(self.values, place.start);
        if self.layout.stride * size_of::<T>() > LINE || N == 0 {
            prefetch(self.values, place.end - 1);
        }
    }

    /// The coefficients of a cell.
    #[inline(always)]
    pub(super) fn of_cell<const N: usize, const B: usize>(&self, cells: &Cells, cell: usize) -> &[T] {
        &self.values[self.place::<N, B>(cells, cell)]
    }

    /// The function's value where a ray ended, for every band.
    #[inline(always)]
    pub(super) fn evaluate<const N: usize, const B: usize>(
        &self,
        cells: &Cells,
        hit: Hit,
        spots: &Spots,
        out: &mut [f64],
    ) {
        let values = self.of_cell::<N, B>(cells, hit.cell());
        out.fill(0.0);
        for (values, function) in values.chunks_exact(out.len()).zip(spots.functions(hit.spot())) {
            out.iter_mut().zip(values).for_each(|(out, &value)| *out += function * value.into());
        }
    }

    /// The coefficients of a cell, if all have N functions and there are B lanes.
    #[inline(always)]
    pub(super) fn known_cell<const N: usize, const B: usize>(&self, cell: usize) -> &[T] {
        &self.values[self.known_place::<N, B>(cell)]
    }

    /// The function's value where a ray ended, for every band, if all cells have N functions and there are B lanes.
    #[inline(always)]
    pub(super) fn known_value<const N: usize, const B: usize>(&self, hit: Hit, spots: &Spots) -> [f64; B] {
        let values = self.known_cell::<N, B>(hit.cell());
        let functions = &spots.functions(hit.spot())[..N];
        let mut sum = [0.0; B];
        for k in 0..N {
            for b in 0..B {
                sum[b] += functions[k] * values[k * B + b].into();
            }
        }
        sum
    }
}

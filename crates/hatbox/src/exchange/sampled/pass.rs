//! Passes over all cells: which bands are taken together, where results go, and who hears of it.
//!
//! Bands are taken in registers of four, for which there are loops of known length: those of any length take longer.
//! Of rays that are stored one register after the other reads all, since the numbers of one may stay near; rays that are cast
//! again are so once for all registers, cell by cell. Constants in many bands are read all together: a cell has few numbers
//! (`cargo bench -p hatbox --bench scale -- bands 200000`).

use super::fit::Take;
use super::product::{Row, Work};
use super::source::{Coefficients, REGISTER, lanes_for};
use super::{CHUNK, Sampled};
use crate::linalg::{MultiVector, Number};
use crate::progress::{Interrupted, Progress, Stage};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Constants in so many bands are taken in registers.
const MOST_CONSTANTS: usize = 8;
/// Chunks whose results wait to be put where they belong, band by band.
const AT_ONCE: usize = 256;

/// How bands are taken together.
#[derive(Clone, Copy)]
pub(super) struct Parts {
    bands: usize,
    /// Bands of all parts but the last.
    each: usize,
    /// Places for the bands of a part.
    pub(super) lanes: usize,
}

impl Parts {
    /// All at once.
    pub(super) fn whole(bands: usize) -> Self {
        Self { bands, each: bands, lanes: lanes_for(bands) }
    }

    /// A part of so many bands alone.
    fn one(self, bands: usize) -> Self {
        Self { bands, each: bands, ..self }
    }

    /// The bands of each part.
    fn ranges(&self) -> impl Iterator<Item = Range<usize>> {
        let part = |first: usize| first..(first + self.each).min(self.bands);
        (0..self.bands).step_by(self.each.max(1)).map(part)
    }
}

impl Sampled {
    /// Puts the rows of S as the rays have them, applied to what has these coefficients by number and band.
    pub(super) fn rows_of(
        &self,
        value: impl Fn(usize, usize) -> f64 + Sync,
        take: Take,
        y: &mut MultiVector,
        put: impl Fn(&mut [f64], Range<usize>, &[f64]) + Sync,
        progress: &dyn Progress,
    ) -> Result<(), Interrupted> {
        let parts = self.parts(y.bands());
        let (single, exact) = self.coefficients::<f32>(&parts, &value);
        if exact {
            self.rows_from((parts, &single), take, y, put, progress)
        } else {
            drop(single);
            self.rows_from((parts, &self.coefficients::<f64>(&parts, &value).0), take, y, put, progress)
        }
    }

    /// Registers where they have loops of their own.
    fn parts(&self, bands: usize) -> Parts {
        let functions = if let [table] = &self.tables[..] { table.element.dofs() } else { 0 };
        let has_loops = match functions {
            1 => bands <= MOST_CONSTANTS,
            3 | 4 | 6 => true,
            _ => false,
        };
        if has_loops && bands > REGISTER {
            Parts { bands, each: REGISTER, lanes: REGISTER }
        } else {
            Parts::whole(bands)
        }
    }

    /// What has these coefficients, for each part, and whether all of them are such numbers.
    fn coefficients<T: Number>(
        &self,
        parts: &Parts,
        value: impl Fn(usize, usize) -> f64 + Sync,
    ) -> (Vec<Coefficients<T>>, bool) {
        let of_part = |part: Range<usize>| {
            let value = |dof: usize, band: usize| value(dof, part.start + band);
            Coefficients::new(&self.cells, &self.lamps, [part.len(), parts.lanes], value)
        };
        let (all, exact): (Vec<_>, Vec<bool>) = parts.ranges().map(of_part).unzip();
        (all, exact.into_iter().all(|exact| exact))
    }

    /// The same for what rays read. Where they are cast again, which takes long, `progress` hears of it.
    fn rows_from<T: Number>(
        &self,
        (parts, coefficients): (Parts, &[Coefficients<T>]),
        take: Take,
        y: &mut MultiVector,
        put: impl Fn(&mut [f64], Range<usize>, &[f64]) + Sync,
        progress: &dyn Progress,
    ) -> Result<(), Interrupted> {
        let (row, kept): (Row<T>, _) = (self.row_for(parts.lanes), self.stored.len() * CHUNK);
        let row = |cell: usize, index: usize, part: usize, work: &mut Work| {
            row(self, cell, index, coefficients[part].source(), take, work);
        };
        let (height, y) = (y.rows(), y.as_mut_slice());
        if kept >= self.cells.len() {
            for (part, bands) in parts.ranges().enumerate() {
                let row = |cell: usize, index: usize, _: usize, work: &mut Work| row(cell, index, part, work);
                self.by_rows(row, parts.one(bands.len()), &mut y[bands.start * height..bands.end * height], &put);
            }
            return Ok(());
        }
        let stage = Stage::begin(progress, "casting rays again", (self.cells.len() - kept) as u64);
        let stopped = AtomicBool::new(false);
        let watched = |cell: usize, index: usize, part: usize, work: &mut Work| {
            if cell < kept {
                row(cell, index, part, work);
            } else if progress.interrupted() {
                stopped.store(true, Ordering::Relaxed);
            } else {
                row(cell, index, part, work);
                // Not by every cell: whoever listens may have to wait for others.
                let chunk = self.chunk(cell / CHUNK);
                if part == 0 && cell + 1 == chunk.end {
                    progress.advance(chunk.len() as u64);
                }
            }
        };
        self.by_rows(watched, parts, y, put);
        drop(stage);
        if stopped.into_inner() { Err(Interrupted) } else { Ok(()) }
    }

    /// Calls `row` for every cell with its place in its chunk and each part, and has the results put into each band of y, in
    /// order.
    pub(super) fn by_rows(
        &self,
        row: impl Fn(usize, usize, usize, &mut Work) + Sync,
        parts: Parts,
        y: &mut [f64],
        put: impl Fn(&mut [f64], Range<usize>, &[f64]) + Sync,
    ) {
        let height = (y.len() / parts.bands.max(1)).max(1);
        let mut put_all = |some: Range<usize>, results: &[Vec<f64>]| {
            y.par_chunks_mut(height).enumerate().for_each(|(band, column)| {
                for (chunk, result) in some.clone().zip(results) {
                    let rows = self.rows_of_chunk(chunk);
                    put(column, rows.clone(), &result[band * rows.len()..(band + 1) * rows.len()]);
                }
            });
        };
        // Bands are no multiple of threads: those that have nothing to put go on with the next chunks.
        let chunks = 0..self.direct.len();
        let mut waiting = (0..0, Vec::new());
        for first in chunks.clone().step_by(AT_ONCE) {
            let some = first..(first + AT_ONCE).min(chunks.end);
            let results = || some.clone().into_par_iter().map(|chunk| self.of_chunk(&row, parts, chunk)).collect();
            let ((), results) = rayon::join(|| put_all(waiting.0.clone(), &waiting.1), results);
            waiting = (some, results);
        }
        put_all(waiting.0, &waiting.1);
    }

    fn rows_of_chunk(&self, chunk: usize) -> Range<usize> {
        let cells = self.chunk(chunk);
        self.cells.range(cells.start).start..self.cells.range(cells.end - 1).end
    }

    /// What `row` works out for a chunk, the bands one after the other, as they are wanted.
    fn of_chunk(&self, row: &(impl Fn(usize, usize, usize, &mut Work) + Sync), parts: Parts, chunk: usize) -> Vec<f64> {
        let rows = self.rows_of_chunk(chunk);
        let mut out = vec![0.0; rows.len() * parts.bands];
        let mut work = Work::new(self.rays, parts.lanes);
        for (index, cell) in self.chunk(chunk).enumerate() {
            for (part, bands) in parts.ranges().enumerate() {
                row(cell, index, part, &mut work);
                for (of_row, result) in self.cells.range(cell).zip(work.result.chunks_exact(parts.lanes)) {
                    let first = bands.start * rows.len() + of_row - rows.start;
                    let places = out[first..].iter_mut().step_by(rows.len());
                    places.zip(&result[..bands.len()]).for_each(|(place, &value)| *place = value);
                }
            }
        }
        out
    }
}

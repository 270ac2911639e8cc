//! What the rows of an operator on constants add up to, in one pass over the upper triangle.

#![expect(clippy::inline_always, reason = "kernels must be inlined into functions compiled for their instruction set")]

use super::{Dense, RUNS};
use rayon::prelude::*;

/// What is known of a cell's row.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RowFacts {
    /// Σ_j S_ij in m².
    pub sum: f64,
    /// Number of entries that are not zero.
    pub nonzeros: usize,
    /// The greatest |A_i F_ij − A_j F_ji|/(A_i F_ij) with F_ij = S_ij/A_i rounded.
    pub reciprocity_error: f64,
}

/// Columns of the facts of all places.
struct Facts {
    sums: Vec<f64>,
    counts: Vec<u32>,
    errors: Vec<f64>,
}

/// What a row is compared with.
struct Areas {
    area: Vec<f64>,
    inverse: Vec<f64>,
}

impl Dense {
    /// The facts of each cell's row, for an operator with one unknown a cell; `areas` are those of the cells.
    ///
    /// # Panics
    /// If there is not one unknown and one area for each cell.
    pub fn row_facts(&self, areas: &[f64]) -> Vec<RowFacts> {
        let cells = self.place.len();
        assert!(self.unknowns.len() == cells && areas.len() == cells, "one unknown and one area a cell");
        let area: Vec<f64> = self.unknowns.iter().map(|&cell| areas[cell as usize]).collect();
        let areas = Areas { inverse: area.iter().map(|area| 1.0 / area).collect(), area };
        let run = |run: usize| {
            let mut facts = Facts { sums: vec![0.0; cells], counts: vec![0; cells], errors: vec![0.0; cells] };
            for place in (run..cells).step_by(RUNS) {
                scan(place, self.table.row(place), &areas, &mut facts);
            }
            facts
        };
        let runs: Vec<Facts> = (0..RUNS).into_par_iter().with_max_len(1).map(run).collect();
        let fact = |&place: &u32| {
            let place = place as usize;
            RowFacts {
                sum: runs.iter().map(|run| run.sums[place]).sum(),
                nonzeros: runs.iter().map(|run| run.counts[place] as usize).sum(),
                reciprocity_error: runs.iter().map(|run| run.errors[place]).fold(0.0, greater),
            }
        };
        self.place.iter().map(fact).collect()
    }
}

/// The greater of two numbers; no number if one of them is none.
#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if b <= a { a } else { b }
}

/// Numbers that are added up side by side, so that sums are the same on every processor and can be vectorized.
const LANES: usize = 8;

/// Adds a row of the upper triangle to the facts of its own place and of those of its columns.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn scan(place: usize, row: &[f64], areas: &Areas, facts: &mut Facts) {
    let (own, row) = ([areas.area[place], areas.inverse[place]], &row[1..]);
    let (mut sum, mut count, mut worst) = ([0.0; LANES], [0; LANES], [0.0; LANES]);
    let (n, first) = (row.len(), place + 1);
    let (area, inverse) = (&areas.area[first..][..n], &areas.inverse[first..][..n]);
    let (sums, counts) = (&mut facts.sums[first..][..n], &mut facts.counts[first..][..n]);
    let errors = &mut facts.errors[first..][..n];
    for start in (0..n).step_by(LANES) {
        let end = if start + LANES < n { start + LANES } else { n };
        for k in start..end {
            let (lane, s) = (k - start, row[k]);
            let (seen, error) = judged(s, own, [area[k], inverse[k]]);
            sums[k] += s;
            counts[k] += seen;
            errors[k] = greater(errors[k], error);
            sum[lane] += s;
            count[lane] += seen;
            worst[lane] = greater(worst[lane], error);
        }
    }
    for lane in 0..LANES {
        facts.sums[place] += sum[lane];
        facts.counts[place] += count[lane];
        facts.errors[place] = greater(facts.errors[place], worst[lane]);
    }
}

/// Whether two cells exchange anything, and how far the factors either way are from reciprocal. The cells are given by
/// area and inverse area.
#[inline(always)]
fn judged(s: f64, one: [f64; 2], other: [f64; 2]) -> (u32, f64) {
    let (there, back) = (one[0] * (s * one[1]), other[0] * (s * other[1]));
    if s == 0.0 { (0, 0.0) } else { (1, (there - back).abs() / s) }
}

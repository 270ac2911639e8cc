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
    /// Whole numbers, as wide as the others, so that all go through the same registers.
    counts: Vec<f64>,
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
            let mut facts = Facts { sums: vec![0.0; cells], counts: vec![0.0; cells], errors: vec![0.0; cells] };
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
                nonzeros: runs.iter().map(|run| run.counts[place]).sum::<f64>() as usize,
                reciprocity_error: runs.iter().map(|run| run.errors[place]).fold(0.0, greater),
            }
        };
        self.place.iter().map(fact).collect()
    }
}

/// The greater of two numbers; no number if one of them is none.
#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if (a >= b) | a.is_nan() { a } else { b }
}

/// Numbers that are added up side by side, so that sums are the same on every processor and can be vectorized.
const LANES: usize = 8;

/// What numbers side by side add up to.
struct Totals {
    sum: [f64; LANES],
    count: [f64; LANES],
    worst: [f64; LANES],
}

/// Adds a row of the upper triangle to the facts of its own place and of those of its columns.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn scan(place: usize, row: &[f64], areas: &Areas, facts: &mut Facts) {
    let own = [areas.area[place], areas.inverse[place]];
    let mut totals = Totals { sum: [0.0; LANES], count: [0.0; LANES], worst: [0.0; LANES] };
    let (s, rest) = row[1..].as_chunks::<LANES>();
    let (area, area_rest) = areas.area[place + 1..].as_chunks();
    let (inverse, inverse_rest) = areas.inverse[place + 1..].as_chunks();
    let (sums, sums_rest) = facts.sums[place + 1..].as_chunks_mut();
    let (counts, counts_rest) = facts.counts[place + 1..].as_chunks_mut();
    let (errors, errors_rest) = facts.errors[place + 1..].as_chunks_mut();
    for k in 0..s.len() {
        let mut columns = Columns { sums: &mut sums[k], counts: &mut counts[k], errors: &mut errors[k] };
        add(&s[k], own, [&area[k], &inverse[k]], &mut columns, &mut totals);
    }
    if !rest.is_empty() {
        // Filled up with zeros, which count for nothing.
        let filled = |values: &[f64]| std::array::from_fn(|k| values.get(k).copied().unwrap_or(0.0));
        let [mut sums, mut counts, mut errors] = [&*sums_rest, counts_rest, errors_rest].map(filled);
        let mut columns = Columns { sums: &mut sums, counts: &mut counts, errors: &mut errors };
        add(&filled(rest), own, [&filled(area_rest), &filled(inverse_rest)], &mut columns, &mut totals);
        for (to, from) in [(sums_rest, sums), (counts_rest, counts), (errors_rest, errors)] {
            to.copy_from_slice(&from[..to.len()]);
        }
    }
    for lane in 0..LANES {
        facts.sums[place] += totals.sum[lane];
        facts.counts[place] += totals.count[lane];
        facts.errors[place] = greater(facts.errors[place], totals.worst[lane]);
    }
}

/// The facts of as many columns.
struct Columns<'a> {
    sums: &'a mut [f64; LANES],
    counts: &'a mut [f64; LANES],
    errors: &'a mut [f64; LANES],
}

/// Adds as many numbers of a row to the facts of their columns and to what the row adds up to. The error is how far two
/// cells are from reciprocal; the cells are given by area and inverse area.
#[inline(always)]
fn add(s: &[f64; LANES], own: [f64; 2], other: [&[f64; LANES]; 2], columns: &mut Columns<'_>, totals: &mut Totals) {
    let (mut seen, mut error) = ([0.0; LANES], [0.0; LANES]);
    for k in 0..LANES {
        let (there, back) = (own[0] * (s[k] * own[1]), other[0][k] * (s[k] * other[1][k]));
        seen[k] = f64::from(u8::from(s[k] != 0.0));
        // What is zero is zero either way, without a branch.
        error[k] = (there - back).abs() / greater(s[k].abs(), f64::MIN_POSITIVE);
    }
    for k in 0..LANES {
        columns.sums[k] += s[k];
        columns.counts[k] += seen[k];
        columns.errors[k] = greater(columns.errors[k], error[k]);
        totals.sum[k] += s[k];
        totals.count[k] += seen[k];
        totals.worst[k] = greater(totals.worst[k], error[k]);
    }
}

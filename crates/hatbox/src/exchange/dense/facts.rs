//! What the rows of an operator on constants add up to, in one pass over the upper triangle.

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
                scan(place, &self.rows[place], &areas, &mut facts);
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
#[expect(clippy::inline_always, reason = "it must become one instruction in the loops that call it")]
#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if b <= a { a } else { b }
}

/// Adds a row of the upper triangle to the facts of its own place and of those of its columns.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn scan(place: usize, row: &[f64], areas: &Areas, facts: &mut Facts) {
    let n = row.len();
    let (area, inverse) = (&areas.area[place..][..n], &areas.inverse[place..][..n]);
    let (mine, mine_inverse) = (area[0], inverse[0]);
    let (sums, counts) = (&mut facts.sums[place..][..n], &mut facts.counts[place..][..n]);
    let errors = &mut facts.errors[place..][..n];
    for k in 1..n {
        let s = row[k];
        let seen = s != 0.0;
        let (there, back) = (mine * (s * mine_inverse), area[k] * (s * inverse[k]));
        let error = if seen { (there - back).abs() / s } else { 0.0 };
        sums[k] += s;
        counts[k] += u32::from(seen);
        errors[k] = if error <= errors[k] { errors[k] } else { error };
    }
    // In lanes, so that sums are the same on every processor and can be vectorized.
    let (mut lanes, mut count, mut worst) = ([0.0; 8], 0, errors[0]);
    for k in 1..n {
        lanes[k % 8] += row[k];
        count += u32::from(row[k] != 0.0);
        let (there, back) = (mine * (row[k] * mine_inverse), area[k] * (row[k] * inverse[k]));
        let error = if row[k] == 0.0 { 0.0 } else { (there - back).abs() / row[k] };
        worst = if error <= worst { worst } else { error };
    }
    sums[0] += lanes.iter().sum::<f64>();
    counts[0] += count;
    errors[0] = worst;
}

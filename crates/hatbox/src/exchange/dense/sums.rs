//! Counts and errors while pairs are integrated, and what rows with too large errors are given the second time.
//!
//! How many pairs of a row are partially hidden is known only when all have been looked at: few in an empty room, most of
//! them among furniture. So each is first allowed the error of a room with few. Where the sum over a row's pairs is then more
//! than the tolerance, its partially hidden pairs are integrated once more, each with its share of what the row may err by.
//!
//! To count them first and integrate each only once was tried, and was no faster in the L-shaped room: to find them all
//! twice costs as much as to integrate again those of the rows that need it.

use crate::assemble::{Accuracy, Block, LANES, Panel};
use crate::exchange::Statistics;
use std::ops::Range;

/// The least part of the tolerance that is left to shadows, whatever the error of clear pairs.
const LEAST: f64 = 0.25;

/// Counts, and the errors of the row of each place.
pub(super) struct Sums {
    /// Errors of quadrature of pairs that are clear.
    clear: Vec<f64>,
    /// Σ of their squares, each times that of the strength of the other panel's light.
    squares: Vec<f64>,
    /// What is known of partially hidden pairs; empty if there are none.
    partial: Partial,
    pub(super) rays: u64,
    pub(super) pairs: u64,
    pub(super) clear_pairs: u64,
}

/// Of the partially hidden pairs in the row of each place.
#[derive(Default)]
struct Partial {
    /// Σ of the errors of quadrature.
    quadrature: Vec<f64>,
    /// Σ of the squares of the errors of visibility, which are independent.
    visibility: Vec<f64>,
    /// Σ of the squares of both, each times that of the strength of the other panel's light.
    squares: Vec<f64>,
    /// Σ of what errors are counted in.
    scale: Vec<f64>,
}

impl Sums {
    pub(super) fn new(cells: usize) -> Self {
        let zeros = vec![0.0; cells];
        Self { clear: zeros.clone(), squares: zeros, partial: Partial::default(), rays: 0, pairs: 0, clear_pairs: 0 }
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.partial.make(other.partial.scale.len());
        let clear = [(&mut self.clear, &other.clear), (&mut self.squares, &other.squares)];
        for (sums, others) in clear.into_iter().chain(self.partial.columns(&other.partial)) {
            sums.iter_mut().zip(others).for_each(|(sum, x)| *sum += x);
        }
        self.rays += other.rays;
        self.pairs += other.pairs;
        self.clear_pairs += other.clear_pairs;
    }

    /// `strengths` are those of the panels at two places.
    pub(super) fn note_clear(&mut self, places: [usize; 2], strengths: [f64; 2], block: &Block) {
        let seen = sees(block);
        (self.pairs, self.clear_pairs) = (self.pairs + seen, self.clear_pairs + seen);
        self.note_error(places, strengths, block.quadrature_error);
    }

    /// The error of a clear pair.
    pub(super) fn note_error(&mut self, places: [usize; 2], [on_j, on_i]: [f64; 2], error: f64) {
        for (place, strength) in places.into_iter().zip([on_i, on_j]) {
            self.clear[place] += error;
            self.squares[place] += (strength * error).powi(2);
        }
    }

    /// The errors of pairs of a place with as many that follow each other, and nothing but errors of pairs that are clear.
    pub(super) fn note_errors(&mut self, i: usize, first: usize, strengths: &[f64], errors: &[f64; LANES]) {
        let own = strengths[i];
        let strengths: &[f64; LANES] = strengths[first..].first_chunk().expect("all lanes lie within the row");
        let [clear, squares] = [&mut self.clear, &mut self.squares]
            .map(|column| column[first..].first_chunk_mut::<LANES>().expect("all lanes lie within the row"));
        let [sum, square] = add_errors(errors, own, strengths, clear, squares);
        self.clear[i] += sum;
        self.squares[i] += square;
    }

    /// `scale` is what the pair's error is counted in.
    pub(super) fn note_partial(&mut self, places: [usize; 2], [on_j, on_i]: [f64; 2], block: &Block, scale: f64) {
        self.partial.make(self.clear.len());
        self.pairs += sees(block);
        self.rays += u64::from(block.rays);
        let square = block.quadrature_error.powi(2) + block.visibility_error.powi(2);
        for (place, strength) in places.into_iter().zip([on_i, on_j]) {
            // That no light came through is an estimate, too.
            self.partial.quadrature[place] += block.quadrature_error;
            self.partial.visibility[place] += block.visibility_error.powi(2);
            self.partial.squares[place] += strength * strength * square;
            self.partial.scale[place] += scale;
        }
    }

    /// Puts the errors of rows that were limited in the place of those they had.
    pub(super) fn replace(&mut self, mended: &Self, limits: &Limits) {
        for place in (0..limits.of.len()).filter(|&place| limits.of[place].is_finite()) {
            self.partial.quadrature[place] = mended.partial.quadrature[place];
            self.partial.squares[place] = mended.partial.squares[place];
        }
    }

    /// For each place the root of the sum of the squares of its pairs' errors, as an error of its irradiance relative to the
    /// mean strength. Pairs report errors that few exceed; here half of them count.
    pub(super) fn row_errors(&self, panels: &[&Panel], strengths: &[f64]) -> Vec<f64> {
        let areas = || panels.iter().map(|panel| panel.area());
        let mean = areas().zip(strengths).map(|(area, s)| area * s).sum::<f64>() / areas().sum::<f64>();
        let square = |place: usize| self.squares[place] + self.partial.squares.get(place).copied().unwrap_or(0.0);
        areas().enumerate().map(|(place, area)| 0.5 * square(place).sqrt() / (area * mean)).collect()
    }

    pub(super) fn statistics(&self, panels: &[&Panel], bytes: usize) -> Statistics {
        // A NaN among the errors must not get lost.
        let greater = |a: f64, b: f64| if b <= a { a } else { b };
        let worst = |error: &dyn Fn(usize) -> f64| {
            panels.iter().enumerate().map(|(place, panel)| error(place) / panel.area()).fold(0.0, greater)
        };
        let of = |errors: &[f64], place: usize| errors.get(place).copied().unwrap_or(0.0);
        Statistics {
            bytes,
            recast: 0.0,
            rays: self.rays,
            pairs: self.pairs,
            clear_pairs: self.clear_pairs,
            quadrature_error: worst(&|place| self.clear[place] + of(&self.partial.quadrature, place)),
            visibility_error: worst(&|place| of(&self.partial.visibility, place).sqrt()),
        }
    }
}

/// Adds errors to those of the columns, and returns what they add to those of the row: the sum and the weighted squares.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn add_errors(
    errors: &[f64; LANES],
    own: f64,
    strengths: &[f64; LANES],
    clear: &mut [f64; LANES],
    squares: &mut [f64; LANES],
) -> [f64; 2] {
    let (mut sum, mut square) = (0.0, 0.0);
    let own = own * own;
    let mut weighted = [0.0; LANES];
    for lane in 0..LANES {
        let error = errors[lane];
        clear[lane] += error;
        squares[lane] += own * (error * error);
        weighted[lane] = (strengths[lane] * error) * (strengths[lane] * error);
    }
    for lane in 0..LANES {
        sum += errors[lane];
        square += weighted[lane];
    }
    [sum, square]
}

fn sees(block: &Block) -> u64 {
    u64::from(block.values().iter().any(|&value| value != 0.0))
}

impl Partial {
    fn make(&mut self, cells: usize) {
        if self.scale.len() < cells {
            for column in [&mut self.quadrature, &mut self.visibility, &mut self.squares, &mut self.scale] {
                column.resize(cells, 0.0);
            }
        }
    }

    fn columns<'a>(&'a mut self, other: &'a Self) -> [(&'a mut Vec<f64>, &'a Vec<f64>); 4] {
        [
            (&mut self.quadrature, &other.quadrature),
            (&mut self.visibility, &other.visibility),
            (&mut self.squares, &other.squares),
            (&mut self.scale, &other.scale),
        ]
    }
}

/// What the partially hidden pairs of some rows may err by, relative to their scale.
pub(super) struct Limits {
    /// Of the row of each place; infinite where there is no need.
    of: Vec<f64>,
    /// How many rows before each place have one.
    before: Vec<u32>,
}

impl Limits {
    /// Those of rows whose errors are too large, if there are any.
    pub(super) fn of(sums: &Sums, panels: &[&Panel], accuracy: &Accuracy) -> Option<Self> {
        let Partial { quadrature, scale, .. } = &sums.partial;
        let limit = |place: usize| {
            let most = accuracy.tolerance * panels[place].area();
            let left = (most - sums.clear[place]).max(LEAST * most);
            let limit = left / scale[place];
            if quadrature[place] > left && limit < accuracy.shadows { limit } else { f64::INFINITY }
        };
        let of: Vec<f64> = (0..quadrature.len()).map(limit).collect();
        let mut before = vec![0];
        for limit in &of {
            before.push(before[before.len() - 1] + u32::from(limit.is_finite()));
        }
        (before[of.len()] > 0).then_some(Self { of, before })
    }

    /// Whether any place of a range has one.
    pub(super) fn any_in(&self, range: &Range<usize>) -> bool {
        self.before[range.end] > self.before[range.start]
    }

    /// That of a pair: the lesser of those of its rows.
    pub(super) fn of_pair(&self, [i, j]: [usize; 2]) -> f64 {
        self.of[i].min(self.of[j])
    }
}

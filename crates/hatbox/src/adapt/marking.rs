//! Which cells to refine, and how often, so that the error is predicted to be what was asked for.
//!
//! Rounds cost the square of their elements, so what counts is how few there are. Dörfler's marking (a fixed part of the
//! error, each cell once) is safe where nothing is known, and creeps. Here the cell with the greatest square of the error
//! *per piece* is refined again and again, until what is predicted to be left is small enough. What refining a cell once
//! leaves of its square is 4^-(p+1) where B is smooth, ⅛ at a kink, ½ at a jump; it is learnt from the last round.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// What refining once is taken to leave of a cell's square before anything is known.
const REDUCTION: f64 = 0.25;
/// What is learnt lies between these.
const LEARNT: [f64; 2] = [1.0 / 32.0, 0.5];
/// A cell is refined so many times in a round at the most.
const MOST_LEVELS: u8 = 2;
/// There is one more cell for so many at the least after a round: it costs as much as the last, and what is predicted may not
/// come. How much is a guess.
const LEAST_GROWTH: usize = 8;
/// What refining a cell makes of it.
const PIECES: usize = 4;

/// The plan of each round, and what came of the last.
pub(super) struct Marking {
    reduction: f64,
    last: Option<Plan>,
}

/// The squares of the cells' errors, and how many times each cell is refined.
struct Plan {
    squares: Vec<f64>,
    levels: Vec<u8>,
}

/// A cell in the queue.
struct Candidate {
    cell: usize,
    level: u8,
    square: f64,
}

impl Candidate {
    fn per_piece(&self) -> f64 {
        self.square / PIECES.pow(u32::from(self.level)) as f64
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.per_piece().total_cmp(&other.per_piece()).then(other.cell.cmp(&self.cell))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl Marking {
    pub(super) fn new() -> Self {
        Self { reduction: REDUCTION, last: None }
    }

    /// Compares the squares of a round with what was predicted for it; `parents` are the last round's cells.
    pub(super) fn learn(&mut self, squares: &[f64], parents: &[u32]) {
        let Some(Plan { squares: before, levels }) = self.last.take() else { return };
        let refined = |level: u8| before.iter().zip(&levels).filter(move |(_, l)| **l == level).map(|(s, _)| s);
        let (once, twice): (f64, f64) = (refined(1).sum(), refined(2).sum());
        let left: f64 =
            squares.iter().zip(parents).filter(|&(_, &parent)| levels[parent as usize] > 0).map(|(s, _)| s).sum();
        // once · q + twice · q² = left, in a form that bears twice = 0.
        let q = 2.0 * left / (once + (once * once + 4.0 * twice * left).sqrt());
        if q.is_finite() {
            self.reduction = q.clamp(LEARNT[0], LEARNT[1]);
        }
    }

    /// How many times each cell is to be refined, for the sum of the squares to be at most `goal` times what it is, or for
    /// there to be about as many cells as there may be; cells grow by one in [`LEAST_GROWTH`] at the least, where there is any error.
    pub(super) fn levels(&self, squares: &[f64], goal: f64, most_cells: usize) -> Vec<u8> {
        let mut sum: f64 = squares.iter().sum();
        let (target, mut cells) = (goal * sum, squares.len());
        let least = (cells + cells / LEAST_GROWTH).min(most_cells);
        let mut levels = vec![0; squares.len()];
        let candidate = |(cell, &square): (usize, &f64)| Candidate { cell, level: 0, square };
        let mut queue: BinaryHeap<Candidate> =
            squares.iter().enumerate().filter(|(_, square)| **square > 0.0).map(candidate).collect();
        while (sum > target || cells < least) && cells < most_cells {
            let Some(Candidate { cell, level, square }) = queue.pop() else { break };
            let left = self.reduction * square;
            sum -= square - left;
            cells += (PIECES - 1) * PIECES.pow(u32::from(level));
            levels[cell] = level + 1;
            if level + 1 < MOST_LEVELS {
                queue.push(Candidate { cell, level: level + 1, square: left });
            }
        }
        levels
    }

    /// Notes what is going to be done.
    pub(super) fn decide(&mut self, squares: Vec<f64>, levels: Vec<u8>) {
        self.last = Some(Plan { squares, levels });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_greatest_errors_per_piece_are_refined_until_little_is_left() {
        let marking = Marking::new();
        assert_eq!(marking.levels(&[1.0, 5.0, 0.0, 4.0], 0.7, 100), [0, 1, 0, 0]);
        assert_eq!(marking.levels(&[1.0, 5.0, 0.0, 4.0], 0.4, 100), [0, 1, 0, 1]);
        assert_eq!(marking.levels(&[1.0, 99.0, 0.0, 1.0], 0.1, 100), [0, 2, 0, 0]);
        assert_eq!(marking.levels(&[0.0, 0.0], 0.1, 100), [0, 0]);
        assert_eq!(marking.levels(&[1.0, 1.0], 0.1, 3), [1, 0], "as many cells as there may be");
    }

    #[test]
    fn a_round_is_worth_its_price() {
        let levels = Marking::new().levels(&[1.0; 16], 1.0, 100);
        assert_eq!(levels.iter().map(|&level| u32::from(level)).sum::<u32>(), 1, "two more cells than 16, or more");
    }

    #[test]
    fn what_refining_leaves_is_learnt() {
        for (q, expected) in [(0.125, 0.125), (0.9, 0.5)] {
            let mut marking = Marking::new();
            marking.decide(vec![8.0, 16.0, 3.0], vec![1, 2, 0]);
            marking.learn(&[4.0 * q, 4.0 * q, 16.0 * q * q, 7.0], &[0, 0, 1, 2]);
            assert!((marking.reduction - expected).abs() < 1e-12, "{q}: {}", marking.reduction);
        }
    }
}

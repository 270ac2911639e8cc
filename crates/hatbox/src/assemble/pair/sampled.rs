//! Partially hidden pairs: low-discrepancy rays on top of the unoccluded block.
//!
//! What is hidden of a pair, H = ∬(1 − V) G N Nᵀ, is sampled with the unoccluded block S⁰ = ∬G N Nᵀ, which is known, as a control
//! variate: S = S⁰ − H̃ − β (S⁰ − S̃⁰), where H̃ and S̃⁰ are the sampled ones and β is the slope of (1 − V) G over G. Clear
//! pairs get S⁰ exactly (β = 0), hidden ones 0 exactly (β = 1), and the part that sampling has to find is only how the
//! shadow lies. The mean visibility ΣVG/ΣG times S⁰, which was here first, is about β = 1 − V̄: of walls that share an edge
//! it has all the noise of G next to the edge, where nothing is hidden. One number per pair would put the shadow's light in
//! the wrong corner.

use super::{Accuracy, Block, Facing};
use crate::assemble::Panel;
use crate::element::MAX_DOFS;
use crate::kernel::geometric;
use crate::quadrature::sequence::{hash, point};
use crate::visibility::PACKET;
use glam::DVec3;
use std::ops::Range;

/// Independent point sets whose spread is the error estimate.
const SETS: usize = 8;
/// Rays of each set in the first round; each further round doubles them.
const FIRST: u32 = 2;

/// Standard errors in the error estimate: eight sets say little of the spread, and stopping when it looks small makes it
/// look smaller. Of random pairs in shadows at a tolerance of 1 % no more than one in a hundred is to be farther off
/// (`tests/pairs/honesty.rs`); with four sets and two standard errors 22 of 200 were.
const CONFIDENCE: f64 = 3.0;
/// If n independent rays agree, another than theirs has a share of more than ln(100)/n in one case of a hundred. A share of
/// the light, n being (ΣG)²/ΣG²: next to an edge that the panels share lies much light for few rays. (That it is all of it is
/// not sure there: something thin right in such a corner may still be overlooked.)
const UNDISCOVERED: f64 = 4.6;

/// Which of up to [`PACKET`] segments are blocked, as bits.
type Hides<'a> = &'a dyn Fn(&[DVec3], &[DVec3]) -> u32;

/// Two panels whose sight is to be sampled, and how accurately.
pub(super) struct Sampling<'a> {
    pub(super) a: &'a Panel,
    pub(super) b: &'a Panel,
    pub(super) facing: &'a Facing,
    pub(super) weights: [f64; 2],
    pub(super) accuracy: &'a Accuracy,
}

impl Sampling<'_> {
    /// The visible part of an unoccluded block.
    pub(super) fn visible_part(&self, unoccluded: &Block, hides: Hides<'_>) -> Block {
        let total = unoccluded.sum();
        if total <= 0.0 {
            return *unoccluded;
        }
        let allowed = self.allowed_error(total);
        let seed = self.seed();
        let mut sums = Sums::new(self, total);
        let (mut done, mut target) = (0, FIRST);
        loop {
            self.round(done..target, seed, &mut sums, hides);
            let error = sums.error();
            if error <= allowed || sums.samples >= self.accuracy.max_rays {
                // Less than what was allowed is not claimed: rays were doubled until it looked so.
                return Block { visibility_error: error.max(allowed), rays: sums.samples, ..sums.combine(unoccluded) };
            }
            (done, target) = (target, 2 * target);
        }
    }

    /// Adds the points of a range of each set, as many at once as rays go together.
    fn round(&self, range: Range<u32>, seed: u64, sums: &mut Sums, hides: Hides<'_>) {
        let all = SETS * range.len();
        let set = |k: usize| k / range.len();
        let (mut from, mut to) = ([DVec3::ZERO; PACKET], [DVec3::ZERO; PACKET]);
        for first in (0..all).step_by(PACKET) {
            let count = PACKET.min(all - first);
            for k in 0..count {
                let (set, index) = (set(first + k), range.start + ((first + k) % range.len()) as u32);
                let [s, t, u, v] = point(hash(seed, set as u64), index);
                (from[k], to[k]) = (self.facing.first.sample(s, t), self.facing.second.sample(u, v));
            }
            let hidden = hides(&from[..count], &to[..count]);
            for k in 0..count {
                sums.add(set(first + k), from[k], to[k], self, hidden >> k & 1 == 0);
            }
        }
    }

    /// Errors of a row's pairs are independent and add in squares: with err² ≤ τ² A s for each, a row's error is at most
    /// τ A √(Σs/A) ≤ τ A. A pair that carries strong light has its share of the square reduced accordingly.
    fn allowed_error(&self, total: f64) -> f64 {
        let area = (self.a.area() / self.weights[0]).min(self.b.area() / self.weights[1]);
        self.accuracy.tolerance * (total * area).sqrt()
    }

    /// A number of its own for each pair.
    fn seed(&self) -> u64 {
        let [p, q] = [self.a, self.b].map(|panel| panel.vertices.iter().fold(0, |h, &v| hash(h, u64::from(v))));
        hash(hash(self.accuracy.seed, p), q)
    }
}

/// Sums over the samples.
struct Sums {
    /// ∬G.
    total: f64,
    /// The product of the areas that are sampled.
    areas: f64,
    /// Σ G and Σ (1 − V) G of each set.
    kernel: [[f64; 2]; SETS],
    /// Σ G² and Σ (1 − V) G².
    squares: [f64; 2],
    /// Σ G N Nᵀ and Σ (1 − V) G N Nᵀ.
    blocks: [Block; 2],
    samples: u32,
}

impl Sums {
    fn new(pair: &Sampling<'_>, total: f64) -> Self {
        let areas = pair.facing.first.area() * pair.facing.second.area();
        let blocks = [Block::zeros(pair.a, pair.b); 2];
        Self { total, areas, kernel: [[0.0; 2]; SETS], squares: [0.0; 2], blocks, samples: 0 }
    }

    fn add(&mut self, set: usize, x: DVec3, y: DVec3, pair: &Sampling<'_>, visible: bool) {
        let g = geometric(x, pair.a.normal(), y, pair.b.normal());
        self.samples += 1;
        let functions = pair.a.values(x);
        let row: [f64; MAX_DOFS] = pair.b.values(y).map(|n| g * n);
        for k in 0..if visible { 1 } else { 2 } {
            self.kernel[set][k] += g;
            self.squares[k] += g * g;
            self.blocks[k].add(1.0, &functions, &row);
        }
    }

    /// Σ G and Σ (1 − V) G.
    fn both(&self) -> [f64; 2] {
        [0, 1].map(|k| self.kernel.iter().map(|sums| sums[k]).sum::<f64>())
    }

    /// β: the covariance of (1 − V) G and G over the variance of G.
    fn slope(&self) -> f64 {
        let (n, [all, hidden], [square, both]) = (f64::from(self.samples), self.both(), self.squares);
        let variance = n * square - all * all;
        if variance > 0.0 {
            ((n * both - hidden * all) / variance).clamp(0.0, 1.0)
        } else {
            hidden / all.max(f64::MIN_POSITIVE)
        }
    }

    /// The error of what is hidden: from the spread of the sets, but never less than what no ray may have found (when all
    /// agree, that is the only thing known).
    fn error(&self) -> f64 {
        let (n, slope) = (SETS as f64, self.slope());
        let scale = self.areas * n / f64::from(self.samples);
        let hidden = self.kernel.map(|[all, hidden]| scale * (hidden - slope * all));
        let mean = hidden.iter().sum::<f64>() / n;
        let variance = hidden.iter().map(|&h| (h - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let rays = self.both()[0].powi(2) / self.squares[0].max(f64::MIN_POSITIVE);
        let undiscovered = UNDISCOVERED * self.total / (rays + 2.0);
        (CONFIDENCE * (variance / n).sqrt()).max(undiscovered)
    }

    /// S⁰ − H̃ − β (S⁰ − S̃⁰), with a sum between nothing and that of S⁰.
    fn combine(&self, unoccluded: &Block) -> Block {
        let (mut block, slope, scale) = (*unoccluded, self.slope(), self.areas / f64::from(self.samples));
        let [all, hidden] = self.both();
        // In this order nothing is left, not even rounding, where all is hidden.
        let found = slope * self.total + scale * (hidden - slope * all);
        let within = if found > 0.0 { found.min(self.total) / found } else { 0.0 };
        let [every, behind] = &self.blocks;
        for (k, value) in block.values[..unoccluded.len].iter_mut().enumerate() {
            *value -= within * (slope * *value + scale * (behind.values[k] - slope * every.values[k]));
        }
        block
    }
}

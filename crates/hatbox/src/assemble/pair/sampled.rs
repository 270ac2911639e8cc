//! Partially hidden pairs: low-discrepancy rays on top of the unoccluded block.
//!
//! With the mean visibility V̄ = ΣVG/ΣG over the samples, S = V̄ S⁰ + (s⁰/ΣG) Σ(V − V̄) G N Nᵀ, where S⁰ is the
//! unoccluded block and s⁰ its sum. Clear pairs get S⁰ exactly, hidden ones 0 exactly, and the part that sampling has to
//! find is only how the shadow lies. Sampling the block itself would add the noise of
//! G to that of V; one number V̄ per pair would put the shadow's light in the wrong corner.

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
/// If n independent rays agree, another than theirs has a share of the light of more than ln(100)/n in one case of a hundred.
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
        let mut sums = Sums::new(self.a, self.b);
        let (mut done, mut target) = (0, FIRST);
        loop {
            self.round(done..target, seed, &mut sums, hides);
            let error = total * sums.error();
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
    /// Σ G and Σ V G of each set.
    kernel: [[f64; 2]; SETS],
    /// Σ G N Nᵀ and Σ V G N Nᵀ.
    blocks: [Block; 2],
    visible: u32,
    samples: u32,
}

impl Sums {
    fn new(a: &Panel, b: &Panel) -> Self {
        Self { kernel: [[0.0; 2]; SETS], blocks: [Block::zeros(a, b); 2], visible: 0, samples: 0 }
    }

    fn add(&mut self, set: usize, x: DVec3, y: DVec3, pair: &Sampling<'_>, visible: bool) {
        let g = geometric(x, pair.a.normal(), y, pair.b.normal());
        self.samples += 1;
        self.visible += u32::from(visible);
        self.kernel[set][0] += g;
        let functions = pair.a.values(x);
        let row: [f64; MAX_DOFS] = pair.b.values(y).map(|n| g * n);
        self.blocks[0].add(1.0, &functions, &row);
        if visible {
            self.kernel[set][1] += g;
            self.blocks[1].add(1.0, &functions, &row);
        }
    }

    /// The error of V̄: from the spread of the sets, but never less than what no ray may have found (when all agree, that
    /// is the only thing known).
    fn error(&self) -> f64 {
        let n = SETS as f64;
        let visibility = |[all, seen]: [f64; 2]| if all > 0.0 { seen / all } else { 0.0 };
        let mean = self.kernel.iter().map(|&k| visibility(k)).sum::<f64>() / n;
        let variance = self.kernel.iter().map(|&k| (visibility(k) - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (CONFIDENCE * (variance / n).sqrt()).max(UNDISCOVERED / (f64::from(self.samples) + 2.0))
    }

    /// V̄ S⁰ + (s⁰/ΣG) Σ(V − V̄) G N Nᵀ.
    fn combine(&self, unoccluded: &Block) -> Block {
        let mut block = *unoccluded;
        if self.visible == self.samples {
            return block;
        }
        let [all, seen] = [0, 1].map(|k| self.kernel.iter().map(|sums| sums[k]).sum::<f64>());
        let (mean, scale) = if all > 0.0 { (seen / all, unoccluded.sum() / all) } else { (0.0, 0.0) };
        let [every, clear] = &self.blocks;
        for (k, value) in block.values[..unoccluded.len].iter_mut().enumerate() {
            *value = mean * *value + scale * (clear.values[k] - mean * every.values[k]);
        }
        block
    }
}

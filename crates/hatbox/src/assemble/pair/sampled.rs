//! Partially hidden pairs: low-discrepancy rays on top of the unoccluded block.
//!
//! What is hidden of a pair, H = ∬(1 − V) G N Nᵀ, is sampled with the unoccluded block S⁰ = ∬G N Nᵀ, which is known, as a control
//! variate: S = S⁰ − H̃ − β (S⁰ − S̃⁰), where H̃ and S̃⁰ are the sampled ones and β is the slope of (1 − V) G over G. Clear
//! pairs get S⁰ exactly (β = 0), hidden ones 0 exactly (β = 1), and the part that sampling has to find is only how the
//! shadow lies. One number per pair would put the shadow's light in the wrong corner.
//!
//! Most pairs are sampled evenly in area. Next to an edge that panels share, G has no bound, and even points overlook what is
//! thin and right in the corner. So pairs that touch, or have an uneven G, are sampled by it ([`Kernel`]): every ray stands for as
//! much light. (Not if less than a hundredth of the smaller panel's directions meet the other, as where faces are nearly in one
//! plane: those are sampled evenly.)
//!
//! Before, all pairs were sampled evenly, and by the mean visibility ΣVG/ΣG times S⁰, which is about β = 1 − V̄: of
//! walls that share an edge it had all the noise of G next to the edge.

use super::region::distance;
use super::{Accuracy, Block, Facing, Region};
use crate::assemble::Panel;
use crate::element::MAX_DOFS;
use crate::kernel::{Frame, geometric};
use crate::quadrature::sequence::{hash, point};
use crate::visibility::PACKET;
use glam::DVec3;

/// Independent point sets whose spread is the error estimate.
const SETS: usize = 8;
/// Rays of each set in the first round; each further round doubles them.
const FIRST: u32 = 2;

/// Standard errors in the error estimate, so that one pair in a hundred is farther off (`tests/pairs/honesty.rs`): eight sets say
/// little of the spread, and this is Student's t for seven degrees of freedom.
const CONFIDENCE: f64 = 3.5;
/// If n independent rays agree, others have a share of more than ln(100)/n in one case of a hundred: a share of the light, n
/// being (ΣG)²/ΣG².
const UNDISCOVERED: f64 = 4.6;
/// A corner this close to the other panel, in radii of the smaller one, touches it.
const TOUCHING: f64 = 0.25;
/// G is uneven if the first round's points are worth, by (ΣG)²/ΣG², no more than this part of them.
const UNEVEN: f64 = 0.5;
/// Directions from a point of one panel, of which fewer meet the other than this, are too many to try.
const LEAST_MET: f64 = 0.01;
/// Directions that are tried for a ray. One in a hundred meets the other panel at the least: that none of these does has a
/// chance of 1e-71, and then an even point is taken.
const MOST_TRIED: u32 = 1 << 14;

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
        let kernel = if self.touches() { Kernel::new(self, total) } else { None };
        let mut points = Points { pair: self, kernel, seed: self.seed(), next: [0; SETS] };
        let mut sums = Sums::new(self, total);
        let (mut done, mut target, mut tried) = (0, FIRST, 0);
        loop {
            self.round((target - done) as usize, &mut points, &mut sums, hides);
            if done == 0 && points.kernel.is_none() && sums.worth() <= UNEVEN * f64::from(sums.samples) {
                points.kernel = Kernel::new(self, total);
                if points.kernel.is_some() {
                    tried = sums.samples;
                    sums = Sums::new(self, total);
                    continue;
                }
            }
            let error = sums.error();
            if error <= allowed || sums.samples >= self.accuracy.max_rays {
                // Less than what was allowed is not claimed: rays were doubled until it looked so.
                return Block {
                    visibility_error: error.max(allowed),
                    rays: tried + sums.samples,
                    ..sums.combine(unoccluded)
                };
            }
            (done, target) = (target, 2 * target);
        }
    }

    /// Adds so many points of each set, as many at once as rays go together.
    fn round(&self, new: usize, points: &mut Points<'_>, sums: &mut Sums, hides: Hides<'_>) {
        let all = SETS * new;
        let set = |k: usize| k / new;
        let (mut from, mut to, mut g) = ([DVec3::ZERO; PACKET], [DVec3::ZERO; PACKET], [0.0; PACKET]);
        for first in (0..all).step_by(PACKET) {
            let count = PACKET.min(all - first);
            for k in 0..count {
                (from[k], to[k], g[k]) = points.next(set(first + k));
            }
            let hidden = hides(&from[..count], &to[..count]);
            for k in 0..count {
                sums.add(set(first + k), [from[k], to[k]], g[k], self, hidden >> k & 1 == 0);
            }
        }
    }

    /// Whether a corner of one panel lies next to the other.
    fn touches(&self) -> bool {
        let (a, b, [first, second]) = (self.a, self.b, self.facing.polygons());
        let near = TOUCHING * a.radius.min(b.radius);
        let touches = |corners: &[DVec3], other: &[DVec3], normal: DVec3| {
            corners.iter().any(|&corner| distance(corner, other, normal) <= near)
        };
        touches(first, second, b.normal()) || touches(second, first, a.normal())
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

/// Points of both panels, set by set.
struct Points<'a> {
    pair: &'a Sampling<'a>,
    kernel: Option<Kernel<'a>>,
    seed: u64,
    /// The next number of each set.
    next: [u32; SETS],
}

impl Points<'_> {
    /// A pair of points, evenly in area, with G.
    fn even(&self, [s, t, u, v]: [f64; 4]) -> (DVec3, DVec3, f64) {
        let Sampling { a, b, facing, .. } = self.pair;
        let (x, y) = (facing.first.sample(s, t), facing.second.sample(u, v));
        (x, y, geometric(x, a.normal(), y, b.normal()))
    }

    /// The next pair of points of a set, and G there as it counts: as it is, or, where points lie by it, its mean.
    fn next(&mut self, set: usize) -> (DVec3, DVec3, f64) {
        let seed = hash(self.seed, set as u64);
        if let Some(kernel) = &self.kernel {
            for _ in 0..MOST_TRIED {
                let found = kernel.pair(point(seed, self.next[set]));
                self.next[set] += 1;
                if let Some([x, y]) = found {
                    return (x, y, kernel.mean);
                }
            }
        }
        let found = self.even(point(seed, self.next[set]));
        self.next[set] += 1;
        found
    }
}

/// Pairs of points with the density of G: even points of the smaller panel, and directions that are distributed like the cosine
/// there, of which those are kept that meet the other.
struct Kernel<'a> {
    from: &'a Region,
    to: &'a Region,
    frame: Frame,
    /// The normal of what is met.
    normal: DVec3,
    /// Whether the smaller panel is the second.
    swapped: bool,
    /// The mean of G.
    mean: f64,
}

impl<'a> Kernel<'a> {
    /// `None` if hardly any direction would meet the other.
    fn new(pair: &Sampling<'a>, total: f64) -> Option<Self> {
        let (a, b, Facing { first, second }) = (pair.a, pair.b, pair.facing);
        let areas = [first.area(), second.area()];
        if total < LEAST_MET * areas[0].min(areas[1]) {
            return None;
        }
        let (swapped, mean) = (areas[1] < areas[0], total / (areas[0] * areas[1]));
        let [(from, n), (to, normal)] = if swapped {
            [(second, b.normal()), (first, a.normal())]
        } else {
            [(first, a.normal()), (second, b.normal())]
        };
        Some(Self { from, to, frame: Frame::about(n), normal, swapped, mean })
    }

    /// A point of either panel, in their order; `None` if the direction does not meet the other.
    fn pair(&self, [s, t, u, v]: [f64; 4]) -> Option<[DVec3; 2]> {
        let (x, direction) = (self.from.sample(s, t), self.frame.cosine(u, v));
        let along = self.normal.dot(self.to.corners()[0] - x) / self.normal.dot(direction);
        let y = x + direction * along;
        // NaN is not.
        let met = along > 0.0 && along < f64::INFINITY && self.to.contains(y, self.normal);
        met.then_some(if self.swapped { [y, x] } else { [x, y] })
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

    fn add(&mut self, set: usize, [x, y]: [DVec3; 2], g: f64, pair: &Sampling<'_>, visible: bool) {
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

    /// How many points of equal G they are worth.
    fn worth(&self) -> f64 {
        self.both()[0].powi(2) / self.squares[0].max(f64::MIN_POSITIVE)
    }

    /// β: the covariance of (1 − V) G and G over the variance of G.
    fn slope(&self) -> f64 {
        let (n, [all, hidden], [square, both]) = (f64::from(self.samples), self.both(), self.squares);
        let variance = n * square - all * all;
        // What n terms of a sum leave of an even G is rounding.
        if variance > n * f64::EPSILON * n * square {
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
        let undiscovered = UNDISCOVERED * self.total / (self.worth() + 2.0);
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

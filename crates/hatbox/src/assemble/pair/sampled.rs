//! Partially hidden pairs: low-discrepancy rays on top of the unoccluded block.
//!
//! With the mean visibility V̄ = ΣVG/ΣG over the samples, S = V̄ S⁰ + (s⁰/ΣG) Σ(V − V̄) G N Nᵀ, where S⁰ is the
//! unoccluded block and s⁰ its sum. Clear pairs get S⁰ exactly, hidden ones 0 exactly, and the part that sampling has to
//! find is only how the shadow lies. Plain sampling of the block, without S⁰, was four times as noisy; one number V̄ per
//! pair puts the shadow's light in the wrong corner.

use super::{Accuracy, Block, Region};
use crate::assemble::Panel;
use crate::element::MAX_DOFS;
use crate::kernel::geometric;
use crate::quadrature::sequence::{hash, point};
use glam::DVec3;

/// Independent point sets whose spread is the error estimate.
const SETS: usize = 4;
/// Rays of each set in the first round; each further round doubles them.
const FIRST: u32 = 4;

/// The visible part of an unoccluded block.
#[allow(clippy::too_many_arguments)] // two panels with their regions, and what is asked of them
pub(super) fn visible_part(
    a: &Panel,
    on_a: &Region,
    b: &Panel,
    on_b: &Region,
    unoccluded: &Block,
    hides: &dyn Fn(DVec3, DVec3) -> bool,
    weights: [f64; 2],
    accuracy: &Accuracy,
) -> Block {
    let total = unoccluded.sum();
    if total <= 0.0 {
        return *unoccluded;
    }
    let allowed = allowed_error(total, a, b, weights, accuracy);
    let seed = hash(accuracy.seed, (u64::from(a.vertices[0]) << 32) ^ u64::from(b.vertices[1]));
    let seed = hash(seed, (u64::from(a.vertices[2]) << 32) ^ u64::from(b.vertices[0]));
    let mut sets = [(); SETS].map(|()| Set::new(a, b));
    let mut done = 0;
    let mut target = FIRST;
    loop {
        for (k, set) in sets.iter_mut().enumerate() {
            for index in done..target {
                let p = point(hash(seed, k as u64), index);
                set.add(on_a.sample(p[0], p[1]), on_b.sample(p[2], p[3]), a, b, hides);
            }
        }
        done = target;
        let error = total * standard_error(&sets);
        let rays = done * SETS as u32;
        if error <= allowed || rays >= accuracy.max_rays {
            let mut block = combine(unoccluded, &sets);
            block.visibility_error = error;
            block.rays = rays;
            return block;
        }
        target = done * 2;
    }
}

/// Errors of a row's pairs are independent and add in squares: with err² ≤ τ² A s for each, a row's error is at most
/// τ A √(Σs/A) ≤ τ A. A pair that carries strong light has its share of the square reduced accordingly.
fn allowed_error(total: f64, a: &Panel, b: &Panel, weights: [f64; 2], accuracy: &Accuracy) -> f64 {
    let area = (a.area() / weights[0]).min(b.area() / weights[1]);
    accuracy.tolerance * (total * area).sqrt()
}

/// Sums over one set of samples.
struct Set {
    /// Σ G and Σ V G.
    kernel: [f64; 2],
    /// Σ G N Nᵀ and Σ V G N Nᵀ.
    blocks: [Block; 2],
    visible: u32,
    samples: u32,
}

impl Set {
    fn new(a: &Panel, b: &Panel) -> Self {
        Self { kernel: [0.0; 2], blocks: [Block::zeros(a, b); 2], visible: 0, samples: 0 }
    }

    fn add(&mut self, x: DVec3, y: DVec3, a: &Panel, b: &Panel, hides: &dyn Fn(DVec3, DVec3) -> bool) {
        let g = geometric(x, a.normal(), y, b.normal());
        self.samples += 1;
        let visible = !hides(x, y);
        self.visible += u32::from(visible);
        self.kernel[0] += g;
        let functions = a.values(x);
        let row: [f64; MAX_DOFS] = b.values(y).map(|n| g * n);
        self.blocks[0].add(1.0, &functions, &row);
        if visible {
            self.kernel[1] += g;
            self.blocks[1].add(1.0, &functions, &row);
        }
    }

    fn visibility(&self) -> f64 {
        if self.kernel[0] > 0.0 { self.kernel[1] / self.kernel[0] } else { 0.0 }
    }
}

/// The standard error of V̄: from the spread of the sets, but never less than what one undiscovered sample would mean
/// (when all rays agree, that is the only thing known).
fn standard_error(sets: &[Set; SETS]) -> f64 {
    let n = SETS as f64;
    let mean = sets.iter().map(Set::visibility).sum::<f64>() / n;
    let variance = sets.iter().map(|s| (s.visibility() - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let samples: u32 = sets.iter().map(|s| s.samples).sum();
    (variance / n).sqrt().max(1.0 / (f64::from(samples) + 2.0))
}

fn combine(unoccluded: &Block, sets: &[Set; SETS]) -> Block {
    let samples: u32 = sets.iter().map(|s| s.samples).sum();
    let visible: u32 = sets.iter().map(|s| s.visible).sum();
    let mut block = *unoccluded;
    if visible == samples {
        return block;
    }
    let sum = |k: usize| sets.iter().map(|s| s.kernel[k]).sum::<f64>();
    let (all, seen) = (sum(0), sum(1));
    let mean = if all > 0.0 { seen / all } else { 0.0 };
    let scale = if all > 0.0 { unoccluded.sum() / all } else { 0.0 };
    for (i, value) in block.values[..unoccluded.len].iter_mut().enumerate() {
        let entry = |k: usize| sets.iter().map(|s| s.blocks[k].values[i]).sum::<f64>();
        *value = mean * *value + scale * (entry(1) - mean * entry(0));
    }
    block
}

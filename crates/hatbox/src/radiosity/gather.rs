//! Irradiance at a point, by one more application of the integral operator to the solution.
//!
//! E(x) = ∫ B̃(y) G(x, y) V(x, y) dA(y) over all panels: the iterate of I. H. Sloan ("Improvement by iteration for compact
//! operator equations", Math. Comp. 30, 1976). Half an order more accurate than B̃ itself, and independent of the
//! quadrature that S was assembled with.

use super::Solution;
use crate::assemble::{Panel, point_row};
use crate::kernel::geometric;
use crate::quadrature::sequence::{hash, point};
use crate::visibility::{Bvh, Visibility};
use glam::DVec3;

/// A ray stands for at most this solid angle, divided by the panel's strength.
const FINEST: f64 = 1e-2;
/// Rays to one panel at the most.
const MAX_RAYS: u32 = 1024;

/// Gathers irradiance from the panels of a solved scene.
pub struct Gather<'a> {
    pub(super) panels: &'a [Panel],
    pub(super) blockers: &'a Bvh,
    /// How strongly each panel's light counts; strong ones are sampled more finely.
    pub(super) strengths: &'a [f64],
    pub(super) solution: &'a Solution,
}

impl Gather<'_> {
    /// E at the point `x` of a face with unit normal `n`, per band. `surface` is the face's index (it blocks nothing),
    /// and `seed` chooses the sample points.
    pub fn irradiance(&self, x: DVec3, n: DVec3, surface: u32, seed: u64) -> Vec<f64> {
        let [sum] = self.independent(x, n, surface, [seed]);
        sum
    }

    /// The same several times over, with the rays of several seeds: the product of two independent errors has the mean
    /// 0, that of one with itself has not.
    pub fn independent<const N: usize>(&self, x: DVec3, n: DVec3, surface: u32, seeds: [u64; N]) -> [Vec<f64>; N] {
        let mut sums = std::array::from_fn(|_| vec![0.0; self.solution.bands()]);
        for (cell, panel) in self.panels.iter().enumerate() {
            if panel.surface != surface {
                self.add(cell, x, n, surface, &seeds, &mut sums);
            }
        }
        sums
    }

    /// Adds what one panel sends: the unoccluded integral times the visible share of the light, by rays whose number
    /// follows how much the panel may matter.
    fn add<const N: usize>(
        &self,
        cell: usize,
        x: DVec3,
        n: DVec3,
        surface: u32,
        seeds: &[u64; N],
        sums: &mut [Vec<f64>; N],
    ) {
        let panel = &self.panels[cell];
        let Some(row) = point_row(panel, x, n) else { return };
        let distance = (panel.center.distance(x) - panel.radius).max(0.25 * panel.radius);
        let weight = self.strengths.get(cell).copied().unwrap_or(1.0) * panel.area() / (distance * distance);
        let rays = (weight / FINEST).ceil().clamp(1.0, f64::from(MAX_RAYS)) as u32;
        let visible = seeds.map(|seed| self.visible_share(panel, x, n, surface, hash(seed, cell as u64), rays));
        if visible.iter().all(|&share| share <= 0.0) {
            return;
        }
        let functions = self.solution.space.range(cell);
        for band in 0..self.solution.bands() {
            let b = &self.solution.radiosity.band(band)[functions.clone()];
            let sent: f64 = b.iter().zip(row).map(|(b, r)| b * r).sum();
            for (sum, visible) in sums.iter_mut().zip(visible) {
                sum[band] += visible * sent;
            }
        }
    }

    /// ΣVG/ΣG over points of the panel.
    fn visible_share(&self, panel: &Panel, x: DVec3, n: DVec3, surface: u32, set: u64, rays: u32) -> f64 {
        let (mut seen, mut all) = (0.0, 0.0);
        for k in 0..rays {
            let p = point(set, k);
            let y = panel.sample(p[0], p[1]);
            let g = geometric(x, n, y, panel.normal());
            all += g;
            if g > 0.0 && !self.blockers.occluded(x, y, [surface, panel.surface]) {
                seen += g;
            }
        }
        if all > 0.0 { seen / all } else { 0.0 }
    }
}

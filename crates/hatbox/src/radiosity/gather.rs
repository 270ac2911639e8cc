//! Irradiance at a point, by one more application of the integral operator to the solution.
//!
//! E(x) = ∫ B̃(y) G(x, y) V(x, y) dA(y) over all panels: the iterate of I. H. Sloan ("Improvement by iteration for compact
//! operator equations", Math. Comp. 30, 1976). Half an order more accurate than B̃ itself, and independent of the
//! quadrature that S was assembled with. Shadows are exact: what convex polygons hide of a panel is cut out. Rays are
//! cast only where too many of them stand in the way.

use super::Solution;
use super::strengths::strengths;
use crate::assemble::{Panel, Region};
use crate::exchange::{Panorama, PointRow, Viewpoint, Views};
use crate::kernel::geometric;
use crate::quadrature::sequence::{hash, point};
use crate::visibility::{Bvh, Occluders, Visibility};
use glam::DVec3;

/// A ray stands for at most this solid angle, divided by the panel's strength.
const FINEST: f64 = 1e-2;
/// Rays to one panel at the most.
const MAX_RAYS: u32 = 1024;

/// The index of no face of any scene.
const NO_SURFACE: u32 = u32::MAX;

/// How far a point is moved into its cell, relative to the way to the middle: on an edge the plane of the other face is
/// seen from neither side.
const INWARD: f64 = 1e-4;

/// Cells of a solved scene as sources of light, and what stands before them:
///
/// E(x) = Σ_c ∫ B_c(y) G(x, y) V(x, y) dA(y),
///
/// c running over the chosen cells.
pub struct Sources<'a> {
    pub(super) solution: &'a Solution,
    pub(super) cells: Vec<usize>,
    pub(super) panels: Vec<Panel>,
    panorama: Panorama,
    pub(super) strengths: Vec<f64>,
    occluders: Occluders,
    blockers: Bvh,
}

impl<'a> Sources<'a> {
    /// All cells.
    pub fn all(solution: &'a Solution) -> Self {
        Self::of(solution, |_| true)
    }

    /// Those with a strength that is chosen: their exitance relative to the mean irradiance, and 1 at the least.
    pub(super) fn of(solution: &'a Solution, chosen: impl Fn(f64) -> bool) -> Self {
        let (scene, space) = (&solution.scene, &solution.space);
        let blockers = Bvh::of_surfaces(&scene.surfaces);
        let all = strengths(scene, &blockers);
        let cells: Vec<usize> = (0..all.len()).filter(|&cell| chosen(all[cell])).collect();
        let panels: Vec<Panel> = cells.iter().map(|&cell| Panel::of_cell(&scene.mesh, space, cell)).collect();
        Self {
            panorama: Panorama::new(&panels),
            panels,
            strengths: cells.iter().map(|&cell| all[cell]).collect(),
            cells,
            occluders: Occluders::new(&scene.surfaces),
            blockers,
            solution,
        }
    }

    pub(super) fn views(&self) -> Views<'_> {
        Views { occluders: &self.occluders, blockers: &self.blockers }
    }

    /// What arrives from them at a point of a cell (reference coordinates), per band. `seed` chooses the rays where too
    /// much stands between for shadows to be cut out.
    pub fn irradiance(&self, cell: usize, at: [f64; 2], seed: u64) -> Vec<f64> {
        let mesh = &self.solution.scene.mesh;
        let patch = mesh.patch(cell);
        let x = patch.point(at).lerp(patch.center(), INWARD);
        self.gather().irradiance(x, patch.normal(), mesh.cells[cell].surface, seed)
    }

    /// What arrives from them at a point in the air on a small area with unit normal `n`, per band.
    pub fn irradiance_in_the_air(&self, x: DVec3, n: DVec3, seed: u64) -> Vec<f64> {
        self.gather().irradiance(x, n, NO_SURFACE, seed)
    }

    fn gather(&self) -> Gather<'_> {
        Gather {
            panels: &self.panels,
            panorama: &self.panorama,
            cells: Some(&self.cells),
            views: self.views(),
            strengths: &self.strengths,
            solution: self.solution,
        }
    }
}

/// Gathers irradiance from the panels of a solved scene.
pub struct Gather<'a> {
    pub(super) panels: &'a [Panel],
    pub(super) panorama: &'a Panorama,
    /// The cell of each panel; that of the same number if not given.
    pub(super) cells: Option<&'a [usize]>,
    pub(super) views: Views<'a>,
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
        let from = Viewpoint { at: x, normal: n, surface };
        let cell = |k: usize| self.cells.map_or(k, |cells| cells[k]);
        let wanted = |k: usize| self.panels[k].surface != surface && !self.is_dark(cell(k));
        self.panorama.seen_from(&from, self.panels, &self.views, wanted, |k, row| {
            let (row, visible) = match row {
                PointRow::Exact(row) => (row, [1.0; N]),
                PointRow::Unoccluded(row) => (row, self.visible_shares(k, x, n, surface, seeds)),
            };
            for (band, sent) in self.sent(cell(k), &row) {
                for (sum, visible) in sums.iter_mut().zip(visible) {
                    sum[band] += visible * sent;
                }
            }
        });
        sums
    }

    /// Whether nothing leaves a cell.
    fn is_dark(&self, cell: usize) -> bool {
        let range = self.solution.space.range(cell);
        self.solution.radiosity.iter_bands().all(|band| band[range.clone()].iter().all(|&b| b == 0.0))
    }

    /// What arrives of a cell's light in each band, if each of its functions sends so much.
    fn sent<'b>(&'b self, cell: usize, row: &'b [f64]) -> impl Iterator<Item = (usize, f64)> + 'b {
        let functions = self.solution.space.range(cell);
        let of = move |b: &[f64]| b[functions.clone()].iter().zip(row).map(|(b, r)| b * r).sum::<f64>();
        self.solution.radiosity.iter_bands().map(of).enumerate()
    }

    /// The visible share of a panel's light by rays, whose number follows how much it may matter; one for each seed.
    fn visible_shares<const N: usize>(&self, k: usize, x: DVec3, n: DVec3, surface: u32, seeds: [u64; N]) -> [f64; N] {
        let panel = &self.panels[k];
        let Some(above) = Region::in_front(&panel.patch, x, n) else { return [0.0; N] };
        let distance = (panel.center.distance(x) - panel.radius).max(0.25 * panel.radius);
        let weight = self.strengths.get(k).copied().unwrap_or(1.0) * panel.area() / (distance * distance);
        let rays = (weight / FINEST).ceil().clamp(1.0, f64::from(MAX_RAYS)) as u32;
        seeds.map(|seed| self.visible_share(panel, &above, [x, n], surface, hash(seed, k as u64), rays))
    }

    /// ΣVG/ΣG over points of the part of the panel above the horizon of x. (A single point below it would say that nothing
    /// is visible.)
    fn visible_share(
        &self,
        panel: &Panel,
        above: &Region,
        [x, n]: [DVec3; 2],
        surface: u32,
        set: u64,
        rays: u32,
    ) -> f64 {
        let (mut seen, mut all) = (0.0, 0.0);
        for k in 0..rays {
            let p = point(set, k);
            let y = above.sample(p[0], p[1]);
            let g = geometric(x, n, y, panel.normal());
            all += g;
            if g > 0.0 && !self.views.blockers.occluded(x, y, [surface, panel.surface]) {
                seen += g;
            }
        }
        if all > 0.0 { seen / all } else { 0.0 }
    }
}

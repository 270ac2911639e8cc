//! Row sums: what a closed scene knows exactly, and how S is made to know it.
//!
//! In a closed scene everything that leaves a surface arrives somewhere: S 1 = Δ 1. Quadrature and sampling leave a
//! small deficit; multiplying the light by a function 1 + ε(x) on its way in and out, S ← Dᵀ S D with
//! D = I + Δ⁻¹ M_ε, removes it, keeps S symmetric, and leaves what is exactly zero (a walled-up room) at zero. In the
//! nodal basis of constants D is a diagonal matrix, and this is the symmetric scaling of matrices (R. Sinkhorn 1964);
//! for quadratics, whose vertex functions have the mean 0, a diagonal matrix would not do.
//!
//! ε is found by Newton's method: each step scales what the last one has left. With one derivative for all steps the
//! streets of a city were not balanced in eight of them: between walls that face each other Δ + S is nearly singular, and
//! what is left of the deficit is then not small.
//!
//! Cells of an open scene that are closed in all the same (`enclosed`) are scaled like those of a closed one. The others have no
//! row sums to go by, but rays have measured what escapes of all. Where S loses more or less than
//! the scatter of the rays allows, it is multiplied by a number: behind a small hole in a bright room, an error of 1e-3
//! of the row sums would be more than what the hole lets out.

use super::enclosed::enclosed;
use super::sealed::is_sealed;
use super::{Exchange, Geometry, Statistics};
use crate::assemble::function_weighted_mass;
use crate::kernel::{Frame, geometric};
use crate::linalg::{BlockDiagonal, Csr, LinearOperator, MultiVector};
use crate::mesh::Patch;
use crate::mesh::polygon::area_vector;
use crate::progress::{Interrupted, Progress, Silent};
use crate::quadrature::sequence::{hash, point};
use crate::scene::Scene;
use crate::solve::{self, cg};
use crate::space::FunctionSpace;
use crate::visibility::{Bvh, Hit, Visibility};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// A scene is scaled only where the row sums are off by less than this; larger deficits are an error to be found.
pub const GREATEST_DEFICIT: f64 = 0.05;
/// Rays per cell that look for a way out, at the least.
const ESCAPE_RAYS: u32 = 16;
/// Rays of all cells together, at the least: if none gets out, less than 3/200 000 of the light does (95 %).
pub(super) const ALL_ESCAPE_RAYS: usize = 200_000;
/// Faces that a ray meets within this part of its length are met together.
const TOGETHER: f64 = 1e-9;
/// A cell is large if it is more than this share of all area.
const LARGE_SHARE: f64 = 0.01;
/// Rays of lamps that are asked where they arrive, and how many must do so to be believed.
const LAMP_RAYS: u32 = 4096;
const ENOUGH_ARRIVED: usize = 64;
/// Standard deviations of rays within which they may be wrong, and not what is integrated.
const SCATTER: f64 = 3.0;
/// Relative error of the row sums up to which S counts as balanced.
const BALANCED: f64 = 1e-11;
/// Steps of the scaling: each about squares what is left of the deficit, or divides it by a million.
const STEPS: usize = 8;
/// S is not scaled where the light would have to be multiplied by more than this or less than its inverse somewhere.
const GREATEST_FACTOR: f64 = 2.0;
/// Relative residual of the equations of a step.
const STEP_RESIDUAL: f64 = 1e-6;

/// What was found about the row sums, and done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closure {
    /// Fraction of cosine-distributed rays, area-weighted, that leave the scene or end on a back; of cells that are not
    /// covered.
    pub escape: f64,
    /// Share of the area that others [cover](Geometry::covered): it sees nothing.
    pub covered: f64,
    /// 1 − 1ᵀS1/A before scaling: the same fraction, as S has it.
    pub lost: f64,
    /// Share of the area of cells that are in enclosures from which nothing escapes: 1 in a closed scene.
    pub enclosed: f64,
    /// Largest |1 − (S 1)_i/A_i| before scaling, over the cells that are enclosed, or over all if none is.
    pub deficit: f64,
    /// Whether S was scaled to exact row sums on all cells that are enclosed.
    pub balanced: bool,
    /// What S was multiplied by on the others to lose what the rays see escape; 1 in a closed scene.
    pub factor: f64,
}

/// Dᵀ S D.
pub struct Balanced {
    exchange: Box<dyn Exchange>,
    scaling: Option<Scaling>,
    /// What S is multiplied by on cells that are not enclosed.
    factor: Option<f64>,
    /// The coefficients of these, in runs; S leads from none of them to others.
    open: Vec<Range<usize>>,
    /// What was found and done.
    pub closure: Closure,
}

/// D, the product of the steps' I + Δ⁻¹ M_ε, and its transpose.
#[derive(Clone)]
struct Scaling {
    d: BlockDiagonal,
    transposed: BlockDiagonal,
}

impl Scaling {
    /// Of no step yet.
    fn none(space: &FunctionSpace) -> Self {
        let identity = BlockDiagonal::identity(space.offsets());
        Self { d: identity.clone(), transposed: identity }
    }

    /// D ← D (I + Δ⁻¹ M_ε)
    fn then(&self, mass_inverse: &BlockDiagonal, weighted: &BlockDiagonal) -> Self {
        let d = self.d.plus(&self.d.product(&mass_inverse.product(weighted)));
        let transposed = self.transposed.plus(&weighted.product(mass_inverse).product(&self.transposed));
        Self { d, transposed }
    }
}

impl Balanced {
    /// Scales S to exact row sums on cells that are enclosed, if the deficit is small; otherwise leaves it as it is.
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn new(
        exchange: Box<dyn Exchange>,
        geometry: &Geometry<'_>,
        masses: [&BlockDiagonal; 2],
        escape: &Escape,
        progress: &dyn Progress,
    ) -> Result<Self, Interrupted> {
        let (space, covered, enclosed) = (geometry.space, geometry.covered(), enclosed(&*exchange, geometry, escape));
        let [open, closed] = [false, true].map(|is| runs(space, |cell| enclosed[cell] == is));
        let ones = MultiVector::uniform(space.broken_dofs(), &[1.0]);
        let hidden = runs(space, |cell| covered[cell]);
        let sums = exchange.times_watched(&ones, progress)?;
        let rows = Rows { target: without(&masses[0].times(&ones), &hidden), sums };
        let closure = Closure {
            escape: escape.fraction,
            covered: share(geometry, covered),
            lost: rows.lost(),
            enclosed: share(geometry, &enclosed),
            deficit: rows.deficit(space, |cell| enclosed[cell] || closed.is_empty()),
            balanced: false,
            factor: 1.0,
        };
        let mut balanced = Self { exchange, scaling: None, factor: None, open, closure };
        if escape.fraction > 0.0 && balanced.exchange.is_symmetric() {
            let there = rows.without(&closed);
            balanced.factor = open_factor(&escape.of_share(there.area() / rows.area()), there.lost());
            balanced.closure.factor = balanced.factor.unwrap_or(1.0);
        }
        if !closed.is_empty() && closure.deficit < GREATEST_DEFICIT {
            let rows = rows.without(&balanced.open);
            balanced.balance(geometry.scene, space, masses, &rows);
        }
        Ok(balanced)
    }

    /// Whether S is applied as it was built.
    fn is_as_built(&self) -> bool {
        self.scaling.is_none() && self.factor.is_none()
    }

    /// Newton's method for Dᵀ S D 1 = Δ 1: since S 1 ≈ Δ 1 for the S that is scaled so far, the derivative is Δ + S.
    fn balance(
        &mut self,
        scene: &Scene,
        space: &FunctionSpace,
        [mass, mass_inverse]: [&BlockDiagonal; 2],
        rows: &Rows,
    ) {
        let (target, norm) = (&rows.target, rows.target.norms()[0]);
        let mut residual = target.clone();
        residual.add_scaled(-1.0, &rows.sums);
        self.closure.balanced = residual.norms()[0] <= BALANCED * norm;
        if self.closure.balanced || !self.exchange.is_symmetric() {
            return;
        }
        let mut scaling = Scaling::none(space);
        for _ in 0..STEPS {
            let params = solve::Params { tolerance: STEP_RESIDUAL, max_iterations: 200, ..Default::default() };
            let mut epsilon = MultiVector::zeros(target.rows(), 1);
            // An unfinished step is still a step; the next one sees what is left.
            let _ = cg(&Sum { mass, balanced: self }, mass_inverse, &residual, &mut epsilon, &params, &Silent);
            scaling = scaling.then(mass_inverse, &function_weighted_mass(scene, space, epsilon.band(0)));
            self.scaling = Some(scaling.clone());
            let before = residual.norms()[0];
            residual = self.deviation(target);
            // Rounding does not get smaller.
            if residual.norms()[0] <= 1e-14 * norm || 2.0 * residual.norms()[0] > before {
                break;
            }
        }
        let factors = scaling.d.times(&MultiVector::uniform(target.rows(), &[1.0]));
        let moderate = |&factor: &f64| factor < GREATEST_FACTOR && factor * GREATEST_FACTOR > 1.0;
        self.closure.balanced = residual.norms()[0] <= BALANCED * norm && factors.as_slice().iter().all(moderate);
        if !self.closure.balanced {
            self.scaling = None;
        }
    }

    /// Δ 1 − S 1 on cells that are enclosed.
    fn deviation(&self, target: &MultiVector) -> MultiVector {
        let mut residual = target.clone();
        residual.add_scaled(-1.0, &self.times(&MultiVector::uniform(target.rows(), &[1.0])));
        without(&residual, &self.open)
    }
}

/// Δ + S.
struct Sum<'a> {
    mass: &'a BlockDiagonal,
    balanced: &'a Balanced,
}

impl LinearOperator for Sum<'_> {
    fn rows(&self) -> usize {
        self.mass.rows()
    }
    fn cols(&self) -> usize {
        self.mass.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        self.balanced.apply(x, y);
        y.add_scaled(1.0, &self.mass.times(x));
    }
}

impl LinearOperator for Balanced {
    fn rows(&self) -> usize {
        self.exchange.rows()
    }
    fn cols(&self) -> usize {
        self.exchange.cols()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        match &self.scaling {
            None => self.exchange.apply(x, y),
            Some(Scaling { d, transposed }) => *y = transposed.times(&self.exchange.times(&d.times(x))),
        }
        if let Some(factor) = self.factor {
            for band in 0..y.bands() {
                let column = y.band_mut(band);
                self.open.iter().for_each(|run| column[run.clone()].iter_mut().for_each(|y| *y *= factor));
            }
        }
    }
}

/// How far a fraction may be wrong if so many rays have seen it: three standard deviations of independent ones.
pub fn scatter(fraction: f64, rays: f64) -> f64 {
    SCATTER * (fraction * (1.0 - fraction) / rays.max(1.0)).sqrt()
}

/// What S is to be multiplied by in an open scene; nothing if `lost` is what the rays may have seen escape.
fn open_factor(escape: &Escape, lost: f64) -> Option<f64> {
    let factor = (1.0 - escape.fraction) / (1.0 - lost);
    let believed = (lost - escape.fraction).abs() > escape.scatter && (factor - 1.0).abs() < GREATEST_DEFICIT;
    believed.then_some(factor)
}

impl Exchange for Balanced {
    fn kind(&self) -> &'static str {
        self.exchange.kind()
    }

    fn statistics(&self) -> Statistics {
        self.exchange.statistics()
    }

    fn is_symmetric(&self) -> bool {
        self.exchange.is_symmetric()
    }

    fn escape(&self) -> Option<f64> {
        self.exchange.escape()
    }

    // Only symmetric operators are scaled, and only others are noisy.
    fn steady(&self, x: &MultiVector) -> Option<MultiVector> {
        self.exchange.steady(x)
    }

    fn steady_noise(&self, x: &MultiVector) -> Option<MultiVector> {
        self.exchange.steady_noise(x)
    }

    fn spread(&self, x: &MultiVector, progress: &dyn Progress) -> Result<Option<MultiVector>, Interrupted> {
        self.exchange.spread(x, progress)
    }

    // Those that are sampled are not scaled.
    fn times_watched(&self, x: &MultiVector, progress: &dyn Progress) -> Result<MultiVector, Interrupted> {
        if self.is_as_built() { self.exchange.times_watched(x, progress) } else { Ok(self.times(x)) }
    }

    fn times_joined(
        &self,
        [c, transpose]: [&Csr; 2],
        x: &MultiVector,
        progress: &dyn Progress,
    ) -> Result<MultiVector, Interrupted> {
        if self.is_as_built() {
            self.exchange.times_joined([c, transpose], x, progress)
        } else {
            super::one_after_the_other(self, [c, transpose], x, progress)
        }
    }

    fn row_errors(&self) -> Option<&[f64]> {
        self.exchange.row_errors()
    }

    fn irradiance(&self, cell: usize, at: [f64; 2], x: &MultiVector, seed: u64) -> Option<Vec<f64>> {
        self.exchange.irradiance(cell, at, x, seed)
    }
}

/// The coefficients of some cells, in runs.
fn runs(space: &FunctionSpace, counts: impl Fn(usize) -> bool) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for range in (0..space.cells()).filter(|&cell| counts(cell)).map(|cell| space.range(cell)) {
        match runs.last_mut() {
            Some(last) if last.end == range.start => last.end = range.end,
            _ => runs.push(range),
        }
    }
    runs
}

/// A vector with zeros at runs.
fn without(x: &MultiVector, runs: &[Range<usize>]) -> MultiVector {
    let mut x = x.clone();
    for run in runs {
        x.band_mut(0)[run.clone()].fill(0.0);
    }
    x
}

/// The share of some cells in all area.
fn share(geometry: &Geometry<'_>, counts: &[bool]) -> f64 {
    let area = |(cell, _): (usize, _)| geometry.scene.mesh.patch(cell).area();
    let area: f64 = counts.iter().enumerate().filter(|(_, counts)| **counts).map(area).sum();
    if area > 0.0 { area / geometry.scene.mesh.area() } else { 0.0 }
}

/// What row sums should be, Δ 1 but for what is covered, and are, S 1.
struct Rows {
    target: MultiVector,
    sums: MultiVector,
}

impl Rows {
    fn without(&self, runs: &[Range<usize>]) -> Self {
        Self { target: without(&self.target, runs), sums: without(&self.sums, runs) }
    }

    fn area(&self) -> f64 {
        self.target.band(0).iter().sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// The share of the light of cells that glow alike that arrives nowhere.
    fn lost(&self) -> f64 {
        1.0 - self.sums.band(0).iter().sum::<f64>() / self.area()
    }

    /// The largest relative deficit of a cell's row sum, of those that count and have one.
    fn deficit(&self, space: &FunctionSpace, counts: impl Fn(usize) -> bool) -> f64 {
        let deficit = |cell: usize| {
            let [target, sum] = [&self.target, &self.sums].map(|x| x.band(0)[space.range(cell)].iter().sum::<f64>());
            if target == 0.0 { 0.0 } else { (1.0 - sum / target).abs() }
        };
        (0..space.cells()).filter(|&cell| counts(cell)).map(deficit).fold(0.0, f64::max)
    }
}

/// How much of the light of uniformly glowing cells leaves a scene, by rays.
#[derive(Debug, Clone, PartialEq)]
pub struct Escape {
    /// The fraction of it.
    pub fraction: f64,
    /// How far that may be wrong: three standard deviations. Each cell has as many rays, so that it is the large ones that
    /// scatter, also where all of their rays were of one mind.
    pub scatter: f64,
    /// The cells of which some did, if that is known.
    pub open: Vec<bool>,
}

impl Escape {
    /// The same of the cells with this share of the area that sees something, if nothing escapes from the others.
    fn of_share(&self, share: f64) -> Self {
        let of = |whole: f64| if share > 0.0 { whole / share } else { 0.0 };
        Self { fraction: of(self.fraction), scatter: of(self.scatter), open: Vec::new() }
    }
}

/// The fraction of the light of uniformly glowing cells that leaves the scene: [`escapes`], weighted by area. Cells that
/// others [cover](Geometry::covered) do not count.
///
/// # Errors
/// [`Interrupted`].
pub fn escape(geometry: &Geometry<'_>, seed: u64, progress: &dyn Progress) -> Result<Escape, Interrupted> {
    let fractions = escapes(geometry, 0, seed, progress)?;
    let (mesh, covered) = (&geometry.scene.mesh, geometry.covered());
    let seeing = || fractions.iter().enumerate().filter(|&(cell, _)| !covered[cell]);
    let area = seeing().map(|(cell, _)| mesh.patch(cell).area()).sum::<f64>().max(f64::MIN_POSITIVE);
    let shares = || seeing().map(|(cell, fraction)| (mesh.patch(cell).area() / area, fraction));
    let rays = f64::from(rays_per_cell(fractions.len(), 0));
    let doubted = |share: f64, fraction: f64| {
        if share > LARGE_SHARE { (fraction * rays + 1.0) / (rays + 2.0) } else { fraction }
    };
    let squares = shares().map(|(share, &fraction)| (share * scatter(doubted(share, fraction), rays)).powi(2));
    Ok(Escape {
        fraction: shares().map(|(share, fraction)| share * fraction).sum(),
        scatter: squares.sum::<f64>().sqrt(),
        open: fractions.iter().zip(covered).map(|(&fraction, &covered)| fraction > 0.0 && !covered).collect(),
    })
}

/// How much of what a scene's lamps emit arrives at its surfaces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arriving {
    /// The fraction.
    pub fraction: f64,
    /// Whether that is what arrives at cells that emit nothing: few rays of lamps arrive at any.
    pub elsewhere: bool,
}

/// The fraction of what cells emit that arrives at a side of a face that receives light; `powers` are those of the cells. Where few
/// rays of lamps do, these are far or hidden, and segments between them and what emits nothing tell more.
pub fn arriving(scene: &Scene, blockers: &Bvh, powers: &[f64]) -> Arriving {
    if powers.iter().sum::<f64>() <= 0.0 {
        return Arriving { fraction: 1.0, elsewhere: false };
    }
    let (mesh, receives, lamps) = (&scene.mesh, receiving_sides(scene), by_weight(powers));
    let arrives = |&(k, cell): &(u32, usize)| {
        let (origin, direction) = cosine_ray(&mesh.patch(cell), point(0x006c_6967_6874, k));
        let own = mesh.cells[cell].surface;
        let hit = blockers.closest_hit(origin, direction, f64::INFINITY, |id, _| id != own);
        hit.is_some_and(|hit| receives[hit.id as usize][usize::from(!hit.front)])
    };
    let arrived = (0..).zip(lamps.iter().copied()).filter(arrives).count();
    let by_rays = arrived as f64 / f64::from(LAMP_RAYS);
    let area = |cell: usize| if powers[cell] == 0.0 { mesh.patch(cell).area() } else { 0.0 };
    let dark: Vec<f64> = (0..mesh.cells.len()).map(area).collect();
    if arrived >= ENOUGH_ARRIVED || dark.iter().all(|&area| area == 0.0) {
        return Arriving { fraction: by_rays.max(1.0 / f64::from(LAMP_RAYS)), elsewhere: false };
    }
    let seen = seen_by(scene, blockers, &lamps, &dark);
    // What neither has found is at most what one ray would mean.
    let fraction = if seen > 0.0 { seen.max(by_rays) } else { by_rays.max(1.0 / f64::from(LAMP_RAYS)) };
    Arriving { fraction, elsewhere: true }
}

/// A G V on the average between these cells and others with such areas, A in all.
fn seen_by(scene: &Scene, blockers: &Bvh, lamps: &[usize], areas: &[f64]) -> f64 {
    let (mesh, receivers) = (&scene.mesh, by_weight(areas));
    let share = |k: u32| {
        // Lamps in the order of the scene, receivers in one that has nothing to do with it.
        let other = k.reverse_bits() >> (u32::BITS - LAMP_RAYS.ilog2());
        let cells = [lamps[k as usize], receivers[other as usize]];
        let ([u, v, s, t], [a, b]) = (point(0x7061_6972, k), cells.map(|cell| mesh.patch(cell)));
        let (x, y) = (a.point(a.shape().uniform([u, v])), b.point(b.shape().uniform([s, t])));
        let g = geometric(x, a.normal(), y, b.normal());
        let hidden = g <= 0.0 || blockers.occluded(x, y, cells.map(|cell| mesh.cells[cell].surface));
        if hidden { 0.0 } else { g }
    };
    let mean = (0..LAMP_RAYS).map(share).sum::<f64>() / f64::from(LAMP_RAYS);
    (mean * areas.iter().sum::<f64>()).min(1.0)
}

/// [`LAMP_RAYS`] cells, each as often as its weight has it.
fn by_weight(weights: &[f64]) -> Vec<usize> {
    let mut all = 0.0;
    let mut end = |weight: &f64| {
        all += weight;
        all
    };
    let ends: Vec<f64> = weights.iter().map(&mut end).collect();
    let share = |k: u32| all * (f64::from(k) + 0.5) / f64::from(LAMP_RAYS);
    (0..LAMP_RAYS).map(|k| ends.partition_point(|&end| end <= share(k)).min(weights.len() - 1)).collect()
}

/// For each cell the fraction of cosine rays that hit nothing, or a side of a face that receives nothing; all of those of a
/// cell that is covered. At least `rays` are cast from each; if that is none, and the topology of the scene says that it is closed,
/// there are none.
///
/// # Errors
/// [`Interrupted`].
pub fn escapes(
    geometry: &Geometry<'_>,
    rays: u32,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Vec<f64>, Interrupted> {
    if rays == 0 && is_sealed(geometry) {
        return Ok(vec![0.0; geometry.scene.mesh.cells.len()]);
    }
    measured(geometry, rays, seed, progress)
}

/// [`escapes`], by rays whatever is known.
pub(super) fn measured(
    geometry: &Geometry<'_>,
    rays: u32,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Vec<f64>, Interrupted> {
    let (receives, covered) = (receiving_sides(geometry.scene), geometry.covered());
    let count = rays_per_cell(covered.len(), rays);
    let lost = |cell: usize| {
        if covered[cell] {
            return Ok(1.0);
        }
        let escaped = (0..count).filter(|&k| gets_away(geometry, &receives, cell, seed, k)).count() as f64;
        if progress.interrupted() { Err(Interrupted) } else { Ok(escaped / f64::from(count)) }
    };
    (0..covered.len()).into_par_iter().map(lost).collect()
}

/// Whether the k-th ray from a cell hits nothing, or a side of a face that receives nothing.
pub(super) fn gets_away(geometry: &Geometry<'_>, receives: &[[bool; 2]], cell: usize, seed: u64, k: u32) -> bool {
    let (patch, surface) = (geometry.scene.mesh.patch(cell), geometry.scene.mesh.cells[cell].surface);
    let (origin, direction) = cosine_ray(&patch, point(hash(seed ^ 0x6573_6361, cell as u64), k));
    let lit = |id: u32, front: bool| receives[id as usize][usize::from(!front)];
    let hit = first_face(geometry.blockers, [origin, direction], surface, lit);
    !hit.is_some_and(|hit| lit(hit.id, hit.front))
}

/// The first face that a ray from a point of a surface meets. Where a lit side and an unlit one are met together, as the two
/// faces of a wall without thickness, it is the lit one: which of them is nearer is a matter of rounding.
pub(super) fn first_face(
    blockers: &Bvh,
    [origin, direction]: [DVec3; 2],
    surface: u32,
    lit: impl Fn(u32, bool) -> bool,
) -> Option<Hit> {
    let first = blockers.closest_hit(origin, direction, f64::INFINITY, |id, _| id != surface)?;
    if lit(first.id, first.front) {
        return Some(first);
    }
    let together = |hit: &Hit| lit(hit.id, hit.front) && hit.t <= first.t * (1.0 + TOGETHER);
    let apart = |id: u32, _| id != surface && id != first.id;
    Some(blockers.closest_hit(origin, direction, f64::INFINITY, apart).filter(together).unwrap_or(first))
}

/// Rays of [`escapes`] from each cell, `least` at the least.
pub fn rays_per_cell(cells: usize, least: u32) -> u32 {
    let enough = ALL_ESCAPE_RAYS.div_ceil(cells.max(1)) as u32;
    enough.max(ESCAPE_RAYS).max(least)
}

/// Whether the front and the back of each face of the input receive light.
pub(super) fn receiving_sides(scene: &Scene) -> Vec<[bool; 2]> {
    let mut receives = vec![[false; 2]; scene.surfaces.len()];
    let fronts: Vec<DVec3> = scene.surfaces.iter().map(|surface| area_vector(surface.corners())).collect();
    for (index, cell) in scene.mesh.cells.iter().enumerate() {
        let front = fronts[cell.surface as usize].dot(scene.mesh.patch(index).normal()) > 0.0;
        receives[cell.surface as usize][usize::from(!front)] = true;
    }
    receives
}

/// A uniform point of a cell and a cosine-distributed direction from it.
pub(super) fn cosine_ray(patch: &Patch, [u, v, s, t]: [f64; 4]) -> (DVec3, DVec3) {
    (patch.point(patch.shape().uniform([u, v])), Frame::about(patch.normal()).cosine(s, t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::{ALL, Shape};
    use crate::mesh::{Cell, Mesh};
    use crate::scene::{Material, Physics};
    use std::sync::{Arc, OnceLock};

    /// That all rays of a large cell are of one mind leaves room for what one more would have said.
    #[test]
    fn what_escapes_of_a_large_cell_is_never_known_for_sure() {
        let vertices = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
        let cell = Cell { shape: Shape::Quad, vertices: [0, 1, 2, 3], material: 0, group: 0, surface: 0 };
        let mesh = Mesh { vertices, cells: vec![cell], groups: vec![String::new()], ..Mesh::default() };
        let scene = Scene::new(mesh, vec![Material::diffuse("sheet", 0.5)], Physics::Light, None).expect("valid");
        let space = FunctionSpace::broken(&scene.mesh, &ALL[0]).expect("an element");
        let (panels, blockers) = (OnceLock::new(), Arc::new(Bvh::of_surfaces(&scene.surfaces)));
        let found = escape(&Geometry::new(&scene, &space, &blockers, &panels), 0, &Silent).expect("not stopped");
        assert!((found.fraction - 1.0).abs() < 1e-12 && found.scatter > 1e-6 && found.scatter < 1e-3, "{found:?}");
    }
}

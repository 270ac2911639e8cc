//! Cosine rays from every cell, and lamps for themselves: time and memory grow like the number of cells.
//!
//! K rays leave each cell, from the points of a net and in cosine-distributed directions, and each remembers where it
//! ended in 5 bytes. (S b)_k = ∫N_k E is then Δ e, where the coefficients e are fitted to the values B(y_r) that the rays
//! bring back, by least squares with the sampled Gram matrix (`fit`). Nothing is singular, nothing is special near
//! edges, and a cell in a closed scene gets exactly what all others send: S 1 = Δ 1 to rounding, without any scaling.
//! Cells that are neighbours have neighbouring blocks of one net, so that what they have in common, the functions that join
//! them and the light that they send on together, is sampled by a finer net.
//!
//! Small strong lamps are the weakness of such rays, so lamps send their mean exitance deterministically (`lamps`): with
//! f the irradiance from lamps of exitance 1 and ē the fit to the rays that met no lamp,
//!
//! ```text
//! e = Σ_lamps f_l · mean_l(b)  +  (1 − f) ē  +  fit of (b − mean_l(b)) over the rays that met lamps
//! ```
//!
//! so that constants still come back exactly, and the operator is one fixed linear map: it holds no emission, only the
//! choice of which faces are lamps.
//!
//! **S is not symmetric**, only nearly. Averaging the rays' matrix T with its transpose was considered: Tᵀ counts how
//! many rays hit a cell, so that it brings back the noise of a count (12 % at 64 rays on cells of equal size, more on
//! small ones) into constants, which T has exact; a balancing of the row sums would then have to undo what need not have
//! happened. So the equation is solved for as one that is not symmetric.
//!
//! On open ground most rays end in the sky. To cast them only below each cell's horizon, of which a few sectors had proven bounds,
//! was tried and dropped: rays of the time that it takes to find horizons take more of the error away. To have more of them leave
//! near the horizon, at all cells alike, and count less, was as good as nothing: how many meet something falls slowly with the
//! height, and more for one cell than for another.
//!
//! Rays are stored cell by cell while they fit into the memory that is allowed, and those of the other cells are cast
//! again whenever the operator is applied. What all of them take, and what lamps leave them, is known in the end; it is guessed
//! before by some cells where it matters, and the last of the rays are forgotten if it was too little.

mod cells;
mod fit;
mod kept;
mod lamp_tree;
mod lamps;
mod pass;
mod product;
mod rays;
mod source;
mod spots;
mod strong;
mod sums;

use super::hierarchical::{Linked, Links};
use super::{Exchange, ExchangeError, Geometry, Hierarchical, Params, Statistics, size};
use crate::element::Element;
use crate::kernel::Frame;
use crate::linalg::{Csr, LinearOperator, MultiVector};
use crate::mesh::Cell;
use crate::progress::{Interrupted, Progress, Silent, Stage};
use crate::quadrature::sequence::{hash, point, unit};
pub(super) use cells::Cells;
use cells::Locator;
use fit::{Matrix, Take, add_outer, factor, mean_mass, solve, variance};
use glam::DVec3;
use kept::{Expected, Hits, Received, Traced};
use lamps::{Entry, Lamps, Receivers};
use rayon::prelude::*;
use rays::{Hit, Points, Tracer};
use spots::Spots;
use std::ops::Range;
use std::sync::Arc;

/// Cells per piece of work.
const CHUNK: usize = 256;
/// Rays by which it is guessed what all take, a fraction of a second's, and the least of cells.
const GUESSED_BY: usize = 1 << 18;
const LEAST_GUESSED_BY: usize = 64;
/// Fewest and most rays of a cell.
const RAYS: [u32; 2] = [8, 1 << 16];
/// What is joined across cells errs by about this times K^(−2/3) of the light that rays bring: nets converge faster than
/// K^(−1/2), in spite of the edges that rays see. On the Cornell box with 581 elements, against the dense operator:
/// 6.9, 2.8, 1.1, 0.54, 0.31 % with 16, 64, … 4096 rays (bench `operators`).
const ERROR_OF_ONE: f64 = 0.45;
/// Rays of a point of a cell to lamps, as a fraction of the rays of a cell, and at the least.
const LAMP_SHARE: u32 = 16;
const LEAST_LAMP_RAYS: u32 = 4;
/// Rays of one point when its irradiance is asked for.
const POINT_RAYS: u32 = 1024;
const POINT_LAMP_RAYS: u32 = 256;

/// The rays of a scene.
#[derive(Debug)]
pub struct Sampled {
    cells: Cells,
    tracer: Tracer,
    lamps: Lamps,
    links: Option<Links>,
    /// D 1 as coefficients: the share of the light of each cell that comes through links.
    linked: Vec<f64>,
    tables: Vec<Table>,
    rays: u32,
    /// The hits of the first cells, a chunk each.
    stored: Vec<Hits>,
    /// What cells get from lamps, for each chunk.
    direct: Vec<Received>,
    escape: f64,
    statistics: Statistics,
    /// Of what decides where rays go.
    digest: u64,
}

/// What is the same for all cells of an element.
#[derive(Debug)]
struct Table {
    element: &'static Element,
    points: Points,
    spots: Spots,
    receivers: Receivers,
    /// ∫N_i N_j divided by the area.
    mass: Matrix,
    /// λ times the variance.
    ridge: Matrix,
    /// The mean of N Nᵀ over the rays that [`Take`] takes plus the ridge, and its Cholesky factor.
    gram: [Matrix; 3],
    factor: [Matrix; 3],
}

impl Table {
    fn new(element: &'static Element, rays: u32, seed: u64) -> Self {
        let points = Points::new(element, rays, seed);
        let (mass, n) = (mean_mass(element, None), element.dofs());
        let ridge = variance(&mass).map(|row| row.map(|entry| entry / f64::from(rays)));
        let gram = [Take::All, Take::FirstHalf, Take::SecondHalf].map(|take| {
            let mut gram = ridge;
            let taken = &points.functions[take.of(rays as usize)];
            for functions in taken {
                add_outer(&mut gram, 1.0 / taken.len() as f64, &functions[..n]);
            }
            gram
        });
        let factor = gram.map(|gram| factor(gram, n));
        let spots = Spots::new(element);
        let receivers = Receivers::new(element, &points, &factor);
        Self { element, points, spots, receivers, mass, ridge, gram, factor }
    }
}

impl Sampled {
    /// The word that selects it.
    pub const NAME: &'static str = "sampled";

    /// Casts the rays.
    ///
    /// # Errors
    /// [`ExchangeError::Interrupted`].
    pub fn new(geometry: &Geometry<'_>, params: &Params, progress: &dyn Progress) -> Result<Self, ExchangeError> {
        let cells = Cells::new(&geometry.scene.mesh, geometry.space);
        let lamps = Lamps::new(geometry, &cells, params);
        Self::of(cells, lamps, None, geometry, params, progress)
    }

    /// Links clusters of cells and casts rays for what the links do not carry: the hierarchical operator.
    ///
    /// # Errors
    /// [`ExchangeError::Interrupted`].
    pub fn linked(geometry: &Geometry<'_>, params: &Params, progress: &dyn Progress) -> Result<Self, ExchangeError> {
        let cells = Cells::new(&geometry.scene.mesh, geometry.space);
        let lamps = Lamps::new(geometry, &cells, params);
        let take = |cell: usize| lamps.of(cell).is_none() && !geometry.covered()[cell];
        let links = Links::new(geometry, &cells, &take, params, progress)?;
        Self::of(cells, lamps, Some(links), geometry, params, progress)
    }

    fn of(
        cells: Cells,
        lamps: Lamps,
        links: Option<Links>,
        geometry: &Geometry<'_>,
        params: &Params,
        progress: &dyn Progress,
    ) -> Result<Self, ExchangeError> {
        let linked = links.as_ref().map_or_else(Vec::new, |links| shares(&cells, links));
        let rays = rays_for(params.tolerance, unlinked(&cells, &linked));
        let locator = Locator::new(geometry.scene, &cells);
        let is_lamp = |cell: usize| lamps.of(cell).is_some();
        let seed = hash(params.seed, 0);
        let is_covered = |cell: usize| geometry.covered()[cell];
        let blockers = Arc::clone(geometry.blockers);
        let tracer = Tracer::new(blockers, locator, [&is_lamp, &is_covered], cells.order(), rays, seed);
        let mut tables: Vec<Table> = Vec::new();
        for cell in 0..cells.len() {
            if !tables.iter().any(|table| std::ptr::eq(table.element, cells.element(cell))) {
                tables.push(Table::new(cells.element(cell), rays, seed));
            }
        }
        let digest = digest(geometry, params);
        let statistics = Statistics::default();
        let (stored, direct) = (Vec::new(), Vec::new());
        let mut sampled =
            Self { cells, tracer, lamps, links, linked, tables, rays, stored, direct, escape: 0.0, statistics, digest };
        let needed = sampled.cast(params.memory, progress)?;
        sampled.keep_within(params.memory, needed, progress);
        sampled.statistics.visibility_error = sampled.measured_error(progress)?;
        Ok(sampled)
    }

    /// Casts all rays, and stores as many as so many bytes are thought to have room for; how many bytes all would take, if it was guessed.
    fn cast(&mut self, memory: usize, progress: &dyn Progress) -> Result<usize, Interrupted> {
        let stage = Stage::begin(progress, "casting rays", self.cells.len() as u64);
        let chunks = self.cells.len().div_ceil(CHUNK);
        let of_cells = self.bytes_of_cells();
        let [keep, needed] = self.chunks_within(memory.saturating_sub(of_cells), progress)?;
        let keep = keep.min(chunks);
        let trace = |chunk: usize| {
            let expected = self.expected(chunk, keep);
            let known = progress.recall(chunk as u64).and_then(|bytes| Traced::from_bytes(&bytes, &expected));
            let trace = || {
                let traced = self.trace(self.chunk(chunk), chunk < keep, progress)?;
                if progress.keeps() {
                    progress.keep(chunk as u64, &traced.to_bytes(self.digest));
                }
                Ok(traced)
            };
            let traced = known.map_or_else(trace, Ok)?;
            progress.advance(self.chunk(chunk).len() as u64);
            Ok(traced)
        };
        let traced: Vec<Traced> = (0..chunks).into_par_iter().map(trace).collect::<Result<_, _>>()?;
        drop(stage);
        let area: f64 = traced.iter().map(|t| t.area).sum();
        self.escape = if area > 0.0 { traced.iter().map(|t| t.lost).sum::<f64>() / area } else { 0.0 };
        self.statistics.rays = traced.iter().map(|t| t.rays).sum();
        for traced in traced {
            if self.stored.len() < keep {
                self.stored.push(traced.hits);
            }
            self.direct.push(traced.received);
        }
        self.statistics.pairs = self.links.as_ref().map_or(0, Links::len) as u64;
        self.statistics.clear_pairs = self.statistics.pairs;
        self.statistics.quadrature_error = self.links.as_ref().map_or(0.0, Links::error);
        Ok(of_cells + needed)
    }

    /// Forgets the last of the rays until all that is stored takes no more than so many bytes.
    fn keep_within(&mut self, memory: usize, needed: usize, progress: &dyn Progress) {
        let stored: usize = self.stored.iter().map(Hits::bytes).sum();
        let direct: usize = self.direct.iter().map(Received::bytes).sum();
        self.statistics.bytes = stored + direct + self.bytes_of_cells();
        let needed = size(needed.max(self.statistics.bytes));
        while self.statistics.bytes > memory
            && let Some(last) = self.stored.pop()
        {
            self.statistics.bytes -= last.bytes();
        }
        let recast = self.cells.len().saturating_sub(self.stored.len() * CHUNK);
        self.statistics.recast = recast as f64 / self.cells.len().max(1) as f64;
        let [bytes, allowed] = [self.statistics.bytes, memory].map(size);
        if recast > 0 {
            let share = 100.0 * self.statistics.recast;
            progress.warn(&format!(
                "the rays of {share:.0} % of the elements do not fit into {allowed} of memory and are cast again for each product; \
                 about {needed} would hold all"
            ));
        }
        if self.statistics.bytes > memory {
            progress.warn(&format!("light of lamps, links and geometry take {bytes}, more than the {allowed} allowed"));
        }
    }

    /// What is stored of the cells, and of links.
    fn bytes_of_cells(&self) -> usize {
        let links = self.links.as_ref().map_or(0, |links| links.bytes() + size_of_val(&*self.linked));
        links + self.cells.bytes() + self.tracer.bytes()
    }

    /// Chunks whose rays so many bytes are thought to have room for beside what all cells get from lamps, and what all would take.
    fn chunks_within(&self, bytes: usize, progress: &dyn Progress) -> Result<[usize; 2], Interrupted> {
        let (cells, most) = (self.cells.len(), Hits::most_bytes(self.rays));
        // Where there is room for twice the rays, there is for lamps.
        if 2 * cells * most <= bytes {
            return Ok([usize::MAX, 0]);
        }
        let some = (GUESSED_BY / self.rays as usize).max(LEAST_GUESSED_BY).min(cells);
        let of_cell = |k: usize| {
            let cell = k * cells / some;
            let traced = self.trace(cell..cell + 1, true, progress)?;
            Ok([traced.hits.bytes(), traced.received.bytes()])
        };
        let found: Vec<[usize; 2]> = (0..some).into_par_iter().map(of_cell).collect::<Result<_, _>>()?;
        // Each stands for the cells up to the next; the first ones' rays are stored.
        let lamps: usize = found.iter().map(|[_, lamps]| lamps).sum();
        let mut left = (bytes * some / cells).saturating_sub(lamps);
        let fits = |&&[hits, _]: &&[usize; 2]| left.checked_sub(hits).map(|rest| left = rest).is_some();
        let kept = found.iter().take_while(fits).count();
        let all = found.iter().map(|[hits, lamps]| hits + lamps).sum::<usize>() * cells / some;
        Ok([if kept == some { usize::MAX } else { kept * cells / some / CHUNK }, all])
    }

    fn chunk(&self, chunk: usize) -> Range<usize> {
        chunk * CHUNK..((chunk + 1) * CHUNK).min(self.cells.len())
    }

    /// Most coefficients of a cell.
    fn width(&self) -> usize {
        self.tables.iter().map(|table| table.element.dofs()).max().unwrap_or(0)
    }

    /// What a chunk is known to be, if the rays of the first `keep` are kept.
    fn expected(&self, chunk: usize, keep: usize) -> Expected {
        let cells = self.chunk(chunk).len();
        Expected {
            cells,
            kept: if chunk < keep { cells } else { 0 },
            rays: self.rays,
            width: self.width(),
            all_cells: self.cells.len(),
            lamps: self.lamps.len(),
            digest: self.digest,
        }
    }

    fn table(&self, cell: usize) -> &Table {
        let element = self.cells.element(cell);
        let index = self.tables.iter().position(|table| std::ptr::eq(table.element, element));
        &self.tables[index.unwrap_or(0)]
    }

    fn linked_with(&self, cell: usize) -> Linked<'_> {
        self.links.as_ref().map_or(Linked::NONE, |links| links.linked_with(cell))
    }

    /// D x, if there are links.
    fn through_links(&self, x: &MultiVector) -> Option<MultiVector> {
        self.links.as_ref().map(|links| links.apply(&self.cells, x))
    }

    /// S x as each half of the rays has it.
    fn halves(&self, x: &MultiVector, progress: &dyn Progress) -> Result<[MultiVector; 2], Interrupted> {
        let half = |take| self.times_with(x, take, progress);
        Ok([half(Take::FirstHalf)?, half(Take::SecondHalf)?])
    }

    /// The relative error of the mean irradiance of cells, from the two halves of the rays, if every face of the input
    /// shines with a strength of its own between 0 and 2.
    fn measured_error(&self, progress: &dyn Progress) -> Result<f64, Interrupted> {
        let mut x = MultiVector::zeros(self.rows(), 1);
        for cell in 0..self.cells.len() {
            let strength = 2.0 * unit(hash(0x6661_6365, u64::from(self.cells.surface(cell))));
            x.band_mut(0)[self.cells.range(cell)].fill(strength);
        }
        let [mut first, second] = self.halves(&x, progress)?;
        let square = |v: &MultiVector| -> f64 {
            let of = |cell: usize| v.band(0)[self.cells.range(cell)].iter().sum::<f64>().powi(2);
            (0..self.cells.len()).map(|cell| of(cell) / self.cells.area(cell)).sum()
        };
        first.add_scaled(1.0, &second);
        let norm = square(&first);
        first.add_scaled(-2.0, &second);
        Ok(if norm > 0.0 { (square(&first) / norm).sqrt() } else { 0.0 })
    }

    fn trace(&self, cells: Range<usize>, keep: bool, progress: &dyn Progress) -> Result<Traced, Interrupted> {
        let k = self.rays as usize;
        let (mut kept, mut hits) = (Hits::new(self.rays), vec![Hit::LOST; k]);
        let mut received = Received::new(self.width());
        let (mut rays, mut area, mut lost) = (0, 0.0, 0.0);
        for cell in cells {
            if progress.interrupted() {
                return Err(Interrupted);
            }
            let table = self.table(cell);
            self.tracer.trace(&self.cells, cell, &table.points, self.linked_with(cell), &mut hits);
            let cell_area = self.cells.area(cell);
            let escaped = hits.iter().filter(|hit| hit.is_lost()).count();
            if !self.tracer.is_covered(cell) {
                (area, lost) = (area + cell_area, lost + cell_area * escaped as f64 / k as f64);
            }
            if keep {
                kept.push(&hits);
            }
            let (found, cast) = self.lit(cell);
            received.push(&found);
            rays += u64::from(self.rays) + cast;
        }
        received.shrink();
        kept.shrink();
        Ok(Traced { hits: kept, received, rays, area, lost })
    }

    /// What a cell gets from lamps, and the number of rays that were cast.
    fn lit(&self, cell: usize) -> (Vec<Entry>, u64) {
        if self.tracer.is_covered(cell) {
            return (Vec::new(), 0);
        }
        let budget = (self.rays / LAMP_SHARE).max(LEAST_LAMP_RAYS);
        self.lamps.at_cell(&self.cells, cell, &self.table(cell).receivers, budget, &self.tracer)
    }

    /// The value of one band where a ray ended.
    fn value(&self, column: &[f64], hit: Hit) -> f64 {
        if hit.is_lost() {
            return 0.0;
        }
        let functions = self.table(hit.cell()).spots.functions(hit.spot());
        column[self.cells.range(hit.cell())].iter().zip(functions).map(|(x, n)| x * n).sum()
    }
}

/// Δ⁻¹ D 1.
fn shares(cells: &Cells, links: &Links) -> Vec<f64> {
    let ones = MultiVector::uniform(cells.unknowns(), &[1.0]);
    let mut shares = links.apply(cells, &ones).into_vec();
    for cell in 0..cells.len() {
        let (patch, element) = (cells.patch(cell), cells.element(cell));
        let share = &mut shares[cells.range(cell)];
        for value in share.iter_mut() {
            *value /= patch.area();
        }
        solve(&factor(mean_mass(element, Some(&patch)), element.dofs()), element.dofs(), 1, share);
    }
    shares
}

/// Of what decides where rays go: scenes whose materials are functions can be told apart by nothing else.
fn digest(geometry: &Geometry<'_>, params: &Params) -> u64 {
    let mesh = &geometry.scene.mesh;
    let start = hash(params.seed, params.tolerance.to_bits());
    let places = mesh.vertices.iter().flat_map(DVec3::to_array).fold(start, |sum, x| hash(sum, x.to_bits()));
    let of_cell = |sum: u64, cell: &Cell| {
        cell.vertices.iter().chain([&cell.surface]).fold(sum, |sum, &k| hash(sum, u64::from(k)))
    };
    params.strengths.iter().fold(mesh.cells.iter().fold(places, of_cell), |sum, x| hash(sum, x.to_bits()))
}

/// The share of the light that does not come through links: the root of its mean square over the area.
fn unlinked(cells: &Cells, linked: &[f64]) -> f64 {
    if linked.is_empty() {
        return 1.0;
    }
    let (mut square, mut area) = (0.0, 0.0);
    for cell in 0..cells.len() {
        let shares = &linked[cells.range(cell)];
        let here = cells.patch(cell).area();
        square += here * (1.0 - shares.iter().sum::<f64>() / shares.len() as f64).powi(2);
        area += here;
    }
    (square / area).sqrt()
}

/// Rays of a cell for a tolerance, if they bring such a share of the light: a power of two, so that they are a net.
pub(super) fn rays_for(tolerance: f64, share: f64) -> u32 {
    let wanted = (ERROR_OF_ONE * share / tolerance).powf(1.5);
    (wanted.clamp(f64::from(RAYS[0]), f64::from(RAYS[1])).ceil() as u32).next_power_of_two()
}

impl LinearOperator for Sampled {
    fn rows(&self) -> usize {
        self.cells.unknowns()
    }

    fn cols(&self) -> usize {
        self.cells.unknowns()
    }

    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        // Nobody listens who could interrupt it.
        if let Ok(product) = self.times_watched(x, &Silent) {
            *y = product;
        }
    }
}

impl Exchange for Sampled {
    fn kind(&self) -> &'static str {
        if self.links.is_some() { Hierarchical::NAME } else { Self::NAME }
    }

    fn statistics(&self) -> Statistics {
        self.statistics
    }

    fn is_symmetric(&self) -> bool {
        false
    }

    fn escape(&self) -> Option<f64> {
        Some(self.escape)
    }

    fn steady(&self, x: &MultiVector) -> Option<MultiVector> {
        // Light through links is not steady: neighbours have other links, and their rays bring what these leave.
        (self.lamps.len() > 0).then(|| self.lamps_alone(x))
    }

    fn steady_noise(&self, x: &MultiVector) -> Option<MultiVector> {
        self.direct.iter().any(Received::is_in_doubt).then(|| self.doubts_alone(x))
    }

    fn spread(&self, x: &MultiVector, progress: &dyn Progress) -> Result<Option<MultiVector>, Interrupted> {
        let [mut first, second] = self.halves(x, progress)?;
        first.add_scaled(-1.0, &second);
        first.scale(0.5);
        Ok(Some(first))
    }

    fn times_watched(&self, x: &MultiVector, progress: &dyn Progress) -> Result<MultiVector, Interrupted> {
        self.times_with(x, Take::All, progress)
    }

    fn times_joined(
        &self,
        [c, transpose]: [&Csr; 2],
        x: &MultiVector,
        progress: &dyn Progress,
    ) -> Result<MultiVector, Interrupted> {
        let mut y = self.joined_by_rays(c, x, progress)?;
        if let Some(links) = &self.links {
            y.add_scaled(1.0, &transpose.times(&links.apply(&self.cells, &c.times(x))));
        }
        Ok(y)
    }

    fn irradiance(&self, cell: usize, at: [f64; 2], x: &MultiVector, seed: u64) -> Option<Vec<f64>> {
        if self.tracer.is_covered(cell) {
            return Some(vec![0.0; x.bands()]);
        }
        let (patch, surface) = (self.cells.patch(cell), self.cells.surface(cell));
        let (origin, frame) = (patch.point(at), Frame::about(patch.normal()));
        let means = self.lamps.means(&self.cells, [x.bands(); 2], |dof, band| x.band(band)[dof]);
        let mut sum = vec![0.0; x.bands()];
        // What rays bring that meet no lamp, the number of them, and the rest that the others bring.
        let (mut free, mut count, mut rest) = (sum.clone(), 0_u32, sum.clone());
        for ray in 0..POINT_RAYS {
            let [s, t, ..] = point(seed, ray);
            let hit = self.tracer.cast(&self.cells, origin, frame.cosine(s, t), surface);
            let lamp = (!hit.is_lost()).then(|| self.lamps.of(hit.cell())).flatten();
            count += u32::from(lamp.is_none());
            for (band, column) in x.iter_bands().enumerate() {
                match lamp {
                    Some(lamp) => rest[band] += self.value(column, hit) - means[lamp * x.bands() + band],
                    None => free[band] += self.value(column, hit),
                }
            }
        }
        let at = (origin, patch.normal(), surface);
        let blockers = &self.tracer.blockers;
        let seen = self.lamps.irradiance(at, POINT_LAMP_RAYS, hash(seed, 1), blockers, &means, &mut sum);
        let share = (1.0 - seen) / f64::from(count.max(1));
        let bands = sum.iter().zip(free.iter().zip(&rest));
        Some(bands.map(|(sum, (free, rest))| sum + share * free + rest / f64::from(POINT_RAYS)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::{ALL, Shape};
    use crate::mesh::{Mesh, Refinement};
    use crate::progress::Silent;
    use crate::scene::{Material, Physics, Scene};
    use crate::space::FunctionSpace;
    use crate::visibility::Bvh;
    use std::sync::OnceLock;

    /// Open ground, of which all rays are lost, and a passage between two walls, of which some are, one after the other.
    fn scene(ground_first: bool) -> Scene {
        let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
        let wall = |x: f64| square.map(|[y, z]| DVec3::new(x, y, z));
        let ground = square.map(|[x, y]| DVec3::new(9.0 + x, y, 0.0));
        let mut faces = vec![wall(0.0), wall(1.0), ground];
        faces[1].reverse();
        faces.rotate_right(usize::from(ground_first));
        let mut mesh = Mesh { groups: vec![String::new()], ..Mesh::default() };
        for face in faces {
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(face);
            let vertices = [0, 1, 2, 3].map(|k| first + k);
            mesh.cells.push(Cell { shape: Shape::Quad, vertices, material: 0, group: 0, surface: 0 });
        }
        let scene = Scene::new(mesh, vec![Material::diffuse("gray", 0.5)], Physics::Light, None).expect("a scene");
        scene.refined(Refinement::Elements(30_000), &ALL[0]).expect("refined")
    }

    /// By a mean over all cells it would be too many or too few by half.
    #[test]
    fn as_many_rays_are_kept_as_there_is_room_for_whichever_cells_come_first() {
        for scene in [scene(false), scene(true)] {
            let space = FunctionSpace::broken(&scene.mesh, &ALL[0]).expect("a space");
            let (panels, blockers) = (OnceLock::new(), Arc::new(Bvh::of_surfaces(&scene.surfaces)));
            let geometry = Geometry::new(&scene, &space, &blockers, &panels);
            let sampled = Sampled::new(&geometry, &Params::new(0.1), &Silent).expect("built");
            let all: usize = sampled.stored.iter().map(Hits::bytes).sum();
            let lamps: usize = sampled.direct.iter().map(Received::bytes).sum();
            for share in [0.2, 0.5, 0.8] {
                let room = (share * all as f64) as usize;
                let [kept, needed] = sampled.chunks_within(room + lamps, &Silent).expect("not interrupted");
                let taken: usize = sampled.stored[..kept].iter().map(Hits::bytes).sum();
                let [used, guessed] = [taken as f64 / room as f64, needed as f64 / (all + lamps) as f64];
                assert!(used > 0.85 && used < 1.1 && (guessed - 1.0).abs() < 0.1, "{share}: {used} {guessed}");
            }
        }
    }
}

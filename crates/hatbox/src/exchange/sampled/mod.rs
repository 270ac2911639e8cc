//! Cosine rays from every cell, and lamps for themselves: time and memory grow like the number of cells.
//!
//! K rays leave each cell, from the points of a net and in cosine-distributed directions, and each remembers where it
//! ended in 8 bytes. (S b)_k = ∫N_k E is then Δ e, where the coefficients e are fitted to the values B(y_r) that the rays
//! bring back, by least squares with the sampled Gram matrix (`fit`). Nothing is singular, nothing is special near
//! edges, and a cell in a closed scene gets exactly what all others send: S 1 = Δ 1 to rounding, without any scaling.
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
//! happened. So the solver is GMRES.
//!
//! Rays are stored cell by cell while they fit into the memory that is allowed, and those of the other cells are cast
//! again whenever the operator is applied.

mod cells;
mod fit;
mod lamps;
mod rays;

use super::{Exchange, ExchangeError, Geometry, Params, Statistics};
use crate::element::{Element, MAX_DOFS};
use crate::linalg::{LinearOperator, MultiVector};
use crate::progress::{Interrupted, Progress};
use crate::quadrature::sequence::{hash, point};
use cells::{Cells, Interleaved, Locator};
use fit::{Matrix, add_outer, factor, mean_mass, solve, variance};
use lamps::{Entry, Lamps, Receivers};
use rayon::prelude::*;
use rays::{Frame, Hit, Points, Tracer};
use std::sync::Arc;

/// Cells per piece of work.
const CHUNK: usize = 256;
/// Fewest and most rays of a cell.
const RAYS: [u32; 2] = [16, 4096];
/// τ² times the number of rays of a cell: the fit of a cell errs by about 0.6/√K of the light that has been reflected,
/// and what is joined across cells by half of that.
const RAYS_AT_TOLERANCE: f64 = 0.0064;
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
    tables: Vec<Table>,
    rays: u32,
    /// The hits of the first cells, a chunk each.
    stored: Vec<Vec<Hit>>,
    /// Where the entries of each cell begin, for each chunk, and the entries.
    direct: Vec<(Vec<u32>, Vec<Entry>)>,
    escape: f64,
    statistics: Statistics,
}

/// What is the same for all cells of an element.
#[derive(Debug)]
struct Table {
    element: &'static Element,
    points: Points,
    receivers: Receivers,
    /// For each ray, what its value adds to each coefficient: the fit where no ray met a lamp.
    fit: Vec<[f64; MAX_DOFS]>,
    /// ∫N_i N_j divided by the area, and λ times the variance.
    mass: Matrix,
    ridge: Matrix,
}

impl Table {
    fn new(element: &'static Element, rays: u32, seed: u64) -> Self {
        let points = Points::new(element, rays, seed);
        let (mass, n, weight) = (mean_mass(element, None), element.dofs(), 1.0 / f64::from(rays));
        let ridge = variance(&mass).map(|row| row.map(|entry| entry * weight));
        let mut gram = ridge;
        points.functions.iter().for_each(|functions| add_outer(&mut gram, weight, functions));
        let l = factor(gram, n);
        let fit = |functions: &[f64; MAX_DOFS]| {
            let mut column = functions.map(|value| weight * value);
            solve(&l, n, 1, &mut column[..n]);
            column
        };
        let fit = points.functions.iter().map(fit).collect();
        Self { element, points, receivers: Receivers::new(element), fit, mass, ridge }
    }

    /// The fit to all values of a cell whose points are weighted alike.
    fn fit_all(&self, work: &mut Work, bands: usize) {
        work.fit.fill(0.0);
        let n = self.element.dofs();
        for (weights, value) in self.fit.iter().zip(work.values.chunks_exact(bands)) {
            for (fit, weight) in work.fit.chunks_exact_mut(bands).zip(&weights[..n]) {
                fit.iter_mut().zip(value).for_each(|(fit, v)| *fit += weight * v);
            }
        }
    }
}

/// What one chunk of cells yields when it is traced.
struct Traced {
    hits: Vec<Hit>,
    direct: (Vec<u32>, Vec<Entry>),
    rays: u64,
    area: f64,
    lost: f64,
}

impl Sampled {
    /// The word that selects it.
    pub const NAME: &'static str = "sampled";

    /// Casts the rays.
    ///
    /// # Errors
    /// [`ExchangeError::Interrupted`].
    pub fn new(geometry: &Geometry<'_>, params: &Params, progress: &dyn Progress) -> Result<Self, ExchangeError> {
        let rays = rays_for(params.tolerance);
        let cells = Cells::new(&geometry.scene.mesh, geometry.space);
        let locator = Locator::new(geometry.scene, &cells);
        let lamps = Lamps::new(geometry, &cells, params);
        let is_lamp = |cell: usize| lamps.of(cell).is_some();
        let tracer =
            Tracer::new(Arc::clone(geometry.blockers), locator, is_lamp, cells.len(), rays, hash(params.seed, 0));
        let mut tables: Vec<Table> = Vec::new();
        for cell in 0..cells.len() {
            if !tables.iter().any(|table| std::ptr::eq(table.element, cells.element(cell))) {
                tables.push(Table::new(cells.element(cell), rays, hash(params.seed, 0)));
            }
        }
        let chunks = cells.len().div_ceil(CHUNK);
        let of_chunk = CHUNK * rays as usize * size_of::<Hit>();
        let keep = (params.memory / of_chunk).min(chunks);
        let statistics = Statistics::default();
        let (stored, direct) = (Vec::new(), Vec::new());
        let mut sampled = Self { cells, tracer, lamps, tables, rays, stored, direct, escape: 0.0, statistics };
        sampled.cast(chunks, keep, progress)?;
        Ok(sampled)
    }

    fn cast(&mut self, chunks: usize, keep: usize, progress: &dyn Progress) -> Result<(), Interrupted> {
        progress.begin("casting rays", self.cells.len() as u64);
        let trace = |chunk: usize| {
            if progress.interrupted() {
                return Err(Interrupted);
            }
            let traced = self.trace(chunk, chunk < keep);
            progress.advance(self.chunk(chunk).len() as u64);
            Ok(traced)
        };
        let traced: Vec<Traced> = (0..chunks).into_par_iter().map(trace).collect::<Result<_, _>>()?;
        progress.end();
        let area: f64 = traced.iter().map(|t| t.area).sum();
        self.escape = if area > 0.0 { traced.iter().map(|t| t.lost).sum::<f64>() / area } else { 0.0 };
        self.statistics.rays = traced.iter().map(|t| t.rays).sum();
        for traced in traced {
            if self.stored.len() < keep {
                self.stored.push(traced.hits);
            }
            self.direct.push(traced.direct);
        }
        let stored: usize = self.stored.iter().map(|hits| hits.len() * size_of::<Hit>()).sum();
        let direct: usize =
            self.direct.iter().map(|(first, list)| 4 * first.len() + list.len() * size_of::<Entry>()).sum();
        self.statistics.bytes = stored + direct + self.cells.bytes() + self.tracer.bytes();
        self.statistics.visibility_error = (RAYS_AT_TOLERANCE / f64::from(self.rays)).sqrt();
        Ok(())
    }

    fn chunk(&self, chunk: usize) -> std::ops::Range<usize> {
        chunk * CHUNK..((chunk + 1) * CHUNK).min(self.cells.len())
    }

    fn table(&self, cell: usize) -> &Table {
        let element = self.cells.element(cell);
        let index = self.tables.iter().position(|table| std::ptr::eq(table.element, element));
        &self.tables[index.unwrap_or(0)]
    }

    fn trace(&self, chunk: usize, keep: bool) -> Traced {
        let range = self.chunk(chunk);
        let k = self.rays as usize;
        let mut hits = vec![Hit::LOST; if keep { range.len() * k } else { k }];
        let mut direct = (Vec::with_capacity(range.len() + 1), Vec::new());
        let (mut rays, mut area, mut lost) = (0, 0.0, 0.0);
        let budget = (self.rays / LAMP_SHARE).max(LEAST_LAMP_RAYS);
        for (index, cell) in range.enumerate() {
            let table = self.table(cell);
            let hits = if keep { &mut hits[index * k..(index + 1) * k] } else { &mut hits[..] };
            self.tracer.trace(&self.cells, cell, &table.points, hits);
            let cell_area = self.cells.patch(cell).area();
            let escaped = hits.iter().filter(|hit| hit.is_lost()).count();
            (area, lost) = (area + cell_area, lost + cell_area * escaped as f64 / k as f64);
            direct.0.push(direct.1.len() as u32);
            let (found, cast) = self.lamps.at_cell(&self.cells, cell, &table.receivers, budget, &self.tracer);
            direct.1.extend(found);
            rays += u64::from(self.rays) + cast;
        }
        direct.0.push(direct.1.len() as u32);
        direct.1.shrink_to_fit();
        Traced { hits: if keep { hits } else { Vec::new() }, direct, rays, area, lost }
    }

    /// y = S x, by the rays that `of` takes: all, or the even or odd ones.
    fn apply_with(&self, x: &MultiVector, y: &mut MultiVector, take: Take) {
        let bands = x.bands();
        let source = Source { x: Interleaved::new(x), means: self.lamps.means(&self.cells, x) };
        self.by_rows(bands, y, |cell, index, work| {
            self.row(cell, index, &source, take, work);
        });
    }

    /// Calls `row` for every cell with its place in its chunk, and collects the results.
    fn by_rows(&self, bands: usize, y: &mut MultiVector, row: impl Fn(usize, usize, &mut Work) + Sync) {
        let results: Vec<Vec<f64>> = (0..self.direct.len())
            .into_par_iter()
            .map(|chunk| {
                let mut out = Vec::with_capacity(self.chunk(chunk).len() * 3 * bands);
                let mut work = Work::new(self.rays as usize, bands);
                for (index, cell) in self.chunk(chunk).enumerate() {
                    row(cell, index, &mut work);
                    out.extend_from_slice(&work.result[..self.cells.element(cell).dofs() * bands]);
                }
                out
            })
            .collect();
        for band in 0..bands {
            let column = y.band_mut(band);
            let values = results.iter().flat_map(|result| result[band..].iter().step_by(bands));
            column.iter_mut().zip(values).for_each(|(y, &value)| *y = value);
        }
    }

    /// The rows of one cell: `work.result` = Δ e.
    fn row(&self, cell: usize, index: usize, source: &Source, take: Take, work: &mut Work) {
        let (table, bands, k) = (self.table(cell), source.x.bands, self.rays as usize);
        let mut cast = std::mem::take(&mut work.hits);
        let hits = if let Some(stored) = self.stored.get(cell / CHUNK) {
            &stored[index * k..(index + 1) * k]
        } else {
            self.tracer.trace(&self.cells, cell, &table.points, &mut cast);
            &cast[..]
        };
        let meets_lamp = self.bring_back(hits, source, work);
        let patch = self.cells.patch(cell);
        let affine = patch.is_affine();
        if affine && !meets_lamp && take == Take::All {
            table.fit_all(work, bands);
        } else {
            let jacobian = |ray: usize| if affine { 1.0 } else { patch.jacobian(table.points.at[ray]) / patch.area() };
            let fitting = Fitting { table, hits, take, jacobian: &jacobian, values: &work.values, bands };
            fitting.fit(|hit| !hit.is_lamp(), |hit| !hit.is_lamp(), |_, _| (), &mut work.fit);
            let less_mean = |hit: Hit, value: &mut [f64]| {
                let lamp = self.lamps.of(hit.cell()).unwrap_or(0);
                value.iter_mut().zip(&source.means[lamp * bands..]).for_each(|(v, mean)| *v -= mean);
            };
            if meets_lamp {
                fitting.fit(|_| true, Hit::is_lamp, less_mean, &mut work.rest);
            }
        }
        work.hits = cast;
        self.combine(cell, index, &source.means, meets_lamp, work);
        self.integrate(cell, bands, work);
    }

    /// `work.result` = Δ `work.fit`.
    fn integrate(&self, cell: usize, bands: usize, work: &mut Work) {
        let (table, patch) = (self.table(cell), self.cells.patch(cell));
        let own = (!patch.is_affine()).then(|| mean_mass(table.element, Some(&patch)));
        let mass = own.as_ref().unwrap_or(&table.mass);
        multiply(mass, patch.area(), table.element.dofs(), bands, &work.fit, &mut work.result);
    }

    /// The values that rays bring back, into `work.values`, and whether one of them comes from a lamp.
    fn bring_back(&self, hits: &[Hit], source: &Source, work: &mut Work) -> bool {
        let mut meets_lamp = false;
        for (hit, value) in hits.iter().zip(work.values.chunks_exact_mut(source.x.bands)) {
            if hit.is_lost() {
                value.fill(0.0);
            } else {
                source.x.evaluate(&self.cells, hit.cell(), hit.at(), value);
                meets_lamp |= hit.is_lamp();
            }
        }
        meets_lamp
    }

    /// The value of one band where a ray ended.
    fn value(&self, column: &[f64], hit: Hit) -> f64 {
        if hit.is_lost() {
            return 0.0;
        }
        let functions = self.cells.element(hit.cell()).values(hit.at());
        column[self.cells.range(hit.cell())].iter().zip(functions).map(|(x, n)| x * n).sum()
    }

    /// e = Σ f_l mean_l + (1 − Σ f_l) ē + rest, into `work.fit`, which holds ē.
    fn combine(&self, cell: usize, index: usize, means: &[f64], rest: bool, work: &mut Work) {
        let bands = work.result.len() / MAX_DOFS;
        let (first, entries) = &self.direct[cell / CHUNK];
        let entries = &entries[first[index] as usize..first[index + 1] as usize];
        for (k, fit) in work.fit.chunks_exact_mut(bands).enumerate() {
            let seen: f64 = entries.iter().map(|entry| f64::from(entry.values[k])).sum();
            for fit in fit.iter_mut() {
                *fit *= 1.0 - seen;
            }
            for entry in entries {
                let means = &means[entry.lamp as usize * bands..];
                fit.iter_mut().zip(means).for_each(|(fit, mean)| *fit += f64::from(entry.values[k]) * mean);
            }
            if rest {
                fit.iter_mut().zip(&work.rest[k * bands..]).for_each(|(fit, rest)| *fit += rest);
            }
        }
    }
}

/// Rays of a cell for a tolerance: a power of two, so that they are a net.
fn rays_for(tolerance: f64) -> u32 {
    let wanted = (RAYS_AT_TOLERANCE / (tolerance * tolerance)).clamp(f64::from(RAYS[0]), f64::from(RAYS[1]));
    // 64 for 1 %, whatever the last bit says.
    ((wanted - 1e-6).ceil() as u32).next_power_of_two()
}

/// Which rays are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Take {
    All,
    FirstHalf,
    SecondHalf,
}

/// What is applied to.
struct Source {
    x: Interleaved,
    /// For each lamp, its mean in every band.
    means: Vec<f64>,
}

/// Memory for one row at a time.
struct Work {
    hits: Vec<Hit>,
    values: Vec<f64>,
    fit: Vec<f64>,
    rest: Vec<f64>,
    result: Vec<f64>,
}

impl Work {
    fn new(rays: usize, bands: usize) -> Self {
        let coefficients = vec![0.0; MAX_DOFS * bands];
        Self {
            hits: vec![Hit::LOST; rays],
            values: vec![0.0; rays * bands],
            fit: coefficients.clone(),
            rest: coefficients.clone(),
            result: coefficients,
        }
    }
}

/// y = a M x for the bands of n rows side by side.
fn multiply(mass: &Matrix, a: f64, n: usize, bands: usize, x: &[f64], y: &mut [f64]) {
    for (row, y) in mass[..n].iter().zip(y.chunks_exact_mut(bands)) {
        for (band, y) in y.iter_mut().enumerate() {
            *y = a * (0..n).map(|j| row[j] * x[j * bands + band]).sum::<f64>();
        }
    }
}

/// A fit to the rays of one cell.
struct Fitting<'a> {
    table: &'a Table,
    hits: &'a [Hit],
    take: Take,
    /// The weight of a ray, relative to the others.
    jacobian: &'a dyn Fn(usize) -> f64,
    values: &'a [f64],
    bands: usize,
}

impl Fitting<'_> {
    fn rays(&self) -> std::ops::Range<usize> {
        let k = self.hits.len();
        match self.take {
            Take::All => 0..k,
            Take::FirstHalf => 0..k / 2,
            Take::SecondHalf => k / 2..k,
        }
    }

    /// The fit to a function at the points of the rays `on`: what the rays `of` among them bring, changed, and zero for
    /// the others.
    fn fit(
        &self,
        on: impl Fn(Hit) -> bool,
        of: impl Fn(Hit) -> bool,
        change: impl Fn(Hit, &mut [f64]),
        out: &mut [f64],
    ) {
        let bands = self.bands;
        let mut gram = self.table.ridge;
        let mut value = vec![0.0; bands];
        out.fill(0.0);
        let share = 1.0 / self.rays().len() as f64;
        for ray in self.rays() {
            let (hit, functions) = (self.hits[ray], &self.table.points.functions[ray]);
            let weight = share * (self.jacobian)(ray);
            if on(hit) {
                add_outer(&mut gram, weight, functions);
            }
            if of(hit) {
                value.copy_from_slice(&self.values[ray * bands..(ray + 1) * bands]);
                change(hit, &mut value);
                for (out, n) in out.chunks_exact_mut(bands).zip(functions) {
                    out.iter_mut().zip(&value).for_each(|(out, v)| *out += weight * n * v);
                }
            }
        }
        let n = self.table.element.dofs();
        solve(&factor(gram, n), n, bands, out);
    }
}

impl LinearOperator for Sampled {
    fn rows(&self) -> usize {
        self.cells.unknowns()
    }

    fn cols(&self) -> usize {
        self.cells.unknowns()
    }

    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        self.apply_with(x, y, Take::All);
    }
}

impl Exchange for Sampled {
    fn kind(&self) -> &'static str {
        Self::NAME
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
        let means = self.lamps.means(&self.cells, x);
        let mut y = MultiVector::zeros(self.rows(), x.bands());
        self.by_rows(x.bands(), &mut y, |cell, index, work| {
            work.fit.fill(0.0);
            self.combine(cell, index, &means, false, work);
            self.integrate(cell, x.bands(), work);
        });
        Some(y)
    }

    fn spread(&self, x: &MultiVector) -> Option<MultiVector> {
        let mut halves = [Take::FirstHalf, Take::SecondHalf].map(|take| {
            let mut y = MultiVector::zeros(self.rows(), x.bands());
            self.apply_with(x, &mut y, take);
            y
        });
        let [first, second] = &mut halves;
        first.add_scaled(-1.0, second);
        for entry in first.as_mut_slice() {
            *entry *= 0.5;
        }
        Some(std::mem::replace(first, MultiVector::zeros(0, 1)))
    }

    fn irradiance(&self, cell: usize, at: [f64; 2], x: &MultiVector, seed: u64) -> Option<Vec<f64>> {
        let (patch, surface) = (self.cells.patch(cell), self.cells.surface(cell));
        let (origin, frame) = (patch.point(at), Frame::new(&patch));
        let means = self.lamps.means(&self.cells, x);
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

//! S x, cell by cell: what the rays of a cell bring back, fitted.
//!
//! Reading B where the rays ended is what a product costs: those places lie in no order. So the coefficients stand with
//! their bands side by side, in large pages, and those of many rays are asked for before the first is used; for the usual
//! numbers of functions and bands there are loops of known length. To solve for 100 000 cells with 128 rays each, and to
//! estimate the error, took 21 s when rays were read one by one, and takes 12 s.
//!
//! The Gram matrix of the rays that count is that of all rays, which is the same for all cells of an element, less that of
//! the few that do not.

use super::cells::Cells;
use super::fit::{Matrix, Take, add_outer, factor, mean_mass, solve};
use super::rays::Hit;
use super::{CHUNK, Sampled, Table};
use crate::element::{MAX_DOFS, Shape};
use crate::linalg::{LinearOperator, MultiVector};
use crate::mesh::Patch;
use crate::visibility::Pages;
use rayon::prelude::*;
use std::ops::Range;

/// Rays whose coefficients are asked for before the first is used.
const AHEAD: usize = 64;

/// What is applied to: coefficients with the bands of each side by side.
struct Source {
    bands: usize,
    values: Pages<f64>,
    /// For each lamp, its mean in every band.
    means: Vec<f64>,
}

/// Memory for one row at a time.
struct Work {
    cast: Vec<Hit>,
    value: Vec<f64>,
    fit: Vec<f64>,
    rest: Vec<f64>,
    result: Vec<f64>,
}

/// The rays of a cell.
struct Rays<'a> {
    table: &'a Table,
    hits: &'a [Hit],
    taken: Range<usize>,
    /// Whether some met neither a lamp nor what is linked.
    free: bool,
    /// The weight of each ray relative to the mean one, on a cell whose map stretches it.
    stretch: Option<Vec<f64>>,
}

impl Rays<'_> {
    /// Whether a ray is fitted to. Where links and lamps bring all, but for rounding and their errors, what is left is as
    /// the links' rays see it.
    #[inline]
    fn counts(&self, hit: Hit) -> bool {
        !(hit.is_lamp() || (self.free && hit.is_linked()))
    }

    /// What a ray counts, if each counts `share` on average.
    #[inline]
    fn weight(&self, share: f64, ray: usize) -> f64 {
        self.stretch.as_ref().map_or(share, |stretch| share * stretch[ray])
    }

    fn share(&self) -> f64 {
        1.0 / self.taken.len() as f64
    }
}

/// What the rays of a cell have in common.
#[derive(Default)]
struct Found {
    /// Σ w N Nᵀ of the rays that do not count, if there are any.
    excluded: Option<Matrix>,
    /// Whether one met a lamp.
    lamp: bool,
}

impl Sampled {
    /// y = S x, by the rays that `take` takes.
    pub(super) fn apply_with(&self, x: &MultiVector, y: &mut MultiVector, take: Take) {
        let source = Source::new(x, self.lamps.means(&self.cells, x));
        self.by_rows(x.bands(), y, |cell, index, work| self.row(cell, index, &source, take, work));
        if let Some(linked) = self.through_links(x) {
            y.add_scaled(1.0, &linked);
        }
    }

    /// The part of S x that comes from the means of lamps and through links.
    pub(super) fn without_rays(&self, x: &MultiVector) -> MultiVector {
        let means = self.lamps.means(&self.cells, x);
        let mut y = MultiVector::zeros(self.rows(), x.bands());
        self.by_rows(x.bands(), &mut y, |cell, index, work| {
            work.fit.fill(0.0);
            self.combine(cell, index, &means, false, work);
            self.integrate(cell, x.bands(), work);
        });
        if let Some(linked) = self.through_links(x) {
            y.add_scaled(1.0, &linked);
        }
        y
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
        let (table, patch, bands) = (self.table(cell), self.cells.patch(cell), source.bands);
        let mut cast = std::mem::take(&mut work.cast);
        let hits = self.hits(cell, index, &mut cast);
        let taken = take.of(hits.len());
        let free = hits[taken.clone()].iter().any(|hit| !hit.is_lamp() && !hit.is_linked());
        let stretch = (!patch.is_affine()).then(|| table.stretch(&patch));
        let rays = Rays { table, hits, taken, free, stretch };
        let found = self.read(&rays, source, work);
        table.fit(&rays, take, &found, bands, work);
        work.cast = cast;
        self.combine(cell, index, &source.means, found.lamp, work);
        self.integrate(cell, bands, work);
    }

    /// Where the rays of a cell ended, as stored or cast again.
    fn hits<'a>(&'a self, cell: usize, index: usize, cast: &'a mut [Hit]) -> &'a [Hit] {
        let k = self.rays as usize;
        if let Some(stored) = self.stored.get(cell / CHUNK) {
            return &stored[index * k..(index + 1) * k];
        }
        self.tracer.trace(&self.cells, cell, &self.table(cell).points, self.linked_with(cell), cast);
        cast
    }

    /// [`read_some`](Self::read_some) with loops of known length, where there are.
    fn read(&self, rays: &Rays<'_>, source: &Source, work: &mut Work) -> Found {
        let element = rays.table.element;
        let alike = self.tables.len() == 1 && (element.shape == Shape::Triangle || element.dofs() == 1);
        match (element.dofs(), source.bands) {
            (1, 1) if alike => self.read_some::<1, 1>(rays, source, work),
            (1, 3) if alike => self.read_some::<1, 3>(rays, source, work),
            (3, 1) if alike => self.read_some::<3, 1>(rays, source, work),
            (3, 3) if alike => self.read_some::<3, 3>(rays, source, work),
            _ => self.read_some::<0, 0>(rays, source, work),
        }
    }

    /// Adds N(x_r) v_r of the rays that count to `work.fit`, and of those from lamps, less the lamps' means, to `work.rest`.
    /// N functions, those of linear triangles or a constant, on every cell; or any, if N is 0.
    fn read_some<const N: usize, const B: usize>(&self, rays: &Rays<'_>, source: &Source, work: &mut Work) -> Found {
        let bands = if B > 0 { B } else { source.bands };
        let n = if N > 0 { N } else { rays.table.element.dofs() };
        work.fit.fill(0.0);
        work.rest.fill(0.0);
        let value = &mut work.value[..bands];
        let (mut found, share) = (Found::default(), rays.share());
        for start in rays.taken.clone().step_by(AHEAD) {
            let some = start..(start + AHEAD).min(rays.taken.end);
            source.ask_for::<N, B>(&self.cells, &rays.hits[some.clone()]);
            for ray in some {
                let (hit, functions, weight) =
                    (rays.hits[ray], &rays.table.points.functions[ray], rays.weight(share, ray));
                let counts = rays.counts(hit);
                if !counts {
                    add_outer(found.excluded.get_or_insert_default(), weight, &functions[..n]);
                }
                let lamp = hit.is_lamp();
                if hit.is_lost() || !(counts || lamp) {
                    continue;
                }
                source.evaluate::<N, B>(&self.cells, hit, value);
                let sums = if lamp {
                    let of = self.lamps.of(hit.cell()).unwrap_or(0);
                    value.iter_mut().zip(&source.means[of * bands..]).for_each(|(v, mean)| *v -= mean);
                    found.lamp = true;
                    &mut work.rest
                } else {
                    &mut work.fit
                };
                for (sums, function) in sums.chunks_exact_mut(bands).zip(&functions[..n]) {
                    sums.iter_mut().zip(&*value).for_each(|(sum, v)| *sum += weight * function * v);
                }
            }
        }
        found
    }

    /// `work.result` = Δ `work.fit`.
    fn integrate(&self, cell: usize, bands: usize, work: &mut Work) {
        let (table, patch) = (self.table(cell), self.cells.patch(cell));
        let own = (!patch.is_affine()).then(|| mean_mass(table.element, Some(&patch)));
        let mass = own.as_ref().unwrap_or(&table.mass);
        multiply(mass, patch.area(), table.element.dofs(), bands, &work.fit, &mut work.result);
    }

    /// e = Σ f_l mean_l + (1 − Σ f_l − D 1) ē + rest, into `work.fit`, which holds ē.
    fn combine(&self, cell: usize, index: usize, means: &[f64], rest: bool, work: &mut Work) {
        let bands = work.result.len() / MAX_DOFS;
        let (first, entries) = &self.direct[cell / CHUNK];
        let entries = &entries[first[index] as usize..first[index + 1] as usize];
        for (k, fit) in work.fit.chunks_exact_mut(bands).enumerate() {
            let linked = self.linked.get(self.cells.range(cell).start + k).copied().unwrap_or(0.0);
            let seen: f64 = linked + entries.iter().map(|entry| f64::from(entry.values[k])).sum::<f64>();
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

impl Source {
    fn new(x: &MultiVector, means: Vec<f64>) -> Self {
        let bands = x.bands();
        let mut values: Pages<f64> = Pages::zeroed(x.rows() * bands);
        values.par_chunks_mut(bands.max(1)).with_min_len(1 << 14).enumerate().for_each(|(row, values)| {
            values.iter_mut().zip(x.iter_bands()).for_each(|(value, column)| *value = column[row]);
        });
        Self { bands, values, means }
    }

    /// Where the coefficients of a cell begin and how many numbers they are.
    #[inline]
    fn place<const N: usize, const B: usize>(&self, cells: &Cells, cell: usize) -> Range<usize> {
        let bands = if B > 0 { B } else { self.bands };
        let range = if N > 0 { cell * N..(cell + 1) * N } else { cells.range(cell) };
        range.start * bands..range.end * bands
    }

    /// Touches the coefficients that rays will read, so that the memory has them on their way.
    #[inline]
    fn ask_for<const N: usize, const B: usize>(&self, cells: &Cells, hits: &[Hit]) {
        let mut sum = 0.0;
        for hit in hits.iter().filter(|hit| !hit.is_lost()) {
            let values = &self.values[self.place::<N, B>(cells, hit.cell())];
            sum += values[0] + values[values.len() - 1];
        }
        std::hint::black_box(sum);
    }

    /// The function's value where a ray ended, for every band.
    #[inline]
    fn evaluate<const N: usize, const B: usize>(&self, cells: &Cells, hit: Hit, out: &mut [f64]) {
        let bands = if B > 0 { B } else { self.bands };
        let values = &self.values[self.place::<N, B>(cells, hit.cell())];
        let [x, y] = hit.at();
        if N == 1 {
            out.copy_from_slice(values);
        } else if N == 3 {
            let (a, rest) = values.split_at(bands);
            let (b, c) = rest.split_at(bands);
            for band in 0..bands {
                out[band] = (1.0 - x - y) * a[band] + x * b[band] + y * c[band];
            }
        } else {
            let functions = cells.element(hit.cell()).values([x, y]);
            out.fill(0.0);
            for (values, function) in values.chunks_exact(bands).zip(functions) {
                out.iter_mut().zip(values).for_each(|(out, value)| *out += function * value);
            }
        }
    }
}

impl Table {
    /// The Jacobian at each ray's point relative to the mean one.
    fn stretch(&self, patch: &Patch) -> Vec<f64> {
        let mean = patch.area() / patch.shape().reference_area();
        self.points.at.iter().map(|&at| patch.jacobian(at) / mean).collect()
    }

    /// From sums to coefficients, in `work.fit` and `work.rest`.
    fn fit(&self, rays: &Rays<'_>, take: Take, found: &Found, bands: usize, work: &mut Work) {
        let n = self.element.dofs();
        let own = rays.stretch.is_some().then(|| {
            let mut gram = self.ridge;
            let (share, functions) = (rays.share(), &self.points.functions);
            rays.taken.clone().for_each(|ray| add_outer(&mut gram, rays.weight(share, ray), &functions[ray][..n]));
            gram
        });
        let factor_of_all = own.map_or(self.factor[take as usize], |gram| factor(gram, n));
        if found.lamp {
            solve(&factor_of_all, n, bands, &mut work.rest);
        }
        let factor_of_counting = found.excluded.as_ref().map(|excluded| {
            let mut gram = own.unwrap_or(self.gram[take as usize]);
            for (row, excluded) in gram.iter_mut().zip(excluded) {
                row.iter_mut().zip(excluded).for_each(|(entry, excluded)| *entry -= excluded);
            }
            factor(gram, n)
        });
        solve(factor_of_counting.as_ref().unwrap_or(&factor_of_all), n, bands, &mut work.fit);
    }
}

impl Work {
    fn new(rays: usize, bands: usize) -> Self {
        let coefficients = vec![0.0; MAX_DOFS * bands];
        Self {
            cast: vec![Hit::LOST; rays],
            value: vec![0.0; bands],
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

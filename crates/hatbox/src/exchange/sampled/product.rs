//! S x, cell by cell: what the rays of a cell bring back, fitted.
//!
//! Reading B where the rays ended is what a product costs: those places lie in no order. So the coefficients stand with
//! their bands side by side, in large pages, and those of many rays are asked for before the first is used; for the usual
//! numbers of functions and bands there are loops of known length.
//!
//! To solve first with an eighth of the rays, and to correct with all of them, was tried and dropped: it took as long as
//! GMRES, since the residuals that are left are as rough as the draft's own noise, and what a cell costs besides its rays
//! is paid by drafts, too.
//!
//! The Gram matrix of the rays that count is that of all rays, which is the same for all cells of an element, less that of
//! the few that do not.

#![expect(clippy::inline_always, reason = "loops must be compiled where their lengths are known")]

use super::fit::{Matrix, Take, add_outer, factor_in_place, mean_mass, solve};
use super::kept::{Ended, Hits, Lit, Run, WORD, set_bits};
use super::pass::Parts;
use super::rays::{Hit, Kinds, Points};
use super::source::Source;
use super::sums::{Word, sum_of};
use super::{CHUNK, Sampled, Table};
use crate::element::MAX_DOFS;
use crate::linalg::{Csr, LinearOperator, MultiVector, Number};
use crate::mesh::Patch;
use crate::progress::{Interrupted, Progress};
use std::ops::Range;

/// Memory for one row at a time.
pub(super) struct Work {
    cast: Vec<Hit>,
    cast_hits: Hits,
    /// The cell whose rays were cast last, in the same pass.
    cast_of: Option<usize>,
    value: Vec<f64>,
    fit: Vec<f64>,
    rest: Vec<f64>,
    pub(super) result: Vec<f64>,
    /// Rays of a word that are read one by one.
    others: Vec<(usize, Hit)>,
}

/// The rays of a cell.
struct Rays<'a> {
    table: &'a Table,
    ended: Ended<'a>,
    taken: Range<usize>,
    /// What rays met that are not fitted to: lamps, and what is linked. Where links and lamps bring all, but for rounding and their
    /// errors, what is left is as the links' rays see it; where all met lamps, they tell what arrives, and sum to 1, which no
    /// visibility of lamps does to the last digit.
    excluded: Kinds,
    /// On a cell whose map stretches it.
    stretch: Option<Stretch>,
}

impl Rays<'_> {
    /// What a ray counts, if each counts `share` on average.
    #[inline]
    fn weight(&self, share: f64, ray: usize) -> f64 {
        self.stretch.as_ref().map_or(share, |stretch| share * stretch.weights[ray])
    }

    fn share(&self) -> f64 {
        1.0 / self.taken.len() as f64
    }

    /// Adds N(x_r) v_r of the rays of a word that count: the first ray's number, their bits, and hits. `others` gets the others.
    #[inline(always)]
    fn add_known<const N: usize, const B: usize, T: Number>(
        &self,
        source: Source<'_, T>,
        (first, bits, hits): (usize, u64, Run<'_>),
        sums: &mut [[f64; B]; N],
        others: &mut Vec<(usize, Hit)>,
    ) {
        let functions = self.stretch.as_ref().map_or(&self.table.points.functions, |stretch| &stretch.functions);
        let word = Word { functions: &functions[first..], bits, hits, excluded: self.excluded };
        let more = sum_of::<N, B, T>(&word, source, &self.table.spots, |ray, hit| others.push((first + ray, hit)));
        let share = self.share();
        sums.iter_mut().flatten().zip(more.iter().flatten()).for_each(|(sum, more)| *sum += share * more);
    }
}

/// How much each ray counts on a cell whose map stretches it.
struct Stretch {
    /// The Jacobian at each ray's point relative to the mean one.
    weights: Vec<f64>,
    /// The functions there, times that.
    functions: Vec<[f64; MAX_DOFS]>,
}

impl Stretch {
    fn new(points: &Points, patch: &Patch) -> Self {
        let mean = patch.area() / patch.shape().reference_area();
        let weights: Vec<f64> = points.at.iter().map(|&at| patch.jacobian(at) / mean).collect();
        let functions = points.functions.iter().zip(&weights).map(|(of_ray, weight)| of_ray.map(|n| weight * n));
        Self { functions: functions.collect(), weights }
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

/// Works out the rows of a cell: the cell, its place in its chunk, what is applied to, which rays count.
pub(super) type Row<T> = fn(&Sampled, usize, usize, Source<'_, T>, Take, &mut Work);

impl Sampled {
    /// S x, by the rays that `take` takes.
    pub(super) fn times_with(
        &self,
        x: &MultiVector,
        take: Take,
        progress: &dyn Progress,
    ) -> Result<MultiVector, Interrupted> {
        let (mut y, value) = (MultiVector::zeros(self.rows(), x.bands()), |dof: usize, band: usize| x.band(band)[dof]);
        self.rows_of(value, take, &mut y, |column, rows, result| column[rows].copy_from_slice(result), progress)?;
        if let Some(linked) = self.through_links(x) {
            y.add_scaled(1.0, &linked);
        }
        Ok(y)
    }

    /// Cᵀ S C x but for links, with none of the vectors of broken coefficients that are written and read once otherwise.
    pub(super) fn joined_by_rays(
        &self,
        c: &Csr,
        x: &MultiVector,
        progress: &dyn Progress,
    ) -> Result<MultiVector, Interrupted> {
        let mut y = MultiVector::zeros(c.cols(), x.bands());
        let value = |dof: usize, band: usize| c.row_times(dof, x.band(band));
        let put = |column: &mut [f64], rows: Range<usize>, result: &[f64]| {
            rows.zip(result).for_each(|(dof, &value)| c.add_row(dof, value, column));
        };
        self.rows_of(value, Take::All, &mut y, put, progress)?;
        Ok(y)
    }

    /// The part of S x that comes from the means of lamps.
    pub(super) fn lamps_alone(&self, x: &MultiVector) -> MultiVector {
        self.of_means(x, |cell, index, means, work| {
            self.combine::<0, 0>(cell, self.lamps_of(cell, index), means, false, work);
        })
    }

    /// Half of what the two halves of the points differ by in [`lamps_alone`](Self::lamps_alone).
    pub(super) fn doubts_alone(&self, x: &MultiVector) -> MultiVector {
        self.of_means(x, |cell, index, means, work| {
            let lamps = self.lamps_of(cell, index);
            for (entry, doubts) in self.direct[cell / CHUNK].doubts_of(index) {
                let bands = work.result.len() / MAX_DOFS;
                let means = &means[lamps.lamp(entry) * bands..];
                for (fit, &doubt) in work.fit.chunks_exact_mut(bands).zip(doubts) {
                    fit.iter_mut().zip(means).for_each(|(fit, mean)| *fit += f64::from(doubt) * mean);
                }
            }
        })
    }

    /// Integrates what `fit` makes of a cell, its place in its chunk and the means of lamps in x: coefficients, where there were
    /// zeros.
    fn of_means(&self, x: &MultiVector, fit: impl Fn(usize, usize, &[f64], &mut Work) + Sync) -> MultiVector {
        let parts = Parts::whole(x.bands());
        let means = self.lamps.means(&self.cells, [x.bands(), parts.lanes], |dof, band| x.band(band)[dof]);
        let mut y = MultiVector::zeros(self.rows(), x.bands());
        let row = |cell: usize, index: usize, _part: usize, work: &mut Work| {
            work.fit.fill(0.0);
            fit(cell, index, &means, work);
            self.integrate::<0, 0>(cell, parts.lanes, work);
        };
        self.by_rows(row, parts, y.as_mut_slice(), |column, rows, result| column[rows].copy_from_slice(result));
        y
    }

    /// [`row`] with loops of known length, where there are.
    pub(super) fn row_for<T: Number>(&self, lanes: usize) -> Row<T> {
        let [table] = &self.tables[..] else { return row::<0, 0, T> };
        match (table.element.dofs(), lanes) {
            (1, 1) => row::<1, 1, T>,
            (1, 4) => row::<1, 4, T>,
            (1, _) => row::<1, 0, T>,
            (3, 1) => row::<3, 1, T>,
            (3, 4) => row::<3, 4, T>,
            (4, 1) => row::<4, 1, T>,
            (4, 4) => row::<4, 4, T>,
            (6, 1) => row::<6, 1, T>,
            (6, 4) => row::<6, 4, T>,
            _ => row::<0, 0, T>,
        }
    }

    /// Where the first `count` rays of a cell end, into memory that may hold it already.
    fn cast_again(&self, cell: usize, count: usize, work: &mut Work) {
        if work.cast_of == Some(cell) {
            return;
        }
        let cast = &mut work.cast[..count];
        self.tracer.trace(&self.cells, cell, &self.table(cell).points, self.linked_with(cell), cast);
        work.cast_hits.clear();
        work.cast_hits.push(cast);
        work.cast_of = Some(cell);
    }

    /// Adds N(x_r) v_r of the rays that count to `work.fit`, and of those from lamps, less the lamps' means, to `work.rest`.
    #[inline(always)]
    fn read<const N: usize, const B: usize, T: Number>(
        &self,
        rays: &Rays<'_>,
        source: Source<'_, T>,
        work: &mut Work,
    ) -> Found {
        let [n, bands] = known::<N, B>(rays.table.element.dofs(), source.lanes());
        work.fit[..n * bands].fill(0.0);
        work.rest[..n * bands].fill(0.0);
        let mut found = Found::default();
        // Sums of rays that count, where lengths are known: they stay in registers.
        let (mut known_fit, mut others) = ([[0.0; B]; N], std::mem::take(&mut work.others));
        for (first, bits, hits) in rays.ended.words(rays.taken.clone()) {
            if N > 0 && B > 0 {
                rays.add_known(source, (first, bits, hits), &mut known_fit, &mut others);
            } else {
                hits.iter().for_each(|hit| source.ask_for::<N, B>(source.place::<N, B>(&self.cells, hit.cell())));
                others.extend(set_bits(bits).map(|bit| first + bit).zip(hits.iter()));
            }
            for (ray, hit) in others.drain(..) {
                self.read_one::<N, B, T>(rays, source, (ray, hit), &mut found, work);
            }
        }
        work.others = others;
        for (sum, known) in work.fit.iter_mut().zip(known_fit.iter().flatten()) {
            *sum += known;
        }
        found
    }

    /// Adds N(x_r) v_r of one ray, as [`read`](Self::read).
    fn read_one<const N: usize, const B: usize, T: Number>(
        &self,
        rays: &Rays<'_>,
        source: Source<'_, T>,
        (ray, hit): (usize, Hit),
        found: &mut Found,
        work: &mut Work,
    ) {
        let [n, bands] = known::<N, B>(rays.table.element.dofs(), source.lanes());
        let (functions, weight) = (&rays.table.points.functions[ray][..n], rays.weight(rays.share(), ray));
        let counts = !hit.is_of(rays.excluded);
        if !counts {
            add_outer(found.excluded.get_or_insert_default(), weight, functions);
            if !hit.is_lamp() {
                return;
            }
        }
        if N == 1 && counts {
            let values = source.of_cell::<N, B>(&self.cells, hit.cell());
            work.fit[..bands].iter_mut().zip(values).for_each(|(sum, &v)| *sum += weight * v.into());
            return;
        }
        let (value, spots) = (&mut work.value[..bands], &self.table(hit.cell()).spots);
        source.evaluate::<N, B>(&self.cells, hit, spots, value);
        let sums = if counts {
            &mut work.fit
        } else {
            let of = self.lamps.of(hit.cell()).unwrap_or(0);
            value.iter_mut().zip(&source.means[of * bands..]).for_each(|(v, mean)| *v -= mean);
            found.lamp = true;
            &mut work.rest
        };
        for (sums, function) in sums.chunks_exact_mut(bands).zip(functions) {
            sums.iter_mut().zip(&*value).for_each(|(sum, v)| *sum += weight * function * v);
        }
    }

    /// `work.result` = Δ `work.fit`.
    #[inline(always)]
    fn integrate<const N: usize, const B: usize>(&self, cell: usize, bands: usize, work: &mut Work) {
        let table = if N > 0 { &self.tables[0] } else { self.table(cell) };
        let [n, bands] = known::<N, B>(table.element.dofs(), bands);
        let own = self.cells.stretched(cell).map(|patch| mean_mass(table.element, Some(&patch)));
        let mass = own.as_ref().unwrap_or(&table.mass);
        multiply(mass, self.cells.area(cell), n, bands, &work.fit, &mut work.result);
    }

    /// What a cell gets from lamps.
    fn lamps_of(&self, cell: usize, index: usize) -> Lit<'_> {
        self.direct[cell / CHUNK].of(index)
    }

    /// e = Σ f_l mean_l + (1 − Σ f_l − D 1) ē + rest, into `work.fit`, which holds ē.
    #[inline(always)]
    fn combine<const N: usize, const B: usize>(
        &self,
        cell: usize,
        lamps: Lit<'_>,
        means: &[f64],
        rest: bool,
        work: &mut Work,
    ) {
        let range = self.cells.range(cell);
        let [n, bands] = known::<N, B>(range.len(), work.result.len() / MAX_DOFS);
        for (k, fit) in work.fit.chunks_exact_mut(bands).take(n).enumerate() {
            let linked = self.linked.get(range.start + k).copied().unwrap_or(0.0);
            let seen: f64 = linked + lamps.iter().map(|(_, values)| f64::from(values[k])).sum::<f64>();
            for fit in fit.iter_mut() {
                *fit *= 1.0 - seen;
            }
            for (lamp, values) in lamps.iter() {
                let means = &means[lamp * bands..];
                fit.iter_mut().zip(means).for_each(|(fit, mean)| *fit += f64::from(values[k]) * mean);
            }
            if rest {
                fit.iter_mut().zip(&work.rest[k * bands..]).for_each(|(fit, rest)| *fit += rest);
            }
        }
    }
}

impl Table {
    /// From sums to coefficients, in `work.fit` and `work.rest`.
    #[inline(always)]
    fn fit<const N: usize, const B: usize>(
        &self,
        rays: &Rays<'_>,
        take: Take,
        found: &mut Found,
        bands: usize,
        work: &mut Work,
    ) {
        let [n, bands] = known::<N, B>(self.element.dofs(), bands);
        let mut own = rays.stretch.is_some().then(|| {
            let mut gram = self.ridge;
            let (share, functions) = (rays.share(), &self.points.functions);
            rays.taken.clone().for_each(|ray| add_outer(&mut gram, rays.weight(share, ray), &functions[ray][..n]));
            gram
        });
        if let Some(excluded) = &mut found.excluded {
            let all = own.as_ref().unwrap_or(&self.gram[take as usize]);
            for (row, all) in excluded[..n].iter_mut().zip(all) {
                row[..n].iter_mut().zip(all).for_each(|(entry, all)| *entry = all - *entry);
            }
            factor_in_place(excluded, n);
        }
        if let Some(gram) = &mut own {
            factor_in_place(gram, n);
        }
        let of_all = own.as_ref().unwrap_or(&self.factor[take as usize]);
        if found.lamp {
            solve(of_all, n, bands, &mut work.rest);
        }
        solve(found.excluded.as_ref().unwrap_or(of_all), n, bands, &mut work.fit);
    }
}

impl Work {
    pub(super) fn new(rays: u32, lanes: usize) -> Self {
        let coefficients = vec![0.0; MAX_DOFS * lanes];
        Self {
            cast: vec![Hit::LOST; rays as usize],
            cast_hits: Hits::new(rays),
            cast_of: None,
            value: vec![0.0; lanes],
            fit: coefficients.clone(),
            rest: coefficients.clone(),
            result: coefficients,
            others: Vec::with_capacity(WORD),
        }
    }
}

/// The rows of one cell: `work.result` = Δ e. If N is not 0, all cells have one element of N functions; if B is not 0,
/// there are B lanes.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn row<const N: usize, const B: usize, T: Number>(
    sampled: &Sampled,
    cell: usize,
    index: usize,
    source: Source<'_, T>,
    take: Take,
    work: &mut Work,
) {
    let table = if N > 0 { &sampled.tables[0] } else { sampled.table(cell) };
    let (taken, stored) = (take.of(sampled.rays as usize), sampled.stored.get(cell / CHUNK));
    if stored.is_none() {
        sampled.cast_again(cell, taken.end, work);
    }
    let cast = std::mem::take(&mut work.cast_hits);
    let ended = stored.map_or_else(|| cast.of(0), |stored| stored.of(index));
    let stretch = sampled.cells.stretched(cell).map(|patch| Stretch::new(&table.points, &patch));
    let excluded = excluded(ended, taken.clone());
    let rays = Rays { table, ended, taken, excluded, stretch };
    let mut found = sampled.read::<N, B, T>(&rays, source, work);
    table.fit::<N, B>(&rays, take, &mut found, source.lanes(), work);
    work.cast_hits = cast;
    let of_lamps = (excluded != Kinds::NONE).then(|| sampled.direct[cell / CHUNK].values_of(index, take));
    let lamps = of_lamps.as_ref().map_or(Lit::NOT, |values| sampled.lamps_of(cell, index).with(values));
    sampled.combine::<N, B>(cell, lamps, source.means, found.lamp, work);
    sampled.integrate::<N, B>(cell, source.lanes(), work);
}

/// The numbers of functions and of bands, as constants where they are known.
#[inline(always)]
fn known<const N: usize, const B: usize>(n: usize, bands: usize) -> [usize; 2] {
    [if N > 0 { N } else { n }, if B > 0 { B } else { bands }]
}

/// What these rays met that they are not fitted to; see [`Rays`].
fn excluded(ended: Ended<'_>, taken: Range<usize>) -> Kinds {
    let (wanted, mut arrived, mut among_lamps) = (taken.len(), 0, true);
    for (_, bits, hits) in ended.words(taken) {
        arrived += bits.count_ones() as usize;
        if hits.iter().any(|hit| !hit.is_of(Kinds::LAMPS_AND_LINKED)) {
            return Kinds::LAMPS_AND_LINKED;
        }
        among_lamps &= hits.iter().all(Hit::is_lamp);
    }
    match (arrived == wanted, among_lamps) {
        (false, _) => Kinds::LAMPS_AND_LINKED,
        (true, false) => Kinds::LAMPS,
        (true, true) => Kinds::NONE,
    }
}

/// y = a M x for the bands of n rows side by side.
#[inline(always)]
fn multiply(mass: &Matrix, a: f64, n: usize, bands: usize, x: &[f64], y: &mut [f64]) {
    for (row, y) in mass[..n].iter().zip(y.chunks_exact_mut(bands)) {
        for (band, y) in y.iter_mut().enumerate() {
            *y = a * (0..n).map(|j| row[j] * x[j * bands + band]).sum::<f64>();
        }
    }
}

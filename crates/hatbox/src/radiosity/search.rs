//! A solution sought among all functions of which it is known what arrives of them.
//!
//! Products with a sampled S are all of the time, so none is wasted: what other lights and paints have asked for is where
//! the search begins *and goes on*, what a new direction brings is all that it does not have yet, and what arrives of
//! the solution is put together from what arrived of its parts, without a product to check it. Products are kept in single
//! precision, and so is what the equation makes of them: most of a search is waiting for memory. Emission and directions are rounded before
//! they are asked about, so that residuals are off by the rounding of images and of what is made of them,
//! and who wants more digits than that ([`FARTHEST`]) does not search. Where the tolerance leaves room for it, what is left of the
//! equation is made to sum to nothing in the end, so that power balances.
//!
//! Each band is sought among its own directions. S is the same for all, so that bands could share theirs (the block method of
//! D. O'Leary 1980): that hardly saved a product where three bands shared, none where the suns over a terrain did, and takes as
//! many times the columns. To split each direction into its parts on each material was tried as well: fewer products, of
//! many more columns.

use super::operators::Equation;
use super::products::{Product, Products, round, rounded};
use crate::linalg::{Columns, LinearOperator, MultiVector, dot};
use crate::progress::Progress;
use crate::solve::{Info, Params, SearchSpace, SolveError, gmres};
use rayon::prelude::*;
use std::sync::Arc;

/// A combination whose terms are together so many times what they sum up to has too few digits left.
const CANCELLED: f64 = 100.0;
/// Who goes farther than this does not search: kept numbers have seven digits.
pub(super) const FARTHEST: f64 = 1e-5;
/// Directions at the least before the search begins afresh, and bytes that more of them may take. (With the memory that an operator has
/// left of what it is allowed, its solution depended on that.)
const FEWEST: usize = 8;
const MOST_BYTES: usize = 4 << 30;

/// B from the emission's coefficients, and what arrives of it, by GMRES for the light that is reflected.
pub(super) fn reflected_exactly(
    equation: &Equation<'_>,
    preconditioner: &dyn LinearOperator,
    mut b: MultiVector,
    params: &Params,
    progress: &dyn Progress,
) -> Result<(MultiVector, MultiVector, Info), SolveError> {
    let mut arrived = equation.transport.seen.times(&b);
    let first = equation.first_bounce(arrived.clone());
    let mut step = MultiVector::zeros(b.rows(), b.bands());
    let info = gmres(equation, preconditioner, &first, &mut step, params, progress)?;
    b.add_scaled(1.0, &step);
    arrived.add_scaled(1.0, &equation.transport.seen.times(&step));
    Ok((b, arrived, info))
}

/// The reflected light of an emission, and where it is sought.
pub(super) struct Search<'a> {
    equation: Equation<'a>,
    /// What is found so far and does not change any more, the emission first, and what arrives of it as it is kept.
    found: [MultiVector; 2],
    /// The norms of the light that is reflected once.
    first_bounce: Vec<f64>,
    /// The right side of the equation for the rest.
    target: MultiVector,
    /// What the best combinations leave of it.
    rest: MultiVector,
    /// What is combined in each band.
    spaces: Vec<Space>,
    /// Functions of a band at the most.
    most: usize,
    kept: Products,
    /// Bytes that these may take.
    most_kept: usize,
}

/// Functions of a band.
#[derive(Clone)]
struct Space {
    /// The first were known before.
    products: Vec<Arc<Product>>,
    known: usize,
    /// What the equation makes of them.
    made: Columns<f32>,
    /// The best combination.
    best: Vec<f64>,
}

impl Space {
    fn new(equation: &Equation<'_>) -> Self {
        Self { products: Vec::new(), known: 0, made: Columns::summed(&equation.roots), best: Vec::new() }
    }

    /// Takes products in.
    fn take(&mut self, equation: &Equation<'_>, band: usize, products: &[Arc<Product>]) {
        self.made.extend(equation.of_band(band, products));
        self.products.extend_from_slice(products);
    }

    /// Finds the best combination for a target, and what it leaves.
    fn fit(&mut self, target: &[f64], rest: &mut [f64]) {
        self.best = self.made.fit(target);
        if self.forgets_what_cancels(target) {
            self.best = self.made.fit(target);
        }
        self.leave(target, rest);
    }

    /// What the best combination leaves of a target.
    fn leave(&self, target: &[f64], rest: &mut [f64]) {
        rest.copy_from_slice(target);
        self.made.subtract(&self.best, rest);
    }

    /// No longer combines what was known before where it takes large multiples that cancel; whether it does.
    fn forgets_what_cancels(&mut self, target: &[f64]) -> bool {
        let norms = self.made.norms();
        let terms: f64 = self.best.iter().zip(norms).take(self.known).map(|(y, norm)| y.abs() * norm).sum();
        let forgets = terms > CANCELLED * dot(target, target).sqrt();
        if forgets {
            self.made.ignore_first(self.known);
        }
        forgets
    }

    /// Adds the best combination to what is found, and forgets all.
    fn add_best(&mut self, equation: &Equation<'_>, x: &mut [f64], image: &mut [f64]) {
        let all: Vec<(f64, &Product)> = self.best.iter().copied().zip(self.products.iter().map(|p| &**p)).collect();
        Product::add_all(&all, x, image);
        *self = Self::new(equation);
    }
}

impl<'a> Search<'a> {
    /// Begins with the combination of what is `known` that is best.
    pub(super) fn new(
        equation: Equation<'a>,
        emission: MultiVector,
        known: &Products,
        most_kept: usize,
        restart: usize,
    ) -> Self {
        let mut kept = Products::default();
        let arrived = arrived_of(&equation, &emission, known, &mut kept, most_kept);
        let target = equation.first_bounce(arrived.clone());
        // A function, what arrives of it, and what the equation makes of it.
        let bytes = target.bands() * (arrived.rows() + 2 * target.rows()) * size_of::<f32>();
        let most = (MOST_BYTES / bytes.max(1)).clamp(FEWEST, restart.max(FEWEST));
        let mut rest = MultiVector::zeros(target.rows(), target.bands());
        let mut spaces = vec![Space::new(&equation); target.bands()];
        let columns = rest.as_mut_slice().par_chunks_mut(target.rows().max(1)).zip(&mut spaces);
        columns.enumerate().for_each(|(band, (rest, space))| {
            let known = known.of_band(band);
            space.known = known.len().min(most - FEWEST / 2);
            space.take(&equation, band, &known[..space.known]);
            space.fit(target.band(band), rest);
        });
        let (first_bounce, found) = (target.norms(), [emission, arrived]);
        Self { equation, found, first_bounce, target, rest, spaces, most, kept, most_kept }
    }

    /// The norm of the light that is reflected once, in each band.
    pub(super) fn first_bounce(&self) -> Vec<f64> {
        self.first_bounce.clone()
    }

    /// Makes what is left of the equation sum to nothing in bands where it stays within the tolerance, and gives the greatest
    /// residual: power balances then to the last digits.
    pub(super) fn balance(&mut self, tolerance: f64) -> f64 {
        let (target, first_bounce) = (&self.target, &self.first_bounce);
        let columns = self.rest.as_mut_slice().par_chunks_mut(target.rows().max(1)).zip(&mut self.spaces);
        columns.enumerate().for_each(|(band, (rest, space))| {
            space.made.balance(target.band(band), &mut space.best, tolerance * first_bounce[band]);
            space.leave(target.band(band), rest);
        });
        let relative = |(rest, first): (f64, &f64)| if *first > 0.0 { rest / first } else { 0.0 };
        self.rest.norms().into_iter().zip(&self.first_bounce).map(relative).fold(0.0, f64::max)
    }

    /// Solves for what the search has left, where it got nowhere after what is `done`, by GMRES.
    pub(super) fn finish_by_gmres(
        &mut self,
        done: &Info,
        preconditioner: &dyn LinearOperator,
        params: &Params,
        progress: &dyn Progress,
    ) -> Result<Info, SolveError> {
        self.fold(&(0..self.spaces.len()).collect::<Vec<_>>());
        // The tolerance is relative to the first bounce, in each band; those that are done are left alone.
        let (mut share, mut open) = (f64::INFINITY, Vec::new());
        for (band, rest) in self.target.norms().into_iter().enumerate() {
            if rest > params.tolerance * self.first_bounce[band] {
                share = share.min(self.first_bounce[band] / rest);
                open.push(band);
            } else {
                self.target.band_mut(band).fill(0.0);
            }
        }
        let params = Params { tolerance: params.tolerance * share, ..*params };
        let mut step = MultiVector::zeros(self.target.rows(), self.target.bands());
        let info = gmres(&self.equation, preconditioner, &self.target, &mut step, &params, progress)?;
        let image = self.equation.transport.seen.times(&step);
        let [x, arrived] = &mut self.found;
        x.add_scaled(1.0, &step);
        arrived.add_scaled(1.0, &image);
        let products = Product::of_bands(&step, &image);
        for band in open {
            self.kept.keep(band, &products[band], self.most_kept);
        }
        self.rest.as_mut_slice().fill(0.0);
        let converged = info.converged.iter().map(|n| done.iterations + n).collect();
        Ok(Info { iterations: done.iterations + info.iterations, residual: info.residual / share, converged })
    }

    /// The solution, what arrives of it, and what was asked for.
    pub(super) fn finish(mut self) -> (MultiVector, MultiVector, Products) {
        self.add_best();
        let [solution, arrived] = self.found;
        (solution, arrived, self.kept)
    }

    /// Adds the best combinations of some bands to what is found, and begins these afresh.
    fn fold(&mut self, bands: &[usize]) {
        let [x, image] = &mut self.found;
        for &band in bands {
            self.spaces[band].add_best(&self.equation, x.band_mut(band), image.band_mut(band));
            self.target.band_mut(band).copy_from_slice(self.rest.band(band));
        }
    }

    /// Adds the best combinations to what is found.
    fn add_best(&mut self) {
        let [x, image] = &mut self.found;
        let (rows, seen) = (x.rows().max(1), image.rows().max(1));
        let columns = x.as_mut_slice().par_chunks_mut(rows).zip(image.as_mut_slice().par_chunks_mut(seen));
        columns.zip(&mut self.spaces).for_each(|((x, image), space)| space.add_best(&self.equation, x, image));
    }
}

impl SearchSpace for Search<'_> {
    fn rest(&self) -> &MultiVector {
        &self.rest
    }

    fn extend(&mut self, bands: &[usize], mut directions: MultiVector) {
        let full = |&band: &usize| self.spaces[band].products.len() >= self.most;
        let full: Vec<usize> = bands.iter().copied().filter(full).collect();
        self.fold(&full);
        round(&mut directions);
        let image = self.equation.transport.seen.times(&directions);
        let products = Product::of_bands(&directions, &image);
        drop((directions, image));
        keep(&mut self.kept, bands, &products, self.most_kept);
        let mut new: Vec<Option<Arc<Product>>> = vec![None; self.spaces.len()];
        bands.iter().zip(products).for_each(|(&band, product)| new[band] = Some(product));
        let (equation, target) = (&self.equation, &self.target);
        let columns = self.rest.as_mut_slice().par_chunks_mut(target.rows().max(1)).zip(&mut self.spaces).zip(new);
        columns.enumerate().for_each(|(band, ((rest, space), product))| {
            if let Some(product) = product {
                space.take(equation, band, &[product]);
                space.fit(target.band(band), rest);
            }
        });
    }
}

/// What arrives of an emission; what is asked for is kept.
fn arrived_of(
    equation: &Equation<'_>,
    emission: &MultiVector,
    known: &Products,
    kept: &mut Products,
    most_kept: usize,
) -> MultiVector {
    let seen = equation.transport.seen;
    let mut arrived = MultiVector::zeros(seen.rows(), emission.bands());
    let rows = arrived.rows().max(1);
    let columns = arrived.as_mut_slice().par_chunks_mut(rows).enumerate();
    let is_new = columns.map(|(band, image)| !known.image_of(band, emission.band(band), image)).collect::<Vec<_>>();
    let bands: Vec<usize> = (0..emission.bands()).filter(|&band| is_new[band]).collect();
    if bands.is_empty() {
        return arrived;
    }
    let asked = rounded(emission, &bands);
    let image = seen.times(&asked);
    if most_kept > 0 {
        keep(kept, &bands, &Product::of_bands(&asked, &image), most_kept);
    }
    if bands.len() == emission.bands() {
        return image;
    }
    bands.iter().enumerate().for_each(|(k, &band)| arrived.band_mut(band).copy_from_slice(image.band(k)));
    arrived
}

/// Keeps products of these bands.
fn keep(kept: &mut Products, bands: &[usize], products: &[Arc<Product>], most_kept: usize) {
    bands.iter().zip(products).for_each(|(&band, product)| kept.keep(band, product, most_kept));
}

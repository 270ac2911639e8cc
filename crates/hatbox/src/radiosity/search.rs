//! A solution sought among all functions of which it is known what arrives of them.
//!
//! Products with a sampled S are all of the time, so none is wasted: what other lights and paints have asked for is where
//! the search begins *and goes on*, what a new direction brings is all that it does not have yet, and what arrives of
//! the solution is put together from what arrived of its parts, without a product to check it. Products are kept in single
//! precision: directions are rounded before they are asked about, so that residuals are off by the rounding of images alone,
//! and who wants more digits than that ([`FARTHEST`]) does not search. Where the tolerance leaves room for it, what is left of the
//! equation is made to sum to nothing in the end, so that power balances.
//!
//! Each band is sought among its own directions. S is the same for all, so that bands could share theirs (the block method of
//! D. O'Leary 1980): that hardly saved a product where three bands shared, none where the suns over a terrain did, and takes as
//! many times the columns. To split each direction into its parts on each material was tried as well: fewer products, of
//! many more columns.

use super::operators::Equation;
use super::products::{Product, Products};
use crate::linalg::{Columns, LinearOperator, MultiVector};
use crate::progress::Progress;
use crate::solve::{Info, Params, SearchSpace, SolveError, gmres};
use rayon::prelude::*;
use std::sync::Arc;

/// A combination whose terms are together so many times what they sum up to has too few digits left.
const CANCELLED: f64 = 100.0;
/// Who goes farther than this does not search: kept numbers have seven digits.
pub(super) const FARTHEST: f64 = 1e-5;
/// Directions at the least before the search begins afresh.
const FEWEST: usize = 8;

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

/// How much may be remembered.
#[derive(Debug, Clone, Copy)]
pub(super) struct Room {
    /// Bytes for the search.
    pub(super) search: usize,
    /// Bytes for what other lights and paints may use.
    pub(super) products: usize,
}

/// The reflected light of an emission, and where it is sought.
pub(super) struct Search<'a> {
    equation: Equation<'a>,
    /// What is found so far and does not change any more, the emission first, and what arrives of it.
    found: [MultiVector; 2],
    /// The norms of the light that is reflected once.
    first_bounce: Vec<f64>,
    /// The right side of the equation for the rest.
    target: MultiVector,
    /// What the best combination leaves of it.
    rest: MultiVector,
    /// The functions that are combined; the first were known before.
    products: Vec<Arc<Product>>,
    known: usize,
    /// What the equation makes of them, for each band.
    spaces: Vec<Columns>,
    /// The best combination for each band.
    best: Vec<Vec<f64>>,
    /// Functions at the most.
    most: usize,
    kept: Products,
    room: Room,
}

impl<'a> Search<'a> {
    /// Begins with the combination of what is `known` that is best.
    pub(super) fn new(
        equation: Equation<'a>,
        emission: MultiVector,
        known: &Products,
        room: Room,
        restart: usize,
    ) -> Self {
        let mut kept = Products::default();
        let arrived = known.image_of(&emission).unwrap_or_else(|| {
            let image = equation.transport.seen.times(&emission);
            kept.keep(&Arc::new(Product::new(&emission, &image)), room.products);
            image
        });
        let target = equation.first_bounce(arrived.clone());
        let bands = target.bands();
        // A function, what arrives of it, and what the equation makes of it.
        let bytes = bands * (equation.transport.seen.rows() + 3 * target.rows()) * size_of::<f32>();
        let mut search = Self {
            first_bounce: target.norms(),
            rest: target.clone(),
            target,
            products: Vec::new(),
            known: 0,
            spaces: vec![Columns::summed(&equation.roots); bands],
            equation,
            best: vec![Vec::new(); bands],
            most: (room.search / bytes.max(1)).clamp(FEWEST, restart.max(FEWEST)),
            found: [emission, arrived],
            kept,
            room,
        };
        let most_known = search.most - FEWEST / 2;
        known.of_bands(bands).take(most_known).for_each(|product| search.take(product, product.both()));
        search.known = search.products.len();
        search.fit();
        search
    }

    /// The norm of the light that is reflected once, in each band.
    pub(super) fn first_bounce(&self) -> Vec<f64> {
        self.first_bounce.clone()
    }

    /// Makes what is left of the equation sum to nothing in bands where it stays within the tolerance, and gives the greatest
    /// residual: power balances then to the last digits.
    pub(super) fn balance(&mut self, tolerance: f64) -> f64 {
        for (band, (space, y)) in self.spaces.iter().zip(&mut self.best).enumerate() {
            space.balance(self.target.band(band), y, tolerance * self.first_bounce[band]);
        }
        self.leave();
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
        self.fold();
        // The tolerance is relative to the first bounce, in each band; those that are done are left alone.
        let mut share = f64::INFINITY;
        for (band, rest) in self.target.norms().into_iter().enumerate() {
            if rest > params.tolerance * self.first_bounce[band] {
                share = share.min(self.first_bounce[band] / rest);
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
        self.kept.keep(&Arc::new(Product::new(&step, &image)), self.room.products);
        self.rest.as_mut_slice().fill(0.0);
        let converged = info.converged.iter().map(|n| done.iterations + n).collect();
        Ok(Info { iterations: done.iterations + info.iterations, residual: info.residual / share, converged })
    }

    /// The solution, what arrives of it, and what was asked for.
    pub(super) fn finish(mut self) -> (MultiVector, MultiVector, Products) {
        self.fold();
        let [solution, arrived] = self.found;
        (solution, arrived, self.kept)
    }

    /// Takes a product in, of which these are the function and what arrives of it.
    fn take(&mut self, product: &Arc<Product>, [x, image]: [MultiVector; 2]) {
        let made = self.equation.of(&x, image);
        let of_band = |(band, space): (usize, &mut Columns)| space.extend([made.band(band).to_vec()]);
        self.spaces.par_iter_mut().enumerate().for_each(of_band);
        self.products.push(Arc::clone(product));
    }

    /// Finds the best combinations, and what they leave.
    fn fit(&mut self) {
        self.best = self.fitted();
        if self.forget_what_cancels() {
            self.best = self.fitted();
        }
        self.leave();
    }

    /// What the best combinations leave.
    fn leave(&mut self) {
        let (target, rows) = (&self.target, self.target.rows().max(1));
        let bands = self.rest.as_mut_slice().par_chunks_mut(rows).zip(&self.spaces).zip(&self.best);
        bands.enumerate().for_each(|(band, ((rest, space), y))| {
            rest.copy_from_slice(target.band(band));
            space.subtract(y, rest);
        });
    }

    fn fitted(&self) -> Vec<Vec<f64>> {
        let of_band = |(band, space): (usize, &Columns)| space.fit(self.target.band(band));
        self.spaces.par_iter().enumerate().map(of_band).collect()
    }

    /// No longer combines what was known before in bands where it takes large multiples that cancel; whether there are any.
    fn forget_what_cancels(&mut self) -> bool {
        let (goals, mut forgotten) = (self.target.norms(), false);
        for ((space, y), goal) in self.spaces.iter_mut().zip(&self.best).zip(goals) {
            let terms: f64 = y.iter().zip(space.norms()).take(self.known).map(|(y, norm)| y.abs() * norm).sum();
            if terms > CANCELLED * goal {
                space.ignore_first(self.known);
                forgotten = true;
            }
        }
        forgotten
    }

    /// Adds the best combination to what is found, and begins afresh.
    fn fold(&mut self) {
        let [x, image] = &mut self.found;
        let (rows, seen) = (x.rows().max(1), image.rows().max(1));
        let bands = x.as_mut_slice().par_chunks_mut(rows).zip(image.as_mut_slice().par_chunks_mut(seen));
        bands.zip(&self.best).enumerate().for_each(|(band, ((x, image), y))| {
            for (product, &y) in self.products.iter().zip(y) {
                product.add(y, band, x, image);
            }
        });
        self.target.clone_from(&self.rest);
        self.products.clear();
        self.known = 0;
        self.spaces.iter_mut().for_each(|space| *space = Columns::summed(&self.equation.roots));
        self.best.iter_mut().for_each(Vec::clear);
    }
}

impl SearchSpace for Search<'_> {
    fn rest(&self) -> &MultiVector {
        &self.rest
    }

    fn extend(&mut self, directions: MultiVector) {
        if self.products.len() >= self.most {
            self.fold();
        }
        let (product, both) = Product::of(directions, self.equation.transport.seen);
        let product = Arc::new(product);
        self.kept.keep(&product, self.room.products);
        self.take(&product, both);
        self.fit();
    }
}

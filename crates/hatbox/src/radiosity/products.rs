//! Products with S that were paid for once, and what other lamps and other paints make of them.
//!
//! S holds no material. Whoever has asked for S x₁, …, S x_k knows what *any* equation Δ − M_R Δ⁻¹ S makes of the functions
//! Σ y_j x_j, at the price of a few vectors. The functions that a solver asks for (the emission, what it makes in one, two, …
//! reflections) are what other lights of the same scene are made of as well: lamps that are dimmed and walls that are
//! painted leave hardly anything that a product has to be asked for. This is the recycling of Krylov spaces (M. Parks, E. de
//! Sturler, G. Mackey, D. Johnson, S. Maiti 2006), for operators that share a factor instead of being close.
//!
//! It is for sampled operators, with which products are all of the time. They are kept in single precision, which is far
//! better than the samples; a dense operator is solved with to the last digits, and fast anyway.

use super::operators::{Equation, Join};
use crate::linalg::{LinearOperator, MultiVector, fit};
use std::sync::{Arc, Mutex, PoisonError};

/// Functions that are kept, at the most.
const MOST: usize = 32;
/// What is left of an emission, relative, up to which it counts as a combination of functions that are known.
const SAME: f64 = 1e-6;

/// A function of the joined space in each band, and what S makes of it, tested with the broken one.
#[derive(Debug)]
struct Product {
    bands: usize,
    x: Vec<f32>,
    image: Vec<f32>,
}

impl Product {
    fn new(x: &MultiVector, image: &MultiVector) -> Self {
        let single = |v: &MultiVector| v.as_slice().iter().map(|&x| x as f32).collect();
        Self { bands: x.bands(), x: single(x), image: single(image) }
    }

    fn bytes(&self) -> usize {
        size_of_val(&*self.x) + size_of_val(&*self.image)
    }
}

/// What is known of S.
#[derive(Debug, Clone, Default)]
pub(super) struct Products(Vec<Arc<Product>>);

/// A part of a solution: c and S C c.
pub(super) struct Part {
    pub(super) x: MultiVector,
    pub(super) image: MultiVector,
}

impl Products {
    /// These and older ones, as many as may be kept.
    pub(super) fn with(mut self, older: &Self) -> Self {
        self.0.extend(older.0.iter().cloned());
        self.0.truncate(MOST);
        self
    }

    /// S C x, if x is a combination of what is known.
    pub(super) fn image_of(&self, x: &MultiVector) -> Option<MultiVector> {
        let known: Vec<MultiVector> = self.of_bands(x.bands()).map(|product| double(&product.x, x.bands())).collect();
        let part = self.combined(&fit(&known, x), x)?;
        let mut rest = part.x;
        rest.add_scaled(-1.0, x);
        rest.norms().iter().zip(x.norms()).all(|(&rest, norm)| rest <= SAME * norm).then_some(part.image)
    }

    /// The combination of what is known that solves an equation best, if any is known.
    pub(super) fn best(&self, equation: &Equation<'_>, right_side: &MultiVector) -> Option<Part> {
        let bands = right_side.bands();
        let of = |product: &Arc<Product>| equation.of(&double(&product.x, bands), &double(&product.image, bands));
        let columns: Vec<MultiVector> = self.of_bands(bands).map(of).collect();
        self.combined(&fit(&columns, right_side), right_side)
    }

    fn of_bands(&self, bands: usize) -> impl Iterator<Item = &Arc<Product>> {
        self.0.iter().filter(move |product| product.bands == bands)
    }

    /// Σ y_j x_j and Σ y_j S C x_j.
    fn combined(&self, y: &[Vec<f64>], like: &MultiVector) -> Option<Part> {
        let bands = like.bands();
        let mut products = self.of_bands(bands).peekable();
        let rows = products.peek()?.image.len() / bands;
        let mut part = Part { x: MultiVector::zeros(like.rows(), bands), image: MultiVector::zeros(rows, bands) };
        for (j, product) in products.enumerate() {
            for (band, y) in y.iter().enumerate() {
                add(part.x.band_mut(band), y[j], &product.x[band * like.rows()..]);
                add(part.image.band_mut(band), y[j], &product.image[band * rows..]);
            }
        }
        Some(part)
    }
}

fn double(numbers: &[f32], bands: usize) -> MultiVector {
    let numbers = numbers.iter().map(|&x| f64::from(x)).collect();
    MultiVector::from_bands(bands, numbers).unwrap_or_else(|| MultiVector::zeros(0, bands))
}

fn add(sum: &mut [f64], factor: f64, numbers: &[f32]) {
    sum.iter_mut().zip(numbers).for_each(|(sum, &number)| *sum += factor * f64::from(number));
}

/// S C, which remembers what it is asked.
pub(super) struct Asked<'a> {
    join: &'a Join,
    exchange: &'a dyn LinearOperator,
    /// Most bytes that may be kept.
    most_bytes: usize,
    log: Mutex<Log>,
}

#[derive(Default)]
struct Log {
    last: Option<(MultiVector, MultiVector)>,
    kept: Vec<Arc<Product>>,
    bytes: usize,
}

impl<'a> Asked<'a> {
    /// Keeps no more than so many bytes of products for [`products`](Self::products).
    pub(super) fn new(join: &'a Join, exchange: &'a dyn LinearOperator, most_bytes: usize) -> Self {
        Self { join, exchange, most_bytes, log: Mutex::default() }
    }

    /// S C x, without asking if that was the last thing asked for.
    pub(super) fn last_of(&self, x: &MultiVector) -> MultiVector {
        let last = self.log.lock().unwrap_or_else(PoisonError::into_inner).last.take();
        match last {
            Some((asked, image)) if asked == *x => image,
            _ => self.times(x),
        }
    }

    /// All that was asked for.
    pub(super) fn products(self) -> Products {
        Products(self.log.into_inner().unwrap_or_else(PoisonError::into_inner).kept)
    }
}

impl LinearOperator for Asked<'_> {
    fn rows(&self) -> usize {
        self.exchange.rows()
    }
    fn cols(&self) -> usize {
        self.join.unknowns(self.exchange.cols())
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        self.exchange.apply(&self.join.spread(x), y);
        let mut log = self.log.lock().unwrap_or_else(PoisonError::into_inner);
        let product = (log.kept.len() < MOST && log.bytes < self.most_bytes).then(|| Product::new(x, y));
        if let Some(product) = product.filter(|product| log.bytes + product.bytes() <= self.most_bytes) {
            log.bytes += product.bytes();
            log.kept.push(Arc::new(product));
        }
        log.last = Some((x.clone(), y.clone()));
    }
}

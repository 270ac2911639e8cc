//! Products with S that were paid for once, and what other lamps and other paints make of them.
//!
//! S holds no material. Whoever has asked for S x₁, …, S x_k knows what *any* equation Δ − M_R Δ⁻¹ S makes of the functions
//! Σ y_j x_j, at the price of a few vectors. (Where no reflectance varies on an element, only the integrals of S x against the joined
//! functions are asked for, and kept; a first texture then asks anew.) The functions that a solver asks for (the emission, what it makes in one, two, …
//! reflections) are what other lights of the same scene are made of as well: lamps that are dimmed and walls that are
//! painted leave hardly anything that a product has to be asked for. This is the recycling of Krylov spaces (M. Parks, E. de
//! Sturler, G. Mackey, D. Johnson, S. Maiti 2006), for operators that share a factor instead of being close.
//!
//! Tried and dropped: a coarse equation (constants on groups of elements) as a second preconditioner beside the mass matrix,
//! for first solutions and new paint. Reflected light converges fast as it is, and what is left sits in edges and corners,
//! which groups do not see: hardly fewer products were asked for.
//!
//! It is for sampled operators, with which products are all of the time. They are kept in single precision, which is far
//! better than the samples; a dense operator is solved with to the last digits, and fast anyway.

use super::operators::{Arriving, Equation};
use crate::linalg::{LinearOperator, MultiVector, fit};
use std::sync::{Arc, Mutex, PoisonError};

/// Functions that are kept, at the most.
const MOST: usize = 32;
/// Coefficients of an emission are a multiple of known ones if they differ by no more than this, relative to themselves (and to the
/// greatest of all, since the inverse of a mass matrix leaves rounding everywhere). Relative to all of them together would not
/// do: a small bright lamp is more than a large dim one, and may light the scene less.
const SAME: f64 = 1e-6;
const ROUNDING: f64 = 1e-10;
/// A combination whose terms are together so many times what they sum up to has too few digits left.
const CANCELLED: f64 = 100.0;
/// Solvers that go farther than this begin afresh: kept numbers have seven digits.
const FARTHEST: f64 = 1e-5;

/// A function of the joined space in each band, and what arrives of it ([`Arriving`](super::operators::Arriving)).
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

    fn is_finite(&self) -> bool {
        self.x.iter().chain(&self.image).all(|x| x.is_finite())
    }

    /// What arrives of x, if every band of x is a multiple of that of this function.
    fn multiple(&self, x: &MultiVector) -> Option<MultiVector> {
        let mut image = double(&self.image, self.bands);
        for band in 0..self.bands {
            let (wanted, known) = (x.band(band), &self.x[band * x.rows()..(band + 1) * x.rows()]);
            let greatest = (0..x.rows()).max_by(|&i, &j| wanted[i].abs().total_cmp(&wanted[j].abs()))?;
            let factor = if wanted[greatest] == 0.0 { 0.0 } else { wanted[greatest] / f64::from(known[greatest]) };
            let rounding = ROUNDING * wanted[greatest].abs();
            let same = |(&x, &known): (&f64, &f32)| (x - factor * f64::from(known)).abs() <= SAME * x.abs() + rounding;
            if !factor.is_finite() || !wanted.iter().zip(known).all(same) {
                return None;
            }
            image.band_mut(band).iter_mut().for_each(|value| *value *= factor);
        }
        Some(image)
    }
}

/// What is known of S.
#[derive(Debug, Clone, Default)]
pub(super) struct Products(Vec<Arc<Product>>);

/// A part of a solution: c and what arrives of it.
pub(super) struct Part {
    pub(super) x: MultiVector,
    pub(super) image: MultiVector,
}

impl Products {
    /// These and older ones, as many as may be kept in so many bytes.
    pub(super) fn with(mut self, older: &Self, most_bytes: usize) -> Self {
        let mut bytes: usize = self.0.iter().map(|product| product.bytes()).sum();
        for product in &older.0 {
            bytes += product.bytes();
            if self.0.len() < MOST && bytes <= most_bytes {
                self.0.push(Arc::clone(product));
            }
        }
        self
    }

    /// What a solver with a tolerance may begin with.
    pub(super) fn good_for(&self, tolerance: f64) -> Self {
        if tolerance < FARTHEST { Self::default() } else { self.clone() }
    }

    /// What arrives of x, if every band of x is a multiple of that of one function that is known.
    pub(super) fn image_of(&self, x: &MultiVector) -> Option<MultiVector> {
        self.of_bands(x.bands()).find_map(|product| product.multiple(x))
    }

    /// The combination of what is known that solves an equation best, if any is known.
    pub(super) fn best(&self, equation: &Equation<'_>, right_side: &MultiVector) -> Option<Part> {
        let bands = right_side.bands();
        let of = |product: &Arc<Product>| equation.of(&double(&product.x, bands), double(&product.image, bands));
        let columns: Vec<MultiVector> = self.of_bands(bands).map(of).collect();
        let mut y = fit(&columns, right_side);
        let (norms, goal): (Vec<Vec<f64>>, Vec<f64>) =
            (columns.iter().map(MultiVector::norms).collect(), right_side.norms());
        for (band, y) in y.iter_mut().enumerate() {
            let terms: f64 = y.iter().zip(&norms).map(|(y, norms)| y.abs() * norms[band]).sum();
            if terms > CANCELLED * goal[band] {
                y.fill(0.0);
            }
        }
        self.combined(&y, right_side)
    }

    fn of_bands(&self, bands: usize) -> impl Iterator<Item = &Arc<Product>> {
        self.0.iter().filter(move |product| product.bands == bands)
    }

    /// Σ y_j x_j and what arrives of it.
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

/// What arrives, remembered.
pub(super) struct Asked<'a> {
    arriving: Arriving<'a>,
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
    pub(super) fn new(arriving: Arriving<'a>, most_bytes: usize) -> Self {
        Self { arriving, most_bytes, log: Mutex::default() }
    }

    /// What arrives of x, without asking if that was the last thing asked for.
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
        self.arriving.rows()
    }
    fn cols(&self) -> usize {
        self.arriving.cols()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        self.arriving.apply(x, y);
        let mut log = self.log.lock().unwrap_or_else(PoisonError::into_inner);
        let product = (log.kept.len() < MOST && log.bytes < self.most_bytes).then(|| Product::new(x, y));
        let fits = |product: &Product| log.bytes + product.bytes() <= self.most_bytes && product.is_finite();
        if let Some(product) = product.filter(fits) {
            log.bytes += product.bytes();
            log.kept.push(Arc::new(product));
        }
        log.last = Some((x.clone(), y.clone()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(numbers: [f64; 3]) -> MultiVector {
        MultiVector::from_bands(1, numbers.to_vec()).expect("one band")
    }

    /// A small lamp ten million times brighter than a wall that shines as well: of all coefficients together the wall's are
    /// nothing, and yet they may be half of the light.
    #[test]
    fn a_dim_wall_beside_a_bright_lamp_is_not_overlooked() {
        let product = Product::new(&of([1e7, 1.0, 0.0]), &of([1.0, 2.0, 3.0]));
        assert_eq!(product.multiple(&of([2e7, 2.0, 0.0])).expect("twice as bright").as_slice(), [2.0, 4.0, 6.0]);
        for other in [[1e7, 0.0, 0.0], [1e7, 1.1, 0.0], [1e7, 1.0, 0.1]] {
            assert_eq!(product.multiple(&of(other)), None, "{other:?}");
        }
        assert_eq!(product.multiple(&of([0.0; 3])).expect("dark").as_slice(), [0.0; 3]);
    }

    #[test]
    fn products_take_no_more_bytes_than_they_may() {
        let some =
            |count: usize| Products((0..count).map(|_| Arc::new(Product::new(&of([1.0; 3]), &of([1.0; 3])))).collect());
        let each = some(1).0[0].bytes();
        assert_eq!(some(2).with(&some(9), 5 * each).0.len(), 5);
        assert_eq!(some(30).with(&some(9), 500 * each).0.len(), MOST);
        assert_eq!(some(2).good_for(1e-7).0.len(), 0);
    }
}

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

use crate::linalg::{LinearOperator, MultiVector};
use rayon::prelude::*;
use std::sync::Arc;

/// Numbers of a thread at the least.
const LEAST_NUMBERS: usize = 1 << 15;
/// Functions that are kept, at the most.
const MOST: usize = 32;
/// Coefficients of an emission are a multiple of known ones if they differ by no more than this, relative to themselves (and to the
/// greatest of all, since the inverse of a mass matrix leaves rounding everywhere). Relative to all of them together would not
/// do: a small bright lamp is more than a large dim one, and may light the scene less.
const SAME: f64 = 1e-6;
const ROUNDING: f64 = 1e-10;
/// Functions whose greatest number is less than this have too few digits in single precision.
const FAINT: f32 = 1e-30;

/// A function of the joined space in each band, and what arrives of it ([`Arriving`](super::operators::Arriving)).
#[derive(Debug)]
pub(super) struct Product {
    bands: usize,
    x: Vec<f32>,
    image: Vec<f32>,
}

impl Product {
    pub(super) fn new(x: &MultiVector, image: &MultiVector) -> Self {
        let single = |v: &MultiVector| v.as_slice().par_iter().with_min_len(LEAST_NUMBERS).map(|&x| x as f32).collect();
        Self { bands: x.bands(), x: single(x), image: single(image) }
    }

    /// What `seen` makes of a function that is rounded first; also both as they are kept.
    pub(super) fn of(mut x: MultiVector, seen: &dyn LinearOperator) -> (Self, [MultiVector; 2]) {
        round(&mut x);
        let mut image = seen.times(&x);
        let product = Self::new(&x, &image);
        round(&mut image);
        (product, [x, image])
    }

    fn bytes(&self) -> usize {
        size_of_val(&*self.x) + size_of_val(&*self.image)
    }

    /// Whether single precision has room for the numbers of every band.
    fn is_held(&self) -> bool {
        let are_held = |numbers: &[f32]| {
            let greatest = |of_band: &[f32]| of_band.iter().fold(0.0, |most: f32, x| most.max(x.abs()));
            let mut all = numbers.chunks((numbers.len() / self.bands).max(1)).map(greatest);
            numbers.iter().all(|x| x.is_finite()) && all.all(|most| most == 0.0 || most >= FAINT)
        };
        are_held(&self.x) && are_held(&self.image)
    }

    /// The function and what arrives of it.
    pub(super) fn both(&self) -> [MultiVector; 2] {
        [&self.x, &self.image].map(|numbers| double(numbers, self.bands))
    }

    /// Adds so many times a band of the function to `x`, and of what arrives of it to `image`.
    pub(super) fn add(&self, factor: f64, band: usize, x: &mut [f64], image: &mut [f64]) {
        add(x, factor, &self.x[band * x.len()..]);
        add(image, factor, &self.image[band * image.len()..]);
    }

    /// What arrives of x, if every band of x is a multiple of that of this function.
    fn multiple(&self, x: &MultiVector) -> Option<MultiVector> {
        let mut factors = Vec::with_capacity(self.bands);
        for band in 0..self.bands {
            let (wanted, known) = (x.band(band), &self.x[band * x.rows()..(band + 1) * x.rows()]);
            let greatest = (0..x.rows()).max_by(|&i, &j| wanted[i].abs().total_cmp(&wanted[j].abs()))?;
            let factor = if wanted[greatest] == 0.0 { 0.0 } else { wanted[greatest] / f64::from(known[greatest]) };
            let rounding = ROUNDING * wanted[greatest].abs();
            let same = |(&x, &known): (&f64, &f32)| (x - factor * f64::from(known)).abs() <= SAME * x.abs() + rounding;
            if !factor.is_finite() || !wanted.iter().zip(known).all(same) {
                return None;
            }
            factors.push(factor);
        }
        let mut image = double(&self.image, self.bands);
        for (band, factor) in factors.into_iter().enumerate() {
            image.band_mut(band).iter_mut().for_each(|value| *value *= factor);
        }
        Some(image)
    }
}

/// What is known of S.
#[derive(Debug, Clone, Default)]
pub(super) struct Products(Vec<Arc<Product>>);

impl Products {
    /// Adds a product, if so many bytes are enough for it, and single precision for its numbers.
    pub(super) fn keep(&mut self, product: &Arc<Product>, most_bytes: usize) {
        if self.0.len() < MOST && self.bytes() + product.bytes() <= most_bytes && product.is_held() {
            self.0.push(Arc::clone(product));
        }
    }

    fn bytes(&self) -> usize {
        self.0.iter().map(|product| product.bytes()).sum()
    }

    /// These and older ones, as many as may be kept in so many bytes.
    pub(super) fn with(mut self, older: &Self, most_bytes: usize) -> Self {
        older.0.iter().for_each(|product| self.keep(product, most_bytes));
        self
    }

    /// What arrives of x, if every band of x is a multiple of that of one function that is known.
    pub(super) fn image_of(&self, x: &MultiVector) -> Option<MultiVector> {
        self.of_bands(x.bands()).find_map(|product| product.multiple(x))
    }

    /// Those of so many bands.
    pub(super) fn of_bands(&self, bands: usize) -> impl Iterator<Item = &Arc<Product>> {
        self.0.iter().filter(move |product| product.bands == bands)
    }
}

/// Numbers as they are kept.
fn round(x: &mut MultiVector) {
    x.as_mut_slice().par_iter_mut().with_min_len(LEAST_NUMBERS).for_each(|x| *x = f64::from(*x as f32));
}

fn double(numbers: &[f32], bands: usize) -> MultiVector {
    let numbers = numbers.par_iter().with_min_len(LEAST_NUMBERS).map(|&x| f64::from(x)).collect();
    MultiVector::from_bands(bands, numbers).unwrap_or_else(|| MultiVector::zeros(0, bands))
}

fn add(sum: &mut [f64], factor: f64, numbers: &[f32]) {
    sum.iter_mut().zip(numbers).for_each(|(sum, &number)| *sum += factor * f64::from(number));
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
    fn what_single_precision_has_no_digits_for_is_not_kept() {
        for (numbers, held) in [
            ([1e-20, 1e-45, 0.0], true),
            ([0.0; 3], true),
            ([1e-40, 0.0, 0.0], false),
            ([1e40, 1.0, 0.0], false),
            ([f64::NAN, 1.0, 0.0], false),
        ] {
            for (x, image) in [(of(numbers), of([1.0; 3])), (of([1.0; 3]), of(numbers))] {
                let mut products = Products::default();
                products.keep(&Arc::new(Product::new(&x, &image)), usize::MAX);
                assert_eq!(products.0.len() == 1, held, "{numbers:?}");
            }
        }
    }

    #[test]
    fn products_take_no_more_bytes_than_they_may() {
        let some =
            |count: usize| Products((0..count).map(|_| Arc::new(Product::new(&of([1.0; 3]), &of([1.0; 3])))).collect());
        let each = some(1).0[0].bytes();
        assert_eq!(some(2).with(&some(9), 5 * each).0.len(), 5);
        assert_eq!(some(30).with(&some(9), 500 * each).0.len(), MOST);
    }
}

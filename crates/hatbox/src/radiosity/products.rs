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

use crate::linalg::MultiVector;
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

/// A function of the joined space, and what arrives of it ([`Arriving`](super::operators::Arriving)).
#[derive(Debug)]
pub(super) struct Product {
    pub(super) x: Vec<f32>,
    pub(super) image: Vec<f32>,
}

impl Product {
    fn new(x: &[f64], image: &[f64]) -> Self {
        let single = |v: &[f64]| v.par_iter().with_min_len(LEAST_NUMBERS).map(|&x| x as f32).collect();
        Self { x: single(x), image: single(image) }
    }

    /// What is known once it is known what arrives of these functions, one for each band.
    pub(super) fn of_bands(x: &MultiVector, image: &MultiVector) -> Vec<Arc<Self>> {
        let of_band = |band: usize| Arc::new(Self::new(x.band(band), image.band(band)));
        (0..x.bands()).into_par_iter().map(of_band).collect()
    }

    fn bytes(&self) -> usize {
        size_of_val(&*self.x) + size_of_val(&*self.image)
    }

    /// Whether single precision has room for the numbers.
    fn is_held(&self) -> bool {
        [&self.x, &self.image].into_iter().all(|numbers| are_held(numbers.iter().copied()))
    }

    /// Adds so many times these functions to `x`, and so many times what arrives of them to `image`.
    pub(super) fn add_all(all: &[(f64, &Self)], x: &mut [f64], image: &mut [f64]) {
        add_all(x, all, |product| &product.x);
        add_all(image, all, |product| &product.image);
    }

    /// Puts what arrives of x into `image`, if x is a multiple of this function; whether it is.
    fn multiple(&self, x: &[f64], image: &mut [f64]) -> bool {
        let Some(greatest) = (0..x.len()).max_by(|&i, &j| x[i].abs().total_cmp(&x[j].abs())) else { return true };
        let factor = if x[greatest] == 0.0 { 0.0 } else { x[greatest] / f64::from(self.x[greatest]) };
        let rounding = ROUNDING * x[greatest].abs();
        let same = |(&x, &known): (&f64, &f32)| (x - factor * f64::from(known)).abs() <= SAME * x.abs() + rounding;
        if !factor.is_finite() || !x.iter().zip(&self.x).all(same) {
            return false;
        }
        image.iter_mut().zip(&self.image).for_each(|(image, &known)| *image = factor * f64::from(known));
        true
    }
}

/// What is known of S from each band's functions.
#[derive(Debug, Clone, Default)]
pub(super) struct Products {
    of_bands: Vec<Vec<Arc<Product>>>,
    bytes: usize,
}

impl Products {
    /// Adds a product to those of a band, if so many bytes are enough for it and all others, and single precision for its numbers.
    pub(super) fn keep(&mut self, band: usize, product: &Arc<Product>, most_bytes: usize) {
        self.of_bands.resize_with(self.of_bands.len().max(band + 1), Vec::new);
        let bytes = self.bytes + product.bytes();
        if self.of_bands[band].len() < MOST && bytes <= most_bytes && product.is_held() {
            self.of_bands[band].push(Arc::clone(product));
            self.bytes = bytes;
        }
    }

    /// These and older ones, as many as may be kept in so many bytes.
    pub(super) fn with(mut self, older: &Self, most_bytes: usize) -> Self {
        // The same number of each band at a time, so that none goes without.
        let longest = older.of_bands.iter().map(Vec::len).max().unwrap_or(0);
        for k in 0..longest {
            for (band, of_band) in older.of_bands.iter().enumerate() {
                of_band.get(k).into_iter().for_each(|product| self.keep(band, product, most_bytes));
            }
        }
        self
    }

    /// Puts what arrives of a band's x into `image`, which holds zeros, if x is a multiple of one function that is known; whether it is.
    pub(super) fn image_of(&self, band: usize, x: &[f64], image: &mut [f64]) -> bool {
        x.iter().all(|&x| x == 0.0) || self.of_band(band).iter().any(|product| product.multiple(x, image))
    }

    /// Those of a band.
    pub(super) fn of_band(&self, band: usize) -> &[Arc<Product>] {
        self.of_bands.get(band).map_or(&[], Vec::as_slice)
    }
}

/// Numbers as they are kept.
pub(super) fn round(x: &mut MultiVector) {
    x.as_mut_slice().par_iter_mut().with_min_len(LEAST_NUMBERS).for_each(|x| *x = f64::from(*x as f32));
}

/// Some bands as they are kept, each as it is if single precision has no room for it.
pub(super) fn rounded(x: &MultiVector, bands: &[usize]) -> MultiVector {
    let single = |&x: &f64| x as f32;
    let held: Vec<bool> = x.iter_bands().map(|x| are_held(x.iter().map(single))).collect();
    x.some(bands, |band, x| if held[band] { f64::from(single(&x)) } else { x })
}

/// Whether single precision has room for these numbers.
fn are_held(numbers: impl Iterator<Item = f32> + Clone) -> bool {
    let most = numbers.clone().fold(0.0, |most: f32, x| most.max(x.abs()));
    numbers.into_iter().all(f32::is_finite) && (most == 0.0 || most >= FAINT)
}

/// Adds so many times these numbers to `sum`, a piece after the other, so that it stays near.
fn add_all<'a>(sum: &mut [f64], all: &[(f64, &'a Product)], numbers: impl Fn(&'a Product) -> &'a [f32] + Sync) {
    sum.par_chunks_mut(LEAST_NUMBERS).enumerate().for_each(|(part, sum)| {
        for (factor, product) in all {
            let numbers = &numbers(product)[part * LEAST_NUMBERS..];
            sum.iter_mut().zip(numbers).for_each(|(sum, &number)| *sum += factor * f64::from(number));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small lamp ten million times brighter than a wall that shines as well: of all coefficients together the wall's are
    /// nothing, and yet they may be half of the light.
    #[test]
    fn a_dim_wall_beside_a_bright_lamp_is_not_overlooked() {
        let product = Product::new(&[1e7, 1.0, 0.0], &[1.0, 2.0, 3.0]);
        let arrived = |x: [f64; 3]| {
            let mut image = [0.0; 3];
            product.multiple(&x, &mut image).then_some(image)
        };
        assert_eq!(arrived([2e7, 2.0, 0.0]).expect("twice as bright"), [2.0, 4.0, 6.0]);
        for other in [[1e7, 0.0, 0.0], [1e7, 1.1, 0.0], [1e7, 1.0, 0.1]] {
            assert_eq!(arrived(other), None, "{other:?}");
        }
        assert_eq!(arrived([0.0; 3]).expect("dark"), [0.0; 3]);
    }

    #[test]
    fn a_dark_band_is_known_and_bands_know_their_own_functions() {
        let mut products = Products::default();
        products.keep(1, &Arc::new(Product::new(&[1.0, 2.0], &[3.0, 4.0])), usize::MAX);
        let arrived = |band: usize, x: [f64; 2]| {
            let mut image = [0.0; 2];
            products.image_of(band, &x, &mut image).then_some(image)
        };
        for band in 0..3 {
            assert_eq!(arrived(band, [0.0; 2]), Some([0.0; 2]));
            assert_eq!(arrived(band, [2.0, 4.0]), (band == 1).then_some([6.0, 8.0]));
        }
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
            for (x, image) in [(numbers, [1.0; 3]), ([1.0; 3], numbers)] {
                let mut products = Products::default();
                products.keep(0, &Arc::new(Product::new(&x, &image)), usize::MAX);
                assert_eq!(products.of_band(0).len() == 1, held, "{numbers:?}");
            }
        }
    }

    #[test]
    fn each_band_is_rounded_for_itself() {
        let x = MultiVector::from_bands(3, vec![0.1, 0.2, 1e-40, 2e-40, 0.3, 0.4]).expect("three bands");
        let [a, b, c, d] = [0.1_f32, 0.2, 0.3, 0.4].map(f64::from);
        assert_eq!(rounded(&x, &[0, 1, 2]).as_slice(), [a, b, 1e-40, 2e-40, c, d]);
        assert_eq!(rounded(&x, &[1, 2]).as_slice(), [1e-40, 2e-40, c, d]);
    }

    #[test]
    fn products_take_no_more_bytes_than_they_may() {
        let product = Arc::new(Product::new(&[1.0; 3], &[1.0; 3]));
        let some = |counts: [usize; 2]| {
            let mut some = Products::default();
            for (band, count) in counts.into_iter().enumerate() {
                (0..count).for_each(|_| some.keep(band, &product, usize::MAX));
            }
            some
        };
        let lengths = |products: Products| [0, 1].map(|band| products.of_band(band).len());
        let each = product.bytes();
        assert_eq!(lengths(some([1, 1]).with(&some([9, 2]), 5 * each)), [3, 2]);
        assert_eq!(lengths(some([30, 1]).with(&some([9, 2]), 500 * each)), [MOST, 3]);
    }
}

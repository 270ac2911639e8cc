//! Σ N(x_r) v_r of rays that all count alike: what nearly all rays of most cells do, and so what a product costs.
//!
//! Compilers do not find the four bands of a coefficient in this loop: they left it to single numbers, or to wider vectors
//! that have to be put together from pieces. So there is a loop in vectors of four, which gives the same bits. It asks for
//! coefficients ray by ray, some time before they are needed: to ask for those of a whole word first has the processor wait.

#![expect(clippy::inline_always, reason = "loops must be compiled where their lengths are known")]

use super::kept::{Run, set_bits};
use super::source::{Number, Source};
use super::spots::Spots;
use crate::element::MAX_DOFS;

/// So many rays before they are needed coefficients are asked for: a guess.
const AHEAD: usize = 24;

/// The sums, if all cells have N functions and there are B lanes, of the rays of a word: the functions where each begins,
/// which of them there are, and where these ended.
#[cfg_attr(target_arch = "x86_64", expect(unsafe_code, reason = "AVX2, behind detection at run time"))]
#[inline(always)]
pub(super) fn sum_of<const N: usize, const B: usize, T: Number>(
    functions: &[[f64; MAX_DOFS]],
    (bits, hits): (u64, Run<'_>),
    source: Source<'_, T>,
    spots: &Spots,
) -> [[f64; B]; N] {
    #[cfg(target_arch = "x86_64")]
    if B == 4 && is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") {
        // SAFETY: the processor has both.
        let sums: [[f64; 4]; N] = unsafe { x86::sum_of(functions, (bits, hits), source, spots) };
        return sums.map(|of_function| std::array::from_fn(|band| of_function[band]));
    }
    portable(functions, (bits, hits), source, spots)
}

#[inline(always)]
fn portable<const N: usize, const B: usize, T: Number>(
    functions: &[[f64; MAX_DOFS]],
    (bits, hits): (u64, Run<'_>),
    source: Source<'_, T>,
    spots: &Spots,
) -> [[f64; B]; N] {
    let mut sums = [[0.0; B]; N];
    for (place, (ray, hit)) in set_bits(bits).zip(hits.iter()).enumerate() {
        ask_ahead::<N, B, T>(hits, place, source);
        let value = source.known_value::<N, B>(hit, spots);
        for (sums, function) in sums.iter_mut().zip(&functions[ray]) {
            sums.iter_mut().zip(value).for_each(|(sum, value)| *sum += function * value);
        }
    }
    sums
}

/// Asks for what a later ray will read.
#[inline(always)]
fn ask_ahead<const N: usize, const B: usize, T: Number>(hits: Run<'_>, place: usize, source: Source<'_, T>) {
    if let Some(coming) = hits.coming(place + AHEAD) {
        source.ask_for::<N, B>(source.known_place::<N, B>(coming.cell()));
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{MAX_DOFS, Number, Run, Source, Spots, ask_ahead, set_bits};
    use std::arch::x86_64::{_mm256_add_pd, _mm256_mul_pd, _mm256_set1_pd, _mm256_setr_pd, _mm256_setzero_pd};

    /// [`super::sum_of`] for four lanes.
    #[target_feature(enable = "avx2,bmi1")]
    pub(super) fn sum_of<const N: usize, T: Number>(
        functions: &[[f64; MAX_DOFS]],
        (bits, hits): (u64, Run<'_>),
        source: Source<'_, T>,
        spots: &Spots,
    ) -> [[f64; 4]; N] {
        let mut sums = [_mm256_setzero_pd(); N];
        for (place, (ray, hit)) in set_bits(bits).zip(hits.iter()).enumerate() {
            ask_ahead::<N, 4, T>(hits, place, source);
            let coefficients = source.known_cell::<N, 4>(hit.cell());
            let mut value = _mm256_setzero_pd();
            for (of_function, &there) in coefficients.chunks_exact(4).zip(&spots.functions(hit.spot())[..N]) {
                let [a, b, c, d] = std::array::from_fn(|band| of_function[band].into());
                value = _mm256_add_pd(value, _mm256_mul_pd(_mm256_set1_pd(there), _mm256_setr_pd(a, b, c, d)));
            }
            for (sum, &here) in sums.iter_mut().zip(&functions[ray]) {
                *sum = _mm256_add_pd(*sum, _mm256_mul_pd(_mm256_set1_pd(here), value));
            }
        }
        sums.map(bytemuck::cast)
    }
}

#[cfg(test)]
mod tests {
    use super::super::kept::Hits;
    use super::super::rays::Hit;
    use super::*;
    use crate::element::ALL;
    use crate::quadrature::sequence::point;

    /// Numbers that are not round.
    fn number<T: Number>(index: usize) -> T {
        T::nearest(point(7, index as u32)[0] - 0.4)
    }

    fn agrees<const N: usize, T: Number>(element: &crate::element::Element) {
        let (cells, rays) = (40, 50);
        let values: Vec<T> = (0..cells * 16 * N).map(number).collect();
        let source = Source::of_known(&values, 4, 16 * N);
        let spots = Spots::new(element);
        let functions: Vec<[f64; MAX_DOFS]> =
            (0..rays).map(|ray| std::array::from_fn(|k| number::<f64>(ray * MAX_DOFS + k))).collect();
        let ended: Vec<Hit> = (0..rays)
            .map(
                |ray| {
                    if ray % 7 == 3 { Hit::LOST } else { Hit::from_parts((ray * 11 % cells) as u32, (ray * 5) as u8) }
                },
            )
            .collect();
        let mut hits = Hits::new(rays as u32);
        hits.push(&ended);
        for (first, bits, run) in hits.of(0).words(0..rays) {
            let of_four: [[f64; 4]; N] = sum_of(&functions[first..], (bits, run), source, &spots);
            assert_eq!(of_four, portable(&functions[first..], (bits, run), source, &spots));
            let mut expected = [[0.0; 4]; N];
            for (ray, hit) in ended.iter().enumerate().filter(|(_, hit)| !hit.is_lost()) {
                for (k, sums) in expected.iter_mut().enumerate() {
                    for (band, sum) in sums.iter_mut().enumerate() {
                        let there = spots.functions(hit.spot()).iter().enumerate();
                        let value = |(l, n): (usize, &f64)| n * values[hit.cell() * 16 * N + 4 * l + band].into();
                        *sum += functions[ray][k] * there.map(value).sum::<f64>();
                    }
                }
            }
            for (found, expected) in of_four.iter().flatten().zip(expected.iter().flatten()) {
                assert!((found - expected).abs() < 1e-13, "{found} {expected}");
            }
        }
    }

    #[test]
    fn vectors_give_the_bits_of_single_numbers_and_both_are_the_formula() {
        agrees::<1, f32>(ALL[0].triangle);
        agrees::<3, f32>(ALL[1].triangle);
        agrees::<3, f64>(ALL[1].triangle);
        agrees::<4, f32>(ALL[2].quad.expect("bilinear functions live on quads"));
        agrees::<6, f64>(ALL[3].triangle);
    }
}

//! Σ N(x_r) v_r of rays that all count alike: what nearly all rays of most cells do, and so what a product costs.
//!
//! Compilers do not find the four bands of a coefficient in this loop: they left it to single numbers, or to wider vectors
//! that have to be put together from pieces. So there is a loop in vectors of four bands, and one in vectors of two functions where
//! there is one band; both give the bits of single numbers. They ask for
//! coefficients ray by ray, some time before they are needed: to ask for those of a whole word first has the processor wait.
//! Rays that met a lamp, of which a word has one now and then, are passed over as they come: to copy the others first takes longer.
//!
//! Tried and dropped: coefficients in 16 bits, half as much to read, and coefficients of joined functions with their numbers, of
//! which a million triangles have a third as much. Neither was faster: what memory gains, taking them apart takes.

#![expect(clippy::inline_always, reason = "loops must be compiled where their lengths are known")]

use super::kept::{Run, set_bits};
use super::rays::{Hit, Kinds};
use super::source::Source;
use super::spots::Spots;
use crate::element::MAX_DOFS;
use crate::linalg::Number;

/// So many rays before they are needed coefficients are asked for. Other paint took a tenth less time than with 24, and as much as with
/// 128 (`cargo bench -p hatbox --bench scale -- city 1000000 sampled`, with this number changed).
const AHEAD: usize = 64;

/// Rays of which 64 at the most ended somewhere.
pub(super) struct Word<'a> {
    /// The functions where each begins.
    pub(super) functions: &'a [[f64; MAX_DOFS]],
    /// Which of them ended somewhere, and where.
    pub(super) bits: u64,
    pub(super) hits: Run<'a>,
    /// Where those ended that are passed over.
    pub(super) excluded: Kinds,
}

/// The sums, if all cells have N functions and there are B lanes, of the rays of a word; `others` gets those that are passed over.
#[cfg_attr(target_arch = "x86_64", expect(unsafe_code, reason = "AVX2, behind detection at run time"))]
#[inline(always)]
pub(super) fn sum_of<const N: usize, const B: usize, T: Number>(
    word: &Word<'_>,
    source: Source<'_, T>,
    spots: &Spots,
    others: impl FnMut(usize, Hit),
) -> [[f64; B]; N] {
    #[cfg(target_arch = "x86_64")]
    if [1, 4].contains(&B) && is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") {
        if B == 4 {
            // SAFETY: the processor has both.
            let sums: [[f64; 4]; N] = unsafe { x86::sum_of_four(word, source, spots, others) };
            return sums.map(|of_function| std::array::from_fn(|band| of_function[band]));
        }
        // SAFETY: the processor has both.
        let sums = unsafe { x86::sum_of_one::<N, T>(word, source, spots, others) };
        return std::array::from_fn(|function| [sums[function]; B]);
    }
    portable(word, source, spots, others)
}

#[inline(always)]
fn portable<const N: usize, const B: usize, T: Number>(
    word: &Word<'_>,
    source: Source<'_, T>,
    spots: &Spots,
    mut others: impl FnMut(usize, Hit),
) -> [[f64; B]; N] {
    let mut sums = [[0.0; B]; N];
    for (place, (ray, hit)) in set_bits(word.bits).zip(word.hits.iter()).enumerate() {
        ask_ahead::<N, B, T>(word.hits, place, source);
        if hit.is_of(word.excluded) {
            others(ray, hit);
            continue;
        }
        let value = source.known_value::<N, B>(hit, spots);
        for (sums, function) in sums.iter_mut().zip(&word.functions[ray]) {
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
    use super::{Hit, MAX_DOFS, Number, Source, Spots, Word, ask_ahead, set_bits};
    use std::arch::x86_64::{_mm_add_pd, _mm_mul_pd, _mm_set1_pd, _mm_setr_pd, _mm_setzero_pd};
    use std::arch::x86_64::{_mm256_add_pd, _mm256_mul_pd, _mm256_set1_pd, _mm256_setr_pd, _mm256_setzero_pd};

    /// [`super::sum_of`] for four lanes.
    #[target_feature(enable = "avx2,bmi1")]
    pub(super) fn sum_of_four<const N: usize, T: Number>(
        word: &Word<'_>,
        source: Source<'_, T>,
        spots: &Spots,
        mut others: impl FnMut(usize, Hit),
    ) -> [[f64; 4]; N] {
        let (mut sums, there) = ([_mm256_setzero_pd(); N], spots.known::<N>());
        for (place, (ray, hit)) in set_bits(word.bits).zip(word.hits.iter()).enumerate() {
            ask_ahead::<N, 4, T>(word.hits, place, source);
            if hit.is_of(word.excluded) {
                others(ray, hit);
                continue;
            }
            let coefficients = source.known_cell::<N, 4>(hit.cell()).as_chunks::<4>().0;
            let mut value = _mm256_setzero_pd();
            for (of_function, &there) in coefficients.iter().zip(&there[usize::from(hit.spot())]) {
                let [a, b, c, d] = of_function.map(Into::into);
                value = _mm256_add_pd(value, _mm256_mul_pd(_mm256_set1_pd(there), _mm256_setr_pd(a, b, c, d)));
            }
            for (sum, &here) in sums.iter_mut().zip(&word.functions[ray]) {
                *sum = _mm256_add_pd(*sum, _mm256_mul_pd(_mm256_set1_pd(here), value));
            }
        }
        sums.map(bytemuck::cast)
    }

    /// [`super::sum_of`] for one lane. What is beyond N means nothing.
    #[target_feature(enable = "avx2,bmi1")]
    pub(super) fn sum_of_one<const N: usize, T: Number>(
        word: &Word<'_>,
        source: Source<'_, T>,
        spots: &Spots,
        mut others: impl FnMut(usize, Hit),
    ) -> [f64; MAX_DOFS] {
        let (mut sums, there) = ([_mm_setzero_pd(); MAX_DOFS / 2], spots.known::<N>());
        for (place, (ray, hit)) in set_bits(word.bits).zip(word.hits.iter()).enumerate() {
            ask_ahead::<N, 1, T>(word.hits, place, source);
            if hit.is_of(word.excluded) {
                others(ray, hit);
                continue;
            }
            let mut value = 0.0;
            for (&of_function, there) in
                source.known_cell::<N, 1>(hit.cell()).iter().zip(&there[usize::from(hit.spot())])
            {
                value += there * of_function.into();
            }
            let here = word.functions[ray].as_chunks::<2>().0;
            for (sum, &[a, b]) in sums.iter_mut().zip(here).take(N.div_ceil(2)) {
                *sum = _mm_add_pd(*sum, _mm_mul_pd(_mm_setr_pd(a, b), _mm_set1_pd(value)));
            }
        }
        const { assert!(MAX_DOFS.is_multiple_of(2)) };
        bytemuck::cast(sums)
    }
}

#[cfg(test)]
mod tests {
    use super::super::kept::Hits;
    use super::*;
    use crate::element::ALL;
    use crate::quadrature::sequence::point;

    /// Numbers that are not round.
    fn number<T: Number>(index: usize) -> T {
        T::nearest(point(7, index as u32)[0] - 0.4)
    }

    fn agrees<const N: usize, const B: usize, T: Number>(element: &crate::element::Element) {
        // More than are read ahead.
        let (cells, rays) = (40, 2 * AHEAD + 50);
        let values: Vec<T> = (0..cells * 16 * N).map(number).collect();
        let source = Source::of_known(&values, B, N);
        let spots = Spots::new(element);
        let functions: Vec<[f64; MAX_DOFS]> =
            (0..rays).map(|ray| std::array::from_fn(|k| number::<f64>(ray * MAX_DOFS + k))).collect();
        let hit = |ray: usize, flag| Hit::from_parts((ray * 11 % cells) as u32 | flag, (ray * 5) as u8);
        let flag = |ray: usize| if ray % 11 == 5 { 1 << (30 + ray % 2) } else { 0 };
        let ended: Vec<Hit> = (0..rays).map(|ray| if ray % 7 == 3 { Hit::LOST } else { hit(ray, flag(ray)) }).collect();
        let mut hits = Hits::new(rays as u32);
        hits.push(&ended);
        let (mut found, mut others) = ([[0.0; B]; N], Vec::new());
        for (first, bits, hits) in hits.of(0).words(0..rays) {
            let word = Word { functions: &functions[first..], bits, hits, excluded: Kinds::LAMPS_AND_LINKED };
            let mut passed = Vec::new();
            let sums: [[f64; B]; N] = sum_of(&word, source, &spots, |ray, hit| others.push((first + ray, hit)));
            let single = portable(&word, source, &spots, |ray, hit| passed.push((first + ray, hit)));
            assert_eq!(sums.map(|of| of.map(f64::to_bits)), single.map(|of| of.map(f64::to_bits)));
            assert!(others.ends_with(&passed));
            found.iter_mut().flatten().zip(sums.iter().flatten()).for_each(|(sum, more)| *sum += more);
        }
        let ended = ended.iter().enumerate().filter(|(_, hit)| !hit.is_lost()).map(|(ray, &hit)| (ray, hit));
        let (passed, counting): (Vec<_>, Vec<_>) = ended.partition(|&(ray, _)| flag(ray) > 0);
        assert_eq!(others, passed);
        let expected = |function: usize, band: usize| -> f64 {
            let of_ray = |&(ray, hit): &(usize, Hit)| {
                let cell = source.known_cell::<N, B>(hit.cell());
                let there = spots.functions(hit.spot()).iter().enumerate();
                let value: f64 = there.map(|(l, n)| n * cell[B * l + band].into()).sum();
                functions[ray][function] * value
            };
            counting.iter().map(of_ray).sum()
        };
        for (function, bands) in found.iter().enumerate() {
            for (band, &found) in bands.iter().enumerate() {
                let expected = expected(function, band);
                assert!((found - expected).abs() < 1e-12, "{found} {expected}");
            }
        }
    }

    fn all_agree<const N: usize>(element: &crate::element::Element) {
        agrees::<N, 1, f32>(element);
        agrees::<N, 1, f64>(element);
        agrees::<N, 4, f32>(element);
        agrees::<N, 4, f64>(element);
    }

    #[test]
    fn vectors_give_the_bits_of_single_numbers_and_both_are_the_formula() {
        all_agree::<1>(ALL[0].triangle);
        all_agree::<3>(ALL[1].triangle);
        all_agree::<4>(ALL[2].quad.expect("bilinear functions live on quads"));
        all_agree::<6>(ALL[3].triangle);
    }
}

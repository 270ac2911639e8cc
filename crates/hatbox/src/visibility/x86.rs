//! The vectors of [`super::lanes`] in AVX2 with fused multiply-add, and packets in AVX-512.

use super::build::{LEAF, WIDTH};
use super::lanes::{Doubles, Lanes, NONE, RAYS, Vector};
use std::arch::x86_64::{
    __m128, __m128i, __m256, __m256d, __m512, _CMP_LE_OQ, _CMP_NLE_UQ, _MM_HINT_T0, _mm_add_ps, _mm_andnot_ps,
    _mm_cmp_ps, _mm_cvtsi128_si32, _mm_fmsub_ps, _mm_fnmadd_ps, _mm_loadu_ps, _mm_loadu_si128, _mm_max_ps, _mm_min_ps,
    _mm_minpos_epu16, _mm_movemask_ps, _mm_mul_ps, _mm_or_si128, _mm_packus_epi32, _mm_prefetch, _mm_set1_epi16,
    _mm_set1_ps, _mm_sub_ps, _mm256_add_pd, _mm256_add_ps, _mm256_andnot_ps, _mm256_castps_si256,
    _mm256_castsi256_si128, _mm256_cmp_pd, _mm256_cmp_ps, _mm256_cvtps_pd, _mm256_div_pd, _mm256_extracti128_si256,
    _mm256_fmsub_ps, _mm256_fnmadd_ps, _mm256_loadu_pd, _mm256_loadu_ps, _mm256_max_pd, _mm256_max_ps, _mm256_min_pd,
    _mm256_min_ps, _mm256_movemask_pd, _mm256_movemask_ps, _mm256_mul_pd, _mm256_mul_ps, _mm256_or_ps, _mm256_set1_pd,
    _mm256_set1_ps, _mm256_srli_epi32, _mm256_storeu_pd, _mm256_sub_pd, _mm256_sub_ps, _mm512_abs_ps, _mm512_add_ps,
    _mm512_cmp_ps_mask, _mm512_fmsub_ps, _mm512_fnmadd_ps, _mm512_loadu_ps, _mm512_max_ps, _mm512_min_ps,
    _mm512_mul_ps, _mm512_set1_ps, _mm512_sub_ps,
};

/// Proof that the processor has AVX2, fused multiply-add, and the instructions on bits that came with them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx2(());

/// Proof that the processor has AVX-512 as well.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx512(Avx2);

impl Avx2 {
    #[inline]
    pub(super) fn detect() -> Option<Self> {
        let all = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt");
        all.then_some(Self(()))
    }
}

impl Avx512 {
    #[inline]
    pub(super) fn detect() -> Option<Self> {
        let all = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq");
        Avx2::detect().filter(|_| all).map(Self)
    }
}

/// A vector of one register. Values are made by [`Lanes`] only, whose implementors prove the feature.
macro_rules! vector {
    ($name:ident, $register:ty, $n:expr, $add:ident, $sub:ident, $mul:ident, $fmsub:ident, $fnmadd:ident, $min:ident,
     $max:ident, $splat:ident, |$x:ident| $abs:expr, |$y:ident, $z:ident| $at_most:expr) => {
        #[derive(Clone, Copy)]
        pub(super) struct $name($register);

        impl Vector<{ $n }> for $name {
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                // SAFETY: a value proves that the processor has the feature, here and below.
                Self(unsafe { $add(self.0, other.0) })
            }
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                // SAFETY: as above.
                Self(unsafe { $sub(self.0, other.0) })
            }
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                // SAFETY: as above.
                Self(unsafe { $mul(self.0, other.0) })
            }
            #[inline(always)]
            fn mul_sub(self, b: Self, c: Self) -> Self {
                // SAFETY: as above.
                Self(unsafe { $fmsub(self.0, b.0, c.0) })
            }
            #[inline(always)]
            fn neg_mul_add(self, b: Self, c: Self) -> Self {
                // SAFETY: as above.
                Self(unsafe { $fnmadd(self.0, b.0, c.0) })
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                // SAFETY: as above.
                Self(unsafe { $min(self.0, other.0) })
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                // SAFETY: as above.
                Self(unsafe { $max(self.0, other.0) })
            }
            #[inline(always)]
            fn abs(self) -> Self {
                let $x = self.0;
                // SAFETY: as above.
                Self(unsafe { $abs })
            }
            #[inline(always)]
            fn at_most(self, other: Self) -> u32 {
                let ($y, $z) = (self.0, other.0);
                // SAFETY: as above.
                unsafe { $at_most }
            }
            #[inline(always)]
            fn like(self, value: f32) -> Self {
                // SAFETY: as above.
                Self(unsafe { $splat(value) })
            }
        }
    };
}

vector!(
    Four,
    __m128,
    4,
    _mm_add_ps,
    _mm_sub_ps,
    _mm_mul_ps,
    _mm_fmsub_ps,
    _mm_fnmadd_ps,
    _mm_min_ps,
    _mm_max_ps,
    _mm_set1_ps,
    |x| _mm_andnot_ps(_mm_set1_ps(-0.0), x),
    |x, y| _mm_movemask_ps(_mm_cmp_ps::<_CMP_LE_OQ>(x, y)) as u32
);
vector!(
    Eight,
    __m256,
    8,
    _mm256_add_ps,
    _mm256_sub_ps,
    _mm256_mul_ps,
    _mm256_fmsub_ps,
    _mm256_fnmadd_ps,
    _mm256_min_ps,
    _mm256_max_ps,
    _mm256_set1_ps,
    |x| _mm256_andnot_ps(_mm256_set1_ps(-0.0), x),
    |x, y| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(x, y)) as u32
);
vector!(
    Sixteen,
    __m512,
    16,
    _mm512_add_ps,
    _mm512_sub_ps,
    _mm512_mul_ps,
    _mm512_fmsub_ps,
    _mm512_fnmadd_ps,
    _mm512_min_ps,
    _mm512_max_ps,
    _mm512_set1_ps,
    |x| _mm512_abs_ps(x),
    |x, y| u32::from(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(x, y))
);

/// Sixteen numbers in two registers.
#[derive(Clone, Copy)]
pub(super) struct Twice(Eight, Eight);

impl Vector<16> for Twice {
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(self.0.add(other.0), self.1.add(other.1))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(self.0.sub(other.0), self.1.sub(other.1))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(self.0.mul(other.0), self.1.mul(other.1))
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        Self(self.0.mul_sub(b.0, c.0), self.1.mul_sub(b.1, c.1))
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        Self(self.0.neg_mul_add(b.0, c.0), self.1.neg_mul_add(b.1, c.1))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.min(other.1))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1.max(other.1))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs(), self.1.abs())
    }
    #[inline(always)]
    fn at_most(self, other: Self) -> u32 {
        self.0.at_most(other.0) | self.1.at_most(other.1) << 8
    }
    #[inline(always)]
    fn like(self, value: f32) -> Self {
        Self(self.0.like(value), self.1.like(value))
    }
}

/// Four numbers of f64.
#[derive(Clone, Copy)]
pub(super) struct FourDoubles(__m256d);

impl Doubles for FourDoubles {
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: a value proves that the processor has the feature, here and below.
        Self(unsafe { _mm256_add_pd(self.0, other.0) })
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm256_sub_pd(self.0, other.0) })
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm256_mul_pd(self.0, other.0) })
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm256_div_pd(self.0, other.0) })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm256_min_pd(self.0, other.0) })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm256_max_pd(self.0, other.0) })
    }
    #[inline(always)]
    fn at_most(self, other: Self) -> u32 {
        // SAFETY: as above.
        unsafe { _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(self.0, other.0)) as u32 }
    }
    #[inline(always)]
    fn to_array(self) -> [f64; LEAF] {
        let mut values = [0.0; LEAF];
        // SAFETY: as above; the array holds the register.
        unsafe { _mm256_storeu_pd(values.as_mut_ptr(), self.0) };
        values
    }
}

/// Eight keys of sixteen bits.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(super) struct Keys(__m128i);

/// All bits in one lane of sixteen.
#[repr(align(16))]
struct Ones([u16; WIDTH]);

/// [`Ones`] for each lane.
static ONES: [Ones; WIDTH] = {
    let mut all = [const { Ones([0; WIDTH]) }; WIDTH];
    let mut lane = 0;
    while lane < WIDTH {
        all[lane].0[lane] = NONE as u16;
        lane += 1;
    }
    all
};

impl Lanes for Avx2 {
    type Leaf = Four;
    type Children = Eight;
    type Rays = Twice;
    type Doubles = FourDoubles;
    type Queue = Keys;

    #[inline(always)]
    fn doubles(self, values: &[f64; LEAF]) -> FourDoubles {
        // SAFETY: `self` proves that the processor has the feature; the array fills the register.
        FourDoubles(unsafe { _mm256_loadu_pd(values.as_ptr()) })
    }
    #[inline(always)]
    fn doubles_of_singles(self, values: &[f32; LEAF]) -> FourDoubles {
        // SAFETY: as above.
        FourDoubles(unsafe { _mm256_cvtps_pd(_mm_loadu_ps(values.as_ptr())) })
    }
    #[inline(always)]
    fn doubles_splat(self, value: f64) -> FourDoubles {
        // SAFETY: `self` proves that the processor has the feature.
        FourDoubles(unsafe { _mm256_set1_pd(value) })
    }

    #[inline(always)]
    fn empty(self) -> Keys {
        // SAFETY: `self` proves that the processor has the feature, here and below.
        Keys(unsafe { _mm_set1_epi16(-1) })
    }
    #[inline(always)]
    fn queue(self, enter: Eight, leave: Eight) -> Keys {
        // SAFETY: as above.
        unsafe {
            let missed = _mm256_cmp_ps::<_CMP_NLE_UQ>(enter.0, leave.0);
            let keys = _mm256_srli_epi32::<16>(_mm256_castps_si256(_mm256_or_ps(enter.0, missed)));
            Keys(_mm_packus_epi32(_mm256_castsi256_si128(keys), _mm256_extracti128_si256::<1>(keys)))
        }
    }
    #[inline(always)]
    fn first(self, queue: Keys) -> u32 {
        // SAFETY: as above.
        unsafe { _mm_cvtsi128_si32(_mm_minpos_epu16(queue.0)) as u32 }
    }
    #[inline(always)]
    fn without(self, queue: Keys, lane: u32) -> Keys {
        // SAFETY: as above; the array fills the register.
        unsafe { Keys(_mm_or_si128(queue.0, _mm_loadu_si128(ONES[lane as usize % WIDTH].0.as_ptr().cast()))) }
    }

    #[inline(always)]
    fn leaf(self, values: &[f32; LEAF]) -> Four {
        // SAFETY: `self` proves that the processor has the feature, here and below; the array fills the register.
        Four(unsafe { _mm_loadu_ps(values.as_ptr()) })
    }
    #[inline(always)]
    fn leaf_splat(self, value: f32) -> Four {
        // SAFETY: as above.
        Four(unsafe { _mm_set1_ps(value) })
    }
    #[inline(always)]
    fn children(self, values: &[f32; WIDTH]) -> Eight {
        // SAFETY: as above.
        Eight(unsafe { _mm256_loadu_ps(values.as_ptr()) })
    }
    #[inline(always)]
    fn children_splat(self, value: f32) -> Eight {
        // SAFETY: as above.
        Eight(unsafe { _mm256_set1_ps(value) })
    }
    #[inline(always)]
    fn rays(self, values: &[f32; RAYS]) -> Twice {
        let (low, high) = (values[..8].as_ptr(), values[8..].as_ptr());
        // SAFETY: as above; the array fills two registers.
        unsafe { Twice(Eight(_mm256_loadu_ps(low)), Eight(_mm256_loadu_ps(high))) }
    }
    #[inline(always)]
    fn rays_splat(self, value: f32) -> Twice {
        Twice(self.children_splat(value), self.children_splat(value))
    }
    #[inline(always)]
    fn prefetch(self, start: *const u8, bytes: usize) {
        for at in (0..bytes).step_by(64) {
            // SAFETY: as above. A prefetch reads nothing as far as the program can tell, wherever it points.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(at).cast()) };
        }
    }
}

impl Lanes for Avx512 {
    type Leaf = Four;
    type Children = Eight;
    type Rays = Sixteen;
    type Doubles = FourDoubles;
    type Queue = Keys;

    #[inline(always)]
    fn doubles(self, values: &[f64; LEAF]) -> FourDoubles {
        self.0.doubles(values)
    }
    #[inline(always)]
    fn doubles_of_singles(self, values: &[f32; LEAF]) -> FourDoubles {
        self.0.doubles_of_singles(values)
    }
    #[inline(always)]
    fn doubles_splat(self, value: f64) -> FourDoubles {
        self.0.doubles_splat(value)
    }

    #[inline(always)]
    fn empty(self) -> Keys {
        self.0.empty()
    }
    #[inline(always)]
    fn queue(self, enter: Eight, leave: Eight) -> Keys {
        self.0.queue(enter, leave)
    }
    #[inline(always)]
    fn first(self, queue: Keys) -> u32 {
        self.0.first(queue)
    }
    #[inline(always)]
    fn without(self, queue: Keys, lane: u32) -> Keys {
        self.0.without(queue, lane)
    }

    #[inline(always)]
    fn leaf(self, values: &[f32; LEAF]) -> Four {
        self.0.leaf(values)
    }
    #[inline(always)]
    fn leaf_splat(self, value: f32) -> Four {
        self.0.leaf_splat(value)
    }
    #[inline(always)]
    fn children(self, values: &[f32; WIDTH]) -> Eight {
        self.0.children(values)
    }
    #[inline(always)]
    fn children_splat(self, value: f32) -> Eight {
        self.0.children_splat(value)
    }
    #[inline(always)]
    fn rays(self, values: &[f32; RAYS]) -> Sixteen {
        // SAFETY: `self` proves that the processor has the feature; the array fills the register.
        Sixteen(unsafe { _mm512_loadu_ps(values.as_ptr()) })
    }
    #[inline(always)]
    fn rays_splat(self, value: f32) -> Sixteen {
        // SAFETY: `self` proves that the processor has the feature.
        Sixteen(unsafe { _mm512_set1_ps(value) })
    }
    #[inline(always)]
    fn prefetch(self, start: *const u8, bytes: usize) {
        self.0.prefetch(start, bytes);
    }
}

//! The two hot kernels in AVX2, operation for operation those of [`Node::slabs`] and [`Ray::cross`]: a compiler turns
//! those loops into half-width vectors and picks the masks together bit by bit, at half the speed.

use super::build::{LEAF, WIDTH};
use super::simd::{Kernels, Node, Slabs};
use super::triangle::{Block, Crossings, Ray};
use std::arch::x86_64::{
    __m256d, _CMP_GT_OQ, _CMP_LE_OQ, _CMP_LT_OQ, _CMP_NEQ_OQ, _mm256_add_pd, _mm256_and_pd, _mm256_andnot_pd,
    _mm256_cmp_pd, _mm256_cmp_ps, _mm256_div_pd, _mm256_loadu_pd, _mm256_loadu_ps, _mm256_max_ps, _mm256_min_ps,
    _mm256_movemask_pd, _mm256_movemask_ps, _mm256_mul_pd, _mm256_mul_ps, _mm256_or_pd, _mm256_set1_pd, _mm256_set1_ps,
    _mm256_setzero_pd, _mm256_setzero_ps, _mm256_storeu_pd, _mm256_storeu_ps, _mm256_sub_pd, _mm256_sub_ps,
};

/// Proof that the processor has AVX2.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx2(());

impl Avx2 {
    #[inline]
    pub(super) fn detect() -> Option<Self> {
        is_x86_feature_detected!("avx2").then_some(Self(()))
    }
}

impl Kernels for Avx2 {
    #[inline(always)]
    fn slabs(self, node: &Node, ray: &Slabs) -> (u32, [f32; WIDTH]) {
        // SAFETY: `self` proves that the processor has the feature.
        unsafe { slabs(node, ray) }
    }

    #[inline(always)]
    fn cross(self, ray: &Ray, block: &Block<LEAF>) -> Crossings<LEAF> {
        // SAFETY: `self` proves that the processor has the feature.
        unsafe { cross(ray, block) }
    }
}

/// # Safety
/// The processor must have AVX2. (Not marked as a target feature, which would rule out that it is always inlined; no
/// closures, which would not be.)
#[inline(always)]
unsafe fn slabs(node: &Node, ray: &Slabs) -> (u32, [f32; WIDTH]) {
    let mut enters = [0.0; WIDTH];
    // SAFETY: the caller vouches for the feature; loads and stores are of arrays of eight numbers.
    let mask = unsafe {
        let mut enter = _mm256_setzero_ps();
        let mut leave = _mm256_set1_ps(ray.end);
        for axis in 0..3 {
            let ([near, far], [from, to], [inverse, slack]) = (ray.rows[axis], ray.origins[axis], ray.inverses[axis]);
            let near = _mm256_sub_ps(_mm256_loadu_ps(node.rows[near].as_ptr()), _mm256_set1_ps(from));
            let far = _mm256_sub_ps(_mm256_loadu_ps(node.rows[far].as_ptr()), _mm256_set1_ps(to));
            enter = _mm256_max_ps(_mm256_mul_ps(near, _mm256_set1_ps(inverse)), enter);
            leave = _mm256_min_ps(_mm256_mul_ps(far, _mm256_set1_ps(slack)), leave);
        }
        _mm256_storeu_ps(enters.as_mut_ptr(), enter);
        _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(enter, leave))
    };
    (mask as u32, enters)
}

/// # Safety
/// As of [`slabs`].
#[inline(always)]
unsafe fn cross(ray: &Ray, block: &Block<LEAF>) -> Crossings<LEAF> {
    let mut found = Crossings { mask: 0, edges: [[0.0; LEAF]; 3], sum: [0.0; LEAF], t: [0.0; LEAF] };
    // SAFETY: the caller vouches for the feature; loads and stores are of arrays of four numbers.
    unsafe {
        let zero = _mm256_setzero_pd();
        let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
        let [i, j, k] = ray.axes;
        for corner in 0..3 {
            let rows = &block.corners[corner];
            let dx = _mm256_sub_pd(_mm256_loadu_pd(rows[i].as_ptr()), _mm256_set1_pd(ray.start[0]));
            let dy = _mm256_sub_pd(_mm256_loadu_pd(rows[j].as_ptr()), _mm256_set1_pd(ray.start[1]));
            let dz = _mm256_sub_pd(_mm256_loadu_pd(rows[k].as_ptr()), _mm256_set1_pd(ray.start[2]));
            x[corner] = _mm256_sub_pd(dx, _mm256_mul_pd(_mm256_set1_pd(ray.shear[0]), dz));
            y[corner] = _mm256_sub_pd(dy, _mm256_mul_pd(_mm256_set1_pd(ray.shear[1]), dz));
            z[corner] = _mm256_mul_pd(_mm256_set1_pd(ray.shear[2]), dz);
        }
        let u = _mm256_sub_pd(_mm256_mul_pd(x[2], y[1]), _mm256_mul_pd(y[2], x[1]));
        let v = _mm256_sub_pd(_mm256_mul_pd(x[0], y[2]), _mm256_mul_pd(y[0], x[2]));
        let w = _mm256_sub_pd(_mm256_mul_pd(x[1], y[0]), _mm256_mul_pd(y[1], x[0]));
        let sum = _mm256_add_pd(_mm256_add_pd(u, v), w);
        found.mask = inside([u, v, w], sum);
        if found.mask != 0 {
            let depth = _mm256_add_pd(_mm256_mul_pd(u, z[0]), _mm256_mul_pd(v, z[1]));
            let depth = _mm256_add_pd(depth, _mm256_mul_pd(w, z[2]));
            _mm256_storeu_pd(found.t.as_mut_ptr(), _mm256_div_pd(depth, sum));
            _mm256_storeu_pd(found.sum.as_mut_ptr(), sum);
            _mm256_storeu_pd(found.edges[0].as_mut_ptr(), u);
            _mm256_storeu_pd(found.edges[1].as_mut_ptr(), v);
            _mm256_storeu_pd(found.edges[2].as_mut_ptr(), w);
        }
    }
    found
}

/// The triangles whose edge functions are not on both sides of zero and sum to neither zero nor NaN, as bits.
///
/// # Safety
/// As of [`slabs`].
#[inline(always)]
unsafe fn inside(edges: [__m256d; 3], sum: __m256d) -> u32 {
    // SAFETY: the caller vouches for the feature.
    unsafe {
        let zero = _mm256_setzero_pd();
        let (mut below, mut above) = (zero, zero);
        for edge in edges {
            below = _mm256_or_pd(below, _mm256_cmp_pd::<_CMP_LT_OQ>(edge, zero));
            above = _mm256_or_pd(above, _mm256_cmp_pd::<_CMP_GT_OQ>(edge, zero));
        }
        let some = _mm256_cmp_pd::<_CMP_NEQ_OQ>(sum, zero);
        _mm256_movemask_pd(_mm256_andnot_pd(_mm256_and_pd(below, above), some)) as u32
    }
}

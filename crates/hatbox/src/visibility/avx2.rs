//! The two hot kernels in AVX2, operation for operation those of [`Node::slabs`] and [`Ray::cross`]: a compiler turns
//! those loops into half-width vectors and picks the masks together bit by bit, at half the speed.

use super::build::{LEAF, WIDTH};
use super::simd::{Kernels, Node, Slabs};
use super::triangle::{Block, Crossings, Ray};
use std::arch::x86_64::*;

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

#[inline]
#[target_feature(enable = "avx2")]
fn slabs(node: &Node, ray: &Slabs) -> (u32, [f32; WIDTH]) {
    let mut enter = _mm256_setzero_ps();
    let mut leave = _mm256_set1_ps(ray.end);
    for axis in 0..3 {
        let [near, far] = [0, 1].map(|side| {
            let plane = load8(&node.rows[ray.rows[axis][side]]);
            let from = _mm256_sub_ps(plane, _mm256_set1_ps(ray.origins[axis][side]));
            _mm256_mul_ps(from, _mm256_set1_ps(ray.inverses[axis][side]))
        });
        enter = _mm256_max_ps(near, enter);
        leave = _mm256_min_ps(far, leave);
    }
    let mask = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(enter, leave));
    let mut enters = [0.0; WIDTH];
    // SAFETY: the array has room for eight numbers.
    unsafe { _mm256_storeu_ps(enters.as_mut_ptr(), enter) };
    (mask as u32, enters)
}

#[inline]
#[target_feature(enable = "avx2")]
fn cross(ray: &Ray, block: &Block<LEAF>) -> Crossings<LEAF> {
    let zero = _mm256_setzero_pd();
    let [ox, oy, oz] = ray.axes.map(|axis| _mm256_set1_pd(ray.origin[axis]));
    let [sx, sy, sz] = ray.shear.map(|s| _mm256_set1_pd(s));
    let (mut x, mut y, mut z) = ([zero; 3], [zero; 3], [zero; 3]);
    for corner in 0..3 {
        let [cx, cy, cz] = ray.axes.map(|axis| load4(&block.corners[corner][axis]));
        let depth = _mm256_sub_pd(cz, oz);
        x[corner] = _mm256_sub_pd(_mm256_sub_pd(cx, ox), _mm256_mul_pd(sx, depth));
        y[corner] = _mm256_sub_pd(_mm256_sub_pd(cy, oy), _mm256_mul_pd(sy, depth));
        z[corner] = depth;
    }
    let edge = |j: usize, i: usize| _mm256_sub_pd(_mm256_mul_pd(x[j], y[i]), _mm256_mul_pd(y[j], x[i]));
    let [u, v, w] = [edge(2, 1), edge(0, 2), edge(1, 0)];
    let sum = _mm256_add_pd(_mm256_add_pd(u, v), w);
    let (below, above) = [u, v, w].into_iter().fold((zero, zero), |(below, above), e| {
        let less = _mm256_cmp_pd::<_CMP_LT_OQ>(e, zero);
        let more = _mm256_cmp_pd::<_CMP_GT_OQ>(e, zero);
        (_mm256_or_pd(below, less), _mm256_or_pd(above, more))
    });
    // Not on both sides, and the sum is neither zero nor NaN.
    let some = _mm256_cmp_pd::<_CMP_NEQ_OQ>(sum, zero);
    let inside = _mm256_andnot_pd(_mm256_and_pd(below, above), some);
    let mask = _mm256_movemask_pd(inside) as u32;
    let mut found = Crossings { mask, edges: [[0.0; LEAF]; 3], sum: [0.0; LEAF], t: [0.0; LEAF] };
    if mask != 0 {
        let [uz, vz, wz] = [(u, z[0]), (v, z[1]), (w, z[2])].map(|(e, z)| _mm256_mul_pd(e, _mm256_mul_pd(sz, z)));
        let depth = _mm256_add_pd(_mm256_add_pd(uz, vz), wz);
        found.t = store4(_mm256_div_pd(depth, sum));
        found.sum = store4(sum);
        found.edges = [store4(u), store4(v), store4(w)];
    }
    found
}

#[inline]
#[target_feature(enable = "avx2")]
fn load8(values: &[f32; 8]) -> __m256 {
    // SAFETY: the array holds eight numbers.
    unsafe { _mm256_loadu_ps(values.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn load4(values: &[f64; 4]) -> __m256d {
    // SAFETY: the array holds four numbers.
    unsafe { _mm256_loadu_pd(values.as_ptr()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn store4(values: __m256d) -> [f64; 4] {
    let mut array = [0.0; 4];
    // SAFETY: the array has room for four numbers.
    unsafe { _mm256_storeu_pd(array.as_mut_ptr(), values) };
    array
}

//! Vectors of f32 in three instruction sets, so that each kernel is written once.
//!
//! The kernels only cull; what they leave is decided in f64 by scalar code that all instruction sets share. So they may
//! round differently (with and without fused multiply-add, say) and answers are the same all the same.

use super::build::{LEAF, WIDTH};

/// Rays of a packet.
pub(super) const RAYS: usize = super::PACKET;

/// `N` numbers and what can be done to all at once. A value is proof that its instructions may be used.
pub(super) trait Vector<const N: usize>: Copy {
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    /// self · b − c, rounded once or twice.
    fn mul_sub(self, b: Self, c: Self) -> Self;
    /// c − self · b, rounded once or twice.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    /// The lesser; `other` if one is NaN.
    fn min(self, other: Self) -> Self;
    /// The greater; `other` if one is NaN.
    fn max(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// Where self ≤ other, as bits.
    fn at_most(self, other: Self) -> u32;
    /// A number in all lanes.
    fn like(self, value: f32) -> Self;
    fn to_array(self) -> [f32; N];
}

/// An instruction set that the processor is known to have.
pub(super) trait Lanes: Copy {
    /// The triangles of a leaf.
    type Leaf: Vector<LEAF>;
    /// The children of a node.
    type Children: Vector<WIDTH>;
    /// The rays of a packet.
    type Rays: Vector<RAYS>;

    fn leaf(self, values: &[f32; LEAF]) -> Self::Leaf;
    fn leaf_splat(self, value: f32) -> Self::Leaf;
    fn children(self, values: &[f32; WIDTH]) -> Self::Children;
    fn children_splat(self, value: f32) -> Self::Children;
    fn rays(self, values: &[f32; RAYS]) -> Self::Rays;
    fn rays_splat(self, value: f32) -> Self::Rays;
    /// Asks for the memory of a value that is soon needed.
    fn prefetch<T>(self, value: &T);
}

/// Plain arrays: every processor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Portable;

/// An array whose loops compile to whatever vector instructions there are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Array<const N: usize>([f32; N]);

impl<const N: usize> Array<N> {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self.0;
        for (x, &y) in out.iter_mut().zip(&other.0) {
            *x = f(*x, y);
        }
        Self(out)
    }
}

impl<const N: usize> Vector<N> for Array<N> {
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |x, y| x + y)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |x, y| x - y)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |x, y| x * y)
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, |x, y| x / y)
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        self.mul(b).sub(c)
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        c.sub(self.mul(b))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |x, y| if x < y { x } else { y })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |x, y| if x > y { x } else { y })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }
    #[inline(always)]
    fn at_most(self, other: Self) -> u32 {
        let mut mask = 0;
        for k in 0..N {
            mask |= u32::from(self.0[k] <= other.0[k]) << k;
        }
        mask
    }
    #[inline(always)]
    fn like(self, value: f32) -> Self {
        Self([value; N])
    }
    #[inline(always)]
    fn to_array(self) -> [f32; N] {
        self.0
    }
}

impl Lanes for Portable {
    type Leaf = Array<LEAF>;
    type Children = Array<WIDTH>;
    type Rays = Array<RAYS>;

    #[inline(always)]
    fn leaf(self, values: &[f32; LEAF]) -> Self::Leaf {
        Array(*values)
    }
    #[inline(always)]
    fn leaf_splat(self, value: f32) -> Self::Leaf {
        Array([value; LEAF])
    }
    #[inline(always)]
    fn children(self, values: &[f32; WIDTH]) -> Self::Children {
        Array(*values)
    }
    #[inline(always)]
    fn children_splat(self, value: f32) -> Self::Children {
        Array([value; WIDTH])
    }
    #[inline(always)]
    fn rays(self, values: &[f32; RAYS]) -> Self::Rays {
        Array(*values)
    }
    #[inline(always)]
    fn rays_splat(self, value: f32) -> Self::Rays {
        Array([value; RAYS])
    }
    #[inline(always)]
    fn prefetch<T>(self, _value: &T) {}
}

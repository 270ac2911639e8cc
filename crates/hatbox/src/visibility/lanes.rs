//! Vectors of f32 in three instruction sets, so that each kernel is written once.
//!
//! Kernels of f32 only cull, so they may round differently, with and without fused multiply-add, say. What decides is
//! f64: scalar code that all instruction sets share, and [`Doubles`], whose operations are each rounded once and alike
//! (so there is no fused one among them). Answers are the same on all.

use super::build::{LEAF, WIDTH};

/// Rays of a packet.
pub(super) const RAYS: usize = super::PACKET;

/// `N` numbers and what can be done to all at once. A value is proof that its instructions may be used.
pub(super) trait Vector<const N: usize>: Copy {
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
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
}

/// Four numbers of f64; every instruction set rounds them alike.
pub(super) trait Doubles: Copy {
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    /// The lesser; `other` if one is NaN.
    fn min(self, other: Self) -> Self;
    /// The greater; `other` if one is NaN.
    fn max(self, other: Self) -> Self;
    /// Where self ≤ other, as bits.
    fn at_most(self, other: Self) -> u32;
    fn to_array(self) -> [f64; LEAF];
}

/// The upper half of a number that is not negative: rounded down, and ordered like the number.
#[inline(always)]
pub(super) fn key(x: f32) -> u32 {
    x.to_bits() >> 16
}

/// The key of no child, greater than that of any number.
pub(super) const NONE: u32 = 0xFFFF;

/// An instruction set that the processor is known to have.
pub(super) trait Lanes: Copy {
    /// The triangles of a leaf.
    type Leaf: Vector<LEAF>;
    /// The children of a node.
    type Children: Vector<WIDTH>;
    /// The rays of a packet.
    type Rays: Vector<RAYS>;
    /// The triangles of a leaf, exactly.
    type Doubles: Doubles;
    /// The keys of some children.
    type Queue: Copy;

    fn leaf(self, values: &[f32; LEAF]) -> Self::Leaf;
    fn leaf_splat(self, value: f32) -> Self::Leaf;
    fn children(self, values: &[f32; WIDTH]) -> Self::Children;
    fn children_splat(self, value: f32) -> Self::Children;
    fn rays(self, values: &[f32; RAYS]) -> Self::Rays;
    fn rays_splat(self, value: f32) -> Self::Rays;
    fn doubles(self, values: &[f64; LEAF]) -> Self::Doubles;
    fn doubles_of_singles(self, values: &[f32; LEAF]) -> Self::Doubles;
    fn doubles_splat(self, value: f64) -> Self::Doubles;
    /// No children.
    fn empty(self) -> Self::Queue;
    /// The children that are entered no later than left, by where they are entered, which is not negative.
    fn queue(self, enter: Self::Children, leave: Self::Children) -> Self::Queue;
    /// The [`key`] of the first child of a queue, [`NONE`] if there is none, and in the upper half of the number its lane.
    fn first(self, queue: Self::Queue) -> u32;
    /// A queue without the child of a lane.
    fn without(self, queue: Self::Queue, lane: u32) -> Self::Queue;
    /// Asks for some memory that is soon needed; it need not exist.
    fn prefetch(self, start: *const u8, bytes: usize);
}

/// Plain arrays: every processor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Portable;

/// An array whose loops compile to whatever vector instructions there are.
#[derive(Debug, Clone, Copy)]
pub(super) struct Array<const N: usize, T = f32>([T; N]);

impl<const N: usize, T: Copy> Array<N, T> {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(T, T) -> T) -> Self {
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
}

impl Doubles for Array<LEAF, f64> {
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
    fn min(self, other: Self) -> Self {
        self.zip(other, |x, y| if x < y { x } else { y })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |x, y| if x > y { x } else { y })
    }
    #[inline(always)]
    fn at_most(self, other: Self) -> u32 {
        let mut mask = 0;
        for k in 0..LEAF {
            mask |= u32::from(self.0[k] <= other.0[k]) << k;
        }
        mask
    }
    #[inline(always)]
    fn to_array(self) -> [f64; LEAF] {
        self.0
    }
}

impl Lanes for Portable {
    type Leaf = Array<LEAF>;
    type Children = Array<WIDTH>;
    type Rays = Array<RAYS>;
    type Doubles = Array<LEAF, f64>;
    type Queue = [u16; WIDTH];

    #[inline(always)]
    fn doubles(self, values: &[f64; LEAF]) -> Self::Doubles {
        Array(*values)
    }
    #[inline(always)]
    fn doubles_of_singles(self, values: &[f32; LEAF]) -> Self::Doubles {
        let [a, b, c, d] = *values;
        Array([a.into(), b.into(), c.into(), d.into()])
    }
    #[inline(always)]
    fn doubles_splat(self, value: f64) -> Self::Doubles {
        Array([value; LEAF])
    }

    #[inline(always)]
    fn empty(self) -> Self::Queue {
        [NONE as u16; WIDTH]
    }
    #[inline(always)]
    fn queue(self, enter: Self::Children, leave: Self::Children) -> Self::Queue {
        let mut queue = self.empty();
        for k in 0..WIDTH {
            if enter.0[k] <= leave.0[k] {
                queue[k] = key(enter.0[k]) as u16;
            }
        }
        queue
    }
    #[inline(always)]
    fn first(self, queue: Self::Queue) -> u32 {
        let mut first = u32::MAX;
        for k in 0..WIDTH {
            first = first.min(u32::from(queue[k]) << 16 | k as u32);
        }
        first.rotate_left(16)
    }
    #[inline(always)]
    fn without(self, mut queue: Self::Queue, lane: u32) -> Self::Queue {
        queue[lane as usize % WIDTH] = NONE as u16;
        queue
    }
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
    fn prefetch(self, _start: *const u8, _bytes: usize) {}
}

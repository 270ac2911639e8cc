//! Nodes and the tests of all eight children at once.
//!
//! The loops run over arrays of fixed length, which compile to vector instructions on every processor. The two hottest
//! have twins for AVX2, chosen at run time through [`Kernels`].

use super::build::{Bounds, LEAF, WIDTH};
use super::triangle::{Block, Crossings, Ray};
use glam::DVec3;

/// Marks a child that is a leaf; the rest is its block.
pub(super) const LEAF_BIT: u32 = 1 << 31;

/// Relative error of the slab test's f32 arithmetic, with room to spare (Ize 2013: 3 roundings of 2⁻²⁴).
const SLACK: f64 = 1e-6;
/// Error of an f32 coordinate in units of the scene, with room to spare (a rounding of 2⁻²⁵).
const PAD: f64 = 1.0 / 4_194_304.0;
/// Directions shorter than this are parallel to a slab: the parameter of its planes is past every end, or the slab
/// contains the origin.
const PARALLEL: f64 = 1e-18;

/// The hot kernels, for some instruction set.
pub(super) trait Kernels: Copy {
    /// [`Node::slabs`].
    fn slabs(self, node: &Node, ray: &Slabs) -> (u32, [f32; WIDTH]);
    /// [`Ray::cross`].
    fn cross(self, ray: &Ray, block: &Block<LEAF>) -> Crossings<LEAF>;
}

/// The kernels for every processor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Portable;

impl Kernels for Portable {
    #[inline]
    fn slabs(self, node: &Node, ray: &Slabs) -> (u32, [f32; WIDTH]) {
        node.slabs(ray)
    }

    #[inline]
    fn cross(self, ray: &Ray, block: &Block<LEAF>) -> Crossings<LEAF> {
        ray.cross(block)
    }
}

/// Eight children.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// Least x, y, z, then greatest x, y, z. A child that is not there has an inside-out box at infinity.
    pub(super) rows: [[f32; WIDTH]; 6],
    /// Index of a node or [`LEAF_BIT`] and the index of a block.
    pub(super) child: [u32; WIDTH],
}

impl Node {
    pub(super) const EMPTY: Self = {
        let (lo, hi) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]);
        Self { rows: [lo, lo, lo, hi, hi, hi], child: [u32::MAX; WIDTH] }
    };

    pub(super) fn set(&mut self, lane: usize, bounds: &Bounds, child: u32) {
        for axis in 0..3 {
            self.rows[axis][lane] = bounds.lo[axis];
            self.rows[axis + 3][lane] = bounds.hi[axis];
        }
        self.child[lane] = child;
    }

    /// The children whose boxes the ray may meet, as bits, and where it enters each.
    #[inline]
    pub(super) fn slabs(&self, ray: &Slabs) -> (u32, [f32; WIDTH]) {
        let mut enter = [0.0_f32; WIDTH];
        let mut leave = [ray.end; WIDTH];
        for axis in 0..3 {
            let (near, far) = (&self.rows[ray.rows[axis][0]], &self.rows[ray.rows[axis][1]]);
            let [near_origin, far_origin] = ray.origins[axis];
            let [near_inverse, far_inverse] = ray.inverses[axis];
            for k in 0..WIDTH {
                let n = (near[k] - near_origin) * near_inverse;
                let f = (far[k] - far_origin) * far_inverse;
                enter[k] = if n > enter[k] { n } else { enter[k] };
                leave[k] = if f < leave[k] { f } else { leave[k] };
            }
        }
        let mut mask = 0;
        for k in 0..WIDTH {
            mask |= u32::from(enter[k] <= leave[k]) << k;
        }
        (mask, enter)
    }

    /// Squared distances of the boxes from a point, in normalised coordinates.
    #[inline]
    pub(super) fn distances_squared(&self, point: [f32; 3]) -> [f32; WIDTH] {
        let mut sum = [0.0_f32; WIDTH];
        for (axis, p) in point.into_iter().enumerate() {
            for (k, sum) in sum.iter_mut().enumerate() {
                let gap = (self.rows[axis][k] - p).max(p - self.rows[axis + 3][k]).max(0.0);
                *sum += gap * gap;
            }
        }
        sum
    }

    /// The children whose boxes meet a box, as bits.
    pub(super) fn overlaps(&self, bounds: &Bounds) -> u32 {
        let meets = |k: usize| {
            (0..3).all(|axis| self.rows[axis][k] <= bounds.hi[axis] && self.rows[axis + 3][k] >= bounds.lo[axis])
        };
        (0..WIDTH).map(|k| u32::from(meets(k)) << k).sum()
    }

    /// Those of the children in `mask` whose boxes reach below the plane normal · x = offset.
    #[inline]
    pub(super) fn below(&self, mask: u32, normal: [f32; 3], offset: f32) -> u32 {
        let row = |axis: usize| &self.rows[if normal[axis] > 0.0 { axis } else { axis + 3 }];
        let (x, y, z) = (row(0), row(1), row(2));
        let mut below = 0;
        for k in 0..WIDTH {
            // Zero times the infinity of an absent child is NaN and keeps its bit out.
            let least = normal[0] * x[k] + normal[1] * y[k] + normal[2] * z[k];
            below |= u32::from(least < offset) << k;
        }
        mask & below
    }
}

/// The map from space to coordinates in which the scene fills [−1, 1], where f32 serves any scene equally.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub(super) center: DVec3,
    /// Half the longest side of the scene.
    pub(super) size: f64,
}

impl Frame {
    pub(super) fn around(points: impl Iterator<Item = DVec3>) -> Self {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (lo, hi) = points.fold(empty, |(lo, hi), p| (lo.min(p), hi.max(p)));
        let size = (0.5 * hi - 0.5 * lo).max_element();
        let usable = size > 0.0 && size.is_finite();
        Self {
            center: if lo.x <= hi.x { 0.5 * lo + 0.5 * hi } else { DVec3::ZERO },
            size: if usable { size } else { 1.0 },
        }
    }

    pub(super) fn to_local(self, point: DVec3) -> DVec3 {
        (point - self.center) / self.size
    }

    /// The box around points, in f32 rounded outward; the rounding of the map itself is included.
    pub(super) fn bounds(self, points: &[DVec3]) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for &point in points {
            let local = self.to_local(point).to_array();
            for (axis, x) in local.into_iter().enumerate() {
                let (x, error) = (x as f32, (x.abs() * f64::EPSILON) as f32);
                bounds.lo[axis] = bounds.lo[axis].min((x - error).next_down());
                bounds.hi[axis] = bounds.hi[axis].max((x + error).next_up());
            }
        }
        bounds
    }

    /// A lower bound of the distance in space from the f32 distance² of a box.
    pub(super) fn least_distance(self, squared: f32, point: DVec3) -> f64 {
        let reach = self.to_local(point).abs().max_element().max(1.0);
        (f64::from(squared).sqrt() * (1.0 - SLACK) - 4.0 * PAD * reach) * self.size
    }
}

/// A ray as the slab test wants it, in normalised coordinates with a direction of unit length.
///
/// The boxes are conservative because the origin is moved back by [`PAD`] for planes where the ray enters and forward
/// where it leaves, and because leaving is delayed by [`SLACK`], more than the arithmetic can err.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slabs {
    /// Rows of [`Node::rows`] that the ray enters and leaves by, for each axis.
    pub(super) rows: [[usize; 2]; 3],
    pub(super) origins: [[f32; 2]; 3],
    pub(super) inverses: [[f32; 2]; 3],
    pub(super) end: f32,
    /// Length of the direction over the size of the scene.
    speed: f64,
    /// No triangle is further away.
    reach: f64,
}

impl Slabs {
    #[inline]
    pub(super) fn new(frame: Frame, origin: DVec3, direction: DVec3, end: f64) -> Self {
        let (origin, length) = (frame.to_local(origin), direction.length());
        let shortest = PARALLEL * length;
        let largest = origin.abs().max_element();
        let pad = PAD * largest.max(1.0);
        let mut slabs = Self {
            rows: [[0; 2]; 3],
            origins: [[0.0; 2]; 3],
            inverses: [[0.0; 2]; 3],
            end: 0.0,
            speed: length / frame.size,
            reach: 2.0 * largest + 4.0,
        };
        for (axis, (o, d)) in origin.to_array().into_iter().zip(direction.to_array()).enumerate() {
            let inverse = if d.abs() < shortest { 1.0 / PARALLEL } else { length / d };
            let forward = inverse > 0.0;
            slabs.rows[axis] = if forward { [axis, axis + 3] } else { [axis + 3, axis] };
            let pad = if forward { pad } else { -pad };
            slabs.origins[axis] = [(o + pad) as f32, (o - pad) as f32];
            slabs.inverses[axis] = [inverse as f32, (inverse * (1.0 + SLACK)) as f32];
        }
        slabs.stop_at(end);
        slabs
    }

    /// Shortens the ray to t ≤ `end`.
    #[inline]
    pub(super) fn stop_at(&mut self, end: f64) {
        self.end = ((end * self.speed).min(self.reach) * (1.0 + SLACK)) as f32;
    }

    /// Whether something entered at `enter` is past the end.
    #[inline]
    pub(super) fn is_past(&self, enter: f32) -> bool {
        enter > self.end
    }
}

//! Nodes of the tree, and rays as the test of all eight children at once wants them.

use super::build::{Bounds, WIDTH};
use super::exact;
use super::lanes::{Lanes, Vector};
use glam::DVec3;

/// Marks a child that is a leaf; the rest is its index.
pub(super) const LEAF_BIT: u32 = 1 << 31;

/// A rounding in f32, relative.
const UNIT: f64 = 1.0 / 16_777_216.0;
/// Relative error of the slab test's ray parameters, with room to spare (Ize 2013: 3 roundings).
const SLACK: f64 = 16.0 * UNIT;
/// Error of the slab test in units of the scene: six roundings of f32, and the 1e-7 by which the exact test may err.
const PAD: f64 = 16.0 * UNIT;
/// Directions shorter than this are parallel to a slab: the parameter of its planes is past every end, or the slab
/// contains the origin.
const PARALLEL: f64 = 1e-18;
/// Keeps boxes off denormal numbers, with which arithmetic is slow.
const TINY: f32 = 1e-30;
/// From further away than this, in units of the scene, f32 sees nothing.
pub(super) const FAR: f64 = 1_048_576.0;

/// Eight children.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// Least x, y, z, then greatest x, y, z. A child that is not there has an inside-out box at infinity.
    pub(super) rows: [[f32; WIDTH]; 6],
    /// Index of a node or [`LEAF_BIT`] and the index of a leaf.
    pub(super) child: [u32; WIDTH],
    /// The children that are leaves, as bits.
    pub(super) leaves: u32,
}

impl Node {
    pub(super) const EMPTY: Self = {
        let (lo, hi) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]);
        Self { rows: [lo, lo, lo, hi, hi, hi], child: [u32::MAX; WIDTH], leaves: 0 }
    };

    pub(super) fn set(&mut self, lane: usize, bounds: &Bounds, child: u32) {
        for axis in 0..3 {
            self.rows[axis][lane] = bounds.lo[axis];
            self.rows[axis + 3][lane] = bounds.hi[axis];
        }
        self.child[lane] = child;
        self.leaves |= (child >> 31) << lane;
    }

    /// The children whose boxes the ray may meet, as bits, and where it enters each.
    #[inline(always)]
    pub(super) fn slabs<L: Lanes>(&self, lanes: L, ray: &Slabs) -> (u32, L::Children) {
        let mut enter = lanes.children_splat(0.0);
        let mut leave = lanes.children_splat(ray.end);
        for axis in 0..3 {
            let ([near, far], [scale, delayed], [shift, late]) = (ray.rows[axis], ray.scales[axis], ray.shifts[axis]);
            let near = lanes.children(&self.rows[near]);
            let far = lanes.children(&self.rows[far]);
            enter = near.mul_sub(lanes.children_splat(scale), lanes.children_splat(shift)).max(enter);
            leave = far.mul_sub(lanes.children_splat(delayed), lanes.children_splat(late)).min(leave);
        }
        (enter.at_most(leave), enter)
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
    /// Its inverse.
    pub(super) scale: f64,
}

impl Frame {
    /// The frame of the points between two corners.
    pub(super) fn between(lo: DVec3, hi: DVec3) -> Self {
        let size = (0.5 * hi - 0.5 * lo).max_element();
        let size = if size > 0.0 && size.is_finite() { size } else { 1.0 };
        let center = if lo.x <= hi.x { 0.5 * lo + 0.5 * hi } else { DVec3::ZERO };
        Self { center, size, scale: 1.0 / size }
    }

    #[inline(always)]
    pub(super) fn to_local(self, point: DVec3) -> DVec3 {
        (point - self.center) * self.scale
    }

    /// The box around points, in f32 rounded outward; the rounding of the map itself is included.
    pub(super) fn bounds(self, points: &[DVec3]) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for &point in points {
            let local = self.to_local(point).to_array();
            for (axis, x) in local.into_iter().enumerate() {
                let x = x as f32;
                let error = x.abs() * (2.0 * UNIT) as f32;
                bounds.lo[axis] = bounds.lo[axis].min(x - error - TINY);
                bounds.hi[axis] = bounds.hi[axis].max(x + error + TINY);
            }
        }
        bounds
    }

    /// A lower bound of the distance in space from the f32 distance² of a box.
    pub(super) fn least_distance(self, squared: f32, point: DVec3) -> f64 {
        let reach = self.to_local(point).abs().max_element().max(1.0);
        (f64::from(squared).sqrt() * (1.0 - SLACK) - PAD * reach) * self.size
    }
}

/// A ray in normalised coordinates, before its numbers become f32.
#[derive(Debug, Clone, Copy)]
pub(super) struct Local {
    pub(super) origin: [f64; 3],
    /// The direction, 1 along its longest axis.
    pub(super) direction: [f64; 3],
    /// Length along that axis of the ray up to t = 1.
    pub(super) length: f64,
    /// How far from the center the scene and the origin reach.
    pub(super) reach: f64,
    /// The axes, the longest of the direction last.
    pub(super) axes: [usize; 3],
    /// [`exact::guard`] in these coordinates.
    pub(super) guard: f64,
}

impl Local {
    /// `None` if the ray has no direction, and [`Far`] if f32 cannot tell where it goes.
    #[inline(always)]
    pub(super) fn new(frame: Frame, origin: DVec3, direction: DVec3, guard: f64) -> Result<Self, Far> {
        let axes = exact::axes(direction);
        let longest = direction.to_array()[axes[2]].abs();
        let origin = frame.to_local(origin);
        let size = origin.abs();
        let reach = size.x.max(size.y).max(size.z).max(1.0);
        let direction = (direction * (1.0 / longest)).to_array();
        let length = longest * frame.scale;
        // Written so that NaN fails. Below 1e-300 the inverse is not finite.
        if !(reach < FAR && longest > 1e-300 && length > 1e-30 && length < 1e30) {
            return Err(Far);
        }
        Ok(Self { origin: origin.to_array(), direction, length, reach, axes, guard: guard * frame.scale })
    }

    /// The length of the ray up to t = `end`: no further than where the scene surely ends.
    #[inline(always)]
    pub(super) fn length_to(&self, end: f64) -> f64 {
        let (length, most) = (end * self.length, 2.0 * self.reach + 4.0);
        if length < most { length } else { most }
    }
}

/// The mark of a ray that f32 does not serve: endless, nearly without length, or from far outside the scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct Far;

/// A ray as the slab test wants it. Its parameter is the length along the longest axis of the direction.
///
/// The boxes are conservative because the origin is moved back by [`PAD`] for planes where the ray enters and forward
/// where it leaves, and because leaving is delayed by [`SLACK`], more than the arithmetic can err.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slabs {
    /// Rows of [`Node::rows`] that the ray enters and leaves by, for each axis.
    rows: [[usize; 2]; 3],
    /// The parameter at a plane is plane · scale − shift.
    scales: [[f32; 2]; 3],
    shifts: [[f32; 2]; 3],
    pub(super) end: f32,
}

impl Slabs {
    #[inline(always)]
    pub(super) fn new(ray: &Local, end: f64) -> Self {
        let mut slabs = Self { rows: [[0; 2]; 3], scales: [[0.0; 2]; 3], shifts: [[0.0; 2]; 3], end: 0.0 };
        let pad = (PAD * ray.reach) as f32;
        for axis in 0..3 {
            let (o, d) = (ray.origin[axis] as f32, ray.direction[axis] as f32);
            slabs.set(axis, d, o, pad);
        }
        slabs.stop_at(ray.length_to(end) as f32);
        slabs
    }

    /// Around all segments between two boxes, given by their corners; the parameter runs from 0 to 1.
    ///
    /// At each parameter s the segments' points lie between two moving planes, lo(s) and hi(s), on each axis: the same
    /// form as a ray, with another origin for either side. Planes that move in opposite directions are held still at
    /// the outermost.
    #[inline(always)]
    pub(super) fn around(from: [[f64; 3]; 2], to: [[f64; 3]; 2], reach: f64) -> Self {
        let mut slabs = Self { rows: [[0; 2]; 3], scales: [[0.0; 2]; 3], shifts: [[0.0; 2]; 3], end: 0.0 };
        for axis in 0..3 {
            let pad = PAD * reach;
            let [lo, hi] = [(from[0][axis] - pad, to[0][axis] - pad), (from[1][axis] + pad, to[1][axis] + pad)];
            let moves = [lo.1 - lo.0, hi.1 - hi.0];
            if moves[0] > 0.0 && moves[1] > 0.0 {
                slabs.set_side(axis, 0, moves[1] as f32, hi.0 as f32, axis);
                slabs.set_side(axis, 1, moves[0] as f32, lo.0 as f32, axis + 3);
            } else if moves[0] < 0.0 && moves[1] < 0.0 {
                slabs.set_side(axis, 0, moves[0] as f32, lo.0 as f32, axis + 3);
                slabs.set_side(axis, 1, moves[1] as f32, hi.0 as f32, axis);
            } else {
                slabs.set_side(axis, 0, 0.0, hi.0.max(hi.1) as f32, axis);
                slabs.set_side(axis, 1, 0.0, lo.0.min(lo.1) as f32, axis + 3);
            }
        }
        slabs.end = (1.0 + SLACK) as f32;
        slabs
    }

    /// Sets an axis from the direction along it. Without branches: the signs cannot be guessed.
    #[inline(always)]
    fn set(&mut self, axis: usize, direction: f32, origin: f32, pad: f32) {
        let back = usize::from(direction.is_sign_negative());
        let pad = pad.copysign(direction);
        let sure = direction.abs().max(PARALLEL as f32).copysign(direction);
        let scale = 1.0 / sure;
        let late = scale * (1.0 + SLACK) as f32;
        self.rows[axis] = [axis + 3 * back, axis + 3 - 3 * back];
        self.scales[axis] = [scale, late];
        self.shifts[axis] = [(origin + pad) * scale, (origin - pad) * late];
    }

    #[inline(always)]
    fn set_side(&mut self, axis: usize, side: usize, direction: f32, origin: f32, row: usize) {
        let scale = if direction.abs() < PARALLEL as f32 { (1.0 / PARALLEL) as f32 } else { 1.0 / direction };
        let scale = if side == 1 { scale * (1.0 + SLACK) as f32 } else { scale };
        self.rows[axis][side] = row;
        self.scales[axis][side] = scale;
        self.shifts[axis][side] = origin * scale;
    }

    /// Shortens the ray to a length.
    #[inline(always)]
    pub(super) fn stop_at(&mut self, length: f32) {
        self.end = length * (1.0 + SLACK) as f32;
    }
}

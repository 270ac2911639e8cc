//! Nodes of the tree, and rays as the test of all eight children at once wants them.

use super::build::{Bounds, WIDTH};
use super::exact::{Line, greater, lesser};
use super::lanes::{Lanes, Vector};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use std::ops::RangeInclusive;

/// Marks a child that is a leaf.
pub(super) const LEAF_BIT: u32 = 1 << 31;
/// The bit above the index of a leaf's first part. From it on, up to [`LEAF_BIT`], the number of the parts after the first.
const PARTS_BIT: u32 = 29;

/// Parts in a tree at the most, so that no child is like another, or like `u32::MAX`.
pub(super) const MOST_PARTS: usize = (1 << PARTS_BIT) - 8;

/// A child that is a leaf.
pub(super) fn leaf(first: usize, parts: usize) -> u32 {
    LEAF_BIT | ((parts - 1) as u32) << PARTS_BIT | first as u32
}

/// The parts of a child that is a leaf.
#[inline(always)]
pub(super) fn parts(child: u32) -> RangeInclusive<usize> {
    let first = (child & ((1 << PARTS_BIT) - 1)) as usize;
    first..=first + ((child ^ LEAF_BIT) >> PARTS_BIT) as usize
}

/// A rounding in f32, relative.
const UNIT: f64 = 1.0 / 16_777_216.0;
/// Relative error of the slab test's ray parameters, with room to spare (Ize 2013: 3 roundings).
const SLACK: f64 = 16.0 * UNIT;
/// Error of the slab test in units of the scene, for origins within [`REACH`]: at most fourteen roundings of f32 (of a
/// plane and the origin, two of its shift, four and four of the scale and the result, each times the distance; single rays
/// have fewer), and the 1e-7 by which the exact test may err.
const PAD: f64 = 24.0 * UNIT;
/// Rays that begin farther from the center than this, along an axis, are begun where they come so near.
const REACH: f64 = 1.001;
/// Past this parameter a ray that begins within [`REACH`] has left the scene.
const MOST: f64 = 2.0 * REACH + 0.01;
/// Directions shorter than this are parallel to a slab: the parameter of its planes is past every end, or the slab
/// contains the origin.
const PARALLEL: f64 = 1e-18;
/// From further away than this, in units of the scene, f32 sees nothing.
pub(super) const FAR: f64 = 1_048_576.0;

/// Eight children.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// By axis, the least and the greatest coordinates. A child that is not there has an inside-out box at infinity.
    pub(super) rows: [[[f32; WIDTH]; 2]; 3],
    /// Index of a node, or a [`leaf`].
    pub(super) child: [u32; WIDTH],
    /// The children that are leaves, as bits.
    pub(super) leaves: u32,
    _rest: [u32; 7],
}

impl Node {
    pub(super) const EMPTY: Self = {
        let (lo, hi) = ([f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]);
        Self { rows: [[lo, hi]; 3], child: [u32::MAX; WIDTH], leaves: 0, _rest: [0; 7] }
    };

    pub(super) fn set(&mut self, lane: usize, bounds: &Bounds, child: u32) {
        for axis in 0..3 {
            self.rows[axis][0][lane] = bounds.lo[axis];
            self.rows[axis][1][lane] = bounds.hi[axis];
        }
        self.child[lane] = child;
        self.leaves |= (child >> 31) << lane;
    }

    /// The child of a lane, modulo their number.
    #[inline(always)]
    pub(super) fn child(&self, lane: u32) -> u32 {
        self.child[lane as usize % WIDTH]
    }

    /// The children that a ray may meet, by where it enters their boxes.
    #[inline(always)]
    pub(super) fn queue<L: Lanes>(&self, lanes: L, ray: &Slabs) -> L::Queue {
        let [enter, leave] = self.slabs(lanes, ray);
        lanes.queue(enter, leave)
    }

    /// Where a ray enters and leaves the boxes of the children; those that it enters no later than it leaves may be met.
    #[inline(always)]
    pub(super) fn slabs<L: Lanes>(&self, lanes: L, ray: &Slabs) -> [L::Children; 2] {
        let (mut enter, mut leave) = (lanes.children_splat(0.0), lanes.children_splat(ray.end));
        for axis in 0..3 {
            let (scale, shift) = (lanes.children_splat(ray.scale[axis]), lanes.children_splat(ray.shift[axis]));
            // An index that is surely below two needs no check.
            let (near, far) = (ray.back[axis] & 1, !ray.back[axis] & 1);
            enter = lanes.children(&self.rows[axis][near]).mul_sub(scale, shift).max(enter);
            leave = lanes.children(&self.rows[axis][far]).mul_sub(scale, shift).min(leave);
        }
        [enter, leave]
    }

    /// The children whose boxes segments of a hull may meet, as bits.
    #[inline(always)]
    pub(super) fn meets<L: Lanes>(&self, lanes: L, hull: &Hull) -> u32 {
        let (mut enter, mut leave) = (lanes.children_splat(0.0), lanes.children_splat((1.0 + SLACK) as f32));
        for axis in 0..3 {
            let ([near, far], [scale, delayed], [shift, late]) =
                (hull.sides[axis], hull.scales[axis], hull.shifts[axis]);
            let near = lanes.children(&self.rows[axis][near & 1]);
            let far = lanes.children(&self.rows[axis][far & 1]);
            enter = near.mul_sub(lanes.children_splat(scale), lanes.children_splat(shift)).max(enter);
            leave = far.mul_sub(lanes.children_splat(delayed), lanes.children_splat(late)).min(leave);
        }
        enter.at_most(leave)
    }

    /// Squared distances of the boxes from a point, in normalised coordinates.
    #[inline]
    pub(super) fn distances_squared(&self, point: [f32; 3]) -> [f32; WIDTH] {
        let mut sum = [0.0_f32; WIDTH];
        for (axis, p) in point.into_iter().enumerate() {
            for (k, sum) in sum.iter_mut().enumerate() {
                let gap = (self.rows[axis][0][k] - p).max(p - self.rows[axis][1][k]).max(0.0);
                *sum += gap * gap;
            }
        }
        sum
    }

    /// The children whose boxes meet a box, as bits.
    pub(super) fn overlaps(&self, bounds: &Bounds) -> u32 {
        let meets = |k: usize| {
            (0..3).all(|axis| self.rows[axis][0][k] <= bounds.hi[axis] && self.rows[axis][1][k] >= bounds.lo[axis])
        };
        (0..WIDTH).map(|k| u32::from(meets(k)) << k).sum()
    }

    /// Those of the children in `mask` whose boxes reach below the plane normal · x = offset.
    #[inline]
    pub(super) fn below(&self, mask: u32, normal: [f32; 3], offset: f32) -> u32 {
        let row = |axis: usize| &self.rows[axis][usize::from(normal[axis] <= 0.0)];
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
    /// The greatest distance of the scene from the center along an axis.
    pub(super) size: f64,
    /// Its inverse.
    pub(super) scale: f64,
}

impl Frame {
    /// The frame of the points between two corners.
    pub(super) fn between(lo: DVec3, hi: DVec3) -> Self {
        let center = if lo.x <= hi.x { 0.5 * lo + 0.5 * hi } else { DVec3::ZERO };
        // Not half their difference: far from the origin the center may be rounded to a corner.
        let size = (hi - center).max(center - lo).max_element();
        let size = if size > 0.0 && size.is_finite() { size } else { 1.0 };
        Self { center, size, scale: 1.0 / size }
    }

    #[inline(always)]
    pub(super) fn to_local(self, point: DVec3) -> DVec3 {
        (point - self.center) * self.scale
    }

    /// The box around points, in f32 rounded outward by [`PAD`], so that the tests of rays need not care for roundings.
    pub(super) fn bounds(self, points: &[DVec3]) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for &point in points {
            let local = self.to_local(point).to_array();
            for (axis, x) in local.into_iter().enumerate() {
                let x = x as f32;
                bounds.lo[axis] = bounds.lo[axis].min(x - PAD as f32);
                bounds.hi[axis] = bounds.hi[axis].max(x + PAD as f32);
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

/// A ray in normalised coordinates, before its numbers become f32. Its parameter is the length along the longest axis of
/// the direction, from where it may first meet the scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct Local {
    /// Within [`REACH`] on each axis.
    pub(super) origin: [f64; 3],
    /// The direction, 1 along its longest axis.
    pub(super) direction: [f64; 3],
    /// The parameter's change with each coordinate: the inverse of the direction.
    pace: [f64; 3],
    /// The parameter at t is t · length − skipped.
    length: f64,
    skipped: f64,
    /// Past this parameter there is nothing.
    most: f64,
    /// The axes, the longest of the direction last.
    pub(super) axes: [usize; 3],
    /// [`super::exact::guard`] in these coordinates.
    pub(super) guard: f64,
}

impl Local {
    /// [`Far`] if the ray has no direction, or f32 cannot tell where it goes.
    #[inline(always)]
    pub(super) fn new(frame: Frame, line: &Line, guard: f64) -> Result<Self, Far> {
        let (size, paces) = (line.direction.abs(), line.pace.abs());
        let longest = greater(greater(size.x, size.y), size.z);
        let inverse = lesser(lesser(paces.x, paces.y), paces.z);
        let mut origin = frame.to_local(line.origin).to_array();
        let reach = greater(greater(origin[0].abs(), origin[1].abs()), origin[2].abs());
        let length = longest * frame.scale;
        // The greatest of several numbers may be one while others are NaN; their sum is not. Below 1e-290 the inverse of a
        // coordinate that matters may not be finite.
        let known = line.is_finite() && (origin[0] + origin[1] + origin[2]).is_finite();
        if !(known && reach < FAR && longest > 1e-290 && length > 1e-30 && length < 1e30) {
            return Err(Far);
        }
        let pace = (line.pace * longest).to_array();
        let direction = (line.direction * inverse).to_array();
        // Numbers one by one, since a structure that a call gives back would be waited for in memory by all rays.
        let (mut skipped, mut most) = (0.0, MOST);
        if reach > REACH {
            (origin, skipped, most) = approached(origin, direction);
        }
        Ok(Self { origin, direction, pace, length, skipped, most, axes: line.axes, guard: guard * frame.scale })
    }

    /// The parameter at t, no more than where the scene surely ends.
    #[inline(always)]
    pub(super) fn length_to(&self, t: f64) -> f64 {
        let length = t * self.length - self.skipped;
        if length < self.most { length } else { self.most }
    }
}

/// Where a ray enters the box that the scene surely lies in, the parameter there, and the greatest parameter after it.
#[cold]
fn approached(origin: [f64; 3], direction: [f64; 3]) -> ([f64; 3], f64, f64) {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for axis in 0..3 {
        let (o, d) = (origin[axis], direction[axis]);
        let side = REACH.copysign(d);
        // Parallel to the sides: infinite or NaN, which is neither the greater nor the lesser.
        enter = enter.max((-side - o) / d);
        leave = leave.min((side - o) / d);
    }
    if enter > leave {
        return (origin, 0.0, -1.0);
    }
    let at = |axis: usize| (origin[axis] + enter * direction[axis]).clamp(-REACH, REACH);
    ([0, 1, 2].map(at), enter, MOST)
}

/// The mark of a ray that f32 does not serve: endless, nearly without length, or from far outside the scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct Far;

/// A ray as the slab test wants it.
///
/// The boxes are larger than what they hold by [`PAD`], more than the arithmetic can err.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slabs {
    /// For each axis, 1 if the ray goes back, else 0.
    back: [usize; 3],
    /// The parameter at a plane is plane · scale − shift.
    scale: [f32; 3],
    shift: [f32; 3],
    pub(super) end: f32,
}

impl Slabs {
    #[inline(always)]
    pub(super) fn new(ray: &Local, end: f64) -> Self {
        let mut slabs = Self { back: [0; 3], scale: [0.0; 3], shift: [0.0; 3], end: 0.0 };
        for axis in 0..3 {
            let pace = ray.pace[axis];
            let sure = if pace.abs() < 1.0 / PARALLEL { pace.abs() } else { 1.0 / PARALLEL };
            slabs.back[axis] = usize::from(pace.is_sign_negative());
            slabs.scale[axis] = sure.copysign(pace) as f32;
            slabs.shift[axis] = (ray.origin[axis] * sure.copysign(pace)) as f32;
        }
        slabs.stop_at(ray.length_to(end) as f32);
        slabs
    }

    /// Shortens the ray to a length.
    #[inline(always)]
    pub(super) fn stop_at(&mut self, length: f32) {
        self.end = length * (1.0 + SLACK) as f32;
    }
}

/// What lies around all segments between two boxes, as the slab test wants it; the parameter runs from 0 to 1.
///
/// At each parameter s the segments' points lie between two moving planes, lo(s) and hi(s), on each axis: the same form
/// as a ray, with another origin for either side. Planes that move in opposite directions are held still at the
/// outermost. The boxes are conservative because the origins are moved by [`PAD`], and because leaving is delayed by
/// [`SLACK`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Hull {
    /// For each axis, the sides of the boxes that are met first and last.
    sides: [[usize; 2]; 3],
    /// The parameter at a plane is plane · scale − shift.
    scales: [[f32; 2]; 3],
    shifts: [[f32; 2]; 3],
}

impl Hull {
    /// Between two boxes, given by their corners.
    #[inline(always)]
    pub(super) fn around(from: [[f64; 3]; 2], to: [[f64; 3]; 2], reach: f64) -> Self {
        let mut hull = Self { sides: [[0; 2]; 3], scales: [[0.0; 2]; 3], shifts: [[0.0; 2]; 3] };
        for axis in 0..3 {
            let pad = PAD * reach;
            let [lo, hi] = [(from[0][axis] - pad, to[0][axis] - pad), (from[1][axis] + pad, to[1][axis] + pad)];
            let moves = [lo.1 - lo.0, hi.1 - hi.0];
            if moves[0] > 0.0 && moves[1] > 0.0 {
                hull.set(axis, 0, moves[1] as f32, hi.0 as f32, 0);
                hull.set(axis, 1, moves[0] as f32, lo.0 as f32, 1);
            } else if moves[0] < 0.0 && moves[1] < 0.0 {
                hull.set(axis, 0, moves[0] as f32, lo.0 as f32, 1);
                hull.set(axis, 1, moves[1] as f32, hi.0 as f32, 0);
            } else {
                hull.set(axis, 0, 0.0, hi.0.max(hi.1) as f32, 0);
                hull.set(axis, 1, 0.0, lo.0.min(lo.1) as f32, 1);
            }
        }
        hull
    }

    #[inline(always)]
    fn set(&mut self, axis: usize, which: usize, direction: f32, origin: f32, side: usize) {
        let scale = if direction.abs() < PARALLEL as f32 { (1.0 / PARALLEL) as f32 } else { 1.0 / direction };
        let scale = if which == 1 { scale * (1.0 + SLACK) as f32 } else { scale };
        self.sides[axis][which] = side;
        self.scales[axis][which] = scale;
        self.shifts[axis][which] = origin * scale;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaves_are_their_parts() {
        for (first, count) in [(0, 1), (0, 4), (5, 2), (MOST_PARTS - 1, 1), (MOST_PARTS - 4, 4), (MOST_PARTS - 1, 4)] {
            let child = leaf(first, count);
            assert!(child & LEAF_BIT != 0 && child != u32::MAX);
            assert_eq!(parts(child), first..=first + count - 1);
        }
    }
}

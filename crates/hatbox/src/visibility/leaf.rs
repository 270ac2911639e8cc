//! Triangles in f32: what the exact test need not see.
//!
//! A leaf holds its corners in f32, half the memory of f64. The same watertight test in f32 with bounds of its error
//! sorts triangles into those surely missed, those surely crossed between the ends, and the doubtful rest, which alone
//! is decided by [`super::exact`].
//!
//! The bounds, in normalised coordinates, with u = 2⁻²⁴, the ray within M of the center and shears up to s: a sheared
//! coordinate errs by at most E = 24 u M (s ≤ 1) or 64 u M (s ≤ 3), roundings of the input included. If the ray does
//! cross a triangle whose box is e long, its sheared corners are at most (1 + s) e + E away, so an edge function errs
//! by at most B = 10 E (e + E), or 20 E (e + E). An edge function beyond −B and another beyond +B prove a miss. For a
//! crossing, all must be beyond 4 B on one side, with the first corner within (1.5 + s) e: then they err by less than
//! 3 B, and their sum by less than three quarters. Depth is a mean of the corners' depths with those weights.

use super::build::{LEAF, WIDTH};
use super::exact::Triangle;
use super::lanes::{Lanes, RAYS, Vector};
use super::node::{Frame, Local};
use glam::DVec3;

/// Greatest shear of a ray of a packet.
pub(super) const SHEAR: f64 = 3.0;
const UNIT: f64 = 1.0 / 16_777_216.0;

/// Up to [`LEAF`] triangles.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Leaf {
    /// Corner, axis, triangle; NaN, which is never hit, where there is none.
    corners: [[[f32; LEAF]; 3]; 3],
    /// Surfaces.
    pub(super) id: [u32; LEAF],
    /// The longest side of the triangles' boxes.
    extent: f32,
    /// The exact triangles of the leaf are `count` from here.
    pub(super) first: u32,
    pub(super) count: u32,
}

impl Leaf {
    pub(super) const EMPTY: Self =
        Self { corners: [[[f32::NAN; LEAF]; 3]; 3], id: [u32::MAX; LEAF], extent: 0.0, first: 0, count: 0 };

    /// Puts in triangles, which are `first` and following of all.
    pub(super) fn fill(&mut self, triangles: &[Triangle], first: u32, frame: Frame) {
        self.first = first;
        for triangle in triangles {
            self.push(triangle, frame);
        }
    }

    fn push(&mut self, triangle: &Triangle, frame: Frame) {
        let lane = self.count as usize;
        let corners = triangle.corners.map(|corner| frame.to_local(corner).to_array().map(|x| x as f32));
        for axis in 0..3 {
            let [a, b, c] = corners.map(|corner| corner[axis]);
            // A rounding more, and two for the f32 of the corners, which are at most 1.
            let side = (a.max(b).max(c) - a.min(b).min(c)) * 1.000_001 + (4.0 * UNIT) as f32;
            self.extent = self.extent.max(side);
            for (row, x) in self.corners.iter_mut().zip([a, b, c]) {
                row[axis][lane] = x;
            }
        }
        self.id[lane] = triangle.id;
        self.count += 1;
    }

    /// Indices of its exact triangles.
    #[inline(always)]
    pub(super) fn range(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }
}

/// What f32 says, a bit for each ray or triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Verdict {
    /// Surely crossed, strictly between the ends.
    pub(super) sure: u32,
    /// Not known.
    pub(super) doubtful: u32,
}

/// [`Verdict`], and for triangles surely crossed, where and from which side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Located {
    pub(super) verdict: Verdict,
    /// The crossing lies between these lengths along the ray.
    pub(super) from: [f32; LEAF],
    pub(super) to: [f32; LEAF],
    /// Where the front is seen, as bits.
    pub(super) front: u32,
}

/// Bounds of the errors, and what depends on the rays only.
#[derive(Debug, Clone, Copy)]
struct Errors {
    /// E.
    corner: f32,
    /// B = edge (e + E).
    edge: f32,
    /// The first corner's distance over e.
    first: f32,
    /// The greatest guard.
    guard: f32,
}

impl Errors {
    #[inline(always)]
    fn new(reach: f64, guard: f64, shear: f64) -> Self {
        let packet = shear > 1.0;
        let corner = if packet { 64.0 } else { 24.0 } * UNIT * reach;
        let edge = if packet { 20.0 } else { 10.0 } * corner;
        let guard = guard * 1.000_001;
        Self { corner: corner as f32, edge: edge as f32, first: (1.5 + shear) as f32, guard: guard as f32 }
    }
}

/// Corners relative to a ray, sheared, and the bounds for their leaf.
struct Sheared<V> {
    x: [V; 3],
    y: [V; 3],
    z: [V; 3],
}

/// What is known of lines that cross triangles or nearly do.
struct Depths<V> {
    /// Twice the area, signed.
    sum: V,
    /// The crossing's depth times that, and the bound of its error.
    depth: V,
    margin: V,
}

impl<V> Sheared<V> {
    /// Sorts triangles by their edge functions; `end` is how far the ray goes along z, in which direction it may.
    #[inline(always)]
    fn judge<const N: usize>(&self, end: V, extent: f32, errors: &Errors) -> Verdict
    where
        V: Vector<N>,
    {
        let (edges, least, most, kept) = self.edges(end, extent, errors);
        if kept == 0 {
            return Verdict { sure: 0, doubtful: 0 };
        }
        self.judge_depth(end, [least, most], edges, extent, errors, kept).0
    }

    /// Edge functions, the least and the greatest of each triangle's, and the triangles that are not surely missed.
    #[inline(always)]
    fn edges<const N: usize>(&self, end: V, extent: f32, errors: &Errors) -> ([V; 3], V, V, u32)
    where
        V: Vector<N>,
    {
        let (x, y) = (&self.x, &self.y);
        let bound = errors.edge * (extent + errors.corner);
        let edges = [
            x[2].mul_sub(y[1], y[2].mul(x[1])),
            x[0].mul_sub(y[2], y[0].mul(x[2])),
            x[1].mul_sub(y[0], y[1].mul(x[0])),
        ];
        let least = edges[0].min(edges[1]).min(edges[2]);
        let most = edges[0].max(edges[1]).max(edges[2]);
        let kept = end.like(-bound).at_most(least) | most.at_most(end.like(bound));
        (edges, least, most, kept)
    }

    /// The second half, where lines cross or nearly.
    #[inline(always)]
    fn judge_depth<const N: usize>(
        &self,
        end: V,
        [least, most]: [V; 2],
        edges: [V; 3],
        extent: f32,
        errors: &Errors,
        kept: u32,
    ) -> (Verdict, Depths<V>)
    where
        V: Vector<N>,
    {
        let bound = errors.edge * (extent + errors.corner);
        let first = self.x[0].abs().max(self.y[0].abs()).at_most(end.like(errors.first * extent));
        let inside = (end.like(4.0 * bound).at_most(least) | most.at_most(end.like(-4.0 * bound))) & first;
        let half = end.mul(end.like(0.5));
        let sum = edges[0].add(edges[1]).add(edges[2]);
        let depth = edges[0].mul(self.z[0]).add(edges[1].mul(self.z[1])).add(edges[2].mul(self.z[2]));
        // The depth between 0 and the end, times the sum, is within half the end of half the end.
        let off = depth.sub(half.mul(sum)).abs();
        let reach = half.mul(sum).abs();
        let margin = sum.abs().mul(end.like(2.0 * errors.corner));
        let margin = margin.add(end.like(extent * (24.0 * bound + 12.0 * extent * errors.guard)));
        let between = off.at_most(reach.sub(margin));
        let outside = reach.add(margin).at_most(off) & inside;
        // Where the weights are not known, depth is between those of the corners.
        let (near, far) = (self.z[0].min(self.z[1]).min(self.z[2]), self.z[0].max(self.z[1]).max(self.z[2]));
        let (tip, slack) = (half.abs().add(end.like(errors.corner)), end.like(0.0));
        let beyond = tip.at_most(near.sub(half)) | far.sub(half).at_most(slack.sub(tip));
        let sure = kept & inside & between;
        (Verdict { sure, doubtful: kept & !sure & !outside & !beyond }, Depths { sum, depth, margin })
    }
}

/// A ray for the triangles of a leaf.
#[derive(Debug, Clone, Copy)]
pub(super) struct Probe {
    axes: [usize; 3],
    start: [f32; 3],
    shear: [f32; 2],
    /// Depth of the end.
    end: f32,
    /// 1 or −1: the direction along the last axis.
    forward: f32,
    errors: Errors,
}

impl Probe {
    #[inline(always)]
    pub(super) fn new(ray: &Local, end: f64) -> Self {
        let ([i, j, k], d, o) = (ray.axes, ray.direction, ray.origin);
        let (d, o) = ([d[i], d[j], d[k]], [o[i], o[j], o[k]]);
        Self {
            axes: ray.axes,
            start: [o[0] as f32, o[1] as f32, o[2] as f32],
            shear: [(d[0] * d[2]) as f32, (d[1] * d[2]) as f32],
            end: (d[2] * ray.length_to(end)) as f32,
            forward: d[2] as f32,
            errors: Errors::new(ray.reach, ray.guard, 1.0),
        }
    }

    /// How far the ray goes.
    #[inline(always)]
    pub(super) fn length(&self) -> f32 {
        self.forward * self.end
    }

    /// Shortens the ray to a length.
    #[inline(always)]
    pub(super) fn stop_at(&mut self, length: f32) {
        self.end = self.forward * length;
    }

    /// A bit for each triangle.
    #[inline(always)]
    pub(super) fn judge<L: Lanes>(&self, lanes: L, leaf: &Leaf) -> Verdict {
        self.sheared(lanes, leaf).judge(lanes.leaf_splat(self.end), leaf.extent, &self.errors)
    }

    /// As [`Self::judge`], and where those surely crossed are; `None` if none is met.
    #[inline(always)]
    pub(super) fn locate<L: Lanes>(&self, lanes: L, leaf: &Leaf) -> Option<Located> {
        let sheared = self.sheared(lanes, leaf);
        let end = lanes.leaf_splat(self.end);
        let (edges, least, most, kept) = sheared.edges(end, leaf.extent, &self.errors);
        if kept == 0 {
            return None;
        }
        let (verdict, depths) = sheared.judge_depth(end, [least, most], edges, leaf.extent, &self.errors, kept);
        if verdict.sure | verdict.doubtful == 0 {
            return None;
        }
        let forward = lanes.leaf_splat(self.forward);
        let middle = depths.depth.mul(forward).div(depths.sum);
        let error = depths.margin.div(depths.sum.abs());
        let turned = lanes.leaf_splat(0.0).at_most(depths.sum.mul(forward));
        Some(Located { verdict, from: middle.sub(error).to_array(), to: middle.add(error).to_array(), front: turned })
    }

    /// The corners of a leaf's triangles relative to the ray.
    #[inline(always)]
    fn sheared<L: Lanes>(&self, lanes: L, leaf: &Leaf) -> Sheared<L::Leaf> {
        let [i, j, k] = self.axes;
        let start = [lanes.leaf_splat(self.start[0]), lanes.leaf_splat(self.start[1]), lanes.leaf_splat(self.start[2])];
        let shear = [lanes.leaf_splat(self.shear[0]), lanes.leaf_splat(self.shear[1])];
        let zero = lanes.leaf_splat(0.0);
        let mut sheared = Sheared { x: [zero; 3], y: [zero; 3], z: [zero; 3] };
        for corner in 0..3 {
            let rows = &leaf.corners[corner];
            let z = lanes.leaf(&rows[k]).sub(start[2]);
            sheared.x[corner] = shear[0].neg_mul_add(z, lanes.leaf(&rows[i]).sub(start[0]));
            sheared.y[corner] = shear[1].neg_mul_add(z, lanes.leaf(&rows[j]).sub(start[1]));
            sheared.z[corner] = z;
        }
        sheared
    }
}

/// Sixteen rays for one triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Probes {
    axes: [usize; 3],
    start: [[f32; RAYS]; 3],
    shear: [[f32; RAYS]; 2],
    end: [f32; RAYS],
    errors: Errors,
    /// The parameter, from 0 to 1, at a plane across an axis is plane · scale − shift, less or more by pad.
    scales: [[f32; RAYS]; 3],
    shifts: [[f32; RAYS]; 3],
    pads: [[f32; RAYS]; 3],
}

impl Probes {
    /// The rays that may meet a box, as bits.
    #[inline(always)]
    pub(super) fn slabs<L: Lanes>(&self, lanes: L, rows: &[[f32; WIDTH]; 6], child: usize) -> u32 {
        let (mut enter, mut leave) = (lanes.rays_splat(0.0), lanes.rays_splat(1.000_002));
        for axis in 0..3 {
            let (scale, shift, pad) =
                (lanes.rays(&self.scales[axis]), lanes.rays(&self.shifts[axis]), lanes.rays(&self.pads[axis]));
            let lo = lanes.rays_splat(rows[axis][child]).mul_sub(scale, shift);
            let hi = lanes.rays_splat(rows[axis + 3][child]).mul_sub(scale, shift);
            enter = lo.min(hi).sub(pad).max(enter);
            leave = lo.max(hi).add(pad).min(leave);
        }
        enter.at_most(leave)
    }

    /// From origins and directions in normalised coordinates, by axis; `None` if the directions differ too much for a
    /// common axis.
    #[inline(always)]
    pub(super) fn new(
        origins: &[[f64; RAYS]; 3],
        directions: &[[f64; RAYS]; 3],
        reach: f64,
        guard: f64,
    ) -> Option<Self> {
        let [x, y, z] = directions;
        let axes = super::exact::axes(DVec3::new(x.iter().sum(), y.iter().sum(), z.iter().sum()));
        let errors = Errors::new(reach, guard, SHEAR);
        let mut probes = Self {
            axes,
            start: [[0.0; RAYS]; 3],
            shear: [[0.0; RAYS]; 2],
            end: [0.0; RAYS],
            errors,
            scales: [[0.0; RAYS]; 3],
            shifts: [[0.0; RAYS]; 3],
            pads: [[0.0; RAYS]; 3],
        };
        probes.set_slabs(origins, directions, (32.0 * UNIT * reach) as f32);
        for row in 0..3 {
            for k in 0..RAYS {
                probes.start[row][k] = origins[axes[row]][k] as f32;
            }
        }
        let last = &directions[axes[2]];
        for k in 0..RAYS {
            probes.end[k] = last[k] as f32;
        }
        let mut gentle = true;
        for row in 0..2 {
            for k in 0..RAYS {
                let shear = directions[axes[row]][k] as f32 / probes.end[k];
                probes.shear[row][k] = shear;
                // NaN is not.
                gentle &= shear.abs() <= SHEAR as f32;
            }
        }
        gentle.then_some(probes)
    }

    /// What [`Self::slabs`] needs. The pad is twice what the slab test of a single ray allows.
    #[inline(always)]
    fn set_slabs(&mut self, origins: &[[f64; RAYS]; 3], directions: &[[f64; RAYS]; 3], pad: f32) {
        for axis in 0..3 {
            for k in 0..RAYS {
                let d = directions[axis][k] as f32;
                let scale = 1.0 / (if d.abs() > 1e-18 { d } else { 1e-18 });
                self.scales[axis][k] = scale;
                self.shifts[axis][k] = origins[axis][k] as f32 * scale;
                self.pads[axis][k] = pad * scale.abs();
            }
        }
    }

    /// A bit for each ray.
    #[inline(always)]
    pub(super) fn judge<L: Lanes>(&self, lanes: L, leaf: &Leaf, triangle: usize) -> Verdict {
        let [i, j, k] = self.axes;
        let start = [lanes.rays(&self.start[0]), lanes.rays(&self.start[1]), lanes.rays(&self.start[2])];
        let shear = [lanes.rays(&self.shear[0]), lanes.rays(&self.shear[1])];
        let zero = lanes.rays_splat(0.0);
        let mut sheared = Sheared { x: [zero; 3], y: [zero; 3], z: [zero; 3] };
        for corner in 0..3 {
            let rows = &leaf.corners[corner];
            let z = lanes.rays_splat(rows[k][triangle]).sub(start[2]);
            sheared.x[corner] = shear[0].neg_mul_add(z, lanes.rays_splat(rows[i][triangle]).sub(start[0]));
            sheared.y[corner] = shear[1].neg_mul_add(z, lanes.rays_splat(rows[j][triangle]).sub(start[1]));
            sheared.z[corner] = z;
        }
        sheared.judge(lanes.rays(&self.end), leaf.extent, &self.errors)
    }
}

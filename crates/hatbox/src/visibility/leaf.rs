//! Triangles in f32: what the exact test need not see, where only one bit is asked for.
//!
//! A part of a leaf holds its corners in f32. The same watertight test in f32 with bounds of its error
//! sorts triangles into those surely missed, those surely crossed between the ends, and the doubtful rest, which alone
//! is decided by [`super::exact`].
//!
//! The bounds, in normalised coordinates, with u = 2⁻²⁴: a sheared coordinate of a single ray, which begins in the box
//! of the scene and whose shears are up to 1, errs by at most E = 20 u: roundings of the corners, the shear and the
//! origin (2 u each), of the results (2 u and 4 u, u more without fused multiply-add), and what the exact test may err.
//! In a packet, whose rays are within M of the center and have shears up to s = 3, E = 64 u M. If the ray does cross a
//! triangle whose box is e long, its sheared corners are at most (1 + s) e + E away, so an edge function errs by at most
//! B = 10 E (e + E), or 20 E (e + E). An edge function beyond −B and another beyond +B prove a miss. For a crossing, all
//! must be beyond 4 B on one side, with the first corner within (1.5 + s) e: then they err by less than 3 B, and their
//! sum by less than three quarters. Depth is a mean of the corners' depths with those weights.

use super::build::{LEAF, WIDTH};
use super::exact::Triangle;
use super::lanes::{Lanes, RAYS, Vector};
use super::node::{Frame, Local};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Greatest shear of a ray of a packet.
pub(super) const SHEAR: f64 = 3.0;
const UNIT: f64 = 1.0 / 16_777_216.0;

/// A part of a leaf: up to [`LEAF`] triangles.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Leaf {
    /// Corner, axis, triangle; NaN, which is never hit, where there is none.
    corners: [[[f32; LEAF]; 3]; 3],
    /// Surfaces.
    pub(super) id: [u32; LEAF],
    /// e, the longest side of the triangles' boxes.
    extent: f32,
    /// B of single rays.
    bound: f32,
    pub(super) count: u32,
    _rest: [u32; 5],
}

impl Leaf {
    pub(super) const EMPTY: Self = Self {
        corners: [[[f32::NAN; LEAF]; 3]; 3],
        id: [u32::MAX; LEAF],
        extent: 0.0,
        bound: 0.0,
        count: 0,
        _rest: [0; 5],
    };

    /// Puts in a triangle.
    pub(super) fn push(&mut self, triangle: &Triangle, frame: Frame) {
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
        self.bound = Errors::ALONE.bound(self.extent);
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

/// Bounds of the errors that depend on the rays only.
#[derive(Debug, Clone, Copy)]
struct Errors {
    /// E.
    corner: f32,
    /// B = edge (e + E).
    edge: f32,
    /// The first corner's distance over e.
    first: f32,
}

impl Errors {
    /// Of a single ray.
    const ALONE: Self = {
        let corner = 20.0 * UNIT;
        Self { corner: corner as f32, edge: (10.0 * corner) as f32, first: 2.5 }
    };

    /// Of the rays of a packet, within `reach` of the center.
    #[inline(always)]
    fn of_packet(reach: f64) -> Self {
        let corner = 64.0 * UNIT * reach;
        Self { corner: corner as f32, edge: (20.0 * corner) as f32, first: (1.5 + SHEAR) as f32 }
    }

    /// B.
    #[inline(always)]
    fn bound(&self, extent: f32) -> f32 {
        self.edge * (extent + self.corner)
    }
}

/// Lengths that the judgement of a leaf depends on.
#[derive(Debug, Clone, Copy)]
struct Scale {
    /// e.
    extent: f32,
    /// B.
    bound: f32,
    /// The greatest guard.
    guard: f32,
    errors: Errors,
}

/// Corners relative to a ray, sheared.
struct Sheared<V> {
    x: [V; 3],
    y: [V; 3],
}

/// Their edge functions.
struct Edges<V> {
    all: [V; 3],
    least: V,
    most: V,
    /// The triangles that are not surely missed.
    kept: u32,
}

impl<V> Sheared<V> {
    /// Sorts triangles by their edge functions.
    #[inline(always)]
    fn edges<const N: usize>(&self, bound: f32) -> Edges<V>
    where
        V: Vector<N>,
    {
        let (x, y) = (&self.x, &self.y);
        let all = [
            x[2].mul_sub(y[1], y[2].mul(x[1])),
            x[0].mul_sub(y[2], y[0].mul(x[2])),
            x[1].mul_sub(y[0], y[1].mul(x[0])),
        ];
        let least = all[0].min(all[1]).min(all[2]);
        let most = all[0].max(all[1]).max(all[2]);
        let kept = x[0].like(-bound).at_most(least) | most.at_most(x[0].like(bound));
        Edges { all, least, most, kept }
    }

    /// The second half, where lines cross or nearly: `z` are the corners' depths, `end` how far the ray goes, in which
    /// direction it may.
    #[inline(always)]
    fn judge<const N: usize>(&self, edges: &Edges<V>, z: [V; 3], end: V, scale: &Scale) -> Verdict
    where
        V: Vector<N>,
    {
        let (extent, bound, errors) = (scale.extent, scale.bound, &scale.errors);
        let first = self.x[0].abs().max(self.y[0].abs()).at_most(end.like(errors.first * extent));
        let clear = end.like(4.0 * bound).at_most(edges.least) | edges.most.at_most(end.like(-4.0 * bound));
        let inside = clear & first;
        let half = end.mul(end.like(0.5));
        let [u, v, w] = edges.all;
        let sum = u.add(v).add(w);
        let depth = u.mul(z[0]).add(v.mul(z[1])).add(w.mul(z[2]));
        // The depth between 0 and the end, times the sum, is within half the end of half the end.
        let off = depth.sub(half.mul(sum)).abs();
        let reach = half.mul(sum).abs();
        let margin = sum.abs().mul(end.like(2.0 * errors.corner));
        let margin = margin.add(end.like(extent * (24.0 * bound + 12.0 * extent * scale.guard)));
        let between = off.at_most(reach.sub(margin));
        let outside = reach.add(margin).at_most(off) & inside;
        // Where the weights are not known, depth is between those of the corners.
        let (near, far) = (z[0].min(z[1]).min(z[2]), z[0].max(z[1]).max(z[2]));
        let (tip, slack) = (half.abs().add(end.like(errors.corner)), end.like(0.0));
        let beyond = tip.at_most(near.sub(half)) | far.sub(half).at_most(slack.sub(tip));
        let sure = edges.kept & inside & between;
        let doubtful = edges.kept & !sure & !outside & !beyond;
        Verdict { sure, doubtful }
    }
}

/// A ray for the triangles of a leaf.
#[derive(Debug, Clone, Copy)]
pub(super) struct Probe {
    axes: [usize; 3],
    /// Where the ray, sheared, is on the first two axes, and where it begins on the last.
    start: [f32; 3],
    shear: [f32; 2],
    /// Depth of the end.
    end: f32,
    guard: f32,
}

impl Probe {
    #[inline(always)]
    pub(super) fn new(ray: &Local, end: f64) -> Self {
        let ([i, j, k], d, o) = (ray.axes, ray.direction, ray.origin);
        let (d, o) = ([d[i], d[j], d[k]], [o[i], o[j], o[k]]);
        let shear = [d[0] * d[2], d[1] * d[2]];
        Self {
            axes: ray.axes,
            start: [(o[0] - shear[0] * o[2]) as f32, (o[1] - shear[1] * o[2]) as f32, o[2] as f32],
            shear: [shear[0] as f32, shear[1] as f32],
            end: (d[2] * ray.length_to(end)) as f32,
            guard: (ray.guard * 1.000_001) as f32,
        }
    }

    /// A bit for each triangle.
    #[inline(always)]
    pub(super) fn judge<L: Lanes>(&self, lanes: L, leaf: &Leaf) -> Verdict {
        let sheared = self.sheared(lanes, leaf);
        let edges = sheared.edges(leaf.bound);
        if edges.kept == 0 {
            return Verdict { sure: 0, doubtful: 0 };
        }
        let (k, start) = (self.axes[2], lanes.leaf_splat(self.start[2]));
        let [a, b, c] = &leaf.corners;
        let z = [lanes.leaf(&a[k]).sub(start), lanes.leaf(&b[k]).sub(start), lanes.leaf(&c[k]).sub(start)];
        let scale = Scale { extent: leaf.extent, bound: leaf.bound, guard: self.guard, errors: Errors::ALONE };
        sheared.judge(&edges, z, lanes.leaf_splat(self.end), &scale)
    }

    /// The corners of a leaf's triangles relative to the ray.
    #[inline(always)]
    fn sheared<L: Lanes>(&self, lanes: L, leaf: &Leaf) -> Sheared<L::Leaf> {
        let [i, j, k] = self.axes;
        let start = [lanes.leaf_splat(self.start[0]), lanes.leaf_splat(self.start[1])];
        let shear = [lanes.leaf_splat(self.shear[0]), lanes.leaf_splat(self.shear[1])];
        let mut sheared = Sheared { x: [start[0]; 3], y: [start[1]; 3] };
        for corner in 0..3 {
            let rows = &leaf.corners[corner];
            let z = lanes.leaf(&rows[k]);
            sheared.x[corner] = shear[0].neg_mul_add(z, lanes.leaf(&rows[i])).sub(start[0]);
            sheared.y[corner] = shear[1].neg_mul_add(z, lanes.leaf(&rows[j])).sub(start[1]);
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
    guard: f32,
    errors: Errors,
    /// The parameter, from 0 to 1, at a plane across an axis is plane · scale − shift, less or more by pad.
    scales: [[f32; RAYS]; 3],
    shifts: [[f32; RAYS]; 3],
    pads: [[f32; RAYS]; 3],
}

impl Probes {
    /// The rays that may meet a box, as bits.
    #[inline(always)]
    pub(super) fn slabs<L: Lanes>(&self, lanes: L, rows: &[[[f32; WIDTH]; 2]; 3], child: usize) -> u32 {
        let (mut enter, mut leave) = (lanes.rays_splat(0.0), lanes.rays_splat(1.000_002));
        for axis in 0..3 {
            let (scale, shift, pad) =
                (lanes.rays(&self.scales[axis]), lanes.rays(&self.shifts[axis]), lanes.rays(&self.pads[axis]));
            let lo = lanes.rays_splat(rows[axis][0][child]).mul_sub(scale, shift);
            let hi = lanes.rays_splat(rows[axis][1][child]).mul_sub(scale, shift);
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
        let errors = Errors::of_packet(reach);
        let mut probes = Self {
            axes,
            start: [[0.0; RAYS]; 3],
            shear: [[0.0; RAYS]; 2],
            end: [0.0; RAYS],
            guard: (guard * 1.000_001) as f32,
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
        let (mut sheared, mut depths) = (Sheared { x: [start[0]; 3], y: [start[1]; 3] }, [start[2]; 3]);
        for corner in 0..3 {
            let rows = &leaf.corners[corner];
            let z = lanes.rays_splat(rows[k][triangle]).sub(start[2]);
            sheared.x[corner] = shear[0].neg_mul_add(z, lanes.rays_splat(rows[i][triangle]).sub(start[0]));
            sheared.y[corner] = shear[1].neg_mul_add(z, lanes.rays_splat(rows[j][triangle]).sub(start[1]));
            depths[corner] = z;
        }
        let (extent, bound) = (leaf.extent, self.errors.bound(leaf.extent));
        let edges = sheared.edges(bound);
        if edges.kept == 0 {
            return Verdict { sure: 0, doubtful: 0 };
        }
        let scale = Scale { extent, bound, guard: self.guard, errors: self.errors };
        sheared.judge(&edges, depths, lanes.rays(&self.end), &scale)
    }
}

//! Sixteen segments at once: those between two elements, which go nearly the same way.

use super::bvh::{Bvh, STACK};
use super::exact::GUARD;
use super::lanes::{Lanes, RAYS};
use super::leaf::{Leaf, Probes};
use super::node::{FAR, Hull, Node, parts};
use glam::DVec3;

/// Segments between two elements.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segments<'a> {
    pub(super) from: &'a [DVec3],
    pub(super) to: &'a [DVec3],
    pub(super) skip: [u32; 2],
}

/// Their form for the tree.
pub(super) struct Packet {
    hull: Hull,
    probes: Probes,
    /// The segments that have two finite ends, as bits.
    present: u32,
}

impl Packet {
    /// `None` if the segments have no common axis or f32 does not serve them: then each goes its own way.
    #[inline(always)]
    pub(super) fn new(bvh: &Bvh, segments: &Segments) -> Option<Self> {
        let count = segments.from.len();
        let ([mut from, mut to], mut moves) = ([[[0.0; RAYS]; 3]; 2], [[0.0; RAYS]; 3]);
        let (mut guard, mut reach) = (0.0_f64, 1.0_f64);
        for k in 0..RAYS {
            // The last segment fills up the rest.
            let last = k.min(count.checked_sub(1)?);
            let (p, q) = (segments.from[last], segments.to[last]);
            let way = (q - p).to_array();
            for axis in 0..3 {
                from[axis][k] = p[axis];
                to[axis][k] = q[axis];
                moves[axis][k] = way[axis];
            }
        }
        let (mut first, mut second) = ([[0.0; 3]; 2], [[0.0; 3]; 2]);
        for axis in 0..3 {
            guard = greater(guard, reach_of(&from[axis], &to[axis]));
            let (center, scale) = (bvh.frame.center[axis], bvh.frame.scale);
            for k in 0..RAYS {
                from[axis][k] = (from[axis][k] - center) * scale;
                to[axis][k] = (to[axis][k] - center) * scale;
                moves[axis][k] *= scale;
            }
            reach = greater(reach, reach_of(&from[axis], &to[axis]));
            let (a, b) = (range(&from[axis]), range(&to[axis]));
            for side in 0..2 {
                (first[side][axis], second[side][axis]) = (a[side], b[side]);
            }
        }
        // NaN is not near.
        let near = reach < FAR;
        if !near {
            return None;
        }
        let guard = guard * (GUARD * f64::EPSILON) * bvh.frame.scale;
        let probes = Probes::new(&from, &moves, reach, guard)?;
        let hull = Hull::around(first, second, reach);
        Some(Self { hull, probes, present: u32::MAX >> (32 - count) })
    }
}

/// The greater of two numbers; NaN if `new` is.
#[inline(always)]
fn greater(old: f64, new: f64) -> f64 {
    if new <= old { old } else { new }
}

/// The greatest magnitude, or NaN if there is one.
#[inline(always)]
fn reach_of(a: &[f64; RAYS], b: &[f64; RAYS]) -> f64 {
    let (mut reach, mut sum) = ([0.0_f64; 8], [0.0_f64; 8]);
    for k in 0..RAYS {
        let (x, y) = (a[k].abs(), b[k].abs());
        let most = if x > y { x } else { y };
        let lane = &mut reach[k % 8];
        *lane = if most > *lane { most } else { *lane };
        sum[k % 8] += x + y;
    }
    let total: f64 = sum.iter().sum();
    let most = reach.iter().fold(0.0, |most, &x| if x > most { x } else { most });
    if total.is_finite() { most } else { f64::NAN }
}

/// The least and the greatest.
#[inline(always)]
fn range(values: &[f64; RAYS]) -> [f64; 2] {
    let (mut lo, mut hi) = ([f64::INFINITY; 8], [f64::NEG_INFINITY; 8]);
    for k in 0..RAYS {
        let (x, lane) = (values[k], k % 8);
        lo[lane] = if x < lo[lane] { x } else { lo[lane] };
        hi[lane] = if x > hi[lane] { x } else { hi[lane] };
    }
    let lo = lo.iter().fold(f64::INFINITY, |lo, &x| if x < lo { x } else { lo });
    [lo, hi.iter().fold(f64::NEG_INFINITY, |hi, &x| if x > hi { x } else { hi })]
}

impl Bvh {
    /// The segments that are blocked, as bits; `None` if they make no packet.
    #[inline(always)]
    pub(super) fn any_of<L: Lanes>(&self, lanes: L, segments: &Segments) -> Option<u32> {
        let packet = &Packet::new(self, segments)?;
        let mut left = packet.present;
        let mut stack = [0_u32; STACK];
        let mut pending = usize::from(!self.nodes.is_empty());
        while pending > 0 {
            pending -= 1;
            let node = &self.nodes[stack[pending] as usize];
            let mask = node.meets(lanes, &packet.hull);
            pending = self.push(lanes, node, mask, &mut stack, pending);
            let mut leaves = mask & node.leaves;
            while leaves != 0 {
                let lane = leaves.trailing_zeros() as usize;
                leaves &= leaves - 1;
                if packet.probes.slabs(lanes, &node.rows, lane) & left == 0 {
                    continue;
                }
                for part in parts(node.child[lane]) {
                    left &= !self.blocked_in(lanes, part, packet, segments, left);
                }
                if left == 0 {
                    return Some(packet.present);
                }
            }
        }
        Some(left ^ packet.present)
    }

    /// Asks for the memory of the children in `mask` and puts those that are nodes on the stack.
    #[inline(always)]
    fn push<L: Lanes>(&self, lanes: L, node: &Node, mask: u32, stack: &mut [u32; STACK], mut pending: usize) -> usize {
        let mut leaves = mask & node.leaves;
        while leaves != 0 {
            let child = node.child[leaves.trailing_zeros() as usize];
            leaves &= leaves - 1;
            lanes.prefetch((&raw const self.leaves[*parts(child).start()]).cast(), size_of::<Leaf>());
        }
        let mut inner = mask & !node.leaves;
        while inner != 0 {
            let child = node.child[inner.trailing_zeros() as usize];
            inner &= inner - 1;
            lanes.prefetch((&raw const self.nodes[child as usize]).cast(), size_of::<Node>());
            stack[pending] = child;
            pending += 1;
        }
        pending
    }

    /// Those of the segments `left` that a leaf's triangles block.
    #[inline(always)]
    fn blocked_in<L: Lanes>(&self, lanes: L, index: usize, packet: &Packet, segments: &Segments, left: u32) -> u32 {
        let (leaf, mut blocked) = (&self.leaves[index], 0);
        for lane in 0..leaf.count as usize {
            if segments.skip.contains(&leaf.id[lane]) {
                continue;
            }
            let verdict = packet.probes.judge(lanes, leaf, lane);
            blocked |= verdict.sure & left;
            let mut doubtful = verdict.doubtful & left & !blocked;
            while doubtful != 0 {
                let k = doubtful.trailing_zeros() as usize;
                doubtful &= doubtful - 1;
                let ends = [segments.from[k], segments.to[k]];
                blocked |= u32::from(self.surely_blocks(index, lane, ends, segments.skip)) << k;
            }
        }
        blocked
    }
}

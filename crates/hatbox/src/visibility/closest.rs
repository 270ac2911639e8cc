//! The first crossing of a ray.
//!
//! Children are visited from the nearest on, leaves among them. A crossing that f32 is sure of shortens the ray at once,
//! to where it lies at most; which crossing is the first, and where, is decided in f64 at the end, among those that may
//! be. So the triangles in f64 are seldom read, and have arrived in the cache by then.

use super::bvh::{Bvh, Hit, STACK};
use super::exact::{Crossing, Ray, Triangle};
use super::lanes::{Lanes, Vector};
use super::leaf::{Leaf, Probe};
use super::node::{LEAF_BIT, Local, Node, Slabs};

/// So many crossings wait for the decision.
const WAITING: usize = 8;

/// A ray on its way through the tree.
struct Search<'a, A> {
    ray: &'a Ray,
    accept: &'a A,
    slabs: Slabs,
    probe: Probe,
    /// Length of the ray up to t = 1.
    length: f64,
    /// Triangles and the lengths from which on they may be crossed.
    waiting: [(f32, u32); WAITING],
    count: usize,
    best: Option<Hit>,
}

impl<A: Fn(u32, bool) -> bool> Search<'_, A> {
    /// Notes the crossings of a leaf's triangles, if it has any before the ray's end; `enter` is where its box begins.
    #[inline(always)]
    fn meet<L: Lanes>(&mut self, lanes: L, leaf: &Leaf, enter: f32, triangles: &[Triangle]) {
        let Some(located) = self.probe.locate(lanes, leaf) else { return };
        let mut found = located.verdict.sure | located.verdict.doubtful;
        while found != 0 {
            let lane = found.trailing_zeros() as usize;
            found &= found - 1;
            let triangle = leaf.first + lane as u32;
            let mut from = enter;
            if located.verdict.sure >> lane & 1 != 0 {
                if !(self.accept)(leaf.id[lane], located.front >> lane & 1 != 0) {
                    continue;
                }
                from = located.from[lane];
                if located.to[lane] < self.probe.length() {
                    self.probe.stop_at(located.to[lane]);
                    self.slabs.stop_at(located.to[lane]);
                }
            }
            lanes.prefetch(&triangles[triangle as usize]);
            if self.count == WAITING {
                self.decide(triangles);
                self.stop_at_best();
            }
            self.waiting[self.count] = (from, triangle);
            self.count += 1;
        }
    }

    /// Finds the first of the crossings that wait.
    #[inline]
    fn decide(&mut self, triangles: &[Triangle]) {
        for &(from, triangle) in &self.waiting[..self.count] {
            if from <= self.slabs.end {
                self.ray.closer(&triangles[triangle as usize], self.accept, &mut self.best);
            }
        }
        self.count = 0;
    }

    /// Shortens the ray to the best crossing: where f32 is sure of none, much would wait else.
    #[inline]
    fn stop_at_best(&mut self) {
        let Some(hit) = self.best else { return };
        let length = (hit.t * self.length) as f32 * 1.000_000_5;
        if length < self.probe.length() {
            self.probe.stop_at(length);
            self.slabs.stop_at(length);
        }
    }
}

impl Bvh {
    /// The first acceptable crossing.
    #[inline(always)]
    pub(super) fn closest<L: Lanes>(
        &self,
        lanes: L,
        ray: &Ray,
        local: &Local,
        t_max: f64,
        accept: &impl Fn(u32, bool) -> bool,
    ) -> Option<Hit> {
        let (slabs, probe) = (Slabs::new(local, t_max), Probe::new(local, t_max));
        let (length, waiting) = (local.length, [(0.0, 0); WAITING]);
        let mut search = Search { ray, accept, slabs, probe, length, waiting, count: 0, best: None };
        let mut stack = [0_u64; STACK];
        let mut pending = usize::from(!self.nodes.is_empty());
        while pending > 0 {
            pending -= 1;
            let (enter, child) = entry(stack[pending]);
            if enter > search.slabs.end {
                continue;
            }
            if child & LEAF_BIT != 0 {
                search.meet(lanes, &self.leaves[(child ^ LEAF_BIT) as usize], enter, &self.triangles);
                continue;
            }
            let node = &self.nodes[child as usize];
            let (mask, enters) = node.slabs(lanes, &search.slabs);
            pending = self.push_sorted(lanes, node, mask, &enters.to_array(), &mut stack, pending);
        }
        search.decide(&self.triangles);
        search.best
    }

    /// Asks for the memory of the children in `mask` and puts them on the stack, the nearest last.
    #[inline(always)]
    fn push_sorted<L: Lanes>(
        &self,
        lanes: L,
        node: &Node,
        mask: u32,
        enters: &[f32],
        stack: &mut [u64; STACK],
        first: usize,
    ) -> usize {
        let (mut mask, mut pending) = (mask, first);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let child = node.child[lane];
            if child & LEAF_BIT == 0 {
                lanes.prefetch(&self.nodes[child as usize]);
            } else {
                lanes.prefetch(&self.leaves[(child ^ LEAF_BIT) as usize]);
            }
            let key = u64::from(enters[lane].to_bits()) << 32 | u64::from(child);
            let mut at = pending;
            while at > first && stack[at - 1] < key {
                stack[at] = stack[at - 1];
                at -= 1;
            }
            stack[at] = key;
            pending += 1;
        }
        pending
    }
}

/// Where a child is entered, which is never negative, so that entries are ordered like that, and the child.
#[inline(always)]
fn entry(key: u64) -> (f32, u32) {
    (f32::from_bits((key >> 32) as u32), key as u32)
}

impl Ray {
    /// Replaces `best` by an acceptable crossing of a triangle that is nearer.
    #[inline]
    pub(super) fn closer(&self, triangle: &Triangle, accept: &impl Fn(u32, bool) -> bool, best: &mut Option<Hit>) {
        let Some(Crossing { edges, sum, t }) = self.cross(triangle) else { return };
        let nearer = best.is_none_or(|best| (t, triangle.index) < (best.t, best.triangle));
        let front = self.sees_front(sum);
        if nearer && self.counts(triangle, t) && accept(triangle.id, front) {
            let barycentric = [edges[1] / sum, edges[2] / sum];
            *best = Some(Hit { t, triangle: triangle.index, id: triangle.id, front, barycentric });
        }
    }
}

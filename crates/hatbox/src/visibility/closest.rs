//! The first crossing of a ray.
//!
//! Children are visited from the nearest on, leaves among them. Those of a node that wait are kept as eight numbers of
//! sixteen bits, where each is entered, in one register: the nearest is found by one instruction, and nothing is sorted.
//! Leaves are tested in f64 at once. A test in f32 that leaves the decision to the end reads less, but then waits for
//! the triangle that is hit, which by then is farther away than anything: that took a fifth of the time. Tried and
//! dropped as well: the leaves among a node's children before its nodes, which visits more leaves; finer keys, and no early
//! way out of leaves, which gain nothing.

use super::block::Block;
use super::build::DEPTH;
use super::bvh::{Bvh, Hit};
use super::exact::{self, Crossing, Ray, Triangle};
use super::lanes::{Lanes, NONE, key};
use super::node::{LEAF_BIT, Local, Node, Slabs};
use glam::DVec3;

/// What is asked for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Query<'a, A> {
    pub(super) origin: DVec3,
    pub(super) direction: DVec3,
    /// Crossings count for 0 < t < `end`.
    pub(super) end: f64,
    pub(super) accept: &'a A,
}

impl Bvh {
    /// The first acceptable crossing.
    #[inline(always)]
    pub(super) fn closest<L: Lanes, A: Fn(u32, bool) -> bool>(&self, lanes: L, query: &Query<A>) -> Option<Hit> {
        let ray = Ray::open(query.origin, query.direction, query.end)?;
        let guard = exact::guard(query.origin, query.origin);
        let Ok(local) = Local::new(self.frame, query.origin, query.direction, guard) else {
            return self.closest_of_all(lanes, &ray, query.accept);
        };
        let (nodes, blocks) = (&*self.nodes, &*self.blocks);
        let mut slabs = Slabs::new(&local, query.end);
        let mut best = None;
        let (mut queues, mut waiting, mut pending) = ([lanes.empty(); DEPTH], [[0_u32; 2]; DEPTH], 0);
        let [enter, leave] = nodes.first()?.slabs(lanes, &slabs);
        let (mut queue, mut index) = (lanes.queue(enter, leave), 0);
        let mut first = lanes.first(queue);
        loop {
            if first & NONE > key(slabs.end) {
                if pending == 0 {
                    return best;
                }
                pending -= 1;
                [index, first] = waiting[pending];
                queue = queues[pending];
                continue;
            }
            let node = &nodes[index as usize];
            let child = node.child(first >> 16);
            queue = lanes.without(queue, first >> 16);
            first = lanes.first(queue);
            let waits = first & NONE <= key(slabs.end);
            prefetch(lanes, nodes, blocks, if waits { node.child(first >> 16) } else { child });
            if child & LEAF_BIT == 0 {
                (queues[pending], waiting[pending]) = (queue, [index, first]);
                pending += usize::from(waits);
                index = child;
                let [enter, leave] = nodes[index as usize].slabs(lanes, &slabs);
                queue = lanes.queue(enter, leave);
                first = lanes.first(queue);
                continue;
            }
            if nearer_in(lanes, &blocks[(child ^ LEAF_BIT) as usize], &ray, query.accept, &mut best)
                && let Some(hit) = best
            {
                slabs.stop_at(local.length_to(hit.t) as f32);
            }
        }
    }

    /// The decision for rays that f32 does not serve.
    #[cold]
    fn closest_of_all<L: Lanes>(&self, lanes: L, ray: &Ray, accept: &impl Fn(u32, bool) -> bool) -> Option<Hit> {
        let mut best = None;
        for block in self.blocks.iter() {
            nearer_in(lanes, block, ray, accept, &mut best);
        }
        best
    }
}

/// Replaces `best` by a crossing of a leaf's triangles if one is nearer, and says whether.
#[inline(always)]
fn nearer_in<L: Lanes>(
    lanes: L,
    block: &Block,
    ray: &Ray,
    accept: &impl Fn(u32, bool) -> bool,
    best: &mut Option<Hit>,
) -> bool {
    let until = if let Some(best) = best { best.t } else { f64::INFINITY };
    let (mut crossings, mut nearer) = (block.crossed_by(lanes, ray, until), false);
    while let Some((lane, crossing)) = crossings.next() {
        if let Some(hit) = ray.closer(&crossing, &block.triangle(lane), accept, best.as_ref()) {
            (*best, nearer) = (Some(hit), true);
        }
    }
    nearer
}

/// Asks for the memory of a child. Without a branch: whether it is a leaf cannot be guessed.
#[inline(always)]
fn prefetch<L: Lanes>(lanes: L, nodes: &[Node], blocks: &[Block], child: u32) {
    let node = nodes.as_ptr().wrapping_add(child as usize).cast();
    let block = blocks.as_ptr().wrapping_add((child ^ LEAF_BIT) as usize).cast();
    lanes.prefetch(if child & LEAF_BIT == 0 { node } else { block }, size_of::<Node>());
}

impl Ray {
    /// A crossing of a triangle, if it is acceptable and nearer than the `best`.
    #[inline(always)]
    fn closer(
        &self,
        crossing: &Crossing,
        triangle: &Triangle,
        accept: &impl Fn(u32, bool) -> bool,
        best: Option<&Hit>,
    ) -> Option<Hit> {
        let &Crossing { edges, sum, t } = crossing;
        let nearer = best.is_none_or(|best| (t, triangle.index) < (best.t, best.triangle));
        let front = self.sees_front(sum);
        if !nearer || !self.counts(triangle, t) || !accept(triangle.id, front) {
            return None;
        }
        let barycentric = [edges[1] / sum, edges[2] / sum];
        Some(Hit { t, triangle: triangle.index, id: triangle.id, front, barycentric })
    }
}

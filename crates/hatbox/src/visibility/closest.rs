//! The first crossing of a ray.
//!
//! Children are visited from the nearest on, leaves among them. Those of a node that wait are kept as eight numbers of
//! sixteen bits, where each is entered, in one register: the nearest is found by one instruction, and nothing is sorted.
//! The memory of the nearest is asked for as soon as they are known.
//! Leaves are tested in f64 at once. A test in f32 that leaves the decision to the end reads less, but then waits for
//! the triangle that is hit, which by then is farther away than anything: that took a fifth of the time. Tried and
//! dropped as well: the leaves among a node's children before its nodes, which visits more leaves; finer keys, and no early
//! way out of leaves, which gain nothing; the memory of a leaf's other parts asked for ahead.

use super::block::{Block, Blocks};
use super::build::DEPTH;
use super::bvh::{Along, Bvh, Hit};
use super::exact::{self, Crossing, Line, Ray, Triangle};
use super::lanes::{Lanes, NONE, key};
use super::node::{LEAF_BIT, Local, Node, Slabs, parts};
use glam::DVec3;

/// Children whose memory is asked for when their node is tested. Two are as good, four are slower.
const AHEAD: usize = 3;

impl Bvh {
    /// The first acceptable crossing with 0 < t < `end`. By axis, where the ray begins and where it goes.
    #[inline(always)]
    pub(super) fn closest<L: Lanes, A: Fn(u32, bool) -> bool>(
        &self,
        lanes: L,
        x: Along,
        y: Along,
        z: Along,
        end: f64,
        accept: &A,
    ) -> Option<Hit> {
        let (origin, direction) = (DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1));
        let line = Line::new(origin, direction);
        let ray = Ray::open(&line, end)?;
        let Ok(local) = Local::new(self.frame, &line, exact::guard(origin, origin)) else {
            return self.closest_of_all(lanes, &ray, accept);
        };
        match &self.blocks {
            Blocks::Wide(blocks) => self.walk(lanes, blocks, &local, &ray, accept),
            Blocks::Narrow(blocks) => self.walk(lanes, blocks, &local, &ray, accept),
        }
    }

    #[inline(always)]
    fn walk<L: Lanes, B: Block>(
        &self,
        lanes: L,
        blocks: &[B],
        local: &Local,
        ray: &Ray,
        accept: &impl Fn(u32, bool) -> bool,
    ) -> Option<Hit> {
        let nodes = &*self.nodes;
        let (mut slabs, mut best) = (Slabs::new(local, ray.end), Best::NONE);
        let (mut queues, mut waiting, mut pending) = ([lanes.empty(); DEPTH], [[0_u32; 2]; DEPTH], 0);
        let (mut queue, mut index) = (nodes.first()?.queue(lanes, &slabs), 0);
        let mut first = lanes.first(queue);
        loop {
            if first & NONE > key(slabs.end) {
                if pending == 0 {
                    return best.hit();
                }
                pending -= 1;
                [index, first] = waiting[pending];
                queue = queues[pending];
                continue;
            }
            let child = nodes[index as usize].child(first >> 16);
            queue = lanes.without(queue, first >> 16);
            first = lanes.first(queue);
            if child & LEAF_BIT == 0 {
                (queues[pending], waiting[pending]) = (queue, [index, first]);
                pending += usize::from(first & NONE <= key(slabs.end));
                index = child;
                queue = nodes[index as usize].queue(lanes, &slabs);
                first = lanes.first(queue);
                prefetch(lanes, nodes, blocks, &nodes[index as usize], queue);
                continue;
            }
            for part in parts(child) {
                if best.improve(lanes, &blocks[part], ray, accept) {
                    slabs.stop_at(local.length_to(best.t) as f32);
                }
            }
        }
    }

    /// The decision for rays that f32 does not serve.
    #[cold]
    fn closest_of_all<L: Lanes>(&self, lanes: L, ray: &Ray, accept: &impl Fn(u32, bool) -> bool) -> Option<Hit> {
        let mut best = Best::NONE;
        match &self.blocks {
            Blocks::Wide(blocks) => blocks.iter().for_each(|block| _ = best.improve(lanes, block, ray, accept)),
            Blocks::Narrow(blocks) => blocks.iter().for_each(|block| _ = best.improve(lanes, block, ray, accept)),
        }
        best.hit()
    }
}

/// The first crossing so far. What is divided is divided at the end.
#[derive(Debug, Clone, Copy)]
struct Best {
    t: f64,
    /// `u32::MAX` if there is none.
    triangle: u32,
    id: u32,
    front: bool,
    /// Edge functions of the second and third corner, and the sum of all.
    edges: [f64; 2],
    sum: f64,
}

impl Best {
    const NONE: Self =
        Self { t: f64::INFINITY, triangle: u32::MAX, id: u32::MAX, front: false, edges: [0.0; 2], sum: 1.0 };

    /// Takes a crossing of a leaf's triangles if one is nearer, and says whether.
    #[inline(always)]
    fn improve<L: Lanes>(
        &mut self,
        lanes: L,
        block: &impl Block,
        ray: &Ray,
        accept: &impl Fn(u32, bool) -> bool,
    ) -> bool {
        let (mut crossings, mut nearer) = (block.crossed_by(lanes, ray, self.t), false);
        while let Some((lane, Crossing { edges, sum, t })) = crossings.next() {
            let (triangle, front) = (block.triangle(lane), ray.sees_front(sum));
            let Triangle { index, id, .. } = triangle;
            if (t, index) < (self.t, self.triangle) && ray.counts(&triangle, t) && accept(id, front) {
                *self = Self { t, triangle: index, id, front, edges: [edges[1], edges[2]], sum };
                nearer = true;
            }
        }
        nearer
    }

    #[inline(always)]
    fn hit(self) -> Option<Hit> {
        let Self { t, triangle, id, front, edges, sum } = self;
        let barycentric = [edges[0] / sum, edges[1] / sum];
        (triangle != u32::MAX).then_some(Hit { t, triangle, id, front, barycentric })
    }
}

/// Asks for the memory of the [`AHEAD`] nearest children of a node. Without a branch: which are leaves cannot be guessed.
#[inline(always)]
fn prefetch<L: Lanes>(lanes: L, nodes: &[Node], blocks: &[impl Block], node: &Node, mut queue: L::Queue) {
    let nearest = lanes.first(queue);
    let mut first = nearest;
    for _ in 0..AHEAD {
        let child = node.child(if first & NONE == NONE { nearest >> 16 } else { first >> 16 });
        queue = lanes.without(queue, first >> 16);
        first = lanes.first(queue);
        let node = nodes.as_ptr().wrapping_add(child as usize).cast();
        let block = blocks.as_ptr().wrapping_add(*parts(child).start()).cast();
        lanes.prefetch(if child & LEAF_BIT == 0 { node } else { block }, size_of::<Node>());
    }
}

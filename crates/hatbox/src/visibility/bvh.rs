use super::Visibility;
#[cfg(target_arch = "x86_64")]
use super::avx2::Avx2;
use super::build::{Child, DEPTH, Item, LEAF, WIDTH, build};
use super::simd::{Frame, Kernels, LEAF_BIT, Node, Portable, Slabs};
use super::triangle::{Block, Crossings, Ray};
use crate::scene::Surface;
use glam::DVec3;

/// Pending nodes of a traversal: each level leaves at most all children but one.
pub(super) const STACK: usize = DEPTH * (WIDTH - 1) + 1;
/// Up to this many blocks are tested one after the other, without the tree.
const FLAT: usize = 4;

/// A tree of boxes over triangles, eight children per node, four triangles per leaf.
///
/// Triangles with coordinates that are not finite are never hit; triangles without area are never hit but can be
/// nearest. Coordinates may lie anywhere between about 1e-100 and 1e100.
#[derive(Debug, Clone)]
pub struct Bvh {
    pub(super) nodes: Vec<Node>,
    pub(super) blocks: Vec<Block<LEAF>>,
    /// Where each triangle of the input is: `LEAF` · block + lane; `u32::MAX` if it was not finite.
    slots: Vec<u32>,
    pub(super) frame: Frame,
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The point is origin + t · direction.
    pub t: f64,
    /// Index of the triangle in the input.
    pub triangle: u32,
    /// Id of the triangle's surface.
    pub id: u32,
    /// Whether its front, the side it is counter-clockwise from, was hit.
    pub front: bool,
    /// Weights of the second and third corner; that of the first is 1 − their sum.
    pub barycentric: [f64; 2],
}

impl Bvh {
    /// From triangles and the id of the surface that each belongs to.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn new(triangles: &[[DVec3; 3]], ids: &[u32]) -> Self {
        assert_eq!(triangles.len(), ids.len(), "one id per triangle");
        let finite = |triangle: &&[DVec3; 3]| triangle.iter().all(|corner| corner.is_finite());
        let frame = Frame::around(triangles.iter().filter(finite).flatten().copied());
        let mut items: Vec<Item> = (0..triangles.len() as u32)
            .filter(|&index| finite(&&triangles[index as usize]))
            .map(|index| Item { bounds: frame.bounds(&triangles[index as usize]), index })
            .collect();
        let slots = vec![u32::MAX; triangles.len()];
        let mut bvh = Self { nodes: Vec::new(), blocks: Vec::new(), slots, frame };
        if !items.is_empty() {
            let root = build(&mut items);
            bvh.flatten(&root, triangles, ids);
        }
        bvh
    }

    /// From surfaces; their ids are their indices.
    pub fn of_surfaces(surfaces: &[Surface]) -> Self {
        let (mut triangles, mut ids) = (Vec::new(), Vec::new());
        for (id, surface) in surfaces.iter().enumerate() {
            for triangle in surface.triangles() {
                triangles.push(triangle);
                ids.push(id as u32);
            }
        }
        Self::new(&triangles, &ids)
    }

    /// Appends a node and all below it, in depth-first order, and returns its index.
    fn flatten(&mut self, children: &[Child], triangles: &[[DVec3; 3]], ids: &[u32]) -> u32 {
        let at = self.nodes.len();
        self.nodes.push(Node::EMPTY);
        for (lane, child) in children.iter().enumerate() {
            let (bounds, child) = match child {
                Child::Leaf(bounds, items) => (bounds, LEAF_BIT | self.push_block(items, triangles, ids)),
                Child::Node(bounds, children) => (bounds, self.flatten(children, triangles, ids)),
            };
            self.nodes[at].set(lane, bounds, child);
        }
        at as u32
    }

    fn push_block(&mut self, items: &[u32], triangles: &[[DVec3; 3]], ids: &[u32]) -> u32 {
        let at = self.blocks.len();
        let mut block = Block::EMPTY;
        for (lane, &index) in items.iter().enumerate() {
            block.set(lane, &triangles[index as usize], index, ids[index as usize]);
            self.slots[index as usize] = (at * LEAF + lane) as u32;
        }
        self.blocks.push(block);
        at as u32
    }

    /// Number of triangles of the input.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Whether there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Memory in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.blocks) + size_of_val(&*self.slots)
    }

    /// The corners of a triangle and the id of its surface; `None` if it does not exist or is not finite.
    pub fn triangle(&self, index: u32) -> Option<([DVec3; 3], u32)> {
        let slot = *self.slots.get(index as usize)? as usize;
        let block = self.blocks.get(slot / LEAF)?;
        Some((block.triangle(slot % LEAF), block.id[slot % LEAF]))
    }

    /// Whether one of the `candidates`, indices of triangles, crosses the segment strictly between its ends: the same
    /// test as [`Visibility::occluded`], on the few triangles that a shaft has left.
    pub fn occluded_by(&self, from: DVec3, to: DVec3, candidates: &[u32]) -> bool {
        let Some(ray) = Ray::segment(from, to) else { return false };
        candidates.chunks(LEAF).any(|chunk| {
            let mut block = Block::<LEAF>::EMPTY;
            for (lane, &index) in chunk.iter().enumerate() {
                if let Some((triangle, _)) = self.triangle(index) {
                    // No surface is skipped, so that the id may be anything but the marks of `skip`.
                    block.set(lane, &triangle, index, 0);
                }
            }
            ray.blocked_by(&ray.cross(&block), &block, [u32::MAX; 2])
        })
    }

    /// The first crossing with 0 < t < `t_max` that `accept(id, front)` takes; `t_max` may be infinite.
    ///
    /// Where triangles cross at equal t, the first of the input is hit, so the answer depends on nothing else.
    pub fn closest_hit(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_max: f64,
        accept: impl Fn(u32, bool) -> bool,
    ) -> Option<Hit> {
        let ray = Ray::open(origin, direction, t_max)?;
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = Avx2::detect() {
            // SAFETY: the processor has the feature.
            return unsafe { self.closest_avx2(avx2, &ray, &accept) };
        }
        self.closest(Portable, &ray, &accept)
    }

    /// [`Self::any`] compiled for AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn any_avx2(&self, avx2: Avx2, ray: &Ray, skip: [u32; 2]) -> bool {
        self.any(avx2, ray, skip)
    }

    /// [`Self::closest`] compiled for AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn closest_avx2(&self, avx2: Avx2, ray: &Ray, accept: &impl Fn(u32, bool) -> bool) -> Option<Hit> {
        self.closest(avx2, ray, accept)
    }

    /// Whether any triangle blocks the ray.
    #[inline(always)]
    pub(super) fn any(&self, kernels: impl Kernels, ray: &Ray, skip: [u32; 2]) -> bool {
        if self.blocks.len() <= FLAT {
            return self.blocks.iter().any(|block| ray.blocked_by(&kernels.cross(ray, block), block, skip));
        }
        let slabs = Slabs::new(self.frame, ray.origin, ray.direction, ray.end);
        let mut stack = [0_u32; STACK];
        let mut pending = 1;
        while pending > 0 {
            pending -= 1;
            let node = &self.nodes[stack[pending] as usize];
            let (mut mask, _) = kernels.slabs(node, &slabs);
            while mask != 0 {
                let child = node.child[mask.trailing_zeros() as usize];
                mask &= mask - 1;
                if child & LEAF_BIT == 0 {
                    stack[pending] = child;
                    pending += 1;
                } else {
                    let block = &self.blocks[(child ^ LEAF_BIT) as usize];
                    if ray.blocked_by(&kernels.cross(ray, block), block, skip) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// The first acceptable crossing: near children first, far ones dropped once something nearer is hit.
    #[inline(always)]
    fn closest(&self, kernels: impl Kernels, ray: &Ray, accept: &impl Fn(u32, bool) -> bool) -> Option<Hit> {
        let mut best = None;
        if self.blocks.len() <= FLAT {
            self.blocks.iter().for_each(|block| closer(ray, block, &kernels.cross(ray, block), accept, &mut best));
            return best;
        }
        let mut slabs = Slabs::new(self.frame, ray.origin, ray.direction, ray.end);
        let mut stack = [(0.0_f32, 0_u32); STACK];
        let mut pending = 1;
        while pending > 0 {
            pending -= 1;
            let (enter, node) = stack[pending];
            if slabs.is_past(enter) {
                continue;
            }
            let node = &self.nodes[node as usize];
            let (mut mask, enters) = kernels.slabs(node, &slabs);
            let first = pending;
            while mask != 0 {
                let lane = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                let child = node.child[lane];
                if child & LEAF_BIT == 0 {
                    stack[pending] = (enters[lane], child);
                    pending += 1;
                    sink(&mut stack[first..pending]);
                } else if !slabs.is_past(enters[lane]) {
                    let block = &self.blocks[(child ^ LEAF_BIT) as usize];
                    closer(ray, block, &kernels.cross(ray, block), accept, &mut best);
                    if let Some(hit) = best {
                        slabs.stop_at(hit.t);
                    }
                }
            }
        }
        best
    }
}

impl Visibility for Bvh {
    fn occluded(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> bool {
        let Some(ray) = Ray::segment(from, to) else { return false };
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = Avx2::detect() {
            // SAFETY: the processor has the feature.
            return unsafe { self.any_avx2(avx2, &ray, skip) };
        }
        self.any(Portable, &ray, skip)
    }
}

/// Puts the last entry where it belongs among the others, which run from the farthest to the nearest.
#[inline(always)]
pub(super) fn sink(stack: &mut [(f32, u32)]) {
    let mut k = stack.len() - 1;
    while k > 0 && stack[k - 1].0 < stack[k].0 {
        stack.swap(k - 1, k);
        k -= 1;
    }
}

/// Replaces `best` by an acceptable crossing of the block that is nearer.
#[inline(always)]
fn closer(
    ray: &Ray,
    block: &Block<LEAF>,
    found: &Crossings<LEAF>,
    accept: &impl Fn(u32, bool) -> bool,
    best: &mut Option<Hit>,
) {
    let mut mask = found.mask;
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask - 1;
        let (t, triangle, id, sum) = (found.t[lane], block.index[lane], block.id[lane], found.sum[lane]);
        let nearer = best.is_none_or(|best| (t, triangle) < (best.t, best.triangle));
        let front = ray.sees_front(sum);
        if nearer && ray.counts(block, lane, t) && accept(id, front) {
            let barycentric = [found.edges[1][lane] / sum, found.edges[2][lane] / sum];
            *best = Some(Hit { t, triangle, id, front, barycentric });
        }
    }
}

use super::Visibility;
use super::block::{Blocks, is_single};
use super::build::{DEPTH, Item, LEAF, Source, WIDTH, build, range};
use super::exact::{self, Line, Ray, Triangle};
use super::lanes::{Lanes, Portable, Vector};
use super::leaf::{Leaf, Probe};
use super::node::{Frame, Local, MOST_PARTS, Node, Slabs, parts};
use super::packet::Segments;
use super::pages::Pages;
#[cfg(target_arch = "x86_64")]
use super::x86::{Avx2, Avx512};
use crate::scene::Surface;
use glam::DVec3;
use rayon::prelude::*;

/// Pending nodes of a traversal: each level leaves at most all children but one.
pub(super) const STACK: usize = DEPTH * (WIDTH - 1) + 1;

/// A tree of boxes over triangles: up to eight children per node, up to sixteen triangles per leaf, in parts of four.
///
/// Triangles with coordinates that are not finite are never hit; triangles without area are never hit but can be
/// nearest. Coordinates may lie anywhere between about 1e-100 and 1e100.
#[derive(Debug, Clone)]
pub struct Bvh {
    pub(super) nodes: Pages<Node>,
    /// Parts of leaves.
    pub(super) leaves: Pages<Leaf>,
    /// The same triangles as they were given.
    pub(super) blocks: Blocks,
    /// Where each triangle of the input is: part of a leaf · [`LEAF`] + lane, or `u32::MAX` if it was not finite.
    slots: Vec<u32>,
    pub(super) frame: Frame,
    instructions: Instructions,
}

/// One coordinate of where a ray begins, and of where it goes or ends. (Pairs of numbers are given to functions in registers,
/// points in memory, where they are read in other widths than they were written, and waited for.)
pub(super) type Along = (f64, f64);

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

/// Vector instructions that the tree is walked with. The answers do not depend on them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum InstructionSet {
    /// Those that the program was compiled for.
    Portable,
    /// AVX2 with fused multiply-add.
    Avx2,
    /// AVX-512 for packets, AVX2 for the rest.
    Avx512,
}

impl InstructionSet {
    /// All, in the order in which each includes the former.
    pub const ALL: [Self; 3] = [Self::Portable, Self::Avx2, Self::Avx512];
}

/// An instruction set that was found.
#[derive(Debug, Clone, Copy)]
enum Instructions {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512, Avx2),
}

impl Instructions {
    /// The best that the processor has, at most `most`.
    fn detect(most: InstructionSet) -> Self {
        #[cfg(target_arch = "x86_64")]
        match (Avx2::detect(), Avx512::detect()) {
            (Some(avx2), Some(avx512)) if most >= InstructionSet::Avx512 => return Self::Avx512(avx512, avx2),
            (Some(avx2), _) if most >= InstructionSet::Avx2 => return Self::Avx2(avx2),
            _ => {}
        }
        let _ = most;
        Self::Portable
    }
}

/// Runs a method, compiled for the tree's instruction set: `$narrow` for single rays, `$wide` for packets.
macro_rules! dispatch {
    ($self:ident, $method:ident, $avx2:ident, $avx512:ident, $($argument:expr),*) => {
        match $self.instructions {
            Instructions::Portable => $self.$method(Portable, $($argument),*),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the value proves that the processor has the feature.
            Instructions::Avx2(avx2) => unsafe { $self.$avx2(avx2, $($argument),*) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the values prove that the processor has the features.
            Instructions::Avx512(_avx512, _avx2) => unsafe { $self.$avx512(dispatch!(@ $avx512 _avx512 _avx2), $($argument),*) },
        }
    };
    (@ any_of_avx512 $avx512:ident $avx2:ident) => { $avx512 };
    (@ $other:ident $avx512:ident $avx2:ident) => { $avx2 };
}

impl Bvh {
    /// From triangles and the id of the surface that each belongs to.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn new(triangles: &[[DVec3; 3]], ids: &[u32]) -> Self {
        assert_eq!(triangles.len(), ids.len(), "one id per triangle");
        let finite = |triangle: &[DVec3; 3]| triangle.iter().all(|corner| corner.is_finite());
        let ranges =
            triangles.par_chunks(1 << 14).map(|part| range(part.iter().filter(|t| finite(t)).flatten().copied()));
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (lo, hi) = ranges.reduce(|| empty, |a, b| (a.0.min(b.0), a.1.max(b.1)));
        let frame = Frame::between(lo, hi);
        let mut items: Vec<Item> = (0..triangles.len() as u32)
            .into_par_iter()
            .with_min_len(1 << 12)
            .filter(|&index| finite(&triangles[index as usize]))
            .map(|index| Item::new(frame.bounds(&triangles[index as usize]), index))
            .collect();
        let mut bvh = Self {
            nodes: Pages::zeroed(0),
            leaves: Pages::zeroed(0),
            blocks: Blocks::zeroed(0, true),
            slots: vec![u32::MAX; triangles.len()],
            frame,
            instructions: Instructions::detect(InstructionSet::Avx512),
        };
        if !items.is_empty() {
            bvh.fill(&mut items, triangles, ids);
        }
        bvh
    }

    fn fill(&mut self, items: &mut [Item], triangles: &[[DVec3; 3]], ids: &[u32]) {
        let root = build(items);
        self.nodes = Pages::zeroed(root.nodes);
        self.leaves = Pages::zeroed(root.leaves);
        assert!(root.leaves <= MOST_PARTS, "too many triangles for the indices of a tree");
        let single = items.par_iter().all(|item| is_single(&triangles[item.index() as usize]));
        self.blocks = Blocks::zeroed(root.leaves, single);
        let source = Source { items, triangles, ids, frame: self.frame };
        match &mut self.blocks {
            Blocks::Wide(blocks) => root.write([0, 0], &mut self.nodes, &mut self.leaves, blocks, &source),
            Blocks::Narrow(blocks) => root.write([0, 0], &mut self.nodes, &mut self.leaves, blocks, &source),
        }
        for part in 0..self.blocks.len() {
            for (lane, triangle) in self.blocks.triangles(part).enumerate() {
                self.slots[triangle.index as usize] = (part * LEAF + lane) as u32;
            }
        }
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

    /// The same tree, walked with an instruction set or, if the processor does not have that, the next lesser one.
    #[must_use]
    pub fn restricted_to(mut self, set: InstructionSet) -> Self {
        self.instructions = Instructions::detect(set);
        self
    }

    /// What the tree is walked with.
    pub fn instruction_set(&self) -> InstructionSet {
        match self.instructions {
            Instructions::Portable => InstructionSet::Portable,
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2(_) => InstructionSet::Avx2,
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512(..) => InstructionSet::Avx512,
        }
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
        size_of_val(&*self.nodes) + size_of_val(&*self.leaves) + self.blocks.bytes() + size_of_val(&*self.slots)
    }

    /// The corners of a triangle and the id of its surface; `None` if it does not exist or is not finite.
    pub fn triangle(&self, index: u32) -> Option<([DVec3; 3], u32)> {
        let triangle = self.exact(index)?;
        Some((triangle.corners, triangle.id))
    }

    fn exact(&self, index: u32) -> Option<Triangle> {
        let slot = *self.slots.get(index as usize)?;
        (slot != u32::MAX).then(|| self.blocks.triangle(slot as usize / LEAF, slot as usize % LEAF))
    }

    /// Whether one of the `candidates`, indices of triangles, crosses the segment strictly between its ends: the same
    /// test as [`Visibility::occluded`], on the few triangles that a shaft has left.
    pub fn occluded_by(&self, from: DVec3, to: DVec3, candidates: &[u32]) -> bool {
        let Some(ray) = Ray::segment(from, to) else { return false };
        let crosses = |triangle: Triangle| ray.cross(&triangle).is_some_and(|found| ray.counts(&triangle, found.t));
        candidates.iter().any(|&index| self.exact(index).is_some_and(crosses))
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
        dispatch!(
            self,
            closest,
            closest_avx2,
            closest_avx2,
            (origin.x, direction.x),
            (origin.y, direction.y),
            (origin.z, direction.z),
            t_max,
            &accept
        )
    }

    /// [`Self::any`] compiled for AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn any_avx2(&self, avx2: Avx2, x: Along, y: Along, z: Along, skip: [u32; 2]) -> bool {
        self.any(avx2, x, y, z, skip)
    }

    /// [`Self::closest`] compiled for AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn closest_avx2<A>(&self, avx2: Avx2, x: Along, y: Along, z: Along, end: f64, accept: &A) -> Option<Hit>
    where
        A: Fn(u32, bool) -> bool,
    {
        self.closest(avx2, x, y, z, end, accept)
    }

    /// [`Self::any_of`] compiled for AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn any_of_avx2(&self, avx2: Avx2, segments: &Segments) -> Option<u32> {
        self.any_of(avx2, segments)
    }

    /// [`Self::any_of`] compiled for AVX-512.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    fn any_of_avx512(&self, avx512: Avx512, segments: &Segments) -> Option<u32> {
        self.any_of(avx512, segments)
    }

    /// Whether any triangle blocks a segment.
    ///
    /// The stack holds nodes and which of their children wait, so that nothing is done for children that are never
    /// visited.
    #[inline(always)]
    fn any<L: Lanes>(&self, lanes: L, x: Along, y: Along, z: Along, skip: [u32; 2]) -> bool {
        let ends @ [from, to] = [DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1)];
        let Ok(local) = Local::new(self.frame, &Line::new(from, to - from), exact::guard(from, to)) else {
            return self.any_of_all(ends, skip);
        };
        let (probe, slabs) = (Probe::new(&local, 1.0), Slabs::new(&local, 1.0));
        let nodes = &*self.nodes;
        let (mut stack, mut pending) = ([(0_u32, 0_u32); DEPTH], 0);
        let mut index = 0;
        while let Some(node) = nodes.get(index as usize) {
            let [enter, leave] = node.slabs(lanes, &slabs);
            let mask = enter.at_most(leave);
            let mut inner = mask & !node.leaves;
            let soon = if inner == 0 { index } else { node.child(inner.trailing_zeros()) };
            lanes.prefetch(nodes.as_ptr().wrapping_add(soon as usize).cast(), size_of::<Node>());
            if self.any_in(lanes, node, mask & node.leaves, &probe, ends, skip) {
                return true;
            }
            if inner == 0 {
                if pending == 0 {
                    return false;
                }
                pending -= 1;
                (index, inner) = stack[pending];
            }
            let rest = inner & (inner - 1);
            stack[pending] = (index, rest);
            pending += usize::from(rest != 0);
            let parent = &nodes[index as usize];
            index = parent.child(inner.trailing_zeros());
            let soon = parent.child(next(inner, rest)) as usize;
            lanes.prefetch(nodes.as_ptr().wrapping_add(soon).cast(), size_of::<Node>());
        }
        false
    }

    /// Whether a triangle of those of a node's leaves that are `met` blocks a segment.
    #[inline(always)]
    fn any_in<L: Lanes>(
        &self,
        lanes: L,
        node: &Node,
        mut met: u32,
        probe: &Probe,
        ends: [DVec3; 2],
        skip: [u32; 2],
    ) -> bool {
        let leaves = &*self.leaves;
        while met != 0 {
            let rest = met & (met - 1);
            let soon = *parts(node.child(next(met, rest))).start();
            lanes.prefetch(leaves.as_ptr().wrapping_add(soon).cast(), size_of::<Leaf>());
            let here = parts(node.child(met.trailing_zeros()));
            met = rest;
            for part in here {
                if self.any_of_part(lanes, part, probe, ends, skip) {
                    return true;
                }
            }
        }
        false
    }

    /// Whether a triangle of a part of a leaf blocks a segment.
    #[inline(always)]
    fn any_of_part<L: Lanes>(&self, lanes: L, part: usize, probe: &Probe, ends: [DVec3; 2], skip: [u32; 2]) -> bool {
        let leaf = &self.leaves[part];
        let found = probe.judge(lanes, leaf);
        let mut left = found.sure | found.doubtful;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            if !skip.contains(&leaf.id[lane])
                && (found.sure >> lane & 1 != 0 || self.surely_blocks(part, lane, ends, skip))
            {
                return true;
            }
        }
        false
    }

    /// The decision in f64, out of the way of the loop.
    #[inline(never)]
    pub(super) fn surely_blocks(&self, part: usize, lane: usize, [from, to]: [DVec3; 2], skip: [u32; 2]) -> bool {
        Ray::segment(from, to).is_some_and(|ray| ray.blocked_by(&self.blocks.triangle(part, lane), skip))
    }

    /// The decision for segments that f32 does not serve.
    #[cold]
    fn any_of_all(&self, [from, to]: [DVec3; 2], skip: [u32; 2]) -> bool {
        let mut all = self.blocks.all();
        Ray::segment(from, to).is_some_and(|ray| all.any(|triangle| ray.blocked_by(&triangle, skip)))
    }
}

/// The lane of the first of the children `rest`; if there is none, that of the first of `all`, modulo their number.
#[inline(always)]
fn next(all: u32, rest: u32) -> u32 {
    (rest | all << WIDTH).trailing_zeros()
}

impl Visibility for Bvh {
    fn occluded(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> bool {
        dispatch!(self, any, any_avx2, any_avx2, (from.x, to.x), (from.y, to.y), (from.z, to.z), skip)
    }

    fn occluded_packet(&self, from: &[DVec3], to: &[DVec3], skip: [u32; 2]) -> u32 {
        super::check_packet(from, to);
        let segments = Segments { from, to, skip };
        dispatch!(self, any_of, any_of_avx2, any_of_avx512, &segments)
            .unwrap_or_else(|| super::one_by_one(self, from, to, skip))
    }
}

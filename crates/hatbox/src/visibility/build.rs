//! Builds the tree: binned surface-area heuristic, eight children at a time.
//!
//! Children are split on until there are eight, the one of the greatest surface first, so no binary tree is ever made.
//! Each split reads its items for the bins, which know the boxes of both halves, and to divide them, without branches:
//! the sides cannot be guessed, and with a branch the spheres of 1.5 million triangles took a fifth longer (together with
//! more bins for few items, which did not make better trees). Subtrees are built and written in parallel and are the
//! same for any number of threads, since each depends on its own triangles only.
//!
//! What is left with up to sixteen triangles when a node's places are given away is a leaf of several parts, tested one
//! after the other, and not another node: with nodes down to four triangles half of all places for children stayed empty,
//! and each ray waited for a node more. First crossings in trees larger than the caches are the faster the more parts there
//! may be, up to four; with six all rays are slower again.
//!
//! Tried and dropped: nodes of the least sum of surfaces, sought from the leaves of a binary tree up (Ylitie, Karras and
//! Laine 2017), which are fewer, but rays visit as many, and leaves and nodes mixed, which cannot be guessed; the places of
//! a node given to what is not yet small enough for a leaf, or by surface and number, which makes wider nodes and slower
//! rays.

use super::block::Block;
use super::exact::Triangle;
use super::leaf::Leaf;
use super::node::{Frame, Node, leaf};
use glam::DVec3;
use rayon::prelude::*;

/// Triangles per part of a leaf.
pub(super) const LEAF: usize = 4;
/// Parts of a leaf, each of [`LEAF`] triangles, at most.
const PARTS: usize = 4;
/// Children per node.
pub(super) const WIDTH: usize = 8;
/// Levels of nodes; with [`WIDTH`] it bounds the traversal stack.
pub(super) const DEPTH: usize = 18;
/// Bins per axis, of many items, of few, and of hardly any.
const BINS: [usize; 3] = [16, 8, 4];
/// So many are few and hardly any.
const FEW: [usize; 2] = [64, 12];
/// Fewer triangles than this are not worth another thread.
const PARALLEL: usize = 4096;

/// A box in normalised coordinates; the fourth number fills the register.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(16))]
pub(super) struct Bounds {
    pub(super) lo: [f32; 4],
    pub(super) hi: [f32; 4],
}

impl Bounds {
    pub(super) const EMPTY: Self = Self { lo: [f32::INFINITY; 4], hi: [f32::NEG_INFINITY; 4] };

    #[inline(always)]
    fn join(&mut self, other: &Self) {
        self.lo = least(self.lo, other.lo);
        self.hi = greatest(self.hi, other.hi);
    }

    #[inline(always)]
    fn add(&mut self, point: [f32; 4]) {
        self.lo = least(self.lo, point);
        self.hi = greatest(self.hi, point);
    }

    /// Half the surface.
    #[inline(always)]
    fn area(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|k| self.hi[k] - self.lo[k]);
        // An empty box is inside out.
        if x < 0.0 { 0.0 } else { x * y + y * z + z * x }
    }
}

#[inline(always)]
fn least(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    let mut out = a;
    for k in 0..4 {
        out[k] = if b[k] < a[k] { b[k] } else { a[k] };
    }
    out
}

#[inline(always)]
fn greatest(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    let mut out = a;
    for k in 0..4 {
        out[k] = if b[k] > a[k] { b[k] } else { a[k] };
    }
    out
}

/// A triangle to be put into the tree: its box, whose fourth numbers are the bits of its index and one (so that no
/// arithmetic with the register meets a denormal number).
#[derive(Debug, Clone, Copy)]
pub(super) struct Item(Bounds);

impl Item {
    pub(super) fn new(mut bounds: Bounds, index: u32) -> Self {
        bounds.lo[3] = f32::from_bits(index);
        bounds.hi[3] = 1.0;
        Self(bounds)
    }

    pub(super) fn index(&self) -> u32 {
        self.0.lo[3].to_bits()
    }

    /// Twice the center of its box.
    #[inline(always)]
    fn center(&self) -> [f32; 4] {
        let mut sum = self.0.lo;
        for k in 0..4 {
            sum[k] += self.0.hi[k];
        }
        sum
    }
}

/// Some items and the boxes around them and around their centers.
struct Part<'a> {
    items: &'a mut [Item],
    bounds: Bounds,
    centers: Bounds,
}

impl<'a> Part<'a> {
    fn new(items: &'a mut [Item]) -> Self {
        let (bounds, centers) = around(items);
        Self { items, bounds, centers }
    }
}

/// The boxes around items and around their centers.
fn around(items: &[Item]) -> (Bounds, Bounds) {
    let one = |items: &[Item]| {
        let (mut bounds, mut centers) = (Bounds::EMPTY, Bounds::EMPTY);
        for item in items {
            bounds.join(&item.0);
            centers.add(item.center());
        }
        (bounds, centers)
    };
    let both = |mut a: (Bounds, Bounds), b: (Bounds, Bounds)| {
        a.0.join(&b.0);
        a.1.join(&b.1);
        a
    };
    items.par_chunks(1 << 14).map(one).reduce(|| (Bounds::EMPTY, Bounds::EMPTY), both)
}

/// A child of a node.
pub(super) enum Child {
    /// Where its items begin, and their number, at most [`LEAF`] for each of [`PARTS`].
    Leaf(Bounds, u32, u32),
    /// A node.
    Node(Bounds, Subtree),
}

/// A node and what is below it.
pub(super) struct Subtree {
    children: Vec<Child>,
    /// Nodes, itself included, and parts of leaves.
    pub(super) nodes: usize,
    pub(super) leaves: usize,
    items: usize,
}

/// The root. The items are put in the order of the leaves.
pub(super) fn build(items: &mut [Item]) -> Subtree {
    node(Part::new(items), 0, 0)
}

fn node(part: Part<'_>, first: usize, depth: usize) -> Subtree {
    // Halving reaches leaves in log₈ n levels. Where the heuristic has used up the slack, halve.
    let total = part.items.len();
    let needed = total.div_ceil(LEAF).max(1).ilog2() as usize / 3 + 2;
    let halve = depth + needed >= DEPTH;
    let mut parts = Vec::with_capacity(WIDTH);
    parts.push((first, part));
    while parts.len() < WIDTH {
        let cost = |part: &Part<'_>| if halve { part.items.len() as f32 } else { part.bounds.area() };
        let splittable = (0..parts.len()).filter(|&k| parts[k].1.items.len() > LEAF);
        let widest = splittable.max_by(|&a, &b| cost(&parts[a].1).total_cmp(&cost(&parts[b].1)));
        let Some(widest) = widest else { break };
        let (first, part) = parts.swap_remove(widest);
        let [left, right] = divide(part, halve);
        let middle = first + left.items.len();
        parts.extend([(first, left), (middle, right)]);
    }
    // The narrowest last, where an any-hit query takes it first: by measurement, the other way round costs an eighth.
    parts.sort_by(|(_, a), (_, b)| b.bounds.area().total_cmp(&a.bounds.area()));
    let finish = |(first, part): (usize, Part<'_>)| {
        let bounds = part.bounds;
        if part.items.len() <= PARTS * LEAF {
            Child::Leaf(bounds, first as u32, part.items.len() as u32)
        } else {
            Child::Node(bounds, node(part, first, depth + 1))
        }
    };
    let children: Vec<Child> = if total >= PARALLEL {
        parts.into_par_iter().map(finish).collect()
    } else {
        parts.into_iter().map(finish).collect()
    };
    Subtree::new(children, total)
}

impl Subtree {
    fn new(children: Vec<Child>, items: usize) -> Self {
        let (mut nodes, mut leaves) = (1, 0);
        for child in &children {
            match child {
                Child::Leaf(_, _, count) => leaves += count.div_ceil(LEAF as u32) as usize,
                Child::Node(_, below) => {
                    nodes += below.nodes;
                    leaves += below.leaves;
                }
            }
        }
        Self { children, nodes, leaves, items }
    }

    /// Writes the nodes and leaves in depth-first order; `at` is where the slices begin in the tree.
    pub(super) fn write<B: Block>(
        &self,
        at: [usize; 2],
        nodes: &mut [Node],
        leaves: &mut [Leaf],
        blocks: &mut [B],
        source: &Source,
    ) {
        let (own, mut nodes) = nodes.split_at_mut(1);
        own[0] = Node::EMPTY;
        let (mut leaves, mut blocks) = (leaves, blocks);
        let mut at = [at[0] + 1, at[1]];
        let mut below = Vec::new();
        for (lane, child) in self.children.iter().enumerate() {
            match child {
                Child::Leaf(bounds, first, count) => {
                    let (its_leaves, its_blocks);
                    let items = &source.items[*first as usize..][..*count as usize];
                    let parts = items.len().div_ceil(LEAF);
                    (its_leaves, leaves) = leaves.split_at_mut(parts);
                    (its_blocks, blocks) = blocks.split_at_mut(parts);
                    for (items, (leaf, block)) in items.chunks(LEAF).zip(its_leaves.iter_mut().zip(its_blocks)) {
                        (*leaf, *block) = source.leaf(items);
                    }
                    own[0].set(lane, bounds, leaf(at[1], parts));
                    at[1] += parts;
                }
                Child::Node(bounds, subtree) => {
                    let (its_nodes, its_leaves, its_blocks);
                    (its_nodes, nodes) = nodes.split_at_mut(subtree.nodes);
                    (its_leaves, leaves) = leaves.split_at_mut(subtree.leaves);
                    (its_blocks, blocks) = blocks.split_at_mut(subtree.leaves);
                    own[0].set(lane, bounds, at[0] as u32);
                    below.push((subtree, at, its_nodes, its_leaves, its_blocks));
                    at = [at[0] + subtree.nodes, at[1] + subtree.leaves];
                }
            }
        }
        let go = |(subtree, at, nodes, leaves, blocks): (&Self, [usize; 2], &mut [Node], &mut [Leaf], &mut [B])| {
            subtree.write(at, nodes, leaves, blocks, source);
        };
        if self.items >= PARALLEL { below.into_par_iter().for_each(go) } else { below.into_iter().for_each(go) }
    }
}

/// What leaves are made of.
pub(super) struct Source<'a> {
    pub(super) items: &'a [Item],
    pub(super) triangles: &'a [[DVec3; 3]],
    pub(super) ids: &'a [u32],
    pub(super) frame: Frame,
}

impl Source<'_> {
    /// The part of a leaf that consists of some items, in both forms.
    fn leaf<B: Block>(&self, items: &[Item]) -> (Leaf, B) {
        let (mut leaf, mut block) = (Leaf::EMPTY, B::EMPTY);
        for (lane, item) in items.iter().enumerate() {
            let index = item.index();
            let triangle = Triangle { corners: self.triangles[index as usize], index, id: self.ids[index as usize] };
            leaf.push(&triangle, self.frame);
            block.set(lane, &triangle);
        }
        (leaf, block)
    }
}

/// Divides items where the surface-area heuristic says, or in the middle.
fn divide(part: Part<'_>, halve: bool) -> [Part<'_>; 2] {
    let plan = match part.items.len() {
        _ if halve => None,
        count if count <= FEW[1] => plan::<{ BINS[2] }>(&part),
        count if count <= FEW[0] => plan::<{ BINS[1] }>(&part),
        _ => plan::<{ BINS[0] }>(&part),
    };
    let items = part.items;
    let Some(plan) = plan else {
        let (left, right) = items.split_at_mut(items.len() / 2);
        return [Part::new(left), Part::new(right)];
    };
    partition(items, &plan)
}

/// How items are divided.
#[derive(Clone, Copy)]
struct Plan {
    axis: usize,
    lo: f32,
    scale: f32,
    /// The first bin on the right.
    at: u32,
    /// The boxes around the items of either side.
    bounds: [Bounds; 2],
}

impl Plan {
    #[inline(always)]
    fn goes_left(&self, item: &Item) -> bool {
        bin(item.center()[self.axis], self.lo, self.scale) < self.at
    }
}

/// The bin of a center, rounded by the bits of a number so large that its last one counts ones: a conversion that
/// saturates costs several times as much.
#[inline(always)]
fn bin(center: f32, lo: f32, scale: f32) -> u32 {
    const ONES: f32 = 12_582_912.0;
    (((center - lo) * scale - 0.5) + ONES).to_bits() % BINS[0] as u32
}

type Bins<const B: usize> = [[(Bounds, u32); B]; 3];

/// The best of the binned splits; `None` if all centers coincide.
fn plan<const B: usize>(part: &Part<'_>) -> Option<Plan> {
    let range = part.centers;
    // A little less, so that the greatest center falls into the last bin.
    let scale = [0, 1, 2].map(|axis| B as f32 * 0.9999 / (range.hi[axis] - range.lo[axis]));
    let usable = scale.map(|scale| scale < f32::MAX);
    let scale = [0, 1, 2].map(|axis| if usable[axis] { scale[axis] } else { 0.0 });
    let bins = binned::<B>(part.items, range.lo, scale);
    (0..3)
        .filter(|&axis| usable[axis])
        .filter_map(|axis| cheapest(&bins[axis]).map(|(cost, at)| (cost, axis, at)))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, axis, at)| {
            let (left, right) = bins[axis].split_at(at);
            let bounds = [left, right].map(joined);
            Plan { axis, lo: range.lo[axis], scale: scale[axis], at: at as u32, bounds }
        })
}

/// The box around bins.
fn joined(bins: &[(Bounds, u32)]) -> Bounds {
    let mut all = Bounds::EMPTY;
    for (bounds, _) in bins {
        all.join(bounds);
    }
    all
}

/// The items in bins along each axis.
fn binned<const B: usize>(items: &[Item], lo: [f32; 4], scale: [f32; 3]) -> Bins<B> {
    if items.len() >= 1 << 15 {
        let halves = items.split_at(items.len() / 2);
        let (mut left, right) = rayon::join(|| binned::<B>(halves.0, lo, scale), || binned::<B>(halves.1, lo, scale));
        for (left, right) in left.iter_mut().flatten().zip(right.iter().flatten()) {
            left.0.join(&right.0);
            left.1 += right.1;
        }
        return left;
    }
    let mut bins = [[(Bounds::EMPTY, 0); B]; 3];
    for item in items {
        let center = item.center();
        for axis in 0..3 {
            let bin = bin(center[axis], lo[axis], scale[axis]);
            let (bounds, count) = &mut bins[axis][bin as usize % B];
            bounds.join(&item.0);
            *count += 1;
        }
    }
    bins
}

/// The cost and the first bin on the right of the best division of the bins.
fn cheapest<const B: usize>(bins: &[(Bounds, u32); B]) -> Option<(f32, usize)> {
    let mut right = [(0.0, 0); B];
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    for at in (1..B).rev() {
        bounds.join(&bins[at].0);
        count += bins[at].1;
        right[at] = (bounds.area(), count);
    }
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    let mut best = None;
    for at in 1..B {
        bounds.join(&bins[at - 1].0);
        count += bins[at - 1].1;
        if count == 0 || right[at].1 == 0 {
            continue;
        }
        // Triangles are tested by the part of a leaf, so that is the unit of work.
        let work = |count: u32| count.div_ceil(LEAF as u32) as f32;
        let cost = bounds.area() * work(count) + right[at].0 * work(right[at].1);
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, at));
        }
    }
    best
}

/// Moves the items whose centers are on the left to the front. Without branches: the sides cannot be guessed.
fn partition<'a>(items: &'a mut [Item], plan: &Plan) -> [Part<'a>; 2] {
    let mut count = 0;
    for k in 0..items.len() {
        // Items from `count` to `k` are on the right, and one more if this one is. (Where it goes is known before it is
        // moved: read again, it would be waited for.)
        let item = items[k];
        let left = plan.goes_left(&item);
        items[k] = items[count];
        items[count] = item;
        count += usize::from(left);
    }
    let (left, right) = items.split_at_mut(count);
    let [l, r] = [&*left, &*right].map(centers);
    let [l_bounds, r_bounds] = plan.bounds;
    [Part { items: left, bounds: l_bounds, centers: l }, Part { items: right, bounds: r_bounds, centers: r }]
}

/// The box around the centers of items.
fn centers(items: &[Item]) -> Bounds {
    let mut centers = Bounds::EMPTY;
    for item in items {
        centers.add(item.center());
    }
    centers
}

/// The box around points.
pub(super) fn range(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)))
}

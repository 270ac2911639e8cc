//! Builds the tree: binned surface-area heuristic, eight children at a time.
//!
//! Children are split on until there are eight, the one that costs most first, so no binary tree is ever made. Subtrees
//! are built in parallel and are the same for any number of threads, since each depends on its own triangles only.

use rayon::prelude::*;

/// Triangles per leaf: one block of the triangle test.
pub(super) const LEAF: usize = 4;
/// Children per node.
pub(super) const WIDTH: usize = 8;
/// Levels of nodes; with [`WIDTH`] it bounds the traversal stack.
pub(super) const DEPTH: usize = 18;
/// Bins per axis.
const BINS: usize = 16;
/// Fewer triangles than this are not worth another thread.
const PARALLEL: usize = 4096;

/// A box in normalised coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub(super) lo: [f32; 3],
    pub(super) hi: [f32; 3],
}

impl Bounds {
    pub(super) const EMPTY: Self = Self { lo: [f32::INFINITY; 3], hi: [f32::NEG_INFINITY; 3] };

    fn join(&mut self, other: &Self) {
        for k in 0..3 {
            self.lo[k] = self.lo[k].min(other.lo[k]);
            self.hi[k] = self.hi[k].max(other.hi[k]);
        }
    }

    /// Half the surface.
    fn area(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|k| (self.hi[k] - self.lo[k]).max(0.0));
        x * y + y * z + z * x
    }

    fn around(items: &[Item]) -> Self {
        let mut bounds = Self::EMPTY;
        for item in items {
            bounds.join(&item.bounds);
        }
        bounds
    }
}

/// A triangle to be put into the tree.
#[derive(Debug, Clone, Copy)]
pub(super) struct Item {
    pub(super) bounds: Bounds,
    pub(super) index: u32,
}

impl Item {
    /// Twice the center of its box.
    fn center(&self, axis: usize) -> f32 {
        self.bounds.lo[axis] + self.bounds.hi[axis]
    }
}

/// A child of a node.
pub(super) enum Child {
    /// Indices of at most [`LEAF`] triangles.
    Leaf(Bounds, Vec<u32>),
    /// A node.
    Node(Bounds, Vec<Child>),
}

/// The children of the root.
pub(super) fn build(items: &mut [Item]) -> Vec<Child> {
    node(items, 0)
}

fn node(items: &mut [Item], depth: usize) -> Vec<Child> {
    // Halving reaches leaves in log₈ n levels. Where the heuristic has used up the slack, halve.
    let needed = items.len().div_ceil(LEAF).max(1).ilog2() as usize / 3 + 2;
    let halve = depth + needed >= DEPTH;
    let parallel = items.len() >= PARALLEL;
    let mut parts = vec![(Bounds::around(items), items)];
    while parts.len() < WIDTH {
        let cost = |part: &(Bounds, &mut [Item])| if halve { part.1.len() as f32 } else { part.0.area() };
        let splittable = (0..parts.len()).filter(|&k| parts[k].1.len() > LEAF);
        let Some(widest) = splittable.max_by(|&a, &b| cost(&parts[a]).total_cmp(&cost(&parts[b]))) else { break };
        let (_, items) = parts.swap_remove(widest);
        let middle = if halve { items.len() / 2 } else { split(items) };
        let (left, right) = items.split_at_mut(middle);
        parts.extend([left, right].map(|side| (Bounds::around(side), side)));
    }
    let finish = |(bounds, items): (Bounds, &mut [Item])| {
        if items.len() <= LEAF {
            Child::Leaf(bounds, items.iter().map(|item| item.index).collect())
        } else {
            Child::Node(bounds, node(items, depth + 1))
        }
    };
    if parallel { parts.into_par_iter().map(finish).collect() } else { parts.into_iter().map(finish).collect() }
}

/// Reorders the items and returns where the best of the binned splits divides them; the middle if there is none.
fn split(items: &mut [Item]) -> usize {
    let mut range = Bounds::EMPTY;
    for item in &*items {
        for axis in 0..3 {
            range.lo[axis] = range.lo[axis].min(item.center(axis));
            range.hi[axis] = range.hi[axis].max(item.center(axis));
        }
    }
    let scale = [0, 1, 2].map(|axis| BINS as f32 / (range.hi[axis] - range.lo[axis]));
    let bin = |item: &Item, axis: usize| (((item.center(axis) - range.lo[axis]) * scale[axis]) as usize).min(BINS - 1);
    let mut bins = [[(Bounds::EMPTY, 0_usize); BINS]; 3];
    for item in &*items {
        for (axis, bins) in bins.iter_mut().enumerate() {
            let (bounds, count) = &mut bins[bin(item, axis)];
            bounds.join(&item.bounds);
            *count += 1;
        }
    }
    let best = (0..3)
        .filter(|&axis| scale[axis].is_finite())
        .filter_map(|axis| cheapest(&bins[axis]).map(|(cost, at)| (cost, axis, at)))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((_, axis, at)) => partition(items, |item| bin(item, axis) < at),
        None => items.len() / 2,
    }
}

/// The cost and the first bin on the right of the best division of the bins.
fn cheapest(bins: &[(Bounds, usize); BINS]) -> Option<(f32, usize)> {
    let mut right = [(0.0, 0); BINS];
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    for at in (1..BINS).rev() {
        bounds.join(&bins[at].0);
        count += bins[at].1;
        right[at] = (bounds.area(), count);
    }
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    let mut best = None;
    for at in 1..BINS {
        bounds.join(&bins[at - 1].0);
        count += bins[at - 1].1;
        if count == 0 || right[at].1 == 0 {
            continue;
        }
        // Triangles are tested by the block, so a block is the unit of work.
        let work = |count: usize| count.div_ceil(LEAF) as f32;
        let cost = bounds.area() * work(count) + right[at].0 * work(right[at].1);
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, at));
        }
    }
    best
}

/// Moves the items on the left to the front and returns their number.
fn partition(items: &mut [Item], left: impl Fn(&Item) -> bool) -> usize {
    let mut count = 0;
    for k in 0..items.len() {
        if left(&items[k]) {
            items.swap(count, k);
            count += 1;
        }
    }
    count
}

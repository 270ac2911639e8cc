//! A tree of boxes, to find what is near without looking at everything.
//!
//! Median splits along the longest side: plain, balanced whatever the input, and good enough for the work that is done
//! once per mesh. Rays have their own, faster tree.

use glam::DVec3;

/// A box as (least, greatest) corner.
pub(crate) type Bounds = (DVec3, DVec3);

/// The smallest box around points.
pub(crate) fn bounds(points: impl IntoIterator<Item = DVec3>) -> Bounds {
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    points.into_iter().fold(empty, |(lo, hi), p| (lo.min(p), hi.max(p)))
}

/// Whether two boxes have a point in common.
pub(crate) fn overlap(a: &Bounds, b: &Bounds) -> bool {
    a.0.cmple(b.1).all() && b.0.cmple(a.1).all()
}

const LEAF: usize = 4;

#[derive(Debug)]
struct Node {
    bounds: Bounds,
    /// First item of a leaf; of an inner node, its second child (the first one follows it).
    link: u32,
    /// Number of items of a leaf; zero for an inner node.
    count: u32,
}

/// Indices of boxes, sorted into a binary tree.
#[derive(Debug)]
pub(crate) struct BoxTree {
    nodes: Vec<Node>,
    items: Vec<u32>,
}

impl BoxTree {
    /// The tree of some of `boxes`, those with an index in `items`.
    pub(crate) fn new(boxes: &[Bounds], mut items: Vec<u32>) -> Self {
        let mut nodes = Vec::with_capacity(2 * items.len() / LEAF + 1);
        if !items.is_empty() {
            build(boxes, &mut items, 0, &mut nodes);
        }
        Self { nodes, items }
    }

    /// The items, neighbours near each other: searches in this order find most of what they need in the cache.
    pub(crate) fn items(&self) -> &[u32] {
        &self.items
    }

    /// Calls `found` with the index of every box in the leaves for which, and for whose parents, `enter` holds.
    pub(crate) fn visit(&self, enter: impl Fn(&Bounds) -> bool, mut found: impl FnMut(u32)) {
        let mut stack = Vec::from_iter((!self.nodes.is_empty()).then_some(0));
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index];
            if !enter(&node.bounds) {
                continue;
            }
            if node.count == 0 {
                stack.extend([node.link as usize, index + 1]);
            } else {
                let first = node.link as usize;
                self.items[first..first + node.count as usize].iter().for_each(|&item| found(item));
            }
        }
    }
}

/// Appends the subtree of `items`, which begin at `first` in the whole list.
fn build(boxes: &[Bounds], items: &mut [u32], first: usize, nodes: &mut Vec<Node>) {
    let at = |i: &u32| boxes[*i as usize];
    let around = bounds(items.iter().flat_map(|i| [at(i).0, at(i).1]));
    let index = nodes.len();
    let leaf = items.len() <= LEAF;
    nodes.push(Node { bounds: around, link: first as u32, count: if leaf { items.len() as u32 } else { 0 } });
    if leaf {
        return;
    }
    let middle = |i: &u32| at(i).0 + at(i).1;
    let spread = bounds(items.iter().map(middle));
    let axis = (spread.1 - spread.0).max_position();
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |a, b| middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.cmp(b)));
    let (left, right) = items.split_at_mut(half);
    build(boxes, left, first, nodes);
    nodes[index].link = nodes.len() as u32;
    build(boxes, right, first + half, nodes);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_visit_finds_what_a_search_of_everything_finds() {
        let boxes: Vec<Bounds> = (0..100)
            .map(|i| {
                let p = DVec3::new(f64::from(i * 37 % 100), f64::from(i * 53 % 97), f64::from(i * 11 % 31));
                (p, p + DVec3::splat(3.0))
            })
            .collect();
        let tree = BoxTree::new(&boxes, (0..100).collect());
        let meets = |a: &Bounds, b: &Bounds| a.0.cmple(b.1).all() && b.0.cmple(a.1).all();
        for query in &boxes {
            let mut found = Vec::new();
            tree.visit(|b| meets(b, query), |i| found.push(i));
            found.retain(|&i| meets(&boxes[i as usize], query));
            found.sort_unstable();
            let all: Vec<u32> = (0..100).filter(|&i| meets(&boxes[i as usize], query)).collect();
            assert_eq!(found, all);
        }
    }
}

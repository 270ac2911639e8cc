//! Which of many lamps a place is lit by one by one, and which stand for others: a cut through a tree over the lamps.
//!
//! With a lamp in every room of a building, asking every lamp at every point takes longer than all rays, and what most of
//! them give is nothing. So a cut of few nodes is made for each cell, the node that can give most being opened
//! first (B. Walter et al., "Lightcuts", SIGGRAPH 2005). A node that stays shut is represented by one of its lamps, another
//! one at every point, drawn with a chance like its power; it then counts as much more: all lamps are right in the mean.

use glam::DVec3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::FRAC_1_PI;

/// Most nodes of a cut where no more rays are cast than that, and wherever.
pub(super) const CUT: usize = 64;
const MOST: usize = 512;

/// A lamp as the tree sees it: the middle, the radius around it, and the power.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bulb {
    pub(super) center: DVec3,
    pub(super) radius: f64,
    pub(super) power: f64,
}

/// A lamp that is asked, and how many times it counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Chosen {
    pub(super) lamp: u32,
    pub(super) times: f64,
}

/// A tree over lamps.
#[derive(Debug)]
pub(super) struct LampTree {
    /// The root is the first.
    nodes: Vec<Node>,
}

#[derive(Debug)]
struct Node {
    around: Bulb,
    below: Below,
}

#[derive(Debug)]
enum Below {
    Lamp(u32),
    Nodes([u32; 2]),
}

impl LampTree {
    /// Halves the lamps where they spread most, again and again.
    pub(super) fn new(bulbs: &[Bulb]) -> Self {
        let mut tree = Self { nodes: Vec::with_capacity(2 * bulbs.len()) };
        let mut order: Vec<u32> = (0..bulbs.len() as u32).collect();
        if !order.is_empty() {
            tree.add(bulbs, &mut order);
        }
        tree
    }

    fn add(&mut self, bulbs: &[Bulb], lamps: &mut [u32]) -> u32 {
        let here = self.nodes.len();
        if let &mut [lamp] = lamps {
            self.nodes.push(Node { around: bulbs[lamp as usize], below: Below::Lamp(lamp) });
            return here as u32;
        }
        let of = |lamp: &u32| bulbs[*lamp as usize];
        let (lo, hi) = lamps
            .iter()
            .map(of)
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), bulb| (lo.min(bulb.center), hi.max(bulb.center)));
        let (center, extent) = (0.5 * (lo + hi), hi - lo);
        let radius = lamps.iter().map(of).map(|bulb| bulb.center.distance(center) + bulb.radius).fold(0.0, f64::max);
        let around = Bulb { center, radius, power: lamps.iter().map(of).map(|bulb| bulb.power).sum() };
        self.nodes.push(Node { around, below: Below::Nodes([0; 2]) });
        let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
        let middle = lamps.len() / 2;
        lamps.select_nth_unstable_by(middle, |a, b| of(a).center[axis].total_cmp(&of(b).center[axis]).then(a.cmp(b)));
        let (left, right) = lamps.split_at_mut(middle);
        let children = [self.add(bulbs, left), self.add(bulbs, right)];
        self.nodes[here].below = Below::Nodes(children);
        here as u32
    }

    /// The nodes to ask for a sphere whose points have the normal `n` and cast so many rays each: with more of those fewer lamps
    /// stand for others. Nodes that follow each other are near each other.
    pub(super) fn cut(&self, x: DVec3, radius: f64, n: DVec3, rays: usize) -> Vec<u32> {
        let most = rays.clamp(CUT, MOST);
        let open = |node: u32| {
            let bound = self.nodes[node as usize].around.most(x, radius, n);
            // The bits of positive numbers are in their order.
            (bound > 0.0).then_some((bound.to_bits(), Reverse(node)))
        };
        let mut queue: BinaryHeap<(u64, Reverse<u32>)> =
            (!self.nodes.is_empty()).then(|| open(0)).flatten().into_iter().collect();
        let mut chosen = Vec::with_capacity(most);
        while let Some((_, Reverse(node))) = queue.pop() {
            match self.nodes[node as usize].below {
                Below::Nodes(children) if chosen.len() + queue.len() + 2 <= most => {
                    queue.extend(children.into_iter().filter_map(open));
                }
                _ => chosen.push(node),
            }
        }
        chosen.sort_unstable();
        chosen
    }

    /// One lamp of a node, drawn by a number between 0 and 1.
    pub(super) fn represent(&self, node: u32, mut u: f64) -> Chosen {
        let (all, mut at) = (self.nodes[node as usize].around.power, node);
        loop {
            let here = &self.nodes[at as usize];
            match here.below {
                Below::Lamp(lamp) => return Chosen { lamp, times: all / here.around.power },
                Below::Nodes([left, right]) => {
                    let share = self.nodes[left as usize].around.power / here.around.power;
                    (at, u) = if u < share { (left, u / share) } else { (right, (u - share) / (1.0 - share)) };
                }
            }
        }
    }
}

impl Bulb {
    /// About the most that it can give to a point of a sphere.
    fn most(&self, x: DVec3, radius: f64, n: DVec3) -> f64 {
        let (to, reach) = (self.center - x, self.radius + radius);
        let square = to.length_squared();
        let cosine = (n.dot(to) + reach) / square.sqrt().max(reach).max(f64::MIN_POSITIVE);
        self.power * FRAC_1_PI * cosine.clamp(0.0, 1.0) / square.max(reach * reach).max(f64::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quadrature::sequence::{hash, unit};

    fn row(count: usize) -> LampTree {
        let bulb = |k: usize| Bulb { center: DVec3::new(k as f64, 0.0, 1.0), radius: 0.1, power: 1.0 + (k % 3) as f64 };
        LampTree::new(&(0..count).map(bulb).collect::<Vec<_>>())
    }

    #[test]
    fn few_lamps_are_all_asked() {
        let tree = row(CUT);
        let mut lamps: Vec<Chosen> =
            tree.cut(DVec3::ZERO, 0.0, DVec3::Z, 1).into_iter().map(|node| tree.represent(node, 0.5)).collect();
        lamps.sort_unstable_by_key(|chosen| chosen.lamp);
        assert!(lamps.into_iter().eq((0..CUT as u32).map(|lamp| Chosen { lamp, times: 1.0 })));
        assert!(row(5).cut(DVec3::ZERO, 0.0, -DVec3::Z, 1).is_empty(), "they are behind");
        assert!(row(0).cut(DVec3::ZERO, 0.0, DVec3::Z, 1).is_empty());
    }

    #[test]
    fn more_rays_ask_more_lamps() {
        let count = |rays: usize| row(1000).cut(DVec3::ZERO, 0.0, DVec3::Z, rays).len();
        assert_eq!([1, 65, 256, 5000].map(count), [CUT, 65, 256, MOST]);
    }

    #[test]
    fn near_lamps_are_themselves_and_far_ones_are_right_in_the_mean() {
        let (tree, lamps, trials) = (row(1000), 1000, 4000_u64);
        let mut times = vec![0.0; lamps];
        let nodes = tree.cut(DVec3::new(3.0, 0.0, 0.0), 0.1, DVec3::Z, 1);
        let is = |node: u32, lamp: u32| tree.represent(node, 0.5) == Chosen { lamp, times: 1.0 };
        assert!(nodes.len() <= CUT && (0..8).all(|near| nodes.iter().any(|&node| is(node, near))));
        for trial in 0..trials {
            for &node in &nodes {
                let u = unit(hash(trial, u64::from(node)));
                let Chosen { lamp, times: more } = tree.represent(node, u);
                times[lamp as usize] += more / trials as f64;
            }
        }
        // The farthest node of 500 lamps is the widest: its lamps are drawn eight times each in 4000 trials.
        let means: Vec<f64> = times.chunks(250).map(|some| some.iter().sum::<f64>() / some.len() as f64).collect();
        assert!(means.iter().all(|mean| (mean - 1.0).abs() < 0.05), "{means:?}");
    }
}

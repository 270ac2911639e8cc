//! Which cells a receiver sees, by proof.

use super::contour::Place;
use super::range;
use super::surroundings::{Group, Surroundings};
use crate::exchange::{Between, Views};
use crate::visibility::Body;
use glam::DVec3;

/// Bits of a word.
const WORD: usize = u64::BITS as usize;

/// What may hide a part of a leaf; `None` if it is more than is worth listing.
pub(super) type Blockers = Option<Vec<u32>>;

/// What is known of them.
pub(super) fn inherited(blockers: &Blockers) -> Between<'_> {
    blockers.as_deref().map_or(Between::Many, Between::Some)
}

/// Which leaves all of a receiver sees all of, and of which it may see a part, in order. The others it does not see.
///
/// A part of the receiver sees and does not see what the whole does; only what is seen in part is asked again.
#[derive(Debug, Clone)]
pub(super) struct Sight {
    visible: Vec<u64>,
    pub(super) partial: Vec<(usize, Blockers)>,
}

impl Sight {
    /// What a receiver sees.
    pub(super) fn new(watcher: &Watcher<'_>) -> Self {
        let surroundings = watcher.surroundings;
        let mut sight = Self { visible: vec![0; surroundings.leaves.len().div_ceil(WORD)], partial: Vec::new() };
        for group in &surroundings.groups {
            if watcher.before(group)[1] > surroundings.flat {
                sight.classify(watcher, group, 0, Between::Many);
            }
        }
        sight
    }

    /// What a part of the receiver sees.
    pub(super) fn of_part(&self, watcher: &Watcher<'_>) -> Self {
        let mut sight = Self { visible: self.visible.clone(), partial: Vec::new() };
        for (leaf, blockers) in &self.partial {
            sight.classify_leaf(watcher, watcher.surroundings.group_of(*leaf), *leaf, inherited(blockers));
        }
        sight
    }

    pub(super) fn sees(&self, leaf: usize) -> bool {
        self.visible[leaf / WORD] >> (leaf % WORD) & 1 == 1
    }

    /// Bytes that it takes.
    pub(super) fn bytes(&self) -> usize {
        let listed: usize = self.partial.iter().filter_map(|(_, blockers)| blockers.as_deref()).map(size_of_val).sum();
        size_of_val(&*self.visible) + size_of_val(&*self.partial) + listed
    }

    fn set(&mut self, leaf: usize) {
        self.visible[leaf / WORD] |= 1 << (leaf % WORD);
    }

    fn classify(&mut self, watcher: &Watcher<'_>, group: &Group, place: usize, inherited: Between<'_>) {
        let (node, flat) = (&group.nodes[place], watcher.surroundings.flat);
        let Some(children) = node.children else {
            return self.classify_leaf(watcher, group, node.leaves.start, inherited);
        };
        let [lo, hi] = watcher.heights(node.patch.corners());
        if hi <= flat {
            return;
        }
        let mut list = Vec::new();
        match watcher.between(group, node.patch.corners(), inherited, &mut list) {
            None => {}
            Some(Between::Nothing) if lo >= -flat => node.leaves.clone().for_each(|leaf| self.set(leaf)),
            Some(between) => children.into_iter().for_each(|child| self.classify(watcher, group, child, between)),
        }
    }

    fn classify_leaf(&mut self, watcher: &Watcher<'_>, group: &Group, leaf: usize, inherited: Between<'_>) {
        let surroundings = watcher.surroundings;
        let corners = surroundings.leaves[leaf].piece.patch.corners();
        let [lo, hi] = watcher.heights(corners);
        if hi <= surroundings.flat {
            return;
        }
        let mut list = Vec::new();
        match watcher.between(group, corners, inherited, &mut list) {
            None => {}
            Some(Between::Nothing) if lo >= -surroundings.flat => self.set(leaf),
            // Nothing is between, but the receiver's horizon crosses it.
            Some(Between::Nothing) => self.partial.push((leaf, Some(Vec::new()))),
            Some(Between::Some(list)) => self.partial.push((leaf, Some(list.to_vec()))),
            Some(Between::Many) => self.partial.push((leaf, None)),
        }
    }
}

/// A receiver that looks around.
pub(super) struct Watcher<'a> {
    pub(super) surroundings: &'a Surroundings,
    pub(super) place: Place<'a>,
    views: Views<'a>,
    body: Body,
    occluder: u32,
}

impl<'a> Watcher<'a> {
    /// `occluder` is what the receiver is a part of.
    pub(super) fn new(surroundings: &'a Surroundings, views: Views<'a>, place: Place<'a>, occluder: u32) -> Self {
        let body = Body::polygon(place.corners);
        Self { surroundings, place, views, body, occluder }
    }

    /// How far points are in front of the receiver: the least and the greatest.
    pub(super) fn heights(&self, points: &[DVec3]) -> [f64; 2] {
        range(points.iter().map(|&point| self.place.normal.dot(point - self.place.center)))
    }

    /// How far the receiver is in front of a group.
    pub(super) fn before(&self, group: &Group) -> [f64; 2] {
        range(self.place.corners.iter().map(|&corner| group.normal.dot(corner - group.origin)))
    }

    /// What of `inherited` may stand between the receiver and a part of a group; `None` if that is hidden.
    pub(super) fn between<'b>(
        &self,
        group: &Group,
        corners: &[DVec3],
        inherited: Between<'_>,
        list: &'b mut Vec<u32>,
    ) -> Option<Between<'b>> {
        let skip = [self.occluder, group.occluder];
        self.views.between([&self.body, &Body::polygon(corners)], skip, inherited, list)
    }
}

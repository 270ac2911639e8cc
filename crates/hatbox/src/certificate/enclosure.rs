//! The irradiance all over a small receiver, from all that sends: a linear function and what it may be wrong by.
//!
//! With F the form factors from a point of the receiver, a plane of cells that are seen sends
//!
//! ```text
//! E(x) = β F_plane(x) + Σ_cells [(mean − β) F_cell(x) + ∫(B − mean) G dA]
//! ```
//!
//! β being the mean of the nearest cell. F of the plane is smooth up to its edges, where the receiver may stand; that of a cell beside
//! the receiver is not, but there the factor is small. What is seen in part sends something between nothing and all.

use super::LANES;
use super::contour::{Local, edge, far_rest};
use super::piece::{Piece, quarters};
use super::sight::{Blockers, Sight, Watcher, inherited};
use super::surroundings::{Group, Leaf};
use crate::assemble::Panel;
use crate::exchange::Between;
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;

/// How often pieces of a cell are quartered.
const DEEPEST: usize = 6;

/// E(x) = `value` + `gradient`·(x − center), wrong by no more than `rest`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Enclosed {
    pub(super) value: [f64; LANES],
    pub(super) gradient: [DVec3; LANES],
    pub(super) rest: [f64; LANES],
}

impl Enclosed {
    /// All that arrives at a receiver. Terms whose rest is less than `fine` are not looked at more closely.
    pub(super) fn new(watcher: &Watcher<'_>, sight: &Sight, panels: &[Panel], fine: [f64; LANES]) -> Self {
        let mut found = Self::default();
        let mut partial = &sight.partial[..];
        for group in &watcher.surroundings.groups {
            let count = partial.partition_point(|(leaf, _)| *leaf < group.leaves().end);
            let (of_group, others) = partial.split_at(count);
            partial = others;
            let [lo, hi] = watcher.before(group);
            if hi > watcher.surroundings.flat {
                let before = lo >= -watcher.surroundings.flat;
                let vague = Vague::default();
                View { watcher, panels, group, before, fine, found: &mut found, vague }.look(sight, of_group);
            }
        }
        found
    }

    fn add(&mut self, factor: [f64; LANES], local: Local) {
        for (lane, factor) in factor.into_iter().enumerate() {
            self.value[lane] += factor * local.value;
            self.gradient[lane] += factor * local.gradient;
            self.rest[lane] += factor.abs() * local.rest;
        }
    }
}

/// Pieces of a group of which little more is known than that together they are no more than its half-space.
#[derive(Default, Clone, Copy)]
struct Vague {
    /// The least and the greatest exitance, and the sums of the least and the most that each may send.
    extremes: [[f64; 2]; LANES],
    sums: [[f64; 2]; LANES],
}

impl Vague {
    /// Adds a piece whose form factor is between 0 and `most`.
    fn add(&mut self, exitance: [f64; LANES], deviation: [f64; LANES], most: f64) {
        for lane in 0..LANES {
            let (lo, hi) = ((exitance[lane] - deviation[lane]).min(0.0), (exitance[lane] + deviation[lane]).max(0.0));
            let [least, greatest] = self.extremes[lane];
            self.extremes[lane] = [least.min(lo), greatest.max(hi)];
            self.sums[lane][0] += lo * most;
            self.sums[lane][1] += hi * most;
        }
    }

    /// What all of them send, if their form factors sum to no more than `most`.
    fn range(&self, lane: usize, most: f64) -> [f64; 2] {
        let ([lo, hi], [least, greatest]) = (self.extremes[lane], self.sums[lane]);
        [(lo * most).max(least), (hi * most).min(greatest)]
    }
}

/// A group as a receiver sees it.
struct View<'a> {
    watcher: &'a Watcher<'a>,
    panels: &'a [Panel],
    group: &'a Group,
    /// Whether all of the receiver is in front of the group.
    before: bool,
    fine: [f64; LANES],
    found: &'a mut Enclosed,
    vague: Vague,
}

impl View<'_> {
    fn look(&mut self, sight: &Sight, partial: &[(usize, Blockers)]) {
        let leaves = &self.watcher.surroundings.leaves;
        let visible: Vec<usize> = self.group.leaves().filter(|&leaf| sight.sees(leaf)).collect();
        if self.before {
            self.seen(&visible, sight);
        } else {
            for leaf in visible.into_iter().map(|leaf| &leaves[leaf]) {
                self.partly(leaf, &leaf.piece, Between::Nothing, DEEPEST);
            }
        }
        self.settle();
        for (leaf, blockers) in partial {
            self.partly(&leaves[*leaf], &leaves[*leaf].piece, inherited(blockers), DEEPEST);
        }
        self.settle();
    }

    /// What all of the group's half-space sends at the most.
    fn half_space(&self) -> f64 {
        0.5 * (1.0 - self.watcher.place.normal.dot(self.group.normal))
    }

    /// Takes what is vague for the middle of what it may be.
    fn settle(&mut self) {
        let most = self.half_space();
        for lane in 0..LANES {
            let [lo, hi] = self.vague.range(lane, most);
            self.found.value[lane] += 0.5 * (lo + hi);
            self.found.rest[lane] += 0.5 * (hi - lo);
        }
        self.vague = Vague::default();
    }

    /// What is seen: as if all were like the nearest leaf, and what the others differ by.
    fn seen(&mut self, visible: &[usize], sight: &Sight) {
        let leaves = &self.watcher.surroundings.leaves;
        let distance = |leaf: &usize| self.distance(&leaves[*leaf].piece);
        let Some(nearest) = visible.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))) else { return };
        let common = leaves[*nearest].piece.mean;
        let whole = self.outline(visible, sight);
        self.found.add(common, Known::of(whole, self.half_space()).local);
        for leaf in visible.iter().map(|&leaf| &leaves[leaf]) {
            self.piece(leaf, &leaf.piece, &common, DEEPEST);
        }
    }

    /// F of all leaves that are seen, by the edges that do not lie between two of them.
    fn outline(&self, visible: &[usize], sight: &Sight) -> Local {
        let mut whole = Local::default();
        for leaf in visible.iter().map(|&leaf| &self.watcher.surroundings.leaves[leaf]) {
            for (side, neighbour) in leaf.neighbours.iter().enumerate() {
                if neighbour.is_none_or(|neighbour| !sight.sees(neighbour)) {
                    whole.add(self.side(&leaf.piece, side));
                }
            }
        }
        whole
    }

    fn side(&self, piece: &Piece, side: usize) -> Local {
        let corners = piece.patch.corners();
        edge(&self.watcher.place, corners[side], corners[(side + 1) % corners.len()])
    }

    /// How far a piece is from all of the receiver, at the least.
    fn distance(&self, piece: &Piece) -> f64 {
        piece.center.distance(self.watcher.place.center) - piece.radius - self.watcher.place.radius
    }

    /// The most that F of a piece may be.
    fn most(&self, piece: &Piece) -> f64 {
        let nearest = self.distance(piece);
        if nearest <= 0.0 {
            return self.half_space();
        }
        let here = (self.watcher.heights(piece.patch.corners())[1] / nearest).min(1.0);
        let there = (self.watcher.before(self.group)[1] / nearest).min(1.0);
        (FRAC_1_PI * piece.patch.area() * here * there / nearest.powi(2)).min(self.half_space())
    }

    /// A piece that is seen, less so much of its exitance.
    fn piece(&mut self, leaf: &Leaf, piece: &Piece, common: &[f64; LANES], deeper: usize) {
        let radius = self.watcher.place.radius;
        let (most, nearest) = (self.most(piece), self.distance(piece));
        let mut local = Local::default();
        (0..piece.patch.corners().len()).for_each(|side| local.add(self.side(piece, side)));
        local.rest = local.rest.min(far_rest(radius, piece.patch.area(), nearest));
        let Known { local, is_vague } = Known::of(local, most);
        let factor: [f64; LANES] = std::array::from_fn(|lane| piece.mean[lane] - common[lane]);
        let normals = [self.watcher.place.normal, self.group.normal];
        let [uneven, rest] = uneven(piece, normals, self.watcher.place.center, radius, nearest, most);
        let coarse = (0..LANES).any(|lane| factor[lane].abs() * local.rest + rest[lane] > self.fine[lane]);
        // Pieces that touch the receiver are known no better if they are smaller than it.
        let least = if is_vague { 0.5 * nearest.max(radius) } else { 0.0 };
        if coarse && deeper > 0 && piece.radius > least {
            self.parts(leaf, piece).iter().for_each(|part| self.piece(leaf, part, common, deeper - 1));
        } else if is_vague {
            self.vague.add(factor, piece.deviation(), most);
        } else {
            self.found.add(factor, local);
            for lane in 0..LANES {
                self.found.value[lane] += uneven[lane];
                self.found.rest[lane] += rest[lane];
            }
        }
    }

    fn parts(&self, leaf: &Leaf, piece: &Piece) -> [Piece; 4] {
        let plane = self.panels[leaf.panel].plane();
        quarters(&piece.patch).map(|part| Piece::new(part, plane, &leaf.functions))
    }

    /// A piece that may be hidden in part, or cross a horizon.
    fn partly(&mut self, leaf: &Leaf, piece: &Piece, inherited: Between<'_>, deeper: usize) {
        let flat = self.watcher.surroundings.flat;
        let [lo, hi] = self.watcher.heights(piece.patch.corners());
        if hi <= flat {
            return;
        }
        let mut list = Vec::new();
        let Some(between) = self.watcher.between(self.group, piece.patch.corners(), inherited, &mut list) else {
            return;
        };
        if matches!(between, Between::Nothing) && lo >= -flat && self.before {
            self.piece(leaf, piece, &[0.0; LANES], deeper);
            return;
        }
        let (most, deviation) = (self.most(piece), piece.deviation());
        let may = |lane: usize| 0.5 * (piece.mean[lane].abs() + deviation[lane]) * most;
        let coarse = (0..LANES).any(|lane| may(lane) > self.fine[lane]);
        if coarse && deeper > 0 && piece.radius > 0.5 * self.watcher.place.radius {
            self.parts(leaf, piece).iter().for_each(|part| self.partly(leaf, part, between, deeper - 1));
        } else {
            self.vague.add(piece.mean, deviation, most);
        }
    }
}

/// ∫(B − mean) G from a piece at the center of a receiver of that radius, and what that may be wrong by anywhere on it, if F is no
/// more than `most` and no points of the two are nearer than `nearest`. With ρ = y − x between two points, |∂G| ≤ 2/π|ρ|³ and
/// |∂²G| ≤ 6/π|ρ|⁴.
pub(super) fn uneven(
    piece: &Piece,
    [here, there]: [DVec3; 2],
    center: DVec3,
    radius: f64,
    nearest: f64,
    most: f64,
) -> [[f64; LANES]; 2] {
    let (mut value, mut rest) = ([0.0; LANES], piece.deviation().map(|deviation| deviation * most));
    if nearest <= 0.0 {
        return [value, rest];
    }
    let rho = piece.center - center;
    let (square, rises, falls) = (rho.length_squared(), here.dot(rho), -there.dot(rho));
    let slope = (here * falls - there * rises - 4.0 * rises * falls / square * rho) * (FRAC_1_PI / (square * square));
    let (size, share) = (piece.radius, FRAC_1_PI * piece.patch.area() / nearest.powi(3));
    for (lane, rest) in rest.iter_mut().enumerate() {
        let curved = piece.curved[lane] * most.min(2.0 * share * size);
        // Mean squares of distances from the middle are at most a third of the radius's.
        let straight = piece.slope[lane] * size * size * share * (size + 2.0 * radius) / nearest;
        if straight + curved < *rest {
            value[lane] = piece.moment[lane].dot(slope);
            *rest = straight + curved;
        }
    }
    [value, rest]
}

/// A form factor that is no more than `most`.
struct Known {
    local: Local,
    /// Whether it says no more than that.
    is_vague: bool,
}

impl Known {
    fn of(local: Local, most: f64) -> Self {
        // What is not even a number says nothing either.
        if local.rest < 0.5 * most {
            Self { local, is_vague: false }
        } else {
            Self { local: Local { value: 0.5 * most, gradient: DVec3::ZERO, rest: 0.5 * most }, is_vague: true }
        }
    }
}

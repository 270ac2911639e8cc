//! Light from lamps, which rays would find too seldom: sides of faces whose cells are strong emitters.
//!
//! What a lamp's face sends is split into the mean over its cells and the rest. The mean is sent here: the irradiance of
//! the whole face, in closed form, times the share of it that rays to points of the face find visible, at the points of a
//! rule on every receiving cell. The rest is small and goes with the other rays.
//!
//! The points of a cell take neighbouring parts of one net of places on a lamp, and so do cells that are neighbours: what
//! joins them averages half-shadows over a finer net.
//!
//! Where the border of a shadow passes through a cell, those few points say too little, however many rays they send: some
//! percent of error stayed on coarse meshes, whatever was asked for. There the lamp is looked at from all points that the cell's
//! own rays start from, by a ray each, so that its error falls with theirs. A quarter of those points, shared among the lamps, and
//! one for each at the least, are asked whether the rule has missed something. What each half of those points has seen
//! tells that error.
//!
//! How many rays a point sends to a lamp does not depend on what they meet. More of them where the first ones disagree was a
//! mistake: a lamp that is a quarter visible is missed by all of few rays more often than it is met by all of them, so that nobody
//! asks on, and its light is too little on the average, with any number of points. (Whether a cell looks from all of its
//! points does depend on rays: those of the rule and of its share of a quarter of its points; a lamp of which all of them
//! miss a hundredth is whole.)
//!
//! A point of a rule takes the share of its rays that arrive for that of ∫G. By one ray alone that is the share of the area, which is
//! not the same for a lamp that is large for its distance; such lamps have more of the budget.
//!
//! A point has a budget of shadow rays, shared among the lamps by how much they can give at most; a lamp whose share is
//! less than one ray gets one with that probability, and counts accordingly more. Who does is not decided for each lamp on
//! its own: the shares are laid end to end, and a comb is laid over them, so that of lamps that are near each other the right
//! number is asked; combs of neighbouring points are shifted evenly. Of many lamps only some are asked ([`LampTree`]), so
//! that a building with a lamp in every room costs what one room costs.

use super::cells::Cells;
use super::fit::{Matrix, Take, factor, mean_mass, solve};
use super::lamp_tree::{Bulb, Chosen, LampTree};
use super::rays::{Points, Tracer};
use super::strong::strong_sides;
use crate::assemble::{Panel, Region, point_row};
use crate::element::{ALL, Element, MAX_DOFS};
use crate::exchange::{Geometry, Params};
use crate::kernel::geometric;
use crate::mesh::Patch;
use crate::quadrature::rule;
use crate::quadrature::sequence::{hash, point, unit};
use crate::visibility::{Bvh, Visibility};
use glam::DVec3;
use std::collections::BTreeMap;
use std::f64::consts::FRAC_1_PI;

/// Lamps that a cell looks at from all of its points, at the most.
const MOST_MIXED: usize = 4;
/// Points of a rule at the most: cells of all elements have so many parts of a lamp's net.
const MOST_POINTS: u32 = 16;
/// A ray stands for at most so many rays that were not cast.
const ROULETTE: f64 = 1.0 / 64.0;

/// One side of a face that shines.
#[derive(Debug)]
struct Lamp {
    panel: Panel,
    strength: f64,
    /// Its cells, each with ∫N_k / area of the lamp.
    cells: Vec<(u32, [f64; MAX_DOFS])>,
}

/// The lamps of a scene.
#[derive(Debug)]
pub(super) struct Lamps {
    all: Vec<Lamp>,
    tree: LampTree,
    /// The lamp of each cell of one.
    of_cell: BTreeMap<u32, u32>,
    seed: u64,
}

/// What a cell gets from one lamp of exitance 1: coefficients of its irradiance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Entry {
    pub(super) lamp: u32,
    pub(super) values: [f32; MAX_DOFS],
    /// Half of what one half of the points that rays start from has more than the other; 0 where the lamp was not looked at from
    /// them.
    pub(super) doubts: [f32; MAX_DOFS],
}

/// Where lamps are looked at from, on the cells of one element.
#[derive(Debug)]
pub(super) struct Receivers {
    /// The points of a rule, and those that rays start from.
    rule: Weighted,
    net: Weighted,
    /// What each of the latter adds to [`doubts`](Entry::doubts).
    doubts: Vec<[f64; MAX_DOFS]>,
}

/// Points of the reference cell.
#[derive(Debug)]
struct Weighted {
    points: Vec<[f64; 2]>,
    /// For each point, what it adds to each coefficient.
    weights: Vec<[f64; MAX_DOFS]>,
}

impl Receivers {
    /// `net` are the points that rays start from, `factors` those of the Gram matrices of the points that each [`Take`] takes.
    pub(super) fn new(element: &'static Element, net: &Points, factors: &[Matrix; 3]) -> Self {
        // Two degrees more than the product of two functions: shadows have edges.
        let rule = rule(element.shape, 2 * element.degree + 2);
        let n = element.dofs();
        let l = factor(mean_mass(element, None), n);
        let weigh = |at: [f64; 2], weight: f64, l: &Matrix| {
            let mut column = element.values(at).map(|value: f64| value * weight);
            solve(l, n, 1, &mut column[..n]);
            column
        };
        let of_rule = rule.points.iter().zip(&rule.weights).map(|(&at, &weight)| weigh(at, weight, &l)).collect();
        let share = 1.0 / net.at.len() as f64;
        let of_net = |take: Take, weight: f64| {
            net.at[take.of(net.at.len())].iter().map(move |&at| weigh(at, weight, &factors[take as usize]))
        };
        // A half has half the points, each of which counts twice as much in it, and half of what it has is taken.
        let doubts = of_net(Take::FirstHalf, share).chain(of_net(Take::SecondHalf, -share)).collect();
        Self {
            rule: Weighted { points: rule.points.clone(), weights: of_rule },
            net: Weighted { points: net.at.clone(), weights: of_net(Take::All, share).collect() },
            doubts,
        }
    }
}

impl Lamps {
    /// The sides of faces whose cells are strong, by the strengths of the parameters.
    pub(super) fn new(geometry: &Geometry<'_>, cells: &Cells, params: &Params) -> Self {
        let all: Vec<Lamp> = strong_sides(geometry, cells, params)
            .iter()
            .filter_map(|on| Lamp::new(geometry, cells, params, on))
            .collect();
        let numbered = all.iter().enumerate();
        let of_cell =
            numbered.flat_map(|(k, lamp)| lamp.cells.iter().map(move |&(cell, _)| (cell, k as u32))).collect();
        let tree = LampTree::new(&all.iter().map(Lamp::bulb).collect::<Vec<_>>());
        Self { all, tree, of_cell, seed: params.seed ^ 0x006c_616d_7073 }
    }

    /// The lamp that a cell belongs to.
    pub(super) fn of(&self, cell: usize) -> Option<usize> {
        self.of_cell.get(&(cell as u32)).map(|&lamp| lamp as usize)
    }

    /// Number of lamps.
    pub(super) fn len(&self) -> usize {
        self.all.len()
    }

    /// The means over each lamp of a function, for every band and zeros for the other lanes, if `value` has its coefficients by
    /// number and band.
    pub(super) fn means(
        &self,
        cells: &Cells,
        [bands, lanes]: [usize; 2],
        value: impl Fn(usize, usize) -> f64,
    ) -> Vec<f64> {
        let mut means = Vec::with_capacity(self.all.len() * lanes);
        for lamp in &self.all {
            for band in 0..bands {
                let share = |(cell, weights): &(u32, [f64; MAX_DOFS])| -> f64 {
                    cells.range(*cell as usize).zip(weights).map(|(dof, w)| w * value(dof, band)).sum()
                };
                means.push(lamp.cells.iter().map(share).sum());
            }
            means.resize(means.len() + lanes - bands, 0.0);
        }
        means
    }

    /// What a cell gets from each lamp it sees, and the number of rays that were cast.
    pub(super) fn at_cell(
        &self,
        cells: &Cells,
        cell: usize,
        receivers: &Receivers,
        budget: u32,
        tracer: &Tracer,
    ) -> (Vec<Entry>, u64) {
        let patch = cells.patch(cell);
        let n = cells.element(cell).dofs();
        let start = tracer.block_of(cell).wrapping_mul(MOST_POINTS);
        let (mut rays, normal) = (0, patch.normal());
        let radius = patch.corners().iter().map(|corner| corner.distance(patch.center())).fold(0.0, f64::max);
        let asked = self.tree.cut(patch.center(), radius, normal, budget as usize);
        let (mut found, mut places): (Vec<View>, BTreeMap<u32, usize>) = Default::default();
        for (q, (&at, weights)) in receivers.rule.points.iter().zip(&receivers.rule.weights).enumerate() {
            let draw = Draw { net: self.seed, part: start.wrapping_add(q as u32) };
            let x = (patch.point(at), normal, cells.surface(cell));
            rays += self.at_point(x, &asked, budget, draw, &tracer.blockers, |lamp, look, times| {
                let place = *places.entry(lamp).or_insert(found.len());
                if place == found.len() {
                    found.push(View::new(lamp));
                }
                found[place].add(look, times, &weights[..n]);
            });
        }
        let (surface, block) = (cells.surface(cell), tracer.block_of(cell));
        let net = Net { points: &receivers.net, doubts: &receivers.doubts, cell: &patch, surface, block };
        rays += u64::from(self.look_at_mixed(&mut found, &net, n, &tracer.blockers));
        found.retain(|view| view.most > 0.0);
        (found.iter().map(View::entry).collect(), rays)
    }

    /// Has a cell look again at lamps where the border of a shadow passes; gives the number of rays.
    ///
    /// A quarter of the points that rays start from look for one that the points of the rule have missed. Lamps share them by what
    /// they give, since less of the light is at stake with each.
    fn look_at_mixed(&self, found: &mut [View], net: &Net<'_>, dofs: usize, blockers: &Bvh) -> u32 {
        let (mut rays, mut left) = (0, MOST_MIXED);
        let gives = |view: &View| self.all[view.lamp as usize].strength * view.whole;
        let all: f64 = found.iter().filter(|view| view.for_itself).map(gives).sum();
        let quarter = net.points.points.len() as f64 / 4.0;
        for view in found.iter_mut().filter(|view| view.for_itself) {
            if left == 0 {
                break;
            }
            let points = (quarter * gives(view) / all.max(f64::MIN_POSITIVE)).ceil() as usize;
            let looks = if view.is_mixed() { Vec::new() } else { self.looks_between(view, net, points, blockers) };
            if view.is_mixed() || looks.last().is_some_and(|look| view.contradicts(look)) {
                left -= 1;
                rays += self.look_from_all(view, looks, net, dofs, blockers);
            } else {
                rays += looks.iter().map(|look| look.cast).sum::<u32>();
            }
        }
        rays
    }

    /// How the first of the points that rays start from see a lamp, up to one that sees it otherwise than the points of the rule do,
    /// which see it whole or not at all.
    fn looks_between(&self, view: &View, net: &Net<'_>, points: usize, blockers: &Bvh) -> Vec<Look> {
        let mut looks = Vec::new();
        for q in 0..points.min(net.points.points.len()) {
            looks.push(self.look(net.from(q), view.lamp, 1.0, self.draw(net, q), blockers));
            if view.contradicts(&looks[q]) {
                break;
            }
        }
        looks
    }

    /// Has a cell look at a lamp from all points that its rays start from, of which the first have looked; gives the number of
    /// rays.
    ///
    /// A ray of a point meets G V at some place of the lamp. With v the share that is visible of what all of them have sought,
    /// G V + v (∫G − G) is ∫G V on the average, but for a part of the size of 1/K, and exact where all of the lamp is visible
    /// or nothing of it.
    fn look_from_all(&self, view: &mut View, mut looks: Vec<Look>, net: &Net<'_>, dofs: usize, blockers: &Bvh) -> u32 {
        let others = looks.len()..net.points.points.len();
        looks.extend(others.map(|q| self.look(net.from(q), view.lamp, 1.0, self.draw(net, q), blockers)));
        let sum = |of: fn(&Look) -> f64| looks.iter().map(of).sum::<f64>();
        let share = sum(|look| look.met) / sum(|look| look.sought).max(f64::MIN_POSITIVE);
        view.values = [0.0; MAX_DOFS];
        for (look, (weights, doubts)) in looks.iter().zip(net.points.weights.iter().zip(net.doubts)) {
            let seen = look.met + share * (look.whole - look.sought);
            let add = |values: &mut [f64], weights: &[f64]| {
                values.iter_mut().zip(&weights[..dofs]).for_each(|(value, weight)| *value += weight * seen);
            };
            add(&mut view.values, weights);
            add(&mut view.doubts, doubts);
            view.note(look);
        }
        sum(|look| f64::from(look.cast)) as u32
    }

    /// What a point of a cell's net draws.
    fn draw(&self, net: &Net<'_>, q: usize) -> Draw {
        Draw { net: hash(self.seed, 1), part: net.part(q) }
    }

    /// Calls `give` with each lamp that is asked by a point with a normal on a surface, how the point sees it, and how many
    /// lamps it stands for.
    fn at_point(
        &self,
        (x, n, surface): (DVec3, DVec3, u32),
        asked: &[u32],
        budget: u32,
        draw: Draw,
        blockers: &Bvh,
        mut give: impl FnMut(u32, &Look, f64),
    ) -> u64 {
        // Who stands for a node is drawn before its share is known: a lamp may be much nearer than the middle of its node.
        let choose = |&node: &u32| {
            let chosen = self.tree.represent(node, draw.shift(u64::from(node) + 1, SHIFTS[1]));
            let lamp = &self.all[chosen.lamp as usize];
            let most = if lamp.panel.surface == surface { 0.0 } else { chosen.times * lamp.most(x, n) };
            (chosen, most)
        };
        let chosen: Vec<(Chosen, f64)> = asked.iter().map(choose).filter(|&(_, most)| most > 0.0).collect();
        let total: f64 = chosen.iter().map(|(_, most)| most).sum();
        let (mut rays, mut comb) = (0, Comb { place: draw.shift(0, SHIFTS[0]) });
        for (Chosen { lamp, times }, most) in chosen {
            let share = f64::from(budget) * most / total;
            let chance = share.clamp(ROULETTE, 1.0);
            if comb.meets(chance) {
                let look = self.look((x, n, surface), lamp, share, draw, blockers);
                rays += u64::from(look.cast);
                give(lamp, &look, times / chance);
            }
        }
        rays
    }

    /// How a point with a normal on a surface sees a lamp, by about `share` rays.
    fn look(&self, (x, n, surface): (DVec3, DVec3, u32), k: u32, share: f64, draw: Draw, blockers: &Bvh) -> Look {
        let lamp = &self.all[k as usize];
        let Some([whole, ..]) = point_row(&lamp.panel, x, n) else { return Look::default() };
        let rays = (share.ceil().max(1.0) as u32).next_power_of_two();
        let (net, first, panel) = (hash(draw.net, u64::from(k)), draw.part.wrapping_mul(rays), &lamp.panel);
        // What lies below the horizon is no part of ∫G.
        let Some(above) = Region::in_front(&panel.patch, x, n) else { return Look::default() };
        let (mut seen, mut all) = (0.0, 0.0);
        for ray in 0..rays {
            let [u, v, ..] = point(net, first.wrapping_add(ray));
            let y = if above.whole { panel.sample(u, v) } else { above.sample(u, v) };
            let g = geometric(x, n, y, panel.normal());
            all += g;
            if g > 0.0 && !blockers.occluded(x, y, [surface, panel.surface]) {
                seen += g;
            }
        }
        let mean = above.area() / f64::from(rays);
        Look { whole, sought: mean * all, met: mean * seen, cast: rays }
    }

    /// A point's irradiance from all lamps, with `budget` rays.
    pub(super) fn irradiance(
        &self,
        x: (DVec3, DVec3, u32),
        budget: u32,
        set: u64,
        blockers: &Bvh,
        means: &[f64],
        sum: &mut [f64],
    ) -> f64 {
        let (bands, mut factor) = (sum.len(), 0.0);
        let asked = self.tree.cut(x.0, 0.0, x.1, budget as usize);
        self.at_point(x, &asked, budget, Draw { net: set, part: 0 }, blockers, |lamp, look, times| {
            let value = times * look.seen();
            factor += value;
            let means = &means[lamp as usize * bands..];
            sum.iter_mut().zip(means).for_each(|(sum, mean)| *sum += value * mean);
        });
        factor
    }
}

impl Lamp {
    /// The lamp that shines through the given cells of one side of a face. Where they do not cover the face, as where
    /// the exitance varies, it is the face all the same, and the dark cells are part of it.
    fn new(geometry: &Geometry<'_>, cells: &Cells, params: &Params, strong: &[u32]) -> Option<Self> {
        let first = cells.patch(*strong.first()? as usize);
        let surface = cells.surface(strong[0] as usize);
        let patch = geometry.surfaces[surface as usize].patch(first.normal());
        let element = ALL[0].element(patch.shape())?;
        let panel = Panel::new(patch, element, [0, 1, 2, 3], surface);
        // The cells of a face follow each other, those of one side too.
        let (mut start, mut end) = (strong[0] as usize, strong[strong.len() - 1] as usize + 1);
        let belongs =
            |cell: usize| cells.surface(cell) == surface && cells.patch(cell).normal().dot(patch.normal()) > 0.0;
        while start > 0 && belongs(start - 1) {
            start -= 1;
        }
        while end < cells.len() && belongs(end) {
            end += 1;
        }
        let area: f64 = (start..end).map(|cell| cells.patch(cell).area()).sum();
        let weights = |cell: usize| {
            let patch = cells.patch(cell);
            let mass = mean_mass(cells.element(cell), Some(&patch));
            (cell as u32, mass.map(|row| row.iter().sum::<f64>() * patch.area() / area))
        };
        let power: f64 = strong.iter().map(|&c| params.strengths[c as usize] * cells.patch(c as usize).area()).sum();
        Some(Self { panel, strength: power / area, cells: (start..end).map(weights).collect() })
    }

    fn bulb(&self) -> Bulb {
        let Panel { center, radius, .. } = self.panel;
        Bulb { center, radius, power: self.strength * self.panel.area() }
    }

    /// An upper estimate of what a point can get, for sharing out rays.
    fn most(&self, x: DVec3, n: DVec3) -> f64 {
        let Panel { center, radius, .. } = self.panel;
        let to = center - x;
        let distance2 = to.length_squared();
        let reach = 1.0 / distance2.sqrt().max(radius);
        let (at_x, at_y) = ((n.dot(to) + radius) * reach, (-self.panel.normal().dot(to)) * reach);
        if at_x <= 0.0 || at_y <= 0.0 {
            return 0.0;
        }
        let area = self.panel.area();
        self.strength * FRAC_1_PI * area * at_x.min(1.0) * at_y.clamp(0.05, 1.0) / distance2.max(area)
    }
}

/// What is left to chance at a point.
#[derive(Debug, Clone, Copy)]
struct Draw {
    /// The net of places on a lamp, and the part of it that is the point's own. Numbers of places wrap; that cells far from
    /// each other then have the same does no harm.
    net: u64,
    part: u32,
}

impl Draw {
    /// A number between 0 and 1 that is spread evenly over parts that follow each other.
    fn shift(self, what: u64, step: f64) -> f64 {
        (unit(hash(self.net, what)) + f64::from(self.part) * step).fract()
    }
}

/// Steps of a sequence that fills the unit square evenly (M. Roberts, "The unreasonable effectiveness of quasirandom
/// sequences", 2018): powers of the inverse of the root of x³ = x + 1.
const SHIFTS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];

/// Shares laid end to end under a comb with teeth at whole numbers.
struct Comb {
    /// Where the next share begins.
    place: f64,
}

impl Comb {
    /// Whether a tooth meets the next share: with a chance like its length, at most 1, if the first begins anywhere.
    fn meets(&mut self, share: f64) -> bool {
        let before = self.place;
        self.place += share;
        self.place.floor() - before.floor() >= 1.0
    }
}

/// The points of a cell that its rays start from.
struct Net<'a> {
    points: &'a Weighted,
    doubts: &'a [[f64; MAX_DOFS]],
    cell: &'a Patch,
    surface: u32,
    /// The place of the cell among all along a curve through space.
    block: u32,
}

impl Net<'_> {
    fn from(&self, q: usize) -> (DVec3, DVec3, u32) {
        (self.cell.point(self.points.points[q]), self.cell.normal(), self.surface)
    }

    /// The part of a lamp's net of places that a point takes.
    fn part(&self, q: usize) -> u32 {
        self.block.wrapping_mul(self.points.points.len() as u32).wrapping_add(q as u32)
    }
}

/// How a point sees a lamp.
#[derive(Default)]
struct Look {
    /// ∫G over the lamp.
    whole: f64,
    /// The same as its rays have it, and ∫G V.
    sought: f64,
    met: f64,
    /// Rays that were cast.
    cast: u32,
}

impl Look {
    /// The share of it that is visible, if it is not behind the point's horizon.
    fn share(&self) -> Option<f64> {
        (self.sought > 0.0).then(|| self.met / self.sought)
    }

    /// ∫G V over the lamp.
    fn seen(&self) -> f64 {
        self.whole * self.share().unwrap_or(0.0)
    }
}

/// How the points of a cell see a lamp.
struct View {
    lamp: u32,
    values: [f64; MAX_DOFS],
    doubts: [f64; MAX_DOFS],
    /// The least and the greatest visible share.
    least: f64,
    most: f64,
    /// Σ ∫G of the points that asked it.
    whole: f64,
    /// Whether each point that asked it stood for no other lamp, and for no other point.
    for_itself: bool,
}

impl View {
    fn new(lamp: u32) -> Self {
        Self {
            lamp,
            values: [0.0; MAX_DOFS],
            doubts: [0.0; MAX_DOFS],
            least: 1.0,
            most: 0.0,
            whole: 0.0,
            for_itself: true,
        }
    }

    fn add(&mut self, look: &Look, times: f64, weights: &[f64]) {
        self.note(look);
        self.whole += look.whole;
        self.for_itself &= (times - 1.0).abs() < 1e-12;
        self.values.iter_mut().zip(weights).for_each(|(value, weight)| *value += weight * times * look.seen());
    }

    fn note(&mut self, look: &Look) {
        if let Some(share) = look.share() {
            (self.least, self.most) = (self.least.min(share), self.most.max(share));
        }
    }

    /// Whether the border of a shadow is seen to pass.
    fn is_mixed(&self) -> bool {
        self.least < 1.0 && self.most > 0.0
    }

    /// Whether a look says otherwise than points that see the lamp whole, or not at all.
    fn contradicts(&self, look: &Look) -> bool {
        look.share().is_some_and(|share| (share > 0.0) != (self.most > 0.0))
    }

    fn entry(&self) -> Entry {
        let [values, doubts] = [self.values, self.doubts].map(|all| all.map(|value| value as f32));
        Entry { lamp: self.lamp, values, doubts }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each lamp is asked as often as it should be, to a few times in thousands of points, and each point asks as many as it should.
    #[test]
    fn combs_ask_evenly_in_lamps_and_in_points() {
        let shares: Vec<f64> = (0..300).map(|k| [0.02, 0.3, 0.1, 1.0, 0.6][k % 5]).collect();
        let (total, points) = (shares.iter().sum::<f64>(), 4096_u32);
        let mut times = vec![0_u32; shares.len()];
        for part in 0..points {
            let mut comb = Comb { place: Draw { net: 7, part }.shift(0, SHIFTS[0]) };
            let asked: Vec<bool> = shares.iter().map(|&share| comb.meets(share)).collect();
            let count = asked.iter().filter(|&&asked| asked).count() as f64;
            assert!((count - total).abs() <= 1.0, "{count} of {total}");
            times.iter_mut().zip(asked).for_each(|(times, asked)| *times += u32::from(asked));
        }
        for (share, times) in shares.iter().zip(times) {
            assert!((share * f64::from(points) - f64::from(times)).abs() < 8.0, "{share}: {times} of {points}");
        }
    }
}

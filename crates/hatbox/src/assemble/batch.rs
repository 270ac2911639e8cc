//! Clear pairs eight at a time: one panel against eight of the same element, coordinate by coordinate.
//!
//! Most pairs of a scene are far from each other and see each other fully. What such a pair costs is not its few kernel
//! evaluations but everything around them: looking the panels up, deciding on a rule, calling a function. Here
//! [`LANES`] panels lie side by side in memory, and every step (do they face each other, which rule is accurate enough,
//! the kernel at the nodes) is one instruction for all. The eight take the rule that the most demanding of them needs.
//! Pairs that are clipped at a horizon, or too near for the Gauss rules, are handed back.
//!
//! Between constants two rules come before the Gauss rules: G between the centroids, and the same with the second
//! derivatives of G along each panel, times its second moments (`corrected`). That is exact to the third degree on
//! parallelograms as 2 × 2 Gauss points on both sides are, which are 16 values of G, at the price of three.
//!
//! Kernels hold no iterators and no closures, which are compiled for the lesser processor and not inlined.
//!
//! What every pair asks of its panels, whatever rule it takes, lies apart from the rest and side by side ([`Head`],
//! [`Front`]): a [`Panel`] and the nodes of a chunk take kilobytes, and waiting for those takes longer
//! than most pairs.
//!
//! Four kernel values share one division, which is what the processor is slowest at: a/p + b/q is (aq + bp)/(pq).
//! And the panels are flat, so that of G = cosθ_a r · cosθ_b r / (π r⁴) only r depends on both points.

#![expect(clippy::inline_always, reason = "kernels must be inlined into functions compiled for their instruction set")]
#![expect(
    clippy::needless_range_loop,
    reason = "several arrays run in step, and iterators are not inlined into kernels"
)]

mod sides;

use super::Accuracy;
use super::pair::{FLAT, a_priori_error_factors};
use super::panel::{LADDER, Panel};
use crate::element::MAX_DOFS;
use glam::DVec3;
pub use sides::LANES;
use sides::{Chunk, Front, Head, Lanes, Node};
use std::f64::consts::{FRAC_1_PI, PI};

/// Chunks that a row looks at before the next row's turn.
const TOGETHER: usize = 8;

/// The most nodes that a rule of the ladder has, on a triangle or a quad.
const MAX_NODES: usize = 25;

/// What a chunk says about a panel, by lanes.
#[derive(Debug, Clone)]
pub struct Found {
    /// The entries of each block, row by row.
    pub values: [Lanes; MAX_DOFS * MAX_DOFS],
    /// Bound of the quadrature error of each block, as an error of ∬G in m².
    pub errors: Lanes,
    /// Bit k: lane k's block is in `values`.
    pub done: u32,
    /// Bit k: lane k's pair is clipped or too near and has to be integrated on its own.
    pub rest: u32,
}

impl Default for Found {
    fn default() -> Self {
        Self { values: [[0.0; LANES]; MAX_DOFS * MAX_DOFS], errors: [0.0; LANES], done: 0, rest: 0 }
    }
}

/// Panels side by side.
#[derive(Debug, Clone)]
pub struct Batch<'a> {
    panels: &'a [&'a Panel],
    heads: Vec<Head>,
    fronts: Vec<Front>,
    chunks: Vec<Chunk>,
    /// The chunk of each panel.
    chunk_of: Vec<u32>,
}

impl<'a> Batch<'a> {
    /// Of panels in the order in which they will be asked for.
    pub fn new(panels: &'a [&'a Panel]) -> Self {
        let heads: Vec<Head> = panels.iter().map(|panel| Head::of(panel)).collect();
        let (mut fronts, mut chunks): (Vec<Front>, Vec<Chunk>) = (Vec::new(), Vec::new());
        let mut chunk_of = Vec::with_capacity(panels.len());
        for (index, panel) in panels.iter().enumerate() {
            let fits = |chunk: &Chunk| chunk.len < LANES && std::ptr::eq(chunk.element, panel.element);
            if !chunks.last().is_some_and(fits) {
                fronts.push(Front::EMPTY);
                chunks.push(Chunk::new(panel, index));
            }
            let last = chunks.len() - 1;
            fronts[last].set(chunks[last].len, &heads[index]);
            chunks[last].push(panel);
            chunk_of.push(last as u32);
        }
        Self { panels, heads, fronts, chunks, chunk_of }
    }

    /// Calls `take(a, first, found)` with the blocks S_ab of each panel a of `rows` and the panels b of `range`, chunk by
    /// chunk: lane l is panel `first` + l. Panels that face away are in neither of its masks.
    ///
    /// A few chunks stay in the processor's nearest memory while all of the rows look at them, so a few dozen rows at a
    /// time are several times as fast as one; and what is found for a row is a run of memory.
    pub fn blocks(
        &self,
        rows: std::ops::Range<usize>,
        range: std::ops::Range<usize>,
        accuracy: &Accuracy,
        mut take: impl FnMut(usize, usize, &Found),
    ) {
        let mut found = Found::default();
        let Some(last) = range.end.checked_sub(1).filter(|&last| last >= range.start) else { return };
        let [mut at, end] = [range.start, last].map(|panel| self.chunk_of[panel] as usize);
        while at <= end {
            let together = at..(at + TOGETHER).min(end + 1);
            for a in rows.clone() {
                for index in together.clone() {
                    let chunk = &self.chunks[index];
                    let [from, to] = [range.start, range.end].map(|panel| panel.saturating_sub(chunk.first).min(LANES));
                    let wanted = (1_u32 << to.min(chunk.len)) - (1 << from);
                    evaluate(&self.one(a), &self.eight(index), wanted, accuracy, &mut found);
                    if found.done | found.rest != 0 {
                        take(a, chunk.first, &found);
                    }
                }
            }
            at = together.end;
        }
    }

    fn one(&self, panel: usize) -> One<'_> {
        One { head: &self.heads[panel], panel: self.panels[panel] }
    }

    fn eight(&self, index: usize) -> Eight<'_> {
        Eight { front: &self.fronts[index], chunk: &self.chunks[index] }
    }

    /// The same for one panel and those of the panels from `start` on whose bit is set.
    pub fn masked(&self, a: usize, start: usize, mask: u64, accuracy: &Accuracy, mut take: impl FnMut(usize, &Found)) {
        let mut found = Found::default();
        let mut left = mask;
        while left != 0 {
            let at = start + left.trailing_zeros() as usize;
            let index = self.chunk_of[at] as usize;
            let chunk = &self.chunks[index];
            // The chunk's panels may begin before `start`.
            let all = if chunk.first >= start { left >> (chunk.first - start) } else { left << (start - chunk.first) };
            let wanted = (all & ((1 << chunk.len) - 1)) as u32;
            evaluate(&self.one(a), &self.eight(index), wanted, accuracy, &mut found);
            if found.done | found.rest != 0 {
                take(chunk.first, &found);
            }
            let next = chunk.first + chunk.len - start;
            left = if next < 64 { left >> next << next } else { 0 };
        }
    }
}

/// A panel.
struct One<'a> {
    head: &'a Head,
    panel: &'a Panel,
}

/// A chunk.
struct Eight<'a> {
    front: &'a Front,
    chunk: &'a Chunk,
}

/// Fills `found` with the blocks of a panel and the lanes of a chunk that are `wanted`.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn evaluate(one: &One<'_>, eight: &Eight<'_>, wanted: u32, accuracy: &Accuracy, found: &mut Found) {
    let (head, front) = (one.head, eight.front);
    let place = Place::new(head, front);
    let whole = place.surely_whole & wanted;
    (found.done, found.rest) = (whole, 0);
    if whole != wanted {
        let (facing, whole) = facing(one, eight);
        (found.done, found.rest) = (facing & whole & wanted, facing & !whole & wanted);
    }
    if found.done == 0 {
        return;
    }
    let demand = Demand::new(head, front, &place, accuracy);
    let constant = head.constant && front.constant;
    if constant && by_midpoints(head, front, &place, &demand, found) {
        return;
    }
    let Some((rung, accurate)) = choose(one.panel, eight.chunk, &demand, found.done, &mut found.errors) else {
        found.rest |= found.done;
        found.done = 0;
        return;
    };
    found.rest |= found.done & !accurate;
    found.done &= accurate;
    if constant {
        found.values[0] = constants(one, eight, rung);
    } else {
        functions(one, eight, rung, &mut found.values);
    }
}

/// The a-priori error of G between centroids, as (C, e) of C (η/2)^e relative to A_a A_b/(π d²), and with second derivatives:
/// on panels of any shape, and on parallelograms, whose third moments vanish. About twice the largest ratio met among random
/// panels with η up to 1; a test tries others.
const MIDPOINT: (f64, usize) = (2.0, 2);
const CORRECTED: [(f64, usize); 2] = [(2.0, 3), (6.0, 4)];

/// ∬G from the centroids, if that is accurate enough for all lanes that are to be done.
#[inline(always)]
fn by_midpoints(a: &Head, front: &Front, place: &Place, demand: &Demand, found: &mut Found) -> bool {
    let (bound, exponent) = MIDPOINT;
    if demand.met(bound, exponent, &mut found.errors) & found.done == found.done {
        found.values[0] = midpoint(a, front, place);
        return true;
    }
    let (bound, exponent) = CORRECTED[usize::from(front.symmetric && a.symmetric)];
    if demand.met(bound, exponent, &mut found.errors) & found.done == found.done {
        found.values[0] = corrected(a, front, place);
        return true;
    }
    false
}

/// A_a A_b G between the centroids.
#[inline(always)]
fn midpoint(a: &Head, front: &Front, place: &Place) -> Lanes {
    let mut values = [0.0; LANES];
    let area = FRAC_1_PI * a.area;
    for lane in 0..LANES {
        let inverse = place.inverse_d2[lane];
        values[lane] = area * front.area[lane] * (place.at_a[lane] * place.at_b[lane]) * (inverse * inverse);
    }
    values
}

/// The same with ½ Σ_k ∂²G along m_k of either panel: with d = y − x, r = |d|, s_a = n_a·d, s_b = −n_b·d and G = s_a s_b/(π r⁴)
///
///   A_a A_b/(π r⁴) {s_a s_b + [4 s_a Σ (n_b·m)(d·m) − 4 s_b Σ (n_a·m')(d·m') + s_a s_b (12 Σ (d·m)²/r² − 2 Σ m²)]/r²},
///
/// m being those of a, m' those of b, and sums without a name over both.
#[inline(always)]
fn corrected(a: &Head, front: &Front, place: &Place) -> Lanes {
    let (n, own) = (a.normal, a.spread);
    let own_square = own[0].length_squared() + own[1].length_squared();
    let mut values = [0.0; LANES];
    for lane in 0..LANES {
        let d = front.center.at(lane) - a.center;
        let m = front.normal.at(lane);
        let others = [front.spread[0].at(lane), front.spread[1].at(lane)];
        let (p0, p1) = (d.dot(own[0]), d.dot(own[1]));
        let (q0, q1) = (d.dot(others[0]), d.dot(others[1]));
        let squares = own_square + others[0].length_squared() + others[1].length_squared();
        let inverse = place.inverse_d2[lane];
        let (at_a, at_b) = (place.at_a[lane], place.at_b[lane]);
        let product = at_a * at_b;
        let along_a = at_a * (m.dot(own[0]) * p0 + m.dot(own[1]) * p1);
        let along_b = at_b * (n.dot(others[0]) * q0 + n.dot(others[1]) * q1);
        let radial = 12.0 * inverse * (p0 * p0 + p1 * p1 + q0 * q0 + q1 * q1) - 2.0 * squares;
        let second = 4.0 * (along_a - along_b) + product * radial;
        let scale = FRAC_1_PI * a.area * front.area[lane] * inverse * inverse;
        values[lane] = scale * (product + inverse * second);
    }
    values
}

/// w_q cosθ_a r at the nodes of a chunk: the panel is flat, so it is the same from all of its points.
#[inline(always)]
fn weighted_heights(a: &Panel, nodes: &[Node], out: &mut [Lanes; MAX_NODES]) {
    let (origin, n) = (a.patch.corners()[0], a.normal());
    for q in 0..nodes.len() {
        let node = &nodes[q];
        for lane in 0..LANES {
            out[q][lane] = node.weight[lane] * greater((node.at.at(lane) - origin).dot(n), 0.0);
        }
    }
}

/// cosθ_b r at a point: the panels of the chunk are flat, so it is the same for all of their nodes.
#[inline(always)]
fn height_above(eight: &Eight<'_>, x: DVec3, lane: usize) -> f64 {
    greater((x - eight.chunk.corners[0].at(lane)).dot(eight.front.normal.at(lane)), 0.0)
}

/// r⁴ between a point and a node.
#[inline(always)]
fn fourth_power(x: DVec3, node: &Node, lane: usize) -> f64 {
    let r2 = (node.at.at(lane) - x).length_squared();
    r2 * r2
}

/// ∬G by the rung's rules on both sides.
#[inline(always)]
fn constants(one: &One<'_>, eight: &Eight<'_>, rung: usize) -> Lanes {
    let (a, chunk) = (one.panel, eight.chunk);
    let (points, nodes) = (&a.ladder[rung], &chunk.nodes[rung][..]);
    let mut weights = [[0.0; LANES]; MAX_NODES];
    weighted_heights(a, nodes, &mut weights);
    let (fours, single) = nodes.as_chunks::<4>();
    let (weights, weights_single) = weights[..nodes.len()].as_chunks::<4>();
    let mut total = [0.0; LANES];
    for p in 0..points.len() {
        let x = points.at(p);
        let mut sum = [0.0; LANES];
        for k in 0..fours.len() {
            let (four, w) = (&fours[k], &weights[k]);
            for lane in 0..LANES {
                let (p, q) = (fourth_power(x, &four[0], lane), fourth_power(x, &four[1], lane));
                let (r, s) = (fourth_power(x, &four[2], lane), fourth_power(x, &four[3], lane));
                let (pq, rs) = (p * q, r * s);
                let first = w[0][lane] * q + w[1][lane] * p;
                let second = w[2][lane] * s + w[3][lane] * r;
                sum[lane] += (first * rs + second * pq) / (pq * rs);
            }
        }
        for k in 0..single.len() {
            let (node, w) = (&single[k], &weights_single[k]);
            for lane in 0..LANES {
                sum[lane] += w[lane] / fourth_power(x, node, lane);
            }
        }
        for lane in 0..LANES {
            total[lane] += points.weight[p] * height_above(eight, x, lane) * sum[lane];
        }
    }
    total
}

/// ∬N_k N_l G by the rung's rules on both sides.
#[inline(always)]
fn functions(one: &One<'_>, eight: &Eight<'_>, rung: usize, values: &mut [Lanes; MAX_DOFS * MAX_DOFS]) {
    let (a, chunk) = (one.panel, eight.chunk);
    let (points, nodes) = (&a.ladder[rung], &chunk.nodes[rung][..]);
    let (on_a, on_b) = (a.tabulated(rung), chunk.tables[rung]);
    let (rows, columns) = (a.element.dofs(), chunk.element.dofs());
    values[..rows * columns].fill([0.0; LANES]);
    let mut weights = [[0.0; LANES]; MAX_NODES];
    weighted_heights(a, nodes, &mut weights);
    for p in 0..points.len() {
        let x = points.at(p);
        let mut row = [[0.0; LANES]; MAX_DOFS];
        let mut g = [0.0; LANES];
        for q in 0..nodes.len() {
            for lane in 0..LANES {
                g[lane] = weights[q][lane] / fourth_power(x, &nodes[q], lane);
            }
            for l in 0..columns {
                for lane in 0..LANES {
                    row[l][lane] += on_b[q][l] * g[lane];
                }
            }
        }
        for lane in 0..LANES {
            g[lane] = points.weight[p] * height_above(eight, x, lane);
        }
        for k in 0..rows {
            for l in 0..columns {
                for lane in 0..LANES {
                    values[k * columns + l][lane] += on_a[p][k] * g[lane] * row[l][lane];
                }
            }
        }
    }
}

/// The greater of two numbers, as one instruction: neither is NaN.
#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// How the lanes of a chunk lie towards a panel.
struct Place {
    /// cosθ_a d and cosθ_b d, d being the distance of the centres.
    at_a: Lanes,
    at_b: Lanes,
    inverse_d2: Lanes,
    /// Lanes where the bounding spheres already prove that both lie wholly in front of each other.
    surely_whole: u32,
}

impl Place {
    #[inline(always)]
    fn new(a: &Head, front: &Front) -> Self {
        let (n, zero) = (a.normal, [0.0; LANES]);
        let mut place = Self { at_a: zero, at_b: zero, inverse_d2: zero, surely_whole: 0 };
        let mut margin = zero;
        for lane in 0..LANES {
            let d = front.center.at(lane) - a.center;
            place.at_a[lane] = d.dot(n);
            place.at_b[lane] = -d.dot(front.normal.at(lane));
            place.inverse_d2[lane] = 1.0 / d.dot(d);
            margin[lane] = -greater(front.radius[lane] - place.at_a[lane], a.radius - place.at_b[lane]);
        }
        for lane in 0..LANES {
            place.surely_whole |= u32::from(margin[lane] >= 0.0) << lane;
        }
        place
    }
}

/// Masks of the lanes that face the panel at all, and of those where both lie wholly in front of each other.
#[inline(always)]
fn facing(one: &One<'_>, eight: &Eight<'_>) -> (u32, u32) {
    let (a, chunk) = (one.panel, eight.chunk);
    let (corners, normal) = (a.patch.corners(), a.normal());
    let longest = a.longest_edge;
    let (mut lo, mut hi) = ([f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
    let (mut above, mut below) = ([f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
    for corner in &chunk.corners {
        for lane in 0..LANES {
            let height = normal.dot(corner.at(lane) - corners[0]);
            lo[lane] = -greater(-lo[lane], -height);
            hi[lane] = greater(hi[lane], height);
        }
    }
    for &corner in corners {
        for lane in 0..LANES {
            let height = eight.front.normal.at(lane).dot(corner - chunk.corners[0].at(lane));
            above[lane] = -greater(-above[lane], -height);
            below[lane] = greater(below[lane], height);
        }
    }
    let (mut facing, mut whole) = (0, 0);
    for lane in 0..LANES {
        let flat = FLAT * (longest + chunk.longest_edge[lane]);
        facing |= u32::from(below[lane] > flat && hi[lane] > flat) << lane;
        whole |= u32::from(above[lane] >= -flat && lo[lane] >= -flat) << lane;
    }
    (facing, whole)
}

/// What the lanes of a chunk demand of a rule.
struct Demand {
    /// Half of the ratio η of the sizes to the distance.
    half_eta: Lanes,
    /// The error that is small enough, relative to `scale`.
    needed: Lanes,
    /// A_a A_b/(π d²).
    scale: Lanes,
}

impl Demand {
    #[inline(always)]
    fn new(a: &Head, front: &Front, place: &Place, accuracy: &Accuracy) -> Self {
        let mut demand = Self { half_eta: [0.0; LANES], needed: [0.0; LANES], scale: [0.0; LANES] };
        let mean = PI / accuracy.total_area;
        for lane in 0..LANES {
            let inverse = place.inverse_d2[lane];
            demand.half_eta[lane] = 0.5 * (a.radius + front.radius[lane]) * inverse.sqrt();
            let cosines = place.at_a[lane] * place.at_b[lane];
            demand.needed[lane] = accuracy.tolerance * greater(cosines * inverse, mean / inverse);
            demand.scale[lane] = a.area * FRAC_1_PI * front.area[lane] * inverse;
        }
        demand
    }

    /// The lanes for which C (η/2)^e is small enough, for η up to 1; the errors.
    #[inline(always)]
    fn met(&self, bound: f64, exponent: usize, errors: &mut Lanes) -> u32 {
        let mut error = [bound; LANES];
        for _ in 0..exponent {
            for lane in 0..LANES {
                error[lane] *= self.half_eta[lane];
            }
        }
        let mut excess = [0.0; LANES];
        for lane in 0..LANES {
            excess[lane] = greater(error[lane] - self.needed[lane], self.half_eta[lane] - 0.5);
            errors[lane] = error[lane] * self.scale[lane];
        }
        let mut accurate = 0;
        for lane in 0..LANES {
            accurate |= u32::from(excess[lane] <= 0.0) << lane;
        }
        accurate
    }
}

/// The rung that is accurate enough for those of the lanes `among` for which any is; their mask, and the errors.
#[inline(always)]
fn choose(a: &Panel, chunk: &Chunk, demand: &Demand, among: u32, errors: &mut Lanes) -> Option<(usize, u32)> {
    let degree = a.functions_degree().max(chunk.degree);
    let mut best = None;
    for rung in 0..LADDER.len() {
        let exact = a.exactness[rung].min(chunk.exactness[rung]);
        let Some((bound, exponent)) = a_priori_error_factors(exact, degree) else { continue };
        let accurate = demand.met(bound, exponent, errors) & among;
        if accurate != 0 {
            best = Some((rung, accurate));
        }
        if accurate == among {
            break;
        }
    }
    best
}

#[cfg(test)]
mod tests;

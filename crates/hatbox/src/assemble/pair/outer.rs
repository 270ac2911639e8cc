//! The outer integral, over the panel that receives: rules on parts that are cut where it pays.
//!
//! What a point receives from a source is analytic, unless something stands between: then it has creases, lines along
//! which it or one of its derivatives jumps ([`super::creases`]). A part of the receiver that a crease crosses is cut along
//! the crease; a part that none crosses is quartered, and there the error falls with the order of the rule. Quartering alone
//! was tried first: the error of n parts falls like 1/n where a straight edge throws a straight shadow, and an aperture in
//! a screen was still 1.2e-6 off after 1024 parts.

use super::region::{Polygon, clip};
use super::{Block, Region};
use crate::assemble::Panel;
use crate::element::{MAX_DOFS, Shape};
use crate::quadrature::rule;
use glam::DVec3;

/// Subdivisions of the outer panel at the most: what is left then is 4^-12 of its area.
const MAX_DEPTH: usize = 12;
/// Quads are parallelograms if their diagonals' middles are closer than this fraction of the panel's size.
const PARALLEL: f64 = 1e-12;
/// Parts smaller than this fraction of the panel are rounding.
const NO_AREA: f64 = 1e-15;
/// A crease this close to the border of a part, relative to the panel's size, does not cross it.
const BORDER: f64 = 1e-9;

/// So few points know the error of a part with a shadow's edge in it to about this factor.
const DOUBT: f64 = 2.0;

/// A segment in the plane of the receiver along which what it receives is not smooth.
pub(super) type Crease = [DVec3; 2];

/// The outer integral, over the panel that receives.
pub(super) struct Outer<'a> {
    pub(super) panel: &'a Panel,
    pub(super) source: &'a Panel,
    /// What a point receives from each function of the source.
    pub(super) at: &'a dyn Fn(DVec3) -> [f64; MAX_DOFS],
    /// Degrees of the rules: each is checked by the one before, and the first that agrees is taken.
    pub(super) degrees: &'a [usize],
    /// What is known of the shadows on the receiver, if there are any.
    pub(super) shadows: Option<Shadows<'a>>,
    /// Parts of the receiver at the most.
    pub(super) most: usize,
}

/// How parts of the receiver with a shadow's edge in them are treated.
#[derive(Clone, Copy)]
pub(super) struct Shadows<'a> {
    /// All creases; asked for when the first part is not accurate enough.
    pub(super) creases: &'a dyn Fn() -> &'a [Crease],
    /// How much of the difference from the mean of the corners counts as an error, for functions that may be zero at all
    /// nodes of a rule and yet not zero.
    pub(super) guard: f64,
}

/// A part of the outer panel with its integral and the error of that.
struct Piece {
    cut: Cut,
    depth: usize,
    block: Block,
    /// A crease that crosses it, if any was looked for.
    crease: Option<Crease>,
}

impl Outer<'_> {
    /// Splits the parts with the largest errors until the sum of the errors is within the budget.
    pub(super) fn integrate(&self, region: &Region, budget: &dyn Fn(f64) -> f64) -> Block {
        let least = budget(0.0) / self.panel.area().max(f64::MIN_POSITIVE);
        let share = |cut: &Cut| 0.5 * least * cut.area();
        let mut pieces: Vec<Piece> =
            Cut::of(self.panel, region).into_iter().map(|cut| self.piece(cut, 0, share(&cut))).collect();
        loop {
            let mut total = Block::zeros(self.panel, self.source);
            for piece in &pieces {
                total.accumulate(&piece.block);
            }
            let budget = budget(total.sum());
            if total.quadrature_error <= budget || pieces.len() >= self.most {
                return total;
            }
            // Every piece with more than its share of the budget is split in this round.
            let limit = budget / (2.0 * pieces.len() as f64);
            let (split, mut kept): (Vec<_>, Vec<_>) =
                pieces.into_iter().partition(|p| p.block.quadrature_error > limit && p.depth < MAX_DEPTH);
            if split.is_empty() {
                return total;
            }
            for piece in split {
                let (cuts, depth) = self.split(&piece);
                kept.extend(cuts.into_iter().map(|cut| self.piece(cut, depth, share(&cut))));
            }
            pieces = kept;
        }
    }

    /// The parts of a part, and their depth: those on either side of its crease, else its quarters. A crease that cuts off
    /// nothing but rounding would be met again for ever.
    fn split(&self, piece: &Piece) -> (Vec<Cut>, usize) {
        if let Some(crease) = piece.crease {
            let least = NO_AREA * self.panel.area();
            let size = PARALLEL * self.panel.radius;
            let mut cuts = piece.cut.along(crease, self.panel.normal(), size);
            cuts.retain(|cut| cut.area() > least);
            if cuts.len() > 1 {
                return (cuts, piece.depth);
            }
        }
        (piece.cut.quarters().into(), piece.depth + 1)
    }

    fn piece(&self, cut: Cut, depth: usize, budget: f64) -> Piece {
        let first = self.rule(&cut, self.degrees[0]);
        let Some(shadows) = &self.shadows else {
            return Piece { cut, depth, block: self.smooth(&cut, &first, budget), crease: None };
        };
        // Rules of few points agree with the corners and with the middle, too, where there is nothing to be found. Both are
        // asked: the corners and a rule of four points agree about any step between the points.
        let corners = self.near_corners(&cut);
        let check = DOUBT * first.distance(&corners).max(first.distance(&self.rule(&cut, 0)));
        let first = Block { quadrature_error: check, ..first };
        if check <= budget {
            return Piece { cut, depth, block: first, crease: None };
        }
        let crease = self.crossing(&cut, (shadows.creases)());
        let block = match crease {
            None => self.smooth(&cut, &first, budget),
            Some(_) if shadows.guard * check > budget => first,
            Some(_) => {
                let better = self.rule(&cut, self.degrees[1]);
                let error = better.distance(&first) + shadows.guard * better.distance(&corners);
                Block { quadrature_error: error, ..better }
            }
        };
        Piece { cut, depth, block, crease }
    }

    /// The first of the rules after the `first` that agrees with the one before to within the budget, or the last.
    fn smooth(&self, cut: &Cut, first: &Block, budget: f64) -> Block {
        let mut block = Block { quadrature_error: f64::INFINITY, ..*first };
        for &degree in &self.degrees[1..] {
            if block.quadrature_error <= budget {
                break;
            }
            let better = self.rule(cut, degree);
            block = Block { quadrature_error: better.distance(&block), ..better };
        }
        block
    }

    /// Of the creases that cross a part the one that cuts it most evenly.
    fn crossing(&self, cut: &Cut, creases: &[Crease]) -> Option<Crease> {
        let (corners, border) = (cut.corners(), BORDER * self.panel.radius);
        let evenness = |crease: &Crease| evenness(&corners, *crease, self.panel.normal(), border);
        let even = creases.iter().filter_map(|crease| Some((evenness(crease)?, *crease)));
        even.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, crease)| crease)
    }

    fn rule(&self, cut: &Cut, degree: usize) -> Block {
        let rule = rule(cut.shape, degree);
        self.nodes(cut, &rule.points, &rule.weights)
    }

    /// The mean of points at the corners, but not on the edges, where a blocker may stand that hides nothing from them.
    fn near_corners(&self, cut: &Cut) -> Block {
        const IN: f64 = 0.005;
        const OUT: f64 = 1.0 - IN;
        match cut.shape {
            Shape::Triangle => self.nodes(cut, &[[IN, IN], [OUT - IN, IN], [IN, OUT - IN]], &[1.0 / 3.0; 3]),
            Shape::Quad => self.nodes(cut, &[[IN, IN], [OUT, IN], [OUT, OUT], [IN, OUT]], &[0.25; 4]),
        }
    }

    /// Σ_p w_p N(x_p) (inner at x_p)ᵀ.
    fn nodes(&self, cut: &Cut, points: &[[f64; 2]], weights: &[f64]) -> Block {
        let mut block = Block::zeros(self.panel, self.source);
        let area = cut.area();
        for (&[u, v], weight) in points.iter().zip(weights) {
            let x = cut.origin + cut.u * u + cut.v * v;
            block.add(weight * area, &self.panel.values(x), &(self.at)(x));
        }
        block
    }
}

/// About the area of the smaller of the two parts that a crease cuts a convex polygon into; `None` if it does not cross it.
fn evenness(corners: &Polygon, [from, to]: Crease, normal: DVec3, border: f64) -> Option<f64> {
    let along = (to - from).try_normalize()?;
    let side = normal.cross(along);
    let place = |p: DVec3| (side.dot(p - from), along.dot(p - from));
    let (mut above, mut below) = (0.0_f64, 0.0_f64);
    let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut h, mut s) = place(*corners.last()?);
    for &corner in corners {
        let (next_h, next_s) = place(corner);
        (above, below) = (above.max(next_h), below.max(-next_h));
        if (h > 0.0) != (next_h > 0.0) {
            let at = s + (next_s - s) * (h / (h - next_h));
            (first, last) = (first.min(at), last.max(at));
        }
        (h, s) = (next_h, next_s);
    }
    let length = last.min(from.distance(to)) - first.max(0.0);
    (above > border && below > border && length > border).then(|| above.min(below) * (last - first))
}

/// A triangle or a parallelogram of the outer panel: origin + ξ u + η v for ξ, η of the reference cell.
#[derive(Debug, Clone, Copy)]
struct Cut {
    shape: Shape,
    origin: DVec3,
    u: DVec3,
    v: DVec3,
}

impl Cut {
    fn triangle([a, b, c]: [DVec3; 3]) -> Self {
        Self { shape: Shape::Triangle, origin: a, u: b - a, v: c - a }
    }

    /// The whole panel if it is a parallelogram, else the triangles of the region.
    fn of(panel: &Panel, region: &Region) -> Vec<Self> {
        if let (true, &[a, b, _, d]) = (region.whole && panel.patch.is_affine(), region.corners()) {
            return vec![Self { shape: Shape::Quad, origin: a, u: b - a, v: d - a }];
        }
        region.triangles().map(Self::triangle).collect()
    }

    /// A convex polygon, as a parallelogram (to `tolerance`) or in triangles.
    fn polygon(corners: &[DVec3], tolerance: f64) -> Vec<Self> {
        match *corners {
            [a, b, c, d] if (a - b + c - d).length() <= tolerance => {
                vec![Self { shape: Shape::Quad, origin: a, u: b - a, v: d - a }]
            }
            [] => Vec::new(),
            _ => (2..corners.len()).map(|k| Self::triangle([corners[0], corners[k - 1], corners[k]])).collect(),
        }
    }

    fn corners(&self) -> Polygon {
        let Self { shape, origin, u, v } = *self;
        match shape {
            Shape::Triangle => [origin, origin + u, origin + v].into_iter().collect(),
            Shape::Quad => [origin, origin + u, origin + u + v, origin + v].into_iter().collect(),
        }
    }

    fn area(&self) -> f64 {
        self.u.cross(self.v).length() * self.shape.reference_area()
    }

    /// What lies on either side of a line.
    fn along(&self, [from, to]: Crease, normal: DVec3, tolerance: f64) -> Vec<Self> {
        let side = normal.cross(to - from).normalize_or_zero();
        let corners = self.corners();
        let parts = [1.0, -1.0].map(|sign| clip(&corners, |p| sign * side.dot(p - from)));
        parts.iter().flat_map(|part| Self::polygon(part, tolerance)).collect()
    }

    /// The four that the midpoints of the edges make.
    fn quarters(&self) -> [Self; 4] {
        let (u, v) = (0.5 * self.u, 0.5 * self.v);
        let part = |origin: DVec3, sign: f64| Self { origin, u: sign * u, v: sign * v, ..*self };
        let o = self.origin;
        let last = match self.shape {
            Shape::Triangle => part(o + u + v, -1.0),
            Shape::Quad => part(o + u + v, 1.0),
        };
        [part(o, 1.0), part(o + u, 1.0), part(o + v, 1.0), last]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::ALL;
    use crate::mesh::Patch;
    use crate::quadrature::sequence::{hash, point};

    /// Needles that creases have left, far smaller than the panel, and creases that cross them: what is cut off may have no
    /// area that counts. The rest came back with the same crease, round after round.
    #[test]
    fn a_crease_that_cuts_off_no_area_does_not_come_back_for_ever() {
        let constant = ALL[0].element(Shape::Triangle).expect("constants");
        let patch = Patch::new(Shape::Triangle, [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Y]);
        let panel = Panel::new(patch, constant, [0; 4], 0);
        let outer =
            Outer { panel: &panel, source: &panel, at: &|_| [1.0; MAX_DOFS], degrees: &[2], shadows: None, most: 1 };
        let mut without_area = 0;
        for k in 0..20_000 {
            let [p, q] = [0, 1].map(|set| point(hash(set, k), 0));
            let size = |x: f64| 10_f64.powf(-10.0 * x);
            let (u, v) = (DVec3::new(size(p[0]), 0.0, 0.0), DVec3::new(p[1] * size(p[0]), size(p[2]), 0.0));
            let cut = Cut { shape: Shape::Triangle, origin: DVec3::new(0.1, 0.1, 0.0), u, v };
            let crease = [cut.origin + u * q[0].powi(8), cut.origin + v * q[1].powi(8)];
            if evenness(&cut.corners(), crease, DVec3::Z, BORDER * panel.radius).is_none() {
                continue;
            }
            let counts = |part: &Cut| part.area() > NO_AREA * panel.area();
            let sides = cut.along(crease, DVec3::Z, PARALLEL * panel.radius);
            without_area += usize::from(sides.iter().filter(|part| counts(part)).count() < 2);
            let piece = Piece { cut, depth: 3, block: Block::zeros(&panel, &panel), crease: Some(crease) };
            let (parts, depth) = outer.split(&piece);
            assert!(parts.len() > 1 && (depth > 3 || parts.iter().all(counts)), "{cut:?} {crease:?}");
        }
        assert!(without_area > 10, "there are such creases: {without_area}");
    }
}

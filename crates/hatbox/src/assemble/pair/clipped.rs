//! Partially hidden pairs, exactly: the visible part of the source is cut out at every point of the receiver.
//!
//! Seen from a point, a convex polygon hides a cone. What is left of the source is a few convex pieces, each of which is
//! integrated in closed form; only the integral over the receiver is numerical, of a function that is analytic but for
//! creases along the edges of shadows, which the receiver is cut along where it matters ([`super::outer`]). The panel that
//! the blockers are farther from is the receiver: shadows there are softer, and right at a blocker's foot they jump.
//!
//! More than sixteen polygons do not come here, and a source that comes to more than 64 pieces is left to rays.
//!
//! The corners of the receiver are asked as well as the nodes of the rules: next to the corner of a wall, a source may be
//! visible from a corner of the receiver and from no node. Where no point at all sees a blocker although one is there,
//! the error is not zero either, but what one undiscovered point would mean. That keeps the estimate honest about slivers.
//! And no pair in a shadow claims less than the error that it was allowed: of random pairs behind random polygons
//! (`tests/pairs/honesty.rs`) two in a hundred were farther off than a few points had made believe.

use super::creases::Ground;
use super::near::Inner;
use super::outer::{Crease, Outer, Shadows};
use super::region::{POLYGON, Polygon, clip, clip_at, distance};
use super::{Accuracy, Block, Facing, Region, sampled};
use crate::assemble::Panel;
use crate::element::MAX_DOFS;
use crate::mesh::polygon::{self, area_vector};
use glam::DVec3;
use std::cell::{Cell, OnceCell, RefCell};
use std::f64::consts::PI;

/// Degrees of the outer rules; across a crease the higher ones are no better.
const OUTER: [usize; 3] = [2, 5, 8];
/// The part of a rule's difference from the mean of the corners that counts as an error: a rule of seven points resolves
/// about an eighth of a triangle.
const GUARD: f64 = 0.125;
/// Points at the least.
const OUTER_POINTS: f64 = 6.0;
/// A point this close to a side of a cone, relative to their distance, is hidden: walls that meet hide what is behind their
/// edge, whatever rounding says.
const EDGE: f64 = 1e-10;
/// Pieces narrower than this fraction of the source are cracks between blockers, whose corners files round to single
/// precision: a room that is walled up stays dark.
const CRACK: f64 = 1e-7;
/// Pieces of a source at the most; a pair that takes more is sampled with rays.
const MAX_PIECES: usize = 64;
/// Parts of the receiver at the most; what they leave is in the error.
const MAX_PARTS: usize = 1024;
/// Edges of blockers shorter than this, relative to the blocker, are left out: what is left out is no greater then than the
/// error of their direction in f64. One is left where a corner lies on the plane that a blocker is clipped at.
const SHORT: f64 = 1e-8;
/// And those shorter than this times the greatest coordinate.
const ROUNDED: f64 = 64.0 * f64::EPSILON;
/// Blockers closer to a point's line of sight than this, relative to their distance, are seen edge-on.
const EDGE_ON: f64 = 1e-12;

/// The block of two panels with the convex polygons that may stand between.
pub(super) fn block(
    a: &Panel,
    b: &Panel,
    facing: &Facing,
    polygons: &[&[DVec3]],
    weights: [f64; 2],
    accuracy: &Accuracy,
) -> Block {
    // Only what lies in front of both planes can hide one from the other.
    let between = |polygon: &&[DVec3]| {
        let above_a = clip(polygon, |p| a.normal().dot(p - a.patch.corners()[0]));
        let above_both = clip(&above_a, |p| b.normal().dot(p - b.patch.corners()[0]));
        Blocker::new(above_both)
    };
    let blockers: Vec<Blocker> = polygons.iter().filter_map(between).collect();
    let distance =
        |panel: &Panel| blockers.iter().map(|blocker| remoteness(panel, blocker)).fold(f64::INFINITY, f64::min);
    let closed = [a, b].map(|panel| panel.functions.is_some());
    let a_outside = closed[1] && (!closed[0] || distance(a) >= distance(b));
    let [first, second] = [&facing.first, &facing.second];
    let clipped = if a_outside {
        Shadow::new(a, first, b, second, &blockers).block(weights, accuracy)
    } else if closed[0] {
        let reversed = [weights[1], weights[0]];
        Shadow::new(b, second, a, first, &blockers).block(reversed, accuracy).map(|block| block.transposed())
    } else {
        None
    };
    clipped.unwrap_or_else(|| {
        let hides = |x: &[DVec3], y: &[DVec3]| {
            let hidden = |k: usize| blockers.iter().any(|polygon| crosses(x[k], y[k], polygon));
            (0..x.len()).map(|k| u32::from(hidden(k)) << k).sum()
        };
        let block = super::unoccluded(a, b, facing, accuracy);
        sampled::Sampling { a, b, facing, weights, accuracy }.visible_part(&block, &hides)
    })
}

/// ∫N_k G V over a part of a panel at the point `x` of a surface with normal `n`, behind polygons; `None` if it comes to
/// too many pieces.
pub(super) fn row(source: &Panel, from: &Region, polygons: &[&[DVec3]], x: DVec3, n: DVec3) -> Option<[f64; MAX_DOFS]> {
    let between = |polygon: &&[DVec3]| {
        let above_point = clip(polygon, |p| n.dot(p - x));
        let above_both = clip(&above_point, |p| source.normal().dot(p - source.patch.corners()[0]));
        Blocker::new(above_both)
    };
    let blockers: Vec<Blocker> = polygons.iter().filter_map(between).collect();
    // Nobody asks which blockers hide something.
    let mut affected = u32::MAX;
    visible_row(source, from, &blockers, (x, n), &mut Vec::new(), &mut affected)
}

/// ∫N_k G V over a part of a panel at a point with a normal; `affected` gets a bit for each blocker that hides some of it,
/// alone or behind others, `pieces` is scratch space.
fn visible_row(
    source: &Panel,
    from: &Region,
    blockers: &[Blocker],
    (x, n): (DVec3, DVec3),
    pieces: &mut Vec<Polygon>,
    affected: &mut u32,
) -> Option<[f64; MAX_DOFS]> {
    pieces.clear();
    pieces.push(from.corners().iter().copied().collect());
    let mut hidden = false;
    for (k, blocker) in blockers.iter().enumerate() {
        let removed = remove_cone(pieces, x, blocker);
        let bit = 1_u32.checked_shl(k as u32).unwrap_or(0);
        if removed || (hidden && *affected & bit == 0 && hides_some(from, x, blocker)) {
            *affected |= bit;
        }
        hidden |= removed;
    }
    if pieces.len() > MAX_PIECES {
        return None;
    }
    let mut sum = [0.0; MAX_DOFS];
    let counts = |piece: &&Polygon| !hidden || width(piece) > CRACK * source.radius;
    for piece in pieces.iter().filter(counts) {
        let values = Inner::new(source, piece).at(x, n);
        sum = std::array::from_fn(|k| sum[k] + values[k]);
    }
    Some(sum)
}

/// A receiver, a source, and what hides parts of it.
struct Shadow<'a> {
    receiver: &'a Panel,
    on: &'a Region,
    source: &'a Panel,
    from: &'a Region,
    blockers: &'a [Blocker],
    /// Pieces of the source.
    scratch: RefCell<Vec<Polygon>>,
    /// Bit k: blocker k hides some of the source from a point of the receiver that has been asked.
    affected: Cell<u32>,
    /// The source has come to too many pieces.
    overflowed: Cell<bool>,
    creases: OnceCell<Vec<Crease>>,
}

impl<'a> Shadow<'a> {
    fn new(receiver: &'a Panel, on: &'a Region, source: &'a Panel, from: &'a Region, blockers: &'a [Blocker]) -> Self {
        Self {
            receiver,
            on,
            source,
            from,
            blockers,
            scratch: RefCell::new(Vec::new()),
            affected: Cell::new(0),
            overflowed: Cell::new(false),
            creases: OnceCell::new(),
        }
    }

    /// `None` if the source comes to too many pieces.
    fn block(&self, weights: [f64; 2], accuracy: &Accuracy) -> Option<Block> {
        let budget = |sum: f64| accuracy.shadows * accuracy.shadow_scale(self.receiver, self.source, weights, sum);
        let at = |x: DVec3| self.irradiance(x);
        let creases = || self.creases();
        let outer = Outer {
            panel: self.receiver,
            source: self.source,
            at: &at,
            degrees: &OUTER,
            shadows: Some(Shadows { creases: &creases, guard: GUARD }),
            most: MAX_PARTS,
        };
        let mut block = outer.integrate(self.on, &budget);
        // Less than what was allowed is not claimed where there is a shadow: few points say little.
        let claimed = if self.affected.get() == 0 { 0.0 } else { budget(block.sum()) };
        block.quadrature_error = block.quadrature_error.max(claimed) + self.undiscovered(block.sum());
        (!self.overflowed.get()).then_some(block)
    }

    fn creases(&self) -> &[Crease] {
        self.creases.get_or_init(|| {
            let Panel { center, radius, .. } = *self.receiver;
            Ground { center, radius, normal: self.receiver.normal() }
                .creases(self.from.corners(), self.blockers.iter().map(|blocker| &blocker.outline[..]))
        })
    }

    /// ∫N_k G V over the source at a point of the receiver.
    fn irradiance(&self, x: DVec3) -> [f64; MAX_DOFS] {
        if self.overflowed.get() {
            return [0.0; MAX_DOFS];
        }
        let mut affected = self.affected.get();
        let (receiver, pieces) = ((x, self.receiver.normal()), &mut self.scratch.borrow_mut());
        let row = visible_row(self.source, self.from, self.blockers, receiver, pieces, &mut affected);
        self.affected.set(affected);
        row.unwrap_or_else(|| {
            self.overflowed.set(true);
            [0.0; MAX_DOFS]
        })
    }

    /// What blockers that no point saw may take away of a sum.
    ///
    /// The views from the corners of the receiver cover the shaft where it is nearer to the source, measured by the sizes
    /// of both: what stands there is seen. What stands nearer to the receiver may hide between the views.
    fn undiscovered(&self, sum: f64) -> f64 {
        let unseen = |k: usize| self.affected.get() >> k & 1 == 0;
        let hidden = |blocker: &Blocker| remoteness(self.receiver, blocker) < remoteness(self.source, blocker);
        let blockers = self.blockers.iter().enumerate();
        let through: f64 = blockers
            .filter(|&(k, blocker)| unseen(k) && hidden(blocker))
            .map(|(_, blocker)| self.through(&blocker.outline))
            .sum();
        through.min(sum / (OUTER_POINTS + 2.0))
    }

    /// A bound of what reaches a polygon from the receiver: A_a A_c/(π d²).
    fn through(&self, polygon: &Polygon) -> f64 {
        let centre = polygon.iter().sum::<DVec3>() / polygon.len() as f64;
        let radius = polygon.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
        let distance = (centre.distance(self.receiver.center) - radius - self.receiver.radius).max(0.0);
        self.on.area() * polygon::area(polygon) / (PI * distance * distance).max(f64::MIN_POSITIVE)
    }
}

/// The distance of a polygon from a panel's centre, in radii of the panel.
fn remoteness(panel: &Panel, blocker: &Blocker) -> f64 {
    distance(panel.center, &blocker.outline, blocker.normal.normalize_or_zero()) / panel.radius
}

/// A convex polygon that may hide something.
struct Blocker {
    outline: Polygon,
    /// See [`area_vector`].
    normal: DVec3,
}

impl Blocker {
    /// `None` if fewer than three corners are apart.
    fn new(mut outline: Polygon) -> Option<Self> {
        let from = *outline.first()?;
        let size = outline.iter().map(|corner| corner.distance(from)).fold(0.0, f64::max);
        let far = outline.iter().map(|corner| corner.abs().max_element()).fold(0.0, f64::max);
        let short = (SHORT * size).max(ROUNDED * far);
        let mut last = *outline.last()?;
        outline.retain(|corner| corner.distance(std::mem::replace(&mut last, *corner)) > short);
        (outline.len() >= 3).then(|| Self { normal: area_vector(&outline), outline })
    }
}

/// Takes the part of the pieces away that a convex polygon hides from `x`; whether there was any.
///
/// Pieces are kept where they are: each is a third of a kilobyte, and cutting takes no longer than moving
/// them about.
fn remove_cone(pieces: &mut Vec<Polygon>, x: DVec3, blocker: &Blocker) -> bool {
    let mut sides = Polygon::new();
    if !cone(pieces, x, blocker, &mut sides) {
        return false;
    }
    for side in &mut sides {
        *side = side.normalize_or_zero();
    }
    let mut hidden = false;
    for k in 0..pieces.len() {
        if pieces.len() <= MAX_PIECES && !sides.iter().any(|&side| misses(&pieces[k], x, side)) {
            hidden = true;
            split(k, x, &sides, pieces);
        }
    }
    if hidden {
        pieces.retain(|piece| !piece.is_empty());
    }
    hidden
}

/// Whether a convex polygon may hide a part of a region from `x`: no side of its cone has the region outside.
fn hides_some(from: &Region, x: DVec3, blocker: &Blocker) -> bool {
    cone(&[from.corners().iter().copied().collect()], x, blocker, &mut Polygon::new())
}

/// Puts the inward normals of the sides of the cone that a convex polygon hides from `x` into `sides`; false if all pieces
/// are on the outer side of one of them, or the polygon is seen edge-on.
fn cone(pieces: &[Polygon], x: DVec3, blocker: &Blocker, sides: &mut Polygon) -> bool {
    let rays: Polygon = blocker.outline.iter().map(|&corner| corner - x).collect();
    let height = blocker.normal.dot(rays[0]);
    if height.abs() <= EDGE_ON * blocker.normal.length() * rays[0].length() {
        return false;
    }
    (0..rays.len()).all(|k| {
        let side = rays[k].cross(rays[if k + 1 < rays.len() { k + 1 } else { 0 }]) * height.signum();
        sides.push(side);
        !pieces.iter().all(|piece| misses(piece, x, side))
    })
}

/// Whether no point of a polygon is on the inner side of a plane through `x`.
fn misses(polygon: &Polygon, x: DVec3, inwards: DVec3) -> bool {
    polygon.iter().all(|&y| inwards.dot(y - x) <= 0.0)
}

/// Replaces a piece by what of it is outside the cone of the sides with these inward normals: the first part takes its
/// place, the others are added; nothing, if nothing is left.
fn split(at: usize, x: DVec3, sides: &[DVec3], pieces: &mut Vec<Polygon>) {
    let (mut piece, mut other) = (pieces[at].take(), Polygon::new());
    let (mut inside, mut rest) = (&mut piece, &mut other);
    let edge = EDGE * inside.iter().map(|&y| y.distance_squared(x)).fold(0.0, f64::max).sqrt();
    for side in sides {
        let mut heights = [0.0; POLYGON];
        for (height, &y) in heights.iter_mut().zip(&*inside) {
            *height = side.dot(y - x);
        }
        let to = if pieces[at].is_empty() {
            at
        } else {
            pieces.push(Polygon::new());
            pieces.len() - 1
        };
        clip_at(inside, |k| -heights[k] - edge, &mut pieces[to]);
        if pieces[to].len() < 3 {
            pieces[to].clear();
            if to > at {
                pieces.pop();
            }
        }
        clip_at(inside, |k| heights[k], rest);
        std::mem::swap(&mut inside, &mut rest);
        if inside.len() < 3 {
            break;
        }
    }
}

/// Twice the area over the circumference: between the least width and half of it.
fn width(polygon: &Polygon) -> f64 {
    let edge = |k: usize| polygon[k].distance(polygon[(k + 1) % polygon.len()]);
    let circumference: f64 = (0..polygon.len()).map(edge).sum();
    2.0 * polygon::area(polygon) / circumference.max(f64::MIN_POSITIVE)
}

/// Whether the segment between two points crosses a convex polygon.
fn crosses(x: DVec3, y: DVec3, polygon: &Blocker) -> bool {
    remove_cone(&mut vec![Polygon::from_iter([y, y, y])], x, polygon)
}

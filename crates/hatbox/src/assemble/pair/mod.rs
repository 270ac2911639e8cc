//! S_ij = ∬ N_i N_j G V over a pair of panels, to a requested tolerance.
//!
//! | pair | rule |
//! |---|---|
//! | coplanar, behind each other, or proven hidden | exactly 0 |
//! | far | symmetric Gauss on both sides, of the smallest degree whose a-priori error is small enough |
//! | near, constant functions on both sides | integrals along the edges (`contour`) |
//! | sharing an edge, uncut, and neither a needle | Sauter–Schwab, order n raised until two orders agree |
//! | near, or cut by the other's horizon | closed-form inner integral, adaptive outer rule |
//! | near, and no closed form (bilinear on a trapezium) | the pair is subdivided |
//! | partially hidden by a few convex polygons | the visible part cut out and integrated in closed form (`clipped`) |
//! | partially hidden by more | the unoccluded block, corrected by low-discrepancy rays (`sampled`) |
//!
//! Every rule returns an error estimate along with its block.

mod clipped;
mod contour;
mod creases;
mod gauss;
mod near;
mod outer;
mod point;
mod region;
mod sampled;
mod touching;

pub use point::{Outlook, point_row};
pub use region::Facing;

use super::Panel;
use crate::element::MAX_DOFS;
use crate::kernel::geometric;
pub(super) use gauss::a_priori_error_factors;
use glam::DVec3;
pub(crate) use region::{FLAT, Region};

/// What is known of the sight between two panels.
#[derive(Clone, Copy)]
pub enum Sight<'a> {
    /// Nothing is between them.
    Clear,
    /// They cannot see each other.
    Blocked,
    /// These convex planar polygons may be between them, and nothing else; at most sixteen.
    Behind(&'a [&'a [DVec3]]),
    /// Something may be between them; ask which of up to [`PACKET`](crate::visibility::PACKET) segments from the first to
    /// the second it crosses, as bits.
    Partial(&'a (dyn Fn(&[DVec3], &[DVec3]) -> u32 + Sync)),
}

/// How accurate pair integrals are to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accuracy {
    /// Relative error τ: the errors of a row add up to about τ times the row's sum.
    pub tolerance: f64,
    /// Area of all panels: pairs smaller than their share A_i A_j / A of a mean row need less relative accuracy.
    pub total_area: f64,
    /// Most rays for a pair.
    pub max_rays: u32,
    /// Seed of the rays.
    pub seed: u64,
    /// What a partially hidden pair may err by, relative to √(s A), s being its sum and A its smaller area.
    pub shadows: f64,
    /// Whether shadows are cut out even where few rays would do.
    pub cut_out: bool,
}

/// [`Accuracy::shadows`] as a part of the tolerance: the pairs that a shadow's edge crosses are about √n of a row of n, each of
/// about 1/n of its sum; the errors of five times as many add up to τ A. Where there are more, the errors of the row show it,
/// and its pairs are given less.
const SHADOWS: f64 = 0.2;

/// A pair that may err by this fraction of its sum is left to rays: fewer than two hundred are faster than cutting it out.
const ROUGH: f64 = 0.02;

impl Accuracy {
    /// τ for a scene of that area, with up to 2²⁰ rays for a pair.
    pub fn new(tolerance: f64, total_area: f64) -> Self {
        Self { tolerance, total_area, max_rays: 1 << 20, seed: 0, shadows: SHADOWS * tolerance, cut_out: true }
    }

    /// Whether so few rays tell enough of a pair's shadow that cutting it out would take longer: where the pair may err by
    /// some percent of its sum, and none of the panels shines.
    pub(crate) fn is_rough(&self, a: &Panel, b: &Panel, weights: [f64; 2]) -> bool {
        let area = a.area().min(b.area());
        let sum = geometric(a.center, a.normal(), b.center, b.normal()) * a.area() * b.area();
        !self.cut_out
            && weights.iter().all(|&weight| weight <= 1.0)
            && self.tolerance * area.sqrt() >= ROUGH * sum.min(area).sqrt()
    }

    /// What the error of a partially hidden pair counts in, √(s A), if its sum is s; the pair counts at least as what a mean
    /// row sends there. A pair that carries strong light has less area.
    pub(crate) fn shadow_scale(&self, a: &Panel, b: &Panel, weights: [f64; 2], sum: f64) -> f64 {
        let area = (a.area() / weights[0]).min(b.area() / weights[1]);
        let least = (a.area() * b.area() / self.total_area).min(area);
        (sum.clamp(least, area) * area).sqrt()
    }

    /// The error in m² that a pair with ∬G = `value` may have.
    fn budget(&self, a: &Panel, b: &Panel, value: f64) -> f64 {
        self.tolerance * value.max(a.area() * b.area() / self.total_area)
    }
}

/// A block of S: n_a × n_b numbers row by row in m², and how it was reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    values: [f64; MAX_DOFS * MAX_DOFS],
    columns: usize,
    len: usize,
    /// Estimated error of the quadrature, as an error of ∬G in m².
    pub quadrature_error: f64,
    /// Estimated error of the sampled visibility, likewise.
    pub visibility_error: f64,
    /// Rays cast.
    pub rays: u32,
}

impl Block {
    fn zeros(a: &Panel, b: &Panel) -> Self {
        let (rows, columns) = (a.element.dofs(), b.element.dofs());
        let values = [0.0; MAX_DOFS * MAX_DOFS];
        Self { values, columns, len: rows * columns, quadrature_error: 0.0, visibility_error: 0.0, rays: 0 }
    }

    /// The entries, row by row.
    pub fn values(&self) -> &[f64] {
        &self.values[..self.len]
    }

    /// ∬ G V: the sum of the entries, since shape functions sum to 1.
    pub fn sum(&self) -> f64 {
        self.values().iter().sum()
    }

    /// Adds w N(x) t, t being a row over the second panel's functions.
    fn add(&mut self, weight: f64, functions: &[f64; MAX_DOFS], row: &[f64; MAX_DOFS]) {
        for (values, n) in self.values[..self.len].chunks_exact_mut(self.columns).zip(functions) {
            for (value, t) in values.iter_mut().zip(row) {
                *value += weight * n * t;
            }
        }
    }

    /// Adds another block with its errors.
    fn accumulate(&mut self, other: &Self) {
        for (a, b) in self.values.iter_mut().zip(&other.values) {
            *a += b;
        }
        self.quadrature_error += other.quadrature_error;
    }

    /// The block of the panels in the other order.
    fn transposed(&self) -> Self {
        let (rows, columns) = (self.len / self.columns, self.columns);
        let mut result = Self { columns: rows, ..*self };
        for i in 0..rows {
            for j in 0..columns {
                result.values[j * rows + i] = self.values[i * columns + j];
            }
        }
        result
    }

    /// The difference of two blocks, as the error of ∬G that it amounts to: Σ|difference|.
    fn distance(&self, other: &Self) -> f64 {
        self.values().iter().zip(other.values()).map(|(a, b)| (a - b).abs()).sum()
    }
}

/// The block S_ab of two panels. `weights` are how strongly errors count that reach a from b, and b from a (1 unless
/// one of them is a strong emitter).
pub fn pair_block(a: &Panel, b: &Panel, sight: Sight<'_>, weights: [f64; 2], accuracy: &Accuracy) -> Block {
    match Facing::new(&a.patch, &b.patch) {
        Some(facing) => facing_block(a, b, &facing, sight, weights, accuracy),
        None => Block::zeros(a, b),
    }
}

/// [`pair_block`] where the parts that face each other are known.
pub fn facing_block(
    a: &Panel,
    b: &Panel,
    facing: &Facing,
    sight: Sight<'_>,
    weights: [f64; 2],
    accuracy: &Accuracy,
) -> Block {
    match sight {
        Sight::Blocked => Block::zeros(a, b),
        Sight::Clear => unoccluded(a, b, facing, accuracy),
        Sight::Behind(polygons) => clipped::block(a, b, facing, polygons, weights, accuracy),
        Sight::Partial(hides) => {
            let block = unoccluded(a, b, facing, accuracy);
            sampled::Sampling { a, b, facing, weights, accuracy }.visible_part(&block, hides)
        }
    }
}

/// The block as if nothing stood between.
fn unoccluded(a: &Panel, b: &Panel, Facing { first, second }: &Facing, accuracy: &Accuracy) -> Block {
    if let Some(block) = gauss::far(a, first, b, second, accuracy) {
        return block;
    }
    if a.element.degree == 0 && b.element.degree == 0 {
        return contour::block(a, first, b, second, accuracy);
    }
    if first.whole && second.whole && touching::shares_a_corner(a, b) {
        return touching::block(a, b, accuracy);
    }
    near::block(a, first, b, second, accuracy)
}

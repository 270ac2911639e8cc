//! Pair integrals where they are hard: random pairs behind random blockers, eight at a time against one at a time,
//! slivers, planes that almost coincide, and places and sizes at the ends of the scale.

#[path = "pairs/batch.rs"]
mod batch;
#[allow(dead_code, reason = "other tests use the rest")]
mod closed_forms;
#[path = "pairs/degenerate.rs"]
mod degenerate;
#[path = "pairs/honesty.rs"]
mod honesty;
mod random;

use glam::DVec3;
use hatbox::assemble::Panel;
use hatbox::element::{Element, Shape};
use hatbox::mesh::Patch;
use hatbox::quadrature::sequence::hash;
pub(crate) use random::Random;

/// What a panel may look like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Outline {
    Triangle,
    Parallelogram,
    Trapezium,
}

impl Outline {
    pub(crate) const ALL: [Self; 3] = [Self::Triangle, Self::Parallelogram, Self::Trapezium];

    pub(crate) fn shape(self) -> Shape {
        if self == Self::Triangle { Shape::Triangle } else { Shape::Quad }
    }

    /// Random corners of about unit size around the origin of the plane z = 0, counter-clockwise.
    pub(crate) fn corners(self, random: &mut Random) -> [DVec3; 4] {
        let mut r = |lo, hi| random.uniform(lo, hi);
        let at = |x: f64, y: f64| DVec3::new(x - 0.5, y - 0.5, 0.0);
        match self {
            Self::Triangle => {
                let apex = at(r(-0.3, 1.3), r(0.3, 1.2));
                [at(0.0, 0.0), at(r(0.4, 1.2), 0.0), apex, apex]
            }
            Self::Parallelogram => {
                let (width, lean, height) = (r(0.3, 1.2), r(-0.5, 0.5), r(0.3, 1.2));
                [at(0.0, 0.0), at(width, 0.0), at(width + lean, height), at(lean, height)]
            }
            Self::Trapezium => {
                let (left, right, height) = (r(0.05, 0.4), r(0.5, 0.95), r(0.3, 1.2));
                [at(0.0, 0.0), at(1.0, 0.0), at(right, height), at(left, height)]
            }
        }
    }
}

/// A panel that touches nothing by its indices.
pub(crate) fn panel(corners: [DVec3; 4], element: &'static Element) -> Panel {
    let first =
        corners.iter().fold(0, |h, p| hash(h, p.x.to_bits() ^ p.y.to_bits() ^ p.z.to_bits())) as u32 & 0xffff_fff0;
    Panel::new(Patch::new(element.shape, corners), element, [first, first + 1, first + 2, first + 3], first)
}

/// cosθ cosθ' / (π r²) of points that face each other, else 0.
pub(crate) fn kernel(x: DVec3, n: DVec3, y: DVec3, m: DVec3) -> f64 {
    let d = y - x;
    let r2 = d.length_squared();
    (n.dot(d).max(0.0) * -m.dot(d).min(0.0)) / (std::f64::consts::PI * r2 * r2)
}

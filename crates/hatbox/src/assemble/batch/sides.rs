//! Panels as a batch looks at them: one on one side, eight on the other.

#![expect(clippy::inline_always, reason = "kernels must be inlined into functions compiled for their instruction set")]

use crate::assemble::panel::{LADDER, Panel};
use crate::element::{Element, MAX_DOFS, Shape};
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;

/// Panels in a chunk.
pub const LANES: usize = 8;

/// One number for each lane.
pub(super) type Lanes = [f64; LANES];

/// One vector for each lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vectors {
    pub(super) x: Lanes,
    pub(super) y: Lanes,
    pub(super) z: Lanes,
}

impl Vectors {
    pub(super) const ZERO: Self = Self { x: [0.0; LANES], y: [0.0; LANES], z: [0.0; LANES] };

    pub(super) fn set(&mut self, lane: usize, v: DVec3) {
        (self.x[lane], self.y[lane], self.z[lane]) = (v.x, v.y, v.z);
    }

    #[inline(always)]
    pub(super) fn at(&self, lane: usize) -> DVec3 {
        DVec3::new(self.x[lane], self.y[lane], self.z[lane])
    }
}

/// A quadrature node of each lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    pub(super) at: Vectors,
    /// Weight in m², divided by π.
    pub(super) weight: Lanes,
}

/// What every pair asks of a panel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Head {
    pub(super) normal: DVec3,
    pub(super) center: DVec3,
    /// See [`Panel`].
    pub(super) spread: [DVec3; 2],
    pub(super) radius: f64,
    pub(super) area: f64,
    /// It is a parallelogram.
    pub(super) symmetric: bool,
    /// Its element has one function.
    pub(super) constant: bool,
}

impl Head {
    pub(super) fn of(panel: &Panel) -> Self {
        Self {
            normal: panel.normal(),
            center: panel.center,
            spread: panel.spread,
            radius: panel.radius,
            area: panel.area(),
            symmetric: panel.patch.shape() == Shape::Quad && panel.patch.is_affine(),
            constant: panel.element.dofs() == 1,
        }
    }
}

/// The heads of a chunk, by lanes.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Front {
    pub(super) normal: Vectors,
    pub(super) center: Vectors,
    pub(super) spread: [Vectors; 2],
    pub(super) radius: Lanes,
    pub(super) area: Lanes,
    /// All are parallelograms.
    pub(super) symmetric: bool,
    pub(super) constant: bool,
}

impl Front {
    pub(super) const EMPTY: Self = Self {
        normal: Vectors::ZERO,
        center: Vectors::ZERO,
        spread: [Vectors::ZERO; 2],
        radius: [0.0; LANES],
        area: [0.0; LANES],
        symmetric: true,
        constant: true,
    };

    pub(super) fn set(&mut self, lane: usize, head: &Head) {
        self.normal.set(lane, head.normal);
        self.center.set(lane, head.center);
        for (vectors, &spread) in self.spread.iter_mut().zip(&head.spread) {
            vectors.set(lane, spread);
        }
        (self.radius[lane], self.area[lane]) = (head.radius, head.area);
        self.symmetric &= head.symmetric;
        self.constant &= head.constant;
    }
}

/// Up to [`LANES`] panels of one element that follow each other.
#[derive(Debug, Clone)]
pub(super) struct Chunk {
    pub(super) element: &'static Element,
    /// The first panel and their number.
    pub(super) first: usize,
    pub(super) len: usize,
    /// The greatest degree that their shape functions use up.
    pub(super) degree: usize,
    /// The degree up to which each rung is exact on all of them.
    pub(super) exactness: [usize; LADDER.len()],
    pub(super) corners: Vec<Vectors>,
    pub(super) longest_edge: Lanes,
    pub(super) nodes: [Vec<Node>; LADDER.len()],
    pub(super) tables: [&'static [[f64; MAX_DOFS]]; LADDER.len()],
}

impl Chunk {
    pub(super) fn new(panel: &Panel, first: usize) -> Self {
        Self {
            element: panel.element,
            first,
            len: 0,
            degree: 0,
            exactness: panel.exactness,
            corners: vec![Vectors::ZERO; panel.patch.corners().len()],
            longest_edge: [0.0; LANES],
            nodes: [0, 1, 2, 3].map(|rung| {
                let zero = Node { at: Vectors::ZERO, weight: [0.0; LANES] };
                vec![zero; panel.tabulated(rung).len()]
            }),
            tables: [0, 1, 2, 3].map(|rung| panel.tabulated(rung)),
        }
    }

    pub(super) fn push(&mut self, panel: &Panel) {
        let lane = self.len;
        self.len += 1;
        self.degree = self.degree.max(panel.functions_degree());
        // A parallelogram may share a chunk with trapezia, on which rules are exact to a degree less.
        for (least, &exact) in self.exactness.iter_mut().zip(&panel.exactness) {
            *least = (*least).min(exact);
        }
        for (corners, &corner) in self.corners.iter_mut().zip(panel.patch.corners()) {
            corners.set(lane, corner);
        }
        self.longest_edge[lane] = panel.longest_edge;
        for (nodes, points) in self.nodes.iter_mut().zip(&panel.ladder) {
            for (k, node) in nodes.iter_mut().enumerate() {
                node.at.set(lane, points.at(k));
                node.weight[lane] = FRAC_1_PI * points.weight[k];
            }
        }
    }
}

//! Rays: where they start, which way they go, and what is kept of what they hit.
//!
//! Every cell uses the same K = 2^m points, two dimensions of a scrambled Sobol' set, so what depends on them alone (shape
//! functions, the fit) is a table. The directions are the other two dimensions, those that fill every elementary
//! interval: the k-th cell along a curve through space takes the k-th block of K. So each cell has a net, and so have
//! neighbours together ([`Blocks`]). Nothing is drawn in sequence, so a ray can be cast again at any time instead of being
//! remembered.

use super::cells::{Cells, Locator};
use super::spots::spot;
use crate::element::{Element, MAX_DOFS, Shape};
use crate::exchange::closure::first_face;
use crate::exchange::hierarchical::Linked;
use crate::kernel::Frame;
use crate::quadrature::sequence::Blocks;
use crate::visibility::Bvh;
use glam::DVec3;
use std::sync::Arc;

/// Where a ray ended: the cell, the part of it, and whether the cell is a lamp's, or one whose light comes through a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Hit {
    cell: u32,
    spot: u8,
}

const LAMP: u32 = 1 << 31;
const LINKED: u32 = 1 << 30;

/// Kinds of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Kinds(u32);

impl Kinds {
    pub(super) const NONE: Self = Self(0);
    pub(super) const LAMPS: Self = Self(LAMP);
    pub(super) const LAMPS_AND_LINKED: Self = Self(LAMP | LINKED);
}

impl Hit {
    /// Out of the scene, or onto an unlit back.
    pub(super) const LOST: Self = Self { cell: u32::MAX, spot: 0 };

    fn new(cell: u32, spot: u8, lamp: bool) -> Self {
        Self { cell: if lamp { cell | LAMP } else { cell }, spot }
    }

    /// The cell with what else is known of it, and the part.
    pub(super) fn to_parts(self) -> (u32, u8) {
        (self.cell, self.spot)
    }

    #[inline]
    pub(super) fn from_parts(cell: u32, spot: u8) -> Self {
        Self { cell, spot }
    }

    pub(super) fn is_lost(self) -> bool {
        self.cell == u32::MAX
    }

    pub(super) fn is_lamp(self) -> bool {
        self.cell & LAMP != 0 && !self.is_lost()
    }

    /// Whether one that is not lost is of a cell of these kinds.
    #[inline]
    pub(super) fn is_of(self, kinds: Kinds) -> bool {
        self.cell & kinds.0 != 0
    }

    pub(super) fn cell(self) -> usize {
        (self.cell & !(LAMP | LINKED)) as usize
    }

    /// The part of the cell; see [`Spots`](super::spots::Spots).
    pub(super) fn spot(self) -> u8 {
        self.spot
    }
}

/// The points of a reference cell.
#[derive(Debug)]
pub(super) struct Points {
    pub(super) at: Vec<[f64; 2]>,
    pub(super) functions: Vec<[f64; MAX_DOFS]>,
}

impl Points {
    pub(super) fn new(element: &Element, rays: u32, seed: u64) -> Self {
        let blocks = Blocks::new(seed, rays);
        let at: Vec<[f64; 2]> = (0..rays).map(|ray| place(element.shape, blocks.last(ray))).collect();
        let functions = at.iter().map(|&at| element.values(at)).collect();
        Self { at, functions }
    }
}

/// Reference coordinates, uniform in the reference cell.
pub(super) fn place(shape: Shape, [u, v]: [f64; 2]) -> [f64; 2] {
    match shape {
        // Lines from a corner: the square root makes the density uniform, and neighbours stay neighbours.
        Shape::Triangle => {
            let root = v.sqrt();
            [root * (1.0 - u), root * u]
        }
        Shape::Quad => [u, v],
    }
}

/// Casts rays.
#[derive(Debug)]
pub(super) struct Tracer {
    pub(super) blockers: Arc<Bvh>,
    pub(super) locator: Locator,
    /// One bit for each cell of a lamp, and for each that others cover.
    lamps: Vec<u64>,
    covered: Vec<u64>,
    /// The points of all cells.
    blocks: Blocks,
    /// The block of each cell.
    block: Vec<u32>,
}

impl Tracer {
    pub(super) fn new(
        blockers: Arc<Bvh>,
        locator: Locator,
        [lamp, covered]: [&dyn Fn(usize) -> bool; 2],
        block: Vec<u32>,
        rays: u32,
        seed: u64,
    ) -> Self {
        let (lamps, covered) = (bits(block.len(), lamp), bits(block.len(), covered));
        Self { blockers, locator, lamps, covered, blocks: Blocks::new(seed, rays), block }
    }

    /// The place of a cell among all along a curve through space.
    pub(super) fn block_of(&self, cell: usize) -> u32 {
        self.block[cell]
    }

    pub(super) fn is_lamp(&self, cell: usize) -> bool {
        has_bit(&self.lamps, cell)
    }

    pub(super) fn is_covered(&self, cell: usize) -> bool {
        has_bit(&self.covered, cell)
    }

    /// Casts all rays of a cell from the given points; `linked` is what it is linked with.
    pub(super) fn trace(&self, cells: &Cells, cell: usize, points: &Points, linked: Linked<'_>, hits: &mut [Hit]) {
        if self.is_covered(cell) {
            hits.fill(Hit::LOST);
            return;
        }
        let patch = cells.patch(cell);
        let frame = Frame::about(patch.normal());
        for ((hit, &at), [s, t]) in hits.iter_mut().zip(&points.at).zip(self.blocks.first(self.block[cell])) {
            *hit = self.cast(cells, patch.point(at), frame.cosine(s, t), cells.surface(cell));
            if !hit.is_lost() && linked.contains(hit.cell()) {
                hit.cell |= LINKED;
            }
        }
    }

    /// What a ray from a point of a face meets.
    pub(super) fn cast(&self, cells: &Cells, origin: DVec3, direction: DVec3, surface: u32) -> Hit {
        let lit = |id: u32, front: bool| self.locator.has_cells(id, front);
        let Some(hit) = first_face(&self.blockers, [origin, direction], surface, lit) else { return Hit::LOST };
        let point = origin + direction * hit.t;
        match self.locator.find(cells, hit.id, hit.front, point) {
            Some((cell, shape, at)) => Hit::new(cell, spot(shape, at), self.is_lamp(cell as usize)),
            None => Hit::LOST,
        }
    }

    pub(super) fn bytes(&self) -> usize {
        self.locator.bytes() + size_of_val(&*self.lamps) + size_of_val(&*self.covered)
    }
}

/// One bit for each cell.
fn bits(cells: usize, is_set: &dyn Fn(usize) -> bool) -> Vec<u64> {
    let word = |first: usize| {
        let set = (first..cells.min(first + 64)).filter(|&cell| is_set(cell));
        set.fold(0, |word, cell| word | 1 << (cell - first))
    };
    (0..cells).step_by(64).map(word).collect()
}

fn has_bit(bits: &[u64], cell: usize) -> bool {
    bits[cell / 64] >> (cell % 64) & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hit_keeps_its_place() {
        for (spot, lamp) in [(37, false), (255, true)] {
            let hit = Hit::new(12_345, spot, lamp);
            assert_eq!((hit.cell(), hit.is_lamp(), hit.is_lost(), hit.spot()), (12_345, lamp, false, spot));
            let (cell, spot) = hit.to_parts();
            assert_eq!(Hit::from_parts(cell, spot), hit);
        }
        assert!(Hit::LOST.is_lost() && !Hit::LOST.is_lamp());
    }
}

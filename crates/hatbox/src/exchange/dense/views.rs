//! What stands between two panels or clusters, and the block of two panels behind it.

use crate::assemble::{Accuracy, Block, Facing, Outlook, Panel, Sight, facing_block, pair_block};
use crate::element::MAX_DOFS;
use crate::visibility::{Body, Bvh, Occluders, Shaft, ShaftResult, Visibility};
use glam::DVec3;

/// More possible blockers than this in a shaft are not listed.
const MAX_CANDIDATES: usize = 48;
/// So many of the listed blockers are tried for hiding the whole view.
const MAX_HIDERS: usize = 8;
/// More possible blockers than this between two panels are not clipped; rays take their place.
const MAX_CLIPPED: usize = 16;

/// What may stand in a view.
#[derive(Clone, Copy)]
pub(crate) enum Between<'a> {
    /// Nothing, by proof.
    Nothing,
    /// These polygons, and no others.
    Some(&'a [u32]),
    /// More than are worth listing.
    Many,
}

/// What a point receives from each function of a panel, dimensionless.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PointRow {
    /// With all shadows.
    Exact([f64; MAX_DOFS]),
    /// As if nothing stood between, although more does than can be cut out: rays have to tell.
    Unoccluded([f64; MAX_DOFS]),
}

/// A point of a surface that looks around.
#[derive(Debug, Clone, Copy)]
pub struct Viewpoint {
    /// Where it is.
    pub at: DVec3,
    /// The unit normal of the surface.
    pub normal: DVec3,
    /// The index of its face, which hides nothing; `u32::MAX` in the air.
    pub surface: u32,
}

/// The opaque faces of a scene, twice: as few large polygons for proofs and exact shadows, and as they are for rays.
#[derive(Clone, Copy)]
pub struct Views<'a> {
    /// As polygons.
    pub occluders: &'a Occluders,
    /// To cast rays at, where there are too many polygons.
    pub blockers: &'a Bvh,
}

impl Views<'_> {
    /// The block S_ab of two panels. `weights` are those of [`pair_block`].
    pub fn pair_block(&self, panels: [&Panel; 2], weights: [f64; 2], accuracy: &Accuracy) -> Block {
        let [a, b] = panels;
        let blocked = || pair_block(a, b, Sight::Blocked, weights, accuracy);
        if a.covered || b.covered {
            return blocked();
        }
        let Some(facing) = Facing::new(&a.patch, &b.patch) else { return blocked() };
        let ends = facing.polygons().map(Body::polygon);
        let mut list = Vec::new();
        let between =
            self.between([&ends[0], &ends[1]], panels.map(|panel| self.polygon(panel)), Between::Many, &mut list);
        between.map_or_else(blocked, |between| self.block(panels, &facing, between, weights, accuracy))
    }

    /// What a point receives from a panel, if nothing stands between but what it inherits; `None` if nothing. `list` is
    /// scratch space.
    pub(super) fn point_row(
        &self,
        panel: &Panel,
        from: &Viewpoint,
        inherited: Between<'_>,
        list: &mut Vec<u32>,
    ) -> Option<PointRow> {
        let outlook = Outlook::new(panel, from.at, from.normal)?;
        let (point, part) = (Body::polygon(&[from.at]), Body::polygon(outlook.corners()));
        let skip = [self.of_surface(from.surface), self.polygon(panel)];
        match self.between([&point, &part], skip, inherited, list)? {
            Between::Nothing => Some(PointRow::Exact(outlook.row())),
            Between::Some(candidates) if candidates.len() <= MAX_CLIPPED => {
                let polygons: Vec<_> = candidates.iter().map(|&k| self.occluders.polygon(k)).collect();
                let exact = outlook.row_behind(&polygons).map(PointRow::Exact);
                Some(exact.unwrap_or_else(|| PointRow::Unoccluded(outlook.row())))
            }
            _ => Some(PointRow::Unoccluded(outlook.row())),
        }
    }

    /// The occluder that a panel is a part of.
    pub(super) fn polygon(&self, panel: &Panel) -> u32 {
        self.of_surface(panel.surface)
    }

    /// The occluder that a face is a part of.
    pub(super) fn of_surface(&self, surface: u32) -> u32 {
        self.occluders.of_surface(surface)
    }

    /// What of `inherited` may stand between two bodies, except the polygons of `skip`; `None` if the whole view is hidden.
    ///
    /// The box around both and the blockers' own planes settle most of what is inherited before the shaft is made.
    pub(crate) fn between<'b>(
        &self,
        [a, b]: [&Body; 2],
        skip: [u32; 2],
        inherited: Between<'_>,
        list: &'b mut Vec<u32>,
    ) -> Option<Between<'b>> {
        list.clear();
        let mut shaft = Shaft::around(a, b);
        match inherited {
            Between::Nothing => return Some(Between::Nothing),
            Between::Some(candidates) => {
                let may_block = |&&k: &&u32| !skip.contains(&k) && self.occluders.may_block(&shaft, k);
                list.extend(candidates.iter().filter(may_block));
                if list.is_empty() {
                    return Some(Between::Nothing);
                }
                if self.is_hidden(&shaft, list) {
                    return None;
                }
                shaft.tighten(a, b);
                list.retain(|&k| self.occluders.may_block(&shaft, k));
            }
            Between::Many => {
                shaft.tighten(a, b);
                if self.occluders.candidates(&shaft, &skip, list, MAX_CANDIDATES) == ShaftResult::TooMany {
                    return Some(Between::Many);
                }
                if self.is_hidden(&shaft, list) {
                    return None;
                }
            }
        }
        Some(if list.is_empty() { Between::Nothing } else { Between::Some(list) })
    }

    /// Whether one of the candidates covers the whole view.
    fn is_hidden(&self, shaft: &Shaft, candidates: &[u32]) -> bool {
        candidates.iter().take(MAX_HIDERS).any(|&k| self.occluders.blocks_fully(shaft, k))
    }

    /// The block of two panels that what is `between` does not hide altogether.
    pub(super) fn block(
        &self,
        [a, b]: [&Panel; 2],
        facing: &Facing,
        between: Between<'_>,
        weights: [f64; 2],
        accuracy: &Accuracy,
    ) -> Block {
        let integrated = |sight| facing_block(a, b, facing, sight, weights, accuracy);
        match between {
            Between::Nothing => integrated(Sight::Clear),
            Between::Some(candidates) if candidates.len() <= MAX_CLIPPED && !accuracy.is_rough(a, b, weights) => {
                let polygons: Vec<_> = candidates.iter().map(|&k| self.occluders.polygon(k)).collect();
                integrated(Sight::Behind(&polygons))
            }
            _ => {
                let skip = [a.surface, b.surface];
                integrated(Sight::Partial(&|x, y| self.blockers.occluded_packet(x, y, skip)))
            }
        }
    }
}

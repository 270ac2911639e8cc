//! Which cells of an open scene are closed in all the same.
//!
//! A room has walls, and walls have another side; a plate stands before the window of a house. That light gets away from there is
//! no reason why a room should not know its row sums. Cells that exchange light, directly or through others, are an enclosure,
//! and it is closed if no ray of any of them gets away: of as many rays as a closed scene is asked with, or, where enclosures are many,
//! of their share of sixteen times as many.
//! (Where it is not known who exchanges light with whom, the scene is one enclosure.)

use super::closure::{ALL_ESCAPE_RAYS, Escape, gets_away, receiving_sides};
use super::{Exchange, Geometry};
use crate::mesh::UnionFind;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Rays of all enclosures together, in those of one, at the most.
const MOST: usize = 16;
/// Seed of these rays.
const SEED: u64 = 0x656e_636c;

/// For each cell whether it is in an enclosure that is closed.
pub(super) fn enclosed(exchange: &dyn Exchange, geometry: &Geometry<'_>, escape: &Escape) -> Vec<bool> {
    let cells = geometry.scene.mesh.cells.len();
    if escape.fraction == 0.0 {
        return vec![true; cells];
    }
    let (mut found, mut enclosures) = (vec![false; cells], UnionFind::new(cells));
    if escape.open.len() != cells || !exchange.join_exchanging(&mut |a, b| enclosures.join(a, b)) {
        return found;
    }
    let mut members: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    (0..cells).for_each(|cell| members.entry(enclosures.find(cell)).or_default().push(cell));
    // Who exchanges light with nobody is in no enclosure.
    let may_be = |of: &Vec<usize>| of.len() > 1 && !of.iter().any(|&cell| escape.open[cell]);
    let closed: Vec<Vec<usize>> = members.into_values().filter(may_be).collect();
    let most = (MOST * ALL_ESCAPE_RAYS).div_ceil(closed.iter().map(Vec::len).sum::<usize>().max(1));
    let receives = receiving_sides(geometry.scene);
    for of in closed {
        let rays = ALL_ESCAPE_RAYS.div_ceil(of.len()).min(most) as u32;
        let none_gets_away = |&cell: &usize| !(0..rays).any(|k| gets_away(geometry, &receives, cell, SEED, k));
        if of.par_iter().all(none_gets_away) {
            for cell in of {
                found[cell] = true;
            }
        }
    }
    found
}

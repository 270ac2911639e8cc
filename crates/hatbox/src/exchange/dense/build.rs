//! The integration of all pairs, cluster by cluster.
//!
//! A small cluster of the tree over the panels is a run of rows. It meets the tree from the top: what may stand between two
//! clusters is found once, and their parts inherit the proof that nothing does, or the list to be narrowed down. Where
//! the view is clear, all panels of both are integrated side by side ([`Batch`]).

use super::Dense;
use crate::assemble::{Accuracy, Batch, Block, Facing, Found, LANES, Panel, Sight, facing_block};
use crate::exchange::tree::{LEAF, Tree};
use crate::exchange::{Geometry, Params, Statistics};
use crate::progress::{Interrupted, Progress};
use crate::visibility::{Occluders, Shaft, ShaftResult, Visibility};
use rayon::prelude::*;
use std::ops::Range;

/// More possible blockers than this in a shaft are not listed.
const MAX_CANDIDATES: usize = 48;
/// So many of the listed blockers are tried for hiding the whole view.
const MAX_HIDERS: usize = 8;
/// More possible blockers than this between two panels are not clipped; rays take their place.
const MAX_CLIPPED: usize = 16;
/// The runs are dealt to this many strands, each of which adds up its errors in order: fixed, so that sums do not depend
/// on the number of threads.
const STRANDS: usize = 64;

pub(super) fn build(geometry: &Geometry<'_>, params: &Params, progress: &dyn Progress) -> Result<Dense, Interrupted> {
    let tree = Tree::new(geometry.panels());
    let ordered: Vec<&Panel> = tree.order.iter().map(|&panel| &geometry.panels()[panel as usize]).collect();
    let mut dense = Dense::empty(geometry.panels(), &tree.order);
    let total_area = geometry.panels().iter().map(Panel::area).sum();
    let accuracy = Accuracy { tolerance: params.tolerance, total_area, max_rays: params.max_rays, seed: params.seed };
    let builder = Builder {
        geometry,
        occluders: &Occluders::new(geometry.surfaces),
        batch: &Batch::new(&ordered),
        panels: &ordered,
        tree: &tree,
        params,
        accuracy,
        offsets: &dense.offsets,
    };
    let runs = tree.runs();
    let cells = ordered.len();
    progress.begin("form factors", (cells * cells.saturating_sub(1) / 2) as u64);
    let strand = |strand: usize| {
        let mut sums = Sums::new(cells);
        let mut rows = Vec::new();
        for &run in runs.iter().skip(strand).step_by(STRANDS) {
            if progress.interrupted() {
                return Err(Interrupted);
            }
            let range = tree.clusters[run].range.clone();
            rows.push((range.start, builder.run(run, &mut sums)));
            progress.advance(range.map(|place| (cells - 1 - place) as u64).sum());
        }
        Ok((rows, sums))
    };
    let strands: Vec<_> = (0..STRANDS).into_par_iter().with_max_len(1).map(strand).collect::<Result<_, _>>()?;
    progress.end();
    let mut total = Sums::new(cells);
    let mut all = Vec::new();
    for (rows, sums) in strands {
        total.add(&sums);
        all.extend(rows);
    }
    all.sort_unstable_by_key(|(start, _)| *start);
    dense.rows = all.into_iter().flat_map(|(_, rows)| rows).collect();
    dense.statistics = total.statistics(&ordered, &dense.rows);
    Ok(dense)
}

/// Counts, and the errors of the row of each place.
struct Sums {
    quadrature: Vec<f64>,
    /// Squares of the errors of visibility.
    visibility: Vec<f64>,
    rays: u64,
    pairs: u64,
    clear_pairs: u64,
}

impl Sums {
    fn new(cells: usize) -> Self {
        let zeros = vec![0.0; cells];
        Self { quadrature: zeros.clone(), visibility: zeros, rays: 0, pairs: 0, clear_pairs: 0 }
    }

    fn add(&mut self, other: &Self) {
        for (sum, x) in self.quadrature.iter_mut().zip(&other.quadrature) {
            *sum += x;
        }
        for (sum, x) in self.visibility.iter_mut().zip(&other.visibility) {
            *sum += x;
        }
        self.rays += other.rays;
        self.pairs += other.pairs;
        self.clear_pairs += other.clear_pairs;
    }

    fn note(&mut self, [i, j]: [usize; 2], block: &Block, clear: bool) {
        for place in [i, j] {
            self.quadrature[place] += block.quadrature_error;
            // That no light came through is an estimate, too.
            self.visibility[place] += block.visibility_error.powi(2);
        }
        self.rays += u64::from(block.rays);
        let sees = block.values().iter().any(|&value| value != 0.0);
        self.pairs += u64::from(sees);
        self.clear_pairs += u64::from(sees && clear);
    }

    fn statistics(&self, panels: &[&Panel], rows: &[Vec<f64>]) -> Statistics {
        // A NaN among the errors must not get lost.
        let greater = |a: f64, b: f64| if b <= a { a } else { b };
        let worst = |errors: &mut dyn Iterator<Item = f64>| {
            errors.zip(panels).map(|(error, panel)| error / panel.area()).fold(0.0, greater)
        };
        Statistics {
            bytes: rows.iter().map(|row| row.len() * size_of::<f64>()).sum(),
            rays: self.rays,
            pairs: self.pairs,
            clear_pairs: self.clear_pairs,
            quadrature_error: worst(&mut self.quadrature.iter().copied()),
            visibility_error: worst(&mut self.visibility.iter().map(|v| v.sqrt())),
        }
    }
}

/// What the blocks of a run of rows need.
struct Builder<'a> {
    geometry: &'a Geometry<'a>,
    occluders: &'a Occluders,
    batch: &'a Batch,
    /// In the tree's order.
    panels: &'a [&'a Panel],
    tree: &'a Tree,
    params: &'a Params,
    accuracy: Accuracy,
    offsets: &'a [usize],
}

/// What may stand in a view.
#[derive(Clone, Copy)]
enum Between<'a> {
    /// Nothing, by proof.
    Nothing,
    /// These polygons, and no others.
    Some(&'a [u32]),
    /// More than are worth listing.
    Many,
}

/// A run of rows while they are made.
struct Rows<'a> {
    range: Range<usize>,
    values: Vec<Vec<f64>>,
    sums: &'a mut Sums,
}

impl Builder<'_> {
    fn run(&self, run: usize, sums: &mut Sums) -> Vec<Vec<f64>> {
        let range = self.tree.clusters[run].range.clone();
        let unknowns = self.offsets[self.panels.len()];
        let row = |place: usize| {
            let first = self.offsets[place];
            vec![0.0; (self.offsets[place + 1] - first) * (unknowns - first)]
        };
        let values = range.clone().map(row).collect();
        let mut rows = Rows { range, values, sums };
        for &root in &self.tree.roots {
            self.meet([run, root], Between::Many, &mut rows);
        }
        rows.values
    }

    /// The blocks of the panels of a cluster with all panels of another that come after them.
    fn meet(&self, pair: [usize; 2], inherited: Between<'_>, rows: &mut Rows<'_>) {
        let [one, other] = pair.map(|cluster| &self.tree.clusters[cluster]);
        if other.range.end <= one.range.start + 1 || one.faces_away(other) {
            return;
        }
        let mut list = Vec::new();
        // Clusters that have panels in common hold each other's blockers.
        let between = if other.range.start < one.range.end && one.range.start < other.range.end {
            Between::Many
        } else {
            let shaft = Shaft::between(&one.hull, &other.hull);
            let between = self.narrowed(&shaft, [u32::MAX; 2], inherited, &mut list);
            if matches!(between, Between::Some(candidates) if self.is_hidden(&shaft, candidates)) {
                return;
            }
            between
        };
        if let Between::Nothing = between {
            self.clear(one.range.clone(), other.range.clone(), rows);
        } else if one.is_leaf() && other.is_leaf() {
            for i in one.range.clone() {
                self.one_by_one(i, other.range.start.max(i + 1)..other.range.end, between, rows);
            }
        } else if other.is_leaf() || (!one.is_leaf() && one.range.len() > other.range.len()) {
            one.children.clone().for_each(|child| self.meet([child, pair[1]], between, rows));
        } else {
            other.children.clone().for_each(|child| self.meet([pair[0], child], between, rows));
        }
    }

    /// What of `inherited` may stand in a shaft, except the polygons of `skip`.
    fn narrowed<'b>(
        &self,
        shaft: &Shaft,
        skip: [u32; 2],
        inherited: Between<'_>,
        list: &'b mut Vec<u32>,
    ) -> Between<'b> {
        list.clear();
        match inherited {
            Between::Nothing => return Between::Nothing,
            Between::Some(candidates) => {
                let may_block = |&&k: &&u32| !skip.contains(&k) && shaft.may_block(self.occluders.polygon(k));
                list.extend(candidates.iter().filter(may_block));
            }
            Between::Many => {
                if self.occluders.candidates(shaft, &skip, list, MAX_CANDIDATES) == ShaftResult::TooMany {
                    return Between::Many;
                }
            }
        }
        if list.is_empty() { Between::Nothing } else { Between::Some(list) }
    }

    /// The occluder that the panel at a place is a part of.
    fn polygon(&self, place: usize) -> u32 {
        self.occluders.of_surface(self.panels[place].surface)
    }

    /// A panel with each of a range: those in clear view side by side, the others on their own.
    fn one_by_one(&self, i: usize, range: Range<usize>, inherited: Between<'_>, rows: &mut Rows<'_>) {
        let mut list = Vec::new();
        let mut clear = 0_u64;
        for j in range.clone() {
            let [a, b] = [i, j].map(|place| self.panels[place]);
            let Some(facing) = Facing::new(&a.patch, &b.patch) else { continue };
            let [on_a, on_b] = facing.polygons();
            let shaft = Shaft::new(on_a, on_b);
            let between = self.narrowed(&shaft, [self.polygon(i), self.polygon(j)], inherited, &mut list);
            match between {
                Between::Nothing => clear |= 1 << (j - range.start),
                Between::Some(candidates) if self.is_hidden(&shaft, candidates) => {}
                _ => {
                    let block = self.partial(i, j, &facing, between);
                    rows.put(self, [i, j], &block, false);
                }
            }
        }
        // Ranges are those of leaves, so that the mask has a bit for each.
        debug_assert!(range.len() <= LEAF);
        self.batch.masked(self.panels[i], range.start, clear, &self.accuracy, |first, found| {
            self.take(i, first, found, rows);
        });
    }

    /// Whether one of the candidates covers the whole view.
    fn is_hidden(&self, shaft: &Shaft, candidates: &[u32]) -> bool {
        candidates.iter().take(MAX_HIDERS).any(|&k| shaft.fully_blocked_by(self.occluders.polygon(k)))
    }

    fn partial(&self, i: usize, j: usize, facing: &Facing, between: Between<'_>) -> Block {
        let (a, b) = (self.panels[i], self.panels[j]);
        let [on_i, on_j] = [i, j].map(|place| self.params.strength(self.tree.order[place] as usize));
        let integrated = |sight| facing_block(a, b, facing, sight, [on_j, on_i], &self.accuracy);
        match between {
            Between::Some(candidates) if candidates.len() <= MAX_CLIPPED => {
                let polygons: Vec<_> = candidates.iter().map(|&k| self.occluders.polygon(k)).collect();
                integrated(Sight::Behind(&polygons))
            }
            _ => {
                let (blockers, skip) = (self.geometry.blockers, [a.surface, b.surface]);
                integrated(Sight::Partial(&|x, y| blockers.occluded_packet(x, y, skip)))
            }
        }
    }

    /// Pairs that are known to see each other.
    fn clear(&self, of: Range<usize>, with: Range<usize>, rows: &mut Rows<'_>) {
        let panels = &self.panels[of.clone()];
        self.batch.blocks(panels, with, &self.accuracy, |k, first, found| self.take(of.start + k, first, found, rows));
    }

    /// Puts what a chunk has found for a panel where it belongs, and integrates the rest.
    fn take(&self, i: usize, first: usize, found: &Found, rows: &mut Rows<'_>) {
        rows.put_lanes(self, i, first, found);
        let mut rest = found.rest;
        while rest != 0 {
            let j = first + rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let (a, b) = (self.panels[i], self.panels[j]);
            let Some(facing) = Facing::new(&a.patch, &b.patch) else { continue };
            let block = facing_block(a, b, &facing, Sight::Clear, [1.0; 2], &self.accuracy);
            rows.put(self, [i, j], &block, true);
        }
    }
}

impl Rows<'_> {
    fn put(&mut self, builder: &Builder<'_>, [i, j]: [usize; 2], block: &Block, clear: bool) {
        self.sums.note([i, j], block, clear);
        let offsets = builder.offsets;
        let width = offsets[builder.panels.len()] - offsets[i];
        let (place, columns) = (offsets[j] - offsets[i], offsets[j + 1] - offsets[j]);
        let row = &mut self.values[i - self.range.start];
        for (k, entries) in block.values().chunks_exact(columns).enumerate() {
            row[k * width + place..][..columns].copy_from_slice(entries);
        }
    }

    fn put_lanes(&mut self, builder: &Builder<'_>, i: usize, first: usize, found: &Found) {
        let offsets = builder.offsets;
        let start = offsets[i];
        let width = offsets[builder.panels.len()] - start;
        let rows = offsets[i + 1] - start;
        let row = &mut self.values[i - self.range.start];
        self.sums.pairs += u64::from(found.done.count_ones());
        self.sums.clear_pairs += u64::from(found.done.count_ones());
        for lane in (0..LANES).filter(|lane| found.done >> lane & 1 == 1) {
            let j = first + lane;
            self.sums.quadrature[i] += found.errors[lane];
            self.sums.quadrature[j] += found.errors[lane];
            let columns = offsets[j + 1] - offsets[j];
            for k in 0..rows {
                for l in 0..columns {
                    row[k * width + offsets[j] - start + l] = found.values[k * columns + l][lane];
                }
            }
        }
    }
}

//! The integration of all pairs, cluster by cluster.
//!
//! A small cluster of the tree over the panels is a run of rows. It meets the tree from the top: what may stand between two
//! clusters is found once, and their parts inherit the proof that nothing does, or the list to be narrowed down. Where
//! the view is clear, all panels of both are integrated side by side ([`Batch`]).

use super::Dense;
use super::sums::{Limits, Sums};
use super::table::{Part, Table};
use super::views::{Between, Views};
use crate::assemble::{Accuracy, Batch, Block, Facing, Found, LANES, Panel, Sight, facing_block};
use crate::exchange::tree::{LEAF, Tree};
use crate::exchange::{Geometry, Params};
use crate::progress::{Interrupted, Progress, Stage};
use crate::visibility::{Body, Occluders};
use rayon::prelude::*;
use std::ops::Range;

/// The runs are dealt to this many strands, each of which adds up its errors in order: fixed, so that sums do not depend
/// on the number of threads.
const STRANDS: usize = 64;

pub(super) fn build(geometry: &Geometry<'_>, params: &Params, progress: &dyn Progress) -> Result<Dense, Interrupted> {
    let tree = Tree::new(geometry.panels());
    let ordered: Vec<&Panel> = tree.order.iter().map(|&panel| &geometry.panels()[panel as usize]).collect();
    let mut dense = Dense::empty(geometry.panels(), &tree.order);
    let (occluders, batch) = rayon::join(|| Occluders::new(geometry.surfaces), || Batch::new(&ordered));
    let builder = Builder {
        views: Views { occluders: &occluders, blockers: geometry.blockers },
        batch: &batch,
        panels: &ordered,
        tree: &tree,
        strengths: &tree.order.iter().map(|&panel| params.strength(panel as usize)).collect::<Vec<_>>(),
        accuracy: params.accuracy(geometry.panels()),
        offsets: &dense.offsets,
        limits: None,
    };
    let mut table = Table::new(dense.lengths());
    let mut strands = builder.strands(&mut table, progress)?;
    let mut total = Sums::new(ordered.len());
    for strand in &strands {
        total.add(&strand.sums);
    }
    let limits = if params.every_row { Limits::of(&total, &ordered, &builder.accuracy) } else { None };
    if let Some(limits) = limits {
        let mended = builder.mend(&limits, &mut strands, progress)?;
        total.replace(&mended, &limits);
    }
    drop(strands);
    let errors = total.row_errors(&ordered, builder.strengths);
    dense.row_errors = dense.place.iter().map(|&place| errors[place as usize]).collect();
    dense.statistics = total.statistics(&ordered, table.bytes());
    dense.table = table;
    Ok(dense)
}

/// The rows of a cluster.
struct Run<'a> {
    cluster: usize,
    rows: Part<'a>,
}

/// Some of the runs, and the sums over their pairs.
struct Strand<'a> {
    runs: Vec<Run<'a>>,
    sums: Sums,
}

/// What the blocks of a run of rows need.
struct Builder<'a> {
    views: Views<'a>,
    batch: &'a Batch<'a>,
    /// In the tree's order.
    panels: &'a [&'a Panel],
    tree: &'a Tree,
    /// Of the light of each.
    strengths: &'a [f64],
    accuracy: Accuracy,
    offsets: &'a [usize],
    /// If given, only partially hidden pairs in one of these rows are integrated.
    limits: Option<&'a Limits>,
}

/// A run of rows while they are made.
struct Rows<'a, 'b> {
    run: &'a mut Part<'b>,
    sums: &'a mut Sums,
    progress: &'a dyn Progress,
}

impl Builder<'_> {
    fn unknowns(&self) -> usize {
        self.offsets[self.panels.len()]
    }

    /// All runs, each with its rows.
    fn strands<'t>(&self, table: &'t mut Table, progress: &dyn Progress) -> Result<Vec<Strand<'t>>, Interrupted> {
        let (clusters, cells) = (self.tree.runs(), self.panels.len());
        let parts = table.parts(clusters.iter().map(|&cluster| self.tree.clusters[cluster].range.clone()));
        let mut strands: Vec<Vec<Run<'t>>> = (0..STRANDS).map(|_| Vec::new()).collect();
        for (k, (&cluster, rows)) in clusters.iter().zip(parts).enumerate() {
            strands[k % STRANDS].push(Run { cluster, rows });
        }
        let stage = Stage::begin(progress, "form factors", (cells * cells.saturating_sub(1) / 2) as u64);
        let integrated = |mut runs: Vec<Run<'t>>| {
            let mut sums = Sums::new(cells);
            for run in &mut runs {
                self.integrate(run, &mut sums, progress)?;
            }
            Ok(Strand { runs, sums })
        };
        let strands = strands.into_par_iter().with_max_len(1).map(integrated).collect::<Result<_, _>>()?;
        drop(stage);
        Ok(strands)
    }

    /// Integrates the partially hidden pairs of rows that have limits once more, and returns the sums over these pairs.
    fn mend(&self, limits: &Limits, strands: &mut [Strand<'_>], progress: &dyn Progress) -> Result<Sums, Interrupted> {
        let (again, cells) = (Builder { limits: Some(limits), ..*self }, self.panels.len());
        let stage = Stage::begin(progress, "shadows", (cells * cells.saturating_sub(1) / 2) as u64);
        let mend = |strand: &mut Strand<'_>| {
            let mut sums = Sums::new(cells);
            for run in &mut strand.runs {
                again.integrate(run, &mut sums, progress)?;
            }
            Ok(sums)
        };
        let all: Vec<Sums> = strands.par_iter_mut().with_max_len(1).map(mend).collect::<Result<_, _>>()?;
        drop(stage);
        let mut total = Sums::new(cells);
        for sums in &all {
            total.add(sums);
        }
        Ok(total)
    }

    fn integrate(&self, run: &mut Run<'_>, sums: &mut Sums, progress: &dyn Progress) -> Result<(), Interrupted> {
        let steps = run.rows.range.clone().map(|place| (self.panels.len() - 1 - place) as u64).sum();
        let mut rows = Rows { run: &mut run.rows, sums, progress };
        for &root in &self.tree.roots {
            self.meet([run.cluster, root], Between::Many, &mut rows)?;
        }
        progress.advance(steps);
        Ok(())
    }

    /// The blocks of the panels of a cluster with all panels of another that come after them. Shadows may take minutes for
    /// a run of rows, so here is where work is interrupted.
    fn meet(&self, pair: [usize; 2], inherited: Between<'_>, rows: &mut Rows<'_, '_>) -> Result<(), Interrupted> {
        if rows.progress.interrupted() {
            return Err(Interrupted);
        }
        let [one, other] = pair.map(|cluster| &self.tree.clusters[cluster]);
        if other.range.end <= one.range.start + 1
            || one.sees_nothing_of(other)
            || !self.wants([&one.range, &other.range])
        {
            return Ok(());
        }
        let mut list = Vec::new();
        // Clusters that have panels in common hold each other's blockers.
        let between = if other.range.start < one.range.end && one.range.start < other.range.end {
            Between::Many
        } else {
            match self.views.between([&one.hull, &other.hull], [u32::MAX; 2], inherited, &mut list) {
                Some(between) => between,
                None => return Ok(()),
            }
        };
        if let Between::Nothing = between {
            self.clear(one.range.clone(), other.range.clone(), rows);
        } else if one.is_leaf() && other.is_leaf() {
            for i in one.range.clone() {
                self.one_by_one(i, other.range.start.max(i + 1)..other.range.end, between, rows);
            }
        } else if other.is_leaf() || (!one.is_leaf() && one.range.len() > other.range.len()) {
            one.children.clone().try_for_each(|child| self.meet([child, pair[1]], between, rows))?;
        } else {
            other.children.clone().try_for_each(|child| self.meet([pair[0], child], between, rows))?;
        }
        Ok(())
    }

    /// Whether there is something to do for the places of either range.
    fn wants(&self, ranges: [&Range<usize>; 2]) -> bool {
        self.limits.is_none_or(|limits| ranges.into_iter().any(|range| limits.any_in(range)))
    }

    /// A panel with each of a range: those in clear view side by side, the others on their own.
    fn one_by_one(&self, i: usize, range: Range<usize>, inherited: Between<'_>, rows: &mut Rows<'_, '_>) {
        let mut list = Vec::new();
        let mut clear = 0_u64;
        for j in range.clone().filter(|&j| self.wants([&(i..i + 1), &(j..j + 1)])) {
            let [a, b] = [i, j].map(|place| self.panels[place]);
            let Some(facing) = Facing::new(&a.patch, &b.patch) else { continue };
            let ends = facing.polygons().map(Body::polygon);
            let skip = [a, b].map(|panel| self.views.polygon(panel));
            match self.views.between([&ends[0], &ends[1]], skip, inherited, &mut list) {
                None => {}
                Some(Between::Nothing) => clear |= 1 << (j - range.start),
                Some(between) => self.partial([i, j], &facing, between, rows),
            }
        }
        // Ranges are those of leaves, so that the mask has a bit for each.
        debug_assert!(range.len() <= LEAF);
        if self.limits.is_some() {
            return;
        }
        self.batch.masked(i, range.start, clear, &self.accuracy, |first, found| {
            self.take(i, first, found, rows);
        });
    }

    fn partial(&self, places: [usize; 2], facing: &Facing, between: Between<'_>, rows: &mut Rows<'_, '_>) {
        let strengths = places.map(|place| self.strengths[place]);
        // What reaches the one is as strong as the other.
        let ([a, b], weights) = (places.map(|place| self.panels[place]), [strengths[1], strengths[0]]);
        let shadows = self.limits.map_or(self.accuracy.shadows, |limits| limits.of_pair(places));
        let accuracy = Accuracy { shadows, ..self.accuracy };
        let block = self.views.block([a, b], facing, between, weights, &accuracy);
        rows.sums.note_partial(places, strengths, &block, accuracy.shadow_scale(a, b, weights, block.sum()));
        rows.put(self, places, &block);
    }

    /// Pairs that are known to see each other.
    fn clear(&self, of: Range<usize>, with: Range<usize>, rows: &mut Rows<'_, '_>) {
        if self.limits.is_some() {
            return;
        }
        self.batch.blocks(of, with, &self.accuracy, |i, first, found| self.take(i, first, found, rows));
    }

    /// Puts what a chunk has found for a panel where it belongs, and integrates the rest.
    fn take(&self, i: usize, first: usize, found: &Found, rows: &mut Rows<'_, '_>) {
        rows.put_lanes(self, i, first, found);
        let mut rest = found.rest;
        while rest != 0 {
            let j = first + rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let (a, b) = (self.panels[i], self.panels[j]);
            let Some(facing) = Facing::new(&a.patch, &b.patch) else { continue };
            let block = facing_block(a, b, &facing, Sight::Clear, [1.0; 2], &self.accuracy);
            rows.sums.note_clear([i, j], [i, j].map(|place| self.strengths[place]), &block);
            rows.put(self, [i, j], &block);
        }
    }
}

impl Rows<'_, '_> {
    fn put(&mut self, builder: &Builder<'_>, [i, j]: [usize; 2], block: &Block) {
        let offsets = builder.offsets;
        let width = offsets[builder.panels.len()] - offsets[i];
        let (place, columns) = (offsets[j] - offsets[i], offsets[j + 1] - offsets[j]);
        let row = self.run.row_mut(i);
        for (k, entries) in block.values().chunks_exact(columns).enumerate() {
            row[k * width + place..][..columns].copy_from_slice(entries);
        }
    }

    fn put_lanes(&mut self, builder: &Builder<'_>, i: usize, first: usize, found: &Found) {
        let offsets = builder.offsets;
        if found.done == u32::MAX >> (32 - LANES) && offsets.len() == builder.unknowns() + 1 {
            // Eight constants side by side.
            self.sums.pairs += LANES as u64;
            self.sums.clear_pairs += LANES as u64;
            self.run.row_mut(i)[first - i..][..LANES].copy_from_slice(&found.values[0]);
            self.sums.note_errors(i, first, builder.strengths, &found.errors);
            return;
        }
        let start = offsets[i];
        let width = offsets[builder.panels.len()] - start;
        let rows = offsets[i + 1] - start;
        let row = self.run.row_mut(i);
        self.sums.pairs += u64::from(found.done.count_ones());
        self.sums.clear_pairs += u64::from(found.done.count_ones());
        for lane in (0..LANES).filter(|lane| found.done >> lane & 1 == 1) {
            let j = first + lane;
            self.sums.note_error([i, j], [i, j].map(|place| builder.strengths[place]), found.errors[lane]);
            let columns = offsets[j + 1] - offsets[j];
            for k in 0..rows {
                for l in 0..columns {
                    row[k * width + offsets[j] - start + l] = found.values[k * columns + l][lane];
                }
            }
        }
    }
}

//! All pairs, stored: the reference for every other operator.
//!
//! S is symmetric, so only the blocks on and above the diagonal are kept, each cell's rows in one run: 4 n² bytes for n
//! unknowns in f64. (f32 would halve that and cap the row sums at seven digits; closed scenes balance power to nine.)
//! A product reads every coefficient once and uses it twice, for all bands.

use super::{Exchange, ExchangeError, Geometry, Params, Statistics};
use crate::assemble::{Accuracy, Block, Facing, Panel, Sight, facing_block};
use crate::linalg::{LinearOperator, MultiVector};
use crate::progress::{Interrupted, Progress};
use crate::visibility::{Shaft, ShaftResult, Visibility};
use glam::DVec3;
use rayon::prelude::*;

/// A product is cut into this many runs of rows, each with its own result, added in order: fixed, so that sums do not
/// depend on the number of threads.
const RUNS: usize = 32;
/// More possible blockers than this between two cells are not listed; rays then search the whole tree.
const MAX_CANDIDATES: usize = 48;
/// So many of the listed blockers are tried for hiding the whole view.
const MAX_HIDERS: usize = 8;

/// The upper triangle of S.
#[derive(Debug)]
pub struct Dense {
    /// First unknown of each cell, and their number.
    offsets: Vec<usize>,
    /// For each cell, its rows from its own first column on.
    rows: Vec<Vec<f64>>,
    statistics: Statistics,
}

impl Dense {
    /// The word that selects it.
    pub const NAME: &'static str = "dense";

    /// Bytes that the coefficients of so many unknowns take.
    pub const fn bytes(unknowns: usize) -> usize {
        unknowns.saturating_mul(unknowns + 1) / 2 * size_of::<f64>()
    }

    /// Integrates all pairs.
    ///
    /// # Errors
    /// [`ExchangeError::TooLarge`] before any work if the memory would not do, [`ExchangeError::Interrupted`].
    pub fn new(geometry: &Geometry<'_>, params: &Params, progress: &dyn Progress) -> Result<Self, ExchangeError> {
        let offsets = geometry.space.offsets().to_vec();
        let unknowns = geometry.space.broken_dofs();
        let bytes = Self::bytes(unknowns);
        if bytes > params.memory {
            return Err(ExchangeError::TooLarge { unknowns, bytes, limit: params.memory });
        }
        let panels = geometry.panels();
        let total_area = panels.iter().map(Panel::area).sum();
        let accuracy =
            Accuracy { tolerance: params.tolerance, total_area, max_rays: params.max_rays, seed: params.seed };
        let build = Builder { geometry, panels, params, accuracy, offsets: &offsets };
        progress.begin("form factors", (panels.len() * panels.len().saturating_sub(1) / 2) as u64);
        // `with_max_len(1)`: rows shrink towards the end, so they are handed out one by one.
        let rows: Result<Vec<Row>, Interrupted> = (0..panels.len())
            .into_par_iter()
            .with_max_len(1)
            .map(|cell| if progress.interrupted() { Err(Interrupted) } else { Ok(build.row(cell, progress)) })
            .collect();
        let rows = rows?;
        progress.end();
        let statistics = summarize(panels, &rows);
        Ok(Self { offsets, rows: rows.into_iter().map(|row| row.values).collect(), statistics })
    }

    /// The sum of the block of two cells, A_i F_ij for the constants' view factor: by symmetry either way round.
    pub fn exchange_area(&self, i: usize, j: usize) -> f64 {
        let (i, j) = (i.min(j), i.max(j));
        let width = self.offsets[self.offsets.len() - 1] - self.offsets[i];
        let columns = self.offsets[j] - self.offsets[i]..self.offsets[j + 1] - self.offsets[i];
        self.rows[i].chunks_exact(width).map(|row| row[columns.clone()].iter().sum::<f64>()).sum()
    }

    /// One entry.
    pub fn entry(&self, row: usize, column: usize) -> f64 {
        let (row, column) = (row.min(column), row.max(column));
        let cell = self.offsets.partition_point(|&first| first <= row) - 1;
        let first = self.offsets[cell];
        self.rows[cell][(row - first) * (self.rows() - first) + column - first]
    }

    /// Adds what the rows of a run of cells contribute to y = S x, in one band.
    fn apply_rows(&self, cells: std::ops::Range<usize>, x: &[f64], y: &mut [f64]) {
        for cell in cells {
            let (first, end) = (self.offsets[cell], self.offsets[cell + 1]);
            for (k, row) in self.rows[cell].chunks_exact(x.len() - first).enumerate() {
                // The diagonal block is zero: a planar cell does not see itself.
                let off = end - first;
                y[first + k] += symmetric_row(&row[off..], &x[end..], x[first + k], &mut y[end..]);
            }
        }
    }
}

/// Returns s·x and adds xi s to y: both uses of a row of the upper triangle.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn symmetric_row(s: &[f64], x: &[f64], xi: f64, y: &mut [f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let (s8, s_rest) = s.as_chunks::<8>();
    let (x8, x_rest) = x[..s.len()].as_chunks::<8>();
    let (y8, y_rest) = y[..s.len()].as_chunks_mut::<8>();
    for ((s, x), y) in s8.iter().zip(x8).zip(y8) {
        for lane in 0..8 {
            lanes[lane] += s[lane] * x[lane];
            y[lane] += xi * s[lane];
        }
    }
    let mut sum: f64 = lanes.iter().sum();
    for ((s, x), y) in s_rest.iter().zip(x_rest).zip(y_rest) {
        sum += s * x;
        *y += xi * s;
    }
    sum
}

impl LinearOperator for Dense {
    fn rows(&self) -> usize {
        self.offsets[self.offsets.len() - 1]
    }

    fn cols(&self) -> usize {
        self.rows()
    }

    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        let cells = self.rows.len();
        // Equal shares of the triangle: row c has a length of about n − c.
        let bound = |run: usize| {
            let left = 1.0 - run as f64 / RUNS as f64;
            (cells as f64 * (1.0 - left.sqrt())).round() as usize
        };
        let parts: Vec<MultiVector> = (0..RUNS)
            .into_par_iter()
            .map(|run| {
                let mut part = MultiVector::zeros(x.rows(), x.bands());
                for cell in bound(run)..bound(run + 1) {
                    for band in 0..x.bands() {
                        self.apply_rows(cell..cell + 1, x.band(band), part.band_mut(band));
                    }
                }
                part
            })
            .collect();
        y.as_mut_slice().fill(0.0);
        for part in &parts {
            y.add_scaled(1.0, part);
        }
    }
}

impl Exchange for Dense {
    fn kind(&self) -> &'static str {
        Self::NAME
    }

    fn statistics(&self) -> Statistics {
        self.statistics
    }
}

/// What the blocks of one row of cells need.
struct Builder<'a> {
    geometry: &'a Geometry<'a>,
    panels: &'a [Panel],
    params: &'a Params,
    accuracy: Accuracy,
    offsets: &'a [usize],
}

/// The rows of one cell, and what they cost.
struct Row {
    values: Vec<f64>,
    rays: u64,
    pairs: u64,
    clear_pairs: u64,
    /// (other cell, quadrature error, square of the visibility error)
    errors: Vec<(u32, f32, f32)>,
}

impl Builder<'_> {
    fn row(&self, i: usize, progress: &dyn Progress) -> Row {
        let n = self.panels[i].element.dofs();
        let (first, unknowns) = (self.offsets[i], self.offsets[self.panels.len()]);
        let width = unknowns - first;
        let values = vec![0.0; n * width];
        let mut row = Row { values, rays: 0, pairs: 0, clear_pairs: 0, errors: Vec::new() };
        let mut sights = Sights::new(self.geometry, &self.panels[i]);
        for j in i + 1..self.panels.len() {
            let Some(block) = self.block(i, j, &mut sights) else { continue };
            row.rays += u64::from(block.rays);
            // That no ray came through is an estimate, too.
            row.errors.push((j as u32, block.quadrature_error as f32, block.visibility_error.powi(2) as f32));
            if block.sum() == 0.0 {
                continue;
            }
            row.pairs += 1;
            row.clear_pairs += u64::from(block.rays == 0);
            let columns = self.panels[j].element.dofs();
            let place = self.offsets[j] - first;
            for (k, entries) in block.values().chunks_exact(columns).enumerate() {
                row.values[k * width + place..k * width + place + columns].copy_from_slice(entries);
            }
        }
        progress.advance((self.panels.len() - 1 - i) as u64);
        row
    }

    /// The block of a pair, `None` if they are known not to see each other.
    fn block(&self, i: usize, j: usize, sights: &mut Sights<'_>) -> Option<Block> {
        let (a, b) = (&self.panels[i], &self.panels[j]);
        let strengths = [self.params.strength(j), self.params.strength(i)];
        let blockers = self.geometry.blockers;
        let skip = [a.surface, b.surface];
        let through_tree = |x: DVec3, y: DVec3| blockers.occluded(x, y, skip);
        let (facing, between) = sights.to(b)?;
        let block = |sight| facing_block(a, b, &facing, sight, strengths, &self.accuracy);
        let block = match between {
            Between::Clear => block(Sight::Clear),
            Between::Some(candidates) => block(Sight::Partial(&|x, y| blockers.occluded_by(x, y, candidates))),
            Between::Many => block(Sight::Partial(&through_tree)),
        };
        Some(block)
    }
}

/// What may stand between a cell and another.
enum Between<'a> {
    Clear,
    Some(&'a [u32]),
    Many,
}

/// The sight from one cell to all others. What may stand in the way is found once for each face of the input; its cells,
/// which follow each other, inherit the proof that nothing does, or the list to be narrowed down.
struct Sights<'a> {
    geometry: &'a Geometry<'a>,
    from: &'a Panel,
    /// The face, and which of its sides (the sign of the normal against the face's), for which `to_surface` and
    /// `inherited` hold: a cell that straddles the plane of a sheet sees either side with another part of itself.
    side: Option<(u32, bool)>,
    to_surface: ShaftResult,
    inherited: Vec<u32>,
    candidates: Vec<u32>,
}

impl<'a> Sights<'a> {
    fn new(geometry: &'a Geometry<'a>, from: &'a Panel) -> Self {
        let to_surface = ShaftResult::Empty;
        Self { geometry, from, side: None, to_surface, inherited: Vec::new(), candidates: Vec::new() }
    }

    /// `None` if the panels face away from each other, or one face of the input hides them from each other.
    fn to(&mut self, other: &Panel) -> Option<(Facing, Between<'_>)> {
        let facing = Facing::new(&self.from.patch, &other.patch)?;
        let face = self.geometry.surfaces[other.surface as usize].patch(DVec3::ZERO);
        let side = Some((other.surface, face.normal().dot(other.normal()) > 0.0));
        if self.side != side {
            self.side = side;
            self.look_at_surface(other);
        }
        if self.to_surface == ShaftResult::Empty {
            return Some((facing, Between::Clear));
        }
        let [on_from, on_other] = facing.polygons();
        let shaft = Shaft::new(on_from, on_other);
        self.candidates.clear();
        if self.to_surface == ShaftResult::Candidates {
            let blockers = self.geometry.blockers;
            let may_block = |&t: &u32| blockers.triangle(t).is_some_and(|(corners, _)| shaft.may_block(&corners));
            self.candidates.extend(self.inherited.iter().copied().filter(may_block));
        } else {
            let skip = [self.from.surface, other.surface];
            let found = self.geometry.blockers.shaft_candidates(&shaft, &skip, &mut self.candidates, MAX_CANDIDATES);
            if found == ShaftResult::TooMany {
                return Some((facing, Between::Many));
            }
        }
        if self.candidates.is_empty() {
            return Some((facing, Between::Clear));
        }
        if self.is_hidden(&shaft) {
            return None;
        }
        Some((facing, Between::Some(&self.candidates)))
    }

    /// Whether one of the candidates' faces covers the whole view.
    fn is_hidden(&self, shaft: &Shaft) -> bool {
        let mut tried = u32::MAX;
        self.candidates.iter().take(MAX_HIDERS).any(|&candidate| {
            let Some((_, surface)) = self.geometry.blockers.triangle(candidate) else { return false };
            // The triangles of a face often follow each other.
            if std::mem::replace(&mut tried, surface) == surface {
                return false;
            }
            let face = &self.geometry.surfaces[surface as usize];
            shaft.fully_blocked_by(face.corners())
        })
    }

    /// Finds what may stand between the cell and the whole face that another belongs to.
    fn look_at_surface(&mut self, other: &Panel) {
        self.inherited.clear();
        let face = self.geometry.surfaces[other.surface as usize].patch(other.normal());
        let Some(facing) = Facing::new(&self.from.patch, &face) else {
            self.to_surface = ShaftResult::TooMany;
            return;
        };
        let [on_from, on_face] = facing.polygons();
        let shaft = Shaft::new(on_from, on_face);
        let skip = [self.from.surface, other.surface];
        self.to_surface = self.geometry.blockers.shaft_candidates(&shaft, &skip, &mut self.inherited, MAX_CANDIDATES);
    }
}

/// Counts, and the errors of the worst row.
fn summarize(panels: &[Panel], rows: &[Row]) -> Statistics {
    let mut quadrature = vec![0.0; panels.len()];
    let mut visibility = vec![0.0; panels.len()];
    for (i, row) in rows.iter().enumerate() {
        for &(j, q, v) in &row.errors {
            for cell in [i, j as usize] {
                quadrature[cell] += f64::from(q);
                visibility[cell] += f64::from(v);
            }
        }
    }
    let worst = |errors: &mut dyn Iterator<Item = f64>| {
        errors.zip(panels).map(|(error, panel)| error / panel.area()).fold(0.0, f64::max)
    };
    Statistics {
        bytes: rows.iter().map(|row| row.values.len() * size_of::<f64>()).sum(),
        rays: rows.iter().map(|row| row.rays).sum(),
        pairs: rows.iter().map(|row| row.pairs).sum(),
        clear_pairs: rows.iter().map(|row| row.clear_pairs).sum(),
        quadrature_error: worst(&mut quadrature.iter().copied()),
        visibility_error: worst(&mut visibility.iter().map(|v| v.sqrt())),
    }
}

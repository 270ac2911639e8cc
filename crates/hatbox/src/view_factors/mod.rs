//! View factors: which fraction of what leaves one surface reaches another.
//!
//! F is the exchange operator in the basis of constants, divided by the area: `F_ij = S_ij / A_i`. For groups of
//! elements `A_g F_gh = Σ S_ij` over their members. S is symmetric, and so reciprocity `A_i F_ij = A_j F_ji` holds to
//! rounding.
//!
//! The row sums are *not* forced to anything unless [`Options::closure`] asks for it, so that their error is an honest
//! measure of the accuracy. What a closure or a threshold changes is reported ([`ViewFactors::closure`],
//! [`ViewFactors::threshold`]).

mod check;
mod closure;
mod groups;
mod matrix;
mod memory;
mod threshold;

pub use check::{Check, Distribution, RowCheck};
pub use closure::{CLOSURES, Closed, ClosureMethod, ClosureMethodKind};
pub use memory::Estimate;
pub use threshold::Thinned;

use crate::assemble::{Accuracy, Panel, Sight, pair_block};
use crate::element::{ALL, Basis};
use crate::exchange::{self, Dense, Exchange, ExchangeError, Geometry, Statistics};
use crate::mesh::{RefineError, Refinement};
use crate::progress::{Interrupted, Progress};
use crate::scene::Scene;
use crate::space::{FunctionSpace, NoElement};
use crate::visibility::{Bvh, Visibility};
use groups::Grouping;
use matrix::Matrix;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// One constant function per element, on triangles and quads alike.
const BASIS: &Basis = &ALL[0];
/// Rows that are made together, and so many blocks of them at a time for each thread.
const BLOCK: usize = 32;
const BLOCKS: usize = 2;
/// So many pairs are integrated a second time, the other way round, with so many rays at most: a look, not a second result.
const REVERSED: u64 = 32;
const REVERSED_RAYS: u32 = 1 << 14;
/// The most rays of a pair behind more polygons than are cut out.
const MAX_RAYS: u32 = 1 << 20;
/// The most rays that measure what escapes when a closure needs it, unless there are very many elements: some seconds.
const MAX_ESCAPE_RAYS: f64 = 4e6;

/// Between what view factors are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Between {
    /// Every element is a surface.
    #[default]
    Elements,
    /// Every named part of the mesh is one.
    Groups,
    /// All elements of a material are one.
    Materials,
}

/// What a user chooses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Between what.
    pub between: Between,
    /// How the mesh is subdivided; by default each face is one element.
    pub refinement: Refinement,
    /// Relative error that the sum of a row may have.
    pub tolerance: f64,
    /// Seed of all sampling.
    pub seed: u64,
    /// How the row sums are made right; by default not at all.
    pub closure: ClosureMethodKind,
    /// Pairs of which neither factor reaches this are dropped, and the others made up for it; 0 drops nothing.
    pub threshold: f64,
    /// The most bytes that the work may take, if there is a limit.
    pub memory: Option<u64>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            between: Between::Elements,
            refinement: Refinement::None,
            tolerance: 1e-2,
            seed: 0,
            closure: ClosureMethodKind::None,
            threshold: 0.0,
            memory: None,
        }
    }
}

/// Why there are no view factors.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Error {
    /// The mesh cannot be subdivided as asked.
    #[error(transparent)]
    Refine(#[from] RefineError),
    /// The work would take more memory than it may.
    #[error(
        "view factors between {elements} elements take about {} MB, more than the {} MB there are; use fewer or larger \
         elements",
        bytes.div_ceil(1_000_000),
        limit / 1_000_000
    )]
    Memory {
        /// Number of elements.
        elements: usize,
        /// Bytes that they would take.
        bytes: u64,
        /// Bytes that they may take.
        limit: u64,
    },
    /// The basis has no element for a cell.
    #[error(transparent)]
    NoElement(#[from] NoElement),
    /// The exchange areas were not computed.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
    /// The threshold is no fraction.
    #[error("a threshold of {0} is not between 0 and 1")]
    Threshold(f64),
}

impl From<Interrupted> for Error {
    fn from(interrupted: Interrupted) -> Self {
        Self::Exchange(interrupted.into())
    }
}

/// An element or a group of elements.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// The name of its part or material; where a part has several elements, with its number among them.
    pub name: String,
    /// Its area in m².
    pub area: f64,
    /// ε = 1 − R, the mean over its area and the bands.
    pub emittance: f64,
    /// The measured fraction of its light that leaves the scene or ends on a side that receives none; 0 in a closed
    /// scene.
    pub escape: f64,
    /// How far that may be wrong: three standard deviations of its rays; 0 where no ray of any surface got out, and the scene
    /// passes for closed.
    pub escape_error: f64,
}

impl Surface {
    /// What a row is to sum to that sums to so much: what does not escape, as far as the rays know it.
    fn closed_sum(&self, sum: f64) -> f64 {
        sum.clamp(1.0 - self.escape - self.escape_error, 1.0 - self.escape + self.escape_error).min(1.0)
    }
}

/// What escapes from each element, and how far that may be wrong.
struct Escapes {
    fractions: Vec<f64>,
    errors: Vec<f64>,
}

/// The view factors of a scene.
#[derive(Debug)]
pub struct ViewFactors {
    /// The surfaces, in the order of rows and columns.
    pub surfaces: Vec<Surface>,
    /// Number of elements they consist of.
    pub elements: usize,
    /// Fraction of rays that leave the scene or end on a back, by area, from elements that nothing covers; 0 in a closed scene.
    pub escape: f64,
    /// What the exchange areas cost and how far they may be wrong.
    pub statistics: Statistics,
    /// What was asked for.
    pub tolerance: f64,
    /// The greatest difference between an exchange area and the same integral with the roles of its two elements
    /// exchanged, over a sample of pairs; relative to the greater of A_i F_ij and A_i A_j / A, which is what the tolerance
    /// refers to. It is an error of the integrals: the matrix itself is symmetric. The second look takes 2¹⁴ rays at the most: behind
    /// many polygons it errs more than what it looks at.
    pub reversed_error: f64,
    /// The time that it took to subdivide the scene.
    pub meshing: Duration,
    /// What the closure did, if there was one.
    pub closure: Option<Closed>,
    /// What the threshold did, if there was one.
    pub threshold: Option<Thinned>,
    matrix: Matrix,
}

impl ViewFactors {
    /// Computes the view factors of a scene.
    ///
    /// # Errors
    /// [`Error`]; too large a scene is refused before any work.
    pub fn new(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Self, Error> {
        if !(0.0..=1.0).contains(&options.threshold) {
            return Err(Error::Threshold(options.threshold));
        }
        Estimate::of(scene, options)?.check(options.memory)?;
        let started = Instant::now();
        let scene = scene.refined(options.refinement, BASIS)?;
        let meshing = started.elapsed();
        Estimate::new(scene.mesh.cells.len()).check(options.memory)?;
        let space = FunctionSpace::broken(&scene.mesh, BASIS)?;
        let (cells, blockers) = (OnceLock::new(), Arc::new(Bvh::of_surfaces(&scene.surfaces)));
        let geometry = Geometry::new(&scene, &space, &blockers, &cells);
        let panels = geometry.panels();
        let escapes = escapes(&geometry, options, progress)?;
        let standard = exchange::Params::new(options.tolerance);
        let memory = options.memory.map_or(standard.memory, |limit| limit as usize);
        let params = exchange::Params { every_row: true, max_rays: MAX_RAYS, seed: options.seed, memory, ..standard };
        let dense = Dense::new(&geometry, &params, progress)?;
        let source = Source { geometry, accuracy: params.accuracy(panels) };
        let (statistics, reversed_error) = (dense.statistics(), source.reversed_error(&dense));
        let grouping = Grouping::new(&scene, options.between);
        let mut found = Self {
            surfaces: grouping.surfaces(&scene, &escapes),
            elements: panels.len(),
            escape: mean(panels, &escapes.fractions),
            statistics,
            tolerance: options.tolerance,
            reversed_error,
            meshing,
            closure: None,
            threshold: None,
            matrix: grouping.matrix(dense),
        };
        found.adjust(options, &source, &grouping, progress)?;
        Ok(found)
    }

    /// Carries out the closure and the threshold.
    fn adjust(
        &mut self,
        options: &Options,
        source: &Source<'_>,
        grouping: &Grouping,
        progress: &dyn Progress,
    ) -> Result<(), Interrupted> {
        // Where every pair is proven clear, there is nothing to keep below the unobstructed factors.
        let clear = self.statistics.clear_pairs == self.statistics.pairs;
        let bound = |i, j| grouping.unobstructed(source, i, j);
        let limits = (!clear).then_some(closure::Limits { bound: &bound, integrated: None });
        if options.closure != ClosureMethodKind::None {
            let sums = closure::sums(&self.matrix, &self.surfaces);
            let targets = self.surfaces.iter().zip(sums).map(|(surface, sum)| surface.area * surface.closed_sum(sum));
            let targets: Vec<f64> = targets.collect();
            let closed = closure::close(&mut self.matrix, &self.surfaces, &targets, options.closure, limits, progress)?;
            self.closure = Some(closed);
        }
        if options.threshold > 0.0 {
            let method = match options.closure {
                ClosureMethodKind::None => ClosureMethodKind::Scaling,
                method => method,
            };
            let thinned =
                threshold::thin(&mut self.matrix, &self.surfaces, options.threshold, method, limits, progress)?;
            self.threshold = Some(thinned);
        }
        Ok(())
    }

    /// Number of surfaces.
    pub fn len(&self) -> usize {
        self.surfaces.len()
    }

    /// Whether there are no surfaces.
    pub fn is_empty(&self) -> bool {
        self.surfaces.is_empty()
    }

    /// `F_ij`, the fraction of what leaves surface i that reaches surface j.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        self.matrix.get(i, j) / self.surfaces[i].area
    }

    /// `F_ij` for all j.
    pub fn row(&self, i: usize) -> impl Iterator<Item = f64> + '_ {
        let mut row = vec![0.0; self.len()];
        self.matrix.fill_rows(i..i + 1, &mut row);
        row.into_iter().map(move |exchanged| exchanged / self.surfaces[i].area)
    }

    /// `F_ij` and j for all j where it is not zero, in order.
    pub fn nonzeros(&self, i: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.matrix.entries(i).into_iter().map(move |(j, exchanged)| (j as usize, exchanged / self.surfaces[i].area))
    }

    /// What `of` makes of each row, in order: `F_ij` for all j. All threads make some rows at a time.
    pub fn map_rows<T: Send>(&self, of: impl Fn(usize, &[f64]) -> T + Sync) -> impl Iterator<Item = T> {
        self.map_blocks(move |rows| {
            let mut whole = vec![0.0; rows.len() * self.len()];
            self.matrix.fill_rows(rows.clone(), &mut whole);
            let made = rows.zip(whole.chunks_exact_mut(self.len())).map(|(i, row)| {
                let area = self.surfaces[i].area;
                for value in row.iter_mut() {
                    *value /= area;
                }
                of(i, row)
            });
            made.collect()
        })
    }

    /// What `of` makes of each row, in order: j and `F_ij` for all j where it is not zero. All threads make some rows at a
    /// time.
    pub fn map_nonzeros<T: Send>(&self, of: impl Fn(usize, &[(u32, f64)]) -> T + Sync) -> impl Iterator<Item = T> {
        self.map_blocks(move |rows| {
            let made = rows.clone().zip(self.matrix.entries_of(rows)).map(|(i, mut row)| {
                let area = self.surfaces[i].area;
                for (_, value) in &mut row {
                    *value /= area;
                }
                of(i, &row)
            });
            made.collect()
        })
    }

    /// What `of` makes of blocks of rows, in order.
    fn map_blocks<T: Send>(&self, of: impl Fn(Range<usize>) -> Vec<T> + Sync) -> impl Iterator<Item = T> {
        let (n, most) = (self.len(), BLOCK * BLOCKS * rayon::current_num_threads());
        (0..n).step_by(most).flat_map(move |first| {
            let blocks = (first..n.min(first + most)).into_par_iter().step_by(BLOCK);
            blocks.flat_map_iter(|start| of(start..n.min(start + BLOCK))).collect::<Vec<T>>()
        })
    }

    /// Whether neither rules nor rays, each for itself, are estimated to err by more than was asked for in any row. Where they
    /// are, smaller elements help, which have less between them.
    pub fn is_reached(&self) -> bool {
        // Where every pair errs by what it may, so does the row, but for rounding.
        const ROUNDING: f64 = 1e-6;
        let Statistics { quadrature_error, visibility_error, .. } = self.statistics;
        quadrature_error.max(visibility_error) <= self.tolerance * (1.0 + ROUNDING)
    }

    /// Whether no ray leaves the scene.
    pub fn is_closed(&self) -> bool {
        self.escape == 0.0
    }

    /// Bytes that the factors take in memory.
    pub fn bytes(&self) -> usize {
        self.matrix.bytes()
    }
}

/// What escapes from each element. A closure that aims at it needs it more accurately: three standard deviations of the rays
/// are not to exceed the tolerance, if [`MAX_ESCAPE_RAYS`] do for that.
fn escapes(geometry: &Geometry<'_>, options: &Options, progress: &dyn Progress) -> Result<Escapes, Interrupted> {
    let (cells, covered) = (geometry.panels().len(), geometry.covered());
    let mut rays = 0;
    let mut fractions = exchange::escapes(geometry, rays, options.seed, progress)?;
    if fractions.iter().zip(covered).all(|(&escape, &covered)| covered || escape == 0.0) {
        return Ok(Escapes { errors: vec![0.0; cells], fractions });
    }
    if options.closure != ClosureMethodKind::None {
        // The deviation of one ray is a half at the most.
        let wanted = (exchange::scatter(0.5, 1.0) / options.tolerance).powi(2);
        rays = wanted.min(MAX_ESCAPE_RAYS / cells.max(1) as f64) as u32;
        fractions = exchange::escapes(geometry, rays, options.seed, progress)?;
    }
    let count = f64::from(exchange::rays_per_cell(cells, rays));
    // A ray more or less is always possible.
    let error = |(&escape, &covered): (&f64, &bool)| {
        if covered { 0.0 } else { exchange::scatter(escape, count).max(1.0 / count) }
    };
    Ok(Escapes { errors: fractions.iter().zip(covered).map(error).collect(), fractions })
}

/// The mean over the area that nothing covers.
fn mean(panels: &[Panel], fractions: &[f64]) -> f64 {
    let seeing = || panels.iter().zip(fractions).filter(|(panel, _)| !panel.covered);
    let area: f64 = seeing().map(|(panel, _)| panel.area()).sum();
    let sum: f64 = seeing().map(|(panel, fraction)| panel.area() * fraction).sum();
    if area > 0.0 { sum / area } else { 0.0 }
}

/// Where single pairs can be integrated again.
struct Source<'a> {
    geometry: Geometry<'a>,
    accuracy: Accuracy,
}

impl Source<'_> {
    /// `A_i F_ij` if nothing stood between two elements.
    fn unobstructed(&self, i: usize, j: usize) -> f64 {
        // In the order of the operator, so that a pair that is clear gives the same number.
        let (a, b) = (&self.geometry.panels()[i.min(j)], &self.geometry.panels()[i.max(j)]);
        pair_block(a, b, Sight::Clear, [1.0; 2], &self.accuracy).sum()
    }

    /// See [`ViewFactors::reversed_error`].
    fn reversed_error(&self, dense: &Dense) -> f64 {
        let (panels, blockers) = (self.geometry.panels(), self.geometry.blockers);
        let accuracy = Accuracy { max_rays: REVERSED_RAYS, ..self.accuracy };
        let n = panels.len() as u64;
        let pick = |k| crate::quadrature::sequence::hash(self.accuracy.seed ^ 0x7265_7665, k) % n.max(1);
        let pairs = (0..4 * REVERSED).map(|k| [2 * k, 2 * k + 1].map(|k| pick(k) as usize));
        let seen = pairs.filter(|&[i, j]| dense.exchange_area(i, j) != 0.0).take(REVERSED as usize);
        // Of few elements the same pairs are picked again and again.
        let seen: BTreeSet<[usize; 2]> = seen.map(|[i, j]| [i.max(j), i.min(j)]).collect();
        let error = |[i, j]: [usize; 2]| {
            let (a, b) = (&panels[i], &panels[j]);
            let skip = [a.surface, b.surface];
            let hides = |x: &[_], y: &[_]| blockers.occluded_packet(x, y, skip);
            let reversed = pair_block(a, b, Sight::Partial(&hides), [1.0; 2], &accuracy).sum();
            let known = dense.exchange_area(i, j);
            (known - reversed).abs() / known.max(a.area() * b.area() / self.accuracy.total_area)
        };
        let errors: Vec<f64> = seen.into_par_iter().map(error).collect();
        check::greatest(errors)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_to_sum_to_what_rays_do_not_contradict() {
        let surface =
            |escape, escape_error| Surface { name: String::new(), area: 2.0, emittance: 1.0, escape, escape_error };
        let open = surface(0.3, 0.01);
        for (sum, target) in [(0.7, 0.7), (0.705, 0.705), (0.65, 0.69), (0.72, 0.71)] {
            assert!((open.closed_sum(sum) - target).abs() < 1e-15, "{sum}");
        }
        assert!((surface(0.0, 0.01).closed_sum(1.004) - 1.0).abs() < 1e-15, "no row has more than all");
        assert!((surface(0.0, 0.0).closed_sum(0.97) - 1.0).abs() < 1e-15, "a closed scene");
    }
}

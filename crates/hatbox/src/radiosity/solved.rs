//! What a user asks for and gets: a scene solved in one go.

use super::strengths::strengths;
use super::{ErrorEstimate, Estimated, Sampling, Solution, System, estimate_error};
use crate::element::{ALL, Basis};
use crate::exchange::{self, Exchange, ExchangeError, Statistics};
use crate::linalg::LinearOperator;
use crate::mesh::{RefineError, Refinement};
use crate::progress::Progress;
use crate::scene::{Scene, SceneError};
use crate::solve::{self, Info, SolveError};
use crate::space::{CREASE_ANGLE, Continuity, FunctionSpace, NoElement};
use crate::visibility::Bvh;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Solvers are asked for no smaller residual, however little of the light an error is asked of: rounding leaves as much.
const LEAST_TOLERANCE: f64 = 1e-10;
/// Light on some cells that is less than this part of all light is none.
const ROUNDING: f64 = 1e-9;

/// What a user chooses.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// The basis; see [`crate::element::ALL`].
    pub basis: &'static Basis,
    /// Where functions are joined.
    pub continuity: Continuity,
    /// How the mesh is subdivided.
    pub refinement: Refinement,
    /// Vertices of the subdivision are at t^q from the edges of faces, this being q: 1 for a uniform subdivision, 2 for
    /// linear and 3 for quadratic functions to have their order in spite of the edges.
    pub grading: f64,
    /// Relative error that the operator may have.
    pub tolerance: f64,
    /// The kind of exchange operator.
    pub operator: &'static exchange::Kind,
    /// The solver; `None` chooses conjugate gradients where R is constant on every element and GMRES elsewhere, as
    /// [`System::best_solver`] has it.
    pub solver: Option<solve::Kind>,
    /// Seed of all sampling.
    pub seed: u64,
    /// Most bytes that the operator may store.
    pub memory: usize,
    /// Points at which the error is estimated, at the least, and up to sixteen times as many
    /// ([`Sampling`](super::Sampling)); 0 leaves it unknown.
    pub error_points: usize,
}

impl Default for Options {
    /// Joined linear functions on about 3000 elements, to 1 %.
    fn default() -> Self {
        Self {
            basis: &ALL[1],
            continuity: Continuity::Continuous { crease_angle: CREASE_ANGLE },
            refinement: Refinement::Elements(3000),
            grading: 1.0,
            tolerance: 1e-2,
            operator: &exchange::AUTO,
            solver: None,
            seed: 0,
            memory: exchange::MEMORY,
            error_points: 512,
        }
    }
}

/// Why there is no solution.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The mesh cannot be subdivided as asked.
    #[error(transparent)]
    Refine(#[from] RefineError),
    /// The basis has no element for a cell.
    #[error(transparent)]
    NoElement(#[from] NoElement),
    /// The operator was not built.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
    /// The system was not solved.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// Nothing absorbs: there is no solution.
    #[error(
        "the scene is closed and nothing in it absorbs light of band {band}: the radiosity has no bound (materials with \
         reflectance 1: {})",
        materials.join(", ")
    )]
    Lossless {
        /// The first band of which that is true.
        band: usize,
        /// The materials that reflect everything.
        materials: Vec<String>,
    },
    /// A cell is too thin for its integrals: its mass matrix is singular to rounding.
    #[error("an element has no area to rounding; remove slivers from the mesh (`hatbox check` lists them)")]
    Degenerate,
}

/// Why materials cannot take the place of others.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MaterialsError {
    /// The cells would have to be others.
    #[error(
        "the new materials are not as many as the old ones, or not two-sided where those are; solve the scene anew"
    )]
    Geometry,
    /// One of them is impossible.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// Where the power went, per band, in lm or W.
#[derive(Debug, Clone, PartialEq)]
pub struct Energy {
    /// ∫B⁰.
    pub emitted: Vec<f64>,
    /// ∫B.
    pub leaving: Vec<f64>,
    /// ∫(1 − R) E.
    pub absorbed: Vec<f64>,
    /// ∫B − ∫E: what leaves and does not arrive.
    pub escaped: Vec<f64>,
}

impl Energy {
    /// |emitted − absorbed − escaped| / emitted, the greatest of all bands.
    pub fn defect(&self) -> f64 {
        let of = |band: usize| {
            let (e, a, s) = (self.emitted[band], self.absorbed[band], self.escaped[band]);
            if e > 0.0 { ((e - a - s) / e).abs() } else { 0.0 }
        };
        (0..self.emitted.len()).map(of).fold(0.0, f64::max)
    }
}

/// A solution and how it was reached.
#[derive(Debug, Clone)]
pub struct Solved {
    /// The solution.
    pub solution: Solution,
    /// Number of unknowns per band.
    pub unknowns: usize,
    /// The exchange operator.
    pub operator: Statistics,
    /// What is known of the row sums.
    pub closure: exchange::Closure,
    /// Name of the kind of operator.
    pub operator_kind: &'static str,
    /// Why that kind was chosen, if it was not asked for.
    pub operator_reason: Option<String>,
    /// ‖Δ^-½ S Δ^-½‖, from below: at most 1 but for the operator's error.
    pub operator_norm: f64,
    /// Time to subdivide the mesh and build it.
    pub operator_time: Duration,
    /// The solver that ran.
    pub solver: solve::Kind,
    /// What it did.
    pub info: Info,
    /// Time it took.
    pub solver_time: Duration,
    /// Where the power went.
    pub energy: Energy,
    /// The estimated error; `None` if it was not asked for.
    pub error: Option<ErrorEstimate>,
    /// Time it took to estimate it.
    pub error_time: Duration,
}

/// Subdivides, builds the operator, solves, and estimates the error.
///
/// # Errors
/// [`Error`]; nothing is left behind.
pub fn solve(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Solved, Error> {
    System::build(scene, options, progress)?.solved(options, progress)
}

impl System {
    /// Subdivides a scene and builds the operator.
    ///
    /// # Errors
    /// [`Error`], but for [`Error::Solve`].
    pub fn build(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Self, Error> {
        Self::of_cells(scene.refined_graded(options.refinement, options.grading, options.basis)?, options, progress)
    }

    /// Builds the operator on the cells of the scene as they are.
    ///
    /// # Errors
    /// [`Error`], but for [`Error::Solve`] and [`Error::Refine`].
    pub fn of_cells(scene: Scene, options: &Options, progress: &dyn Progress) -> Result<Self, Error> {
        let blockers = Arc::new(Bvh::of_surfaces(&scene.surfaces));
        let strengths = strengths(&scene, &blockers);
        Self::of_strengths(scene, blockers, strengths, options, progress)
    }

    /// The same among the faces of the scene in their tree, if light from each cell counts so strongly.
    pub(crate) fn of_strengths(
        scene: Scene,
        blockers: Arc<Bvh>,
        strengths: Vec<f64>,
        options: &Options,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let started = Instant::now();
        let space = FunctionSpace::new(&scene, options.basis, options.continuity)?;
        let params = exchange::Params {
            seed: options.seed,
            strengths,
            memory: options.memory,
            ..exchange::Params::new(options.tolerance)
        };
        let mut system = Self::among(scene, blockers, space, options.operator, &params, progress)?;
        system.operator_time = started.elapsed();
        Ok(system)
    }

    /// Solves, and estimates the error.
    ///
    /// # Errors
    /// [`Error::Solve`].
    pub fn solved(&self, options: &Options, progress: &dyn Progress) -> Result<Solved, Error> {
        self.solved_within(options, 0.0, |_, _| Ok(None), progress).map(|(solved, _)| solved)
    }

    /// The same. The error is estimated on the cells that `within` chooses, all if it chooses none, and no longer than it takes to
    /// know that it is more than is `wanted`, or far less; with it comes what it is made of.
    ///
    /// # Errors
    /// [`Error::Solve`].
    pub fn solved_within(
        &self,
        options: &Options,
        wanted: f64,
        within: impl FnOnce(&Self, &Solution) -> Result<Option<Vec<bool>>, SolveError>,
        progress: &dyn Progress,
    ) -> Result<(Solved, Option<Estimated>), Error> {
        let started = Instant::now();
        let kind = options.solver.unwrap_or_else(|| self.best_solver());
        let params = self.solver_params(kind);
        let (mut solution, mut info) = self.solve(kind, &params, progress)?;
        let mut solver_time = started.elapsed();
        let within = within(self, &solution)?;
        // The solver's residual is relative to all light, and little of it may be where the error is asked of. (Neumann's is relative
        // to the emission, and goes as far as it was asked to.)
        let share = within.as_ref().map_or(1.0, |within| self.share_of_light(&solution, within));
        let tolerance = (params.tolerance * share).max(LEAST_TOLERANCE);
        if info.residual > tolerance && kind != solve::Kind::Neumann && !self.exchange.is_symmetric() {
            let again = Instant::now();
            (solution, info) = self.solve(kind, &solve::Params { tolerance, ..params }, progress)?;
            solver_time += again.elapsed();
        }
        let sampling = Sampling { points: options.error_points, wanted, seed: options.seed, within: within.as_deref() };
        let asked = Instant::now();
        let estimated = (options.error_points > 0)
            .then(|| estimate_error(self, &solution, &info, &sampling, progress))
            .transpose()?;
        let error_time = asked.elapsed();
        let solved = Solved {
            energy: self.energy(&solution, progress).map_err(SolveError::from)?,
            unknowns: self.space.dofs(),
            operator: self.exchange.statistics(),
            closure: self.exchange.closure,
            operator_kind: self.exchange.kind(),
            operator_reason: self.operator_reason.clone(),
            operator_norm: self.operator_norm(progress).map_err(SolveError::from)?,
            operator_time: self.operator_time,
            solver: kind,
            info,
            solver_time,
            error: estimated.as_ref().map(|estimated| estimated.error),
            error_time,
            solution,
        };
        Ok((solved, estimated))
    }

    /// The L2 norm of the reflected light on some cells over that on all, in the band where it is least of those that are lit there.
    fn share_of_light(&self, solution: &Solution, within: &[bool]) -> f64 {
        let light = self.reflected_light(solution);
        let weighted = self.mass().times(&light);
        let square = |band: usize, cells: &mut dyn Iterator<Item = usize>| -> f64 {
            let of = |k: usize| light.band(band)[k] * weighted.band(band)[k];
            cells.flat_map(|cell| solution.space.range(cell)).map(of).sum()
        };
        let share = |band: usize| {
            let here = square(band, &mut (0..within.len()).filter(|&cell| within[cell]));
            let all = square(band, &mut (0..within.len()));
            // Where nothing is reflected there is rounding.
            if here > ROUNDING * ROUNDING * all { (here / all).sqrt() } else { 1.0 }
        };
        (0..light.bands()).map(share).fold(1.0, f64::min)
    }
}

use super::operators::{Equation, InverseMass, Join, Mass, Symmetric, Transport, preconditioner};
use super::{ErrorEstimate, Gather, Solution, estimate_error};
use crate::assemble::{Accuracy, Block, Facing, Panel, Sight, load, mass, pair_block, weighted_mass};
use crate::element::{ALL, Basis};
use crate::exchange::{self, Balanced, Exchange, ExchangeError, Geometry, Statistics};
use crate::linalg::{BlockDiagonal, LinearOperator, MultiVector};
use crate::mesh::{RefineError, Refinement};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::solve::{self, Info, SolveError, cg, gmres, neumann};
use crate::space::{CREASE_ANGLE, Continuity, FunctionSpace, NoElement};
use crate::visibility::{Bvh, Shaft, ShaftResult, Visibility};
use glam::DVec3;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The solver always goes this far: beside building the operator it costs next to nothing, and power then balances to
/// ten digits whatever the operator's tolerance.
const SOLVER_TOLERANCE: f64 = 1e-11;

/// What a user chooses.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// The basis; see [`crate::element::ALL`].
    pub basis: &'static Basis,
    /// Where functions are joined.
    pub continuity: Continuity,
    /// How the mesh is subdivided.
    pub refinement: Refinement,
    /// Relative error that the operator may have.
    pub tolerance: f64,
    /// The kind of exchange operator.
    pub operator: &'static exchange::Kind,
    /// The solver; `None` chooses conjugate gradients where R is constant on every element and GMRES elsewhere.
    pub solver: Option<solve::Kind>,
    /// Seed of all sampling.
    pub seed: u64,
    /// Points at which the error is estimated; 0 leaves it unknown.
    pub error_points: usize,
}

impl Default for Options {
    /// Joined linear functions on about 3000 elements, to 1 %.
    fn default() -> Self {
        Self {
            basis: &ALL[1],
            continuity: Continuity::Continuous { crease_angle: CREASE_ANGLE },
            refinement: Refinement::Elements(3000),
            tolerance: 1e-2,
            operator: &exchange::ALL[0],
            solver: None,
            seed: 0,
            error_points: 256,
        }
    }
}

/// Why there is no solution.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
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
    /// A cell is too thin for its integrals: its mass matrix is singular to rounding.
    #[error("an element has no area to rounding; remove slivers from the mesh (`hatbox check` lists them)")]
    Degenerate,
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
}

/// Subdivides, builds the operator, solves, and estimates the error.
///
/// # Errors
/// [`Error`]; nothing is left behind.
pub fn solve(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Solved, Error> {
    System::build(scene, options, progress)?.solved(options, progress)
}

/// How strongly the light of each cell counts: its exitance over the mean irradiance that the scene's power makes.
fn strengths(scene: &Scene) -> Vec<f64> {
    let cells = scene.mesh.cells.len();
    let exitance = |cell: usize| {
        let site = scene.site(cell, [1.0 / 3.0, 1.0 / 3.0]);
        (0..scene.bands).map(|band| scene.material(cell).exitance.at(&site, band)).sum::<f64>()
    };
    let absorbed = |cell: usize| {
        let site = scene.site(cell, [1.0 / 3.0, 1.0 / 3.0]);
        (0..scene.bands).map(|b| 1.0 - scene.material(cell).reflectance.at(&site, b)).sum::<f64>() / scene.bands as f64
    };
    let areas: Vec<f64> = (0..cells).map(|cell| scene.mesh.patch(cell).area()).collect();
    let power: f64 = (0..cells).map(|cell| areas[cell] * exitance(cell)).sum();
    let sink: f64 = (0..cells).map(|cell| areas[cell] * absorbed(cell)).sum();
    let mean = power / sink.max(0.05 * areas.iter().sum::<f64>());
    (0..cells).map(|cell| if mean > 0.0 { (exitance(cell) / mean).max(1.0) } else { 1.0 }).collect()
}

/// What does not depend on the light: a space on a scene, its mass matrix and its exchange operator.
pub struct System {
    /// The scene, subdivided.
    pub scene: Scene,
    /// The space.
    pub space: FunctionSpace,
    /// S, balanced where the scene is closed; shared with the systems that [`with_scene`](Self::with_scene) made of this.
    pub exchange: Arc<Balanced>,
    /// Name of its kind.
    pub operator_kind: &'static str,
    /// Time to subdivide the mesh and build it.
    pub operator_time: Duration,
    pub(super) panels: Vec<Panel>,
    pub(super) blockers: Bvh,
    strengths: Vec<f64>,
    join: Join,
    mass: BlockDiagonal,
    mass_inverse: BlockDiagonal,
    preconditioner: Box<dyn LinearOperator + Send>,
}

impl System {
    /// Subdivides a scene and builds the operator.
    ///
    /// # Errors
    /// [`Error`], but for [`Error::Solve`].
    pub fn build(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Self, Error> {
        let started = Instant::now();
        let scene = scene.refined(options.refinement, options.basis)?;
        let space = FunctionSpace::new(&scene, options.basis, options.continuity)?;
        let params = exchange::Params {
            seed: options.seed,
            strengths: strengths(&scene),
            ..exchange::Params::new(options.tolerance)
        };
        let system = Self::new(scene, space, options.operator, &params, progress)?;
        Ok(Self { operator_time: started.elapsed(), ..system })
    }

    /// Solves, and estimates the error.
    ///
    /// # Errors
    /// [`Error::Solve`].
    pub fn solved(&self, options: &Options, progress: &dyn Progress) -> Result<Solved, Error> {
        let started = Instant::now();
        let kind = options.solver.unwrap_or_else(|| self.best_solver());
        let (solution, info) =
            self.solve(kind, &solve::Params { tolerance: SOLVER_TOLERANCE, ..Default::default() }, progress)?;
        let solver_time = started.elapsed();
        let error = (options.error_points > 0)
            .then(|| estimate_error(self, &solution, &info, options.error_points, options.seed, progress))
            .transpose()
            .map_err(SolveError::Interrupted)?;
        Ok(Solved {
            energy: self.energy(&solution),
            unknowns: self.space.dofs(),
            operator: self.exchange.statistics(),
            closure: self.exchange.closure,
            operator_kind: self.operator_kind,
            operator_time: self.operator_time,
            solver: kind,
            info,
            solver_time,
            error,
            solution,
        })
    }

    /// The system of the same cells in other materials (see [`Scene::with_materials`]): the operator is shared, and only
    /// where functions are joined is found anew, since radiosity jumps where materials change.
    ///
    /// How finely shadows were sampled followed the lamps of the first scene; the estimated error of a solution tells
    /// whether that is good enough for the new ones.
    ///
    /// # Errors
    /// [`Error::NoElement`] if the scene is not of the same cells.
    pub fn with_scene(&self, scene: Scene, continuity: Continuity) -> Result<Self, Error> {
        debug_assert_eq!(scene.mesh.cells.len(), self.scene.mesh.cells.len());
        let space = FunctionSpace::new(&scene, self.space.basis(), continuity)?;
        let join = Join::of(&space);
        Ok(Self {
            exchange: Arc::clone(&self.exchange),
            operator_kind: self.operator_kind,
            operator_time: Duration::ZERO,
            panels: self.panels.clone(),
            blockers: self.blockers.clone(),
            strengths: strengths(&scene),
            preconditioner: preconditioner(&join, &self.mass, &self.mass_inverse),
            mass: self.mass.clone(),
            mass_inverse: self.mass_inverse.clone(),
            join,
            scene,
            space,
        })
    }

    /// The block S_ij = ∬ N_i N_j G V of two cells, integrated afresh to a tolerance of its own and not balanced.
    pub fn pair_block(&self, i: usize, j: usize, accuracy: &Accuracy) -> Block {
        let (a, b) = (&self.panels[i], &self.panels[j]);
        let skip = [a.surface, b.surface];
        let hides = |x: DVec3, y: DVec3| self.blockers.occluded(x, y, skip);
        let clear = Facing::new(&a.patch, &b.patch).is_some_and(|facing| {
            let [on_a, on_b] = facing.polygons();
            let shaft = Shaft::new(on_a, on_b);
            self.blockers.shaft_candidates(&shaft, &skip, &mut Vec::new(), 1) == ShaftResult::Empty
        });
        pair_block(a, b, if clear { Sight::Clear } else { Sight::Partial(&hides) }, [1.0, 1.0], accuracy)
    }

    /// Builds the operator.
    ///
    /// # Errors
    /// [`Error::Exchange`], [`Error::Degenerate`].
    pub fn new(
        scene: Scene,
        space: FunctionSpace,
        kind: &exchange::Kind,
        params: &exchange::Params,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let started = Instant::now();
        let panels = Panel::of(&scene.mesh, &space);
        let blockers = Bvh::of_surfaces(&scene.surfaces);
        let mass = mass(&scene, &space);
        let mass_inverse = mass.inverse().ok_or(Error::Degenerate)?;
        let geometry = Geometry { panels: &panels, surfaces: &scene.surfaces, blockers: &blockers };
        let exchange = (kind.build)(&geometry, params, progress)?;
        let escape = exchange::escape(&geometry, &scene, params.seed, progress).map_err(ExchangeError::from)?;
        let exchange = Balanced::new(exchange, &scene, &space, &mass, &mass_inverse, escape);
        let join = Join::of(&space);
        Ok(Self {
            exchange: Arc::new(exchange),
            operator_kind: kind.name,
            operator_time: started.elapsed(),
            strengths: params.strengths.clone(),
            preconditioner: preconditioner(&join, &mass, &mass_inverse),
            scene,
            space,
            panels,
            blockers,
            join,
            mass,
            mass_inverse,
        })
    }

    /// Conjugate gradients where R is constant on every element, GMRES elsewhere.
    pub fn best_solver(&self) -> solve::Kind {
        if self.root_reflectance().is_some() { solve::Kind::Cg } else { solve::Kind::Gmres }
    }

    /// Solves Δ b = b⁰ + F̂ b for the scene's emission.
    ///
    /// Conjugate gradients need R constant on every element; where it is not, GMRES takes their place.
    ///
    /// # Errors
    /// [`Error::Solve`].
    pub fn solve(
        &self,
        kind: solve::Kind,
        params: &solve::Params,
        progress: &dyn Progress,
    ) -> Result<(Solution, Info), Error> {
        let right_side = self.join.collect(&load(&self.scene, &self.space));
        let reflectance = weighted_mass(&self.scene, &self.space);
        let transport = Transport {
            join: &self.join,
            exchange: &*self.exchange,
            mass_inverse: &self.mass_inverse,
            reflectance: &reflectance,
        };
        let mut b = self.inverse_mass().times(&right_side);
        let info = match (kind, self.root_reflectance()) {
            (solve::Kind::Cg, Some(root)) => {
                let symmetric = Symmetric { mass: self.mass(), exchange: &*self.exchange, root: &root };
                return self.solve_symmetric(&symmetric, &b, params, progress);
            }
            (solve::Kind::Neumann, _) => {
                neumann(&self.inverse_mass(), &transport, &right_side, &mut b, params, progress)?
            }
            _ => {
                let equation = Equation { mass: self.mass(), transport };
                gmres(&equation, &*self.preconditioner, &right_side, &mut b, params, progress)?
            }
        };
        Ok((self.solution(self.join.spread(&b)), info))
    }

    fn solve_symmetric(
        &self,
        symmetric: &Symmetric<'_>,
        emission: &MultiVector,
        params: &solve::Params,
        progress: &dyn Progress,
    ) -> Result<(Solution, Info), Error> {
        let emission = self.join.spread(emission);
        let right_side = symmetric.reflected(&emission);
        let mut c = MultiVector::zeros(right_side.rows(), right_side.bands());
        let info = cg(symmetric, &*self.preconditioner, &right_side, &mut c, params, progress)?;
        let mut radiosity = symmetric.scaled(&c);
        radiosity.add_scaled(1.0, &emission);
        Ok((self.solution(radiosity), info))
    }

    /// The solution whose radiosity has these broken coefficients. E is the projection Δ⁻¹ S b of what arrives onto the
    /// *broken* space, joined or not: more accurate than on hats where shadows have sharp edges, and it costs no solve.
    fn solution(&self, radiosity: MultiVector) -> Solution {
        let irradiance = self.mass_inverse.times(&self.exchange.times(&radiosity));
        Solution { scene: self.scene.clone(), space: self.space.clone(), radiosity, irradiance }
    }

    /// √R for each broken coefficient and band, if R is constant on every element.
    fn root_reflectance(&self) -> Option<MultiVector> {
        let mut root = MultiVector::zeros(self.space.broken_dofs(), self.scene.bands);
        for cell in 0..self.space.cells() {
            for band in 0..self.scene.bands {
                let r = self.scene.material(cell).reflectance.uniform(band)?;
                root.band_mut(band)[self.space.range(cell)].fill(r.sqrt());
            }
        }
        Some(root)
    }

    /// Where the power of a solution goes.
    pub fn energy(&self, solution: &Solution) -> Energy {
        let emitted = load(&self.scene, &self.space);
        let left = self.mass.times(&solution.radiosity);
        let arrived = self.exchange.times(&solution.radiosity);
        let reflected = weighted_mass(&self.scene, &self.space).times(&self.mass_inverse.times(&arrived));
        let total = |x: &MultiVector, band: usize| x.band(band).iter().sum::<f64>();
        let bands = 0..self.scene.bands;
        Energy {
            emitted: bands.clone().map(|b| total(&emitted, b)).collect(),
            leaving: bands.clone().map(|b| total(&left, b)).collect(),
            absorbed: bands.clone().map(|b| total(&arrived, b) - total(&reflected, b)).collect(),
            escaped: bands.map(|b| total(&left, b) - total(&arrived, b)).collect(),
        }
    }

    /// Irradiance at any point, from a solution of this system.
    pub fn gather<'a>(&'a self, solution: &'a Solution) -> Gather<'a> {
        Gather { panels: &self.panels, blockers: &self.blockers, strengths: &self.strengths, solution }
    }

    fn mass(&self) -> Mass<'_> {
        Mass { join: &self.join, mass: &self.mass }
    }

    fn inverse_mass(&self) -> InverseMass<'_> {
        InverseMass { mass: self.mass(), preconditioner: &*self.preconditioner }
    }
}

use super::operators::{Equation, InverseMass, Join, Mass, Symmetric, Transport, preconditioner};
use super::{ErrorEstimate, Estimated, Gather, Sampling, Solution, estimate_error};
use crate::assemble::{Panel, load, mass, weighted_mass};
use crate::element::{ALL, Basis};
use crate::exchange::{self, Balanced, Exchange, ExchangeError, Geometry, Statistics};
use crate::linalg::{BlockDiagonal, LinearOperator, MultiVector};
use crate::mesh::{RefineError, Refinement};
use crate::progress::Progress;
use crate::scene::{Material, Scene, SceneError};
use crate::solve::{self, Info, SolveError, cg, gmres, neumann};
use crate::space::{CREASE_ANGLE, Continuity, FunctionSpace, NoElement};
use crate::visibility::Bvh;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// The solver always goes this far: beside building the operator it costs next to nothing, and power then balances to
/// ten digits whatever the operator's tolerance.
const SOLVER_TOLERANCE: f64 = 1e-11;
/// An operator that is sampled errs by far more than this, and its products are most of the time.
const SAMPLED_SOLVER_TOLERANCE: f64 = 1e-7;
/// Steps of Arnoldi's method for the norm of the operator: an exact one costs little to apply, a sampled one has its
/// greatest gain among the first.
const NORM_STEPS: [usize; 2] = [12, 4];

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
    /// The solver; `None` chooses conjugate gradients where R is constant on every element and GMRES elsewhere.
    pub solver: Option<solve::Kind>,
    /// Seed of all sampling.
    pub seed: u64,
    /// Most bytes that the operator may store.
    pub memory: usize,
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
            grading: 1.0,
            tolerance: 1e-2,
            operator: &exchange::AUTO,
            solver: None,
            seed: 0,
            memory: exchange::MEMORY,
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
}

/// Subdivides, builds the operator, solves, and estimates the error.
///
/// # Errors
/// [`Error`]; nothing is left behind.
pub fn solve(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Solved, Error> {
    let scene = scene.refined_graded(options.refinement, options.grading, options.basis)?;
    let no_focus = |_: &System, _: &Solution| Ok(None);
    solve_subdivided(scene, options, no_focus, progress).map(|(solved, _)| solved)
}

/// Solves on the cells of the scene as they are. The error is estimated on the cells that `within` chooses, all if it
/// chooses none; with it come the residuals it is made of.
///
/// # Errors
/// [`Error`]; nothing is left behind.
pub fn solve_subdivided(
    scene: Scene,
    options: &Options,
    within: impl FnOnce(&System, &Solution) -> Result<Option<Vec<bool>>, SolveError>,
    progress: &dyn Progress,
) -> Result<(Solved, Vec<(usize, f64)>), Error> {
    let started = Instant::now();
    let space = FunctionSpace::new(&scene, options.basis, options.continuity)?;
    let params = exchange::Params {
        seed: options.seed,
        strengths: strengths(&scene),
        memory: options.memory,
        ..exchange::Params::new(options.tolerance)
    };
    let reason =
        (options.operator.name == exchange::AUTO.name).then(|| exchange::choose(space.broken_dofs(), options.memory).1);
    let system = System::new(scene, space, options.operator, &params, progress)?;
    let operator_time = started.elapsed();
    let started = Instant::now();
    let kind = options.solver.unwrap_or_else(|| system.best_solver());
    let (solution, info) =
        system.solve(kind, &solve::Params { tolerance: system.solver_tolerance(), ..Default::default() }, progress)?;
    let solver_time = started.elapsed();
    let within = within(&system, &solution)?;
    let sampling = Sampling { points: options.error_points, seed: options.seed, within: within.as_deref() };
    let estimated = (options.error_points > 0)
        .then(|| estimate_error(&system, &solution, &info, &sampling, progress))
        .transpose()?;
    let (error, seen) = estimated.map_or((None, Vec::new()), |Estimated { error, seen }| (Some(error), seen));
    let solved = Solved {
        energy: system.energy(&solution),
        unknowns: system.space.dofs(),
        operator: system.exchange.statistics(),
        closure: system.exchange.closure,
        operator_kind: system.exchange.kind(),
        operator_reason: reason,
        operator_norm: system.operator_norm(),
        operator_time,
        solver: kind,
        info,
        solver_time,
        error,
        solution,
    };
    Ok((solved, seen))
}

/// How strongly the light of each cell counts: its exitance over the mean irradiance that the scene's power makes.
pub(super) fn strengths(scene: &Scene) -> Vec<f64> {
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
    /// S, balanced where the scene is closed.
    pub exchange: Balanced,
    panels: OnceLock<Vec<Panel>>,
    blockers: Arc<Bvh>,
    strengths: Vec<f64>,
    join: Join,
    mass: BlockDiagonal,
    mass_inverse: BlockDiagonal,
    preconditioner: Box<dyn LinearOperator>,
}

impl System {
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
        let (panels, blockers) = (OnceLock::new(), Arc::new(Bvh::of_surfaces(&scene.surfaces)));
        let mass = mass(&scene, &space);
        let mass_inverse = mass.inverse().ok_or(Error::Degenerate)?;
        let geometry = Geometry::new(&scene, &space, &blockers, &panels);
        let exchange = (kind.build)(&geometry, params, progress)?;
        let escape = match exchange.escape() {
            Some(escape) => escape,
            None => exchange::escape(&geometry, params.seed, progress).map_err(ExchangeError::from)?,
        };
        let exchange = Balanced::new(exchange, &scene, &space, &mass, &mass_inverse, escape);
        let join = Join::of(&space);
        let preconditioner = preconditioner(&join, &mass, &mass_inverse);
        let strengths = params.strengths.clone();
        Ok(Self { scene, space, exchange, panels, blockers, strengths, join, mass, mass_inverse, preconditioner })
    }

    /// The cells as panels, made when they are first asked for.
    pub(super) fn panels(&self) -> &[Panel] {
        self.panels.get_or_init(|| Panel::of(&self.scene.mesh, &self.space))
    }

    /// Replaces the materials, one by one, and keeps the operator: another light (new B⁰), another paint (new R).
    ///
    /// What is solved next is what a system made afresh with the same [`exchange::Params`] would solve, to the last
    /// bit; only the functions' joints are found again, since they follow the materials.
    ///
    /// # Errors
    /// [`MaterialsError`] if their number, their bands or which of them are two-sided would change, or one of them is
    /// not physical; the system is then as it was.
    pub fn set_materials(&mut self, materials: Vec<Material>, continuity: Continuity) -> Result<(), MaterialsError> {
        let same = |(a, b): (&Material, &Material)| a.two_sided == b.two_sided;
        if materials.len() != self.scene.materials.len() || !materials.iter().zip(&self.scene.materials).all(same) {
            return Err(MaterialsError::Geometry);
        }
        self.scene.set_materials(materials)?;
        // The cells have elements: only the joints may differ.
        if let Ok(space) = FunctionSpace::new(&self.scene, self.space.basis(), continuity) {
            self.space = space;
        }
        self.join = Join::of(&self.space);
        self.preconditioner = preconditioner(&self.join, &self.mass, &self.mass_inverse);
        Ok(())
    }

    /// ‖Δ^-½ S Δ^-½‖ from below, by a few steps of Arnoldi's method.
    pub fn operator_norm(&self) -> f64 {
        let steps = NORM_STEPS[usize::from(!self.exchange.is_symmetric())];
        exchange::norm(&self.exchange, &self.mass, &self.mass_inverse, steps)
    }

    /// How far the solver should go: as far as power balances by the operator.
    pub fn solver_tolerance(&self) -> f64 {
        if self.exchange.is_symmetric() { SOLVER_TOLERANCE } else { SAMPLED_SOLVER_TOLERANCE }
    }

    /// The relative L2 error of the irradiance that the operator makes, from two halves of its samples where it is
    /// sampled, else as estimated when it was built.
    pub fn operator_error(&self, solution: &Solution) -> f64 {
        let Some(spread) = self.exchange.spread(&solution.radiosity) else {
            return self.exchange.statistics().error();
        };
        let spread = self.irradiance_of(&spread);
        let norms = |x: &MultiVector| x.dot(&self.mass.times(x));
        let relative = |(error, norm): (f64, f64)| if norm > 0.0 { (error / norm).sqrt() } else { 0.0 };
        norms(&spread).into_iter().zip(norms(&solution.irradiance)).map(relative).fold(0.0, f64::max)
    }

    /// Conjugate gradients where S is symmetric and R constant on every element, GMRES elsewhere.
    pub fn best_solver(&self) -> solve::Kind {
        if self.root_reflectance().is_some() { solve::Kind::Cg } else { solve::Kind::Gmres }
    }

    /// Solves Δ b = b⁰ + F̂ b for the scene's emission.
    ///
    /// Conjugate gradients need a symmetric S and R constant on every element; else GMRES takes their place.
    ///
    /// # Errors
    /// [`Error::Solve`].
    pub fn solve(
        &self,
        kind: solve::Kind,
        params: &solve::Params,
        progress: &dyn Progress,
    ) -> Result<(Solution, Info), Error> {
        Ok(self.solve_for(&load(&self.scene, &self.space), kind, params, progress)?)
    }

    /// The same for another emission, given by its integrals ∫B⁰N_i against the broken functions.
    fn solve_for(
        &self,
        load: &MultiVector,
        kind: solve::Kind,
        params: &solve::Params,
        progress: &dyn Progress,
    ) -> Result<(Solution, Info), SolveError> {
        let right_side = self.join.collect(load);
        let reflectance = weighted_mass(&self.scene, &self.space);
        let transport = Transport {
            join: &self.join,
            exchange: &self.exchange,
            mass_inverse: &self.mass_inverse,
            reflectance: &reflectance,
        };
        let mut b = self.inverse_mass().times(&right_side);
        let info = match (kind, self.root_reflectance()) {
            (solve::Kind::Cg, Some(root)) => {
                let symmetric = Symmetric { mass: self.joined_mass(), exchange: &self.exchange, root: &root };
                return self.solve_symmetric(&symmetric, &b, params, progress);
            }
            (solve::Kind::Neumann, _) => {
                neumann(&self.inverse_mass(), &transport, &right_side, &mut b, params, progress)?
            }
            _ => {
                let equation = Equation { mass: self.joined_mass(), transport };
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
    ) -> Result<(Solution, Info), SolveError> {
        let emission = self.join.spread(emission);
        let right_side = symmetric.reflected(&emission);
        let mut c = MultiVector::zeros(right_side.rows(), right_side.bands());
        let info = cg(symmetric, &*self.preconditioner, &right_side, &mut c, params, progress)?;
        let mut radiosity = symmetric.scaled(&c);
        radiosity.add_scaled(1.0, &emission);
        Ok((self.solution(radiosity), info))
    }

    /// The solution whose radiosity has these broken coefficients.
    fn solution(&self, radiosity: MultiVector) -> Solution {
        let mut arrived = self.exchange.times(&radiosity);
        let steady = self.exchange.steady(&radiosity);
        if let Some(steady) = &steady {
            arrived.add_scaled(-1.0, steady);
        }
        let mut irradiance = self.irradiance_of(&arrived);
        if let Some(steady) = &steady {
            irradiance.add_scaled(1.0, &self.mass_inverse.times(steady));
        }
        Solution { scene: self.scene.clone(), space: self.space.clone(), radiosity, irradiance }
    }

    /// The irradiance with these integrals against the broken functions. It is the projection Δ⁻¹ S b onto the *broken*
    /// space, joined or not: more accurate than on hats where shadows have sharp edges, and it costs no solve. Of a
    /// sampled operator it is the projection onto the joined space, which averages the noise of the cells that meet (and
    /// would blur the shadows of lamps, which are therefore left out: [`Exchange::steady`]).
    fn irradiance_of(&self, arrived: &MultiVector) -> MultiVector {
        if self.exchange.is_symmetric() {
            self.mass_inverse.times(arrived)
        } else {
            self.join.spread(&self.inverse_mass().times(&self.join.collect(arrived)))
        }
    }

    /// √R for each broken coefficient and band, if S is symmetric and R constant on every element.
    fn root_reflectance(&self) -> Option<MultiVector> {
        if !self.exchange.is_symmetric() {
            return None;
        }
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
        Gather { panels: self.panels(), blockers: &self.blockers, strengths: &self.strengths, solution }
    }

    /// What surfaces reflect, again and again, if they emit a function of the broken space: (I − RK)⁻¹RK of it, to three
    /// digits, in the broken space.
    ///
    /// # Errors
    /// [`SolveError`].
    pub fn reflections(&self, emission: &MultiVector, progress: &dyn Progress) -> Result<MultiVector, SolveError> {
        if emission.as_slice().iter().all(|&value| value == 0.0) {
            return Ok(emission.clone());
        }
        let params = solve::Params { tolerance: 1e-3, ..Default::default() };
        let (solution, _) = self.solve_for(&self.mass.times(emission), self.best_solver(), &params, progress)?;
        let reflected = weighted_mass(&self.scene, &self.space).times(&solution.irradiance);
        Ok(self.mass_inverse.times(&reflected))
    }

    /// Δ⁻¹ b⁰: what the scene emits, in the broken space.
    pub(super) fn projected_emission(&self) -> MultiVector {
        self.mass_inverse.times(&load(&self.scene, &self.space))
    }

    /// Δ of the broken space.
    pub(super) fn mass(&self) -> &BlockDiagonal {
        &self.mass
    }

    fn joined_mass(&self) -> Mass<'_> {
        Mass { join: &self.join, mass: &self.mass }
    }

    fn inverse_mass(&self) -> InverseMass<'_> {
        InverseMass { mass: self.joined_mass(), preconditioner: &*self.preconditioner }
    }
}

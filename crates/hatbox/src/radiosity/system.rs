mod equation;
mod relight;

use super::denoise::remove_noise;
use super::lossless::lossless;
use super::operators::{InverseMass, Join, Mass, RoughInverse};
use super::products::Products;
use super::residual::greater;
use super::search::FARTHEST;
use super::strengths::strengths;
use super::{Energy, Error, Gather, Solution};
use crate::assemble::{Accuracy, Block, Panel, load, mass, weighted_mass};
use crate::exchange::{self, Balanced, Escape, Exchange, ExchangeError, Geometry, Panorama};
use crate::linalg::{BlockDiagonal, LinearOperator, MultiVector};
use crate::progress::{Interrupted, Progress};
use crate::scene::{Material, Scene};
use crate::solve::{self, Info, SolveError};
use crate::space::FunctionSpace;
use crate::visibility::{Bvh, Occluders};
use std::borrow::Cow;
use std::fmt;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// The solver always goes this far: beside building the operator it costs next to nothing, and power then balances to
/// ten digits whatever the operator's tolerance.
const SOLVER_TOLERANCE: f64 = 1e-11;
/// With an operator that is sampled, products are most of the time, and what it errs by is far more: the solver goes to this
/// share of the operator's error, but no farther than the first of these numbers, and at least as far as the second.
const SAMPLED_SOLVER_SHARE: f64 = 5e-2;
const SAMPLED_SOLVER_TOLERANCES: [f64; 2] = [1e-7, 1e-3];
/// The mass matrix of joined functions is inverted to these relative residuals: beside an exact operator, and beside a sampled
/// one, whose noise is a million times that.
const MASS_TOLERANCES: [f64; 2] = [1e-13, 1e-10];
/// The same for directions of a search. A product leaves far more of the residual; but the light of a furnace, which is
/// constant, is found to this in a few products, whatever the solver's tolerance (to 1e-2, quadratic functions missed it:
/// `what_is_covered_sees_nothing_and_the_rest_of_the_room_is_closed`). And for what noise is averaged to.
const ROUGH_MASS_TOLERANCE: f64 = 1e-4;
/// The relative residual to which [`System::reflections`] are solved for: what causes them is known to a digit.
const REFLECTIONS: f64 = 1e-2;
/// Numbers of the functions in which noise is looked for: of ten million cells each has more.
const NUMBERS_OF_NOISE: usize = 1 << 24;
/// Bounces that Neumann's iteration may take at the most.
const MOST_BOUNCES: usize = 100_000;
/// Steps of Arnoldi's method for the norm of the operator: an exact one costs little to apply, a sampled one has its
/// greatest gain among the first.
const NORM_STEPS: [usize; 2] = [12, 4];

/// The greatest reflectance of any cell in any band, at its middle.
fn greatest_reflectance(scene: &Scene) -> f64 {
    let of = |cell: usize| {
        let site = scene.site(cell, [1.0 / 3.0, 1.0 / 3.0]);
        (0..scene.bands).map(|band| scene.material(cell).reflectance.at(&site, band)).fold(0.0, f64::max)
    };
    (0..scene.mesh.cells.len()).map(of).fold(0.0, f64::max)
}

/// S, balanced, and why it is of that kind, if it was chosen.
fn operator(
    geometry: &Geometry<'_>,
    kind: &'static exchange::Kind,
    params: &exchange::Params,
    [mass, mass_inverse]: [&BlockDiagonal; 2],
    progress: &dyn Progress,
) -> Result<(Balanced, Option<String>), ExchangeError> {
    let (kind, reason) = kind.chosen(&exchange::Problem::of(geometry, params));
    let exchange = (kind.build)(geometry, params, progress)?;
    let escape = match exchange.escape() {
        // Its own rays: nothing is to be learnt from them that it does not know.
        Some(fraction) => Escape { fraction, scatter: f64::INFINITY, open: Vec::new() },
        None => exchange::escape(geometry, params.seed, progress)?,
    };
    Ok((Balanced::new(exchange, geometry, [mass, mass_inverse], &escape, progress)?, reason))
}

/// What does not depend on the light: a space on a scene, its mass matrix and its exchange operator.
///
/// Clones share the operator: [`set_materials`](Self::set_materials) on one of them makes another light beside the first.
#[derive(Clone)]
pub struct System {
    /// The scene, subdivided.
    pub scene: Scene,
    /// The space.
    pub space: FunctionSpace,
    /// S, balanced where the scene is closed.
    pub exchange: Arc<Balanced>,
    /// Time to build it; nothing in new materials.
    pub operator_time: Duration,
    /// Why that kind of operator was chosen, if it was not asked for.
    pub operator_reason: Option<String>,
    panels: Arc<OnceLock<Vec<Panel>>>,
    panorama: Arc<OnceLock<Panorama>>,
    blockers: Arc<Bvh>,
    occluders: Arc<OnceLock<Occluders>>,
    strengths: OnceLock<Vec<f64>>,
    /// b⁰ and M_R, integrated when they are first asked for: functions and textures take their time.
    load: OnceLock<MultiVector>,
    /// The emission as a joined function.
    emission: OnceLock<MultiVector>,
    reflectance: OnceLock<Arc<BlockDiagonal>>,
    join: Join,
    mass: BlockDiagonal,
    mass_inverse: BlockDiagonal,
    rough: Arc<RoughInverse>,
    /// Bytes that the operator may store and does not.
    spare: usize,
    /// What is known of a sampled S from other materials, and what the first solution with these has asked of it.
    known: Products,
    found: OnceLock<Products>,
    /// The materials that shone when the operator was built.
    shone: Arc<[bool]>,
}

impl fmt::Debug for System {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (cells, unknowns) = (self.space.cells(), self.space.dofs());
        f.debug_struct("System").field("cells", &cells).field("unknowns", &unknowns).finish_non_exhaustive()
    }
}

impl System {
    /// Builds the operator.
    ///
    /// # Errors
    /// [`Error::Exchange`], [`Error::Degenerate`], [`Error::Lossless`].
    pub fn new(
        scene: Scene,
        space: FunctionSpace,
        kind: &'static exchange::Kind,
        params: &exchange::Params,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let blockers = Arc::new(Bvh::of_surfaces(&scene.surfaces));
        Self::among(scene, blockers, space, kind, params, progress)
    }

    /// Builds the operator for the faces of the scene in their tree.
    pub(super) fn among(
        scene: Scene,
        blockers: Arc<Bvh>,
        space: FunctionSpace,
        kind: &'static exchange::Kind,
        params: &exchange::Params,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let started = Instant::now();
        let panels = Arc::new(OnceLock::new());
        let mass = mass(&scene, &space);
        let mass_inverse = mass.inverse().ok_or(Error::Degenerate)?;
        let geometry = Geometry::new(&scene, &space, &blockers, &panels);
        let escape = || Ok::<_, ExchangeError>(exchange::escape(&geometry, params.seed, progress)?.fraction);
        if let Some(error) = lossless(&scene, escape)? {
            return Err(error);
        }
        let (exchange, operator_reason) = operator(&geometry, kind, params, [&mass, &mass_inverse], progress)?;
        let join = Join::of(&space, &mass);
        Ok(Self {
            spare: params.memory.saturating_sub(exchange.statistics().bytes),
            known: Products::default(),
            found: OnceLock::new(),
            shone: relight::shining(&scene.materials),
            exchange: Arc::new(exchange),
            operator_time: started.elapsed(),
            operator_reason,
            occluders: Arc::default(),
            strengths: OnceLock::from(params.strengths.clone()),
            load: OnceLock::new(),
            emission: OnceLock::new(),
            reflectance: OnceLock::new(),
            rough: Arc::new(RoughInverse::new(&join, [&mass, &mass_inverse])),
            scene,
            space,
            panels,
            panorama: Arc::default(),
            blockers,
            join,
            mass,
            mass_inverse,
        })
    }

    /// The cells as panels, made when they are first asked for.
    pub(super) fn panels(&self) -> &[Panel] {
        Geometry::new(&self.scene, &self.space, &self.blockers, &self.panels).panels()
    }

    /// The block S_ij = ∬ N_i N_j G V of two cells, integrated afresh as the dense operator would, to a tolerance of its own,
    /// and not balanced.
    pub fn pair_block(&self, i: usize, j: usize, accuracy: &Accuracy) -> Block {
        self.views().pair_block([&self.panels()[i], &self.panels()[j]], [1.0; 2], accuracy)
    }

    /// What stands between.
    fn views(&self) -> exchange::Views<'_> {
        let occluders = self.occluders.get_or_init(|| Occluders::new(&self.scene.surfaces));
        exchange::Views { occluders, blockers: &self.blockers }
    }

    /// ‖Δ^-½ S Δ^-½‖ from below, by a few steps of Arnoldi's method.
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn operator_norm(&self, progress: &dyn Progress) -> Result<f64, Interrupted> {
        let steps = NORM_STEPS[usize::from(!self.exchange.is_symmetric())];
        exchange::norm(&*self.exchange, &self.mass, &self.mass_inverse, steps, progress)
    }

    /// How far the solver should go, and how long it may take: to the last digits where they cost little; to a twentieth
    /// of the error of an operator that is sampled.
    ///
    /// Neumann's iteration takes a bounce at a time, and each leaves the greatest reflectance ρ of the last: it may take
    /// twice ln τ/ln ρ of them, since its residual is relative to one bounce less.
    pub fn solver_params(&self, kind: solve::Kind) -> solve::Params {
        let [least, most] = SAMPLED_SOLVER_TOLERANCES;
        let of_samples = || (SAMPLED_SOLVER_SHARE * self.exchange.statistics().error()).clamp(least, most);
        let tolerance = if self.exchange.is_symmetric() { SOLVER_TOLERANCE } else { of_samples() };
        let params = solve::Params { tolerance, ..Default::default() };
        if kind != solve::Kind::Neumann {
            return params;
        }
        let bounces = 2.0 * tolerance.ln() / greatest_reflectance(&self.scene).ln();
        // A float that is too large for an integer becomes the largest; ρ = 0 gives 0, and ρ = 1 no number of bounces.
        solve::Params { max_iterations: params.max_iterations.max((bounces as usize).min(MOST_BOUNCES)), ..params }
    }

    /// The relative L2 error of the reflected light that the operator makes, the worst band's: the norm of
    /// [`operator_spread`](Self::operator_spread).
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn operator_error(&self, solution: &Solution, progress: &dyn Progress) -> Result<f64, Interrupted> {
        let norms = |x: &MultiVector| x.dot(&self.mass.times(x));
        let relative = |(error, norm): (f64, f64)| if norm == 0.0 { 0.0 } else { (error / norm).sqrt() };
        let light = norms(&self.reflected(solution));
        let errors = norms(&self.operator_spread(solution, progress)?);
        Ok(errors.into_iter().zip(light).map(relative).fold(0.0, greater))
    }

    /// A function as large as the error of the reflected light that the operator makes, in the broken space.
    ///
    /// Where the operator is sampled, it is what two halves of its samples differ by. Else the errors of pairs are known,
    /// and taken to be independent: the irradiance of a cell errs by the root of the sum of their squares, each as strong as
    /// the light that it concerns. What errors cause by reflection is not in it; it is less, since they average out.
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn operator_spread(&self, solution: &Solution, progress: &dyn Progress) -> Result<MultiVector, Interrupted> {
        let irradiance = match (self.exchange.spread(&solution.radiosity, progress)?, self.exchange.row_errors()) {
            (Some(spread), _) => self.irradiance_of(spread),
            (None, Some(errors)) => self.of_row_errors(errors, solution),
            (None, None) => MultiVector::zeros(solution.radiosity.rows(), solution.bands()),
        };
        Ok(self.mass_inverse.times(&self.weighted_mass().times(&irradiance)))
    }

    /// The errors of rows, constant on each cell and relative to the mean radiosity.
    fn of_row_errors(&self, errors: &[f64], solution: &Solution) -> MultiVector {
        let (left, area) = (self.mass.times(&solution.radiosity), self.scene.mesh.area());
        let mut irradiance = MultiVector::zeros(left.rows(), left.bands());
        for band in 0..left.bands() {
            let mean = left.band(band).iter().sum::<f64>() / area;
            for (cell, error) in errors.iter().enumerate() {
                irradiance.band_mut(band)[self.space.range(cell)].fill(mean * error);
            }
        }
        irradiance
    }

    /// Conjugate gradients where S is symmetric and R constant on every element; elsewhere a solver for what is not symmetric,
    /// which is called GMRES.
    pub fn best_solver(&self) -> solve::Kind {
        if self.root_reflectance().is_some() { solve::Kind::Cg } else { solve::Kind::Gmres }
    }

    /// Solves Δ b = b⁰ + F̂ b for the scene's emission.
    ///
    /// Conjugate gradients need a symmetric S and R constant on every element; else GMRES takes their place. Where S is not
    /// symmetric and the tolerance is no less than 1e-5, the steps of GMRES are taken among all products that are known of S
    /// ([`solve::search`]), and by [`solve::gmres`] itself if that gets nowhere. All of them solve for the light that is reflected,
    /// and their residuals are relative to its first bounce; Neumann's are relative to b⁰.
    ///
    /// # Errors
    /// [`Error::Solve`].
    pub fn solve(
        &self,
        kind: solve::Kind,
        params: &solve::Params,
        progress: &dyn Progress,
    ) -> Result<(Solution, Info), Error> {
        if self.exchange.is_symmetric() || kind == solve::Kind::Neumann {
            return Ok(self.solve_for(self.load(), kind, params, progress)?);
        }
        let (emission, bytes) = (self.emission().clone(), self.most_products());
        let (solution, info, products) = self.solve_reflected(emission, &self.known, bytes, params, progress)?;
        if params.tolerance >= FARTHEST {
            self.found.get_or_init(|| products);
        }
        Ok((solution, info))
    }

    /// The same for another emission, given by its integrals ∫B⁰N_i against the broken functions; one column per band, or
    /// any number of columns where the scene has one band: a hundred suns are a hundred right-hand sides, and go through
    /// one pass of the operator.
    ///
    /// # Errors
    /// [`SolveError`].
    ///
    /// # Panics
    /// If the number of rows is not that of the broken coefficients.
    pub fn solve_for(
        &self,
        load: &MultiVector,
        kind: solve::Kind,
        params: &solve::Params,
        progress: &dyn Progress,
    ) -> Result<(Solution, Info), SolveError> {
        match (kind, self.root_reflectance()) {
            (solve::Kind::Cg, Some(root)) => self.solve_symmetric(load, &root, params, progress),
            (solve::Kind::Neumann, _) => self.solve_by_bounces(load, params, progress),
            _ => self
                .solve_reflected(self.emission_of(load), &Products::default(), 0, params, progress)
                .map(|(solution, info, _)| (solution, info)),
        }
    }

    /// Whether all that is asked of what arrives are its integrals against the joined functions: R does not vary on what is
    /// joined, which is of one material, and the irradiance of a sampled operator is joined as well.
    fn collects(&self) -> bool {
        !self.exchange.is_symmetric() && self.is_reflectance_uniform()
    }

    /// Whether no material's reflectance varies from place to place.
    fn is_reflectance_uniform(&self) -> bool {
        let uniform = |m: &Material| (0..self.scene.bands).all(|band| m.reflectance.uniform(band).is_some());
        self.scene.materials.iter().all(uniform)
    }

    /// The solution whose radiosity has these broken coefficients.
    fn solution(&self, radiosity: MultiVector, progress: &dyn Progress) -> Result<Solution, Interrupted> {
        let arrived = self.exchange.times_watched(&radiosity, progress)?;
        Ok(self.solution_of(radiosity, arrived, false).0)
    }

    /// The same, if `arrived` is S of it, or that collected. What a sampled operator has from lamps alone is not averaged
    /// ([`Exchange::steady`]); here it is, too.
    fn solution_of(
        &self,
        radiosity: MultiVector,
        arrived: MultiVector,
        collected: bool,
    ) -> (Solution, Option<MultiVector>) {
        let steady = self.exchange.steady(&radiosity);
        let irradiance = match &steady {
            None if collected => self.averaged(arrived),
            None => self.irradiance_of(arrived),
            Some(steady) => {
                let mut rest = if collected { arrived } else { self.join.collect(Cow::Owned(arrived)).into_owned() };
                rest.add_scaled(-1.0, &self.join.collect(Cow::Borrowed(steady)));
                let mut irradiance = self.averaged(rest);
                irradiance.add_scaled(1.0, &self.mass_inverse.times(steady));
                irradiance
            }
        };
        (Solution { scene: self.scene.clone(), space: self.space.clone(), radiosity, irradiance }, steady)
    }

    /// A solution whose irradiance is averaged also where what is steady in it is noise. That is looked at in as many bands at a
    /// time as have so many numbers.
    fn without_noise(&self, mut solution: Solution, steady: Option<MultiVector>, numbers: usize) -> Solution {
        let Some(steady) = steady.filter(|_| self.space.continuity().is_some()) else { return solution };
        let averaging = InverseMass { tolerance: ROUGH_MASS_TOLERANCE, ..self.inverse_mass() };
        let rows = steady.rows().max(1);
        let at_once = (numbers / rows).min(steady.bands()).max(1);
        for (part, irradiance) in solution.irradiance.as_mut_slice().chunks_mut(rows * at_once).enumerate() {
            let bands: Vec<usize> = (part * at_once..).take(irradiance.len() / rows).collect();
            let [radiosity, steady] = [&solution.radiosity, &steady].map(|x| {
                if bands.len() == x.bands() { Cow::Borrowed(x) } else { Cow::Owned(x.some(&bands, |_, x| x)) }
            });
            let Some(noise) = self.exchange.steady_noise(&radiosity) else { break };
            let noise = self.mass_inverse.times_owned(noise);
            let change = self.change_by(&averaging, &steady);
            remove_noise(&self.scene.mesh, &self.space, &self.mass, [&change, &noise], irradiance);
        }
        solution
    }

    /// What averaging changes of the broken function with these integrals.
    fn change_by(&self, averaging: &InverseMass<'_>, integrals: &MultiVector) -> MultiVector {
        let averaged = averaging.times(&self.join.collect(Cow::Borrowed(integrals)));
        let mut change = self.join.spread(Cow::Owned(averaged)).into_owned();
        change.add_scaled(-1.0, &self.mass_inverse.times(integrals));
        change
    }

    /// The irradiance with these integrals against the broken functions. It is the projection Δ⁻¹ S b onto the *broken*
    /// space, joined or not: more accurate than on hats where shadows have sharp edges, and it costs no solve. Of a
    /// sampled operator it is the projection onto the joined space, which averages the noise of the cells that meet (and
    /// would blur the shadows of lamps, which are therefore left out: [`Exchange::steady`]).
    fn irradiance_of(&self, arrived: MultiVector) -> MultiVector {
        if self.exchange.is_symmetric() {
            self.mass_inverse.times_owned(arrived)
        } else {
            self.averaged(self.join.collect(Cow::Owned(arrived)).into_owned())
        }
    }

    /// The joined function with these integrals against the joined functions, in the broken space.
    fn averaged(&self, collected: MultiVector) -> MultiVector {
        self.join.spread(Cow::Owned(self.inverse_mass().times_owned(collected))).into_owned()
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
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn energy(&self, solution: &Solution, progress: &dyn Progress) -> Result<Energy, Interrupted> {
        let total = |x: &[f64]| x.iter().sum::<f64>();
        // ∫ of each band of a function, one at a time: of millions of cells each vector is large.
        let integrals = |function: &MultiVector| -> Vec<f64> {
            (0..self.scene.bands).map(|band| total(self.mass.times(&function.one_band(band)).as_slice())).collect()
        };
        // Joining keeps the power of what is joined, and that is of one material: where R does not vary on it, the
        // irradiance has the sums of what arrived.
        let irradiance = if self.is_reflectance_uniform() {
            Cow::Borrowed(&solution.irradiance)
        } else {
            Cow::Owned(self.mass_inverse.times(&self.exchange.times_watched(&solution.radiosity, progress)?))
        };
        let reflected = self.weighted_mass().times(&irradiance);
        let [leaving, arrived] = [&solution.radiosity, &*irradiance].map(integrals);
        let less = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect();
        let reflected: Vec<f64> = reflected.iter_bands().map(total).collect();
        Ok(Energy {
            emitted: self.load().iter_bands().map(total).collect(),
            absorbed: less(&arrived, &reflected),
            escaped: less(&leaving, &arrived),
            leaving,
        })
    }

    /// Irradiance at any point, from a solution of this system.
    pub fn gather<'a>(&'a self, solution: &'a Solution) -> Gather<'a> {
        let panels = self.panels();
        let panorama = self.panorama.get_or_init(|| Panorama::new(panels));
        let strengths = self.strengths.get_or_init(|| strengths(&self.scene, &self.blockers));
        Gather { panels, panorama, cells: None, views: self.views(), strengths, solution }
    }

    /// What surfaces reflect, again and again, if they emit a function of the broken space: (I − RK)⁻¹RK of it, to two
    /// digits, as errors and what matters are estimated, in the broken space. The first reflection is that of the function as it is; the others, which K has made
    /// smooth, are computed in the joined space.
    ///
    /// # Errors
    /// [`SolveError`].
    pub fn reflections(&self, emission: &MultiVector, progress: &dyn Progress) -> Result<MultiVector, SolveError> {
        if emission.as_slice().iter().all(|&value| value == 0.0) {
            return Ok(emission.clone());
        }
        let params = solve::Params { tolerance: REFLECTIONS, ..Default::default() };
        let mut once = self.reflected(&self.solution(emission.clone(), progress)?);
        let (again, _) = self.solve_for(&self.mass.times(&once), self.best_solver(), &params, progress)?;
        once.add_scaled(1.0, &self.reflected(&again));
        Ok(once)
    }

    /// Δ⁻¹ b⁰: what the scene emits, in the broken space.
    pub(super) fn projected_emission(&self) -> MultiVector {
        self.mass_inverse.times(self.load())
    }

    /// Δ⁻¹ M_R e in the broken space: the irradiance of a solution, reflected.
    fn reflected(&self, solution: &Solution) -> MultiVector {
        self.mass_inverse.times(&self.weighted_mass().times(&solution.irradiance))
    }

    /// Δ⁻¹(b⁰ + M_R e) in the broken space: a solution of this system reflected once more.
    pub(super) fn reflected_once_more(&self, solution: &Solution) -> MultiVector {
        let mut g = self.reflected(solution);
        g.add_scaled(1.0, &self.projected_emission());
        g
    }

    /// b⁰ against the broken functions.
    fn load(&self) -> &MultiVector {
        self.load.get_or_init(|| load(&self.scene, &self.space))
    }

    /// A solution's light but for what the solver was given of the emission, in the broken space.
    pub(super) fn reflected_light(&self, solution: &Solution) -> MultiVector {
        let mut light = solution.radiosity.clone();
        light.add_scaled(-1.0, &self.join.spread(Cow::Borrowed(self.emission())));
        light
    }

    /// The joined function that is nearest to the scene's emission.
    fn emission(&self) -> &MultiVector {
        self.emission.get_or_init(|| self.emission_of(self.load()))
    }

    /// The same, given the integrals of the emission against the broken functions.
    fn emission_of(&self, load: &MultiVector) -> MultiVector {
        self.inverse_mass().times(&self.join.collect(Cow::Borrowed(load)))
    }

    /// M_R of the broken space.
    fn weighted_mass(&self) -> &BlockDiagonal {
        self.reflectance.get_or_init(|| Arc::new(weighted_mass(&self.scene, &self.space)))
    }

    /// Δ of the broken space.
    pub(super) fn mass(&self) -> &BlockDiagonal {
        &self.mass
    }

    fn joined_mass(&self) -> Mass<'_> {
        Mass { join: &self.join, mass: &self.mass }
    }

    fn inverse_mass(&self) -> InverseMass<'_> {
        let tolerance = MASS_TOLERANCES[usize::from(!self.exchange.is_symmetric())];
        InverseMass { rough: &self.rough, tolerance }
    }
}

//! What a solve did, as numbers with names: the one source of the summary that people read and of the JSON that scripts
//! read.
//!
//! The names and the nesting are an interface: fields are added, never renamed. Numbers are in the units of the scene
//! (lm, lx or W, W/m²), lengths in metres, errors and fractions relative to 1, and lists have one entry per band.

mod bright;

pub use bright::BrightReport;

use crate::adapt::{self, Adapted};
use crate::certificate::Certificate;
use crate::linalg::{LinearOperator, MultiVector};
use crate::mesh::Mesh;
use crate::radiosity::{Solution, Solved};
use crate::scene::{Physics, Scene};
use serde::Serialize;
use std::collections::HashMap;
use std::time::Duration;

/// What is known after a solve.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Number of elements: cells of the subdivided mesh.
    pub elements: usize,
    /// Number of unknowns per band.
    pub dofs: usize,
    /// Name of the basis.
    pub basis: &'static str,
    /// `continuous` or `broken`.
    pub continuity: &'static str,
    /// Number of bands.
    pub bands: usize,
    /// What was given.
    pub scene: SceneReport,
    /// The exchange operator.
    pub operator: OperatorReport,
    /// The solver.
    pub solver: SolverReport,
    /// Where the power went.
    pub energy: EnergyReport,
    /// The same, object by object and material by material.
    pub parts: Vec<PartReport>,
    /// What is known of the row sums of the operator.
    pub closure: ClosureReport,
    /// How wrong the solution may be; `None` if nobody asked.
    pub error: Option<ErrorReport>,
    /// Where most of the square of the norm is that errors are relative to; `None` if nothing is reflected, no error was asked for, or
    /// only that in a focus.
    pub bright: Option<BrightReport>,
    /// What the error is proven not to exceed, if that was asked for.
    pub certificate: Option<CertificateReport>,
    /// How the mesh was refined; `None` if it was given.
    pub adaptivity: Option<AdaptivityReport>,
}

/// How the mesh was refined.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AdaptivityReport {
    /// The estimate that was asked for.
    pub tolerance: f64,
    /// Whether it was reached; if not, more coefficients would have been needed than allowed.
    pub reached: bool,
    /// The most coefficients per band that were allowed.
    pub most_coefficients: usize,
    /// The rounds, in order.
    pub rounds: Vec<RoundReport>,
}

/// One mesh of several.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RoundReport {
    /// Number of elements.
    pub elements: usize,
    /// Unknowns per band.
    pub dofs: usize,
    /// The estimated error.
    pub estimate: f64,
    /// Time it took.
    pub seconds: f64,
}

/// The scene as it was given.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneReport {
    /// `light` or `heat`.
    pub physics: &'static str,
    /// Faces of the input, after welding.
    pub faces: usize,
    /// Area of all sides that carry light, in m².
    pub area: f64,
    /// Extents along x, y and z, in metres.
    pub size: [f64; 3],
}

/// What the exchange operator cost and how wrong it may be.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OperatorReport {
    /// Its kind.
    pub kind: &'static str,
    /// Why that kind was chosen; `None` if it was asked for.
    pub reason: Option<String>,
    /// The norm of Δ^-½ S Δ^-½ from below: at most 1 but for the operator's error.
    pub norm: f64,
    /// Memory of its coefficients.
    pub bytes: usize,
    /// The fraction of the elements whose rays are cast again whenever it is applied, since memory does not hold them.
    pub recast: f64,
    /// Rays cast.
    pub rays: u64,
    /// Pairs of elements that exchange light.
    pub pairs: u64,
    /// Pairs among them that were proven to see each other fully.
    pub clear_pairs: u64,
    /// Time to build it.
    pub seconds: f64,
    /// Estimated relative error of the worst row's sum from quadrature.
    pub quadrature_error: f64,
    /// Estimated relative error of the worst row's sum from sampled visibility.
    pub visibility_error: f64,
}

/// What the solver did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SolverReport {
    /// Its name.
    pub kind: &'static str,
    /// Iterations of the slowest band.
    pub iterations: usize,
    /// The greatest relative residual of all bands.
    pub residual: f64,
    /// Time it took.
    pub seconds: f64,
}

/// Where the power went, per band, in lm or W.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EnergyReport {
    /// What the emitters emit.
    pub emitted: Vec<f64>,
    /// What leaves the surfaces, emitted and reflected.
    pub leaving: Vec<f64>,
    /// What the surfaces keep.
    pub absorbed: Vec<f64>,
    /// What leaves the scene or falls on unlit backs.
    pub escaped: Vec<f64>,
    /// |emitted − absorbed − escaped| / emitted, the greatest of all bands.
    pub defect: f64,
    /// Mean irradiance by area, in lx or W/m².
    pub mean_irradiance: Vec<f64>,
}

/// What arrives at a part of the scene, the faces of one object and material, and what leaves it; lists have an entry per band.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PartReport {
    /// Name of the object.
    pub object: String,
    /// Name of the material.
    pub material: String,
    /// Its area in m².
    pub area: f64,
    /// Number of its elements.
    pub elements: usize,
    /// ∫E, in lm or W.
    pub arriving: Vec<f64>,
    /// ∫B, in lm or W.
    pub leaving: Vec<f64>,
    /// ∫B − ∫E: the power that it gives off on balance; negative where it takes more than it gives.
    pub net: Vec<f64>,
    /// Mean irradiance by area, in lx or W/m².
    pub mean_irradiance: Vec<f64>,
    /// The least mean irradiance of an element. Relative to the mean it is the uniformity that lighting codes ask for, as
    /// far as elements tell; those in a hard shadow may be a little below zero.
    pub least_irradiance: Vec<f64>,
    /// The greatest mean irradiance of an element.
    pub greatest_irradiance: Vec<f64>,
}

/// What is known of the row sums.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClosureReport {
    /// Fraction of rays that leave the scene; 0 in a closed one.
    pub escape: f64,
    /// Share of the area that lies under other faces, and sees nothing.
    pub covered: f64,
    /// Share of the area of cells that are in enclosures from which nothing escapes; 1 in a closed scene.
    pub enclosed: f64,
    /// The worst row's deviation from what a closed scene must have, before balancing; of cells that are enclosed, if any are.
    pub deficit: f64,
    /// Whether the operator was balanced to exact row sums on these.
    pub balanced: bool,
    /// What the operator was multiplied by on the others to lose what rays see escape.
    pub factor: f64,
}

/// A bound of the error of the solution.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CertificateReport {
    /// The relative L2 error of the reflected light, at the most.
    pub bound: f64,
    /// The relative residual of the equation, at the most, in the worst band.
    pub residual: f64,
    /// The greatest reflectance in that band: the bound is the residual's divided by 1 less it.
    pub reflectance: f64,
    /// Parts of elements on which it was bounded.
    pub receivers: usize,
    /// Time that took.
    pub seconds: f64,
}

impl CertificateReport {
    /// From a bound and the time it took.
    pub fn new(found: &Certificate, time: Duration) -> Self {
        let Certificate { relative, residual, reflectance, receivers } = *found;
        Self { bound: relative, residual, reflectance, receivers, seconds: time.as_secs_f64() }
    }
}

/// How wrong the solution may be.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ErrorReport {
    /// `estimated`: from samples, not a bound.
    pub kind: &'static str,
    /// Relative L2 error of the reflected light.
    pub estimate: f64,
    /// Relative residual of the equation at points that the solver never saw.
    pub residual: f64,
    /// What the residual causes elsewhere by reflection; the estimate is the sum of the two.
    pub propagated: f64,
    /// Of the residual, what textures lose by projection.
    pub data: f64,
    /// Of the residual, the rest: elements too large for the light on them, and the operator's part.
    pub discretisation: f64,
    /// What joining has taken away from elements that are joined where faces bend; of sampled operators, of lamps' light only.
    pub bends: f64,
    /// The residuals relative to the light there that half of the area does not exceed, and nine tenths.
    pub pointwise: [f64; 2],
    /// The emitted over the leaving power.
    pub absorption: f64,
    /// Computation, the operator's part: what its errors of quadrature and visibility change of the reflected light, in the norm
    /// of the others.
    pub operator: f64,
    /// The solver's part.
    pub solver: f64,
    /// Time it took to estimate.
    pub seconds: f64,
}

impl Report {
    /// What is likely not meant: nothing is emitted, or what is arrives nowhere.
    pub fn warnings(&self) -> Vec<String> {
        if self.energy.emitted.iter().all(|&power| power == 0.0) {
            return vec![
                "nothing shines: no face has an exitance, or a temperature and an emissivity; give one to its material"
                    .to_owned(),
            ];
        }
        let is_dark = self.energy.mean_irradiance.iter().all(|&mean| mean == 0.0);
        // A lamp that stands alone lights nothing.
        let is_alone = self.parts.iter().all(|part| part.leaving.iter().sum::<f64>() > 0.0);
        let warning =
            "nothing of what is emitted arrives at any surface; lit sides may look outwards, `hatbox check` tells";
        (is_dark && !is_alone).then(|| warning.to_owned()).into_iter().collect()
    }

    /// From what was given and what came out of refinement to a tolerance.
    pub fn adapted(given: &Scene, options: &adapt::Options, adapted: &Adapted) -> Self {
        let round = |round: &adapt::Round| RoundReport {
            elements: round.elements,
            dofs: round.unknowns,
            estimate: round.estimate,
            seconds: round.time.as_secs_f64(),
        };
        let adaptivity = AdaptivityReport {
            tolerance: options.tolerance,
            reached: adapted.reached,
            most_coefficients: adapted.most_coefficients,
            rounds: adapted.rounds.iter().map(round).collect(),
        };
        let report = Self::new(given, &adapted.solved);
        let bright = report.bright.filter(|_| options.focus.is_none());
        Self { adaptivity: Some(adaptivity), bright, ..report }
    }

    /// From what was given and what came out.
    pub fn new(given: &Scene, solved: &Solved) -> Self {
        let solution = &solved.solution;
        let parts = parts(solution);
        Self {
            elements: solution.space.cells(),
            dofs: solved.unknowns,
            basis: solution.space.basis().name,
            continuity: if solution.space.continuity().is_some() { "continuous" } else { "broken" },
            bands: solution.bands(),
            scene: SceneReport::new(given),
            operator: operator(solved),
            solver: SolverReport {
                kind: crate::solve::ALL.iter().find(|solver| solver.kind == solved.solver).map_or("", |s| s.name),
                iterations: solved.info.iterations,
                residual: solved.info.residual,
                seconds: solved.solver_time.as_secs_f64(),
            },
            energy: energy(solved, &parts),
            parts,
            closure: ClosureReport {
                escape: solved.closure.escape,
                covered: solved.closure.covered,
                enclosed: solved.closure.enclosed,
                deficit: solved.closure.deficit,
                balanced: solved.closure.balanced,
                factor: solved.closure.factor,
            },
            certificate: None,
            bright: solved.error.and_then(|_| BrightReport::new(solution)),
            error: solved.error.map(|e| ErrorReport {
                kind: "estimated",
                estimate: e.relative,
                residual: e.residual,
                propagated: e.propagated,
                data: e.data,
                discretisation: e.discretisation,
                bends: e.bends,
                pointwise: e.pointwise,
                absorption: e.absorption,
                operator: e.operator,
                solver: e.solver,
                seconds: solved.error_time.as_secs_f64(),
            }),
            adaptivity: None,
        }
    }
}

impl SceneReport {
    /// The facts about a scene.
    pub fn new(scene: &Scene) -> Self {
        let physics = match scene.physics {
            Physics::Light => "light",
            Physics::Heat => "heat",
        };
        Self { physics, faces: scene.surfaces.len(), area: scene.mesh.area(), size: size(&scene.mesh) }
    }
}

/// The extents of a mesh; zero if it has no vertices.
fn size(mesh: &Mesh) -> [f64; 3] {
    let (low, high) = mesh.bounds();
    (high - low).max(glam::DVec3::ZERO).to_array()
}

fn operator(solved: &Solved) -> OperatorReport {
    let statistics = &solved.operator;
    OperatorReport {
        kind: solved.operator_kind,
        reason: solved.operator_reason.clone(),
        norm: solved.operator_norm,
        bytes: statistics.bytes,
        recast: statistics.recast,
        rays: statistics.rays,
        pairs: statistics.pairs,
        clear_pairs: statistics.clear_pairs,
        seconds: solved.operator_time.as_secs_f64(),
        quadrature_error: statistics.quadrature_error,
        visibility_error: statistics.visibility_error,
    }
}

fn energy(solved: &Solved, parts: &[PartReport]) -> EnergyReport {
    let (energy, area) = (&solved.energy, parts.iter().map(|part| part.area).sum::<f64>());
    let arriving = |band: usize| parts.iter().map(|part| part.arriving[band]).sum::<f64>();
    EnergyReport {
        emitted: energy.emitted.clone(),
        leaving: energy.leaving.clone(),
        absorbed: energy.absorbed.clone(),
        escaped: energy.escaped.clone(),
        defect: energy.defect(),
        mean_irradiance: (0..solved.solution.bands()).map(|band| arriving(band) / area).collect(),
    }
}

/// The parts of a solved scene, in the order in which the mesh has them.
fn parts(solution: &Solution) -> Vec<PartReport> {
    let (mesh, bands) = (&solution.scene.mesh, solution.bands());
    let mass = crate::assemble::mass(&solution.scene, &solution.space);
    let [arriving, leaving] = [&solution.irradiance, &solution.radiosity].map(|function| mass.times(function));
    let mut places: HashMap<(u32, u32), usize> = HashMap::new();
    let mut parts: Vec<PartReport> = Vec::new();
    for (cell, of) in mesh.cells.iter().enumerate() {
        let place = *places.entry((of.group, of.material)).or_insert_with(|| {
            let object = mesh.groups.get(of.group as usize).cloned().unwrap_or_default();
            parts.push(PartReport::empty(object, solution.scene.material(cell).name.clone(), bands));
            parts.len() - 1
        });
        let over = |integrals: &MultiVector, band: usize| -> f64 {
            integrals.band(band)[solution.space.range(cell)].iter().sum()
        };
        let powers = |band: usize| [over(&arriving, band), over(&leaving, band)];
        parts[place].add(mesh.patch(cell).area(), powers);
    }
    for part in &mut parts {
        part.net = part.leaving.iter().zip(&part.arriving).map(|(b, e)| b - e).collect();
        part.mean_irradiance = part.arriving.iter().map(|e| e / part.area).collect();
    }
    parts
}

impl PartReport {
    fn empty(object: String, material: String, bands: usize) -> Self {
        Self {
            object,
            material,
            area: 0.0,
            elements: 0,
            arriving: vec![0.0; bands],
            leaving: vec![0.0; bands],
            net: Vec::new(),
            mean_irradiance: Vec::new(),
            least_irradiance: vec![f64::INFINITY; bands],
            greatest_irradiance: vec![f64::NEG_INFINITY; bands],
        }
    }

    /// Adds an element; `powers` are ∫E and ∫B over it in a band.
    fn add(&mut self, area: f64, powers: impl Fn(usize) -> [f64; 2]) {
        self.area += area;
        self.elements += 1;
        for band in 0..self.arriving.len() {
            let [arriving, leaving] = powers(band);
            self.arriving[band] += arriving;
            self.leaving[band] += leaving;
            self.least_irradiance[band] = self.least_irradiance[band].min(arriving / area);
            self.greatest_irradiance[band] = self.greatest_irradiance[band].max(arriving / area);
        }
    }
}

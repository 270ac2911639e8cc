//! Meshes that follow the light: solve, estimate, refine, until the error is what was asked for.
//!
//! A round solves on the mesh at hand, estimates ‖B − B̃‖/‖B̃ − B⁰‖, and, if that is too much, refines the cells that
//! indicate the greatest errors, as often as it is predicted to take (`marking`); or it builds a stricter operator on the same
//! mesh, if that is what is wrong; as long as the error is far from what is asked for, operators are looser (`strictness`).
//! Indicators are those of [`local_error`](radiosity::local_error), raised where the points of the estimate saw more. Everything
//! that the mesh decides follows by itself: elements become small where a shadow's border passes and towards the edges of rooms. Only borders narrower than the
//! first elements are cut into them beforehand (`borders`).
//!
//! A first mesh that is graded towards the edges of faces is the user's choice. To grade it always was tried: in
//! an empty cube linear functions need fewer unknowns, but on the Cornell box, where shadows decide, estimates are greater with
//! as many (`hatbox solve scenes/cornell-box.glb --basis quadratic --tolerance 0.5% --grading 3 --max-unknowns 12000`). Nor do
//! linear functions need it for their order. Where B is like r^β at a distance r from an edge, elements of size h err by
//! h^(p+1) r^(β−p−1); errors are spread evenly by h ~ r^((p+1−β)/(p+2)), which halving finds by itself. Of such cells there are
//! ∫ h⁻² dr, finite if p < 2β; else those along the edge are most of them, and the order (in the root of their number) is 2β + 1.
//! At right angles β is 0.76 to 0.58 for ρ = 0.5 to 0.9: linear functions have their order 2, quadratic ones 2.5 to 2.2, where cells
//! that are long along the edge, as grading makes them, have 3, and uniform meshes β + ½.
//!
//! Orders are not mixed. Linear functions were tried on cells that are to be refined where quadratic ones do not pay: where what
//! these add to linear ones is no more than the indicated error. For the same estimate that took as many unknowns on the
//! Cornell box, and hardly fewer in two rooms: under a lamp that is no point the light has a continuous slope at the
//! borders of half-shadows, and quadratic functions do pay there.
//!
//! What a round has found to be bright, such as the inside of a lamp's housing, is no lamp of the next round's rays. That was tried, from
//! ten times the mean irradiance on: what such a lamp on a post lights became more exact, but inside a bright housing
//! faces that fill each other's view were sampled as lamps are, far worse than by rays.
//!
//! Every round builds its operator afresh. Blocks of cells that did not change could be copied from the last one: vertices
//! keep their numbers and rays are seeded by them, so that the copies would be the same to the last bit. That is not
//! done: where meshes grow by a half, neighbours included, at most two thirds of the new cells are old and less than half of their
//! pairs; where they double, a third and a ninth.

mod borders;
mod focus;
mod marking;
mod strictness;

pub use focus::{Focus, NothingInFocus};

use crate::exchange::{self, Problem, Sampled};
use crate::mesh::Refinement;
use crate::progress::Progress;
use crate::radiosity::{self, Error, Estimated, Solution, Solved, System};
use crate::scene::Scene;
use crate::solve::SolveError;
use crate::visibility::Bvh;
use borders::with_sharp_borders;
use marking::Marking;
use std::sync::Arc;
use std::time::{Duration, Instant};
use strictness::Strictness;

/// Of a residual seen at a cell's points, as much of its square is believed of the cell at least.
const BELIEVED: f64 = 0.25;

/// What is asked for.
#[derive(Debug, Clone)]
pub struct Options {
    /// Basis, continuity, operator, solver, seed, points of the estimate. [`refinement`](radiosity::Options::refinement)
    /// makes the first mesh; the operator's tolerance is set by the one below.
    pub solve: radiosity::Options,
    /// The greatest ‖B − B̃‖/‖B̃ − B⁰‖, estimated.
    pub tolerance: f64,
    /// Refinement stops before there are more coefficients per band than this in the broken space, where the operator
    /// lives; as many as its kind [may have](Self::most_coefficients) if not given.
    pub most_coefficients: Option<usize>,
    /// Where the error counts; everywhere if not given.
    pub focus: Option<Focus>,
}

impl Default for Options {
    /// Joined linear functions to 2 %, from about 400 elements on.
    fn default() -> Self {
        let solve = radiosity::Options { refinement: Refinement::Elements(400), ..radiosity::Options::default() };
        Self { solve, tolerance: 0.02, most_coefficients: None, focus: None }
    }
}

impl Options {
    /// Coefficients per band at the most, if the first mesh has so many cells.
    pub fn most_coefficients(&self, first: usize) -> usize {
        let exchange::Kind { most_coefficients, most_growth, .. } = *self.solve.operator;
        let grown = (most_growth * (first * self.dofs()) as f64).ceil() as usize;
        self.most_coefficients.unwrap_or(most_coefficients.max(grown))
    }

    /// Coefficients of a cell.
    fn dofs(&self) -> usize {
        self.solve.basis.triangle.dofs()
    }

    /// Makes sure that there is something in focus.
    ///
    /// # Errors
    /// [`NothingInFocus`] if no cell would lie in it, however fine, or none that reflects: the error is that of the reflected light.
    pub fn check_focus(&self, scene: &Scene) -> Result<(), NothingInFocus> {
        let Some(focus) = &self.focus else { return Ok(()) };
        // For cells in focus whether they reflect.
        let found = |scene: &Scene| -> Vec<bool> {
            let cells = focus.cells(scene).into_iter().enumerate().filter(|(_, is_in)| *is_in);
            cells.map(|(cell, _)| reflects(scene, cell)).collect()
        };
        let mut of_cells = found(scene);
        // A box may hold no middle of a face, or of a black one only, and yet middles of smaller cells. (What cannot be refined is
        // told elsewhere.)
        if !of_cells.contains(&true) && matches!(focus, Focus::Box(..)) {
            let most = self.most_coefficients(scene.mesh.cells.len()) / self.dofs();
            let fine = scene.refined(Refinement::Elements(most), self.solve.basis);
            of_cells = fine.map_or(vec![true], |fine| found(&fine));
        }
        let is_black = !of_cells.is_empty();
        if of_cells.contains(&true) { Ok(()) } else { Err(NothingInFocus::of(focus, scene, is_black)) }
    }
}

/// One round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Round {
    /// Number of elements.
    pub elements: usize,
    /// Unknowns per band.
    pub unknowns: usize,
    /// The estimated relative error.
    pub estimate: f64,
    /// Time it took.
    pub time: Duration,
}

/// A solution, and how its mesh came to be.
#[derive(Debug, Clone)]
pub struct Adapted {
    /// What was solved last: it can be relit and repainted.
    pub system: System,
    /// The last round's solution.
    pub solved: Solved,
    /// The rounds, in order.
    pub rounds: Vec<Round>,
    /// Whether the estimate is at most the tolerance. If not, the next mesh would have had too many coefficients.
    pub reached: bool,
    /// Coefficients per band that it might have at the most.
    pub most_coefficients: usize,
}

/// Solves to a tolerance.
///
/// # Errors
/// [`Error`]; nothing is left behind.
pub fn solve(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Adapted, Error> {
    let mut settings = options.solve;
    let mut scene = first_mesh(scene, &settings)?;
    let most_coefficients = options.most_coefficients(scene.mesh.cells.len());
    let most = most_coefficients / options.dofs();
    if let Some(focus) = &options.focus {
        scene = in_focus(scene, focus, most);
    }
    let blockers = Arc::new(Bvh::of_surfaces(&scene.surfaces));
    let (mut rounds, mut marking, mut parents) = (Vec::new(), Marking::new(), Vec::new());
    // Without an estimate the first operator is the last.
    let mut strictness = Strictness::new(options.tolerance, settings.error_points > 0);
    loop {
        let started = Instant::now();
        let asked = strictness.asked();
        let strengths = radiosity::strengths(&scene, &blockers);
        let (kind, why) = options.solve.operator.chosen(&problem(&scene, &blockers, &strengths, options, asked));
        (settings.operator, settings.tolerance) = (kind, strictness.tolerance([kind.looseness, kind.slack]));
        let mut system = System::of_strengths(scene, Arc::clone(&blockers), strengths, &settings, progress)?;
        system.operator_reason = why;
        let Found { solved, estimated, importance } = solved_in_focus(&system, &settings, options, progress)?;
        let estimate = estimated.as_ref().map_or(0.0, |estimated| estimated.error.relative);
        let elements = solved.solution.space.cells();
        rounds.push(Round { elements, unknowns: solved.unknowns, estimate, time: started.elapsed() });
        if estimated.as_ref().is_some_and(|estimated| strictness.is_raised_for(estimated.error.operator, estimate)) {
            scene = system.scene;
            continue;
        }
        let too_much = estimate.is_nan() || estimate > options.tolerance;
        let Some(estimated) = estimated.filter(|_| too_much) else {
            return Ok(Adapted { system, solved, rounds, reached: true, most_coefficients });
        };
        strictness.come_to(estimate);
        let squares = error_squares(&solved.solution, &estimated, importance.as_deref());
        marking.learn(&squares, &parents);
        // Predictions are pessimistic: what came was 0.7 to 0.9 of them on the sample scenes.
        let goal = (options.tolerance / estimate).powi(2);
        let planned = most.min((kind.growth * elements as f64).ceil() as usize);
        match finer_mesh(&solved.solution.scene, squares, &mut marking, goal, [planned, most]) {
            Some(finer) => (scene, parents) = finer,
            None if strictness.ends_its_slack() => scene = system.scene,
            None => return Ok(Adapted { system, solved, rounds, reached: false, most_coefficients }),
        }
    }
}

/// Whether a cell's material reflects light anywhere.
fn reflects(scene: &Scene, cell: usize) -> bool {
    let reflectance = &scene.material(cell).reflectance;
    (0..scene.bands).any(|band| reflectance.uniform(band) != Some(0.0))
}

/// What a round has found, and how much the error of each cell counts, if not alike.
struct Found {
    solved: Solved,
    estimated: Option<Estimated>,
    importance: Option<Vec<f64>>,
}

/// Solves, and estimates the error where it counts.
fn solved_in_focus(
    system: &System,
    settings: &radiosity::Options,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Found, Error> {
    let mut importance = None;
    let within = |system: &System, solution: &Solution| -> Result<_, SolveError> {
        let cells = options.focus.as_ref().map(|focus| focus.cells(&system.scene));
        if let Some(cells) = &cells {
            importance = Some(focus::importance(system, solution, cells, progress)?);
        }
        Ok(cells)
    };
    let (solved, estimated) = system.solved_within(settings, options.tolerance, within, progress)?;
    Ok(Found { solved, estimated, importance })
}

/// What an operator is to be chosen for, if the light is asked to a tolerance.
fn problem<'a>(
    scene: &'a Scene,
    blockers: &'a Bvh,
    strengths: &'a [f64],
    options: &Options,
    tolerance: f64,
) -> Problem<'a> {
    let coefficients = scene.mesh.cells.len() * options.dofs();
    let of_rays = exchange::kind(Sampled::NAME).map_or(1.0, |kind| kind.looseness);
    Problem { scene, blockers, strengths, coefficients, tolerance: of_rays * tolerance, memory: options.solve.memory }
}

/// The next mesh, and the cell that each of its cells is a piece of; `None` if there is no error to refine for (what is
/// left is not the elements') or too little room. It is planned to have so many cells and may have so many: neighbours that are
/// halved with them come on top.
fn finer_mesh(
    scene: &Scene,
    squares: Vec<f64>,
    marking: &mut Marking,
    goal: f64,
    [planned, most]: [usize; 2],
) -> Option<(Scene, Vec<u32>)> {
    let cells = scene.mesh.cells.len();
    let mut budget = planned;
    while budget > cells {
        let levels = marking.levels(&squares, goal, budget);
        let (finer, parents) = refined(scene, &levels);
        let found = finer.mesh.cells.len();
        if found == cells {
            break;
        }
        if found <= most {
            marking.decide(squares, levels);
            return Some((finer, parents));
        }
        // Neighbours are halved, too, which nobody has planned.
        budget = (budget * most / found).min(budget - 1);
    }
    None
}

/// The scene with each cell refined so many times, once or twice, and the cell that each is a piece of.
fn refined(scene: &Scene, levels: &[u8]) -> (Scene, Vec<u32>) {
    let once: Vec<bool> = levels.iter().map(|&level| level > 0).collect();
    let (scene, parents) = scene.bisected(&once);
    let twice: Vec<bool> = parents.iter().map(|&parent| levels[parent as usize] > 1).collect();
    if !twice.contains(&true) {
        return (scene, parents);
    }
    let (scene, second) = scene.bisected(&twice);
    let parents = second.iter().map(|&parent| parents[parent as usize]).collect();
    (scene, parents)
}

/// Triangles to start from.
fn first_mesh(scene: &Scene, settings: &radiosity::Options) -> Result<Scene, Error> {
    // Grading is towards the edges of faces, which must not be cut.
    if settings.grading > 1.0 {
        return Ok(scene.refined_graded(settings.refinement, settings.grading, settings.basis)?.triangulated());
    }
    let size = match settings.refinement {
        Refinement::None => scene.mesh.area().sqrt(),
        Refinement::MaxEdge(length) => length,
        Refinement::Elements(n) => (scene.mesh.area() / n as f64).sqrt(),
    };
    let scene = with_sharp_borders(scene, size).triangulated();
    Ok(scene.refined(settings.refinement, settings.basis)?.triangulated())
}

/// The scene halved all over until some cell is in focus, as long as it has no more than `most`.
fn in_focus(mut scene: Scene, focus: &Focus, most: usize) -> Scene {
    while !focus.cells(&scene).contains(&true) && 4 * scene.mesh.cells.len() <= most {
        scene = scene.bisected(&vec![true; scene.mesh.cells.len()]).0;
    }
    scene
}

/// The square of the error of each cell relative to the reflected light, times its importance: their sum is the estimate's
/// square.
fn error_squares(solution: &Solution, estimated: &Estimated, importance: Option<&[f64]>) -> Vec<f64> {
    let Estimated { error, seen, indicated } = estimated;
    let weights: Vec<f64> = indicated.iter_bands().map(|band| total(solution, band)).collect();
    let areas: Vec<f64> = (0..solution.space.cells()).map(|cell| solution.scene.mesh.patch(cell).area()).collect();
    let mut squares: Vec<f64> = areas.clone();
    for (cell, square) in squares.iter_mut().enumerate() {
        let of = |(band, &all): (usize, &f64)| if all > 0.0 { indicated.band(band)[cell].powi(2) / all } else { 0.0 };
        *square *= weights.iter().enumerate().map(of).sum::<f64>();
    }
    // Indicators are relative to their own sum, the points' residuals to that of their squares.
    let points: f64 = seen.iter().map(|&(cell, square)| square * areas[cell]).sum();
    let bands = weights.len() as f64;
    for &(cell, square) in seen {
        squares[cell] = squares[cell].max(BELIEVED * bands * square * areas[cell] / points.max(f64::MIN_POSITIVE));
    }
    if let Some(importance) = importance {
        squares.iter_mut().zip(importance).for_each(|(square, w)| *square *= w * w);
    }
    let scale = error.relative.powi(2) / squares.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    for square in &mut squares {
        *square *= scale;
    }
    squares
}

/// ∫ of the square of an indicator.
fn total(solution: &Solution, indicated: &[f64]) -> f64 {
    indicated.iter().enumerate().map(|(cell, e)| e * e * solution.scene.mesh.patch(cell).area()).sum()
}

//! Adaptive against uniform meshes, and the estimate against the error: `cargo bench -p hatbox --bench adapt`.
//!
//! The truth is a quadratic solution on a mesh adapted to a tolerance four times as tight as the tightest in the table. It
//! is compared at the points of a quadrature rule on the cells of each solution, in the norm of the estimate: relative to
//! the reflected light, the worst band's. An argument chooses scenes by a part of their name.

use hatbox::adapt;
use hatbox::element::{ALL, Basis};
use hatbox::io::read_scene;
use hatbox::mesh::Refinement;
use hatbox::probe::Probe;
use hatbox::progress::Silent;
use hatbox::quadrature::rule;
use hatbox::radiosity::{Options, Shown, Solution, Solved, solve};
use hatbox::scene::Scene;
use std::path::Path;
use std::time::Instant;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const SCENES: [&str; 3] = ["cube.toml", "cornell-box.glb", "two-rooms.glb"];
const TOLERANCES: [f64; 4] = [0.10, 0.05, 0.03, 0.02];
const UNIFORM: [usize; 3] = [400, 1000, 2500];
const TRUTH: f64 = 0.005;

fn main() -> Result<()> {
    let chosen: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    for name in SCENES.into_iter().filter(|name| chosen.is_empty() || chosen.iter().any(|part| name.contains(part))) {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
        let (scene, _) = read_scene(&folder.join(name))?;
        let (truth, _) = adapted(&scene, &ALL[3], TRUTH)?;
        println!("\n{name}; truth: {} quadratic elements", truth.solution.space.cells());
        println!("basis      mesh       elements unknowns  seconds  estimate     error  quotient");
        for basis in [&ALL[0], &ALL[1], &ALL[3]] {
            for elements in UNIFORM {
                let started = Instant::now();
                let options = Options { basis, refinement: Refinement::Elements(elements), ..Options::default() };
                let solved = solve(&scene, &options, &Silent)?;
                row("uniform", &solved, started.elapsed().as_secs_f64(), &truth.solution);
            }
            for tolerance in TOLERANCES {
                let (solved, seconds) = adapted(&scene, basis, tolerance)?;
                row(&format!("to {} %", 100.0 * tolerance), &solved, seconds, &truth.solution);
            }
        }
    }
    Ok(())
}

fn adapted(scene: &Scene, basis: &'static Basis, tolerance: f64) -> Result<(Solved, f64)> {
    let started = Instant::now();
    let defaults = adapt::Options::default();
    let options = adapt::Options { solve: Options { basis, ..defaults.solve }, tolerance, ..defaults };
    let adapted = adapt::solve(scene, &options, &Silent)?;
    Ok((adapted.solved, started.elapsed().as_secs_f64()))
}

fn row(mesh: &str, solved: &Solved, seconds: f64, truth: &Solution) {
    let estimate = solved.error.map_or(f64::NAN, |error| error.relative);
    let error = error(&solved.solution, truth);
    println!(
        "{:<10} {mesh:<10} {:>8} {:>8} {seconds:>8.2} {:>7.2} % {:>7.2} % {:>9.2}",
        solved.solution.space.basis().name,
        solved.solution.space.cells(),
        solved.unknowns,
        100.0 * estimate,
        100.0 * error,
        estimate / error
    );
}

/// ‖B̃ − B‖/‖B − B⁰‖, the worst band's.
fn error(solution: &Solution, truth: &Solution) -> f64 {
    let mesh = &solution.scene.mesh;
    let (mut places, mut here) = (Vec::new(), Vec::new());
    for cell in 0..mesh.cells.len() {
        let patch = mesh.patch(cell);
        let rule = rule(patch.shape(), 5);
        for (&at, weight) in rule.points.iter().zip(&rule.weights) {
            places.push((patch.point(at), patch.normal()));
            here.push((cell, at, weight * patch.area()));
        }
    }
    let exact = Probe::new(truth).values(&places).radiosity;
    let of = |band: usize| {
        let (mut error, mut norm) = (0.0, 0.0);
        for (k, &(cell, at, area)) in here.iter().enumerate() {
            let exact = exact.band(band)[k];
            let b0 = solution.scene.material(cell).exitance.at(&solution.scene.site(cell, at), band);
            error += area * (solution.evaluate(Shown::Radiosity, cell, at, band) - exact).powi(2);
            norm += area * (exact - b0).powi(2);
        }
        (error / norm).sqrt()
    };
    (0..solution.bands()).map(of).fold(0.0, f64::max)
}

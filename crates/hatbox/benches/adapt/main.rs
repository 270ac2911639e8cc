//! What a tolerance costs and whether it is kept: `cargo bench -p hatbox --bench adapt [-- WORD…] [--plot FOLDER]`.
//!
//! | part | what it prints |
//! |---|---|
//! | `asked` | tolerances asked for: unknowns, CPU seconds, the estimate, the error, and the quotient of the two |
//! | `ladder` | error against unknowns and CPU seconds of all bases, uniform and adaptive; `--plot` draws it |
//! | `focus` | unknowns until the dark room is solved to a tolerance, with `--focus` and without |
//!
//! Words choose parts and scenes by pieces of their names; without any, everything runs. Errors are relative to the reflected
//! light, in L2, the worst band's: the norm of the estimate. CPU seconds are those of all threads.

mod cases;
mod plot;
mod truth;

use cases::{CASES, Case};
use hatbox::adapt::{self, Focus};
use hatbox::element::{ALL, Basis};
use hatbox::mesh::Refinement;
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, Solved, solve};
use hatbox::scene::Scene;
use plot::{Curve, Panel};
use std::path::Path;
use truth::Truth;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Tolerances of the part `asked`.
const ASKED: [f64; 3] = [0.03, 0.01, 0.005];
/// The default basis and the one for tight tolerances.
const BASES: [&Basis; 2] = [&ALL[1], &ALL[3]];
/// Elements of uniform meshes, and tolerances of adaptive ones.
const UNIFORM: [usize; 4] = [200, 800, 3200, 6400];
const LADDER: [f64; 6] = [0.10, 0.03, 0.01, 0.005, 0.002, 0.001];
/// Tolerances of the part `focus`.
const FOCUSED: [f64; 3] = [0.05, 0.03, 0.02];
/// Coefficients with which the whole scene may be solved as well.
const MOST_WHOLE: usize = 45_000;
/// A dense operator of more coefficients is not tried.
const MOST: usize = 20_000;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let plot = arguments.iter().position(|argument| argument == "--plot");
    let folder = plot.and_then(|at| arguments.get(at + 1)).map(Path::new);
    let words = &arguments[..plot.unwrap_or(arguments.len())];
    let parts = ["asked", "ladder", "focus"];
    let names = words.iter().filter(|word| !parts.contains(&word.as_str())).collect::<Vec<_>>();
    let wanted =
        |part: &str| !words.iter().any(|word| parts.contains(&word.as_str())) || words.iter().any(|w| w == part);
    let cases = || CASES.iter().filter(|case| names.is_empty() || names.iter().any(|word| case.name.contains(*word)));
    if wanted("asked") {
        for case in cases() {
            asked(case)?;
        }
    }
    if wanted("ladder") {
        let panels = cases().filter(|case| case.ladder).map(ladder).collect::<Result<Vec<_>>>()?.concat();
        if let Some(folder) = folder {
            std::fs::create_dir_all(folder)?;
            std::fs::write(folder.join("ladder.svg"), plot::draw(&panels))?;
        }
    }
    if wanted("focus") {
        focus()?;
    }
    Ok(())
}

/// One solve.
struct Row {
    mesh: String,
    solved: Solved,
    reached: bool,
    cpu: f64,
}

impl Row {
    fn uniform(scene: &Scene, basis: &'static Basis, elements: usize) -> Result<Self> {
        let before = cpu_seconds();
        let options = Options { basis, refinement: Refinement::Elements(elements), ..Options::default() };
        let solved = solve(scene, &options, &Silent)?;
        Ok(Self { mesh: "uniform".to_owned(), solved, reached: true, cpu: cpu_seconds() - before })
    }

    fn adaptive(
        scene: &Scene,
        basis: &'static Basis,
        tolerance: f64,
        focus: Option<Focus>,
        most_coefficients: usize,
    ) -> Result<Self> {
        let before = cpu_seconds();
        let defaults = adapt::Options::default();
        let solve = Options { basis, ..defaults.solve };
        let most_coefficients = Some(most_coefficients);
        let options = adapt::Options { solve, tolerance, focus, most_coefficients };
        let adapted = adapt::solve(scene, &options, &Silent)?;
        let mesh = format!("to {} %", (1e5 * tolerance).round() / 1e3);
        Ok(Self { mesh, solved: adapted.solved, reached: adapted.reached, cpu: cpu_seconds() - before })
    }

    fn print(&self, error: f64) {
        let estimate = self.solved.error.map_or(f64::NAN, |error| error.relative);
        println!(
            "{:<10} {:<9} {:>8} {:>8} {:>8.2} {:>8.3} % {:>8.3} % {:>8.2}{}",
            self.solved.solution.space.basis().name,
            self.mesh,
            self.solved.solution.space.cells(),
            self.solved.unknowns,
            self.cpu,
            100.0 * estimate,
            100.0 * error,
            estimate / error,
            if self.reached { "" } else { "  not reached" }
        );
    }
}

fn title(name: &str, truth: &Truth) {
    println!("\n{name}; truth: {}", truth.origin);
    println!("basis      mesh      elements unknowns    CPU s   estimate      error quotient");
}

fn asked(case: &Case) -> Result<()> {
    let scene = (case.scene)()?;
    let truth = (case.truth)(&scene)?;
    title(case.name, &truth);
    for basis in BASES {
        for tolerance in ASKED {
            let row = Row::adaptive(&scene, basis, tolerance, None, MOST)?;
            row.print(truth.error(&row.solved.solution));
        }
    }
    Ok(())
}

/// Error against unknowns, and against CPU seconds.
fn ladder(case: &Case) -> Result<Vec<Panel>> {
    let scene = (case.scene)()?;
    let truth = (case.truth)(&scene)?;
    title(case.name, &truth);
    let mut curves = [Vec::new(), Vec::new()];
    let mut add = |basis: &Basis, adaptive: bool, rows: &mut dyn Iterator<Item = Result<Row>>| -> Result<()> {
        let mut points = [Vec::new(), Vec::new()];
        for row in rows {
            let row = row?;
            let error = truth.error(&row.solved.solution);
            row.print(error);
            points[0].push([row.solved.unknowns as f64, error]);
            points[1].push([row.cpu, error]);
            if !row.reached {
                break;
            }
        }
        for (curves, points) in curves.iter_mut().zip(points) {
            curves.push(Curve { name: basis.name, dashed: !adaptive, points });
        }
        Ok(())
    };
    for basis in &ALL {
        let most = MOST / basis.triangle.dofs();
        let sizes = UNIFORM.into_iter().filter(|&elements| elements <= most);
        add(basis, false, &mut sizes.map(|elements| Row::uniform(&scene, basis, elements)))?;
        // On triangles bilinear functions are linear.
        if basis.quad.is_none() || basis.triangle.degree == 0 {
            add(
                basis,
                true,
                &mut LADDER.into_iter().map(|tolerance| Row::adaptive(&scene, basis, tolerance, None, MOST)),
            )?;
        }
    }
    let [unknowns, seconds] = curves;
    Ok(vec![
        Panel { title: format!("{}: unknowns", case.name), curves: unknowns },
        Panel { title: format!("{}: CPU seconds", case.name), curves: seconds },
    ])
}

/// The dark room of two, with a focus on it, and with ever smaller tolerances of the whole until it is as accurate.
fn focus() -> Result<()> {
    let case = CASES.iter().find(|case| case.name == "two rooms").ok_or("no two rooms")?;
    let scene = (case.scene)()?;
    let truth = (case.truth)(&scene)?.within(cases::is_in_the_dark_room);
    title("the dark room of two rooms", &truth);
    for tolerance in FOCUSED {
        let row = Row::adaptive(&scene, &ALL[1], tolerance, Some(cases::dark_room()), MOST)?;
        let (goal, unknowns) = (truth.error(&row.solved.solution), row.solved.unknowns);
        println!("focus:");
        row.print(goal);
        println!("whole scene:");
        let mut coarser: Option<[f64; 2]> = None;
        for k in 4..12 {
            let row = Row::adaptive(&scene, &ALL[1], tolerance / 1.5_f64.powi(k), None, MOST_WHOLE)?;
            let (error, found) = (truth.error(&row.solved.solution), row.solved.unknowns as f64);
            row.print(error);
            if error <= goal {
                // At the same error, between this mesh and the one before: powers join them.
                let at_goal = coarser.map_or(found, |[before, fewer]| {
                    fewer * (found / fewer).powf((before / goal).ln() / (before / error).ln())
                });
                println!("{:.1} times the unknowns", at_goal / unknowns as f64);
            }
            if error <= goal || !row.reached {
                break;
            }
            coarser = Some([error, found]);
        }
    }
    Ok(())
}

/// Seconds that all threads of this process have computed; 0 where the system does not tell (it is Linux that does).
fn cpu_seconds() -> f64 {
    const TICKS_PER_SECOND: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name in brackets may hold anything; user and system time are the 12th and 13th field after it.
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(2);
    fields.filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / TICKS_PER_SECOND
}

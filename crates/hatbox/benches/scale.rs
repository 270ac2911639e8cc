//! Time, memory and estimated error against the number of elements, on scenes of `examples/generate`.
//!
//! `cargo bench -p hatbox --bench scale [-- MOST [KIND]]`: every scene at every size up to MOST (1 000 000) with that kind
//! of operator (hierarchical). `… -- SCENE ELEMENTS KIND [TOLERANCE]` is one of them, `… -- suns FACETS [KIND [TOLERANCE]]` the
//! terrain under a hundred suns, and `… -- bands ELEMENTS` what products of the room's operator take, by elements and bands. Each is run in a process of its
//! own, so that the memory is its own. Beyond two million elements there are only `build` and `solve`. `build` makes the operator, `solve` solves, `check` estimates the error, `relight`
//! solves again with lamps of another colour on the same operator, and `repaint` after that with other paints; all in
//! seconds. `passes` are those of the operator in the three. `CPU s` are those of the first three, of all threads. `noise` is the error of the operator from two halves of its
//! rays, `estimate` the estimated error of the solution. How far operators are from the dense one is the bench `operators`.

mod measure;

use glam::DVec3;
use hatbox::exchange::{self, Exchange as _};
use hatbox::linalg::{LinearOperator as _, MultiVector};
use hatbox::mesh::Refinement;
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, System};
use hatbox::scene::{Material, Quantity};
use hatbox::visibility::{Bvh, Visibility};
use measure::{cpu_seconds, kinds, peak_megabytes, scene};
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::process::Command;
use std::time::Instant;

/// Sizes of each scene.
const SIZES: [usize; 4] = [10_000, 100_000, 1_000_000, 10_000_000];
/// Faces of the file for so many elements: the terrain is all detail, the others are subdivided.
const SUBDIVIDED: usize = 20;
/// Tolerance of the operator.
const TOLERANCE: f64 = 0.02;
/// Suns, and how many are solved for at once.
const SUNS: usize = 100;
const BATCH: usize = 25;
/// A length, in metres, beyond which nothing stands.
const FAR: f64 = 1e4;
/// Bands of products, and how often each is made.
const BANDS: [usize; 8] = [1, 2, 3, 4, 6, 8, 16, 32];
const TIMES: usize = 3;
/// Points at which the error is estimated.
const POINTS: usize = 256;
/// Most elements with which the error is estimated, and other lights and paints are solved for.
const MOST_CHECKED: usize = 2_000_000;
/// Bytes that the operator and the products that are kept for other lights may take: ten million elements are to fit into
/// 16 GB.
const MEMORY: usize = 8_000_000_000;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let number = |text: &String| text.parse::<f64>().expect("a number");
    match &arguments[..] {
        [suns, facets, rest @ ..] if suns == "suns" => {
            let kind = rest.first().map_or(exchange::Sampled::NAME, String::as_str);
            light(number(facets) as usize, kind, rest.get(1).map_or(TOLERANCE, number));
        }
        [bands, elements] if bands == "bands" => products(number(elements) as usize),
        [scene, elements, kind, rest @ ..] if kinds::ALL.iter().any(|known| known.name == scene) => {
            run(scene, number(elements) as usize, kind, rest.first().map_or(TOLERANCE, number));
        }
        rest => {
            let most = rest.first().map_or(1_000_000, |most| number(most) as usize);
            all(most, rest.get(1).map_or(exchange::Hierarchical::NAME, String::as_str));
        }
    }
}

/// Every scene at every size, each in a process of its own, and the exponents between the least and the greatest size.
fn all(most: usize, kind: &str) {
    println!(
        "scene      kind          elements triangles   build   solve   check relight repaint  passes   CPU s  peak MB operator   noise  estimate"
    );
    for scene in kinds::ALL {
        let mut measured: Vec<[f64; 3]> = Vec::new();
        for elements in SIZES.into_iter().filter(|&n| n <= most) {
            let program = std::env::current_exe().expect("this program");
            let output = Command::new(program).args([scene.name, &elements.to_string(), kind]).output().expect("run");
            let line = String::from_utf8_lossy(&output.stdout);
            print!("{line}");
            let numbers: Vec<f64> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
            if let &[n, _, _, _, _, _, _, cpu, peak, ..] = &numbers[..] {
                measured.push([n, cpu, peak]);
            }
        }
        if let (Some(from), Some(to)) = (measured.first(), measured.last()) {
            let exponent = |k: usize| (to[k] / from[k]).ln() / (to[0] / from[0]).ln();
            println!("{:<10} exponents: time {:.2}, memory {:.2}", scene.name, exponent(1), exponent(2));
        }
    }
}

fn run(name: &str, elements: usize, kind: &str, tolerance: f64) {
    let faces = if name == "terrain" { elements } else { (elements / SUBDIVIDED).clamp(500, 50_000) };
    let scene = scene(name, faces);
    let options = Options {
        operator: exchange::kind(kind).expect("a kind"),
        refinement: Refinement::Elements(elements),
        error_points: if elements > MOST_CHECKED { 0 } else { POINTS },
        memory: MEMORY,
        tolerance,
        ..Options::default()
    };
    let (started, cpu) = (Instant::now(), cpu_seconds());
    let mut system = System::build(&scene, &options, &Silent).expect("built");
    let build = started.elapsed().as_secs_f64();
    let solved = system.solved(&options, &Silent).expect("solved");
    let (solve, cpu) = (solved.solver_time.as_secs_f64(), cpu_seconds() - cpu);
    let check = started.elapsed().as_secs_f64() - build - solve;
    let (noise, peak) = (system.operator_error(&solved.solution, &Silent), peak_megabytes());
    let noise = noise.expect("not interrupted");
    // Seconds and passes, or dashes.
    let mut again = |change: &dyn Fn(usize, &Material) -> Material| {
        if elements > MOST_CHECKED {
            return ["-"; 2].map(str::to_owned);
        }
        let started = Instant::now();
        let materials = system.scene.materials.iter().enumerate().map(|(k, material)| change(k, material)).collect();
        system.set_materials(materials, options.continuity).expect("the same cells");
        let solver = system.best_solver();
        let (_, info) = system.solve(solver, &system.solver_params(solver), &Silent).expect("solved again");
        [format!("{:.1}", started.elapsed().as_secs_f64()), info.iterations.to_string()]
    };
    let [relight, relit] = again(&|_, material| Material { exitance: tinted(&material.exitance), ..material.clone() });
    let [repaint, repainted] = again(&|k, material| {
        let darker = if k.is_multiple_of(3) { tinted(&material.reflectance) } else { material.reflectance.clone() };
        Material { reflectance: darker, ..material.clone() }
    });
    println!(
        "{name:<10} {kind:<12} {:>9} {:>9} {build:>7.1} {solve:>7.1} {check:>7.1} {relight:>7} {repaint:>7} {:>7} {cpu:>7.1} {peak:>8.0} {:>8.0} {:>6.2} % {:>8}",
        system.space.cells(),
        scene.surfaces.len(),
        format!("{}/{relit}/{repainted}", solved.info.iterations),
        solved.operator.bytes as f64 / 1e6,
        100.0 * noise,
        solved.error.map_or("-".to_owned(), |error| format!("{:.2} %", 100.0 * error.relative)),
    );
}

/// Milliseconds of a product, the best of some.
fn products(elements: usize) {
    println!("function   elements {}", BANDS.map(|bands| format!("{bands:>6}")).join(""));
    let scene = scene("room", (elements / SUBDIVIDED).clamp(500, 50_000));
    for basis in [0, 1, 3].map(|k| &hatbox::element::ALL[k]) {
        let options = Options {
            operator: exchange::kind(exchange::Sampled::NAME).expect("a kind"),
            refinement: Refinement::Elements(elements),
            tolerance: TOLERANCE,
            basis,
            ..Options::default()
        };
        let exchange = System::build(&scene, &options, &Silent).expect("built").exchange;
        let took = BANDS.map(|bands| {
            // Of single precision, as those of a search are.
            let x = MultiVector::from_fn(exchange.rows(), bands, |row, band| f64::from(((row + band) % 97) as f32));
            let once = |_| {
                let started = Instant::now();
                std::hint::black_box(exchange.times(&x));
                started.elapsed().as_secs_f64()
            };
            (0..TIMES).map(once).fold(f64::INFINITY, f64::min)
        });
        println!("{:<10} {elements:>8} {}", basis.name, took.map(|s| format!("{:>6.0}", 1e3 * s)).join(""));
    }
}

/// The terrain under many suns.
fn light(facets: usize, kind: &str, tolerance: f64) {
    let mut scene = scene("terrain", facets);
    let dust = scene.materials.iter().map(|material| Material {
        reflectance: Quantity::gray(material.reflectance.uniform(0).unwrap_or(0.0)),
        exitance: Quantity::gray(0.0),
        ..material.clone()
    });
    scene.set_materials(dust.collect()).expect("as many");
    let options = Options {
        operator: exchange::kind(kind).expect("a kind"),
        basis: &hatbox::element::ALL[0],
        refinement: Refinement::None,
        tolerance,
        ..Options::default()
    };
    let (started, cpu) = (Instant::now(), cpu_seconds());
    let system = System::build(&scene, &options, &Silent).expect("built");
    let (build, build_cpu) = (started.elapsed().as_secs_f64(), cpu_seconds() - cpu);
    let Suns { direct, solve, solve_cpu, iterations } = suns(&system);
    let error = 100.0 * system.exchange.statistics().visibility_error;
    let [quotient, of_cpu] = [(build + solve) / build, (build_cpu + solve_cpu) / build_cpu];
    println!("terrain    {kind:<12} facets {}, {SUNS} suns, error of the operator {error:.1} %", system.space.cells());
    println!("build {build:.1} s, direct {direct:.1} s, solve {solve:.1} s ({iterations} iterations)");
    println!("(build + solve)/build {quotient:.2}, of CPU time {of_cpu:.2}; peak {:.0} MB", peak_megabytes());
}

/// Seconds, and iterations at the most.
#[derive(Default)]
struct Suns {
    direct: f64,
    solve: f64,
    solve_cpu: f64,
    iterations: usize,
}

/// Solves for all suns, so many at once.
fn suns(system: &System) -> Suns {
    let (blockers, mut took) = (Bvh::of_surfaces(&system.scene.surfaces), Suns::default());
    for batch in (0..SUNS).collect::<Vec<_>>().chunks(BATCH) {
        let started = Instant::now();
        let loads = batch.iter().flat_map(|&sun| reflected(system, &blockers, sun)).collect();
        let loads = MultiVector::from_bands(batch.len(), loads).expect("whole columns");
        took.direct += started.elapsed().as_secs_f64();
        let (started, cpu) = (Instant::now(), cpu_seconds());
        let solver = system.best_solver();
        let (_, info) = system.solve_for(&loads, solver, &system.solver_params(solver), &Silent).expect("solved");
        took.solve += started.elapsed().as_secs_f64();
        took.solve_cpu += cpu_seconds() - cpu;
        took.iterations = took.iterations.max(info.iterations);
    }
    took
}

/// What the facets reflect of a sun of 1 W/m², times their areas.
fn reflected(system: &System, blockers: &Bvh, sun: usize) -> Vec<f64> {
    let (height, around) = (0.05 + 0.85 * sun as f64 / SUNS as f64, TAU * 0.618 * sun as f64);
    let flat = (1.0 - height * height).sqrt();
    let towards = DVec3::new(flat * around.cos(), height, flat * around.sin());
    let mesh = &system.scene.mesh;
    let facet = |cell: usize| {
        let (patch, surface) = (mesh.patch(cell), mesh.cells[cell].surface);
        let cosine = patch.normal().dot(towards);
        let dark =
            cosine <= 0.0 || blockers.occluded(patch.center(), patch.center() + towards * FAR, [surface, surface]);
        if dark {
            0.0
        } else {
            patch.area() * cosine * system.scene.material(cell).reflectance.uniform(0).unwrap_or(0.0)
        }
    };
    (0..mesh.cells.len()).into_par_iter().map(facet).collect()
}

/// Another colour: less of each band than of the one before.
fn tinted(quantity: &Quantity) -> Quantity {
    match quantity {
        Quantity::Uniform(values) => Quantity::Uniform(
            values.iter().enumerate().map(|(band, value)| value * 0.8 / (1.0 + band as f64)).collect(),
        ),
        other => other.clone(),
    }
}

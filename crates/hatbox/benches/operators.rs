//! Every kind of exchange operator against the dense one, from tolerance to tolerance.
//!
//! `cargo bench -p hatbox --bench operators [-- SCENE [ELEMENTS [KIND [LEAST]]]]`; SCENE is a kind of `examples/generate` or the
//! name of a file of the samples, KIND `all` for every one, LEAST the least tolerance (0.0015). The error is that of the radiosity, ‖B − B_dense‖/‖B_dense − B⁰‖ on the same mesh, and
//! `order` is the binary logarithm of the error's ratio from one tolerance to its half: 1 where the error halves too.
//!
//! `… -- choice [ELEMENTS]`: for every scene what `auto` chooses and why, and the CPU seconds of building either kind.

#[allow(dead_code, reason = "other benches use the rest")]
mod measure;

use hatbox::assemble::{load, mass};
use hatbox::exchange::{self, Exchange};
use hatbox::linalg::{LinearOperator, MultiVector};
use hatbox::mesh::Refinement;
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, Solved, System};
use measure::{cpu_seconds, kinds, scene};

/// Scenes that are no kinds.
const SAMPLES: [&str; 3] = ["cube.toml", "cornell-box.glb", "two-rooms.glb"];
/// Faces of a generated scene for so many elements.
const SUBDIVIDED: usize = 4;
/// Tolerances: 10 % and its halves.
const FIRST: f64 = 0.1;
const LEAST: f64 = 0.0015;
/// Tolerance of what the others are compared with: rays of another seed, or the dense operator if there are few elements.
const TRUTH: f64 = 1e-3;
const FEW: usize = 700;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let elements = arguments.get(1).map_or(5_000, |text| text.parse().expect("a number"));
    let names: Vec<&str> = match arguments.first() {
        Some(name) => vec![name],
        None => kinds::ALL.iter().map(|kind| kind.name).chain(SAMPLES).collect(),
    };
    if names == ["choice"] {
        kinds::ALL.iter().map(|kind| kind.name).chain(SAMPLES).for_each(|name| choice(name, elements));
        return;
    }
    let least = arguments.get(3).map_or(LEAST, |text| text.parse().expect("a number"));
    println!("scene           kind         elements  tolerance    CPU s      MB     error  estimate  order");
    for name in names {
        compare(name, elements, arguments.get(2).map(String::as_str).filter(|&kind| kind != "all"), least);
    }
}

/// What `auto` chooses for a scene, and what either kind takes.
fn choice(name: &str, elements: usize) {
    let scene = scene(name, if name == "terrain" { elements } else { elements / SUBDIVIDED });
    let build = |kind: &str| {
        let (options, before) = (options(kind, elements, Options::default().tolerance), cpu_seconds());
        let system = System::build(&scene, &options, &Silent).expect("built");
        (system, cpu_seconds() - before)
    };
    let (auto, _) = build(exchange::AUTO.name);
    let [dense, sampled] = [exchange::Dense::NAME, exchange::Sampled::NAME].map(|kind| build(kind).1);
    let (cells, kind, why) = (auto.space.cells(), auto.exchange.kind(), auto.operator_reason.unwrap_or_default());
    println!("{name:<15} {cells:>6} dense {dense:>7.2} s, sampled {sampled:>6.2} s; {kind}: {why}");
}

fn options(kind: &str, elements: usize, tolerance: f64) -> Options {
    Options {
        operator: exchange::kind(kind).expect("a kind"),
        refinement: Refinement::Elements(elements),
        tolerance,
        error_points: 0,
        ..Options::default()
    }
}

/// One scene.
fn compare(name: &str, elements: usize, only: Option<&str>, least: f64) {
    let faces = if name == "terrain" { elements } else { elements / SUBDIVIDED };
    let scene = scene(name, faces);
    let options = |kind: &str, tolerance: f64| options(kind, elements, tolerance);
    let best = if elements <= FEW { exchange::Dense::NAME } else { exchange::Sampled::NAME };
    let dense = run(&scene, &Options { seed: 1, ..options(best, TRUTH) });
    println!("{name:<15} {best:<12} {:>8}  {:>7.3} %  {:>7.2}", dense.cells(), 100.0 * TRUTH, dense.seconds);
    for kind in exchange::ALL.iter().filter(|kind| only.is_none_or(|only| kind.name == only)) {
        let mut last: Option<f64> = None;
        for tolerance in (0..).map(|halving| FIRST * 0.5_f64.powi(halving)).take_while(|&t| t > least) {
            let made = run(&scene, &options(kind.name, tolerance));
            let error = made.error(&dense);
            let order = last.map_or(String::new(), |last| format!("{:>6.2}", (last / error).log2()));
            println!(
                "{name:<15} {:<12} {:>8}  {:>7.2} %  {:>7.2} {:>7.1} {:>7.3} % {:>7.3} % {order}",
                kind.name,
                made.cells(),
                100.0 * tolerance,
                made.seconds,
                made.solved.operator.bytes as f64 / 1e6,
                100.0 * error,
                100.0 * made.estimate,
            );
            last = Some(error);
        }
    }
}

/// What was made, and in how many seconds of CPU time.
struct Made {
    system: System,
    solved: Solved,
    seconds: f64,
    /// The operator's own estimate of its error.
    estimate: f64,
}

fn run(scene: &hatbox::scene::Scene, options: &Options) -> Made {
    let started = cpu_seconds();
    let system = System::build(scene, options, &Silent).expect("built");
    let solved = system.solved(options, &Silent).expect("solved");
    let seconds = cpu_seconds() - started;
    let estimate = system.operator_error(&solved.solution, &Silent).expect("not interrupted");
    Made { system, solved, seconds, estimate }
}

impl Made {
    fn cells(&self) -> usize {
        self.system.space.cells()
    }

    fn error(&self, truth: &Self) -> f64 {
        let exact = &truth.solved.solution.radiosity;
        let (scene, space) = (&truth.system.scene, &truth.system.space);
        let mass = mass(scene, space);
        let emission = mass.inverse().expect("elements with an area").times(&load(scene, space));
        let square = |x: &MultiVector| x.dot(&mass.times(x)).iter().sum::<f64>();
        let mut difference = self.solved.solution.radiosity.clone();
        difference.add_scaled(-1.0, exact);
        let mut reflected = exact.clone();
        reflected.add_scaled(-1.0, &emission);
        (square(&difference) / square(&reflected)).sqrt()
    }
}

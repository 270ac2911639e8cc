//! Time, memory and error of the sampled operator against the number of elements, on scenes of `examples/generate`.
//!
//! `cargo bench -p hatbox --bench scale [-- MOST]`, MOST being the greatest number of elements (1 000 000). Each size is
//! run in a process of its own, so that the memory is its own. The error is the relative L2 error of the irradiance
//! against the dense operator on the same mesh, at the smallest size.

#[path = "../examples/generate/kinds/mod.rs"]
mod kinds;

use hatbox::exchange;
use hatbox::io::read_scene;
use hatbox::linalg::{LinearOperator, MultiVector};
use hatbox::mesh::Refinement;
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, solve};
use hatbox::scene::Scene;
use std::process::Command;
use std::time::Instant;

/// Where the dense operator is compared with.
const SMALL: usize = 5_000;
/// Faces of the file for so many elements: the terrain is all detail, the others are subdivided.
const SUBDIVIDED: usize = 20;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    match &arguments[..] {
        [kind, elements] => run(kind, elements.parse().expect("a number")),
        rest => all(rest.first().map_or(1_000_000, |most| most.parse().expect("a number"))),
    }
}

/// Every kind at every size, each in a process of its own, and the exponents between 10⁴ and the greatest size.
fn all(most: usize) {
    println!("scene      elements  triangles  seconds   CPU s     peak MB    error  estimate");
    for kind in kinds::ALL {
        let mut measured: Vec<[f64; 3]> = Vec::new();
        for elements in [SMALL, 10_000, 100_000, 1_000_000, 10_000_000].into_iter().filter(|&n| n <= most) {
            let program = std::env::current_exe().expect("this program");
            let output = Command::new(program).args([kind.name, &elements.to_string()]).output().expect("run");
            let line = String::from_utf8_lossy(&output.stdout);
            print!("{line}");
            let numbers: Vec<f64> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
            if let &[n, _, _, cpu, peak, ..] = &numbers[..] {
                measured.push([n, cpu, peak]);
            }
        }
        if let (Some(from), Some(to)) = (measured.get(1), measured.last()) {
            let exponent = |k: usize| (to[k] / from[k]).ln() / (to[0] / from[0]).ln();
            println!("{:<10} exponents: time {:.2}, memory {:.2}", kind.name, exponent(1), exponent(2));
        }
    }
}

fn run(name: &str, elements: usize) {
    let kind = kinds::ALL.iter().find(|kind| kind.name == name).expect("a kind");
    let faces = if name == "terrain" { elements } else { (elements / SUBDIVIDED).clamp(500, 50_000) };
    let scene = scene(kind, faces);
    let options = Options {
        operator: exchange::kind(exchange::Sampled::NAME).expect("a kind"),
        refinement: Refinement::Elements(elements),
        error_points: 256,
        ..Options::default()
    };
    let (started, cpu) = (Instant::now(), status("utime"));
    let solved = solve(&scene, &options, &Silent).expect("solved");
    let (seconds, cpu) = (started.elapsed().as_secs_f64(), status("utime") - cpu);
    let peak = status("VmHWM");
    let error = if elements <= SMALL {
        let dense = Options { operator: exchange::kind("dense").expect("a kind"), error_points: 0, ..options };
        let dense = solve(&scene, &dense, &Silent).expect("solved").solution;
        let mass = hatbox::assemble::mass(&dense.scene, &dense.space);
        let mut difference = solved.solution.irradiance.clone();
        difference.add_scaled(-1.0, &dense.irradiance);
        let square = |x: &MultiVector| x.dot(&mass.times(x)).iter().sum::<f64>();
        format!("{:.2} %", 100.0 * (square(&difference) / square(&dense.irradiance)).sqrt())
    } else {
        "-".to_owned()
    };
    let cells = solved.solution.space.cells();
    let estimate = solved.error.map_or(0.0, |error| 100.0 * error.relative);
    println!(
        "{name:<10} {cells:>8} {:>9} {seconds:>9.2} {cpu:>8.2} {peak:>10.0} {error:>9} {estimate:>7.2} %",
        scene.surfaces.len()
    );
}

fn scene(kind: &kinds::Kind, faces: usize) -> Scene {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, (kind.make)(faces).to_glb()).expect("written");
    read_scene(&path).expect("a scene").0
}

/// Seconds of CPU time, or megabytes of memory at the most, as Linux tells; 0 elsewhere.
fn status(what: &str) -> f64 {
    if what == "utime" {
        let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
        let fields: Vec<f64> = text.split_whitespace().map(|word| word.parse().unwrap_or(0.0)).collect();
        return fields.get(13).zip(fields.get(14)).map_or(0.0, |(user, system)| (user + system) / 100.0);
    }
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find(|line| line.starts_with(what)).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kb| kb.parse::<f64>().ok()).unwrap_or(0.0) / 1000.0
}

//! View factors of closed rooms by size and by tolerance: `cargo bench -p hatbox --bench factors`.
//!
//! `operator` is the time to integrate all pairs; `seconds` everything from the scene to the checked factors, with the
//! rays that measure what escapes, but without reading and writing. `error` is that of the worst row's sum, 1 in a
//! closed room, and `estimate` what is reported for it. Rooms are given as a file would: every element a face.

#[allow(dead_code, reason = "tests use the rest")]
#[path = "../tests/meshes/mod.rs"]
mod meshes;

use glam::DVec3;
use hatbox::element::ALL;
use hatbox::exchange::{Dense, Exchange, Geometry, Params};
use hatbox::progress::Silent;
use hatbox::scene::Scene;
use hatbox::space::FunctionSpace;
use hatbox::view_factors::{Options, ViewFactors};
use hatbox::visibility::Bvh;
use meshes::rooms::{cuboid, divided, l_room};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

const TOLERANCES: [f64; 7] = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8];
/// More elements than this are tried at one tolerance only.
const LARGE: usize = 5_000;
const USUAL: f64 = 1e-3;

fn main() {
    let (cube, bent) = (cuboid(DVec3::ZERO, DVec3::ONE), l_room());
    println!("room      elements  tolerance  operator   seconds      error   estimate       MB  µs/pair");
    for (name, faces, divisions) in [("cube", &cube, &[13, 29, 58][..]), ("L", &bent, &[9, 18])] {
        for &n in divisions {
            let scene = divided(faces, n);
            let large = scene.mesh.cells.len() > LARGE;
            for tolerance in TOLERANCES.into_iter().filter(|&tolerance| !large || tolerance == USUAL) {
                println!("{name:<8} {}", line(&scene, tolerance));
            }
        }
    }
}

/// One run, as a line of the table.
fn line(scene: &Scene, tolerance: f64) -> String {
    let operator = operator(scene, tolerance);
    let started = Instant::now();
    let found = ViewFactors::new(scene, &Options { tolerance, ..Options::default() }, &Silent).expect("factors");
    let error = found.check().max_row_sum_error;
    let seconds = started.elapsed().as_secs_f64();
    let (n, estimate) = (found.len(), found.statistics.error());
    let pairs = (n * (n - 1) / 2) as f64;
    format!(
        "{n:>9} {tolerance:>10.0e} {operator:>9.3} {seconds:>9.3} {error:>10.1e} {estimate:>10.1e} {:>8.1} {:>8.3}",
        found.bytes() as f64 / 1e6,
        1e6 * operator / pairs,
    )
}

/// Seconds to integrate all pairs.
fn operator(scene: &Scene, tolerance: f64) -> f64 {
    let space = FunctionSpace::broken(&scene.mesh, &ALL[0]).expect("constants");
    let (panels, blockers) = (OnceLock::new(), Arc::new(Bvh::of_surfaces(&scene.surfaces)));
    let geometry = Geometry::new(scene, &space, &blockers, &panels);
    geometry.panels();
    let started = Instant::now();
    let dense = Dense::new(&geometry, &Params::new(tolerance), &Silent).expect("small enough");
    let seconds = started.elapsed().as_secs_f64();
    assert!(dense.statistics().bytes > 0);
    seconds
}

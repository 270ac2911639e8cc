//! Where work with sampled operators ends: how far the equations are solved, in the norm of L2 and where the error is asked of, and
//! how soon an interrupt is noticed.

#[expect(dead_code, reason = "not every test needs every mesh")]
mod meshes;

use glam::DVec3;
use hatbox::exchange::{self, ExchangeError};
use hatbox::io::checkpoint::Checkpoint;
use hatbox::mesh::{Mesh, Refinement};
use hatbox::progress::{Progress, Silent};
use hatbox::radiosity::{Error, Options, Solution, System, solve};
use hatbox::scene::{Material, Physics, Quantity, Scene};
use hatbox::solve::Params;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Small cells of each plate along an edge.
const PIECES: usize = 24;

/// A wide ground of one cell under a lamp, and on it two white plates of many cells that face each other.
fn street() -> Scene {
    street_of_width(1.0)
}

fn street_of_width(width: f64) -> Scene {
    let mut mesh = Mesh::default();
    let ground = [(-30.0, -30.0), (30.0, -30.0), (30.0, 30.0), (-30.0, 30.0)];
    meshes::face(&mut mesh, &ground.map(|(x, y)| DVec3::new(x, y, 0.0)), 0);
    let lamp = [(-4.0, -4.0), (-4.0, 4.0), (4.0, 4.0), (4.0, -4.0)];
    meshes::face(&mut mesh, &lamp.map(|(x, y)| DVec3::new(x, y, 60.0)), 2);
    for (x, turned) in [(-0.5 * width, false), (0.5 * width, true)] {
        let at = |i: usize, j: usize| {
            let [along, up] = [i, j].map(|k| k as f64 / PIECES as f64);
            DVec3::new(x, 4.0 * along - 2.0, 0.1 + 3.0 * up)
        };
        for (i, j) in (0..PIECES).flat_map(|i| (0..PIECES).map(move |j| (i, j))) {
            let mut cell = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if turned {
                cell.reverse();
            }
            meshes::face(&mut mesh, &cell, 1);
        }
    }
    let lamp = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.0) };
    let materials = vec![Material::diffuse("ground", 0.5), Material::diffuse("plates", 0.95), lamp];
    Scene::new(mesh, materials, Physics::Light, None).expect("valid")
}

fn options() -> Options {
    let operator = exchange::kind(exchange::Sampled::NAME).expect("a kind");
    Options { operator, refinement: Refinement::None, tolerance: 0.02, error_points: 16, ..Options::default() }
}

/// The L2 norm of the difference on the plates, relative to their light.
fn difference(system: &System, found: &Solution, exact: &Solution) -> f64 {
    let scene = &system.scene;
    let square = |value: &dyn Fn(usize) -> f64| -> f64 {
        let cells = (0..scene.mesh.cells.len()).filter(|&cell| scene.material(cell).name == "plates");
        let of = |cell: usize| found.space.range(cell).map(|k| value(k).powi(2)).sum::<f64>();
        cells.map(|cell| scene.mesh.patch(cell).area() * of(cell)).sum()
    };
    let [found, exact] = [found, exact].map(|solution| solution.radiosity.band(0));
    (square(&|k| found[k] - exact[k]) / square(&|k| exact[k])).sqrt()
}

/// Residuals were measured as integrals over elements, of which the ground's is a million times a small cell's: nine tenths of the
/// light of the plates were missing. In a focus the residual is relative to the light there.
#[test]
fn what_lies_beside_a_wide_ground_is_solved_for() {
    let system = System::build(&street(), &options(), &Silent).expect("built");
    let kind = system.best_solver();
    let usual = system.solver_params(kind);
    let solved = |params: Params| system.solve(kind, &params, &Silent).expect("solved").0;
    let exact = solved(Params { tolerance: 1e-9, ..usual });
    let error = difference(&system, &solved(usual), &exact);
    assert!(error < 30.0 * usual.tolerance, "{error}");
    let is_plate = |cell: usize| system.scene.material(cell).name == "plates";
    let plates = (0..system.scene.mesh.cells.len()).map(is_plate).collect();
    let (focused, _) = system.solved_within(&options(), 0.0, |_, _| Ok(Some(plates)), &Silent).expect("solved");
    let error = difference(&system, &focused.solution, &exact);
    assert!(error < 2.0 * usual.tolerance, "in focus {error}");
}

/// Interrupts when it is asked for the hundredth time.
#[derive(Default)]
struct Impatient(AtomicUsize);

impl Progress for Impatient {
    fn interrupted(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) >= 100
    }
}

/// What a material that is a function shows decides where meshes are refined, and nothing in a file can tell which function it was.
#[test]
fn rays_of_another_mesh_of_as_many_cells_are_not_taken() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    let options = Options { tolerance: 0.3, error_points: 0, ..options() };
    let wider = street_of_width(1.1);
    let solution = |scene: &Scene, progress: &dyn Progress| solve(scene, &options, progress).expect("solved").solution;
    let with_file = |scene: &Scene| {
        let checkpoint = Checkpoint::open(file.path(), 1, Silent).expect("a checkpoint");
        (solution(scene, &checkpoint).radiosity, checkpoint.earlier().steps)
    };
    assert_eq!(with_file(&street()).1, 0);
    let (found, steps) = with_file(&wider);
    assert!(steps > 0);
    assert_eq!(found, solution(&wider, &Silent).radiosity);
    // And are taken where they belong: nothing is added.
    let size = || file.as_file().metadata().expect("its size").len();
    let before = size();
    with_file(&wider);
    assert_eq!(size(), before);
}

/// Only every 256th cell asked: with tens of thousands of rays a cell, that is seldom.
#[test]
fn every_cell_notices_an_interrupt() {
    assert!(street().mesh.cells.len() > 1000);
    let options = Options { tolerance: 0.3, ..options() };
    let result = System::build(&street(), &options, &Impatient::default());
    assert!(matches!(result, Err(Error::Exchange(ExchangeError::Interrupted(_)))), "{:?}", result.err());
}

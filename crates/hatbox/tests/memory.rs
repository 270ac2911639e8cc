//! What sampled operators store, and that nothing depends on it.

#[expect(dead_code, reason = "not every test needs every mesh")]
mod meshes;

use glam::DVec3;
use hatbox::element::ALL as BASES;
use hatbox::exchange::{self, Exchange, Kind, Statistics};
use hatbox::failure;
use hatbox::linalg::{LinearOperator, MultiVector};
use hatbox::mesh::{Mesh, Refinement};
use hatbox::progress::{Progress, Silent};
use hatbox::radiosity::{Error, Options, System, solve};
use hatbox::scene::{Material, Physics, Quantity, Scene};
use hatbox::solve::{self as solvers, Kind as Solver, SolveError};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// A closed room, of which no ray is lost, with a lamp, and open ground, of which all are, one after the other.
fn scene(ground_first: bool) -> Scene {
    let mut mesh = Mesh::default();
    let ground = |mesh: &mut Mesh| {
        let corners = [[0.0, 0.0], [7.0, 0.0], [7.0, 7.0], [0.0, 7.0]];
        meshes::face(mesh, &corners.map(|[x, y]| DVec3::new(x + 5.0, y + 5.0, 0.0)), 0);
    };
    if ground_first {
        ground(&mut mesh);
    }
    let room = meshes::room(DVec3::splat(2.0), |face| face == 3);
    for (index, cell) in room.cells.iter().enumerate() {
        let corners: Vec<DVec3> = cell.corners().iter().map(|&vertex| room.vertices[vertex as usize]).collect();
        meshes::face(&mut mesh, &corners, u32::from(index == 0));
    }
    if !ground_first {
        ground(&mut mesh);
    }
    let lamp = Material { exitance: Quantity::gray(100.0), ..Material::diffuse("lamp", 0.6) };
    Scene::new(mesh, vec![Material::diffuse("walls", 0.6), lamp], Physics::Light, None).expect("valid")
}

fn sampled() -> &'static Kind {
    exchange::kind(exchange::Sampled::NAME).expect("a kind")
}

fn options(elements: usize, memory: usize) -> Options {
    let refinement = Refinement::Elements(elements);
    let (operator, basis) = (sampled(), &BASES[1]);
    Options { operator, basis, refinement, tolerance: 0.3, memory, error_points: 0, ..Options::default() }
}

/// Rays that are cast again are the rays that were stored.
#[test]
fn memory_does_not_change_a_bit() {
    let scene = scene(false);
    let [stored, recast] =
        [exchange::MEMORY, 1].map(|memory| solve(&scene, &options(2000, memory), &Silent).expect("solved"));
    assert_eq!(stored.solution.radiosity, recast.solution.radiosity);
    assert!(recast.operator.bytes < stored.operator.bytes);
}

/// Bands are taken in parts, and so are those whose rays are cast again.
#[test]
fn memory_does_not_change_a_bit_of_many_bands_each_of_which_is_what_it_is_alone() {
    let scene = scene(false);
    for basis in [0, 1, 3].map(|k| &BASES[k]) {
        let [stored, recast] = [exchange::MEMORY, 1].map(|memory| {
            let options = Options { basis, ..options(500, memory) };
            System::build(&scene, &options, &Silent).expect("built").exchange
        });
        // Of single precision, as those of a search are.
        let value = |row: usize, band: usize| f64::from(((row + 1) as f64 * (0.3 + band as f64)).sin() as f32);
        let x = MultiVector::from_fn(stored.rows(), 14, value);
        let alone: Vec<MultiVector> = (0..x.bands()).map(|band| stored.times(&x.one_band(band))).collect();
        for bands in 1..=x.bands() {
            let x = MultiVector::from_fn(stored.rows(), bands, value);
            let [found, again] = [&stored, &recast].map(|exchange| exchange.times(&x));
            assert_eq!(found, again, "{} {bands}", basis.name);
            for (found, alone) in found.iter_bands().zip(&alone) {
                let off = found.iter().zip(alone.band(0)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(off <= 1e-14 * alone.norms()[0], "{} {bands}: {off}", basis.name);
            }
        }
    }
}

/// What work says of its stages. It asks it to stop after having been asked so many times whether it should.
#[derive(Default)]
struct Listener {
    patience: Option<u64>,
    asked: AtomicU64,
    /// Steps that were done after that.
    late: AtomicU64,
    /// Stages in the order in which they begin: their names, steps, and steps that are done.
    stages: Mutex<Vec<(&'static str, u64, u64)>>,
    /// Those that have not ended.
    open: Mutex<Vec<usize>>,
}

impl Progress for Listener {
    fn begin(&self, stage: &'static str, total: u64) {
        let mut stages = self.stages.lock().expect("no panics");
        self.open.lock().expect("no panics").push(stages.len());
        stages.push((stage, total, 0));
    }

    fn advance(&self, steps: u64) {
        let innermost = *self.open.lock().expect("no panics").last().expect("a stage");
        self.stages.lock().expect("no panics")[innermost].2 += steps;
        if self.patience.is_some_and(|patience| self.asked.load(Ordering::Relaxed) > patience) {
            self.late.fetch_add(steps, Ordering::Relaxed);
        }
    }

    fn end(&self) {
        self.open.lock().expect("no panics").pop().expect("a stage");
    }

    fn interrupted(&self) -> bool {
        let asked = self.asked.fetch_add(1, Ordering::Relaxed);
        self.patience.is_some_and(|patience| asked >= patience)
    }
}

/// Each product took as long as casting the rays, in silence, and went on to its end.
#[test]
fn work_whose_rays_are_cast_again_tells_where_it_is_and_stops_at_any_time() {
    let scene = scene(false);
    for solver in [None, Some(Solver::Neumann)] {
        let options = Options { error_points: 64, solver, ..options(2000, 1) };
        let listener = Listener::default();
        let solved = solve(&scene, &options, &listener).expect("solved");
        assert!(solved.operator.recast > 0.99);
        assert!(listener.open.into_inner().expect("no panics").is_empty(), "what begins ends");
        let stages = listener.stages.into_inner().expect("no panics");
        let again = stages.iter().filter(|(name, ..)| *name == "casting rays again");
        assert!(again.clone().count() > solved.info.iterations);
        for stage in again {
            assert_eq!((stage.1, stage.2), (solved.solution.space.cells() as u64, stage.1));
        }
        let asked = listener.asked.into_inner();
        for part in 1..20 {
            let patience = Some(asked * part / 20);
            let listener = Listener { patience, ..Listener::default() };
            let stopped = solve(&scene, &options, &listener).map(drop);
            assert_eq!(failure::Failure::from(stopped.expect_err("stopped")), failure::Failure::Interrupted, "{part}");
            assert!(listener.open.into_inner().expect("no panics").is_empty(), "what begins ends");
            // The work of other threads.
            let late = listener.late.into_inner();
            assert!(late < solved.solution.space.cells() as u64 / 2, "{part}: {late}");
        }
    }
}

/// Nobody heard of these products.
#[test]
fn every_product_in_which_rays_are_cast_again_is_told() {
    let told = |work: &dyn Fn(&Listener)| {
        let listener = Listener::default();
        work(&listener);
        let stages = listener.stages.into_inner().expect("no panics");
        stages.iter().filter(|(name, ..)| *name == "casting rays again").count()
    };
    let mut scene = scene(false);
    let mut materials = scene.materials.clone();
    materials[0].reflectance = Quantity::function(|site, _| 0.3 + 0.1 * site.position.x.sin());
    scene.set_materials(materials).expect("as many");
    let build = |progress: &dyn Progress| System::build(&scene, &options(2000, 1), progress).expect("built");
    let system = build(&Silent);
    let solver = system.best_solver();
    let (solution, _) = system.solve(solver, &system.solver_params(solver), &Silent).expect("solved");
    // Two halves of the rays, and sums of rows.
    assert_eq!(told(&|listener| drop(build(listener))), 3);
    assert_eq!(told(&|listener| assert!(system.operator_norm(listener).is_ok())), 4);
    assert_eq!(told(&|listener| assert!(system.operator_error(&solution, listener).is_ok())), 2);
    assert_eq!(told(&|listener| assert!(system.energy(&solution, listener).is_ok())), 1);
}

/// A search that began afresh sooner where less memory was left had other digits.
#[test]
fn memory_does_not_change_a_bit_of_what_takes_many_products() {
    let mut scene = scene(false);
    let bright = |material: &Material| Material { reflectance: Quantity::gray(0.99), ..material.clone() };
    scene.set_materials(scene.materials.iter().map(bright).collect()).expect("as many");
    let solved = |memory: usize| {
        let system = System::build(&scene, &options(1000, memory), &Silent).expect("built");
        let params = solvers::Params { tolerance: 1e-4, ..system.solver_params(Solver::Gmres) };
        let (solution, info) = system.solve(Solver::Gmres, &params, &Silent).expect("solved");
        (solution.radiosity, info.iterations, system.exchange.statistics().bytes)
    };
    let (radiosity, iterations, bytes) = solved(exchange::MEMORY);
    assert!(iterations > 9, "{iterations}");
    for memory in [bytes, 1] {
        assert_eq!(solved(memory).0, radiosity, "{memory}");
    }
}

/// The last of the cells are no whole chunk, and were cast again whatever was allowed.
#[test]
fn what_is_said_to_hold_all_rays_holds_all() {
    let scene = scene(false);
    let stored =
        |memory: usize| System::build(&scene, &options(2000, memory), &Silent).expect("built").exchange.statistics();
    let most = stored(exchange::MEMORY);
    assert_eq!(stored(most.bytes + most.bytes / 20), most);
}

/// What an interrupted product leaves looks like a solution: nothing is missing where nothing arrives.
#[test]
fn what_is_made_of_an_interrupted_product_is_no_solution() {
    let system = System::build(&scene(false), &options(2000, 1), &Silent).expect("built");
    for solver in [Solver::Gmres, Solver::Neumann] {
        let params = system.solver_params(solver);
        let solve = |listener: &Listener| system.solve(solver, &params, listener).map(drop);
        let listener = Listener::default();
        solve(&listener).expect("solved");
        let asked = listener.asked.into_inner();
        for part in 0..20 {
            let stopped = solve(&Listener { patience: Some(asked * part / 20), ..Listener::default() });
            assert!(matches!(stopped, Err(Error::Solve(SolveError::Interrupted(_)))), "{solver:?} {part}: {stopped:?}");
        }
    }
}

/// Rays that are lost take no room. Cells stand in the order of the file, so that the first may have all of them, or none.
#[test]
fn memory_bounds_rays_beside_what_is_always_stored_and_nearly_all_of_it_is_used() {
    for scene in [scene(false), scene(true)] {
        let stored = |memory: usize| -> Statistics {
            System::build(&scene, &options(20_000, memory), &Silent).expect("built").exchange.statistics()
        };
        let [least, most] = [0, exchange::MEMORY].map(stored);
        assert_eq!((least.recast, most.recast), (1.0, 0.0));
        for share in [0.3, 0.7] {
            let room = share * (most.bytes - least.bytes) as f64;
            let used = (stored(least.bytes + room as usize).bytes - least.bytes) as f64 / room;
            assert!(used <= 1.0 && used > 0.85, "{share}: {used}");
        }
    }
}

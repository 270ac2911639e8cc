//! New lamps and new paints on the operator that is there: S holds no material.

#[expect(dead_code, reason = "not every test needs every mesh")]
mod meshes;

use hatbox::assemble::Accuracy;
use hatbox::exchange::Exchange;
use hatbox::linalg::{LinearOperator, MultiVector};
use hatbox::mesh::Refinement;
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, Solved, System};
use hatbox::scene::{Material, Physics, Quantity, Scene, SceneError};
use std::sync::Arc;

/// The unit cube, seen from inside: floor, walls in two materials side by side, and a lamp on the ceiling.
fn cube(materials: Vec<Material>) -> Scene {
    let mut mesh = meshes::room(glam::DVec3::ONE, |face| face == 0);
    for cell in 0..mesh.cells.len() {
        let patch = mesh.patch(cell);
        mesh.cells[cell].material = match patch.normal().z {
            z if z < -0.5 => 2,
            z if z > 0.5 && cell % 2 == 0 => 1,
            _ => 0,
        };
    }
    Scene::new(mesh, materials, Physics::Light, None).expect("a valid scene")
}

fn materials(reflectances: [f64; 3], lamp: f64) -> Vec<Material> {
    let [a, b, c] = reflectances;
    let lamp = Material { exitance: Quantity::gray(lamp), ..Material::diffuse("lamp", c) };
    vec![Material::diffuse("walls", a), Material::diffuse("floor", b), lamp]
}

fn options() -> Options {
    Options { refinement: Refinement::Elements(300), tolerance: 1e-4, error_points: 16, ..Options::default() }
}

fn system(scene: &Scene) -> System {
    System::build(scene, &options(), &Silent).expect("built")
}

fn solved(system: &System) -> Solved {
    system.solved(&options(), &Silent).expect("solved")
}

/// The greatest difference of two fields, relative to the greatest value.
fn difference(a: &MultiVector, b: &MultiVector) -> f64 {
    let greatest = a.as_slice().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    a.as_slice().iter().zip(b.as_slice()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / greatest
}

#[test]
fn light_is_linear_in_the_lamps_and_the_operator_is_shared() {
    let first = system(&cube(materials([0.5, 0.5, 0.2], 1.0)));
    let mut second = first.clone();
    second.set_materials(materials([0.5, 0.5, 0.2], 3.0), options().continuity).expect("the same cells");
    assert!(Arc::ptr_eq(&first.exchange, &second.exchange));
    let (mut once, thrice) = (solved(&first).solution.radiosity, solved(&second).solution.radiosity);
    once.add_scaled(2.0, &once.clone());
    assert!(difference(&once, &thrice) < 1e-9, "{}", difference(&once, &thrice));
}

#[test]
fn a_repainted_scene_is_the_scene_that_was_painted_so_from_the_start() {
    let paints = materials([0.7, 0.1, 0.0], 2.0);
    let fresh = solved(&system(&cube(paints.clone())));
    let first = system(&cube(materials([0.5, 0.5, 0.2], 1.0)));
    let mut again = first.clone();
    again.set_materials(paints, options().continuity).expect("the same cells");
    let again = solved(&again);
    // Radiosity jumps where the floor is painted in two ways now, so there are more unknowns than before.
    assert!(first.space.dofs() < again.unknowns);
    assert_eq!(again.unknowns, fresh.unknowns);
    let (a, b) = (&fresh.solution, &again.solution);
    assert!(difference(&a.radiosity, &b.radiosity) < 1e-9, "{}", difference(&a.radiosity, &b.radiosity));
    assert!(difference(&a.irradiance, &b.irradiance) < 1e-9, "{}", difference(&a.irradiance, &b.irradiance));
    assert!(again.energy.defect() < 1e-9);
}

/// What was integrated of the first one is used again.
#[test]
fn an_emission_that_stays_follows_the_paint_and_the_number_of_bands() {
    let paints = |lamp| materials([0.7, 0.1, 0.0], lamp);
    let mut kept = system(&cube(materials([0.5, 0.5, 0.2], 1.0)));
    solved(&kept);
    for (lamp, bands) in [(1.0, 1), (1.0, 3), (2.0, 1), (2.0, 2)] {
        kept.set_materials(paints(lamp), options().continuity).expect("the same cells");
        kept.raise_bands(bands);
        let (again, fresh) =
            (solved(&kept).solution.radiosity, solved(&system(&cube(paints(lamp)))).solution.radiosity);
        assert_eq!(again.bands(), bands);
        for band in 0..bands {
            let off = difference(&fresh, &again.one_band(band));
            assert!(off < 1e-9, "{lamp} {bands}: {off}");
        }
    }
}

/// Rays know less of an equation that is solved in the joined space than one needs whose reflectance varies on elements.
#[test]
fn a_texture_on_a_sampled_operator_is_solved_for_as_from_the_start() {
    let options =
        Options { operator: hatbox::exchange::kind("sampled").expect("a kind"), tolerance: 0.02, ..options() };
    let varying = |factor: f64| {
        let mut varying = materials([0.7, 0.1, 0.0], 2.0);
        varying[0].reflectance = Quantity::function(move |site, _| factor * site.position.x);
        varying
    };
    let steps = [materials([0.5, 0.5, 0.2], 1.0), varying(0.8), varying(0.4), materials([0.6, 0.5, 0.2], 3.0)];
    let solved = |system: &System| system.solved(&options, &Silent).expect("solved").solution;
    let mut kept = System::build(&cube(steps[0].clone()), &options, &Silent).expect("built");
    for materials in steps {
        kept.set_materials(materials.clone(), options.continuity).expect("the same cells");
        let (again, fresh) =
            (solved(&kept), solved(&System::build(&cube(materials), &options, &Silent).expect("built")));
        for (again, fresh) in [(&again.radiosity, &fresh.radiosity), (&again.irradiance, &fresh.irradiance)] {
            assert!(difference(fresh, again) < 1e-3, "{}", difference(fresh, again));
        }
    }
}

#[test]
fn lamps_that_were_dark_when_rays_were_cast_are_named() {
    let with_walls = |walls: f64| {
        let mut all = materials([0.5, 0.5, 0.2], 1.0);
        all[0].exitance = Quantity::gray(walls);
        all
    };
    for operator in hatbox::exchange::ALL {
        let scene = cube(with_walls(0.0));
        let mut system =
            System::build(&scene, &Options { operator, tolerance: 0.1, ..options() }, &Silent).expect("built");
        assert_eq!(system.new_lamps(), Vec::<&str>::new());
        system.set_materials(with_walls(2.0), options().continuity).expect("the same cells");
        assert_eq!(system.new_lamps().contains(&"walls"), !system.exchange.is_symmetric(), "{}", operator.name);
    }
}

#[test]
fn new_materials_are_checked_like_the_first() {
    let mut scene = cube(materials([0.5, 0.5, 0.2], 1.0));
    let error = scene.set_materials(materials([0.5, 1.5, 0.2], 1.0)).expect_err("it reflects too much");
    assert!(matches!(error, SceneError::Reflectance { band: 0, .. }), "{error}");
    let error = scene.set_materials(vec![Material::diffuse("paint", 0.5)]).expect_err("two are missing");
    assert!(matches!(error, SceneError::Index { what: "material", .. }), "{error}");
}

#[test]
fn joined_coefficients_spread_to_the_broken_ones() {
    let solution = solved(&system(&cube(materials([0.5, 0.5, 0.2], 1.0)))).solution;
    let joined = solution.coefficients();
    let continuity = solution.space.continuity().expect("linear functions are joined");
    assert_eq!(joined.rows(), solution.space.dofs());
    assert_eq!(continuity.times(&joined), solution.radiosity);
}

/// The balanced operator differs from the integrals by no more than the row sums missed.
#[test]
fn single_blocks_are_those_of_the_operator() {
    let system = system(&cube(materials([0.5, 0.5, 0.2], 1.0)));
    let accuracy = Accuracy::new(1e-6, system.scene.mesh.area());
    let unit = |column: usize| {
        let mut x = MultiVector::zeros(system.space.broken_dofs(), 1);
        x.band_mut(0)[column] = 1.0;
        x
    };
    let (i, j) = (0, system.space.cells() - 1);
    let block = system.pair_block(i, j, &accuracy);
    assert!(block.sum() > 0.0);
    for (k, column) in system.space.range(j).enumerate() {
        let s = system.exchange.times(&unit(column));
        for (l, row) in system.space.range(i).enumerate() {
            let (found, exact) = (s.band(0)[row], block.values()[l * system.space.range(j).len() + k]);
            assert!((found - exact).abs() < 1e-3 * block.sum(), "{found} {exact}");
        }
    }
}

/// A sampled operator is asked for nothing it has said before.
mod what_was_learnt {
    use super::*;
    use hatbox::exchange::{self, Exchange};
    use hatbox::solve::{Info, Kind, Params};

    const TOLERANCE: f64 = 1e-5;

    fn system(materials: Vec<Material>) -> System {
        let operator = exchange::kind(exchange::Sampled::NAME).expect("a kind");
        let options = Options { operator, tolerance: 0.03, ..options() };
        System::build(&cube(materials), &options, &Silent).expect("built")
    }

    fn repainted(system: &System, materials: Vec<Material>) -> System {
        let mut system = system.clone();
        system.set_materials(materials, options().continuity).expect("the same cells");
        system
    }

    fn solved(system: &System) -> (hatbox::radiosity::Solution, Info) {
        let params = Params { tolerance: TOLERANCE, ..Default::default() };
        system.solve(Kind::Gmres, &params, &Silent).expect("solved")
    }

    /// Solves `materials` after what `first` knows and afresh: the passes of both, after a comparison of the solutions.
    fn passes(first: &System, materials: Vec<Material>) -> [usize; 2] {
        let ((again, after), (fresh, before)) =
            (solved(&repainted(first, materials.clone())), solved(&system(materials)));
        for (again, fresh) in [(again.radiosity, fresh.radiosity), (again.irradiance, fresh.irradiance)] {
            assert!(difference(&again, &fresh) < 50.0 * TOLERANCE, "{}", difference(&again, &fresh));
        }
        [after.iterations, before.iterations]
    }

    #[test]
    fn dimming_costs_no_pass_and_painting_fewer_than_before() {
        let first = system(materials([0.7, 0.7, 0.2], 1.0));
        solved(&first);
        let [dimmed, fresh] = passes(&first, materials([0.7, 0.7, 0.2], 0.3));
        assert!(dimmed == 0 && fresh > 4, "{dimmed} of {fresh}");
        let [painted, fresh] = passes(&first, materials([0.6, 0.6, 0.3], 1.0));
        assert!(painted + 1 < fresh, "{painted} of {fresh}");
    }

    /// It is handed on from light to light, and a light that was solved for is known.
    #[test]
    fn of_two_lights_is_known_for_a_third() {
        let with = |floor: f64, lamp: f64| {
            let mut materials = materials([0.7, 0.6, 0.2], lamp);
            materials[1].exitance = Quantity::gray(floor);
            materials
        };
        let first = system(with(0.0, 1.0));
        solved(&first);
        let second = repainted(&first, with(1.0, 0.0));
        solved(&second);
        let [mixed, fresh] = passes(&second, with(0.2, 0.7));
        assert!(mixed <= 1 && fresh > 4, "{mixed} of {fresh}");
    }

    /// Where functions are joined in another way, nothing that was learnt has a meaning.
    #[test]
    fn is_forgotten_where_joints_change() {
        let first = system(materials([0.5, 0.5, 0.2], 1.0));
        solved(&first);
        let paints = materials([0.7, 0.1, 0.2], 1.0);
        let (again, fresh) = (solved(&repainted(&first, paints.clone())).0, solved(&system(paints)).0);
        assert_eq!(again.radiosity, fresh.radiosity);
    }

    /// A search that has no room for another function adds up what it has found, and begins afresh.
    #[test]
    fn where_little_may_be_remembered_the_light_is_the_same() {
        let operator = exchange::kind(exchange::Sampled::NAME).expect("a kind");
        let bright = || cube(materials([0.95, 0.9, 0.2], 1.0));
        let with = |memory: usize| {
            let options = Options { operator, tolerance: 0.03, memory, ..options() };
            System::build(&bright(), &options, &Silent).expect("built")
        };
        let much = with(options().memory);
        let little = with(much.exchange.statistics().bytes + 1);
        let ((much, _), (little, info)) = (solved(&much), solved(&little));
        assert!(info.iterations > 8, "{}", info.iterations);
        assert!(difference(&much.radiosity, &little.radiosity) < 50.0 * TOLERANCE);
    }

    /// A floor of one cell under a ceiling of many small ones: what is left of the equation weighs cells by their areas, and a direction
    /// along it brings nothing. The search went on along the same one for a thousand products.
    #[test]
    fn one_large_cell_among_small_ones_does_not_hold_up_the_search() {
        let operator = exchange::kind(exchange::Sampled::NAME).expect("a kind");
        let mut mesh = hatbox::mesh::Mesh::default();
        // A ceiling of small cells a tenth of a metre above a floor of one.
        for (height, n) in [(0.0, 1), (0.1, 24)] {
            let at = |i: usize, j: usize| glam::DVec3::new(i as f64 / n as f64, j as f64 / n as f64, height);
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let mut cell = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                if n > 1 {
                    cell.reverse();
                }
                meshes::face(&mut mesh, &cell, u32::from(n == 1));
            }
        }
        let floor = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("floor", 0.8) };
        let scene = Scene::new(mesh, vec![Material::diffuse("walls", 0.8), floor], Physics::Light, None);
        let options = Options {
            operator,
            basis: &hatbox::element::ALL[0],
            refinement: Refinement::None,
            tolerance: 0.02,
            ..options()
        };
        let system = System::build(&scene.expect("valid"), &options, &Silent).expect("built");
        let (solution, info) = solved(&system);
        assert!(info.iterations < 60, "{}", info.iterations);
        let power = system.energy(&solution, &Silent).expect("not interrupted");
        assert!(power.leaving[0] > 0.0 && power.defect() < 1e-3, "{power:?}");
    }

    /// A system says the same whenever it is asked.
    #[test]
    fn does_not_change_what_a_system_says() {
        let system = system(materials([0.7, 0.7, 0.2], 1.0));
        assert_eq!(solved(&system).0.radiosity, solved(&system).0.radiosity);
    }
}

/// A search asks for the bands that are still open: here first for all of them, and last for the bright one, which is neither the first
/// nor the last. Then, as a floor shines in that band, for the emission of that alone. Each is what it is where there are no others.
#[test]
fn bands_that_are_found_sooner_or_later_are_what_they_are_alone() {
    let reflectances = [0.02, 0.8, 0.3];
    let some = |varying: bool, bands: &[usize], floor: [f64; 3]| -> Vec<Material> {
        let of = |values: [f64; 3]| bands.iter().map(|&band| values[band]).collect::<Vec<f64>>();
        let r = of(reflectances);
        let paint = if varying {
            Quantity::function(move |site, band| r[band] * (0.5 + 0.5 * site.position.x))
        } else {
            Quantity::Uniform(r)
        };
        let mut all = materials([0.0; 3], 0.0);
        for (material, exitance) in all.iter_mut().zip([[0.0; 3], floor, [1.0; 3]]) {
            material.reflectance = paint.clone();
            material.exitance = Quantity::Uniform(of(exitance));
        }
        all
    };
    let options = Options { operator: hatbox::exchange::kind("sampled").expect("a kind"), ..options() };
    let options = Options { tolerance: 0.01, ..options };
    let system = System::build(&cube(some(false, &[0, 1, 2], [0.0; 3])), &options, &Silent).expect("built");
    let lit = |system: &mut System, materials: Vec<Material>| {
        system.set_materials(materials, options.continuity).expect("the same cells");
        system.solved(&options, &Silent).expect("solved").solution
    };
    for varying in [false, true] {
        let mut together = system.clone();
        for floor in [[0.0; 3], [0.0, 0.5, 0.0]] {
            let found = lit(&mut together, some(varying, &[0, 1, 2], floor));
            for band in 0..3 {
                let alone = lit(&mut system.clone(), some(varying, &[band], floor));
                for (found, alone) in [(&found.radiosity, alone.radiosity), (&found.irradiance, alone.irradiance)] {
                    let off = difference(&found.one_band(band), &alone);
                    assert!(off < 5e-3, "varying {varying}, floor {floor:?}, band {band}: {off}");
                }
            }
        }
    }
}

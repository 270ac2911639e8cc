//! What every kind of exchange operator must do, whichever way it gets there.

#![expect(clippy::float_cmp, reason = "exact zeros are meant exactly")]

#[allow(dead_code, reason = "other tests use the rest")]
mod meshes;

use glam::DVec3;
use hatbox::element::{ALL as BASES, Basis};
use hatbox::exchange::{self, Exchange, Kind};
use hatbox::io::read_scene;
use hatbox::linalg::{LinearOperator, MultiVector};
use hatbox::mesh::{Mesh, Refinement};
use hatbox::progress::Silent;
use hatbox::radiosity::{MaterialsError, Options, Solution, System, solve};
use hatbox::scene::{Material, Physics, Quantity, Scene};
use hatbox::solve;
use hatbox::space::{Continuity, FunctionSpace};
use std::path::Path;

const TOLERANCE: f64 = 0.01;

/// A room whose first face may be a lamp.
fn room(reflectance: f64, exitance: [f64; 2]) -> Scene {
    let mut mesh = meshes::room(DVec3::new(2.0, 1.0, 1.5), |face| face == 3);
    mesh.cells[0].material = 1;
    let wall = Material { exitance: Quantity::gray(exitance[0]), ..Material::diffuse("wall", reflectance) };
    let lamp = Material { exitance: Quantity::gray(exitance[1]), ..Material::diffuse("lamp", reflectance) };
    Scene::new(mesh, vec![wall, lamp], Physics::Light, None).expect("valid")
}

fn options(kind: &'static Kind, basis: &'static Basis) -> Options {
    let refinement = Refinement::Elements(200);
    Options { operator: kind, basis, refinement, tolerance: TOLERANCE, error_points: 0, ..Options::default() }
}

fn system(scene: &Scene, kind: &'static Kind, basis: &'static Basis, strengths: &dyn Fn(usize) -> f64) -> System {
    let scene = scene.refined(Refinement::Elements(200), basis).expect("refined");
    let space = FunctionSpace::new(&scene, basis, Continuity::named("continuous").expect("a name")).expect("elements");
    let strengths =
        (0..scene.mesh.cells.len()).map(|cell| strengths(scene.mesh.cells[cell].material as usize)).collect();
    let params = exchange::Params { strengths, ..exchange::Params::new(TOLERANCE) };
    System::new(scene, space, kind, &params, &Silent).expect("built")
}

/// With lamps and without.
const STRENGTHS: [fn(usize) -> f64; 2] = [|_| 1.0, |material| if material == 1 { 50.0 } else { 1.0 }];

fn for_all(check: impl Fn(&'static Kind, &'static Basis)) {
    for kind in exchange::ALL {
        for basis in &BASES {
            check(kind, basis);
        }
    }
}

#[test]
fn constants_come_back_exactly_in_a_closed_scene() {
    for_all(|kind, basis| {
        for strengths in STRENGTHS {
            let system = system(&room(0.5, [0.0, 1.0]), kind, basis, &strengths);
            assert_eq!(system.exchange.closure.escape, 0.0, "{}", kind.name);
            assert!(system.exchange.closure.balanced, "{} {}", kind.name, basis.name);
            let norm = system.operator_norm(&Silent).expect("not interrupted");
            assert!((norm - 1.0).abs() < TOLERANCE, "{} {}: norm {norm}", kind.name, basis.name);
        }
    });
}

/// xᵀS y = yᵀS x: to rounding, or else to what the operator says of itself.
#[test]
fn the_operator_is_as_symmetric_as_it_says() {
    for_all(|kind, basis| {
        let system = system(&room(0.5, [0.0, 1.0]), kind, basis, &STRENGTHS[1]);
        let exchange = &system.exchange;
        let smooth = |phase: f64| {
            MultiVector::from_fn(exchange.rows(), 1, |row, _| {
                let cell = (0..system.space.cells()).find(|&cell| system.space.range(cell).contains(&row));
                let p = system.scene.mesh.patch(cell.expect("a cell")).center();
                1.0 + (2.0 * p.x + p.y - p.z + phase).sin()
            })
        };
        let (x, y) = (smooth(0.0), smooth(1.3));
        let [there, back] = [x.dot(&exchange.times(&y))[0], y.dot(&exchange.times(&x))[0]];
        let allowed = if exchange.is_symmetric() { 1e-12 } else { TOLERANCE };
        assert!((there - back).abs() <= allowed * there.abs(), "{} {}: {there} {back}", kind.name, basis.name);
    });
}

/// A closed scene of uniform exitance and reflectance glows with B⁰/(1 − ρ) everywhere.
#[test]
fn a_furnace_glows_evenly() {
    for_all(|kind, basis| {
        let (rho, exitance) = (0.75, 2.0);
        let system = System::build(&room(rho, [exitance; 2]), &options(kind, basis), &Silent).expect("built");
        let (solution, expected) = (tightly(&system), exitance / (1.0 - rho));
        for b in solution.radiosity.as_slice() {
            assert!((b - expected).abs() < 1e-6 * expected, "{} {}: {b}", kind.name, basis.name);
        }
        // Everywhere as much arrives as leaves, by rays and through links together.
        // Rows of a symmetric operator have the right sums, those of others are right at every point.
        let allowed = if system.exchange.is_symmetric() { TOLERANCE } else { 1e-6 };
        for e in solution.irradiance.as_slice() {
            assert!((e - expected).abs() < allowed * expected, "{} {}: E = {e}", kind.name, basis.name);
        }
    });
}

/// What lamps emit is absorbed: Galerkin's method balances power, and a closed scene loses none but for the operator's
/// lack of symmetry.
#[test]
fn power_is_balanced() {
    for_all(|kind, basis| {
        let system = System::build(&room(0.6, [0.0, 100.0]), &options(kind, basis), &Silent).expect("built");
        let energy = system.energy(&tightly(&system), &Silent).expect("not interrupted");
        assert!(energy.defect() < 1e-6, "{} {}: defect {}", kind.name, basis.name, energy.defect());
        let escaped = (energy.escaped[0] / energy.emitted[0]).abs();
        let allowed = if kind.name == exchange::Dense::NAME { 1e-8 } else { TOLERANCE };
        assert!(escaped < allowed, "{} {}: escaped {escaped}", kind.name, basis.name);
    });
}

/// Suns are right-hand sides: each is solved for as if it were alone, by every solver.
#[test]
fn many_right_hand_sides_are_each_solved_for_as_if_alone() {
    for_all(|kind, basis| {
        let system = System::build(&room(0.6, [0.0, 100.0]), &options(kind, basis), &Silent).expect("built");
        let load = |column: usize, dof: usize| (1.0 + (dof * (column + 1)) as f64).sin().abs();
        let rows = system.space.broken_dofs();
        let together = MultiVector::from_fn(rows, 3, |dof, column| load(column, dof));
        let params = solve::Params { tolerance: 1e-9, ..solve::Params::default() };
        for solver in [solve::Kind::Cg, solve::Kind::Gmres, solve::Kind::Neumann] {
            let solved =
                |load: &MultiVector| system.solve_for(load, solver, &params, &Silent).expect("solved").0.radiosity;
            let together = solved(&together);
            for column in 0..3 {
                let alone = solved(&MultiVector::from_fn(rows, 1, |dof, _| load(column, dof)));
                let pairs = alone.band(0).iter().zip(together.band(column));
                let off = pairs.map(|(a, b)| (a - b).abs() / (1.0 + a.abs())).fold(0.0, f64::max);
                assert!(off < 1e-5, "{} {} {solver:?}: {off}", kind.name, basis.name);
            }
        }
    });
}

/// Cᵀ S C in one is what the three are one after the other: with lamps, with links, and with rays that are cast again.
#[test]
fn an_operator_that_is_handed_the_joints_applies_the_same() {
    for_all(|kind, basis| {
        let scene = room(0.6, [0.0, 100.0]);
        for memory in [exchange::MEMORY, 200_000] {
            if memory < exchange::MEMORY && kind.name == exchange::Dense::NAME {
                continue;
            }
            let options = Options { memory, ..options(kind, basis) };
            let system = System::build(&scene, &options, &Silent).expect("built");
            let Some(c) = system.space.continuity() else { continue };
            let x = MultiVector::from_fn(c.cols(), 2, |row, band| ((row + 1) as f64 * (0.3 + band as f64)).sin());
            let transpose = c.transpose();
            let expected = transpose.times(&system.exchange.times(&c.times(&x)));
            let found = system.exchange.times_joined([c, &transpose], &x, &Silent).expect("not interrupted");
            let scale = expected.norms()[0];
            let off = found.as_slice().iter().zip(expected.as_slice()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-13 * scale, "{} {} {memory}: {off}", kind.name, basis.name);
        }
    });
}

/// The solution to ten digits, whatever the operator deserves.
fn tightly(system: &System) -> Solution {
    let params = solve::Params { tolerance: 1e-10, ..solve::Params::default() };
    system.solve(system.best_solver(), &params, &Silent).expect("solved").0
}

/// The residual is relative to what is reflected: a lamp that is far away and very bright is no excuse.
#[test]
fn the_light_of_a_far_lamp_is_reflected() {
    let mut mesh = Mesh::default();
    let up = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    meshes::face(&mut mesh, &up.map(|(x, y)| DVec3::new(x, y, 0.0)), 0);
    // The lamp is behind the wall, which the floor alone lights.
    meshes::face(&mut mesh, &up.map(|(y, z)| DVec3::new(0.0, y, z)), 0);
    meshes::face(&mut mesh, &up.map(|(y, x)| DVec3::new(0.1 * x - 2.0, 0.1 * y, 1000.0)), 1);
    let lamp = Material { exitance: Quantity::gray(1e9), ..Material::diffuse("lamp", 0.0) };
    let scene = Scene::new(mesh, vec![Material::diffuse("gray", 0.5), lamp], Physics::Light, None).expect("valid");
    let light_on_wall = |kind| {
        let solution = solve(&scene, &options(kind, &BASES[0]), &Silent).expect("solved").solution;
        let on_wall = |&cell: &usize| solution.scene.mesh.patch(cell).normal().x > 0.5;
        let light = |cell: usize| {
            let mean = solution.irradiance.band(0)[solution.space.range(cell)][0];
            mean * solution.scene.mesh.patch(cell).area()
        };
        (0..solution.space.cells()).filter(on_wall).map(light).sum::<f64>()
    };
    let [expected, ..] = exchange::ALL.iter().map(light_on_wall).collect::<Vec<_>>()[..] else { panic!("kinds") };
    assert!(expected > 0.0);
    for kind in exchange::ALL {
        let found = light_on_wall(kind);
        assert!((found - expected).abs() < 0.1 * expected, "{}: {found} instead of {expected}", kind.name);
    }
}

/// A lamp of a hundred times the floor's area, so far away that it is small: E = B⁰ A / (π h²).
#[test]
fn a_large_lamp_that_is_far_away_is_small() {
    let square = |s: f64, z: f64| [(-s, -s), (s, -s), (s, s), (-s, s)].map(|(x, y)| DVec3::new(x, y, z));
    let (height, exitance) = (1e4, 1e6);
    let mut mesh = Mesh::default();
    meshes::face(&mut mesh, &square(0.5, 0.0), 0);
    let mut lamp = square(5.0, height);
    lamp.reverse();
    meshes::face(&mut mesh, &lamp, 1);
    let sun = Material { exitance: Quantity::gray(exitance), ..Material::diffuse("sun", 0.0) };
    let scene = Scene::new(mesh, vec![Material::diffuse("gray", 0.5), sun], Physics::Light, None).expect("valid");
    let exact = exitance * 100.0 / (std::f64::consts::PI * height * height);
    for_all(|kind, basis| {
        let solution = solve(&scene, &options(kind, basis), &Silent).expect("solved").solution;
        let on_floor = |&cell: &usize| solution.scene.mesh.patch(cell).center().z < 1.0;
        for cell in (0..solution.space.cells()).filter(on_floor) {
            for e in &solution.irradiance.band(0)[solution.space.range(cell)] {
                assert!((e - exact).abs() < TOLERANCE * exact, "{} {}: {e} {exact}", kind.name, basis.name);
            }
        }
    });
}

/// What sees nothing but lamps gets what they send, to the last digit.
#[test]
fn among_lamps_constants_come_back_exactly() {
    // A chamber of lamps with a gray floor, beside a large room.
    let mut mesh = meshes::room(DVec3::splat(10.0), |_| false);
    let chamber = meshes::room(DVec3::ONE, |_| false);
    for cell in 0..chamber.cells.len() {
        let corners: Vec<DVec3> = chamber.patch(cell).corners().iter().map(|&p| p + DVec3::splat(20.0)).collect();
        meshes::face(&mut mesh, &corners, u32::from(cell > 0));
    }
    let lamp = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.0) };
    let scene = Scene::new(mesh, vec![Material::diffuse("gray", 0.5), lamp], Physics::Light, None).expect("valid");
    for_all(|kind, basis| {
        let system = system(&scene, kind, basis, &|material| if material == 1 { 50.0 } else { 1.0 });
        let sums = system.exchange.times(&MultiVector::uniform(system.exchange.rows(), &[1.0]));
        for cell in 0..system.space.cells() {
            let sum: f64 = sums.band(0)[system.space.range(cell)].iter().sum();
            let area = system.scene.mesh.patch(cell).area();
            assert!((sum - area).abs() < 1e-9 * area, "{} {}: {sum} {area}", kind.name, basis.name);
        }
    });
}

/// Bands do not know of each other. Products have loops of their own for some numbers of them, and read those of single precision
/// as such: here the last three, where they are alone.
#[test]
fn each_band_is_what_it_is_alone() {
    let mixed = room(0.5, [0.0, 1.0]);
    let quads = Scene::new(meshes::room(DVec3::ONE, |_| false), mixed.materials.clone(), Physics::Light, None);
    for scene in [mixed.triangulated(), quads.expect("valid"), mixed] {
        for_all(|kind, basis| {
            let system = system(&scene, kind, basis, &STRENGTHS[1]);
            let rows = system.exchange.rows();
            let x = MultiVector::from_fn(rows, 6, |row, band| {
                let x = 1.0 + ((row + 7 * band) as f64).sin();
                if band < 3 { x } else { f64::from(x as f32) }
            });
            let some = |bands: std::ops::Range<usize>| {
                let data = bands.clone().flat_map(|band| x.band(band).to_vec()).collect();
                system.exchange.times(&MultiVector::from_bands(bands.len(), data).expect("whole columns"))
            };
            let all = some(0..6);
            for bands in [0..1, 1..3, 0..3, 0..4, 3..6, 4..5] {
                for (band, alone) in bands.clone().zip(some(bands).iter_bands()) {
                    for (a, b) in all.band(band).iter().zip(alone) {
                        assert!((a - b).abs() < 1e-13 * b.abs().max(1e-3), "{} {}: {a} {b}", kind.name, basis.name);
                    }
                }
            }
        });
    }
}

/// A band in which nothing shines, or nothing is reflected, has no light, and the others do not mind.
#[test]
fn a_dark_band_keeps_no_other_from_its_light() {
    let rgb = |values: [f64; 3]| Quantity::Uniform(values.to_vec());
    for (exitance, reflectance) in [([1.0, 0.5, 0.0], [0.5; 3]), ([1.0; 3], [0.5, 0.6, 0.0])] {
        let mut scene = room(0.5, [0.0, 1.0]);
        let materials = scene.materials.iter().enumerate().map(|(k, material)| Material {
            reflectance: rgb(reflectance),
            exitance: rgb(exitance.map(|b| if k == 1 { b } else { 0.0 })),
            ..material.clone()
        });
        scene.set_materials(materials.collect()).expect("as many");
        for_all(|kind, basis| {
            let solution = solve(&scene, &options(kind, basis), &Silent).expect("solved").solution;
            let reflects = solution.radiosity.iter_bands().zip(reflectance.iter().zip(exitance));
            for (b, (&r, e)) in reflects {
                let dark = b.iter().filter(|&&b| b == 0.0).count();
                assert!(
                    b.iter().all(|b| b.is_finite()) && (dark > 0) == (r * e == 0.0),
                    "{} {}",
                    kind.name,
                    basis.name
                );
            }
        });
    }
}

/// Light may be as faint or as bright as it likes: the solution is so many times that of a lamp of 1.
#[test]
fn the_unit_of_light_does_not_matter() {
    let light = |exitance: f64| {
        let kind = exchange::kind(exchange::Sampled::NAME).expect("a kind");
        let mut light =
            solve(&room(0.5, [0.0, exitance]), &options(kind, &BASES[1]), &Silent).expect("solved").solution.radiosity;
        light.scale(1.0 / exitance);
        light
    };
    let one = light(1.0);
    for exitance in [1e-43, 1e-40, 1e40] {
        let found = light(exitance);
        let off = one.as_slice().iter().zip(found.as_slice()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-6, "{exitance:e}: {off}");
    }
}

/// Sampled solutions balance power where light is reflected a hundred times, too, and say how far they went.
#[test]
fn power_is_balanced_in_a_bright_room() {
    for name in ["sampled", "hierarchical"] {
        let kind = exchange::kind(name).expect("a kind");
        for basis in &BASES {
            let solved = solve(&room(0.99, [0.0, 1.0]), &options(kind, basis), &Silent).expect("solved");
            let (defect, residual) = (solved.energy.defect(), solved.info.residual);
            assert!(defect < 1e-6 && residual < 1.01e-3, "{name} {}: {defect} {residual}", basis.name);
        }
    }
}

#[test]
fn nothing_goes_through_a_wall() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/two-rooms-walled.glb");
    let (scene, _) = read_scene(&path).expect("a sample scene");
    for_all(|kind, basis| {
        let solved = solve(&scene, &options(kind, basis), &Silent).expect("solved").solution;
        let (mut dark, mut lit) = (0, 0);
        for cell in 0..solved.scene.mesh.cells.len() {
            let values = &solved.radiosity.band(0)[solved.space.range(cell)];
            if solved.scene.mesh.patch(cell).center().x > 4.1 {
                assert!(values.iter().all(|&b| b == 0.0), "{} {}: {values:?}", kind.name, basis.name);
                dark += 1;
            } else {
                lit += usize::from(values.iter().all(|&b| b > 0.0));
            }
        }
        assert!(dark > 20 && lit > 20, "{dark} {lit}");
    });
}

/// The kinds are independent ways to one number.
#[test]
fn all_kinds_agree_on_a_small_lamp() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/cornell-box.glb");
    let (scene, _) = read_scene(&path).expect("a sample scene");
    let solved: Vec<_> = exchange::ALL
        .iter()
        .map(|kind| solve(&scene, &options(kind, &BASES[1]), &Silent).expect("solved").solution)
        .collect();
    for other in &solved[1..] {
        let mass = hatbox::assemble::mass(&other.scene, &other.space);
        let mut difference = other.irradiance.clone();
        difference.add_scaled(-1.0, &solved[0].irradiance);
        let square = |x: &MultiVector| x.dot(&mass.times(x)).iter().sum::<f64>();
        let relative = (square(&difference) / square(&solved[0].irradiance)).sqrt();
        // On 200 elements the joined and the broken irradiance differ by the discretisation's error.
        assert!(relative < 0.12, "{relative}");
    }
}

/// Another paint and another light on the same operator give what a system made afresh gives, to the last bit.
#[test]
fn new_materials_keep_the_operator() {
    let continuity = Continuity::named("continuous").expect("a name");
    for kind in exchange::ALL {
        let (old, new) = (room(0.5, [0.0, 10.0]), room(0.7, [1.0, 3.0]));
        let mut changed = system(&old, kind, &BASES[1], &STRENGTHS[1]);
        changed.set_materials(new.materials.clone(), continuity).expect("the same cells");
        let fresh = system(&new, kind, &BASES[1], &STRENGTHS[1]);
        let params = hatbox::solve::Params { tolerance: 1e-7, ..Default::default() };
        let [a, b] = [&changed, &fresh].map(|s| s.solve(s.best_solver(), &params, &Silent).expect("solved").0);
        assert_eq!(a.radiosity, b.radiosity, "{}", kind.name);
        assert_eq!(a.irradiance, b.irradiance, "{}", kind.name);
        let fewer = changed.set_materials(vec![Material::diffuse("one", 0.5)], continuity);
        assert_eq!(fewer, Err(MaterialsError::Geometry));
    }
}

/// What an operator's errors change of the reflected light relative to it: the difference to a better one, and what the operator
/// says itself.
fn operator_errors(scene: &Scene, rough: &Options, better: &Options) -> [f64; 2] {
    let fine = solve(scene, better, &Silent).expect("solved").solution;
    let system = System::build(scene, rough, &Silent).expect("built");
    let coarse = system.solved(rough, &Silent).expect("solved").solution;
    let mass = hatbox::assemble::mass(&fine.scene, &fine.space);
    let emitted = mass.inverse().expect("areas").times(&hatbox::assemble::load(&fine.scene, &fine.space));
    let distance = |from: &MultiVector| {
        let mut difference = fine.radiosity.clone();
        difference.add_scaled(-1.0, from);
        difference.dot(&mass.times(&difference))[0].sqrt()
    };
    [
        distance(&coarse.radiosity) / distance(&emitted),
        system.operator_error(&coarse, &Silent).expect("not interrupted"),
    ]
}

/// What errors of pairs say of the light is not less than what comes of it, and little more than ten times as much: in an
/// empty room errors of quadrature are given so that none is greater, and joining averages them.
#[test]
fn the_errors_of_pairs_tell_the_error_of_the_light() {
    let kind = exchange::kind(exchange::Dense::NAME).expect("a kind");
    for basis in [&BASES[1], &BASES[3]] {
        let rough = Options { tolerance: 0.1, ..options(kind, basis) };
        let better = Options { tolerance: 1e-3, ..rough };
        let [truth, estimate] = operator_errors(&room(0.6, [0.0, 100.0]), &rough, &better);
        assert!(estimate > truth && estimate < 20.0 * truth, "{}: {estimate} {truth}", basis.name);
    }
}

/// The edge of the sheet that hides the greater part of a lamp from a floor.
const EDGE: f64 = 0.125;

/// A floor of 64 faces that sees about a quarter of a lamp past the edge of a sheet, so wide that the lamp is small beside it.
fn floor_behind_a_sheet() -> Scene {
    let mut mesh = Mesh::default();
    let rectangle = |x: [f64; 2], y: [f64; 2], z: f64| {
        [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j): (usize, usize)| DVec3::new(x[i], y[j], z))
    };
    let part = |k: u32| [f64::from(k), f64::from(k + 1)].map(|k| 0.0125 * (k - 4.0));
    (0..64).for_each(|k| meshes::face(&mut mesh, &rectangle(part(k % 8), part(k / 8), 0.0), 0));
    meshes::face(&mut mesh, &rectangle([-6.0, EDGE], [-1.0, 1.0], 0.5), 1);
    meshes::face(&mut mesh, &rectangle([0.5, -0.5], [-0.5, 0.5], 1.0), 2);
    let lamp = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.0) };
    let materials = vec![Material::diffuse("floor", 0.5), Material::diffuse("sheet", 0.0), lamp];
    Scene::new(mesh, materials, Physics::Light, None).expect("valid")
}

/// ∫G over the part of the lamp that a point of that floor sees: G = 1/(π (1 + r²)²) at a distance of 1.
fn irradiance_behind_the_sheet(x: f64, y: f64) -> f64 {
    const STEPS: u32 = 100;
    let from = 2.0 * EDGE - x;
    let middle = |k: u32| (f64::from(k) + 0.5) / f64::from(STEPS);
    let g = |k: u32| {
        let (to_x, to_y) = (from + (0.5 - from) * middle(k % STEPS) - x, middle(k / STEPS) - 0.5 - y);
        1.0 / (std::f64::consts::PI * (1.0 + to_x * to_x + to_y * to_y).powi(2))
    };
    (0..STEPS * STEPS).map(g).sum::<f64>() * (0.5 - from) / f64::from(STEPS * STEPS)
}

/// Rays that asked on only where the first of them disagreed made the floor too dark, and so did a number that S was multiplied
/// by, from the rays that had left the wide sheet.
#[test]
fn a_floor_that_sees_a_quarter_of_a_lamp_gets_that_light() {
    let scene = floor_behind_a_sheet();
    for kind in exchange::ALL {
        for (tolerance, most) in [(0.1, 0.03), (0.03, 0.01), (0.01, 0.003)] {
            let options = Options { refinement: Refinement::None, tolerance, ..options(kind, &BASES[0]) };
            let solution = solve(&scene, &options, &Silent).expect("solved").solution;
            let mesh = &solution.scene.mesh;
            let (mut found, mut exact) = (0.0, 0.0);
            for cell in (0..mesh.cells.len()).filter(|&cell| mesh.cells[cell].material == 0) {
                let center = mesh.patch(cell).center();
                found += solution.irradiance.band(0)[cell];
                exact += irradiance_behind_the_sheet(center.x, center.y);
            }
            assert!((found / exact - 1.0).abs() < most, "{}, {tolerance}: {} of what it is", kind.name, found / exact);
        }
    }
}

/// Of many lamps each has one ray, which must not go to places below the horizon: the floor lost what they would have brought.
#[test]
fn lamps_that_reach_below_the_horizon_send_what_is_above() {
    let mut mesh = Mesh::default();
    let part = |k: u32| [f64::from(k), f64::from(k + 1)].map(|k| 0.025 * (k - 4.0));
    for k in 0..64 {
        let ([x0, x1], [y0, y1]) = (part(k % 8), part(k / 8));
        meshes::face(&mut mesh, &[(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|(x, y)| DVec3::new(x, y, 0.0)), 0);
    }
    // So wide that the lamps are small beside it.
    meshes::face(
        &mut mesh,
        &[(-2, -2), (2, -2), (2, 2), (-2, 2)].map(|(x, y)| DVec3::new(x.into(), y.into(), -3.0)),
        1,
    );
    for k in 0..64 {
        let y = 0.03 * (f64::from(k) - 31.5);
        let corners = [(y - 0.01, -0.25), (y - 0.01, 0.25), (y + 0.01, 0.25), (y + 0.01, -0.25)];
        meshes::face(&mut mesh, &corners.map(|(y, z)| DVec3::new(1.0, y, z)), 2);
    }
    let lamp = Material { exitance: Quantity::gray(100.0), ..Material::diffuse("lamp", 0.0) };
    let materials = vec![Material::diffuse("floor", 0.5), Material::diffuse("ground", 0.0), lamp];
    let scene = Scene::new(mesh, materials, Physics::Light, None).expect("valid");
    let light = |name: &str| {
        let kind = exchange::kind(name).expect("a kind");
        let options = Options { refinement: Refinement::None, tolerance: 0.03, ..options(kind, &BASES[0]) };
        let solution = solve(&scene, &options, &Silent).expect("solved").solution;
        let floor = (0..solution.space.cells()).filter(|&cell| solution.scene.mesh.cells[cell].material == 0);
        floor.map(|cell| solution.irradiance.band(0)[cell]).sum::<f64>()
    };
    let share = light(exchange::Sampled::NAME) / light(exchange::Dense::NAME);
    assert!((share - 1.0).abs() < 0.05, "{share} of what it is");
}

/// Nearly all light of a far lamp escapes. Its pairs were allowed errors as if none did, more than the light that there was.
#[test]
fn errors_of_pairs_in_the_light_of_a_far_lamp_count_the_light_that_is_there() {
    let mut mesh = meshes::room(DVec3::new(1.0, 1.0, 1.0), |face| face == 1);
    mesh.cells.remove(1);
    mesh.cells.iter_mut().enumerate().for_each(|(k, cell)| cell.surface = k as u32);
    let lamp = [(0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)].map(|(x, y)| DVec3::new(x + 0.5, y + 0.5, 30.0));
    meshes::face(&mut mesh, &lamp, 1);
    let sun = Material { exitance: Quantity::gray(1e4), ..Material::diffuse("lamp", 0.0) };
    let scene = Scene::new(mesh, vec![Material::diffuse("wall", 0.5), sun], Physics::Light, None).expect("valid");
    let rough =
        Options { tolerance: 0.1, ..options(exchange::kind(exchange::Dense::NAME).expect("a kind"), &BASES[1]) };
    let [truth, estimate] = operator_errors(&scene, &rough, &Options { tolerance: 1e-3, ..rough });
    assert!(estimate > truth && estimate < rough.tolerance, "{estimate} {truth}");
}

/// Where all light is a lamp's, all that rays err by is the border of its shadow.
#[test]
fn an_operator_of_rays_knows_what_it_errs_by_in_the_shadow_of_a_lamp() {
    let dense = exchange::kind(exchange::Dense::NAME).expect("a kind");
    for name in [exchange::Sampled::NAME, exchange::Hierarchical::NAME] {
        for basis in [&BASES[0], &BASES[1], &BASES[3]] {
            let rough = options(exchange::kind(name).expect("a kind"), basis);
            let better = Options { operator: dense, tolerance: 1e-3, ..rough };
            let [truth, estimate] = operator_errors(&meshes::shadow::scene(), &rough, &better);
            assert!(estimate > 0.5 * truth && estimate < 2.0 * truth, "{name}, {}: {estimate} {truth}", basis.name);
        }
    }
}

/// The spread of two halves of the rays is an honest estimate of the operator's error: between a fifth and five times the
/// difference to an operator of sixteen times the rays.
#[test]
fn the_spread_estimates_the_error() {
    let kind = exchange::kind(exchange::Sampled::NAME).expect("a kind");
    let scene = room(0.6, [0.0, 100.0]);
    let coarse = solve(&scene, &options(kind, &BASES[1]), &Silent).expect("solved");
    let fine = solve(&scene, &Options { tolerance: TOLERANCE / 8.0, ..options(kind, &BASES[1]) }, &Silent);
    let fine = fine.expect("solved").solution;
    let system = system(&scene, kind, &BASES[1], &STRENGTHS[1]);
    let mass = hatbox::assemble::mass(&fine.scene, &fine.space);
    let mut difference = coarse.solution.irradiance.clone();
    difference.add_scaled(-1.0, &fine.irradiance);
    let square = |x: &MultiVector| x.dot(&mass.times(x))[0];
    let truth = (square(&difference) / square(&fine.irradiance)).sqrt();
    let estimate = system.operator_error(&coarse.solution, &Silent).expect("not interrupted");
    assert!(estimate > 0.2 * truth && estimate < 5.0 * truth, "{estimate} {truth}");
}

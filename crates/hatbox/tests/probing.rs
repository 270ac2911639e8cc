//! Values at points: the light of lamps as it falls there, shadows and all.

#[expect(dead_code, reason = "not every test needs every mesh")]
mod meshes;

use glam::DVec3;
use hatbox::element::ALL;
use hatbox::io::npz;
use hatbox::mesh::Refinement;
use hatbox::probe::Probe;
use hatbox::progress::{Interrupted, Progress, Silent};
use hatbox::quadrature::rule;
use hatbox::radiosity::{Options, Shown, Solution, solve};
use hatbox::render::{RenderOptions, render};
use hatbox::scene::{Camera, Material, Physics, Quantity, Scene};
use meshes::shadow::{EXITANCE, FLOOR, LAMP, SHEET, scene};
use std::f64::consts::PI;

/// E at (x, 0, 0) on the floor: ∫ B (cos θ)²/(π d²) over the part of the lamp that the sheet leaves, a rectangle.
fn exact(x: f64) -> f64 {
    // The edge of the sheet in the plane of the lamp, as seen from the floor.
    let [half, height] = SHEET;
    let edge = x + (half - x) / height;
    let from = edge.clamp(-LAMP, LAMP);
    let width = LAMP - from;
    let rule = rule(hatbox::element::Shape::Quad, 8);
    let density = |&[u, v]: &[f64; 2]| {
        let (dx, y) = (from + u * width - x, LAMP * (2.0 * v - 1.0));
        1.0 / (PI * (dx * dx + y * y + 1.0).powi(2))
    };
    let mean: f64 = rule.points.iter().zip(&rule.weights).map(|(at, w)| w * density(at)).sum();
    EXITANCE * mean * 2.0 * LAMP * width
}

fn points() -> Vec<(DVec3, DVec3)> {
    (0..60).map(|k| (DVec3::new(0.16 + 0.01 * f64::from(k), 0.0, 0.0), DVec3::Z)).collect()
}

fn solution(basis: &'static hatbox::element::Basis) -> Solution {
    let options = Options {
        basis,
        refinement: Refinement::Elements(300),
        tolerance: 1e-4,
        error_points: 0,
        ..Options::default()
    };
    solve(&scene(), &options, &Silent).expect("solved").solution
}

#[test]
fn the_light_of_a_lamp_is_exact_at_points_on_either_side_of_a_hard_shadow_in_any_basis() {
    for basis in &ALL {
        let (solution, points) = (solution(basis), points());
        let probe = Probe::new(&solution);
        let errors = |found: &[f64]| {
            let error = |(point, found): (&(DVec3, DVec3), &f64)| (found - exact(point.0.x)).abs() / exact(0.8);
            points.iter().zip(found).map(error).fold(0.0, f64::max)
        };
        let [direct, plain] =
            [probe.values_with_direct_light(&points, 0, &Silent).expect("nobody stops it"), probe.values(&points)];
        let (sharp, blurred) = (errors(direct.irradiance.band(0)), errors(plain.irradiance.band(0)));
        assert!(sharp < 2e-3 && blurred > 0.1, "{}: {sharp} instead of {blurred}", basis.name);
        // B = B⁰ + R E: what arrives at a point is reflected there, whatever functions have made of it.
        for (e, b) in direct.irradiance.band(0).iter().zip(direct.radiosity.band(0)) {
            assert!((b - FLOOR * e).abs() <= 1e-12 * e, "{}: {e} {b}", basis.name);
        }
    }
}

#[test]
fn no_point_has_less_than_no_light() {
    let (solution, points) = (solution(&ALL[1]), points());
    let probe = Probe::new(&solution);
    let of_functions = |&(position, normal): &(DVec3, DVec3)| {
        let place = probe.place(position, normal).expect("on the floor");
        solution.evaluate(Shown::Irradiance, place.cell, place.at, 0)
    };
    let probed = probe.values(&points);
    let direct = probe.values_with_direct_light(&points, 0, &Silent).expect("nobody stops it");
    let gathered = probe.values_gathered(&points, 0, &Silent).expect("nobody stops it");
    for found in [&probed, &direct, &gathered] {
        assert!(found.irradiance.as_slice().iter().chain(found.radiosity.as_slice()).all(|&value| value >= 0.0));
    }
    let least = points.iter().map(of_functions).fold(f64::INFINITY, f64::min);
    assert!(least < 0.0, "the functions swing below zero: {least}");
    for (point, found) in points.iter().zip(probed.irradiance.band(0)) {
        assert_eq!(found.to_bits(), of_functions(point).max(0.0).to_bits(), "{point:?}");
    }
}

/// A row of pixels along y = 0, from above the floor and below the sheet.
#[test]
fn a_picture_with_direct_light_has_the_hard_shadow_where_it_is() {
    let (width, eye) = (20, DVec3::new(0.45, 0.0, 0.25));
    let half = 0.063_f64;
    let camera = Camera { eye, target: DVec3::new(0.45, 0.0, 0.0), up: DVec3::Y, fov_y: 2.0 * half.atan() };
    let x = |pixel: usize| eye.x + eye.z * half * (2.0 * pixel as f64 + 1.0 - width as f64);
    let solution = solution(&ALL[1]);
    let error = |shown: Shown, direct: bool| {
        let options = RenderOptions { camera: Some(camera), width, height: 1, samples: 1, shown, direct };
        let image = render(&solution, &options, &Silent).expect("nobody stops it");
        // The floor reflects half.
        let factor = if shown == Shown::Radiosity { 0.5 } else { 1.0 };
        let error = |(k, pixel): (usize, &[f32; 4])| (f64::from(pixel[1]) - factor * exact(x(k))).abs();
        image.pixels.iter().enumerate().map(error).fold(0.0, f64::max) / exact(0.8)
    };
    for shown in [Shown::Radiosity, Shown::Irradiance] {
        let (sharp, blurred) = (error(shown, true), error(shown, false));
        assert!(sharp < 2e-3 && blurred > 0.02, "{shown:?}: {sharp} instead of {blurred}");
    }
}

/// It came back broken, and the pictures and bakes of `hatbox render` had seams that those of `hatbox solve` had not.
#[test]
fn a_joined_solution_is_joined_again_when_it_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("solution.npz");
    for basis in &ALL {
        let before = solution(basis);
        npz::save(&before, &path).expect("written");
        let after = npz::load(&path).expect("read");
        assert_eq!(before.space.dofs(), after.space.dofs(), "{}", basis.name);
        assert_eq!(before.coefficients(), after.coefficients(), "{}", basis.name);
        let options = RenderOptions { width: 24, height: 18, samples: 1, direct: true, ..RenderOptions::default() };
        let [one, other] = [&before, &after].map(|solution| render(solution, &options, &Silent));
        assert_eq!(one, other, "{}", basis.name);
    }
}

#[test]
fn gathered_light_is_exact_on_either_side_of_a_hard_shadow() {
    let (solution, points) = (solution(&ALL[1]), points());
    let probe = Probe::new(&solution);
    let gathered = probe.values_gathered(&points, 0, &Silent).expect("nobody stops it");
    let direct = probe.values_with_direct_light(&points, 0, &Silent).expect("nobody stops it");
    for (k, (at, _)) in points.iter().enumerate() {
        // Nothing comes from elsewhere but what the lamp and the sheet reflect, and both are black.
        let (e, b) = (gathered.irradiance.band(0)[k], gathered.radiosity.band(0)[k]);
        assert!((e - exact(at.x)).abs() < 2e-3 * exact(0.8), "{e} at {}", at.x);
        assert!((b - 0.5 * e).abs() < 1e-12, "B = R E: {b} {e}");
        assert!((e - direct.irradiance.band(0)[k]).abs() < 2e-3 * exact(0.8));
    }
    assert_eq!(probe.values_gathered(&points, 0, &Impatient), Err(Interrupted));
}

/// In a furnace everything receives what everything sends, whichever way it looks; and so do points beside a wall.
#[test]
fn points_in_the_air_receive_what_a_furnace_sends() {
    let mut scene = Scene::new(
        meshes::room(DVec3::new(2.0, 1.0, 1.5), |face| face == 3),
        vec![Material { exitance: Quantity::gray(1.0), ..Material::diffuse("wall", 0.5) }],
        Physics::Light,
        None,
    )
    .expect("valid");
    let solve = |scene: &Scene| {
        let options =
            Options { refinement: Refinement::Elements(100), tolerance: 1e-6, error_points: 0, ..Options::default() };
        solve(scene, &options, &Silent).expect("solved").solution
    };
    let solution = solve(&scene);
    let points = [
        (DVec3::new(1.0, 0.5, 0.7), DVec3::Z),
        (DVec3::new(0.3, 0.8, 0.7), DVec3::new(3.0, -1.0, 2.0)),
        (DVec3::new(1.0, 0.5, 0.0), DVec3::Z),
        (DVec3::new(1.0, 0.5, 0.7), DVec3::ZERO),
    ];
    let gathered = Probe::new(&solution).values_gathered(&points, 0, &Silent).expect("nobody stops it");
    let (e, b) = (gathered.irradiance.band(0), gathered.radiosity.band(0));
    assert!(e[..3].iter().all(|e| (e - 2.0).abs() < 2e-4) && e[3].is_nan(), "{e:?}");
    assert!(b[0].is_nan() && b[1].is_nan() && (b[2] - 2.0).abs() < 2e-4 && b[3].is_nan(), "{b:?}");
    assert_eq!((gathered.far, gathered.missed), (0, 1));
    // A lamp that is looked at, and not looked at.
    scene.materials.push(Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.0) });
    scene.materials[0] = Material::diffuse("wall", 0.0);
    let down: Vec<bool> = (0..scene.mesh.cells.len()).map(|k| scene.mesh.patch(k).normal().z < -0.5).collect();
    for (cell, down) in std::sync::Arc::make_mut(&mut scene.mesh).cells.iter_mut().zip(down) {
        cell.material = u32::from(down);
    }
    let solution = solve(&scene);
    let at = DVec3::new(1.0, 0.5, 1.5 - 0.5);
    let gathered =
        Probe::new(&solution).values_gathered(&[(at, DVec3::Z), (at, -DVec3::Z)], 0, &Silent).expect("not stopped");
    // A quarter of a rectangle of 1 × 0.5 at a distance of 0.5, four times: the factor from an element to a rectangle.
    let (x, y) = (1.0 / 0.5_f64, 0.5 / 0.5_f64);
    let term = |x: f64, y: f64| x / (1.0 + x * x).sqrt() * (y / (1.0 + x * x).sqrt()).atan();
    let exact = 4.0 * (term(x, y) + term(y, x)) / (2.0 * PI);
    let e = gathered.irradiance.band(0);
    assert!((e[0] - exact).abs() < 1e-6 && e[1] == 0.0, "{e:?} {exact}");
}

/// A work plane in a hall of ninety metres was given the light of the floor under it, since it was less than a hundredth of the
/// scene above it. Behind a surface there is no light; a point there belongs to it.
#[test]
fn what_is_gathered_just_above_a_floor_is_gathered_there() {
    for (size, heights) in
        [([2.0, 1.0, 1.5], [-0.02, 0.0, 0.0002, 0.02]), ([1000.0, 900.0, 3.0], [-1.0, 0.0, 0.01, 0.85])]
    {
        let glowing = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("wall", 0.5) };
        let room = meshes::room(DVec3::from(size), |_| false);
        let scene = Scene::new(room, vec![glowing], Physics::Light, None).expect("valid");
        let options =
            Options { refinement: Refinement::Elements(100), tolerance: 1e-4, error_points: 0, ..Options::default() };
        let solution = solve(&scene, &options, &Silent).expect("solved").solution;
        let points = heights.map(|z| (DVec3::new(1.0, 0.5, z), DVec3::Z));
        let gathered = Probe::new(&solution).values_gathered(&points, 0, &Silent).expect("nobody stops it");
        let (e, b) = (gathered.irradiance.band(0), gathered.radiosity.band(0));
        assert!(e.iter().all(|e| (e - 2.0).abs() < 1e-3), "{e:?}");
        assert!(b[..3].iter().all(|b| (b - 2.0).abs() < 1e-3) && b[3].is_nan(), "{b:?}");
    }
}

#[test]
fn a_scene_without_lamps_is_left_as_it_is() {
    let mut dark = scene();
    dark.materials[1].exitance = Quantity::gray(0.0);
    let solved = solve(&dark, &Options { error_points: 0, ..Options::default() }, &Silent).expect("solved").solution;
    let probe = Probe::new(&solved);
    let direct = probe.values_with_direct_light(&points(), 0, &Silent).expect("nobody stops it");
    assert_eq!(direct, probe.values(&points()));
}

/// Somebody who wants it to stop.
struct Impatient;

impl Progress for Impatient {
    fn interrupted(&self) -> bool {
        true
    }
}

#[test]
fn probing_can_be_interrupted() {
    let solution = solution(&ALL[0]);
    let stopped = Probe::new(&solution).values_with_direct_light(&points(), 0, &Impatient);
    assert_eq!(stopped, Err(Interrupted));
}

/// What averages noise leaves the borders of shadows: with rays, too, irradiance follows a hard shadow better than radiosity, which
/// is joined.
#[test]
fn irradiance_at_a_hard_shadow_is_not_averaged() {
    let options = Options {
        operator: hatbox::exchange::kind("sampled").expect("known"),
        refinement: Refinement::Elements(1500),
        tolerance: 0.02,
        error_points: 0,
        ..Options::default()
    };
    let solution = solve(&scene(), &options, &Silent).expect("solved").solution;
    let found = Probe::new(&solution).values(&points());
    let error = |values: &[f64], share: f64| -> f64 {
        let of = |((point, _), value): (&(DVec3, DVec3), &f64)| (value / share - exact(point.x)).powi(2);
        (points().iter().zip(values).map(of).sum::<f64>() / 60.0).sqrt()
    };
    let [irradiance, radiosity] = [error(found.irradiance.band(0), 1.0), error(found.radiosity.band(0), FLOOR)];
    assert!(irradiance < 0.9 * radiosity, "{irradiance} {radiosity}");
}

/// Behind slats each cell sees as much of a lamp as its few points happen to. Before, irradiance was not averaged over the cells that
/// meet, as radiosity is, and was far noisier than it.
#[test]
fn irradiance_behind_slats_is_as_accurate_as_radiosity() {
    let mut mesh = meshes::room(DVec3::new(4.0, 3.0, 2.5), |_| false);
    let lamp = [[1.0, 1.0], [1.0, 2.0], [3.0, 2.0], [3.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 2.45));
    meshes::face(&mut mesh, &lamp, 1);
    for k in 0..21 {
        let x = 1.0 + 0.1 * f64::from(k);
        let slat = [[1.0, 2.3], [2.0, 2.3], [2.0, 2.4], [1.0, 2.4]].map(|[y, z]| DVec3::new(x, y, z));
        meshes::face(&mut mesh, &slat, 2);
    }
    let lamp = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.0) };
    let slats = Material { two_sided: true, ..Material::diffuse("slats", 0.0) };
    let materials = vec![Material::diffuse("walls", 0.001), lamp, slats];
    let scene = Scene::new(mesh, materials, Physics::Light, None).expect("valid");
    let operator = hatbox::exchange::kind("sampled").expect("known");
    let options = Options {
        operator,
        refinement: Refinement::Elements(1500),
        tolerance: 0.03,
        error_points: 0,
        ..Options::default()
    };
    let solved = solve(&scene, &options, &Silent).expect("solved");
    assert!(solved.energy.defect() < 1e-5, "{}", solved.energy.defect());
    let (solution, mass) = (&solved.solution, hatbox::assemble::mass(&solved.solution.scene, &solved.solution.space));
    let mut off = solution.irradiance.clone();
    off.add_scaled(-1000.0, &solution.radiosity);
    let on_walls = |function: &hatbox::linalg::MultiVector| -> f64 {
        let weighted = hatbox::linalg::LinearOperator::times(&mass, function);
        let cells = (0..solution.space.cells()).filter(|&cell| solution.scene.mesh.cells[cell].material == 0);
        cells.flat_map(|cell| solution.space.range(cell)).map(|k| function.band(0)[k] * weighted.band(0)[k]).sum()
    };
    let relative = (on_walls(&off) / on_walls(&solution.irradiance)).sqrt();
    assert!(relative < 0.06, "E and B/R differ by {relative}");
}

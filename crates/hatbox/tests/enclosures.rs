//! Closed scenes whose radiosity is known: the physics before the numbers.

#[expect(dead_code, reason = "not every test needs every mesh")]
mod meshes;

use hatbox::element::{ALL, Basis};
use hatbox::linalg::{LinearOperator, MultiVector};
use hatbox::mesh::Refinement;
use hatbox::progress::Silent;
use hatbox::radiosity::{Error, Options, Solved, System, solve};
use hatbox::report::Report;
use hatbox::scene::{Material, Physics, Quantity, Scene};
use hatbox::space::Continuity;
use hatbox::view_factors::{self, ViewFactors};

/// The unit cube, seen from inside, every wall of reflectance ρ, the ceiling (z = 1) for itself.
fn cube(rho: f64, exitance: [f64; 2]) -> Scene {
    let mut mesh = meshes::room(glam::DVec3::ONE, |_| false);
    for cell in 0..mesh.cells.len() {
        mesh.cells[cell].material = u32::from(mesh.patch(cell).normal().z < -0.5);
    }
    Scene::new(mesh, walls_and_ceiling(rho, exitance), Physics::Light, None).expect("a valid scene")
}

fn walls_and_ceiling(rho: f64, exitance: [f64; 2]) -> Vec<Material> {
    let material = |name: &str, b0: f64| Material { exitance: Quantity::gray(b0), ..Material::diffuse(name, rho) };
    vec![material("walls", exitance[0]), material("ceiling", exitance[1])]
}

/// The cube with a ceiling of B⁰ = 1, for each ρ; the operator is shared.
fn with_glowing_ceiling<const N: usize>(rhos: [f64; N], options: &Options) -> [Solved; N] {
    let mut system = System::build(&cube(rhos[0], [0.0, 1.0]), options, &Silent).expect("built");
    rhos.map(|rho| {
        system.set_materials(walls_and_ceiling(rho, [0.0, 1.0]), options.continuity).expect("the same cells");
        system.solved(options, &Silent).expect("solved")
    })
}

fn options(basis: &'static Basis, elements: usize, tolerance: f64) -> Options {
    Options { basis, refinement: Refinement::Elements(elements), tolerance, error_points: 0, ..Options::default() }
}

/// Area means over the cells whose normal passes the test.
fn mean(solved: &Solved, pick: impl Fn(glam::DVec3) -> bool) -> f64 {
    let solution = &solved.solution;
    let mass = hatbox::assemble::mass(&solution.scene, &solution.space);
    let integrals = hatbox::linalg::LinearOperator::times(&mass, &solution.radiosity);
    let (mut power, mut area) = (0.0, 0.0);
    for cell in 0..solution.space.cells() {
        let patch = solution.scene.mesh.patch(cell);
        if pick(patch.normal()) {
            power += integrals.band(0)[solution.space.range(cell)].iter().sum::<f64>();
            area += patch.area();
        }
    }
    power / area
}

#[test]
fn a_cube_with_a_glowing_ceiling_has_the_published_means() {
    let table = [([0.171_215, 1.104_364, 0.181_105], 2.0), ([0.660_976, 1.587_514, 0.687_878], 5.0)];
    for (basis, elements) in [(&ALL[1], 3000), (&ALL[3], 800)] {
        let solved = with_glowing_ceiling([0.5, 0.8], &options(basis, elements, 1e-6));
        for (solved, (means, total)) in solved.iter().zip(table) {
            let found = [mean(solved, |n| n.z > 0.5), mean(solved, |n| n.z < -0.5), mean(solved, |n| n.z.abs() < 0.5)];
            for (value, exact) in found.iter().zip(means) {
                assert!((value - exact).abs() < 1e-4, "{}, total {total}: {found:?} {means:?}", basis.name);
            }
            let sum = 6.0 * mean(solved, |_| true);
            assert!((sum - total).abs() < 1e-8 * total, "{}, total {total}: {sum}", basis.name);
        }
    }
}

#[test]
fn a_report_has_what_each_part_gives_and_takes() {
    let [solved] = with_glowing_ceiling([0.5], &options(&ALL[1], 3000, 1e-6));
    let report = Report::new(&cube(0.5, [0.0, 1.0]), &solved);
    let [floor_and_walls, ceiling] = &report.parts[..] else { panic!("two parts: {:?}", report.parts) };
    assert_eq!((&*floor_and_walls.material, &*ceiling.material), ("walls", "ceiling"));
    // B = 0.5 E on the walls, of which one square metre has 0.171 215 and four have 0.181 105; 1 + 0.5 E = 1.104 364 above.
    let known = [(5.0, 0.171_215 + 4.0 * 0.181_105, 2.0), (1.0, 1.104_364, 0.208_728 / 1.104_364)];
    for (part, (area, leaving, ratio)) in [floor_and_walls, ceiling].into_iter().zip(known) {
        assert!((part.area - area).abs() < 1e-12);
        assert!(
            (part.leaving[0] - leaving).abs() < 5e-4 && (part.arriving[0] - ratio * leaving).abs() < 1e-3,
            "{part:?}"
        );
        assert!((part.net[0] - (1.0 - ratio) * leaving).abs() < 1e-3, "{part:?}");
        assert!((part.mean_irradiance[0] * area - part.arriving[0]).abs() < 1e-12);
        assert!(
            part.least_irradiance[0] < part.mean_irradiance[0] && part.mean_irradiance[0] < part.greatest_irradiance[0]
        );
    }
    assert_eq!(report.elements, floor_and_walls.elements + ceiling.elements);
    assert!((floor_and_walls.net[0] + ceiling.net[0]).abs() < 1e-9, "the room is closed");
}

#[test]
fn a_furnace_glows_uniformly_in_every_basis() {
    for basis in &ALL {
        for continuity in ["continuous", "broken"] {
            let options =
                Options { continuity: Continuity::named(continuity).expect("a name"), ..options(basis, 300, 1e-4) };
            let solved = solve(&cube(0.5, [0.5, 0.5]), &options, &Silent).expect("solved");
            for (i, b) in solved.solution.radiosity.as_slice().iter().enumerate() {
                assert!((b - 1.0).abs() < 1e-6, "{} {continuity}: B_{i} = {b}", basis.name);
            }
        }
    }
}

/// A drum of so many walls, seen from inside, its floor and ceiling cut into needles from one corner as from an n-gon of a file.
fn drum(walls: usize) -> hatbox::mesh::Mesh {
    let mut mesh = hatbox::mesh::Mesh::default();
    let rim = |k: usize, z: f64| {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / walls as f64).sin_cos();
        glam::DVec3::new(cos, sin, z)
    };
    for k in 0..walls {
        let (here, next) = (k, (k + 1) % walls);
        meshes::face(&mut mesh, &[rim(next, 0.0), rim(here, 0.0), rim(here, 2.0), rim(next, 2.0)], 0);
        if k > 0 && k + 1 < walls {
            meshes::face(&mut mesh, &[rim(0, 0.0), rim(here, 0.0), rim(next, 0.0)], 0);
            meshes::face(&mut mesh, &[rim(0, 2.0), rim(next, 2.0), rim(here, 2.0)], 0);
        }
    }
    mesh
}

/// Needles that touch walls were integrated so wrongly that rows of this drum were off by 11 %, and its light by up to 19 %.
#[test]
fn a_bright_drum_whose_floor_is_cut_into_needles_is_a_furnace() {
    for basis in [&ALL[1], &ALL[3]] {
        let materials = vec![Material { exitance: Quantity::gray(0.01), ..Material::diffuse("white", 0.99) }];
        let scene = Scene::new(drum(48), materials, Physics::Light, None).expect("a valid scene");
        let loose = Options { tolerance: 0.1, refinement: Refinement::None, ..options(basis, 0, 0.1) };
        let solved =
            solve(&scene, &Options { operator: hatbox::exchange::kind("dense").expect("a kind"), ..loose }, &Silent)
                .expect("solved");
        let closure = solved.closure;
        assert!(closure.balanced && closure.deficit < 0.02, "{}: {closure:?}", basis.name);
        for b in solved.solution.radiosity.as_slice() {
            assert!((b - 1.0).abs() < 1e-6, "{}: {b}", basis.name);
        }
    }
}

#[test]
fn galerkins_method_conserves_power_on_every_mesh_and_in_every_basis() {
    for basis in &ALL {
        for elements in [12, 150, 700] {
            let rhos = [0.3, 0.9];
            for (rho, solved) in rhos.iter().zip(with_glowing_ceiling(rhos, &options(basis, elements, 1e-3))) {
                let sum = 6.0 * mean(&solved, |_| true);
                let exact = 1.0 / (1.0 - rho);
                assert!((sum - exact).abs() < 1e-9 * exact, "{} {elements} ρ = {rho}: {sum}", basis.name);
            }
        }
    }
}

/// A two-sided sheet above a floor, with a plate under it; the floor reaches past the sheet's plane on both sides. Which
/// way round the sheet was drawn must not matter.
#[test]
fn either_side_of_a_sheet_has_its_own_shadows() {
    let lit = |flipped: bool| {
        let mut mesh = hatbox::mesh::Mesh::default();
        let p = |x: f64, y: f64, z: f64| glam::DVec3::new(x, y, z);
        meshes::face(&mut mesh, &[p(-2.0, -1.0, 0.0), p(2.0, -1.0, 0.0), p(2.0, 1.0, 0.0), p(-2.0, 1.0, 0.0)], 0);
        let mut sheet = [p(0.0, -0.5, 1.0), p(0.0, 0.5, 1.0), p(0.0, 0.5, 2.0), p(0.0, -0.5, 2.0)];
        if flipped {
            sheet.reverse();
        }
        meshes::face(&mut mesh, &sheet, 1);
        // Hides the floor at x > 0 from the sheet's side that faces it.
        meshes::face(&mut mesh, &[p(0.02, -1.5, 0.9), p(2.5, -1.5, 0.9), p(2.5, 1.5, 0.9), p(0.02, 1.5, 0.9)], 2);
        let materials = vec![
            Material { exitance: Quantity::gray(1.0), ..Material::diffuse("floor", 0.0) },
            Material { two_sided: true, ..Material::diffuse("sheet", 0.0) },
            Material::diffuse("plate", 0.0),
        ];
        let scene = Scene::new(mesh, materials, Physics::Light, None).expect("a valid scene");
        let options = Options {
            basis: &ALL[0],
            refinement: Refinement::None,
            tolerance: 1e-3,
            error_points: 0,
            ..Options::default()
        };
        let solution = solve(&scene, &options, &Silent).expect("solved").solution;
        // What the side towards −x receives, and what the side towards +x does.
        [-1.0, 1.0].map(|x| {
            let towards = |cell: &usize| {
                solution.scene.mesh.cells[*cell].material == 1 && solution.scene.mesh.patch(*cell).normal().x * x > 0.5
            };
            let cell = (0..solution.space.cells()).find(towards).expect("a side");
            solution.irradiance.band(0)[solution.space.range(cell).start]
        })
    };
    let (one, other) = (lit(false), lit(true));
    assert!(one[1] < 0.1 * one[0], "the plate hides the floor from one side: {one:?}");
    for side in 0..2 {
        assert!((one[side] - other[side]).abs() < 3e-3, "{one:?} {other:?}");
    }
}

#[test]
fn a_closed_room_that_absorbs_nothing_is_refused_by_the_name_of_its_material() {
    let refused = solve(&cube(1.0, [0.0, 1.0]), &options(&ALL[0], 24, 1e-2), &Silent).expect_err("no solution");
    assert_eq!(refused, Error::Lossless { band: 0, materials: vec!["ceiling".to_owned(), "walls".to_owned()] });
    assert!(refused.to_string().contains("ceiling, walls"), "{refused}");
    // In the dark there is nothing to multiply.
    assert!(solve(&cube(1.0, [0.0, 0.0]), &options(&ALL[0], 24, 1e-2), &Silent).is_ok());
}

#[test]
fn neumanns_iteration_may_take_as_many_bounces_as_bright_walls_ask_for() {
    let solved = |solver| {
        let options = Options { solver: Some(solver), ..options(&ALL[0], 24, 1e-2) };
        solve(&cube(0.99, [0.0, 1.0]), &options, &Silent).expect("solved")
    };
    let (bounces, exact) = (solved(hatbox::solve::Kind::Neumann), solved(hatbox::solve::Kind::Cg));
    assert!(bounces.info.iterations > 1000, "{:?}", bounces.info);
    let relative = (mean(&bounces, |_| true) / mean(&exact, |_| true) - 1.0).abs();
    assert!(relative < 1e-8, "{relative}");
}

/// A hole lets out B times its area; of what glows uniformly in a cavity of ρ = 0.99 that is a sixtieth of what is absorbed.
#[test]
fn a_bright_cube_with_a_small_hole_loses_what_the_hole_lets_out() {
    let hole = 0.03;
    let mut mesh = hatbox::mesh::Mesh::default();
    for face in &meshes::CUBE[1..] {
        meshes::face(&mut mesh, &face.map(glam::DVec3::from), 0);
    }
    let at = [0.0, 0.5 - 0.5 * hole, 0.5 + 0.5 * hole, 1.0];
    for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))).filter(|&ij| ij != (1, 1)) {
        let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
        meshes::face(&mut mesh, &corners.map(|(i, j)| glam::DVec3::new(at[i], at[j], 0.0)), 0);
    }
    let glow = Material { exitance: Quantity::gray(0.01), ..Material::diffuse("walls", 0.99) };
    let scene = Scene::new(mesh, vec![glow], Physics::Light, None).expect("valid");
    let solved = solve(&scene, &options(&ALL[1], 150, 1e-2), &Silent).expect("solved");
    let through = mean(&solved, |_| true) * hole * hole;
    let escaped = solved.energy.escaped[0];
    // 200 000 rays meet the hole 30 times: ± 18 %.
    assert!((escaped / through - 1.0).abs() < 0.4, "{escaped} {through} {:?}", solved.closure);
}

/// A box that stands on the floor of a room, in its corner: what it covers of the floor and of two walls is inside it,
/// and nothing but its own bottom and back, in the same planes, is between the one and the other.
fn box_in_a_corner(moved: impl Fn(glam::DVec3) -> glam::DVec3) -> Scene {
    let mut mesh = meshes::room(glam::DVec3::ONE, |_| false);
    let (from, to) = (glam::DVec3::new(0.7, 0.6, 0.0), glam::DVec3::new(1.0, 1.0, 0.5));
    meshes::bodies::body(&mut mesh, &meshes::CUBE, |p| from + p * (to - from));
    mesh.vertices.iter_mut().for_each(|vertex| *vertex = moved(*vertex));
    glowing(mesh)
}

/// A scene of one material that shines and reflects half.
fn glowing(mesh: hatbox::mesh::Mesh) -> Scene {
    let glowing = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("all", 0.5) };
    Scene::new(mesh, vec![glowing], Physics::Light, None).expect("a valid scene")
}

/// Before, the covered parts of floor and walls saw each other, and half as many rays as should told that the room was open:
/// the light of all was raised or lowered by some percent, at any tolerance.
#[test]
fn what_is_covered_sees_nothing_and_the_rest_of_the_room_is_closed() {
    let scene = box_in_a_corner(|p| p);
    for kind in hatbox::exchange::ALL {
        for basis in &ALL {
            let options = Options { operator: kind, error_points: 64, ..options(basis, 300, 0.02) };
            let system = System::build(&scene, &options, &Silent).expect("built");
            let solved = system.solved(&options, &Silent).expect("solved");
            let (name, solution) = (format!("{}, {}", kind.name, basis.name), &solved.solution);
            assert!(system.exchange.closure.escape == 0.0 && system.exchange.closure.balanced, "{name}");
            let mut covered = 0.0;
            for cell in 0..solution.space.cells() {
                let irradiance = &solution.irradiance.band(0)[solution.space.range(cell)];
                let dark = irradiance.iter().all(|&e| e == 0.0);
                let as_in_a_furnace = irradiance.iter().all(|&e| (e - 2.0).abs() < 1e-5);
                assert!(dark || as_in_a_furnace, "{name}, cell {cell}: {irradiance:?}");
                covered += if dark { solution.scene.mesh.patch(cell).area() } else { 0.0 };
            }
            let twice = 2.0 * (0.3 * 0.4 + 0.3 * 0.5 + 0.4 * 0.5);
            assert!((covered - twice).abs() < 1e-9, "{name}: {covered}");
            let error = solved.error.expect("asked for").relative;
            assert!(error < 1e-4, "{name}: the estimate is {error}");
        }
    }
}

/// Numbers of a cell are padded to lines of the cache where all cells have as many; here they have three or four.
#[test]
fn many_bands_on_triangles_and_quads_are_each_what_they_are_alone() {
    let sampled = hatbox::exchange::kind("sampled").expect("a kind");
    let options = Options { operator: sampled, error_points: 0, ..options(&ALL[2], 300, 0.02) };
    let system = System::build(&box_in_a_corner(|p| p), &options, &Silent).expect("built");
    let space = &system.space;
    assert!([3, 4].iter().all(|&count| (0..space.cells()).any(|cell| space.range(cell).len() == count)));
    let value = |dof: usize, band: usize| ((7 * dof + 5 * band) % 16) as f64;
    for bands in 1..=17 {
        let together = system.exchange.times(&MultiVector::from_fn(space.broken_dofs(), bands, value));
        let last = MultiVector::from_fn(space.broken_dofs(), 1, |dof, _| value(dof, bands - 1));
        for (a, b) in together.band(bands - 1).iter().zip(system.exchange.times(&last).band(0)) {
            assert!((a - b).abs() <= 1e-12 * b.abs(), "{bands} bands: {a} {b}");
        }
    }
}

/// Six times as large, turned, and with corners rounded to single precision, as files have them: what touches does so to the
/// tolerance of the scene, however small the cells.
#[test]
fn what_is_covered_is_found_in_a_turned_and_rounded_scene_with_small_cells() {
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, 1.1, -0.7);
    let scene = box_in_a_corner(|p| (turn * (6.0 * p)).as_vec3().as_dvec3());
    for elements in [100, 20_000] {
        let options =
            Options { operator: hatbox::exchange::kind("sampled").expect("a kind"), ..options(&ALL[0], elements, 0.1) };
        let system = System::build(&scene, &options, &Silent).expect("built");
        let (closure, share) = (system.exchange.closure, 2.0 * (0.12 + 0.15 + 0.2) / (6.0 + 2.0 * 0.47));
        assert!(closure.escape < 1e-5 && (closure.covered - share).abs() < 1e-6, "{elements}: {closure:?} {share}");
    }
}

/// A large cell under a box whose bottom is of many small faces with rounded corners, turned.
#[test]
fn what_is_covered_by_many_small_faces_is_found() {
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, 1.1, -0.7);
    let scene = tessellated_box(200, |p| (turn * (10.0 * p)).as_vec3().as_dvec3());
    let sampled = hatbox::exchange::kind("sampled").expect("a kind");
    let options = Options { operator: sampled, refinement: Refinement::None, ..options(&ALL[0], 1, 0.1) };
    let closure = System::build(&scene, &options, &Silent).expect("built").exchange.closure;
    let share = 2.0 * 0.16 / (6.0 + 2.0 * 0.16 + 4.0 * 0.4 * 0.5);
    assert!(closure.escape < 1e-5 && (closure.covered - share).abs() < 1e-3 * share, "{closure:?} {share}");
}

/// A unit room in whose middle a box stands on the floor, with a bottom of n × n faces.
fn tessellated_box(n: u32, moved: impl Fn(glam::DVec3) -> glam::DVec3) -> Scene {
    let mut mesh = meshes::room(glam::DVec3::ONE, |_| false);
    let (from, to) = (glam::DVec3::new(0.3, 0.3, 0.0), glam::DVec3::new(0.7, 0.7, 0.5));
    meshes::bodies::body(&mut mesh, &meshes::CUBE[1..], |p| from + p * (to - from));
    let at = |i: u32, j: u32| from + (to - from) * glam::DVec3::new(f64::from(i), f64::from(j), 0.0) / f64::from(n);
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        meshes::face(&mut mesh, &[at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)], 0);
    }
    mesh.vertices.iter_mut().for_each(|vertex| *vertex = moved(*vertex));
    glowing(mesh)
}

/// The floor of a room is joined to the bottom of a turned box that is a little below it, and so is a little below itself: it does
/// not hide what it is part of.
#[test]
fn a_floor_does_not_hide_cells_that_are_joined_to_what_is_a_little_below() {
    let turn = glam::DQuat::from_rotation_z(0.26);
    for sunk in [1e-9, 1e-7] {
        let mut mesh = meshes::room(glam::DVec3::ONE, |_| false);
        let (from, to) = (glam::DVec3::new(-0.15, -0.15, -sunk), glam::DVec3::new(0.15, 0.15, 0.4));
        let place = |p| turn * (from + p * (to - from)) + glam::DVec3::new(0.45, 0.55, 0.0);
        meshes::bodies::body(&mut mesh, &meshes::CUBE, place);
        let scene = glowing(mesh);
        let options = Options { operator: &hatbox::exchange::ALL[0], ..options(&ALL[0], 400, 0.01) };
        let closure = System::build(&scene, &options, &Silent).expect("built").exchange.closure;
        assert!(closure.deficit < 0.05 && closure.balanced, "{sunk}: {closure:?}");
    }
}

/// A sheet of two faces on a floor leaves the room closed, and a wall is lit though the one on its back is there twice.
#[test]
fn sheets_on_a_floor_and_faces_that_are_there_twice_leave_light_where_it_was() {
    let at = |z: f64| [[0.2, 0.2], [0.6, 0.2], [0.6, 0.6], [0.2, 0.6]].map(|[x, y]| glam::DVec3::new(x, y, z));
    for on_floor in [true, false] {
        let mut mesh = meshes::room(glam::DVec3::ONE, |_| false);
        meshes::bodies::sheet(&mut mesh, at(if on_floor { 0.0 } else { 0.5 }));
        if !on_floor {
            meshes::face(&mut mesh, &at(0.5), 0);
        }
        let scene = glowing(mesh);
        let covered = if on_floor { 0.16 / scene.mesh.area() } else { 0.0 };
        for kind in hatbox::exchange::ALL {
            let options = Options { operator: kind, ..options(&ALL[0], 300, 0.02) };
            let closure = solve(&scene, &options, &Silent).expect("solved").closure;
            assert!((closure.covered - covered).abs() < 1e-6, "{}: {closure:?}", kind.name);
            assert!(closure.escape < 1e-5 || !on_floor, "{}: {closure:?}", kind.name);
        }
    }
}

/// Of a sheet of two faces on the roof of a box under the open sky the bottom is covered, and nothing else.
#[test]
fn a_sheet_on_a_roof_sees_the_sky() {
    let mut mesh = hatbox::mesh::Mesh::default();
    meshes::bodies::body(&mut mesh, &meshes::CUBE, |p| p);
    let on_roof = [[0.2, 0.2, 1.0], [0.6, 0.2, 1.0], [0.6, 0.6, 1.0], [0.2, 0.6, 1.0]];
    meshes::bodies::sheet(&mut mesh, on_roof.map(glam::DVec3::from));
    let scene = Scene::new(mesh, vec![Material::diffuse("all", 0.5)], Physics::Light, None).expect("a valid scene");
    let closure = System::build(&scene, &options(&ALL[0], 300, 0.1), &Silent).expect("built").exchange.closure;
    assert!((closure.covered - 0.16 / 6.16).abs() < 1e-6, "{closure:?}");
}

/// What a lamp lights inside the box is nothing, and so is what links would join there.
#[test]
fn neither_lamps_nor_links_reach_what_is_covered() {
    let mut mesh = box_in_a_corner(|p| p).mesh.as_ref().clone();
    for cell in 0..mesh.cells.len() {
        // Of the wall that the box stands against, the part behind it, which is a face of its own.
        let patch = mesh.patch(cell);
        let is_behind =
            patch.normal().x < -0.5 && patch.corners().iter().all(|p| p.x > 0.999 && p.y > 0.599 && p.z < 0.501);
        mesh.cells[cell].material = u32::from(is_behind);
    }
    let lamp = Material { exitance: Quantity::gray(100.0), ..Material::diffuse("lamp", 0.5) };
    let scene = Scene::new(mesh, vec![Material::diffuse("all", 0.5), lamp], Physics::Light, None).expect("valid");
    for kind in hatbox::exchange::ALL {
        let options = Options { operator: kind, ..options(&ALL[1], 3000, 0.02) };
        let solved = solve(&scene, &options, &Silent).expect("solved");
        let brightest = solved.solution.irradiance.as_slice().iter().copied().fold(0.0, f64::max);
        assert!(solved.closure.covered > 0.1 && brightest < 1e-9, "{}: {brightest}", kind.name);
    }
}

/// Rows of what is covered are empty, all others sum to 1, and nothing escapes.
#[test]
fn a_room_is_closed_for_view_factors_though_a_box_stands_in_its_corner() {
    let refinement = Refinement::Elements(200);
    let options = view_factors::Options { refinement, tolerance: 1e-3, ..view_factors::Options::default() };
    let found = ViewFactors::new(&box_in_a_corner(|p| p), &options, &Silent).expect("few elements");
    let (check, covered) = (found.check(), |escape: f64| escape > 0.5);
    assert!(found.is_closed() && found.escape == 0.0 && check.max_row_sum_error < 1e-3, "{check:?}");
    let area: f64 = found.surfaces.iter().filter(|s| covered(s.escape)).map(|s| s.area).sum();
    assert!((area - 2.0 * (0.12 + 0.15 + 0.2)).abs() < 1e-6, "{area}");
    for (surface, row) in found.surfaces.iter().zip(&check.rows) {
        let exact = if covered(surface.escape) { 0.0 } else { 1.0 };
        assert!((row.sum - exact).abs() < 1e-3 && row.closure_error.abs() < 1e-3, "{surface:?} {row:?}");
    }
}

/// The unit cube cut in two by a wall without thickness, each side of it a face of its own, and a sheet of two faces in one half:
/// they look opposite ways in one plane as a box and the floor it stands on do, and yet see all around. Half of the rays that met
/// such a wall were lost, on the back of one of its faces.
#[test]
fn the_sides_of_a_sheet_of_two_faces_are_not_covered() {
    let at = glam::DVec3::new;
    let mut mesh = meshes::room(glam::DVec3::ONE, |_| false);
    for corners in [
        [at(0.5, 0.0, 0.0), at(0.5, 1.0, 0.0), at(0.5, 1.0, 1.0), at(0.5, 0.0, 1.0)],
        [at(0.7, 0.3, 0.4), at(0.9, 0.3, 0.4), at(0.9, 0.7, 0.4), at(0.7, 0.7, 0.4)],
    ] {
        meshes::bodies::sheet(&mut mesh, corners);
    }
    let scene = glowing(mesh);
    for kind in hatbox::exchange::ALL {
        let tolerance = if kind.name == "dense" { 1e-4 } else { 0.02 };
        let options = Options { operator: kind, ..options(&ALL[1], 300, tolerance) };
        let system = System::build(&scene, &options, &Silent).expect("built");
        let closure = system.exchange.closure;
        assert!(closure.covered == 0.0 && closure.escape == 0.0, "{}: {closure:?}", kind.name);
        let irradiance = system.solved(&options, &Silent).expect("solved").solution.irradiance;
        let off = irradiance.as_slice().iter().map(|e| (e - 2.0).abs()).fold(0.0, f64::max);
        assert!(off < 1e-3, "{}: {off}", kind.name);
    }
}

/// Corners and a material.
type Face = ([glam::DVec3; 4], u32);

/// Before, integrated pairs saw both layers: a furnace with a rug drawn into its floor, or whose floor was there twice, had far too
/// much light, and the estimate knew nothing of it.
#[test]
fn of_layers_that_look_the_same_way_one_is_lit() {
    let at =
        |from: f64, to: f64| [[from, from], [to, from], [to, to], [from, to]].map(|[x, y]| glam::DVec3::new(x, y, 0.0));
    let turned = |[a, b, c, d]: [glam::DVec3; 4]| [a, d, c, b];
    let (rug, across) = (at(0.3, 0.7), at(0.5, 0.9));
    let (one, both) = (Material::diffuse("one side", 0.5), Material::diffuse("both", 0.5));
    let one = Material { exitance: Quantity::gray(1.0), ..one };
    let both = Material { exitance: Quantity::gray(1.0), two_sided: true, ..both };
    // Faces that are drawn into the floor, and what is the area of the room with them.
    let cases: [(&str, &[Face], f64); 6] = [
        ("a rug", &[(rug, 0)], 6.0),
        ("a rug of two sides, which looks down", &[(turned(rug), 1)], 6.16),
        ("the floor", &[(at(0.0, 1.0), 0)], 6.0),
        ("rugs across each other", &[(rug, 0), (across, 0)], 6.0),
        ("a rug twice", &[(rug, 0), (rug, 0)], 6.0),
        ("a rug of two faces", &[(rug, 0), (turned(rug), 0)], 6.16),
    ];
    for (name, faces, area) in cases {
        let mut mesh = meshes::room(glam::DVec3::ONE, |_| false);
        for (corners, material) in faces {
            meshes::face(&mut mesh, corners, *material);
        }
        let scene = Scene::new(mesh, vec![one.clone(), both.clone()], Physics::Light, None).expect("a valid scene");
        assert!((scene.mesh.area() - area).abs() < 1e-9, "{name}: {}", scene.mesh.area());
        for kind in hatbox::exchange::ALL {
            let options = Options { operator: kind, error_points: 64, ..options(&ALL[1], 300, 0.02) };
            let solution = solve(&scene, &options, &Silent).expect("solved").solution;
            for cell in 0..solution.space.cells() {
                let (patch, range) = (solution.scene.mesh.patch(cell), solution.space.range(cell));
                let is_seen = patch.center().z > 0.0 || patch.normal().z > 0.0;
                let as_expected = |&e: &f64| if is_seen { (e - 2.0).abs() < 1e-5 } else { e < 1e-9 };
                let irradiance = &solution.irradiance.band(0)[range];
                assert!(irradiance.iter().all(as_expected), "{name}, {}, cell {cell}: {irradiance:?}", kind.name);
            }
        }
    }
}

/// In a room that hardly absorbs, rays that miss a few of those that should be lost raise the light of all of it. Before, what
/// the errors of a sampled operator cause by reflection was in no estimate.
#[test]
fn the_estimate_of_a_bright_room_knows_what_the_noise_of_rays_causes() {
    let mut mesh = meshes::room(glam::DVec3::ONE, |_| false);
    let hole = [[0.45, 0.45], [0.55, 0.45], [0.55, 0.55], [0.45, 0.55]].map(|[x, y]| glam::DVec3::new(x, y, 0.0));
    meshes::face(&mut mesh, &hole, 1);
    let white = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("white", 0.99) };
    let scene = Scene::new(mesh, vec![white, Material::diffuse("black", 0.0)], Physics::Light, None).expect("valid");
    let truth = solve(&scene, &options(&ALL[0], 300, 1e-6), &Silent).expect("solved");
    let truth = mean(&truth, |_| true);
    let of = |seed: u64| {
        let kind = hatbox::exchange::kind("sampled").expect("known");
        let options = Options { operator: kind, seed, error_points: 64, ..options(&ALL[0], 300, 0.1) };
        let solved = solve(&scene, &options, &Silent).expect("solved");
        ((mean(&solved, |_| true) / truth - 1.0).abs(), solved.error.expect("asked for"))
    };
    let found: Vec<_> = (0..20).map(of).collect();
    let told =
        found.iter().map(|(error, estimate)| format!("{error:.4} {:.4} {:.4}", estimate.relative, estimate.operator));
    let told: Vec<_> = told.collect();
    let above = found.iter().filter(|(error, estimate)| *error > estimate.relative).count();
    assert!(above <= 2, "error, estimate, computation: {told:#?}");
    assert!(found.iter().any(|(error, _)| *error > 0.02), "noise is what this is about: {told:#?}");
}

/// A room does not lose its row sums because something stands outside. Before, a plate far away was enough for the room to be left
/// unbalanced.
#[test]
fn a_room_is_balanced_though_light_escapes_elsewhere() {
    let plate = [[9.0, 9.0, 9.0], [10.0, 9.0, 9.0], [10.0, 10.0, 9.0], [9.0, 10.0, 9.0]].map(glam::DVec3::from);
    for (basis, tolerance) in [(&ALL[0], 0.05), (&ALL[1], 0.05), (&ALL[3], 0.1)] {
        let mut mesh = meshes::room(glam::DVec3::ONE, |_| false);
        let within = glam::DVec3::new(0.3, 0.4, 0.0);
        meshes::bodies::body(&mut mesh, &meshes::CUBE, |p| within + 0.3 * p + glam::DVec3::Z * 0.2);
        let cells = mesh.cells.len();
        meshes::face(&mut mesh, &plate, 0);
        assert!(mesh.cells.len() > cells);
        let options =
            Options { operator: hatbox::exchange::kind("dense").expect("known"), ..options(basis, 300, tolerance) };
        let system = System::build(&glowing(mesh), &options, &Silent).expect("built");
        let closure = system.exchange.closure;
        assert!(closure.escape > 0.0 && closure.balanced && closure.deficit > 1e-9, "{}: {closure:?}", basis.name);
        assert!((closure.enclosed - 6.54 / 7.54).abs() < 1e-9, "{closure:?}");
        let solution = system.solved(&options, &Silent).expect("solved").solution;
        for cell in 0..solution.space.cells() {
            let expected = if solution.scene.mesh.patch(cell).center().z > 8.0 { 1.0 } else { 2.0 };
            for b in &solution.radiosity.band(0)[solution.space.range(cell)] {
                assert!((b - expected).abs() < 1e-8, "{}, cell {cell}: {b}", basis.name);
            }
        }
    }
}

/// Programs export walls as two faces, one each way. Before, such a room was taken for the inside of bodies that touch, and black.
#[test]
fn a_room_of_walls_of_two_faces_is_lit() {
    let mut mesh = meshes::room(glam::DVec3::ONE, |_| false);
    meshes::bodies::body(&mut mesh, &meshes::CUBE, |p| p);
    let scene = glowing(mesh);
    for kind in hatbox::exchange::ALL {
        let options = Options { operator: kind, ..options(&ALL[1], 300, 0.02) };
        let solution = solve(&scene, &options, &Silent).expect("solved").solution;
        let middle = glam::DVec3::splat(0.5);
        for cell in 0..solution.space.cells() {
            let patch = solution.scene.mesh.patch(cell);
            let expected = if patch.normal().dot(middle - patch.center()) > 0.0 { 2.0 } else { 1.0 };
            for b in &solution.radiosity.band(0)[solution.space.range(cell)] {
                assert!((b - expected).abs() < 1e-5, "{}, cell {cell}: {b}", kind.name);
            }
        }
    }
}

//! Error estimates, local refinement, and solving to a tolerance.

mod manufactured;
#[expect(dead_code, reason = "not every test needs every mesh")]
mod meshes;

use glam::DVec3;
use hatbox::adapt::{self, Focus};
use hatbox::element::{ALL, Basis};
use hatbox::exchange::{self, Exchange};
use hatbox::io::read_scene;
use hatbox::linalg::MultiVector;
use hatbox::mesh::{Mesh, Refinement, Topology};
use hatbox::probe::Probe;
use hatbox::progress::{Progress, Silent};
use hatbox::quadrature::rule;
use hatbox::radiosity::{Options, Shown, Solution, System, error_of, gathered, local_error, solve};
use hatbox::scene::{Material, Physics, Quantity, Scene};
use hatbox::solve as solvers;
use hatbox::space::{CREASE_ANGLE, Continuity, FunctionSpace};
use manufactured::{RHO, chosen, l2_error};
use std::f64::consts::SQRT_2;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// A room with a lamp in its ceiling's place and a sheet that throws a shadow.
fn room(split: bool) -> Scene {
    let mut mesh = meshes::room(DVec3::ONE, |_| split);
    mesh.cells[1].material = 1;
    let sheet = [(0.3, 0.3), (0.7, 0.3), (0.7, 0.7), (0.3, 0.7)].map(|(x, y)| DVec3::new(x, y, 0.4));
    meshes::face(&mut mesh, &sheet, 2);
    let lamp = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.0) };
    let sheet = Material { two_sided: true, ..Material::diffuse("sheet", 0.3) };
    Scene::new(mesh, vec![Material::diffuse("walls", 0.5), lamp, sheet], Physics::Light, None).expect("valid")
}

#[test]
fn bisection_leaves_no_hanging_vertex_and_keeps_what_cells_are() {
    let mut mesh = room(false).triangulated().mesh;
    let area = mesh.area();
    for round in 0..6_usize {
        let marked: Vec<bool> = (0..mesh.cells.len()).map(|cell| (cell * 7 + round) % 11 == 0).collect();
        let old = std::mem::take(&mut mesh);
        let bisected = old.bisected(&marked);
        mesh = bisected.mesh.into();
        assert!((mesh.area() - area).abs() < 1e-12 * area);
        assert_eq!(mesh.vertices[..old.vertices.len()], old.vertices, "vertices keep their numbers");
        let (_, hanging) = mesh.conformed(1e-9);
        assert_eq!(hanging, 0, "round {round}");
        for (cell, &parent) in mesh.cells.iter().zip(&bisected.parents) {
            let like = &old.cells[parent as usize];
            assert_eq!((cell.material, cell.group, cell.surface), (like.material, like.group, like.surface));
        }
        let pieces = |cell: usize| bisected.parents.iter().filter(|&&p| p as usize == cell).count();
        assert!((0..marked.len()).all(|cell| !marked[cell] || pieces(cell) == 4));
        closed_as_before(&old, &mesh);
    }
}

/// As many edges are open after refinement as were before, counted by length.
fn closed_as_before(old: &Mesh, new: &Mesh) {
    let open = |mesh: &Mesh| -> f64 {
        let topology = Topology::new(mesh);
        let length = |edge| {
            let [a, b] = topology.vertices(edge).map(|v: u32| mesh.vertices[v as usize]);
            a.distance(b)
        };
        topology.open_edges().map(length).sum()
    };
    assert!((open(old) - open(new)).abs() < 1e-9);
}

fn options(basis: &'static Basis, max_edge: f64) -> Options {
    Options {
        basis,
        refinement: Refinement::MaxEdge(max_edge),
        // Of the worst row, as if all errors were of one sign: what B sees of it is some thirty times less.
        tolerance: 10f64.powi(-1 - basis.order as i32),
        error_points: 256,
        ..Options::default()
    }
}

/// ‖B − B⁰‖ of the manufactured solution.
fn reflected(solution: &Solution) -> f64 {
    let mesh = &solution.scene.mesh;
    let mut sum = 0.0;
    for cell in 0..mesh.cells.len() {
        let patch = mesh.patch(cell);
        let rule = rule(patch.shape(), 5);
        for (&at, weight) in rule.points.iter().zip(&rule.weights) {
            let b0 = solution.scene.material(cell).exitance.at(&solution.scene.site(cell, at), 0);
            sum += weight * patch.area() * (chosen(patch.point(at)) - b0).powi(2);
        }
    }
    sum.sqrt()
}

/// The estimate over the true error lies between 1 and 5.
#[test]
fn estimates_are_effective_where_the_truth_is_known() {
    for (basis, n) in [(&ALL[0], 4.0), (&ALL[1], 2.0), (&ALL[3], 2.0)] {
        let longest = if basis.quad.is_some() { 1.0 } else { SQRT_2 };
        let solved = solve(&manufactured::scene(), &options(basis, 1.001 * longest / n), &Silent).expect("solved");
        let truth = l2_error(&solved.solution) / reflected(&solved.solution);
        let estimate = solved.error.expect("asked for").relative;
        let effectivity = estimate / truth;
        assert!((1.0..5.0).contains(&effectivity), "{}: {effectivity} = {estimate} / {truth}", basis.name);
    }
}

/// The residual of joined functions is orthogonal to them; the light that it reflects must not be lost with it. (It was, and
/// estimates in empty rooms were too small: along an edge both faces reflect theirs to each other.)
#[test]
fn what_joined_functions_leave_is_reflected() {
    let scene = glowing_ceiling().refined(Refinement::MaxEdge(0.36), &ALL[1]).expect("refined");
    let system = |continuity| {
        let space = FunctionSpace::new(&scene, &ALL[1], continuity).expect("elements");
        System::new(scene.clone(), space, &exchange::ALL[0], &exchange::Params::new(1e-3), &Silent).expect("built")
    };
    let [joined, broken] = [Continuity::Continuous { crease_angle: CREASE_ANGLE }, Continuity::Broken].map(system);
    // Bright at one corner of each cell and dark at the others: its integral is 0.
    let corner = |row: usize, _: usize| if row.is_multiple_of(3) { 2.0 } else { -1.0 };
    let left = MultiVector::from_fn(3 * scene.triangulated().mesh.cells.len(), 1, corner);
    let [found, expected] = [joined, broken].map(|system| system.reflections(&left, &Silent).expect("solved"));
    let mut difference = found.clone();
    difference.add_scaled(-1.0, &expected);
    let error = difference.norms()[0] / expected.norms()[0];
    assert!(error < 0.1, "{error}");
    assert!(expected.norms()[0] > 0.01 * left.norms()[0]);
}

/// A ridge of two strips that bend by an angle, beneath a lamp to one side.
fn ridge(bend: f64) -> Scene {
    let mut mesh = Mesh::default();
    let (run, rise) = ((0.5 * bend).cos(), (0.5 * bend).sin());
    for x in [-1.0, 1.0] {
        let (a, b) = (DVec3::new(x * run, 0.0, -rise), DVec3::new(x * run, 1.0, -rise));
        let (c, d) = (DVec3::Y, DVec3::ZERO);
        meshes::face(&mut mesh, &if x > 0.0 { [a, b, c, d] } else { [d, c, b, a] }, 0);
    }
    let lamp = [(2.0, 0.0), (2.0, 1.0), (3.0, 1.0), (3.0, 0.0)].map(|(x, y)| DVec3::new(x, y, 2.0));
    meshes::face(&mut mesh, &lamp, 1);
    let lamp = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.0) };
    Scene::new(mesh, vec![Material::diffuse("ground", 0.5), lamp], Physics::Light, None).expect("valid")
}

#[test]
fn what_joining_takes_away_where_faces_bend_is_told_apart() {
    let parts = |bend: f64, continuity: &str| {
        let continuity = Continuity::named(continuity).expect("listed");
        let solved = solve(&ridge(bend), &Options { continuity, ..options(&ALL[1], 0.1) }, &Silent).expect("solved");
        let error = solved.error.expect("asked for");
        (error.bends, error.discretisation)
    };
    let (bends, discretisation) = parts(0.4, "continuous");
    let (none, of_broken) = parts(0.4, "broken");
    assert!(bends < discretisation && bends.powi(2) > 0.5 * discretisation.powi(2), "{bends} of {discretisation}");
    // Without joints there is nothing left to represent but a smooth function.
    assert!(none.to_bits() == 0 && of_broken < 0.1 * discretisation, "{none} of {of_broken}");
    // What is flat, and what is a crease and is not joined, is not even looked at.
    assert!([0.0, 0.6].map(|bend| parts(bend, "continuous").0).into_iter().all(|bends| bends.to_bits() == 0));
}

/// Sloan's iterate B⁰ + RKB̃ gains half an order at least.
#[test]
fn one_more_gather_gains_half_an_order() {
    for basis in [&ALL[0], &ALL[1]] {
        let longest = if basis.quad.is_some() { 1.0 } else { SQRT_2 };
        let error = |n: f64| gathered_error(basis, 1.001 * longest / n);
        let errors = [error(2.0), error(4.0)];
        let order = (errors[0] / errors[1]).log2();
        assert!(order > basis.order as f64 + 0.35, "{}: order {order}, errors {errors:?}", basis.name);
    }
}

/// ‖B⁰ + RKB̃ − B‖ for the manufactured solution.
fn gathered_error(basis: &'static Basis, max_edge: f64) -> f64 {
    let scene = manufactured::scene().refined(Refinement::MaxEdge(max_edge), basis).expect("refined");
    let space = FunctionSpace::new(&scene, basis, Continuity::Broken).expect("elements");
    let params = exchange::Params::new(10f64.powi(-2 - basis.order as i32));
    let system = System::new(scene, space, &exchange::ALL[0], &params, &Silent).expect("built");
    let tight = solvers::Params { tolerance: 1e-10, ..Default::default() };
    let (solution, _) = system.solve(system.best_solver(), &tight, &Silent).expect("solved");
    let (gather, mesh) = (system.gather(&solution), &system.scene.mesh);
    let mut sum = 0.0;
    for cell in 0..mesh.cells.len() {
        let patch = mesh.patch(cell);
        let rule = rule(patch.shape(), 2);
        for (&at, weight) in rule.points.iter().zip(&rule.weights) {
            let x = patch.point(at);
            let e = gather.irradiance(x, patch.normal(), mesh.cells[cell].surface, 0)[0];
            let error = RHO * (e - manufactured::chosen_irradiance(x));
            sum += weight * patch.area() * error * error;
        }
    }
    sum.sqrt()
}

#[test]
fn a_solution_gathered_at_its_nodes_is_close_to_itself_and_positive() {
    let options = Options { refinement: Refinement::Elements(200), error_points: 0, ..Options::default() };
    let solution = solve(&room(false), &options, &Silent).expect("solved").solution;
    let again = gathered(&solution, 0, &Silent).expect("gathered");
    let mut difference = again.radiosity.clone();
    difference.add_scaled(-1.0, &solution.radiosity);
    assert!(difference.norms()[0] < 0.1 * solution.radiosity.norms()[0]);
    assert!(again.irradiance.as_slice().iter().all(|e| (0.0..=1.0).contains(e)), "no more than the lamp's exitance");
}

/// Solving to a tolerance, from the faces of the file on.
fn to(tolerance: f64) -> adapt::Options {
    let solve = Options { refinement: Refinement::None, ..Options::default() };
    adapt::Options { solve, tolerance, ..adapt::Options::default() }
}

#[test]
fn refinement_reaches_what_was_asked_and_goes_where_the_error_is() {
    let adapted = adapt::solve(&room(false), &to(0.05), &Silent).expect("solved");
    assert!(adapted.reached && adapted.rounds.len() > 1, "{:?}", adapted.rounds);
    let estimate = |k: usize| adapted.rounds[k].estimate;
    let last = adapted.rounds.len() - 1;
    assert!(estimate(last) <= 0.05 && estimate(last - 1) > 0.05);
    let mesh = &adapted.solved.solution.scene.mesh;
    let walls = (0..mesh.cells.len()).filter(|&cell| mesh.cells[cell].material == 0);
    let (least, greatest) =
        walls.map(|cell| mesh.patch(cell).area()).fold((f64::MAX, 0.0_f64), |(a, b), x| (a.min(x), b.max(x)));
    assert!(greatest > 3.9 * least, "the mesh is uniform: {least} {greatest}");
    assert!(adapted.solved.energy.defect() < 1e-9);
    let few = adapt::Options { most_coefficients: Some(100), ..to(0.01) };
    assert!(!adapt::solve(&room(false), &few, &Silent).expect("solved").reached);
}

/// A scene of more than 67 000 triangles was left as it was, and the summary did not say so.
#[test]
fn what_has_many_faces_may_be_refined_as_well() {
    let most = |operator: &str, first: usize| {
        let mut options = to(0.01);
        (options.solve.operator, options.solve.basis) = (exchange::kind(operator).expect("a kind"), &ALL[1]);
        options.most_coefficients = None;
        options.most_coefficients(first)
    };
    for operator in ["auto", "sampled", "hierarchical"] {
        assert_eq!([100, 1_000_000].map(|first| most(operator, first)), [1_000_000, 6_000_000], "{operator}");
    }
    // A table of all pairs has no room for more.
    assert_eq!([100, 1_000_000].map(|first| most("dense", first)), [20_000; 2]);
}

/// There is no light in a walled-up room for an error to be relative to.
#[test]
fn a_focus_that_nothing_lights_has_no_infinite_error() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/two-rooms-walled.glb");
    let scene = read_scene(&path).expect("a sample").0;
    let options = adapt::Options { focus: Some(Focus::Name("floor 2".to_owned())), ..to(0.05) };
    let adapted = adapt::solve(&scene, &options, &Silent).expect("solved");
    let error = adapted.solved.error.expect("asked for");
    assert!(adapted.reached && error.relative <= 0.05 && error.operator.is_finite(), "{error:?}");
}

/// Rays were cast for five times the tolerance, as pairs are integrated, and no mesh was fine enough.
#[test]
fn operators_of_rays_reach_what_was_asked() {
    let mut options = to(0.01);
    options.solve.operator = exchange::kind("sampled").expect("a kind");
    let adapted = adapt::solve(&room(false), &options, &Silent).expect("solved");
    assert!(adapted.reached, "{:?}", adapted.rounds);
}

/// The first operator is looser than what is asked for needs: an answer that it may have spoilt is given again.
#[test]
fn no_answer_is_left_to_an_operator_that_is_looser_than_asked_for() {
    let mut options = to(0.05);
    options.solve.operator = exchange::kind("sampled").expect("a kind");
    options.solve.refinement = Refinement::Elements(2000);
    let adapted = adapt::solve(&room(false), &options, &Silent).expect("solved");
    let elements: Vec<usize> = adapted.rounds.iter().map(|round| round.elements).collect();
    assert!(adapted.reached && elements == [elements[0]; 2], "{:?}", adapted.rounds);
    let built = |slack: f64| {
        let tolerance = slack * options.solve.operator.looseness * options.tolerance;
        let scene = adapted.system.scene.clone();
        let system = System::of_cells(scene, &Options { tolerance, ..options.solve }, &Silent).expect("built");
        system.exchange.statistics().rays
    };
    let rays = adapted.solved.operator.rays;
    assert!(rays == built(1.0) && rays > 2 * built(options.solve.operator.slack), "{rays}");
}

/// A sheet under a small lamp: the border of its shadow is two hundredths of the floor wide.
fn hard_shadow() -> Scene {
    let square = |s: f64, z: f64| [(-s, -s), (s, -s), (s, s), (-s, s)].map(|(x, y)| DVec3::new(x, y, z));
    let mut mesh = Mesh::default();
    meshes::face(&mut mesh, &square(1.0, 0.0), 0);
    meshes::face(&mut mesh, &square(0.33, 0.3), 2);
    let mut lamp = square(0.02, 1.0);
    lamp.reverse();
    meshes::face(&mut mesh, &lamp, 1);
    let lamp = Material { exitance: Quantity::gray(100.0), ..Material::diffuse("lamp", 0.0) };
    let materials = vec![Material::diffuse("floor", 0.5), lamp, Material::diffuse("sheet", 0.0)];
    Scene::new(mesh, materials, Physics::Light, None).expect("valid")
}

#[test]
fn sharp_borders_of_shadows_are_edges_of_the_mesh() {
    let scene = hard_shadow();
    let adapted = adapt::solve(&scene, &to(0.04), &Silent).expect("solved");
    assert!(adapted.reached && adapted.solved.solution.space.cells() < 2000, "{:?}", adapted.rounds);
    let mesh = &adapted.solved.solution.scene.mesh;
    let topology = Topology::new(mesh);
    // An edge at 0.33 as the lamp's sides at ±0.02 throw it.
    for x in [0.02 + 0.31 / 0.7, -0.02 + 0.35 / 0.7] {
        let on_border = |&edge: &usize| {
            let ends = topology.vertices(edge).map(|v| mesh.vertices[v as usize]);
            ends.iter().all(|p| (p.x - x).abs() < 1e-6 && p.z.abs() < 1e-9)
        };
        let length = |edge: usize| {
            let [a, b] = topology.vertices(edge).map(|v| mesh.vertices[v as usize]);
            a.distance(b)
        };
        let found: f64 = (0..topology.edges()).filter(on_border).map(length).sum();
        assert!(found > 0.9, "{x}: {found}");
    }
}

/// What was left was the operator's error, and quadratic elements were refined again and again, to three times as many.
#[test]
fn elements_are_not_refined_for_what_the_operator_errs_by() {
    let mut options = adapt::Options { tolerance: 0.005, ..adapt::Options::default() };
    options.solve = Options { basis: &ALL[3], operator: exchange::kind("dense").expect("a kind"), ..options.solve };
    let adapted = adapt::solve(&hard_shadow(), &options, &Silent).expect("solved");
    assert!(adapted.reached && adapted.rounds.len() > 1, "{:?}", adapted.rounds);
    assert!(adapted.rounds.iter().all(|round| round.elements == adapted.rounds[0].elements), "{:?}", adapted.rounds);
}

/// Counts the points at which the error is estimated.
#[derive(Default)]
struct Points(AtomicU64);

impl Progress for Points {
    fn begin(&self, stage: &'static str, total: u64) {
        if stage == "at points" {
            self.0.fetch_add(total, Ordering::Relaxed);
        }
    }
}

/// Points are added where r² scatters, but not where the error is surely more than is wanted, or far less.
#[test]
fn no_more_points_are_taken_than_it_takes_to_know() {
    let options = Options { error_points: 64, ..options(&ALL[1], 0.5) };
    let system = System::build(&room(false), &options, &Silent).expect("built");
    let points = |wanted: f64| {
        let points = Points::default();
        let (solved, _) = system.solved_within(&options, wanted, |_, _| Ok(None), &points).expect("solved");
        (points.0.into_inner(), solved.error.expect("asked for").relative)
    };
    let (whatever, estimate) = points(0.0);
    assert!(whatever > 64, "r² scatters: {whatever}");
    assert_eq!([points(0.1 * estimate).0, points(estimate).0, points(10.0 * estimate).0], [64, whatever, 64]);
}

#[test]
fn with_a_focus_the_rest_is_refined_less() {
    let focused = adapt::Options { focus: Some(Focus::Name("sheet".to_owned())), ..to(0.03) };
    let elements = |options: &adapt::Options| {
        let adapted = adapt::solve(&room(false), options, &Silent).expect("solved");
        assert!(adapted.reached, "{:?}", adapted.rounds);
        adapted.solved.solution.space.cells()
    };
    let (some, all) = (elements(&focused), elements(&to(0.03)));
    assert!(some < all, "{some} {all}");
}

#[test]
fn where_light_is_uniform_nothing_is_indicated() {
    let mesh = meshes::room(DVec3::ONE, |_| false);
    let furnace = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("furnace", 0.5) };
    let scene = Scene::new(mesh, vec![furnace], Physics::Light, None).expect("valid");
    for basis in &ALL {
        let options = Options { basis, refinement: Refinement::Elements(48), tolerance: 1e-4, ..Options::default() };
        let solved = solve(&scene, &options, &Silent).expect("solved");
        let error = local_error(&solved.solution);
        assert!(error.as_slice().iter().all(|&e| e < 1e-8), "{}", basis.name);
        let shown = error_of(&solved.solution).evaluate(Shown::Radiosity, 3, [0.2, 0.2], 0);
        assert_eq!(shown.to_bits(), error.band(0)[3].to_bits());
        let estimate = solved.error.expect("asked for");
        assert!(estimate.relative < 1e-3, "{}: {estimate:?}", basis.name);
    }
}

#[test]
fn graded_meshes_fit_together_and_keep_area_and_corners() {
    for split in [false, true] {
        let scene = room(split);
        for basis in [&ALL[0], &ALL[1]] {
            let uniform = scene.refined(Refinement::MaxEdge(0.26), basis).expect("refined");
            let graded = scene.refined_graded(Refinement::MaxEdge(0.26), 2.0, basis).expect("refined");
            assert!((graded.mesh.area() - uniform.mesh.area()).abs() < 1e-12);
            assert_eq!(graded.mesh.conformed(1e-9).1, 0, "hanging vertices");
            assert_eq!(graded.mesh.vertices[..scene.mesh.vertices.len()], scene.mesh.vertices);
            // The first of four parts of an edge of length 1 ends at (1/4)²/((1/4)² + (3/4)²).
            assert!(graded.mesh.vertices.iter().any(|v| v.distance(DVec3::new(0.1, 0.0, 0.0)) < 1e-12));
        }
    }
}

/// The interpolation error of a function that is like r^β at edges, β = 0.63 being that of ρ = 0.8: order β + ½ on uniform
/// meshes, that of the basis on graded ones.
#[test]
fn grading_gives_the_order_back_that_edges_take() {
    let scene =
        Scene::new(meshes::room(DVec3::ONE, |_| false), vec![Material::diffuse("walls", 0.8)], Physics::Light, None);
    let scene = scene.expect("valid");
    for (basis, q) in [(&ALL[1], 2.0), (&ALL[3], 3.0)] {
        let order = |q: f64| {
            let error = |n: f64| interpolation_error(&scene, basis, 1.001 * SQRT_2 / n, q);
            (error(16.0) / error(32.0)).log2()
        };
        let (uniform, graded) = (order(1.0), order(q));
        assert!(uniform < 1.3, "{}: uniform {uniform}", basis.name);
        assert!(graded > basis.order as f64 - 0.25, "{}: graded {graded}", basis.name);
    }
}

/// Like the distance to the power 0.63 at every edge of the unit cube's surface, and smooth elsewhere.
fn singular(p: DVec3) -> f64 {
    p.to_array().map(|x| (x * (1.0 - x)).max(0.0).powf(0.63)).iter().sum()
}

fn interpolation_error(scene: &Scene, basis: &'static Basis, max_edge: f64, q: f64) -> f64 {
    // Splitting quads before or after subdividing them gives cells of the same size.
    let max_edge = if q <= 1.0 { max_edge } else { max_edge / SQRT_2 };
    let mesh = scene.refined_graded(Refinement::MaxEdge(max_edge), q, basis).expect("refined").mesh;
    let mut sum = 0.0;
    for cell in 0..mesh.cells.len() {
        let (patch, element) = (mesh.patch(cell), basis.triangle);
        let values: Vec<f64> = element.nodes.iter().map(|node| singular(patch.point(node.at))).collect();
        let rule = rule(patch.shape(), 8);
        for (&at, weight) in rule.points.iter().zip(&rule.weights) {
            let found: f64 = values.iter().zip(element.values(at)).map(|(v, n)| v * n).sum();
            sum += weight * patch.area() * (found - singular(patch.point(at))).powi(2);
        }
    }
    sum.sqrt()
}

/// The cube whose ceiling glows, with ρ = 0.8: there B is like r^0.63 at the edges, as computed and not as assumed.
fn glowing_ceiling() -> Scene {
    let mut mesh = meshes::room(DVec3::ONE, |_| false);
    mesh.cells[1].material = 1;
    let ceiling = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("ceiling", 0.8) };
    Scene::new(mesh, vec![Material::diffuse("walls", 0.8), ceiling], Physics::Light, None).expect("valid")
}

fn on_mesh(scene: &Scene, basis: &'static Basis, n: f64, q: f64) -> Solution {
    let longest = if q <= 1.0 { SQRT_2 } else { 1.0 };
    let options = Options {
        grading: q,
        continuity: Continuity::Broken,
        tolerance: 1e-5,
        error_points: 0,
        ..options(basis, 1.001 * longest / n)
    };
    solve(scene, &options, &Silent).expect("solved").solution
}

/// ‖B̃ − B‖ against a solution that is taken for the truth.
fn difference(solution: &Solution, truth: &Solution) -> f64 {
    let mesh = &solution.scene.mesh;
    let (mut places, mut here) = (Vec::new(), Vec::new());
    for cell in 0..mesh.cells.len() {
        let patch = mesh.patch(cell);
        let rule = rule(patch.shape(), 8);
        for (&at, weight) in rule.points.iter().zip(&rule.weights) {
            places.push((patch.point(at), patch.normal()));
            here.push((solution.evaluate(Shown::Radiosity, cell, at, 0), weight * patch.area()));
        }
    }
    let exact = Probe::new(truth).values_gathered(&places, 0, &Silent).expect("nobody stops it").radiosity;
    here.iter().zip(exact.band(0)).map(|((found, area), exact)| area * (found - exact).powi(2)).sum::<f64>().sqrt()
}

/// From four to eight parts of an edge quadratic elements reach less: that is too coarse to tell. The truth is of another mesh than
/// all that it is compared with, and gathered once more.
#[test]
#[ignore = "twenty minutes: cargo test --release -p hatbox --test adapt -- --ignored --nocapture edges_of_a_room"]
fn graded_meshes_have_the_order_that_the_edges_of_a_room_take() {
    let scene = glowing_ceiling();
    let truth = on_mesh(&scene, &ALL[3], 16.0, 2.5);
    for (basis, q) in [(&ALL[1], 2.0), (&ALL[3], 3.0)] {
        let order = |q: f64| {
            let errors = [8.0, 16.0].map(|n| difference(&on_mesh(&scene, basis, n, q), &truth));
            println!("{} q = {q}: {errors:?}", basis.name);
            (errors[0] / errors[1]).log2()
        };
        let (uniform, graded) = (order(1.0), order(q));
        println!("{}: order {uniform} uniform, {graded} graded", basis.name);
        assert!(uniform < 1.5, "{}: uniform {uniform}", basis.name);
        assert!(graded > basis.order as f64 - 0.25, "{}: graded {graded}", basis.name);
    }
}

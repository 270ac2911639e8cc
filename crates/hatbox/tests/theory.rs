//! The sentences of the theory: what the generalized system is, and at what rate it converges.

mod manufactured;
#[expect(dead_code, reason = "not every test needs every mesh")]
mod meshes;

use glam::{DQuat, DVec3};
use hatbox::assemble::{Accuracy, Panel, Sight, mass, pair_block, weighted_mass};
use hatbox::element::{ALL, Basis, Shape};
use hatbox::exchange::{self, Balanced, Dense, Escape, Exchange, Geometry};
use hatbox::linalg::{LinearOperator, MultiVector};
use hatbox::mesh::{Mesh, Patch, Refinement};
use hatbox::progress::Silent;
use hatbox::quadrature::gauss_legendre;
use hatbox::radiosity::{Options, solve};
use hatbox::scene::{Material, Physics, Quantity, Scene};
use hatbox::solve::ALL as SOLVERS;
use hatbox::space::{Continuity, FunctionSpace};
use hatbox::visibility::Bvh;
use manufactured::l2_error;
use std::f64::consts::SQRT_2;
use std::sync::{Arc, OnceLock};

fn cube(materials: Vec<Material>, of_face: impl Fn(usize) -> u32) -> Scene {
    let mut mesh = meshes::room(DVec3::ONE, |_| false);
    for (face, cell) in mesh.cells.iter_mut().enumerate() {
        cell.material = of_face(face);
    }
    Scene::new(mesh, materials, Physics::Light, None).expect("a valid scene")
}

fn dense(scene: &Scene, space: &FunctionSpace, tolerance: f64) -> Dense {
    let (panels, blockers) = (OnceLock::new(), Arc::new(Bvh::of_surfaces(&scene.surfaces)));
    let geometry = Geometry::new(scene, space, &blockers, &panels);
    Dense::new(&geometry, &exchange::Params::new(tolerance), &Silent).expect("small enough")
}

/// D S D for a diagonal matrix D.
struct Scaled {
    exchange: Dense,
    factors: Vec<f64>,
}

impl Scaled {
    fn scaled(&self, x: &MultiVector) -> MultiVector {
        MultiVector::from_fn(x.rows(), x.bands(), |row, band| self.factors[row] * x.band(band)[row])
    }
}

impl LinearOperator for Scaled {
    fn rows(&self) -> usize {
        self.exchange.rows()
    }
    fn cols(&self) -> usize {
        self.exchange.cols()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        *y = self.scaled(&self.exchange.times(&self.scaled(x)));
    }
}

impl Exchange for Scaled {
    fn kind(&self) -> &'static str {
        self.exchange.kind()
    }
    fn statistics(&self) -> exchange::Statistics {
        self.exchange.statistics()
    }
}

/// In a flat box nearly all light goes to and fro, so that what is too much above and too little below hardly shows in row
/// sums, and Δ + S is nearly singular: one derivative for all steps of the balancing did not get there in eight.
#[test]
fn what_goes_to_and_fro_is_balanced() {
    let mesh = meshes::room(DVec3::new(1.0, 1.0, 0.02), |_| false);
    let scene = Scene::new(mesh, vec![Material::diffuse("wall", 0.5)], Physics::Light, None).expect("valid");
    let scene = scene.refined(Refinement::Elements(600), &ALL[0]).expect("refined");
    let space = FunctionSpace::broken(&scene.mesh, &ALL[0]).expect("an element for every cell");
    let (exchange, cells) = (dense(&scene, &space, 1e-6), scene.mesh.cells.len());
    let above = |cell: usize| scene.mesh.patch(cell).normal().z;
    let factors = (0..cells).map(|cell| 1.0 + 0.12 * above(cell)).collect();
    let mass = mass(&scene, &space);
    let inverse = mass.inverse().expect("positive definite");
    let closed = Escape { fraction: 0.0, scatter: 0.0, open: Vec::new() };
    let (panels, blockers) = (OnceLock::new(), Arc::new(Bvh::of_surfaces(&scene.surfaces)));
    let geometry = Geometry::new(&scene, &space, &blockers, &panels);
    let balanced =
        Balanced::new(Box::new(Scaled { exchange, factors }), &geometry, [&mass, &inverse], &closed, &Silent)
            .expect("not interrupted");
    let closure = balanced.closure;
    assert!(closure.deficit > 0.01 && closure.balanced, "{closure:?}");
    let ones = MultiVector::uniform(cells, &[1.0]);
    let (sums, areas) = (balanced.times(&ones), mass.times(&ones));
    for (sum, area) in sums.as_slice().iter().zip(areas.as_slice()) {
        assert!((sum - area).abs() < 1e-11 * area, "{sum} {area}");
    }
}

/// With one constant function and one reflectance per element the generalized system is the classical one.
#[test]
fn constants_give_the_classical_radiosity_system() {
    let materials = (0..6).map(|k| Material::diffuse(&format!("m{k}"), 0.1 + 0.15 * f64::from(k))).collect();
    let scene = cube(materials, |face| face as u32).refined(Refinement::Elements(24), &ALL[0]).expect("refined");
    let space = FunctionSpace::broken(&scene.mesh, &ALL[0]).expect("an element for every cell");
    let s = dense(&scene, &space, 1e-6);
    let (delta, m_r) = (mass(&scene, &space), weighted_mass(&scene, &space));
    let inverse = delta.inverse().expect("cells have an area");
    let n = scene.mesh.cells.len();
    for j in 0..n {
        let unit = MultiVector::from_fn(n, 1, |row, _| f64::from(u8::from(row == j)));
        let column = m_r.times(&inverse.times(&s.times(&unit)));
        for i in 0..n {
            let (area, r) = (scene.mesh.patch(i).area(), scene.material(i).reflectance.uniform(0).expect("uniform"));
            assert!((delta.block(0, i)[0] - area).abs() < 1e-14, "Δ = diag(A)");
            let form_factor = s.exchange_area(i, j) / area;
            let classical = r * area * form_factor;
            assert!((column.band(0)[i] - classical).abs() <= 1e-12 * classical.abs(), "F̂_{i}{j}");
        }
    }
}

/// The same solver solves every basis, and all solvers agree.
#[test]
fn every_solver_solves_every_basis() {
    let materials = vec![
        Material::diffuse("walls", 0.6),
        Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.3) },
    ];
    let scene = cube(materials, |face| u32::from(face == 1));
    for basis in &ALL {
        for continuity in ["continuous", "broken"] {
            let mut answers = Vec::new();
            for solver in SOLVERS {
                let options = Options {
                    basis,
                    continuity: Continuity::named(continuity).expect("a name"),
                    refinement: Refinement::Elements(48),
                    tolerance: 1e-3,
                    solver: Some(solver.kind),
                    error_points: 0,
                    ..Options::default()
                };
                let solved = solve(&scene, &options, &Silent).expect("solved");
                assert_eq!(solved.solver, solver.kind);
                answers.push(solved.solution.radiosity);
            }
            for other in &answers[1..] {
                let mut difference = answers[0].clone();
                difference.add_scaled(-1.0, other);
                let relative = difference.norms()[0] / answers[0].norms()[0];
                assert!(relative < 1e-8, "{} {continuity}: {relative:e}", basis.name);
            }
        }
    }
}

#[test]
fn the_exchange_operator_is_symmetric_to_the_last_bit() {
    let scene =
        cube(vec![Material::diffuse("walls", 0.5)], |_| 0).refined(Refinement::Elements(48), &ALL[1]).expect("refined");
    let space = FunctionSpace::broken(&scene.mesh, &ALL[1]).expect("an element for every cell");
    let s = dense(&scene, &space, 1e-3);
    let n = space.broken_dofs();
    let columns: Vec<MultiVector> =
        (0..n).map(|j| s.times(&MultiVector::from_fn(n, 1, |row, _| f64::from(u8::from(row == j))))).collect();
    for i in 0..n {
        for j in 0..n {
            assert_eq!(columns[j].band(0)[i].to_bits(), columns[i].band(0)[j].to_bits(), "S_{i}{j}");
        }
    }
}

#[test]
fn the_solution_turns_moves_and_scales_with_the_scene() {
    let room = |turn: DQuat, scale: f64, shift: DVec3| {
        let mut mesh = meshes::room(DVec3::new(1.0, 0.8, 0.6), |k| k == 2);
        mesh.cells[1].material = 1;
        for vertex in &mut mesh.vertices {
            *vertex = turn * *vertex * scale + shift;
        }
        let lamp = Material { exitance: Quantity::gray(2.0), ..Material::diffuse("lamp", 0.2) };
        let scene = Scene::new(mesh, vec![Material::diffuse("walls", 0.7), lamp], Physics::Light, None).expect("valid");
        let options = Options {
            refinement: Refinement::MaxEdge(0.51 * scale),
            tolerance: 1e-7,
            error_points: 0,
            ..Options::default()
        };
        solve(&scene, &options, &Silent).expect("solved").solution.radiosity
    };
    let still = room(DQuat::IDENTITY, 1.0, DVec3::ZERO);
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.9);
    for (turn, scale, shift) in
        [(turn, 1.0, DVec3::splat(3.0)), (turn, 1e-2, DVec3::ZERO), (DQuat::IDENTITY, 1e3, DVec3::ONE)]
    {
        let moved = room(turn, scale, shift);
        let mut difference = still.clone();
        difference.add_scaled(-1.0, &moved);
        let relative = difference.norms()[0] / still.norms()[0];
        assert!(relative < 1e-6, "scale {scale}: {relative:e}");
    }
}

fn manufactured(basis: &'static Basis, continuity: &str, max_edge: f64) -> f64 {
    let options = Options {
        basis,
        continuity: Continuity::named(continuity).expect("a name"),
        refinement: Refinement::MaxEdge(max_edge),
        // Of the worst row, as if all errors were of one sign: what B sees of it is some thirty times less.
        tolerance: 10f64.powi(-1 - basis.order as i32),
        error_points: 0,
        ..Options::default()
    };
    l2_error(&solve(&manufactured::scene(), &options, &Silent).expect("solved").solution)
}

#[test]
fn the_l2_error_falls_at_the_order_of_the_basis() {
    // In the joined spaces too; joined quadratics, whose constant still grows from the walls' edges (where every node is
    // its own) to the interior, reach their order on meshes too large for a test.
    let cases = ALL.iter().map(|basis| (basis, "broken")).chain([(&ALL[1], "continuous"), (&ALL[2], "continuous")]);
    for (basis, continuity) in cases {
        let longest = if basis.quad.is_some() { 1.0 } else { SQRT_2 };
        let coarse = if basis.order == 1 { 4.0 } else { 2.0 };
        let error = |n: f64| manufactured(basis, continuity, 1.001 * longest / n);
        let errors = [error(coarse), error(2.0 * coarse)];
        let order = (errors[0] / errors[1]).log2();
        let name = format!("{continuity} {}", basis.name);
        assert!((order - basis.order as f64).abs() < 0.15, "{name}: order {order}, errors {errors:?}");
    }
}

/// Reflected power ∫R E from M_R Δ⁻¹ S against the exact ∫R∫G: off by ∫(R − PR)(E − PE), a product of two projection
/// errors, so the order is twice that of the basis.
#[test]
fn varying_reflectance_converges_at_twice_the_order_of_the_basis() {
    let r = |p: DVec3| 0.5 + 0.4 * (2.5 * p.x + 1.0).sin() * (1.7 * p.y).cos();
    let source =
        Patch::new(Shape::Quad, [[0.0, 0.3, 1.0], [0.0, 1.0, 1.0], [1.2, 1.0, 1.0], [1.2, 0.3, 1.0]].map(DVec3::from));
    let source = Panel::new(source, ALL[0].element(Shape::Quad).expect("constant quads"), [100, 101, 102, 103], 1);
    let exact: f64 = reflected_exactly(&r, &source);
    for basis in [&ALL[0], &ALL[1]] {
        let error = |n: usize| (reflected_by_projection(basis, n, &r, &source) - exact).abs();
        let errors = [error(4), error(8)];
        let order = (errors[0] / errors[1]).log2();
        let expected = 2.0 * basis.order as f64;
        assert!((order - expected).abs() < 0.2, "{}: order {order}, errors {errors:?}", basis.name);
    }
}

/// ∫R(x) ∫G(x, y) over the unit square, by Gauss rules on the closed form.
fn reflected_exactly(r: &impl Fn(DVec3) -> f64, source: &Panel) -> f64 {
    let gauss = gauss_legendre(24);
    let pairs = gauss.iter().flat_map(|s| gauss.iter().map(move |t| (s, t)));
    pairs
        .map(|(s, t)| {
            let x = DVec3::new(s.0, t.0, 0.0);
            let row = hatbox::assemble::point_row(source, x, DVec3::Z).expect("visible");
            s.1 * t.1 * r(x) * row[0]
        })
        .sum()
}

fn reflected_by_projection(
    basis: &'static Basis,
    n: usize,
    r: &(impl Fn(DVec3) -> f64 + Clone + Send + Sync + 'static),
    source: &Panel,
) -> f64 {
    let mut mesh = Mesh::default();
    meshes::face(&mut mesh, &[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y], 0);
    let f = r.clone();
    let material = Material {
        reflectance: Quantity::function(move |site, _| f(site.position)),
        ..Material::diffuse("textured", 0.0)
    };
    let scene = Scene::new(mesh.triangulated(), vec![material], Physics::Light, None).expect("valid");
    let scene = scene.refined(Refinement::MaxEdge(1.001 * SQRT_2 / n as f64), basis).expect("refined");
    let space = FunctionSpace::broken(&scene.mesh, basis).expect("triangles");
    let accuracy = Accuracy::new(1e-10, 2.0);
    let mut received = MultiVector::zeros(space.broken_dofs(), 1);
    for (cell, panel) in Panel::of(&scene.mesh, &space).iter().enumerate() {
        let block = pair_block(panel, source, Sight::Clear, [1.0; 2], &accuracy);
        received.band_mut(0)[space.range(cell)].copy_from_slice(block.values());
    }
    let irradiance = mass(&scene, &space).inverse().expect("cells have an area").times(&received);
    weighted_mass(&scene, &space).times(&irradiance).band(0).iter().sum()
}

#[test]
fn results_are_the_same_bytes_on_any_number_of_threads() {
    let scene =
        hatbox::io::read_scene(std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/cornell.obj")))
            .expect("read")
            .0;
    let options = Options { refinement: Refinement::Elements(150), error_points: 16, ..Options::default() };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| solve(&scene, &options, &Silent).expect("solved"))
    };
    let (one, three) = (on(1), on(3));
    assert_eq!(one.solution.radiosity, three.solution.radiosity);
    assert_eq!(one.solution.irradiance, three.solution.irradiance);
    assert_eq!(one.error, three.error);
}

//! Many lamps: what they send does not depend on how they are declared, and is as right as is asked for.

#[allow(dead_code, reason = "other tests use the rest")]
mod meshes;

use glam::DVec3;
use hatbox::element::ALL as BASES;
use hatbox::exchange::{self, Sampled};
use hatbox::linalg::{LinearOperator, MultiVector};
use hatbox::mesh::{Mesh, Patch, Refinement};
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, System, solve};
use hatbox::scene::{Material, Physics, Quantity, Scene};

const TOLERANCE: f64 = 0.01;

fn shining(name: &str, exitance: f64) -> Material {
    Material { exitance: Quantity::gray(exitance), ..Material::diffuse(name, 0.1) }
}

fn options(kind: &'static exchange::Kind, refinement: Refinement, tolerance: f64) -> Options {
    Options { operator: kind, basis: &BASES[0], refinement, tolerance, error_points: 0, ..Options::default() }
}

fn sampled(scene: &Scene, refinement: Refinement, tolerance: f64) -> System {
    let kind = exchange::kind(Sampled::NAME).expect("a kind");
    System::build(scene, &options(kind, refinement, tolerance), &Silent).expect("built")
}

/// Of many lamps a cell asks some, which count for the others: what all cells get is right.
#[test]
fn many_lamps_send_what_they_send() {
    let mut mesh = meshes::room(DVec3::new(6.0, 4.0, 3.0), |_| false);
    for k in 0..200 {
        let at = DVec3::new(0.2 + 0.28 * f64::from(k % 20), 0.2 + 0.4 * f64::from(k / 20), 2.9);
        let corner = |x: f64, y: f64| at + 0.05 * DVec3::new(x, y, 0.0);
        meshes::face(&mut mesh, &[corner(0.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0), corner(1.0, 0.0)], 1);
    }
    let materials = vec![Material::diffuse("gray", 0.5), shining("lamp", 100.0)];
    let scene = Scene::new(mesh, materials, Physics::Light, None).expect("valid");
    let arrived = |kind| {
        let options = options(kind, Refinement::Elements(1000), TOLERANCE);
        let solution = solve(&scene, &options, &Silent).expect("solved").solution;
        let on = |up: bool| {
            let mesh = &solution.scene.mesh;
            let faces = (0..solution.space.cells()).filter(move |&cell| (mesh.patch(cell).normal().z > 0.5) == up);
            faces.map(|cell| solution.irradiance.band(0)[cell] * mesh.patch(cell).area()).sum::<f64>()
        };
        [on(true), on(false)]
    };
    let exact = arrived(&exchange::ALL[0]);
    for kind in exchange::ALL {
        for (found, exact) in arrived(kind).into_iter().zip(exact) {
            assert!((found - exact).abs() < 2.0 * TOLERANCE * exact, "{}: {found} instead of {exact}", kind.name);
        }
    }
}

/// A floor under so many lamps side by side, which are its second material.
fn floor_under_lamps(side: u32) -> Mesh {
    let square = |x: f64, y: f64, z: f64, s: f64| {
        [(0.0, 0.0), (s, 0.0), (s, s), (0.0, s)].map(|(u, v)| DVec3::new(x + u, y + v, z))
    };
    let mut mesh = Mesh::default();
    meshes::face(&mut mesh, &square(0.0, 0.0, 0.0, 10.0), 0);
    for k in 0..side * side {
        let at = |k: u32| 10.0 * (f64::from(k) + 0.5) / f64::from(side);
        let mut lamp = square(at(k % side), at(k / side), 1.0, 0.02);
        lamp.reverse();
        meshes::face(&mut mesh, &lamp, 1);
    }
    mesh
}

/// However many stand for others where little is asked for, few do where much is.
#[test]
fn the_error_of_many_lamps_falls_with_the_tolerance() {
    let materials = vec![Material::diffuse("gray", 0.5), shining("lamp", 100.0)];
    let scene = Scene::new(floor_under_lamps(20), materials, Physics::Light, None).expect("valid");
    let error = |tolerance: f64| {
        let system = sampled(&scene, Refinement::Elements(800), tolerance);
        let shines = |row: usize, _| f64::from(u8::from(system.scene.mesh.cells[row].material == 1));
        let sent = system.exchange.times(&MultiVector::from_fn(system.exchange.rows(), 1, shines));
        let [mut square, mut norm] = [0.0; 2];
        for cell in (0..system.space.cells()).filter(|&cell| system.scene.mesh.cells[cell].material == 0) {
            let patch = system.scene.mesh.patch(cell);
            let exact = patch.area() * from_lamps(&scene.mesh, &patch);
            square += (sent.band(0)[cell] - exact).powi(2);
            norm += exact.powi(2);
        }
        (square / norm).sqrt()
    };
    for tolerance in [0.02, 0.001] {
        let error = error(tolerance);
        assert!(error < tolerance, "{error} where {tolerance} is asked for");
    }
}

/// The mean of Σ cos cos A / (π r²) of lamps that are small for their distance; both cosines are 1/r, a metre above.
fn from_lamps(mesh: &Mesh, floor: &Patch) -> f64 {
    let places = (0..400).map(|k| [k % 20, k / 20].map(|j| (f64::from(j) + 0.5) / 20.0));
    let lamps: Vec<Patch> =
        (0..mesh.cells.len()).map(|cell| mesh.patch(cell)).filter(|lamp| lamp.normal().z < 0.0).collect();
    let from = |x: DVec3, lamp: &Patch| {
        let square = (lamp.center() - x).length_squared();
        lamp.area() / (std::f64::consts::PI * square * square)
    };
    places.map(|at| lamps.iter().map(|lamp| from(floor.point(at), lamp)).sum::<f64>()).sum::<f64>() / 400.0
}

/// A number for each face makes each a material. Of ground that shines where the sun is, thousands of such were lamps, some of which
/// stood for others, with the same error whatever was asked for.
#[test]
fn faces_that_shine_alike_are_the_same_light_with_a_material_each() {
    let side = 16;
    let at = |x: u32, y: u32| DVec3::new(f64::from(x), f64::from(y), f64::from((7 * x + 5 * y) % 4) / 4.0);
    let ground = |material: &dyn Fn(u32) -> u32| {
        let mut mesh = Mesh::default();
        for (k, (x, y)) in (0..side).flat_map(|x| (0..side).map(move |y| (x, y))).enumerate() {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            meshes::face(&mut mesh, &[a, b, c], material(2 * k as u32));
            meshes::face(&mut mesh, &[a, c, d], material(2 * k as u32 + 1));
        }
        mesh
    };
    let is_lit = |face: u32| u32::from(face.is_multiple_of(3));
    let together = vec![shining("dark", 0.0), shining("lit", 1.0)];
    let apart = (0..2 * side * side).map(|face| shining(&face.to_string(), f64::from(is_lit(face)))).collect();
    let sent = [(ground(&is_lit), together), (ground(&|face| face), apart)].map(|(mesh, materials)| {
        let scene = Scene::new(mesh, materials, Physics::Light, None).expect("valid");
        let system = sampled(&scene, Refinement::None, TOLERANCE);
        let rows = system.exchange.rows();
        system.exchange.times(&MultiVector::from_fn(rows, 1, |row, _| f64::from(is_lit(row as u32))))
    });
    assert_eq!(sent[0], sent[1]);
}

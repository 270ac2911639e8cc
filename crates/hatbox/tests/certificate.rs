//! What the error is proven not to exceed.

#[expect(dead_code, reason = "not every test needs every mesh")]
mod meshes;

use glam::DVec3;
use hatbox::certificate::{CertifyError, certifiable, certify};
use hatbox::element::{ALL, Basis};
use hatbox::exchange;
use hatbox::linalg::MultiVector;
use hatbox::mesh::{Mesh, Refinement};
use hatbox::probe::Probe;
use hatbox::progress::{Progress, Silent};
use hatbox::quadrature::sequence::{hash, point};
use hatbox::radiosity::{Options, Shown, Solution, solve};
use hatbox::scene::{Material, Physics, Quantity, Scene};
use hatbox::space::{Continuity, FunctionSpace};

/// Points of the scene at which a solution is compared with the truth, besides one in each cell.
const POINTS: f64 = 1500.0;

fn scene(mut mesh: Mesh) -> Scene {
    // What lies at the top and looks down shines.
    for cell in 0..mesh.cells.len() {
        let patch = mesh.patch(cell);
        mesh.cells[cell].material = u32::from(patch.normal().z < -0.9 && patch.center().z > 0.9);
    }
    let colour = |values: &[f64]| Quantity::Uniform(values.to_vec());
    let walls = Material { reflectance: colour(&[0.7, 0.4]), ..Material::diffuse("walls", 0.5) };
    let lamp = Material { exitance: colour(&[1.0, 2.0]), ..Material::diffuse("lamp", 0.2) };
    Scene::new(mesh, vec![walls, lamp], Physics::Light, None).expect("a valid scene")
}

/// A closed cube, and an open one in which a sheet and a box on the floor throw shadows.
fn scenes() -> [(&'static str, Scene); 2] {
    let mut furnished = meshes::room(DVec3::ONE, |k| k == 2);
    furnished.cells.remove(5);
    let sheet = [[0.2, 0.3], [0.6, 0.3], [0.6, 0.8], [0.2, 0.8]].map(|[x, y]| DVec3::new(x, y, 0.6));
    meshes::bodies::sheet(&mut furnished, sheet);
    meshes::bodies::body(&mut furnished, &meshes::CUBE, |p| DVec3::new(0.55, 0.1, 0.0) + 0.25 * p);
    [("cube", scene(meshes::room(DVec3::ONE, |_| false))), ("furnished", scene(furnished))]
}

fn solved(scene: &Scene, basis: &'static Basis, elements: usize, tolerance: f64) -> Solution {
    let options = Options {
        basis,
        refinement: Refinement::Elements(elements),
        tolerance,
        operator: exchange::kind("dense").expect("a kind"),
        error_points: 0,
        ..Options::default()
    };
    solve(scene, &options, &Silent).expect("solved").solution
}

/// ‖B − B̃‖/‖B̃ − B⁰‖, the worst band's, if what is `fine` is reflected once more for the truth.
fn error(solution: &Solution, fine: &Solution) -> f64 {
    let mesh = &solution.scene.mesh;
    let (mut sites, mut places) = (Vec::new(), Vec::new());
    for cell in 0..mesh.cells.len() {
        let patch = mesh.patch(cell);
        let count = 1 + (POINTS * patch.area() / mesh.area()) as u32;
        for k in 0..count {
            let [u, v, ..] = point(hash(3, cell as u64), k);
            let at = patch.shape().uniform([u, v]);
            sites.push((patch.point(at), patch.normal()));
            places.push((cell, at, patch.area() / f64::from(count)));
        }
    }
    let truth = Probe::new(fine).values_gathered(&sites, 0, &Silent).expect("gathered");
    let of = |band: usize| {
        let (mut wrong, mut light) = (0.0, 0.0);
        for (k, &(cell, at, area)) in places.iter().enumerate() {
            let found = solution.evaluate(Shown::Radiosity, cell, at, band);
            let material = solution.scene.material(cell);
            let known = material.exitance.uniform(band).expect("uniform")
                + material.reflectance.uniform(band).expect("uniform") * truth.irradiance.band(band)[k];
            wrong += area * (found - known).powi(2);
            light += area * (found - material.exitance.uniform(band).expect("uniform")).powi(2);
        }
        (wrong / light).sqrt()
    };
    (0..solution.bands()).map(of).fold(0.0, f64::max)
}

#[test]
fn the_error_is_never_more_than_what_is_certified() {
    for (name, scene) in scenes() {
        let fine = solved(&scene, &ALL[3], 400, 1e-3);
        for (basis, elements) in [(&ALL[0], 200), (&ALL[1], 200), (&ALL[3], 80)] {
            let solution = solved(&scene, basis, elements, 1e-3);
            let found = certify(&solution, &Silent).expect("certified");
            let truth = error(&solution, &fine);
            let what = format!("{name}, {}, {elements}: {truth}, {found:?}", basis.name);
            assert!(truth <= found.relative && truth * (1.0 - found.reflectance) <= found.residual, "{what}");
            // Were nothing known of visibility or of what a cell receives, it would be several times the light.
            assert!(found.residual < 0.5, "{what}");
        }
    }
}

/// What points are likely to miss: a small cell that is far too bright.
#[test]
fn a_single_wrong_cell_is_in_the_bound() {
    let [(_, scene), _] = scenes();
    let mut solution = solved(&scene, &ALL[0], 300, 1e-4);
    let before = certify(&solution, &Silent).expect("certified");
    let fine = solved(&scene, &ALL[3], 100, 1e-4);
    let range = solution.space.range(17);
    solution.radiosity.band_mut(1)[range].iter_mut().for_each(|value| *value += 10.0);
    let after = certify(&solution, &Silent).expect("certified");
    let truth = error(&solution, &fine);
    assert!(truth > 2.0 * before.relative, "{truth} {before:?}");
    assert!(truth <= after.relative && after.residual < 3.0 * truth, "{truth} {after:?}");
}

/// In a closed furnace all differences from the median vanish.
#[test]
fn nothing_is_lost_in_a_furnace() {
    let material = |name| Material { exitance: Quantity::gray(0.5), ..Material::diffuse(name, 0.5) };
    let mesh = meshes::room(DVec3::ONE, |_| true);
    let furnace = Scene::new(mesh, vec![material("white")], Physics::Light, None).expect("valid");
    let solution = solved(&furnace, &ALL[1], 50, 1e-4);
    let found = certify(&solution, &Silent).expect("certified");
    assert!(found.relative < 1e-5, "{found:?}");
}

#[test]
fn what_cannot_be_certified_is_refused_by_name() {
    let mut materials = vec![Material::diffuse("painted", 0.5)];
    materials[0].reflectance = Quantity::function(|site, _| 0.5 * site.position.x);
    let scene = Scene::new(meshes::room(DVec3::ONE, |_| false), materials, Physics::Light, None).expect("valid");
    assert_eq!(certifiable(&scene, &ALL[1], true), Err(CertifyError::Varying("painted".to_owned())));
    let mirror = vec![Material::diffuse("mirror", 1.0)];
    let scene = Scene::new(meshes::room(DVec3::ONE, |_| false), mirror, Physics::Light, None).expect("valid");
    assert_eq!(certifiable(&scene, &ALL[0], true), Err(CertifyError::Lossless("mirror".to_owned())));
    let mut mesh = Mesh::default();
    let trapezium = [[0.0, 0.0], [1.0, 0.0], [0.7, 1.0], [0.2, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
    meshes::face(&mut mesh, &trapezium, 0);
    let scene = Scene::new(mesh, vec![Material::diffuse("floor", 0.5)], Physics::Light, None).expect("valid");
    assert_eq!(certifiable(&scene, &ALL[2], false), Err(CertifyError::Warped(0)));
    assert_eq!(certifiable(&scene, &ALL[2], true), Ok(()), "refined, it is triangles");
    assert_eq!(certifiable(&scene, &ALL[0], false), Ok(()), "constants are polynomials anywhere");
}

/// Both passed for certified to 2e-6.
#[test]
fn what_is_no_number_and_what_reflects_nothing_have_no_bound() {
    let [(_, scene), _] = scenes();
    let mut solution = solved(&scene, &ALL[0], 24, 1e-2);
    for cell in 0..24 {
        for band in 0..2 {
            let emitted = scene.materials[solution.scene.mesh.cells[cell].material as usize].exitance.uniform(band);
            let range = solution.space.range(cell);
            solution.radiosity.band_mut(band)[range].fill(emitted.expect("uniform"));
        }
    }
    assert!(matches!(certify(&solution, &Silent), Err(CertifyError::Dark(0))));
    solution.radiosity.band_mut(1)[7] = f64::NAN;
    assert!(matches!(certify(&solution, &Silent), Err(CertifyError::NoNumber(7))));
}

/// Far from the origin, what is nearer than a billionth of the coordinates was taken for one plane, and its light for none.
#[test]
fn plates_near_each_other_and_far_from_the_origin_light_each_other() {
    const GAP: f64 = 5e-3;
    let mut mesh = Mesh::default();
    let at = |[x, y, z]: [f64; 3]| DVec3::new(x + 1e7, y, z);
    meshes::face(&mut mesh, &[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]].map(at), 0);
    meshes::face(&mut mesh, &[[0., 0., GAP], [0., 1., GAP], [1., 1., GAP], [1., 0., GAP]].map(at), 1);
    let lamp = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.5) };
    let scene = Scene::new(mesh, vec![Material::diffuse("plate", 0.5), lamp], Physics::Light, None).expect("valid");
    let mut solution = solved(&scene, &ALL[0], 8, 1e-3);
    for cell in 0..solution.space.cells() {
        let emitted = solution.scene.material(cell).exitance.uniform(0).expect("uniform");
        let range = solution.space.range(cell);
        // A tenth of the light that is reflected: an error of nine times what is there.
        solution.radiosity.band_mut(0)[range].iter_mut().for_each(|b| *b = emitted + 0.1 * (*b - emitted));
    }
    let found = certify(&solution, &Silent).expect("certified");
    assert!(found.relative > 8.9, "{found:?}");
}

#[test]
fn more_cells_than_memory_has_room_for_are_refused_at_once() {
    let mesh = meshes::room(DVec3::ONE, |_| false);
    let scene = Scene::new(mesh, vec![Material::diffuse("wall", 0.5)], Physics::Light, None).expect("valid");
    let scene = scene.refined(Refinement::Elements(70_000), &ALL[0]).expect("refined");
    let space = FunctionSpace::new(&scene, &ALL[0], Continuity::Broken).expect("constants");
    let dark = MultiVector::zeros(space.broken_dofs(), 1);
    let cells = space.cells();
    let solution = Solution { scene, space, radiosity: dark.clone(), irradiance: dark };
    assert_eq!(certify(&solution, &Silent), Err(CertifyError::TooMany(cells)));
}

#[test]
fn it_can_be_interrupted() {
    struct Stop;
    impl Progress for Stop {
        fn interrupted(&self) -> bool {
            true
        }
    }
    let [(_, scene), _] = scenes();
    let solution = solved(&scene, &ALL[0], 50, 1e-2);
    assert!(matches!(certify(&solution, &Stop), Err(CertifyError::Interrupted(_))));
}

//! What is shown next to a hard shadow: no ringing, no negative light, and the same power.

#[expect(dead_code, reason = "not every test needs every mesh")]
mod meshes;

use glam::DVec3;
use hatbox::assemble::mass;
use hatbox::bake::{bake, limited};
use hatbox::element::ALL;
use hatbox::linalg::{LinearOperator, MultiVector};
use hatbox::mesh::{Mesh, Refinement};
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, Shown, Solution, solve};
use hatbox::scene::{Material, Physics, Quantity, Scene};
use hatbox::space::{Continuity, FunctionSpace};

fn integrals(solution: &Solution, field: &MultiVector) -> Vec<f64> {
    let integrals = mass(&solution.scene, &solution.space).times(field);
    integrals.iter_bands().map(|band| band.iter().sum()).collect()
}

fn least(field: &MultiVector) -> f64 {
    field.as_slice().iter().copied().fold(f64::INFINITY, f64::min)
}

#[test]
fn limiting_keeps_the_power_and_leaves_nothing_negative_in_any_basis() {
    for basis in &ALL {
        for continuity in ["continuous", "broken"] {
            let options = Options {
                basis,
                continuity: Continuity::named(continuity).expect("a name"),
                refinement: Refinement::Elements(300),
                error_points: 0,
                ..Options::default()
            };
            let solution = solve(&meshes::shadow::scene(), &options, &Silent).expect("solved").solution;
            let shown = limited(&solution);
            let name = format!("{continuity} {}", basis.name);
            for (before, after) in [(&solution.radiosity, &shown.radiosity), (&solution.irradiance, &shown.irradiance)]
            {
                let (before, after) = (integrals(&solution, before)[0], integrals(&shown, after)[0]);
                assert!((after / before - 1.0).abs() < 1e-12, "{name}: {before} {after}");
            }
            assert!(least(&shown.radiosity) >= 0.0 && least(&shown.irradiance) >= 0.0, "{name}");
            assert!(least(&bake(&solution, Shown::Radiosity).values) >= 0.0, "{name}");
        }
    }
}

#[test]
fn the_expansion_itself_does_ring_next_to_a_hard_shadow() {
    let options = Options { refinement: Refinement::Elements(300), error_points: 0, ..Options::default() };
    let solution = solve(&meshes::shadow::scene(), &options, &Silent).expect("solved").solution;
    assert!(least(&solution.radiosity) < 0.0, "otherwise the other test shows nothing");
}

#[test]
fn limiting_leaves_linear_functions_alone() {
    let mut mesh = Mesh::default();
    meshes::face(&mut mesh, &[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.3), DVec3::new(0.0, 1.0, 0.3)], 0);
    let material = Material { exitance: Quantity::gray(0.0), ..Material::diffuse("gray", 0.5) };
    let scene = Scene::new(mesh, vec![material], Physics::Light, None).expect("valid");
    let linear = |p: DVec3| 3.0 + p.x - 1.5 * p.y;
    for basis in ALL.iter().filter(|basis| basis.order > 1) {
        let scene = scene.refined(Refinement::MaxEdge(0.3), basis).expect("refined");
        for continuity in ["continuous", "broken"] {
            let continuity = Continuity::named(continuity).expect("a name");
            let space = FunctionSpace::new(&scene, basis, continuity).expect("elements");
            let mut irradiance = MultiVector::zeros(space.broken_dofs(), 1);
            for cell in 0..space.cells() {
                let patch = scene.mesh.patch(cell);
                for (dof, node) in space.range(cell).zip(space.element(cell).nodes) {
                    irradiance.band_mut(0)[dof] = linear(patch.point(node.at));
                }
            }
            let radiosity = MultiVector::zeros(space.broken_dofs(), 1);
            let solution = Solution { scene: scene.clone(), space, radiosity, irradiance };
            let shown = limited(&solution);
            for (before, after) in solution.irradiance.as_slice().iter().zip(shown.irradiance.as_slice()) {
                assert!((before - after).abs() < 1e-12, "{}: {before} {after}", basis.name);
            }
        }
    }
}

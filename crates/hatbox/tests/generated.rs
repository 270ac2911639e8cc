//! The scenes that `examples/generate` makes are sound, and what operators for large scenes make of these and others.

#[path = "../examples/generate/kinds/mod.rs"]
mod kinds;
#[expect(dead_code, reason = "not every test needs every mesh")]
mod meshes;

use glam::DVec3;
use hatbox::check::Lighting;
use hatbox::exchange::{self, Problem};
use hatbox::io::read_scene;
use hatbox::linalg::{LinearOperator, MultiVector};
use hatbox::mesh::Refinement;
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, System, solve};
use hatbox::scene::{Material, Physics, Quantity, Scene};
use hatbox::visibility::Bvh;

fn scene(kind: &kinds::Kind, elements: usize) -> (Scene, bool) {
    let model = (kind.make)(elements);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, model.to_glb()).expect("written");
    (read_scene(&path).expect("a scene").0, model.closed)
}

#[test]
fn every_kind_is_sound() {
    for kind in kinds::ALL {
        let (scene, closed) = scene(kind, 1200);
        let lighting = Lighting::of(&scene).expect("elements");
        assert_eq!(lighting.escape == 0.0, closed, "{}: {}", kind.name, lighting.escape);
        assert!(lighting.emitters > 0, "{}", kind.name);
    }
}

#[test]
fn every_kind_has_about_as_many_triangles_as_asked() {
    for kind in kinds::ALL {
        for elements in [2_000, 20_000] {
            let triangles = (kind.make)(elements).triangles();
            assert!(
                (0.5..2.0).contains(&(triangles as f64 / elements as f64)),
                "{} {elements}: {triangles}",
                kind.name
            );
        }
        assert_eq!((kind.make)(2_000).to_glb(), (kind.make)(2_000).to_glb(), "{}", kind.name);
    }
}

#[test]
fn every_kind_is_solved_by_rays() {
    for kind in kinds::ALL {
        let (scene, closed) = scene(kind, 1500);
        let options = Options {
            operator: exchange::kind(exchange::Sampled::NAME).expect("a kind"),
            refinement: Refinement::Elements(3000),
            tolerance: 0.02,
            error_points: 0,
            ..Options::default()
        };
        let solved = solve(&scene, &options, &Silent).expect("solved");
        assert_eq!(solved.closure.balanced, closed, "{}", kind.name);
        assert!(solved.operator_norm < 1.05, "{}: {}", kind.name, solved.operator_norm);
        assert!(solved.energy.defect() < 1e-5, "{}: {}", kind.name, solved.energy.defect());
    }
}

/// Among many small things all pairs take minutes, more so if they shine, in an empty room seconds, and none where memory is
/// short. Faces of a ball do not see each other, but all their pairs are a large table; those of a hollow one do, each for itself.
#[test]
fn rays_are_chosen_where_much_is_partly_hidden() {
    let clutter = scene(kinds::ALL.iter().find(|kind| kind.name == "clutter").expect("a kind"), 500).0;
    let cube = read_scene(std::path::Path::new("../../scenes/cube.toml")).expect("a sample").0;
    let gray = |mesh| Scene::new(mesh, vec![Material::diffuse("gray", 0.5)], Physics::Light, None).expect("valid");
    let (ball, mut hollow) = (gray(meshes::icosphere(5)), meshes::icosphere(4));
    hollow.cells.iter_mut().for_each(|cell| cell.vertices.swap(0, 1));
    let hollow = gray(hollow);
    let chosen = |scene: &Scene, elements: usize, memory: usize, strength: f64| {
        let scene = scene.refined(Refinement::Elements(elements), Options::default().basis).expect("refined");
        let blockers = Bvh::of_surfaces(&scene.surfaces);
        let coefficients = 3 * scene.mesh.cells.len();
        let strengths = vec![strength; scene.mesh.cells.len()];
        let (scene, blockers, strengths) = (&scene, &blockers, &strengths);
        exchange::choose(&Problem { scene, blockers, strengths, coefficients, tolerance: 0.01, memory })
    };
    for (scene, elements, memory, strength, expected, word) in [
        (&clutter, 4000, 8 << 30, 1.0, exchange::Sampled::NAME, "partly hidden"),
        (&clutter, 1000, 8 << 30, 1.0, exchange::Dense::NAME, "partly hidden"),
        (&clutter, 1000, 8 << 30, 9.0, exchange::Sampled::NAME, "partly hidden"),
        (&cube, 4000, 8 << 30, 9.0, exchange::Dense::NAME, "0 % of them partly hidden"),
        (&cube, 4000, 1 << 20, 1.0, exchange::Sampled::NAME, "MB allowed"),
        (&cube, 60_000, 400 << 30, 1.0, exchange::Sampled::NAME, "CPU seconds, rays"),
        (&ball, 1, 400 << 30, 1.0, exchange::Sampled::NAME, "0 % of them partly hidden, would take"),
        (&hollow, 1, 8 << 30, 1.0, exchange::Sampled::NAME, "0 % of them partly hidden, would take"),
    ] {
        let (kind, why) = chosen(scene, elements, memory, strength);
        assert_eq!(kind.name, expected, "{elements} {memory}: {why}");
        assert!(why.contains(word), "{why}");
    }
}

/// Shadows of a sun have hard borders, which pass through facets between the few points at which lamps are integrated: what
/// rays err by there falls with the tolerance as elsewhere, and the operator knows it.
#[test]
fn borders_of_shadows_within_elements_are_seen_by_rays() {
    let terrain = scene(kinds::ALL.iter().find(|kind| kind.name == "terrain").expect("a kind"), 690).0;
    let solved = |operator: &str, tolerance: f64| {
        let operator = exchange::kind(operator).expect("a kind");
        let (refinement, error_points) = (Refinement::None, 0);
        let options = Options { operator, refinement, tolerance, error_points, ..Options::default() };
        let system = System::build(&terrain, &options, &Silent).expect("built");
        let solution = system.solved(&options, &Silent).expect("solved").solution;
        let estimate = system.operator_error(&solution, &Silent).expect("not interrupted");
        (solution, estimate)
    };
    let (exact, _) = solved(exchange::Dense::NAME, 1e-3);
    let mass = hatbox::assemble::mass(&exact.scene, &exact.space);
    let dark = |cell: usize| exact.scene.material(cell).exitance.is_zero();
    // The points of a rule alone do not get there, with any number of rays.
    for tolerance in [0.1, 0.025, 0.006] {
        for kind in [exchange::Sampled::NAME, exchange::Hierarchical::NAME] {
            let (found, estimate) = solved(kind, tolerance);
            let mut difference = found.radiosity;
            difference.add_scaled(-1.0, &exact.radiosity);
            let square = |function: &MultiVector| -> f64 {
                let weighted = mass.times(function);
                let cells = (0..exact.space.cells()).filter(|&cell| dark(cell));
                cells.flat_map(|cell| exact.space.range(cell)).map(|k| function.band(0)[k] * weighted.band(0)[k]).sum()
            };
            let error = (square(&difference) / square(&exact.radiosity)).sqrt();
            assert!(error < tolerance / 3.0, "{kind}, {tolerance}: {error}");
            assert!((0.5..2.0).contains(&(estimate / error)), "{kind}, {tolerance}: {error}, estimated {estimate}");
        }
    }
}

/// Of planes only the largest are linked: a ground alone is more than nine tenths of all area.
#[test]
fn a_room_on_a_wide_ground_keeps_its_links() {
    let mut room = meshes::room(DVec3::new(2.0, 1.0, 1.5), |_| true);
    room.cells[0].material = 1;
    let links = |edge: f64| {
        let mut mesh = room.refined(Refinement::Elements(2000)).expect("refined");
        let (parts, side) = (10, edge / 10.0);
        for (x, y) in (0..parts).flat_map(|x| (0..parts).map(move |y| (f64::from(x), f64::from(y)))) {
            let piece = [(x, y), (x + 1.0, y), (x + 1.0, y + 1.0), (x, y + 1.0)];
            meshes::face(&mut mesh, &piece.map(|(x, y)| DVec3::new(side * x, side * y, -1.0)), 0);
        }
        let lamp = Material { exitance: Quantity::gray(1.0), ..Material::diffuse("lamp", 0.0) };
        let materials = vec![Material::diffuse("walls", 0.5), lamp];
        let scene = Scene::new(mesh.triangulated(), materials, Physics::Light, None).expect("valid");
        let kind = exchange::kind("hierarchical").expect("a kind");
        let options = Options {
            operator: kind,
            refinement: Refinement::None,
            tolerance: 0.02,
            error_points: 0,
            ..Options::default()
        };
        solve(&scene, &options, &Silent).expect("solved").operator.pairs
    };
    let (small, wide) = (links(1.0), links(1000.0));
    assert!(wide > 0 && wide <= small, "{wide} {small}");
}

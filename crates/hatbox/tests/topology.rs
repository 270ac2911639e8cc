//! Meshes through welding, repair, subdivision and joining: nothing is lost, nothing hangs, and functions are continuous
//! exactly where light is.

mod meshes;

use glam::{DVec2, DVec3};
use hatbox::element::{Basis, Shape};
use hatbox::linalg::{Csr, LinearOperator};
use hatbox::mesh::{Mesh, RefineError, Refinement, Topology};
use hatbox::scene::{Material, Physics, Quantity, Scene, SceneError, Texture, Warning, Wrap};
use hatbox::space::{Continuity, FunctionSpace};
use meshes::{cornell, face, icosphere, room};
use proptest::prelude::*;
use std::collections::HashMap;
use std::f64::consts::PI;
use std::sync::Arc;

fn scene(mesh: Mesh, materials: Vec<Material>) -> Scene {
    Scene::new(mesh, materials, Physics::Light, None).expect("a good scene")
}

fn gray(mesh: Mesh) -> Scene {
    scene(mesh, vec![Material::diffuse("gray", 0.5)])
}

// --- what must hold ---

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * a.abs().max(b.abs())
}

/// No vertex lies inside an edge.
fn nothing_hangs(mesh: &Mesh) {
    let topology = Topology::new(mesh);
    for edge in 0..topology.edges() {
        let [a, b] = topology.vertices(edge).map(|v| mesh.vertices[v as usize]);
        for &p in &mesh.vertices {
            let inside = (p - a).dot(b - a) > 1e-9 && (p - b).dot(a - b) > 1e-9;
            let distance = (p - a).cross(b - a).length() / a.distance(b);
            assert!(!inside || distance > 1e-9, "{p} hangs on the edge {a} {b}");
        }
    }
}

/// Every edge has two cells that run through it in opposite directions.
fn closed(mesh: &Mesh) {
    let topology = Topology::new(mesh);
    assert_eq!(topology.open_edges().count(), 0);
    for edge in 0..topology.edges() {
        let sides = topology.sides(edge);
        assert_eq!(sides.len(), 2, "edge {:?}", topology.vertices(edge));
        assert_ne!(sides[0].forward, sides[1].forward);
    }
}

/// All arrays fit, and the parts of each (surface, side) are contiguous and in its plane.
fn consistent(scene: &Scene) {
    let mesh = &scene.mesh;
    assert!(mesh.uvs.is_empty() || mesh.uvs.len() == mesh.cells.len());
    assert!(mesh.normals.is_empty() || mesh.normals.len() == mesh.cells.len());
    let mut runs: HashMap<(u32, bool), usize> = HashMap::new();
    let mut last = None;
    for (index, cell) in mesh.cells.iter().enumerate() {
        let [a, b, c, _] = scene.surfaces[cell.surface as usize].corners;
        let normal = (b - a).cross(c - a).normalize();
        let along = normal.dot(mesh.patch(index).normal());
        assert!(along.abs() > 1.0 - 1e-9);
        let key = (cell.surface, along > 0.0);
        if last != Some(key) {
            *runs.entry(key).or_default() += 1;
        }
        last = Some(key);
    }
    assert!(runs.values().all(|&n| n == 1));
}

fn longest_edge(mesh: &Mesh) -> f64 {
    (0..mesh.cells.len()).map(|cell| mesh.patch(cell).longest_edge()).fold(0.0, f64::max)
}

fn hats(scene: &Scene, basis: &str) -> usize {
    let basis = Basis::named(basis).expect("a basis");
    let continuity = Continuity::named("continuous").expect("a name");
    let scene = scene.refined(Refinement::None, basis).expect("nothing to do");
    let space = FunctionSpace::new(&scene, basis, continuity).expect("elements on all cells");
    if let Some(c) = space.continuity() {
        rows_are_unit_vectors(c, space.broken_dofs());
    }
    space.dofs()
}

fn rows_are_unit_vectors(c: &Csr, rows: usize) {
    assert_eq!(c.rows(), rows);
    for row in 0..rows {
        assert_eq!(c.row(row).map(|(_, value)| value).collect::<Vec<_>>(), [1.0]);
    }
}

// --- welding and repair ---

#[test]
fn a_cube_of_separate_faces_welds_to_eight_vertices() {
    for split in [false, true] {
        let mesh = room(DVec3::ONE, |_| split);
        let (welded, dropped) = mesh.welded(mesh.tolerance());
        assert_eq!((welded.vertices.len(), dropped), (8, 0));
        assert!(close(welded.area(), 6.0));
        closed(&welded);
    }
}

#[test]
fn welding_respects_its_tolerance() {
    let mut mesh = Mesh::default();
    face(&mut mesh, &[DVec3::ZERO, DVec3::X, DVec3::Y], 0);
    let shift = DVec3::new(1e-4, 0.0, 0.0);
    face(&mut mesh, &[DVec3::X + shift, DVec3::ONE + shift, DVec3::Y + shift], 0);
    assert_eq!(mesh.welded(0.9e-4).0.vertices.len(), 6);
    assert_eq!(mesh.welded(1.1e-4).0.vertices.len(), 4);
    assert_eq!(mesh.welded(0.0).0.vertices.len(), 6);
}

#[test]
fn collapsed_cells_go_and_a_quad_with_a_repeated_corner_is_a_triangle() {
    let mut mesh = Mesh::default();
    let (o, x, y) = (DVec3::ZERO, DVec3::X, DVec3::Y);
    face(&mut mesh, &[o, x, x, y], 0);
    face(&mut mesh, &[o, x, o], 0);
    face(&mut mesh, &[o, x, 2.0 * x], 0);
    face(&mut mesh, &[o, x, o, y], 0);
    let (welded, dropped) = mesh.welded(mesh.tolerance());
    assert_eq!((welded.cells.len(), dropped), (1, 3));
    assert_eq!(welded.cells[0].shape, Shape::Triangle);
    assert!(close(welded.area(), 0.5));
}

#[test]
fn a_t_junction_is_repaired_with_its_texture_coordinates() {
    let mut mesh = Mesh::default();
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    face(&mut mesh, &[at(0.0, 0.0), at(3.0, 0.0), at(3.0, 1.0), at(0.0, 1.0)], 0);
    for x in [0.0, 1.0, 2.0] {
        face(&mut mesh, &[at(x, 1.0), at(x + 1.0, 1.0), at(x + 1.0, 2.0), at(x, 2.0)], 0);
    }
    mesh.uvs = mesh.cells.iter().map(|c| c.vertices.map(|v| mesh.vertices[v as usize].truncate())).collect();
    let tolerance = mesh.tolerance();
    let (welded, _) = mesh.welded(tolerance);
    let (conforming, split) = welded.conformed(tolerance);
    assert_eq!(split, 1);
    nothing_hangs(&conforming);
    assert!(close(conforming.area(), 6.0));
    assert_eq!(conforming.cells.len(), 3 + 4);
    assert_eq!(Topology::new(&conforming).open_edges().count(), 8);
    for (cell, uvs) in conforming.cells.iter().zip(&conforming.uvs) {
        for (uv, v) in uvs.iter().zip(cell.vertices) {
            assert!(uv.distance(conforming.vertices[v as usize].truncate()) < 1e-12);
        }
    }
}

#[test]
fn an_edge_with_a_hundred_vertices_is_cut_into_sound_triangles() {
    let mut mesh = Mesh::default();
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    face(&mut mesh, &[at(0.0, 0.0), at(1.0, 0.0), at(0.5, 1.0)], 0);
    for i in 0..100 {
        let (x, w) = (f64::from(i) / 100.0, 0.01);
        face(&mut mesh, &[at(x + w, 0.0), at(x, 0.0), at(x + 0.5 * w, -w)], 0);
    }
    let (welded, _) = mesh.welded(mesh.tolerance());
    let (conforming, _) = welded.conformed(mesh.tolerance());
    nothing_hangs(&conforming);
    assert!(close(conforming.area(), welded.area()));
    assert_eq!(conforming.cells.len(), 200);
}

#[test]
fn the_cornell_box_becomes_conforming_and_stays_so() {
    let mesh = cornell();
    let area = mesh.area();
    let scene = gray(mesh);
    consistent(&scene);
    nothing_hangs(&scene.mesh);
    assert!(scene.warnings.iter().any(|w| matches!(w, Warning::TJunctions(_))));
    assert!((scene.mesh.area() - area).abs() < 1e-9 * area);
    let fine = scene.refined(Refinement::Elements(1500), Basis::named("linear").expect("linear")).expect("refined");
    consistent(&fine);
    nothing_hangs(&fine.mesh);
    assert!(close(fine.mesh.area(), scene.mesh.area()));
    assert!((750..3000).contains(&fine.mesh.cells.len()), "{}", fine.mesh.cells.len());
    assert_eq!(fine.surfaces.len(), scene.surfaces.len());
}

// --- subdivision ---

#[test]
fn a_subdivided_cube_stays_closed_and_respects_the_length() {
    let faces: [fn(usize) -> bool; 4] = [|_| false, |_| true, |k| k % 2 == 0, |k| k < 2];
    for split in faces {
        for size in [DVec3::ONE, DVec3::new(1.0, 2.3, 0.4)] {
            let mesh = room(size, split);
            let (mesh, _) = mesh.welded(mesh.tolerance());
            for h in [3.0, 1.0, 0.7, 0.25, 0.11] {
                let fine = mesh.refined(Refinement::MaxEdge(h)).expect("refined");
                closed(&fine);
                assert!(close(fine.area(), mesh.area()));
                assert!(longest_edge(&fine) <= h * (1.0 + 1e-6), "{} > {h}", longest_edge(&fine));
                if fine.cells.len() < 1000 {
                    nothing_hangs(&fine);
                }
            }
        }
    }
}

#[test]
fn quads_are_cut_no_finer_than_the_length_asks() {
    let mesh = room(DVec3::ONE, |_| false);
    let (mesh, _) = mesh.welded(mesh.tolerance());
    for (h, n) in [(1.0, 1), (0.5, 2), (0.25, 4)] {
        assert_eq!(mesh.refined(Refinement::MaxEdge(h)).expect("refined").cells.len(), 6 * n * n);
    }
}

#[test]
fn subdivision_keeps_the_shape_of_triangles() {
    let scene = gray(room(DVec3::new(1.0, 2.3, 0.4), |_| true));
    let fine = scene.mesh.refined(Refinement::MaxEdge(0.1)).expect("refined");
    // A sharp corner stays as sharp as it was; nothing gets sharper.
    let worst = |mesh: &Mesh| {
        let patches = (0..mesh.cells.len()).map(|cell| mesh.patch(cell));
        patches.map(|patch| patch.area() / patch.longest_edge().powi(2)).fold(f64::INFINITY, f64::min)
    };
    assert!(worst(&fine) > 0.999 * worst(&scene.mesh));
}

#[test]
fn the_number_of_elements_is_met_within_a_factor_of_two() {
    let basis = |name| Basis::named(name).expect("a basis");
    for size in [DVec3::ONE, DVec3::new(4.0, 2.5, 7.0)] {
        for split in [false, true] {
            let scene = gray(room(size, |_| split));
            for (n, name) in
                [(20, "bilinear"), (100, "linear"), (777, "bilinear"), (5000, "linear"), (40000, "constant")]
            {
                let fine = scene.refined(Refinement::Elements(n), basis(name)).expect("refined");
                let ratio = fine.mesh.cells.len() as f64 / n as f64;
                assert!((0.5..=2.0).contains(&ratio), "{name} {n}: {}", fine.mesh.cells.len());
                consistent(&fine);
            }
            assert_eq!(scene.refined(Refinement::Elements(1), basis("bilinear")).expect("kept").mesh, scene.mesh);
        }
    }
}

#[test]
fn absurd_subdivisions_are_refused() {
    for split in [false, true] {
        let scene = gray(room(DVec3::ONE, |_| split));
        let refine = |refinement| scene.mesh.refined(refinement).map(|mesh| mesh.cells.len());
        assert_eq!(refine(Refinement::MaxEdge(1e-5)), Err(RefineError::TooMany { max_edge: 1e-5 }));
        assert_eq!(refine(Refinement::MaxEdge(1e-300)), Err(RefineError::TooMany { max_edge: 1e-300 }));
        assert_eq!(refine(Refinement::MaxEdge(0.0)), Err(RefineError::Length(0.0)));
        assert!(matches!(refine(Refinement::MaxEdge(f64::NAN)), Err(RefineError::Length(_))));
        assert_eq!(refine(Refinement::Elements(usize::MAX)), Err(RefineError::TooManyElements(usize::MAX)));
        assert_eq!(refine(Refinement::MaxEdge(f64::INFINITY)), Ok(scene.mesh.cells.len()));
    }
}

#[test]
fn both_sides_of_a_sheet_are_subdivided_alike() {
    let mut mesh = Mesh::default();
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    face(&mut mesh, &[at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)], 0);
    face(&mut mesh, &[at(1.0, 0.0), at(2.0, 0.5), at(1.0, 1.0)], 0);
    mesh.uvs = mesh.cells.iter().map(|c| c.vertices.map(|v| mesh.vertices[v as usize].truncate())).collect();
    mesh.normals = vec![[DVec3::Z; 4]; 2];
    let scene = scene(mesh, vec![Material { two_sided: true, ..Material::diffuse("paper", 0.5) }]);
    assert_eq!((scene.mesh.cells.len(), scene.surfaces.len()), (4, 2));
    consistent(&scene);
    for h in [2.0, 0.4, 0.1] {
        let fine = scene.mesh.refined(Refinement::MaxEdge(h)).expect("refined");
        assert!(close(fine.area(), 3.0));
        let mut places: HashMap<Vec<u32>, i32> = HashMap::new();
        for (index, cell) in fine.cells.iter().enumerate() {
            let mut key = cell.corners().to_vec();
            key.sort_unstable();
            let side = fine.patch(index).normal().z;
            *places.entry(key).or_default() += side as i32;
            for (k, &v) in cell.corners().iter().enumerate() {
                assert!(fine.uvs[index][k].distance(fine.vertices[v as usize].truncate()) < 1e-12);
                assert!(fine.normals[index][k].dot(fine.patch(index).normal()) > 0.999);
            }
        }
        assert_eq!(2 * places.len(), fine.cells.len());
        assert!(places.values().all(|&sum| sum == 0));
    }
    // The square and the triangle are joined, on each side apart.
    assert_eq!(hats(&scene, "bilinear"), 2 * 5);
    assert_eq!(hats(&scene, "quadratic"), 2 * (5 + 7));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn random_soups_keep_their_area_and_conform(
        coordinates in prop::collection::vec(-1.0..1.0_f64, 9 * 5), h in 0.2..1.0_f64,
    ) {
        // Fans around common edges: vertices are shared, orientation and manifoldness are not looked after.
        let points: Vec<DVec3> = coordinates.chunks_exact(3).map(DVec3::from_slice).collect();
        let mut mesh = Mesh::default();
        points.windows(3).for_each(|w| face(&mut mesh, w, 0));
        let (mesh, _) = mesh.welded(mesh.tolerance());
        let fine = mesh.refined(Refinement::MaxEdge(h)).expect("refined");
        prop_assert!(close(fine.area(), mesh.area()));
        prop_assert!(longest_edge(&fine) <= h * (1.0 + 1e-6));
        let edges = Topology::new(&fine);
        let open = |mesh: &Mesh, edges: &Topology| -> f64 {
            let length = |e| {
                let [a, b] = edges.vertices(e).map(|v| mesh.vertices[v as usize]);
                a.distance(b)
            };
            edges.open_edges().map(length).sum()
        };
        // A hanging vertex would open edges inside the surface.
        prop_assert!((open(&fine, &edges) - open(&mesh, &Topology::new(&mesh))).abs() < 1e-9);
        let again = fine.conformed(1e-12);
        prop_assert_eq!(again.1, 0);
    }
}

// --- continuity ---

#[test]
fn the_hats_of_a_cube_are_those_of_its_six_faces() {
    for (basis, longest) in [("bilinear", 1.0), ("linear", 2.0_f64.sqrt())] {
        for n in [1, 2, 4] {
            let scene = gray(room(DVec3::ONE, |_| false));
            let max_edge = Refinement::MaxEdge(longest / n as f64);
            let fine = scene.refined(max_edge, Basis::named(basis).expect("a basis")).expect("refined");
            assert_eq!(hats(&fine, basis), 6 * (n + 1) * (n + 1), "{basis} {n}");
        }
    }
}

#[test]
fn constants_and_broken_spaces_join_nothing() {
    let scene = gray(room(DVec3::ONE, |_| true));
    assert_eq!(hats(&scene, "constant"), 12);
    let space = FunctionSpace::new(&scene, Basis::named("linear").expect("linear"), Continuity::Broken);
    assert_eq!(space.expect("triangles").dofs(), 36);
    for (name, _) in Continuity::NAMES {
        assert_eq!(Continuity::named(name).map(|c| c.name()), Some(name));
    }
}

/// Two squares side by side, each with its own vertices.
fn strip(materials: [u32; 2]) -> Mesh {
    let mut mesh = Mesh::default();
    for (x, material) in [0.0, 1.0].into_iter().zip(materials) {
        let at = |dx: f64, y: f64| DVec3::new(x + dx, y, 0.0);
        face(&mut mesh, &[at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)], material);
    }
    mesh
}

#[test]
fn a_flat_strip_is_joined_unless_the_material_or_the_normals_change() {
    let [white, also_white, dark] = [("a", 0.8), ("b", 0.8), ("c", 0.2)].map(|(n, r)| Material::diffuse(n, r));
    let lamp = Material { exitance: Quantity::gray(3.0), ..white.clone() };
    let materials = vec![white, also_white, dark, lamp];
    for (pair, expected) in [([0, 0], 6), ([0, 1], 6), ([0, 2], 8), ([0, 3], 8)] {
        assert_eq!(hats(&scene(strip(pair), materials.clone()), "bilinear"), expected, "{pair:?}");
    }
    for (tilt, expected) in [(0.0, 6), (20.0, 6), (40.0, 8)] {
        let (sine, cosine) = (PI * tilt / 180.0).sin_cos();
        let mut mesh = strip([0, 0]);
        mesh.normals = vec![[DVec3::Z; 4], [DVec3::new(sine, 0.0, cosine); 4]];
        assert_eq!(hats(&gray(mesh), "bilinear"), expected, "{tilt}°");
    }
}

#[test]
fn surfaces_that_touch_in_a_vertex_stay_apart() {
    let mut mesh = Mesh::default();
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    face(&mut mesh, &[at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)], 0);
    face(&mut mesh, &[at(0.0, 0.0), at(-1.0, 0.0), at(0.0, -1.0)], 0);
    assert_eq!(hats(&gray(mesh), "linear"), 6);
}

#[test]
fn a_smooth_sphere_is_one_surface() {
    for times in [1, 2] {
        let scene = gray(icosphere(times));
        closed(&scene.mesh);
        let (v, e) = (scene.mesh.vertices.len(), Topology::new(&scene.mesh).edges());
        assert_eq!(hats(&scene, "linear"), v);
        assert_eq!(hats(&scene, "quadratic"), v + e);
    }
    // The icosahedron itself has edges of 42°.
    assert_eq!(hats(&gray(icosphere(0)), "linear"), 60);
}

#[test]
fn four_walls_that_meet_in_a_line_are_joined_only_behind_each_other() {
    // A floor and a wall that cross: each side of each is cut in two by the other.
    let mut mesh = Mesh::default();
    let along = DVec3::Y;
    let halves = [(-DVec3::X, DVec3::ZERO), (DVec3::ZERO, DVec3::X), (-DVec3::Z, DVec3::ZERO), (DVec3::ZERO, DVec3::Z)];
    for (count, hats_expected) in [(2, 2 * 6), (3, 6 + 4 * 4), (4, 8 * 4)] {
        mesh.cells.clear();
        for &(a, b) in &halves[..count] {
            face(&mut mesh, &[a, b, b + along, a + along], 0);
        }
        let sheet = Material { two_sided: true, ..Material::diffuse("sheet", 0.5) };
        assert_eq!(hats(&scene(mesh.clone(), vec![sheet]), "bilinear"), hats_expected, "{count}");
    }
}

#[test]
fn dihedral_angles_are_measured_in_front_of_the_cells() {
    let at = |mesh: Mesh| {
        let (mesh, _) = mesh.welded(mesh.tolerance());
        let topology = Topology::new(&mesh);
        let sides = topology.sides(0);
        mesh.dihedral_angle(sides[0].cell as usize, sides[1].cell as usize)
    };
    assert!(close(at(room(DVec3::ONE, |_| false)), PI / 2.0));
    assert!(close(at(icosphere(0)), 2.0 * PI - (-(5.0_f64.sqrt()) / 3.0).acos()));
}

// --- scenes ---

#[test]
fn warped_and_dented_quads_are_split_where_they_can_be() {
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let mut mesh = Mesh::default();
    face(&mut mesh, &[at(0., 0., 0.), at(1., 0., 0.), at(1., 1., 0.5), at(0., 1., 0.)], 0);
    // Dented at corner 1, so the diagonal 0–2 runs outside.
    face(&mut mesh, &[at(0., 0., 2.), at(0.2, 0.2, 2.), at(1., 0., 2.), at(0., 1., 2.)], 0);
    // Straight at corner 3.
    face(&mut mesh, &[at(0., 0., 3.), at(1., 0., 3.), at(0., 1., 3.), at(0., 0.5, 3.)], 0);
    let scene = gray(mesh);
    assert_eq!((scene.mesh.cells.len(), scene.surfaces.len()), (6, 6));
    assert_eq!(scene.warnings, [Warning::SplitQuads(3)]);
    assert_eq!(scene.mesh.vertices[scene.mesh.cells[0].vertices[2] as usize], at(1., 1., 0.5));
    for cell in 2..6 {
        assert!(scene.mesh.patch(cell).normal().z > 0.99);
    }
    consistent(&scene);
}

#[test]
fn what_cannot_be_computed_is_named() {
    let error = |change: &dyn Fn(&mut Mesh, &mut Material)| {
        let (mut mesh, mut material) = (room(DVec3::ONE, |_| false), Material::diffuse("wall", 0.5));
        change(&mut mesh, &mut material);
        Scene::new(mesh, vec![material], Physics::Light, None).map(|_| ()).expect_err("a bad scene")
    };
    let wall = || "wall".to_owned();
    let reflectance = |band, value| SceneError::Reflectance { material: wall(), band, value };
    assert_eq!(error(&|mesh, _| mesh.cells.clear()), SceneError::Empty);
    assert_eq!(error(&|mesh, _| mesh.vertices.fill(DVec3::ONE)), SceneError::NoArea(6));
    assert_eq!(
        error(&|mesh, _| mesh.vertices[5].y = f64::INFINITY),
        SceneError::Position { vertex: 5, group: "part".to_owned(), position: DVec3::new(0.0, f64::INFINITY, 1.0) }
    );
    assert_eq!(
        error(&|mesh, _| mesh.cells[2].material = 7),
        SceneError::Index { cell: 2, what: "material", index: 7, count: 1 }
    );
    assert_eq!(
        error(&|mesh, _| mesh.cells[3].vertices[1] = 99),
        SceneError::Index { cell: 3, what: "vertex", index: 99, count: 24 }
    );
    assert_eq!(
        error(&|mesh, _| mesh.uvs = vec![[DVec2::ZERO; 4]]),
        SceneError::Corners { what: "texture coordinates", found: 1, faces: 6 }
    );
    assert_eq!(error(&|_, m| m.reflectance = Quantity::Uniform(vec![0.1, 1.2, 0.1])), reflectance(1, 1.2));
    assert_eq!(error(&|_, m| m.reflectance = Quantity::gray(-0.5)), reflectance(0, -0.5));
    let texture = Texture::new(1, 1, 1, vec![0.75], [Wrap::Clamp; 2]).map(Arc::new).expect("fits");
    assert_eq!(
        error(&|_, m| m.reflectance = Quantity::Textured { factor: vec![2.0], texture: texture.clone() }),
        reflectance(0, 1.5)
    );
    assert!(matches!(error(&|_, m| m.exitance = Quantity::gray(f64::NAN)), SceneError::Exitance { band: 0, .. }));
    assert_eq!(
        error(&|_, m| {
            m.reflectance = Quantity::Uniform(vec![0.5; 3]);
            m.exitance = Quantity::Uniform(vec![1.0; 2]);
        }),
        SceneError::Bands { material: wall(), found: 2, bands: 3 }
    );
}

#[test]
fn bands_are_those_of_the_richest_material() {
    let red = Material { reflectance: Quantity::Uniform(vec![0.8, 0.1, 0.1]), ..Material::diffuse("red", 0.0) };
    let scene = scene(strip([0, 1]), vec![Material::diffuse("gray", 0.5), red]);
    assert_eq!(scene.bands, 3);
}

//! Cells that stand on others or pass through them: both get edges along the line, and functions part there.

mod meshes;

use glam::{DVec2, DVec3};
use hatbox::element::Basis;
use hatbox::io::read_scene;
use hatbox::mesh::{FindingKind, Mesh, Refinement, Topology, diagnose};
use hatbox::scene::{Material, Physics, Scene, Warning};
use hatbox::space::{Continuity, FunctionSpace};
use meshes::{cornell, face, icosphere, room};
use proptest::prelude::*;
use std::collections::{BTreeSet, HashSet};
use std::path::Path;

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn gray(mesh: Mesh) -> Scene {
    Scene::new(mesh, vec![Material::diffuse("gray", 0.5)], Physics::Light, None).expect("a good scene")
}

/// Plates of a metre that face each other 0.1 mm apart above a ground of 100 m were one, without a word, and lit through each other.
#[test]
fn gaps_that_the_size_of_the_scene_closes_are_told() {
    let plates = |gap: f64, ground: f64| {
        let mut mesh = Mesh::default();
        face(&mut mesh, &[at(0., 0., 0.), at(1., 0., 0.), at(1., 1., 0.), at(0., 1., 0.)], 0);
        face(&mut mesh, &[at(0., 0., gap), at(0., 1., gap), at(1., 1., gap), at(1., 0., gap)], 0);
        let g = ground;
        face(&mut mesh, &[at(-g, -g, -1.), at(g, -g, -1.), at(g, g, -1.), at(-g, g, -1.)], 0);
        let told = gray(mesh).warnings;
        told.into_iter().find(|warning| matches!(warning, Warning::ClosedGaps(_)))
    };
    assert_eq!(plates(1e-4, 50.0), Some(Warning::ClosedGaps(4)));
    assert_eq!(plates(1e-4, 5.0), None, "they are two");
    assert_eq!(plates(1e-7, 50.0), None, "that is rounding");
}

/// The square −1…1 at height 0, lit from above.
fn floor() -> Mesh {
    let mut mesh = Mesh::default();
    face(&mut mesh, &[at(-1., -1., 0.), at(1., -1., 0.), at(1., 1., 0.), at(-1., 1., 0.)], 0);
    mesh
}

/// Adds an upright wall over the segment from `from` to `to`.
fn wall(mesh: &mut Mesh, from: [f64; 2], to: [f64; 2], heights: [f64; 2]) {
    let [(a, b), (c, d)] = [from, to].map(|[x, y]| (at(x, y, heights[0]), at(x, y, heights[1])));
    face(mesh, &[a, c, d, b], 0);
}

/// What a file says, welded and conforming.
fn prepared(mesh: &Mesh) -> Mesh {
    mesh.welded(mesh.tolerance()).0.conformed(mesh.tolerance()).0
}

fn split(mesh: &Mesh) -> (Mesh, usize) {
    let mesh = prepared(mesh);
    let (cut, n) = mesh.split_at_contacts(mesh.tolerance());
    assert!((cut.area() - mesh.area()).abs() < 1e-9 * mesh.area(), "{} {}", cut.area(), mesh.area());
    assert_eq!(cut.conformed(mesh.tolerance()).1, 0, "the result is conforming");
    assert_eq!(cut.split_at_contacts(mesh.tolerance()).1, 0, "once is enough");
    (cut, n)
}

/// The length of the edges on the segment from a to b, for the cells that are told.
fn length_of_edges(mesh: &Mesh, [a, b]: [DVec3; 2], of: impl Fn(usize) -> bool) -> f64 {
    let topology = Topology::new(mesh);
    let on = |p: DVec3| (p.distance(a) + p.distance(b) - a.distance(b)).abs() < 1e-9;
    let length = |edge: usize| {
        let [p, q] = topology.vertices(edge).map(|v| mesh.vertices[v as usize]);
        let here = on(p) && on(q) && topology.sides(edge).iter().any(|side| of(side.cell as usize));
        if here { p.distance(q) } else { 0.0 }
    };
    (0..topology.edges()).map(length).sum()
}

/// Whether a cell is horizontal.
fn level(mesh: &Mesh) -> impl Fn(usize) -> bool + '_ {
    |cell| mesh.patch(cell).normal().z.abs() > 0.9
}

/// The unknowns of a continuous basis on each cell.
fn unknowns(scene: &Scene) -> Vec<HashSet<usize>> {
    let continuity = Continuity::named("continuous").expect("a name");
    let space = FunctionSpace::new(scene, Basis::named("linear").expect("linear"), continuity).expect("triangles");
    let c = space.continuity().expect("joined");
    (0..space.cells()).map(|cell| space.range(cell).flat_map(|row| c.row(row).map(|(i, _)| i)).collect()).collect()
}

// --- nothing to do ---

#[test]
fn a_mesh_without_contacts_is_returned_unchanged() {
    for mesh in [room(DVec3::ONE, |_| false), room(at(1.0, 2.3, 0.4), |k| k % 2 == 0), icosphere(0), icosphere(3)] {
        let mesh = prepared(&mesh);
        assert_eq!(mesh.split_at_contacts(mesh.tolerance()), (mesh, 0));
    }
}

#[test]
fn walls_that_end_on_one_another_are_left_as_they_are() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/two-rooms.glb");
    let (scene, _) = read_scene(&path).expect("a sample scene");
    assert!(!scene.warnings.iter().any(|w| matches!(w, Warning::Contacts(_))), "{:?}", scene.warnings);
}

#[test]
fn faces_in_one_plane_do_not_cut_each_other() {
    let mut mesh = floor();
    face(&mut mesh, &[at(0., 0., 0.), at(2., 0., 0.), at(2., 2., 0.), at(0., 2., 0.)], 0);
    face(&mut mesh, &[at(-0.5, -0.5, 0.), at(-0.5, 0.5, 0.), at(0.5, 0., 0.)], 0);
    let mesh = prepared(&mesh);
    assert_eq!(mesh.split_at_contacts(mesh.tolerance()), (mesh, 0));
}

// --- standing ---

/// Whether a point is in the footprint of a polygon.
fn inside(polygon: &[DVec2], p: DVec2) -> bool {
    let turns = |k: usize| (polygon[(k + 1) % polygon.len()] - polygon[k]).perp_dot(p - polygon[k]) > 0.0;
    (0..polygon.len()).all(turns) || (0..polygon.len()).all(|k| !turns(k))
}

/// The feet of the two blocks of the Cornell box, in its floor's coordinates.
fn footprints(mesh: &Mesh) -> Vec<Vec<DVec2>> {
    let blocks = [
        [[130., 65.], [82., 225.], [240., 272.], [290., 114.]],
        [[423., 247.], [265., 296.], [314., 456.], [472., 406.]],
    ];
    let found = |p: DVec2| mesh.vertices.iter().any(|v| v.y.abs() < 1e-9 && DVec2::new(v.x, v.z).distance(p) < 1e-6);
    let feet: Vec<Vec<DVec2>> = blocks.iter().map(|b| b.map(|p| DVec2::from(p) * 0.001).to_vec()).collect();
    assert!(feet.iter().flatten().all(|&p| found(p)), "the blocks are where they are expected");
    feet
}

#[test]
fn the_floor_of_the_cornell_box_has_edges_where_the_blocks_stand() {
    let mesh = cornell();
    let feet = footprints(&mesh);
    let area = mesh.area();
    let scene = gray(mesh);
    assert!(scene.warnings.iter().any(|w| matches!(w, Warning::Contacts(2))), "{:?}", scene.warnings);
    assert!((scene.mesh.area() - area).abs() < 1e-9 * area);
    for refinement in [Refinement::None, Refinement::Elements(1500)] {
        let fine = scene.refined(refinement, Basis::named("linear").expect("linear")).expect("refined");
        let mesh = &fine.mesh;
        let unknowns = unknowns(&fine);
        let (mut under, mut beside) = (HashSet::<usize>::new(), HashSet::<usize>::new());
        for cell in (0..mesh.cells.len()).filter(|&c| mesh.patch(c).center().y.abs() < 1e-9) {
            let patch = mesh.patch(cell);
            let flat = |p: DVec3| DVec2::new(p.x, p.z);
            let covered = |p: DVec3| feet.iter().any(|foot| inside(foot, flat(p)));
            let center = patch.center();
            // Corners may lie on the line; points just inside them may not be on its other side.
            let near = patch.corners().iter().map(|&p| p.lerp(center, 1e-6));
            assert!(near.map(covered).all(|c| c == covered(center)), "a cell at {center} is partly covered");
            if covered(center) { &mut under } else { &mut beside }.extend(&unknowns[cell]);
        }
        assert!(!under.is_empty() && under.is_disjoint(&beside));
        // The blocks' sides share their feet with the floor.
        let topology = Topology::new(mesh);
        for foot in &feet {
            for k in 0..4 {
                let ends = [foot[k], foot[(k + 1) % 4]].map(|p| at(p.x, 0.0, p.y));
                let whole = ends[0].distance(ends[1]);
                let upright = |cell: usize| mesh.patch(cell).normal().y.abs() < 0.1;
                let flat = |cell: usize| !upright(cell);
                assert!((length_of_edges(mesh, ends, upright) - whole).abs() < 1e-6);
                assert!((length_of_edges(mesh, ends, flat) - whole).abs() < 1e-6);
            }
        }
        assert!((0..topology.edges()).filter(|&e| topology.sides(e).len() == 3).count() >= 8);
    }
}

#[test]
fn a_wall_is_cut_into_the_floor_as_far_as_it_stands_on_it() {
    let ends_inside = ([-0.5, 0.1], [0.4, -0.3]);
    let ends_outside = ([-3.0, 0.25], [2.0, 0.25]);
    let half = ([0.0, 0.0], [0.0, 5.0]);
    let visible =
        |(from, to): ([f64; 2], [f64; 2])| [from, to].map(|[x, y]| at(x.clamp(-1., 1.), y.clamp(-1., 1.), 0.));
    for (k, foot) in [ends_inside, ends_outside, half].into_iter().enumerate() {
        for (heights, cut) in [([0.0, 1.0], 1), ([-1.0, 0.0], 1), ([-0.5, 0.5], 2)] {
            let mut mesh = floor();
            wall(&mut mesh, foot.0, foot.1, heights);
            let (mesh, n) = split(&mesh);
            let line = visible(foot);
            assert_eq!(n, cut, "{k} {heights:?}");
            for floor in [false, true] {
                let length = length_of_edges(&mesh, line, |cell| level(&mesh)(cell) == floor);
                assert!((length - line[0].distance(line[1])).abs() < 1e-9, "{k} {heights:?} {length}");
            }
        }
    }
}

#[test]
fn feet_that_cross_or_overlap_share_their_point() {
    let mut mesh = floor();
    wall(&mut mesh, [-0.5, -0.5], [0.5, 0.5], [0.0, 1.0]);
    wall(&mut mesh, [-0.5, 0.4], [0.5, -0.5], [0.0, 0.7]);
    // Along the first one, and with its end on the second.
    wall(&mut mesh, [0.2, 0.2], [0.7, 0.7], [-0.5, 0.0]);
    wall(&mut mesh, [0.0, -0.05], [0.9, -0.05], [0.0, 0.2]);
    let (mesh, n) = split(&mesh);
    assert_eq!(n, 5, "the floor, the first wall and the three parts of the second, which has a T-junction");
    for (from, to) in [([-0.5, -0.5], [0.7, 0.7]), ([-0.5, 0.4], [0.5, -0.5]), ([0.0, -0.05], [0.9, -0.05])] {
        let line = [from, to].map(|[x, y]: [f64; 2]| at(x, y, 0.0));
        let length = length_of_edges(&mesh, line, level(&mesh));
        assert!((length - line[0].distance(line[1])).abs() < 1e-9, "{length}");
    }
}

#[test]
fn texture_coordinates_and_normals_are_interpolated() {
    let mut mesh = floor();
    wall(&mut mesh, [-0.5, 0.1], [0.4, -0.3], [-0.5, 0.5]);
    mesh.uvs = mesh.cells.iter().map(|c| c.vertices.map(|v| mesh.vertices[v as usize].truncate())).collect();
    mesh.normals = vec![[DVec3::Z; 4], [at(0.4, 0.9, 0.0).normalize(); 4]];
    let (mesh, _) = split(&mesh);
    for (k, cell) in mesh.cells.iter().enumerate() {
        for (corner, &v) in cell.corners().iter().enumerate() {
            assert!(mesh.uvs[k][corner].distance(mesh.vertices[v as usize].truncate()) < 1e-12);
            assert!(mesh.normals[k][corner].is_normalized());
        }
    }
}

/// The feet of a table are small, and the floor around them is large: its triangles were needles from a foot to the far
/// walls, and streaked the floor with light. Next to lines some angles are sharp, but few.
#[test]
fn small_feet_leave_no_needles_on_a_large_floor() {
    let (cut, _) = split(&table(0.03));
    let is_level = level(&cut);
    let sine = |cell: usize| {
        let corners: Vec<DVec3> = cut.patch(cell).corners().to_vec();
        let at = |k: usize| {
            let [u, v] = [1, 2].map(|j| (corners[(k + j) % 3] - corners[k]).normalize());
            u.cross(v).length()
        };
        (0..3).map(at).fold(1.0, f64::min)
    };
    let cells: Vec<usize> = (0..cut.cells.len()).filter(|&cell| is_level(cell)).collect();
    let sines: Vec<f64> = cells.iter().map(|&cell| sine(cell)).collect();
    let (least, sharp) = (sines.iter().copied().fold(1.0, f64::min), sines.iter().filter(|&&sine| sine < 0.26).count());
    assert!(least > 0.1 && 10 * sharp < cells.len(), "{least}, {sharp} of {} triangles", cells.len());
}

/// Around feet of some tolerances no triangles are made that are as small: the floor has its own corners and theirs.
#[test]
fn hardly_any_feet_add_nothing_to_a_floor() {
    for (edge, adds) in [(0.003, true), (1e-4, false)] {
        let (cut, _) = split(&table(edge));
        let is_level = level(&cut);
        let on_floor = (0..cut.cells.len()).filter(|&cell| is_level(cell)).flat_map(|cell| cut.cells[cell].corners());
        let corners: BTreeSet<u32> = on_floor.copied().collect();
        assert_eq!(corners.len() > 4 + 16, adds, "{} corners", corners.len());
    }
}

/// A floor on which a table stands with four square feet.
fn table(edge: f64) -> Mesh {
    let mut mesh = floor();
    for [x, y] in [[-0.4, -0.3], [0.5, -0.3], [0.5, 0.4], [-0.4, 0.4]] {
        let [u, v] = [x + edge, y + edge];
        for (from, to) in [([x, y], [u, y]), ([u, y], [u, v]), ([u, v], [x, v]), ([x, v], [x, y])] {
            wall(&mut mesh, from, to, [0.0, 0.7]);
        }
    }
    mesh
}

#[test]
fn a_hundred_blades_of_grass_stand_on_one_floor() {
    let mut mesh = floor();
    for i in 0..100 {
        let (x, y) = (f64::from(i % 10) / 5.0 - 0.9, f64::from(i / 10) / 5.0 - 0.9);
        let (sine, cosine) = f64::from(i).sin_cos();
        wall(&mut mesh, [x, y], [x + 0.07 * cosine, y + 0.07 * sine], [0.0, 0.3]);
    }
    let (cut, n) = split(&mesh);
    assert_eq!(n, 1);
    let topology = Topology::new(&cut);
    let shared = (0..topology.edges()).filter(|&e| topology.sides(e).len() == 3).map(|e| {
        let [a, b] = topology.vertices(e).map(|v| cut.vertices[v as usize]);
        a.distance(b)
    });
    assert!((shared.sum::<f64>() - 7.0).abs() < 1e-9);
}

// --- passing through ---

#[test]
fn sheets_that_cross_are_both_cut() {
    let mut mesh = floor();
    wall(&mut mesh, [0.0, -1.0], [0.0, 1.0], [-1.0, 1.0]);
    let (cut, n) = split(&mesh);
    assert_eq!(n, 2);
    let line = [at(0., -1., 0.), at(0., 1., 0.)];
    for floor in [false, true] {
        assert!((length_of_edges(&cut, line, |c| level(&cut)(c) == floor) - 2.0).abs() < 1e-9);
    }
    // Each side of each is two halves, and light jumps from one to the other.
    let sheet = Material { two_sided: true, ..Material::diffuse("sheet", 0.5) };
    let scene = Scene::new(mesh, vec![sheet], Physics::Light, None).expect("a good scene");
    assert_eq!(scene.mesh.cells.len(), 2 * cut.cells.len());
    for (a, b) in pairs(&unknowns(&scene)) {
        let (p, q) = (scene.mesh.patch(a).center(), scene.mesh.patch(b).center());
        assert!(p.x * q.x >= 0.0 && p.z * q.z >= 0.0, "{p} and {q} are joined");
    }
}

/// The pairs of cells that share an unknown.
fn pairs(unknowns: &[HashSet<usize>]) -> Vec<(usize, usize)> {
    let joined = |a: usize, b: usize| !unknowns[a].is_disjoint(&unknowns[b]);
    (0..unknowns.len()).flat_map(|a| (0..a).map(move |b| (a, b))).filter(|&(a, b)| joined(a, b)).collect()
}

#[test]
fn light_jumps_only_on_the_side_where_something_stands() {
    for (heights, parted) in [([0.0, 1.0], true), ([-1.0, 0.0], false), ([-0.5, 0.5], true)] {
        let mut mesh = floor();
        wall(&mut mesh, [0.0, -1.0], [0.0, 1.0], heights);
        let basis = Basis::named("linear").expect("linear");
        let scene = gray(mesh).refined(Refinement::MaxEdge(0.5), basis).expect("refined");
        let joined = pairs(&unknowns(&scene)).into_iter().any(|(a, b)| {
            let on_floor = level(&scene.mesh)(a) && level(&scene.mesh)(b);
            on_floor && scene.mesh.patch(a).center().x * scene.mesh.patch(b).center().x < 0.0
        });
        assert_eq!(joined, !parted, "{heights:?}");
    }
}

#[test]
fn a_cut_that_ends_in_a_cell_is_walked_around() {
    // The hats at the ends of a short foot are one all around it; in its middle there are two.
    let mut mesh = floor();
    wall(&mut mesh, [-0.5, 0.1], [0.5, 0.1], [0.0, 1.0]);
    let basis = Basis::named("linear").expect("linear");
    let scene = gray(mesh).refined(Refinement::MaxEdge(0.6), basis).expect("refined");
    let mesh = &scene.mesh;
    let unknowns = unknowns(&scene);
    let floor = (0..mesh.cells.len()).filter(|&c| level(mesh)(c));
    let hats: HashSet<usize> = floor.clone().flat_map(|c| unknowns[c].iter().copied()).collect();
    let vertices: HashSet<u32> = floor.flat_map(|c| mesh.cells[c].corners().iter().copied()).collect();
    let strictly_on = |v: &&u32| {
        let p = mesh.vertices[**v as usize];
        (p.y - 0.1).abs() < 1e-9 && p.x.abs() < 0.5 - 1e-9
    };
    let twice = vertices.iter().filter(strictly_on).count();
    assert!(twice > 0);
    assert_eq!(hats.len(), vertices.len() + twice);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn random_soups_are_cut_wherever_they_cross(coordinates in prop::collection::vec(-1.0..1.0_f64, 9 * 8)) {
        let points: Vec<DVec3> = coordinates.chunks_exact(3).map(DVec3::from_slice).collect();
        let mut mesh = Mesh::default();
        points.chunks_exact(3).for_each(|corners| face(&mut mesh, corners, 0));
        let mesh = prepared(&mesh);
        let (cut, _) = mesh.split_at_contacts(mesh.tolerance());
        prop_assert!((cut.area() - mesh.area()).abs() < 1e-4 * mesh.area());
        prop_assert_eq!(cut.conformed(mesh.tolerance()).1, 0);
        // Nothing crosses any more.
        prop_assert!(diagnose(&cut).iter().all(|finding| finding.kind != FindingKind::Intersecting));
    }
}

//! Mistakes in meshes are found, and what is sound is not called a mistake.

mod meshes;

use glam::DVec3;
use hatbox::mesh::{FindingKind, Mesh, Severity, diagnose, diagnose_room, diagnose_sheets};
use meshes::{CUBE, cornell, face, icosphere, room};

fn findings(mesh: &Mesh) -> Vec<(FindingKind, usize)> {
    diagnose(mesh).into_iter().map(|finding| (finding.kind, finding.count)).collect()
}

#[test]
fn sound_meshes_have_no_findings() {
    assert_eq!(findings(&room(DVec3::ONE, |k| k % 2 == 0)), []);
    assert_eq!(findings(&icosphere(2)), []);
}

#[test]
fn a_room_whose_faces_look_outwards_is_inside_out_and_a_body_is_not() {
    let kinds = |mesh: &Mesh| diagnose_room(mesh, |_| false).iter().map(|f| (f.kind, f.count)).collect::<Vec<_>>();
    let mut inside_out = room(DVec3::ONE, |_| false);
    assert_eq!(kinds(&inside_out), []);
    inside_out.cells.iter_mut().for_each(|cell| cell.vertices.reverse());
    assert_eq!(kinds(&inside_out), [(FindingKind::InsideOut, 6)]);
    assert!(diagnose_room(&inside_out, |_| true).is_empty(), "both sides are lit");
    assert_eq!(findings(&inside_out), [], "as a body it is sound");
    // Furniture in a room looks outwards, and so it should.
    let mut furnished = room(DVec3::splat(3.0), |_| false);
    let vertices = furnished.vertices.len() as u32;
    furnished.vertices.extend(inside_out.vertices.iter().map(|v| *v * 0.5 + DVec3::ONE));
    furnished.cells.extend(inside_out.cells.iter().map(|cell| {
        let mut cell = *cell;
        cell.vertices = cell.vertices.map(|v| v + vertices);
        cell
    }));
    assert_eq!(kinds(&furnished), []);
}

#[test]
fn the_cornell_box_has_an_open_front_and_boxes_on_its_floor() {
    // The open front and the two boxes without bottoms.
    assert_eq!(findings(&cornell()), [(FindingKind::OpenEdge, 4 + 2 * 4)]);
}

#[test]
fn a_flipped_face_is_told_from_a_room_that_faces_inwards() {
    let mut mesh = room(DVec3::ONE, |_| false);
    mesh.cells[4].vertices.reverse();
    let found = diagnose(&mesh);
    assert_eq!(found.len(), 1);
    assert_eq!((found[0].kind, found[0].count, found[0].examples[0].cell), (FindingKind::Flipped, 1, 4));
    assert!(found[0].to_string().starts_with("1 face is turned against its neighbours (first: face 4"), "{}", found[0]);
    assert_eq!(found[0].examples[0].group, "part");
    assert!(found[0].to_string().contains("face 4 of `part`, at 0.0000 0.5000 0.5000 m"), "{}", found[0]);
    assert!(diagnose_sheets(&mesh, |_| true).is_empty());
}

#[test]
fn a_bow_tie_crosses_itself_and_an_arrow_does_not() {
    let quad = |corners: [(f64, f64); 4]| {
        let mut mesh = Mesh::default();
        face(&mut mesh, &corners.map(|(x, y)| DVec3::new(x, y, 0.0)), 0);
        findings(&mesh).into_iter().find(|(kind, _)| *kind == FindingKind::SelfCrossing)
    };
    assert_eq!(quad([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]), Some((FindingKind::SelfCrossing, 1)));
    assert_eq!(quad([(0.0, 0.0), (2.0, -1.0), (1.0, 0.0), (2.0, 1.0)]), None, "an arrow");
    assert_eq!(quad([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]), None);
}

#[test]
fn a_missing_wall_opens_four_edges_and_a_t_junction_none() {
    let mut mesh = room(DVec3::ONE, |_| false);
    mesh.cells.pop();
    assert_eq!(findings(&mesh), [(FindingKind::OpenEdge, 4)]);
    let [a, b, c, d] = CUBE[5].map(DVec3::from);
    let (m, n) = (a.midpoint(b), c.midpoint(d));
    face(&mut mesh, &[a, m, n, d], 0);
    face(&mut mesh, &[m, b, c, n], 0);
    assert_eq!(findings(&mesh), []);
}

#[test]
fn faces_that_are_there_twice_cross_or_cover_each_other_are_found() {
    let floor = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]].map(DVec3::from);
    let with = |corners: [DVec3; 4]| {
        let mut mesh = Mesh::default();
        face(&mut mesh, &floor, 0);
        face(&mut mesh, &corners, 0);
        let found = findings(&mesh).into_iter().filter(|&(kind, _)| kind != FindingKind::OpenEdge);
        (found.collect::<Vec<_>>(), mesh)
    };
    let turned = |[a, b, c, d]: [DVec3; 4]| [d, c, b, a];
    let (found, sheet) = with(turned(floor));
    assert_eq!(found, [(FindingKind::BackToBack, 1)]);
    assert_eq!(diagnose_sheets(&sheet, |_| true)[0].kind, FindingKind::Duplicate);
    assert_eq!(with(floor).0, [(FindingKind::Duplicate, 1)]);
    let half = floor.map(|p| p + DVec3::X * 0.5);
    assert_eq!(with(half).0, [(FindingKind::Overlapping, 1)]);
    assert_eq!(with(turned(half)).0, [(FindingKind::Covering, 1)]);
    assert_eq!(with(floor.map(|p| p + DVec3::X)).0, []);
    // A wall across the floor's middle, through its diagonal too; and one that stands on it.
    let wall = |z: f64| [[0.2, 0.5, z], [0.8, 0.5, z], [0.8, 0.5, z + 1.0], [0.2, 0.5, z + 1.0]].map(DVec3::from);
    assert_eq!(with(wall(-0.5)).0, [(FindingKind::Intersecting, 1)]);
    assert_eq!(with(wall(0.0)).0, []);
    assert_eq!(with(wall(0.1)).0, []);
}

#[test]
fn damaged_and_oddly_sized_meshes_are_diagnosed_all_the_same() {
    let mut mesh = room(DVec3::splat(2000.0), |_| false);
    mesh.cells[0].vertices[1] = 1_000_000;
    mesh.vertices[4].x = f64::NAN;
    mesh.cells[2].vertices[1] = mesh.cells[2].vertices[0];
    mesh.cells[2].vertices[3] = mesh.cells[2].vertices[2];
    let kinds: Vec<_> = findings(&mesh).into_iter().map(|(kind, _)| kind).collect();
    let expected = [
        FindingKind::BadIndex,
        FindingKind::NotFinite,
        FindingKind::Degenerate,
        FindingKind::Large,
        FindingKind::OpenEdge,
    ];
    assert_eq!(kinds, expected);
    assert_eq!(kinds[0].severity(), Severity::Error);
    assert_eq!(findings(&room(DVec3::splat(0.001), |_| true)), [(FindingKind::Small, 1)]);
    assert_eq!(findings(&Mesh::default()), []);
}

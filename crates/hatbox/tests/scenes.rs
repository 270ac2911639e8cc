//! Whole scenes: the Cornell box against a path tracer, and two rooms with a door.

use glam::DVec3;
use hatbox::element::ALL;
use hatbox::io::read_scene;
use hatbox::linalg::MultiVector;
use hatbox::mesh::Refinement;
use hatbox::probe::Probe;
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, Solved, solve};
use std::path::Path;

fn solved(path: &str, options: &Options) -> Solved {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    let (scene, _) = read_scene(&path).expect("a sample scene");
    solve(&scene, options, &Silent).expect("solved")
}

/// 6010 points with the irradiance of an unbiased path tracer, whose own relative L2 noise is 0.18 %.
#[test]
fn the_cornell_box_agrees_with_a_path_tracer() {
    let options =
        Options { basis: &ALL[3], refinement: Refinement::Elements(500), error_points: 0, ..Options::default() };
    let solved = solved("tests/data/cornell.obj", &options);
    let table = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/cornell_irradiance.csv"))
        .expect("the reference");
    let rows: Vec<Vec<f64>> =
        table.lines().skip(1).map(|line| line.split(',').map(|x| x.parse().expect("a number")).collect()).collect();
    assert_eq!(rows.len(), 6010);
    let points: Vec<_> = rows.iter().map(|r| (DVec3::new(r[0], r[1], r[2]), DVec3::new(r[3], r[4], r[5]))).collect();
    let relative = |found: &MultiVector| {
        let (mut error, mut norm) = (0.0, 0.0);
        for (k, row) in rows.iter().enumerate() {
            let (area, reference) = (row[6], &row[8..11]);
            for (band, b) in reference.iter().enumerate() {
                error += area * (found.band(band)[k] - b).powi(2);
                norm += area * b * b;
            }
        }
        (error / norm).sqrt()
    };
    let probe = Probe::new(&solved.solution);
    let plain = relative(&probe.values(&points).irradiance);
    assert!(plain < 0.015, "relative L2 error of the irradiance: {plain}");
    let direct = probe.values_with_direct_light(&points, 0, &Silent).expect("nobody stops it");
    let direct = relative(&direct.irradiance);
    assert!(direct < 0.5 * plain, "with the light of the lamp at each point: {direct} after {plain}");
}

/// What S loses through the open front is what rays see leave.
#[test]
fn the_row_sums_of_an_open_scene_lose_what_rays_see_escape() {
    let options = Options { refinement: Refinement::Elements(600), error_points: 0, ..Options::default() };
    let closure = solved("tests/data/cornell.obj", &options).closure;
    assert!((closure.escape - closure.lost).abs() < 0.005, "{closure:?}");
    assert!(!closure.balanced);
}

fn two_rooms(file: &str) -> Solved {
    let options = Options { refinement: Refinement::Elements(900), error_points: 0, ..Options::default() };
    solved(file, &options)
}

/// Least and greatest irradiance over the nodes of the cells beyond the dividing wall, seen from the lamp, and before it.
fn irradiance_beyond(solved: &Solved) -> ([f64; 2], [f64; 2]) {
    let solution = &solved.solution;
    let mesh = &solution.scene.mesh;
    let (lo, hi) = mesh.bounds();
    let side = |cell: usize| mesh.patch(cell).center().x - f64::midpoint(lo.x, hi.x);
    let lamp = (0..mesh.cells.len()).find(|&cell| !solution.scene.material(cell).exitance.is_zero()).expect("a lamp");
    let mut ranges = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    // Cells of the doorway itself belong to neither room.
    for cell in (0..mesh.cells.len()).filter(|&cell| side(cell).abs() > 0.05 * (hi.x - lo.x)) {
        let range = &mut ranges[usize::from(side(cell) * side(lamp) > 0.0)];
        for &e in &solution.irradiance.band(0)[solution.space.range(cell)] {
            *range = [range[0].min(e), range[1].max(e)];
        }
    }
    (ranges[0], ranges[1])
}

#[test]
fn with_the_door_walled_up_the_far_room_is_exactly_dark() {
    let (far, near) = irradiance_beyond(&two_rooms("../../scenes/two-rooms-walled.glb"));
    assert!(near[1] > 0.0, "the first room is lit: {near:?}");
    assert!(far.iter().all(|&e| e == 0.0), "the second is not: {far:?}");
}

#[test]
fn through_an_open_door_the_far_room_is_lit() {
    let solved = two_rooms("../../scenes/two-rooms.glb");
    let (far, near) = irradiance_beyond(&solved);
    assert!(far[1] > 0.0 && far[1] < near[1], "{far:?} {near:?}");
    assert!(solved.closure.balanced, "the rooms are closed: {:?}", solved.closure);
    assert!(solved.energy.escaped[0].abs() < 1e-9 * solved.energy.emitted[0], "{:?}", solved.energy);
}

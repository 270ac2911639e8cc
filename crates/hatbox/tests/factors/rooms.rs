//! Closed rooms, all of whose light arrives somewhere.

use crate::meshes::rooms::{Corners, cuboid, divided, l_room, outwards, scene};
use crate::meshes::{face, icosphere, room};
use crate::random::Random;
use glam::{DQuat, DVec3};
use hatbox::progress::Silent;
use hatbox::scene::Scene;
use hatbox::view_factors::{Options, ViewFactors};
use proptest::prelude::*;

fn factors(scene: &Scene, tolerance: f64) -> ViewFactors {
    ViewFactors::new(scene, &Options { tolerance, ..Options::default() }, &Silent).expect("few elements")
}

fn moved(faces: &[Corners]) -> Vec<Corners> {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, -2.0, 0.7).normalize(), 0.9);
    faces.iter().map(|corners| corners.map(|p| turn * (p * DVec3::new(1.0, 1.3, 0.8)) + DVec3::splat(3.0))).collect()
}

/// A box of a room and of things in it that touch nothing.
fn furnished(things: &[[[f64; 3]; 2]]) -> Vec<Corners> {
    let mut faces = cuboid(DVec3::ZERO, DVec3::new(2.0, 1.5, 1.0));
    for [from, to] in things {
        faces.extend(outwards(cuboid(DVec3::from(*from), DVec3::from(*to))));
    }
    faces
}

/// A table: a top on two boards.
fn table() -> Vec<Corners> {
    furnished(&[
        [[0.5, 0.4, 0.5], [1.5, 1.1, 0.55]],
        [[0.6, 0.5, 0.02], [0.65, 1.0, 0.48]],
        [[1.35, 0.5, 0.02], [1.4, 1.0, 0.48]],
    ])
}

/// Boxes at random places of a grid, so that they do not go through each other.
fn boxes(seed: u64) -> Vec<Corners> {
    let mut random = Random::new(seed);
    let mut thing = |k: usize| {
        let cell = [0.65 * (k % 3) as f64, 0.7 * (k / 3) as f64, 0.0];
        let from: [f64; 3] = cell.map(|c| c + random.uniform(0.05, 0.3));
        [from, from.map(|c| c + random.uniform(0.05, 0.3))]
    };
    furnished(&[0, 2, 4, 5].map(&mut thing))
}

#[test]
fn the_rows_of_furnished_rooms_sum_to_one() {
    assert_rows(&[("L", l_room(), 3), ("table", table(), 2), ("boxes", boxes(1), 2), ("more boxes", boxes(2), 2)]);
}

#[test]
#[ignore = "a minute, for finer meshes: cargo test --release -p hatbox --test factors -- --ignored finely"]
fn the_rows_of_finely_furnished_rooms_sum_to_one() {
    assert_rows(&[("L", l_room(), 6), ("table", table(), 4), ("boxes", boxes(1), 4), ("more boxes", boxes(2), 4)]);
}

/// Between the walls are more faces than are cut out of a view. Rows were off by more than was said, and than was asked for.
#[test]
fn walls_that_look_past_a_ball_have_the_factors_that_were_asked_for() {
    let mut mesh = room(DVec3::ONE, |_| false);
    let ball = icosphere(2);
    for cell in &ball.cells {
        let corners = cell.corners().iter().map(|&v| DVec3::new(0.5, 0.45, 0.4) + 0.3 * ball.vertices[v as usize]);
        face(&mut mesh, &corners.collect::<Vec<_>>(), 0);
    }
    let scene = scene(mesh);
    for (tolerance, seed) in [1e-2, 1e-3].into_iter().flat_map(|t| (0..8).map(move |seed| (t, seed))) {
        let options = Options { tolerance, seed, ..Options::default() };
        let found = ViewFactors::new(&scene, &options, &Silent).expect("few elements");
        let (error, estimate) = (found.check().max_row_sum_error, found.statistics.error());
        assert!(found.is_closed() && found.is_reached(), "{tolerance} {seed}: {:?}", found.statistics);
        assert!(error <= estimate, "{tolerance} {seed}: {error}, estimated {estimate}");
    }
    let found = factors(&scene, 1e-5);
    assert!(!found.is_reached(), "rays do not go so far, and it says so: {}", found.statistics.error());
}

/// A view past an edge that two walls share is clear, or each of them is seen to hide what the other does.
#[test]
fn the_estimate_of_an_l_shaped_room_follows_the_tolerance() {
    for digits in 3..=6 {
        let tolerance = 0.1_f64.powi(digits);
        let found = factors(&divided(&l_room(), 3), tolerance);
        let (estimate, error) = (found.statistics.quadrature_error, found.check().max_row_sum_error);
        assert!(error < estimate && estimate < 2.0 * tolerance, "{tolerance}: {estimate}, {error}");
    }
}

/// Every row of rooms divided n times sums to one, to the tolerance and to the estimate.
fn assert_rows(rooms: &[(&str, Vec<Corners>, usize)]) {
    for (name, faces, n) in rooms {
        let scene = divided(faces, *n);
        for tolerance in [1e-2, 1e-3] {
            let found = factors(&scene, tolerance);
            assert!(found.is_closed(), "{name}: {}", found.escape);
            let error = found.check().max_row_sum_error;
            assert!(error <= tolerance, "{name} at {tolerance:e}: {error:e}");
            let worst = found.statistics.error();
            assert!(error <= worst + 1e-12, "{name} at {tolerance:e}: {error:e}, estimated {worst:e}");
        }
    }
}

#[test]
fn the_rows_of_a_convex_room_at_any_angle_are_exact() {
    let scene = divided(&moved(&cuboid(DVec3::ZERO, DVec3::ONE)), 3);
    for tolerance in [1e-2, 1e-4, 1e-6, 1e-8] {
        let found = factors(&scene, tolerance);
        let error = found.check().max_row_sum_error;
        assert!(error <= tolerance && error <= found.statistics.error() + 1e-13, "{tolerance:e}: {error:e}");
        assert_eq!(found.statistics.clear_pairs, found.statistics.pairs);
    }
}

/// A box from a corner, every face one element.
fn assert_box_closes(size: [f64; 3], tolerance: f64) {
    let found = factors(&divided(&cuboid(DVec3::ZERO, DVec3::from(size)), 1), tolerance);
    let error = found.check().max_row_sum_error;
    assert!(error <= tolerance && error <= found.statistics.error() + 1e-13, "{size:?} at {tolerance:e}: {error:e}");
}

#[test]
fn long_rectangles_that_touch_meet_the_tolerance() {
    assert_box_closes([3.0, 0.5, 0.25], 1e-2);
    assert_box_closes([2.0, 5.0, 1.300_781_25], 1e-5);
}

/// Two rules agreed about long edges close to each other and were both wrong.
#[test]
fn flat_boxes_err_by_no_more_than_they_say() {
    assert_box_closes([4.144_016_317_844_197, 3.273_892_140_343_914, 0.215_526_360_613_906], 1e-2);
    assert_box_closes([2.425_008_590_649_693, 0.2, 3.635_994_678_509_621_5], 1e-2);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn boxes_of_any_shape_close(size in prop::array::uniform3(0.2..5.0_f64), digits in 2..=6) {
        assert_box_closes(size, 0.1_f64.powi(digits));
    }
}

#[test]
fn a_row_is_its_pairs() {
    let found = factors(&divided(&boxes(1), 3), 1e-2);
    for i in 0..found.len() {
        for (j, factor) in found.row(i).enumerate() {
            assert_eq!(factor.to_bits(), found.get(i, j).to_bits(), "{i} {j}");
        }
        assert!(found.nonzeros(i).all(|(j, factor)| factor.to_bits() == found.get(i, j).to_bits() && factor != 0.0));
    }
}

#[test]
fn all_rows_together_are_the_rows_one_by_one() {
    // More rows than are made at a time.
    let found = factors(&divided(&boxes(1), 8), 1e-2);
    assert!(found.len() > 512);
    let rows: Vec<(usize, Vec<f64>)> = found.map_rows(|i, row| (i, row.to_vec())).collect();
    let entries: Vec<(usize, Vec<(u32, f64)>)> = found.map_nonzeros(|i, row| (i, row.to_vec())).collect();
    assert_eq!((rows.len(), entries.len()), (found.len(), found.len()));
    for (i, (row, entries)) in rows.into_iter().zip(entries).enumerate() {
        assert_eq!(row, (i, found.row(i).collect()));
        assert_eq!(entries, (i, found.nonzeros(i).map(|(j, factor)| (j as u32, factor)).collect()));
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let scene = divided(&boxes(1), 3);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let found = factors(&scene, 1e-2);
            let bits: Vec<u64> =
                (0..found.len()).flat_map(|i| found.row(i).map(f64::to_bits).collect::<Vec<_>>()).collect();
            (bits, found.statistics)
        })
    };
    let one = on(1);
    for threads in [2, 3] {
        assert!(on(threads) == one, "{threads} threads");
    }
}

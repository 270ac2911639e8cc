//! Every instruction set and the packets against the triangles one by one, on everything that is awkward.

use super::exact::{Crossing, Line};
use super::tests::{Numbers, ids, segment, soup};
use super::*;

/// All trees of the same triangles.
fn trees(triangles: &[[DVec3; 3]]) -> Vec<Bvh> {
    let tree = Bvh::new(triangles, &ids(triangles));
    InstructionSet::ALL.map(|set| tree.clone().restricted_to(set)).into()
}

/// The first crossing, by exact tests of all triangles.
fn first_of_all(triangles: &[[DVec3; 3]], origin: DVec3, direction: DVec3, end: f64) -> Option<Hit> {
    let ray = Ray::open(&Line::new(origin, direction), end)?;
    let crossing = |(index, &corners): (usize, &[DVec3; 3])| {
        let triangle = Triangle { corners, index: index as u32, id: index as u32 };
        let Crossing { edges, sum, t } = ray.cross(&triangle)?;
        let hit = Hit {
            t,
            triangle: triangle.index,
            id: triangle.id,
            front: ray.sees_front(sum),
            barycentric: [edges[1] / sum, edges[2] / sum],
        };
        ray.counts(&triangle, t).then_some(hit)
    };
    let hits = triangles.iter().enumerate().filter_map(crossing);
    hits.min_by(|a, b| a.t.total_cmp(&b.t).then(a.triangle.cmp(&b.triangle)))
}

/// Coordinates on a grid, so that corners, edges and planes coincide, with rays along axes and in planes.
fn grid(count: usize, numbers: &mut Numbers) -> Vec<[DVec3; 3]> {
    let mut point = || (numbers.point() * 4.0).round() * 0.25;
    (0..count).map(|_| [point(), point(), point()]).collect()
}

/// Needles down to the width of rounding, points, and pairs of triangles at an edge.
fn slivers(count: usize, numbers: &mut Numbers) -> Vec<[DVec3; 3]> {
    let mut triangles = Vec::new();
    while triangles.len() < count {
        let (a, u, v) = (numbers.point(), numbers.point(), numbers.point());
        let width = 10.0_f64.powi(-(numbers.below(22) as i32));
        let length = 10.0_f64.powi(-(numbers.below(18) as i32));
        let (b, c) = (a + u * length, a + u * (length * numbers.next()) + v * (length * width));
        let d = b + v * length;
        triangles.extend([[a, b, c], [c, b, d], [a, a + u * (length * width), b]]);
    }
    triangles.truncate(count);
    triangles
}

/// Compares all ways to ask about sixteen segments.
fn compare(triangles: &[[DVec3; 3]], trees: &[Bvh], ends: &[[DVec3; 2]], skip: [u32; 2]) -> u32 {
    let reference = BruteForce::new(triangles, &ids(triangles));
    let (from, to): (Vec<_>, Vec<_>) = ends.iter().map(|&[from, to]| (from, to)).unzip();
    let expected = reference.occluded_packet(&from, &to, skip);
    for tree in trees {
        let set = tree.instruction_set();
        assert_eq!(tree.occluded_packet(&from, &to, skip), expected, "{set:?} {from:?} {to:?} {skip:?}");
        for (k, &[from, to]) in ends.iter().enumerate() {
            assert_eq!(u32::from(tree.occluded(from, to, skip)), expected >> k & 1, "{set:?} {from} {to} {skip:?}");
            let end = if k % 2 == 0 { 1.0 } else { f64::INFINITY };
            let hit = tree.closest_hit(from, to - from, end, |_, _| true);
            assert_eq!(hit, first_of_all(triangles, from, to - from, end), "{set:?} {from} {to}");
        }
    }
    expected.count_ones()
}

/// Sixteen segments from about one place to about another.
fn bundle(triangles: &[[DVec3; 3]], numbers: &mut Numbers, place: impl Fn(DVec3) -> DVec3) -> Vec<[DVec3; 2]> {
    let (from, to) = segment(triangles, numbers);
    let width = [0.0, 1e-9, 1e-3, 0.1, 1.0][numbers.below(5)];
    let count = 1 + numbers.below(16);
    let ends = (0..count).map(|_| [from + numbers.point() * width, to + numbers.point() * width].map(&place));
    ends.collect()
}

/// Runs `rounds` of sixteen segments per kind of triangles.
fn fuzz(seed: u64, rounds: usize) {
    let mut numbers = Numbers(seed);
    let mut counts = [0; 2];
    for kind in 0..24 {
        let count = [3, 17, 40, 250][kind % 4];
        let mut local = match kind / 4 % 3 {
            0 => soup(count, &mut numbers),
            1 => grid(count, &mut numbers),
            _ => slivers(count, &mut numbers),
        };
        let (mut scale, mut shift) =
            [(1.0, 0.0), (1e-90, 0.0), (1e60, 0.0), (1.0, 1e6), (1e-3, 1e9), (3.7, -0.1)][numbers.below(6)];
        if kind >= 12 {
            // Such as single precision holds.
            local = local.iter().map(|t| t.map(|p| p.as_vec3().as_dvec3())).collect();
            (scale, shift) = ([1.0, 1.0 / 1024.0, 4096.0][numbers.below(3)], 0.0);
        }
        let place = |p: DVec3| p * scale + DVec3::new(shift, -shift, 0.5 * shift);
        let triangles: Vec<_> = local.iter().map(|t| t.map(place)).collect();
        let trees = trees(&triangles);
        for round in 0..rounds {
            let mut ends = bundle(&local, &mut numbers, place);
            if round % 3 == 0 {
                for ends in &mut ends {
                    let (from, to) = segment(&local, &mut numbers);
                    *ends = [place(from), place(to)];
                }
            }
            let skip = [numbers.below(2 * count) as u32, u32::MAX];
            counts[0] += compare(&triangles, &trees, &ends, skip);
            counts[1] += ends.len() as u32;
        }
    }
    assert!(counts[0] > counts[1] / 20 && counts[0] < counts[1], "{counts:?}");
}

#[test]
fn every_instruction_set_and_packets_agree_with_brute_force() {
    for seed in 0..4 {
        fuzz(seed, 60);
    }
}

/// `cargo test --release -p hatbox --lib -- --ignored ten_million_rays`.
#[test]
#[ignore = "takes a minute"]
fn ten_million_rays() {
    use rayon::prelude::*;
    (0..1000_u64).into_par_iter().for_each(|seed| fuzz(1000 + seed, 50));
}

/// Where the scene is as small as the last place of its coordinates, the center between its corners is rounded, here to
/// one of them. Rays from afar ended on the way to the box around that center.
#[test]
fn a_scene_of_two_roundings_is_not_lost_behind_its_center() {
    let (corner, step) = (DVec3::splat(1e9), f64::EPSILON * f64::from(1 << 29));
    let triangles = [[corner, corner + DVec3::X * step, corner + DVec3::Y * step]];
    assert!(triangles[0][1].x > corner.x && triangles[0][2].y > corner.y);
    let (trees, mut blocked) = (trees(&triangles), 0);
    for k in 0..40 {
        let far = DVec3::new(f64::from(k) * 50.0, 300.0 - f64::from(k), 1e4) * (2.0 * step);
        for target in triangles[0] {
            blocked += compare(&triangles, &trees, &[[target - far, target + far]], [u32::MAX; 2]);
        }
    }
    assert!(blocked > 60, "{blocked} of 120");
}

#[test]
fn rays_from_afar_and_of_any_length_agree() {
    let mut numbers = Numbers(77);
    let triangles = soup(60, &mut numbers);
    let trees = trees(&triangles);
    for _ in 0..2000 {
        let (from, to) = segment(&triangles, &mut numbers);
        let (far, near) = (10.0_f64.powi(numbers.below(60) as i32), 10.0_f64.powi(-(numbers.below(40) as i32)));
        let ends = [[to - (to - from) * far, to + (to - from) * far], [from, from + (to - from) * near]];
        compare(&triangles, &trees, &ends, [1, 2]);
        compare(
            &triangles,
            &trees,
            &[ends[0], [from, to], [to, to], [from, DVec3::NAN], [from, to.with_y(f64::NAN)]],
            [1, 2],
        );
    }
}

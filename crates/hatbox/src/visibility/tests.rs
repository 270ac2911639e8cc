use super::*;
use crate::mesh::polygon::area_vector;
use proptest::prelude::*;

/// A reproducible stream of numbers in [0, 1) (after Steele, Lea and Flood 2014).
pub(super) struct Numbers(pub(super) u64);

impl Numbers {
    pub(super) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
    pub(super) fn point(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }
    pub(super) fn below(&mut self, n: usize) -> usize {
        (self.next() * n as f64) as usize
    }
}

/// Triangles of every kind: small, large, slivers, axis-parallel, sharing corners, without area.
pub(super) fn soup(count: usize, numbers: &mut Numbers) -> Vec<[DVec3; 3]> {
    let mut triangles: Vec<[DVec3; 3]> = Vec::new();
    while triangles.len() < count {
        let (a, size) = (numbers.point(), if triangles.len().is_multiple_of(7) { 1.0 } else { 0.1 });
        let (u, v) = (numbers.point() * size, numbers.point() * size);
        triangles.push(match triangles.len() % 6 {
            0 | 1 => [a, a + u, a + v],
            2 => [a, a + u, a + u * 0.7 + v * 1e-7],
            3 => [a, a + DVec3::X * size, a + DVec3::Y * size],
            4 => {
                let [p, q, _] = triangles[triangles.len() - 1];
                [q, p, a]
            }
            _ => [a, a + u, a + u * 2.0],
        });
    }
    triangles
}

pub(super) fn ids(triangles: &[[DVec3; 3]]) -> Vec<u32> {
    (0..triangles.len() as u32).collect()
}

/// A segment of any kind: anywhere, axis-parallel, through corners or edges, inside a triangle's plane.
pub(super) fn segment(triangles: &[[DVec3; 3]], numbers: &mut Numbers) -> (DVec3, DVec3) {
    let [a, b, c] = triangles[numbers.below(triangles.len())];
    let from = numbers.point() * 1.5;
    match numbers.below(7) {
        0 => (from, from + DVec3::AXES[numbers.below(3)] * 3.0),
        1 => (from, from + (a - from) * 1.5),
        2 => (from, from + (a + (b - a) * numbers.next() - from) * 1.5),
        3 => (a + (b - a) * 0.3 + (c - a) * 0.3, numbers.point()),
        4 => (a - (b - a), a + (c - a) * 2.0),
        5 => (a, DVec3::new(a.x, a.y, -2.0)),
        _ => (from, numbers.point() * 1.5),
    }
}

#[test]
fn the_tree_agrees_with_brute_force_on_everything() {
    let mut numbers = Numbers(1);
    for (count, shift, scale) in [
        (0, 0.0, 1.0),
        (1, 0.0, 1.0),
        (13, 0.0, 1.0),
        (17, 1e6, 1.0),
        (400, 0.0, 1.0),
        (400, 1e6, 1.0),
        (300, 0.0, 1e9),
        (300, 0.0, 1e-9),
    ] {
        let place = |p: DVec3| p * scale + DVec3::new(shift, -shift, 0.5 * shift);
        let local = soup(count, &mut numbers);
        let triangles: Vec<_> = local.iter().map(|t| t.map(place)).collect();
        let ids = ids(&triangles);
        let (tree, reference) = (Bvh::new(&triangles, &ids), BruteForce::new(&triangles, &ids));
        let mut blocked = 0;
        for _ in 0..20_000 {
            let (from, to) = if count > 0 { segment(&local, &mut numbers) } else { (DVec3::X, DVec3::Y) };
            let (from, to) = (place(from), place(to));
            let skip = [numbers.below(count + 1) as u32, u32::MAX];
            let expected = reference.occluded(from, to, skip);
            assert_eq!(tree.occluded(from, to, skip), expected, "{from} {to} of {count}");
            let hit = tree.closest_hit(from, to - from, 1.0, |id, _| !skip.contains(&id));
            assert!(hit.is_some() || !expected || shift > 0.0, "{from} {to} of {count}");
            blocked += u32::from(expected);
        }
        assert_eq!(count == 0, blocked == 0);
    }
}

#[test]
fn without_triangles_all_agree() {
    let all: [&dyn Visibility; 3] = [&Unoccluded, &BruteForce::new(&[], &[]), &Bvh::of_surfaces(&[])];
    assert!(all.iter().all(|visibility| !visibility.occluded(DVec3::ZERO, DVec3::ONE, [0, 0])));
}

#[test]
fn the_tree_does_not_depend_on_the_number_of_threads() {
    let triangles = soup(20_000, &mut Numbers(10));
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be had");
        pool.install(|| format!("{:?}", Bvh::new(&triangles, &ids(&triangles))))
    };
    assert!(build(1) == build(4));
}

#[test]
fn corners_that_single_precision_holds_are_kept_in_it_and_hit_the_same() {
    let mut numbers = Numbers(12);
    let single = |corner: DVec3| corner.as_vec3().as_dvec3();
    let mut triangles: Vec<[DVec3; 3]> = soup(500, &mut numbers).iter().map(|t| t.map(single)).collect();
    // One more, that no ray meets, in both trees.
    triangles.push([DVec3::splat(1.1); 3].map(single));
    let narrow = Bvh::new(&triangles, &ids(&triangles));
    triangles[500] = [DVec3::splat(1.1); 3];
    let wide = Bvh::new(&triangles, &ids(&triangles));
    assert!(narrow.bytes() < wide.bytes());
    let mut hits = 0;
    for _ in 0..2000 {
        let ((from, to), skip) = (segment(&triangles[..500], &mut numbers), [u32::MAX; 2]);
        let first = |tree: &Bvh| tree.closest_hit(from, to - from, 1.0, |_, _| true);
        assert_eq!(first(&narrow), first(&wide));
        assert_eq!(narrow.occluded(from, to, skip), wide.occluded(from, to, skip));
        hits += usize::from(first(&wide).is_some());
    }
    assert!(hits > 500, "{hits}");
}

#[test]
fn candidates_give_the_same_answer_as_the_tree() {
    let mut numbers = Numbers(2);
    let triangles = soup(200, &mut numbers);
    let tree = Bvh::new(&triangles, &ids(&triangles));
    let all = ids(&triangles);
    for _ in 0..5_000 {
        let (from, to) = segment(&triangles, &mut numbers);
        assert_eq!(tree.occluded_by(from, to, &all), tree.occluded(from, to, [u32::MAX; 2]));
    }
}

#[test]
fn the_closest_hit_is_the_first_of_all() {
    let mut numbers = Numbers(3);
    let triangles = soup(300, &mut numbers);
    let tree = Bvh::new(&triangles, &ids(&triangles));
    for _ in 0..20_000 {
        let (from, to) = segment(&triangles, &mut numbers);
        let direction = to - from;
        let alone = |k: u32| tree.closest_hit(from, direction, f64::INFINITY, |id, _| id == k).map(|hit| hit.t);
        let Some(hit) = tree.closest_hit(from, direction, f64::INFINITY, |_, _| true) else { continue };
        assert_eq!(alone(hit.id), Some(hit.t));
        let earlier = tree.closest_hit(from, direction, hit.t, |id, _| id != hit.id);
        assert!(earlier.is_none(), "{hit:?} {earlier:?}");
        let [a, b, c] = triangles[hit.triangle as usize];
        let [v, w] = hit.barycentric;
        assert!(v >= 0.0 && w >= 0.0 && v + w <= 1.0 + 1e-15);
        let normal = (b - a).cross(c - a);
        // Where a triangle without area is met is not defined.
        if ![2, 5].contains(&(hit.triangle % 6)) {
            let gap = (a + (b - a) * v + (c - a) * w).distance(from + direction * hit.t);
            assert!(gap < 1e-9, "{gap} {hit:?}");
            assert!(hit.front == (normal.dot(direction) < 0.0) || normal.dot(direction).abs() < 1e-12);
        }
    }
}

#[test]
fn a_ray_sees_the_side_it_meets() {
    let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
    for turn in 0..3 {
        let turned = triangle.map(|p| DVec3::from_array([0, 1, 2].map(|k| p[(k + turn) % 3])));
        let tree = Bvh::new(&[turned], &[7]);
        let normal = (turned[1] - turned[0]).cross(turned[2] - turned[0]);
        let above = (turned[0] + turned[1] + turned[2]) / 3.0 + normal;
        let hit = tree.closest_hit(above, -normal, f64::INFINITY, |_, front| front).expect("the front is there");
        assert!(hit.front && hit.id == 7 && (hit.t - 1.0).abs() < 1e-15);
        assert!(tree.closest_hit(above, -normal, f64::INFINITY, |_, front| !front).is_none());
        assert!(tree.closest_hit(above, normal, f64::INFINITY, |_, _| true).is_none());
        assert!(tree.closest_hit(above, -normal, 0.999, |_, _| true).is_none());
    }
}

/// The surface of a cube of side 2, `n` × `n` quads per face, each two triangles; `turn` maps it to where it is to be.
fn cube(n: usize, turn: impl Fn(DVec3) -> DVec3) -> Vec<[DVec3; 3]> {
    let at = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
    let mut triangles = Vec::new();
    for face in 0..6 {
        let side = if face < 3 { 1.0 } else { -1.0 };
        let corner = |i: usize, j: usize| {
            let p = [at(i), at(j), side];
            turn(DVec3::from_array([0, 1, 2].map(|k| p[(k + face) % 3])))
        };
        for (i, j) in (0..n * n).map(|k| (k / n, k % n)) {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

fn turned(p: DVec3) -> DVec3 {
    glam::DMat3::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1) * p * 3.0 + DVec3::new(0.1, 0.2, -5.0)
}

/// A sphere of unit radius: the cube's triangles blown up.
fn ball(n: usize) -> Vec<[DVec3; 3]> {
    cube(n, DVec3::normalize)
}

#[test]
fn nothing_escapes_from_a_closed_surface() {
    let mut numbers = Numbers(4);
    for triangles in [cube(1, |p| p), cube(7, turned), ball(1), ball(12), cube(5, |p| p + 1e6)] {
        let tree = Bvh::new(&triangles, &ids(&triangles));
        let reference = BruteForce::new(&triangles, &ids(&triangles));
        let center = triangles.iter().flatten().sum::<DVec3>() / (3 * triangles.len()) as f64;
        let inside = |numbers: &mut Numbers| {
            let mix = numbers.next() * 0.9;
            center + (triangles[numbers.below(triangles.len())][0] - center) * mix
        };
        for _ in 0..20_000 {
            let from = if numbers.below(3) == 0 { center } else { inside(&mut numbers) };
            let [a, b, c] = triangles[numbers.below(triangles.len())];
            let aim = match numbers.below(5) {
                0 => a,
                1 => a + (b - a) * 0.5,
                2 => b + (c - b) * numbers.next(),
                3 => from + DVec3::AXES[numbers.below(3)],
                _ => a + (b - a) * 0.2 + (c - a) * 0.3,
            };
            let direction = aim - from;
            let hit = tree.closest_hit(from, direction, f64::INFINITY, |_, _| true);
            assert!(hit.is_some(), "{from} -> {aim} escapes");
            let outside = from + direction * (20.0 / direction.length());
            assert!(tree.occluded(from, outside, [u32::MAX; 2]), "{from} -> {outside} is clear");
            assert!(tree.occluded(outside, from, [u32::MAX; 2]), "{outside} -> {from} is clear");
            assert!(reference.occluded(from, outside, [u32::MAX; 2]));
        }
    }
}

#[test]
fn a_segment_that_ends_on_a_surface_is_not_blocked_by_it() {
    let mut numbers = Numbers(5);
    for shift in [0.0, 1e6] {
        let triangles = cube(6, |p| turned(p) + shift);
        let tree = Bvh::new(&triangles, &vec![u32::MAX - 1; triangles.len()]);
        for _ in 0..20_000 {
            let on = |numbers: &mut Numbers| {
                let ([a, b, c], u) = (triangles[numbers.below(triangles.len())], numbers.next());
                let v = (1.0 - u) * numbers.next();
                a * (1.0 - u - v) + b * u + c * v
            };
            let (from, to) = (on(&mut numbers), on(&mut numbers));
            // Nothing is skipped: both ends lie on walls by their coordinates alone.
            assert!(!tree.occluded(from, to, [0, 0]), "{from} {to}");
        }
    }
}

#[test]
fn segments_and_triangles_without_sense_block_nothing() {
    let good = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let bad = [DVec3::ZERO, DVec3::NAN, DVec3::Y];
    let tree = Bvh::new(&[bad, good, [DVec3::INFINITY; 3]], &[0, 1, 2]);
    let (below, above) = (DVec3::new(0.2, 0.2, -1.0), DVec3::new(0.2, 0.2, 1.0));
    assert!(tree.occluded(below, above, [5, 5]) && !tree.occluded(below, above, [5, 1]));
    for (from, to) in [(below, below), (DVec3::NAN, above), (below, DVec3::INFINITY)] {
        assert!(!tree.occluded(from, to, [5, 5]));
    }
    assert!(tree.triangle(0).is_none() && tree.triangle(1) == Some((good, 1)) && tree.triangle(3).is_none());
    assert_eq!(tree.nearest_point(below, |_| true).map(|near| near.triangle), Some(1));
    let flat = Bvh::new(&vec![[DVec3::ONE; 3]; 100], &vec![0; 100]);
    assert!(!flat.occluded(DVec3::ZERO, DVec3::splat(2.0), [5, 5]));
    assert!(Bvh::new(&[], &[]).nearest_point(DVec3::ZERO, |_| true).is_none());
}

#[test]
fn many_equal_triangles_do_not_make_a_deep_tree() {
    let mut triangles = vec![[DVec3::ZERO, DVec3::X, DVec3::Y]; 5000];
    // Ever smaller ones, which the heuristic peels off one by one.
    triangles.extend(
        (0..900)
            .map(|k| [DVec3::ZERO, DVec3::X, DVec3::Z].map(|p| p * 0.97_f64.powi(k) + DVec3::ONE * 0.97_f64.powi(k))),
    );
    let tree = Bvh::new(&triangles, &ids(&triangles));
    assert!(tree.occluded(DVec3::new(0.2, 0.2, -1.0), DVec3::new(0.2, 0.2, 0.1), [0, 1]));
    assert!(
        tree.closest_hit(DVec3::new(0.2, 0.2, -1.0), DVec3::Z, 9.0, |_, _| true).is_some_and(|hit| hit.triangle == 0)
    );
}

#[test]
fn the_nearest_point_is_the_nearest_of_all() {
    let mut numbers = Numbers(6);
    let triangles = soup(300, &mut numbers);
    let tree = Bvh::new(&triangles, &ids(&triangles));
    for _ in 0..2_000 {
        let p = numbers.point() * 3.0;
        let near = tree.nearest_point(p, |k| k % 3 != 0).expect("there are triangles");
        let each = (0..300).filter(|k| k % 3 != 0);
        let all = each.filter_map(|k| tree.nearest_point(p, |j| j == k)).map(|near| near.distance);
        assert!(all.fold(f64::INFINITY, f64::min).total_cmp(&near.distance).is_eq());
        // No sampled point of the triangle is nearer.
        let [a, b, c] = triangles[near.triangle as usize];
        for _ in 0..20 {
            let u = numbers.next();
            let v = (1.0 - u) * numbers.next();
            assert!((a + (b - a) * u + (c - a) * v).distance(p) >= near.distance - 1e-12);
        }
    }
}

#[test]
fn overlapping_finds_the_boxes_that_meet() {
    let mut numbers = Numbers(7);
    let triangles = soup(500, &mut numbers);
    let tree = Bvh::new(&triangles, &ids(&triangles));
    for _ in 0..200 {
        let (a, b) = (numbers.point(), numbers.point());
        let (lo, hi) = (a.min(b), a.max(b));
        let mut found = Vec::new();
        tree.overlapping(lo, hi, |index| found.push(index));
        found.sort_unstable();
        let meets =
            |t: &[DVec3; 3]| t[0].min(t[1]).min(t[2]).cmple(hi).all() && t[0].max(t[1]).max(t[2]).cmpge(lo).all();
        let expected: Vec<u32> = (0..500).filter(|&k| meets(&triangles[k as usize])).collect();
        assert_eq!(found, expected);
    }
}

#[test]
fn in_a_convex_room_all_pairs_are_proven_visible() {
    for triangles in [cube(3, |p| p), cube(3, turned), cube(2, |p| turned(p) + 1e4)] {
        let tree = Bvh::new(&triangles, &ids(&triangles));
        let mut out = Vec::new();
        for (i, a) in triangles.iter().enumerate() {
            for (j, b) in triangles.iter().enumerate().skip(i + 1) {
                let found = tree.shaft_candidates(&Shaft::new(a, b), &[i as u32, j as u32], &mut out, 100);
                assert_eq!(found, ShaftResult::Empty, "{i} {j}: {out:?}");
            }
        }
    }
}

fn convex_polygon(numbers: &mut Numbers, center: DVec3, size: f64) -> Vec<DVec3> {
    let (u, v, count) = (numbers.point() * size, numbers.point() * size, 3 + numbers.below(6));
    let turn = |k: usize| std::f64::consts::TAU * (k as f64 + 0.2) / count as f64;
    (0..count).map(|k| center + u * turn(k).cos() + v * turn(k).sin()).collect()
}

fn inner_point(numbers: &mut Numbers, polygon: &[DVec3]) -> DVec3 {
    let weights: Vec<f64> = polygon.iter().map(|_| numbers.next() + 1e-3).collect();
    polygon.iter().zip(&weights).map(|(&p, &w)| p * w).sum::<DVec3>() / weights.iter().sum::<f64>()
}

#[test]
fn an_empty_shaft_has_no_blocked_segment_and_a_full_one_no_clear_one() {
    let mut numbers = Numbers(8);
    let mut seen = [0; 3];
    for round in 0..3000 {
        let triangles = soup(1 + round % 12, &mut numbers);
        let tree = Bvh::new(&triangles, &ids(&triangles));
        let (p, q) = (numbers.point(), numbers.point());
        let (a, b) = (convex_polygon(&mut numbers, p, 0.1), convex_polygon(&mut numbers, q, 0.1));
        let (shaft, mut out) = (Shaft::new(&a, &b), Vec::new());
        let found = tree.shaft_candidates(&shaft, &[u32::MAX; 2], &mut out, 1000);
        let full = triangles.iter().any(|t| shaft.fully_blocked_by(t, area_vector(t).normalize_or_zero(), 0.0));
        seen[if full { 2 } else { usize::from(found == ShaftResult::Candidates) }] += 1;
        for _ in 0..50 {
            let (from, to) = (inner_point(&mut numbers, &a), inner_point(&mut numbers, &b));
            let blocked = tree.occluded(from, to, [u32::MAX; 2]);
            assert!(!(blocked && found == ShaftResult::Empty), "{a:?} {b:?} {triangles:?}");
            assert!(blocked || !full, "{a:?} {b:?} {triangles:?}");
            assert_eq!(tree.occluded_by(from, to, &out), blocked);
        }
    }
    assert!(seen.iter().all(|&n| n > 10), "{seen:?}");
}

#[test]
fn shafts_keep_to_their_limit_and_their_surfaces() {
    let square = |z: f64, s: f64| [(-s, -s), (s, -s), (s, s), (-s, s)].map(|(x, y)| DVec3::new(x, y, z));
    let sheets: Vec<[DVec3; 3]> = (1..10)
        .map(|k| {
            let q = square(f64::from(k) / 10.0, 0.4);
            [q[0], q[1], q[2]]
        })
        .collect();
    let tree = Bvh::new(&sheets, &ids(&sheets));
    let shaft = Shaft::new(&square(0.0, 1.0), &square(1.0, 1.0));
    let mut out = Vec::new();
    assert_eq!(tree.shaft_candidates(&shaft, &[3, 4], &mut out, 7), ShaftResult::Candidates);
    out.sort_unstable();
    assert_eq!(out, [0, 1, 2, 5, 6, 7, 8]);
    assert_eq!(tree.shaft_candidates(&shaft, &[3, 4], &mut out, 6), ShaftResult::TooMany);
    assert!(shaft.may_block(&sheets[0], DVec3::Z));
    assert!(!Shaft::new(&square(0.0, 1.0), &square(1.0, 1.0).map(|p| p + DVec3::X * 9.0)).fully_blocked_by(
        &square(0.5, 2.0),
        DVec3::Z,
        0.0
    ));
    let hides = |s: f64| shaft.fully_blocked_by(&square(0.5, s), DVec3::Z, 0.0);
    assert!(hides(1.1) && !hides(1.0));
}

proptest! {
    /// The watertight test finds what a plain one finds, away from borders.
    #[test]
    fn clear_cases_agree_with_signed_volumes(v in proptest::array::uniform5(proptest::array::uniform3(-1.0_f64..1.0))) {
        let [a, b, c, p, q] = v.map(DVec3::from_array);
        let volume = |x: DVec3, y: DVec3, z: DVec3, w: DVec3| (y - x).cross(z - x).dot(w - x);
        let ends = [volume(a, b, c, p), volume(a, b, c, q)];
        let sides = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
        prop_assume!(ends.iter().chain(&sides).all(|v| v.abs() > 1e-9));
        let inside = sides.iter().all(|&s| s > 0.0) || sides.iter().all(|&s| s < 0.0);
        let expected = inside && (ends[0] > 0.0) != (ends[1] > 0.0);
        prop_assert_eq!(Bvh::new(&[[a, b, c]], &[0]).occluded(p, q, [1, 1]), expected);
        prop_assert!(!Unoccluded.occluded(p, q, [1, 1]));
    }
}

//! Whether the reported error of partially hidden pairs is one.

use crate::{Outline, Random, kernel, panel};
use glam::{DMat3, DVec3};
use hatbox::assemble::{Accuracy, Block, Facing, Panel, Sight, pair_block};
use hatbox::element::{ALL, Basis, Shape};
use hatbox::mesh::Patch;
use hatbox::quadrature::sequence::point;

/// Pairs with something in between, and how many are tried when there is time.
const PAIRS: usize = 100;
const MANY: usize = 2000;
/// Tolerances of the tried runs, and how much tighter those are that count as the truth.
const TOLERANCES: [f64; 2] = [1e-2, 1e-3];
const TIGHTER: f64 = 1e-3;
/// The part of the pairs whose error may exceed what is reported.
const FAILURES: f64 = 0.01;

struct Scene {
    seed: u64,
    a: Panel,
    b: Panel,
    blockers: Vec<Vec<DVec3>>,
}

impl Scene {
    fn random(seed: u64, basis: &Basis) -> Option<Self> {
        let mut random = Random::new(seed);
        let mut next = |center: DVec3, normal: DVec3| {
            let outlines: &[Outline] = if basis.quad.is_some() { &Outline::ALL[..2] } else { &Outline::ALL[..1] };
            let outline = outlines[random.below(outlines.len())];
            let frame = random.frame(normal);
            let corners = outline.corners(&mut random).map(|p| center + frame * p);
            (
                panel(corners, basis.element(outline.shape()).expect("an element")),
                random.direction(),
                random.size(0.6, 4.0),
            )
        };
        let (a, way, distance) = next(DVec3::ZERO, DVec3::Z);
        let up = (way + DVec3::Z).normalize_or(DVec3::Z);
        let (b, tilt, _) = next(up * distance, (-up * 1.2 + way.cross(DVec3::X)).normalize());
        Facing::new(&a.patch, &b.patch)?;
        let count = 1 + random.below(4);
        let blockers = (0..count).map(|_| blocker(&a, &b, tilt, &mut random)).collect();
        Some(Self { seed, a, b, blockers })
    }

    fn block(&self, tolerance: f64) -> Block {
        let polygons: Vec<&[DVec3]> = self.blockers.iter().map(Vec::as_slice).collect();
        // The pair is a part of a room.
        let accuracy = Accuracy::new(tolerance, 8.0 * (self.a.area() + self.b.area()));
        pair_block(&self.a, &self.b, Sight::Behind(&polygons), [1.0; 2], &accuracy)
    }

    /// The block if rays have to tell what is hidden.
    fn sampled(&self, tolerance: f64) -> Block {
        let hidden = |x: DVec3, y: DVec3| u32::from(self.blockers.iter().any(|polygon| crosses(x, y, polygon)));
        let hides = |x: &[DVec3], y: &[DVec3]| (0..x.len()).map(|k| hidden(x[k], y[k]) << k).sum();
        let accuracy = Accuracy::new(tolerance, 8.0 * (self.a.area() + self.b.area()));
        let accuracy = Accuracy { seed: self.seed, ..accuracy };
        pair_block(&self.a, &self.b, Sight::Partial(&hides), [1.0; 2], &accuracy)
    }

    fn clear(&self) -> f64 {
        pair_block(&self.a, &self.b, Sight::Clear, [1.0; 2], &Accuracy::new(1e-6, 1e3)).sum()
    }

    fn assert_like_rays(&self, block: &Block) {
        let [mean, deviation] = self.by_rays();
        let difference = (block.sum() - mean).abs();
        let allowed = 5.0 * deviation + block.quadrature_error + 1e-3 * self.clear();
        assert!(difference <= allowed, "{}: {} by rays {mean} ± {deviation}", self.seed, block.sum());
    }

    /// ∬GV by rays, and its standard error from sixteen sets.
    fn by_rays(&self) -> [f64; 2] {
        const SETS: usize = 16;
        const RAYS: u32 = 2048;
        let scale = self.a.area() * self.b.area() / f64::from(RAYS);
        let value = |set: usize| {
            let rays = (0..RAYS).map(|k| {
                let [s, t, u, v] = point(self.seed.wrapping_mul(SETS as u64).wrapping_add(set as u64), k);
                let (x, y) = (self.a.sample(s, t), self.b.sample(u, v));
                let hidden = self.blockers.iter().any(|polygon| crosses(x, y, polygon));
                if hidden { 0.0 } else { kernel(x, self.a.normal(), y, self.b.normal()) }
            });
            scale * rays.sum::<f64>()
        };
        let values: [f64; SETS] = std::array::from_fn(value);
        let mean = values.iter().sum::<f64>() / SETS as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (SETS - 1) as f64;
        [mean, (variance / SETS as f64).sqrt()]
    }
}

/// A convex polygon that is met by a line from panel to panel: small or large, straight, oblique or grazing, free or with
/// its foot on or through one of the panels' planes.
fn blocker(a: &Panel, b: &Panel, tilt: DVec3, random: &mut Random) -> Vec<DVec3> {
    let [x, y] = [a, b].map(|panel| panel.sample(random.uniform(0.0, 1.0), random.uniform(0.0, 1.0)));
    let line = (y - x).normalize();
    let normal = match random.below(4) {
        0 => line,
        1 => line.cross(tilt).normalize_or(line),
        2 => (line.cross(tilt).normalize_or(line) + line * random.size(1e-4, 0.1)).normalize(),
        _ => random.direction(),
    };
    let frame = random.frame(normal);
    let size = random.size(0.03, 3.0);
    let corners = 3 + random.below(4);
    let turn = std::f64::consts::TAU / corners as f64;
    let flat: Vec<DVec3> = (0..corners)
        .map(|k| {
            let (sin, cos) = ((k as f64 + random.uniform(-0.2, 0.2)) * turn).sin_cos();
            frame * (DVec3::new(cos, sin, 0.0) * size)
        })
        .collect();
    let mut center = x.lerp(y, random.uniform(0.02, 0.98));
    // Some stand on a panel's plane.
    let lowest = flat.iter().map(|p| a.normal().dot(*p)).fold(f64::INFINITY, f64::min);
    if random.below(4) == 0 && a.normal().dot(center - x) + lowest > 0.0 {
        center -= line * (a.normal().dot(center - x) + lowest) / a.normal().dot(line).max(0.05);
    }
    flat.iter().map(|p| center + *p).collect()
}

/// Whether a segment goes through a convex polygon, by the signs of the volumes with its edges.
fn crosses(x: DVec3, y: DVec3, polygon: &[DVec3]) -> bool {
    let normal = (polygon[1] - polygon[0]).cross(polygon[2] - polygon[0]);
    let (from, to) = (normal.dot(x - polygon[0]), normal.dot(y - polygon[0]));
    if from * to >= 0.0 {
        return false;
    }
    let volume = |k: usize| (polygon[k] - x).cross(polygon[(k + 1) % polygon.len()] - x).dot(y - x);
    let positive = (0..polygon.len()).filter(|&k| volume(k) > 0.0).count();
    positive == 0 || positive == polygon.len()
}

/// Σ|difference| of the entries, which is what an error of ∬G means for a block.
fn distance(p: &Block, q: &Block) -> f64 {
    p.values().iter().zip(q.values()).map(|(p, q)| (p - q).abs()).sum()
}

/// Checks the pairs of a basis that have something in between, against very accurate ones.
fn check(basis: &Basis, pairs: usize, first_seed: u64, block: impl Fn(&Scene, f64) -> Block) {
    let mut found = 0;
    let mut failures = [const { Vec::new() }; TOLERANCES.len()];
    for seed in first_seed.. {
        let Some(scene) = Scene::random(seed, basis) else { continue };
        let truth = scene.block(TOLERANCES[1] * TIGHTER);
        let clear = scene.clear();
        if truth.sum() > 0.9999 * clear && seed % 8 != 0 {
            continue;
        }
        found += 1;
        if found % 10 == 0 {
            scene.assert_like_rays(&truth);
        }
        for (tolerance, failures) in TOLERANCES.into_iter().zip(&mut failures) {
            let coarse = block(&scene, tolerance);
            let (error, reported) = (distance(&coarse, &truth), coarse.quadrature_error + coarse.visibility_error);
            if error > reported + 1e-12 * clear {
                failures
                    .push(format!("{seed}: {error:.2e} > {reported:.2e} of {:.4e}, clear {clear:.4e}", truth.sum()));
            }
        }
        if found == pairs {
            break;
        }
    }
    for (tolerance, failures) in TOLERANCES.into_iter().zip(failures) {
        for failure in &failures {
            println!("{} {tolerance:e}: {failure}", basis.name);
        }
        let rate = failures.len() as f64 / pairs as f64;
        println!("{} {tolerance:e}: {rate}", basis.name);
        assert!(rate <= FAILURES, "{} at {tolerance:e}: {} of {pairs} exceed the estimate", basis.name, failures.len());
    }
}

#[test]
fn the_error_of_hidden_pairs_is_within_the_estimate() {
    assert!(ALL[1].element(Shape::Triangle).is_some_and(|element| element.degree == 1));
    check(&ALL[0], PAIRS, 0, Scene::block);
    check(&ALL[1], PAIRS / 3, 1_000_000, Scene::block);
}

#[test]
fn the_error_of_pairs_left_to_rays_is_within_the_estimate() {
    check(&ALL[0], 2 * PAIRS, 5_000_000, Scene::sampled);
}

/// Where panels share an edge, even points overlooked a thin fin in the corner, or found a part of it and claimed that it was all.
#[test]
fn the_error_of_touching_pairs_left_to_rays_is_within_the_estimate() {
    const SEEDS: u64 = 100;
    let square =
        |[x, y]: [DVec3; 2]| panel([DVec3::ZERO, x, x + y, y], ALL[0].element(Shape::Quad).expect("constants"));
    let (a, b) = (square([DVec3::X, DVec3::Y]), square([DVec3::Y, DVec3::Z]));
    let mut failures = [0; TOLERANCES.len()];
    let heights = [0.003, 0.01, 0.03, 0.1];
    for height in heights {
        let tip = DVec3::new(height, 0.0, height);
        let fin = vec![DVec3::ZERO, DVec3::Y, DVec3::Y + tip, tip];
        let scene = |seed| Scene { seed, a: a.clone(), b: b.clone(), blockers: vec![fin.clone()] };
        let truth = scene(0).block(1e-7).sum();
        for (tolerance, failures) in TOLERANCES.into_iter().zip(&mut failures) {
            for seed in 0..SEEDS {
                let block = scene(seed).sampled(tolerance);
                let (error, reported) = ((block.sum() - truth).abs(), block.quadrature_error + block.visibility_error);
                *failures += u64::from(error > reported);
            }
        }
    }
    let most = FAILURES * (SEEDS * heights.len() as u64) as f64;
    assert!(failures.iter().all(|&count| count as f64 <= most), "{failures:?} of {}", SEEDS * heights.len() as u64);
}

/// A triangle on the floor and another that touches it along an edge or at a corner, both down to a hundred times as long as wide.
fn touching_triangles(seed: u64, along_an_edge: bool) -> Option<[Panel; 2]> {
    let mut random = Random::new(seed);
    let mut triangle = |length: f64| {
        let (foot, height) = (random.uniform(0.0, 1.0), random.size(0.01, 1.0));
        [DVec3::ZERO, DVec3::X, DVec3::new(foot, height, 0.0)].map(|corner| length * corner)
    };
    let (a, b) = (triangle(1.0), triangle(1.0));
    let (scale, turn) = if along_an_edge { (1.0, 0.0) } else { (random.size(0.3, 3.0), random.uniform(0.0, 6.0)) };
    let raised = DMat3::from_rotation_z(turn) * DMat3::from_rotation_x(random.uniform(0.3, 2.8));
    let mut corners = [(b[0], 0), (b[1], if along_an_edge { 1 } else { 3 }), (b[2], 4)];
    if (raised * DVec3::Z).dot(a[2]) < 0.0 {
        corners.swap(1, 2);
    }
    let element = ALL[1].element(Shape::Triangle).expect("linear functions");
    let new = |[a, b, c]: [DVec3; 3], [i, j, k]: [u32; 3], surface| {
        Panel::new(Patch::new(Shape::Triangle, [a, b, c, c]), element, [i, j, k, k], surface)
    };
    let a = new(a, [0, 1, 2], 0);
    let b = new(corners.map(|(corner, _)| scale * (raised * corner)), corners.map(|(_, index)| index), 1);
    Facing::new(&a.patch, &b.patch)?;
    Some([a, b])
}

/// Orders of a transform agreed about needles that share an edge, and both were wrong: 116 of these pairs erred by more than 10 %.
/// The truth is that of the rule that has taken their place; what it sums to is held against 1 in a drum full of needles.
#[test]
fn triangles_that_touch_err_by_no_more_than_they_may() {
    const SEEDS: u64 = 600;
    for along_an_edge in [true, false] {
        let mut failures = [0; 2];
        for [a, b] in (0..SEEDS).filter_map(|seed| touching_triangles(seed, along_an_edge)) {
            let area = 10.0 * (a.area() + b.area());
            let of = |tolerance: f64| pair_block(&a, &b, Sight::Clear, [1.0; 2], &Accuracy::new(tolerance, area));
            let truth = of(1e-5);
            for (tolerance, failures) in [0.1, 0.01].into_iter().zip(&mut failures) {
                let may = tolerance * truth.sum().max(a.area() * b.area() / area);
                *failures += u64::from(distance(&of(tolerance), &truth) > may);
            }
        }
        let most = FAILURES * SEEDS as f64;
        assert!(failures.iter().all(|&count| count as f64 <= most), "{along_an_edge}: {failures:?} of {SEEDS}");
    }
}

/// The light of each function of panels of unequal size, in either order, of which a screen hides some.
#[test]
fn touching_panels_left_to_rays_have_the_block_that_is_cut_out() {
    let triangle = |corners: [DVec3; 3]| {
        let [a, b, c] = corners;
        panel([a, b, c, c], ALL[1].element(Shape::Triangle).expect("linear functions"))
    };
    let floor = triangle([DVec3::ZERO, 2.0 * DVec3::X, DVec3::Y]);
    let wall = triangle([DVec3::ZERO, DVec3::Y, 0.3 * DVec3::Z]);
    let at = |x: f64, z: f64| DVec3::new(x, 0.4, z);
    let screen = vec![at(0.0, 0.0), at(3.0, 0.0), at(3.0, 3.0), at(0.0, 3.0)];
    for [a, b] in [[&floor, &wall], [&wall, &floor]] {
        let scene = |seed| Scene { seed, a: a.clone(), b: b.clone(), blockers: vec![screen.clone()] };
        let truth = scene(0).block(1e-7);
        assert!(truth.sum() < 0.9 * scene(0).clear(), "something is hidden");
        for seed in 0..20 {
            let block = scene(seed).sampled(1e-3);
            let (error, reported) = (distance(&block, &truth), block.quadrature_error + block.visibility_error);
            assert!(error <= 2.0 * reported && reported < 0.02 * truth.sum(), "{seed}: {error:e} {reported:e}");
        }
    }
}

/// A room that is walled up stays dark to the last bit.
#[test]
fn pairs_of_which_no_ray_sees_anything_exchange_nothing() {
    let scene = (0..).find_map(|seed| Scene::random(seed, &ALL[1])).expect("panels that face each other");
    let accuracy = Accuracy::new(1e-3, 8.0 * (scene.a.area() + scene.b.area()));
    let with = |hides: &(dyn Fn(&[DVec3], &[DVec3]) -> u32 + Sync)| {
        pair_block(&scene.a, &scene.b, Sight::Partial(hides), [1.0; 2], &accuracy)
    };
    assert!(with(&|_, _| u32::MAX).values().iter().all(|&value| value == 0.0));
    let clear = pair_block(&scene.a, &scene.b, Sight::Clear, [1.0; 2], &accuracy);
    assert_eq!(with(&|_, _| 0).values(), clear.values());
}

#[test]
#[ignore = "minutes, for thousands of pairs: cargo test --release -p hatbox --test pairs -- --ignored"]
fn the_error_of_many_hidden_pairs_is_within_the_estimate() {
    check(&ALL[0], MANY, 2_000_000, Scene::block);
    check(&ALL[1], MANY / 4, 3_000_000, Scene::block);
    check(&ALL[0], MANY, 4_000_000, Scene::sampled);
}

/// A corner of the blocker is 3e-17 under the plane of a panel, where clipping left an edge without a direction, whose side of
/// the shadow then missed everything.
#[test]
fn a_blocker_with_a_corner_on_the_plane_of_a_panel_hides_what_it_hides() {
    let scene = Scene::random(2_001_336, &ALL[0]).expect("panels that face each other");
    let heights =
        scene.blockers.iter().flatten().map(|corner| scene.a.normal().dot(*corner - scene.a.patch.corners()[0]));
    assert!(heights.clone().any(|height| height < 0.0 && height > -1e-15), "{:?}", heights.collect::<Vec<_>>());
    let block = scene.block(1e-6);
    assert!(block.sum() < 0.96 * scene.clear(), "something is hidden: {}", block.sum());
    scene.assert_like_rays(&block);
}

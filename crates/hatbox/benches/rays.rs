//! Rays per second of the tree, on one thread: `cargo bench -p hatbox --bench rays`.
//!
//! The scenes are made here, so the figures can be made again: a box with 72 000 triangles of bumpy spheres, a soup of
//! as many triangles, and a Cornell-like box of 36.

use glam::DVec3;
use hatbox::visibility::{Bvh, Shaft, Visibility};
use std::hint::black_box;
use std::time::Instant;

/// A reproducible stream of numbers in [0, 1) (after Steele, Lea and Flood 2014).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn point(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }
}

type Triangles = Vec<[DVec3; 3]>;

/// A cube from −1 to 1 with `n` × `n` quads per face, mapped.
fn cube(n: usize, map: impl Fn(DVec3) -> DVec3) -> Triangles {
    let at = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
    let mut triangles = Vec::new();
    for face in 0..6 {
        let side = if face < 3 { 1.0 } else { -1.0 };
        let corner = |i: usize, j: usize| {
            let p = [at(i), at(j), side];
            map(DVec3::from_array([0, 1, 2].map(|k| p[(k + face) % 3])))
        };
        for (i, j) in (0..n * n).map(|k| (k / n, k % n)) {
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

fn cornell() -> Triangles {
    let mut triangles = cube(1, |p| p);
    triangles.extend(cube(1, |p| p * DVec3::new(0.3, 0.3, 0.3) + DVec3::new(0.35, 0.35, -0.7)));
    triangles.extend(cube(1, |p| p * DVec3::new(0.3, 0.3, 0.6) + DVec3::new(-0.35, -0.3, -0.4)));
    triangles
}

fn spheres() -> Triangles {
    let mut triangles = cube(1, |p| p);
    for k in 0..60 {
        let center = DVec3::new(f64::from(k % 4), f64::from(k / 4 % 4), f64::from(k / 16)) * 0.5 - 0.75;
        triangles.extend(cube(10, |p| {
            let n = p.normalize();
            center + n * (0.2 + 0.02 * (9.0 * n.x).sin() * (7.0 * n.y).cos())
        }));
    }
    triangles
}

fn soup() -> Triangles {
    let mut numbers = Numbers(1);
    let mut triangle = || {
        let a = numbers.point();
        [a, a + numbers.point() * 0.03, a + numbers.point() * 0.03]
    };
    (0..72_000).map(|_| triangle()).collect()
}

/// Prints millions of calls a second; the first argument of `call` is a number from 0 up.
fn rate(what: &str, count: usize, mut call: impl FnMut(usize) -> bool) {
    let mut best = f64::INFINITY;
    let mut hits = 0;
    for _ in 0..9 {
        let start = Instant::now();
        hits = (0..count).filter(|&k| black_box(call(k))).count();
        best = best.min(start.elapsed().as_secs_f64());
    }
    let (rate, share) = (count as f64 / best / 1e6, 100.0 * hits as f64 / count as f64);
    println!("  {what:<34} {rate:8.3} M/s   {share:5.1} % yes");
}

fn measure(name: &str, triangles: &Triangles) {
    let ids: Vec<u32> = (0..triangles.len() as u32).collect();
    let start = Instant::now();
    let tree = Bvh::new(triangles, &ids);
    let (ms, kib) = (start.elapsed().as_secs_f64() * 1e3, tree.bytes() / 1024);
    println!("{name}: {} triangles, built in {ms:.1} ms, {kib} KiB", triangles.len());
    let mut numbers = Numbers(2);
    let ends: Vec<[DVec3; 2]> = (0..1 << 18).map(|_| [numbers.point(), numbers.point()].map(|p| p * 0.99)).collect();
    let none = [u32::MAX; 2];
    rate("segments, occluded", ends.len(), |k| tree.occluded(ends[k][0], ends[k][1], none));
    let direction = |k: usize| ends[k][1] - ends[k][0];
    rate("rays, closest hit", ends.len(), |k| {
        tree.closest_hit(ends[k][0], direction(k), f64::INFINITY, |_, _| true).is_some()
    });
    rate("nearest point", ends.len() / 16, |k| {
        tree.nearest_point(ends[k][0], |_| true).is_some_and(|n| n.distance < 0.1)
    });
    let pick = |x: f64| (x * triangles.len() as f64) as usize;
    let pairs: Vec<[usize; 2]> = (0..1 << 12).map(|_| [pick(numbers.next()), pick(numbers.next())]).collect();
    let mut out = Vec::new();
    rate("shafts made", pairs.len(), |k| {
        black_box(Shaft::new(&triangles[pairs[k][0]], &triangles[pairs[k][1]]));
        true
    });
    rate("shafts made and asked (limit 16)", pairs.len(), |k| {
        let shaft = Shaft::new(&triangles[pairs[k][0]], &triangles[pairs[k][1]]);
        tree.shaft_candidates(&shaft, &pairs[k].map(|k| k as u32), &mut out, 16)
            == hatbox::visibility::ShaftResult::Empty
    });
}

fn main() {
    measure("box", &cornell());
    measure("spheres", &spheres());
    measure("soup", &soup());
}

//! Triangles and segments, made here so that the figures can be made again.

use glam::DVec3;

/// A reproducible stream of numbers in [0, 1) (after Steele, Lea and Flood 2014).
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn point(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() * n as f64) as usize
    }
}

pub(crate) type Triangles = Vec<[DVec3; 3]>;

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

/// A Cornell-like box of 36 triangles.
pub(crate) fn cornell() -> Triangles {
    let mut triangles = cube(1, |p| p);
    triangles.extend(cube(1, |p| p * DVec3::new(0.3, 0.3, 0.3) + DVec3::new(0.35, 0.35, -0.7)));
    triangles.extend(cube(1, |p| p * DVec3::new(0.3, 0.3, 0.6) + DVec3::new(-0.35, -0.3, -0.4)));
    triangles
}

/// Sixty bumpy spheres in a box, 12 `n`² triangles each.
pub(crate) fn spheres(n: usize) -> Triangles {
    let mut triangles = cube(1, |p| p);
    for k in 0..60 {
        let center = DVec3::new(f64::from(k % 4), f64::from(k / 4 % 4), f64::from(k / 16)) * 0.5 - 0.75;
        triangles.extend(cube(n, |p| {
            let n = p.normalize();
            center + n * (0.2 + 0.02 * (9.0 * n.x).sin() * (7.0 * n.y).cos())
        }));
    }
    triangles
}

/// Triangles anywhere, their edges up to `size` long.
pub(crate) fn soup(count: usize, size: f64) -> Triangles {
    let mut numbers = Numbers(1);
    let mut triangle = || {
        let a = numbers.point();
        [a, a + numbers.point() * size, a + numbers.point() * size]
    };
    (0..count).map(|_| triangle()).collect()
}

/// Segments between random points of the box.
pub(crate) fn segments(count: usize) -> Vec<[DVec3; 2]> {
    let mut numbers = Numbers(2);
    (0..count).map(|_| [numbers.point() * 0.99, numbers.point() * 0.99]).collect()
}

/// Sixteen segments between two elements.
pub(crate) struct Pair {
    pub(crate) ids: [u32; 2],
    pub(crate) from: [DVec3; 16],
    pub(crate) to: [DVec3; 16],
}

/// Random pairs of elements that may see each other (those of a soup have two sides), ordered along the Morton curve of
/// their six coordinates, with a jittered 4 × 4 grid of points on each.
pub(crate) fn pairs(triangles: &Triangles, count: usize, two_sided: bool) -> Vec<Pair> {
    let mut numbers = Numbers(3);
    let mut pairs = Vec::new();
    while pairs.len() < count {
        let ids = [numbers.below(triangles.len()), numbers.below(triangles.len())];
        let [a, b] = ids.map(|id| triangles[id]);
        if ids[0] != ids[1] && (two_sided || (faces(&a, &b) && faces(&b, &a))) {
            let order = [1, 0, 2, 3].map(|k| k * 4).map(|k| [k, k + 1, k + 2, k + 3]).concat();
            let from = std::array::from_fn(|k| sample(&a, k, &mut numbers));
            let to = std::array::from_fn(|k| sample(&b, order[k] * 5 % 16, &mut numbers));
            pairs.push(Pair { ids: ids.map(|id| id as u32), from, to });
        }
    }
    pairs.sort_by_key(|pair| morton(pair.from[0], pair.to[0]));
    pairs
}

fn faces(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    let normal = (b[1] - b[0]).cross(b[2] - b[0]);
    // The boxes of these scenes are seen from inside, the spheres from outside.
    let walls = b.iter().all(|corner| corner.abs().max_element() >= 1.0);
    let side = normal.dot(a[0] - b[0]) > 0.0;
    let outward = normal.dot(b[0] + b[1] + b[2]) > 0.0;
    if walls { side != outward } else { side }
}

fn sample(triangle: &[DVec3; 3], cell: usize, numbers: &mut Numbers) -> DVec3 {
    let (s, t) = (((cell % 4) as f64 + numbers.next()) / 4.0, ((cell / 4) as f64 + numbers.next()) / 4.0);
    let root = s.sqrt();
    triangle[0] * (1.0 - root) + triangle[1] * (root * (1.0 - t)) + triangle[2] * (root * t)
}

fn morton(a: DVec3, b: DVec3) -> u64 {
    let cells = [a.x, a.y, a.z, b.x, b.y, b.z].map(|x| ((x + 1.0) * 511.5).clamp(0.0, 1023.0) as u64);
    (0..10).rev().fold(0, |code, bit| cells.iter().fold(code, |code, cell| code << 1 | (cell >> bit & 1)))
}

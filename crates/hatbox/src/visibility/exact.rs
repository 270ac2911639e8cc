//! The test that decides: ray against triangle in f64.

use glam::DVec3;

/// Units in the last place, of the greatest coordinate of a segment's ends, within which an end counts as lying on the
/// plane of a triangle. Points computed on a plane (a weighted sum of three corners) are off it by up to about four.
pub const GUARD: f64 = 8.0;

/// A triangle as it was given.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triangle {
    pub(super) corners: [DVec3; 3],
    /// Its index in the input.
    pub(super) index: u32,
    /// Its surface.
    pub(super) id: u32,
}

/// The points origin + t · direction, and what all tests begin with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub(super) origin: DVec3,
    pub(super) direction: DVec3,
    /// How t changes with each coordinate: the inverse of the direction. (The only divisions of a ray.)
    pub(super) pace: DVec3,
    /// The axes in cyclic order, that along which the direction is longest last.
    pub(super) axes: [usize; 3],
}

impl Line {
    #[inline(always)]
    pub(super) fn new(origin: DVec3, direction: DVec3) -> Self {
        let pace = DVec3::new(1.0 / direction.x, 1.0 / direction.y, 1.0 / direction.z);
        Self { origin, direction, pace, axes: axes(direction) }
    }

    /// Whether all its numbers are. (The sum of numbers is not if one of them is not; finite ones far beyond all that
    /// [`super::Bvh`] promises may be refused too.)
    #[inline(always)]
    pub(super) fn is_finite(&self) -> bool {
        let (o, d) = (self.origin, self.direction);
        (o.x + o.y + o.z + d.x + d.y + d.z).is_finite()
    }
}

/// A ray origin + t · direction, prepared for the watertight test: the axes are permuted so that the direction is
/// longest along the last, and space is sheared so that it *is* the last.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    direction: DVec3,
    /// Crossings count for 0 < t < `end`.
    pub(super) end: f64,
    pub(super) axes: [usize; 3],
    /// The origin, axes permuted.
    pub(super) start: [f64; 3],
    pub(super) shear: [f64; 3],
    /// An end this close to a triangle's plane lies on it.
    guard: f64,
    /// Whether `end` is such an end as well.
    closed: bool,
}

/// Where a ray crosses a triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    /// Edge functions opposite to each corner; divided by their sum they are the barycentric coordinates.
    pub(super) edges: [f64; 3],
    /// Sum of the edge functions.
    pub(super) sum: f64,
    /// Ray parameter.
    pub(super) t: f64,
}

/// The guard of a segment or, with `to` = `from`, of the beginning of a ray.
#[inline(always)]
pub(super) fn guard(from: DVec3, to: DVec3) -> f64 {
    let (a, b) = (from.abs(), to.abs());
    let size = greater(greater(greater(a.x, a.y), a.z), greater(greater(b.x, b.y), b.z));
    size * (GUARD * f64::EPSILON)
}

impl Ray {
    /// The segment between two points, t from 0 to 1; `None` if it has no direction.
    #[inline]
    pub(super) fn segment(from: DVec3, to: DVec3) -> Option<Self> {
        Self::new(&Line::new(from, to - from), 1.0, guard(from, to), true)
    }

    /// The ray up to t = `end`, which may be infinite; `None` if it has no direction.
    #[inline(always)]
    pub(super) fn open(line: &Line, end: f64) -> Option<Self> {
        Self::new(line, end, guard(line.origin, line.origin), false)
    }

    #[inline(always)]
    fn new(line: &Line, end: f64, guard: f64, closed: bool) -> Option<Self> {
        let &Line { origin, direction, pace, axes } = line;
        let [i, j, k] = axes;
        let (d, o, pace) = (direction.to_array(), origin.to_array(), pace.to_array()[k]);
        let (start, shear) = ([o[i], o[j], o[k]], [d[i] * pace, d[j] * pace, pace]);
        let usable = d[k] != 0.0 && line.is_finite() && end > 0.0;
        usable.then_some(Self { direction, end, axes, start, shear, guard, closed })
    }

    /// The watertight test of Woop et al. (2013).
    ///
    /// An edge function is a difference of two products. Rounding is monotonic, so its computed sign is never opposite
    /// to the true sign of the sheared corners, only zero too often, and zero counts as inside. It must not be
    /// contracted to a fused multiply-add: the two triangles at an edge have to see exactly opposite values.
    ///
    /// Where edge functions are zero too often, on needles narrower than rounding, the signs alone would let a ray cross
    /// beyond the needle's end. So the ray must also pass the box around the sheared corners: then it comes within
    /// 1e-7 of the triangle's size (√ε), which the boxes of the tree and the tests in f32 allow for. The triangle that
    /// a ray passes through is never lost by this.
    #[inline]
    pub(super) fn cross(&self, triangle: &Triangle) -> Option<Crossing> {
        let [a, b, c] = &triangle.corners;
        let (a, b, c) = (self.sheared(*a), self.sheared(*b), self.sheared(*c));
        let edges = [c[0] * b[1] - c[1] * b[0], a[0] * c[1] - a[1] * c[0], b[0] * a[1] - b[1] * a[0]];
        let [u, v, w] = edges;
        // Single bars, since which triangle is met cannot be guessed.
        let inside = ((u >= 0.0) & (v >= 0.0) & (w >= 0.0)) | ((u <= 0.0) & (v <= 0.0) & (w <= 0.0));
        let sum = u + v + w;
        let below = |row: usize| (a[row] <= 0.0) | (b[row] <= 0.0) | (c[row] <= 0.0);
        let above = |row: usize| (a[row] >= 0.0) | (b[row] >= 0.0) | (c[row] >= 0.0);
        let passes = below(0) & above(0) & below(1) & above(1);
        if !inside || sum == 0.0 || !passes {
            return None;
        }
        Some(Crossing { edges, sum, t: (u * a[2] + v * b[2] + w * c[2]) / sum })
    }

    /// A corner relative to the ray.
    #[inline(always)]
    fn sheared(&self, corner: DVec3) -> [f64; 3] {
        let (c, [i, j, k]) = (corner.to_array(), self.axes);
        let (dx, dy, dz) = (c[i] - self.start[0], c[j] - self.start[1], c[k] - self.start[2]);
        [dx - self.shear[0] * dz, dy - self.shear[1] * dz, self.shear[2] * dz]
    }

    /// Whether a crossing of a triangle at `t` lies strictly between the ends.
    #[inline(always)]
    pub(super) fn counts(&self, triangle: &Triangle, t: f64) -> bool {
        if !(t > 0.0 && t < self.end) {
            return false;
        }
        let [a, b, c] = triangle.corners;
        let normal = (b - a).cross(c - a);
        let speed = normal.dot(self.direction).abs();
        let left = if self.closed { self.end - t } else { t };
        let way = speed * lesser(t, left);
        // The sum of magnitudes is no less than the length, and there is no root to wait for.
        let size = normal.abs();
        way > self.guard * (size.x + size.y + size.z) || way > self.guard * normal.length()
    }

    /// Whether a triangle that is not on a surface of `skip` crosses the ray between its ends.
    #[inline]
    pub(super) fn blocked_by(&self, triangle: &Triangle, skip: [u32; 2]) -> bool {
        !skip.contains(&triangle.id) && self.cross(triangle).is_some_and(|found| self.counts(triangle, found.t))
    }

    /// Whether a triangle whose edge functions sum to `sum` shows its front, the side it is counter-clockwise from.
    #[inline]
    pub(super) fn sees_front(&self, sum: f64) -> bool {
        (sum > 0.0) == (self.shear[2] > 0.0)
    }
}

/// The greater of two numbers; the second if one is NaN. (One instruction, unlike `f64::max`.)
#[inline(always)]
pub(super) fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The lesser of two numbers; the second if one is NaN.
#[inline(always)]
pub(super) fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The axes in cyclic order, that along which the direction is longest last. (Without branches: which axis it is cannot
/// be guessed.)
#[inline(always)]
pub(super) fn axes(direction: DVec3) -> [usize; 3] {
    const CYCLES: [[usize; 3]; 4] = [[0, 1, 2], [2, 0, 1], [1, 2, 0], [1, 2, 0]];
    let size = direction.abs();
    let x = (size.x > size.y) & (size.x > size.z);
    CYCLES[2 * usize::from(x) + usize::from(size.y > size.z)]
}

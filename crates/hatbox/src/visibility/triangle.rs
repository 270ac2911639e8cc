use glam::DVec3;

/// Units in the last place, of the greatest coordinate of a segment's ends, within which an end counts as lying on the
/// plane of a triangle. Points computed on a plane (a weighted sum of three corners) are off it by up to about four.
pub const GUARD: f64 = 8.0;

/// `N` triangles, coordinate by coordinate, so that one instruction serves all.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Block<const N: usize> {
    /// Corner, axis, triangle.
    pub(super) corners: [[[f64; N]; 3]; 3],
    /// Index of each triangle in the input.
    pub(super) index: [u32; N],
    /// Surface of each triangle.
    pub(super) id: [u32; N],
}

impl<const N: usize> Block<N> {
    /// No triangles: NaN compares false with everything, so nothing hits them.
    pub(super) const EMPTY: Self = Self { corners: [[[f64::NAN; N]; 3]; 3], index: [u32::MAX; N], id: [u32::MAX; N] };

    pub(super) fn set(&mut self, lane: usize, triangle: &[DVec3; 3], index: u32, id: u32) {
        for (rows, corner) in self.corners.iter_mut().zip(triangle) {
            for (row, value) in rows.iter_mut().zip(corner.to_array()) {
                row[lane] = value;
            }
        }
        self.index[lane] = index;
        self.id[lane] = id;
    }

    pub(super) fn triangle(&self, lane: usize) -> [DVec3; 3] {
        let [a, b, c] = &self.corners;
        [a, b, c].map(|rows| DVec3::new(rows[0][lane], rows[1][lane], rows[2][lane]))
    }
}

/// A ray origin + t · direction, prepared for the watertight test: the axes are permuted so that the direction is
/// longest along the last, and space is sheared so that it *is* the last.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    pub(super) origin: DVec3,
    pub(super) direction: DVec3,
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

/// What the edge functions say about the triangles of a block.
pub(super) struct Crossings<const N: usize> {
    /// Bit k: the line meets triangle k, borders included.
    pub(super) mask: u32,
    /// Edge functions opposite to each corner, by corner; divided by their sum they are the barycentric coordinates.
    pub(super) edges: [[f64; N]; 3],
    /// Sum of the edge functions.
    pub(super) sum: [f64; N],
    /// Ray parameter.
    pub(super) t: [f64; N],
}

impl Ray {
    /// The segment between two points, t from 0 to 1; `None` if it has no direction.
    #[inline]
    pub(super) fn segment(from: DVec3, to: DVec3) -> Option<Self> {
        let guard = from.abs().max(to.abs()).max_element() * (GUARD * f64::EPSILON);
        Self::new(from, to - from, 1.0, guard, true)
    }

    /// The ray up to t = `end`, which may be infinite; `None` if it has no direction.
    #[inline]
    pub(super) fn open(origin: DVec3, direction: DVec3, end: f64) -> Option<Self> {
        Self::new(origin, direction, end, origin.abs().max_element() * (GUARD * f64::EPSILON), false)
    }

    #[inline]
    fn new(origin: DVec3, direction: DVec3, end: f64, guard: f64, closed: bool) -> Option<Self> {
        let size = direction.abs();
        let last = if size.x > size.y && size.x > size.z {
            0
        } else if size.y > size.z {
            1
        } else {
            2
        };
        let axes = [[1, 2, 0], [2, 0, 1], [0, 1, 2]][last];
        let (d, o) = (direction.to_array(), origin.to_array());
        let (d, start) = (axes.map(|axis| d[axis]), axes.map(|axis| o[axis]));
        let usable = d[2] != 0.0 && direction.is_finite() && origin.is_finite() && end > 0.0;
        let shear = [d[0] / d[2], d[1] / d[2], 1.0 / d[2]];
        usable.then_some(Self { origin, direction, end, axes, start, shear, guard, closed })
    }

    /// The watertight test of Woop et al. (2013).
    ///
    /// An edge function is a difference of two products. Rounding is monotonic, so its computed sign is never opposite
    /// to the true sign of the sheared corners, only zero too often, and zero counts as inside. It must not be
    /// contracted to a fused multiply-add: the two triangles at an edge have to see exactly opposite values.
    #[inline]
    pub(super) fn cross<const N: usize>(&self, block: &Block<N>) -> Crossings<N> {
        let mut x = [[0.0; N]; 3];
        let mut y = [[0.0; N]; 3];
        let mut z = [[0.0; N]; 3];
        let [ox, oy, oz] = self.start;
        let [sx, sy, sz] = self.shear;
        for corner in 0..3 {
            let [cx, cy, cz] = self.axes.map(|axis| &block.corners[corner][axis]);
            for k in 0..N {
                let depth = cz[k] - oz;
                x[corner][k] = (cx[k] - ox) - sx * depth;
                y[corner][k] = (cy[k] - oy) - sy * depth;
                z[corner][k] = sz * depth;
            }
        }
        let mut edges = [[0.0; N]; 3];
        for (corner, edge) in edges.iter_mut().enumerate() {
            let (i, j) = ((corner + 1) % 3, (corner + 2) % 3);
            for k in 0..N {
                edge[k] = x[j][k] * y[i][k] - y[j][k] * x[i][k];
            }
        }
        let mut found = Crossings { mask: 0, edges, sum: [0.0; N], t: [0.0; N] };
        for k in 0..N {
            let signed = edges.map(|edge| edge[k]);
            found.sum[k] = signed[0] + signed[1] + signed[2];
            let inside = signed.iter().all(|&e| e >= 0.0) || signed.iter().all(|&e| e <= 0.0);
            found.mask |= u32::from(inside && found.sum[k] != 0.0) << k;
        }
        if found.mask != 0 {
            for k in 0..N {
                let depth = edges[0][k] * z[0][k] + edges[1][k] * z[1][k] + edges[2][k] * z[2][k];
                found.t[k] = depth / found.sum[k];
            }
        }
        found
    }

    /// Whether a crossing of triangle `lane` at `t` lies strictly between the ends.
    #[inline]
    pub(super) fn counts<const N: usize>(&self, block: &Block<N>, lane: usize, t: f64) -> bool {
        if !(t > 0.0 && t < self.end) {
            return false;
        }
        let [a, b, c] = block.triangle(lane);
        let normal = (b - a).cross(c - a);
        let (speed, guard) = (normal.dot(self.direction).abs(), self.guard * normal.length());
        t * speed > guard && (!self.closed || (self.end - t) * speed > guard)
    }

    /// Whether one of the crossings `found` with a block is of a triangle that is not on a surface of `skip`.
    #[inline(always)]
    pub(super) fn blocked_by<const N: usize>(&self, found: &Crossings<N>, block: &Block<N>, skip: [u32; 2]) -> bool {
        let mut mask = found.mask;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            if !skip.contains(&block.id[lane]) && self.counts(block, lane, found.t[lane]) {
                return true;
            }
        }
        false
    }

    /// Whether a triangle whose edge functions sum to `sum` shows its front, the side it is counter-clockwise from.
    #[inline]
    pub(super) fn sees_front(&self, sum: f64) -> bool {
        (sum > 0.0) == (self.shear[2] > 0.0)
    }
}

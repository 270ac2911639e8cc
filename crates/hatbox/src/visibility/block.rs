//! The triangles of a part of a leaf as they were given, for the test that decides, of all of them at once.
//!
//! Where f32 holds all corners exactly, as they come from most files, they are kept in f32: the test is the same, and
//! reads three lines of the cache instead of five (`closest` and `closest in f64` of `benches/embree/run`).

use super::build::LEAF;
use super::exact::{Crossing, Ray, Triangle};
use super::lanes::{Doubles, Lanes};
use super::pages::Pages;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Up to [`LEAF`] triangles.
pub(super) trait Block: Pod + Send + Sync {
    const EMPTY: Self;

    fn set(&mut self, lane: usize, triangle: &Triangle);

    /// The triangle of a lane; its index is `u32::MAX` if there is none.
    fn triangle(&self, lane: usize) -> Triangle;

    /// A coordinate of a corner of all.
    fn row<L: Lanes>(&self, lanes: L, corner: usize, axis: usize) -> L::Doubles;

    /// Where a line crosses the triangles, at parameters no greater than `until`: the arithmetic of [`Ray::cross`].
    #[inline(always)]
    fn crossed_by<L: Lanes>(&self, lanes: L, ray: &Ray, until: f64) -> Crossings {
        let [i, j, k] = ray.axes;
        let ([x, y, z], [to_x, to_y, to_z]) = (ray.start, ray.shear);
        let start = [lanes.doubles_splat(x), lanes.doubles_splat(y), lanes.doubles_splat(z)];
        let shear = [lanes.doubles_splat(to_x), lanes.doubles_splat(to_y), lanes.doubles_splat(to_z)];
        let (mut x, mut y, mut z) = ([start[0]; 3], [start[1]; 3], [start[2]; 3]);
        for corner in 0..3 {
            z[corner] = self.row(lanes, corner, k).sub(start[2]);
            x[corner] = self.row(lanes, corner, i).sub(start[0]).sub(shear[0].mul(z[corner]));
            y[corner] = self.row(lanes, corner, j).sub(start[1]).sub(shear[1].mul(z[corner]));
        }
        let [u, v, w] = [
            x[2].mul(y[1]).sub(y[2].mul(x[1])),
            x[0].mul(y[2]).sub(y[0].mul(x[2])),
            x[1].mul(y[0]).sub(y[1].mul(x[0])),
        ];
        let zero = lanes.doubles_splat(0.0);
        let inside = zero.at_most(least([u, v, w])) | most([u, v, w]).at_most(zero);
        if inside == 0 {
            return Crossings::NONE;
        }
        let below = least(x).at_most(zero) & least(y).at_most(zero);
        let above = zero.at_most(most(x)) & zero.at_most(most(y));
        let sum = u.add(v).add(w);
        let [a, b, c] = [shear[2].mul(z[0]), shear[2].mul(z[1]), shear[2].mul(z[2])];
        // Where the sum is zero all three are, and t is NaN, which is at most nothing.
        let t = u.mul(a).add(v.mul(b)).add(w.mul(c)).div(sum);
        let found = inside & below & above & t.at_most(lanes.doubles_splat(until));
        let edges = [u.to_array(), v.to_array(), w.to_array()];
        Crossings { found, edges, sum: sum.to_array(), t: t.to_array() }
    }
}

macro_rules! block {
    ($(#[$doc:meta])* $name:ident, $number:ty, $rest:expr, $load:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, Pod, Zeroable)]
        #[repr(C, align(64))]
        pub(super) struct $name {
            /// Corner, axis, triangle; NaN, which is never hit, where there is none.
            corners: [[[$number; LEAF]; 3]; 3],
            /// Indices in the input; `u32::MAX` where there is none.
            index: [u32; LEAF],
            /// Surfaces.
            id: [u32; LEAF],
            _rest: [u32; $rest],
        }

        impl Block for $name {
            const EMPTY: Self = Self {
                corners: [[[<$number>::NAN; LEAF]; 3]; 3],
                index: [u32::MAX; LEAF],
                id: [u32::MAX; LEAF],
                _rest: [0; $rest],
            };

            fn set(&mut self, lane: usize, triangle: &Triangle) {
                for (rows, corner) in self.corners.iter_mut().zip(triangle.corners) {
                    for (row, x) in rows.iter_mut().zip(corner.to_array()) {
                        row[lane] = x as $number;
                    }
                }
                self.index[lane] = triangle.index;
                self.id[lane] = triangle.id;
            }

            #[inline(always)]
            fn triangle(&self, lane: usize) -> Triangle {
                let [a, b, c] = &self.corners;
                let corner = |[x, y, z]: &[[$number; LEAF]; 3]| {
                    DVec3::new(f64::from(x[lane]), f64::from(y[lane]), f64::from(z[lane]))
                };
                Triangle { corners: [corner(a), corner(b), corner(c)], index: self.index[lane], id: self.id[lane] }
            }

            #[inline(always)]
            fn row<L: Lanes>(&self, lanes: L, corner: usize, axis: usize) -> L::Doubles {
                lanes.$load(&self.corners[corner][axis])
            }
        }
    };
}

block!(
    /// With corners in f64.
    Wide,
    f64,
    0,
    doubles
);
block!(
    /// With corners in f32.
    Narrow,
    f32,
    4,
    doubles_of_singles
);

/// All parts of leaves.
#[derive(Debug, Clone)]
pub(super) enum Blocks {
    Wide(Pages<Wide>),
    Narrow(Pages<Narrow>),
}

impl Blocks {
    /// Room for some parts; `exact` says whether f32 holds all corners.
    pub(super) fn zeroed(len: usize, exact: bool) -> Self {
        if exact { Self::Narrow(Pages::zeroed(len)) } else { Self::Wide(Pages::zeroed(len)) }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Wide(all) => all.len(),
            Self::Narrow(all) => all.len(),
        }
    }

    /// Memory in bytes.
    pub(super) fn bytes(&self) -> usize {
        match self {
            Self::Wide(all) => size_of_val(&**all),
            Self::Narrow(all) => size_of_val(&**all),
        }
    }

    /// The triangle of a lane of a part; its index is `u32::MAX` if there is none.
    #[inline]
    pub(super) fn triangle(&self, part: usize, lane: usize) -> Triangle {
        match self {
            Self::Wide(all) => all[part].triangle(lane),
            Self::Narrow(all) => all[part].triangle(lane),
        }
    }

    /// The triangles of a part.
    pub(super) fn triangles(&self, part: usize) -> impl Iterator<Item = Triangle> {
        (0..LEAF).map(move |lane| self.triangle(part, lane)).filter(|triangle| triangle.index != u32::MAX)
    }

    /// All triangles.
    pub(super) fn all(&self) -> impl Iterator<Item = Triangle> {
        (0..self.len()).flat_map(|part| self.triangles(part))
    }
}

/// Whether f32 holds a triangle exactly.
pub(super) fn is_single(triangle: &[DVec3; 3]) -> bool {
    triangle.iter().all(|corner| corner.as_vec3().as_dvec3() == *corner)
}

#[inline(always)]
fn least<D: Doubles>([a, b, c]: [D; 3]) -> D {
    a.min(b).min(c)
}

#[inline(always)]
fn most<D: Doubles>([a, b, c]: [D; 3]) -> D {
    a.max(b).max(c)
}

/// Where a line crosses the triangles of a leaf.
pub(super) struct Crossings {
    /// Those that it does cross, as bits.
    found: u32,
    edges: [[f64; LEAF]; 3],
    sum: [f64; LEAF],
    t: [f64; LEAF],
}

impl Crossings {
    const NONE: Self = Self { found: 0, edges: [[0.0; LEAF]; 3], sum: [0.0; LEAF], t: [0.0; LEAF] };

    /// Takes out the next, with the lane of its triangle.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<(usize, Crossing)> {
        if self.found == 0 {
            return None;
        }
        let lane = self.found.trailing_zeros() as usize;
        self.found &= self.found - 1;
        let [u, v, w] = &self.edges;
        Some((lane, Crossing { edges: [u[lane], v[lane], w[lane]], sum: self.sum[lane], t: self.t[lane] }))
    }
}

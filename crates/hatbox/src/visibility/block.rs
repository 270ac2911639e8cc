//! The triangles of a leaf in f64, for the test that decides, of all of them at once.

use super::build::LEAF;
use super::exact::{Ray, Triangle};
use super::lanes::{Doubles, Lanes};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Up to [`LEAF`] triangles as they were given.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Block {
    /// Corner, axis, triangle; NaN, which is never hit, where there is none.
    corners: [[[f64; LEAF]; 3]; 3],
    /// Indices in the input; `u32::MAX` where there is none.
    index: [u32; LEAF],
    /// Surfaces.
    id: [u32; LEAF],
}

impl Block {
    pub(super) const EMPTY: Self =
        Self { corners: [[[f64::NAN; LEAF]; 3]; 3], index: [u32::MAX; LEAF], id: [u32::MAX; LEAF] };

    pub(super) fn set(&mut self, lane: usize, triangle: &Triangle) {
        for (rows, corner) in self.corners.iter_mut().zip(triangle.corners) {
            for (row, x) in rows.iter_mut().zip(corner.to_array()) {
                row[lane] = x;
            }
        }
        self.index[lane] = triangle.index;
        self.id[lane] = triangle.id;
    }

    /// The triangle of a lane.
    #[inline(always)]
    pub(super) fn triangle(&self, lane: usize) -> Triangle {
        let [a, b, c] = &self.corners;
        let corner = |[x, y, z]: &[[f64; LEAF]; 3]| DVec3::new(x[lane], y[lane], z[lane]);
        Triangle { corners: [corner(a), corner(b), corner(c)], index: self.index[lane], id: self.id[lane] }
    }

    /// Its triangles.
    pub(super) fn triangles(&self) -> impl Iterator<Item = Triangle> {
        (0..LEAF).filter(|&lane| self.index[lane] != u32::MAX).map(|lane| self.triangle(lane))
    }

    /// The triangles that a line passes, by the edge functions of [`Ray::cross`], as bits: the same arithmetic.
    #[inline(always)]
    pub(super) fn passed_by<L: Lanes>(&self, lanes: L, ray: &Ray) -> u32 {
        let [i, j, k] = ray.axes;
        let [x, y, z] = ray.start;
        let start = [lanes.doubles_splat(x), lanes.doubles_splat(y), lanes.doubles_splat(z)];
        let (x_shear, y_shear) = (lanes.doubles_splat(ray.shear[0]), lanes.doubles_splat(ray.shear[1]));
        let (mut x, mut y) = ([start[0]; 3], [start[1]; 3]);
        for corner in 0..3 {
            let rows = &self.corners[corner];
            let z = lanes.doubles(&rows[k]).sub(start[2]);
            x[corner] = lanes.doubles(&rows[i]).sub(start[0]).sub(x_shear.mul(z));
            y[corner] = lanes.doubles(&rows[j]).sub(start[1]).sub(y_shear.mul(z));
        }
        let edges = [
            x[2].mul(y[1]).sub(y[2].mul(x[1])),
            x[0].mul(y[2]).sub(y[0].mul(x[2])),
            x[1].mul(y[0]).sub(y[1].mul(x[0])),
        ];
        let least = edges[0].min(edges[1]).min(edges[2]);
        let most = edges[0].max(edges[1]).max(edges[2]);
        let zero = lanes.doubles_splat(0.0);
        zero.at_most(least) | most.at_most(zero)
    }
}

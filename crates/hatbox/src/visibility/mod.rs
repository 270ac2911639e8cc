//! What lies between two points, and what can lie between two polygons.
//!
//! A pair of elements is in one of three states: *proven* fully visible ([`Shaft`] finds nothing between them), *proven*
//! fully blocked ([`Shaft::fully_blocked_by`]), or neither, and then visibility is a function of the two points, asked
//! for by rays at the quadrature nodes. It is never one number per pair.
//!
//! Three decisions:
//!
//! - **The triangle test is exact where it matters.** It is the watertight test of Woop, Benthin and Wald (2013) in f64:
//!   a ray cannot pass between two triangles that share an edge or a vertex, so a sealed dark room stays exactly dark.
//!   All implementations, the brute-force reference included, share it, so they agree bit for bit.
//! - **There is no ray epsilon.** The surfaces of the two end elements are excluded by their ids. A crossing counts
//!   strictly between the ends; the only guard is one of rounding: a crossing does not count if an end of the segment
//!   lies within [`GUARD`] units in the last place (of the greatest coordinate of the ends) of the blocker's *plane*.
//!   Such an end lies on that plane as far as f64 can tell. Measuring along the plane's normal instead of along the ray
//!   keeps grazing rays from catching on coplanar neighbours.
//! - **f32 only where it cannot decide.** The [`Bvh`] culls with f32 boxes that are rounded outward and tested
//!   conservatively, in coordinates normalised to the scene. Whether a segment is blocked is asked of f32 corners first,
//!   by a test with bounds of its error, which settles what is surely missed and surely crossed (`leaf`); the rest goes
//!   to the f64 test. The first crossing of a ray is sought in f64 at once (`block`). So booleans and hits are those of
//!   [`BruteForce`], bit for bit, with every [`InstructionSet`] (`fuzz`).
//!
//! A kernel is written once, over vectors (`lanes`) that are arrays, AVX2 or AVX-512 registers. Kernels hold no closures
//! and no `map`: those are compiled for the lesser processor and are not inlined, which costs a factor of two.
//!
//! [`Visibility::occluded_packet`] asks for up to 16 segments between two elements at once. Nodes are tested against
//! the hull of all segments, at the price of one ray; leaves against each ray's box test, and their triangles against
//! all rays.
//!
//! Tried and dropped, with figures of the spheres of 72 000 triangles of `benches/embree`:
//!
//! - a system library for rays: the build is to need nothing but cargo;
//! - deciding in single precision: it leaks at 1e-7 of the scene;
//! - leaves in f64 only: 0.8 to 0.9 of Embree's speed on single any-hit rays, 0.2 on packets asked ray by ray;
//! - the widest child first in any-hit queries: slower by an eighth than the narrowest first;
//! - first crossings by the f32 test too, decided in f64 at the end: slower than f64 at once, the more so the more
//!   triangles there are, since the ray then waits for a triangle that no cache holds;
//! - two-megabyte pages through glibc's tunables: nothing. By maps of their own (`pages`), with memory asked for a step
//!   ahead, they are kept: they help where the tree is larger than the caches;
//! - boxes of nodes in steps of sixteen bits, which halve nodes: slower where the tree lies in the caches, faster where it
//!   does not (1.5 million triangles); leaves of several parts do better there and cost nothing elsewhere;
//! - points given to the kernels as structures: they are read in other widths than they were written, and waited for;
//! - testing each ray of a packet against the boxes of inner nodes too: no gain over leaves only.

#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "AVX2 and AVX-512 intrinsics, behind detection at run time")
)]
#![expect(
    clippy::needless_range_loop,
    reason = "several arrays run in step, and iterators are not inlined into kernels"
)]
#![expect(clippy::needless_bitwise_bool, reason = "branches that cannot be guessed are avoided")]
#![expect(clippy::inline_always, reason = "kernels must be inlined into functions compiled for their instruction set")]

mod block;
mod build;
mod bvh;
mod closest;
mod exact;
mod lanes;
mod leaf;
mod merge;
mod nearest;
mod node;
mod occluders;
mod packet;
mod pages;
mod shaft;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use bvh::{Bvh, Hit, InstructionSet};
pub use exact::GUARD;
pub use nearest::Nearest;
pub use occluders::Occluders;
pub(crate) use pages::{Pages, prefetch};
pub use shaft::{Body, Shaft, ShaftResult};

use exact::{Ray, Triangle};
use glam::DVec3;

/// Says whether something opaque lies between two points.
pub trait Visibility: Sync {
    /// Whether a surface other than the two of `skip` crosses the segment strictly between its ends.
    ///
    /// `skip` are the surfaces that the ends lie on, which never block their own elements. Surfaces block from both
    /// sides. A segment of zero length or with coordinates that are not finite is not occluded.
    fn occluded(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> bool;

    /// [`Visibility::occluded`] for up to [`PACKET`] segments between the same two surfaces: bit k is set if the segment
    /// from `from[k]` to `to[k]` is occluded.
    ///
    /// # Panics
    /// If there are more segments than that, or not as many ends as beginnings.
    fn occluded_packet(&self, from: &[DVec3], to: &[DVec3], skip: [u32; 2]) -> u32 {
        check_packet(from, to);
        one_by_one(self, from, to, skip)
    }
}

fn check_packet(from: &[DVec3], to: &[DVec3]) {
    assert!(from.len() == to.len() && from.len() <= PACKET, "at most {PACKET} segments, each with two ends");
}

fn one_by_one<V: Visibility + ?Sized>(visibility: &V, from: &[DVec3], to: &[DVec3], skip: [u32; 2]) -> u32 {
    let blocked = |(k, (&from, &to)): (usize, (&DVec3, &DVec3))| u32::from(visibility.occluded(from, to, skip)) << k;
    from.iter().zip(to).enumerate().map(blocked).sum()
}

/// Segments of [`Visibility::occluded_packet`].
pub const PACKET: usize = 16;

/// Nothing is in the way: convex rooms, and tests of everything else.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unoccluded;

impl Visibility for Unoccluded {
    fn occluded(&self, _from: DVec3, _to: DVec3, _skip: [u32; 2]) -> bool {
        false
    }
}

/// Tests every triangle: the reference that [`Bvh`] must agree with.
#[derive(Debug, Clone)]
pub struct BruteForce {
    triangles: Vec<Triangle>,
}

impl BruteForce {
    /// From triangles and the id of the surface that each belongs to.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn new(triangles: &[[DVec3; 3]], ids: &[u32]) -> Self {
        assert_eq!(triangles.len(), ids.len(), "one id per triangle");
        let triangle =
            |(index, (&corners, &id)): (usize, (&[DVec3; 3], &u32))| Triangle { corners, index: index as u32, id };
        Self { triangles: triangles.iter().zip(ids).enumerate().map(triangle).collect() }
    }
}

impl Visibility for BruteForce {
    fn occluded(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> bool {
        let Some(ray) = Ray::segment(from, to) else { return false };
        self.triangles.iter().any(|triangle| ray.blocked_by(triangle, skip))
    }
}

#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod tests;

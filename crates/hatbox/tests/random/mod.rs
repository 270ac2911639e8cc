//! Random numbers that are the same every time.

use glam::{DQuat, DVec3};
use hatbox::quadrature::sequence::hash;
use std::f64::consts::TAU;

/// Random numbers: a seed and a counter.
pub(crate) struct Random(u64, u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed, 0)
    }

    /// Uniform in [lo, hi).
    pub(crate) fn uniform(&mut self, lo: f64, hi: f64) -> f64 {
        self.1 += 1;
        lo + (hi - lo) * (hash(self.0, self.1) >> 11) as f64 / 2f64.powi(53)
    }

    /// An index below n.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.uniform(0.0, n as f64) as usize).min(n - 1)
    }

    /// A size between two, uniform on a logarithmic scale.
    pub(crate) fn size(&mut self, lo: f64, hi: f64) -> f64 {
        self.uniform(lo.ln(), hi.ln()).exp()
    }

    pub(crate) fn direction(&mut self) -> DVec3 {
        let z = self.uniform(-1.0, 1.0);
        let (sin, cos) = self.uniform(0.0, TAU).sin_cos();
        DVec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
    }

    /// A rotation that takes +z to a direction, with a random turn about it.
    pub(crate) fn frame(&mut self, to: DVec3) -> DQuat {
        DQuat::from_rotation_arc(DVec3::Z, to) * DQuat::from_rotation_z(self.uniform(0.0, TAU))
    }
}

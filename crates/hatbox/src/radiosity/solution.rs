//! The solution as a function on the surfaces.

use crate::linalg::{LinearOperator, MultiVector};
use crate::scene::Scene;
use crate::space::FunctionSpace;

/// Which function of the solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Shown {
    /// B, what leaves the surface.
    #[default]
    Radiosity,
    /// E, what arrives.
    Irradiance,
}

/// Radiosity and irradiance as functions on the cells of a scene.
#[derive(Debug, Clone)]
pub struct Solution {
    /// The scene, subdivided as it was solved.
    pub scene: Scene,
    /// The space of both functions.
    pub space: FunctionSpace,
    /// Broken coefficients of B per band.
    pub radiosity: MultiVector,
    /// Broken coefficients of E per band.
    pub irradiance: MultiVector,
}

impl Solution {
    /// The value at a point of a cell, in one band.
    pub fn evaluate(&self, shown: Shown, cell: usize, at: [f64; 2], band: usize) -> f64 {
        let field = match shown {
            Shown::Radiosity => &self.radiosity,
            Shown::Irradiance => &self.irradiance,
        };
        self.space.evaluate(field.band(band), cell, at)
    }

    /// The joined coefficients of B, one per unknown and band: what the system was solved for. The broken ones where
    /// nothing is joined.
    pub fn coefficients(&self) -> MultiVector {
        let Some(continuity) = self.space.continuity() else { return self.radiosity.clone() };
        let mut joined = MultiVector::zeros(continuity.cols(), self.bands());
        for dof in 0..self.radiosity.rows() {
            // A row of C holds a single one: the broken coefficient is that of its set.
            for (unknown, _) in continuity.row(dof) {
                for band in 0..self.bands() {
                    joined.band_mut(band)[unknown] = self.radiosity.band(band)[dof];
                }
            }
        }
        joined
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.radiosity.bands()
    }
}

//! How much memory view factors will take, before it is taken.

use super::{BASIS, Error, Options};
use crate::element::Shape;
use crate::mesh::RefineError;
use crate::scene::Scene;

/// Bytes per pair of elements: the exchange area.
const BYTES_PER_PAIR: u64 = 8;
/// Bytes per element: the cell and its quadrature nodes.
const BYTES_PER_ELEMENT: u64 = 6000;

/// What a computation will take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Estimate {
    /// Number of elements.
    pub elements: usize,
    /// The most bytes held at a time: about N²/2 × 8, since every pair is stored once.
    pub bytes: u64,
}

impl Estimate {
    /// That of so many elements.
    pub(super) fn new(elements: usize) -> Self {
        let n = elements as u64;
        let pairs = n.saturating_mul(n + 1) / 2;
        let bytes = pairs.saturating_mul(BYTES_PER_PAIR).saturating_add(n.saturating_mul(BYTES_PER_ELEMENT));
        Self { elements, bytes }
    }

    /// What the view factors of a scene will take, found out without subdividing it.
    ///
    /// # Errors
    /// [`RefineError`] if the subdivision is impossible.
    pub fn of(scene: &Scene, options: &Options) -> Result<Self, RefineError> {
        let splits = BASIS.quad.is_none() && scene.mesh.cells.iter().any(|cell| cell.shape == Shape::Quad);
        let elements = scene.mesh.refined_count(options.refinement)?;
        Ok(Self::new(if splits { 2 * elements } else { elements }))
    }

    /// Refuses what does not fit.
    pub(super) fn check(self, limit: Option<u64>) -> Result<(), Error> {
        let Self { elements, bytes } = self;
        match limit {
            Some(limit) if bytes > limit => Err(Error::Memory { elements, bytes, limit }),
            _ => Ok(()),
        }
    }
}

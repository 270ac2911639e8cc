//! Subdivisions that become finer towards the edges of the faces.
//!
//! Near an edge radiosity behaves as c + r^β with β < 1, and on a uniform mesh no basis gets beyond the order β + ½. With
//! nodes at t^q from the edge the order of the basis returns if q ≥ (p + 1)/(β + ½): q = 2 for linear functions, 3 for
//! quadratic ones (T. von Petersdorff, E. P. Stephan, "Decompositions in edge and corner singularities …", Math. Methods
//! Appl. Sci. 12, 1990, for the principle). Cells become long and thin along edges, which costs far fewer of them than
//! refinement that keeps their shape.
//!
//! A subdivision is made as always and its vertices are moved: along an edge by g(t) = t^q/(t^q + (1−t)^q), in a quad in
//! both directions, in a triangle by λ_k^q/Σλ_j^q, which is g on its edges. So neighbours still fit.

use super::corner::{Builder, Corner};
use super::{Mesh, RefineError, Refinement};
use crate::element::Shape;

impl Mesh {
    /// [`refined`](Self::refined), with the new vertices at t^q from the edges of the cells that were subdivided; q = 1
    /// leaves them where they are.
    ///
    /// # Errors
    /// [`RefineError`], as for an ungraded subdivision.
    pub fn refined_graded(&self, refinement: Refinement, q: f64) -> Result<Self, RefineError> {
        let (fine, parents) = self.refined_with_parents(refinement)?;
        if q <= 1.0 {
            return Ok(fine);
        }
        let mut vertices = fine.vertices.clone();
        let mut moved = vec![false; vertices.len()];
        moved[..self.vertices.len()].fill(true);
        for (cell, &parent) in fine.cells.iter().zip(&parents) {
            let patch = self.patch(parent as usize);
            for &v in cell.corners() {
                if !std::mem::replace(&mut moved[v as usize], true) {
                    let at = patch.locate(fine.vertices[v as usize]);
                    vertices[v as usize] = patch.point(graded(patch.shape(), at, q));
                }
            }
        }
        let placed = Self { vertices, ..self.clone() };
        let mut builder = Builder::like(&placed);
        for (cell, &parent) in fine.cells.iter().zip(&parents) {
            let corners =
                cell.corners().iter().map(|&v| placed.corner_within(parent as usize, v, placed.vertices[v as usize]));
            builder.push(cell, &corners.collect::<Vec<Corner>>());
        }
        Ok(builder.finish())
    }
}

/// Where a point of the reference cell goes.
fn graded(shape: Shape, [x, y]: [f64; 2], q: f64) -> [f64; 2] {
    // Rounding may leave points outside by the last bits.
    let power = |t: f64| t.max(0.0).powf(q);
    match shape {
        Shape::Quad => [x, y].map(|t| power(t) / (power(t) + power(1.0 - t))),
        Shape::Triangle => {
            let [a, b, c] = [1.0 - x - y, x, y].map(power);
            [b, c].map(|part| part / (a + b + c))
        }
    }
}

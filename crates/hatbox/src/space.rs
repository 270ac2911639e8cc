//! The space of functions in which the radiosity is sought: an element on every cell, joined where the light is
//! continuous.
//!
//! Everything is computed in the *broken* space, where cells share nothing; continuity is a sparse matrix C whose
//! columns are the joined functions (hats) written in broken coefficients. Assembly, elements and operators never hear
//! of it: Δ_hat = CᵀΔC and F̂_hat = CᵀF̂C.

use crate::element::{Basis, Element};
use crate::linalg::Csr;
use crate::mesh::Mesh;

/// An element on every cell of a mesh, and how they are joined.
#[derive(Debug, Clone)]
pub struct FunctionSpace {
    basis: &'static Basis,
    elements: Vec<&'static Element>,
    offsets: Vec<usize>,
    continuity: Option<Csr>,
}

/// A cell has a shape for which the basis has no element; refine the scene for that basis first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cell {cell} is a quad, and the basis `{basis}` has no element for quads; split it into triangles first")]
pub struct NoElement {
    /// Index of the cell.
    pub cell: usize,
    /// Name of the basis.
    pub basis: &'static str,
}

impl FunctionSpace {
    /// The broken space: every cell on its own.
    ///
    /// # Errors
    /// [`NoElement`] if a cell's shape has no element in this basis.
    pub fn broken(mesh: &Mesh, basis: &'static Basis) -> Result<Self, NoElement> {
        let element = |(cell, shape)| basis.element(shape).ok_or(NoElement { cell, basis: basis.name });
        let shapes = mesh.cells.iter().map(|cell| cell.shape).enumerate();
        let elements = shapes.map(element).collect::<Result<Vec<_>, _>>()?;
        let mut offsets = vec![0];
        for element in &elements {
            offsets.push(offsets[offsets.len() - 1] + element.dofs());
        }
        Ok(Self { basis, elements, offsets, continuity: None })
    }

    /// The basis.
    pub fn basis(&self) -> &'static Basis {
        self.basis
    }

    /// The element on a cell.
    pub fn element(&self, cell: usize) -> &'static Element {
        self.elements[cell]
    }

    /// First broken coefficient of each cell, and their number at the end.
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// The broken coefficients of a cell.
    pub fn range(&self, cell: usize) -> std::ops::Range<usize> {
        self.offsets[cell]..self.offsets[cell + 1]
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.elements.len()
    }

    /// Number of broken coefficients.
    pub fn broken_dofs(&self) -> usize {
        self.offsets[self.cells()]
    }

    /// Number of unknowns: of hats if the space is continuous, of broken coefficients otherwise.
    pub fn dofs(&self) -> usize {
        self.continuity.as_ref().map_or(self.broken_dofs(), crate::linalg::LinearOperator::cols)
    }

    /// C, broken coefficients from joined ones; `None` if nothing is joined.
    pub fn continuity(&self) -> Option<&Csr> {
        self.continuity.as_ref()
    }
}

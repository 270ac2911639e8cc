//! The operators of the system, put together from mass, reflectance, exchange and continuity.

use crate::exchange::Exchange;
use crate::linalg::{BlockDiagonal, Csr, Diagonal, LinearOperator, MultiVector};
use crate::progress::Silent;
use crate::solve::{Params, cg};
use crate::space::FunctionSpace;

/// C and Cᵀ; the identity where nothing is joined.
#[derive(Clone)]
pub(super) struct Join {
    matrices: Option<(Csr, Csr)>,
}

impl Join {
    pub(super) fn of(space: &FunctionSpace) -> Self {
        Self { matrices: space.continuity().map(|c| (c.clone(), c.transpose())) }
    }

    /// C x: broken coefficients of a joined function.
    pub(super) fn spread(&self, x: &MultiVector) -> MultiVector {
        self.matrices.as_ref().map_or_else(|| x.clone(), |(c, _)| c.times(x))
    }

    /// Cᵀ x: integrals against the joined functions.
    pub(super) fn collect(&self, x: &MultiVector) -> MultiVector {
        self.matrices.as_ref().map_or_else(|| x.clone(), |(_, ct)| ct.times(x))
    }

    fn unknowns(&self, broken: usize) -> usize {
        self.matrices.as_ref().map_or(broken, |(c, _)| c.cols())
    }
}

/// CᵀΔC.
pub(super) struct Mass<'a> {
    pub(super) join: &'a Join,
    pub(super) mass: &'a BlockDiagonal,
}

impl LinearOperator for Mass<'_> {
    fn rows(&self) -> usize {
        self.join.unknowns(self.mass.rows())
    }
    fn cols(&self) -> usize {
        self.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        *y = self.join.collect(&self.mass.times(&self.join.spread(x)));
    }
}

/// An approximation of (CᵀΔC)⁻¹ that costs nothing: exact where nothing is joined, the inverse of the diagonal else
/// (the condition of a scaled mass matrix of hats is below 10 on any mesh).
pub(super) fn preconditioner(
    join: &Join,
    mass: &BlockDiagonal,
    inverse: &BlockDiagonal,
) -> Box<dyn LinearOperator + Send> {
    let Some((c, _)) = &join.matrices else { return Box::new(inverse.clone()) };
    let mut diagonal = vec![0.0; c.cols()];
    for (row, column, value) in mass.triplets(0) {
        for (i, ci) in c.row(row as usize) {
            for (_, cj) in c.row(column as usize).filter(|&(j, _)| j == i) {
                diagonal[i] += ci * value * cj;
            }
        }
    }
    Box::new(Diagonal(diagonal.into_iter().map(|d| 1.0 / d).collect()))
}

/// (CᵀΔC)⁻¹, by conjugate gradients where it is no block matrix.
pub(super) struct InverseMass<'a> {
    pub(super) mass: Mass<'a>,
    pub(super) preconditioner: &'a dyn LinearOperator,
}

impl LinearOperator for InverseMass<'_> {
    fn rows(&self) -> usize {
        self.mass.rows()
    }
    fn cols(&self) -> usize {
        self.mass.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        self.preconditioner.apply(x, y);
        if self.mass.join.matrices.is_some() {
            let params = Params { tolerance: 1e-13, max_iterations: 200, ..Params::default() };
            // Rounding may keep it from the last digit; what is reached is what can be.
            let _ = cg(&self.mass, self.preconditioner, x, y, &params, &Silent);
        }
    }
}

/// F̂ = Cᵀ M_R Δ⁻¹ S C.
pub(super) struct Transport<'a> {
    pub(super) join: &'a Join,
    pub(super) exchange: &'a dyn Exchange,
    pub(super) mass_inverse: &'a BlockDiagonal,
    pub(super) reflectance: &'a BlockDiagonal,
}

impl LinearOperator for Transport<'_> {
    fn rows(&self) -> usize {
        self.join.unknowns(self.exchange.rows())
    }
    fn cols(&self) -> usize {
        self.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        let irradiance = self.mass_inverse.times(&self.exchange.times(&self.join.spread(x)));
        *y = self.join.collect(&self.reflectance.times(&irradiance));
    }
}

/// Δ − F̂.
pub(super) struct Equation<'a> {
    pub(super) mass: Mass<'a>,
    pub(super) transport: Transport<'a>,
}

impl LinearOperator for Equation<'_> {
    fn rows(&self) -> usize {
        self.mass.rows()
    }
    fn cols(&self) -> usize {
        self.mass.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        self.mass.apply(x, y);
        y.add_scaled(-1.0, &self.transport.times(x));
    }
}

/// Cᵀ(Δ − √R S √R)C, for R constant on every element: symmetric and positive definite.
///
/// With b = β + √R c, where β is the emission's projection, Δb = b⁰ + R S b becomes this operator on c, with the right
/// side Cᵀ√R S β; no division by R is needed, so black surfaces are allowed.
pub(super) struct Symmetric<'a> {
    pub(super) mass: Mass<'a>,
    pub(super) exchange: &'a dyn Exchange,
    /// √R for each broken coefficient and band.
    pub(super) root: &'a MultiVector,
}

impl Symmetric<'_> {
    /// Cᵀ √R S x for broken coefficients x.
    pub(super) fn reflected(&self, x: &MultiVector) -> MultiVector {
        let mut y = self.exchange.times(x);
        multiply(&mut y, self.root);
        self.mass.join.collect(&y)
    }

    /// √R C c.
    pub(super) fn scaled(&self, c: &MultiVector) -> MultiVector {
        let mut x = self.mass.join.spread(c);
        multiply(&mut x, self.root);
        x
    }
}

impl LinearOperator for Symmetric<'_> {
    fn rows(&self) -> usize {
        self.mass.rows()
    }
    fn cols(&self) -> usize {
        self.mass.rows()
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        self.mass.apply(x, y);
        y.add_scaled(-1.0, &self.reflected(&self.scaled(x)));
    }
}

fn multiply(x: &mut MultiVector, by: &MultiVector) {
    for (x, b) in x.as_mut_slice().iter_mut().zip(by.as_slice()) {
        *x *= b;
    }
}

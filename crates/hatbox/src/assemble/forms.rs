//! Integrals over one panel at a time.

use crate::element::MAX_DOFS;
use crate::linalg::{BlockDiagonal, LinearOperator, MultiVector};
use crate::quadrature::{Rule, rule};
use crate::scene::{Quantity, Scene};
use crate::space::FunctionSpace;

/// Degree of the rules for data that vary over an element (textures, given functions).
const DATA_DEGREE: usize = 14;

/// Δ_ij = ∫ N_i N_j, in m²: one block per cell.
pub fn mass(scene: &Scene, space: &FunctionSpace) -> BlockDiagonal {
    weighted_blocks(scene, space, 1, |_, _| true, |_, _, _| 1.0)
}

/// (M_R)_ij = ∫ R N_i N_j, in m², for each band.
pub fn weighted_mass(scene: &Scene, space: &FunctionSpace) -> BlockDiagonal {
    let uniform = |cell: usize, band: usize| scene.material(cell).reflectance.uniform(band).is_some();
    let value = |cell: usize, at: [f64; 2], band: usize| {
        let r = &scene.material(cell).reflectance;
        r.uniform(band).unwrap_or_else(|| r.at(&scene.site(cell, at), band))
    };
    weighted_blocks(scene, space, scene.bands, uniform, value)
}

/// (M_ε)_ij = ∫ ε N_i N_j for a function ε of the broken space, given by its coefficients.
pub fn function_weighted_mass(scene: &Scene, space: &FunctionSpace, epsilon: &[f64]) -> BlockDiagonal {
    let value = |cell: usize, at: [f64; 2], _| {
        let functions = space.element(cell).values(at);
        epsilon[space.range(cell)].iter().zip(functions).map(|(e, n)| e * n).sum()
    };
    weighted_blocks(scene, space, 1, |_, _| true, value)
}

/// b⁰_i = ∫ B⁰ N_i, in lm or W, for each band.
pub fn load(scene: &Scene, space: &FunctionSpace) -> MultiVector {
    functional(scene, space, |cell| &scene.material(cell).exitance)
}

/// The L2 projection of a quantity of the materials onto the broken space: Δ⁻¹ ∫ q N_i.
///
/// `None` if a cell has no area.
pub fn project(scene: &Scene, space: &FunctionSpace, of: impl Fn(usize) -> Quantity) -> Option<MultiVector> {
    let quantities: Vec<Quantity> = (0..space.cells()).map(of).collect();
    let right_side = functional(scene, space, |cell| &quantities[cell]);
    Some(mass(scene, space).inverse()?.times(&right_side))
}

/// ∫ q N_i for each band.
fn functional<'a>(scene: &Scene, space: &FunctionSpace, of: impl Fn(usize) -> &'a Quantity) -> MultiVector {
    let mut result = MultiVector::zeros(space.broken_dofs(), scene.bands);
    for cell in 0..space.cells() {
        let quantity = of(cell);
        if quantity.is_zero() {
            continue;
        }
        let element = space.element(cell);
        for band in 0..scene.bands {
            let uniform = quantity.uniform(band);
            let degree = if uniform.is_some() { element.degree + 2 } else { DATA_DEGREE };
            let mut sums = [0.0; MAX_DOFS];
            for_each_node(scene, cell, rule(element.shape, degree), |at, weight| {
                let q = uniform.unwrap_or_else(|| quantity.at(&scene.site(cell, at), band));
                for (sum, n) in sums.iter_mut().zip(element.values(at)) {
                    *sum += weight * q * n;
                }
            });
            for (i, sum) in space.range(cell).zip(sums) {
                result.band_mut(band)[i] = sum;
            }
        }
    }
    result
}

/// ∫ w N_i N_j for each cell and band.
fn weighted_blocks(
    scene: &Scene,
    space: &FunctionSpace,
    bands: usize,
    uniform: impl Fn(usize, usize) -> bool,
    w: impl Fn(usize, [f64; 2], usize) -> f64,
) -> BlockDiagonal {
    let mut blocks = BlockDiagonal::zeros(space.offsets(), bands);
    for cell in 0..space.cells() {
        let element = space.element(cell);
        let n = element.dofs();
        for band in 0..bands {
            // A bilinear map adds up to two degrees through its Jacobian.
            let degree = if uniform(cell, band) { 2 * element.degree + 4 } else { DATA_DEGREE };
            let block = blocks.block_mut(band, cell);
            for_each_node(scene, cell, rule(element.shape, degree), |at, weight| {
                let values = element.values(at);
                let weight = weight * w(cell, at, band);
                for (k, entry) in block.iter_mut().enumerate() {
                    *entry += weight * values[k / n] * values[k % n];
                }
            });
        }
    }
    blocks
}

/// Visits the nodes of a rule on a cell with their weights in m².
fn for_each_node(scene: &Scene, cell: usize, rule: &Rule, mut visit: impl FnMut([f64; 2], f64)) {
    let patch = scene.mesh.patch(cell);
    for (&at, weight) in rule.points.iter().zip(&rule.weights) {
        visit(at, weight * patch.shape().reference_area() * patch.jacobian(at));
    }
}

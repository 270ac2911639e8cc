//! Where the error is: an indicator of each cell, from the solution alone.
//!
//! With g = Δ⁻¹(b⁰ + M_R e), the solution reflected once more and projected onto the broken space, two things show what a
//! cell cannot represent, and neither needs a ray:
//!
//! - g − B̃, what joining has taken away;
//! - g of a joined neighbour, continued into the cell, against g itself in the middle of the cell. Where B is smooth the
//!   difference is a derivative of order p + 1 times h^(p+1), as the error is, and the quotient of the two is a number:
//!   for the projections of x, x², x³ onto piecewise polynomials on a uniform mesh it is 1/12, 1/180, 1/2025 in squares.
//!   Where a shadow's border passes, it is of the size of the jump.
//!
//! Indicators say where to refine; how large the error is on the whole is asked of
//! [`estimate_error`](super::estimate_error). Jumps of value alone, the usual indicator, were tried and dropped: for odd p
//! the projection's error is the same on both sides of an edge, and they vanish with a higher power of h.

use super::Solution;
use crate::assemble::{load, mass, weighted_mass};
use crate::linalg::{BlockDiagonal, LinearOperator, MultiVector};
use crate::mesh::Side;
use crate::space::{CREASE_ANGLE, joints};

/// (mean square of the projection's error)/(difference in the middle)² for degrees 0, 1, 2.
const QUOTIENTS: [f64; 3] = [1.0 / 12.0, 1.0 / 180.0, 1.0 / 2025.0];

/// Δ⁻¹(b⁰ + M_R e) in the broken space: the solution reflected once more. `None` if a cell has no area.
fn reflected_once_more(solution: &Solution) -> Option<MultiVector> {
    let (scene, space) = (&solution.scene, &solution.space);
    let mut g = weighted_mass(scene, space).times(&solution.irradiance);
    g.add_scaled(1.0, &load(scene, space));
    Some(mass(scene, space).inverse()?.times(&g))
}

/// The indicated error of B̃, root of the mean square over each cell, cells × bands in the unit of B.
pub fn local_error(solution: &Solution) -> MultiVector {
    match reflected_once_more(solution) {
        Some(g) => {
            let weight = mass(&solution.scene, &solution.space);
            indicated(solution, &g, &weight, &joints(&solution.scene, CREASE_ANGLE))
        }
        None => MultiVector::zeros(solution.space.cells(), solution.bands()),
    }
}

/// How far a function is in each cell from one that the space has: the second of the two parts of the indicator, for the
/// radiosity of `function` itself in the place of g.
pub(crate) fn roughness(function: &Solution) -> MultiVector {
    let weight = mass(&function.scene, &function.space);
    indicated(function, &function.radiosity, &weight, &joints(&function.scene, CREASE_ANGLE))
}

/// The indicator from g, Δ, and the pairs of cells that are joined.
pub(super) fn indicated(
    solution: &Solution,
    g: &MultiVector,
    mass: &BlockDiagonal,
    joints: &[[Side; 2]],
) -> MultiVector {
    let (space, bands) = (&solution.space, solution.bands());
    let mut squares = MultiVector::zeros(space.cells(), bands);
    let mut own = g.clone();
    own.add_scaled(-1.0, &solution.radiosity);
    let weighted = mass.times(&own);
    for band in 0..bands {
        for cell in 0..space.cells() {
            let area = solution.scene.mesh.patch(cell).area();
            let square: f64 = space.range(cell).map(|k| own.band(band)[k] * weighted.band(band)[k]).sum();
            squares.band_mut(band)[cell] = (square / area).max(0.0);
        }
    }
    for &[a, b] in joints {
        for (to, from) in [(a, b), (b, a)] {
            add_difference(solution, g, [to, from], &mut squares);
        }
    }
    squares.as_mut_slice().iter_mut().for_each(|square| *square = square.sqrt());
    squares
}

/// Adds the square of the difference between a cell and its neighbour's function, continued, in the middle of the cell;
/// each of the cell's edges has its share of two directions.
fn add_difference(solution: &Solution, g: &MultiVector, sides: [Side; 2], squares: &mut MultiVector) {
    let ([cell, other], mesh) = (sides.map(|side| side.cell as usize), &solution.scene.mesh);
    let patch = mesh.patch(cell);
    let (here, there) = (patch.locate(patch.center()), mesh.patch(other).locate(patch.center()));
    let share = 2.0 / patch.corners().len() as f64;
    let quotient = QUOTIENTS[solution.space.element(cell).degree.min(2)];
    for band in 0..g.bands() {
        let value = |cell, at| solution.space.evaluate(g.band(band), cell, at);
        let difference: f64 = value(cell, here) - value(other, there);
        squares.band_mut(band)[cell] += share * quotient * difference * difference;
    }
}

//! What is made of a solution for output.

use super::{Solution, Sources, local_error};
use crate::element::ALL;
use crate::linalg::MultiVector;
use crate::progress::{Interrupted, Progress, Stage};
use crate::quadrature::sequence::hash;
use crate::scene::{Material, Quantity, Scene};
use crate::space::FunctionSpace;
use rayon::prelude::*;

/// The solution with every nodal value of E gathered afresh from B̃, and B = B⁰ + R E there: I. H. Sloan's iterate, half
/// an order more accurate at the nodes, with the direct light of each point its own. The power of the result is close to
/// the solution's and not the same.
///
/// # Errors
/// [`Interrupted`].
pub fn gathered(solution: &Solution, seed: u64, progress: &dyn Progress) -> Result<Solution, Interrupted> {
    let (scene, space) = (&solution.scene, &solution.space);
    let (sources, nodes) = (Sources::all(solution), nodes(space));
    let stage = Stage::begin(progress, "gathering", nodes.len() as u64);
    let values: Result<Vec<Vec<[f64; 2]>>, Interrupted> = nodes
        .par_iter()
        .enumerate()
        .map(|(k, &(cell, node))| {
            progress.advance(1);
            if progress.interrupted() {
                return Err(Interrupted);
            }
            Ok(at_node(scene, &sources, cell, space.element(cell).nodes[node].at, hash(seed, k as u64)))
        })
        .collect();
    drop(stage);
    let values = values?;
    let spread = |which: usize| {
        MultiVector::from_fn(space.broken_dofs(), solution.bands(), |dof, band| match space.continuity() {
            Some(c) => c.row(dof).map(|(unknown, share)| share * values[unknown][band][which]).sum(),
            None => values[dof][band][which],
        })
    };
    Ok(Solution { radiosity: spread(0), irradiance: spread(1), scene: scene.clone(), space: space.clone() })
}

/// For each unknown, the first cell and node that have it.
fn nodes(space: &FunctionSpace) -> Vec<(usize, usize)> {
    let all = (0..space.cells()).flat_map(|cell| (0..space.element(cell).dofs()).map(move |node| (cell, node)));
    let Some(c) = space.continuity() else { return all.collect() };
    let mut first = vec![(usize::MAX, 0); space.dofs()];
    for (dof, place) in all.enumerate() {
        for (unknown, _) in c.row(dof) {
            if first[unknown].0 == usize::MAX {
                first[unknown] = place;
            }
        }
    }
    first
}

/// (B, E) per band at a node of a cell.
fn at_node(scene: &Scene, sources: &Sources<'_>, cell: usize, at: [f64; 2], seed: u64) -> Vec<[f64; 2]> {
    let e = sources.irradiance(cell, at, seed);
    let (material, site) = (scene.material(cell), scene.site(cell, at));
    let of = |(band, &e): (usize, &f64)| [material.leaving(&site, band, e), e];
    e.iter().enumerate().map(of).collect()
}

/// The [`local_error`] as a solution of its own, to be written and drawn like any other: constant on each cell.
pub fn error_of(solution: &Solution) -> Solution {
    let error = local_error(solution);
    // White surfaces that emit nothing show what arrives.
    let white = |material: &Material| Material {
        reflectance: Quantity::gray(1.0),
        exitance: Quantity::gray(0.0),
        ..material.clone()
    };
    let materials = solution.scene.materials.iter().map(white).collect();
    let scene = Scene { materials, ..solution.scene.clone() };
    // Constants have an element for every shape of cell.
    match FunctionSpace::broken(&scene.mesh, &ALL[0]) {
        Ok(space) => Solution { scene, space, radiosity: error.clone(), irradiance: error },
        Err(_) => solution.clone(),
    }
}

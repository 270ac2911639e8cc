//! View factors: which fraction of what leaves one surface reaches another.
//!
//! F is the exchange operator in the basis of constants, divided by the area: `F_ij = S_ij / A_i`. For groups of
//! elements `A_g F_gh = Σ S_ij` over their members. S is symmetric, and so reciprocity `A_i F_ij = A_j F_ji` holds to
//! rounding; the row sums are *not* forced to one here, so that in a closed scene their error is an honest measure of the accuracy.

use crate::element::{ALL, Basis};
use crate::exchange::{self, Dense, Exchange, ExchangeError, Geometry, Statistics};
use crate::mesh::{RefineError, Refinement};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::space::{FunctionSpace, NoElement};
use crate::visibility::Bvh;
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// One constant function per element, on triangles and quads alike.
const BASIS: &Basis = &ALL[0];

/// Between what view factors are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Between {
    /// Every element is a surface.
    #[default]
    Elements,
    /// Every named part of the mesh is one.
    Groups,
    /// All elements of a material are one.
    Materials,
}

/// What a user chooses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Between what.
    pub between: Between,
    /// How the mesh is subdivided; by default each face is one element.
    pub refinement: Refinement,
    /// Relative error that the sum of a row may have.
    pub tolerance: f64,
    /// Seed of all sampling.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self { between: Between::Elements, refinement: Refinement::None, tolerance: 1e-2, seed: 0 }
    }
}

/// Why there are no view factors.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Error {
    /// The mesh cannot be subdivided as asked.
    #[error(transparent)]
    Refine(#[from] RefineError),
    /// The basis has no element for a cell.
    #[error(transparent)]
    NoElement(#[from] NoElement),
    /// The exchange areas were not computed.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
}

/// An element or a group of elements.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// The name of its part or material; where a part has several elements, with its number among them.
    pub name: String,
    /// Its area in m².
    pub area: f64,
}

/// The view factors of a scene.
#[derive(Debug)]
pub struct ViewFactors {
    /// The surfaces, in the order of rows and columns.
    pub surfaces: Vec<Surface>,
    /// Number of elements they consist of.
    pub elements: usize,
    /// Fraction of rays that leave the scene or end on a back, by area; 0 in a closed scene.
    pub escape: f64,
    /// What the exchange areas cost and how far they may be wrong.
    pub statistics: Statistics,
    areas: Areas,
}

/// The exchange areas `A_i F_ij`.
#[derive(Debug)]
enum Areas {
    Elements(Dense),
    /// Row after row.
    Groups(Vec<f64>),
}

/// What the rows of F say about its accuracy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Check {
    /// The smallest sum of a row.
    pub least_row_sum: f64,
    /// The greatest sum of a row.
    pub greatest_row_sum: f64,
    /// In a closed scene the greatest `|1 − Σ_j F_ij|`; in an open one, where sums below one are right, the greatest excess
    /// over one.
    pub max_row_sum_error: f64,
    /// The greatest `|A_i F_ij − A_j F_ji|`, relative to the greater of both.
    pub max_reciprocity_error: f64,
    /// Number of factors that are not zero.
    pub nonzeros: usize,
}

impl ViewFactors {
    /// Computes the view factors of a scene.
    ///
    /// # Errors
    /// [`Error`]; too large a scene is refused before any work.
    pub fn new(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Self, Error> {
        let scene = scene.refined(options.refinement, BASIS)?;
        let space = FunctionSpace::broken(&scene.mesh, BASIS)?;
        let (panels, blockers) = (OnceLock::new(), Arc::new(Bvh::of_surfaces(&scene.surfaces)));
        let geometry = Geometry::new(&scene, &space, &blockers, &panels);
        let params = exchange::Params { seed: options.seed, ..exchange::Params::new(options.tolerance) };
        let dense = Dense::new(&geometry, &params, progress)?;
        let escape = exchange::escape(&geometry, options.seed, progress).map_err(ExchangeError::from)?;
        let (elements, statistics) = (space.cells(), dense.statistics());
        let (surfaces, areas) = match options.between {
            Between::Elements => (element_surfaces(&scene), Areas::Elements(dense)),
            Between::Groups => grouped(&scene, &dense, &scene.mesh.groups, |cell| scene.mesh.cells[cell].group),
            Between::Materials => {
                let names: Vec<String> = scene.materials.iter().map(|material| material.name.clone()).collect();
                grouped(&scene, &dense, &names, |cell| scene.mesh.cells[cell].material)
            }
        };
        Ok(Self { surfaces, elements, escape, statistics, areas })
    }

    /// Number of surfaces.
    pub fn len(&self) -> usize {
        self.surfaces.len()
    }

    /// Whether there are no surfaces.
    pub fn is_empty(&self) -> bool {
        self.surfaces.is_empty()
    }

    /// `F_ij`, the fraction of what leaves surface i that reaches surface j.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        let exchanged = match &self.areas {
            Areas::Elements(dense) => dense.exchange_area(i, j),
            Areas::Groups(areas) => areas[i * self.len() + j],
        };
        exchanged / self.surfaces[i].area
    }

    /// `F_ij` for all j.
    pub fn row(&self, i: usize) -> impl Iterator<Item = f64> + '_ {
        (0..self.len()).map(move |j| self.get(i, j))
    }

    /// Whether no ray leaves the scene.
    pub fn is_closed(&self) -> bool {
        self.escape == 0.0
    }

    /// Looks at all factors.
    pub fn check(&self) -> Check {
        let rows: Vec<(f64, f64, usize)> = (0..self.len()).into_par_iter().map(|i| self.check_row(i)).collect();
        let least = rows.iter().map(|row| row.0).fold(f64::INFINITY, f64::min);
        let greatest = rows.iter().map(|row| row.0).fold(f64::NEG_INFINITY, f64::max);
        let shortfall = if self.is_closed() { 1.0 - least } else { 0.0 };
        Check {
            least_row_sum: least,
            greatest_row_sum: greatest,
            max_row_sum_error: shortfall.max(greatest - 1.0).max(0.0),
            max_reciprocity_error: rows.iter().map(|row| row.1).fold(0.0, f64::max),
            nonzeros: rows.iter().map(|row| row.2).sum(),
        }
    }

    /// The row's sum, its greatest error of reciprocity and the number of its factors.
    fn check_row(&self, i: usize) -> (f64, f64, usize) {
        let (mut sum, mut worst, mut nonzeros) = (0.0, 0.0_f64, 0);
        for (j, factor) in self.row(i).enumerate().filter(|&(_, factor)| factor != 0.0) {
            sum += factor;
            nonzeros += 1;
            let (there, back) = (self.surfaces[i].area * factor, self.surfaces[j].area * self.get(j, i));
            worst = worst.max((there - back).abs() / there.abs().max(back.abs()));
        }
        (sum, worst, nonzeros)
    }
}

/// A surface for each cell, named after its part.
fn element_surfaces(scene: &Scene) -> Vec<Surface> {
    let mesh = &scene.mesh;
    let mut members = vec![0_usize; mesh.groups.len()];
    for cell in &mesh.cells {
        members[cell.group as usize] += 1;
    }
    let mut next = vec![0_usize; mesh.groups.len()];
    let surface = |(index, cell): (usize, &crate::mesh::Cell)| {
        let group = cell.group as usize;
        let number = next[group];
        next[group] += 1;
        let name = &mesh.groups[group];
        let name = if members[group] > 1 { format!("{name}.{number}") } else { name.clone() };
        Surface { name, area: mesh.patch(index).area() }
    };
    mesh.cells.iter().enumerate().map(surface).collect()
}

/// The sums over groups of cells, in the order of `names`; groups without cells are left out.
fn grouped(scene: &Scene, dense: &Dense, names: &[String], group: impl Fn(usize) -> u32) -> (Vec<Surface>, Areas) {
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); names.len()];
    for cell in 0..scene.mesh.cells.len() {
        members[group(cell) as usize].push(cell);
    }
    let area = |cells: &[usize]| cells.iter().map(|&cell| scene.mesh.patch(cell).area()).sum();
    let surfaces = names.iter().zip(&members).filter(|(_, cells)| !cells.is_empty());
    let surfaces: Vec<_> = surfaces.map(|(name, cells)| Surface { name: name.clone(), area: area(cells) }).collect();
    members.retain(|cells| !cells.is_empty());
    let count = members.len();
    let pairs = (0..count * count).into_par_iter().map(|pair| (pair / count, pair % count));
    let exchanged = |(g, h): (usize, usize)| {
        // The lesser group outside, so that both orders add the same numbers in the same order.
        let (from, to) = (&members[g.min(h)], &members[g.max(h)]);
        from.iter().map(|&i| to.iter().map(|&j| dense.exchange_area(i, j)).sum::<f64>()).sum()
    };
    (surfaces, Areas::Groups(pairs.map(exchanged).collect()))
}

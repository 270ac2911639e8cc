//! Which elements make a surface.

use super::matrix::{Areas, Matrix};
use super::{Between, Escapes, Source, Surface};
use crate::exchange::Dense;
use crate::scene::Scene;
use rayon::prelude::*;

/// The surfaces between which factors are wanted.
pub(super) enum Grouping {
    /// Every element is one.
    Elements,
    /// Each of these is one.
    Groups {
        /// Their names.
        names: Vec<String>,
        /// Their elements.
        members: Vec<Vec<usize>>,
    },
}

impl Grouping {
    pub(super) fn new(scene: &Scene, between: Between) -> Self {
        let cells = &scene.mesh.cells;
        match between {
            Between::Elements => Self::Elements,
            Between::Groups => Self::by(scene.mesh.groups.iter(), cells.iter().map(|cell| cell.group)),
            Between::Materials => {
                Self::by(scene.materials.iter().map(|material| &material.name), cells.iter().map(|cell| cell.material))
            }
        }
    }

    /// Groups in the order of their names; those without elements are left out.
    fn by<'a>(names: impl Iterator<Item = &'a String>, group_of: impl Iterator<Item = u32>) -> Self {
        let names: Vec<&String> = names.collect();
        let mut members: Vec<Vec<usize>> = vec![Vec::new(); names.len()];
        for (cell, group) in group_of.enumerate() {
            members[group as usize].push(cell);
        }
        let filled = names.into_iter().zip(members).filter(|(_, cells)| !cells.is_empty());
        let (names, members) = filled.map(|(name, cells)| (name.clone(), cells)).unzip();
        Self::Groups { names, members }
    }

    /// The surfaces; `escapes` are those of the elements.
    pub(super) fn surfaces(&self, scene: &Scene, escapes: &Escapes) -> Vec<Surface> {
        let emittances: Vec<f64> = scene.materials.iter().map(|material| emittance(scene, material)).collect();
        let surface = |name: String, cells: &[usize]| {
            let [mut area, mut emitted, mut escaped, mut squares] = [0.0; 4];
            for &cell in cells {
                let a = scene.mesh.patch(cell).area();
                area += a;
                emitted += a * emittances[scene.mesh.cells[cell].material as usize];
                escaped += a * escapes.fractions[cell];
                squares += (a * escapes.errors[cell]).powi(2);
            }
            let [emittance, escape, escape_error] = [emitted, escaped, squares.sqrt()].map(|sum| sum / area);
            Surface { name, area, emittance, escape, escape_error }
        };
        match self {
            Self::Elements => {
                let names = element_names(scene).into_iter().enumerate();
                names.map(|(cell, name)| surface(name, &[cell])).collect()
            }
            Self::Groups { names, members } => {
                names.iter().zip(members).map(|(name, cells)| surface(name.clone(), cells)).collect()
            }
        }
    }

    /// The exchange areas between the surfaces.
    pub(super) fn matrix(&self, dense: Dense) -> Matrix {
        let Self::Groups { members, .. } = self else {
            let elements = crate::linalg::LinearOperator::rows(&dense);
            return Matrix::new(Areas::Elements(dense), elements);
        };
        let count = members.len();
        let exchanged = |pair: usize| self.sum(pair / count, pair % count, |i, j| dense.exchange_area(i, j));
        Matrix::new(Areas::Table((0..count * count).into_par_iter().map(exchanged).collect()), count)
    }

    /// `A_i F_ij` of two surfaces if nothing stood between their elements.
    pub(super) fn unobstructed(&self, source: &Source<'_>, i: usize, j: usize) -> f64 {
        self.sum(i, j, |a, b| source.unobstructed(a, b))
    }

    /// A sum over the pairs of elements of two surfaces, the same numbers in the same order either way round.
    fn sum(&self, i: usize, j: usize, value: impl Fn(usize, usize) -> f64) -> f64 {
        let Self::Groups { members, .. } = self else { return value(i.min(j), i.max(j)) };
        let (from, to) = (&members[i.min(j)], &members[i.max(j)]);
        from.iter().map(|&a| to.iter().map(|&b| value(a, b)).sum::<f64>()).sum()
    }
}

/// 1 − R, the mean over the bands; of a texture the mean of its texels' extremes.
fn emittance(scene: &Scene, material: &crate::scene::Material) -> f64 {
    use crate::scene::Quantity;
    let reflectance = |band: usize| match (&material.reflectance, material.reflectance.uniform(band)) {
        (_, Some(value)) => value,
        (Quantity::Textured { texture, .. }, None) => {
            let (least, greatest) = texture.range(band);
            material.reflectance.factor(band).unwrap_or(1.0) * f64::midpoint(least, greatest)
        }
        // Of a function nothing is known without a place.
        (_, None) => f64::NAN,
    };
    1.0 - (0..scene.bands).map(reflectance).sum::<f64>() / scene.bands as f64
}

/// A name for each cell, after its part.
fn element_names(scene: &Scene) -> Vec<String> {
    let mesh = &scene.mesh;
    let mut members = vec![0_usize; mesh.groups.len()];
    for cell in &mesh.cells {
        members[cell.group as usize] += 1;
    }
    let mut next = vec![0_usize; mesh.groups.len()];
    let name = |cell: &crate::mesh::Cell| {
        let group = cell.group as usize;
        let number = next[group];
        next[group] += 1;
        let name = &mesh.groups[group];
        if members[group] > 1 { format!("{name}.{number}") } else { name.clone() }
    };
    mesh.cells.iter().map(name).collect()
}

//! Whether a little of a scene has most of its light.
//!
//! Errors are relative to the norm of the reflected light, which squares it: what stands right below a lamp may have nearly all of
//! it, and a solution to one percent is then one of what stands there.

use crate::radiosity::{Shown, Solution};
use serde::Serialize;
use std::collections::BTreeMap;

/// Of the square of the norm, so much is nearly all.
const MOST: f64 = 0.9;
/// Names that are listed.
const NAMES: usize = 3;

/// Where nine tenths of ‖B̃ − B⁰‖² are, the brightest first.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BrightReport {
    /// The share of the area.
    pub area: f64,
    /// The objects that have most of it, at most three.
    pub objects: Vec<String>,
}

impl BrightReport {
    /// From the middles of the cells; all bands count alike. `None` where nothing is reflected.
    pub(super) fn new(solution: &Solution) -> Option<Self> {
        let mesh = &solution.scene.mesh;
        let areas: Vec<f64> = (0..mesh.cells.len()).map(|cell| mesh.patch(cell).area()).collect();
        let mut density = vec![0.0; areas.len()];
        for band in 0..solution.bands() {
            let squares: Vec<f64> = (0..areas.len()).map(|cell| light(solution, cell, band).powi(2)).collect();
            let all: f64 = squares.iter().zip(&areas).map(|(square, area)| square * area).sum();
            if all > 0.0 {
                density.iter_mut().zip(squares).for_each(|(sum, square)| *sum += square / all);
            }
        }
        let mut cells: Vec<usize> = (0..areas.len()).collect();
        cells.sort_by(|&a, &b| density[b].total_cmp(&density[a]));
        let total: f64 = density.iter().zip(&areas).map(|(density, area)| density * area).sum();
        if total.is_nan() || total <= 0.0 {
            return None;
        }
        let (mut sum, mut area, mut objects) = (0.0, 0.0, BTreeMap::<u32, f64>::new());
        for cell in cells {
            if sum >= MOST * total {
                break;
            }
            let here = density[cell] * areas[cell];
            (sum, area) = (sum + here, area + areas[cell]);
            *objects.entry(mesh.cells[cell].group).or_default() += here;
        }
        let mut objects: Vec<(u32, f64)> = objects.into_iter().collect();
        objects.sort_by(|a, b| b.1.total_cmp(&a.1));
        let name = |&(group, _): &(u32, f64)| mesh.groups[group as usize].clone();
        Some(Self { area: area / areas.iter().sum::<f64>(), objects: objects.iter().take(NAMES).map(name).collect() })
    }
}

/// R E in the middle of a cell. (B̃ − B⁰ would have what projection errs by on lamps with textures.)
fn light(solution: &Solution, cell: usize, band: usize) -> f64 {
    let middle = solution.scene.mesh.cells[cell].shape.middle();
    let site = solution.scene.site(cell, middle);
    solution.scene.material(cell).reflectance.at(&site, band) * solution.evaluate(Shown::Irradiance, cell, middle, band)
}

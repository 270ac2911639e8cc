//! The light at points, known better than any solution that is compared with it.
//!
//! Errors are sharp peaks at the feet of doorways and of occluders. Points that lie evenly in the scene meet one of them
//! by chance, with an area that is far too large for it; so each cell of the solution that is asked about has points of
//! its own, more than its share if it is small.

use crate::Result;
use glam::DVec3;
use hatbox::adapt;
use hatbox::element::ALL;
use hatbox::exchange::{self, Dense};
use hatbox::probe::Probe;
use hatbox::progress::Silent;
use hatbox::quadrature::sequence::{hash, point};
use hatbox::radiosity::{Options, Shown, Solution, System};
use hatbox::scene::Scene;
use rayon::prelude::*;
use std::path::Path;

/// So many points lie evenly in the scene, besides one in each cell.
const POINTS: f64 = 12_000.0;
/// The tolerance of the solution that is gathered from.
const FINE: f64 = 0.002;

/// Reflected light that is known.
pub(crate) struct Truth {
    pub(crate) origin: String,
    known: Known,
    within: fn(DVec3) -> bool,
}

enum Known {
    /// B⁰ + R K B̃ for a quadratic solution B̃ to 0.2 %: K smooths what is wrong with it, and shadows are exact.
    Gathered(Box<(System, Solution)>),
    /// Irradiances at points that each stand for an area.
    Table { places: Vec<(DVec3, DVec3)>, areas: Vec<f64>, irradiance: Vec<Vec<f64>> },
}

/// What is reflected at a point that stands for an area, per band: twice as it is, with independent noise that has no part
/// in products, and as it was found.
struct Compared {
    area: f64,
    exact: [Vec<f64>; 2],
    found: Vec<f64>,
}

impl Truth {
    /// Gathered from a fine solution.
    pub(crate) fn gathered(scene: &Scene) -> Result<Self> {
        let defaults = adapt::Options::default();
        let options = adapt::Options {
            // No noise is the truth.
            solve: Options {
                basis: &ALL[3],
                operator: exchange::kind(Dense::NAME).ok_or("no dense operator")?,
                ..defaults.solve
            },
            tolerance: FINE,
            most_coefficients: Some(12_000),
            ..defaults
        };
        let fine = adapt::solve(scene, &options, &Silent)?;
        let origin = format!("gathered from {} quadratic elements", fine.solved.solution.space.cells());
        let known = Known::Gathered(Box::new((fine.system, fine.solved.solution)));
        Ok(Self { origin, known, within: |_| true })
    }

    /// The irradiance of an unbiased path tracer at 6010 points of the Cornell box, whose noise is 0.18 %.
    pub(crate) fn of_the_cornell_box(_: &Scene) -> Result<Self> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/cornell_irradiance.csv");
        let table = std::fs::read_to_string(path)?;
        let rows: Vec<Vec<f64>> = table
            .lines()
            .skip(1)
            .map(|line| line.split(',').map(str::parse).collect())
            .collect::<std::result::Result<_, _>>()?;
        let known = Known::Table {
            places: rows.iter().map(|r| (DVec3::new(r[0], r[1], r[2]), DVec3::new(r[3], r[4], r[5]))).collect(),
            areas: rows.iter().map(|row| row[6]).collect(),
            irradiance: rows.iter().map(|row| row[8..11].to_vec()).collect(),
        };
        Ok(Self { origin: "the irradiance of a path tracer (noise 0.18 %)".to_owned(), known, within: |_| true })
    }

    /// The same where `here` says.
    pub(crate) fn within(self, here: fn(DVec3) -> bool) -> Self {
        Self { within: here, ..self }
    }

    /// The relative L2 error of a solution, the worst band's.
    pub(crate) fn error(&self, solution: &Solution) -> f64 {
        let compared = match &self.known {
            Known::Gathered(fine) => self.in_cells(fine, solution),
            Known::Table { places, areas, irradiance } => {
                let probed = Probe::new(solution).values(places);
                let found = |k: usize| (0..solution.bands()).map(|band| probed.irradiance.band(band)[k]).collect();
                let of = |k: usize| Compared {
                    area: areas[k],
                    exact: [irradiance[k].clone(), irradiance[k].clone()],
                    found: found(k),
                };
                (0..places.len()).map(of).collect()
            }
        };
        let of = |band: usize| {
            // ∫ (found − known)² with the factor 1, ∫ known² with 0.
            let square = |factor: f64| -> f64 {
                let at = |c: &Compared| {
                    c.area * c.exact.iter().map(|exact| factor * c.found[band] - exact[band]).product::<f64>()
                };
                compared.iter().map(at).sum()
            };
            (square(1.0) / square(0.0)).max(0.0).sqrt()
        };
        (0..solution.bands()).map(of).fold(0.0, f64::max)
    }

    /// At points of the cells of a solution.
    fn in_cells(&self, (system, fine): &(System, Solution), solution: &Solution) -> Vec<Compared> {
        let (gather, scene) = (system.gather(fine), &solution.scene);
        let total = scene.mesh.area();
        let of_cell = |cell: usize| -> Vec<Compared> {
            let patch = scene.mesh.patch(cell);
            if !(self.within)(patch.center()) {
                return Vec::new();
            }
            let points = 1 + (POINTS * patch.area() / total) as u32;
            let seed = hash(1, cell as u64);
            let of = |k: u32| {
                let [u, v, ..] = point(seed, k);
                let (at, surface) = (patch.shape().uniform([u, v]), scene.mesh.cells[cell].surface);
                let seeds = [2 * k, 2 * k + 1].map(|k| hash(seed, u64::from(k)));
                let received = gather.independent(patch.point(at), patch.normal(), surface, seeds);
                let (material, site) = (scene.material(cell), scene.site(cell, at));
                let reflected = |e: Vec<f64>| {
                    e.iter().enumerate().map(|(band, e)| material.reflectance.at(&site, band) * e).collect()
                };
                let found = (0..solution.bands()).map(|band| {
                    solution.evaluate(Shown::Radiosity, cell, at, band) - material.exitance.at(&site, band)
                });
                Compared {
                    area: patch.area() / f64::from(points),
                    exact: received.map(reflected),
                    found: found.collect(),
                }
            };
            (0..points).map(of).collect()
        };
        (0..scene.mesh.cells.len()).into_par_iter().flat_map_iter(of_cell).collect()
    }
}

//! The light at points, known better than any solution that is compared with it.

use crate::Result;
use glam::DVec3;
use hatbox::adapt;
use hatbox::element::ALL;
use hatbox::linalg::MultiVector;
use hatbox::mesh::Refinement;
use hatbox::probe::Probe;
use hatbox::progress::Silent;
use hatbox::quadrature::sequence::{hash, point};
use hatbox::radiosity::{Options, Solution};
use hatbox::scene::Scene;
use std::path::Path;

/// Points, one in each cell of a uniform mesh of so many.
const POINTS: usize = 16_000;
/// The tolerance of the solution that is gathered from.
const FINE: f64 = 0.002;

/// Reflected light at points that each stand for an area.
pub(crate) struct Truth {
    pub(crate) origin: String,
    places: Vec<(DVec3, DVec3)>,
    areas: Vec<f64>,
    /// R E, and what turns a solution's B or E into it.
    exact: MultiVector,
    /// B⁰ at each point; `None` where irradiance is compared.
    emitted: Option<MultiVector>,
}

impl Truth {
    /// B⁰ + R K B̃ for a quadratic solution B̃ to 0.2 %: K smooths what is wrong with it, and shadows are exact.
    pub(crate) fn gathered(scene: &Scene) -> Result<Self> {
        let defaults = adapt::Options::default();
        let options = adapt::Options {
            solve: Options { basis: &ALL[3], ..defaults.solve },
            tolerance: FINE,
            most_coefficients: 12_000,
            ..defaults
        };
        let fine = adapt::solve(scene, &options, &Silent)?;
        let gather = fine.system.gather(&fine.solved.solution);
        let uniform = scene.refined(Refinement::Elements(POINTS), &ALL[0])?;
        let (cells, bands) = (uniform.mesh.cells.len(), scene.bands);
        let (mut places, mut areas) = (Vec::new(), Vec::new());
        let (mut exact, mut emitted) = (MultiVector::zeros(cells, bands), MultiVector::zeros(cells, bands));
        for cell in 0..cells {
            let patch = uniform.mesh.patch(cell);
            let [u, v, ..] = point(hash(0, 1), cell as u32);
            let at = if patch.corners().len() == 4 || u + v <= 1.0 { [u, v] } else { [1.0 - u, 1.0 - v] };
            let (x, n) = (patch.point(at), patch.normal());
            let received = gather.irradiance(x, n, uniform.mesh.cells[cell].surface, cell as u64);
            let (material, site) = (uniform.material(cell), uniform.site(cell, at));
            for (band, e) in received.iter().enumerate() {
                exact.band_mut(band)[cell] = material.reflectance.at(&site, band) * e;
                emitted.band_mut(band)[cell] = material.exitance.at(&site, band);
            }
            places.push((x, n));
            areas.push(patch.area());
        }
        let origin = format!("gathered from {} quadratic elements", fine.solved.solution.space.cells());
        Ok(Self { origin, places, areas, exact, emitted: Some(emitted) })
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
        let places = rows.iter().map(|r| (DVec3::new(r[0], r[1], r[2]), DVec3::new(r[3], r[4], r[5]))).collect();
        Ok(Self {
            origin: "the irradiance of a path tracer (noise 0.18 %)".to_owned(),
            places,
            areas: rows.iter().map(|row| row[6]).collect(),
            exact: MultiVector::from_fn(rows.len(), 3, |row, band| rows[row][8 + band]),
            emitted: None,
        })
    }

    /// The same where `here` says.
    pub(crate) fn within(mut self, here: impl Fn(DVec3) -> bool) -> Self {
        for (area, (place, _)) in self.areas.iter_mut().zip(&self.places) {
            *area *= f64::from(u8::from(here(*place)));
        }
        self
    }

    /// The relative L2 error of a solution, the worst band's.
    pub(crate) fn error(&self, solution: &Solution) -> f64 {
        let probed = Probe::new(solution).values(&self.places);
        let of = |band: usize| {
            let (mut error, mut norm) = (0.0, 0.0);
            for (k, area) in self.areas.iter().enumerate() {
                let exact = self.exact.band(band)[k];
                let found = match &self.emitted {
                    Some(emitted) => probed.radiosity.band(band)[k] - emitted.band(band)[k],
                    None => probed.irradiance.band(band)[k],
                };
                error += area * (found - exact).powi(2);
                norm += area * exact * exact;
            }
            (error / norm).sqrt()
        };
        (0..solution.bands()).map(of).fold(0.0, f64::max)
    }
}

//! Time against error on the Cornell box: `cargo bench -p hatbox --bench cornell`.
//!
//! The truth is the irradiance of an unbiased path tracer at 6010 points (relative L2 noise 0.18 %, median 0.21 %). A row
//! of the table is one solve from the scene to the solution, evaluated at these points, and what it is worth with the
//! light of the lamp as it falls on each of them (`hatbox probe --direct`).

#[expect(dead_code, reason = "other benches use the rest")]
mod measure;

use glam::DVec3;
use hatbox::element::ALL;
use hatbox::io::read_scene;
use hatbox::mesh::Refinement;
use hatbox::probe::{Probe, Probed};
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, solve};
use hatbox::scene::Scene;
use measure::cpu_seconds;
use std::error::Error;
use std::path::Path;

/// The heads of [`Reference::column`].
const COLUMNS: &str = "   CPU s       L2   median     95 %";
const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data");

fn main() -> Result<(), Box<dyn Error>> {
    let (scene, _) = read_scene(&Path::new(DATA).join("cornell.obj"))?;
    let reference = Reference::read(&Path::new(DATA).join("cornell_irradiance.csv"))?;
    println!("{:<28}    {:<34}    and direct light at each point", "", "functions");
    println!("{:<10} {:>8} {:>8} {COLUMNS}   {COLUMNS}", "basis", "elements", "unknowns");
    for basis in &ALL {
        for elements in [125, 250, 500, 1000, 2000] {
            row(
                &scene,
                &Options { basis, refinement: Refinement::Elements(elements), ..Options::default() },
                &reference,
            )?;
        }
    }
    Ok(())
}

/// Prints a row.
fn row(scene: &Scene, options: &Options, reference: &Reference) -> Result<(), Box<dyn Error>> {
    let started = cpu_seconds();
    let solved = solve(scene, &Options { error_points: 0, ..*options }, &Silent)?;
    let probe = Probe::new(&solved.solution);
    let plain = reference.column(&probe.values(&reference.points), cpu_seconds() - started);
    let direct = probe.values_with_direct_light(&reference.points, 0, &Silent)?;
    let direct = reference.column(&direct, cpu_seconds() - started);
    let (cells, unknowns) = (solved.solution.space.cells(), solved.unknowns);
    println!("{:<10} {cells:>8} {unknowns:>8} {plain}   {direct}", options.basis.name);
    Ok(())
}

/// What is known of the box.
struct Reference {
    /// Points and normals.
    points: Vec<(DVec3, DVec3)>,
    areas: Vec<f64>,
    irradiance: Vec<[f64; 3]>,
}

impl Reference {
    fn read(path: &Path) -> Result<Self, Box<dyn Error>> {
        let mut reference = Self { points: Vec::new(), areas: Vec::new(), irradiance: Vec::new() };
        for line in std::fs::read_to_string(path)?.lines().skip(1) {
            let row: Vec<f64> = line.split(',').map(str::parse).collect::<Result<_, _>>()?;
            reference.points.push((DVec3::new(row[0], row[1], row[2]), DVec3::new(row[3], row[4], row[5])));
            reference.areas.push(row[6]);
            reference.irradiance.push([row[8], row[9], row[10]]);
        }
        Ok(reference)
    }

    /// Seconds, the relative L2 error, and the median and 95th percentile of the pointwise relative error.
    fn column(&self, found: &Probed, seconds: f64) -> String {
        let (mut error, mut norm, mut pointwise) = (0.0, 0.0, Vec::new());
        for (row, (truth, area)) in self.irradiance.iter().zip(&self.areas).enumerate() {
            let squares = |f: &dyn Fn(usize) -> f64| (0..3).map(|band| f(band).powi(2)).sum::<f64>();
            let e = squares(&|band| found.irradiance.band(band)[row] - truth[band]);
            let n = squares(&|band| truth[band]);
            error += area * e;
            norm += area * n;
            pointwise.push((e / n).sqrt());
        }
        pointwise.sort_by(f64::total_cmp);
        let errors = [(error / norm).sqrt(), pointwise[pointwise.len() / 2], pointwise[pointwise.len() * 95 / 100]];
        let [l2, median, p95] = errors.map(|error| 100.0 * error);
        format!("{seconds:>8.2} {l2:>6.2} % {median:>6.2} % {p95:>6.2} %")
    }
}

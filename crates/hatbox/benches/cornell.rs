//! Time against error on the Cornell box: `cargo bench -p hatbox --bench cornell`.
//!
//! The truth is the irradiance of an unbiased path tracer at 6010 points (relative L2 noise 0.18 %, median 0.21 %). A row
//! of the table is one solve from the file to the solution, without output.

use glam::DVec3;
use hatbox::element::ALL;
use hatbox::io::read_scene;
use hatbox::mesh::Refinement;
use hatbox::progress::Silent;
use hatbox::radiosity::{Options, Shown, Solution, solve};
use hatbox::visibility::Bvh;
use std::path::Path;
use std::time::Instant;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data");

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (scene, _) = read_scene(&Path::new(DATA).join("cornell.obj"))?;
    let table = std::fs::read_to_string(Path::new(DATA).join("cornell_irradiance.csv"))?;
    let reference: Vec<Vec<f64>> =
        table.lines().skip(1).map(|line| line.split(',').map(str::parse).collect()).collect::<Result<_, _>>()?;
    println!(
        "{:<10} {:>8} {:>8} {:>8} {:>9} {:>8} {:>8}",
        "basis", "elements", "unknowns", "seconds", "L2", "median", "95 %"
    );
    for basis in &ALL {
        for elements in [500, 1000, 2000] {
            let refinement = Refinement::Elements(elements);
            let started = Instant::now();
            let solved = solve(&scene, &Options { basis, refinement, error_points: 0, ..Options::default() }, &Silent)?;
            let seconds = started.elapsed().as_secs_f64();
            let [l2, median, p95] = errors(&solved.solution, &reference).map(|e| 100.0 * e);
            let cells = solved.solution.space.cells();
            let unknowns = solved.unknowns;
            println!(
                "{:<10} {cells:>8} {unknowns:>8} {seconds:>8.2} {l2:>7.2} % {median:>6.2} % {p95:>6.2} %",
                basis.name
            );
        }
    }
    Ok(())
}

/// Relative L2 error, and the median and 95th percentile of the pointwise relative error.
fn errors(solution: &Solution, reference: &[Vec<f64>]) -> [f64; 3] {
    let mesh = &solution.scene.mesh;
    let cells: Vec<usize> =
        (0..mesh.cells.len()).flat_map(|cell| mesh.patch(cell).triangles().iter().map(move |_| cell)).collect();
    let triangles: Vec<[DVec3; 3]> = (0..mesh.cells.len())
        .flat_map(|cell| {
            let patch = mesh.patch(cell);
            patch.triangles().iter().map(move |t| t.map(|k| patch.corners()[k]))
        })
        .collect();
    let tree = Bvh::new(&triangles, &cells.iter().map(|&cell| cell as u32).collect::<Vec<_>>());
    let (mut error, mut norm, mut pointwise) = (0.0, 0.0, Vec::new());
    for row in reference {
        let (point, normal) = (DVec3::new(row[0], row[1], row[2]), DVec3::new(row[3], row[4], row[5]));
        let agrees = |t: u32| mesh.patch(cells[t as usize]).normal().dot(normal) > 0.9;
        let Some(nearest) = tree.nearest_point(point, agrees) else { continue };
        let cell = cells[nearest.triangle as usize];
        let at = mesh.patch(cell).locate(nearest.point);
        let found = |band| solution.evaluate(Shown::Irradiance, cell, at, band);
        let squares = |f: &dyn Fn(usize) -> f64| (0..3).map(|band| f(band).powi(2)).sum::<f64>();
        let (e, n) = (squares(&|band| found(band) - row[8 + band]), squares(&|band| row[8 + band]));
        error += row[6] * e;
        norm += row[6] * n;
        pointwise.push((e / n).sqrt());
    }
    pointwise.sort_by(f64::total_cmp);
    [(error / norm).sqrt(), pointwise[pointwise.len() / 2], pointwise[pointwise.len() * 95 / 100]]
}

//! View factors as compressed sparse rows.

use crate::error::unknown;
use crate::run::run;
use crate::scene::Scene;
use hatbox::failure::Failure;
use hatbox::mesh::Refinement;
use hatbox::view_factors::{Between, CLOSURES, Options, ViewFactors};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;

/// Row starts, columns, values, and the rows' areas and names.
type Factors<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Vec<String>,
);

/// View factors between the cells, or between the groups that have any.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "how arguments arrive from Python")]
pub(crate) fn view_factors<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    groups: bool,
    elements: Option<usize>,
    max_edge: Option<f64>,
    tolerance: f64,
    closure: &str,
    threshold: f64,
    memory: Option<u64>,
    seed: u64,
    threads: Option<usize>,
    reporter: Option<&Bound<'py, PyAny>>,
) -> PyResult<Factors<'py>> {
    let Scene { inner, fault, .. } = scene.get();
    let method = CLOSURES.iter().find(|method| method.name == closure);
    let names = || CLOSURES.iter().map(|method| method.name);
    let options = Options {
        between: if groups { Between::Groups } else { Between::Elements },
        refinement: max_edge.map(Refinement::MaxEdge).or(elements.map(Refinement::Elements)).unwrap_or_default(),
        tolerance,
        seed,
        closure: method.ok_or_else(|| unknown("closure", closure, names()))?.kind,
        threshold,
        memory,
    };
    let (found, rows) = run(py, threads, reporter, fault, |progress| {
        let found = ViewFactors::new(inner, &options, progress)?;
        let rows = Rows::of(&found);
        Ok::<_, Failure>((found, rows))
    })?;
    let areas: Vec<f64> = found.surfaces.iter().map(|surface| surface.area).collect();
    let names = found.surfaces.into_iter().map(|surface| surface.name).collect();
    let Rows { starts, columns, values } = rows;
    Ok((starts.into_pyarray(py), columns.into_pyarray(py), values.into_pyarray(py), areas.into_pyarray(py), names))
}

/// What is not zero, row after row.
struct Rows {
    starts: Vec<i64>,
    columns: Vec<i64>,
    values: Vec<f64>,
}

impl Rows {
    fn of(factors: &ViewFactors) -> Self {
        let mut rows = Self { starts: vec![0], columns: Vec::new(), values: Vec::new() };
        let apart = |row: &[(u32, f64)]| row.iter().map(|&(j, value)| (i64::from(j), value)).unzip();
        for (columns, values) in factors.map_nonzeros(|_, row| -> (Vec<i64>, Vec<f64>) { apart(row) }) {
            rows.columns.extend(columns);
            rows.values.extend(values);
            rows.starts.push(rows.columns.len() as i64);
        }
        rows
    }
}

//! What a solve returns.

use crate::arrays;
use crate::error::exception;
use crate::quantity::Fault;
use crate::run::run;
use crate::scene::Scene;
use crate::system;
use glam::DVec3;
use hatbox::bake::bake;
use hatbox::certificate::certify;
use hatbox::io::{self, WriteOptions, npz};
use hatbox::probe::Probe;
use hatbox::radiosity::{self, Shown};
use hatbox::report::Report;
use numpy::ndarray::ArrayView2;
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Radiosity and irradiance as functions on the cells of a scene.
#[pyclass(frozen, module = "hatbox._native")]
pub(crate) struct Solution {
    pub(crate) solution: radiosity::Solution,
    /// What is known of the solve; nothing of a solution from a file.
    report: Option<Report>,
}

impl Solution {
    pub(crate) fn new(solution: radiosity::Solution, report: Report) -> Self {
        Self { solution, report: Some(report) }
    }
}

/// Irradiance and radiosity (bands × points), and what is doubtful about them.
type Values<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Vec<String>);
/// Positions, normals, triangles, values (bands × vertices).
type Triangles<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>, Bound<'py, PyArray2<f64>>);

#[pymethods]
impl Solution {
    /// From a file that `save` wrote as `.npz`.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let solution = py.detach(|| npz::load(&path)).map_err(exception)?;
        Ok(Self { solution, report: None })
    }

    /// Writes a file; the format follows the extension.
    fn save(
        &self,
        py: Python<'_>,
        path: PathBuf,
        threads: Option<usize>,
        reporter: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        run(py, threads, reporter, &Arc::default(), |progress| {
            io::write(&self.solution, &path, &WriteOptions { progress, ..WriteOptions::default() })
        })
    }

    /// What is likely not meant.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.report.as_ref().map(Report::warnings).unwrap_or_default()
    }

    /// B at the nodes, bands × D.
    #[getter]
    fn radiosity<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::shared(slf.as_any(), &slf.get().solution.radiosity)
    }

    /// E at the nodes, bands × D.
    #[getter]
    fn irradiance<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::shared(slf.as_any(), &slf.get().solution.irradiance)
    }

    /// Joined coefficients of B, bands × unknowns.
    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::owned(py, self.solution.coefficients())
    }

    /// The scene, subdivided as it was solved.
    #[getter]
    fn scene(&self) -> Scene {
        Scene::derived(self.solution.scene.clone(), &Arc::<Fault>::default())
    }

    /// Name of the basis.
    #[getter]
    fn basis(&self) -> &'static str {
        self.solution.space.basis().name
    }

    /// First coefficient of each cell, and their number.
    #[getter]
    fn offsets<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u64>> {
        system::offsets(py, &self.solution.space)
    }

    /// Where each coefficient is the value (D, 3).
    #[getter]
    fn nodes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        system::nodes(py, &self.solution.scene, &self.solution.space)
    }

    /// What the solve did, as the JSON of the command line.
    #[getter]
    fn report(&self) -> PyResult<Option<String>> {
        let text = self.report.as_ref().map(serde_json::to_string).transpose();
        text.map_err(|error| PyRuntimeError::new_err(error.to_string()))
    }

    /// What the error is at most: bound, residual, reflectance, number of receivers.
    fn certify(
        &self,
        py: Python<'_>,
        threads: Option<usize>,
        reporter: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(f64, f64, f64, usize)> {
        let found = run(py, threads, reporter, &Arc::default(), |progress| certify(&self.solution, progress))?;
        Ok((found.relative, found.residual, found.reflectance, found.receivers))
    }

    /// E and B at points with normals.
    #[expect(clippy::too_many_arguments, reason = "Python names them")]
    fn probe<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        normals: PyReadonlyArray2<'py, f64>,
        direct: bool,
        gather: bool,
        seed: u64,
        threads: Option<usize>,
    ) -> PyResult<Values<'py>> {
        let sites = sites(points.as_array(), normals.as_array());
        let probed = run(py, threads, None, &Arc::default(), |progress| {
            let probe = Probe::new(&self.solution);
            match (direct, gather) {
                (_, true) => probe.values_gathered(&sites, seed, progress),
                (true, _) => probe.values_with_direct_light(&sites, seed, progress),
                _ => Ok(probe.values(&sites)),
            }
        })?;
        let warnings = probed.warnings();
        Ok((arrays::owned(py, probed.irradiance)?, arrays::owned(py, probed.radiosity)?, warnings))
    }

    /// B (or E) as triangles with values at their vertices.
    fn bake<'py>(&self, py: Python<'py>, irradiance: bool) -> PyResult<Triangles<'py>> {
        let shown = if irradiance { Shown::Irradiance } else { Shown::Radiosity };
        let baked = py.detach(|| bake(&self.solution, shown));
        let vectors = |of: &[DVec3]| arrays::rows(py, of.iter().map(DVec3::to_array).collect());
        let (positions, normals) = (vectors(&baked.positions), vectors(&baked.normals));
        Ok((positions, normals, arrays::rows(py, baked.triangles), arrays::owned(py, baked.values)?))
    }
}

/// Points with their normals.
pub(crate) fn sites(points: ArrayView2<'_, f64>, normals: ArrayView2<'_, f64>) -> Vec<(DVec3, DVec3)> {
    let vector = |row: numpy::ndarray::ArrayView1<'_, f64>| DVec3::new(row[0], row[1], row[2]);
    points.rows().into_iter().zip(normals.rows()).map(|(p, n)| (vector(p), vector(n))).collect()
}

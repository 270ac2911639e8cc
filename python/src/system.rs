//! The finite-element system: what is behind a solve, piece by piece.

use crate::arrays;
use crate::error::{exception, unknown};
use crate::functions::basis;
use crate::quantity::{Fault, Given};
use crate::run::{quickly, run};
use crate::scene::{Scene, repainted, with_bands};
use crate::solution::Solution;
use hatbox::assemble::{self, Accuracy};
use hatbox::linalg::LinearOperator;
use hatbox::mesh::Refinement;
use hatbox::radiosity::{self, Options};
use hatbox::space::Continuity;
use hatbox::{exchange, scene, solve};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use std::sync::Arc;

/// Rows, columns and values of a sparse matrix.
type Triplets<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>);

/// A space on a scene, its mass matrix and its exchange operator.
#[pyclass(frozen, module = "hatbox._native")]
pub(crate) struct System {
    pub(crate) inner: Arc<radiosity::System>,
    /// The scene as it was given.
    pub(crate) given: Arc<scene::Scene>,
    pub(crate) options: Options,
    pub(crate) fault: Arc<Fault>,
}

#[pymethods]
impl System {
    /// Subdivides the scene and builds the operator.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "how arguments arrive from Python")]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        basis_name: &str,
        continuity: &str,
        elements: Option<usize>,
        max_edge: Option<f64>,
        tolerance: f64,
        operator: &str,
        seed: u64,
        threads: Option<usize>,
        reporter: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let Scene { inner, fault, .. } = scene.get();
        let subdivided = max_edge.map(Refinement::MaxEdge).or(elements.map(Refinement::Elements));
        let names = || Continuity::NAMES.iter().map(|(name, _)| *name);
        let kinds = || ["auto"].into_iter().chain(exchange::ALL.iter().map(|kind| kind.name));
        let options = Options {
            basis: basis(basis_name)?,
            continuity: Continuity::named(continuity).ok_or_else(|| unknown("continuity", continuity, names()))?,
            refinement: subdivided.unwrap_or(Refinement::None),
            tolerance,
            operator: exchange::kind(operator).ok_or_else(|| unknown("operator", operator, kinds()))?,
            seed,
            ..Options::default()
        };
        let system = run(py, threads, reporter, fault, |progress| radiosity::System::build(inner, &options, progress))?;
        Ok(Self { inner: Arc::new(system), given: Arc::clone(inner), options, fault: Arc::clone(fault) })
    }

    /// Solves for the scene's own emission.
    fn solve(
        &self,
        py: Python<'_>,
        solver: &str,
        error_points: usize,
        threads: Option<usize>,
        reporter: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Solution> {
        let options = Options { solver: solver_kind(solver)?, error_points, ..self.options };
        let system = &self.inner;
        let solved = run(py, threads, reporter, &self.fault, |progress| system.solved(&options, progress))?;
        Ok(Solution::of(solved, &self.given))
    }

    /// The same operator with other reflectances and exitances, `None` where a material keeps its own.
    fn with_materials(
        &self,
        reflectance: Vec<Option<Given>>,
        exitance: Vec<Option<Given>>,
        bands: usize,
    ) -> PyResult<Self> {
        let materials = repainted(&self.given, reflectance, exitance, &self.fault);
        let mut system = (*self.inner).clone();
        system.set_materials(materials.clone(), self.options.continuity).map_err(exception)?;
        system.scene = with_bands(system.scene, bands);
        let given = scene::Scene { materials, bands: system.scene.bands, ..(*self.given).clone() };
        let fault = Arc::clone(&self.fault);
        Ok(Self { inner: Arc::new(system), given: Arc::new(given), options: self.options, fault })
    }

    /// The scene, subdivided.
    #[getter]
    fn scene(&self) -> Scene {
        Scene::derived(self.inner.scene.clone(), &self.fault)
    }

    /// Number of broken coefficients, and of unknowns.
    #[getter]
    fn dofs(&self) -> (usize, usize) {
        (self.inner.space.broken_dofs(), self.inner.space.dofs())
    }

    /// First coefficient of each cell, and their number.
    #[getter]
    fn offsets<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u64>> {
        offsets(py, &self.inner.space)
    }

    /// Where each broken coefficient is the value (D, 3).
    #[getter]
    fn nodes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        nodes(py, &self.inner.scene, &self.inner.space)
    }

    /// Δ.
    fn mass<'py>(&self, py: Python<'py>) -> Triplets<'py> {
        let mass = assemble::mass(&self.inner.scene, &self.inner.space);
        triplets(py, mass.triplets(0))
    }

    /// M_R in one band.
    fn reflectance_mass<'py>(&self, py: Python<'py>, band: usize) -> PyResult<Triplets<'py>> {
        let (scene, space) = (&self.inner.scene, &self.inner.space);
        if band >= scene.bands {
            return Err(PyIndexError::new_err(format!("band {band} of {} bands", scene.bands)));
        }
        let matrix = quickly(py, None, || assemble::weighted_mass(scene, space))?;
        self.fault.take().map_or_else(|| Ok(triplets(py, matrix.triplets(band))), Err)
    }

    /// C; `None` where nothing is joined.
    fn continuity<'py>(&self, py: Python<'py>) -> Option<Triplets<'py>> {
        let matrix = self.inner.space.continuity()?;
        let row = |i: usize| matrix.row(i).map(move |(j, value)| (i as u32, j as u32, value));
        Some(triplets(py, (0..matrix.rows()).flat_map(row)))
    }

    /// b⁰, bands × D.
    fn load<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (scene, space) = (&self.inner.scene, &self.inner.space);
        let load = quickly(py, None, || assemble::load(scene, space))?;
        self.fault.take().map_or_else(|| arrays::owned(py, load), Err)
    }

    /// S x for every row of x (bands × D).
    fn exchange<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyArray2<f64>>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let x = arrays::multivector(x, self.inner.space.broken_dofs())?;
        arrays::owned(py, quickly(py, threads, || self.inner.exchange.times(&x))?)
    }

    /// S_ij of two cells and its estimated errors of quadrature and of visibility.
    fn pair_block<'py>(
        &self,
        py: Python<'py>,
        i: usize,
        j: usize,
        tolerance: f64,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, f64, f64)> {
        let space = &self.inner.space;
        if let Some(cell) = [i, j].into_iter().find(|&cell| cell >= space.cells()) {
            return Err(PyIndexError::new_err(format!("cell {cell} of {} cells", space.cells())));
        }
        let accuracy = Accuracy { seed: self.options.seed, ..Accuracy::new(tolerance, self.inner.scene.mesh.area()) };
        let block = quickly(py, None, || self.inner.pair_block(i, j, &accuracy))?;
        let shape = (space.range(i).len(), space.range(j).len());
        let values = Array2::from_shape_fn(shape, |(row, column)| block.values()[row * shape.1 + column]);
        Ok((values.into_pyarray(py), block.quadrature_error, block.visibility_error))
    }
}

/// The solver of that name; `None` for `auto`.
fn solver_kind(name: &str) -> PyResult<Option<solve::Kind>> {
    if name == "auto" {
        return Ok(None);
    }
    let found = solve::ALL.iter().find(|solver| solver.name == name);
    let names = || ["auto"].into_iter().chain(solve::ALL.iter().map(|solver| solver.name));
    found.map(|solver| Some(solver.kind)).ok_or_else(|| unknown("solver", name, names()))
}

fn triplets(py: Python<'_>, entries: impl Iterator<Item = (u32, u32, f64)>) -> Triplets<'_> {
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for (row, column, value) in entries {
        rows.push(row);
        columns.push(column);
        values.push(value);
    }
    (rows.into_pyarray(py), columns.into_pyarray(py), values.into_pyarray(py))
}

pub(crate) fn offsets<'py>(py: Python<'py>, space: &hatbox::space::FunctionSpace) -> Bound<'py, PyArray1<u64>> {
    space.offsets().iter().map(|&offset| offset as u64).collect::<Vec<_>>().into_pyarray(py)
}

pub(crate) fn nodes<'py>(
    py: Python<'py>,
    scene: &scene::Scene,
    space: &hatbox::space::FunctionSpace,
) -> Bound<'py, PyArray2<f64>> {
    let of = |cell: usize| {
        let patch = scene.mesh.patch(cell);
        space.element(cell).nodes.iter().map(move |node| patch.point(node.at).to_array())
    };
    arrays::rows(py, (0..space.cells()).flat_map(of).collect())
}

//! The finite-element system: what is behind a solve, piece by piece.

use crate::arrays;
use crate::error::{exception, unknown};
use crate::functions::basis;
use crate::quantity::{Fault, Given};
use crate::run::{quickly, run};
use crate::scene::{Scene, repainted};
use crate::solution::Solution;
use hatbox::adapt::{self, Adapted, Focus};
use hatbox::assemble::{self, Accuracy};
use hatbox::exchange::{self, Exchange as _};
use hatbox::failure::Failure;
use hatbox::io::checkpoint::{Checkpoint, identity};
use hatbox::linalg::LinearOperator as _;
use hatbox::mesh::Refinement;
use hatbox::progress::{Interrupted, Progress};
use hatbox::radiosity::{self, Options};
use hatbox::report::Report;
use hatbox::space::Continuity;
use hatbox::{scene, solve};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

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
    /// As many as there are processors if not given.
    threads: Option<usize>,
    /// The file of finished work, until the system is solved.
    checkpoint: Mutex<Option<PathBuf>>,
}

/// Removes a file of finished work that is not needed any more.
fn remove(checkpoint: Option<PathBuf>) {
    // Whoever removed it before has saved the work.
    let _ = checkpoint.map(std::fs::remove_file);
}

/// What every way to a system needs to know.
#[derive(FromPyObject)]
struct Settings {
    #[pyo3(item)]
    basis: String,
    #[pyo3(item)]
    continuity: String,
    #[pyo3(item)]
    tolerance: f64,
    #[pyo3(item)]
    operator: String,
    #[pyo3(item)]
    grading: f64,
    #[pyo3(item)]
    memory: Option<usize>,
    #[pyo3(item)]
    seed: u64,
    /// The file of finished work.
    #[pyo3(item)]
    checkpoint: Option<PathBuf>,
}

impl Settings {
    /// Does work with the file of finished work, if there is to be one, which stays; `more` is what decides the result beside scene and
    /// options.
    fn keeping<T>(
        &self,
        (scene, options, more): (&scene::Scene, &Options, &str),
        progress: &dyn Progress,
        work: impl FnOnce(&dyn Progress) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let Some(path) = &self.checkpoint else { return work(progress) };
        let identity = identity(scene, options, more);
        if progress.interrupted() {
            return Err(Failure::Interrupted);
        }
        work(&Checkpoint::open(path, identity, progress)?)
    }

    fn options(&self) -> PyResult<Options> {
        let Self { continuity, operator, .. } = self;
        let names = || Continuity::NAMES.iter().map(|(name, _)| *name);
        let kinds = || [exchange::AUTO.name].into_iter().chain(exchange::ALL.iter().map(|kind| kind.name));
        Ok(Options {
            basis: basis(&self.basis)?,
            continuity: Continuity::named(continuity).ok_or_else(|| unknown("continuity", continuity, names()))?,
            tolerance: self.tolerance,
            operator: exchange::kind(operator).ok_or_else(|| unknown("operator", operator, kinds()))?,
            grading: self.grading,
            memory: self.memory.unwrap_or(exchange::MEMORY),
            seed: self.seed,
            ..Options::default()
        })
    }
}

/// Where the error counts: a name, or two opposite corners of a box.
#[derive(FromPyObject)]
enum Focused {
    Name(String),
    Box([[f64; 3]; 2]),
}

impl Focused {
    fn into_focus(self) -> Focus {
        match self {
            Self::Name(name) => Focus::Name(name),
            Self::Box([a, b]) => Focus::Box(a.into(), b.into()),
        }
    }
}

/// The solution as it is shown: gathered once more if that is asked for.
fn shown(
    solution: radiosity::Solution,
    gather: bool,
    seed: u64,
    progress: &dyn Progress,
) -> Result<radiosity::Solution, Failure> {
    if gather { Ok(radiosity::gathered(&solution, seed, progress)?) } else { Ok(solution) }
}

impl System {
    /// The system, with its materials integrated again if a function of theirs has ever raised an exception.
    fn intact(&self) -> Arc<radiosity::System> {
        if !self.fault.is_known() {
            return Arc::clone(&self.inner);
        }
        let mut system = (*self.inner).clone();
        system.forget_materials();
        Arc::new(system)
    }
}

#[pymethods]
impl System {
    /// Subdivides the scene and builds the operator.
    #[new]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        settings: Settings,
        elements: Option<usize>,
        max_edge: Option<f64>,
        threads: Option<usize>,
        reporter: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let Scene { inner, fault, .. } = scene.get();
        let subdivided = max_edge.map(Refinement::MaxEdge).or(elements.map(Refinement::Elements));
        let options = Options { refinement: subdivided.unwrap_or(Refinement::None), ..settings.options()? };
        let system = run(py, threads, reporter, fault, |progress| {
            let build = |progress: &dyn Progress| Ok(radiosity::System::build(inner, &options, progress)?);
            settings.keeping((inner, &options, "system"), progress, build)
        })?;
        let (given, checkpoint) = (Arc::clone(inner), Mutex::new(settings.checkpoint));
        Ok(Self { inner: Arc::new(system), given, options, fault: Arc::clone(fault), threads, checkpoint })
    }

    /// Refines the scene until the estimated error is no greater than the settings' tolerance: the last system and its
    /// solution.
    #[staticmethod]
    #[expect(clippy::too_many_arguments, reason = "how arguments arrive from Python")]
    fn adapted(
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        settings: Settings,
        solver: &str,
        error_points: usize,
        max_unknowns: Option<usize>,
        focus: Option<Focused>,
        gather: bool,
        threads: Option<usize>,
        reporter: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(Self, Solution)> {
        let Scene { inner, fault, .. } = scene.get();
        let (solver, start) = (solver_kind(solver)?, adapt::Options::default().solve.refinement);
        let options = adapt::Options {
            solve: Options { solver, error_points, refinement: start, ..settings.options()? },
            tolerance: settings.tolerance,
            most_coefficients: max_unknowns,
            focus: focus.map(Focused::into_focus),
        };
        let solve = |progress: &dyn Progress| {
            let found = adapt::solve(inner, &options, progress)?;
            let report = Report::adapted(inner, &options, &found);
            let Adapted { system, solved, .. } = found;
            let solution = shown(solved.solution, gather, options.solve.seed, progress)?;
            Ok((system, Solution::new(solution, report)))
        };
        let (system, solution) = run(py, threads, reporter, fault, |progress| {
            options.check_focus(inner)?;
            let more = format!("{max_unknowns:?} {:?}", options.focus);
            settings.keeping((inner, &options.solve, &more), progress, solve)
        })?;
        remove(settings.checkpoint);
        let (given, fault, checkpoint) = (Arc::clone(inner), Arc::clone(fault), Mutex::default());
        Ok((Self { inner: Arc::new(system), given, options: options.solve, fault, threads, checkpoint }, solution))
    }

    /// Solves for the scene's own emission.
    fn solve(
        &self,
        py: Python<'_>,
        solver: &str,
        error_points: usize,
        gather: bool,
        threads: Option<usize>,
        reporter: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Solution> {
        let options = Options { solver: solver_kind(solver)?, error_points, ..self.options };
        let solution = run(py, threads.or(self.threads), reporter, &self.fault, |progress| {
            let solved = self.intact().solved(&options, progress)?;
            let report = Report::new(&self.given, &solved);
            let solution = shown(solved.solution, gather, options.seed, progress)?;
            Ok::<_, Failure>(Solution::new(solution, report))
        })?;
        remove(self.checkpoint.lock().map_or(None, |mut path| path.take()));
        Ok(solution)
    }

    /// The same operator with other reflectances and exitances, `None` where a material keeps its own.
    fn with_materials(
        &self,
        reflectance: Vec<Option<Given>>,
        exitance: Vec<Option<Given>>,
        bands: usize,
    ) -> PyResult<Self> {
        let materials = repainted(&self.given, reflectance, exitance, &self.fault);
        let mut system = (*self.intact()).clone();
        system.set_materials(materials.clone(), self.options.continuity).map_err(exception)?;
        system.raise_bands(bands);
        let given = scene::Scene { materials, bands: system.scene.bands, ..(*self.given).clone() };
        let fault = Arc::clone(&self.fault);
        Ok(Self {
            inner: Arc::new(system),
            given: Arc::new(given),
            options: self.options,
            fault,
            threads: self.threads,
            checkpoint: Mutex::default(),
        })
    }

    /// Names of materials that shine and did not when a sampled operator was built.
    #[getter]
    fn new_lamps(&self) -> Vec<String> {
        self.inner.new_lamps().into_iter().map(str::to_owned).collect()
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
        let matrix = quickly(py, self.threads, || assemble::weighted_mass(scene, space))?;
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
        let load = quickly(py, self.threads, || assemble::load(scene, space))?;
        self.fault.take().map_or_else(|| arrays::owned(py, load), Err)
    }

    /// S x for every row of x (bands × D).
    fn exchange<'py>(&self, py: Python<'py>, x: &Bound<'py, PyArray2<f64>>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let x = arrays::multivector(x, self.inner.space.broken_dofs())?;
        let times = |progress: &dyn Progress| {
            self.inner.exchange.times_watched(&x, progress).map_err(|Interrupted| Failure::Interrupted)
        };
        arrays::owned(py, run(py, self.threads, None, &self.fault, times)?)
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
        let block = quickly(py, self.threads, || self.inner.pair_block(i, j, &accuracy))?;
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

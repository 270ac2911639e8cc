//! Scenes from files and from arrays.

use crate::arrays;
use crate::error::exception;
use crate::quantity::{Fault, Given};
use hatbox::element::Shape;
use hatbox::failure::Failure;
use hatbox::io::read_scene;
use hatbox::mesh::{Cell, Mesh};
use hatbox::report::SceneReport;
use hatbox::scene::{self, Material, Physics, Quantity};
use numpy::ndarray::{Array2, ArrayView1, ArrayView2};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// A mesh and what it is made of.
#[pyclass(frozen, module = "hatbox._native")]
pub(crate) struct Scene {
    pub(crate) inner: Arc<scene::Scene>,
    pub(crate) fault: Arc<Fault>,
    warnings: Vec<String>,
}

/// Materials as they come from Python, one entry per material.
#[derive(FromPyObject)]
pub(crate) struct Materials {
    #[pyo3(item)]
    names: Vec<String>,
    #[pyo3(item)]
    reflectance: Vec<Given>,
    #[pyo3(item)]
    exitance: Vec<Given>,
    #[pyo3(item)]
    two_sided: Vec<bool>,
}

impl Materials {
    fn build(self, fault: &Arc<Fault>) -> Vec<Material> {
        let quantities = self.reflectance.into_iter().zip(self.exitance);
        let rest = self.names.into_iter().zip(self.two_sided);
        let material = |((reflectance, exitance), (name, two_sided)): ((Given, Given), _)| Material {
            name,
            reflectance: reflectance.into_quantity(fault),
            exitance: exitance.into_quantity(fault),
            two_sided,
            blocks_only: false,
        };
        quantities.zip(rest).map(material).collect()
    }
}

#[pymethods]
impl Scene {
    /// From arrays: vertices (V, 3), faces (F, 4) where a triangle repeats its last index, and per face the index of its
    /// material and of its group.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "how arguments arrive from Python")]
    fn new(
        py: Python<'_>,
        vertices: PyReadonlyArray2<'_, f64>,
        faces: PyReadonlyArray2<'_, i64>,
        material: PyReadonlyArray1<'_, u32>,
        group: PyReadonlyArray1<'_, u32>,
        materials: Materials,
        group_names: Vec<String>,
        physics: &str,
        bands: usize,
    ) -> PyResult<Self> {
        let fault = Arc::new(Fault::default());
        let cells = cells(faces.as_array(), material.as_array(), group.as_array(), vertices.as_array().nrows())?;
        let vertices = vertices.as_array().rows().into_iter().map(|v| glam::DVec3::new(v[0], v[1], v[2])).collect();
        let mesh = Mesh { vertices, cells, groups: group_names, ..Mesh::default() };
        let physics = if physics == "heat" { Physics::Heat } else { Physics::Light };
        let materials = materials.build(&fault);
        let built = py.detach(|| scene::Scene::new(mesh, materials, physics, None)).map_err(exception)?;
        let warnings = built.warnings.iter().map(ToString::to_string).collect();
        Ok(Self { inner: Arc::new(with_bands(built, bands)), fault, warnings })
    }

    /// From a file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let (scene, warnings) = py.detach(|| read_scene(&path)).map_err(exception)?;
        Ok(Self { inner: Arc::new(scene), fault: Arc::default(), warnings })
    }

    /// What was repaired or passed over in the input, a sentence each.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// Number of bands.
    #[getter]
    fn bands(&self) -> usize {
        self.inner.bands
    }

    /// `light` or `heat`.
    #[getter]
    fn physics(&self) -> &'static str {
        SceneReport::new(&self.inner).physics
    }

    /// Area of all sides that carry light.
    #[getter]
    fn area(&self) -> f64 {
        self.inner.mesh.area()
    }

    /// Names of the materials.
    #[getter]
    fn material_names(&self) -> Vec<String> {
        self.inner.materials.iter().map(|material| material.name.clone()).collect()
    }

    /// Names of the groups.
    #[getter]
    fn group_names(&self) -> Vec<String> {
        self.inner.mesh.groups.clone()
    }

    /// R per material and band; NaN where it varies over the surface.
    #[getter]
    fn reflectance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.quantities(py, |material| &material.reflectance)
    }

    /// B⁰ per material and band; NaN where it varies over the surface.
    #[getter]
    fn exitance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.quantities(py, |material| &material.exitance)
    }

    /// Positions (V, 3).
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        arrays::rows(py, self.inner.mesh.vertices.iter().map(glam::DVec3::to_array).collect())
    }

    /// Indices of the cells' corners (N, 4); a triangle repeats its last.
    #[getter]
    fn cells<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u32>> {
        arrays::rows(py, self.inner.mesh.cells.iter().map(|cell| cell.vertices).collect())
    }

    /// Index of each cell's material (N,).
    #[getter]
    fn material<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        self.per_cell(py, |cell| cell.material)
    }

    /// Index of each cell's group (N,).
    #[getter]
    fn group<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        self.per_cell(py, |cell| cell.group)
    }

    /// Index of the opaque face that each cell is a part of (N,).
    #[getter]
    fn surface<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        self.per_cell(py, |cell| cell.surface)
    }
}

impl Scene {
    /// A scene that was made of another one.
    pub(crate) fn derived(scene: scene::Scene, fault: &Arc<Fault>) -> Self {
        Self { inner: Arc::new(scene), fault: Arc::clone(fault), warnings: Vec::new() }
    }

    fn quantities<'py>(&self, py: Python<'py>, of: impl Fn(&Material) -> &Quantity) -> Bound<'py, PyArray2<f64>> {
        let value = |(m, band)| of(&self.inner.materials[m]).uniform(band).unwrap_or(f64::NAN);
        Array2::from_shape_fn((self.inner.materials.len(), self.inner.bands), value).into_pyarray(py)
    }

    fn per_cell<'py>(&self, py: Python<'py>, of: impl Fn(&Cell) -> u32) -> Bound<'py, PyArray1<u32>> {
        self.inner.mesh.cells.iter().map(of).collect::<Vec<_>>().into_pyarray(py)
    }
}

/// Functions leave the number of bands open; whoever gave them knows it.
fn with_bands(mut scene: scene::Scene, bands: usize) -> scene::Scene {
    scene.bands = scene.bands.max(bands);
    scene
}

/// The materials of a scene with new reflectances or exitances; `None` keeps a material's own.
pub(crate) fn repainted(
    scene: &scene::Scene,
    reflectance: Vec<Option<Given>>,
    exitance: Vec<Option<Given>>,
    fault: &Arc<Fault>,
) -> Vec<Material> {
    let mut materials = scene.materials.clone();
    for (material, given) in materials.iter_mut().zip(reflectance) {
        if let Some(given) = given {
            material.reflectance = given.into_quantity(fault);
        }
    }
    for (material, given) in materials.iter_mut().zip(exitance) {
        if let Some(given) = given {
            material.exitance = given.into_quantity(fault);
        }
    }
    materials
}

fn cells(
    faces: ArrayView2<'_, i64>,
    material: ArrayView1<'_, u32>,
    group: ArrayView1<'_, u32>,
    vertices: usize,
) -> PyResult<Vec<Cell>> {
    let cell = |(face, ((indices, &material), &group)): (usize, _)| {
        let indices: ArrayView1<'_, i64> = indices;
        let index = |k: usize| {
            let index = u32::try_from(indices[k]).ok().filter(|&index| (index as usize) < vertices);
            index.ok_or_else(|| {
                let text = format!("face {face} refers to vertex {}, but there are only {vertices}", indices[k]);
                exception(Failure::with_help(text, "vertices are counted from 0"))
            })
        };
        let vertices = [index(0)?, index(1)?, index(2)?, index(3)?];
        let shape = if vertices[2] == vertices[3] { Shape::Triangle } else { Shape::Quad };
        Ok(Cell { shape, vertices, material, group, surface: 0 })
    };
    faces.rows().into_iter().zip(material).zip(group).enumerate().map(cell).collect()
}

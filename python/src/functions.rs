//! The finite elements themselves.

use crate::arrays;
use crate::error::unknown;
use hatbox::element::{ALL, Basis, Element, Shape};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

/// The basis of that name.
pub(crate) fn basis(name: &str) -> PyResult<&'static Basis> {
    Basis::named(name).ok_or_else(|| unknown("basis", name, ALL.iter().map(|basis| basis.name)))
}

fn element(name: &str, shape: &str) -> PyResult<&'static Element> {
    let shape = match shape {
        "triangle" => Shape::Triangle,
        "quad" => Shape::Quad,
        other => return Err(unknown("shape", other, ["triangle", "quad"])),
    };
    let with_quads = ALL.iter().filter(|basis| basis.quad.is_some()).map(|basis| basis.name);
    basis(name)?.element(shape).ok_or_else(|| unknown("basis on quads", name, with_quads))
}

/// Reference coordinates of an element's nodes.
#[pyfunction]
pub(crate) fn nodes<'py>(py: Python<'py>, basis: &str, shape: &str) -> PyResult<Bound<'py, PyArray2<f64>>> {
    Ok(arrays::rows(py, element(basis, shape)?.nodes.iter().map(|node| node.at).collect()))
}

/// N_k at reference coordinates.
#[pyfunction]
pub(crate) fn shape_functions<'py>(
    py: Python<'py>,
    basis: &str,
    points: PyReadonlyArray2<'py, f64>,
    shape: &str,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let element = element(basis, shape)?;
    let points = points.as_array();
    let mut values = Array2::zeros((points.nrows(), element.dofs()));
    for (row, point) in values.rows_mut().into_iter().zip(points.rows()) {
        for (value, n) in row.into_iter().zip(element.values([point[0], point[1]])) {
            *value = n;
        }
    }
    Ok(values.into_pyarray(py))
}

//! Arrays between Rust and NumPy. What Rust keeps is shown to NumPy where it is, read-only, and not copied.

use hatbox::linalg::MultiVector;
use numpy::ndarray::{Array2, ArrayView2};
use numpy::{Element, IntoPyArray, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Rows of N numbers as an array of N columns.
pub(crate) fn rows<T: Element, const N: usize>(py: Python<'_>, values: Vec<[T; N]>) -> Bound<'_, PyArray2<T>> {
    let shape = (values.len(), N);
    let flat: Vec<T> = values.into_iter().flatten().collect();
    // The shape is that of the vector by construction.
    Array2::from_shape_vec(shape, flat).unwrap_or_else(|_| unreachable!("N numbers in each row")).into_pyarray(py)
}

/// Bands × rows that `owner` keeps alive and never changes, as a read-only array that shares them.
pub(crate) fn shared<'py>(owner: &Bound<'py, PyAny>, values: &MultiVector) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let shape = (values.bands(), values.rows());
    let view = ArrayView2::from_shape(shape, values.as_slice()).map_err(|e| PyValueError::new_err(e.to_string()))?;
    // SAFETY: the array holds a reference to `owner`, a frozen object that neither changes nor moves the numbers.
    #[expect(unsafe_code, reason = "sharing memory with NumPy")]
    let array = unsafe { PyArray2::borrow_from_array(&view, owner.clone()) };
    read_only(array.as_any());
    Ok(array)
}

fn read_only(array: &Bound<'_, PyAny>) {
    // Every array has this attribute, and clearing it never fails.
    let _ = array.getattr("flags").and_then(|flags| flags.setattr("writeable", false));
}

/// Bands × rows, handed over.
pub(crate) fn owned(py: Python<'_>, values: MultiVector) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let shape = (values.bands(), values.rows());
    let array = Array2::from_shape_vec(shape, values.into_vec()).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(array.into_pyarray(py))
}

/// The bands × rows of an array.
pub(crate) fn multivector(array: &Bound<'_, PyArray2<f64>>, rows: usize) -> PyResult<MultiVector> {
    let (bands, found) = (array.shape()[0], array.shape()[1]);
    if found != rows || bands == 0 {
        let text = format!("the shape is ({bands}, {found}), but (bands, {rows}) is needed");
        return Err(PyValueError::new_err(text));
    }
    let values: Vec<f64> = array.readonly().as_array().iter().copied().collect();
    MultiVector::from_bands(bands, values).ok_or_else(|| PyValueError::new_err("there are no bands"))
}

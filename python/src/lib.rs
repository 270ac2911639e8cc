//! The Python package's native half: the library's types behind Python classes, and nothing that Python can do itself.
//!
//! Arguments arrive checked and in C order; the modules in `package/hatbox` see to that, give the defaults and carry the
//! documentation.

#![allow(clippy::needless_pass_by_value, reason = "how arguments arrive from Python")]

mod arrays;
mod error;
mod functions;
mod quantity;
mod run;
mod scene;
mod solution;
mod system;
mod view_factors;

use hatbox::{element, exchange, io, solve, space};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Names and what they mean, in the order of the library's list.
fn table(
    py: Python<'_>,
    entries: impl IntoIterator<Item = (&'static str, &'static str)>,
) -> PyResult<Bound<'_, PyDict>> {
    let table = PyDict::new(py);
    for (name, summary) in entries {
        table.set_item(name, summary)?;
    }
    Ok(table)
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("BASES", table(py, element::ALL.iter().map(|basis| (basis.name, basis.summary)))?)?;
    module.add("OPERATORS", table(py, exchange::ALL.iter().map(|kind| (kind.name, kind.summary)))?)?;
    module.add("SOLVERS", table(py, solve::ALL.iter().map(|solver| (solver.name, solver.summary)))?)?;
    let closures = hatbox::view_factors::CLOSURES.iter().map(|closure| (closure.name, closure.summary));
    module.add("CLOSURES", table(py, closures)?)?;
    module.add("CONTINUITIES", table(py, space::Continuity::NAMES)?)?;
    let formats = io::FORMATS.iter().flat_map(|format| format.extensions.iter().map(|e| (*e, format.summary)));
    module.add("FORMATS", table(py, formats)?)?;
    module.add("OUTPUTS", table(py, io::OUTPUTS.iter().map(|output| (output.extension, output.summary)))?)?;
    module.add("HatboxError", py.get_type::<error::HatboxError>())?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<system::System>()?;
    module.add_class::<solution::Solution>()?;
    module.add_function(wrap_pyfunction!(view_factors::view_factors, module)?)?;
    module.add_function(wrap_pyfunction!(functions::nodes, module)?)?;
    module.add_function(wrap_pyfunction!(functions::shape_functions, module)?)
}

//! What goes wrong in the library, as Python exceptions with the words of the command line.

use hatbox::failure::Failure;
use pyo3::exceptions::{PyKeyboardInterrupt, PyValueError};
use pyo3::{PyErr, create_exception};

create_exception!(
    hatbox,
    HatboxError,
    PyValueError,
    "The input is wrong. The text is that of the command line: where and what is wrong, and what to do about it."
);

/// The exception that says what a failure says.
pub(crate) fn exception(failure: impl Into<Failure>) -> PyErr {
    match failure.into() {
        Failure::Wrong(problem) => HatboxError::new_err(problem.to_string()),
        Failure::Interrupted => PyKeyboardInterrupt::new_err("interrupted"),
    }
}

/// A name that is in none of the library's lists.
pub(crate) fn unknown<'a>(what: &str, name: &str, known: impl IntoIterator<Item = &'a str>) -> PyErr {
    let known: Vec<_> = known.into_iter().collect();
    exception(Failure::with_help(format!("there is no {what} `{name}`"), format!("use one of {}", known.join(", "))))
}

//! Reflectances and exitances from Python: numbers per band, or a function of the place.

use hatbox::scene::{Quantity, Site};
use pyo3::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

/// The first exception of a Python function that was called in the middle of other work.
#[derive(Default)]
pub(crate) struct Fault {
    set: AtomicBool,
    /// Whether there has ever been one.
    known: AtomicBool,
    error: Mutex<Option<PyErr>>,
}

impl Fault {
    /// Whether there is one: the work is then in vain.
    pub(crate) fn is_set(&self) -> bool {
        self.set.load(Ordering::Relaxed)
    }

    /// Whether there has ever been one: what was integrated then is nonsense.
    pub(crate) fn is_known(&self) -> bool {
        self.known.load(Ordering::Relaxed)
    }

    /// The exception, to be raised; the next work begins afresh.
    pub(crate) fn take(&self) -> Option<PyErr> {
        self.set.store(false, Ordering::Relaxed);
        self.error.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn put(&self, error: PyErr) {
        self.error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        self.known.store(true, Ordering::Relaxed);
        self.set.store(true, Ordering::Relaxed);
    }
}

/// What a material reflects or emits: numbers per band (one stands for all), or `f(x, y, z)` that returns them.
#[derive(FromPyObject)]
pub(crate) enum Given {
    Numbers(Vec<f64>),
    Function(Py<PyAny>),
}

impl Given {
    pub(crate) fn into_quantity(self, fault: &Arc<Fault>) -> Quantity {
        match self {
            Self::Numbers(values) => Quantity::Uniform(values),
            Self::Function(function) => {
                let called = Called { function, fault: Arc::clone(fault), known: RwLock::default() };
                Quantity::function(move |site, band| called.at(site, band))
            }
        }
    }
}

/// A Python function and what it has returned: integrals ask for the same points band after band and again and again.
struct Called {
    function: Py<PyAny>,
    fault: Arc<Fault>,
    known: RwLock<HashMap<[u64; 3], Vec<f64>>>,
}

impl Called {
    fn at(&self, site: &Site, band: usize) -> f64 {
        let of = |values: &Vec<f64>| values.get(band).or(values.last()).copied().unwrap_or(0.0);
        let key = site.position.to_array().map(f64::to_bits);
        if let Some(values) = self.known.read().unwrap_or_else(PoisonError::into_inner).get(&key) {
            return of(values);
        }
        if self.fault.is_set() {
            return 0.0;
        }
        let [x, y, z] = site.position.to_array();
        let values = Python::attach(|py| self.function.call1(py, (x, y, z))?.extract::<Vec<f64>>(py));
        match values {
            Ok(values) => {
                let value = of(&values);
                self.known.write().unwrap_or_else(PoisonError::into_inner).insert(key, values);
                value
            }
            Err(error) => {
                self.fault.put(error);
                0.0
            }
        }
    }
}

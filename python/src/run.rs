//! Long work with the interpreter's lock released: in a pool of as many threads as asked for, watched by the thread that
//! called, which draws the progress and listens for Ctrl-C.

use crate::quantity::Fault;
use hatbox::failure::Failure;
use hatbox::progress::Progress;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::HashMap;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Mutex};
use std::time::Duration;
use std::{process, thread};

/// How often the calling thread looks up.
const TICK: Duration = Duration::from_millis(50);

/// Pools by process and number of threads: a forked process has none of its parent's threads.
type Pools = HashMap<(u32, usize), Arc<ThreadPool>>;

static POOLS: LazyLock<Mutex<Pools>> = LazyLock::new(Mutex::default);

/// A pool of that many threads; of as many as there are processors by default.
pub(crate) fn pool(threads: Option<usize>) -> PyResult<Arc<ThreadPool>> {
    let threads = threads.unwrap_or(0);
    let mut pools = POOLS.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    if let Some(pool) = pools.get(&(process::id(), threads)) {
        return Ok(Arc::clone(pool));
    }
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| {
        crate::error::exception(Failure::with_help(format!("cannot use {threads} threads: {error}"), "ask for fewer"))
    })?;
    let pool = Arc::new(pool);
    pools.insert((process::id(), threads), Arc::clone(&pool));
    Ok(pool)
}

/// A stage, its steps and those that are done.
#[derive(Clone, Copy)]
struct Stage {
    name: &'static str,
    total: u64,
    done: u64,
}

/// What the workers tell the watcher, and the watcher them.
#[derive(Default)]
struct Watch {
    /// Each in the one before.
    stages: Mutex<Vec<Stage>>,
    stop: AtomicBool,
    fault: Arc<Fault>,
    warned: Mutex<Vec<String>>,
}

impl Progress for Watch {
    fn begin(&self, name: &'static str, total: u64) {
        if let Ok(mut stages) = self.stages.lock() {
            stages.push(Stage { name, total, done: 0 });
        }
    }

    fn advance(&self, steps: u64) {
        if let Ok(mut stages) = self.stages.lock()
            && let Some(stage) = stages.last_mut()
        {
            stage.done += steps;
        }
    }

    fn end(&self) {
        if let Ok(mut stages) = self.stages.lock() {
            stages.pop();
        }
    }

    fn warn(&self, text: &str) {
        if let Ok(mut warned) = self.warned.lock() {
            warned.push(text.to_owned());
        }
    }

    fn interrupted(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.fault.is_set()
    }
}

impl Watch {
    /// Tells `reporter(stage, done, total)` where the work is.
    fn report(&self, reporter: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let Some(reporter) = reporter else { return Ok(()) };
        let stage = self.stages.lock().ok().and_then(|stages| stages.last().copied());
        stage.map_or(Ok(()), |stage| reporter.call1((stage.name, stage.done, stage.total)).map(drop))
    }

    /// What the workers have warned of, as Python's warnings.
    fn raise_warnings(&self, py: Python<'_>) -> PyResult<()> {
        let warned = self.warned.lock().map_or_else(|_| Vec::new(), |mut warned| std::mem::take(&mut *warned));
        if warned.is_empty() {
            return Ok(());
        }
        let warn = py.import("hatbox._scene")?.getattr("_warn")?;
        warn.call1((warned,)).map(drop)
    }
}

/// Does the work. Ctrl-C, and whatever else a signal handler or `reporter` raises, stops it and is raised; so does an
/// exception of a Python function that a material is given by.
pub(crate) fn run<T: Send, E: Into<Failure> + Send>(
    py: Python<'_>,
    threads: Option<usize>,
    reporter: Option<&Bound<'_, PyAny>>,
    fault: &Arc<Fault>,
    work: impl FnOnce(&dyn Progress) -> Result<T, E> + Send,
) -> PyResult<T> {
    let pool = pool(threads)?;
    let watch = Watch { fault: Arc::clone(fault), ..Watch::default() };
    let caller = thread::current();
    let mut raised = None;
    let result = thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let result = pool.install(|| work(&watch));
            caller.unpark();
            result
        });
        while !worker.is_finished() {
            py.detach(|| thread::park_timeout(TICK));
            if raised.is_none() {
                raised = py.check_signals().and_then(|()| watch.report(reporter)).err();
                watch.stop.store(raised.is_some(), Ordering::Relaxed);
            }
        }
        worker.join().unwrap_or_else(|panic| resume_unwind(panic))
    });
    match raised.or_else(|| fault.take()).or_else(|| watch.raise_warnings(py).err()) {
        Some(error) => Err(error),
        None => result.map_err(crate::error::exception),
    }
}

/// Short work: nothing to watch.
pub(crate) fn quickly<T: Send>(py: Python<'_>, threads: Option<usize>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let pool = pool(threads)?;
    Ok(py.detach(|| pool.install(work)))
}

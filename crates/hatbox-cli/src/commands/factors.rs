//! `hatbox factors`: view factors between elements or named parts.

use super::{Talk, Written, check_outputs};
use crate::args::FactorsArgs;
use crate::failure::Failure;
use crate::progress::Bars;
use crate::style::Style;
use crate::{options, output, summary};
use hatbox::io::{self, factors};
use hatbox::view_factors::{self, Closed, Distribution, Estimate, RowCheck, Thinned, ViewFactors};
use serde::Serialize;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What `--json` prints.
#[derive(Debug, Serialize)]
pub(crate) struct Done {
    /// Number of elements.
    pub(crate) elements: usize,
    /// Number of rows of the matrix: the named parts, or the elements.
    pub(crate) groups: usize,
    /// Number of factors that are not zero.
    pub(crate) nonzeros: usize,
    /// Whether no ray leaves the scene.
    pub(crate) closed: bool,
    /// The smallest and the greatest sum of a row.
    pub(crate) row_sums: [f64; 2],
    /// In a closed scene the greatest |1 − row sum|, in an open one the greatest excess over 1.
    pub(crate) max_row_sum_error: f64,
    /// The greatest `|A_i F_ij − A_j F_ji|`, relative to the greater.
    pub(crate) max_reciprocity_error: f64,
    /// The greatest difference of an exchange area from the same integral with its two elements exchanged, over some
    /// pairs; relative as the tolerance is.
    pub(crate) reversed_error: f64,
    /// Row sum minus what it should be: in a closed scene 1, in an open one what the measured escape leaves.
    pub(crate) row_sum_errors: Spread,
    /// What goes to the environment, 1 − row sum; `null` in a closed scene, where it is an error.
    pub(crate) environment: Option<Spread>,
    /// What was done to the row sums; `null` if nothing.
    pub(crate) closure: Option<Closure>,
    /// What was left out; `null` if nothing was to be.
    pub(crate) threshold: Option<LeftOut>,
    /// Rays cast.
    pub(crate) rays: u64,
    /// Pairs of elements that see each other.
    pub(crate) pairs: u64,
    /// Those of them that were proven to see each other fully.
    pub(crate) clear_pairs: u64,
    /// Estimated relative error of the worst row's sum from quadrature.
    pub(crate) quadrature_error: f64,
    /// Estimated relative error of the worst row's sum from sampled visibility.
    pub(crate) visibility_error: f64,
    /// Relative error of a row's sum that was asked for.
    pub(crate) tolerance: f64,
    /// Whether neither quadrature nor visibility is estimated to err by more in any row.
    pub(crate) reached: bool,
    /// Memory of the exchange areas.
    pub(crate) bytes: usize,
    /// The memory that was expected to be needed.
    pub(crate) estimated_bytes: u64,
    /// The memory that might be used; `null` where the system does not tell.
    pub(crate) available_bytes: Option<u64>,
    /// From start to end.
    pub(crate) seconds: f64,
    /// The parts of it.
    pub(crate) stages: Stages,
    /// The most memory held; `null` where the system does not tell.
    pub(crate) peak_bytes: Option<u64>,
    /// The files written.
    pub(crate) outputs: Vec<Written>,
    /// What was repaired or passed over in the input.
    pub(crate) warnings: Vec<String>,
}

/// How many seconds the stages took.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(crate) struct Stages {
    /// Reading the file.
    pub(crate) reading: f64,
    /// Subdividing the faces.
    pub(crate) meshing: f64,
    /// The factors, and what is said of their accuracy.
    pub(crate) computing: f64,
    /// Writing the files.
    pub(crate) writing: f64,
}

impl Stages {
    /// From the times when the file was read, the factors known, and the files written.
    fn new(times: [Duration; 3], meshing: Duration) -> Self {
        let ([read, computed, written], meshing) = (times.map(|time| time.as_secs_f64()), meshing.as_secs_f64());
        Self { reading: read, meshing, computing: computed - read - meshing, writing: written - computed }
    }
}

/// How numbers are distributed.
#[derive(Debug, Clone, Copy, Serialize)]
pub(crate) struct Spread {
    /// The smallest.
    pub(crate) min: f64,
    /// The one in the middle.
    pub(crate) median: f64,
    /// The greatest.
    pub(crate) max: f64,
}

impl Spread {
    fn of(rows: &[RowCheck], value: impl Fn(&RowCheck) -> f64) -> Self {
        let Distribution { min, median, max } = Distribution::of(rows.iter().map(value));
        Self { min, median, max }
    }
}

/// What was done to the row sums.
#[derive(Debug, Clone, Copy, Serialize)]
pub(crate) struct Closure {
    /// How.
    pub(crate) method: &'static str,
    /// The greatest error of a row sum before.
    pub(crate) row_sum_error_before: f64,
    /// The greatest error of a row sum after.
    pub(crate) row_sum_error_after: f64,
    /// The greatest relative change of a factor.
    pub(crate) largest_relative_change: f64,
    /// Pairs that were kept at what they would be if nothing stood in the way.
    pub(crate) capped_pairs: usize,
}

impl From<Closed> for Closure {
    fn from(closed: Closed) -> Self {
        Self {
            method: closed.method.name(),
            row_sum_error_before: closed.error_before,
            row_sum_error_after: closed.error_after,
            largest_relative_change: closed.largest_change,
            capped_pairs: closed.capped,
        }
    }
}

/// What was left out.
#[derive(Debug, Clone, Copy, Serialize)]
pub(crate) struct LeftOut {
    /// Pairs with both factors below this.
    pub(crate) threshold: f64,
    /// Number of factors.
    pub(crate) dropped: usize,
    /// Number of factors that are left.
    pub(crate) kept: usize,
    /// The most that a row lost, before the others made up for it.
    pub(crate) largest_row_loss: f64,
    /// How they made up for it; the errors are against the row sums before.
    pub(crate) rebalancing: Closure,
}

impl From<Thinned> for LeftOut {
    fn from(thinned: Thinned) -> Self {
        Self {
            threshold: thinned.threshold,
            dropped: thinned.dropped,
            kept: thinned.kept,
            largest_row_loss: thinned.largest_loss,
            rebalancing: thinned.closure.into(),
        }
    }
}

pub(super) fn run(args: &FactorsArgs, talk: Talk) -> Result<(), Failure> {
    let started = Instant::now();
    // 1. What can be known to fail fails before the work.
    options::set_threads(&args.run)?;
    check_outputs(&args.scene.path, &args.output)?;
    for path in &args.output {
        factors::writer_for(path)?;
    }
    // 2. The scene.
    let (scene, warnings) = io::read_scene(&args.scene.path)?;
    output::warn(&warnings);
    let read = started.elapsed();
    // 3. The factors, if they fit.
    let options = options::factors(args);
    let failed = |error: view_factors::Error| Failure::from(error).in_file(&args.scene.path);
    let estimate = Estimate::of(&scene, &options).map_err(|error| failed(error.into()))?;
    let bars = Bars::new(talk.shows_progress());
    if talk.is_watched() {
        output::note(&summary::estimate(&estimate, options.memory));
    }
    let found = ViewFactors::new(&scene, &options, &bars).map_err(failed)?;
    let done = done(&found);
    let computed = started.elapsed();
    // 4. The files.
    let outputs = write(&found, &args.output, &bars)?;
    // 5. The summary.
    let ended = started.elapsed();
    let done = Done {
        seconds: ended.as_secs_f64(),
        stages: Stages::new([read, computed, ended], found.meshing),
        outputs,
        warnings,
        estimated_bytes: estimate.bytes,
        available_bytes: options.memory,
        ..done
    };
    match talk {
        Talk::Json | Talk::QuietJson => output::print_json(&done),
        Talk::Summary => output::print(&summary::factors(&args.scene.path, &found, &done, Style::stdout())),
        Talk::Quiet => Ok(()),
    }
}

/// Writes every file, unless the work is to stop.
fn write(found: &ViewFactors, paths: &[PathBuf], bars: &Bars) -> Result<Vec<Written>, Failure> {
    let one = |path: &PathBuf| {
        if crate::interrupt::asked() {
            return Err(Failure::Interrupted);
        }
        factors::write(found, path, bars)?;
        Ok(Written::new(path))
    };
    paths.iter().map(one).collect()
}

fn done(found: &ViewFactors) -> Done {
    let (check, statistics) = (found.check(), &found.statistics);
    Done {
        elements: found.elements,
        groups: found.len(),
        nonzeros: check.nonzeros,
        closed: found.is_closed(),
        row_sums: [check.least_row_sum, check.greatest_row_sum],
        max_row_sum_error: check.max_row_sum_error,
        max_reciprocity_error: check.max_reciprocity_error,
        reversed_error: found.reversed_error,
        row_sum_errors: Spread::of(&check.rows, |row| row.closure_error),
        environment: (!found.is_closed()).then(|| Spread::of(&check.rows, RowCheck::environment)),
        closure: found.closure.map(Into::into),
        threshold: found.threshold.map(Into::into),
        rays: statistics.rays,
        pairs: statistics.pairs,
        clear_pairs: statistics.clear_pairs,
        quadrature_error: statistics.quadrature_error,
        visibility_error: statistics.visibility_error,
        tolerance: found.tolerance,
        reached: found.is_reached(),
        bytes: found.bytes(),
        estimated_bytes: 0,
        available_bytes: None,
        seconds: 0.0,
        stages: Stages::default(),
        peak_bytes: output::peak_bytes(),
        outputs: Vec::new(),
        warnings: Vec::new(),
    }
}

//! `hatbox factors`: view factors between elements or named parts.

use super::{Talk, Written, check_outputs};
use crate::args::FactorsArgs;
use crate::failure::Failure;
use crate::progress::Bars;
use crate::style::Style;
use crate::{options, output, summary};
use hatbox::io::{self, factors};
use hatbox::view_factors::ViewFactors;
use serde::Serialize;
use std::time::Instant;

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
    /// Memory of the exchange areas.
    pub(crate) bytes: usize,
    /// From start to end.
    pub(crate) seconds: f64,
    /// The most memory held; `null` where the system does not tell.
    pub(crate) peak_bytes: Option<u64>,
    /// The files written.
    pub(crate) outputs: Vec<Written>,
    /// What was repaired or passed over in the input.
    pub(crate) warnings: Vec<String>,
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
    // 3. The factors.
    let bars = Bars::new(talk.shows_progress());
    let found = ViewFactors::new(&scene, &options::factors(args), &bars);
    let found = found.map_err(|error| Failure::from(error).in_file(&args.scene.path))?;
    // 4. The files.
    let mut outputs = Vec::new();
    for path in &args.output {
        if crate::interrupt::asked() {
            return Err(Failure::Interrupted);
        }
        factors::write(&found, path)?;
        outputs.push(Written::new(path));
    }
    // 5. The summary.
    let done = Done { seconds: started.elapsed().as_secs_f64(), outputs, warnings, ..done(&found) };
    match talk {
        Talk::Json => output::print_json(&done),
        Talk::Summary => output::print(&summary::factors(&args.scene.path, &found, &done, Style::stdout())),
        Talk::Quiet => Ok(()),
    }
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
        rays: statistics.rays,
        pairs: statistics.pairs,
        clear_pairs: statistics.clear_pairs,
        quadrature_error: statistics.quadrature_error,
        visibility_error: statistics.visibility_error,
        bytes: statistics.bytes,
        seconds: 0.0,
        peak_bytes: output::peak_bytes(),
        outputs: Vec::new(),
        warnings: Vec::new(),
    }
}

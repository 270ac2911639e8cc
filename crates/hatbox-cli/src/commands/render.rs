//! `hatbox render`: pictures of a solution.

use super::solve::write;
use super::{Talk, check_outputs};
use crate::args::RenderArgs;
use crate::failure::Failure;
use crate::progress::Bars;
use crate::style::Style;
use crate::{options, output, summary};
use hatbox::io::{npz, writer_for};

pub(super) fn run(args: &RenderArgs, talk: Talk) -> Result<(), Failure> {
    check_outputs(&args.solution, &args.output)?;
    for path in &args.output {
        writer_for(path)?;
    }
    let solution = options::shown(npz::load(&args.solution)?, &args.view);
    let bars = Bars::new(talk.shows_progress());
    let outputs = write(&solution, &args.output, &options::write(&args.view, solution.scene.camera, &bars))?;
    if talk == Talk::Quiet { Ok(()) } else { output::print(&summary::outputs(&outputs, Style::stdout())) }
}

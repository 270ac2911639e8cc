//! `hatbox probe`: a solution at points.

use super::Talk;
use crate::args::ProbeArgs;
use crate::failure::Failure;
use crate::output;
use crate::progress::Bars;
use hatbox::io::csv::{self, Point};
use hatbox::io::{atomic, npz};
use hatbox::probe::{Probe, Probed};
use std::path::Path;

/// The formats of the output.
const EXTENSIONS: [&str; 2] = ["csv", "npy"];

pub(super) fn run(args: &ProbeArgs, talk: Talk) -> Result<(), Failure> {
    // 1. What can be known to fail fails before the work.
    if let Some(path) = &args.output {
        check_output(path)?;
    }
    // 2. The solution and the points.
    let solution = npz::load(&args.solution)?;
    let points = csv::read_points(&args.points)
        .map_err(|error| Failure::with_help(error.to_string(), "give a point per line: x y z nx ny nz"))?;
    // 3. The values there.
    let places: Vec<_> = points.iter().map(|point| (point.position, point.normal)).collect();
    let probe = Probe::new(&solution);
    let progress = Bars::new(talk.shows_progress());
    let probed = match (args.direct, args.gather) {
        (false, false) => probe.values(&places),
        (true, _) => probe.values_with_direct_light(&places, args.seed, &progress)?,
        (_, true) => probe.values_gathered(&places, args.seed, &progress)?,
    };
    output::warn(&probed.warnings());
    // 4. The table.
    match &args.output {
        Some(path) => Ok(csv::save_points(&points, &probed.irradiance, &probed.radiosity, path)?),
        None => print(&points, &probed),
    }
}

fn check_output(path: &Path) -> Result<(), Failure> {
    let known = |extension: &std::ffi::OsStr| EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known));
    if !path.extension().is_some_and(known) {
        let message = format!("cannot tell from the name what to write to `{}`", path.display());
        return Err(Failure::with_help(message, "use one of .csv, .npy"));
    }
    Ok(atomic::check(path)?)
}

fn print(points: &[Point], probed: &Probed) -> Result<(), Failure> {
    output::print_with(|mut out| csv::write_points(points, &probed.irradiance, &probed.radiosity, &mut out))
}

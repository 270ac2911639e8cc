//! `hatbox solve`: the radiosity of a scene.

use super::{Talk, Written, check_outputs, same_place};
use crate::args::SolveArgs;
use crate::failure::Failure;
use crate::progress::Bars;
use crate::style::Style;
use crate::{options, output, summary};
use hatbox::adapt;
use hatbox::certificate::{certifiable, certify};
use hatbox::io::checkpoint::{Checkpoint, identity};
use hatbox::io::{self, WriteOptions};
use hatbox::progress::Progress;
use hatbox::radiosity::{self, Solution, gathered, solve};
use hatbox::report::{CertificateReport, Report};
use hatbox::scene::Scene;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What `--json` prints.
#[derive(Debug, Serialize)]
pub(crate) struct Done {
    #[serde(flatten)]
    pub(crate) report: Report,
    /// From start to end.
    pub(crate) seconds: f64,
    /// The most memory held; `null` where the system does not tell.
    pub(crate) peak_bytes: Option<u64>,
    /// The files written.
    pub(crate) outputs: Vec<Written>,
    /// What was repaired or passed over in the input.
    pub(crate) warnings: Vec<String>,
}

pub(super) fn run(args: &SolveArgs, talk: Talk) -> Result<(), Failure> {
    let started = Instant::now();
    // 1. What can be known to fail fails before the work.
    options::set_threads(&args.run)?;
    check_files(args)?;
    // 2. The scene.
    let (scene, mut warnings) = io::read_scene(&args.scene.path)?;
    output::warn(&warnings);
    let adaptive = options::adaptive(args);
    if args.certify {
        certifiable(&scene, options::solve(args).basis, adaptive.is_some())?;
    }
    // 3. The light in it.
    let bars = Bars::new(talk.shows_progress());
    let checkpoint = args.checkpoint.as_deref().map(|path| checkpoint(path, &scene, args, &bars)).transpose()?;
    let earlier = checkpoint.as_ref().and_then(|checkpoint| summary::earlier(checkpoint.earlier()));
    if let Some(earlier) = earlier.filter(|_| talk.shows_progress()) {
        output::note(&earlier);
    }
    let progress: &dyn Progress = checkpoint.as_ref().map_or(&bars, |checkpoint| checkpoint);
    let (solution, report) = light(args, &scene, adaptive, progress)?;
    // 4. The files.
    let shown = options::shown(solution, &args.view);
    let outputs = write(&shown, &args.output, &options::write(&args.view, scene.camera, &bars))?;
    if let Some(checkpoint) = checkpoint {
        checkpoint.remove();
    }
    // 5. The summary.
    let late = report.warnings();
    output::warn(&late);
    warnings.extend(bars.warned());
    warnings.extend(late);
    let seconds = started.elapsed().as_secs_f64();
    let done = Done { report, seconds, peak_bytes: output::peak_bytes(), outputs, warnings };
    match talk {
        Talk::Json | Talk::QuietJson => output::print_json(&done),
        Talk::Summary => output::print(&summary::solve(&args.scene.path, &done, Style::stdout())),
        Talk::Quiet => Ok(()),
    }
}

/// Solves, and does what else was asked for with the solution.
fn light(
    args: &SolveArgs,
    scene: &Scene,
    adaptive: Option<adapt::Options>,
    progress: &dyn Progress,
) -> Result<(Solution, Report), Failure> {
    let failure = |error: radiosity::Error| Failure::from(error).in_file(&args.scene.path);
    let (solution, mut report) = if let Some(options) = adaptive {
        options.check_focus(scene)?;
        let adapted = adapt::solve(scene, &options, progress).map_err(failure)?;
        let report = Report::adapted(scene, &options, &adapted);
        (adapted.solved.solution, report)
    } else {
        let solved = solve(scene, &options::solve(args), progress).map_err(failure)?;
        let report = Report::new(scene, &solved);
        (solved.solution, report)
    };
    let solution = if args.gather { gathered(&solution, args.run.seed, progress)? } else { solution };
    if args.certify {
        let started = Instant::now();
        let found = certify(&solution, progress)?;
        report.certificate = Some(CertificateReport::new(&found, started.elapsed()));
    }
    Ok((solution, report))
}

/// Makes sure that every output can be written, and that no file destroys another.
fn check_files(args: &SolveArgs) -> Result<(), Failure> {
    check_outputs(&args.scene.path, &args.output)?;
    for path in &args.output {
        io::writer_for(path)?;
    }
    args.checkpoint.as_deref().map_or(Ok(()), |path| check_checkpoint(path, args))
}

/// Makes sure that the file of finished work, which is removed in the end, is none of the others.
fn check_checkpoint(path: &Path, args: &SolveArgs) -> Result<(), Failure> {
    if args.output.iter().chain([&args.scene.path]).any(|other| same_place(path, other)) {
        let message = format!("{}: the checkpoint is removed when the work is done", path.display());
        return Err(Failure::with_help(message, "choose another name for it than those of the scene and of outputs"));
    }
    Ok(())
}

/// The file of finished work.
fn checkpoint<'a>(
    path: &Path,
    scene: &Scene,
    args: &SolveArgs,
    bars: &'a Bars,
) -> Result<Checkpoint<&'a Bars>, Failure> {
    let rest = format!("{:?} {} {:?}", args.max_unknowns, args.tolerance, args.focus);
    Ok(Checkpoint::open(path, identity(scene, &options::solve(args), &rest), bars)?)
}

/// Writes a solution to every file.
pub(super) fn write(
    solution: &Solution,
    paths: &[PathBuf],
    options: &WriteOptions<'_>,
) -> Result<Vec<Written>, Failure> {
    let write = |path: &PathBuf| {
        if options.progress.interrupted() {
            return Err(Failure::Interrupted);
        }
        io::write(solution, path, options)?;
        Ok(Written::new(path))
    };
    paths.iter().map(write).collect()
}

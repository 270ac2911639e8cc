//! What each command does: options, work, files, summary.

pub(crate) mod check;
pub(crate) mod factors;
mod probe;
mod render;
pub(crate) mod solve;

use crate::args::{Cli, Command};
use crate::failure::Failure;
use crate::output;
use clap::CommandFactory;
use clap::error::ErrorKind;
use serde::Serialize;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Carries out a command.
pub(crate) fn run(cli: &Cli) -> Result<ExitCode, Failure> {
    match &cli.command {
        Command::Solve(args) => solve::run(args, Talk::new(cli.quiet, args.run.json))?,
        Command::Factors(args) => factors::run(args, Talk::new(cli.quiet, args.run.json))?,
        Command::Probe(args) => probe::run(args, Talk::new(cli.quiet, false))?,
        Command::Render(args) => render::run(args, Talk::new(cli.quiet, false))?,
        Command::Check(args) => return check::run(args),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut Cli::command(), "hatbox", &mut script);
            output::print_with(|out| out.write_all(&script))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// How much is said, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Talk {
    /// Only what is wrong.
    Quiet,
    /// One JSON object, and beside it only what is wrong.
    QuietJson,
    /// One JSON object.
    Json,
    /// A summary for people.
    Summary,
}

impl Talk {
    fn new(quiet: bool, json: bool) -> Self {
        match (quiet, json) {
            (true, true) => Self::QuietJson,
            (false, true) => Self::Json,
            (true, _) => Self::Quiet,
            _ => Self::Summary,
        }
    }

    /// Whether standard error tells where work is.
    fn shows_progress(self) -> bool {
        matches!(self, Self::Json | Self::Summary)
    }

    /// Whether a person may be looking.
    fn is_watched(self) -> bool {
        self == Self::Summary && std::io::stderr().is_terminal()
    }
}

/// A file that was written.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Written {
    /// Where.
    pub(crate) file: PathBuf,
    /// Its size; 0 if it is not a file but a device.
    pub(crate) bytes: u64,
}

impl Written {
    fn new(file: &Path) -> Self {
        Self { file: file.to_owned(), bytes: file.metadata().map_or(0, |metadata| metadata.len()) }
    }
}

/// Makes sure that no output is the input, and that none is named twice.
fn check_outputs(input: &Path, outputs: &[PathBuf]) -> Result<(), Failure> {
    for (k, output) in outputs.iter().enumerate() {
        if outputs[..k].iter().any(|other| same_place(other, output)) {
            let message = format!("the output `{}` is named twice", output.display());
            Cli::command().error(ErrorKind::ArgumentConflict, message).exit();
        }
        if same_place(input, output) {
            let message = format!("{}: writing it would destroy the input", output.display());
            return Err(Failure::with_help(message, "choose another name for the output"));
        }
    }
    Ok(())
}

/// Whether two paths name the same file, one that there is or one that may be made.
fn same_place(a: &Path, b: &Path) -> bool {
    let place = |path: &Path| -> std::io::Result<PathBuf> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        std::fs::canonicalize(path)
            .or_else(|_| Ok(std::fs::canonicalize(folder)?.join(path.file_name().unwrap_or_default())))
    };
    a == b || place(a).ok().zip(place(b).ok()).is_some_and(|(a, b)| a == b)
}

//! What went wrong, as it is shown to people, and the exit status that scripts see.

use crate::interrupt;
use hatbox::exchange::ExchangeError;
use hatbox::io::npz::LoadError;
use hatbox::io::{ReadError, WriteError};
use hatbox::progress::Interrupted;
use hatbox::solve::SolveError;
use hatbox::{io, radiosity};
use miette::{Diagnostic, LabeledSpan, MietteHandlerOpts, NamedSource, SourceCode};
use std::fmt;
use std::io::{IsTerminal, Write};
use std::process::ExitCode;

/// Why a command did not do what it was asked.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The input is wrong.
    Wrong(Box<Problem>),
    /// The user has had enough.
    Interrupted,
}

/// What is wrong and what to do.
#[derive(Debug)]
pub(crate) struct Problem {
    message: String,
    help: Option<String>,
    snippet: Option<(NamedSource<String>, LabeledSpan)>,
}

impl Failure {
    /// A failure that its message says all about.
    pub(crate) fn new(message: String) -> Self {
        Self::Wrong(Box::new(Problem { message, help: None, snippet: None }))
    }

    /// A failure with advice.
    pub(crate) fn with_help(message: String, help: impl Into<String>) -> Self {
        Self::Wrong(Box::new(Problem { message, help: Some(help.into()), snippet: None }))
    }

    /// A failure of what was done with a file.
    pub(crate) fn of_file(file: &std::path::Path, error: &impl fmt::Display) -> Self {
        Self::new(format!("{}: {error}", file.display()))
    }

    /// A failure to solve a scene.
    pub(crate) fn of_solve(file: &std::path::Path, error: &radiosity::Error) -> Self {
        match error {
            radiosity::Error::Exchange(ExchangeError::Interrupted(_))
            | radiosity::Error::Solve(SolveError::Interrupted(_)) => Self::Interrupted,
            _ => Self::of_file(file, error),
        }
    }

    /// Shows it and says how the program ends.
    pub(crate) fn report(self) -> ExitCode {
        match self {
            Self::Wrong(problem) => {
                let terminal = std::io::stderr().is_terminal();
                // Lines that a program reads are not broken, so that paths stay whole.
                let look = MietteHandlerOpts::new().wrap_lines(terminal).break_words(false).build();
                let shown = Shown { problem: &problem, look: &look };
                let _ = writeln!(std::io::stderr(), "{shown:?}");
                ExitCode::from(1)
            }
            Self::Interrupted => {
                let _ = writeln!(std::io::stderr(), "interrupted; nothing was left behind");
                ExitCode::from(interrupt::STATUS)
            }
        }
    }
}

/// A problem in the look of miette.
struct Shown<'a> {
    problem: &'a Problem,
    look: &'a miette::MietteHandler,
}

impl fmt::Debug for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        miette::ReportHandler::debug(self.look, self.problem, f)
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Problem {}

impl Diagnostic for Problem {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.snippet.as_ref().map(|(source, _)| source as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let (_, label) = self.snippet.as_ref()?;
        Some(Box::new(std::iter::once(label.clone())))
    }
}

impl From<ReadError> for Failure {
    fn from(error: ReadError) -> Self {
        let ReadError { file, place, reason, remedy, snippet } = error;
        let file = file.display().to_string();
        let place = if place.is_empty() { String::new() } else { format!("{place}: ") };
        let snippet = snippet.filter(|snippet| !snippet.span.is_empty()).map(|snippet| {
            let source = NamedSource::new(&file, snippet.text.to_string());
            (source, LabeledSpan::underline(snippet.span))
        });
        Self::Wrong(Box::new(Problem { message: format!("{file}: {place}{reason}"), help: Some(remedy), snippet }))
    }
}

impl From<WriteError> for Failure {
    fn from(error: WriteError) -> Self {
        match error {
            WriteError::Interrupted(_) => Self::Interrupted,
            WriteError::File(_) => {
                Self::with_help(error.to_string(), "choose a folder that exists and may be written to")
            }
            error => Self::new(error.to_string()),
        }
    }
}

impl From<io::atomic::AtomicError> for Failure {
    fn from(error: io::atomic::AtomicError) -> Self {
        WriteError::File(error).into()
    }
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        Self::with_help(error.to_string(), "name a solution that `hatbox solve SCENE -o SOLUTION.npz` wrote")
    }
}

impl From<Interrupted> for Failure {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

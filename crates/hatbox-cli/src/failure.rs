//! How what went wrong is shown to people, and the exit status that scripts see. The words are the library's.

use crate::interrupt;
use hatbox::failure::Problem;
use miette::{Diagnostic, LabeledSpan, MietteHandlerOpts, NamedSource, SourceCode};
use std::fmt;
use std::io::{IsTerminal, Write};
use std::process::ExitCode;

pub(crate) use hatbox::failure::Failure;

/// Shows a failure and says how the program ends.
pub(crate) fn report(failure: Failure) -> ExitCode {
    match failure {
        Failure::Wrong(problem) => {
            let terminal = std::io::stderr().is_terminal();
            // Lines that a program reads are not broken, so that paths stay whole.
            let look = MietteHandlerOpts::new().wrap_lines(terminal).break_words(false).build();
            let shown = Shown { report: &Report::new(*problem), look: &look };
            let _ = writeln!(std::io::stderr(), "{shown:?}");
            ExitCode::from(1)
        }
        Failure::Interrupted => {
            let _ = writeln!(
                std::io::stderr(),
                "interrupted; no file is half-written, finished ones stay, and so does what `--checkpoint` keeps"
            );
            ExitCode::from(interrupt::STATUS)
        }
    }
}

/// A problem as miette shows it.
#[derive(Debug)]
struct Report {
    message: String,
    help: Option<String>,
    snippet: Option<(NamedSource<String>, LabeledSpan)>,
}

impl Report {
    fn new(problem: Problem) -> Self {
        let Problem { message, help, snippet } = problem;
        let snippet =
            snippet.map(|found| (NamedSource::new(&found.file, found.text), LabeledSpan::underline(found.span)));
        Self { message, help, snippet }
    }
}

/// A report in the look of miette.
struct Shown<'a> {
    report: &'a Report,
    look: &'a miette::MietteHandler,
}

impl fmt::Debug for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        miette::ReportHandler::debug(self.look, self.report, f)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Report {}

impl Diagnostic for Report {
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

//! What went wrong, in words for people: a message that says where and what, and a help that says what to do.
//!
//! The command line and the Python package show the same words because both take them from here. What the words look
//! like (underlined, in colour, as an exception) is theirs.

use crate::adapt::{Focus, NothingInFocus};
use crate::certificate::CertifyError;
use crate::exchange::ExchangeError;
use crate::io::atomic::AtomicError;
use crate::io::checkpoint::CheckpointError;
use crate::io::npz::LoadError;
use crate::io::suggestion::nearest;
use crate::io::{ReadError, WriteError};
use crate::progress::Interrupted;
use crate::radiosity::MaterialsError;
use crate::scene::SceneError;
use crate::solve::SolveError;
use crate::{radiosity, view_factors};
use std::fmt;
use std::ops::Range;
use std::path::Path;

/// So many names are listed where one is unknown.
const NAMES: usize = 20;

/// Why something was not done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The input is wrong.
    Wrong(Box<Problem>),
    /// The user has had enough.
    Interrupted,
}

/// What is wrong and what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Where and what.
    pub message: String,
    /// What to do, where that does not go without saying.
    pub help: Option<String>,
    /// The text that is wrong, where there is one.
    pub snippet: Option<Excerpt>,
}

/// The part of a text file that is wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Excerpt {
    /// The name of the file.
    pub file: String,
    /// Its whole text.
    pub text: String,
    /// The offending bytes in it.
    pub span: Range<usize>,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)?;
        self.help.as_ref().map_or(Ok(()), |help| write!(f, "\n  help: {help}"))
    }
}

impl Failure {
    /// A failure that its message says all about.
    pub fn new(message: impl Into<String>) -> Self {
        Self::Wrong(Box::new(Problem { message: message.into(), help: None, snippet: None }))
    }

    /// A failure with advice.
    pub fn with_help(message: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Wrong(Box::new(Problem { message: message.into(), help: Some(help.into()), snippet: None }))
    }

    /// The same failure, in what was done with a file.
    #[must_use]
    pub fn in_file(mut self, file: &Path) -> Self {
        if let Self::Wrong(problem) = &mut self {
            problem.message = format!("{}: {}", file.display(), problem.message);
        }
        self
    }
}

impl From<ReadError> for Failure {
    fn from(error: ReadError) -> Self {
        let ReadError { file, place, reason, remedy, snippet } = error;
        let file = file.display().to_string();
        let place = if place.is_empty() { String::new() } else { format!("{place}: ") };
        let message = format!("{file}: {place}{reason}");
        let snippet = snippet.filter(|snippet| !snippet.span.is_empty());
        let snippet = snippet.map(|found| Excerpt { file, text: found.text.to_string(), span: found.span.clone() });
        Self::Wrong(Box::new(Problem { message, help: Some(remedy), snippet }))
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

impl From<AtomicError> for Failure {
    fn from(error: AtomicError) -> Self {
        WriteError::File(error).into()
    }
}

impl From<CheckpointError> for Failure {
    fn from(error: CheckpointError) -> Self {
        match error {
            CheckpointError::File(error) => error.into(),
            CheckpointError::Other { .. } => Self::with_help(
                error.to_string(),
                "give the scene and the options that it was begun with, or another file; remove it to begin anew",
            ),
        }
    }
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        Self::with_help(error.to_string(), "name a solution that `hatbox solve SCENE -o SOLUTION.npz` wrote")
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self::new(error.to_string())
    }
}

impl From<radiosity::Error> for Failure {
    fn from(error: radiosity::Error) -> Self {
        match error {
            radiosity::Error::Exchange(ExchangeError::Interrupted(_))
            | radiosity::Error::Solve(SolveError::Interrupted(_)) => Self::Interrupted,
            radiosity::Error::Lossless { .. } => {
                Self::with_help(error.to_string(), "give one of them a reflectance below 1, or make an opening")
            }
            radiosity::Error::Solve(SolveError::NotConverged { .. }) => Self::with_help(
                error.to_string(),
                "bounces multiply where surfaces in a closed part of the scene reflect all light: set reflectances below 1; \
                 of the solvers, gmres and cg do not count bounces",
            ),
            _ => Self::new(error.to_string()),
        }
    }
}

impl From<CertifyError> for Failure {
    fn from(error: CertifyError) -> Self {
        match error {
            CertifyError::Interrupted(_) => Self::Interrupted,
            CertifyError::Varying(_) => {
                Self::with_help(error.to_string(), "give its mean instead of a texture, or no certificate")
            }
            CertifyError::Lossless(_) => Self::with_help(error.to_string(), "give it a reflectance below 1"),
            CertifyError::TooMany(_) => {
                Self::with_help(error.to_string(), "ask for a greater tolerance or fewer elements")
            }
            CertifyError::NoNumber(_) | CertifyError::Dark(_) => Self::new(error.to_string()),
            CertifyError::Warped(_) => Self::with_help(
                error.to_string(),
                "with a tolerance alone elements are triangles; or take constant functions, or split the quads of the mesh",
            ),
        }
    }
}

impl From<view_factors::Error> for Failure {
    fn from(error: view_factors::Error) -> Self {
        match error {
            view_factors::Error::Exchange(ExchangeError::Interrupted(_)) => Self::Interrupted,
            view_factors::Error::Memory { .. } => Self::with_help(
                error.to_string(),
                "ask for fewer elements (--elements, --max-edge); every pair of them is kept until the end, so --groups \
                 and --threshold make the result smaller, but not the work. --memory allows more",
            ),
            _ => Self::new(error.to_string()),
        }
    }
}

impl From<NothingInFocus> for Failure {
    fn from(error: NothingInFocus) -> Self {
        let names = || error.names.iter().map(String::as_str);
        let listed = || {
            let more = error.names.len().saturating_sub(NAMES);
            let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
            format!("{}{rest}", names().take(NAMES).collect::<Vec<_>>().join(", "))
        };
        let help = match &error.focus {
            _ if error.black => {
                "the error that is estimated is that of the reflected light, of which there is none; give it a \
                                 reflectance, however small (0.001), and the error is that of its irradiance"
                    .to_owned()
            }
            Focus::Box(..) => format!("the scene lies between {} and {}", error.bounds[0], error.bounds[1]),
            Focus::Name(name) => nearest(name, names()).map_or_else(
                || format!("use a box X,Y,Z;X,Y,Z or one of: {}", listed()),
                |known| format!("did you mean `{known}`?"),
            ),
        };
        Self::with_help(error.to_string(), help)
    }
}

impl From<MaterialsError> for Failure {
    fn from(error: MaterialsError) -> Self {
        Self::new(error.to_string())
    }
}

impl From<Interrupted> for Failure {
    fn from(_: Interrupted) -> Self {
        Self::Interrupted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_says_where_what_and_what_to_do() {
        let error = ReadError::new(Path::new("room.obj"), "line 3", "there is no vertex 9", "export it again");
        let Failure::Wrong(problem) = Failure::from(error) else { panic!("it is no interruption") };
        assert_eq!(problem.to_string(), "room.obj: line 3: there is no vertex 9\n  help: export it again");
        let failure = Failure::from(radiosity::Error::Degenerate).in_file(Path::new("room.obj"));
        let Failure::Wrong(problem) = failure else { panic!("it is no interruption") };
        assert!(problem.to_string().starts_with("room.obj: an element has no area"), "{problem}");
    }

    #[test]
    fn an_interruption_is_nobodys_fault() {
        for failure in [
            Failure::from(Interrupted),
            WriteError::Interrupted(Interrupted).into(),
            radiosity::Error::Solve(Interrupted.into()).into(),
            radiosity::Error::Exchange(Interrupted.into()).into(),
            view_factors::Error::Exchange(Interrupted.into()).into(),
        ] {
            assert_eq!(failure.in_file(Path::new("room.obj")), Failure::Interrupted);
        }
    }
}

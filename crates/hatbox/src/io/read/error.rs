use std::fmt::Write as _;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The part of a text file that is wrong, so that it can be shown underlined.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Snippet {
    /// The whole text of the file.
    pub text: Arc<str>,
    /// The offending bytes in it.
    pub span: Range<usize>,
}

/// Why a file could not be read: where, what, and what to do about it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.text())]
pub struct ReadError {
    /// The file that is wrong: the one that was asked for, or one that it names.
    pub file: PathBuf,
    /// Where in the file (node, mesh, primitive, material, line, key); empty if it is the file as a whole.
    pub place: String,
    /// What is wrong.
    pub reason: String,
    /// What to do.
    pub remedy: String,
    /// The offending text, where there is one.
    pub snippet: Option<Box<Snippet>>,
}

impl ReadError {
    /// An error in a file, at a place in it.
    pub fn new(file: &Path, place: impl Into<String>, reason: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { file: file.to_owned(), place: place.into(), reason: reason.into(), remedy: remedy.into(), snippet: None }
    }

    /// With the text that is wrong.
    #[must_use]
    pub fn with_snippet(mut self, text: &Arc<str>, span: Range<usize>) -> Self {
        self.snippet = Some(Box::new(Snippet { text: Arc::clone(text), span }));
        self
    }

    fn text(&self) -> String {
        let mut text = format!("{}: ", self.file.display());
        if !self.place.is_empty() {
            // Writing to a String cannot fail.
            let _ = write!(text, "{}: ", self.place);
        }
        text + &self.reason + "; " + &self.remedy
    }
}

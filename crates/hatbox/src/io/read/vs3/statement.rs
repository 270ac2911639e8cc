//! The lines of a `.vs3`, with their numbers.

use crate::io::read::ReadError;
use std::path::Path;

/// The names of View3D's controls.
const CONTROLS: [&str; 12] =
    ["eps", "maxu", "maxo", "mino", "row", "col", "encl", "emit", "out", "list", "prjd", "maxv"];

/// One line: a letter and what follows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Statement<'a> {
    file: &'a Path,
    pub(super) line: usize,
    /// In upper case.
    pub(super) keyword: char,
    rest: &'a str,
}

/// The lines of a text that are neither blank nor comments.
pub(super) fn statements<'a>(file: &'a Path, text: &'a str) -> impl Iterator<Item = Statement<'a>> {
    text.lines().enumerate().filter_map(move |(k, line)| {
        let line = line.trim();
        let keyword = line.chars().next().filter(|first| !"!/".contains(*first))?;
        // The letter counts; the rest of its word does not: `End of data`.
        let rest = line.split_once(char::is_whitespace).map_or("", |(_, rest)| rest);
        Some(Statement { file, line: k + 1, keyword: keyword.to_ascii_uppercase(), rest })
    })
}

impl<'a> Statement<'a> {
    /// The k-th word after the letter, up to a comment.
    pub(super) fn word(&self, k: usize) -> Option<&'a str> {
        self.words().nth(k)
    }

    fn words(&self) -> impl Iterator<Item = &'a str> + use<'a> {
        self.rest.split_whitespace().take_while(|word| !word.starts_with(['!', '/']))
    }

    pub(super) fn error(&self, reason: impl Into<String>, remedy: &str) -> ReadError {
        ReadError::new(self.file, format!("line {}", self.line), reason, remedy)
    }

    fn parsed<T: std::str::FromStr>(&self, k: usize, what: &str, kind: &str) -> Result<T, ReadError> {
        let Some(word) = self.word(k) else {
            return Err(self.error(format!("{what} is missing"), "complete the line"));
        };
        word.parse().map_err(|_| self.error(format!("{what} is `{word}`, which is not {kind}"), "correct the line"))
    }

    /// The k-th word as a number that is not negative.
    pub(super) fn integer(&self, k: usize, what: &str) -> Result<usize, ReadError> {
        self.parsed(k, what, "a whole number of at least 0")
    }

    /// The k-th word as a finite number.
    pub(super) fn number(&self, k: usize, what: &str) -> Result<f64, ReadError> {
        let value: f64 = self.parsed(k, what, "a number")?;
        if value.is_finite() { Ok(value) } else { Err(self.error(format!("{what} is not finite"), "correct the line")) }
    }

    /// Makes sure that vertices and surfaces follow.
    pub(super) fn format(&self) -> Result<(), ReadError> {
        match self.word(0).map(str::to_ascii_lowercase).as_deref() {
            Some("3" | "3d") => Ok(()),
            other => {
                let reason = format!("`F {}` is a geometry that is not supported", other.unwrap_or_default());
                Err(self.error(reason, "describe it by vertices and surfaces, which is `F 3`"))
            }
        }
    }

    /// The controls, each with its value.
    pub(super) fn controls(&self) -> Result<Vec<(&'a str, f64)>, ReadError> {
        let text = self.rest.split(['!', '/']).next().unwrap_or_default();
        let mut words = text.split([' ', '\t', '=', ',']).filter(|word| !word.is_empty());
        let mut controls = Vec::new();
        while let Some(name) = words.next() {
            if !CONTROLS.contains(&name.to_ascii_lowercase().as_str()) {
                return Err(self.error(format!("View3D has no control `{name}`"), "correct or remove it"));
            }
            let value = words.next().and_then(|word| word.parse().ok()).filter(|value: &f64| value.is_finite());
            let value =
                value.ok_or_else(|| self.error(format!("the control `{name}` has no number"), "write name=number"))?;
            controls.push((name, value));
        }
        Ok(controls)
    }
}

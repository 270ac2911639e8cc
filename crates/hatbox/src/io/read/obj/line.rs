//! The statements of OBJ and MTL files, with their line numbers.

use crate::io::read::ReadError;
use std::borrow::Cow;
use std::path::Path;

/// One statement: a keyword and what follows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line<'a> {
    pub(super) file: &'a Path,
    number: usize,
    pub(super) keyword: &'a str,
    pub(super) rest: &'a str,
}

/// The statements of a text, without comments and blank lines. A backslash at its end joins a line to the next; lines
/// so joined carry the number of the first.
pub(super) fn lines<'a>(file: &'a Path, text: &'a str) -> impl Iterator<Item = Line<'a>> {
    text.lines().enumerate().filter_map(move |(k, line)| {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let blank = keyword.is_empty() || keyword.starts_with('#');
        (!blank).then_some(Line { file, number: k + 1, keyword, rest: rest.trim() })
    })
}

/// The text with continued lines joined; as many lines as before, so that numbers stay right.
pub(super) fn joined(text: &str) -> Cow<'_, str> {
    if !text.contains('\\') {
        return Cow::Borrowed(text);
    }
    let mut joined = String::with_capacity(text.len());
    let mut owed = 0;
    for line in text.lines() {
        if let Some(start) = line.trim_end().strip_suffix('\\') {
            joined.push_str(start);
            joined.push(' ');
            owed += 1;
        } else {
            joined.push_str(line);
            joined.extend(std::iter::repeat_n('\n', owed + 1));
            owed = 0;
        }
    }
    Cow::Owned(joined)
}

impl<'a> Line<'a> {
    /// `line 12`.
    pub(super) fn place(&self) -> String {
        format!("line {}", self.number)
    }

    /// The words after the keyword, up to a comment.
    pub(super) fn words(&self) -> impl Iterator<Item = &'a str> + use<'a> {
        self.rest.split_whitespace().take_while(|word| !word.starts_with('#'))
    }

    /// The k-th word as a number.
    pub(super) fn number(&self, k: usize) -> Result<f64, ReadError> {
        self.parsed(k, self.words().nth(k))
    }

    /// The first three words as numbers.
    pub(super) fn numbers(&self) -> Result<[f64; 3], ReadError> {
        let mut words = self.words();
        Ok([self.parsed(0, words.next())?, self.parsed(1, words.next())?, self.parsed(2, words.next())?])
    }

    /// The k-th word, which is this one if there is any, as a number.
    fn parsed(&self, k: usize, word: Option<&str>) -> Result<f64, ReadError> {
        word.and_then(|word| word.parse().ok()).ok_or_else(|| {
            let reason = match word {
                Some(word) => format!("`{word}` is not a number"),
                None => format!("`{}` has only {k} numbers", self.keyword),
            };
            ReadError::new(self.file, self.place(), reason, "correct the line")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn continued_lines_are_joined_and_counted() {
        let text = joined("v 1 \\\n2 \\\n3\n# no\nf 1\n");
        let found: Vec<_> =
            lines(Path::new("a.obj"), &text).map(|l| (l.place(), l.keyword, l.words().count())).collect();
        assert_eq!(found, [("line 1".to_owned(), "v", 3), ("line 5".to_owned(), "f", 1)]);
    }
}

//! Opening files, with errors that say what to do, and the checks that every format shares.

use super::ReadError;
use std::borrow::Cow;
use std::io::ErrorKind;
use std::path::Path;

/// All bytes of a file that the user named.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, ReadError> {
    std::fs::read(path).map_err(|error| {
        let remedy = match error.kind() {
            ErrorKind::NotFound => "check the path",
            ErrorKind::PermissionDenied => "allow reading it",
            _ => "name a readable file",
        };
        ReadError::new(path, "", format!("cannot be read ({error})"), remedy)
    })
}

/// A text; bytes that are none are replaced.
pub(super) fn text(bytes: &[u8]) -> Cow<'_, str> {
    String::from_utf8_lossy(unmarked(bytes))
}

/// A text without the byte order mark that some editors put before it.
pub(super) fn unmarked(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes)
}

/// All bytes of a file that `file` names at `place`.
pub(super) fn read_named(path: &Path, file: &Path, place: &str) -> Result<Vec<u8>, ReadError> {
    std::fs::read(path).map_err(|error| {
        let reason = format!("the file `{}` that it names cannot be read ({error})", path.display());
        ReadError::new(file, place, reason, "put it there, or correct the name")
    })
}

/// What is wrong with these reflectances, if anything.
pub(super) fn reflectance_fault(values: &[f64]) -> Option<String> {
    let bad = values.iter().find(|r| !(0.0..=1.0).contains(*r))?;
    Some(format!("a reflectance of {} is not between 0 and 1", shown(*bad)))
}

/// What is wrong with these exitances, if anything.
pub(super) fn exitance_fault(values: &[f64]) -> Option<String> {
    let bad = values.iter().find(|b| !(0.0..f64::INFINITY).contains(*b))?;
    Some(format!("an emission of {} is not a finite number of at least 0", shown(*bad)))
}

/// A number as the user wrote it, also where the file stores it in single precision.
fn shown(value: f64) -> String {
    let single = value as f32;
    if f64::from(single).to_bits() == value.to_bits() { single.to_string() } else { value.to_string() }
}

/// Joins messages that say the same, and says how often.
pub(super) fn without_repeats(warnings: Vec<String>) -> Vec<String> {
    let mut seen = std::collections::HashSet::new();
    warnings.into_iter().filter(|warning| seen.insert(warning.clone())).collect()
}

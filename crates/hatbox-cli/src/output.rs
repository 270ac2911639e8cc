//! Standard output and standard error, and facts about the process.

use crate::failure::Failure;
use crate::style::Style;
use serde::Serialize;
use std::io::{self, ErrorKind, Write};

/// Writes to standard output. A reader that has gone (`| head`) has what it wanted: that is no failure.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    print_with(|out| out.write_all(text.as_bytes()))
}

/// Writes to standard output what `fill` produces.
pub(crate) fn print_with(fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), Failure> {
    let mut out = io::BufWriter::new(io::stdout().lock());
    match fill(&mut out).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::new(format!("cannot write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Writes one JSON object and a line end to standard output.
pub(crate) fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value);
    let text = text.map_err(|error| Failure::new(format!("cannot write the report: {error}")))?;
    print(&(text + "\n"))
}

/// Writes warnings to standard error, one a line.
pub(crate) fn warn(warnings: &[String]) {
    let style = Style::stderr();
    for warning in warnings {
        // Where standard error is closed there is nobody to tell.
        let _ = writeln!(io::stderr(), "{} {warning}", style.warning("warning:"));
    }
}

/// Writes a line to standard error.
pub(crate) fn note(text: &str) {
    // Where standard error is closed there is nobody to tell.
    let _ = writeln!(io::stderr(), "{text}");
}

/// The most memory that the process has held, where the system tells.
pub(crate) fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kilobytes| kilobytes * 1024)
}

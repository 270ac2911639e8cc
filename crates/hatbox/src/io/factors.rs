//! View factors in files: a sparse matrix for NumPy and SciPy, for everyone (Matrix Market), a table for spreadsheets, or
//! the text that View3D writes.
//!
//! Rows are written one after the other, straight from the exchange areas: the matrix F itself is never in memory, only a
//! block of its rows, which all threads make together. Making them takes longer than writing them: numbers become text, and
//! half of a row is a column of the triangle that is stored.

use super::atomic;
use super::csv::quoted;
use super::npy::{self, Scalar};
use super::write::WriteError;
use crate::progress::{Interrupted, Progress, Stage};
use crate::view_factors::{RowCheck, ViewFactors};
use std::io::{self, Seek, Write};
use std::path::Path;
use zip::write::{SimpleFileOptions, ZipWriter};

/// A format that view factors are written in.
#[derive(Debug)]
pub struct FactorOutput {
    /// The extension that chooses it, without the dot.
    pub extension: &'static str,
    /// One line for help texts.
    pub summary: &'static str,
    write: fn(&Source<'_>, &Path) -> Result<(), atomic::AtomicError>,
}

/// Every format.
pub static OUTPUTS: [FactorOutput; 4] = [
    FactorOutput {
        extension: "npz",
        summary: "sparse matrix (scipy.sparse.load_npz), with names and areas (numpy.load)",
        write: |factors, path| atomic::write(path, |file| npz(factors, file)),
    },
    FactorOutput {
        extension: "mtx",
        summary: "sparse matrix in Matrix Market's format",
        write: |factors, path| atomic::write(path, |file| matrix_market(factors, file)),
    },
    FactorOutput {
        extension: "csv",
        summary: "table with names, areas, and what goes to the environment",
        write: |factors, path| atomic::write(path, |file| csv(factors, file)),
    },
    FactorOutput {
        extension: "vf",
        summary: "View3D's text: areas, all factors row by row, emittances",
        write: |factors, path| atomic::write(path, |file| view3d(factors, file)),
    },
];

/// The format that a path's extension chooses, after making sure that the file could be written.
///
/// # Errors
/// [`WriteError::UnknownExtension`], or [`WriteError::File`] if the folder does not exist or may not be written to.
pub fn writer_for(path: &Path) -> Result<&'static FactorOutput, WriteError> {
    let extension = path.extension().unwrap_or_default();
    let output = OUTPUTS.iter().find(|output| extension.eq_ignore_ascii_case(output.extension));
    let known = || OUTPUTS.iter().map(|output| output.extension).collect();
    let output = output.ok_or_else(|| WriteError::UnknownExtension { path: path.to_owned(), known: known() })?;
    atomic::check(path)?;
    Ok(output)
}

/// Writes view factors in the format that the path's extension chooses.
///
/// # Errors
/// [`WriteError::UnknownExtension`], [`WriteError::File`] or [`WriteError::Interrupted`]; there is no new file then, and
/// an old one is as it was.
pub fn write(factors: &ViewFactors, path: &Path, progress: &dyn Progress) -> Result<(), WriteError> {
    let output = writer_for(path)?;
    let stage = Stage::begin(progress, "writing", factors.len() as u64);
    let result = (output.write)(&Source { factors, progress }, path);
    drop(stage);
    result.map_err(|error| {
        let inner = error.source.get_ref().and_then(|inner| inner.downcast_ref::<Interrupted>());
        if inner.is_some() { WriteError::Interrupted(Interrupted) } else { WriteError::File(error) }
    })
}

/// The factors, and who wants to know how far they are.
struct Source<'a> {
    factors: &'a ViewFactors,
    progress: &'a dyn Progress,
}

impl Source<'_> {
    /// To be asked before each row is written.
    fn go_on(&self) -> io::Result<()> {
        self.progress.advance(1);
        if self.progress.interrupted() { Err(io::Error::other(Interrupted)) } else { Ok(()) }
    }

    /// Writes what has been made of each row.
    fn write(&self, file: &mut impl Write, mut rows: impl Iterator<Item = io::Result<Vec<u8>>>) -> io::Result<()> {
        rows.try_for_each(|bytes| {
            self.go_on()?;
            file.write_all(&bytes?)
        })
    }
}

/// Compressed sparse rows, with the keys of `scipy.sparse.save_npz`, and what is known of the rows.
#[expect(clippy::cast_possible_wrap, reason = "i32 was tried, and no array has 2^63 entries")]
fn npz(source: &Source<'_>, file: &mut (impl Write + Seek)) -> io::Result<()> {
    let (factors, check) = (source.factors, source.factors.check());
    let n = factors.len();
    let mut starts = vec![0_usize];
    for row in &check.rows {
        starts.push(starts[starts.len() - 1] + row.nonzeros);
    }
    let mut archive = ZipWriter::new(file);
    // SciPy wants one integer type in both arrays, the narrower if it will do.
    if i32::try_from(starts[n]).is_ok() {
        let columns = factors.map_nonzeros(|_, row| row.iter().map(|&(column, _)| column as i32).collect::<Vec<_>>());
        array(&mut archive, "indices", &[starts[n]], columns.flatten())?;
        array(&mut archive, "indptr", &[n + 1], starts.iter().map(|&start| start as i32))?;
    } else {
        let columns =
            factors.map_nonzeros(|_, row| row.iter().map(|&(column, _)| i64::from(column)).collect::<Vec<_>>());
        array(&mut archive, "indices", &[starts[n]], columns.flatten())?;
        array(&mut archive, "indptr", &[n + 1], starts.iter().map(|&start| start as i64))?;
    }
    entry(&mut archive, "format", &npy::encode_bytes("csr"))?;
    array(&mut archive, "shape", &[2], [n as i64; 2].into_iter())?;
    source.go_on()?;
    let values = factors.map_nonzeros(|_, row| row.iter().map(|&(_, factor)| factor).collect::<Vec<_>>());
    array(&mut archive, "data", &[starts[n]], values.flatten())?;
    let surfaces = &factors.surfaces;
    let columns: [(&str, Vec<f64>); 6] = [
        ("areas", surfaces.iter().map(|surface| surface.area).collect()),
        ("emittances", surfaces.iter().map(|surface| surface.emittance).collect()),
        ("escape", surfaces.iter().map(|surface| surface.escape).collect()),
        ("environment", check.rows.iter().map(RowCheck::environment).collect()),
        ("row_sum_error", check.rows.iter().map(|row| row.closure_error).collect()),
        ("reciprocity_error", check.rows.iter().map(|row| row.reciprocity_error).collect()),
    ];
    for (key, values) in columns {
        array(&mut archive, key, &[n], values.into_iter())?;
    }
    let names: Vec<&str> = surfaces.iter().map(|surface| surface.name.as_str()).collect();
    entry(&mut archive, "names", &npy::encode_strings(&[n], &names))?;
    archive.finish()?.flush()
}

/// An array, written as it is made.
fn array<T: Scalar, W: Write + Seek>(
    archive: &mut ZipWriter<W>,
    key: &str,
    shape: &[usize],
    values: impl Iterator<Item = T>,
) -> io::Result<()> {
    let large = shape.iter().product::<usize>() >= 1 << 28;
    start(archive, key, large)?;
    npy::write(archive, shape, values)
}

fn entry<W: Write + Seek>(archive: &mut ZipWriter<W>, key: &str, bytes: &[u8]) -> io::Result<()> {
    start(archive, key, bytes.len() >= 1 << 31)?;
    archive.write_all(bytes)
}

fn start<W: Write + Seek>(archive: &mut ZipWriter<W>, key: &str, large: bool) -> io::Result<()> {
    // Stored and without a time stamp, so that equal factors are equal files.
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored).large_file(large);
    Ok(archive.start_file(format!("{key}.npy"), options)?)
}

fn matrix_market(source: &Source<'_>, file: &mut impl Write) -> io::Result<()> {
    let factors = source.factors;
    let n = factors.len();
    let count: usize = factors.map_nonzeros(|_, row| row.len()).sum();
    writeln!(file, "%%MatrixMarket matrix coordinate real general")?;
    writeln!(file, "% view factors: entry (i, j) is the fraction of what leaves i that reaches j")?;
    writeln!(file, "{n} {n} {count}")?;
    let line = |row: usize, entries: &[(u32, f64)]| {
        let mut text = Vec::new();
        for (column, factor) in entries {
            writeln!(text, "{} {} {factor:?}", row + 1, column + 1)?;
        }
        Ok(text)
    };
    source.write(file, factors.map_nonzeros(line))
}

fn csv(source: &Source<'_>, file: &mut impl Write) -> io::Result<()> {
    let factors = source.factors;
    write!(file, "from,area")?;
    for surface in &factors.surfaces {
        write!(file, ",{}", quoted(&surface.name))?;
    }
    writeln!(file, ",environment")?;
    let line = |row: usize, all: &[f64]| {
        let surface = &factors.surfaces[row];
        let mut text = Vec::new();
        write!(text, "{},{:?}", quoted(&surface.name), surface.area)?;
        for factor in all {
            write!(text, ",{factor:?}")?;
        }
        writeln!(text, ",{:?}", 1.0 - all.iter().sum::<f64>())?;
        Ok(text)
    };
    source.write(file, factors.map_rows(line))
}

/// What View3D writes with `out=0`: a line with its name, a version, the format (0 is text), whether the scene is closed,
/// whether emittances are in the factors (0, they are not), and the number of surfaces; the areas; the factors, a row a
/// line; the emittances. It has no place for the environment, which is what the rows lack.
///
/// Programs that read it look for the numbers and not for columns, so all digits are there.
fn view3d(source: &Source<'_>, file: &mut impl Write) -> io::Result<()> {
    let factors = source.factors;
    let header = format!("View3D hatbox 0 {} 0 {}", u8::from(factors.is_closed()), factors.len());
    // Its own reader expects the line to have this width.
    writeln!(file, "{header:<30}")?;
    numbers(file, factors.surfaces.iter().map(|surface| surface.area))?;
    let line = |_: usize, all: &[f64]| {
        let mut text = Vec::new();
        numbers(&mut text, all.iter().copied()).map(|()| text)
    };
    source.write(file, factors.map_rows(line))?;
    numbers(file, factors.surfaces.iter().map(|surface| surface.emittance))
}

/// A line of numbers.
fn numbers(file: &mut impl Write, values: impl Iterator<Item = f64>) -> io::Result<()> {
    for (k, value) in values.enumerate() {
        write!(file, "{}{value:?}", if k == 0 { "" } else { " " })?;
    }
    writeln!(file)
}

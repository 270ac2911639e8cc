//! View factors in files: a sparse matrix for NumPy and SciPy, for everyone (Matrix Market), or a table for spreadsheets.
//!
//! Rows are written one after the other, straight from the exchange areas: the matrix itself is never in memory.

use super::atomic;
use super::csv::quoted;
use super::npy::{self, Scalar};
use super::write::WriteError;
use crate::view_factors::ViewFactors;
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
    write: fn(&ViewFactors, &Path) -> Result<(), atomic::AtomicError>,
}

/// Every format.
pub static OUTPUTS: [FactorOutput; 3] = [
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
/// [`WriteError`]; there is no new file then, and an old one is as it was.
pub fn write(factors: &ViewFactors, path: &Path) -> Result<(), WriteError> {
    Ok((writer_for(path)?.write)(factors, path)?)
}

/// The factors of a row that are not zero, each with its column.
fn nonzeros(factors: &ViewFactors, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
    factors.row(row).enumerate().filter(|&(_, factor)| factor != 0.0)
}

/// Compressed sparse rows, with the keys of `scipy.sparse.save_npz`.
#[expect(clippy::cast_possible_wrap, reason = "i32 was tried, and no array has 2^63 entries")]
fn npz(factors: &ViewFactors, file: &mut (impl Write + Seek)) -> io::Result<()> {
    let n = factors.len();
    let mut starts = vec![0_usize];
    for row in 0..n {
        starts.push(starts[row] + nonzeros(factors, row).count());
    }
    let mut archive = ZipWriter::new(file);
    let columns = || (0..n).flat_map(|row| nonzeros(factors, row).map(|(column, _)| column));
    // SciPy wants one integer type in both arrays, the narrower if it will do.
    if i32::try_from(starts[n]).is_ok() {
        array(&mut archive, "indices", &[starts[n]], columns().map(|column| column as i32))?;
        array(&mut archive, "indptr", &[n + 1], starts.iter().map(|&start| start as i32))?;
    } else {
        array(&mut archive, "indices", &[starts[n]], columns().map(|column| column as i64))?;
        array(&mut archive, "indptr", &[n + 1], starts.iter().map(|&start| start as i64))?;
    }
    entry(&mut archive, "format", &npy::encode_bytes("csr"))?;
    array(&mut archive, "shape", &[2], [n as i64; 2].into_iter())?;
    let values = (0..n).flat_map(|row| nonzeros(factors, row).map(|(_, factor)| factor));
    array(&mut archive, "data", &[starts[n]], values)?;
    array(&mut archive, "areas", &[n], factors.surfaces.iter().map(|surface| surface.area))?;
    let names: Vec<&str> = factors.surfaces.iter().map(|surface| surface.name.as_str()).collect();
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

fn matrix_market(factors: &ViewFactors, file: &mut impl Write) -> io::Result<()> {
    let n = factors.len();
    let count: usize = (0..n).map(|row| nonzeros(factors, row).count()).sum();
    writeln!(file, "%%MatrixMarket matrix coordinate real general")?;
    writeln!(file, "% view factors: entry (i, j) is the fraction of what leaves i that reaches j")?;
    writeln!(file, "{n} {n} {count}")?;
    for row in 0..n {
        for (column, factor) in nonzeros(factors, row) {
            writeln!(file, "{} {} {factor:?}", row + 1, column + 1)?;
        }
    }
    Ok(())
}

fn csv(factors: &ViewFactors, file: &mut impl Write) -> io::Result<()> {
    write!(file, "from,area")?;
    for surface in &factors.surfaces {
        write!(file, ",{}", quoted(&surface.name))?;
    }
    writeln!(file, ",environment")?;
    for (row, surface) in factors.surfaces.iter().enumerate() {
        write!(file, "{},{:?}", quoted(&surface.name), surface.area)?;
        let mut sum = 0.0;
        for factor in factors.row(row) {
            write!(file, ",{factor:?}")?;
            sum += factor;
        }
        writeln!(file, ",{:?}", 1.0 - sum)?;
    }
    Ok(())
}

//! Tables: the solution's nodes as `.csv`, and the points of `hatbox probe` in and out.
//!
//! Numbers are written with as many digits as give the same number back.

use crate::io::atomic::{self, AtomicError};
use crate::io::npy::{self, Array, NpyError};
use crate::linalg::MultiVector;
use crate::radiosity::Solution;
use glam::DVec3;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writes the nodes of a solution as a table: `x, y, z, nx, ny, nz, cell, material` and then `E_0 …` (lx or W/m²) and
/// `B_0 …` (lm/m² or W/m²), one per band. One row per broken coefficient: a place where cells meet has several.
///
/// # Errors
/// [`AtomicError`] if the file cannot be written; there is none then.
pub fn save(solution: &Solution, path: &Path) -> Result<(), AtomicError> {
    atomic::write(path, |file| {
        writeln!(file, "x,y,z,nx,ny,nz,cell,material{}", band_names(solution.bands()))?;
        for cell in 0..solution.space.cells() {
            let patch = solution.scene.mesh.patch(cell);
            let material = quoted(&solution.scene.material(cell).name);
            let nodes = solution.space.element(cell).nodes;
            for (node, row) in nodes.iter().zip(solution.space.range(cell)) {
                numbers(file, patch.point(node.at).to_array().into_iter().chain(patch.normal().to_array()), "")?;
                write!(file, ",{cell},{material}")?;
                numbers(file, values(&solution.irradiance, &solution.radiosity, row), ",")?;
                writeln!(file)?;
            }
        }
        Ok(())
    })
}

/// A place at which the solution is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// In metres.
    pub position: DVec3,
    /// Towards the side that is asked for; of any length but zero.
    pub normal: DVec3,
}

/// A file is no table of points.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PointsError {
    /// The system could not read it.
    #[error("cannot read the points `{}`: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A line is not understood.
    #[error("`{}`, {line}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Which line, and what is wrong with it.
        line: LineError,
    },
    /// A `.npy` file holds something else.
    #[error("cannot read the points `{}`: {source}", path.display())]
    Npy {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: NpyError,
    },
    /// A `.npy` file holds an array of another shape, or a point that is none.
    #[error("cannot read the points `{}`: {problem}", path.display())]
    Array {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
}

/// A line of a table is not a point.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {problem}")]
pub struct LineError {
    /// The line's number, from 1.
    pub line: usize,
    /// What is wrong with it, and what it should be.
    pub problem: String,
}

/// Reads points from a `.npy` array (N × 6) or a text table (see [`parse_points`]).
///
/// # Errors
/// [`PointsError`] if the file cannot be read, or something in it is no point.
pub fn read_points(path: &Path) -> Result<Vec<Point>, PointsError> {
    let owned = || path.to_owned();
    let bytes = fs::read(path).map_err(|source| PointsError::Io { path: owned(), source })?;
    if !is_npy(path) {
        return parse_points(&String::from_utf8_lossy(&bytes))
            .map_err(|line| PointsError::Line { path: owned(), line });
    }
    let array = Array::parse(&bytes).map_err(|source| PointsError::Npy { path: owned(), source })?;
    let &[_, 6] = array.shape() else {
        let problem = format!("its shape is {:?}, not N × 6 (x y z nx ny nz)", array.shape());
        return Err(PointsError::Array { path: owned(), problem });
    };
    let values = array.f64s().map_err(|source| PointsError::Npy { path: owned(), source })?;
    let rows = values.as_chunks::<6>().0.iter().enumerate();
    rows.map(|(row, &values)| {
        point(values).map_err(|problem| PointsError::Array { path: owned(), problem: format!("row {row}: {problem}") })
    })
    .collect()
}

/// Reads a table of points: a row of x y z nx ny nz per line, separated by semicolons, commas or blanks.
///
/// Empty lines and lines that begin with `#` are skipped. A header may name the columns, in any order and among others.
///
/// # Errors
/// [`LineError`] names the first line that is no point.
pub fn parse_points(text: &str) -> Result<Vec<Point>, LineError> {
    let text = text.trim_start_matches('\u{feff}');
    let lines = text.lines().map(str::trim).enumerate().map(|(i, line)| (i + 1, line));
    let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#')).peekable();
    let mut columns = None;
    if let Some(&(line, first)) = lines.peek()
        && fields(first).first().is_some_and(|field| field.parse::<f64>().is_err())
    {
        columns = Some(header(&fields(first)).map_err(|problem| LineError { line, problem })?);
        lines.next();
    }
    lines.map(|(line, text)| row(text, columns).map_err(|problem| LineError { line, problem })).collect()
}

const COLUMNS: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

/// Where each of the six columns is.
fn header(names: &[&str]) -> Result<[usize; 6], String> {
    let mut columns = [0; 6];
    for (column, wanted) in columns.iter_mut().zip(COLUMNS) {
        let place = names.iter().position(|name| name.eq_ignore_ascii_case(wanted));
        *column = place.ok_or_else(|| {
            format!(
                "this is neither a row of numbers nor a header with the columns {} (`{wanted}` is missing)",
                COLUMNS.join(" ")
            )
        })?;
    }
    Ok(columns)
}

fn row(line: &str, columns: Option<[usize; 6]>) -> Result<Point, String> {
    let fields = fields(line);
    if columns.is_none() && fields.len() != 6 {
        return Err(format!("{} columns where 6 are expected: {}", fields.len(), COLUMNS.join(" ")));
    }
    let mut values = [0.0; 6];
    for (k, column) in columns.unwrap_or([0, 1, 2, 3, 4, 5]).into_iter().enumerate() {
        let field = *fields.get(column).ok_or_else(|| format!("column `{}` is missing", COLUMNS[k]))?;
        values[k] = field.parse().map_err(|_| format!("`{field}` is no number (column `{}`)", COLUMNS[k]))?;
    }
    point(values)
}

fn point(values: [f64; 6]) -> Result<Point, String> {
    if let Some(k) = values.iter().position(|v| !v.is_finite()) {
        return Err(format!("column `{}` is not finite", COLUMNS[k]));
    }
    let [x, y, z, nx, ny, nz] = values;
    let normal = DVec3::new(nx, ny, nz);
    if normal == DVec3::ZERO {
        return Err("the normal (nx, ny, nz) is zero".to_owned());
    }
    Ok(Point { position: DVec3::new(x, y, z), normal })
}

/// The fields of a line: between semicolons if it has any, else between commas, else between blanks. What stands in
/// quotes is one field.
fn fields(line: &str) -> Vec<&str> {
    let mut quoted = false;
    let mut outside = |c: char| {
        quoted ^= c == '"';
        !quoted
    };
    let unquoted: String = line.chars().filter(|&c| outside(c)).collect();
    let separator = [';', ','].into_iter().find(|&s| unquoted.contains(s));
    let mut quoted = false;
    let at_separator = |c: char| {
        quoted ^= c == '"';
        !quoted && separator.map_or(c.is_whitespace(), |s| s == c)
    };
    let fields = line.split(at_separator).map(|field| field.trim().trim_matches('"'));
    // Several blanks are one separator; between two commas there is an empty field.
    fields.filter(|field| separator.is_some() || !field.is_empty()).collect()
}

/// Writes points with the values found there (see [`write_points`]) to a `.npy` array or, with any other extension, a
/// table. The functions have one row per point.
///
/// # Errors
/// [`AtomicError`] if the file cannot be written; there is none then.
pub fn save_points(
    points: &[Point],
    irradiance: &MultiVector,
    radiosity: &MultiVector,
    path: &Path,
) -> Result<(), AtomicError> {
    atomic::write(path, |file| {
        if !is_npy(path) {
            return write_points(points, irradiance, radiosity, file);
        }
        let columns = 6 + irradiance.bands() + radiosity.bands();
        let rows = points.iter().enumerate().flat_map(|(i, point)| with_values(point, irradiance, radiosity, i));
        npy::write(file, &[points.len(), columns], rows)
    })
}

/// Writes a table with a header: the six columns of each point, then `E_0 …` and `B_0 …`.
///
/// # Errors
/// What the writer says.
pub fn write_points(
    points: &[Point],
    irradiance: &MultiVector,
    radiosity: &MultiVector,
    writer: &mut impl Write,
) -> io::Result<()> {
    writeln!(writer, "{}{}", COLUMNS.join(","), band_names(radiosity.bands()))?;
    points.iter().enumerate().try_for_each(|(i, point)| {
        numbers(writer, with_values(point, irradiance, radiosity, i), "")?;
        writeln!(writer)
    })
}

/// A point and, of the functions' row i, E and B.
fn with_values<'a>(
    point: &Point,
    irradiance: &'a MultiVector,
    radiosity: &'a MultiVector,
    i: usize,
) -> impl Iterator<Item = f64> + 'a {
    let point = point.position.to_array().into_iter().chain(point.normal.to_array());
    point.chain(values(irradiance, radiosity, i))
}

fn is_npy(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npy"))
}

fn band_names(bands: usize) -> String {
    ["E", "B"].iter().flat_map(|name| (0..bands).map(move |band| format!(",{name}_{band}"))).collect()
}

/// E and then B of one row.
fn values<'a>(irradiance: &'a MultiVector, radiosity: &'a MultiVector, row: usize) -> impl Iterator<Item = f64> + 'a {
    irradiance.iter_bands().chain(radiosity.iter_bands()).map(move |band| band[row])
}

/// Numbers with commas between them, and `before` in front of the first.
fn numbers(file: &mut impl Write, values: impl Iterator<Item = f64>, before: &str) -> io::Result<()> {
    let mut separator = before;
    for value in values {
        // Adding zero makes a negative zero a plain one.
        write!(file, "{separator}{:?}", value + 0.0)?;
        separator = ",";
    }
    Ok(())
}

/// A field of text, in quotes if it must be.
pub(super) fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r', ';']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

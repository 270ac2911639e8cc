//! The solution as a ParaView unstructured grid (`.vtu`).
//!
//! Every cell has points of its own, so that the broken function is shown as it is, jumps included. Constant elements
//! are cell data; others are point data on the cells that interpolate as the element does: `VTK_TRIANGLE`, `VTK_QUAD`,
//! and `VTK_LAGRANGE_TRIANGLE` for quadratics, whose nodes stand in the same order as ours.
//!
//! Arrays: `radiosity` and `irradiance` (one component per band), and of each cell `material`, `group` (indices),
//! `reflectance` (per band, NaN where a texture varies it) and `error` (per band, the indicated error of the radiosity, root
//! of the mean square over the cell). (Names are left out: string arrays are not read by
//! `meshio`.)
//!
//! The file is written here and not by `vtkio`: that crate's stable release is years old, and the format is one short
//! XML header before raw little-endian arrays.

use crate::element::{Element, Shape};
use crate::io::atomic::{self, AtomicError};
use crate::linalg::MultiVector;
use crate::radiosity::{Solution, local_error};
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// Writes a solution as a `.vtu` file.
///
/// # Errors
/// [`AtomicError`] if the file cannot be written; there is none then.
pub fn save(solution: &Solution, path: &Path) -> Result<(), AtomicError> {
    let grid = Grid::of(solution);
    atomic::write(path, |file| {
        file.write_all(grid.header.as_bytes())?;
        file.write_all(&grid.appended)?;
        file.write_all(b"\n  </AppendedData>\n</VTKFile>\n")
    })
}

/// The file as it grows: the XML, and the arrays that it refers to by their offset.
#[derive(Default)]
struct Grid {
    header: String,
    appended: Vec<u8>,
}

impl Grid {
    fn of(solution: &Solution) -> Self {
        let (mesh, space) = (&solution.scene.mesh, &solution.space);
        let points: usize = mesh.cells.iter().enumerate().map(|(c, _)| nodes(space.element(c)).count()).sum();
        let mut grid = Self::default();
        grid.line("<?xml version=\"1.0\"?>");
        grid.line(
            "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">",
        );
        grid.line("  <UnstructuredGrid>");
        grid.line(&format!("    <Piece NumberOfPoints=\"{points}\" NumberOfCells=\"{}\">", mesh.cells.len()));
        grid.geometry(solution);
        let constant = space.basis().order == 1;
        grid.line("      <PointData>");
        if !constant {
            grid.functions(solution);
        }
        grid.line("      </PointData>");
        grid.line("      <CellData>");
        if constant {
            grid.functions(solution);
        }
        grid.materials(solution);
        grid.line("      </CellData>");
        grid.line("    </Piece>");
        grid.line("  </UnstructuredGrid>");
        grid.header.push_str("  <AppendedData encoding=\"raw\">\n_");
        grid
    }

    fn line(&mut self, line: &str) {
        self.header.push_str(line);
        self.header.push('\n');
    }

    /// An array of rows of `components`; the bytes follow their length.
    fn array<const N: usize>(
        &mut self,
        name: &str,
        kind: &str,
        components: usize,
        values: impl Iterator<Item = [u8; N]>,
    ) {
        let offset = self.appended.len();
        // Writing to a string cannot fail.
        let _ = writeln!(
            self.header,
            "        <DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" \
             format=\"appended\" offset=\"{offset}\"/>"
        );
        self.appended.extend_from_slice(&[0; 8]);
        values.for_each(|bytes| self.appended.extend_from_slice(&bytes));
        let length = (self.appended.len() - offset - 8) as u64;
        self.appended[offset..offset + 8].copy_from_slice(&length.to_le_bytes());
    }

    fn floats(&mut self, name: &str, components: usize, values: impl Iterator<Item = f64>) {
        self.array(name, "Float64", components, values.map(f64::to_le_bytes));
    }

    /// VTK's own indices are signed; none is large enough to tell the difference.
    fn integers(&mut self, name: &str, values: impl Iterator<Item = u64>) {
        self.array(name, "Int64", 1, values.map(u64::to_le_bytes));
    }

    fn geometry(&mut self, solution: &Solution) {
        let (mesh, space) = (&solution.scene.mesh, &solution.space);
        let cells = || (0..mesh.cells.len()).map(|cell| (cell, space.element(cell)));
        self.line("      <Points>");
        let points = cells().flat_map(|(cell, element)| {
            let patch = mesh.patch(cell);
            nodes(element).flat_map(move |at| patch.point(at).to_array())
        });
        self.floats("Points", 3, points);
        self.line("      </Points>");
        self.line("      <Cells>");
        let ends = cells().scan(0, |end, (_, element)| {
            *end += nodes(element).count() as u64;
            Some(*end)
        });
        let ends: Vec<u64> = ends.collect();
        self.integers("connectivity", 0..ends.last().copied().unwrap_or(0));
        self.integers("offsets", ends.into_iter());
        self.array("types", "UInt8", 1, cells().map(|(_, element)| [cell_type(element)]));
        self.line("      </Cells>");
    }

    fn functions(&mut self, solution: &Solution) {
        for (name, field) in [("radiosity", &solution.radiosity), ("irradiance", &solution.irradiance)] {
            self.floats(name, field.bands(), rows(field));
        }
    }

    fn materials(&mut self, solution: &Solution) {
        let (mesh, bands) = (&solution.scene.mesh, solution.bands());
        self.integers("material", mesh.cells.iter().map(|cell| u64::from(cell.material)));
        self.integers("group", mesh.cells.iter().map(|cell| u64::from(cell.group)));
        let reflectance = (0..mesh.cells.len()).flat_map(|cell| {
            let reflectance = &solution.scene.material(cell).reflectance;
            (0..bands).map(|band| reflectance.uniform(band).unwrap_or(f64::NAN))
        });
        self.floats("reflectance", bands, reflectance);
        self.floats("error", bands, rows(&local_error(solution)));
    }
}

/// The points of a cell: the nodes, or the corners where the element has none on its boundary.
fn nodes(element: &'static Element) -> impl Iterator<Item = [f64; 2]> {
    let corners = if element.degree == 0 { element.shape.reference_corners() } else { &[] };
    let nodes = if element.degree == 0 { &[] } else { element.nodes };
    corners.iter().copied().chain(nodes.iter().map(|node| node.at))
}

/// VTK's number for cells that interpolate as the element does.
fn cell_type(element: &Element) -> u8 {
    match (element.shape, element.degree) {
        (Shape::Triangle, 2) => 69,
        (Shape::Triangle, _) => 5,
        (Shape::Quad, _) => 9,
    }
}

/// The entries row after row.
fn rows(field: &MultiVector) -> impl Iterator<Item = f64> {
    (0..field.rows()).flat_map(|row| field.iter_bands().map(move |band| band[row]))
}

//! What a solution can be written as.
//!
//! [`OUTPUTS`] is the one list of formats: the command line, its help, the documentation and the tests read it.

use super::atomic::{self, AtomicError};
use super::{csv, npz, picture, vtu, write_gltf};
use crate::bake::{Exposure, percentile};
use crate::linalg::MultiVector;
use crate::progress::{Interrupted, Progress, Silent};
use crate::radiosity::{Shown, Solution};
use crate::render::{RenderOptions, render};
use crate::scene::Physics;
use std::fmt;
use std::path::{Path, PathBuf};

/// A solution could not be written; no file was made or changed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The extension says no format that is written.
    #[error("cannot tell from the name what to write to `{}`: use one of {}", path.display(), in_words(known))]
    UnknownExtension {
        /// The file.
        path: PathBuf,
        /// The extensions that are known, without the dot.
        known: Vec<&'static str>,
    },
    /// The file cannot be written.
    #[error(transparent)]
    File(#[from] AtomicError),
    /// The solution is no solution.
    #[error("the solution is not finite in cell {cell}; nothing was written")]
    NotFinite {
        /// The first cell where it is not.
        cell: usize,
    },
    /// The work was asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// How a solution is written, as far as the format leaves it open.
#[derive(Clone, Copy)]
pub struct WriteOptions<'a> {
    /// The view that pictures show; its [`shown`](RenderOptions::shown) also says what `.glb` shows.
    pub view: RenderOptions,
    /// How bright the colours of `.glb` and `.png` are; automatic if not given.
    pub exposure: Option<Exposure>,
    /// Whether `.png` shows luminance in false colours.
    pub false_color: bool,
    /// Where the false colours end, in the unit of what is shown; if not given, at the brightest surfaces in the
    /// picture but lamps.
    pub false_color_top: Option<f64>,
    /// Hears how a picture proceeds.
    pub progress: &'a dyn Progress,
}

impl Default for WriteOptions<'_> {
    fn default() -> Self {
        Self {
            view: RenderOptions::default(),
            exposure: None,
            false_color: false,
            false_color_top: None,
            progress: &Silent,
        }
    }
}

impl fmt::Debug for WriteOptions<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { view, exposure, false_color, false_color_top, .. } = self;
        let mut shown = f.debug_struct("WriteOptions");
        shown.field("view", view).field("exposure", exposure).field("false_color", false_color);
        shown.field("false_color_top", false_color_top).finish_non_exhaustive()
    }
}

/// A format that solutions are written in.
#[derive(Debug)]
pub struct Output {
    /// The extension that chooses it, without the dot.
    pub extension: &'static str,
    /// One line for help texts.
    pub summary: &'static str,
    /// Writes a solution whose values are finite.
    write: fn(&Solution, &Path, &WriteOptions) -> Result<(), WriteError>,
}

/// Every format.
pub static OUTPUTS: [Output; 6] = [
    Output {
        extension: "glb",
        summary: "baked glTF: HDR radiosity per vertex and its exposed colour",
        write: |solution, path, options| Ok(write_gltf::save(solution, options.view.shown, options.exposure, path)?),
    },
    Output {
        extension: "npz",
        summary: "the solution: mesh, materials, basis, coefficients (numpy.load)",
        write: |solution, path, _| Ok(npz::save(solution, path)?),
    },
    Output {
        extension: "vtu",
        summary: "ParaView unstructured grid",
        write: |solution, path, _| Ok(vtu::save(solution, path)?),
    },
    Output {
        extension: "csv",
        summary: "table of the values at the nodes",
        write: |solution, path, _| Ok(csv::save(solution, path)?),
    },
    Output { extension: "png", summary: "a rendered view, exposed or in false colours", write: write_png },
    Output { extension: "exr", summary: "a rendered view in physical units", write: write_exr },
];

/// Extensions as a list in words.
fn in_words(extensions: &[&str]) -> String {
    extensions.iter().map(|extension| format!(".{extension}")).collect::<Vec<_>>().join(", ")
}

/// The format that a path's extension chooses, after making sure that the file could be written: to be asked *before*
/// hours of work.
///
/// # Errors
/// [`WriteError::UnknownExtension`], or [`WriteError::File`] if the folder does not exist or may not be written to.
pub fn writer_for(path: &Path) -> Result<&'static Output, WriteError> {
    let output = output_for(path)?;
    atomic::check(path)?;
    Ok(output)
}

/// Writes a solution in the format that the path's extension chooses.
///
/// # Errors
/// [`WriteError`]; there is no new file then, and an old one is as it was.
pub fn write(solution: &Solution, path: &Path, options: &WriteOptions) -> Result<(), WriteError> {
    let output = output_for(path)?;
    check_finite(solution)?;
    (output.write)(solution, path, options)
}

fn output_for(path: &Path) -> Result<&'static Output, WriteError> {
    let extension = path.extension().unwrap_or_default();
    let output = OUTPUTS.iter().find(|output| extension.eq_ignore_ascii_case(output.extension));
    let known = || OUTPUTS.iter().map(|output| output.extension).collect();
    output.ok_or_else(|| WriteError::UnknownExtension { path: path.to_owned(), known: known() })
}

fn check_finite(solution: &Solution) -> Result<(), WriteError> {
    let bad = |field: &MultiVector| field.iter_bands().filter_map(|b| b.iter().position(|v| !v.is_finite())).min();
    match [&solution.radiosity, &solution.irradiance].into_iter().filter_map(bad).min() {
        Some(row) => Err(WriteError::NotFinite {
            cell: solution.space.offsets().partition_point(|&o| o <= row).saturating_sub(1),
        }),
        None => Ok(()),
    }
}

fn write_png(solution: &Solution, path: &Path, options: &WriteOptions) -> Result<(), WriteError> {
    let mut view = options.view;
    if !options.false_color {
        let image = render(solution, &view, options.progress)?;
        let exposure = options.exposure.unwrap_or_else(|| Exposure::automatic(solution, view.shown));
        return Ok(picture::save_png(&image, exposure, path)?);
    }
    // The scale stands beside the view, and together they are as wide as was asked for, if there is room.
    let panel = picture::panel_width(view.height);
    view.width = if view.width > 2 * panel { view.width - panel } else { view.width };
    let image = render(solution, &view, options.progress)?;
    let top = || picture::brightest(&image).min(percentile(solution, view.shown, 0.99));
    let top = options.false_color_top.unwrap_or_else(top);
    let unit = match (solution.scene.physics, view.shown) {
        (Physics::Light, Shown::Radiosity) => "lm/m²",
        (Physics::Light, Shown::Irradiance) => "lx",
        (Physics::Heat, _) => "W/m²",
    };
    Ok(picture::save_false_color(&image, top, unit, path)?)
}

fn write_exr(solution: &Solution, path: &Path, options: &WriteOptions) -> Result<(), WriteError> {
    let image = render(solution, &options.view, options.progress)?;
    Ok(picture::save_exr(&image, path)?)
}

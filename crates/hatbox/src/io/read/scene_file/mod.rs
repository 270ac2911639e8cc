//! The scene file (`.toml`): names meshes, puts them in place, and says what their materials are.
//!
//! ```toml
#![doc = include_str!("example.toml")]
//! ```
//!
//! Every error carries the text of the file and the bytes that are wrong, so that they can be shown underlined.

mod assemble;
mod material;
mod schema;

use super::{RawScene, ReadError, files};
use crate::io::suggestion;
use crate::io::unit;
use crate::scene::{Camera, Physics};
use glam::DVec3;
use schema::{CameraEntry, Content, Length};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use toml::Spanned;

/// A scene file that shows every key.
pub const EXAMPLE: &str = include_str!("example.toml");

/// Reads a `.toml` scene file and the meshes that it names.
pub(super) fn read(file: &Path) -> Result<RawScene, ReadError> {
    let bytes = files::read(file)?;
    let not_text = |_| ReadError::new(file, "", "it is not UTF-8 text", "save it as UTF-8");
    let text = str::from_utf8(files::unmarked(&bytes)).map_err(not_text)?;
    let source = Source { file, text: text.into() };
    let content: Content = toml::from_str(&source.text).map_err(|error| source.syntax(&error))?;
    let metres = content.unit.as_ref().map_or(Ok(1.0), |unit| source.metres(unit))?;
    let mut scene = assemble::meshes(&source, &content.mesh, metres)?;
    scene.physics = content.physics.map_or(Physics::Light, Into::into);
    material::apply(&source, &content.material, &mut scene)?;
    if let Some(camera) = &content.camera {
        scene.camera = Some(source.camera(camera, metres)?);
    }
    Ok(scene)
}

/// The file and its text: what errors quote.
struct Source<'a> {
    file: &'a Path,
    text: Arc<str>,
}

impl Source<'_> {
    /// An error about some bytes of the file.
    fn error(&self, span: Range<usize>, what: &str, reason: impl Into<String>, remedy: impl Into<String>) -> ReadError {
        let before = self.text.get(..span.start).unwrap_or(&self.text);
        let line = before.matches('\n').count() + 1;
        let separator = if what.is_empty() { "" } else { ", " };
        let place = format!("line {line}{separator}{what}");
        ReadError::new(self.file, place, reason, remedy).with_snippet(&self.text, span)
    }

    fn syntax(&self, error: &toml::de::Error) -> ReadError {
        let span = error.span().unwrap_or(0..0);
        let reason = error.message().lines().collect::<Vec<_>>().join(", ");
        let remedy = suggestion::meant(&reason).map_or_else(
            || "correct it as the guide's chapter on scene files shows (book/scene-files.md)".to_owned(),
            |known| format!("did you mean `{known}`?"),
        );
        self.error(span, "", reason, remedy)
    }

    fn metres(&self, length: &Spanned<Length>) -> Result<f64, ReadError> {
        let metres = match length.get_ref() {
            Length::Metres(metres) => (*metres > 0.0 && metres.is_finite()).then_some(*metres),
            Length::Named(name) => unit::named(name).map(|unit| unit.metres),
        };
        metres.ok_or_else(|| {
            let remedy = format!("use one of {}, or a positive number of metres", unit::names());
            self.error(length.span(), "unit", "this is no unit of length", remedy)
        })
    }

    /// A vector of finite numbers.
    fn vector(&self, vector: &Spanned<[f64; 3]>, what: &str) -> Result<DVec3, ReadError> {
        let value = DVec3::from_array(*vector.get_ref());
        if value.is_finite() {
            return Ok(value);
        }
        Err(self.error(vector.span(), what, "it has a coordinate that is not finite", "give three finite numbers"))
    }

    fn camera(&self, entry: &CameraEntry, metres: f64) -> Result<Camera, ReadError> {
        let eye = self.vector(&entry.eye, "camera eye")? * metres;
        let target = self.vector(&entry.target, "camera target")? * metres;
        let up = entry.up.as_ref().map_or(Ok(DVec3::Y), |up| self.vector(up, "camera up"))?;
        if (target - eye).normalize_or_zero().cross(up.normalize_or_zero()).length() < 1e-9 {
            let span = entry.up.as_ref().map_or(entry.target.span(), Spanned::span);
            let reason = "the camera looks along its up direction, or from its target";
            return Err(self.error(span, "camera", reason, "choose another `up` or `target`"));
        }
        let fov = *entry.fov.get_ref();
        if !(fov > 0.0 && fov < 180.0) {
            let reason = format!("a field of view of {fov}° cannot be");
            return Err(self.error(entry.fov.span(), "camera fov", reason, "give degrees between 0 and 180"));
        }
        Ok(Camera { eye, target, up, fov_y: fov.to_radians() })
    }
}

//! The keys of a scene file, as they are parsed.

use crate::scene::Physics;
use serde::Deserialize;
use std::collections::BTreeMap;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Content {
    pub(super) unit: Option<Spanned<Length>>,
    pub(super) physics: Option<PhysicsName>,
    #[serde(default)]
    pub(super) mesh: Vec<MeshEntry>,
    #[serde(default)]
    pub(super) material: BTreeMap<Spanned<String>, MaterialEntry>,
    pub(super) camera: Option<CameraEntry>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected the name of a unit, or a number of metres")]
pub(super) enum Length {
    Metres(f64),
    Named(String),
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum PhysicsName {
    Light,
    Heat,
}

impl From<PhysicsName> for Physics {
    fn from(name: PhysicsName) -> Self {
        match name {
            PhysicsName::Light => Self::Light,
            PhysicsName::Heat => Self::Heat,
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MeshEntry {
    pub(super) file: Spanned<String>,
    #[serde(default)]
    pub(super) prefix: String,
    pub(super) material: Option<Spanned<String>>,
    pub(super) unit: Option<Spanned<Length>>,
    pub(super) scale: Option<Spanned<Scale>>,
    pub(super) rotate: Option<Rotation>,
    pub(super) translate: Option<Spanned<[f64; 3]>>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number, or a list of three")]
pub(super) enum Scale {
    Uniform(f64),
    PerAxis([f64; 3]),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Rotation {
    pub(super) axis: Spanned<[f64; 3]>,
    pub(super) degrees: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaterialEntry {
    pub(super) reflectance: Option<Spanned<Value>>,
    pub(super) emissivity: Option<Spanned<Value>>,
    pub(super) exitance: Option<Spanned<Value>>,
    pub(super) radiance: Option<Spanned<Value>>,
    pub(super) temperature: Option<Spanned<f64>>,
    pub(super) sides: Option<Sides>,
}

/// What a surface has at each point and in each band.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "expected a number, a list with one for each band, or { file = …, factor = …, srgb = … }"
)]
pub(super) enum Value {
    Gray(f64),
    Bands(Vec<f64>),
    Picture(Picture),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Picture {
    pub(super) file: String,
    #[serde(default = "one")]
    pub(super) factor: Factor,
    #[serde(default = "yes")]
    pub(super) srgb: bool,
}

#[derive(Deserialize, Clone)]
#[serde(untagged, expecting = "expected a number, or a list with one for each band")]
pub(super) enum Factor {
    Gray(f64),
    Bands(Vec<f64>),
}

fn one() -> Factor {
    Factor::Gray(1.0)
}

fn yes() -> bool {
    true
}

#[derive(Deserialize, Clone, Copy, PartialEq)]
#[serde(rename_all = "lowercase")]
pub(super) enum Sides {
    One,
    Two,
    None,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraEntry {
    pub(super) eye: Spanned<[f64; 3]>,
    pub(super) target: Spanned<[f64; 3]>,
    pub(super) up: Option<Spanned<[f64; 3]>>,
    pub(super) fov: Spanned<f64>,
}

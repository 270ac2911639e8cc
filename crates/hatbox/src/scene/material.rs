use super::Texture;
use glam::{DVec2, DVec3};
use std::fmt;
use std::sync::Arc;

/// The Stefan–Boltzmann constant σ in W/(m² K⁴) (CODATA 2018): a surface of emissivity ε at T kelvin has B⁰ = εσT⁴.
pub const STEFAN_BOLTZMANN: f64 = 5.670_374_419e-8;

/// A place on a surface, as a material sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// Position in metres.
    pub position: DVec3,
    /// Texture coordinates, in the file's convention (v runs down the image, as in glTF).
    pub uv: DVec2,
}

/// A number per band at each point of a surface.
#[derive(Clone)]
pub enum Quantity {
    /// The same everywhere; a single number stands for all bands.
    Uniform(Vec<f64>),
    /// A factor per band times a texture.
    Textured {
        /// The factor; a single number stands for all bands.
        factor: Vec<f64>,
        /// The texture.
        texture: Arc<Texture>,
    },
    /// Any function of the place and the band.
    Function(Arc<Function>),
}

/// A number for a place and a band.
pub type Function = dyn Fn(&Site, usize) -> f64 + Send + Sync;

impl Quantity {
    /// The same value everywhere and in all bands.
    pub fn gray(value: f64) -> Self {
        Self::Uniform(vec![value])
    }

    /// A function of the place and the band.
    pub fn function(f: impl Fn(&Site, usize) -> f64 + Send + Sync + 'static) -> Self {
        Self::Function(Arc::new(f))
    }

    /// The value at a place.
    pub fn at(&self, site: &Site, band: usize) -> f64 {
        match self {
            Self::Uniform(values) => broadcast(values, band),
            Self::Textured { factor, texture } => broadcast(factor, band) * texture.sample(site.uv, band),
            Self::Function(f) => f(site, band),
        }
    }

    /// The value in a band, if it is the same everywhere.
    pub fn uniform(&self, band: usize) -> Option<f64> {
        match self {
            Self::Uniform(values) => Some(broadcast(values, band)),
            Self::Textured { factor, .. } if broadcast(factor, band) == 0.0 => Some(0.0),
            _ => None,
        }
    }

    /// What the texture of a band is multiplied with; `None` unless there is a texture.
    pub fn factor(&self, band: usize) -> Option<f64> {
        match self {
            Self::Textured { factor, .. } => Some(broadcast(factor, band)),
            _ => None,
        }
    }

    /// Whether the other is given by the same numbers, and by the same texture or function.
    pub fn is_given_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Uniform(a), Self::Uniform(b)) => a == b,
            (Self::Textured { factor: a, texture: s }, Self::Textured { factor: b, texture: t }) => {
                a == b && Arc::ptr_eq(s, t)
            }
            (Self::Function(a), Self::Function(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }

    /// Whether it is zero everywhere in every band.
    pub fn is_zero(&self) -> bool {
        match self {
            Self::Uniform(values) => values.iter().all(|&v| v == 0.0),
            Self::Textured { factor, .. } => factor.iter().all(|&v| v == 0.0),
            Self::Function(_) => false,
        }
    }

    /// Number of bands it was given with: 1 where it is gray or leaves the number open.
    pub fn bands(&self) -> usize {
        match self {
            Self::Uniform(values) => values.len(),
            Self::Textured { factor, texture } => factor.len().max(texture.channels()),
            Self::Function(_) => 1,
        }
    }
}

/// A single number stands for all bands.
fn broadcast(values: &[f64], band: usize) -> f64 {
    values.get(band).or(values.last()).copied().unwrap_or(0.0)
}

impl fmt::Debug for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Uniform(values) => write!(f, "Uniform({values:?})"),
            Self::Textured { factor, texture } => {
                write!(f, "Textured({factor:?} × {}×{})", texture.width(), texture.height())
            }
            Self::Function(_) => write!(f, "Function"),
        }
    }
}

/// What a surface is made of: an ideal diffuse reflector and emitter.
#[derive(Debug, Clone)]
pub struct Material {
    /// Its name in the file.
    pub name: String,
    /// R, between 0 and 1 (heat: 1 − ε).
    pub reflectance: Quantity,
    /// B⁰ in lm/m² or W/m² (a diffuse emitter of radiance L has B⁰ = πL; heat: εσT⁴).
    pub exitance: Quantity,
    /// Whether both sides of its faces send and receive.
    pub two_sided: bool,
    /// Whether neither side does: its faces hide what is behind them, and have no unknowns. What hits them is lost.
    pub blocks_only: bool,
}

impl Material {
    /// A one-sided gray reflector that does not emit.
    pub fn diffuse(name: &str, reflectance: f64) -> Self {
        Self {
            name: name.to_owned(),
            reflectance: Quantity::gray(reflectance),
            exitance: Quantity::gray(0.0),
            two_sided: false,
            blocks_only: false,
        }
    }

    /// B⁰ + R E, what leaves a point that receives an irradiance, in one band.
    pub fn leaving(&self, site: &Site, band: usize, irradiance: f64) -> f64 {
        self.exitance.at(site, band) + self.reflectance.at(site, band) * irradiance
    }
}

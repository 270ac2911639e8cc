//! What a scene file says about materials, laid over what the meshes say.

use super::Source;
use super::schema::{Factor, MaterialEntry, Picture, Sides, Value};
use crate::io::read::picture::{self, Coding};
use crate::io::read::{RawScene, ReadError, files};
use crate::io::suggestion::nearest;
use crate::scene::{Material, Physics, Quantity, STEFAN_BOLTZMANN, Texture, Wrap};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;
use toml::Spanned;

/// The name that stands for all materials.
pub(super) const ALL: &str = "*";

/// Lays the tables over the scene's materials: first `"*"`, then the named ones.
pub(super) fn apply(
    source: &Source<'_>,
    entries: &BTreeMap<Spanned<String>, MaterialEntry>,
    scene: &mut RawScene,
) -> Result<(), ReadError> {
    let mut overlays = Vec::with_capacity(entries.len());
    for (name, entry) in entries {
        if name.get_ref() != ALL && scene.materials.iter().all(|material| material.name != *name.get_ref()) {
            return Err(unknown(source, name, &scene.materials));
        }
        let place = format!("material `{}`", name.get_ref());
        let overlay = Overlay::new(&Context { source, place: &place, physics: scene.physics }, entry)?;
        overlays.push((name.get_ref().as_str(), overlay));
    }
    overlays.sort_by_key(|&(name, _)| name != ALL);
    for material in &mut scene.materials {
        let meant: Vec<_> = overlays.iter().filter(|(name, _)| [ALL, &material.name].contains(name)).collect();
        // Emission last: that of a temperature depends on the reflectance.
        for (_, overlay) in &meant {
            overlay.lay_reflection_over(material);
        }
        for (_, overlay) in &meant {
            overlay.lay_emission_over(material);
        }
        if meant.iter().any(|(_, overlay)| overlay.reflectance.is_some()) {
            let no_more =
                |warning: &String| scene.guessed.iter().any(|[name, text]| *name == material.name && text == warning);
            scene.warnings.retain(|warning| !no_more(warning));
        }
    }
    Ok(())
}

fn unknown(source: &Source<'_>, name: &Spanned<String>, materials: &[Material]) -> ReadError {
    let guess = nearest(name.get_ref(), materials.iter().map(|material| material.name.as_str()));
    let names = || materials.iter().map(|material| format!("`{}`", material.name)).collect::<Vec<_>>().join(", ");
    let remedy =
        guess.map_or_else(|| format!("the meshes have {}", names()), |known| format!("did you mean `{known}`?"));
    let reason = format!("no mesh has a material `{}`", name.get_ref());
    source.error(name.span(), "material", reason, remedy)
}

/// Where a table stands.
struct Context<'a> {
    source: &'a Source<'a>,
    place: &'a str,
    physics: Physics,
}

/// What a table says.
struct Overlay {
    reflectance: Option<Quantity>,
    emission: Option<Emission>,
    sides: Option<Sides>,
}

enum Emission {
    /// B⁰ itself.
    Exitance(Quantity),
    /// T in kelvin: B⁰ = εσT⁴ with the material's ε = 1 − R.
    Temperature(f64),
}

impl Overlay {
    fn new(context: &Context<'_>, entry: &MaterialEntry) -> Result<Self, ReadError> {
        let reflectance = match (&entry.reflectance, &entry.emissivity) {
            (Some(_), Some(emissivity)) => {
                return Err(context.both(emissivity, "reflectance", "emissivity"));
            }
            (Some(reflectance), None) => Some(context.reflectance(reflectance, "reflectance")?),
            (None, Some(emissivity)) => {
                context.only_in_heat(emissivity, "emissivity")?;
                Some(complement(context.reflectance(emissivity, "emissivity")?))
            }
            (None, None) => None,
        };
        Ok(Self { reflectance, emission: Emission::new(context, entry)?, sides: entry.sides })
    }

    fn lay_reflection_over(&self, material: &mut Material) {
        if let Some(reflectance) = &self.reflectance {
            material.reflectance = reflectance.clone();
        }
        if let Some(sides) = self.sides {
            (material.two_sided, material.blocks_only) = (sides == Sides::Two, sides == Sides::None);
        }
    }

    fn lay_emission_over(&self, material: &mut Material) {
        match &self.emission {
            Some(Emission::Exitance(exitance)) => material.exitance = exitance.clone(),
            Some(Emission::Temperature(kelvin)) => {
                let black = STEFAN_BOLTZMANN * kelvin.powi(4);
                material.exitance = scaled(complement(material.reflectance.clone()), black);
            }
            None => {}
        }
    }
}

impl Emission {
    fn new(context: &Context<'_>, entry: &MaterialEntry) -> Result<Option<Self>, ReadError> {
        match (&entry.exitance, &entry.radiance, &entry.temperature) {
            (Some(_), Some(radiance), _) => Err(context.both(radiance, "exitance", "radiance")),
            (Some(exitance), None, Some(_)) => Err(context.both(exitance, "temperature", "exitance")),
            (None, Some(radiance), Some(_)) => Err(context.both(radiance, "temperature", "radiance")),
            (Some(exitance), None, None) => Ok(Some(Self::Exitance(context.exitance(exitance, "exitance")?))),
            (None, Some(radiance), None) => {
                Ok(Some(Self::Exitance(scaled(context.exitance(radiance, "radiance")?, PI))))
            }
            (None, None, Some(temperature)) => {
                context.only_in_heat(temperature, "temperature")?;
                let kelvin = *temperature.get_ref();
                if !(0.0..f64::INFINITY).contains(&kelvin) {
                    let reason = format!("a temperature of {kelvin} K cannot be");
                    return Err(context.error(temperature, "temperature", reason, "give kelvin, at least 0"));
                }
                Ok(Some(Self::Temperature(kelvin)))
            }
            (None, None, None) => Ok(None),
        }
    }
}

impl Context<'_> {
    fn error<T>(&self, value: &Spanned<T>, key: &str, reason: impl Into<String>, remedy: &str) -> ReadError {
        self.source.error(value.span(), &format!("{}, {key}", self.place), reason, remedy)
    }

    fn both<T>(&self, value: &Spanned<T>, first: &str, second: &str) -> ReadError {
        let reason = format!("both {first} and {second} are given, and they say the same thing");
        self.error(value, second, reason, "keep one of them")
    }

    fn only_in_heat<T>(&self, value: &Spanned<T>, key: &str) -> Result<(), ReadError> {
        match self.physics {
            Physics::Heat => Ok(()),
            Physics::Light => {
                let remedy = "write physics = \"heat\" at the top, or give reflectance and exitance";
                Err(self.error(value, key, format!("{key} has a meaning for heat only"), remedy))
            }
        }
    }

    /// A value between 0 and 1.
    fn reflectance(&self, value: &Spanned<Value>, key: &str) -> Result<Quantity, ReadError> {
        self.quantity(value, key, |values| {
            files::reflectance_fault(values).map(|fault| fault.replace("reflectance", key))
        })
    }

    /// A value that is finite and not negative.
    fn exitance(&self, value: &Spanned<Value>, key: &str) -> Result<Quantity, ReadError> {
        self.quantity(value, key, |values| files::exitance_fault(values).map(|fault| fault.replace("emission", key)))
    }

    fn quantity(
        &self,
        value: &Spanned<Value>,
        key: &str,
        fault: impl Fn(&[f64]) -> Option<String>,
    ) -> Result<Quantity, ReadError> {
        let (numbers, picture) = match value.get_ref() {
            Value::Gray(number) => (vec![*number], None),
            Value::Bands(numbers) => (numbers.clone(), None),
            Value::Picture(picture) => (picture.factor.bands(), Some(picture)),
        };
        if numbers.is_empty() {
            return Err(self.error(value, key, "the list is empty", "give one number, or one for each band"));
        }
        if let Some(reason) = fault(&numbers) {
            return Err(self.error(value, key, reason, "correct the value"));
        }
        let texture = picture.map(|picture| self.texture(value, key, picture)).transpose()?;
        Ok(picture::quantity(numbers, texture))
    }

    fn texture<T>(&self, value: &Spanned<T>, key: &str, picture: &Picture) -> Result<Arc<Texture>, ReadError> {
        let folder = self.source.file.parent().unwrap_or(Path::new(""));
        let path = folder.join(&picture.file);
        let coding = if picture.srgb { Coding::Srgb } else { Coding::Linear };
        let texture = std::fs::read(&path)
            .map_err(|error| format!("it cannot be read ({error})"))
            .and_then(|bytes| picture::decode(&bytes, coding, [Wrap::Repeat; 2]));
        let remedy = "name a PNG or JPEG picture beside the scene file";
        texture
            .map(Arc::new)
            .map_err(|fault| self.error(value, key, format!("the picture `{}`: {fault}", path.display()), remedy))
    }
}

impl Factor {
    fn bands(&self) -> Vec<f64> {
        match self {
            Self::Gray(number) => vec![*number],
            Self::Bands(numbers) => numbers.clone(),
        }
    }
}

/// 1 − q.
fn complement(quantity: Quantity) -> Quantity {
    match quantity {
        Quantity::Uniform(values) => Quantity::Uniform(values.into_iter().map(|value| 1.0 - value).collect()),
        Quantity::Textured { factor, texture } => {
            // Interpolation between texels commutes with 1 − q, so a texture of complements is exact.
            let bands = factor.len().max(texture.channels());
            let factors = Quantity::Uniform(factor);
            let rest = |uv, band| 1.0 - factors.uniform(band).unwrap_or_default() * texture.sample(uv, band);
            let complement = picture::bake(&texture, bands, rest);
            Quantity::Textured { factor: vec![1.0], texture: Arc::new(complement) }
        }
        varying @ Quantity::Function(_) => Quantity::function(move |site, band| 1.0 - varying.at(site, band)),
    }
}

/// c q.
fn scaled(quantity: Quantity, c: f64) -> Quantity {
    let scale = |values: Vec<f64>| values.into_iter().map(|value| c * value).collect();
    match quantity {
        Quantity::Uniform(values) => Quantity::Uniform(scale(values)),
        Quantity::Textured { factor, texture } => Quantity::Textured { factor: scale(factor), texture },
        varying @ Quantity::Function(_) => Quantity::function(move |site, band| c * varying.at(site, band)),
    }
}

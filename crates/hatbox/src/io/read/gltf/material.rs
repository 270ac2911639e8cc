//! glTF's metallic-roughness materials as diffuse reflectors and emitters.

use super::{Document, container};
use crate::io::read::picture::{self, CHANNELS, Coding, quantity};
use crate::io::read::{DEFAULT_REFLECTANCE, ReadError, files};
use crate::scene::{Material, Quantity, Texture, Wrap};
use glam::DVec2;
use gltf_json::extensions::texture::TextureTransform;
use gltf_json::material::AlphaMode;
use gltf_json::texture::{Info, WrappingMode};
use gltf_json::validation::Checked;
use gltf_json::{Index, Material as Json};
use std::collections::HashMap;
use std::f64::consts::PI;
use std::sync::Arc;

/// Which texture coordinates a texture is looked up with.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct UvSource {
    /// The n of `TEXCOORD_n`.
    pub(super) set: u32,
    transform: Option<UvTransform>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct UvTransform {
    offset: [f32; 2],
    rotation: f32,
    scale: [f32; 2],
}

impl UvSource {
    fn of(info: &Info) -> Self {
        let extension = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
        let transform = extension.map(|TextureTransform { offset, rotation, scale, .. }| UvTransform {
            offset: offset.0,
            rotation: rotation.0,
            scale: scale.0,
        });
        Self { set: extension.and_then(|e| e.tex_coord).unwrap_or(info.tex_coord), transform }
    }

    /// The coordinates after the texture's transform (`KHR_texture_transform`).
    pub(super) fn apply(&self, uv: DVec2) -> DVec2 {
        let Some(UvTransform { offset, rotation, scale }) = self.transform else { return uv };
        let vector = |[u, v]: [f32; 2]| DVec2::new(f64::from(u), f64::from(v));
        DVec2::from_angle(-f64::from(rotation)).rotate(uv * vector(scale)) + vector(offset)
    }
}

/// The materials that are in use, in the order of their first use.
pub(super) struct Palette<'a> {
    document: &'a Document<'a>,
    indices: HashMap<Option<usize>, u32>,
    materials: Vec<Material>,
    uv_sources: Vec<UvSource>,
    textures: HashMap<(usize, Coding), Arc<Texture>>,
    warnings: Vec<String>,
}

impl<'a> Palette<'a> {
    pub(super) fn new(document: &'a Document<'a>) -> Self {
        Self {
            document,
            indices: HashMap::new(),
            materials: Vec::new(),
            uv_sources: Vec::new(),
            textures: HashMap::new(),
            warnings: Vec::new(),
        }
    }

    /// The materials; `warnings` gets what they cannot say.
    pub(super) fn finish(self, warnings: &mut Vec<String>) -> Vec<Material> {
        warnings.extend(self.warnings);
        self.materials
    }

    /// The texture coordinates that a material wants.
    pub(super) fn uv_source(&self, material: u32) -> UvSource {
        self.uv_sources[material as usize]
    }

    /// The index among the used materials of what a primitive names.
    pub(super) fn material(&mut self, index: Option<Index<Json>>, user: &str) -> Result<u32, ReadError> {
        let key = index.map(|index| index.value());
        if let Some(&known) = self.indices.get(&key) {
            return Ok(known);
        }
        let (material, uv_source) = if let Some(index) = index {
            self.convert(index, user)?
        } else {
            self.warn(user, &format!("it has no material: reflectance {DEFAULT_REFLECTANCE} is assumed"));
            (Material::diffuse("default", DEFAULT_REFLECTANCE), UvSource::default())
        };
        let new = self.materials.len() as u32;
        self.materials.push(material);
        self.uv_sources.push(uv_source);
        self.indices.insert(key, new);
        Ok(new)
    }

    fn warn(&mut self, place: &str, text: &str) {
        self.warnings.push(self.document.warning(place, text));
    }

    fn convert(&mut self, index: Index<Json>, user: &str) -> Result<(Material, UvSource), ReadError> {
        let json = self.document.get(index, user)?;
        let name = json.name.clone().unwrap_or_else(|| format!("material {}", index.value()));
        let place = format!("material `{name}`");
        let pbr = &json.pbr_metallic_roughness;
        let infos = [&pbr.base_color_texture, &json.emissive_texture, &pbr.metallic_roughness_texture];
        let uv_source = infos.into_iter().flatten().next().map(UvSource::of).unwrap_or_default();
        let reflectance = self.reflectance(json, uv_source, &place)?;
        let exitance = self.exitance(json, uv_source, &place)?;
        if matches!(json.alpha_mode, Checked::Valid(AlphaMode::Blend | AlphaMode::Mask)) {
            self.warn(&place, "it is transparent in the file, and taken as opaque");
        }
        let material = Material { name, reflectance, exitance, two_sided: json.double_sided, blocks_only: false };
        Ok((material, uv_source))
    }

    /// R = base colour × texture × (1 − metallic).
    fn reflectance(&mut self, json: &Json, uv: UvSource, place: &str) -> Result<Quantity, ReadError> {
        let pbr = &json.pbr_metallic_roughness;
        let [r, g, b, _] = pbr.base_color_factor.0.map(f64::from);
        let metallic = f64::from(pbr.metallic_factor.0);
        for (key, values) in [("baseColorFactor", &[r, g, b][..]), ("metallicFactor", &[metallic])] {
            if let Some(fault) = files::reflectance_fault(values) {
                let reason = fault.replace("reflectance", key);
                let remedy = format!("set {key} to values from 0 to 1");
                return Err(self.document.error(place, reason, &remedy));
            }
        }
        let base = self.texture(pbr.base_color_texture.as_ref(), Coding::Srgb, place)?;
        let metal = pbr.metallic_roughness_texture.as_ref().filter(|_| metallic > 0.0);
        let metal_uv = metal.map(UvSource::of);
        let metal = self.texture(metal, Coding::Linear, place)?;
        let (dielectric, texture) = match metal {
            None => (1.0 - metallic, base),
            Some(metal) if metal_uv == Some(uv) => {
                (1.0, Some(Arc::new(without_metal(base.as_deref(), &metal, metallic))))
            }
            Some(metal) => {
                self.warn(place, "metallicRoughnessTexture has texture coordinates of its own: its mean is used");
                (1.0 - metallic * mean_metal(&metal), base)
            }
        };
        if dielectric == 0.0 {
            self.warn(place, "it is all metal (metallicFactor is 1): its diffuse reflectance is 0");
        }
        Ok(quantity([r, g, b].map(|value| value * dielectric), texture))
    }

    /// B⁰ = π × emissiveFactor × texture × emissiveStrength.
    fn exitance(&mut self, json: &Json, uv: UvSource, place: &str) -> Result<Quantity, ReadError> {
        let extension = json.extensions.as_ref().and_then(|e| e.emissive_strength.as_ref());
        let strength = extension.map_or(1.0, |e| f64::from(e.emissive_strength.0));
        let [r, g, b] = json.emissive_factor.0.map(f64::from);
        if let Some(fault) = files::exitance_fault(&[r, g, b, strength]) {
            return Err(self.document.error(place, fault, "correct emissiveFactor and emissiveStrength"));
        }
        let factor = [r, g, b].map(|value| PI * strength * value);
        let info = json.emissive_texture.as_ref().filter(|_| factor.iter().any(|&value| value > 0.0));
        if info.is_some_and(|info| UvSource::of(info) != uv) {
            self.warn(place, "emissiveTexture has texture coordinates of its own: those of the base colour are used");
        }
        let texture = self.texture(info, Coding::Srgb, place)?;
        Ok(quantity(factor, texture))
    }

    /// Loads a texture, once.
    fn texture(&mut self, info: Option<&Info>, coding: Coding, place: &str) -> Result<Option<Arc<Texture>>, ReadError> {
        let Some(info) = info else { return Ok(None) };
        let key = (info.index.value(), coding);
        if let Some(texture) = self.textures.get(&key) {
            return Ok(Some(Arc::clone(texture)));
        }
        let document = self.document;
        let place = format!("{place}, texture {}", info.index.value());
        let json = document.get(info.index, &place)?;
        let wrap = match json.sampler {
            Some(sampler) => {
                let sampler = document.get(sampler, &place)?;
                [wrap(sampler.wrap_s), wrap(sampler.wrap_t)]
            }
            None => [Wrap::Repeat; 2],
        };
        let image = document.get(json.source, &place)?;
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => container::resolve(document.file, &place, uri)?,
            (None, Some(view)) => document.view(view, &place)?.0.to_owned(),
            (None, None) => return Err(document.error(&place, "its image has no data", "export the file again")),
        };
        let remedy = "store the picture as PNG or JPEG";
        let texture = picture::decode(&bytes, coding, wrap).map_err(|fault| document.error(&place, fault, remedy))?;
        let texture = Arc::new(texture);
        self.textures.insert(key, Arc::clone(&texture));
        Ok(Some(texture))
    }
}

fn wrap(mode: Checked<WrappingMode>) -> Wrap {
    match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        _ => Wrap::Repeat,
    }
}

/// The channel of a metallic-roughness texture that says how metallic it is.
const METAL: usize = 2;

/// base × (1 − metallic · metal), at the resolution of the base colour; white if there is none.
fn without_metal(base: Option<&Texture>, metal: &Texture, metallic: f64) -> Texture {
    picture::bake(base.unwrap_or(metal), CHANNELS, |uv, band| {
        base.map_or(1.0, |base| base.sample(uv, band)) * (1.0 - metallic * metal.sample(uv, METAL))
    })
}

fn mean_metal(metal: &Texture) -> f64 {
    let sum: f64 = picture::centres(metal).map(|uv| metal.sample(uv, METAL)).sum();
    sum / (metal.width() * metal.height()) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metal_darkens_texel_by_texel() {
        let wrap = [Wrap::Clamp; 2];
        let base = Texture::new(2, 1, 3, vec![0.5, 0.4, 0.2, 1.0, 1.0, 1.0], wrap).expect("fits");
        let metal = Texture::new(2, 1, 3, vec![0.0, 0.0, 0.0, 0.0, 0.0, 1.0], wrap).expect("fits");
        let baked = without_metal(Some(&base), &metal, 0.75);
        let at = |u, band| baked.sample(DVec2::new(u, 0.5), band);
        assert!((at(0.25, 1) - 0.4).abs() < 1e-6 && (at(0.75, 0) - 0.25).abs() < 1e-6);
        assert!((mean_metal(&metal) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn texture_transforms_scale_then_turn_then_shift() {
        let transform = UvTransform { offset: [0.5, 0.0], rotation: std::f32::consts::FRAC_PI_2, scale: [2.0, 1.0] };
        let source = UvSource { set: 0, transform: Some(transform) };
        // The extension's matrix: u' = u cos + v sin, v' = −u sin + v cos.
        assert!((source.apply(DVec2::new(1.0, 3.0)) - DVec2::new(3.5, -2.0)).length() < 1e-6);
    }
}

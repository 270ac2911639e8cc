//! Pictures as textures of linear values.

use crate::scene::{Quantity, Texture, Wrap};
use glam::DVec2;
use std::sync::Arc;

/// What the numbers in a picture mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Coding {
    /// Colours, as screens show them.
    Srgb,
    /// The values themselves.
    Linear,
}

/// A decoded picture: red, green and blue per texel.
pub(super) const CHANNELS: usize = 3;

/// Decodes a PNG or JPEG to linear values between 0 and 1; the error is a reason.
pub(super) fn decode(bytes: &[u8], coding: Coding, wrap: [Wrap; 2]) -> Result<Texture, String> {
    let picture = image::load_from_memory(bytes).map_err(|error| format!("it is no PNG or JPEG picture ({error})"))?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let mut texels = picture.into_rgb32f().into_raw();
    if coding == Coding::Srgb {
        for texel in &mut texels {
            *texel = linear(*texel);
        }
    }
    Texture::new(width, height, CHANNELS, texels, wrap).ok_or_else(|| "the picture has no texels".to_owned())
}

/// A factor times a texture, or the factor alone.
pub(super) fn quantity(factor: impl Into<Vec<f64>>, texture: Option<Arc<Texture>>) -> Quantity {
    let factor = factor.into();
    match texture {
        Some(texture) => Quantity::Textured { factor, texture },
        None => Quantity::Uniform(factor),
    }
}

/// The centres of a texture's texels, row by row.
pub(super) fn centres(texture: &Texture) -> impl Iterator<Item = DVec2> {
    let (width, height) = (texture.width(), texture.height());
    (0..width * height).map(move |k| {
        let (i, j) = (k % width, k / width);
        DVec2::new((i as f64 + 0.5) / width as f64, (j as f64 + 0.5) / height as f64)
    })
}

/// A texture of the same size and wrapping as `grid`, with the values of a function of place and band at its texels.
pub(super) fn bake(grid: &Texture, bands: usize, value: impl Fn(DVec2, usize) -> f64) -> Texture {
    let texel = |uv| (0..bands).map(move |band| (uv, band));
    let texels = centres(grid).flat_map(texel).map(|(uv, band)| value(uv, band) as f32).collect();
    // A grid has texels, so the count fits as long as there are bands.
    Texture::new(grid.width(), grid.height(), bands, texels, grid.wrap()).unwrap_or_else(|| grid.clone())
}

/// The sRGB transfer function (IEC 61966-2-1), decoded.
pub(super) fn linear(coded: f32) -> f32 {
    if coded <= 0.040_45 { coded / 12.92 } else { ((coded + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::linear;

    #[test]
    fn the_transfer_function_is_continuous_and_keeps_black_and_white() {
        assert!(linear(0.0).abs() < f32::EPSILON && (linear(1.0) - 1.0).abs() < 1e-6);
        assert!((linear(0.040_45) - linear(0.040_451)).abs() < 1e-6);
        assert!((linear(0.5) - 0.214_041_14).abs() < 1e-6);
    }
}

//! Pictures of the solution: as the eye would see it, as numbers, or in false colours with a scale.
//!
//! `.png` holds 8-bit sRGB values after the exposure and tone curve of [`crate::bake`], transparent where nothing is
//! seen; `.exr` holds the physical values as float32. In false colours, luminance (or lux, or W/m²) is looked up in
//! viridis, which is even to the eye and to those who confuse red and green.

mod scale_bar;

use crate::bake::{Exposure, luminance, srgb};
use crate::io::atomic::{self, AtomicError};
use crate::render::Image;
use image::{DynamicImage, ImageFormat, RgbImage, Rgba32FImage, RgbaImage};
use scale_bar::Bar;
use std::io;
use std::path::Path;

pub use scale_bar::panel_width;

/// Behind false colours and their scale, in sRGB.
const BACKGROUND: [u8; 3] = [24, 24, 24];

/// Writes an 8-bit sRGB `.png`.
///
/// # Errors
/// [`AtomicError`] if the file cannot be written; there is none then.
pub fn save_png(image: &Image, exposure: Exposure, path: &Path) -> Result<(), AtomicError> {
    let pixel = |pixel: &[f32; 4]| {
        let [r, g, b] = exposure.color(color(pixel)).map(|linear| to_byte(srgb(linear)));
        [r, g, b, to_byte(f64::from(pixel[3]))]
    };
    let bytes = image.pixels.iter().flat_map(pixel).collect();
    write(RgbaImage::from_raw(image.width as u32, image.height as u32, bytes), ImageFormat::Png, path)
}

/// Writes the physical values as a float32 `.exr` (linear, Rec. 709 primaries, colours multiplied with coverage).
///
/// # Errors
/// [`AtomicError`] if the file cannot be written; there is none then.
pub fn save_exr(image: &Image, path: &Path) -> Result<(), AtomicError> {
    let values = image.pixels.iter().copied().flatten().collect();
    write(Rgba32FImage::from_raw(image.width as u32, image.height as u32, values), ImageFormat::OpenExr, path)
}

/// Writes an 8-bit `.png` in false colours: luminance from 0 to about `top`, rounded up to a mark of the scale that is
/// drawn in a panel of [`panel_width`] at the right, headed by `unit`. What is brighter has the colour of the end.
///
/// # Errors
/// [`AtomicError`] if the file cannot be written; there is none then.
pub fn save_false_color(image: &Image, top: f64, unit: &str, path: &Path) -> Result<(), AtomicError> {
    let bar = Bar::new(top, unit, image.height);
    let panel = panel_width(image.height);
    let width = image.width + panel;
    let mut picture = RgbImage::from_pixel(width as u32, image.height as u32, image::Rgb(BACKGROUND));
    for (k, pixel) in image.pixels.iter().enumerate() {
        let (shade, cover) = (bar.color(luminance(color(pixel))), f64::from(pixel[3]));
        let mixed = [0, 1, 2].map(|c| {
            let mixed = cover * f64::from(shade[c]) + (1.0 - cover) * f64::from(BACKGROUND[c]);
            mixed.round() as u8
        });
        picture.put_pixel((k % image.width) as u32, (k / image.width) as u32, image::Rgb(mixed));
    }
    bar.draw(&mut picture, image.width as u32);
    write(Some(picture), ImageFormat::Png, path)
}

/// The greatest luminance in a picture; 0 if nothing is seen.
pub fn brightest(image: &Image) -> f64 {
    image.pixels.iter().map(|pixel| luminance(color(pixel))).fold(0.0, f64::max)
}

/// The colour of the covered part of a pixel.
fn color(&[r, g, b, cover]: &[f32; 4]) -> [f64; 3] {
    let scale = if cover > 0.0 { 1.0 / f64::from(cover) } else { 0.0 };
    [r, g, b].map(|value| f64::from(value) * scale)
}

fn to_byte(value: f64) -> u8 {
    (255.0 * value).round() as u8
}

fn write(picture: Option<impl Into<DynamicImage>>, format: ImageFormat, path: &Path) -> Result<(), AtomicError> {
    atomic::write(path, |file| {
        let picture = picture.ok_or_else(|| io::Error::other("the picture has no pixels"))?;
        picture.into().write_to(file, format).map_err(io::Error::other)
    })
}

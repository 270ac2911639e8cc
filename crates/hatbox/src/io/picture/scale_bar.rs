use font8x8::{BASIC_FONTS, LATIN_FONTS, UnicodeFonts};
use image::{Rgb, RgbImage};

/// Width and height of a character before magnification.
const GLYPH: u32 = 8;
/// Room for the bar, marks, and "123456".
const PANEL: u32 = 10 * GLYPH;
/// Left edge and width of the bar in the panel.
const BAR: (u32, u32) = (6, 10);
/// Length of a mark, and what is left free behind it: no more, and it would pass for a minus.
const MARK: (u32, u32) = (2, 6);
const TEXT: Rgb<u8> = Rgb([230, 230, 230]);

/// How wide the panel of the scale is beside a picture of that height, in pixels.
pub fn panel_width(height: usize) -> usize {
    (PANEL * magnification(height)) as usize
}

fn magnification(height: usize) -> u32 {
    (height as u32 / 360).max(1)
}

/// The colours of values from 0 to a round number, and the picture of them.
pub(super) struct Bar<'a> {
    top: f64,
    step: f64,
    unit: &'a str,
    zoom: u32,
}

impl<'a> Bar<'a> {
    /// A scale whose last mark is not below `top`.
    pub(super) fn new(top: f64, unit: &'a str, height: usize) -> Self {
        let top = if top.is_finite() && top > 0.0 { top } else { 1.0 };
        let step = round_step(top / 5.0);
        Self { top: (top / step - 1e-9).ceil() * step, step, unit, zoom: magnification(height) }
    }

    /// The colour of a value.
    pub(super) fn color(&self, value: f64) -> [u8; 3] {
        let t = if value > 0.0 { (value / self.top).min(1.0) } else { 0.0 };
        colorous::VIRIDIS.eval_continuous(t).as_array()
    }

    /// Draws the scale into the panel that begins at column `left`.
    pub(super) fn draw(&self, picture: &mut RgbImage, left: u32) {
        let zoom = self.zoom;
        let (top, bottom) = (3 * GLYPH * zoom, picture.height().saturating_sub(GLYPH * zoom));
        if bottom <= top {
            return;
        }
        self.text(picture, self.unit, left + BAR.0 * zoom, GLYPH * zoom / 2);
        let edge = left + (BAR.0 + BAR.1) * zoom;
        for y in top..=bottom {
            let value = self.top * f64::from(bottom - y) / f64::from(bottom - top);
            for x in left + BAR.0 * zoom..edge {
                put(picture, x, y, Rgb(self.color(value)));
            }
        }
        let marks = (self.top / self.step).round() as u32;
        for mark in 0..=marks {
            let y = bottom - (f64::from(bottom - top) * f64::from(mark) / f64::from(marks)).round() as u32;
            (edge..edge + MARK.0 * zoom).for_each(|x| put(picture, x, y, TEXT));
            let label = self.label(f64::from(mark) * self.step);
            self.text(picture, &label, edge + (MARK.0 + MARK.1) * zoom, y.saturating_sub(GLYPH * zoom / 2));
        }
    }

    /// A mark's number with the digits that its step needs.
    fn label(&self, value: f64) -> String {
        let digits = (-self.step.log10().floor()).max(0.0) as usize;
        if self.top >= 1e6 || digits > 4 {
            return if value == 0.0 { "0".to_owned() } else { format!("{value:.0e}") };
        }
        format!("{value:.digits$}")
    }

    fn text(&self, picture: &mut RgbImage, text: &str, left: u32, top: u32) {
        let glyphs = text.chars().map(glyph);
        for (k, glyph) in glyphs.enumerate() {
            for (dot, y) in (0..GLYPH * self.zoom).flat_map(|y| (0..GLYPH * self.zoom).map(move |x| (x, y))) {
                if glyph[(y / self.zoom) as usize] >> (dot / self.zoom) & 1 == 1 {
                    put(picture, left + k as u32 * GLYPH * self.zoom + dot, top + y, TEXT);
                }
            }
        }
    }
}

/// What falls outside the picture is not drawn.
fn put(picture: &mut RgbImage, x: u32, y: u32, color: Rgb<u8>) {
    if let Some(pixel) = picture.get_pixel_mut_checked(x, y) {
        *pixel = color;
    }
}

/// The least of 1, 2, 5, 10, … × 10ᵏ that is not below `step`.
fn round_step(step: f64) -> f64 {
    let power = 10_f64.powf(step.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|&s| s >= step * (1.0 - 1e-9)).unwrap_or(step)
}

/// The rows of a character from the top, the lowest bit at the left.
fn glyph(c: char) -> [u8; 8] {
    match c {
        // The font has an acute in its place.
        '²' => [0b0110, 0b1001, 0b0100, 0b0010, 0b1111, 0, 0, 0],
        // The font's stands on a serif, as its 1 does.
        'l' => [0b1100, 0b1100, 0b1100, 0b1100, 0b1100, 0b1100, 0b11_1000, 0],
        c => BASIC_FONTS.get(c).or_else(|| LATIN_FONTS.get(c)).unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_ends_at_a_round_number() {
        for (top, expected, label) in
            [(1.0, 1.0, "1.0"), (870.0, 1000.0, "1000"), (0.031, 0.04, "0.04"), (3e7, 3e7, "3e7"), (0.0, 1.0, "1.0")]
        {
            let bar = Bar::new(top, "lx", 100);
            assert!((bar.top / expected - 1.0).abs() < 1e-9, "{top} gives {}", bar.top);
            assert_eq!(bar.label(bar.top), label);
        }
    }

    #[test]
    fn the_ends_have_the_colours_of_the_map() {
        let bar = Bar::new(10.0, "lx", 100);
        assert_eq!(bar.color(-1.0), bar.color(0.0));
        assert_eq!(bar.color(99.0), bar.color(10.0));
        assert_ne!(bar.color(0.0), bar.color(10.0));
    }
}

use crate::radiosity::{Shown, Solution};

/// What a reflecting surface brighter than nine tenths of the others is shown as, in linear display values.
const BRIGHT: f64 = 0.8;

/// How physical values become colours: a scale, then a tone curve.
///
/// With x = scale · value, the curve is x itself up to 0.8 and 1 − 0.2 exp(−(x − 0.8)/0.2) above: everything reflected
/// is shown in proportion, and lamps and highlights approach white instead of being cut off. The curve and its slope
/// are continuous.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// Linear display value per lm/m² (lx, W/m²).
    pub scale: f64,
}

impl Exposure {
    /// Chosen so that the 90th percentile by area of the luminance of the surfaces that do not themselves emit becomes
    /// 0.8. Where all surfaces emit (heat), all count.
    pub fn automatic(solution: &Solution, shown: Shown) -> Self {
        let bright = percentile(solution, shown, 0.9);
        let scale = BRIGHT / bright;
        // Black scenes, and the last subnormal numbers, have no exposure.
        Self { scale: if bright > 0.0 && scale.is_finite() { scale } else { 1.0 } }
    }

    /// The linear display value, from 0 to 1; what is negative or no number is black.
    pub fn tone(self, value: f64) -> f64 {
        let x = (self.scale * value).max(0.0);
        if x <= BRIGHT { x } else { 1.0 - (1.0 - BRIGHT) * (-(x - BRIGHT) / (1.0 - BRIGHT)).exp() }
    }

    /// [`tone`](Self::tone) of each channel.
    pub fn color(self, rgb: [f64; 3]) -> [f64; 3] {
        rgb.map(|value| self.tone(value))
    }
}

/// Red, green and blue of a value per band: three bands are RGB; any other number, whose wavelengths nobody told, is
/// the gray of its mean.
pub fn rgb(bands: &[f64]) -> [f64; 3] {
    match *bands {
        [r, g, b] => [r, g, b],
        _ => [bands.iter().sum::<f64>() / bands.len().max(1) as f64; 3],
    }
}

/// The luminance of a colour with the primaries of Rec. 709 (sRGB).
pub fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// The sRGB code value, from 0 to 1, of a linear one.
pub fn srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The luminance that the given fraction of the area does not exceed, counting the surfaces that do not themselves emit
/// (all of them, if every one does), each cell with its value in the middle; 0 for an empty scene.
pub fn percentile(solution: &Solution, shown: Shown, fraction: f64) -> f64 {
    let emits = |cell: &usize| !solution.scene.material(*cell).exitance.is_zero();
    let cells = 0..solution.scene.mesh.cells.len();
    let mut samples: Vec<_> = cells.clone().filter(|cell| !emits(cell)).map(|c| sample(solution, shown, c)).collect();
    if samples.is_empty() {
        samples = cells.map(|cell| sample(solution, shown, cell)).collect();
    }
    samples.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = samples.iter().map(|(_, area)| area).sum();
    let mut below = 0.0;
    let reached = samples.iter().find(|(_, area)| {
        below += area;
        below >= fraction * total
    });
    reached.or(samples.last()).map_or(0.0, |&(luminance, _)| luminance)
}

/// Luminance in the middle of a cell, and the cell's area.
fn sample(solution: &Solution, shown: Shown, cell: usize) -> (f64, f64) {
    let patch = solution.scene.mesh.patch(cell);
    let middle = patch.shape().middle();
    let bands: Vec<f64> = (0..solution.bands()).map(|band| solution.evaluate(shown, cell, middle, band)).collect();
    (luminance(rgb(&bands)), patch.area())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tone_curve_is_smooth_and_ends_at_white() {
        let exposure = Exposure { scale: 2.0 };
        assert_eq!([-1.0, 0.0, 0.1, 0.4].map(|x| exposure.tone(x)), [0.0, 0.0, 0.2, 0.8]);
        assert!(exposure.tone(f64::NAN) == 0.0 && (exposure.tone(1e30) - 1.0).abs() < 1e-15);
        let slope = (exposure.tone(0.4 + 1e-6) - exposure.tone(0.4)) / 2e-6;
        assert!((slope - 1.0).abs() < 1e-4, "slope {slope} above the knee");
    }

    #[test]
    fn srgb_has_its_known_values() {
        assert!(srgb(0.0) == 0.0 && (srgb(1.0) - 1.0).abs() < 1e-12);
        assert!((srgb(0.214_041) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn bands_other_than_three_are_gray() {
        assert_eq!(rgb(&[1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        assert_eq!(rgb(&[2.0]), [2.0; 3]);
        assert_eq!(rgb(&[1.0, 2.0, 3.0, 6.0]), [3.0; 3]);
    }
}

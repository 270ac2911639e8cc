use glam::DVec2;

/// What a texture shows outside the unit square.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// The image again and again.
    #[default]
    Repeat,
    /// Again and again, every other one mirrored.
    Mirror,
    /// The colour of the edge.
    Clamp,
}

impl Wrap {
    fn index(self, i: i64, n: usize) -> usize {
        let n = n as i64;
        let wrapped = match self {
            Self::Repeat => i.rem_euclid(n),
            Self::Mirror => {
                let k = i.rem_euclid(2 * n);
                k.min(2 * n - 1 - k)
            }
            Self::Clamp => i.clamp(0, n - 1),
        };
        wrapped as usize
    }
}

/// An image of *linear* values (decode sRGB before), sampled bilinearly between the centres of its texels.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    width: usize,
    height: usize,
    channels: usize,
    texels: Vec<f32>,
    wrap: [Wrap; 2],
}

impl Texture {
    /// Rows from top to bottom, `channels` values per texel; `None` if the count does not fit or is zero.
    pub fn new(width: usize, height: usize, channels: usize, texels: Vec<f32>, wrap: [Wrap; 2]) -> Option<Self> {
        let fits = !texels.is_empty() && texels.len() == width * height * channels;
        fits.then_some(Self { width, height, channels, texels, wrap })
    }

    /// Width in texels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in texels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Values per texel.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The least and the greatest texel of a band; not a number if one of them is not.
    pub fn range(&self, band: usize) -> (f64, f64) {
        let channel = band.min(self.channels - 1);
        let texels = self.texels.iter().skip(channel).step_by(self.channels).map(|&t| f64::from(t));
        texels.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), t| {
            if t.is_nan() { (t, t) } else { (if t < lo { t } else { lo }, if t > hi { t } else { hi }) }
        })
    }

    /// The values, rows from top to bottom.
    pub fn texels(&self) -> &[f32] {
        &self.texels
    }

    /// What is shown outside the image, along u and v.
    pub fn wrap(&self) -> [Wrap; 2] {
        self.wrap
    }

    /// The value at (u, v), u to the right and v down, the image being the unit square.
    pub fn sample(&self, uv: DVec2, band: usize) -> f64 {
        let (x, y) = (uv.x * self.width as f64 - 0.5, uv.y * self.height as f64 - 0.5);
        if !(x.is_finite() && y.is_finite()) {
            return 0.0;
        }
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let (x0, y0) = (x0 as i64, y0 as i64);
        let texel = |i, j| self.texel(i, j, band);
        let top = texel(x0, y0) * (1.0 - fx) + texel(x0 + 1, y0) * fx;
        let bottom = texel(x0, y0 + 1) * (1.0 - fx) + texel(x0 + 1, y0 + 1) * fx;
        top * (1.0 - fy) + bottom * fy
    }

    fn texel(&self, i: i64, j: i64, band: usize) -> f64 {
        let (i, j) = (self.wrap[0].index(i, self.width), self.wrap[1].index(j, self.height));
        f64::from(self.texels[(j * self.width + i) * self.channels + band.min(self.channels - 1)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_met_at_their_centres_and_blended_between() {
        let texture = Texture::new(2, 1, 1, vec![0.0, 1.0], [Wrap::Clamp, Wrap::Clamp]).expect("fits");
        for (u, expected) in [(0.25, 0.0), (0.75, 1.0), (0.5, 0.5), (0.0, 0.0), (7.0, 1.0)] {
            assert!((texture.sample(DVec2::new(u, 0.5), 0) - expected).abs() < 1e-12, "u = {u}");
        }
    }

    #[test]
    fn the_range_of_a_band_spans_its_texels_and_shows_what_is_no_number() {
        let texture = |texels| Texture::new(2, 1, 2, texels, [Wrap::Clamp; 2]).expect("fits");
        let fine = texture(vec![0.5, 7.0, 0.25, 3.0]);
        assert_eq!([fine.range(0), fine.range(1), fine.range(2)], [(0.25, 0.5), (3.0, 7.0), (3.0, 7.0)]);
        assert!(texture(vec![f32::NAN, 7.0, 0.25, 3.0]).range(0).0.is_nan());
    }

    #[test]
    fn wrapping_repeats_mirrors_or_clamps() {
        assert_eq!([-1, 0, 2, 3].map(|i| Wrap::Repeat.index(i, 3)), [2, 0, 2, 0]);
        assert_eq!([-1, 0, 3, 5].map(|i| Wrap::Mirror.index(i, 3)), [0, 0, 2, 0]);
        assert_eq!([-4, 1, 9].map(|i| Wrap::Clamp.index(i, 3)), [0, 1, 2]);
    }
}

//! By how much of the light *there* the residual is off, point by point.
//!
//! The norm of all light squares it: where a lamp stands in a bright housing, a solution may be within a percent of that norm, and far
//! off in the room that it lights. So the points of the estimate are asked by how much of their own light they disagree with what
//! the solution sends them. (What errors elsewhere cause is not in it: who agrees with a wrong source has no residual.)
//!
//! Where rays tell what arrives, each point has two independent residuals. Half of their sum has the noise that half of their
//! difference is a sample of. Squares of the two quantiles are subtracted, as if both were normal: where there is nothing but noise,
//! nothing is left. The root of the product of both residuals, which has no noise in its mean square, was tried, and has a
//! quantile of noise all the same.

use super::residual::Sample;

/// Of the area that reflects.
const SHARES: [f64; 2] = [0.5, 0.9];
/// Light counts as this part of its mean at the least: in the dark every error is more than all light.
const LEAST_LIGHT: f64 = 0.01;

/// The relative residuals that half and nine tenths of the area that reflects do not exceed, from points that stand for their areas.
/// All bands of a point are taken together.
pub(super) fn quantiles<'a>(samples: impl Iterator<Item = &'a Sample>) -> [f64; 2] {
    let lit: Vec<(&Sample, f64)> = samples.filter_map(|sample| Some((sample, sample.light?))).collect();
    let area: f64 = lit.iter().map(|(sample, _)| sample.area).sum();
    let mean = lit.iter().map(|(sample, light)| sample.area * light).sum::<f64>() / area;
    if mean == 0.0 || lit.is_empty() {
        return [0.0; 2];
    }
    let relative = |(sample, light): &(&Sample, f64), of: fn(f64, f64) -> f64| {
        let sum: f64 = sample.bands.iter().map(|&[first, second, ..]| 0.5 * of(first, second).abs()).sum();
        [sum / light.max(LEAST_LIGHT * mean), sample.area]
    };
    let [found, noise] = [|a: f64, b: f64| a + b, |a: f64, b: f64| a - b]
        .map(|of| shares(lit.iter().map(|point| relative(point, of)).collect(), area));
    [0, 1].map(|share| {
        let square = found[share].powi(2) - noise[share].powi(2);
        // No number stays none, as it would not with `max`.
        if square < 0.0 { 0.0 } else { square.sqrt() }
    })
}

/// What the [`SHARES`] of the area do not exceed, from values and areas; no number, if one of them is none.
fn shares(mut known: Vec<[f64; 2]>, area: f64) -> [f64; 2] {
    if known.iter().any(|[value, _]| value.is_nan()) {
        return [f64::NAN; 2];
    }
    known.sort_by(|a, b| a[0].total_cmp(&b[0]));
    SHARES.map(|share| {
        let mut sum = 0.0;
        let reached = known.iter().find(|[_, area_of]| {
            sum += area_of;
            sum >= share * area
        });
        reached.or(known.last()).map_or(0.0, |[value, _]| *value)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quadrature::sequence::point;

    /// One of ten points stands for half of the area.
    #[test]
    fn points_count_by_their_area_and_light_by_a_hundredth_at_least() {
        let sample = |area: f64, light: Option<f64>, r: f64| Sample {
            cell: 0,
            area,
            light,
            bands: vec![[r, r, 0.0, 0.0], [-r, -r, 0.0, 0.0]],
        };
        let mut samples = vec![sample(90.0, Some(2.0), 0.01)];
        samples.extend((1..=9).map(|k| sample(10.0, Some(2.0), 0.1 * f64::from(k))));
        let found = |samples: &[Sample], expected: [f64; 2]| {
            let off =
                quantiles(samples.iter()).into_iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-12, "{expected:?} {off}");
        };
        found(&samples, [0.01, 0.8]);
        // The mean is 1 if it is dark in the first.
        samples[0].light = Some(0.0);
        found(&samples, [0.9, 2.0]);
        samples[0].light = Some(2.0);
        // Black faces have no light to err by, and are no part of the mean.
        samples.push(sample(1e9, None, 0.5));
        found(&samples, [0.01, 0.8]);
        samples[0].light = Some(0.0);
        found(&samples, [0.9, 2.0]);
        found(&[], [0.0; 2]);
        found(&[sample(1.0, Some(0.0), 0.0)], [0.0; 2]);
        samples[3].light = Some(f64::NAN);
        assert!(quantiles(samples.iter()).iter().all(|error| error.is_nan()), "it would pass for nothing");
    }

    #[test]
    fn noise_is_no_error_of_a_point() {
        let sample = |k: u32, off: f64| {
            let [u, v, ..] = point(1, k);
            let noise = [u - 0.5, v - 0.5].map(|x| 0.2 * x + off);
            Sample { cell: 0, area: 1.0, light: Some(1.0), bands: vec![[noise[0], noise[1], 0.0, 0.0]] }
        };
        let of = |off: f64| quantiles((0..4096).map(|k| sample(k, off)).collect::<Vec<_>>().iter());
        assert!(of(0.0)[1] < 0.01, "{:?}", of(0.0));
        let [half, most] = of(0.3);
        assert!((half - 0.3).abs() < 0.01 && (most - 0.35).abs() < 0.02, "{half} {most}");
    }
}

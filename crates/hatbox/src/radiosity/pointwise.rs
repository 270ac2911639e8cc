//! What single points err by, relative to the light there.
//!
//! The norm of all light squares it: where a lamp stands in a bright housing, a solution may be within a percent of that and half as
//! bright as it should be everywhere else. So the points of the estimate are asked as well what each of them would call its error.

use super::residual::Sample;

/// Of the area that reflects.
const SHARES: [f64; 2] = [0.5, 0.9];
/// Light counts as this part of the mean at the least: in the dark every error is more than all light.
const LEAST_LIGHT: f64 = 0.01;

/// The relative residuals that half and nine tenths of the area do not exceed, from points that stand for their areas. All bands of
/// a point are taken together.
pub(super) fn quantiles<'a>(samples: impl Iterator<Item = &'a Sample> + Clone) -> [f64; 2] {
    let area: f64 = samples.clone().map(|sample| sample.area).sum();
    let mean = samples.clone().map(|sample| sample.area * sample.light.unwrap_or(0.0)).sum::<f64>() / area;
    let residual = |sample: &Sample| -> f64 {
        // Independent residuals, of which the product has no noise on the average.
        sample.bands.iter().map(|[first, second, ..]| (first * second).max(0.0).sqrt()).sum()
    };
    let mut known: Vec<[f64; 2]> = samples
        .filter_map(|sample| Some([residual(sample) / sample.light?.max(LEAST_LIGHT * mean), sample.area]))
        .filter(|[error, _]| error.is_finite())
        .collect();
    known.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let total: f64 = known.iter().map(|[_, area]| area).sum();
    SHARES.map(|share| {
        let mut sum = 0.0;
        let reached = known.iter().find(|[_, area]| {
            sum += area;
            sum >= share * total
        });
        reached.map_or(0.0, |[error, _]| *error)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

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
        // Black faces have no light to err by.
        samples.push(sample(1e9, None, 0.5));
        found(&samples, [0.01, 0.8]);
        found(&[], [0.0; 2]);
    }
}

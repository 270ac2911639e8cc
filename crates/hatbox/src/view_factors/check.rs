//! What the rows of F say about its accuracy.

use super::matrix::Areas;
use super::{Surface, ViewFactors};
use crate::exchange::{Dense, RowFacts};
use rayon::prelude::*;

/// What one row says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowCheck {
    /// Σ_j F_ij.
    pub sum: f64,
    /// Σ_j F_ij − (1 − measured escape): the closure defect. In an open scene it contains the noise of the measurement.
    pub closure_error: f64,
    /// The greatest `|A_i F_ij − A_j F_ji|` of the row, relative to the greater of both.
    pub reciprocity_error: f64,
    /// Number of factors that are not zero.
    pub nonzeros: usize,
}

impl RowCheck {
    /// 1 − Σ_j F_ij: what goes to the environment; in a closed scene the closure defect.
    pub fn environment(&self) -> f64 {
        1.0 - self.sum
    }
}

/// How numbers are distributed; a number that is not one shows in all three.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distribution {
    /// The smallest.
    pub min: f64,
    /// The one in the middle.
    pub median: f64,
    /// The greatest.
    pub max: f64,
}

impl Distribution {
    /// That of these numbers; not a number if there are none, or one of them is not.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = values.into_iter().collect();
        values.sort_unstable_by(f64::total_cmp);
        match &values[..] {
            [min, .., max] if !min.is_nan() && !max.is_nan() => {
                let n = values.len();
                let median = f64::midpoint(values[(n - 1) / 2], values[n / 2]);
                Self { min: *min, median, max: *max }
            }
            [only] => Self { min: *only, median: *only, max: *only },
            _ => Self { min: f64::NAN, median: f64::NAN, max: f64::NAN },
        }
    }
}

/// What all rows say.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    /// The smallest sum of a row.
    pub least_row_sum: f64,
    /// The greatest sum of a row.
    pub greatest_row_sum: f64,
    /// In a closed scene the greatest `|1 − Σ_j F_ij|`, but for what is covered and sees nothing; in an open one, where sums
    /// below one are right, the greatest excess over one.
    pub max_row_sum_error: f64,
    /// The greatest `|A_i F_ij − A_j F_ji|`, relative to the greater of both.
    pub max_reciprocity_error: f64,
    /// Number of factors that are not zero.
    pub nonzeros: usize,
    /// Row by row.
    pub rows: Vec<RowCheck>,
}

/// The greatest of some numbers that are not negative; not a number if one of them is not.
pub(super) fn greatest(values: impl IntoIterator<Item = f64>) -> f64 {
    // `f64::max` passes over what is not a number.
    values.into_iter().fold(0.0, |a, b| if a.is_nan() || a > b { a } else { b })
}

impl ViewFactors {
    /// Looks at all factors. What is not a number shows in every result that it belongs to.
    pub fn check(&self) -> Check {
        let rows = match &self.matrix.areas {
            // A closure has made the sums of rows at most one, to the last bit, in the order of the columns.
            Areas::Elements(dense) if self.matrix.correction.is_none() => self.check_integrated(dense),
            _ => (0..self.len()).into_par_iter().map(|i| self.check_row(i)).collect(),
        };
        let closed = self.is_closed();
        let sums = Distribution::of(rows.iter().map(|row| row.sum));
        // In a closed scene all that escapes does so under what covers it. Comparisons with what is not a number are false.
        let error = |row: &RowCheck| match if closed { row.closure_error } else { row.sum - 1.0 } {
            shortfall if shortfall < 0.0 => {
                if closed {
                    -shortfall
                } else {
                    0.0
                }
            }
            excess => excess,
        };
        Check {
            least_row_sum: sums.min,
            greatest_row_sum: sums.max,
            max_row_sum_error: greatest(rows.iter().map(error)),
            max_reciprocity_error: greatest(rows.iter().map(|row| row.reciprocity_error)),
            nonzeros: rows.iter().map(|row| row.nonzeros).sum(),
            rows,
        }
    }

    /// All rows of a matrix that is as it was integrated.
    fn check_integrated(&self, dense: &Dense) -> Vec<RowCheck> {
        let areas: Vec<f64> = self.surfaces.iter().map(|surface| surface.area).collect();
        let check = |(facts, surface): (RowFacts, &Surface)| {
            let RowFacts { sum, nonzeros, reciprocity_error } = facts;
            let sum = sum / surface.area;
            RowCheck { sum, closure_error: sum - (1.0 - surface.escape), reciprocity_error, nonzeros }
        };
        dense.row_facts(&areas).into_iter().zip(&self.surfaces).map(check).collect()
    }

    fn check_row(&self, i: usize) -> RowCheck {
        let (mut sum, mut nonzeros) = (0.0, 0);
        let errors = self.nonzeros(i).map(|(j, factor)| {
            sum += factor;
            nonzeros += 1;
            let (there, back) = (self.surfaces[i].area * factor, self.surfaces[j].area * self.get(j, i));
            (there - back).abs() / there.abs().max(back.abs())
        });
        let reciprocity_error = greatest(errors);
        RowCheck { sum, closure_error: sum - (1.0 - self.surfaces[i].escape), reciprocity_error, nonzeros }
    }
}

#[cfg(test)]
mod tests {
    use super::super::matrix::{Areas, Matrix};
    use super::super::{Surface, ViewFactors};
    use super::{Distribution, greatest};

    fn factors(areas: Vec<f64>) -> ViewFactors {
        let surface =
            |name: &str| Surface { name: name.to_owned(), area: 1.0, emittance: 1.0, escape: 0.0, escape_error: 0.0 };
        ViewFactors {
            surfaces: ["a", "b"].map(surface).into(),
            elements: 2,
            escape: 0.0,
            statistics: crate::exchange::Statistics::default(),
            tolerance: 1e-2,
            reversed_error: 0.0,
            meshing: std::time::Duration::ZERO,
            closure: None,
            threshold: None,
            matrix: Matrix::new(Areas::Table(areas), 2),
        }
    }

    #[test]
    fn what_is_not_a_number_is_not_passed_over() {
        for areas in [[0.0, f64::NAN, 0.5, 0.5], [0.5, 0.5, f64::NAN, 0.5]] {
            let check = factors(areas.into()).check();
            let shown =
                [check.least_row_sum, check.greatest_row_sum, check.max_row_sum_error, check.max_reciprocity_error];
            assert!(shown.iter().all(|value| value.is_nan()), "{shown:?}");
        }
        assert!(greatest([f64::NAN, 1.0]).is_nan() && greatest([1.0, f64::NAN, 2.0]).is_nan());
        assert!(Distribution::of([1.0, f64::NAN, 2.0]).median.is_nan());
    }

    #[test]
    fn a_matrix_that_is_not_reciprocal_is_found_out() {
        let check = factors(vec![0.0, 1.0, 0.5, 0.5]).check();
        assert!((check.max_reciprocity_error - 0.5).abs() < 1e-15 && check.max_row_sum_error == 0.0);
        let check = factors(vec![0.0, 0.75, 0.75, 0.5]).check();
        assert_eq!((check.least_row_sum, check.greatest_row_sum, check.max_row_sum_error), (0.75, 1.25, 0.25));
        assert_eq!((check.max_reciprocity_error, check.nonzeros), (0.0, 3));
    }

    #[test]
    fn the_median_is_in_the_middle() {
        assert_eq!(Distribution::of([3.0, 1.0, 2.0]), Distribution { min: 1.0, median: 2.0, max: 3.0 });
        assert_eq!(Distribution::of([4.0, 1.0]), Distribution { min: 1.0, median: 2.5, max: 4.0 });
        assert_eq!(Distribution::of([7.0]), Distribution { min: 7.0, median: 7.0, max: 7.0 });
    }
}

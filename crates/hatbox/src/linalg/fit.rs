use super::MultiVector;
use rayon::prelude::*;

/// Rows of a piece of work.
const ROWS: usize = 1 << 14;
/// What is left of a column beside the columns before it, squared and relative, up to which it counts as their combination:
/// what is a thousandth of it or less would magnify the errors of columns that are rounded to single precision.
const DEPENDENT: f64 = 1e-6;

/// For each band the coefficients y of least ‖t − Σ y_j a_j‖, where t is the band of `target` and a_j that of `columns[j]`.
///
/// From the normal equations by a Cholesky factorisation with pivots (Higham 2002, §10.3), which leaves out what depends on
/// other columns: t is met to a few digits, or as many as the columns have. Sums run in a fixed order.
pub(crate) fn fit(columns: &[MultiVector], target: &MultiVector) -> Vec<Vec<f64>> {
    let of_band = |band: usize| {
        let vectors: Vec<&[f64]> = columns.iter().map(|column| column.band(band)).collect();
        solve(gram(&vectors, target.band(band)))
    };
    (0..target.bands()).map(of_band).collect()
}

/// The products of the columns with each other and, in the last place of each row, with the target.
fn gram(columns: &[&[f64]], target: &[f64]) -> Vec<Vec<f64>> {
    let n = columns.len();
    let of_part = |part: usize| {
        let rows = part * ROWS..((part + 1) * ROWS).min(target.len());
        let mut products = vec![vec![0.0; n + 1]; n];
        for (j, row) in products.iter_mut().enumerate() {
            let a = &columns[j][rows.clone()];
            for (product, b) in row.iter_mut().zip(columns.iter().chain([&target])) {
                *product = super::dot(a, &b[rows.clone()]);
            }
        }
        products
    };
    let parts: Vec<Vec<Vec<f64>>> = (0..target.len().div_ceil(ROWS)).into_par_iter().map(of_part).collect();
    let mut sum = vec![vec![0.0; n + 1]; n];
    for part in parts {
        for (row, part) in sum.iter_mut().flatten().zip(part.into_iter().flatten()) {
            *row += part;
        }
    }
    sum
}

/// Solves the normal equations, whose right side is the last column.
fn solve(mut a: Vec<Vec<f64>>) -> Vec<f64> {
    let n = a.len();
    let scales: Vec<f64> = (0..n).map(|j| a[j][j]).collect();
    let mut order: Vec<usize> = Vec::new();
    // Each step eliminates the column of which most is left, relative to what it was.
    loop {
        let left = |j: usize| if scales[j] > 0.0 { a[j][j] / scales[j] } else { 0.0 };
        let open = (0..n).filter(|j| !order.contains(j));
        let Some(pivot) = open.max_by(|&j, &k| left(j).total_cmp(&left(k)).then(k.cmp(&j))) else { break };
        if left(pivot) <= DEPENDENT || !left(pivot).is_finite() {
            break;
        }
        order.push(pivot);
        let pivot_row = a[pivot].clone();
        for row in (0..n).filter(|row| !order.contains(row)) {
            let factor = pivot_row[row] / pivot_row[pivot];
            a[row].iter_mut().zip(&pivot_row).for_each(|(entry, pivot)| *entry -= factor * pivot);
        }
    }
    let mut y = vec![0.0; n];
    for &j in order.iter().rev() {
        let known: f64 = (0..n).filter(|&k| k != j).map(|k| a[j][k] * y[k]).sum();
        y[j] = (a[j][n] - known) / a[j][j];
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(number: usize) -> Vec<f64> {
        (0..50_000).map(|row| (0.1 * (number + 1) as f64 * f64::from(row)).sin()).collect()
    }

    fn one(numbers: Vec<f64>) -> MultiVector {
        MultiVector::from_bands(1, numbers).expect("one band")
    }

    #[test]
    fn a_combination_is_found_and_what_depends_on_others_does_no_harm() {
        let sum =
            |a: f64, b: f64| -> Vec<f64> { column(0).into_iter().zip(column(1)).map(|(x, y)| a * x + b * y).collect() };
        let columns = [one(column(0)), one(sum(1.0, 1e-3)), one(column(1)), one(vec![0.0; 50_000])];
        let target = one(sum(2.0, -3.0));
        let [y] = &fit(&columns, &target)[..] else { panic!("one band") };
        let mut rest = target.clone();
        columns.iter().zip(y).for_each(|(column, &y)| rest.add_scaled(-y, column));
        assert!(rest.norms()[0] < 1e-6 * target.norms()[0], "{} of {}", rest.norms()[0], target.norms()[0]);
    }

    #[test]
    fn what_is_left_is_orthogonal_to_every_column() {
        let columns = [one(column(0)), one(column(1))];
        let target = one((0..50_000).map(|row| f64::from(row % 7)).collect());
        let y = fit(&columns, &target);
        let mut rest = target.clone();
        columns.iter().zip(&y[0]).for_each(|(column, &y)| rest.add_scaled(-y, column));
        for column in &columns {
            assert!(rest.dot(column)[0].abs() < 1e-9 * target.norms()[0] * column.norms()[0]);
        }
    }

    #[test]
    fn no_columns_have_no_coefficients() {
        assert_eq!(fit(&[], &one(vec![1.0, 2.0])), vec![Vec::<f64>::new()]);
    }
}

//! Least squares of a few long columns.

use super::Number;
use rayon::prelude::*;
use std::sync::Arc;

/// Rows of a piece of work: some columns of them fit into a cache.
const ROWS: usize = 1 << 12;
/// What is left of a column beside the columns before it, squared and relative, up to which it counts as their combination:
/// what is a thousandth of it or less would magnify the errors of columns that are rounded to single precision.
const DEPENDENT: f64 = 1e-6;

/// Columns a_j, more and more of them, whose combinations are fitted to a target t.
#[derive(Debug, Clone)]
pub(crate) struct Columns<T> {
    /// What each row counts in sums.
    weights: Arc<[f64]>,
    all: Vec<Vec<T>>,
    /// Products of each column with those up to itself.
    products: Vec<Vec<f64>>,
    /// The weighted sum of each.
    sums: Vec<f64>,
}

impl<T: Number> Columns<T> {
    /// None yet; in sums each row counts so much.
    pub(crate) fn summed(weights: &Arc<[f64]>) -> Self {
        Self { weights: Arc::clone(weights), all: Vec::new(), products: Vec::new(), sums: Vec::new() }
    }

    /// Adds columns, all of one length, each with its weighted sum: of what is rounded that of the numbers that it was.
    pub(crate) fn extend(&mut self, new: impl IntoIterator<Item = (Vec<T>, f64)>) {
        let before = self.all.len();
        let (columns, sums): (Vec<_>, Vec<_>) = new.into_iter().unzip();
        self.all.extend(columns);
        self.sums.extend(sums);
        let all: Vec<&[T]> = self.all.iter().map(Vec::as_slice).collect();
        let products = products(&all[before..], &all);
        self.products.extend(products.into_iter().enumerate().map(|(k, mut row)| {
            row.truncate(before + k + 1);
            row
        }));
    }

    /// The coefficients y of least ‖t − Σ y_j a_j‖.
    ///
    /// From the normal equations by a Cholesky factorisation with pivots (Higham 2002, §10.3), which leaves out what depends
    /// on other columns: t is met to a few digits, or as many as the columns have. Sums run in a fixed order.
    pub(crate) fn fit(&self, target: &[f64]) -> Vec<f64> {
        self.solved(&self.times(target))
    }

    /// Changes these coefficients so that the weighted sum of t − Σ y_j a_j is zero and its norm grows least by it, if its norm does not exceed `most`:
    /// with s the sums and G the normal matrix, y + λ G⁻¹ s.
    pub(crate) fn balance(&self, target: &[f64], y: &mut [f64], most: f64) {
        let towards = self.solved(&self.sums);
        let least = super::dot(target, target) - super::dot(y, &self.times(target));
        let lacking = super::dot(target, &self.weights) - super::dot(y, &self.sums);
        let reach = super::dot(&towards, &self.sums);
        if reach > 0.0 && least + lacking * lacking / reach <= most * most {
            y.iter_mut().zip(towards).for_each(|(y, towards)| *y += lacking / reach * towards);
        }
    }

    /// The products of each column with a target.
    fn times(&self, target: &[f64]) -> Vec<f64> {
        let all: Vec<&[T]> = self.all.iter().map(Vec::as_slice).collect();
        products(&all, &[target]).concat()
    }

    /// Solves the normal equations.
    fn solved(&self, right: &[f64]) -> Vec<f64> {
        let row = |(j, right): (usize, &f64)| {
            let product = |k: usize| self.products[j.max(k)][j.min(k)];
            (0..self.all.len()).map(product).chain([*right]).collect()
        };
        solve(right.iter().enumerate().map(row).collect())
    }

    /// The norm of each column.
    pub(crate) fn norms(&self) -> impl Iterator<Item = f64> {
        self.products.iter().enumerate().map(|(j, row)| row[j].sqrt())
    }

    /// t − Σ y_j a_j, in the place of t.
    pub(crate) fn subtract(&self, y: &[f64], target: &mut [f64]) {
        target.par_chunks_mut(ROWS).enumerate().for_each(|(part, rest)| {
            for (column, y) in self.all.iter().zip(y).filter(|(_, y)| **y != 0.0) {
                rest.iter_mut().zip(&column[part * ROWS..]).for_each(|(rest, &a)| *rest -= y * a.into());
            }
        });
    }

    /// No longer uses the first columns.
    pub(crate) fn ignore_first(&mut self, count: usize) {
        self.products.iter_mut().for_each(|row| row.iter_mut().take(count).for_each(|product| *product = 0.0));
    }
}

/// The products of each column on the left with each on the right.
fn products<A: Number, B: Number>(left: &[&[A]], right: &[&[B]]) -> Vec<Vec<f64>> {
    let length = left.first().map_or(0, |column| column.len());
    let of_part = |part: usize| -> Vec<f64> {
        let rows = part * ROWS..((part + 1) * ROWS).min(length);
        let with = |a: &[A]| right.iter().map(|b| super::dot(a, &b[rows.clone()])).collect::<Vec<f64>>();
        left.iter().flat_map(|a| with(&a[rows.clone()])).collect()
    };
    let parts: Vec<Vec<f64>> = (0..length.div_ceil(ROWS)).into_par_iter().map(of_part).collect();
    let mut sum = vec![0.0; left.len() * right.len()];
    for part in parts {
        sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
    }
    sum.chunks(right.len().max(1)).map(<[f64]>::to_vec).collect()
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

    fn sum(a: f64, b: f64) -> Vec<f64> {
        column(0).into_iter().zip(column(1)).map(|(x, y)| a * x + b * y).collect()
    }

    /// Columns that all count alike.
    fn alike<T: Number>(all: impl IntoIterator<Item = Vec<T>>) -> Columns<T> {
        let mut columns = Columns::summed(&vec![1.0; 50_000].into());
        add(&mut columns, all);
        columns
    }

    fn add<T: Number>(columns: &mut Columns<T>, all: impl IntoIterator<Item = Vec<T>>) {
        let weights = Arc::clone(&columns.weights);
        let with_sum = |column: Vec<T>| {
            let sum = crate::linalg::dot(&column, &weights);
            (column, sum)
        };
        columns.extend(all.into_iter().map(with_sum));
    }

    fn norm(x: &[f64]) -> f64 {
        crate::linalg::dot(x, x).sqrt()
    }

    /// What the best combination leaves.
    fn rest<T: Number>(columns: &Columns<T>, target: &[f64]) -> Vec<f64> {
        let mut rest = target.to_vec();
        columns.subtract(&columns.fit(target), &mut rest);
        rest
    }

    #[test]
    fn a_combination_is_found_and_what_depends_on_others_does_no_harm() {
        let target = sum(2.0, -3.0);
        let mut columns = alike([column(0), sum(1.0, 1e-3)]);
        add(&mut columns, [column(1), vec![0.0; 50_000]]);
        assert!(norm(&rest(&columns, &target)) < 1e-6 * norm(&target));
        let single = |column: Vec<f64>| column.into_iter().map(|x| x as f32).collect::<Vec<f32>>();
        let columns = alike([column(0), sum(1.0, 1e-3), column(1), vec![0.0; 50_000]].map(single));
        assert!(norm(&rest(&columns, &target)) < 1e-6 * norm(&target));
    }

    #[test]
    fn what_is_left_sums_to_nothing_if_it_may_be_that_much() {
        let weights: Arc<[f64]> = (0..50_000).map(|row| 1.0 + f64::from(row % 3)).collect();
        let mut columns = Columns::summed(&weights);
        let lifted = |number: usize| column(number).into_iter().map(|x| 1.0 + x).collect::<Vec<f64>>();
        add(&mut columns, [lifted(0), lifted(1), lifted(2)]);
        let target: Vec<f64> = lifted(1).iter().enumerate().map(|(row, x)| x + 0.01 * (row % 2) as f64).collect();
        let left = |y: &[f64]| {
            let mut rest = target.clone();
            columns.subtract(y, &mut rest);
            (rest.iter().zip(&*weights).map(|(rest, weight)| rest * weight).sum::<f64>(), norm(&rest))
        };
        let (least, mut balanced) = (columns.fit(&target), columns.fit(&target));
        let (sum, norm) = left(&least);
        columns.balance(&target, &mut balanced, 1.0001 * norm);
        assert_eq!(balanced, least, "it would be more than that");
        columns.balance(&target, &mut balanced, 1.1 * norm);
        let (none, more) = left(&balanced);
        assert!(sum.abs() > 10.0 && none.abs() < 1e-6 && more < 1.1 * norm, "{sum} {none}, {norm} {more}");
    }

    #[test]
    fn a_dark_band_stays_dark() {
        let mut columns = Columns::summed(&vec![1.0; 9].into());
        add(&mut columns, [vec![0.0; 9], vec![0.0; 9]]);
        let mut y = columns.fit(&[0.0; 9]);
        columns.balance(&[0.0; 9], &mut y, 0.0);
        assert_eq!(y, [0.0; 2]);
    }

    #[test]
    fn what_is_left_is_orthogonal_to_every_column() {
        let columns = alike([column(0), column(1)]);
        let target: Vec<f64> = (0..50_000).map(|row| f64::from(row % 7)).collect();
        let rest = rest(&columns, &target);
        for (column, length) in [column(0), column(1)].iter().zip(columns.norms()) {
            assert!((norm(column) - length).abs() < 1e-9 * length);
            assert!(crate::linalg::dot(&rest, column).abs() < 1e-9 * norm(&target) * length);
        }
    }

    #[test]
    fn what_is_ignored_has_no_part_in_it() {
        let mut columns = alike([column(0), column(1)]);
        columns.ignore_first(1);
        let y = columns.fit(&sum(2.0, -3.0));
        assert!(y[0] == 0.0 && (y[1] + 3.0).abs() < 0.1, "{y:?}");
    }

    #[test]
    fn no_columns_have_no_coefficients() {
        assert_eq!(Columns::<f64>::summed(&vec![1.0; 50_000].into()).fit(&[1.0, 2.0]), Vec::<f64>::new());
    }
}

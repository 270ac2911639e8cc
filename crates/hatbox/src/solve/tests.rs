//! One suite over all solvers, on systems with the traits of light: symmetric non-negative exchange, rows that sum to
//! less than one, a reflectance per band.

use super::*;
use crate::linalg::{Columns, Csr, Identity};
use crate::progress::Silent;

const ROWS: usize = 40;
const REFLECTANCES: [f64; 3] = [0.3, 0.0, 0.9];

/// A symmetric exchange between surfaces in a ring: K = Kᵀ ≥ 0, rows sum to one.
fn exchange(i: usize, j: usize) -> f64 {
    let gap = i.abs_diff(j).min(ROWS - i.abs_diff(j)) as f64;
    let weight = |gap: f64| if gap == 0.0 { 0.0 } else { 1.0 / (1.0 + gap * gap) };
    let total: f64 = (1..ROWS).map(|k| weight(k.min(ROWS - k) as f64)).sum();
    weight(gap) / total
}

fn area(i: usize) -> f64 {
    1.0 + 0.5 * (i % 3) as f64
}

/// F (or M − F) with M = diag(area), F = ρ √M K √M: symmetric, ‖√M⁻¹ F √M⁻¹‖ = ρ.
struct Light {
    with_mass: bool,
}

impl LinearOperator for Light {
    fn rows(&self) -> usize {
        ROWS
    }
    fn cols(&self) -> usize {
        ROWS
    }
    fn apply(&self, x: &MultiVector, y: &mut MultiVector) {
        for band in 0..x.bands() {
            for i in 0..ROWS {
                let gathered: f64 = (0..ROWS).map(|j| self.entry(band, i, j) * x.band(band)[j]).sum();
                y.band_mut(band)[i] = gathered;
            }
        }
    }
}

impl Light {
    fn entry(&self, band: usize, i: usize, j: usize) -> f64 {
        let f = REFLECTANCES[band] * (area(i) * area(j)).sqrt() * exchange(i, j);
        let mass = if i == j { area(i) } else { 0.0 };
        if self.with_mass { mass - f } else { f }
    }

    fn dense(&self, band: usize) -> Vec<Vec<f64>> {
        (0..ROWS).map(|i| (0..ROWS).map(|j| self.entry(band, i, j)).collect()).collect()
    }
}

fn mass_inverse() -> Csr {
    Csr::from_triplets(ROWS, ROWS, (0..ROWS).map(|i| (i as u32, i as u32, 1.0 / area(i))).collect())
}

/// Gaussian elimination with partial pivoting: the reference.
fn direct(mut a: Vec<Vec<f64>>, b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let mut x = b.to_vec();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs())).expect("rows remain");
        a.swap(k, pivot);
        x.swap(k, pivot);
        for i in k + 1..n {
            let f = a[i][k] / a[k][k];
            let above = a[k].clone();
            add_scaled(&mut a[i], -f, &above);
            x[i] -= f * x[k];
        }
    }
    for k in (0..n).rev() {
        let known: f64 = (k + 1..n).map(|j| a[k][j] * x[j]).sum();
        x[k] = (x[k] - known) / a[k][k];
    }
    x
}

fn run(
    kind: Kind,
    rhs: &MultiVector,
    x: &mut MultiVector,
    params: &Params,
    to: &dyn Progress,
) -> Result<Info, SolveError> {
    let (f, system, p) = (Light { with_mass: false }, Light { with_mass: true }, mass_inverse());
    match kind {
        Kind::Gmres => gmres(&system, &p, rhs, x, params, to),
        Kind::Cg => cg(&system, &p, rhs, x, params, to),
        Kind::Neumann => neumann(&p, &f, rhs, x, params, to),
    }
}

fn lamps() -> MultiVector {
    MultiVector::from_fn(ROWS, 3, |row, band| if row % 7 == band { 10.0 + row as f64 } else { 0.1 })
}

#[test]
fn every_solver_agrees_with_elimination_in_every_band() {
    let rhs = lamps();
    for solver in ALL {
        for guess in [0.0, 3.0] {
            let mut x = MultiVector::uniform(ROWS, &[guess; 3]);
            let info = run(solver.kind, &rhs, &mut x, &Params::default(), &Silent).expect(solver.name);
            assert!(info.residual <= 1e-10, "{}: {info:?}", solver.name);
            assert_eq!(info.converged.iter().max(), Some(&info.iterations), "{}", solver.name);
            for band in 0..3 {
                let exact = direct(Light { with_mass: true }.dense(band), rhs.band(band));
                for (x, exact) in x.band(band).iter().zip(exact) {
                    assert!((x - exact).abs() < 1e-7 * exact.abs(), "{} band {band}: {x} {exact}", solver.name);
                }
            }
        }
    }
}

#[test]
fn no_light_is_no_work_and_a_dark_band_stays_dark() {
    for solver in ALL {
        let mut x = MultiVector::uniform(ROWS, &[1.0; 3]);
        let info = run(solver.kind, &MultiVector::zeros(ROWS, 3), &mut x, &Params::default(), &Silent);
        assert_eq!(info.map(|info| info.iterations), Ok(0), "{}", solver.name);
        assert!(x.as_slice().iter().all(|&x| x == 0.0));
        let mut rhs = lamps();
        rhs.band_mut(2).fill(0.0);
        let mut x = MultiVector::uniform(ROWS, &[1.0; 3]);
        run(solver.kind, &rhs, &mut x, &Params::default(), &Silent).expect(solver.name);
        assert!(x.band(2).iter().all(|&x| x == 0.0), "{}", solver.name);
        assert!(x.band(0).iter().all(|&x| x > 0.0), "{}", solver.name);
    }
}

#[test]
fn a_converged_guess_takes_no_further_look() {
    let mut x = MultiVector::zeros(ROWS, 3);
    for kind in [Kind::Gmres, Kind::Cg] {
        run(kind, &lamps(), &mut x, &Params { tolerance: 1e-13, ..Params::default() }, &Silent).expect("converges");
        let again = run(kind, &lamps(), &mut x, &Params::default(), &Silent);
        assert_eq!(again.map(|info| info.iterations), Ok(0));
    }
}

#[test]
fn too_few_iterations_are_an_error_that_says_so() {
    for solver in ALL {
        let params = Params { tolerance: 1e-14, max_iterations: 3, ..Params::default() };
        let error =
            run(solver.kind, &lamps(), &mut MultiVector::zeros(ROWS, 3), &params, &Silent).expect_err("too few");
        let SolveError::NotConverged { iterations: 3, residual } = error else { panic!("{}: {error:?}", solver.name) };
        assert!(residual > 1e-14 && residual < 1.0, "{}: {residual}", solver.name);
        assert!(error.to_string().starts_with("not converged after 3 iterations"), "{error}");
    }
}

#[test]
fn every_solver_stops_when_asked() {
    struct Stop;
    impl Progress for Stop {
        fn interrupted(&self) -> bool {
            true
        }
    }
    for solver in ALL {
        let result = run(solver.kind, &lamps(), &mut MultiVector::zeros(ROWS, 3), &Params::default(), &Stop);
        assert_eq!(result, Err(SolveError::Interrupted(Interrupted)), "{}", solver.name);
    }
}

#[test]
fn bands_do_not_touch_each_other() {
    let all = lamps();
    for solver in ALL {
        let mut x = MultiVector::zeros(ROWS, 3);
        let together = run(solver.kind, &all, &mut x, &Params::default(), &Silent).expect(solver.name);
        for band in 0..3 {
            let mut alone = MultiVector::zeros(ROWS, 3);
            alone.band_mut(band).copy_from_slice(all.band(band));
            let mut y = MultiVector::zeros(ROWS, 3);
            let info = run(solver.kind, &alone, &mut y, &Params::default(), &Silent).expect(solver.name);
            assert_eq!(x.band(band), y.band(band), "{} band {band}", solver.name);
            assert_eq!(info.iterations, together.converged[band], "{} band {band}", solver.name);
        }
    }
}

fn diagonal(values: &[f64]) -> Csr {
    let entries = values.iter().enumerate().map(|(i, &v)| (i as u32, i as u32, v)).collect();
    Csr::from_triplets(values.len(), values.len(), entries)
}

#[test]
fn krylov_methods_take_one_step_per_distinct_eigenvalue() {
    for distinct in 1..6 {
        let a = diagonal(&(0..60).map(|i| 1.0 + (i % distinct) as f64).collect::<Vec<_>>());
        let rhs = MultiVector::from_fn(60, 2, |row, band| 1.0 + ((row * 7 + band) % 11) as f64);
        for solve in [gmres, cg] {
            let mut x = MultiVector::zeros(60, 2);
            let info = solve(&a, &Identity(60), &rhs, &mut x, &Params::default(), &Silent).expect("regular");
            assert_eq!(info.iterations, distinct);
        }
    }
}

#[test]
fn gmres_survives_restarts_and_asymmetry() {
    let n = 80;
    let entries =
        (0..n as u32).flat_map(|i| [(i, i, 2.0), (i, (i + 1) % n as u32, -1.5), (i, (i + 9) % n as u32, 0.3)]);
    let a = Csr::from_triplets(n, n, entries.collect());
    let rhs = MultiVector::from_fn(n, 2, |row, band| ((row * 13 + 5 * band) % 17) as f64);
    let mut x = MultiVector::zeros(n, 2);
    let params = Params { restart: 10, tolerance: 1e-12, ..Params::default() };
    let info = gmres(&a, &Identity(n), &rhs, &mut x, &params, &Silent).expect("regular");
    assert!(info.iterations > 10, "{info:?}");
    assert!(residual(&a, &rhs, &x).norms().iter().zip(rhs.norms()).all(|(r, b)| *r <= 1e-12 * b));
}

#[test]
fn singular_indefinite_and_infinite_systems_break_down() {
    let rhs = MultiVector::uniform(3, &[1.0, 1.0]);
    let broken = Err(SolveError::Breakdown { band: 0 });
    let cases: [(Kind, [f64; 3]); 5] = [
        (Kind::Gmres, [0.0, 0.0, 0.0]),
        (Kind::Gmres, [1.0, f64::NAN, 1.0]),
        (Kind::Cg, [1.0, -2.0, -3.0]),
        (Kind::Cg, [1.0, f64::INFINITY, 1.0]),
        (Kind::Neumann, [2.0, 2.0, 2.0]),
    ];
    for (kind, values) in cases {
        let (a, x) = (diagonal(&values), &mut MultiVector::zeros(3, 2));
        let params = Params { max_iterations: 5000, ..Params::default() };
        let result = match kind {
            Kind::Gmres => gmres(&a, &Identity(3), &rhs, x, &params, &Silent),
            Kind::Cg => cg(&a, &Identity(3), &rhs, x, &params, &Silent),
            Kind::Neumann => neumann(&Identity(3), &a, &rhs, x, &params, &Silent),
        };
        assert_eq!(result, broken, "{kind:?} {values:?}");
    }
}

/// Functions, what [`Light`] makes of them, and what the best combination of each band leaves.
struct Kept {
    target: MultiVector,
    rest: MultiVector,
    functions: Vec<MultiVector>,
    images: Vec<Columns<f64>>,
}

impl Kept {
    fn new(target: MultiVector) -> Self {
        let images = vec![Columns::summed(&vec![1.0; target.rows()].into()); target.bands()];
        Self { rest: target.clone(), target, functions: Vec::new(), images }
    }

    /// The best combination in each band.
    fn solution(&self) -> MultiVector {
        let mut x = MultiVector::zeros(ROWS, self.target.bands());
        for (band, images) in self.images.iter().enumerate() {
            let y = images.fit(self.target.band(band));
            for (function, y) in self.functions.iter().zip(y) {
                add_scaled(x.band_mut(band), y, function.band(band));
            }
        }
        x
    }
}

impl SearchSpace for Kept {
    fn rest(&self) -> &MultiVector {
        &self.rest
    }

    fn extend(&mut self, bands: &[usize], directions: MultiVector) {
        // The others take nothing in.
        let mut all = MultiVector::zeros(ROWS, self.target.bands());
        bands.iter().enumerate().for_each(|(k, &band)| all.band_mut(band).copy_from_slice(directions.band(k)));
        let image = Light { with_mass: true }.times(&all);
        self.functions.push(all);
        self.rest.clone_from(&self.target);
        for (band, images) in self.images.iter_mut().enumerate() {
            images.extend([(image.band(band).to_vec(), 0.0)]);
            let y = images.fit(self.target.band(band));
            images.subtract(&y, self.rest.band_mut(band));
        }
    }
}

/// It takes the steps of GMRES, and none where a space that holds the solution is known.
#[test]
fn a_search_ends_at_the_solution_and_begins_with_what_is_known() {
    let (rhs, params) = (lamps(), Params { tolerance: 1e-8, ..Params::default() });
    let by_gmres = run(Kind::Gmres, &rhs, &mut MultiVector::zeros(ROWS, 3), &params, &Silent).expect("regular");
    let mut space = Kept::new(rhs.clone());
    let info = search(&mut space, &mass_inverse(), rhs.norms(), &params, &Silent).expect("regular");
    assert_eq!((info.iterations, &info.converged), (by_gmres.iterations, &by_gmres.converged));
    let x = space.solution();
    for band in 0..3 {
        let exact = direct(Light { with_mass: true }.dense(band), rhs.band(band));
        for (x, exact) in x.band(band).iter().zip(exact) {
            assert!((x - exact).abs() < 1e-6 * exact.abs(), "band {band}: {x} {exact}");
        }
    }
    let mut dimmer = rhs;
    dimmer.as_mut_slice().iter_mut().for_each(|x| *x *= 0.3);
    let mut known = Kept { target: dimmer.clone(), ..space };
    let none = MultiVector::zeros(ROWS, 3);
    known.extend(&[0, 1, 2], none);
    let again = search(&mut known, &mass_inverse(), dimmer.norms(), &params, &Silent).expect("regular");
    assert_eq!(again.iterations, 0);
}

#[test]
fn a_search_says_why_it_ends() {
    let rhs = lamps();
    let few = Params { tolerance: 1e-14, max_iterations: 3, ..Params::default() };
    let result = search(&mut Kept::new(rhs.clone()), &mass_inverse(), rhs.norms(), &few, &Silent);
    assert!(matches!(result, Err(SolveError::NotConverged { iterations: 3, .. })), "{result:?}");
    let mut broken = rhs.clone();
    broken.band_mut(1)[5] = f64::NAN;
    let result = search(&mut Kept::new(broken), &mass_inverse(), rhs.norms(), &few, &Silent);
    assert_eq!(result, Err(SolveError::Breakdown { band: 1 }));
}

/// A chain, in several pieces, of which D⁻¹ A has its eigenvalues between ½ and 3/2: hats, if neighbours have 1.
fn chain(neighbour: f64) -> Csr {
    let rows = 20_000;
    let row = |i: usize| {
        let near = [i.wrapping_sub(1), i, i + 1].into_iter().filter(|&j| j < rows);
        near.map(|j| (j as u32, if i == j { 4.0 } else { neighbour })).collect::<Vec<_>>()
    };
    Csr::from_rows(rows, (0..rows).map(row))
}

/// The error of Chebyshev's iteration for each band, relative to that of 0, in the norm of A.
fn chebyshev_error(matrix: &Csr, exact: &MultiVector, tolerance: f64) -> Vec<f64> {
    let (rhs, inverse_diagonal) = (matrix.times(exact), vec![0.25; exact.rows()]);
    let a = Scaled { matrix, inverse_diagonal: &inverse_diagonal, spectrum: [0.5, 1.5] };
    let mut x = MultiVector::uniform(exact.rows(), &vec![9.0; exact.bands()]);
    chebyshev(&a, &rhs, &mut x, tolerance);
    x.add_scaled(-1.0, exact);
    let errors = x.dot(&matrix.times(&x)).into_iter().zip(exact.dot(&rhs));
    errors.map(|(error, all)| (error / all).sqrt()).collect()
}

#[test]
fn chebyshev_brings_the_error_to_the_tolerance_whatever_the_number_of_bands() {
    for (neighbour, bands) in [(1.0, 1), (1.0, 3), (-1.0, 4), (1.0, 5)] {
        let value = |row: usize, band: usize| ((7 * row + 3 * band) % 11) as f64 - 5.0;
        let (matrix, exact) = (chain(neighbour), MultiVector::from_fn(20_000, bands, value));
        for tolerance in [1e-2, 1e-5, 1e-6, 1e-10, 1e-12] {
            for error in chebyshev_error(&matrix, &exact, tolerance) {
                assert!(error <= tolerance, "{bands} bands to {tolerance:e}: {error:e}");
            }
        }
    }
}

#[test]
fn chebyshev_loses_no_number_that_is_very_small_or_very_large() {
    let magnitudes = [1e-60, 1e-40, 1.0, 1e40, 1e60];
    let exact = MultiVector::from_fn(20_000, 5, |row, band| magnitudes[band] * ((7 * row + band) % 11) as f64);
    for tolerance in [1e-4, 1e-9] {
        for (error, magnitude) in chebyshev_error(&chain(1.0), &exact, tolerance).into_iter().zip(magnitudes) {
            assert!(error <= tolerance, "{magnitude:e} to {tolerance:e}: {error:e}");
        }
    }
}

#[test]
fn chebyshev_finds_constants_at_once_if_no_number_is_negative() {
    let exact = MultiVector::uniform(20_000, &[1.0, 0.3]);
    // To the last digits of single precision.
    assert!(chebyshev_error(&chain(1.0), &exact, 1.0).iter().all(|&error| error < 1e-7));
    assert!(chebyshev_error(&chain(-1.0), &exact, 1.0).iter().all(|&error| error > 1e-3), "one step");
}

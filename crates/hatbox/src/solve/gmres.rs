use super::{Info, Params, SolveError, Watch, add_scaled, check_finite, clear_dark_bands, residual};
use crate::linalg::{LinearOperator, MultiVector, dot};
use crate::progress::Progress;
use rayon::prelude::*;

/// Solves A x = b by restarted GMRES (Saad and Schultz 1986), for any regular A.
///
/// `x` holds the guess on entry and the solution on return. The preconditioner P ≈ A⁻¹ acts from the *right*,
/// A P y = b with x = P y, so the residual that is minimised is the true one, ‖b − A x‖₂, in every band.
/// Orthogonalisation is modified Gram–Schmidt, repeated when it cancels (Daniel et al. 1976), the least-squares problem
/// is updated by Givens rotations.
///
/// # Errors
/// [`SolveError::NotConverged`] with the best `x` so far, [`SolveError::Breakdown`] if A is singular on the Krylov space
/// or not finite, [`SolveError::Interrupted`].
///
/// # Panics
/// If the dimensions of the arguments do not match.
pub fn gmres(
    a: &dyn LinearOperator,
    preconditioner: &dyn LinearOperator,
    rhs: &MultiVector,
    x: &mut MultiVector,
    params: &Params,
    progress: &dyn Progress,
) -> Result<Info, SolveError> {
    clear_dark_bands(rhs, x);
    let mut watch = Watch::new(rhs.norms(), *params, progress);
    check_finite(&watch.scales)?;
    loop {
        let r = residual(a, rhs, x);
        let norms = r.norms();
        check_finite(&norms)?;
        let open = watch.open(&norms);
        if !open.contains(&true) {
            return Ok(watch.info(&norms));
        }
        let mut spaces: Vec<Krylov> = r.iter_bands().zip(&open).map(|(r, &open)| Krylov::new(r, open)).collect();
        cycle(a, preconditioner, &mut spaces, &mut watch, &norms)?;
        let mut step = MultiVector::zeros(x.rows(), x.bands());
        for (band, space) in spaces.iter().enumerate() {
            space.combine(step.band_mut(band)).ok_or(SolveError::Breakdown { band })?;
        }
        x.add_scaled(1.0, &preconditioner.times(&step));
    }
}

/// Extends the spaces until every band's residual is small enough or the restart is due.
fn cycle(
    a: &dyn LinearOperator,
    preconditioner: &dyn LinearOperator,
    spaces: &mut [Krylov],
    watch: &mut Watch,
    norms: &[f64],
) -> Result<(), SolveError> {
    let rows = a.rows();
    let mut direction = MultiVector::zeros(rows, spaces.len());
    let (mut scaled, mut image) = (direction.clone(), direction.clone());
    for step in 0..watch.params.restart.max(1) {
        for (band, space) in spaces.iter().enumerate() {
            match space.direction() {
                Some(v) => direction.band_mut(band).copy_from_slice(v),
                None => direction.band_mut(band).fill(0.0),
            }
        }
        match watch.tick(norms) {
            // The steps already done are worth keeping: the caller finds the same lack of iterations after the update.
            Err(SolveError::NotConverged { .. }) if step > 0 => return Ok(()),
            other => other?,
        }
        preconditioner.apply(&direction, &mut scaled);
        a.apply(&scaled, &mut image);
        spaces.par_iter_mut().zip(image.as_slice().par_chunks(rows.max(1))).for_each(|(space, w)| space.extend(w));
        let estimates: Vec<f64> = spaces.iter().map(Krylov::estimate).collect();
        for (space, open) in spaces.iter_mut().zip(watch.open(&estimates)) {
            space.open &= open && !space.exhausted;
        }
        if spaces.iter().all(|space| !space.open) {
            break;
        }
    }
    Ok(())
}

/// The Krylov space of one band: A P V = V⁺ H, where V⁺ is V and one vector more, and H is kept as its QR
/// factors.
struct Krylov {
    /// Orthonormal basis V.
    basis: Vec<Vec<f64>>,
    /// Columns of R; column k has k + 1 entries.
    triangle: Vec<Vec<f64>>,
    /// Givens rotations (cos, sin).
    rotations: Vec<[f64; 2]>,
    /// The rotated right-hand side; its last entry is ± the norm of the residual.
    target: Vec<f64>,
    /// Whether it still grows.
    open: bool,
    /// Whether the space is invariant: it cannot grow.
    exhausted: bool,
}

impl Krylov {
    fn new(residual: &[f64], open: bool) -> Self {
        let norm = dot(residual, residual).sqrt();
        let basis = if open { vec![residual.iter().map(|r| r / norm).collect()] } else { Vec::new() };
        Self { basis, triangle: Vec::new(), rotations: Vec::new(), target: vec![norm], open, exhausted: false }
    }

    /// The vector that the operator is to be applied to next.
    fn direction(&self) -> Option<&[f64]> {
        self.basis.last().filter(|_| self.open).map(Vec::as_slice)
    }

    /// Norm of the residual of the best combination.
    fn estimate(&self) -> f64 {
        self.target[self.target.len() - 1].abs()
    }

    /// Takes the image of [`Self::direction`] in.
    fn extend(&mut self, image: &[f64]) {
        if !self.open {
            return;
        }
        let mut w = image.to_vec();
        let before = dot(&w, &w).sqrt();
        let mut column = vec![0.0; self.basis.len()];
        let mut norm = self.orthogonalise(&mut w, &mut column);
        if norm < 0.5 * before {
            norm = self.orthogonalise(&mut w, &mut column);
        }
        // What is left after two passes is rounding: the space is invariant.
        self.exhausted = norm <= 4.0 * f64::EPSILON * before || !norm.is_finite();
        let below = if self.exhausted { 0.0 } else { norm };
        self.rotate(column, below);
        self.basis.push(w.iter().map(|w| w / norm).collect());
    }

    /// One pass of modified Gram–Schmidt; adds the coefficients to `column` and returns the norm of what is left.
    fn orthogonalise(&self, w: &mut [f64], column: &mut [f64]) -> f64 {
        for (v, h) in self.basis.iter().zip(column) {
            let c = dot(v, w);
            add_scaled(w, -c, v);
            *h += c;
        }
        dot(w, w).sqrt()
    }

    /// Appends a column of H, whose entry below the diagonal is `below`, to the QR factors.
    fn rotate(&mut self, mut column: Vec<f64>, below: f64) {
        for (k, [c, s]) in self.rotations.iter().enumerate() {
            let (above, here) = (column[k], column[k + 1]);
            column[k] = c * above + s * here;
            column[k + 1] = c * here - s * above;
        }
        let k = column.len() - 1;
        let diagonal = column[k].hypot(below);
        let [c, s] = if diagonal > 0.0 { [column[k] / diagonal, below / diagonal] } else { [1.0, 0.0] };
        column[k] = diagonal;
        self.triangle.push(column);
        self.rotations.push([c, s]);
        let target = self.target[k];
        self.target[k] = c * target;
        self.target.push(-s * target);
    }

    /// Adds V y of the least residual to `out`; `None` if H is singular.
    fn combine(&self, out: &mut [f64]) -> Option<()> {
        let n = self.triangle.len();
        let mut y = self.target[..n].to_vec();
        let greatest = self.triangle.iter().map(|column| column[column.len() - 1].abs()).fold(0.0, f64::max);
        for k in (0..n).rev() {
            let diagonal = self.triangle[k][k];
            if diagonal.is_nan() || diagonal.abs() <= f64::EPSILON * greatest {
                return None;
            }
            y[k] /= diagonal;
            let (head, tail) = y.split_at_mut(k);
            add_scaled(head, -tail[0], &self.triangle[k][..k]);
        }
        for (v, y) in self.basis.iter().zip(y) {
            add_scaled(out, y, v);
        }
        Some(())
    }
}

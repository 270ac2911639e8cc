use super::{Info, Params, SolveError, Watch, add_scaled, check_finite, clear_dark_bands, residual};
use crate::linalg::{LinearOperator, MultiVector, dot, each};
use crate::progress::Progress;

/// Solves A x = b by preconditioned conjugate gradients (Hestenes and Stiefel 1952), for A and P symmetric positive
/// definite, P ≈ A⁻¹.
///
/// `x` holds the guess on entry and the solution on return. The recurrence restarts from the true residual when it
/// believes to have converged, so drift of the recurrence is not reported as accuracy.
///
/// # Errors
/// [`SolveError::NotConverged`] with the last `x`, [`SolveError::Breakdown`] where pᵀA p ≤ 0 or rᵀP r ≤ 0 shows an
/// operator that is not positive definite, [`SolveError::Interrupted`].
///
/// # Panics
/// If the dimensions of the arguments do not match.
pub fn cg(
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
        descend(a, preconditioner, r, open, x, &mut watch)?;
    }
}

/// The recurrence, from the residual `r` of `x`, until it has passed the tolerance in all open bands.
fn descend(
    a: &dyn LinearOperator,
    preconditioner: &dyn LinearOperator,
    mut r: MultiVector,
    mut open: Vec<bool>,
    x: &mut MultiVector,
    watch: &mut Watch,
) -> Result<(), SolveError> {
    let mut z = preconditioner.times(&r);
    let mut p = MultiVector::zeros(r.rows(), r.bands());
    let mut image = p.clone();
    let mut rz_before = vec![f64::INFINITY; r.bands()];
    while open.contains(&true) {
        watch.tick(&r.norms())?;
        let rz = r.dot(&z);
        for band in 0..r.bands() {
            let beta = if open[band] { rz[band] / rz_before[band] } else { 0.0 };
            if open[band] {
                each(p.band_mut(band), z.band(band), |p, z| *p = z + beta * *p);
            } else {
                p.band_mut(band).fill(0.0);
            }
        }
        a.apply(&p, &mut image);
        for band in (0..r.bands()).filter(|&band| open[band]) {
            let curvature = dot(p.band(band), image.band(band));
            if !(curvature > 0.0 && curvature.is_finite() && rz[band] > 0.0) {
                return Err(SolveError::Breakdown { band });
            }
            let alpha = rz[band] / curvature;
            add_scaled(x.band_mut(band), alpha, p.band(band));
            add_scaled(r.band_mut(band), -alpha, image.band(band));
        }
        open = watch.open(&r.norms());
        preconditioner.apply(&r, &mut z);
        rz_before = rz;
    }
    Ok(())
}

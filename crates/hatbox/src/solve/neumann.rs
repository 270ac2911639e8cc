use super::{Info, Params, SolveError, Watch, check_finite, clear_dark_bands};
use crate::linalg::{LinearOperator, MultiVector};
use crate::progress::Progress;

/// Solves M x = b + F x bounce by bounce: x ← M⁻¹(b + F x).
///
/// From the guess zero, iterate k holds the light of at most k − 1 bounces, which is what this solver is for; the
/// number of iterations to reach a tolerance grows like 1/(1 − ρ). `x` holds the guess on entry and the solution on
/// return.
///
/// The residual is that of the system (I − M⁻¹F) x = M⁻¹b, relative to ‖M⁻¹b‖₂: it equals the change of the
/// iterate and is therefore known exactly for the last but one. The last is returned; its own residual is smaller by one more
/// bounce.
///
/// # Errors
/// [`SolveError::NotConverged`] with the last `x`, [`SolveError::Breakdown`] if the iterates leave the finite numbers
/// (‖M⁻¹F‖ > 1), [`SolveError::Interrupted`].
///
/// # Panics
/// If the dimensions of the arguments do not match.
pub fn neumann(
    mass_inverse: &dyn LinearOperator,
    transport: &dyn LinearOperator,
    rhs: &MultiVector,
    x: &mut MultiVector,
    params: &Params,
    progress: &dyn Progress,
) -> Result<Info, SolveError> {
    clear_dark_bands(rhs, x);
    let mut watch = Watch::new(mass_inverse.times(rhs).norms(), *params, progress);
    check_finite(&watch.scales)?;
    let unknown = |&scale: &f64| if scale > 0.0 { f64::INFINITY } else { 0.0 };
    let mut changes: Vec<f64> = watch.scales.iter().map(unknown).collect();
    let mut open = watch.open(&changes);
    let mut sum = rhs.clone();
    let mut next = rhs.clone();
    while open.contains(&true) {
        watch.tick(&changes)?;
        transport.apply(x, &mut sum);
        sum.add_scaled(1.0, rhs);
        mass_inverse.apply(&sum, &mut next);
        for band in (0..x.bands()).filter(|&band| open[band]) {
            changes[band] = advance(x.band_mut(band), next.band(band));
        }
        check_finite(&changes)?;
        open = watch.open(&changes);
    }
    Ok(watch.info(&changes))
}

/// Replaces `x` by `next` and returns the norm of the change.
fn advance(x: &mut [f64], next: &[f64]) -> f64 {
    let mut change = 0.0;
    for (x, &next) in x.iter_mut().zip(next) {
        change += (next - *x) * (next - *x);
        *x = next;
    }
    change.sqrt()
}

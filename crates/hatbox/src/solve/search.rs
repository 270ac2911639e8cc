use super::{Info, Params, SolveError, Watch, check_finite};
use crate::linalg::{LinearOperator, MultiVector};
use crate::progress::Progress;

/// Functions that the x of A x = b is sought among, more and more of them.
///
/// Whoever keeps them knows A of each, and may have known some before, from other equations that share a factor.
pub trait SearchSpace {
    /// b − A x for the x among all combinations that makes it least in each band.
    fn rest(&self) -> &MultiVector;
    /// Takes more functions in, one in each band; a band that needs none has zeros.
    fn extend(&mut self, directions: &MultiVector);
}

/// Extends a space until it holds the solution: the method of generalised conjugate residuals (Eisenstat, Elman and Schultz
/// 1983), in which each direction is P ≈ A⁻¹ of what is left. It finds what [`gmres()`](super::gmres()) finds in as many
/// steps, and can begin with any functions. The residual of each band is relative to its number in `scales`.
///
/// # Errors
/// [`SolveError`]; breakdown is numbers that are not finite.
pub fn search(
    space: &mut dyn SearchSpace,
    preconditioner: &dyn LinearOperator,
    scales: Vec<f64>,
    params: &Params,
    progress: &dyn Progress,
) -> Result<Info, SolveError> {
    let mut watch = Watch::new(scales, *params, progress);
    check_finite(&watch.scales)?;
    loop {
        let norms = space.rest().norms();
        check_finite(&norms)?;
        let open = watch.open(&norms);
        if !open.contains(&true) {
            return Ok(watch.info(&norms));
        }
        watch.tick(&norms)?;
        let mut left = space.rest().clone();
        for band in (0..left.bands()).filter(|&band| !open[band]) {
            left.band_mut(band).fill(0.0);
        }
        space.extend(&preconditioner.times(&left));
    }
}

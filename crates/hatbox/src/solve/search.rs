use super::{Info, Params, SolveError, Watch, check_finite};
use crate::linalg::{LinearOperator, MultiVector};
use crate::progress::Progress;
use std::collections::VecDeque;

/// So many directions that together leave more than this of the residual are not worth their products. (One may bring little, and
/// the next much: in a bright room the first ones find what all of it has in common.)
const STALLED: f64 = 0.9;
const PATIENCE: usize = 3;

/// Functions that the x of A x = b is sought among, more and more of them.
///
/// Whoever keeps them knows A of each, and may have known some before, from other equations that share a factor.
pub trait SearchSpace {
    /// b − A x for the x among all combinations that makes it least in each band.
    fn rest(&self) -> &MultiVector;
    /// Takes more functions in, one in each of these bands.
    fn extend(&mut self, bands: &[usize], directions: MultiVector);
}

/// Extends a space until it holds the solution: the method of generalised conjugate residuals (Eisenstat, Elman and Schultz
/// 1983), in which each direction is P ≈ A⁻¹ of what is left. It can begin with any functions. Where rows weigh very differently
/// (a large cell among small ones) a direction may bring nothing, and then all later ones would be the same: the search ends
/// there, with a residual above the tolerance, and what is left is for [`gmres()`](super::gmres()). The residual of each band
/// is relative to its number in `scales`.
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
    let mut before = VecDeque::from(vec![vec![f64::INFINITY; watch.scales.len()]; PATIENCE]);
    loop {
        let norms = space.rest().norms();
        check_finite(&norms)?;
        let open = watch.open(&norms);
        if !open.contains(&true) {
            return Ok(watch.info(&norms));
        }
        let stalls = |(norm, before): (&f64, &f64)| *norm > STALLED * before;
        let is_stalled = norms.iter().zip(&before[0]).zip(&open).any(|(pair, &open)| open && stalls(pair));
        if is_stalled {
            return Ok(watch.info(&norms));
        }
        watch.tick(&norms)?;
        before.pop_front();
        before.push_back(norms.clone());
        // Of norm 1, as whoever keeps few digits of them wants it.
        let bands: Vec<usize> = (0..open.len()).filter(|&band| open[band]).collect();
        let left = space.rest().some(&bands, |band, x| x / norms[band]);
        space.extend(&bands, preconditioner.times_owned(left));
    }
}

//! Scenes without a solution: closed and lit, with surfaces that reflect everything. Light that enters never ends, and the
//! solver would say no more than that it does not converge.

use super::Error;
use crate::scene::{Quantity, Scene};

/// Surfaces that absorb less than this reflect everything.
const ABSORBS: f64 = 1e-9;

/// Why the scene has no solution, if it has none; `escape` is asked what [escapes](crate::exchange::escape) where that
/// decides.
pub(crate) fn lossless<E>(scene: &Scene, escape: impl FnOnce() -> Result<f64, E>) -> Result<Option<Error>, E> {
    let cells = || 0..scene.mesh.cells.len();
    let somewhere = |band: usize, test: &dyn Fn(usize, usize) -> bool| cells().any(|cell| test(cell, band));
    let absorbs = |cell: usize, band: usize| least(scene, cell, band) < 1.0 - ABSORBS;
    let emits = |cell: usize, _| !scene.material(cell).exitance.is_zero();
    let suspect = (0..scene.bands).find(|&band| somewhere(band, &emits) && !somewhere(band, &absorbs));
    match suspect {
        Some(band) if escape()? == 0.0 => Ok(Some(Error::Lossless { band, materials: mirrors(scene, band) })),
        _ => Ok(None),
    }
}

/// The least reflectance of a cell, at its middle and its corners if it varies.
fn least(scene: &Scene, cell: usize, band: usize) -> f64 {
    let reflectance: &Quantity = &scene.material(cell).reflectance;
    reflectance.uniform(band).unwrap_or_else(|| {
        let corners = scene.mesh.patch(cell).shape().reference_corners();
        let places = corners.iter().copied().chain([[1.0 / 3.0, 1.0 / 3.0]]);
        places.map(|at| reflectance.at(&scene.site(cell, at), band)).fold(f64::INFINITY, f64::min)
    })
}

/// The names of the materials that reflect all light of a band, of those that are used.
fn mirrors(scene: &Scene, band: usize) -> Vec<String> {
    let bright = |&cell: &usize| least(scene, cell, band) >= 1.0 - ABSORBS;
    let mut names: Vec<String> =
        (0..scene.mesh.cells.len()).filter(bright).map(|cell| scene.material(cell).name.clone()).collect();
    names.sort_unstable();
    names.dedup();
    names
}

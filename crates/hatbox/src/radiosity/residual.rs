//! How wrong the solution is: the residual of the continuous equation, at points that the solver never saw.
//!
//! r = B⁰ + R K B̃ − B̃ vanishes for the true radiosity, and the error is e = r + R K e = r + p. The two parts are estimated
//! apart:
//!
//! - ‖r‖ from irradiance gathered afresh, with its own quadrature and its own rays, at points drawn where the indicators
//!   see error, where the error is asked of, and all over the surfaces (a third of them each); where more are needed, half
//!   of these lie where the first have seen error (`spread`). Visibility, quadrature, discretisation and the solver are all
//!   in it. Shadows are exact there. Where rays have to tell, each point has two independent gathers whose residuals are
//!   *multiplied*, so that their noise does not pass for an error of the solution. To the mean three standard errors are
//!   added.
//! - p = R K (r + p) is what the residual causes elsewhere. Of r that can be reflected, the space knows its projection
//!   g − B̃, with g = Δ⁻¹(b⁰ + M_R e) in the broken space: joined functions leave it. The operator's errors are not in it;
//!   what share of the light these are in parts of the scene (`means`) is measured at the same points. Both are reflected with the same S.
//! - In a bright room a thousandth that too little is lost is a hundredth of the light, and no points see a thousandth in the noise
//!   of theirs. Where rays make the operator, half of what the halves of them differ by is a function like its error, and so is the
//!   same with other signs on the cells, whose rays are their own. Both are reflected; what they cause is a third part, q, of
//!   which nothing is known but its size (`doubt`).
//!
//! The estimate is the root of ‖r‖² + 2⟨r, p⟩ + ‖p‖² + ‖q‖². What is reported is *estimated*: points prove nothing. What is certified is
//! another module's (`certificate`, which is above this one).
//!
//! Tried and dropped: p from means over parts alone. Beside an edge r has one sign on both faces, which reflect it to each
//! other; in an empty cube the estimate was too small, with any number of points. ‖r‖/(1 − ρ) with the emitted over
//! the leaving power for 1 − ρ. It takes the residual to be of the shape that multiplies most, and overestimated by
//! 1/(1 − ρ): threefold in a room of ρ = 0.7.

use super::indicator::indicated;
use super::means::part_means;
use super::pointwise::quantiles;
use super::spread::{Spread, carried_around};
use super::{Shown, Solution, System};
use crate::exchange::Exchange;
use crate::linalg::{LinearOperator, MultiVector};
use crate::mesh::{Patch, Side};
use crate::progress::{Interrupted, Progress, Stage};
use crate::quadrature::sequence::{hash, point};
use crate::solve::{Info, SolveError};
use crate::space::{COPLANAR_ANGLE, CREASE_ANGLE, joints};
use rayon::prelude::*;

/// Points are added until so many standard errors as are added are less than this share of the mean of r², or the error is
/// surely more than is wanted or less than a part of that, or there are so many times those that were asked for. The share is twice that of the norm.
/// Where r is even, the first points do; where it sits at the edge of a shadow they may err by half. (That points which
/// happen to miss an edge ask for no others is a bias; the third of them that follows the indicators is there to see
/// edges.)
const PRECISE: f64 = 0.3;
const MOST_TIMES: usize = 16;
/// An error that is less than this part of what is wanted, with its standard errors, is small enough for certain: the other half is
/// for what no point has seen.
const ENOUGH: f64 = 0.5;
/// Standard errors that are added to the mean of r²: few points fall where r is greatest, at edges and in corners.
const DEVIATIONS: f64 = 3.0;
/// A residual that is smaller than B̃ by this factor is none.
const ROUNDING: f64 = 1e-12;

/// An estimate of ‖B − B̃‖/‖B̃ − B⁰‖ and of what it is made of, each the worst band's. The norm is that of the reflected
/// light: emitters are often hundreds of times brighter than what they light, and their own exitance is exact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorEstimate {
    /// The estimated relative L2 error of the reflected light.
    pub relative: f64,
    /// ‖r‖/‖B̃ − B⁰‖, with three standard errors of its sampling.
    pub residual: f64,
    /// ‖p‖/‖B̃ − B⁰‖, what the residual causes by reflection, as far as the broken space or means over parts of the scene know
    /// it.
    pub propagated: f64,
    /// Of the residual, what textures and given functions lose by projection.
    pub data: f64,
    /// Of the residual, the rest: elements too large, shadows between them (and the operator's errors at the points).
    pub discretisation: f64,
    /// What joining has taken away from elements that are joined where faces bend: g − B̃ on them, g being the solution
    /// reflected once more. 0 of broken functions, and of flat faces. A sampled operator's light is averaged over joined
    /// elements, but for that of lamps: there, only lamps' is in it.
    pub bends: f64,
    /// The residual relative to the light *there* that half of the area that reflects does not exceed, and nine tenths: whatever little
    /// of the scene has most of its light and so decides the norm. Light counts as a hundredth of its mean at the least.
    pub pointwise: [f64; 2],
    /// Emitted over leaving power, 1 − ρ for the scene as a whole.
    pub absorption: f64,
    /// Computation: what errors of the operator (quadrature and visibility) change of the reflected light, as known when it
    /// was built and in the norm of the others, with what that causes by reflection where rays make the operator. The residual
    /// has the first in it. Of a dense operator it is one to fourteen
    /// times what is true: most in empty rooms, where joining averages what quadrature errs by.
    pub operator: f64,
    /// Relative residual that the solver left: of all light, wherever the error is asked of.
    pub solver: f64,
}

/// An estimate, and the squared residuals that it is made of.
#[derive(Debug, Clone)]
pub struct Estimated {
    /// The estimate.
    pub error: ErrorEstimate,
    /// For each cell with points, the mean of r² relative to ‖B̃ − B⁰‖², summed over bands, in 1/m².
    pub seen: Vec<(usize, f64)>,
    /// The [`local_error`](super::local_error).
    pub indicated: MultiVector,
}

/// How an error is to be estimated.
#[derive(Debug, Clone, Copy)]
pub struct Sampling<'a> {
    /// Number of points to begin with: there are up to sixteen times as many where r² scatters, until three standard errors
    /// are less than 0.3 of its mean.
    pub points: usize,
    /// The relative error that is wanted: where it is surely more or far less, nothing is to be gained from more points. 0 if
    /// any answer is.
    pub wanted: f64,
    /// Seed of the points and rays.
    pub seed: u64,
    /// Which cells the error is asked of: all if not given.
    pub within: Option<&'a [bool]>,
}

/// Estimates the error of a solution from its residual at points.
///
/// # Errors
/// [`SolveError::Interrupted`], or another [`SolveError`] where the reflections of the residual cannot be computed.
pub fn estimate_error(
    system: &System,
    solution: &Solution,
    info: &Info,
    sampling: &Sampling<'_>,
    progress: &dyn Progress,
) -> Result<Estimated, SolveError> {
    let measure = Measure::new(system, solution, sampling);
    let stage = Stage::begin(progress, "estimating the error", 3);
    let samples = measure.samples(progress)?;
    progress.advance(1);
    let propagated = measure.propagated(&samples, progress)?;
    progress.advance(1);
    let (residuals, seen) = (measure.residuals(&samples), measure.seen(&samples));
    let energy = system.energy(solution, progress)?;
    let worst = |f: &dyn Fn(usize) -> f64| (0..solution.bands()).map(f).fold(0.0, greater);
    let absorption = |band: usize| {
        let (emitted, leaving) = (energy.emitted[band], energy.leaving[band]);
        if leaving > 0.0 { -emitted / leaving } else { -1.0 }
    };
    let whole = measure.norms_within(&solution.radiosity);
    let spread = system.operator_spread(solution, progress)?;
    let doubt = measure.doubt(&spread, progress)?;
    drop(stage);
    let spread = measure.norms_within(&spread);
    let bends = measure.bends();
    // Where nothing is reflected there is nothing to be wrong but the last digits of the emission.
    let relative = |value: f64, band: usize| {
        if value <= ROUNDING * whole[band] { 0.0 } else { value / measure.norms[band] }
    };
    let residual = |band: usize| relative(residuals[band][0], band);
    let data = |band: usize| relative(residuals[band][1], band);
    let caused = |band: usize| relative(root(propagated[band][0]), band);
    let total = |band: usize| {
        let [square, product] = propagated[band];
        relative(root(residuals[band][0].powi(2) + 2.0 * product + square + doubt[band]), band)
    };
    let error = ErrorEstimate {
        relative: worst(&total),
        residual: worst(&residual),
        propagated: worst(&caused),
        data: worst(&data),
        discretisation: worst(&|band| root(residual(band).powi(2) - data(band).powi(2))),
        bends: worst(&|band| relative(bends[band], band)),
        pointwise: quantiles(samples.iter().filter(|sample| measure.counts(sample.cell))),
        absorption: -(0..solution.bands()).map(absorption).fold(-1.0, greater),
        operator: worst(&|band| relative(spread[band].hypot(doubt[band].sqrt()), band)),
        solver: info.residual,
    };
    Ok(Estimated { error, seen, indicated: measure.indicated })
}

/// The greater of two numbers; no number at all, if one of them is none.
pub(super) fn greater(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

/// The square root of what is not negative but for noise; no number stays none, as it would not with `max`.
fn root(square: f64) -> f64 {
    if square < 0.0 { 0.0 } else { square.sqrt() }
}

/// What is known at a point.
pub(super) struct Sample {
    pub(super) cell: usize,
    /// 1/density, in m²: what the point would stand for if it were the only one.
    pub(super) area: f64,
    /// The reflected light there, the sum of all bands, if the material reflects any.
    pub(super) light: Option<f64>,
    /// Per band: the two independent residuals, what projection of the data costs, and the known part g − B̃ of the residual.
    pub(super) bands: Vec<[f64; 4]>,
}

struct Measure<'a> {
    system: &'a System,
    solution: &'a Solution,
    sampling: &'a Sampling<'a>,
    areas: Vec<f64>,
    /// ‖B̃ − B⁰‖ within, per band; everywhere if that is nothing.
    norms: Vec<f64>,
    /// Δ⁻¹(b⁰ + M_R e), and the same without the emission.
    reflected: MultiVector,
    light: MultiVector,
    /// g − B̃, the part of the residual that is known without points.
    taken: MultiVector,
    /// The cells that functions are joined across the edges of, if they are.
    joints: Vec<[Side; 2]>,
    /// The indicators.
    indicated: MultiVector,
}

impl<'a> Measure<'a> {
    fn new(system: &'a System, solution: &'a Solution, sampling: &'a Sampling<'a>) -> Self {
        let (mesh, reflected) = (&system.scene.mesh, system.reflected_once_more(solution));
        let joints = joints(&system.scene, CREASE_ANGLE);
        let mut taken = reflected.clone();
        taken.add_scaled(-1.0, &solution.radiosity);
        let mut light = reflected.clone();
        light.add_scaled(-1.0, &system.projected_emission());
        let mut measure = Self {
            norms: Vec::new(),
            areas: (0..mesh.cells.len()).map(|cell| mesh.patch(cell).area()).collect(),
            indicated: indicated(solution, &reflected, system.mass(), &joints),
            taken,
            joints,
            reflected,
            light,
            system,
            solution,
            sampling,
        };
        measure.norms = measure.norms_within(&measure.light);
        // Where nothing lights what is asked of, there is no light there to be relative to.
        let everywhere = measure.light.dot(&system.mass().times(&measure.light)).into_iter().map(root);
        measure.norms.iter_mut().zip(everywhere).for_each(|(norm, all)| {
            if *norm <= ROUNDING * all {
                *norm = all;
            }
        });
        measure
    }

    fn counts(&self, cell: usize) -> bool {
        self.sampling.within.is_none_or(|within| within[cell])
    }

    /// The norm of g − B̃ over the cells that are asked of and joined with cells of other planes.
    fn bends(&self) -> Vec<f64> {
        let (space, mesh) = (&self.solution.space, &self.solution.scene.mesh);
        let mut bent = vec![false; mesh.cells.len()];
        let joined = if space.continuity().is_some() { &*self.joints } else { &[] };
        for pair in joined.iter().map(|sides| sides.map(|side| side.cell as usize)) {
            if mesh.normal_angle(pair[0], pair[1]) > COPLANAR_ANGLE {
                for cell in pair {
                    bent[cell] = true;
                }
            }
        }
        let mut taken = self.taken.clone();
        for band in 0..taken.bands() {
            for cell in (0..bent.len()).filter(|&cell| !bent[cell]) {
                taken.band_mut(band)[space.range(cell)].fill(0.0);
            }
        }
        self.norms_within(&taken)
    }

    /// The norm of a broken function over the cells that are asked of.
    fn norms_within(&self, function: &MultiVector) -> Vec<f64> {
        self.products_within(function, function).into_iter().map(root).collect()
    }

    /// The integrals of the product of two broken functions over the cells that are asked of.
    fn products_within(&self, function: &MultiVector, other: &MultiVector) -> Vec<f64> {
        let weighted = self.system.mass().times(other);
        let cells = || (0..self.solution.space.cells()).filter(|&cell| self.counts(cell));
        let product = |(f, w): (&[f64], &[f64])| -> f64 {
            cells().flat_map(|cell| self.solution.space.range(cell)).map(|k| f[k] * w[k]).sum()
        };
        function.iter_bands().zip(weighted.iter_bands()).map(product).collect()
    }

    /// A third of the points by area, a third by area where the error is asked of, a third by the indicators there.
    fn first_densities(&self) -> [Vec<f64>; 3] {
        let indicated = |cell: usize| {
            let of = |(band, norm): (usize, &f64)| {
                if *norm > 0.0 { self.indicated.band(band)[cell] / norm } else { 0.0 }
            };
            if self.counts(cell) { self.norms.iter().enumerate().map(of).sum::<f64>().powi(2) } else { 0.0 }
        };
        let cells = || 0..self.areas.len();
        let counts = |cell| f64::from(u8::from(self.counts(cell)));
        [vec![1.0; self.areas.len()], cells().map(counts).collect(), cells().map(indicated).collect()]
    }

    /// As many points as it takes, by cell. What the first have seen says where the others are: half of these lie by r²
    /// on cells that have points and around them.
    fn samples(&self, progress: &dyn Progress) -> Result<Vec<Sample>, SolveError> {
        let (first, seed) = (self.sampling.points, hash(self.sampling.seed, 0x0065_7272_6f72));
        let densities = self.first_densities();
        let start = Spread::of(&densities.each_ref().map(Vec::as_slice), &self.areas);
        let mut samples = self.some_samples(first, &start, seed, progress)?;
        let mut batch = 0;
        while samples.len() < MOST_TIMES * first && self.is_vague(&samples) {
            batch += 1;
            samples.sort_by_key(|sample| sample.cell);
            let seen: Vec<_> = self.seen(&samples).into_iter().filter(|&(cell, _)| self.counts(cell)).collect();
            let learnt = carried_around(&self.system.scene.mesh, &seen);
            let spread = Spread::of(&[start.density(), &learnt], &self.areas);
            // Seeds of their own: those of points' rays are hashes of small numbers.
            let seed = hash(hash(seed, u64::MAX), batch);
            samples.extend(self.some_samples(samples.len(), &spread, seed, progress)?);
        }
        samples.sort_by_key(|sample| sample.cell);
        Ok(samples)
    }

    fn some_samples(
        &self,
        points: usize,
        spread: &Spread,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Vec<Sample>, SolveError> {
        let stage = Stage::begin(progress, "at points", points as u64);
        let samples: Result<Vec<Sample>, Interrupted> = (0..points)
            .into_par_iter()
            .map(|k| {
                progress.advance(1);
                if progress.interrupted() { Err(Interrupted) } else { Ok(self.sample(k as u32, points, spread, seed)) }
            })
            .collect();
        drop(stage);
        Ok(samples?)
    }

    /// The k-th of some points: one in each k-th part of the density.
    fn sample(&self, k: u32, points: usize, spread: &Spread, seed: u64) -> Sample {
        let p = point(seed, k);
        let cell = spread.cell((f64::from(k) + p[0]) / points as f64);
        let patch = self.system.scene.mesh.patch(cell);
        let at = patch.shape().uniform([p[1], p[2]]);
        let seeds = [2 * u64::from(k), 2 * u64::from(k) + 1].map(|k| hash(seed, k));
        let [first, second] = self.gathered(cell, &patch, at, seeds);
        let material = self.system.scene.material(cell);
        let site = self.system.scene.site(cell, at);
        let of = |band: usize| {
            let b = self.solution.evaluate(Shown::Radiosity, cell, at, band);
            let (b0, r) = (material.exitance.at(&site, band), material.reflectance.at(&site, band));
            let e = self.solution.evaluate(Shown::Irradiance, cell, at, band);
            let projected = self.solution.space.evaluate(self.reflected.band(band), cell, at);
            [b0 + r * first[band] - b, b0 + r * second[band] - b, b0 + r * e - projected, projected - b]
        };
        let bands = (0..self.solution.bands()).map(of).collect();
        let reflectances: Vec<f64> =
            (0..self.solution.bands()).map(|band| material.reflectance.at(&site, band)).collect();
        let light = || reflectances.iter().zip(first.iter().zip(&second)).map(|(r, (a, b))| 0.5 * r * (a + b)).sum();
        let light = reflectances.iter().any(|&r| r > 0.0).then(light);
        // Reference coordinates are uniform; on a quad that is no parallelogram the points are not.
        let stretch = patch.jacobian(at) * patch.shape().reference_area() / patch.area();
        Sample { cell, area: stretch * spread.area(cell), light, bands }
    }

    /// The irradiance at a point, twice and independently: by the operator if it can, else gathered from all panels.
    fn gathered(&self, cell: usize, patch: &Patch, at: [f64; 2], seeds: [u64; 2]) -> [Vec<f64>; 2] {
        let exchange = &self.system.exchange;
        if let [Some(first), Some(second)] =
            seeds.map(|seed| exchange.irradiance(cell, at, &self.solution.radiosity, seed))
        {
            return [first, second];
        }
        let surface = self.system.scene.mesh.cells[cell].surface;
        self.system.gather(self.solution).independent(patch.point(at), patch.normal(), surface, seeds)
    }

    /// The mean of r² over the points, each standing for its area, and its standard error.
    fn mean_square(&self, samples: &[Sample], band: usize) -> [f64; 2] {
        let n = samples.len().max(1) as f64;
        let squares = || {
            let within = samples.iter().filter(|sample| self.counts(sample.cell));
            within.map(|s| s.area * s.bands[band][0] * s.bands[band][1])
        };
        let mean = squares().sum::<f64>() / n;
        let variance = squares().map(|s| s * s).sum::<f64>() / n - mean * mean;
        [mean, (variance.max(0.0) / n).sqrt()]
    }

    /// Whether more points would tell more, in any band; not where there is no number, which would not become one.
    fn is_vague(&self, samples: &[Sample]) -> bool {
        let bands = || (0..self.solution.bands()).map(|band| (self.mean_square(samples, band), self.norms[band]));
        let too_much = |([mean, deviation], norm): ([f64; 2], f64)| {
            self.sampling.wanted > 0.0 && mean - DEVIATIONS * deviation > (self.sampling.wanted * norm).powi(2)
        };
        let is_little = |([mean, deviation], norm): ([f64; 2], f64)| {
            mean + DEVIATIONS * deviation < (ENOUGH * self.sampling.wanted * norm).powi(2)
        };
        !bands().any(too_much)
            && !bands().all(is_little)
            && bands().any(|([mean, deviation], _)| DEVIATIONS * deviation > PRECISE * mean)
    }

    /// ‖r‖ with three standard errors, and the data's part, per band.
    fn residuals(&self, samples: &[Sample]) -> Vec<[f64; 2]> {
        let within = || samples.iter().filter(|sample| self.counts(sample.cell));
        let of = |band: usize| {
            let [mean, deviation] = self.mean_square(samples, band);
            let data = within().map(|s| s.area * s.bands[band][2].powi(2)).sum::<f64>() / samples.len().max(1) as f64;
            [root(mean + DEVIATIONS * deviation), data.sqrt()]
        };
        (0..self.solution.bands()).map(of).collect()
    }

    /// The mean of r² relative to the norm on each cell with points.
    fn seen(&self, samples: &[Sample]) -> Vec<(usize, f64)> {
        let square = |sample: &Sample| -> f64 {
            let of = |(r, norm): (&[f64; 4], &f64)| if *norm > 0.0 { r[0] * r[1] / (norm * norm) } else { 0.0 };
            sample.bands.iter().zip(&self.norms).map(of).sum::<f64>().max(0.0)
        };
        let cells = samples.chunk_by(|a, b| a.cell == b.cell);
        cells.map(|s| (s[0].cell, s.iter().map(square).sum::<f64>() / s.len() as f64)).collect()
    }

    /// ‖q‖² within, per band: what the error of a sampled operator causes by reflection. The sum of two that are both as large as it
    /// on the average, since one of them may be small by chance.
    fn doubt(&self, spread: &MultiVector, progress: &dyn Progress) -> Result<Vec<f64>, SolveError> {
        let mut squares = vec![0.0; spread.bands()];
        if self.system.exchange.is_symmetric() {
            return Ok(squares);
        }
        let (space, mut flipped) = (&self.solution.space, spread.clone());
        for band in 0..spread.bands() {
            let signs = (0..space.cells()).filter(|&cell| hash(self.sampling.seed, cell as u64).is_multiple_of(2));
            for k in signs.flat_map(|cell| space.range(cell)) {
                flipped.band_mut(band)[k] *= -1.0;
            }
        }
        for error in [spread, &flipped] {
            let caused = self.system.reflections(error, progress)?;
            squares.iter_mut().zip(self.products_within(&caused, &caused)).for_each(|(sum, square)| *sum += square);
        }
        Ok(squares)
    }

    /// ‖p‖² and ⟨r, p⟩ within, per band.
    fn propagated(&self, samples: &[Sample], progress: &dyn Progress) -> Result<Vec<[f64; 2]>, SolveError> {
        let mut residual = self.taken.clone();
        residual.add_scaled(1.0, &part_means(self.system, samples, &self.light, self.sampling.within));
        let p = self.system.reflections(&residual, progress)?;
        let [square, product] = [&p, &residual].map(|other| self.products_within(&p, other));
        Ok(square.into_iter().zip(product).map(|(square, product)| [square, product]).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::root;

    #[test]
    fn an_estimate_that_is_no_number_is_not_0() {
        assert!(root(f64::NAN).is_nan(), "it would pass for a tolerance that is reached");
        assert_eq!([root(4.0), root(-1e-20)], [2.0, 0.0]);
    }
}

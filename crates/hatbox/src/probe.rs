//! The solution at places that a user names: points in space, each with a direction.
//!
//! A point of a measuring grid seldom lies on the mesh to the last bit, and near an edge or a thin wall the nearest
//! surface may be the wrong one. So a point takes the value of the nearest cell whose lit side looks the same way (the
//! cosine of the angle between the normals is at least one half). How far that is, is reported: a point in mid-air still
//! gets a value, and its distance says what the value is worth. Only where no cell at all looks that way there is none. Light
//! that is gathered afresh does not need a surface: points in mid-air are where they are.
//!
//! Beside a hard shadow functions on elements swing below zero. No light does, so that the value is zero there.

use crate::linalg::MultiVector;
use crate::progress::{Interrupted, Progress, Stage};
use crate::quadrature::sequence::hash;
use crate::radiosity::{Direct, Shown, Solution, Sources};
use crate::visibility::Bvh;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeSet, HashMap};

/// Cosine of the greatest angle between a point's normal and that of the cell it belongs to.
const AGREEMENT: f64 = 0.5;

/// Points farther from the surface than this fraction of the scene's diagonal are [`far`](Probed::far).
pub const FAR: f64 = 0.01;
/// A point in front of a surface lies on it if it is no farther than this fraction of the scene's diagonal: a millimetre in a
/// room, a hand in a city.
const ON: f64 = 1e-4;

/// Answers where a point lies on the surfaces of a solution.
pub struct Probe<'a> {
    solution: &'a Solution,
    triangles: Bvh,
    normals: Vec<DVec3>,
}

/// The place on the surfaces that a point belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The cell.
    pub cell: usize,
    /// Reference coordinates in the cell.
    pub at: [f64; 2],
    /// Distance from the point, in metres.
    pub distance: f64,
}

/// Values at points.
#[derive(Debug, Clone, PartialEq)]
pub struct Probed {
    /// E, a row per point; NaN where nothing looks the point's way.
    pub irradiance: MultiVector,
    /// B, likewise.
    pub radiosity: MultiVector,
    /// How many points lie farther than [`FAR`] from the surface that they took the value of.
    pub far: usize,
    /// How many points found no surface.
    pub missed: usize,
}

impl Probed {
    /// None of it below zero.
    fn lit(mut self) -> Self {
        for field in [&mut self.irradiance, &mut self.radiosity] {
            field.as_mut_slice().iter_mut().filter(|value| **value < 0.0).for_each(|value| *value = 0.0);
        }
        self
    }

    /// What is doubtful about the values, a sentence each.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.far > 0 {
            let percent = 100.0 * FAR;
            let far = self.far;
            warnings.push(format!(
                "points farther than {percent} % of the scene's size from the surface whose value they were given: {far}; \
                 gather the light afresh to have it at the points themselves"
            ));
        }
        if self.missed > 0 {
            warnings
                .push(format!("points with a normal that no surface agrees with, and NaN for values: {}", self.missed));
        }
        warnings
    }
}

impl<'a> Probe<'a> {
    /// Prepares the search.
    pub fn new(solution: &'a Solution) -> Self {
        let (mut triangles, mut ids) = (Vec::new(), Vec::new());
        let mut normals = Vec::new();
        for cell in 0..solution.space.cells() {
            let patch = solution.scene.mesh.patch(cell);
            for corners in patch.triangles() {
                triangles.push(corners.map(|k| patch.corners()[k]));
                ids.push(cell as u32);
                normals.push(patch.normal());
            }
        }
        Self { solution, triangles: Bvh::new(&triangles, &ids), normals }
    }

    /// The place that a point with a normal (of any length) belongs to.
    pub fn place(&self, position: DVec3, normal: DVec3) -> Option<Place> {
        let normal = normal.normalize_or_zero();
        let agrees = |triangle: u32| self.normals[triangle as usize].dot(normal) >= AGREEMENT;
        let nearest = self.triangles.nearest_point(position, agrees)?;
        let (_, cell) = self.triangles.triangle(nearest.triangle)?;
        let patch = self.solution.scene.mesh.patch(cell as usize);
        Some(Place { cell: cell as usize, at: patch.locate(nearest.point), distance: nearest.distance })
    }

    /// E and B at points with normals.
    pub fn values(&self, points: &[(DVec3, DVec3)]) -> Probed {
        self.at(&self.places(points)).lit()
    }

    /// The same with the light of lamps as it falls on each point instead of as functions on elements have it: the edges of
    /// shadows are where they are ([`Direct`]). `seed` chooses rays, where any are needed.
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn values_with_direct_light(
        &self,
        points: &[(DVec3, DVec3)],
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Probed, Interrupted> {
        let (places, direct) = (self.places(points), Direct::new(self.solution));
        let cells: BTreeSet<usize> = places.iter().flatten().map(|place| place.cell).collect();
        let stage = Stage::begin(progress, "direct light", (cells.len() + places.len()) as u64);
        let go_on = || {
            progress.advance(1);
            if progress.interrupted() { Err(Interrupted) } else { Ok(()) }
        };
        let project = |cell: usize| go_on().map(|()| (cell, direct.projected(cell)));
        let projected: HashMap<usize, _> = cells.into_par_iter().map(project).collect::<Result<_, _>>()?;
        let correct = |place: &Option<Place>| {
            let of = |place: Place| direct.correction(place.cell, place.at, &projected[&place.cell], seed);
            go_on().map(|()| place.map(of))
        };
        let corrections: Vec<_> = places.par_iter().map(correct).collect::<Result<_, _>>()?;
        drop(stage);
        let mut probed = self.at(&places);
        let found = places.iter().zip(&corrections).enumerate();
        for (row, place, correction) in found.filter_map(|(row, (place, c))| Some((row, (*place)?, c.as_ref()?))) {
            for (band, light) in correction.iter().enumerate() {
                let e = &mut probed.irradiance.band_mut(band)[row];
                *e += light;
                probed.radiosity.band_mut(band)[row] = self.reflected(place, band, *e);
            }
        }
        Ok(probed.lit())
    }

    /// The same with all light as it falls on each point, gathered from every surface of the solution: I. H. Sloan's iterate,
    /// the most accurate value that a solution has for a point ([`Sources`]). It takes a visit of every surface for every
    /// point. `seed` chooses rays, where any are needed.
    ///
    /// A point in front of every surface that looks its way, farther than a ten-thousandth of the scene's diagonal, is where it is, as
    /// on a work plane: E is what arrives there on a small area with that normal, and there is no B. One that is behind a surface
    /// is on it up to [`FAR`].
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn values_gathered(
        &self,
        points: &[(DVec3, DVec3)],
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Probed, Interrupted> {
        let (mut places, sources) = (self.places(points), Sources::all(self.solution));
        let limits = [ON, FAR].map(|share| self.limit(share));
        for (place, (x, _)) in places.iter_mut().zip(points) {
            *place = place.filter(|place| self.is_on(*place, *x, limits));
        }
        let stage = Stage::begin(progress, "gathering", places.len() as u64);
        let light = |(row, place): (usize, &Option<Place>)| {
            progress.advance(1);
            let seed = hash(seed, row as u64);
            let (x, n) = (points[row].0, points[row].1.try_normalize());
            let light = match place {
                Some(place) => Some(sources.irradiance(place.cell, place.at, seed)),
                None => n.map(|n| sources.irradiance_in_the_air(x, n, seed)),
            };
            if progress.interrupted() { Err(Interrupted) } else { Ok(light) }
        };
        let lights: Vec<_> = places.par_iter().enumerate().map(light).collect::<Result<_, _>>()?;
        drop(stage);
        let mut probed = self.at(&places);
        probed.missed = lights.iter().filter(|light| light.is_none()).count();
        for (row, (place, light)) in places.iter().zip(lights).enumerate() {
            for (band, e) in light.into_iter().flatten().enumerate() {
                probed.irradiance.band_mut(band)[row] = e;
                if let Some(place) = place {
                    probed.radiosity.band_mut(band)[row] = self.reflected(*place, band, e);
                }
            }
        }
        Ok(probed.lit())
    }

    /// B⁰ + R E at a place.
    fn reflected(&self, place: Place, band: usize, irradiance: f64) -> f64 {
        let scene = &self.solution.scene;
        let (material, site) = (scene.material(place.cell), scene.site(place.cell, place.at));
        material.leaving(&site, band, irradiance)
    }

    /// Whether a point lies on the cell that it belongs to, and not in the air in front of it.
    fn is_on(&self, place: Place, x: DVec3, [before, behind]: [f64; 2]) -> bool {
        let patch = self.solution.scene.mesh.patch(place.cell);
        let is_behind = patch.normal().dot(x - patch.point(place.at)) <= 0.0;
        place.distance <= if is_behind { behind } else { before }
    }

    /// A share of the scene's diagonal.
    fn limit(&self, share: f64) -> f64 {
        let (low, high) = self.solution.scene.mesh.bounds();
        share * low.distance(high)
    }

    fn places(&self, points: &[(DVec3, DVec3)]) -> Vec<Option<Place>> {
        points.iter().map(|&(position, normal)| self.place(position, normal)).collect()
    }

    /// E and B at places, as the functions have them.
    fn at(&self, places: &[Option<Place>]) -> Probed {
        let limit = self.limit(FAR);
        let field = |shown| {
            MultiVector::from_fn(places.len(), self.solution.bands(), |row, band| {
                places[row].map_or(f64::NAN, |place| self.solution.evaluate(shown, place.cell, place.at, band))
            })
        };
        Probed {
            irradiance: field(Shown::Irradiance),
            radiosity: field(Shown::Radiosity),
            far: places.iter().flatten().filter(|place| place.distance > limit).count(),
            missed: places.iter().filter(|place| place.is_none()).count(),
        }
    }
}

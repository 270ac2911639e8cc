//! Which kind of operator suits a problem: what all pairs would cost, against what rays would.
//!
//! A pair of cells that see each other fully takes a microsecond; one with something between a hundred, since what is visible
//! is cut out (36 in the Cornell box, 170 among furniture); and eight times that if one of them shines and so counts more:
//! nearly all that are partly hidden in a city under its sky. Where cells are faces of their own nothing is proven of many pairs at
//! once, and each takes five more, however clear. How many of these there are is asked of some pairs with a few
//! segments each.
//!
//! A limit of coefficients alone was tried: 3000 elements among small things take 97 seconds for what rays do in two, and as
//! many in an empty room take three.

use super::{ALL, Dense, Geometry, Kind, MOST_WITH_RAYS, Params, Sampled, sampled, size};
use crate::mesh::Patch;
use crate::quadrature::sequence::{hash, point, unit};
use crate::scene::Scene;
use crate::visibility::{Bvh, Visibility};
use glam::DVec3;
use rayon::prelude::*;

/// CPU seconds of a pair of linear cells that is clear, of one that is partly hidden, and of a ray with all that is done with it
/// (`cargo bench -p hatbox --bench operators -- choice`).
const CLEAR: f64 = 0.7e-6;
const PARTIAL: f64 = 100e-6;
/// The same if one of the pair counts more, since it shines: its shadows are cut out wherever they are seen. From one scene, the
/// city.
const PARTIAL_LIT: f64 = 800e-6;
const RAY: f64 = 1e-6;
/// What a clear pair takes besides if every cell is a face of its own, as on a terrain: what stands between is then asked for each. From
/// one scene, a spherical bowl.
const ALONE: f64 = 5e-6;
/// CPU seconds of a byte of the table of all pairs: to fill it, and to read it in some twenty products. A guess from one scene, a
/// room with a sphere of very many faces, of which none sees another.
const BYTE: f64 = 5e-9;
/// All pairs, which leave no noise, are worth so many CPU seconds.
const PATIENCE: f64 = 25.0;
/// Pairs that are looked at, and segments between the cells of each.
const PAIRS: u32 = 2048;
const SEGMENTS: u32 = 8;

/// What [`choose`] chooses, made when the space is known.
pub static AUTO: Kind = Kind {
    name: "auto",
    summary: "all pairs if they take few seconds or less than rays, and fit into the memory; else rays",
    looseness: 1.0,
    slack: 1.0,
    growth: 2.0,
    most_coefficients: MOST_WITH_RAYS,
    most_growth: 2.0,
    build: |geometry, params, progress| (choose(&Problem::of(geometry, params)).0.build)(geometry, params, progress),
};

/// What is to be solved.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The scene, subdivided.
    pub scene: &'a Scene,
    /// The faces of the input.
    pub blockers: &'a Bvh,
    /// How strongly light from each cell counts, as in [`Params::strengths`].
    pub strengths: &'a [f64],
    /// Coefficients of the broken space.
    pub coefficients: usize,
    /// The relative error that rays may have.
    pub tolerance: f64,
    /// Bytes that the operator may store.
    pub memory: usize,
}

impl<'a> Problem<'a> {
    /// That of an operator with these parameters.
    pub fn of(geometry: &Geometry<'a>, params: &'a Params) -> Self {
        Self {
            scene: geometry.scene,
            blockers: geometry.blockers,
            strengths: &params.strengths,
            coefficients: geometry.space.broken_dofs(),
            tolerance: params.tolerance,
            memory: params.memory,
        }
    }
}

/// The kind for a problem, and why.
pub fn choose(problem: &Problem<'_>) -> (&'static Kind, String) {
    let named = |name| ALL.iter().find(|kind| kind.name == name).unwrap_or(&ALL[0]);
    let bytes = Dense::bytes(problem.coefficients);
    if bytes > problem.memory {
        let [needed, allowed] = [bytes, problem.memory].map(size);
        return (named(Sampled::NAME), format!("all pairs would take {needed}, more than the {allowed} allowed"));
    }
    let mesh = &problem.scene.mesh;
    let pairs = 0.5 * (mesh.cells.len() as f64).powi(2);
    let [clear, partial, lit] = shares(problem);
    let entries = (problem.coefficients as f64 / mesh.cells.len() as f64 / 3.0).powi(2);
    let alone = (problem.scene.surfaces.len() as f64 / mesh.cells.len() as f64).min(1.0);
    let clear = (CLEAR * entries + ALONE * alone) * clear;
    let all_pairs = BYTE * bytes as f64 + pairs * (clear + PARTIAL * partial + PARTIAL_LIT * lit);
    let rays = RAY * mesh.cells.len() as f64 * f64::from(sampled::rays_for(problem.tolerance, 1.0));
    let [seconds, with_rays] = [all_pairs, rays].map(|seconds| format!("{:.0} CPU seconds", seconds.max(1.0)));
    let hidden = format!("{:.0} % of them partly hidden", 100.0 * (partial + lit));
    if all_pairs <= PATIENCE.max(rays) {
        (named(Dense::NAME), format!("all pairs, {hidden}, take about {seconds}"))
    } else {
        (named(Sampled::NAME), format!("all pairs, {hidden}, would take about {seconds}, rays {with_rays}"))
    }
}

impl Kind {
    /// The kind itself, or if it is [`AUTO`] the one that it [chooses](choose), and why.
    pub fn chosen(&'static self, problem: &Problem<'_>) -> (&'static Self, Option<String>) {
        if self.name != AUTO.name {
            return (self, None);
        }
        let (kind, why) = choose(problem);
        (kind, Some(why))
    }
}

/// Of all pairs of cells, the shares of those that see each other, of those that something hides a part of, and of those of
/// which one shines besides, as some of them have it.
fn shares(problem: &Problem<'_>) -> [f64; 3] {
    let Problem { blockers, strengths, .. } = problem;
    let (mesh, cells) = (&problem.scene.mesh, problem.scene.mesh.cells.len() as f64);
    let look = |pair: u32| -> [u32; 3] {
        let ends = [0, 1].map(|end| (unit(hash(end, u64::from(pair))) * cells) as usize);
        let [a, b] = ends.map(|cell| mesh.patch(cell));
        let sees = |from: &Patch, to: DVec3| from.normal().dot(to - from.center()) > 0.0;
        let surfaces = ends.map(|cell| mesh.cells[cell].surface);
        let segment = |k: u32| {
            let [u, v, s, t] = point(hash(2, u64::from(pair)), k);
            let (x, y) = (a.point(a.shape().uniform([u, v])), b.point(b.shape().uniform([s, t])));
            let faces = sees(&a, y) && sees(&b, x);
            faces.then(|| blockers.occluded(x, y, surfaces))
        };
        let found: Vec<bool> = (0..SEGMENTS).filter_map(segment).collect();
        let [free, hidden] = [false, true].map(|hidden| found.contains(&hidden));
        let shines = ends.into_iter().any(|cell| strengths.get(cell).is_some_and(|&strength| strength > 1.0));
        [free && !hidden, free && hidden && !shines, free && hidden && shines].map(u32::from)
    };
    let sum = |a: [u32; 3], b: [u32; 3]| [0, 1, 2].map(|k| a[k] + b[k]);
    let sums = (0..PAIRS).into_par_iter().map(look).reduce(|| [0; 3], sum);
    sums.map(|sum| f64::from(sum) / f64::from(PAIRS))
}

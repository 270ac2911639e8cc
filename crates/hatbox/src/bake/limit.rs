//! The solution without ringing: what is shown and exported next to a hard shadow.
//!
//! The best approximation of a jump by hat functions over- and undershoots it, on any mesh: dark spots at the foot of a
//! block, values below zero in its shadow. For output, where plausible beats optimal, three steps remove that and leave
//! the power of every joined surface as it was:
//!
//! 1. B becomes Δ⁻¹(b⁰ + M_R e) in the *broken* space, the solution reflected once more. It has the same power (that is
//!    Galerkin's equation, tested with 1), and its cells do not yet share in their neighbours' jumps.
//! 2. Each cell's function is drawn towards its mean, u ← m + θ(u − m), until its corners lie between the means of the
//!    cells around each (D. Kuzmin, "A vertex-based hierarchical slope limiter for p-adaptive discontinuous Galerkin
//!    methods", J. Comput. Appl. Math. 233, 2010), and until it is nowhere negative (X. Zhang, C.-W. Shu, J. Comput. Phys.
//!    229, 2010). At the border of a surface there are no cells beyond, and the means of those before say too little: a
//!    plane through them is continued to the corner, and once more as far. So linear functions stay as they are.
//! 3. Where functions are joined, coefficients that are to be one become their mean with the weights ∫N_k.
//!
//! Tried and dropped: limiting the joined function itself (its means already ring: some are negative), and the lumped
//! projection ∫u N_v/∫N_v onto hats (at borders it takes the value half a cell inside).

use crate::assemble::{load, mass, weighted_mass};
use crate::element::{ALL, Element, Entity};
use crate::linalg::{Csr, LinearOperator, MultiVector};
use crate::mesh::UnionFind;
use crate::radiosity::Solution;
use crate::space::{CREASE_ANGLE, Continuity, FunctionSpace};
use glam::{DMat3, DVec3};

/// A plane through means is not trusted if the points of its cells are closer to a line than this (relative).
const FLAT: f64 = 1e-6;

/// A negative value smaller than the greatest by this factor is zero.
const ROUNDING: f64 = 1e-14;

/// The solution limited: B and E as above, with the same power on every joined surface, nowhere negative where their mean
/// over the surface is not, and between their neighbours' means.
pub fn limited(solution: &Solution) -> Solution {
    let (scene, space) = (&solution.scene, &solution.space);
    let mass = mass(scene, space);
    let mut radiosity = weighted_mass(scene, space).times(&solution.irradiance);
    radiosity.add_scaled(1.0, &load(scene, space));
    let limiter = Limiter::new(solution, &mass.times(&MultiVector::uniform(space.broken_dofs(), &[1.0])));
    let radiosity = match mass.inverse() {
        Some(inverse) => inverse.times(&radiosity),
        None => solution.radiosity.clone(),
    };
    Solution {
        radiosity: limiter.apply(&radiosity),
        irradiance: limiter.apply(&solution.irradiance),
        scene: scene.clone(),
        space: space.clone(),
    }
}

/// The joined corners of the mesh, and what bounds the values there.
struct Limiter<'a> {
    space: &'a FunctionSpace,
    /// ∫N_k of each broken coefficient.
    weights: Vec<f64>,
    areas: Vec<f64>,
    centers: Vec<DVec3>,
    /// The joined corner that each corner of a cell is.
    corners: Vec<Vec<usize>>,
    /// The cells around each joined corner, ascending.
    around: Vec<Vec<u32>>,
    /// Where each joined corner is.
    positions: Vec<DVec3>,
    /// The joined surface of each cell, named by one of its cells.
    patches: Vec<usize>,
}

/// What values may lie between.
type Bounds = (f64, f64);

impl<'a> Limiter<'a> {
    fn new(solution: &'a Solution, weights: &MultiVector) -> Self {
        let (space, mesh) = (&solution.space, &solution.scene.mesh);
        let cells = space.cells();
        // Corners are joined as hats on this mesh would be, whatever the basis.
        let hats = FunctionSpace::new(&solution.scene, &ALL[2], Continuity::Continuous { crease_angle: CREASE_ANGLE });
        let joined = hats.ok().and_then(|hats| hats.continuity().map(|c| (corner_sets(&hats, c), c.cols())));
        let (corners, sets) = joined.unwrap_or_default();
        let mut around = vec![Vec::new(); sets];
        let mut positions = vec![DVec3::ZERO; sets];
        let mut patches = UnionFind::new(cells);
        for (cell, corners) in corners.iter().enumerate() {
            for (&corner, &position) in corners.iter().zip(mesh.patch(cell).corners()) {
                positions[corner] = position;
                if around[corner].last() != Some(&(cell as u32)) {
                    around[corner].push(cell as u32);
                }
                patches.join(around[corner][0] as usize, cell);
            }
        }
        Self {
            weights: weights.band(0).to_vec(),
            areas: (0..cells).map(|cell| weights.band(0)[space.range(cell)].iter().sum()).collect(),
            centers: (0..cells).map(|cell| mesh.patch(cell).center()).collect(),
            patches: (0..cells).map(|cell| patches.find(cell)).collect(),
            space,
            corners,
            around,
            positions,
        }
    }

    /// Limits every band of a broken function.
    fn apply(&self, function: &MultiVector) -> MultiVector {
        let mut result = function.clone();
        for band in 0..function.bands() {
            let values = result.band_mut(band);
            let means = self.lift_means(values);
            let bounds: Vec<Bounds> = (0..self.around.len()).map(|corner| self.bounds(corner, &means)).collect();
            self.limit(values, &means, Some(&bounds));
            if let Some(c) = self.space.continuity() {
                self.join(values, c);
                // Joining quadratics may take them below zero between their nodes again.
                self.limit(values, &self.means(values), None);
            }
        }
        result
    }

    fn means(&self, values: &[f64]) -> Vec<f64> {
        let integral = |cell: usize| self.space.range(cell).map(|k| self.weights[k] * values[k]).sum::<f64>();
        (0..self.space.cells()).map(|cell| integral(cell) / self.areas[cell]).collect()
    }

    /// The cells' means, none below zero: what one lacks, all of its surface give in proportion to what they have.
    fn lift_means(&self, values: &mut [f64]) -> Vec<f64> {
        let mut means = self.means(values);
        if means.iter().all(|&mean| mean >= 0.0) {
            return means;
        }
        let mut power = vec![[0.0; 2]; means.len()];
        for (cell, mean) in means.iter().enumerate() {
            power[self.patches[cell]][usize::from(*mean < 0.0)] += mean * self.areas[cell];
        }
        for (cell, mean) in means.iter_mut().enumerate() {
            let [above, below] = power[self.patches[cell]];
            // A surface that is negative on the whole stays as it is: there is nothing to take from.
            if below == 0.0 || above + below < 0.0 {
                continue;
            }
            let lifted = if *mean < 0.0 { 0.0 } else { *mean * (above + below) / above };
            for value in &mut values[self.space.range(cell)] {
                *value += lifted - *mean;
            }
            *mean = lifted;
        }
        means
    }

    /// The least and greatest value that a function may have at a joined corner.
    fn bounds(&self, corner: usize, means: &[f64]) -> Bounds {
        let star = self.around[corner].iter().map(|&cell| means[cell as usize]);
        let (least, greatest) = star.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), m| (a.min(m), b.max(m)));
        match self.continued(corner, means) {
            None => (0.0, f64::INFINITY),
            Some(p) if p < least => (2.0 * p - least, greatest),
            Some(p) if p > greatest => (least, 2.0 * p - greatest),
            Some(_) => (least, greatest),
        }
    }

    /// The value at a corner of the plane that fits the means of the cells around it and of those around them.
    fn continued(&self, corner: usize, means: &[f64]) -> Option<f64> {
        let star = &self.around[corner];
        let mut near: Vec<u32> = star
            .iter()
            .flat_map(|&cell| &self.corners[cell as usize])
            .flat_map(|&corner| self.around[corner].iter().copied())
            .collect();
        near.sort_unstable();
        near.dedup();
        let origin = self.positions[corner];
        let farthest = near.iter().map(|&c| self.centers[c as usize].distance(origin)).fold(0.0, f64::max);
        let mut frame = DMat3::ZERO;
        let [first, second] = self.tangents(star, origin)?;
        let mut right = DVec3::ZERO;
        for &cell in &near {
            let offset = (self.centers[cell as usize] - origin) / farthest;
            let row = DVec3::new(1.0, offset.dot(first), offset.dot(second));
            frame += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
            right += row * means[cell as usize];
        }
        let scale = near.len() as f64;
        (frame.determinant() > FLAT * scale.powi(3)).then(|| (frame.inverse() * right).x)
    }

    /// Two directions along the surface at a corner.
    fn tangents(&self, star: &[u32], origin: DVec3) -> Option<[DVec3; 2]> {
        let offsets = || star.iter().map(|&cell| self.centers[cell as usize] - origin);
        let first = offsets().next()?.try_normalize()?;
        let across = |v: DVec3| v - first * v.dot(first);
        let widest = offsets().map(across).max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?;
        // A corner of one cell only: its own corners tell the plane.
        let mut own = self.corners[star[0] as usize].iter().map(|&corner| across(self.positions[corner] - origin));
        let second = widest.try_normalize().or_else(|| own.find_map(DVec3::try_normalize))?;
        Some([first, second])
    }

    /// Draws every cell's function towards its mean.
    fn limit(&self, values: &mut [f64], means: &[f64], bounds: Option<&[Bounds]>) {
        for (cell, &mean) in means.iter().enumerate() {
            let element = self.space.element(cell);
            let values = &mut values[self.space.range(cell)];
            let mut theta = 1.0_f64;
            if let Some(bounds) = bounds {
                for (k, node) in element.nodes.iter().enumerate() {
                    let (least, greatest) = self.node_bounds(cell, node.on, bounds);
                    theta = theta.min(share(values[k] - mean, (least - mean).min(0.0), (greatest - mean).max(0.0)));
                }
            }
            let lowest = least_of(element, values);
            theta = theta.min(share(lowest - mean, (-mean).min(0.0), f64::INFINITY));
            if theta < 1.0 {
                for value in values.iter_mut() {
                    *value = mean + theta * (*value - mean);
                }
            }
        }
        // What rounding has left below zero.
        let greatest = values.iter().fold(0.0, |a: f64, value| a.max(value.abs()));
        values
            .iter_mut()
            .filter(|value| **value < 0.0 && **value > -ROUNDING * greatest)
            .for_each(|value| *value = 0.0);
    }

    fn node_bounds(&self, cell: usize, on: Entity, bounds: &[Bounds]) -> Bounds {
        let Some(corners) = self.corners.get(cell) else { return (f64::NEG_INFINITY, f64::INFINITY) };
        let at = |k: usize| bounds[corners[k % corners.len()]];
        match on {
            Entity::Corner(k) => at(k),
            Entity::Edge(k) => {
                let ((a, b), (c, d)) = (at(k), at(k + 1));
                (a.min(c), b.max(d))
            }
            Entity::Interior => (f64::NEG_INFINITY, f64::INFINITY),
        }
    }

    /// Gives coefficients that are to be one their weighted mean; those without weight count by area.
    fn join(&self, values: &mut [f64], c: &Csr) {
        let weight = |cell: usize, dof: usize| {
            let weight = self.weights[dof].max(0.0);
            if weight < 1e-12 * self.areas[cell] { 0.0 } else { weight }
        };
        let weighted = self.space.sums(c, values, weight);
        let by_area = self.space.sums(c, values, |cell, _| self.areas[cell]);
        let mean = |unknown: usize| {
            let [sum, weight] = if weighted[unknown][1] > 0.0 { weighted[unknown] } else { by_area[unknown] };
            sum / weight
        };
        for (dof, value) in values.iter_mut().enumerate() {
            *value = c.row(dof).map(|(unknown, share)| share * mean(unknown)).sum();
        }
    }
}

/// For each cell, the unknown at each of its corners.
fn corner_sets(hats: &FunctionSpace, c: &Csr) -> Vec<Vec<usize>> {
    let unknown = |dof: usize| c.row(dof).next().map_or(0, |(unknown, _)| unknown);
    (0..hats.cells()).map(|cell| hats.range(cell).map(unknown).collect()).collect()
}

/// The greatest θ ≤ 1 for which θ × `deviation` lies between `least` ≤ 0 and `greatest` ≥ 0.
fn share(deviation: f64, least: f64, greatest: f64) -> f64 {
    if deviation < least {
        least / deviation
    } else if deviation > greatest {
        greatest / deviation
    } else {
        1.0
    }
}

/// A lower bound of an element's function: its least coefficient in the basis of Bernstein.
fn least_of(element: &Element, values: &[f64]) -> f64 {
    let corners = element.shape.corners();
    let bernstein = |(k, value): (usize, &f64)| match element.nodes[k].on {
        Entity::Edge(edge) => 2.0 * value - 0.5 * (values[edge] + values[(edge + 1) % corners]),
        _ => *value,
    };
    values.iter().enumerate().map(bernstein).fold(f64::INFINITY, f64::min)
}

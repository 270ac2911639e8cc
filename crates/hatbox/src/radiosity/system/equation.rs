//! The equation of a system, for each kind of solver.

use super::super::operators::{Arriving, Equation, InverseMass, Reflection, ScaledInverse, Symmetric, Transport};
use super::super::products::Products;
use super::super::search::{FARTHEST, Search, reflected_exactly};
use super::{NUMBERS_OF_NOISE, ROUGH_MASS_TOLERANCE, Solution, System};
use crate::exchange::Exchange;
use crate::linalg::{LinearOperator, MultiVector};
use crate::progress::Progress;
use crate::scene::Material;
use crate::solve::{self, Info, SolveError, cg, neumann};
use std::borrow::Cow;
use std::sync::Arc;

impl System {
    /// Light that is reflected once, twice, …
    pub(super) fn solve_by_bounces(
        &self,
        load: &MultiVector,
        params: &solve::Params,
        progress: &dyn Progress,
    ) -> Result<(Solution, Info), SolveError> {
        let seen = self.arriving(progress);
        let reflection = self.reflection();
        let transport = Transport { join: &self.join, seen: &seen, reflection: &reflection };
        let right_side = self.join.collect(Cow::Borrowed(load));
        let mut b = self.inverse_mass().times(&right_side);
        let found = neumann(&self.inverse_mass(), &transport, &right_side, &mut b, params, progress);
        let info = seen.unless_interrupted(found)?;
        Ok((self.solution(self.join.spread(Cow::Owned(b)).into_owned(), progress)?, info))
    }

    /// By minimal residuals, for what is reflected of an emission: the residual is relative to the first bounce, however bright
    /// the lamps. A search for what a sampled S makes of it begins with what is `known` of S, and gives what it has learnt, in so
    /// many bytes.
    pub(super) fn solve_reflected(
        &self,
        emission: MultiVector,
        known: &Products,
        bytes: usize,
        params: &solve::Params,
        progress: &dyn Progress,
    ) -> Result<(Solution, Info, Products), SolveError> {
        let seen = self.arriving(progress);
        let found = self.sought(&seen, (emission, known, bytes), params, progress);
        let (b, arrived, info, products) = seen.unless_interrupted(found)?;
        let (solution, steady) =
            self.solution_of(self.join.spread(Cow::Owned(b)).into_owned(), arrived, self.collects());
        Ok((self.without_noise(solution, steady, NUMBERS_OF_NOISE), info, products))
    }

    /// B as a joined function, and what arrives of it.
    fn sought(
        &self,
        seen: &Arriving<'_>,
        (emission, known, bytes): (MultiVector, &Products, usize),
        params: &solve::Params,
        progress: &dyn Progress,
    ) -> Result<(MultiVector, MultiVector, Info, Products), SolveError> {
        let reflection = self.reflection();
        let transport = Transport { join: &self.join, seen, reflection: &reflection };
        let equation = Equation::new(self.joined_mass(), transport);
        let roots = Arc::clone(&equation.roots);
        let inverse =
            |tolerance| ScaledInverse { inverse: InverseMass { tolerance, ..self.inverse_mass() }, roots: &roots };
        let preconditioner = inverse(1e-2 * params.tolerance);
        if self.exchange.is_symmetric() || params.tolerance < FARTHEST {
            let (b, arrived, info) = reflected_exactly(&equation, &preconditioner, emission, params, progress)?;
            return Ok((b, arrived, info, Products::default()));
        }
        let mut search = Search::new(equation, emission, known, bytes, params.restart);
        let scales = search.first_bounce();
        // Directions of a search need not be the same function of what is left each time.
        let rough = inverse(ROUGH_MASS_TOLERANCE);
        let mut info = solve::search(&mut search, &rough, scales, params, progress)?;
        if info.residual > params.tolerance {
            info = search.finish_by_gmres(&info, &preconditioner, params, progress)?;
        } else {
            info.residual = search.balance(params.tolerance);
        }
        let (b, arrived, products) = search.finish();
        Ok((b, arrived, info, products))
    }

    /// Bytes that products may take: half of what the operator does, if it has left as much.
    pub(super) fn most_products(&self) -> usize {
        self.spare.min(self.exchange.statistics().bytes / 2)
    }

    /// What arrives, as [`reflection`](Self::reflection) wants it.
    fn arriving<'a>(&'a self, progress: &'a dyn Progress) -> Arriving<'a> {
        Arriving::new(&self.join, &*self.exchange, self.collects(), progress)
    }

    pub(super) fn solve_symmetric(
        &self,
        load: &MultiVector,
        root: &MultiVector,
        params: &solve::Params,
        progress: &dyn Progress,
    ) -> Result<(Solution, Info), SolveError> {
        let symmetric = Symmetric { mass: self.joined_mass(), exchange: &*self.exchange, root };
        let emission = self.join.spread(Cow::Owned(self.emission_of(load))).into_owned();
        let right_side = symmetric.reflected(&emission);
        let mut c = MultiVector::zeros(right_side.rows(), right_side.bands());
        let info = cg(&symmetric, &self.inverse_mass(), &right_side, &mut c, params, progress)?;
        let mut radiosity = symmetric.scaled(&c);
        radiosity.add_scaled(1.0, &emission);
        Ok((self.solution(radiosity, progress)?, info))
    }

    fn reflection(&self) -> Reflection {
        if !self.collects() {
            return Reflection::Broken(self.weighted_mass().product(&self.mass_inverse));
        }
        let mut materials = vec![0; self.space.dofs()];
        for (cell, of_cell) in self.scene.mesh.cells.iter().enumerate() {
            let unknowns = self.space.range(cell).flat_map(|dof| self.space.unknowns_of(dof));
            unknowns.for_each(|(unknown, _)| materials[unknown] = of_cell.material);
        }
        let mut reflectance = MultiVector::zeros(materials.len(), self.scene.bands);
        for band in 0..self.scene.bands {
            let of = |material: &Material| material.reflectance.uniform(band).unwrap_or(0.0);
            let known: Vec<f64> = self.scene.materials.iter().map(of).collect();
            reflectance
                .band_mut(band)
                .iter_mut()
                .zip(&materials)
                .for_each(|(r, &material)| *r = known[material as usize]);
        }
        Reflection::Joined(reflectance)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::Options;
    use super::super::super::products::{Product, round};
    use super::*;
    use crate::element::{ALL, Basis, Shape};
    use crate::exchange;
    use crate::linalg::dot;
    use crate::mesh::{Cell, Mesh, Refinement};
    use crate::progress::Silent;
    use crate::scene::{Physics, Quantity, Scene, Site};
    use glam::DVec3;

    /// A floor below a lamp, in three bands, and a smaller square between.
    fn squares(reflectance: Quantity) -> Scene {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let square = |(size, z): (f64, f64)| corners.map(|[x, y]| DVec3::new(size * x, size * y, z));
        let vertices = [(1.0, 0.0), (1.0, 1.0), (0.6, 0.4)].into_iter().flat_map(square).collect();
        let cell = |vertices, surface| {
            let material = u32::from(surface == 1);
            Cell { shape: Shape::Quad, vertices, material, group: 0, surface }
        };
        let cells = vec![cell([0, 1, 2, 3], 0), cell([4, 7, 6, 5], 1), cell([8, 9, 10, 11], 2)];
        let mesh = Mesh { vertices, cells, groups: vec![String::new()], ..Mesh::default() };
        let floor = Material { reflectance, ..Material::diffuse("floor", 0.0) };
        let lamp = Material { exitance: Quantity::Uniform(vec![1.0, 2.0, 3.0]), ..Material::diffuse("lamp", 0.2) };
        Scene::new(mesh, vec![floor, lamp], Physics::Light, None).expect("valid")
    }

    fn system(basis: &'static Basis, reflectance: Quantity) -> System {
        let options = Options {
            basis,
            operator: exchange::kind("sampled").expect("a kind"),
            refinement: Refinement::Elements(9000),
            tolerance: 0.1,
            ..Options::default()
        };
        System::build(&squares(reflectance), &options, &Silent).expect("built")
    }

    /// All bands, two and one, one by one.
    #[test]
    fn noise_is_the_same_however_many_bands_are_looked_at() {
        let system = system(&ALL[1], Quantity::gray(0.5));
        let rows = system.space.broken_dofs();
        let radiosity = system.projected_emission();
        let arrived = system.exchange.times(&radiosity);
        let (noisy, steady) = system.solution_of(radiosity, arrived, false);
        let without = |numbers| system.without_noise(noisy.clone(), steady.clone(), numbers).irradiance;
        let all = without(3 * rows);
        assert_ne!(all, noisy.irradiance);
        for few in [without(0), without(2 * rows)] {
            let off = all.as_slice().iter().zip(few.as_slice()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-12, "{off:e}");
        }
    }

    /// More rows than are worked on at a time, of each kind of mass and of reflection.
    #[test]
    fn what_a_search_makes_of_what_is_known_is_the_operator() {
        let varying = |site: &Site, band: usize| 0.2 + 0.4 * site.position.x + 0.1 * band as f64;
        for (basis, varies) in [(0, false), (0, true), (1, false), (1, true)] {
            let reflectance =
                if varies { Quantity::Function(Arc::new(varying)) } else { Quantity::Uniform(vec![0.3, 0.6, 0.4]) };
            let system = system(&ALL[basis], reflectance);
            assert_eq!(system.space.continuity().is_some(), basis == 1);
            let (seen, reflection) = (system.arriving(&Silent), system.reflection());
            let transport = Transport { join: &system.join, seen: &seen, reflection: &reflection };
            let equation = Equation::new(system.joined_mass(), transport);
            // What is rounded is so.
            let x = |row: usize, band: usize| ((7 * row + 3 * band) % 11) as f64 - 5.0;
            let x = MultiVector::from_fn(equation.cols(), 3, x);
            let products = Product::of_bands(&x, &seen.times(&x));
            assert!(equation.rows() > 4000, "{}", equation.rows());
            for band in 0..3 {
                // The functions of all bands, as if they were of this one.
                let x = [0, 1, 2].map(|of: usize| MultiVector::from_fn(x.rows(), 3, |row, _| x.band(of)[row]));
                let of_band = equation.of_band(band, &products);
                assert_eq!(of_band.len(), 3);
                for (x, (found, sum)) in x.iter().zip(of_band) {
                    let made = equation.times(x);
                    let made = made.band(band);
                    let off: Vec<f64> = made.iter().zip(found).map(|(a, b)| a - f64::from(b)).collect();
                    assert!(dot(&off, &off) < 1e-12 * dot(made, made), "{basis} {varies} {band}");
                    // The sum is that of what is kept, to the last digits.
                    let mut image = seen.times(x);
                    round(&mut image);
                    let total = |x: &MultiVector, weights: &[f64]| dot(x.band(band), weights);
                    let own = total(&system.joined_mass().times(x), &vec![1.0; x.rows()]);
                    let exact = own - total(&equation.first_bounce(image), &equation.roots);
                    let scale = dot(made, made).sqrt();
                    assert!((sum - exact).abs() < 1e-12 * scale, "{basis} {varies} {band}: {sum} {exact} {scale}");
                }
            }
        }
    }
}

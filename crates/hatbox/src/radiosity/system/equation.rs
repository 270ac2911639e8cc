//! The equation of a system, for each kind of solver.

use super::super::operators::{Arriving, Equation, InverseMass, Reflection, ScaledInverse, Symmetric, Transport};
use super::super::products::Products;
use super::super::search::{FARTHEST, Room, Search, reflected_exactly};
use super::{ROUGH_MASS_TOLERANCE, Solution, System};
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
        let seen = self.arriving();
        let reflection = self.reflection();
        let transport = Transport { join: &self.join, seen: &seen, reflection: &reflection };
        let right_side = self.join.collect(Cow::Borrowed(load));
        let mut b = self.inverse_mass().times(&right_side);
        let info = neumann(&self.inverse_mass(), &transport, &right_side, &mut b, params, progress)?;
        Ok((self.solution(self.join.spread(Cow::Owned(b)).into_owned()), info))
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
        let seen = self.arriving();
        let reflection = self.reflection();
        let transport = Transport { join: &self.join, seen: &seen, reflection: &reflection };
        let equation = Equation::new(self.joined_mass(), transport);
        let roots = Arc::clone(&equation.roots);
        let inverse =
            |tolerance| ScaledInverse { inverse: InverseMass { tolerance, ..self.inverse_mass() }, roots: &roots };
        let preconditioner = inverse(1e-2 * params.tolerance);
        let (b, arrived, info, products) = if self.exchange.is_symmetric() || params.tolerance < FARTHEST {
            let (b, arrived, info) = reflected_exactly(&equation, &preconditioner, emission, params, progress)?;
            (b, arrived, info, Products::default())
        } else {
            let room = Room { search: self.spare.saturating_sub(bytes), products: bytes };
            let mut search = Search::new(equation, emission, known, room, params.restart);
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
            (b, arrived, info, products)
        };
        let (solution, steady) =
            self.solution_of(self.join.spread(Cow::Owned(b)).into_owned(), arrived, self.collects());
        Ok((self.without_noise(solution, steady), info, products))
    }

    /// Bytes that products may take: half of what the operator does, if it has left as much.
    pub(super) fn most_products(&self) -> usize {
        self.spare.min(self.exchange.statistics().bytes / 2)
    }

    /// What arrives, as [`reflection`](Self::reflection) wants it.
    fn arriving(&self) -> Arriving<'_> {
        Arriving { join: &self.join, exchange: &*self.exchange, collected: self.collects() }
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
        Ok((self.solution(radiosity), info))
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

//! Other materials on the same operator.

use super::super::MaterialsError;
use super::super::operators::{Join, RoughInverse};
use super::super::products::Products;
use super::System;
use crate::exchange::Exchange;
use crate::scene::Material;
use crate::space::{Continuity, FunctionSpace};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

impl System {
    /// Replaces the materials, one by one, and keeps the operator: another light (new B⁰), another paint (new R).
    ///
    /// What is solved next is what a system made afresh with the same [`Params`](crate::exchange::Params) would solve; only the
    /// functions' joints are found again where other materials are alike than before, since they follow them. It is the same to the last
    /// bit, unless the operator is sampled and the system has been solved before: then the solver begins with what its first
    /// solution has asked of the operator (which spares all products where lamps are dimmed together, and some where walls are
    /// painted), and what it finds is the same to the solver's tolerance.
    ///
    /// The parameters have the lamps that the operator was built for: how finely shadows are sampled follows these. The
    /// estimated error of a solution tells whether that is good enough for new ones.
    ///
    /// What is known of a sampled operator from earlier solutions is forgotten when the first reflectance that varies over an
    /// element comes, or the last goes.
    ///
    /// # Errors
    /// [`MaterialsError`] if their number or what their sides do would change, or one of them is not physical; the system
    /// is then as it was.
    pub fn set_materials(&mut self, materials: Vec<Material>, continuity: Continuity) -> Result<(), MaterialsError> {
        let same = |(a, b): (&Material, &Material)| (a.two_sided, a.blocks_only) == (b.two_sided, b.blocks_only);
        if materials.len() != self.scene.materials.len() || !materials.iter().zip(&self.scene.materials).all(same) {
            return Err(MaterialsError::Geometry);
        }
        let (collects, alike, bands) = (self.collects(), self.scene.alike(), self.scene.bands);
        let shine = |(a, b): (&Material, &Material)| a.exitance.is_given_like(&b.exitance);
        let shines_as_before = materials.iter().zip(&self.scene.materials).all(shine);
        self.scene.set_materials(materials)?;
        if !shines_as_before || self.scene.bands != bands {
            self.forget_emission();
        }
        if let Some(found) = self.found.take() {
            self.known = found.with(&self.known, self.most_products());
        }
        if self.collects() != collects {
            self.known = Products::default();
        }
        // The cells have elements: only the joints may differ.
        if (alike, self.space.joined()) != (self.scene.alike(), continuity)
            && let Ok(space) = FunctionSpace::new(&self.scene, self.space.basis(), continuity)
        {
            self.rejoin(space);
        }
        self.strengths = OnceLock::new();
        self.reflectance = OnceLock::new();
        self.operator_time = Duration::ZERO;
        Ok(())
    }

    /// Goes on with so many bands, if there are fewer: a number that stands for all stands for these. Functions leave the number of
    /// bands open; whoever gives them as materials knows it.
    pub fn raise_bands(&mut self, bands: usize) {
        if bands > self.scene.bands {
            self.scene.bands = bands;
            self.reflectance = OnceLock::new();
            self.forget_emission();
        }
    }

    /// Has all that follows from the materials integrated again, for whoever knows that their functions gave nonsense.
    pub fn forget_materials(&mut self) {
        self.strengths = OnceLock::new();
        self.reflectance = OnceLock::new();
        self.known = Products::default();
        self.found = OnceLock::new();
        self.forget_emission();
    }

    /// What follows from how materials shine.
    fn forget_emission(&mut self) {
        self.load = OnceLock::new();
        self.emission = OnceLock::new();
    }

    /// Materials that shine and did not when the operator was built, if it is sampled: it takes their light for that of other
    /// surfaces, which rays find or not, and the smaller they are the noisier it is. A system that is to be lit by one lamp after
    /// the other is built with all of them lit.
    pub fn new_lamps(&self) -> Vec<&str> {
        let now = shining(&self.scene.materials);
        let is_new = |&k: &usize| now[k] && !self.shone[k] && !self.exchange.is_symmetric();
        (0..now.len()).filter(is_new).map(|k| &*self.scene.materials[k].name).collect()
    }

    /// Joins functions in another way.
    fn rejoin(&mut self, space: FunctionSpace) {
        let before = std::mem::replace(&mut self.space, space);
        if self.space.continuity() == before.continuity() {
            return;
        }
        self.join = Join::of(&self.space, &self.mass);
        self.emission = OnceLock::new();
        self.rough = Arc::new(RoughInverse::new(&self.join, [&self.mass, &self.mass_inverse]));
        self.known = Products::default();
    }
}

/// Which of some materials may give light of their own.
pub(super) fn shining(materials: &[Material]) -> Arc<[bool]> {
    materials.iter().map(|material| !material.exitance.is_zero()).collect()
}

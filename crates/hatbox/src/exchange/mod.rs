//! The exchange operator S_ij = ∬ N_i N_j G V: how surfaces see each other, and nothing of what they are made of.
//!
//! S is symmetric (that is reciprocity), knows no bands and no reflectances, and so is shared by all bands, by every
//! relighting and by every repainting. Kinds of operator stand behind one trait and in one list, [`ALL`].

mod closure;
mod dense;

pub use closure::{Balanced, Closure, escape};
pub use dense::Dense;

use crate::assemble::Panel;
use crate::linalg::LinearOperator;
use crate::progress::{Interrupted, Progress};
use crate::scene::Surface;
use crate::visibility::Bvh;
use std::sync::Arc;

/// What an operator cost and how far it may be wrong.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Statistics {
    /// Bytes that its coefficients take.
    pub bytes: usize,
    /// Visibility rays cast.
    pub rays: u64,
    /// Pairs of elements that exchange something.
    pub pairs: u64,
    /// Pairs among them that were proven to see each other fully.
    pub clear_pairs: u64,
    /// Estimated relative error of the worst row's sum from quadrature.
    pub quadrature_error: f64,
    /// Estimated relative error of the worst row's sum from sampled visibility.
    pub visibility_error: f64,
}

impl Statistics {
    /// δ, the estimate of the relative error of the operator.
    pub fn error(&self) -> f64 {
        self.quadrature_error + self.visibility_error
    }
}

/// S applied to coefficients of the broken space: symmetric, in m².
pub trait Exchange: LinearOperator + Send {
    /// What it cost and how far it may be wrong.
    fn statistics(&self) -> Statistics;
}

/// One operator shared by all paints and lamps of the same cells.
impl<T: Exchange + ?Sized> Exchange for Arc<T> {
    fn statistics(&self) -> Statistics {
        (**self).statistics()
    }
}

/// How an operator is to be built.
#[derive(Debug, Clone, PartialEq)]
pub struct Params {
    /// Relative error τ that the sum of a row may have.
    pub tolerance: f64,
    /// How strongly light from each panel counts, relative to a mean one; empty if all count alike. Errors of visibility
    /// towards a strong emitter count more.
    pub strengths: Vec<f64>,
    /// Most rays for one pair.
    pub max_rays: u32,
    /// Seed of all sampling.
    pub seed: u64,
}

impl Params {
    /// τ, all panels counting alike.
    pub fn new(tolerance: f64) -> Self {
        Self { tolerance, strengths: Vec::new(), max_rays: 1 << 14, seed: 0 }
    }

    /// The strength of one panel.
    fn strength(&self, panel: usize) -> f64 {
        self.strengths.get(panel).copied().unwrap_or(1.0)
    }
}

/// Why an operator was not built.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ExchangeError {
    /// It would take more memory than it may.
    #[error(
        "the dense exchange operator of {unknowns} unknowns takes {} MB, more than the {} MB allowed; use fewer or larger \
         elements",
        bytes / 1_000_000,
        limit / 1_000_000
    )]
    TooLarge {
        /// Number of unknowns.
        unknowns: usize,
        /// Bytes needed.
        bytes: usize,
        /// Bytes allowed.
        limit: usize,
    },
    /// The work was asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// What exchanges light, and what stands between.
#[derive(Clone, Copy)]
pub struct Geometry<'a> {
    /// The panels; those of one face of the input follow each other.
    pub panels: &'a [Panel],
    /// The faces of the input, indexed by [`Panel::surface`].
    pub surfaces: &'a [Surface],
    /// The same faces, to cast rays at.
    pub blockers: &'a Bvh,
}

/// Builds an operator.
pub type Build = fn(&Geometry<'_>, &Params, &dyn Progress) -> Result<Box<dyn Exchange>, ExchangeError>;

/// A kind of operator as users meet it.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    /// The word that selects it.
    pub name: &'static str,
    /// One line for help and documentation.
    pub summary: &'static str,
    /// Builds it.
    pub build: Build,
}

/// Every kind of operator.
pub const ALL: &[Kind] = &[Kind {
    name: "dense",
    summary: "all pairs, stored; the reference, up to about 20 000 unknowns",
    build: |geometry, params, progress| Ok(Box::new(Dense::new(geometry, params, progress)?)),
}];

/// The kind of that name; `auto` is the best for the number of unknowns.
pub fn kind(name: &str) -> Option<&'static Kind> {
    if name == "auto" { ALL.first() } else { ALL.iter().find(|kind| kind.name == name) }
}

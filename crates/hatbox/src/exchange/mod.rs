//! The exchange operator S_ij = ∬ N_i N_j G V: how surfaces see each other, and nothing of what they are made of.
//!
//! S is symmetric (that is reciprocity), knows no bands and no reflectances, and so is shared by all bands, by every
//! relighting and by every repainting. Kinds of operator stand behind one trait and in one list, [`ALL`]. A sampled
//! operator is symmetric only in the limit of many rays; it says so ([`Exchange::is_symmetric`]), and the solver is chosen
//! accordingly.

mod choice;
mod closure;
mod covered;
mod dense;
mod enclosed;
mod hierarchical;
mod norm;
mod sampled;
mod sealed;
mod tree;

pub use choice::{AUTO, Problem, choose};
pub use closure::{
    Arriving, Balanced, Closure, Escape, GREATEST_DEFICIT, arriving, escape, escapes, rays_per_cell, scatter,
};
pub(crate) use dense::Between;
pub use dense::{Dense, Panorama, PointRow, RowFacts, Viewpoint, Views};
pub use hierarchical::Hierarchical;
pub use norm::norm;
pub use sampled::Sampled;
pub(crate) use sealed::is_sealed;

use crate::assemble::{Accuracy, Panel};
use crate::linalg::{Csr, LinearOperator, MultiVector};
use crate::progress::{Interrupted, Progress};
use crate::scene::{Scene, Surface};
use crate::space::FunctionSpace;
use crate::visibility::Bvh;
use std::sync::{Arc, OnceLock};

/// What an operator cost and how far it may be wrong.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Statistics {
    /// Bytes that its coefficients take.
    pub bytes: usize,
    /// The fraction of the elements whose rays are cast again whenever it is applied, since they are not stored.
    pub recast: f64,
    /// Visibility rays cast.
    pub rays: u64,
    /// Pairs of elements that exchange something.
    pub pairs: u64,
    /// Pairs among them that were proven to see each other fully.
    pub clear_pairs: u64,
    /// Estimated relative error of the worst row's sum from quadrature.
    pub quadrature_error: f64,
    /// Estimated relative error of the worst row's sum from sampled visibility. Where all rows are sampled and their sums
    /// are exact, that of the irradiance if every face shines with a strength of its own, as two halves of the rays have it.
    pub visibility_error: f64,
}

impl Statistics {
    /// δ, the estimate of the relative error of the operator.
    pub fn error(&self) -> f64 {
        self.quadrature_error + self.visibility_error
    }
}

/// S applied to coefficients of the broken space, in m².
pub trait Exchange: LinearOperator + Send {
    /// Name of its kind.
    fn kind(&self) -> &'static str;

    /// What it cost and how far it may be wrong.
    fn statistics(&self) -> Statistics;

    /// Whether S = Sᵀ to rounding.
    fn is_symmetric(&self) -> bool {
        true
    }

    /// The fraction of the light of uniformly glowing cells that leaves the scene, if rays have measured it.
    fn escape(&self) -> Option<f64> {
        None
    }

    /// The part of S x that has no noise from cell to cell, if the other part has: light from lamps, whose shadows have
    /// edges. `None` where S x has none at all.
    fn steady(&self, _x: &MultiVector) -> Option<MultiVector> {
        None
    }

    /// A function as large as the noise that [`steady`](Self::steady) has all the same, integrated like it; `None` where it has none.
    fn steady_noise(&self, _x: &MultiVector) -> Option<MultiVector> {
        None
    }

    /// Calls `join` with pairs of cells that exchange light, as many as tell which ones do so through others; `false` if it is not
    /// known who does.
    fn join_exchanging(&self, _join: &mut dyn FnMut(usize, usize)) -> bool {
        false
    }

    /// Half the difference of S x as two independent halves of the samples have it: a sample of the error of S x.
    /// `None` where nothing is sampled.
    ///
    /// # Errors
    /// [`Interrupted`].
    fn spread(&self, _x: &MultiVector, _progress: &dyn Progress) -> Result<Option<MultiVector>, Interrupted> {
        Ok(None)
    }

    /// S x. Where that takes long, since rays are cast again, `progress` hears of it.
    ///
    /// # Errors
    /// [`Interrupted`].
    fn times_watched(&self, x: &MultiVector, _progress: &dyn Progress) -> Result<MultiVector, Interrupted> {
        Ok(self.times(x))
    }

    /// Cᵀ S C x, where C (and its transpose, the second) joins what S knows as broken; watched as well.
    ///
    /// # Errors
    /// [`Interrupted`].
    fn times_joined(
        &self,
        [c, transpose]: [&Csr; 2],
        x: &MultiVector,
        progress: &dyn Progress,
    ) -> Result<MultiVector, Interrupted> {
        one_after_the_other(self, [c, transpose], x, progress)
    }

    /// For each cell the estimated error of its irradiance, relative to the mean radiosity: that of the scene that the operator
    /// was built for, if errors of pairs are independent. `None` where they are not known; see [`spread`](Self::spread).
    fn row_errors(&self) -> Option<&[f64]> {
        None
    }

    /// The irradiance at one point of a cell (reference coordinates `at`) per band, gathered with rays of its own that
    /// `seed` chooses; `None` if the operator cannot do that.
    fn irradiance(&self, _cell: usize, _at: [f64; 2], _x: &MultiVector, _seed: u64) -> Option<Vec<f64>> {
        None
    }
}

/// Cᵀ S C x by its parts.
fn one_after_the_other<S: Exchange + ?Sized>(
    s: &S,
    [c, transpose]: [&Csr; 2],
    x: &MultiVector,
    progress: &dyn Progress,
) -> Result<MultiVector, Interrupted> {
    Ok(transpose.times(&s.times_watched(&c.times(x), progress)?))
}

/// How an operator is to be built.
#[derive(Debug, Clone, PartialEq)]
pub struct Params {
    /// Relative error τ that the sum of a row may have, if light comes from everywhere. On open ground, where most of a
    /// row's rays escape, what little arrives errs by more of itself; [`statistics`](Exchange::statistics) tell how much.
    pub tolerance: f64,
    /// Whether every row must keep to it, however many shadows fall on it: pairs of rows whose errors add up to more are
    /// then integrated again. View factors are read row by row; in a solution errors of rows average out.
    pub every_row: bool,
    /// How strongly light from each panel counts, relative to a mean one; empty if all count alike. Errors of visibility
    /// towards a strong emitter count more.
    pub strengths: Vec<f64>,
    /// Most rays for one pair.
    pub max_rays: u32,
    /// Seed of all sampling.
    pub seed: u64,
    /// Most bytes that the operator may store. An operator that can do with less does, the dense one is not built. The light of
    /// lamps, links and what rays need of the elements are stored whatever is allowed.
    pub memory: usize,
}

/// Bytes that an operator may store unless told otherwise.
pub const MEMORY: usize = 16 << 30;

impl Params {
    /// τ, all panels counting alike.
    pub fn new(tolerance: f64) -> Self {
        Self { tolerance, every_row: false, strengths: Vec::new(), max_rays: 1 << 14, seed: 0, memory: MEMORY }
    }

    /// How exactly pairs of these panels are to be integrated.
    pub(crate) fn accuracy(&self, panels: &[Panel]) -> Accuracy {
        let total_area = panels.iter().map(Panel::area).sum();
        Accuracy {
            max_rays: self.max_rays,
            seed: self.seed,
            cut_out: self.every_row,
            ..Accuracy::new(self.tolerance, total_area)
        }
    }

    /// The strength of one panel.
    fn strength(&self, panel: usize) -> f64 {
        self.strengths.get(panel).copied().unwrap_or(1.0)
    }
}

/// So many bytes in words, rounded up.
fn size(bytes: usize) -> String {
    let in_tenths = |tenth: usize, unit: &str| match (bytes.div_ceil(tenth) / 10, bytes.div_ceil(tenth) % 10) {
        (whole, 0) => format!("{whole} {unit}"),
        (whole, tenths) => format!("{whole}.{tenths} {unit}"),
    };
    match bytes {
        0..1_000_000 => format!("{} kB", bytes.div_ceil(1000)),
        1_000_000..10_000_000 => in_tenths(100_000, "MB"),
        10_000_000..10_000_000_000 => format!("{} MB", bytes.div_ceil(1_000_000)),
        10_000_000_000..10_000_000_000_000 => in_tenths(100_000_000, "GB"),
        _ => format!("{} TB", bytes.div_ceil(1_000_000_000_000)),
    }
}

/// Why an operator was not built.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ExchangeError {
    /// It would take more memory than it may.
    #[error(
        "the dense exchange operator of {unknowns} unknowns takes {}, more than the {} allowed; use fewer or larger \
         elements",
        size(*bytes),
        size(*limit)
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
#[derive(Clone)]
pub struct Geometry<'a> {
    /// The scene, subdivided.
    pub scene: &'a Scene,
    /// The space on its cells.
    pub space: &'a FunctionSpace,
    /// The faces of the input, indexed by [`Panel::surface`].
    pub surfaces: &'a [Surface],
    /// The same faces, to cast rays at.
    pub blockers: &'a Arc<Bvh>,
    panels: &'a OnceLock<Vec<Panel>>,
    covered: OnceLock<Vec<bool>>,
}

impl<'a> Geometry<'a> {
    /// `panels` is filled when an operator first asks for them: they take two kilobytes each, and rays do without.
    pub fn new(
        scene: &'a Scene,
        space: &'a FunctionSpace,
        blockers: &'a Arc<Bvh>,
        panels: &'a OnceLock<Vec<Panel>>,
    ) -> Self {
        Self { scene, space, surfaces: &scene.surfaces, blockers, panels, covered: OnceLock::new() }
    }

    /// The panels; those of one face of the input follow each other.
    pub fn panels(&self) -> &'a [Panel] {
        self.panels.get_or_init(|| {
            let mut panels = Panel::of(&self.scene.mesh, self.space);
            panels.iter_mut().zip(self.covered()).for_each(|(panel, &covered)| panel.covered = covered);
            panels
        })
    }

    /// For each cell whether others lie on all of it, so that it sees nothing.
    pub fn covered(&self) -> &[bool] {
        self.covered.get_or_init(|| covered::covered(self.scene, self.blockers))
    }
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
    /// Its tolerance for a solution whose error is to be 1, to begin with. What a dense operator keeps to is the worst row, as
    /// if all errors were of one sign: what is left of it in a solution is mostly far less (where it is not, solving to a
    /// tolerance makes it stricter). The error of rays is a third to two thirds of what they are asked for
    /// (`cargo bench -p hatbox --bench operators`), and elements have to be left the greater part of the error. That of `auto` is that of the kind it [chooses](Self::chosen).
    pub looseness: f64,
    /// How many times looser it may be while the error of the mesh is far from what is asked for: 1 where that spares little.
    pub slack: f64,
    /// How many times the elements of the last mesh one is planned to have that is to follow the light: the less, the better they
    /// lie and the more meshes it takes. (Neighbours that are halved as well come on top.) Where rays are cast again
    /// each time, doubling is cheaper; where all pairs are integrated, small steps mostly end with fewer
    /// unknowns, in a focus most of all, for more rounds (`cargo bench -p hatbox --bench adapt -- asked`, `-- focus`).
    pub growth: f64,
    /// Coefficients of a band that such a mesh may have at the most unless told otherwise: a table of all pairs takes 4 n² bytes.
    pub most_coefficients: usize,
    /// And at least so many times those of the first mesh: what many faces need from the start is to be refined all the same, where
    /// memory and time grow like elements.
    pub most_growth: f64,
    /// Builds it.
    pub build: Build,
}

/// A third of a million linear elements: far less than a gigabyte of rays to 2 %.
const MOST_WITH_RAYS: usize = 1_000_000;

/// Every kind of operator.
pub const ALL: &[Kind] = &[
    Kind {
        name: Dense::NAME,
        summary: "all pairs, stored; the reference, without noise, up to about 20 000 unknowns",
        looseness: 5.0,
        slack: 1.0,
        growth: 1.25,
        most_coefficients: 20_000,
        most_growth: 0.0,
        build: |geometry, params, progress| Ok(Box::new(Dense::new(geometry, params, progress)?)),
    },
    Kind {
        name: Hierarchical::NAME,
        summary: "links between clusters that see each other, rays for the rest; time and memory grow like the elements",
        looseness: 0.5,
        slack: 4.0,
        growth: 2.0,
        most_coefficients: MOST_WITH_RAYS,
        most_growth: 2.0,
        build: |geometry, params, progress| Ok(Box::new(Sampled::linked(geometry, params, progress)?)),
    },
    Kind {
        name: Sampled::NAME,
        summary: "cosine rays from every element and exact light from lamps; time and memory grow like the elements",
        looseness: 0.5,
        slack: 4.0,
        growth: 2.0,
        most_coefficients: MOST_WITH_RAYS,
        most_growth: 2.0,
        build: |geometry, params, progress| Ok(Box::new(Sampled::new(geometry, params, progress)?)),
    },
];

/// The kind of that name; `auto` is [`AUTO`].
pub fn kind(name: &str) -> Option<&'static Kind> {
    if name == AUTO.name { Some(&AUTO) } else { ALL.iter().find(|kind| kind.name == name) }
}

#[cfg(test)]
mod tests {
    use super::size;

    #[test]
    fn sizes_are_told_in_units_that_fit() {
        let sizes = [5, 1_000_000, 1_234_567, 1_600_000_000, 17_179_869_184, 9_001_951_000_000_000];
        assert_eq!(sizes.map(size), ["1 kB", "1 MB", "1.3 MB", "1600 MB", "17.2 GB", "9002 TB"]);
    }
}

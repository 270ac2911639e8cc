//! Which kind of operator suits a problem.

use super::{ALL, Dense, Geometry, Kind, Params, Sampled};

/// The greatest number of unknowns for which all pairs are integrated: beyond, the time of the sampled operator is a
/// fraction of the dense one's for the same error.
const MOST_DENSE: usize = 20_000;

/// What [`choose`] chooses, made when the space is known.
pub static AUTO: Kind = Kind {
    name: "auto",
    summary: "what suits the number of unknowns and the memory",
    looseness: 1.0,
    build: |geometry: &Geometry<'_>, params: &Params, progress| {
        let (kind, _) = choose(geometry.space.broken_dofs(), params.memory);
        (kind.build)(geometry, params, progress)
    },
};

/// The kind for so many unknowns of the broken space and at most `memory` bytes to store, and why.
pub fn choose(unknowns: usize, memory: usize) -> (&'static Kind, String) {
    let named = |name| ALL.iter().find(|kind| kind.name == name).unwrap_or(&ALL[0]);
    let bytes = Dense::bytes(unknowns);
    if unknowns > MOST_DENSE {
        let why = format!("{unknowns} coefficients are more than the {MOST_DENSE} for which all pairs are integrated");
        (named(Sampled::NAME), why)
    } else if bytes > memory {
        let [needed, allowed] = [bytes, memory].map(|bytes| bytes.div_ceil(1_000_000));
        (named(Sampled::NAME), format!("all pairs would take {needed} MB, more than the {allowed} MB allowed"))
    } else {
        (named(Dense::NAME), format!("all pairs of {unknowns} coefficients are affordable"))
    }
}

impl Kind {
    /// The kind itself, or if it is [`AUTO`] the one that it [chooses](choose).
    pub fn chosen(&'static self, unknowns: usize, memory: usize) -> &'static Self {
        if self.name == AUTO.name { choose(unknowns, memory).0 } else { self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_unknowns_are_dense_unless_memory_is_short() {
        assert_eq!(choose(9_000, 1 << 30).0.name, Dense::NAME);
        assert_eq!(choose(9_000, 1 << 20).0.name, Sampled::NAME);
        assert_eq!(choose(3_000_000, 1 << 40).0.name, Sampled::NAME);
    }
}

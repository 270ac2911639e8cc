//! How strict the operator of the next round is to be.

/// The operator's tolerance is no looser than this.
const OPERATOR_LOOSEST: f64 = 0.1;
/// An operator with slack is what a mesh needs whose error is this part of the last one.
const NEXT: f64 = 0.25;
/// If more than this of the estimate may be the operator's error, the operator is to blame, and is made so many times stricter
/// instead of refining.
const BLAMED: f64 = 0.6;
const STRICTER: f64 = 2.0;
/// Unless the last time did not bring its error down to this share.
const WORTHWHILE: f64 = 0.7;
/// An operator that may err by less than this part of what is asked for is strict enough, whatever its slack.
const LITTLE: f64 = 0.3;

/// How many times stricter the operator is than what is asked for needs, how many times looser for now, and its error when it was
/// made stricter last.
///
/// Rounds whose error is many times what is asked for have no use for an operator that is as exact as the last round's, and rays
/// are most of their time. No answer is given that a slack may have spoilt.
pub(super) struct Strictness {
    asked: f64,
    factor: f64,
    slack: f64,
    error: f64,
}

impl Strictness {
    /// For a tolerance; with slack only where there are estimates to take it back.
    pub(super) fn new(asked: f64, estimated: bool) -> Self {
        Self { asked, factor: 1.0, slack: if estimated { f64::INFINITY } else { 1.0 }, error: f64::INFINITY }
    }

    /// The error of a solution that the operator is made for in the end.
    pub(super) fn asked(&self) -> f64 {
        self.asked / self.factor
    }

    /// The tolerance of the next operator, of a kind with this looseness and slack.
    pub(super) fn tolerance(&mut self, [looseness, slack]: [f64; 2]) -> f64 {
        let wanted = looseness * self.asked;
        self.slack = self.slack.min(slack).min(OPERATOR_LOOSEST / wanted).max(1.0);
        (self.slack * wanted).min(OPERATOR_LOOSEST) / self.factor
    }

    /// Raises it if the operator is to blame for an estimate, or if its slack may decide whether what is asked for is reached.
    pub(super) fn is_raised_for(&mut self, operator: f64, estimate: f64) -> bool {
        let of_elements = (estimate.powi(2) - operator.powi(2)).max(0.0).sqrt();
        if of_elements <= self.asked && operator > LITTLE * self.asked && self.ends_its_slack() {
            return true;
        }
        let to_blame = estimate > self.asked && operator > BLAMED * estimate && operator < WORTHWHILE * self.error;
        if to_blame && self.slack > 1.0 {
            self.slack = (self.slack / STRICTER).max(1.0);
        } else if to_blame {
            (self.factor, self.error) = (STRICTER * self.factor, operator);
        }
        to_blame
    }

    /// Sees to the next mesh after an estimate.
    pub(super) fn come_to(&mut self, estimate: f64) {
        // No number says nothing.
        if estimate.is_finite() {
            self.slack = (NEXT * estimate / self.asked).clamp(1.0, self.slack);
        }
    }

    /// Whether there was any slack; there is no more.
    pub(super) fn ends_its_slack(&mut self) -> bool {
        std::mem::replace(&mut self.slack, 1.0) > 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_close(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }

    #[test]
    fn an_operator_is_made_stricter_where_it_is_to_blame_and_where_that_helped_before() {
        let mut strictness = Strictness::new(0.003, false);
        assert!(!strictness.is_raised_for(0.004, 0.01), "most of it is the elements'");
        assert!(strictness.is_raised_for(0.008, 0.01));
        assert!(!strictness.is_raised_for(0.0075, 0.01), "it did not help");
        assert!(strictness.is_raised_for(0.004, 0.005), "it helped, and is to blame again");
        assert!(!strictness.is_raised_for(0.002, 0.0025), "what is asked for is reached");
        assert_close(strictness.asked(), 0.003 / (STRICTER * STRICTER));
        assert!(!strictness.is_raised_for(f64::NAN, 0.01) && !strictness.is_raised_for(0.004, f64::NAN));
    }

    #[test]
    fn far_from_what_is_asked_for_an_operator_is_looser_and_does_not_become_so_again() {
        let mut strictness = Strictness::new(0.01, true);
        assert_close(strictness.tolerance([0.5, 4.0]), 0.02);
        strictness.come_to(0.06);
        assert_close(strictness.tolerance([0.5, 4.0]), 0.0075);
        assert!(strictness.is_raised_for(0.05, 0.06));
        assert_close(strictness.tolerance([0.5, 4.0]), 0.005);
        strictness.come_to(1.0);
        assert_close(strictness.tolerance([0.5, 4.0]), 0.005);
        assert!(strictness.is_raised_for(0.05, 0.06));
        assert_close(strictness.tolerance([0.5, 4.0]), 0.0025);
    }

    /// With no slack left by the loosest tolerance of all, the same operator would be built again.
    #[test]
    fn an_operator_that_is_as_loose_as_any_has_no_slack() {
        let mut strictness = Strictness::new(0.02, true);
        assert_close(strictness.tolerance([5.0, 4.0]), OPERATOR_LOOSEST);
        assert!(!strictness.ends_its_slack());
        let mut strictness = Strictness::new(0.001, true);
        assert_close(strictness.tolerance([5.0, 1.0]), 0.005);
        assert!(!strictness.ends_its_slack(), "nor has a kind that would gain nothing");
    }

    #[test]
    fn nothing_counts_as_reached_or_missed_by_an_operator_with_slack() {
        for (estimate, operator, again) in [(0.009, 0.008, true), (0.0105, 0.005, true), (0.009, 0.002, false)] {
            let mut strictness = Strictness::new(0.01, true);
            assert_close(strictness.tolerance([0.5, 4.0]), 0.02);
            assert_eq!(strictness.is_raised_for(operator, estimate), again, "{estimate} {operator}");
            assert_close(strictness.tolerance([0.5, 4.0]), if again { 0.005 } else { 0.02 });
            assert!(!again || !strictness.is_raised_for(operator, estimate), "once is enough");
        }
    }
}

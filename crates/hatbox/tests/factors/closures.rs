//! Closures and thresholds: reciprocal, never above one, and what they change is as their formulas say.

use crate::{FLOOR, Quad, between, cube, level};
use hatbox::mesh::Refinement;
use hatbox::view_factors::{CLOSURES, ClosureMethodKind, Options, ViewFactors};

/// Inaccurate enough to leave something to do.
fn coarse(closure: ClosureMethodKind) -> Options {
    Options { tolerance: 0.1, refinement: Refinement::Elements(96), closure, ..Options::default() }
}

/// A cube with a small box in it that stands in many ways.
fn furnished() -> Vec<Quad> {
    let corner = |[x, y, z]: [f64; 3]| [0.3 + 0.3 * x, 0.2 + 0.5 * y, 0.4 + 0.1 * z];
    let outwards = |[a, b, c, d]: Quad| [a, d, c, b].map(corner);
    cube().into_iter().chain(cube().into_iter().map(outwards)).collect()
}

/// Rows of at most one, and A_i F_ij = A_j F_ji to rounding.
#[track_caller]
fn assert_physical(found: &ViewFactors) {
    let check = found.check();
    assert!(check.greatest_row_sum <= 1.0, "1 + {:e}", check.greatest_row_sum - 1.0);
    assert!(check.max_reciprocity_error < 1e-15, "{:e}", check.max_reciprocity_error);
    let negative = (0..found.len()).any(|i| found.row(i).any(|factor| factor < 0.0));
    assert!(!negative);
}

#[test]
fn every_closure_makes_the_rows_of_a_closed_scene_sum_to_one() {
    for scene in [cube(), furnished()] {
        let raw = between(&scene, &coarse(ClosureMethodKind::None));
        assert!(raw.is_closed() && raw.closure.is_none());
        let error = raw.check().max_row_sum_error;
        assert!(error > 1e-6, "{error}");
        for method in CLOSURES.iter().filter(|method| method.kind != ClosureMethodKind::None) {
            let found = between(&scene, &coarse(method.kind));
            assert_physical(&found);
            let closed = found.closure.expect("a report");
            assert!((closed.error_before - error).abs() < 1e-15, "{}", method.name);
            assert!(closed.error_after < 1e-12, "{}: {:e}", method.name, closed.error_after);
            assert!((found.check().max_row_sum_error - closed.error_after).abs() < 1e-13);
            let mut largest = 0.0_f64;
            for i in 0..raw.len() {
                for (j, (before, after)) in raw.row(i).zip(found.row(i)).enumerate() {
                    assert_eq!(before == 0.0, after == 0.0, "{}: F_{i},{j}", method.name);
                    if before > 0.0 {
                        largest = largest.max((after / before - 1.0).abs());
                    }
                }
            }
            assert!((closed.largest_change - largest).abs() < 1e-12, "{closed:?} {largest}");
        }
    }
}

/// The changes of the corners of a rectangle in the matrix, if it has no zeros there.
fn changes(raw: &ViewFactors, found: &ViewFactors, [i, k]: [usize; 2], [j, l]: [usize; 2]) -> Option<[f64; 4]> {
    let change = |a, b| (raw.get(a, b) != 0.0).then(|| found.get(a, b) / raw.get(a, b));
    Some([change(i, j)?, change(k, l)?, change(i, l)?, change(k, j)?])
}

#[test]
fn changes_are_products_or_sums_of_numbers_of_rows_and_columns() {
    let raw = between(&cube(), &coarse(ClosureMethodKind::None));
    let scaled = between(&cube(), &coarse(ClosureMethodKind::Scaling));
    let least = between(&cube(), &coarse(ClosureMethodKind::LeastSquares));
    let n = raw.len();
    let mut rectangles = 0;
    for step in 1..n {
        let (rows, columns) = ([0, step], [(step + n / 3) % n, (2 * step + n / 2) % n]);
        let Some([ij, kl, il, kj]) = changes(&raw, &scaled, rows, columns) else { continue };
        assert!((ij * kl - il * kj).abs() < 1e-12);
        let Some([ij, kl, il, kj]) = changes(&raw, &least, rows, columns) else { continue };
        assert!((ij + kl - il - kj).abs() < 1e-12);
        rectangles += usize::from(columns[0] != columns[1]);
    }
    assert!(rectangles > 10, "{rectangles}");
    // Σ (change of a)² / a, the quantity that least squares minimise.
    let cost = |found: &ViewFactors| -> f64 {
        let of_row = |i: usize| -> f64 {
            let entries = raw.row(i).zip(found.row(i)).filter(|(before, _)| *before > 0.0);
            raw.surfaces[i].area * entries.map(|(before, after)| (after - before).powi(2) / before).sum::<f64>()
        };
        (0..n).map(of_row).sum()
    };
    assert!(cost(&least) > 0.0 && cost(&least) < cost(&scaled), "{:e} {:e}", cost(&least), cost(&scaled));
}

#[test]
fn a_closure_leaves_rows_alone_that_rays_do_not_contradict() {
    let mut open = cube();
    open.remove(1);
    for method in [ClosureMethodKind::Scaling, ClosureMethodKind::LeastSquares] {
        let options = Options { tolerance: 1e-3, closure: method, ..Options::default() };
        let found = between(&open, &options);
        assert_physical(&found);
        let raw = between(&open, &Options { closure: ClosureMethodKind::None, ..options });
        for (i, (row, surface)) in found.check().rows.iter().zip(&found.surfaces).enumerate() {
            // Rays would move it, if they were believed.
            assert!(row.closure_error != 0.0 && row.closure_error.abs() < surface.escape_error);
            assert!(surface.escape_error < 2e-3, "what 800 000 rays know");
            assert!(found.row(i).zip(raw.row(i)).all(|(after, before)| after.to_bits() == before.to_bits()), "row {i}");
        }
        // The integrals are better than the rays, whose scatter is 2e-3.
        assert!((found.get(1, 3) - 0.200_043_776).abs() < 1e-6, "{}", found.get(1, 3));
    }
}

#[test]
fn two_plates_that_no_closure_can_close_stay_physical() {
    // The large one loses more than the small one: no symmetric matrix with two zeros has both sums.
    let plates = [FLOOR, level([0., 3.], [0., 1.], 0.2, false)];
    for method in [ClosureMethodKind::Scaling, ClosureMethodKind::LeastSquares] {
        let found = between(&plates, &Options { closure: method, ..Options::default() });
        assert_physical(&found);
    }
}

#[test]
fn a_threshold_drops_small_pairs_and_keeps_the_row_sums() {
    let threshold = 4e-3;
    for scene in [cube(), furnished()] {
        let whole = between(&scene, &coarse(ClosureMethodKind::None));
        let found = between(&scene, &Options { threshold, ..coarse(ClosureMethodKind::None) });
        let (before, after) = (whole.check(), found.check());
        let thinned = found.threshold.expect("a report");
        assert!(thinned.dropped > 100 && thinned.kept > 100, "{thinned:?}");
        assert_eq!((thinned.kept, thinned.dropped + thinned.kept), (after.nonzeros, before.nonzeros));
        assert_eq!(found.bytes(), 12 * after.nonzeros);
        // Where pairs may not grow beyond what they are unobstructed, the last digits come slowly.
        let allowed = if thinned.closure.capped > 0 { 1e-3 * thinned.largest_loss } else { 1e-10 };
        assert!(thinned.largest_loss > 0.0 && thinned.closure.error_after < allowed, "{thinned:?}");
        for i in 0..whole.len() {
            // A sum a little above one is brought down to it.
            assert!((before.rows[i].sum.min(1.0) - after.rows[i].sum).abs() < allowed, "row {i}");
            for j in 0..whole.len() {
                let small = whole.get(i, j) < threshold && whole.get(j, i) < threshold;
                assert_eq!(small, found.get(i, j) == 0.0, "F_{i},{j} = {}", whole.get(i, j));
            }
        }
        assert!(after.max_reciprocity_error < 1e-15);
    }
}

#[test]
fn a_closed_and_thinned_matrix_is_physical() {
    for method in [ClosureMethodKind::Scaling, ClosureMethodKind::LeastSquares] {
        let found = between(&furnished(), &Options { threshold: 4e-3, ..coarse(method) });
        assert_physical(&found);
        let loss = found.threshold.as_ref().expect("a report").largest_loss;
        assert!(found.check().max_row_sum_error < 1e-3 * loss, "{:?}", found.threshold);
        assert_eq!(found.threshold.expect("a report").closure.method, method);
    }
}

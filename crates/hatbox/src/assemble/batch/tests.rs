//! The a-priori errors of the rules that take one point of each panel.

use super::*;
use crate::assemble::{Facing, Sight, pair_block};
use crate::element::{ALL, Shape};
use crate::mesh::Patch;
use crate::quadrature::sequence;

/// A random triangle or parallelogram in the unit cube around `center`.
fn random_panel(seed: u64, center: DVec3, shape: Shape) -> Panel {
    let corner = |k: u32| {
        let p = sequence::point(seed, k);
        center + DVec3::new(p[0], p[1], p[2]) - 0.5
    };
    let [a, b, c] = [corner(0), corner(1), corner(2)];
    let corners = if shape == Shape::Triangle { [a, b, c, c] } else { [a, b, b + c - a, c] };
    Panel::new(Patch::new(shape, corners), ALL[0].element(shape).expect("constants"), [0; 4], 0)
}

#[test]
fn the_a_priori_errors_bound_those_of_midpoints() {
    for (shape, corrected_error) in [(Shape::Triangle, CORRECTED[0]), (Shape::Quad, CORRECTED[1])] {
        let mut worst = [0.0_f64; 2];
        for k in 0..2000 {
            let a = random_panel(2 * k, DVec3::ZERO, shape);
            let way = sequence::point(1, k as u32);
            let away = (DVec3::new(way[0], way[1], way[2]) - 0.5).normalize_or(DVec3::X);
            let b = random_panel(2 * k + 1, away * (1.0 + 8.0 * way[3].powi(3)), shape);
            let d2 = b.center.distance_squared(a.center);
            let half_eta = 0.5 * (a.radius + b.radius) / d2.sqrt();
            let whole = Facing::new(&a.patch, &b.patch).is_some_and(|facing| facing.first.whole && facing.second.whole);
            if half_eta > 0.5 || !whole {
                continue;
            }
            let accuracy = Accuracy::new(1e-9, a.area() + b.area());
            let exact = pair_block(&a, &b, Sight::Clear, [1.0; 2], &accuracy).sum();
            let (head, front) = (&Head::of(&a), &Batch::new(&[&b]).fronts[0]);
            let place = Place::new(head, front);
            let scale = a.area() * b.area() / (PI * d2);
            for (worst, (value, (bound, exponent))) in worst.iter_mut().zip([
                (midpoint(head, front, &place)[0], MIDPOINT),
                (corrected(head, front, &place)[0], corrected_error),
            ]) {
                let allowed = bound * half_eta.powi(exponent as i32) * scale;
                *worst = worst.max((value - exact).abs() / (allowed + 1e-8 * scale));
            }
        }
        assert!(worst.iter().all(|&w| w < 1.0), "{shape:?}: {worst:?}");
    }
}

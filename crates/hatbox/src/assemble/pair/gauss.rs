//! Symmetric Gauss rules on both sides, for pairs whose distance is large against their size.

use super::{Accuracy, Block, Region};
use crate::assemble::Panel;
use crate::assemble::panel::{LADDER, nodes};
use crate::element::{MAX_DOFS, Shape};
use crate::kernel::{Points, weighted_row};
use crate::mesh::Patch;
use crate::quadrature::rule;
use glam::DVec3;
use std::borrow::Cow;
use std::f64::consts::PI;

/// The most nodes that a rule of the ladder has, on two triangles.
pub(super) const MAX_NODES: usize = 64;

/// The a-priori error of a rule that is exact to degree p, for a pair with η = (r_a + r_b)/distance, relative to
/// A_a A_b/(π d²), as (C, e) of C (η/2)^e; `None` if the shape functions use up the whole degree.
///
/// G is analytic on either side within a circle of radius d, so e = p + 1; what the shape functions use up of the degree
/// shifts it. The constants are about twice the largest ratio met among random triangles and parallelograms with η up to
/// 1; a test tries others.
pub(in crate::assemble) fn a_priori_error_factors(exact: usize, functions_degree: usize) -> Option<(f64, usize)> {
    let constant = match exact {
        0 | 1 => 2.0,
        2 | 3 => 0.3,
        4 | 5 => 0.25,
        _ => 0.04,
    };
    (exact >= functions_degree).then(|| (constant, exact + 1 - functions_degree))
}

/// The same as a number.
fn a_priori_error(exact: usize, functions_degree: usize, eta: f64) -> f64 {
    a_priori_error_factors(exact, functions_degree).map_or(f64::INFINITY, |(c, e)| c * (0.5 * eta).powi(e as i32))
}

/// The block by the cheapest rule that is accurate enough; `None` if none is.
pub(super) fn far(a: &Panel, on_a: &Region, b: &Panel, on_b: &Region, accuracy: &Accuracy) -> Option<Block> {
    let d = b.center - a.center;
    let d2 = d.length_squared();
    let eta = (a.radius + b.radius) / d2.sqrt();
    if eta >= 1.0 {
        return None;
    }
    let cosines = (a.normal().dot(d) * -b.normal().dot(d) / d2).max(0.0);
    let needed = accuracy.tolerance * cosines.max(PI * d2 / accuracy.total_area);
    let degree = a.functions_degree().max(b.functions_degree());
    let error = |rung: usize| {
        // A part of a panel is triangles.
        let exactness = |panel: &Panel, on: &Region| if on.whole { panel.exactness[rung] } else { LADDER[rung] };
        a_priori_error(exactness(a, on_a).min(exactness(b, on_b)), degree, eta)
    };
    let rung = (0..LADDER.len()).find(|&rung| error(rung) <= needed)?;
    let mut block = product(&Nodes::on(a, on_a, rung), &Nodes::on(b, on_b, rung), a, b);
    block.quadrature_error = error(rung) * a.area() * b.area() / (PI * d2);
    Some(block)
}

/// Quadrature nodes on a part of a panel, with the values of its shape functions.
pub(super) struct Nodes<'a> {
    pub(super) points: Cow<'a, Points>,
    pub(super) functions: Cow<'a, [[f64; MAX_DOFS]]>,
}

impl<'a> Nodes<'a> {
    pub(super) fn on(panel: &'a Panel, region: &Region, rung: usize) -> Self {
        if region.whole {
            let points = Cow::Borrowed(&panel.ladder[rung]);
            return Self { points, functions: panel.tabulated(rung).into() };
        }
        let mut points = Points::default();
        for triangle in region.triangles() {
            append(&mut points, &triangle, LADDER[rung]);
        }
        Self::with_functions(panel, points)
    }

    /// The nodes of the rule of a degree on a triangle of a panel.
    pub(super) fn on_triangle(panel: &Panel, triangle: &[DVec3; 3], degree: usize) -> Self {
        let mut points = Points::default();
        append(&mut points, triangle, degree);
        Self::with_functions(panel, points)
    }

    fn with_functions(panel: &Panel, points: Points) -> Self {
        let functions: Vec<_> = (0..points.len()).map(|k| panel.values(points.at(k))).collect();
        Self { points: Cow::Owned(points), functions: functions.into() }
    }
}

fn append(points: &mut Points, &[a, b, c]: &[DVec3; 3], degree: usize) {
    let found = nodes(&Patch::new(Shape::Triangle, [a, b, c, c]), rule(Shape::Triangle, degree));
    for k in 0..found.len() {
        points.push(found.at(k), found.weight[k]);
    }
}

/// Σ_p Σ_q w_p w_q N(x_p) N(y_q)ᵀ G(x_p, y_q).
pub(super) fn product(on_a: &Nodes<'_>, on_b: &Nodes<'_>, a: &Panel, b: &Panel) -> Block {
    let mut block = Block::zeros(a, b);
    let columns = b.element.dofs();
    let mut kernel = [0.0; MAX_NODES];
    let kernel = &mut kernel[..on_b.points.len()];
    for (p, functions) in on_a.functions.iter().enumerate() {
        weighted_row(on_a.points.at(p), a.normal(), &on_b.points, b.normal(), kernel);
        let mut row = [0.0; MAX_DOFS];
        for (g, values) in kernel.iter().zip(on_b.functions.iter()) {
            for (r, n) in row[..columns].iter_mut().zip(values) {
                *r += g * n;
            }
        }
        block.add(on_a.points.weight[p], functions, &row);
    }
    block
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::pair::Facing;
    use crate::assemble::pair::near::quarters;
    use crate::element::ALL;
    use crate::quadrature::sequence;

    /// A random triangle with corners in the unit cube around `center`.
    fn random_panel(seed: u64, center: DVec3, element: &'static crate::element::Element) -> Panel {
        let corner = |k: u32| {
            let p = sequence::point(seed, k);
            center + DVec3::new(p[0], p[1], p[2]) - 0.5
        };
        let corners = [corner(0), corner(1), corner(2), corner(2)];
        Panel::new(Patch::new(Shape::Triangle, corners), element, [0; 4], 0)
    }

    /// Degree 14 on 16 × 16 subtriangles.
    fn reference(a: &Panel, on_a: &Region, b: &Panel, on_b: &Region) -> Block {
        let fine = |region: &Region| {
            region.triangles().flat_map(|t| quarters(&t)).flat_map(|t| quarters(&t)).collect::<Vec<_>>()
        };
        let (on_a, on_b) = (fine(on_a), fine(on_b));
        let mut total = Block::zeros(a, b);
        for (s, t) in on_a.iter().flat_map(|s| on_b.iter().map(move |t| (s, t))) {
            total.accumulate(&product(&Nodes::on_triangle(a, s, 8), &Nodes::on_triangle(b, t, 8), a, b));
        }
        total
    }

    #[test]
    fn the_a_priori_error_bounds_the_error_of_random_pairs() {
        for element in [ALL[0].triangle, ALL[1].triangle, ALL[3].triangle] {
            let mut worst = [0.0f64; LADDER.len()];
            for k in 0..500 {
                let a = random_panel(1_000_000 + 3 * k, DVec3::ZERO, element);
                let way = sequence::point(1, k as u32);
                let away =
                    (DVec3::new(way[0], way[1], way[2]) - 0.5).normalize_or(DVec3::X) * (1.0 + 8.0 * way[3].powi(3));
                let b = random_panel(1_000_001 + 3 * k, away, element);
                let Some(Facing { first: on_a, second: on_b }) = Facing::new(&a.patch, &b.patch) else { continue };
                let d = b.center.distance(a.center);
                let eta = (a.radius + b.radius) / d;
                if eta > 1.0 {
                    continue;
                }
                let exact = reference(&a, &on_a, &b, &on_b);
                for (rung, worst) in worst.iter_mut().enumerate() {
                    let block = product(&Nodes::on(&a, &on_a, rung), &Nodes::on(&b, &on_b, rung), &a, &b);
                    let relative = block.distance(&exact) * PI * d * d / (a.area() * b.area());
                    *worst = worst.max(relative / (a_priori_error(LADDER[rung], element.degree, eta) + 1e-15));
                }
            }
            assert!(worst.iter().all(|&w| w < 1.0), "{}: {worst:?}", element.name);
        }
    }
}

//! Where in a cell a ray ended, in one byte: 256 parts of the reference cell, all of one size.
//!
//! What a ray brings back are the means of the functions over its part. They are exact for constants, and right in the
//! mean for all functions where rays end anywhere in a part; what single rays miss is some hundredths of what the function
//! varies by within the cell, and most of that averages out over the rays. Operators are made of little else than ends of rays.

use crate::element::{Element, Shape};
use crate::quadrature::rule;

/// Parts along an edge.
const EDGE: u8 = 16;
/// Parts of a cell.
const SPOTS: usize = EDGE as usize * EDGE as usize;

/// The part that a point lies in, or the nearest.
pub(super) fn spot(shape: Shape, at: [f64; 2]) -> u8 {
    let [x, y] = at.map(|x| f64::from(EDGE) * x.max(0.0));
    let [i, j] = [x, y].map(|x| (x as u8).min(EDGE - 1));
    match shape {
        Shape::Quad => i * EDGE + j,
        Shape::Triangle => {
            let j = j.min(EDGE - 1 - i);
            let upper = i + j < EDGE - 1 && x + y > f64::from(i + j + 1);
            first_of(i) + 2 * j + u8::from(upper)
        }
    }
}

/// The number of the first part of a triangle's i-th strip, which has 2(16 − i) − 1 of them.
fn first_of(i: u8) -> u8 {
    (2 * u16::from(EDGE) * u16::from(i) - u16::from(i) * u16::from(i)) as u8
}

/// The means of an element's functions over each part.
#[derive(Debug)]
pub(super) struct Spots {
    dofs: usize,
    means: Vec<f64>,
}

impl Spots {
    pub(super) fn new(element: &Element) -> Self {
        let dofs = element.dofs();
        let mut means = vec![0.0; SPOTS * dofs];
        let rule = rule(element.shape, element.degree);
        for_each_part(element.shape, |spot, origin, side| {
            for (at, weight) in rule.points.iter().zip(&rule.weights) {
                let functions = element.values([origin[0] + side * at[0], origin[1] + side * at[1]]);
                let sums = means[usize::from(spot) * dofs..].iter_mut();
                sums.take(dofs).zip(functions).for_each(|(sum, n)| *sum += weight * n);
            }
        });
        Self { dofs, means }
    }

    /// The functions in each part, if they are N.
    #[inline]
    pub(super) fn known<const N: usize>(&self) -> &[[f64; N]] {
        self.means.as_chunks().0
    }

    /// The functions where a ray ended.
    #[inline]
    pub(super) fn functions(&self, spot: u8) -> &[f64] {
        &self.means[usize::from(spot) * self.dofs..][..self.dofs]
    }
}

/// Calls `give` with the number of each part, where the origin of the reference cell lies in it, and how it is scaled.
fn for_each_part(shape: Shape, mut give: impl FnMut(u8, [f64; 2], f64)) {
    let side = 1.0 / f64::from(EDGE);
    for i in 0..EDGE {
        let strip = if shape == Shape::Triangle { EDGE - i } else { EDGE };
        for j in 0..strip {
            let [x, y] = [i, j].map(|k| side * f64::from(k));
            match shape {
                Shape::Quad => give(i * EDGE + j, [x, y], side),
                Shape::Triangle => {
                    give(first_of(i) + 2 * j, [x, y], side);
                    if j + 1 < strip {
                        // Upside down.
                        give(first_of(i) + 2 * j + 1, [x + side, y + side], -side);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::ALL;

    /// All parts together are the cell: their means average to the functions' means, and a point in the middle of a part is
    /// in that part.
    #[test]
    fn parts_tile_the_cell() {
        for element in ALL.iter().flat_map(|basis| Shape::ALL.into_iter().filter_map(|shape| basis.element(shape))) {
            let (spots, n) = (Spots::new(element), element.dofs());
            let mut seen = vec![false; SPOTS];
            for_each_part(element.shape, |number, [x, y], side| {
                let middle = if element.shape == Shape::Triangle { side / 3.0 } else { side / 2.0 };
                let at = [x + middle, y + middle];
                assert_eq!(spot(element.shape, at), number, "{} {at:?}", element.name);
                assert!(!std::mem::replace(&mut seen[usize::from(number)], true), "one part each");
                let functions = spots.functions(number);
                assert!((functions.iter().sum::<f64>() - 1.0).abs() < 1e-14, "{}", element.name);
                let off =
                    functions.iter().zip(element.values(at)).map(|(mean, n)| (mean - n).abs()).fold(0.0, f64::max);
                let bound = if element.degree > 1 { 0.01 } else { 1e-14 };
                assert!(off < bound, "{}: {off}", element.name);
            });
            assert!(seen.iter().all(|&seen| seen));
            let rule = rule(element.shape, element.degree);
            for k in 0..n {
                let values = rule.points.iter().zip(&rule.weights).map(|(&at, w)| w * element.values(at)[k]);
                let (whole, parts) = (values.sum::<f64>(), spots.means.iter().skip(k).step_by(n).sum::<f64>());
                assert!((whole - parts / SPOTS as f64).abs() < 1e-14, "{} {k}: {whole} {parts}", element.name);
            }
        }
    }

    #[test]
    fn points_on_the_rim_and_beyond_have_a_part() {
        for shape in Shape::ALL {
            // A point outside, and one inside the part that is nearest to it.
            let beyond = [([-1e-9, 0.31], [0.01, 0.3]), ([1.1, -0.1], [0.95, 0.01]), ([-0.2, 1.01], [0.01, 0.95])];
            for (outside, inside) in beyond {
                assert_eq!(spot(shape, outside), spot(shape, inside), "{shape:?} {outside:?}");
            }
        }
        assert_eq!([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]].map(|at| spot(Shape::Triangle, at)), [0, 30, 255]);
        assert_eq!([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(|at| spot(Shape::Quad, at)), [0, 15, 255]);
        // Across the diagonal of a triangle, as rounding may put it.
        assert_eq!(spot(Shape::Triangle, [0.5 + 1e-12, 0.5]), spot(Shape::Triangle, [0.51, 0.48]));
    }
}

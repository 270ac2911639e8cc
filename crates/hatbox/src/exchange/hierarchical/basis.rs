//! Polynomials on rectangles: Lagrange's at Chebyshev's points, axis by axis.

use std::f64::consts::PI;

/// The greatest number of points of an axis.
pub(super) const MOST: usize = 5;
/// Of a rectangle.
pub(super) const MOST_POINTS: usize = MOST * MOST;

/// p points on each axis of a rectangle, from −1 to 1.
#[derive(Debug, Clone)]
pub(super) struct Basis {
    nodes: Vec<f64>,
    /// 1/Π(t_a − t_b).
    scales: Vec<f64>,
}

impl Basis {
    pub(super) fn new(p: usize) -> Self {
        let nodes: Vec<f64> = (0..p).map(|a| (PI * (a as f64 + 0.5) / p as f64).cos()).collect();
        let others = |a: usize| nodes.iter().enumerate().filter(move |&(b, _)| b != a);
        let scales = (0..p).map(|a| others(a).map(|(_, t)| 1.0 / (nodes[a] - t)).product()).collect();
        Self { nodes, scales }
    }

    /// Number of points of an axis.
    pub(super) fn p(&self) -> usize {
        self.nodes.len()
    }

    /// Number of points of a rectangle.
    pub(super) fn len(&self) -> usize {
        self.p() * self.p()
    }

    /// Point a of a rectangle; those of the second axis follow each other.
    pub(super) fn point(&self, a: usize) -> [f64; 2] {
        [self.nodes[a / self.p()], self.nodes[a % self.p()]]
    }

    /// The functions of an axis at a place.
    pub(super) fn axis(&self, t: f64) -> [f64; MOST] {
        let mut values = [0.0; MOST];
        for (a, value) in values[..self.p()].iter_mut().enumerate() {
            let others = self.nodes.iter().enumerate().filter(|&(b, _)| b != a);
            *value = self.scales[a] * others.map(|(_, node)| t - node).product::<f64>();
        }
        values
    }

    /// The functions of a rectangle at a place.
    pub(super) fn values(&self, at: [f64; 2]) -> [f64; MOST_POINTS] {
        let [first, second] = at.map(|t| self.axis(t));
        let mut values = [0.0; MOST_POINTS];
        for (a, value) in values[..self.len()].iter_mut().enumerate() {
            *value = first[a / self.p()] * second[a % self.p()];
        }
        values
    }

    /// For each axis, the functions of a rectangle at the points of one inside it, whose middle lies at `middle` and
    /// whose sides are `size` times as long: `[axis][b][a]`.
    pub(super) fn transfer(&self, middle: [f64; 2], size: [f64; 2]) -> [[[f64; MOST]; MOST]; 2] {
        let mut transfer = [[[0.0; MOST]; MOST]; 2];
        for (axis, table) in transfer.iter_mut().enumerate() {
            for (row, node) in table.iter_mut().zip(&self.nodes) {
                *row = self.axis(middle[axis] + size[axis] * node);
            }
        }
        transfer
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_of_the_degree_are_exact() {
        for p in 2..=MOST {
            let basis = Basis::new(p);
            let f = |[x, y]: [f64; 2]| (x - 0.3).powi(p as i32 - 1) * (1.0 + 0.5 * y).powi(p as i32 - 1);
            let at = [0.35, -0.8];
            let values = basis.values(at);
            let found: f64 = (0..basis.len()).map(|a| values[a] * f(basis.point(a))).sum();
            assert!((found - f(at)).abs() < 1e-13, "{p}: {found} {}", f(at));
        }
    }
}

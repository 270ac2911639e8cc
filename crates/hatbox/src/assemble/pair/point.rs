//! ∫N_k(y) G(x, y) dA(y): what a point receives from a panel, as if nothing stood between.

use super::gauss::Nodes;
use super::near::Inner;
use super::{Region, clipped};
use crate::assemble::Panel;
use crate::element::MAX_DOFS;
use crate::kernel::weighted_row;
use glam::DVec3;

/// Radius over distance below which a Gauss rule of degree 5 is accurate to 1e-5.
const FAR: f64 = 0.2;
/// The rung of the ladder with that rule.
const FAR_RUNG: usize = 2;
/// Degree of the rule where there is neither distance nor a closed form.
const NEAR_DEGREE: usize = 14;

/// ∫N_k G over a panel for each of its shape functions, at the point `x` of a surface with unit normal `n`; `None` if
/// the panel faces away or lies below the point's horizon. Dimensionless.
pub fn point_row(panel: &Panel, x: DVec3, n: DVec3) -> Option<[f64; MAX_DOFS]> {
    Outlook::new(panel, x, n).map(|outlook| outlook.row())
}

/// A panel as a point of a surface sees it: the part above the horizon.
#[derive(Debug, Clone, Copy)]
pub struct Outlook<'a> {
    panel: &'a Panel,
    region: Region,
    x: DVec3,
    n: DVec3,
}

impl<'a> Outlook<'a> {
    /// From the point `x` of a surface with unit normal `n`; `None` if the panel faces away or lies below the horizon.
    pub fn new(panel: &'a Panel, x: DVec3, n: DVec3) -> Option<Self> {
        if panel.normal().dot(x - panel.patch.corners()[0]) <= 0.0 {
            return None;
        }
        Region::in_front(&panel.patch, x, n).map(|region| Self { panel, region, x, n })
    }

    /// The corners of the part.
    pub fn corners(&self) -> &[DVec3] {
        self.region.corners()
    }

    /// ∫N_k G over the part, dimensionless.
    pub fn row(&self) -> [f64; MAX_DOFS] {
        let &Self { panel, ref region, x, n } = self;
        if panel.radius < FAR * panel.center.distance(x) {
            return sum(&Nodes::on(panel, region, FAR_RUNG), panel, x, n);
        }
        if panel.functions.is_some() {
            return Inner::new(panel, region.corners()).at(x, n);
        }
        let mut total = [0.0; MAX_DOFS];
        for triangle in region.triangles() {
            let part = sum(&Nodes::on_triangle(panel, &triangle, NEAR_DEGREE), panel, x, n);
            total = std::array::from_fn(|k| total[k] + part[k]);
        }
        total
    }

    /// ∫N_k G V over the part behind convex polygons, exactly: what they hide is cut out. `None` if what is left comes to
    /// too many pieces, or where there is no closed form.
    pub fn row_behind(&self, polygons: &[&[DVec3]]) -> Option<[f64; MAX_DOFS]> {
        self.panel.functions.as_ref()?;
        clipped::row(self.panel, &self.region, polygons, self.x, self.n)
    }
}

/// Σ_q w_q N_k(y_q) G(x, y_q).
fn sum(nodes: &Nodes<'_>, panel: &Panel, x: DVec3, n: DVec3) -> [f64; MAX_DOFS] {
    let mut kernel = [0.0; super::gauss::MAX_NODES];
    let kernel = &mut kernel[..nodes.points.len()];
    weighted_row(x, n, &nodes.points, panel.normal(), kernel);
    let mut row = [0.0; MAX_DOFS];
    for (g, values) in kernel.iter().zip(nodes.functions.iter()) {
        row = std::array::from_fn(|k| row[k] + g * values[k]);
    }
    row
}

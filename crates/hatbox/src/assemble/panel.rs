use super::pair::Region;
use crate::element::{ALL, Element, MAX_DOFS, Polynomial, Shape};
use crate::kernel::{Plane, Points};
use crate::mesh::{Mesh, Patch};
use crate::quadrature::{Rule, rule};
use crate::space::FunctionSpace;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::sync::LazyLock;

/// Degrees of the symmetric Gauss rules that a pair of distant panels chooses from.
pub(super) const LADDER: [usize; 4] = [1, 2, 5, 8];

/// The rung that is exact for second moments on any quad.
const SMOOTH: usize = 2;

/// A cell as the pair integrals see it: its geometry, its shape functions as polynomials of the plane, and its
/// quadrature nodes.
#[derive(Debug, Clone)]
pub struct Panel {
    /// The geometry.
    pub patch: Patch,
    /// The shape functions on the reference cell.
    pub element: &'static Element,
    /// The corners' indices in the mesh: what touches is decided by them, not by coordinates.
    pub vertices: [u32; 4],
    /// The face of the input it belongs to.
    pub surface: u32,
    /// Whether something lies on it, so that it sees nothing.
    pub covered: bool,
    /// Its centroid, the centre of its bounding sphere.
    pub center: DVec3,
    /// Radius of its bounding sphere.
    pub radius: f64,
    /// m₁, m₂ with Σ m_k m_kᵀ = (1/A) ∫ (x − c)(x − c)ᵀ dA: how far it spreads about its centroid c.
    pub(super) spread: [DVec3; 2],
    pub(super) longest_edge: f64,
    pub(super) plane: Plane,
    /// The shape functions in the plane's coordinates; `None` where they are no polynomials (a quad that is no
    /// parallelogram, unless its element is constant).
    pub(super) functions: Option<[Polynomial; MAX_DOFS]>,
    pub(super) ladder: [Points; LADDER.len()],
    /// The degree up to which each rung is exact on the panel.
    pub(super) exactness: [usize; LADDER.len()],
    /// N_k at the nodes of each rung.
    tables: &'static [Vec<[f64; MAX_DOFS]>],
}

impl Panel {
    /// The panels of all cells of a mesh.
    pub fn of(mesh: &Mesh, space: &FunctionSpace) -> Vec<Self> {
        (0..mesh.cells.len()).into_par_iter().map(|cell| Self::of_cell(mesh, space, cell)).collect()
    }

    /// The panel of one cell.
    pub fn of_cell(mesh: &Mesh, space: &FunctionSpace, cell: usize) -> Self {
        let found = &mesh.cells[cell];
        Self::new(mesh.patch(cell), space.element(cell), found.vertices, found.surface)
    }

    /// A panel on its own. Corners with the same index in `vertices` are the same point.
    pub fn new(patch: Patch, element: &'static Element, vertices: [u32; 4], surface: u32) -> Self {
        let plane = Plane::new(patch.corners()[0], patch.normal());
        let ladder = LADDER.map(|degree| nodes(&patch, rule(patch.shape(), degree)));
        let (center, spread) = moments(&ladder[SMOOTH], &plane);
        Self {
            element,
            vertices,
            surface,
            covered: false,
            center,
            radius: patch.corners().iter().map(|corner| corner.distance(center)).fold(0.0, f64::max),
            spread,
            longest_edge: patch.longest_edge(),
            plane,
            functions: polynomials(&patch, element, &plane),
            tables: tables(element),
            // The Jacobian of a quad that is no parallelogram is of degree 1.
            exactness: LADDER.map(|degree| rule(patch.shape(), degree).degree - usize::from(!patch.is_affine())),
            ladder,
            patch,
        }
    }

    /// The area.
    pub fn area(&self) -> f64 {
        self.patch.area()
    }

    /// The length of the longest edge.
    pub fn longest_edge(&self) -> f64 {
        self.longest_edge
    }

    /// The unit normal.
    pub fn normal(&self) -> DVec3 {
        self.patch.normal()
    }

    /// The point that (u, v) in the unit square is mapped to, uniformly in area.
    pub fn sample(&self, u: f64, v: f64) -> DVec3 {
        Region::of(self.patch.corners()).sample(u, v)
    }

    /// N_k at a point of the panel.
    pub fn values(&self, point: DVec3) -> [f64; MAX_DOFS] {
        let Some(functions) = &self.functions else { return self.element.values(self.patch.locate(point)) };
        let p = self.plane.project(point);
        let m = crate::element::monomials([p.x, p.y]);
        let mut values = [0.0; MAX_DOFS];
        for (value, f) in values.iter_mut().zip(&functions[..self.element.dofs()]) {
            *value = f.iter().zip(&m).map(|(c, m)| c * m).sum();
        }
        values
    }

    /// The function with these coefficients as a polynomial of the [plane](Self::plane)'s coordinates; `None` where it is
    /// none.
    pub(crate) fn polynomial(&self, coefficients: &[f64]) -> Option<Polynomial> {
        let functions = self.functions.as_ref()?;
        let mut sum = [0.0; 6];
        for (c, f) in coefficients.iter().zip(functions) {
            sum.iter_mut().zip(f).for_each(|(sum, f)| *sum += c * f);
        }
        Some(sum)
    }

    /// The plane and its coordinates.
    pub(crate) fn plane(&self) -> &Plane {
        &self.plane
    }

    /// Degree of the shape functions as polynomials of the plane; 2 for those that are none.
    pub(super) fn functions_degree(&self) -> usize {
        if self.functions.is_some() { self.element.degree } else { 2 }
    }

    /// N_k at the nodes of a rung of the ladder.
    pub(super) fn tabulated(&self, rung: usize) -> &'static [[f64; MAX_DOFS]] {
        &self.tables[rung]
    }
}

/// The centroid of weighted points of a plane, and two vectors whose squares are their second moments about it.
fn moments(points: &Points, plane: &Plane) -> (DVec3, [DVec3; 2]) {
    let all = || (0..points.len()).map(|k| (points.at(k) - plane.origin, points.weight[k]));
    let total: f64 = points.weight.iter().sum();
    // Of a panel without area nothing is asked.
    let mean = |sum: DVec3| if total > 0.0 { sum / total } else { sum };
    let center = mean(all().map(|(p, w)| w * p).sum());
    let [e1, e2, _] = plane.axes;
    let [xx, xy, yy] = all().fold([0.0; 3], |[xx, xy, yy], (p, w)| {
        let (x, y) = ((p - center).dot(e1), (p - center).dot(e2));
        [xx + w * x * x, xy + w * x * y, yy + w * y * y]
    });
    // Cholesky's factor of the moments.
    let scale = if total > 0.0 { 1.0 / total } else { 0.0 };
    let first = (scale * xx).sqrt();
    let slope = if xx > 0.0 { xy / xx } else { 0.0 };
    let second = (scale * (yy - slope * xy)).max(0.0).sqrt();
    (plane.origin + center, [first * (e1 + slope * e2), second * e2])
}

/// The tables of an element; those of an element that is in no basis are made for good.
fn tables(element: &'static Element) -> &'static [Vec<[f64; MAX_DOFS]>] {
    let known = ELEMENTS.iter().position(|e| std::ptr::eq(*e, element));
    known.map_or_else(|| Box::leak(Box::new(tabulate(element))).as_slice(), |index| &TABLES[index])
}

static ELEMENTS: LazyLock<Vec<&'static Element>> = LazyLock::new(|| {
    ALL.iter().flat_map(|basis| Shape::ALL.into_iter().filter_map(|shape| basis.element(shape))).collect()
});

static TABLES: LazyLock<Vec<Vec<Vec<[f64; MAX_DOFS]>>>> =
    LazyLock::new(|| ELEMENTS.iter().map(|element| tabulate(element)).collect());

/// N_k at the nodes of each rung.
fn tabulate(element: &Element) -> Vec<Vec<[f64; MAX_DOFS]>> {
    let table = |degree| rule(element.shape, degree).points.iter().map(|&at| element.values(at)).collect();
    LADDER.iter().map(|&degree| table(degree)).collect()
}

/// The nodes of a rule on a patch, weighted in m².
pub(super) fn nodes(patch: &Patch, rule: &Rule) -> Points {
    let mut points = Points::with_capacity(rule.points.len());
    for (&at, weight) in rule.points.iter().zip(&rule.weights) {
        points.push(patch.point(at), weight * patch.shape().reference_area() * patch.jacobian(at));
    }
    points
}

/// The shape functions as polynomials of the plane's coordinates, by substituting the affine map to the reference cell.
fn polynomials(patch: &Patch, element: &Element, plane: &Plane) -> Option<[Polynomial; MAX_DOFS]> {
    if element.degree > 0 && !patch.is_affine() {
        return None;
    }
    let mut functions = [[0.0; 6]; MAX_DOFS];
    if element.degree == 0 {
        functions[0][0] = 1.0;
        return Some(functions);
    }
    // ξ = α₁ + β₁·p, η = α₂ + β₂·p; the plane's origin is corner 0, where ξ = η = 0.
    let corners = patch.corners();
    let (a, b) = (plane.project(corners[1]), plane.project(corners[corners.len() - 1]));
    let det = a.perp_dot(b);
    let (xi, eta) = (DVec2::new(b.y, -b.x) / det, DVec2::new(-a.y, a.x) / det);
    for (function, c) in functions.iter_mut().zip(element.functions) {
        *function = [
            c[0],
            c[1] * xi.x + c[2] * eta.x,
            c[1] * xi.y + c[2] * eta.y,
            c[3] * xi.x * xi.x + c[4] * xi.x * eta.x + c[5] * eta.x * eta.x,
            2.0 * c[3] * xi.x * xi.y + c[4] * (xi.x * eta.y + xi.y * eta.x) + 2.0 * c[5] * eta.x * eta.y,
            c[3] * xi.y * xi.y + c[4] * xi.y * eta.y + c[5] * eta.y * eta.y,
        ];
    }
    Some(functions)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plane_polynomials_are_the_shape_functions() {
        let at = |x: f64, y: f64| DVec3::new(1.0 + x, 0.5 * x - y, 2.0 + 0.3 * y);
        let triangle = Patch::new(Shape::Triangle, [at(0.0, 0.0), at(1.0, 0.2), at(0.3, 1.0), at(0.3, 1.0)]);
        let parallelogram = Patch::new(Shape::Quad, [at(0.0, 0.0), at(2.0, 0.2), at(2.3, 1.2), at(0.3, 1.0)]);
        for basis in &ALL {
            for patch in [triangle, parallelogram] {
                let Some(element) = basis.element(patch.shape()) else { continue };
                let panel = Panel::new(patch, element, [0, 1, 2, 3], 0);
                assert!(panel.functions.is_some());
                for at in [[0.1, 0.2], [0.6, 0.3]] {
                    let (values, expected) = (panel.values(patch.point(at)), element.values(at));
                    for (v, e) in values.iter().zip(expected) {
                        assert!((v - e).abs() < 1e-13, "{}: {v} {e}", element.name);
                    }
                }
            }
        }
    }
}

//! The finite elements: shape functions on a reference cell, as a table of facts.
//!
//! Every shape function here is a polynomial of degree ≤ 2 in the reference coordinates (ξ, η), so an [`Element`] is its
//! nodes and one row of six numbers per shape function. That is what the closed forms of [`crate::kernel`] integrate,
//! and what [`ALL`] lists: a new basis is one entry there, and the command line, the documentation and the conformance
//! tests read it.
//!
//! The functions are *nodal* (Lagrange): a coefficient is the value at a node. An orthonormal basis would make the mass
//! matrix the identity, but the mass blocks are a constant matrix times the area, inverted once; in return the
//! coefficients in files mean something to their readers, the continuity matrix C holds plain ones, and the closed forms
//! deliver hats directly.

/// Kinds of reference cell. The triangle is (0,0), (1,0), (0,1); the quad is the unit square, counter-clockwise from
/// the origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Shape {
    /// Three corners.
    Triangle,
    /// Four corners.
    Quad,
}

impl Shape {
    /// Both shapes.
    pub const ALL: [Self; 2] = [Self::Triangle, Self::Quad];

    /// Number of corners, and of edges: edge k runs from corner k to corner k+1.
    pub const fn corners(self) -> usize {
        match self {
            Self::Triangle => 3,
            Self::Quad => 4,
        }
    }

    /// Area of the reference cell.
    pub const fn reference_area(self) -> f64 {
        match self {
            Self::Triangle => 0.5,
            Self::Quad => 1.0,
        }
    }

    /// Reference coordinates of the corners.
    pub const fn reference_corners(self) -> &'static [[f64; 2]] {
        match self {
            Self::Triangle => &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
            Self::Quad => &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
        }
    }

    /// Reference coordinates of the middle.
    pub const fn middle(self) -> [f64; 2] {
        match self {
            Self::Triangle => [1.0 / 3.0, 1.0 / 3.0],
            Self::Quad => [0.5, 0.5],
        }
    }

    /// The point of the reference cell that two uniform numbers choose, uniformly.
    pub fn uniform(self, [u, v]: [f64; 2]) -> [f64; 2] {
        match self {
            Self::Triangle => [v.sqrt() * (1.0 - u), v.sqrt() * u],
            Self::Quad => [u, v],
        }
    }

    /// The map of the reference cell's corners to `corners`, at ξ: linear on triangles, bilinear on quads. The weights
    /// of the corners.
    pub fn corner_weights(self, [x, y]: [f64; 2]) -> [f64; 4] {
        match self {
            Self::Triangle => [1.0 - x - y, x, y, 0.0],
            Self::Quad => [(1.0 - x) * (1.0 - y), x * (1.0 - y), x * y, (1.0 - x) * y],
        }
    }
}

/// The part of a cell that a node sits on; nodes on a shared corner or edge are what continuity glues together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Entity {
    /// Corner k.
    Corner(usize),
    /// Middle of the edge from corner k to corner k+1.
    Edge(usize),
    /// Inside: belongs to this cell alone.
    Interior,
}

/// One degree of freedom: the value at a point of the reference cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// Reference coordinates.
    pub at: [f64; 2],
    /// What it sits on.
    pub on: Entity,
}

/// Coefficients of a polynomial on (1, ξ, η, ξ², ξη, η²).
pub type Polynomial = [f64; 6];

/// The monomials (1, ξ, η, ξ², ξη, η²) at a point.
pub fn monomials([x, y]: [f64; 2]) -> [f64; 6] {
    [1.0, x, y, x * x, x * y, y * y]
}

/// A finite element: a reference cell, nodes, and one shape function per node.
#[derive(Debug)]
pub struct Element {
    /// Its name, as in file formats' documentation.
    pub name: &'static str,
    /// Its reference cell.
    pub shape: Shape,
    /// The highest degree p such that all polynomials of degree p are in its span.
    pub degree: usize,
    /// The nodes.
    pub nodes: &'static [Node],
    /// N_k, the function that is 1 at node k and 0 at the others.
    pub functions: &'static [Polynomial],
}

/// The most shape functions that an element has.
pub const MAX_DOFS: usize = 6;

impl Element {
    /// Number of shape functions.
    pub fn dofs(&self) -> usize {
        self.functions.len()
    }

    /// N_k(ξ) for every k; entries past [`dofs`](Self::dofs) are zero.
    pub fn values(&self, at: [f64; 2]) -> [f64; MAX_DOFS] {
        let m = monomials(at);
        let mut values = [0.0; MAX_DOFS];
        for (value, p) in values.iter_mut().zip(self.functions) {
            *value = p.iter().zip(&m).map(|(c, m)| c * m).sum();
        }
        values
    }
}

const fn corner(k: usize, at: [f64; 2]) -> Node {
    Node { at, on: Entity::Corner(k) }
}

const fn edge(k: usize, at: [f64; 2]) -> Node {
    Node { at, on: Entity::Edge(k) }
}

static CONSTANT_TRIANGLE: Element = Element {
    name: "constant triangle",
    shape: Shape::Triangle,
    degree: 0,
    nodes: &[Node { at: [1.0 / 3.0, 1.0 / 3.0], on: Entity::Interior }],
    functions: &[[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]],
};

static CONSTANT_QUAD: Element = Element {
    name: "constant quad",
    shape: Shape::Quad,
    degree: 0,
    nodes: &[Node { at: [0.5, 0.5], on: Entity::Interior }],
    functions: &[[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]],
};

static LINEAR_TRIANGLE: Element = Element {
    name: "linear triangle",
    shape: Shape::Triangle,
    degree: 1,
    nodes: &[corner(0, [0.0, 0.0]), corner(1, [1.0, 0.0]), corner(2, [0.0, 1.0])],
    functions: &[
        [1.0, -1.0, -1.0, 0.0, 0.0, 0.0], //
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    ],
};

static BILINEAR_QUAD: Element = Element {
    name: "bilinear quad",
    shape: Shape::Quad,
    degree: 1,
    nodes: &[corner(0, [0.0, 0.0]), corner(1, [1.0, 0.0]), corner(2, [1.0, 1.0]), corner(3, [0.0, 1.0])],
    functions: &[
        [1.0, -1.0, -1.0, 0.0, 1.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, -1.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, -1.0, 0.0],
    ],
};

static QUADRATIC_TRIANGLE: Element = Element {
    name: "quadratic triangle",
    shape: Shape::Triangle,
    degree: 2,
    nodes: &[
        corner(0, [0.0, 0.0]),
        corner(1, [1.0, 0.0]),
        corner(2, [0.0, 1.0]),
        edge(0, [0.5, 0.0]),
        edge(1, [0.5, 0.5]),
        edge(2, [0.0, 0.5]),
    ],
    functions: &[
        [1.0, -3.0, -3.0, 2.0, 4.0, 2.0],
        [0.0, -1.0, 0.0, 2.0, 0.0, 0.0],
        [0.0, 0.0, -1.0, 0.0, 0.0, 2.0],
        [0.0, 4.0, 0.0, -4.0, -4.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 4.0, 0.0],
        [0.0, 0.0, 4.0, 0.0, -4.0, -4.0],
    ],
};

/// What `--basis` chooses: an element for each shape of cell.
#[derive(Debug)]
pub struct Basis {
    /// The name users type.
    pub name: &'static str,
    /// One line for help texts.
    pub summary: &'static str,
    /// The L2 order of accuracy on smooth functions.
    pub order: usize,
    /// The element on triangles.
    pub triangle: &'static Element,
    /// The element on quads; where there is none, quads are split into triangles.
    pub quad: Option<&'static Element>,
}

impl Basis {
    /// The basis of that name.
    pub fn named(name: &str) -> Option<&'static Self> {
        ALL.iter().find(|basis| basis.name == name)
    }

    /// The element on a shape; `None` where cells of that shape must be split first.
    pub fn element(&self, shape: Shape) -> Option<&'static Element> {
        match shape {
            Shape::Triangle => Some(self.triangle),
            Shape::Quad => self.quad,
        }
    }

    /// Whether its functions can be joined continuously (some node sits on a cell's boundary).
    pub fn can_be_continuous(&self) -> bool {
        self.triangle.nodes.iter().any(|node| node.on != Entity::Interior)
    }
}

impl PartialEq for Basis {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

/// Every basis, simplest first.
pub static ALL: [Basis; 4] = [
    Basis {
        name: "constant",
        summary: "one value per element (classical radiosity)",
        order: 1,
        triangle: &CONSTANT_TRIANGLE,
        quad: Some(&CONSTANT_QUAD),
    },
    Basis {
        name: "linear",
        summary: "hat functions at the vertices of triangles; quads are split",
        order: 2,
        triangle: &LINEAR_TRIANGLE,
        quad: None,
    },
    Basis {
        name: "bilinear",
        summary: "bilinear hats on quads, linear hats on triangles",
        order: 2,
        triangle: &LINEAR_TRIANGLE,
        quad: Some(&BILINEAR_QUAD),
    },
    Basis {
        name: "quadratic",
        summary: "values at vertices and edge midpoints of triangles; quads are split",
        order: 3,
        triangle: &QUADRATIC_TRIANGLE,
        quad: None,
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    fn elements() -> impl Iterator<Item = &'static Element> {
        ALL.iter().flat_map(|basis| Shape::ALL.into_iter().filter_map(|shape| basis.element(shape)))
    }

    /// The conformance test that every element passes.
    #[test]
    fn every_element_is_nodal_sums_to_one_and_is_exact_to_its_degree() {
        let points = [[0.2, 0.3], [0.0, 0.0], [0.7, 0.1], [1.0 / 3.0, 0.4]];
        for element in elements() {
            assert_eq!(element.nodes.len(), element.functions.len(), "{}", element.name);
            assert!(element.dofs() <= MAX_DOFS);
            for (k, node) in element.nodes.iter().enumerate() {
                let values = element.values(node.at);
                for (l, value) in values.iter().enumerate() {
                    assert!((value - f64::from(u8::from(k == l))).abs() < 1e-15, "{}: N_{l} at node {k}", element.name);
                }
            }
            for at in points {
                let values = element.values(at);
                assert!((values.iter().sum::<f64>() - 1.0).abs() < 1e-15, "{}: partition of unity", element.name);
                // Interpolating a monomial of degree ≤ p gives it back.
                for (m, degree) in [0, 1, 1, 2, 2, 2].into_iter().enumerate().filter(|&(_, d)| d <= element.degree) {
                    let interpolated: f64 =
                        element.nodes.iter().zip(&values).map(|(node, n)| monomials(node.at)[m] * n).sum();
                    assert!((interpolated - monomials(at)[m]).abs() < 1e-15, "{}: degree {degree}", element.name);
                }
            }
        }
    }

    #[test]
    fn a_node_sits_where_its_entity_says() {
        for element in elements() {
            let corners = element.shape.reference_corners();
            for node in element.nodes {
                let expected = match node.on {
                    Entity::Corner(k) => corners[k],
                    Entity::Edge(k) => {
                        let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
                        [f64::midpoint(a[0], b[0]), f64::midpoint(a[1], b[1])]
                    }
                    Entity::Interior => continue,
                };
                assert_eq!(node.at, expected, "{}", element.name);
            }
        }
    }

    #[test]
    fn the_order_of_a_basis_is_its_degree_plus_one() {
        for basis in &ALL {
            assert_eq!(basis.order, basis.triangle.degree + 1, "{}", basis.name);
            assert_eq!(Basis::named(basis.name), Some(basis));
        }
    }
}

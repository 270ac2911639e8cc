//! The space of functions in which the radiosity is sought: an element on every cell, joined where the light is
//! continuous.
//!
//! Everything is computed in the *broken* space, where cells share nothing; continuity is a sparse matrix C whose
//! columns are the joined functions (hats) written in broken coefficients. Assembly, elements and operators never hear
//! of it: `Δ_hat = CᵀΔC` and `F̂_hat = CᵀF̂C`.
//!
//! Cells are joined across the edges they share, and only where radiosity cannot jump: see [`Continuity::Continuous`].
//! Joining goes from cell to cell around a vertex, never through the vertex alone, so two surfaces that touch in a point
//! stay apart.

use crate::element::{Basis, Element, Entity, MAX_DOFS};
use crate::linalg::Csr;
use crate::mesh::{Mesh, Side, Topology, UnionFind};
use crate::scene::Scene;
use glam::DVec3;
use std::sync::Arc;

/// The greatest angle between normals across which the light is still taken to be continuous: 30°. Facets of a curved
/// surface meet at less (a cylinder of twelve sides just so); the edges that are meant as edges at more.
pub const CREASE_ANGLE: f64 = std::f64::consts::PI / 6.0;

/// A cell that is turned by less than this, 1°, against another at the same edge lies on it and does not stand on it.
pub(crate) const COPLANAR_ANGLE: f64 = std::f64::consts::PI / 180.0;

/// Where functions are continuous.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Continuity {
    /// Nowhere: every cell on its own.
    Broken,
    /// Across an edge whose two cells run through it in opposite directions, are turned against each other by no more
    /// than the crease angle (as are the normals that the file gives at the edge's ends), and reflect and emit the same.
    /// Where more than two cells meet, the flattest pairs are joined first; the two sides of a sheet never, nor cells with
    /// another standing on their edge in front of them: the light jumps across its foot.
    Continuous {
        /// The greatest angle between the normals, in radians.
        crease_angle: f64,
    },
}

impl Continuity {
    /// The names users type, with one line of help for each.
    pub const NAMES: [(&'static str, &'static str); 2] = [
        ("continuous", "joined across edges, except at creases and where the material changes"),
        ("broken", "every element on its own"),
    ];

    /// The continuity of that name, with the usual [`CREASE_ANGLE`].
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "continuous" => Some(Self::Continuous { crease_angle: CREASE_ANGLE }),
            "broken" => Some(Self::Broken),
            _ => None,
        }
    }

    /// Its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Continuous { .. } => "continuous",
            Self::Broken => "broken",
        }
    }
}

/// An element on every cell of a mesh, and how they are joined. Clones share what they are made of.
#[derive(Debug, Clone)]
pub struct FunctionSpace {
    basis: &'static Basis,
    elements: Arc<[&'static Element]>,
    offsets: Arc<[usize]>,
    joined: Continuity,
    continuity: Option<Arc<Csr>>,
}

/// A cell has a shape for which the basis has no element; refine the scene for that basis first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cell {cell} is a quad, and the basis `{basis}` has no element for quads; split it into triangles first")]
pub struct NoElement {
    /// Index of the cell.
    pub cell: usize,
    /// Name of the basis.
    pub basis: &'static str,
}

impl FunctionSpace {
    /// The space of a basis on the cells of a scene. A basis whose functions live inside the cells (`constant`) has
    /// nothing to join and gives the broken space.
    ///
    /// # Errors
    /// [`NoElement`] if a cell's shape has no element in this basis.
    pub fn new(scene: &Scene, basis: &'static Basis, continuity: Continuity) -> Result<Self, NoElement> {
        let mut space = Self { joined: continuity, ..Self::broken(&scene.mesh, basis)? };
        if let Continuity::Continuous { crease_angle } = continuity
            && basis.can_be_continuous()
        {
            let mut sets = UnionFind::new(space.broken_dofs());
            for [a, b] in joints(scene, crease_angle) {
                space.join(&scene.mesh, a, b, &mut sets);
            }
            space.continuity = Some(Arc::new(numbered(&mut sets, space.broken_dofs())));
        }
        Ok(space)
    }

    /// Makes the coefficients of two cells the same on an edge that they run through in opposite directions.
    fn join(&self, mesh: &Mesh, a: Side, b: Side, sets: &mut UnionFind) {
        for (i, place) in self.nodes_on(mesh, a) {
            for (j, _) in self.nodes_on(mesh, b).filter(|&(_, other)| other == place) {
                sets.join(i, j);
            }
        }
    }

    /// The broken coefficients of a cell's nodes on an edge, each with the vertex it sits on (`None`: in the middle).
    fn nodes_on<'a>(&'a self, mesh: &'a Mesh, side: Side) -> impl Iterator<Item = (usize, Option<u32>)> + 'a {
        let (cell, edge) = (side.cell as usize, usize::from(side.edge));
        let corners = mesh.cells[cell].corners();
        self.elements[cell].nodes.iter().zip(self.range(cell)).filter_map(move |(node, dof)| match node.on {
            Entity::Corner(k) if k == edge || k == (edge + 1) % corners.len() => Some((dof, Some(corners[k]))),
            Entity::Edge(k) if k == edge => Some((dof, None)),
            _ => None,
        })
    }

    /// The broken space: every cell on its own.
    ///
    /// # Errors
    /// [`NoElement`] if a cell's shape has no element in this basis.
    pub fn broken(mesh: &Mesh, basis: &'static Basis) -> Result<Self, NoElement> {
        let element = |(cell, shape)| basis.element(shape).ok_or(NoElement { cell, basis: basis.name });
        let shapes = mesh.cells.iter().map(|cell| cell.shape).enumerate();
        let elements = shapes.map(element).collect::<Result<Vec<_>, _>>()?;
        let mut offsets = vec![0];
        for element in &elements {
            offsets.push(offsets[offsets.len() - 1] + element.dofs());
        }
        Ok(Self {
            basis,
            elements: elements.into(),
            offsets: offsets.into(),
            joined: Continuity::Broken,
            continuity: None,
        })
    }

    /// The basis.
    pub fn basis(&self) -> &'static Basis {
        self.basis
    }

    /// The element on a cell.
    pub fn element(&self, cell: usize) -> &'static Element {
        self.elements[cell]
    }

    /// First broken coefficient of each cell, and their number at the end.
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// The broken coefficients of a cell.
    pub fn range(&self, cell: usize) -> std::ops::Range<usize> {
        self.offsets[cell]..self.offsets[cell + 1]
    }

    /// A function with these broken coefficients at a point of a cell (reference coordinates).
    pub fn evaluate(&self, coefficients: &[f64], cell: usize, at: [f64; 2]) -> f64 {
        let functions: [f64; MAX_DOFS] = self.element(cell).values(at);
        coefficients[self.range(cell)].iter().zip(functions).map(|(b, n)| b * n).sum()
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.elements.len()
    }

    /// Number of broken coefficients.
    pub fn broken_dofs(&self) -> usize {
        self.offsets[self.cells()]
    }

    /// Number of unknowns: of hats if the space is continuous, of broken coefficients otherwise.
    pub fn dofs(&self) -> usize {
        self.continuity().map_or(self.broken_dofs(), crate::linalg::LinearOperator::cols)
    }

    /// The unknowns that a broken coefficient is made of, with their shares.
    pub(crate) fn unknowns_of(&self, dof: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let joined = self.continuity.as_ref().map(|c| c.row(dof)).into_iter().flatten();
        joined.chain(self.continuity.is_none().then_some((dof, 1.0)))
    }

    /// For each column of `c`, which joins broken coefficients, Σ w v over the values that it joins and Σ w; the weight is that
    /// of a coefficient of a cell.
    pub(crate) fn sums(&self, c: &Csr, values: &[f64], weight: impl Fn(usize, usize) -> f64) -> Vec<[f64; 2]> {
        let mut sums = vec![[0.0; 2]; crate::linalg::LinearOperator::cols(c)];
        for cell in 0..self.cells() {
            for dof in self.range(cell) {
                let weight = weight(cell, dof);
                for (unknown, share) in c.row(dof) {
                    sums[unknown][0] += share * weight * values[dof];
                    sums[unknown][1] += share * weight;
                }
            }
        }
        sums
    }

    /// How functions were asked to be joined.
    pub(crate) fn joined(&self) -> Continuity {
        self.joined
    }

    /// C, broken coefficients from joined ones; `None` if nothing is joined.
    pub fn continuity(&self) -> Option<&Csr> {
        self.continuity.as_deref()
    }

    /// The same, shared.
    pub(crate) fn shared_continuity(&self) -> Option<&Arc<Csr>> {
        self.continuity.as_ref()
    }
}

/// The pairs of cells across whose common edge functions are continuous.
pub(crate) fn joints(scene: &Scene, crease_angle: f64) -> Vec<[Side; 2]> {
    let topology = Topology::new(&scene.mesh);
    let mut joints: Vec<[Side; 2]> = Vec::new();
    for edge in 0..topology.edges() {
        let sides = topology.sides(edge);
        let pairs = sides.iter().enumerate().flat_map(|(i, a)| sides[i + 1..].iter().map(move |b| [*a, *b]));
        let mut candidates: Vec<(f64, [Side; 2])> =
            pairs.filter_map(|pair| Some((bend(scene, pair, crease_angle)?, pair))).collect();
        candidates.retain(|(_, pair)| !parted(&scene.mesh, sides, *pair));
        // Stable, so that equally flat pairs stay in the order of their cells.
        candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
        let first = joints.len();
        for (_, [a, b]) in candidates {
            if joints[first..].iter().flatten().all(|taken| *taken != a && *taken != b) {
                joints.push([a, b]);
            }
        }
    }
    joints
}

/// The angle between the normals of two cells at an edge, if functions are continuous there.
fn bend(scene: &Scene, [a, b]: [Side; 2], crease_angle: f64) -> Option<f64> {
    let (cell, other) = (a.cell as usize, b.cell as usize);
    let cells = &scene.mesh.cells;
    let angle = scene.mesh.normal_angle(cell, other);
    // A crease angle of exactly the facets' angle is meant to join them.
    let crease_angle = crease_angle + 1e-9;
    let joined = cell != other
        && a.forward != b.forward
        && angle <= crease_angle
        && scene.same_material(cells[cell].material, cells[other].material)
        && split_normals(&scene.mesh, a, b) <= crease_angle;
    joined.then_some(angle)
}

/// Whether another cell stands on the edge between two, in front of both. The cells around the edge are told apart by
/// the angle through which the first must be turned to become them, on its lit side.
fn parted(mesh: &Mesh, sides: &[Side], [a, b]: [Side; 2]) -> bool {
    let into = |side: Side| {
        let patch = mesh.patch(side.cell as usize);
        let (corners, k) = (patch.corners(), usize::from(side.edge));
        patch.normal().cross(corners[(k + 1) % corners.len()] - corners[k])
    };
    let (x, y) = (into(a).normalize_or_zero(), mesh.patch(a.cell as usize).normal());
    let turn = |side: Side| {
        let direction = into(side);
        direction.dot(y).atan2(direction.dot(x)).rem_euclid(std::f64::consts::TAU)
    };
    let between = COPLANAR_ANGLE..turn(b) - COPLANAR_ANGLE;
    sides.len() > 2 && sides.iter().any(|&side| between.contains(&turn(side)))
}

/// The greatest angle between the normals that the file gives two cells at the ends of an edge; 0 if it gives none.
fn split_normals(mesh: &Mesh, a: Side, b: Side) -> f64 {
    if mesh.normals.is_empty() {
        return 0.0;
    }
    let ends = |side: Side| {
        let (cell, k) = (side.cell as usize, usize::from(side.edge));
        [k, (k + 1) % mesh.cells[cell].corners().len()].map(|corner| mesh.normals[cell][corner])
    };
    let ([a0, a1], [b0, b1]) = (ends(a), ends(b));
    let angle = |m: DVec3, n: DVec3| m.cross(n).length().atan2(m.dot(n));
    angle(a0, b1).max(angle(a1, b0))
}

/// C from the sets of coefficients that are one: an unknown per set, in order of first appearance.
fn numbered(sets: &mut UnionFind, broken_dofs: usize) -> Csr {
    let mut unknown = vec![u32::MAX; broken_dofs];
    let mut count = 0;
    let mut triplets = Vec::with_capacity(broken_dofs);
    for dof in 0..broken_dofs {
        // A set is named by its least member, so the name comes first.
        let set = sets.find(dof);
        if set == dof {
            unknown[dof] = count;
            count += 1;
        }
        triplets.push((dof as u32, unknown[set], 1.0));
    }
    Csr::from_triplets(broken_dofs, count as usize, triplets)
}

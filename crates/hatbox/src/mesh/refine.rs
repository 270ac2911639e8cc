//! Conforming subdivision, down to a greatest edge length or up to a number of cells.
//!
//! Every edge of the input gets a *level* before anything is split: it will be cut into 2^level equal parts, on whichever
//! cell it is looked at, so the result is conforming without any repair, across the two sides of a sheet too. Opposite
//! edges of a quad must have one level, and so must everything connected through quads; triangles take any three levels.
//! Edges that arise inside a triangle belong to it alone and get the level of their own length.

use super::corner::{Builder, Corner};
use super::topology::UnionFind;
use super::{Mesh, Topology};
use crate::element::Shape;
use rustc_hash::FxHashMap;
use std::ops::ControlFlow;

/// The most cells that a refinement may produce.
pub const MAX_CELLS: usize = 50_000_000;

/// How finely to subdivide.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Refinement {
    /// Not at all.
    #[default]
    None,
    /// Until no edge is longer than this, in metres.
    MaxEdge(f64),
    /// By the greatest edge length whose number of cells is closest to this (as a ratio) and no less than half of it;
    /// never fewer cells than there were.
    Elements(usize),
}

/// A refinement that cannot be made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RefineError {
    /// The length is not a positive number.
    #[error("the greatest edge length must be a positive number of metres, not {0}")]
    Length(f64),
    /// Nobody wants so many cells.
    #[error(
        "subdividing to edges of at most {max_edge} m gives more than {MAX_CELLS} cells; allow longer edges, ask for a \
         number of cells, or check the length unit of the file"
    )]
    TooMany {
        /// The length that was asked for, in metres.
        max_edge: f64,
    },
    /// Nobody wants so many cells.
    #[error("{0} cells are more than the {MAX_CELLS} that a mesh may have; ask for fewer")]
    TooManyElements(usize),
}

impl Mesh {
    /// Subdivides the cells; the pieces of a cell take its place, in a fixed order, and inherit its material, group and
    /// surface. Texture coordinates and normals are interpolated. On a welded, T-junction-free mesh the result has no
    /// hanging vertices.
    ///
    /// # Errors
    /// [`RefineError`] if the length is not positive or the result would have more than [`MAX_CELLS`] cells.
    pub fn refined(&self, refinement: Refinement) -> Result<Self, RefineError> {
        self.refined_with_parents(refinement).map(|(mesh, _)| mesh)
    }

    /// The same, and for each cell that of which it is a piece.
    pub(super) fn refined_with_parents(&self, refinement: Refinement) -> Result<(Self, Vec<u32>), RefineError> {
        let plan = Plan::new(self);
        let unchanged = || (self.clone(), (0..self.cells.len() as u32).collect());
        let max_edge = match refinement {
            Refinement::None => return Ok(unchanged()),
            Refinement::MaxEdge(h) if h.is_nan() || h <= 0.0 => return Err(RefineError::Length(h)),
            Refinement::MaxEdge(h) => h,
            Refinement::Elements(n) if n > MAX_CELLS => return Err(RefineError::TooManyElements(n)),
            Refinement::Elements(n) if n <= self.cells.len() => return Ok(unchanged()),
            Refinement::Elements(n) => plan.edge_for(n),
        };
        if plan.count(max_edge, MAX_CELLS) > MAX_CELLS {
            return Err(RefineError::TooMany { max_edge });
        }
        Ok(plan.carry_out(max_edge))
    }

    /// About how many cells [`Mesh::refined`] makes, without making them: exactly, except that
    /// [`Refinement::Elements`] is taken at its word.
    ///
    /// # Errors
    /// Those of [`Mesh::refined`].
    pub fn refined_count(&self, refinement: Refinement) -> Result<usize, RefineError> {
        match refinement {
            Refinement::None => Ok(self.cells.len()),
            Refinement::MaxEdge(h) if h.is_nan() || h <= 0.0 => Err(RefineError::Length(h)),
            Refinement::MaxEdge(max_edge) => {
                let count = Plan::new(self).count(max_edge, MAX_CELLS);
                if count > MAX_CELLS { Err(RefineError::TooMany { max_edge }) } else { Ok(count) }
            }
            Refinement::Elements(n) if n > MAX_CELLS => Err(RefineError::TooManyElements(n)),
            Refinement::Elements(n) => Ok(n.max(self.cells.len())),
        }
    }
}

/// The number of halvings that bring a length down to `max_edge`, forgiving the last bits.
fn level(length: f64, max_edge: f64) -> u32 {
    // No length of a finite mesh needs more halvings than there are bits; counting stops long before.
    ((length / max_edge).log2() - 1e-9).ceil().clamp(0.0, 1100.0) as u32
}

/// What is known before a length is chosen.
struct Plan<'a> {
    mesh: &'a Mesh,
    topology: Topology,
    /// For each edge, the length that decides its level: the greatest of all that must share it.
    lengths: Vec<f64>,
    area: f64,
}

impl<'a> Plan<'a> {
    fn new(mesh: &'a Mesh) -> Self {
        let topology = Topology::new(mesh);
        let mut classes = UnionFind::new(topology.edges());
        for (index, _) in mesh.cells.iter().enumerate().filter(|(_, cell)| cell.shape == Shape::Quad) {
            classes.join(topology.edge(index, 0), topology.edge(index, 2));
            classes.join(topology.edge(index, 1), topology.edge(index, 3));
        }
        let mut longest = vec![0.0_f64; topology.edges()];
        for edge in 0..topology.edges() {
            let [a, b] = topology.vertices(edge).map(|v| mesh.vertices[v as usize]);
            let class = classes.find(edge);
            longest[class] = longest[class].max(a.distance(b));
        }
        let lengths = (0..topology.edges()).map(|edge| longest[classes.find(edge)]).collect();
        Self { mesh, topology, lengths, area: mesh.area() }
    }

    /// Splits every cell into `target`, until it has had enough.
    fn split(&self, max_edge: f64, target: &mut impl Target) -> ControlFlow<()> {
        for (index, cell) in self.mesh.cells.iter().enumerate() {
            target.begin(index);
            let corners = self.mesh.corners(index);
            let levels = |k| level(self.lengths[self.topology.edge(index, k)], max_edge);
            match cell.shape {
                Shape::Triangle => {
                    let [a, b, c, _] = corners;
                    split_triangle([a, b, c], [0, 1, 2].map(levels), max_edge, target)?;
                }
                Shape::Quad => split_quad(&corners, [0, 1].map(levels), target)?,
            }
        }
        ControlFlow::Continue(())
    }

    /// The number of cells, or something greater than `limit` if it is greater.
    fn count(&self, max_edge: f64, limit: usize) -> usize {
        // No cell with edges up to h is larger than h².
        if self.area > limit as f64 * max_edge * max_edge {
            return limit.saturating_add(1);
        }
        let mut count = Count { cells: 0, limit };
        // Stopping early is the count's way to say that there are more.
        let _ = self.split(max_edge, &mut count);
        count.cells
    }

    fn carry_out(&self, max_edge: f64) -> (Mesh, Vec<u32>) {
        let builder = Builder::like(self.mesh);
        let mut build =
            Build { mesh: self.mesh, cell: 0, builder, midpoints: FxHashMap::default(), parents: Vec::new() };
        let _ = self.split(max_edge, &mut build);
        (build.builder.finish(), build.parents)
    }

    /// The length for a number of cells: bisection in its logarithm, remembering the best.
    fn edge_for(&self, wanted: usize) -> f64 {
        let miss = |count: usize| {
            let ratio = count as f64 / wanted as f64;
            ratio.ln().abs() + if ratio < 0.5 { 1e3 } else { 0.0 }
        };
        let mut long = self.lengths.iter().copied().fold(0.0, f64::max);
        let mut best = (miss(self.mesh.cells.len()), long);
        let limit = wanted.saturating_mul(8).min(MAX_CELLS);
        let mut try_length = |h: f64| {
            let count = self.count(h, limit);
            // Beyond the limit nothing is counted, so nothing can be said about how close it is.
            if count <= limit && miss(count) < best.0 {
                best = (miss(count), h);
            }
            count < wanted
        };
        let mut short = 0.5 * long;
        while try_length(short) && short > 0.0 {
            (long, short) = (short, 0.5 * short);
        }
        for _ in 0..24 {
            let middle = (long * short).sqrt();
            if try_length(middle) {
                long = middle;
            } else {
                short = middle;
            }
        }
        best.1
    }
}

/// What the splitting of cells is done for.
trait Target {
    /// The next cells are pieces of this one.
    fn begin(&mut self, cell: usize);
    /// The corner in the middle of an edge.
    fn midpoint(&mut self, a: &Corner, b: &Corner) -> Corner;
    /// A cell that is split no further.
    fn cell(&mut self, corners: &[Corner]) -> ControlFlow<()>;
    /// A quad that would be split into 2^`halvings` cells; true if they need not be listed one by one.
    fn quads(&mut self, _halvings: u32) -> bool {
        false
    }
}

/// Counts the cells.
struct Count {
    cells: usize,
    limit: usize,
}

impl Target for Count {
    fn begin(&mut self, _cell: usize) {}
    fn midpoint(&mut self, a: &Corner, b: &Corner) -> Corner {
        Corner { position: a.position.midpoint(b.position), ..*a }
    }
    fn cell(&mut self, _corners: &[Corner]) -> ControlFlow<()> {
        self.cells += 1;
        if self.cells > self.limit { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
    fn quads(&mut self, halvings: u32) -> bool {
        // One less: the quad itself is still to be passed to `cell`.
        let cells = 1_usize.checked_shl(halvings).unwrap_or(usize::MAX);
        self.cells = self.cells.saturating_add(cells - 1).min(usize::MAX - 1);
        true
    }
}

/// Makes the mesh.
struct Build<'a> {
    mesh: &'a Mesh,
    cell: usize,
    builder: Builder,
    midpoints: FxHashMap<[u32; 2], u32>,
    parents: Vec<u32>,
}

impl Target for Build<'_> {
    fn begin(&mut self, cell: usize) {
        self.cell = cell;
    }
    fn midpoint(&mut self, a: &Corner, b: &Corner) -> Corner {
        let ends = [a.vertex.min(b.vertex), a.vertex.max(b.vertex)];
        let position = a.position.midpoint(b.position);
        let vertex = *self.midpoints.entry(ends).or_insert_with(|| self.builder.vertex(position));
        a.between(b, 0.5, vertex, position)
    }
    fn cell(&mut self, corners: &[Corner]) -> ControlFlow<()> {
        self.builder.push(&self.mesh.cells[self.cell], corners);
        self.parents.push(self.cell as u32);
        ControlFlow::Continue(())
    }
}

/// Splits a triangle whose edge k, from corner k to the next, is to be halved `levels[k]` times: into four similar ones
/// if all edges are marked about equally, otherwise in two through the longest marked edge (of equal ones, that with the
/// least midpoint, so that the back of a sheet is split like its front).
fn split_triangle(corners: [Corner; 3], levels: [u32; 3], max_edge: f64, target: &mut impl Target) -> ControlFlow<()> {
    let (most, least) = (levels.into_iter().fold(0, u32::max), levels.into_iter().fold(u32::MAX, u32::min));
    if most == 0 {
        return target.cell(&corners);
    }
    if least > 0 && most - least <= 1 {
        return split_red(corners, levels, max_edge, target);
    }
    let edge = |k: usize| (corners[k].position, corners[(k + 1) % 3].position);
    let longest = (0..3).filter(|&k| levels[k] > 0).max_by(|&i, &j| {
        let ((a, b), (c, d)) = (edge(i), edge(j));
        let (m, n) = (a.midpoint(b).to_array(), c.midpoint(d).to_array());
        let least_midpoint = || n.partial_cmp(&m).unwrap_or(std::cmp::Ordering::Equal);
        a.distance_squared(b).total_cmp(&c.distance_squared(d)).then_with(least_midpoint)
    });
    let k = longest.unwrap_or(0);
    let [a, b, c] = [k, k + 1, k + 2].map(|i| corners[i % 3]);
    let [ab, bc, ca] = [k, k + 1, k + 2].map(|i| levels[i % 3]);
    let middle = target.midpoint(&a, &b);
    let inner = level(middle.position.distance(c.position), max_edge);
    split_triangle([a, middle, c], [ab - 1, inner, ca], max_edge, target)?;
    split_triangle([middle, b, c], [ab - 1, bc, inner], max_edge, target)
}

/// Splits a triangle into four through the middles of its edges.
fn split_red(corners: [Corner; 3], levels: [u32; 3], max_edge: f64, target: &mut impl Target) -> ControlFlow<()> {
    let [a, b, c] = corners;
    let [ab, bc, ca] = levels.map(|l| l - 1);
    let (p, q, r) = (target.midpoint(&a, &b), target.midpoint(&b, &c), target.midpoint(&c, &a));
    let inner = |from: &Corner, to: &Corner| level(from.position.distance(to.position), max_edge);
    let (pq, qr, rp) = (inner(&p, &q), inner(&q, &r), inner(&r, &p));
    split_triangle([a, p, r], [ab, rp, ca], max_edge, target)?;
    split_triangle([p, b, q], [ab, bc, pq], max_edge, target)?;
    split_triangle([r, q, c], [qr, bc, ca], max_edge, target)?;
    split_triangle([p, q, r], [pq, qr, rp], max_edge, target)
}

/// Splits a quad into 2^`levels[0]` columns (edges 0 and 2) by 2^`levels[1]` rows: halves of halves of a bilinear map
/// are the halves of straight lines, so midpoints are all it takes. The direction with the higher level goes first; of
/// equal ones, that of the edge with the least midpoint.
fn split_quad(corners: &[Corner; 4], levels: [u32; 2], target: &mut impl Target) -> ControlFlow<()> {
    if levels == [0, 0] || target.quads(levels[0] + levels[1]) {
        return target.cell(corners);
    }
    let &[a, b, c, d] = corners;
    let [columns, rows] = levels;
    if columns > rows || (columns == rows && runs_first(corners)) {
        let (p, q) = (target.midpoint(&a, &b), target.midpoint(&c, &d));
        split_quad(&[a, p, q, d], [columns - 1, rows], target)?;
        split_quad(&[p, b, c, q], [columns - 1, rows], target)
    } else {
        let (p, q) = (target.midpoint(&b, &c), target.midpoint(&d, &a));
        split_quad(&[a, b, p, q], [columns, rows - 1], target)?;
        split_quad(&[q, p, c, d], [columns, rows - 1], target)
    }
}

/// Whether the edge with the least midpoint is edge 0 or 2.
fn runs_first(corners: &[Corner; 4]) -> bool {
    let middle = |k: usize| corners[k].position.midpoint(corners[(k + 1) % 4].position).to_array();
    let least = |i, j| if middle(j) < middle(i) { middle(j) } else { middle(i) };
    least(0, 2) < least(1, 3)
}

//! Values at vertices: the solution as triangles that any renderer draws.
//!
//! Renderers interpolate linearly between vertices, so a cell becomes as many triangles as keep the shape of its
//! function: one or two, or four through the edge midpoints where the element is quadratic. Corners that agree in
//! place, normal, texture coordinates and value share a vertex; where radiosity jumps they do not, and the jump is
//! kept. What is shown is the solution [limited]: without the over- and undershoots next to a hard shadow.

mod exposure;
mod limit;

pub use exposure::{Exposure, luminance, percentile, rgb, srgb};
pub use limit::limited;

use crate::element::Shape;
use crate::linalg::MultiVector;
use crate::radiosity::{Shown, Solution};
use glam::{DVec2, DVec3};
use std::collections::HashMap;
use std::ops::Range;

/// The solution as triangles with values at their vertices, sorted into parts of one group and one material.
#[derive(Debug, Clone, PartialEq)]
pub struct Baked {
    /// Positions in metres.
    pub positions: Vec<DVec3>,
    /// Unit normals: those of the input if it gave any, else the cells'.
    pub normals: Vec<DVec3>,
    /// Texture coordinates (v runs down); empty if the mesh has none.
    pub uvs: Vec<DVec2>,
    /// Vertices × bands: B in lm/m² or W/m², or E in lx or W/m². None is negative, and none over- or undershoots.
    pub values: MultiVector,
    /// Indices of vertices, counter-clockwise from the lit side.
    pub triangles: Vec<[u32; 3]>,
    /// The parts, by group and then material; each has its own vertices.
    pub parts: Vec<Part>,
}

/// The triangles of one group and one material.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Index into [`crate::mesh::Mesh::groups`].
    pub group: u32,
    /// Index into [`crate::scene::Scene::materials`].
    pub material: u32,
    /// Its vertices.
    pub vertices: Range<usize>,
    /// Its triangles.
    pub triangles: Range<usize>,
}

/// Bakes B or E, [limited], into vertices.
pub fn bake(solution: &Solution, shown: Shown) -> Baked {
    let solution = &limited(solution);
    let mesh = &solution.scene.mesh;
    let mut order: Vec<usize> = (0..mesh.cells.len()).collect();
    order.sort_by_key(|&cell| (mesh.cells[cell].group, mesh.cells[cell].material));
    let mut baker = Baker::new(solution, shown);
    for part in order.chunk_by(|&a, &b| {
        let key = |cell: usize| (mesh.cells[cell].group, mesh.cells[cell].material);
        key(a) == key(b)
    }) {
        baker.part(part);
    }
    let Baker { positions, normals, uvs, values, triangles, parts, .. } = baker;
    let bands = solution.bands();
    let values = MultiVector::from_fn(positions.len(), bands, |vertex, band| values[vertex * bands + band]);
    Baked { positions, normals, uvs, values, triangles, parts }
}

/// Where a cell is sampled and how the samples are joined.
struct Pattern {
    /// The cell's corners between which each sample lies; equal at a corner.
    between: &'static [[usize; 2]],
    /// Indices of samples.
    triangles: &'static [[u32; 3]],
}

impl Pattern {
    fn of(shape: Shape, degree: usize) -> Self {
        match shape {
            Shape::Triangle if degree < 2 => Self { between: &[[0, 0], [1, 1], [2, 2]], triangles: &[[0, 1, 2]] },
            Shape::Triangle => Self {
                between: &[[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [2, 0]],
                triangles: &[[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
            },
            Shape::Quad => Self { between: &[[0, 0], [1, 1], [2, 2], [3, 3]], triangles: &[[0, 1, 2], [0, 2, 3]] },
        }
    }
}

/// A place shared by cells: the mesh vertices that it lies between, in order.
type Place = [u32; 2];

/// No vertex.
const NONE: u32 = u32::MAX;

struct Baker<'a> {
    solution: &'a Solution,
    shown: Shown,
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
    uvs: Vec<DVec2>,
    values: Vec<f64>,
    triangles: Vec<[u32; 3]>,
    parts: Vec<Part>,
    /// The last vertex made at a place, in the part at hand …
    last: HashMap<Place, u32>,
    /// … and the one made there before each.
    before: Vec<u32>,
    /// What values may differ by and still be the same, however small they are.
    rounding: f64,
}

/// A vertex that may have been made before.
struct Candidate<'a> {
    position: DVec3,
    normal: DVec3,
    uv: DVec2,
    values: &'a [f64],
}

impl<'a> Baker<'a> {
    fn new(solution: &'a Solution, shown: Shown) -> Self {
        let field = match shown {
            Shown::Radiosity => &solution.radiosity,
            Shown::Irradiance => &solution.irradiance,
        };
        let greatest = field.as_slice().iter().fold(0.0, |greatest: f64, value| greatest.max(value.abs()));
        Self {
            rounding: 1e-12 * greatest,
            solution,
            shown,
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            values: Vec::new(),
            triangles: Vec::new(),
            parts: Vec::new(),
            last: HashMap::new(),
            before: Vec::new(),
        }
    }

    /// The cells of one part.
    fn part(&mut self, cells: &[usize]) {
        let (vertices, triangles) = (self.positions.len(), self.triangles.len());
        self.last.clear();
        for &cell in cells {
            self.cell(cell);
        }
        let first = &self.solution.scene.mesh.cells[cells[0]];
        self.parts.push(Part {
            group: first.group,
            material: first.material,
            vertices: vertices..self.positions.len(),
            triangles: triangles..self.triangles.len(),
        });
    }

    fn cell(&mut self, cell: usize) {
        let element = self.solution.space.element(cell);
        let (mesh, bands) = (&self.solution.scene.mesh, self.solution.bands());
        let (corners, patch) = (mesh.cells[cell].corners(), mesh.patch(cell));
        let reference = element.shape.reference_corners();
        let pattern = Pattern::of(element.shape, element.degree);
        let mut values = vec![0.0; bands];
        let samples: Vec<u32> = pattern
            .between
            .iter()
            .map(|&[a, b]| {
                let at = [0, 1].map(|axis| f64::midpoint(reference[a][axis], reference[b][axis]));
                for (band, value) in values.iter_mut().enumerate() {
                    *value = self.solution.evaluate(self.shown, cell, at, band);
                }
                let given = mesh.normals.get(cell).map_or(DVec3::ZERO, |normals| normals[a] + normals[b]);
                let normal = given.normalize_or(patch.normal()).normalize_or(DVec3::Z);
                let position = patch.point(at);
                let candidate = Candidate { position, normal, uv: mesh.uv(cell, at), values: &values };
                // One value per cell jumps at every edge: nothing is shared.
                let place = (element.degree > 0).then(|| [corners[a].min(corners[b]), corners[a].max(corners[b])]);
                self.vertex(place, &candidate)
            })
            .collect();
        self.triangles.extend(pattern.triangles.iter().map(|t| t.map(|k| samples[k as usize])));
    }

    /// The vertex that is like the candidate at its place, or a new one.
    fn vertex(&mut self, place: Option<Place>, candidate: &Candidate) -> u32 {
        let newest = place.and_then(|place| self.last.get(&place).copied()).unwrap_or(NONE);
        let mut known = newest;
        while known != NONE {
            if self.is_like(known as usize, candidate) {
                return known;
            }
            known = self.before[known as usize];
        }
        let vertex = self.positions.len() as u32;
        self.positions.push(candidate.position);
        self.normals.push(candidate.normal);
        if !self.solution.scene.mesh.uvs.is_empty() {
            self.uvs.push(candidate.uv);
        }
        self.values.extend_from_slice(candidate.values);
        self.before.push(newest);
        if let Some(place) = place {
            self.last.insert(place, vertex);
        }
        vertex
    }

    fn is_like(&self, vertex: usize, candidate: &Candidate) -> bool {
        const TOLERANCE: f64 = 1e-6;
        let values = &self.values[vertex * candidate.values.len()..][..candidate.values.len()];
        let close = |(&a, &b): (&f64, &f64)| (a - b).abs() <= TOLERANCE * a.abs().max(b.abs()) + self.rounding;
        let uv = self.uvs.get(vertex).copied().unwrap_or_default();
        self.normals[vertex].distance(candidate.normal) <= TOLERANCE
            && uv.distance(candidate.uv) <= TOLERANCE
            && values.iter().zip(candidate.values).all(close)
    }
}

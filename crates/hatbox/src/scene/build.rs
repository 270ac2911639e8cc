//! From what a file says to a [`Scene`]: checked, welded, planar, conforming, with a back for every two-sided face.
//!
//! What has only one sensible repair is repaired and noted as a [`Warning`]; what has none is a [`SceneError`] that names
//! the place and the remedy. The order matters: quads are tested for planarity after welding has moved their corners, and
//! the faces that block light are recorded before T-junctions and contacts cut them up, so that a ray meets as few as
//! possible.

use super::{Camera, Material, Physics, Quantity, Scene, Surface};
use crate::element::{Basis, Shape};
use crate::mesh::{Bisected, Builder, Cell, Corner, Layers, Line, Lit, Mesh, RefineError, Refinement, Split};
use glam::DVec3;
use rustc_hash::FxHashMap;
use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

/// A scene that cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// There is nothing to compute.
    #[error("the scene has no faces; check that the file contains surfaces and that they were exported")]
    Empty,
    /// All faces are degenerate.
    #[error("none of the {0} faces has any area; check the scale and the transformations of the file")]
    NoArea(usize),
    /// There is nothing that light could leave or reach.
    #[error("all {0} faces only block light; give one of them a side that sends and receives it")]
    OnlyBlocking(usize),
    /// A coordinate is infinite or not a number.
    #[error("vertex {vertex} of `{group}` is at {position}, which is not a place; repair it in the modelling program")]
    Position {
        /// Index of the vertex.
        vertex: u32,
        /// Name of a part that uses it.
        group: String,
        /// What stands there.
        position: DVec3,
    },
    /// An index points at nothing.
    #[error("face {cell} refers to {what} {index}, but there are only {count}; the file is damaged, export it again")]
    Index {
        /// Index of the face.
        cell: usize,
        /// What is referred to: "vertex", "group" or "material".
        what: &'static str,
        /// The index.
        index: u32,
        /// How many there are.
        count: usize,
    },
    /// Texture coordinates or normals are given for some faces only.
    #[error("the mesh has {found} sets of {what} for {faces} faces; give every face one, or none")]
    Corners {
        /// "texture coordinates" or "normals".
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        faces: usize,
    },
    /// A reflectance outside 0…1.
    #[error(
        "material `{material}` reflects {value} in band {band}; a reflectance is between 0 and 1 (a surface cannot \
         reflect more than it receives), so scale it down"
    )]
    Reflectance {
        /// Name of the material.
        material: String,
        /// The band, counted from 0.
        band: usize,
        /// The offending value.
        value: f64,
    },
    /// A negative or infinite exitance.
    #[error("material `{material}` emits {value} in band {band}; an exitance is a finite number and not negative")]
    Exitance {
        /// Name of the material.
        material: String,
        /// The band, counted from 0.
        band: usize,
        /// The offending value.
        value: f64,
    },
    /// Numbers of bands that cannot be reconciled.
    #[error("material `{material}` has {found} bands, others have {bands}; give every material 1 or {bands}")]
    Bands {
        /// Name of the material.
        material: String,
        /// Its number of bands.
        found: usize,
        /// The greatest number of bands in the scene.
        bands: usize,
    },
}

/// Something about the input that was repaired.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Warning {
    /// So many faces had no area.
    Degenerate(usize),
    /// So many quads were not planar and convex.
    SplitQuads(usize),
    /// So many edges had other faces' vertices on them.
    TJunctions(usize),
    /// So many faces had others standing on them or passing through them.
    Contacts(usize),
    /// So many faces had others lying on them that look the same way.
    Layers(usize),
    /// Of what was left out of them, so many faces shine.
    HiddenLamps(usize),
    /// So many corners of faces were moved onto others by more than rounding.
    ClosedGaps(usize),
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Degenerate(1) => f.write_str("left out a face that has no area"),
            Self::Degenerate(n) => write!(f, "left out {n} faces that have no area"),
            Self::SplitQuads(1) => f.write_str("split a quad into triangles because it is not planar and convex"),
            Self::SplitQuads(n) => write!(f, "split {n} quads into triangles because they are not planar and convex"),
            Self::TJunctions(1) => f.write_str("split an edge at vertices of other faces that lie on it"),
            Self::TJunctions(n) => write!(f, "split {n} edges at vertices of other faces that lie on them"),
            Self::Contacts(1) => f.write_str("split a face along the lines in which others touch or cross it"),
            Self::Contacts(n) => write!(f, "split {n} faces along the lines in which others touch or cross them"),
            Self::Layers(1) => f.write_str("left out what of a face lies under others that look the same way"),
            Self::Layers(n) => write!(f, "left out what of {n} faces lies under others that look the same way"),
            Self::ClosedGaps(n) => write!(
                f,
                "took {n} corners of faces for others near them: gaps narrower than a millionth of the scene's size are closed; \
                 widen them, or leave out what makes the scene so large"
            ),
            Self::HiddenLamps(1) => f.write_str("a face that shines lies under others; `hatbox check` says where"),
            Self::HiddenLamps(n) => write!(f, "{n} faces that shine lie under others; `hatbox check` says where"),
        }
    }
}

impl Scene {
    /// Makes a scene of a mesh as it was read: vertices may be duplicated, [`surface`](crate::mesh::Cell::surface) is
    /// ignored, positions are in metres.
    ///
    /// Each planar face that remains after welding becomes a [`Surface`]. The cells of a surface are contiguous: first
    /// those of its front and then, if its material is two-sided, as many of its back. A surface whose material only
    /// blocks light has none.
    ///
    /// # Errors
    /// [`SceneError`] if the mesh is empty, damaged or not finite, or a material is not physical.
    #[expect(clippy::needless_pass_by_value, reason = "the raw mesh is used up: the scene's is another")]
    pub fn new(
        mesh: Mesh,
        materials: Vec<Material>,
        physics: Physics,
        camera: Option<Camera>,
    ) -> Result<Self, SceneError> {
        check_mesh(&mesh, materials.len())?;
        let bands = check_materials(&materials)?;
        let (faces, tolerance) = (mesh.cells.len(), mesh.tolerance());
        let merged = mesh.merged_vertices(tolerance);
        let closed = mesh.moved_corners(&merged, tolerance);
        let (mesh, degenerate) = mesh.welded_as(&merged, tolerance);
        if mesh.cells.is_empty() {
            return Err(SceneError::NoArea(faces));
        }
        let (mut mesh, split) = planar(mesh, tolerance);
        let mut surfaces = Vec::with_capacity(mesh.cells.len());
        for index in 0..mesh.cells.len() {
            mesh.cells[index].surface = index as u32;
            surfaces.push(Surface { corners: mesh.corners(index).map(|corner| corner.position) });
        }
        let layers = Layers::of(&mesh, tolerance, |material| lit(&materials[material as usize]));
        let (mesh, joints) = mesh.conformed(tolerance);
        let Split { mesh, cells: contacts, hidden } = mesh.split_at_contacts_and(&layers, tolerance);
        let (mesh, surfaces) = with_sides(&mesh, &materials, &surfaces, &layers, tolerance);
        let lamps = hidden.iter().filter(|(cell, _)| emits(&materials[cell.material as usize], bands));
        let lamps = lamps.map(|(cell, _)| cell.surface).collect::<BTreeSet<_>>().len();
        let hidden: Arc<[Surface]> = hidden.into_iter().map(|(_, corners)| Surface { corners }).collect();
        if mesh.cells.is_empty() {
            return Err(SceneError::OnlyBlocking(faces));
        }
        let warnings = [
            (degenerate, Warning::Degenerate(degenerate)),
            (split, Warning::SplitQuads(split)),
            (joints, Warning::TJunctions(joints)),
            (contacts, Warning::Contacts(contacts)),
            (layers.faces(), Warning::Layers(layers.faces())),
            (lamps, Warning::HiddenLamps(lamps)),
            (closed, Warning::ClosedGaps(closed)),
        ];
        let warnings = warnings.into_iter().filter(|&(n, _)| n > 0).map(|(_, warning)| warning).collect();
        let (mesh, surfaces) = (Arc::new(mesh), surfaces.into());
        Ok(Self { mesh, materials, surfaces, hidden, bands, physics, camera, warnings })
    }

    /// The scene subdivided for a basis: quads are split first if the basis has no element on them. What blocks light
    /// stays as it was.
    ///
    /// # Errors
    /// [`RefineError`] if the subdivision is impossible or too fine.
    pub fn refined(&self, refinement: Refinement, basis: &Basis) -> Result<Self, RefineError> {
        let mesh = if basis.quad.is_none() && self.mesh.cells.iter().any(|cell| cell.shape == Shape::Quad) {
            self.mesh.triangulated().refined(refinement)?
        } else {
            self.mesh.refined(refinement)?
        };
        Ok(self.on(mesh))
    }

    /// The same materials on other cells, of the same faces.
    fn on(&self, mesh: Mesh) -> Self {
        Self { mesh: Arc::new(mesh), ..self.clone() }
    }

    /// Replaces the materials, one by one.
    ///
    /// # Errors
    /// [`SceneError`] if one of them is not physical; the scene is then as it was.
    pub fn set_materials(&mut self, materials: Vec<Material>) -> Result<(), SceneError> {
        if let Some(cell) = self.mesh.cells.iter().position(|cell| cell.material as usize >= materials.len()) {
            let (index, count) = (self.mesh.cells[cell].material, materials.len());
            return Err(SceneError::Index { cell, what: "material", index, count });
        }
        self.bands = check_materials(&materials)?;
        self.materials = materials;
        Ok(())
    }

    /// [`refined`](Self::refined), with vertices at t^q from the edges of the faces: finer there. Quads are graded as
    /// quads and split afterwards, so that their diagonals are none of the edges.
    ///
    /// # Errors
    /// [`RefineError`] if the subdivision is impossible or too fine.
    pub fn refined_graded(&self, refinement: Refinement, q: f64, basis: &Basis) -> Result<Self, RefineError> {
        if q <= 1.0 {
            return self.refined(refinement, basis);
        }
        let quads = self.mesh.cells.iter().any(|cell| cell.shape == Shape::Quad);
        let split = basis.quad.is_none() && quads;
        let refinement = match refinement {
            Refinement::Elements(n) if split => Refinement::Elements(n.div_ceil(2)),
            other => other,
        };
        let mesh = self.mesh.refined_graded(refinement, q)?;
        let mesh = if split { mesh.triangulated() } else { mesh };
        Ok(self.on(mesh))
    }

    /// The scene with the marked cells refined, and few others ([`Mesh::bisected`]); quads stay as they are. Also for each
    /// new cell the one that it is a piece of. What blocks light stays as it was.
    ///
    /// # Panics
    /// If there is not one mark per cell.
    #[must_use]
    pub fn bisected(&self, marked: &[bool]) -> (Self, Vec<u32>) {
        let Bisected { mesh, parents } = self.mesh.bisected(marked);
        (self.on(mesh), parents)
    }

    /// The scene with cells split along segments of their planes: [`Mesh::split_along`].
    #[must_use]
    pub fn split_along(&self, lines: &[(usize, Line)]) -> Self {
        let (mesh, _) = self.mesh.split_along(lines, self.mesh.tolerance());
        self.on(mesh)
    }

    /// The scene with every quad split into triangles.
    #[must_use]
    pub fn triangulated(&self) -> Self {
        self.on(self.mesh.triangulated())
    }

    /// For each material the first that is the same.
    pub(crate) fn alike(&self) -> Vec<u32> {
        let mut first = FxHashMap::default();
        let of = |(material, index): (&Material, u32)| {
            let numbers = [&material.reflectance, &material.exitance].into_iter().flat_map(|quantity| {
                // Adding 0 makes −0 the same.
                (0..self.bands).map(|band| quantity.uniform(band).map(|value| (value + 0.0).to_bits()))
            });
            // What varies is like nothing else.
            let uniform: Option<Vec<u64>> = numbers.collect();
            uniform.map_or(index, |uniform| *first.entry(uniform).or_insert(index))
        };
        self.materials.iter().zip(0..).map(of).collect()
    }

    /// Whether two materials reflect and emit the same everywhere.
    pub fn same_material(&self, a: u32, b: u32) -> bool {
        let equal = |p: &Quantity, q: &Quantity| {
            (0..self.bands).all(|band| p.uniform(band).is_some() && p.uniform(band) == q.uniform(band))
        };
        let (p, q) = (&self.materials[a as usize], &self.materials[b as usize]);
        a == b || (equal(&p.reflectance, &q.reflectance) && equal(&p.exitance, &q.exitance))
    }
}

fn check_mesh(mesh: &Mesh, materials: usize) -> Result<(), SceneError> {
    if mesh.cells.is_empty() {
        return Err(SceneError::Empty);
    }
    let faces = mesh.cells.len();
    for (what, found) in [("texture coordinates", mesh.uvs.len()), ("normals", mesh.normals.len())] {
        if found != 0 && found != faces {
            return Err(SceneError::Corners { what, found, faces });
        }
    }
    for (index, cell) in mesh.cells.iter().enumerate() {
        let vertices = cell.vertices.map(|v| ("vertex", v, mesh.vertices.len()));
        let others = [("group", cell.group, mesh.groups.len()), ("material", cell.material, materials)];
        for (what, i, count) in vertices.into_iter().chain(others) {
            if i as usize >= count {
                return Err(SceneError::Index { cell: index, what, index: i, count });
            }
        }
        for &vertex in cell.corners() {
            let position = mesh.vertices[vertex as usize];
            if !position.is_finite() {
                let group = mesh.groups[cell.group as usize].clone();
                return Err(SceneError::Position { vertex, group, position });
            }
        }
    }
    Ok(())
}

/// The number of bands, if all materials are possible.
fn check_materials(materials: &[Material]) -> Result<usize, SceneError> {
    let count = |m: &Material| m.reflectance.bands().max(m.exitance.bands());
    let bands = materials.iter().map(count).max().unwrap_or(1).max(1);
    for Material { name, reflectance, exitance, .. } in materials {
        for found in [reflectance.bands(), exitance.bands()] {
            if found > 1 && found != bands {
                return Err(SceneError::Bands { material: name.clone(), found, bands });
            }
        }
        for band in 0..bands {
            // A texel of a file is an f32, and 1 may come out of a colour conversion a little above.
            let slack = if reflectance.uniform(band).is_some() { 0.0 } else { 1e-6 };
            if let Some(value) = outside(reflectance, band, 1.0 + slack) {
                return Err(SceneError::Reflectance { material: name.clone(), band, value });
            }
            if let Some(value) = outside(exitance, band, f64::MAX) {
                return Err(SceneError::Exitance { material: name.clone(), band, value });
            }
        }
    }
    Ok(bands)
}

/// A value of the quantity that is not between 0 and `most`. Functions are not tried.
fn outside(quantity: &Quantity, band: usize, most: f64) -> Option<f64> {
    let extremes = match (quantity.uniform(band), quantity) {
        (Some(value), _) => [value, value],
        (None, Quantity::Textured { texture, .. }) => {
            let factor = quantity.factor(band)?;
            let (least, greatest) = texture.range(band);
            [factor * least, factor * greatest]
        }
        (None, _) => return None,
    };
    extremes.into_iter().find(|value| !(0.0..=most).contains(value))
}

/// Splits the quads that are not planar within the tolerance or not convex, and counts them.
fn planar(mesh: Mesh, tolerance: f64) -> (Mesh, usize) {
    let from = |(index, cell): (usize, &Cell)| match cell.shape {
        Shape::Triangle => None,
        Shape::Quad => diagonal(&mesh.corners(index), tolerance),
    };
    let diagonals: Vec<Option<usize>> = mesh.cells.iter().enumerate().map(from).collect();
    let split = diagonals.iter().flatten().count();
    if split == 0 {
        return (mesh, 0);
    }
    let mut builder = Builder::like(&mesh);
    for (index, (cell, diagonal)) in mesh.cells.iter().zip(diagonals).enumerate() {
        let corners = mesh.corners(index);
        if let Some(k) = diagonal {
            let [a, b, c, d] = [k, k + 1, k + 2, k + 3].map(|i| corners[i % 4]);
            builder.push(cell, &[a, b, c]);
            builder.push(cell, &[a, c, d]);
        } else {
            builder.push(cell, &corners[..cell.shape.corners()]);
        }
    }
    let (mesh, _) = builder.finish().welded(tolerance);
    (mesh, split)
}

/// The corner from which a quad must be split: `None` if it need not be, 0 for a warped one, for one that is not convex
/// the end of the diagonal that lies inside.
fn diagonal(corners: &[Corner; 4], tolerance: f64) -> Option<usize> {
    let p = corners.map(|corner| corner.position);
    let normal = (p[2] - p[0]).cross(p[3] - p[1]).normalize_or_zero();
    let center = p.iter().sum::<DVec3>() / 4.0;
    // The height of each corner over the chord of its neighbours, positive if it points outwards.
    let heights: [f64; 4] = std::array::from_fn(|k| {
        let (before, at, after) = (p[(k + 3) % 4], p[k], p[(k + 1) % 4]);
        (at - before).cross(after - at).dot(normal) / before.distance(after).max(f64::MIN_POSITIVE)
    });
    if heights.iter().all(|&h| h > tolerance) {
        let warped = p.iter().any(|p| (*p - center).dot(normal).abs() > tolerance);
        return warped.then_some(0);
    }
    // The diagonal from 0 makes the triangles at corners 1 and 3.
    Some(usize::from(heights[0].min(heights[2]) > heights[1].min(heights[3])))
}

/// Which sides of a material send and receive light.
fn lit(material: &Material) -> Lit {
    match (material.blocks_only, material.two_sided) {
        (true, _) => Lit::Neither,
        (false, false) => Lit::Front,
        (false, true) => Lit::Both,
    }
}

/// Whether a material shines anywhere.
fn emits(material: &Material, bands: usize) -> bool {
    (0..bands).any(|band| material.exitance.uniform(band) != Some(0.0))
}

/// Puts the back of each two-sided surface after its front: the corners run the other way round, from the same first.
/// Leaves out the cells of surfaces that only block light, and sides that lie under others; surfaces of which some do are taken
/// to pieces, each a surface of its own if it has a side that is left.
fn with_sides(
    mesh: &Mesh,
    materials: &[Material],
    surfaces: &[Surface],
    layers: &Layers,
    tolerance: f64,
) -> (Mesh, Vec<Surface>) {
    let mut builder = Builder::like(mesh);
    let mut kept = Vec::with_capacity(surfaces.len());
    let indices: Vec<usize> = (0..mesh.cells.len()).collect();
    for cells in indices.chunk_by(|&a, &b| mesh.cells[a].surface == mesh.cells[b].surface) {
        let Cell { surface, material, .. } = mesh.cells[cells[0]];
        let lit = lit(&materials[material as usize]);
        if !layers.are_on(surface) {
            push_sides(&mut builder, mesh, cells, kept.len(), [lit != Lit::Neither, lit == Lit::Both]);
            kept.push(surfaces[surface as usize]);
            continue;
        }
        for cell in cells {
            let patch = mesh.patch(*cell);
            let is_seen = |normal: DVec3| !layers.cover(surface, &patch, normal, tolerance);
            let sides = [is_seen(patch.normal()), lit == Lit::Both && is_seen(-patch.normal())];
            push_sides(&mut builder, mesh, std::slice::from_ref(cell), kept.len(), sides);
            kept.push(Surface { corners: mesh.corners(*cell).map(|corner| corner.position) });
        }
    }
    (builder.finish(), kept)
}

/// Adds the front and the back of cells as those of a surface.
fn push_sides(builder: &mut Builder, mesh: &Mesh, cells: &[usize], surface: usize, [front, back]: [bool; 2]) {
    let of = |index: usize| (Cell { surface: surface as u32, ..mesh.cells[index] }, mesh.corners(index));
    for (cell, corners) in cells.iter().filter(|_| front).map(|&index| of(index)) {
        builder.push(&cell, &corners[..cell.shape.corners()]);
    }
    for (cell, corners) in cells.iter().filter(|_| back).map(|&index| of(index)) {
        let mut corners = corners.map(|c| Corner { normal: -c.normal, ..c });
        let corners = &mut corners[..cell.shape.corners()];
        corners[1..].reverse();
        builder.push(&cell, corners);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_are_alike_as_pairs_of_them_are() {
        let of = |reflectance: Quantity, exitance: f64| Material {
            reflectance,
            exitance: Quantity::gray(exitance),
            ..Material::diffuse("", 0.5)
        };
        let colour = |last: f64| Quantity::Uniform(vec![0.5, 0.5, last]);
        let painted = || Quantity::function(|_, _| 0.5);
        let materials = vec![
            of(painted(), 0.0),
            of(Quantity::gray(0.5), 0.0),
            of(painted(), 0.0),
            of(colour(0.4), 0.0),
            of(colour(0.5), -0.0),
            of(colour(0.4), 1.0),
            of(colour(0.4), 0.0),
        ];
        let corner = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let cell = Cell { shape: Shape::Triangle, vertices: [0, 1, 2, 2], material: 0, group: 0, surface: 0 };
        let vertices = vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0)];
        let mesh = Mesh { vertices, cells: vec![cell], groups: vec![String::new()], ..Mesh::default() };
        let scene = Scene::new(mesh, materials, Physics::Light, None).expect("valid");
        assert_eq!(scene.alike(), [0, 1, 2, 3, 1, 5, 3]);
        let by_pairs = (0..7).map(|a| (0..a).find(|&b| scene.same_material(a, b)).unwrap_or(a));
        assert_eq!(scene.alike(), by_pairs.collect::<Vec<_>>());
    }
}

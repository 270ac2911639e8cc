//! A scene: a mesh, what it is made of, and where it is looked at from.
//!
//! All quantities are in the units of the design's table: metres, lm/m² or W/m², reflectance between 0 and 1. File
//! formats convert at their border; nothing behind them knows of centimetres, candela or kelvin.

mod build;
mod material;
mod texture;

pub use build::{SceneError, Warning};
pub use material::{Function, Material, Quantity, STEFAN_BOLTZMANN, Site};
pub use texture::{Texture, Wrap};

use crate::element::Shape;
use crate::mesh::{Mesh, Patch};
use glam::DVec3;
use std::sync::Arc;

/// Where the scene is looked at from: a pinhole camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Position of the pinhole.
    pub eye: DVec3,
    /// The point in the middle of the picture.
    pub target: DVec3,
    /// The direction that is up in the picture.
    pub up: DVec3,
    /// Vertical field of view in radians.
    pub fov_y: f64,
}

/// What the numbers measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Physics {
    /// Radiosity in lm/m², irradiance in lux.
    #[default]
    Light,
    /// Radiosity and irradiance in W/m².
    Heat,
}

/// One opaque face of the input: what rays hit. Its index is [`crate::mesh::Cell::surface`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// The corners; a triangle repeats its last.
    pub corners: [DVec3; 4],
}

impl Surface {
    /// The corners, three or four.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners[..if self.corners[2] == self.corners[3] { 3 } else { 4 }]
    }

    /// Its geometry, seen from the side that `normal` points to.
    pub fn patch(&self, normal: DVec3) -> Patch {
        let [a, b, c, d] = self.corners;
        let (shape, back) = if c == d { (Shape::Triangle, [a, c, b, b]) } else { (Shape::Quad, [a, d, c, b]) };
        let front = Patch::new(shape, self.corners);
        if front.normal().dot(normal) >= 0.0 { front } else { Patch::new(shape, back) }
    }

    /// The triangles it consists of: one, or two along the diagonal 0–2.
    pub fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> {
        let [a, b, c, d] = self.corners;
        [Some([a, b, c]), (c != d).then_some([a, c, d])].into_iter().flatten()
    }
}

/// Cells, materials and occluders.
///
/// Every face of the input blocks light from both sides, whichever of its sides is lit. The occluders are the faces of
/// the *input*: subdividing cells for accuracy leaves them, and so the cost of a ray, as they were.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The cells that carry unknowns. Scenes with other materials, and solutions, share them.
    pub mesh: Arc<Mesh>,
    /// What the cells are made of.
    pub materials: Vec<Material>,
    /// The opaque faces of the input.
    pub surfaces: Arc<[Surface]>,
    /// Pieces of faces that were left out because others that look the same way lie on them.
    pub hidden: Arc<[Surface]>,
    /// Number of bands that every material broadcasts to.
    pub bands: usize,
    /// What the numbers measure.
    pub physics: Physics,
    /// The file's camera, if it has one.
    pub camera: Option<Camera>,
    /// What was repaired in the input.
    pub warnings: Vec<Warning>,
}

impl Scene {
    /// The material of a cell.
    pub fn material(&self, cell: usize) -> &Material {
        &self.materials[self.mesh.cells[cell].material as usize]
    }

    /// Where a point of a cell is, for materials that vary over it.
    pub fn site(&self, cell: usize, at: [f64; 2]) -> Site {
        Site { position: self.mesh.patch(cell).point(at), uv: self.mesh.uv(cell, at) }
    }
}

//! Reading scenes: every format becomes the same [`RawScene`], in metres, with materials in the library's units.
//!
//! A reader checks what only it can name the place of: a line, a node, a primitive, a key. Whatever is wrong is a
//! [`ReadError`] that says in which file, where in it, what, and what to do; whatever is merely left out (lines, lights
//! of a kind that radiosity does not know) is a warning. What holds for all formats alike (welding, warped quads, back
//! sides) is done once, behind the readers, where the scene is built.
//!
//! [`FORMATS`] has one entry per format; the command line and the documentation read it.

mod builder;
mod error;
mod files;
mod gltf;
mod obj;
mod picture;
mod ply;
mod polygon;
mod scene_file;
mod stl;
mod vs3;

pub use error::{ReadError, Snippet};
pub use scene_file::EXAMPLE;

use crate::mesh::Mesh;
use crate::scene::{Camera, Material, Physics, Scene};
use builder::MeshBuilder;
use std::path::Path;

/// R of what a file gives no material.
const DEFAULT_REFLECTANCE: f64 = 0.5;

/// What a file says, before it is made fit for computing.
#[derive(Debug, Clone)]
pub struct RawScene {
    /// Cells as they stand in the file: unwelded, quads perhaps warped, [`surface`](crate::mesh::Cell::surface) 0. In
    /// [`Mesh::normals`] a zero vector stands where the file gave no normal.
    pub mesh: Mesh,
    /// The materials of the cells.
    pub materials: Vec<Material>,
    /// What the numbers measure.
    pub physics: Physics,
    /// The first camera of the file.
    pub camera: Option<Camera>,
    /// What was left out or guessed, each with its file and place.
    pub warnings: Vec<String>,
    /// Materials whose reflectance was guessed, each with what `warnings` say of it: no more, where a scene file gives one.
    pub guessed: Vec<[String; 2]>,
}

impl RawScene {
    /// The scene of a format that knows no materials.
    fn without_materials(file: &Path, builder: MeshBuilder) -> Result<Self, ReadError> {
        let text = format!("it has no materials: reflectance {DEFAULT_REFLECTANCE} is assumed; set it in a scene file");
        let name = "default";
        let warning = format!("{}: {text}", file.display());
        let (mut warnings, guessed) = (vec![warning.clone()], vec![[name.to_owned(), warning]]);
        Ok(Self {
            mesh: builder.finish(file, &mut warnings)?,
            materials: vec![Material::diffuse(name, DEFAULT_REFLECTANCE)],
            physics: Physics::Light,
            camera: None,
            warnings,
            guessed,
        })
    }
}

/// A file format that scenes are read from.
#[derive(Debug)]
pub struct Format {
    /// Its name.
    pub name: &'static str,
    /// The file name extensions, in lower case.
    pub extensions: &'static [&'static str],
    /// One line for help texts: what becomes of its materials.
    pub summary: &'static str,
    /// Whether its lengths are metres by definition. Those of the others are taken as metres unless a scene file says
    /// otherwise.
    pub in_metres: bool,
    read: fn(&Path) -> Result<RawScene, ReadError>,
}

impl Format {
    /// The format of a file, by its extension.
    pub fn of(path: &Path) -> Option<&'static Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        FORMATS.iter().find(|format| format.extensions.contains(&extension.as_str()))
    }

    /// Reads a file of this format.
    ///
    /// # Errors
    /// What is wrong with the file, and where.
    pub fn read(&self, path: &Path) -> Result<RawScene, ReadError> {
        (self.read)(path)
    }
}

/// Every format that scenes are read from.
pub static FORMATS: [Format; 6] = [
    Format {
        name: "glTF",
        extensions: &["glb", "gltf"],
        summary: "R = base colour × texture × (1 − metallic), B⁰ = π × emission; doubleSided is honoured",
        in_metres: true,
        read: gltf::read,
    },
    Format {
        name: "OBJ",
        extensions: &["obj"],
        summary: "with its .mtl: R = Kd × map_Kd, B⁰ = π Ke",
        in_metres: false,
        read: obj::read,
    },
    Format {
        name: "PLY",
        extensions: &["ply"],
        summary: "geometry only: R = 0.5, unless a scene file says otherwise",
        in_metres: false,
        read: ply::read,
    },
    Format {
        name: "STL",
        extensions: &["stl"],
        summary: "geometry only: R = 0.5, unless a scene file says otherwise",
        in_metres: false,
        read: stl::read,
    },
    Format {
        name: "View3D",
        extensions: &["vs3"],
        summary: "surfaces with R = 1 − emittance; base, combined and obstruction surfaces are honoured",
        in_metres: false,
        read: vs3::read,
    },
    Format {
        name: "scene file",
        extensions: &["toml"],
        summary: "names meshes and sets materials, the length unit and the camera",
        in_metres: true,
        read: scene_file::read,
    },
];

/// Reads a scene and makes it ready: checked, welded, repaired, the backs of two-sided faces added. What had to be
/// repaired or passed over is the second value, a sentence each.
///
/// # Errors
/// What is wrong with the file, and where.
pub fn read_scene(path: &Path) -> Result<(Scene, Vec<String>), ReadError> {
    let RawScene { mesh, materials, physics, camera, mut warnings, guessed: _ } = read_raw(path)?;
    let scene = Scene::new(mesh, materials, physics, camera)
        .map_err(|error| ReadError::new(path, "", error.to_string(), "run `hatbox check` on it to see more"))?;
    warnings.extend(scene.warnings.iter().map(ToString::to_string));
    Ok((scene, warnings))
}

/// Reads what a file says, as it says it; the format follows the file name's extension.
///
/// # Errors
/// What is wrong with the file, and where.
pub fn read_raw(path: &Path) -> Result<RawScene, ReadError> {
    let format = Format::of(path).ok_or_else(|| {
        let known: Vec<_> = FORMATS.iter().flat_map(|format| format.extensions).map(|e| format!(".{e}")).collect();
        ReadError::new(
            path,
            "",
            "no scene format has this file name extension",
            format!("use one of {}", known.join(", ")),
        )
    })?;
    format.read(path)
}

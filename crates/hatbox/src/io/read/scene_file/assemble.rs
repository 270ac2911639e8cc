//! The meshes of a scene file, read and put in place.

use super::Source;
use super::material::ALL;
use super::schema::{MeshEntry, Rotation, Scale};
use crate::io::read::builder::normal_matrix;
use crate::io::read::{DEFAULT_REFLECTANCE, Format, RawScene, ReadError, files, read_raw};
use crate::mesh::Mesh;
use crate::scene::{Camera, Material, Physics};
use glam::{DMat4, DQuat, DVec3};
use std::path::Path;
use toml::Spanned;

/// Reads every mesh and joins them; `metres` is the file's unit of length.
pub(super) fn meshes(source: &Source<'_>, entries: &[MeshEntry], metres: f64) -> Result<RawScene, ReadError> {
    if entries.is_empty() {
        let remedy = "add `[[mesh]]` with `file = \"….obj\"`";
        return Err(source.error(0..0, "", "the scene is empty: it names no mesh", remedy));
    }
    let mut joined = RawScene {
        mesh: Mesh::default(),
        materials: Vec::new(),
        physics: Physics::Light,
        camera: None,
        warnings: Vec::new(),
        guessed: Vec::new(),
    };
    for entry in entries {
        let (mut part, in_metres) = open(source, entry)?;
        if let Some(name) = &entry.material {
            of_one_material(source, &mut part, name)?;
        }
        let unit = match &entry.unit {
            Some(unit) => source.metres(unit)?,
            None if in_metres => 1.0,
            None => metres,
        };
        append(&mut joined, part, &placement(source, entry, unit, metres)?, &entry.prefix);
    }
    joined.warnings = files::without_repeats(joined.warnings);
    Ok(joined)
}

/// Reads one mesh; also whether its format is in metres.
fn open(source: &Source<'_>, entry: &MeshEntry) -> Result<(RawScene, bool), ReadError> {
    let folder = source.file.parent().unwrap_or(Path::new(""));
    let path = folder.join(entry.file.get_ref());
    let error = |reason: String, remedy: &str| source.error(entry.file.span(), "mesh file", reason, remedy);
    if !path.is_file() {
        return Err(error(format!("there is no file `{}`", path.display()), "put it there, or correct the name"));
    }
    let format = Format::of(&path);
    if format.is_some_and(|format| format.extensions.contains(&"toml")) {
        return Err(error("a scene file cannot be a mesh of another".to_owned(), "name its meshes here"));
    }
    Ok((read_raw(&path)?, format.is_some_and(|format| format.in_metres)))
}

/// Makes all faces of a mesh of one material, of which nothing is known but its name.
fn of_one_material(source: &Source<'_>, part: &mut RawScene, spanned: &Spanned<String>) -> Result<(), ReadError> {
    let name = spanned.get_ref();
    if name.is_empty() || name == ALL {
        let reason = format!("`{name}` is no name of a material");
        return Err(source.error(spanned.span(), "mesh material", reason, "give it a name of its own"));
    }
    let text = format!("nothing says what material `{name}` is: reflectance {DEFAULT_REFLECTANCE} is assumed");
    let warning = format!("{}: {text}; set it in a table [material.NAME]", source.file.display());
    part.materials = vec![Material::diffuse(name, DEFAULT_REFLECTANCE)];
    part.mesh.cells.iter_mut().for_each(|cell| cell.material = 0);
    let guessed = std::mem::replace(&mut part.guessed, vec![[name.clone(), warning.clone()]]);
    part.warnings.retain(|warning| guessed.iter().all(|[_, text]| text != warning));
    part.warnings.push(warning);
    Ok(())
}

/// Scale, then rotation, then translation; the mesh's own unit comes first.
fn placement(source: &Source<'_>, entry: &MeshEntry, unit: f64, metres: f64) -> Result<DMat4, ReadError> {
    let scale = match &entry.scale {
        None => DVec3::ONE,
        Some(spanned) => {
            let scale = match *spanned.get_ref() {
                Scale::Uniform(scale) => DVec3::splat(scale),
                Scale::PerAxis(scale) => DVec3::from_array(scale),
            };
            if !scale.is_finite() || scale.cmpeq(DVec3::ZERO).any() {
                let reason = "a mesh cannot be scaled by this";
                return Err(source.error(spanned.span(), "mesh scale", reason, "give finite numbers that are not 0"));
            }
            scale
        }
    };
    let rotation = entry.rotate.as_ref().map_or(Ok(DQuat::IDENTITY), |rotate| rotation(source, rotate))?;
    let translate = entry.translate.as_ref().map_or(Ok(DVec3::ZERO), |t| source.vector(t, "mesh translate"))?;
    Ok(DMat4::from_scale_rotation_translation(scale * unit, rotation, translate * metres))
}

fn rotation(source: &Source<'_>, Rotation { axis, degrees }: &Rotation) -> Result<DQuat, ReadError> {
    let Some(direction) = source.vector(axis, "mesh rotate axis")?.try_normalize() else {
        let reason = "the axis has no direction";
        return Err(source.error(axis.span(), "mesh rotate", reason, "give a vector that is not 0"));
    };
    if !degrees.get_ref().is_finite() {
        let reason = "the angle is not finite";
        return Err(source.error(degrees.span(), "mesh rotate", reason, "give a finite number of degrees"));
    }
    Ok(DQuat::from_axis_angle(direction, degrees.get_ref().to_radians()))
}

/// Adds a mesh, moved, to the scene.
fn append(scene: &mut RawScene, part: RawScene, placement: &DMat4, prefix: &str) {
    let mesh = &mut scene.mesh;
    let (first_vertex, first_cell) = (mesh.vertices.len() as u32, mesh.cells.len());
    let first_material = scene.materials.len() as u32;
    let groups: Vec<u32> = part.mesh.groups.iter().map(|name| group(mesh, format!("{prefix}{name}"))).collect();
    mesh.vertices.extend(part.mesh.vertices.iter().map(|&v| placement.transform_point3(v)));
    mesh.cells.extend(part.mesh.cells.iter().map(|&cell| {
        let mut cell = cell;
        cell.vertices = cell.vertices.map(|v| v + first_vertex);
        cell.material += first_material;
        cell.group = groups[cell.group as usize];
        cell
    }));
    let matrix = normal_matrix(placement);
    let normals = part.mesh.normals.iter().map(|n| n.map(|n| (matrix * n).normalize_or_zero()));
    extend(&mut mesh.normals, normals.collect(), first_cell, mesh.cells.len());
    extend(&mut mesh.uvs, part.mesh.uvs, first_cell, mesh.cells.len());
    if placement.determinant() < 0.0 {
        turn_around(mesh, first_cell);
    }
    scene.camera = scene.camera.or(part.camera.map(|camera| Camera {
        eye: placement.transform_point3(camera.eye),
        target: placement.transform_point3(camera.target),
        up: placement.transform_vector3(camera.up).normalize_or_zero(),
        ..camera
    }));
    scene.materials.extend(part.materials);
    scene.warnings.extend(part.warnings);
    scene.guessed.extend(part.guessed);
}

fn group(mesh: &mut Mesh, name: String) -> u32 {
    let known = mesh.groups.iter().position(|group| *group == name);
    known.unwrap_or_else(|| {
        mesh.groups.push(name);
        mesh.groups.len() - 1
    }) as u32
}

/// Appends what the cells from `first` to `last` have; zeros stand for cells without, unless no cell has any.
fn extend<T: Clone + Default>(all: &mut Vec<T>, new: Vec<T>, first: usize, last: usize) {
    if all.is_empty() && new.is_empty() {
        return;
    }
    all.resize(first, T::default());
    all.extend(new);
    all.resize(last, T::default());
}

/// Reverses the corners of the cells from `first` on, which a mirroring has turned inside out.
fn turn_around(mesh: &mut Mesh, first: usize) {
    fn reverse<T: Copy>(corners: [T; 4], count: usize) -> [T; 4] {
        let [a, b, c, d] = corners;
        if count == 3 { [a, c, b, b] } else { [a, d, c, b] }
    }
    let counts: Vec<usize> = mesh.cells.iter().map(|cell| cell.shape.corners()).collect();
    for (cell, &count) in mesh.cells.iter_mut().zip(&counts).skip(first) {
        cell.vertices = reverse(cell.vertices, count);
    }
    for (uvs, &count) in mesh.uvs.iter_mut().zip(&counts).skip(first) {
        *uvs = reverse(*uvs, count);
    }
    for (normals, &count) in mesh.normals.iter_mut().zip(&counts).skip(first) {
        *normals = reverse(*normals, count);
    }
}

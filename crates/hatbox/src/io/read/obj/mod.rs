//! Wavefront OBJ with its MTL: R = Kd × `map_Kd`, B⁰ = π Ke (Ke is a radiance), one-sided.
//!
//! Quads stay quads if they are convex; polygons of more corners are cut into triangles. `o` and `g` name the groups
//! (a `g` within an `o` wins); `vn` are kept as the corners' normals, `vt` as texture coordinates, with v turned to run
//! down the image. What has no material, or one that its `.mtl` lacks, is gray 0.5, with a warning.
//!
//! The parser is the project's own because errors must name the line: the usual crate reports a kind of error without
//! its place, loses the names of materials it does not find, and panics on a `Kd` of one number.

mod line;
mod mtl;

use super::builder::{Face, MeshBuilder};
use super::{DEFAULT_REFLECTANCE, RawScene, ReadError, files};
use crate::element::Shape;
use crate::scene::{Material, Physics};
use glam::{DVec2, DVec3};
use line::Line;
use mtl::Library;
use std::collections::HashMap;
use std::path::Path;

/// Reads an `.obj` and the `.mtl` files that it names.
pub(super) fn read(file: &Path) -> Result<RawScene, ReadError> {
    let bytes = files::read(file)?;
    let text = files::text(&bytes);
    let mut reader = Reader::new(file);
    let text = line::joined(&text);
    for line in line::lines(file, &text) {
        reader.statement(&line)?;
    }
    reader.finish()
}

/// What has been read so far.
struct Reader<'a> {
    file: &'a Path,
    stem: String,
    positions: Vec<DVec3>,
    uvs: Vec<DVec2>,
    normals: Vec<DVec3>,
    /// Where positions went in the mesh, once a face has used them.
    added: Vec<Option<u32>>,
    builder: MeshBuilder,
    object: String,
    group: String,
    library: Library,
    /// The name given by `usemtl`, and the materials in use by name.
    material: Option<String>,
    used: HashMap<Option<String>, u32>,
    materials: Vec<Material>,
    /// How many statements were skipped, and the first of them.
    skipped: Option<(usize, String)>,
    warnings: Vec<String>,
    guessed: Vec<[String; 2]>,
}

/// One corner of a face: indices of its position, texture coordinates and normal.
#[derive(Debug, Clone, Copy)]
struct Corner {
    position: usize,
    uv: Option<usize>,
    normal: Option<usize>,
}

impl<'a> Reader<'a> {
    fn new(file: &'a Path) -> Self {
        Self {
            file,
            stem: file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
            positions: Vec::new(),
            uvs: Vec::new(),
            normals: Vec::new(),
            added: Vec::new(),
            builder: MeshBuilder::default(),
            object: String::new(),
            group: String::new(),
            library: Library::default(),
            material: None,
            used: HashMap::new(),
            materials: Vec::new(),
            skipped: None,
            warnings: Vec::new(),
            guessed: Vec::new(),
        }
    }

    fn statement(&mut self, line: &Line<'_>) -> Result<(), ReadError> {
        match line.keyword {
            "v" => self.positions.push(DVec3::from_array(line.numbers()?)),
            "vt" => {
                let u = line.number(0)?;
                let v = if line.words().count() > 1 { line.number(1)? } else { 0.0 };
                self.uvs.push(DVec2::new(u, 1.0 - v));
            }
            "vn" => self.normals.push(DVec3::from_array(line.numbers()?).try_normalize().unwrap_or_default()),
            "f" => self.face(line)?,
            "o" => (self.object, self.group) = (line.rest.to_owned(), String::new()),
            "g" => line.rest.clone_into(&mut self.group),
            "usemtl" => self.material = Some(line.rest.to_owned()),
            "mtllib" => self.library.load(line, &mut self.warnings)?,
            // Smoothing groups, and the parameters of curves, which are skipped themselves.
            "s" | "vp" => {}
            _ => self.skipped.get_or_insert_with(|| (0, format!("{}: `{}`", line.place(), line.keyword))).0 += 1,
        }
        Ok(())
    }

    /// The name under which faces are grouped.
    fn group_name(&self) -> &str {
        [&self.group, &self.object].into_iter().find(|name| !name.is_empty()).unwrap_or(&self.stem)
    }

    fn place(&self, line: &Line<'_>) -> String {
        format!("{} (object `{}`)", line.place(), self.group_name())
    }

    fn face(&mut self, line: &Line<'_>) -> Result<(), ReadError> {
        let corners = line.words().map(|word| self.corner(line, word)).collect::<Result<Vec<_>, _>>()?;
        if corners.len() < 3 {
            let reason = format!("a face has {} corners", corners.len());
            return Err(ReadError::new(self.file, self.place(line), reason, "give it at least 3"));
        }
        let points: Vec<DVec3> = corners.iter().map(|corner| self.positions[corner.position]).collect();
        if let Some(k) = points.iter().position(|point| !point.is_finite()) {
            let reason = format!("the position of vertex {} is not finite: {}", corners[k].position + 1, points[k]);
            return Err(ReadError::new(self.file, self.place(line), reason, "repair the mesh"));
        }
        let material = self.current_material();
        let name = self.group_name().to_owned();
        let group = self.builder.group(&name);
        for (shape, picked) in self.builder.cut(&points, || format!("{} (object `{name}`)", line.place())) {
            self.piece(shape, picked.map(|k| corners[k]), material, group);
        }
        Ok(())
    }

    fn piece(&mut self, shape: Shape, corners: [Corner; 4], material: u32, group: u32) {
        self.added.resize(self.positions.len(), None);
        let vertices = corners.map(|corner| {
            let position = self.positions[corner.position];
            *self.added[corner.position].get_or_insert_with(|| self.builder.vertex(position))
        });
        let uvs = corners.iter().all(|c| c.uv.is_some());
        let normals = corners.iter().all(|c| c.normal.is_some());
        let uv = |corner: Corner| corner.uv.map_or(DVec2::ZERO, |index| self.uvs[index]);
        let normal = |corner: Corner| corner.normal.map_or(DVec3::ZERO, |index| self.normals[index]);
        let (uvs, normals) = (uvs.then(|| corners.map(uv)), normals.then(|| corners.map(normal)));
        self.builder.face(Face { shape, vertices, uvs, normals, material, group });
    }

    /// Parses `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, line: &Line<'_>, word: &str) -> Result<Corner, ReadError> {
        let mut parts = word.split('/');
        let mut index = |what: &str, count: usize| match parts.next() {
            None | Some("") => Ok(None),
            Some(part) => self.index(line, part, what, count).map(Some),
        };
        let position = index("vertex", self.positions.len())?;
        let uv = index("texture coordinate", self.uvs.len())?;
        let normal = index("normal", self.normals.len())?;
        let position = position.ok_or_else(|| {
            ReadError::new(self.file, self.place(line), format!("`{word}` names no vertex"), "write v/vt/vn")
        })?;
        Ok(Corner { position, uv, normal })
    }

    /// Indices count from 1, or back from the last if negative.
    fn index(&self, line: &Line<'_>, part: &str, what: &str, count: usize) -> Result<usize, ReadError> {
        let number: Option<isize> = part.parse().ok();
        let index =
            number.and_then(|n| if n < 0 { count.checked_add_signed(n) } else { n.unsigned_abs().checked_sub(1) });
        let index = index.filter(|&index| index < count);
        index.ok_or_else(|| {
            let reason = match number {
                Some(0) => format!("the face names {what} 0, but they count from 1, or back from the last with -1"),
                Some(_) => format!("the face names {what} {part}, but {count} are defined up to here"),
                None => format!("`{part}` is no {what} index"),
            };
            ReadError::new(self.file, self.place(line), reason, "repair the mesh, or export it again")
        })
    }

    fn current_material(&mut self) -> u32 {
        if let Some(&index) = self.used.get(&self.material) {
            return index;
        }
        let name = self.material.as_deref().unwrap_or("default");
        let found = self.library.get(name).filter(|_| self.material.is_some()).cloned();
        let material = found.unwrap_or_else(|| {
            let what =
                if self.material.is_some() { "is in no .mtl that was read" } else { "stands for faces without one" };
            let file = self.file.display();
            let warning = format!("{file}: material `{name}` {what}: reflectance {DEFAULT_REFLECTANCE} is assumed");
            self.guessed.push([name.to_owned(), warning.clone()]);
            self.warnings.push(warning);
            Material::diffuse(name, DEFAULT_REFLECTANCE)
        });
        let index = self.materials.len() as u32;
        self.materials.push(material);
        self.used.insert(self.material.clone(), index);
        index
    }

    fn finish(mut self) -> Result<RawScene, ReadError> {
        if let Some((count, first)) = &self.skipped {
            let file = self.file.display();
            self.warnings.push(format!("{file}: {count} statements that are no surfaces were skipped, first {first}"));
        }
        let mesh = self.builder.finish(self.file, &mut self.warnings)?;
        Ok(RawScene {
            mesh,
            materials: self.materials,
            physics: Physics::Light,
            camera: None,
            warnings: files::without_repeats(self.warnings),
            guessed: self.guessed,
        })
    }
}

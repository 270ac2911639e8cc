//! View3D's `.vs3`: vertices and flat surfaces with an emittance, for view factors.
//!
//! | line | what it says |
//! |---|---|
//! | `T …` | a title |
//! | `C name=value …` | View3D's controls: read, reported, without effect |
//! | `F 3` | that vertices and surfaces follow |
//! | `V n x y z` | vertex n |
//! | `S n v1 v2 v3 v4 base cmb emit name` | surface n, counter-clockwise seen from its front; v4 = 0 for a triangle |
//! | `O n v1 v2 v3 v4` | a surface that only stands in the way |
//! | `N n …` | a part of its base, taken out of it |
//! | `E` or `*` | the end |
//!
//! `!` and `/` begin comments. A surface with a base is a part of it that is a surface of its own, such as a window of a
//! wall: it is cut out of the base. A surface with a number under `cmb` is one with the surface of that number: the two
//! are one *part* of the mesh, so that view factors between parts are those that View3D gives. The material of each
//! surface has its name, and R = 1 − ε.

mod holes;
mod statement;

use super::builder::{Face, MeshBuilder};
use super::{RawScene, ReadError, files};
use crate::scene::{Material, Physics};
use glam::DVec3;
use statement::Statement;
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// How far from the plane of its base a surface may be, relative to its size.
const COPLANAR: f64 = 1e-5;

/// Reads a `.vs3`.
pub(super) fn read(file: &Path) -> Result<RawScene, ReadError> {
    let bytes = files::read(file)?;
    let text = files::text(&bytes);
    let mut reader = Reader::new(file);
    for statement in statement::statements(file, &text) {
        if !reader.statement(&statement)? {
            break;
        }
    }
    reader.finish()
}

/// What a surface is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// It sends and receives.
    Radiating,
    /// It takes a part of its base away.
    Null,
    /// It stands in the way.
    Obstruction,
}

/// A surface as it stands in the file.
#[derive(Debug, Clone)]
struct Entry<'a> {
    statement: Statement<'a>,
    kind: Kind,
    number: usize,
    corners: Vec<DVec3>,
    /// Number of the surface that it is a part of, or 0.
    base: usize,
    /// Number of the surface that it is combined with, or 0.
    combined: usize,
    emittance: f64,
    name: String,
}

impl Entry<'_> {
    /// Twice the area times the normal (Newell's).
    fn normal(&self) -> DVec3 {
        let edges = self.corners.iter().zip(self.corners.iter().cycle().skip(1));
        edges.map(|(&a, &b)| (a - self.corners[0]).cross(b - self.corners[0])).sum()
    }
}

struct Reader<'a> {
    file: &'a Path,
    vertices: HashMap<usize, DVec3>,
    surfaces: Vec<Entry<'a>>,
    /// Where in the list the surface of a number is.
    places: HashMap<usize, usize>,
    warnings: Vec<String>,
}

impl<'a> Reader<'a> {
    fn new(file: &'a Path) -> Self {
        Self { file, vertices: HashMap::new(), surfaces: Vec::new(), places: HashMap::new(), warnings: Vec::new() }
    }

    /// Takes in a line; false at the end of the data.
    fn statement(&mut self, statement: &Statement<'a>) -> Result<bool, ReadError> {
        match statement.keyword {
            'V' => self.vertex(statement)?,
            'S' => self.surface(statement, Kind::Radiating)?,
            'N' => self.surface(statement, Kind::Null)?,
            'O' => self.surface(statement, Kind::Obstruction)?,
            'M' => {
                let reason = "masking surfaces are not supported";
                return Err(statement.error(reason, "write N to take the masked part out of its base, or leave it out"));
            }
            'F' => statement.format()?,
            'C' => self.controls(statement)?,
            // Titles, and transformations that View3D itself passes over.
            'T' | 'X' => {}
            'E' | '*' => return Ok(false),
            other => {
                let text = format!("`{other}` begins no line of View3D's format; it was left out");
                self.warn(statement.line, &text);
            }
        }
        Ok(true)
    }

    fn warn(&mut self, line: usize, text: &str) {
        self.warnings.push(format!("{}: line {line}: {text}", self.file.display()));
    }

    fn vertex(&mut self, statement: &Statement<'_>) -> Result<(), ReadError> {
        let number = statement.integer(0, "the vertex number")?;
        let mut position = DVec3::ZERO;
        for axis in 0..3 {
            position[axis] = statement.number(axis + 1, ["x", "y", "z"][axis])?;
        }
        if number == 0 || self.vertices.insert(number, position).is_some() {
            let reason = format!("vertex {number} is there already, or no number of a vertex");
            return Err(statement.error(reason, "number the vertices 1, 2, 3, …"));
        }
        Ok(())
    }

    /// Reports the controls that View3D would follow.
    fn controls(&mut self, statement: &Statement<'_>) -> Result<(), ReadError> {
        let controls = statement.controls()?;
        if !controls.is_empty() {
            let shown: Vec<String> = controls.iter().map(|(name, value)| format!("{name} = {value}")).collect();
            let text =
                format!("View3D's controls have no effect here: {}; the tolerance sets the accuracy", shown.join(", "));
            self.warn(statement.line, &text);
        }
        Ok(())
    }

    fn surface(&mut self, statement: &Statement<'a>, kind: Kind) -> Result<(), ReadError> {
        let number = statement.integer(0, "the surface number")?;
        if number == 0 || self.places.insert(number, self.surfaces.len()).is_some() {
            let reason = format!("surface {number} is there already, or no number of a surface");
            return Err(statement.error(reason, "number the surfaces 1, 2, 3, …"));
        }
        let corners = self.corners(statement, number)?;
        let name = statement.word(8).map_or_else(|| format!("{number}"), str::to_owned);
        let mut entry =
            Entry { statement: *statement, kind, number, corners, base: 0, combined: 0, emittance: 1.0, name };
        if kind != Kind::Obstruction {
            entry.base = statement.integer(5, "the base number")?;
            entry.combined = statement.integer(6, "the combine number")?;
            entry.emittance = statement.number(7, "the emittance")?;
        }
        if !(0.0..=1.0).contains(&entry.emittance) {
            let reason = format!("surface {number} has an emittance of {}", entry.emittance);
            return Err(statement.error(reason, "give a number between 0 and 1"));
        }
        self.surfaces.push(entry);
        Ok(())
    }

    fn corners(&self, statement: &Statement<'_>, number: usize) -> Result<Vec<DVec3>, ReadError> {
        let mut corners = Vec::with_capacity(4);
        for k in 1..=4 {
            let vertex = statement.integer(k, "a vertex number")?;
            match self.vertices.get(&vertex) {
                Some(&position) => corners.push(position),
                None if vertex == 0 && k == 4 => {}
                None => {
                    let reason = format!("surface {number} names vertex {vertex}, which is not above it");
                    return Err(statement.error(reason, "correct the number, or add the vertex"));
                }
            }
        }
        Ok(corners)
    }

    /// The surface that another refers to by a number that is not 0.
    fn other(&self, entry: &Entry<'_>, number: usize, what: &str) -> Result<&Entry<'a>, ReadError> {
        let found = self.places.get(&number).map(|&place| &self.surfaces[place]);
        // What only stands in the way has the last numbers.
        let in_order = |other: &&Entry<'_>| other.number < entry.number || other.kind == Kind::Obstruction;
        found.filter(in_order).ok_or_else(|| {
            let reason =
                format!("the {what} number of surface {} is {number}, and no surface before it has it", entry.number);
            entry.statement.error(reason, "name a surface with a lower number, or 0")
        })
    }

    /// What must hold between a surface and the one that it is combined with.
    fn check_combined(&self, entry: &Entry<'_>) -> Result<(), ReadError> {
        if entry.combined == 0 {
            return Ok(());
        }
        let other = self.other(entry, entry.combined, "combine")?;
        if other.combined == 0 && other.kind == Kind::Radiating && entry.kind == Kind::Radiating {
            return Ok(());
        }
        let reason = format!("surface {} cannot be combined with surface {}", entry.number, other.number);
        Err(entry.statement.error(reason, "combine S surfaces with one that is itself not combined"))
    }

    /// What must hold between a surface and the one that it is a part of.
    fn check_base(&self, entry: &Entry<'_>) -> Result<(), ReadError> {
        let (number, error) = (entry.number, |reason: String, remedy| Err(entry.statement.error(reason, remedy)));
        if entry.base == 0 {
            return match entry.kind {
                Kind::Null => error(format!("null surface {number} has no base"), "name its base"),
                _ => Ok(()),
            };
        }
        let base = self.other(entry, entry.base, "base")?;
        let normal = base.normal().normalize_or_zero();
        let size = base.corners.iter().map(|corner| corner.distance(base.corners[0])).fold(0.0, f64::max);
        if entry.corners.iter().any(|corner| (*corner - base.corners[0]).dot(normal).abs() > COPLANAR * size) {
            let reason = format!("surface {number} does not lie in the plane of its base {}", base.number);
            return error(reason, "move its vertices into the plane");
        }
        if (entry.normal().dot(normal) > 0.0) != (entry.kind == Kind::Radiating) {
            let way = if entry.kind == Kind::Radiating { "the same way as" } else { "against" };
            let reason = format!("surface {number} must face {way} its base {}", base.number);
            return error(reason, "turn the order of its vertices round");
        }
        if !holes::contains(&base.corners, &entry.corners, COPLANAR * size) {
            let reason = format!("surface {number} reaches beyond its base {}", base.number);
            return error(reason, "move its vertices, or write 0 for its base");
        }
        Ok(())
    }

    fn finish(mut self) -> Result<RawScene, ReadError> {
        let mut parts: HashMap<usize, Vec<&[DVec3]>> = HashMap::new();
        for entry in &self.surfaces {
            self.check_combined(entry)?;
            self.check_base(entry)?;
        }
        let names = self.unique_names();
        for entry in &self.surfaces {
            parts.entry(entry.base).or_default().push(&entry.corners);
        }
        let mut builder = MeshBuilder::default();
        let mut materials = Vec::with_capacity(self.surfaces.len());
        for (entry, name) in self.surfaces.iter().zip(&names) {
            let group = builder.group(self.places.get(&entry.combined).map_or(name, |&place| &names[place]));
            let holes = parts.get(&entry.number).into_iter().flatten().copied();
            for piece in holes::without(&entry.corners, holes) {
                add(&mut builder, &piece, entry.number, materials.len() as u32, group);
            }
            let blocks_only = entry.kind != Kind::Radiating;
            materials.push(Material { blocks_only, ..Material::diffuse(name, 1.0 - entry.emittance) });
        }
        let mesh = builder.finish(self.file, &mut self.warnings)?;
        Ok(RawScene {
            mesh,
            materials,
            physics: Physics::Heat,
            camera: None,
            warnings: self.warnings,
            guessed: Vec::new(),
        })
    }

    /// The names of the surfaces, with the number where another before has the same.
    fn unique_names(&mut self) -> Vec<String> {
        let mut known = HashSet::new();
        let mut names = Vec::with_capacity(self.surfaces.len());
        for k in 0..self.surfaces.len() {
            let Entry { statement, number, ref name, .. } = self.surfaces[k];
            let mut unique = name.clone();
            while !known.insert(unique.clone()) {
                unique = format!("{unique}#{number}");
            }
            if unique != *name {
                let text = format!("another surface is called `{name}`, too; this one is `{unique}` here");
                self.warn(statement.line, &text);
            }
            names.push(unique);
        }
        names
    }
}

/// Adds a part of a surface to the mesh.
fn add(builder: &mut MeshBuilder, corners: &[DVec3], number: usize, material: u32, group: u32) {
    let vertices: Vec<u32> = corners.iter().map(|&corner| builder.vertex(corner)).collect();
    for (shape, picked) in builder.cut(corners, || format!("surface {number}")) {
        let vertices = picked.map(|k| vertices[k]);
        builder.face(Face { shape, vertices, uvs: None, normals: None, material, group });
    }
}

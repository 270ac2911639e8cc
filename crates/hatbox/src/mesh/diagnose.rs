//! What is suspicious about a mesh as it was read.
//!
//! A simulation gives numbers for almost any input; these are the mistakes that make the numbers wrong. What
//! [`Scene::new`](crate::scene::Scene::new) repairs or refuses is reported here too, all of it at once and with places.

use super::box_tree::{self, Bounds, BoxTree};
use super::corner::Builder;
use super::intersect::{Contact, contact};
use super::{Cell, Mesh, Topology};
use crate::element::Shape;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashMap;
use std::fmt;

/// How many places a [`Finding`] names.
const EXAMPLES: usize = 5;

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Good to know; often meant so.
    Note,
    /// The result is likely wrong there.
    Warning,
    /// Nothing can be computed.
    Error,
}

/// Kinds of findings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FindingKind {
    /// A face refers to a vertex that does not exist.
    BadIndex,
    /// A face has a corner that is infinite or not a number.
    NotFinite,
    /// A face has no area.
    Degenerate,
    /// Two edges of a quad cross each other: a bow tie.
    SelfCrossing,
    /// A face is there twice.
    Duplicate,
    /// Two faces with the same corners face opposite ways.
    BackToBack,
    /// A face is turned against its neighbours.
    Flipped,
    /// Faces that close off everything look outwards.
    InsideOut,
    /// Two faces go through each other.
    Intersecting,
    /// Two faces in one plane, facing the same way, share area.
    Overlapping,
    /// Two faces in one plane, facing opposite ways, share area.
    Covering,
    /// An edge of a one-sided face where nothing continues.
    OpenEdge,
    /// The whole is larger than a kilometre.
    Large,
    /// The whole is smaller than a centimetre.
    Small,
}

impl FindingKind {
    /// Every kind, in the order of reporting.
    pub const ALL: [Self; 14] = [
        Self::BadIndex,
        Self::NotFinite,
        Self::Degenerate,
        Self::SelfCrossing,
        Self::Duplicate,
        Self::Flipped,
        Self::InsideOut,
        Self::Intersecting,
        Self::Overlapping,
        Self::Large,
        Self::Small,
        Self::BackToBack,
        Self::Covering,
        Self::OpenEdge,
    ];

    /// Its name in machine-readable output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::BadIndex => "bad-index",
            Self::NotFinite => "not-finite",
            Self::Degenerate => "degenerate",
            Self::SelfCrossing => "self-crossing",
            Self::Duplicate => "duplicate",
            Self::BackToBack => "back-to-back",
            Self::Flipped => "flipped",
            Self::InsideOut => "inside-out",
            Self::Intersecting => "intersecting",
            Self::Overlapping => "overlapping",
            Self::Covering => "covering",
            Self::OpenEdge => "open-edge",
            Self::Large => "large",
            Self::Small => "small",
        }
    }

    /// How bad it is.
    pub const fn severity(self) -> Severity {
        match self {
            Self::BadIndex | Self::NotFinite => Severity::Error,
            Self::Degenerate | Self::BackToBack | Self::Covering | Self::OpenEdge => Severity::Note,
            _ => Severity::Warning,
        }
    }

    /// What is counted, of one and of several, as the end of a sentence that begins with the count; for
    /// [`Large`](Self::Large) and [`Small`](Self::Small) a sentence.
    pub const fn summary(self) -> [&'static str; 2] {
        match self {
            Self::BadIndex => {
                ["face refers to vertices that do not exist", "faces refer to vertices that do not exist"]
            }
            Self::NotFinite => [
                "face has a corner that is infinite or not a number",
                "faces have a corner that is infinite or not a number",
            ],
            Self::Degenerate => ["face has no area", "faces have no area"],
            Self::SelfCrossing => ["quad crosses itself, like a bow tie", "quads cross themselves, like a bow tie"],
            Self::Duplicate => ["face is there twice", "faces are there twice"],
            Self::BackToBack => [
                "pair of faces has the same corners and faces opposite ways",
                "pairs of faces have the same corners and face opposite ways",
            ],
            Self::Flipped => ["face is turned against its neighbours", "faces are turned against their neighbours"],
            Self::InsideOut => [
                "face closes off everything and looks outwards: as a room it is inside out, and no light gets in",
                "faces close off everything and look outwards: as a room it is inside out, and no light gets in",
            ],
            Self::Intersecting => ["pair of faces goes through each other", "pairs of faces go through each other"],
            Self::Overlapping => [
                "pair of faces lies on top of each other and faces the same way",
                "pairs of faces lie on top of each other and face the same way",
            ],
            Self::Covering => [
                "pair of faces touches front to front or back to back",
                "pairs of faces touch front to front or back to back",
            ],
            Self::OpenEdge => {
                ["edge of a one-sided face where the surface ends", "edges of one-sided faces where the surface ends"]
            }
            Self::Large => ["the scene is larger than a kilometre"; 2],
            Self::Small => ["the scene is smaller than a centimetre"; 2],
        }
    }

    /// What to do about it.
    pub const fn remedy(self) -> &'static str {
        match self {
            Self::BadIndex => "export the file again; it is damaged",
            Self::NotFinite => "check the transformations in the modelling program and export again",
            Self::Degenerate => "nothing need be done, they are left out",
            Self::SelfCrossing => {
                "exchange two neighbouring corners; as it is, each is two triangles that look opposite ways"
            }
            Self::Duplicate => "remove one of each; modelling programs call it deleting duplicate faces",
            Self::BackToBack => "fine for a sheet lit from both sides; otherwise remove the one that is never seen",
            Self::Flipped => "flip them so that the lit side is the front, or make their material two-sided",
            Self::InsideOut => "turn them all round (flip their normals); fine for a body that is lit from outside",
            Self::Intersecting => "cut them where they meet, or light is wrong where a face is partly hidden inside",
            Self::Overlapping => {
                "one is lit, that of which the object has less in the plane, and what it covers is left out; \
                 if that is not meant, remove one"
            }
            Self::Covering => "fine for a box on a floor; cells that are partly covered are less accurate",
            Self::OpenEdge => "fine for open scenes and sheets; in a closed room, light escapes there",
            Self::Large | Self::Small => "check the length unit; lengths are taken to be metres",
        }
    }
}

/// A place where something was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Example {
    /// Index of the face in the mesh that was diagnosed.
    pub cell: usize,
    /// The other face, of pairs.
    pub other: Option<usize>,
    /// Name of the part that the face belongs to.
    pub group: String,
    /// The middle of the face or edge, in metres; not finite where the face is not.
    pub position: DVec3,
}

/// Something suspicious.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What it is.
    pub kind: FindingKind,
    /// How often.
    pub count: usize,
    /// The first few places.
    pub examples: Vec<Example>,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let summary = self.kind.summary()[usize::from(self.count != 1)];
        if self.examples.is_empty() {
            write!(f, "{summary}")?;
        } else {
            write!(f, "{} {summary}", self.count)?;
        }
        if let Some(Example { cell, other, group, position: p }) = self.examples.first() {
            write!(f, " (first: face {cell}")?;
            if let Some(other) = other {
                write!(f, " and face {other}")?;
            }
            write!(f, " of `{group}`, at {:.4} {:.4} {:.4} m)", p.x, p.y, p.z)?;
        }
        write!(f, ": {}", self.kind.remedy())
    }
}

/// Everything suspicious about a mesh as it was read, in the order of [`FindingKind::ALL`], all faces being one-sided.
/// Vertices may be duplicated, and [`Cell::surface`] is ignored; the mesh may even be damaged.
pub fn diagnose(mesh: &Mesh) -> Vec<Finding> {
    diagnose_sheets(mesh, |_| false)
}

/// Like [`diagnose`], where the materials for which `two_sided` holds are lit from both sides: such faces have no wrong
/// side and no open edges, and one on the other's back is there twice.
pub fn diagnose_sheets(mesh: &Mesh, two_sided: impl Fn(u32) -> bool) -> Vec<Finding> {
    examine(mesh, two_sided, false)
}

/// Like [`diagnose_sheets`], where the mesh is meant to be seen from inside: a closed surface around everything whose
/// faces look outwards is suspicious, too. As the surface of a body it is not.
pub fn diagnose_room(mesh: &Mesh, two_sided: impl Fn(u32) -> bool) -> Vec<Finding> {
    examine(mesh, two_sided, true)
}

fn examine(mesh: &Mesh, two_sided: impl Fn(u32) -> bool, from_inside: bool) -> Vec<Finding> {
    let mut report = Report { mesh, places: HashMap::new() };
    let sound = report.sound_faces();
    let tolerance = sound.tolerance();
    report.scale(sound.diagonal());
    let (welded, _) = sound.welded(tolerance);
    report.degenerate(&sound, &welded);
    report.self_crossing(&sound);
    let two_sided: Vec<bool> = mesh.cells.iter().map(|cell| two_sided(cell.material)).collect();
    let welded = report.without_duplicates(&welded, &two_sided);
    report.contacts(&welded, tolerance);
    let (conforming, _) = welded.conformed(tolerance);
    let topology = Topology::new(&conforming);
    report.open_edges(&conforming, &topology, &two_sided);
    let parts = report.flipped(&conforming, &topology, &two_sided);
    if from_inside {
        report.inside_out(&conforming, &topology, &two_sided, &parts);
    }
    report.finish()
}

/// Findings while they are collected. The meshes that are looked into are cleaned copies whose [`Cell::surface`] is the
/// index of the face in the mesh that was read.
struct Report<'a> {
    mesh: &'a Mesh,
    places: HashMap<FindingKind, (usize, Vec<Example>)>,
}

impl Report<'_> {
    fn add(&mut self, kind: FindingKind, cell: usize, other: Option<usize>, position: DVec3) {
        let (count, examples) = self.places.entry(kind).or_default();
        *count += 1;
        if examples.len() < EXAMPLES {
            let group = self.mesh.groups.get(self.mesh.cells[cell].group as usize);
            examples.push(Example { cell, other, group: group.cloned().unwrap_or_default(), position });
        }
    }

    fn finish(mut self) -> Vec<Finding> {
        let finding = |kind| self.places.remove(&kind).map(|(count, examples)| Finding { kind, count, examples });
        FindingKind::ALL.into_iter().filter_map(finding).collect()
    }

    /// The faces that can be looked at.
    fn sound_faces(&mut self) -> Mesh {
        let mesh = self.mesh;
        let mut builder = Builder::like(mesh);
        for (index, cell) in mesh.cells.iter().enumerate() {
            if cell.vertices.iter().any(|&v| v as usize >= mesh.vertices.len()) {
                self.add(FindingKind::BadIndex, index, None, DVec3::NAN);
                continue;
            }
            let corners = mesh.corners(index);
            if corners.iter().all(|corner| corner.position.is_finite()) {
                builder.push(&Cell { surface: index as u32, ..*cell }, &corners[..cell.shape.corners()]);
            } else {
                self.add(FindingKind::NotFinite, index, None, mesh.patch(index).center());
            }
        }
        builder.finish().without_unused_vertices()
    }

    fn scale(&mut self, diagonal: f64) {
        let kinds = [(FindingKind::Large, diagonal > 1e3), (FindingKind::Small, diagonal > 0.0 && diagonal < 1e-2)];
        for (kind, _) in kinds.into_iter().filter(|&(_, found)| found) {
            self.places.insert(kind, (1, Vec::new()));
        }
    }

    fn degenerate(&mut self, sound: &Mesh, welded: &Mesh) {
        let mut kept = welded.cells.iter().map(|cell| cell.surface).peekable();
        for (index, cell) in sound.cells.iter().enumerate() {
            if kept.next_if_eq(&cell.surface).is_none() {
                self.add(FindingKind::Degenerate, cell.surface as usize, None, sound.patch(index).center());
            }
        }
    }

    /// Quads of which either diagonal makes two triangles that look opposite ways.
    fn self_crossing(&mut self, sound: &Mesh) {
        for (index, cell) in sound.cells.iter().enumerate().filter(|(_, cell)| cell.shape == Shape::Quad) {
            let p = sound.corners(index).map(|corner| corner.position);
            let turn = |k: usize| (p[(k + 1) % 4] - p[k]).cross(p[(k + 2) % 4] - p[(k + 1) % 4]);
            let opposite = |k: usize| turn(k).dot(turn((k + 2) % 4)) < 0.0;
            if opposite(0) && opposite(1) {
                self.add(FindingKind::SelfCrossing, cell.surface as usize, None, p.iter().sum::<DVec3>() / 4.0);
            }
        }
    }

    /// The faces without those that are there already; two sides of a sheet stay.
    fn without_duplicates(&mut self, welded: &Mesh, two_sided: &[bool]) -> Mesh {
        let mut builder = Builder::like(welded);
        let mut first: HashMap<[u32; 4], usize> = HashMap::new();
        for (index, cell) in welded.cells.iter().enumerate() {
            let corners = welded.corners(index);
            let other = *first.entry(corner_set(cell)).or_insert(index);
            if other == index {
                builder.push(cell, &corners[..cell.shape.corners()]);
                continue;
            }
            let patch = welded.patch(index);
            let (a, b) = (welded.cells[other].surface as usize, cell.surface as usize);
            let same_way = patch.normal().dot(welded.patch(other).normal()) > 0.0;
            let twice = same_way || two_sided[a] || two_sided[b];
            let kind = if twice { FindingKind::Duplicate } else { FindingKind::BackToBack };
            self.add(kind, a, Some(b), patch.center());
            if !twice {
                builder.push(cell, &corners[..cell.shape.corners()]);
            }
        }
        builder.finish()
    }

    /// Pairs that cross or cover each other; those with the same corners have been reported.
    fn contacts(&mut self, welded: &Mesh, tolerance: f64) {
        let boxes: Vec<Bounds> = (0..welded.cells.len())
            .map(|cell| box_tree::bounds(welded.patch(cell).corners().iter().copied()))
            .collect();
        let tree = BoxTree::new(&boxes, (0..boxes.len() as u32).collect());
        let contacts_of = |a: usize| {
            let near = |b: &Bounds| b.0.cmple(boxes[a].1 + tolerance).all() && boxes[a].0.cmple(b.1 + tolerance).all();
            let mut found = Vec::new();
            tree.visit(near, |b| {
                let b = b as usize;
                if b > a && near(&boxes[b]) && corner_set(&welded.cells[a]) != corner_set(&welded.cells[b]) {
                    found.extend(cells_contact(welded, a, b, tolerance).map(|contact| (a, b, contact)));
                }
            });
            found.sort_unstable_by_key(|&(_, b, _)| b);
            found
        };
        let found: Vec<_> = (0..boxes.len()).into_par_iter().flat_map_iter(contacts_of).collect();
        for (a, b, contact) in found {
            let kind = match contact {
                Contact::Crossing => FindingKind::Intersecting,
                Contact::Overlapping => FindingKind::Overlapping,
                Contact::BackToBack => FindingKind::Covering,
            };
            // Of the two, the smaller is nearer to where they meet.
            let (p, q) = (welded.patch(a), welded.patch(b));
            let at = if p.area() < q.area() { p.center() } else { q.center() };
            self.add(kind, welded.cells[a].surface as usize, Some(welded.cells[b].surface as usize), at);
        }
    }

    fn open_edges(&mut self, mesh: &Mesh, topology: &Topology, two_sided: &[bool]) {
        for edge in topology.open_edges() {
            let face = mesh.cells[topology.sides(edge)[0].cell as usize].surface as usize;
            if !two_sided[face] {
                let [a, b] = topology.vertices(edge).map(|v| mesh.vertices[v as usize]);
                self.add(FindingKind::OpenEdge, face, None, a.midpoint(b));
            }
        }
    }

    /// In each connected part, the faces that are turned against most of its area. Returns the parts that have none.
    fn flipped(&mut self, mesh: &Mesh, topology: &Topology, two_sided: &[bool]) -> Vec<Vec<usize>> {
        let mut turned: Vec<Option<bool>> = vec![None; mesh.cells.len()];
        let mut flipped = vec![false; self.mesh.cells.len()];
        let mut sound = Vec::new();
        for seed in 0..mesh.cells.len() {
            if turned[seed].is_some() {
                continue;
            }
            let part = orient(mesh, topology, two_sided, seed, &mut turned);
            let area =
                |way| -> f64 { part.iter().filter(|&&c| turned[c] == Some(way)).map(|&c| mesh.patch(c).area()).sum() };
            let wrong = area(true) <= area(false);
            for &cell in part.iter().filter(|&&c| turned[c] == Some(wrong)) {
                flipped[mesh.cells[cell].surface as usize] = true;
            }
            if part.iter().all(|&c| turned[c] != Some(wrong)) {
                sound.push(part);
            }
        }
        for index in (0..flipped.len()).filter(|&index| flipped[index]) {
            self.add(FindingKind::Flipped, index, None, self.mesh.patch(index).center());
        }
        sound
    }

    /// Closed parts that everything is inside of, and whose faces look outwards: their signed volume is positive.
    fn inside_out(&mut self, mesh: &Mesh, topology: &Topology, two_sided: &[bool], parts: &[Vec<usize>]) {
        let (least, greatest) = mesh.bounds();
        let tolerance = 1e-9 * least.distance(greatest);
        for part in parts {
            let edges = |cell: usize| (0..mesh.cells[cell].shape.corners()).map(move |k| topology.edge(cell, k));
            let is_closed = part.iter().all(|&cell| {
                !two_sided[mesh.cells[cell].surface as usize] && edges(cell).all(|e| topology.sides(e).len() == 2)
            });
            let (lo, hi) = box_tree::bounds(part.iter().flat_map(|&cell| mesh.corners(cell).map(|c| c.position)));
            let holds_all = lo.cmple(least + tolerance).all() && hi.cmpge(greatest - tolerance).all();
            let volume = |&cell: &usize| {
                let patch = mesh.patch(cell);
                (patch.center() - least).dot(patch.normal()) * patch.area() / 3.0
            };
            if is_closed && holds_all && part.iter().map(volume).sum::<f64>() > 0.0 {
                for &cell in part {
                    let index = mesh.cells[cell].surface as usize;
                    self.add(FindingKind::InsideOut, index, None, mesh.patch(cell).center());
                }
            }
        }
    }
}

/// The part of the surface that hangs together with `seed` through edges of two one-sided cells. Notes for each of its
/// cells whether it is turned against the seed.
fn orient(
    mesh: &Mesh,
    topology: &Topology,
    two_sided: &[bool],
    seed: usize,
    turned: &mut [Option<bool>],
) -> Vec<usize> {
    turned[seed] = Some(false);
    let mut part = vec![seed];
    let mut next = 0;
    while let Some(&cell) = part.get(next) {
        next += 1;
        for k in 0..mesh.cells[cell].shape.corners() {
            let [a, b] = topology.sides(topology.edge(cell, k)) else { continue };
            let other = if a.cell as usize == cell { b.cell } else { a.cell } as usize;
            let sheet = [cell, other].iter().any(|&c| two_sided[mesh.cells[c].surface as usize]);
            // Facing the same way from the same side of the edge, they lie on top of each other: not neighbours.
            let same_way = a.forward == b.forward;
            let stacked = same_way && mesh.normal_angle(cell, other) < 1e-3;
            if turned[other].is_none() && !sheet && !stacked {
                turned[other] = turned[cell].map(|t| t ^ same_way);
                part.push(other);
            }
        }
    }
    part
}

/// The corners of a cell in a fixed order, whichever way round it is.
fn corner_set(cell: &Cell) -> [u32; 4] {
    let mut set = cell.vertices;
    set.sort_unstable();
    if cell.shape == Shape::Triangle {
        // A triangle repeats a corner; which one must not matter.
        let mut three = [cell.vertices[0], cell.vertices[1], cell.vertices[2]];
        three.sort_unstable();
        set = [three[0], three[1], three[2], u32::MAX];
    }
    set
}

/// How two cells meet: crossing, if any of their triangles cross.
fn cells_contact(mesh: &Mesh, a: usize, b: usize, tolerance: f64) -> Option<Contact> {
    let triangles = |cell: usize| {
        let patch = mesh.patch(cell);
        patch.triangles().iter().map(move |t| t.map(|k| patch.corners()[k]))
    };
    let mut found = None;
    for p in triangles(a) {
        for q in triangles(b) {
            match contact(&p, &q, tolerance) {
                Some(Contact::Crossing) => return Some(Contact::Crossing),
                other => found = found.or(other),
            }
        }
    }
    found
}

//! What is suspicious about a scene before anything is computed: its mesh, its materials, and where no light goes.
//!
//! The mesh is examined as it was read (see [`crate::mesh::diagnose`]); whether light can reach a face is found by rays.
//! Seeing is mutual, so a face is lit if a cosine ray from a lit face hits it, or one from it hits a lit face. Rays go
//! out from the emitters and from whatever they light, until no dark face finds a lit one any more. A face that is seen
//! only through a pinhole may be called dark; one that is called lit is.

use crate::assemble::Panel;
use crate::element::ALL;
use crate::exchange::{Geometry, escape};
use crate::kernel::Frame;
use crate::mesh::{Finding, Mesh, Severity, diagnose_room};
use crate::progress::Silent;
use crate::quadrature::sequence::{hash, point};
use crate::radiosity;
use crate::scene::{Material, Physics, Scene, SceneError, Warning};
use crate::space::FunctionSpace;
use crate::visibility::{Bvh, Hit, Visibility};
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;
use std::sync::{Arc, OnceLock};

/// Rays from each face, whenever it looks around.
const RAYS: u32 = 256;
/// How many dark faces are named.
const EXAMPLES: usize = 5;

/// Everything found about a scene.
#[derive(Debug, Clone)]
pub struct Check {
    /// What is suspicious about the mesh as it was read.
    pub findings: Vec<Finding>,
    /// Why nothing can be computed.
    pub error: Option<SceneError>,
    /// What would be repaired.
    pub repairs: Vec<Warning>,
    /// Where light goes; `None` if nothing can be computed.
    pub lighting: Option<Lighting>,
    /// Why the light has no bound, if it has none.
    pub unbounded: Option<radiosity::Error>,
    /// The scene, if it can be computed.
    pub scene: Option<Scene>,
}

/// Where light goes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Lighting {
    /// Lit sides of faces, of which there are two where the material is two-sided.
    pub faces: usize,
    /// How many of them emit.
    pub emitters: usize,
    /// How many of them no light reaches.
    pub dark: usize,
    /// Their share of the area.
    pub dark_area: f64,
    /// The first few of them.
    pub examples: Vec<DarkFace>,
    /// Fraction of the light that leaves the scene, or ends on backs, if all surfaces glow alike; 0 in a closed scene.
    pub escape: f64,
}

/// A face that no light reaches.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DarkFace {
    /// Name of its part.
    pub group: String,
    /// Name of its material.
    pub material: String,
    /// Its middle, in metres.
    pub position: [f64; 3],
}

impl Check {
    /// Examines what a file says.
    pub fn new(mesh: Mesh, materials: Vec<Material>, physics: Physics) -> Self {
        let two_sided = |material: u32| materials.get(material as usize).is_some_and(|material| material.two_sided);
        let findings = diagnose_room(&mesh, two_sided);
        match Scene::new(mesh, materials, physics, None) {
            Ok(scene) => {
                let (repairs, lighting) = (scene.warnings.clone(), Lighting::of(&scene));
                let escape = lighting.as_ref().ok_or(()).map(|lighting| lighting.escape);
                let unbounded = radiosity::lossless(&scene, || escape).unwrap_or(None);
                Self { findings, error: None, repairs, lighting, unbounded, scene: Some(scene) }
            }
            Err(error) => {
                let (error, repairs) = (Some(error), Vec::new());
                Self { findings, error, repairs, lighting: None, unbounded: None, scene: None }
            }
        }
    }

    /// Whether something makes a computation impossible.
    pub fn has_errors(&self) -> bool {
        self.error.is_some()
            || self.unbounded.is_some()
            || self.findings.iter().any(|finding| finding.kind.severity() == Severity::Error)
    }
}

impl Lighting {
    /// Finds where the light of a scene goes; `None` for what is no scene of elements.
    pub fn of(scene: &Scene) -> Option<Self> {
        let space = FunctionSpace::broken(&scene.mesh, &ALL[0]).ok()?;
        let (panels, blockers) = (OnceLock::new(), Arc::new(Bvh::of_surfaces(&scene.surfaces)));
        let geometry = Geometry::new(scene, &space, &blockers, &panels);
        let panels = geometry.panels();
        let sides = Sides::of(scene, panels, &blockers);
        let escape = escape(&geometry, 0, &Silent).ok()?;
        let lit = sides.lit();
        let dark: Vec<usize> = (0..panels.len()).filter(|&cell| !lit[sides.of_cell[cell]]).collect();
        let area = |cells: &[usize]| cells.iter().map(|&cell| panels[cell].area()).sum::<f64>();
        let dark_sides = lit.iter().filter(|&&lit| !lit).count();
        Some(Self {
            faces: lit.len(),
            emitters: sides.emits.iter().filter(|&&emits| emits).count(),
            dark: dark_sides,
            // Plus 0, since a sum of nothing is −0.
            dark_area: area(&dark) / scene.mesh.area() + 0.0,
            examples: dark.iter().take(EXAMPLES).map(|&cell| dark_face(scene, cell)).collect(),
            escape: escape.fraction,
        })
    }
}

fn dark_face(scene: &Scene, cell: usize) -> DarkFace {
    DarkFace {
        group: scene.mesh.groups[scene.mesh.cells[cell].group as usize].clone(),
        material: scene.material(cell).name.clone(),
        position: scene.mesh.patch(cell).center().to_array(),
    }
}

/// The lit sides of faces, between which light goes.
struct Sides<'a> {
    panels: &'a [Panel],
    blockers: &'a Bvh,
    /// The side that each cell is a part of.
    of_cell: Vec<usize>,
    /// The cells of each side.
    cells: Vec<Vec<usize>>,
    /// The side that is hit on the front and on the back of each face of the input.
    of_surface: Vec<[Option<usize>; 2]>,
    emits: Vec<bool>,
    reflects: Vec<bool>,
}

impl<'a> Sides<'a> {
    fn of(scene: &Scene, panels: &'a [Panel], blockers: &'a Bvh) -> Self {
        let of_surface = vec![[None; 2]; scene.surfaces.len()];
        let mut sides = Self {
            panels,
            blockers,
            of_cell: Vec::with_capacity(panels.len()),
            cells: Vec::new(),
            of_surface,
            emits: Vec::new(),
            reflects: Vec::new(),
        };
        for (cell, panel) in panels.iter().enumerate() {
            let surface = &scene.surfaces[panel.surface as usize];
            let normal = surface.triangles().map(|[a, b, c]| (b - a).cross(c - a)).sum::<DVec3>();
            let back = usize::from(normal.dot(panel.normal()) < 0.0);
            let material = scene.material(cell);
            let side = *sides.of_surface[panel.surface as usize][back].get_or_insert_with(|| {
                sides.cells.push(Vec::new());
                sides.emits.push(!material.exitance.is_zero());
                sides.reflects.push(!material.reflectance.is_zero());
                sides.cells.len() - 1
            });
            sides.of_cell.push(side);
            sides.cells[side].push(cell);
        }
        sides
    }

    /// Which sides light reaches, emitters included.
    fn lit(&self) -> Vec<bool> {
        let mut lit = self.emits.clone();
        let emitters: Vec<usize> = (0..self.panels.len()).filter(|&cell| self.emits[self.of_cell[cell]]).collect();
        let mut fresh: Vec<usize> = (0..lit.len()).filter(|&side| lit[side]).collect();
        let mut round = 0;
        while !fresh.is_empty() {
            // What is seen from where light comes from is lit.
            while !fresh.is_empty() {
                let senders: Vec<usize> = fresh.into_iter().filter(|&side| self.sends(side)).collect();
                let seen: Vec<Vec<usize>> = senders.par_iter().map(|&side| self.seen_from(side, round)).collect();
                fresh = Vec::new();
                for side in seen.into_iter().flatten() {
                    if !std::mem::replace(&mut lit[side], true) {
                        fresh.push(side);
                    }
                }
            }
            // So is what sees where light comes from.
            let dark: Vec<usize> = (0..lit.len()).filter(|&side| !lit[side]).collect();
            let sees_light = |&side: &usize| {
                self.sees(side, &emitters, round)
                    || self.seen_from(side, round).into_iter().any(|other| lit[other] && self.sends(other))
            };
            fresh = dark.into_par_iter().filter(sees_light).collect();
            for &side in &fresh {
                lit[side] = true;
            }
            round += 1;
        }
        lit
    }

    /// Whether light leaves a lit side.
    fn sends(&self, side: usize) -> bool {
        self.emits[side] || self.reflects[side]
    }

    /// Whether points of some cells are seen from a side: lamps that are small or far are missed by rays that go anywhere.
    fn sees(&self, side: usize, cells: &[usize], round: u64) -> bool {
        let (own, set) = (&self.cells[side], hash(round, side as u64));
        // Each of the cells twice, at least.
        let rays = if cells.is_empty() { 0 } else { RAYS.max(2 * cells.len() as u32) };
        (0..rays).any(|k| {
            let ([share, ..], [u, v, s, t]) = (point(hash(set, 1), k), point(set, k));
            let panel = &self.panels[own[((share * own.len() as f64) as usize).min(own.len() - 1)]];
            let other = &self.panels[cells[k as usize % cells.len()]];
            let (from, to) = (place(panel, [u, v]), place(other, [s, t]));
            let way = to - from;
            way.dot(panel.normal()) > 0.0
                && way.dot(other.normal()) < 0.0
                && !self.blockers.occluded(from, to, [panel.surface, other.surface])
        })
    }

    /// The sides that rays from one side hit.
    fn seen_from(&self, side: usize, round: u64) -> Vec<usize> {
        let cells = &self.cells[side];
        let set = hash(round, side as u64);
        let mut seen: Vec<usize> = (0..RAYS)
            .filter_map(|k| {
                let panel = &self.panels[cells[k as usize % cells.len()]];
                let (origin, direction) = ray(panel, point(set, k));
                let hit = self.blockers.closest_hit(origin, direction, f64::INFINITY, |id, _| id != panel.surface)?;
                self.hit(&hit)
            })
            .collect();
        seen.sort_unstable();
        seen.dedup();
        seen
    }

    fn hit(&self, hit: &Hit) -> Option<usize> {
        self.of_surface[hit.id as usize][usize::from(!hit.front)]
    }
}

/// A point of a panel and a cosine-distributed direction from it.
fn ray(panel: &Panel, [u, v, s, t]: [f64; 4]) -> (DVec3, DVec3) {
    (place(panel, [u, v]), Frame::about(panel.normal()).cosine(s, t))
}

/// A point of a panel.
fn place(panel: &Panel, [u, v]: [f64; 2]) -> DVec3 {
    panel.patch.point(if panel.patch.corners().len() == 3 { [1.0 - u.sqrt(), u.sqrt() * v] } else { [u, v] })
}

//! Lines along which shadows are sharp, cut into the first mesh.
//!
//! Where a lamp is small or an occluder near, the border of a shadow is narrower than the elements around it. Halving
//! triangles follows it with ever more of them, a number like its length over its width; two lines, along the beginning and
//! the end of the half-shadow, make strips of it in which the light is smooth (P. Heckbert, "Discontinuity meshing for
//! radiosity", Eurographics Workshop on Rendering 1992). The lines are the images of the occluder's edges as the lamp's
//! outermost corners throw them. Wide half-shadows are left alone: there the light has a continuous slope at their borders,
//! and triangles that lines have cut thin cost more than they gain.

use crate::mesh::{Line, Patch};
use crate::scene::Scene;
use crate::visibility::Occluders;
use glam::DVec3;

/// A half-shadow is narrow if it is so many times narrower than the elements of the first mesh.
const NARROW: f64 = 0.25;
/// Corners of a lamp that throw an edge to the same place, relative to the size of the elements.
const SAME: f64 = 1e-6;
/// More lamps than this are no lamps: everything glows, and there are no sharp shadows.
const MOST_LAMPS: usize = 16;
/// More lamps × occluders × faces than this are not looked at.
const MOST: usize = 200_000;

/// The scene with the narrow borders of its shadows among the edges of its cells; `size` is the length of the edges that
/// the first mesh will have.
pub(super) fn with_sharp_borders(scene: &Scene, size: f64) -> Scene {
    let occluders = &Occluders::new(&scene.surfaces);
    let mesh = &scene.mesh;
    let cells: Vec<Patch> = (0..mesh.cells.len()).map(|cell| mesh.patch(cell)).collect();
    let mut lamps: Vec<(u32, DVec3)> = (0..cells.len())
        .filter(|&cell| !scene.material(cell).exitance.is_zero())
        .map(|cell| (occluders.of_surface(mesh.cells[cell].surface), cells[cell].normal()))
        .collect();
    lamps.sort_unstable_by_key(|&(polygon, _)| polygon);
    lamps.dedup_by_key(|&mut (polygon, _)| polygon);
    if lamps.len() > MOST_LAMPS || lamps.len() * occluders.len() * cells.len() > MOST {
        return scene.clone();
    }
    let receivers = cells.iter().enumerate().filter(|&(cell, _)| receives(scene, cell));
    let lines: Vec<(usize, Line)> = receivers
        .flat_map(|(cell, patch)| {
            let lamps = lamps.iter().copied();
            lamps.flat_map(move |lamp| (0..occluders.len() as u32).map(move |blocker| (cell, patch, lamp, blocker)))
        })
        .filter(|&(_, _, (lamp, _), blocker)| blocker != lamp)
        .flat_map(|(cell, patch, lamp, blocker)| {
            let found = thrown(occluders, lamp, blocker, patch, size);
            found.into_iter().map(move |line| (cell, line))
        })
        .collect();
    scene.split_along(&lines)
}

/// The narrow borders that a blocker throws on a cell in the light of a lamp, which looks along a normal.
fn thrown(occluders: &Occluders, lamp: (u32, DVec3), blocker: u32, patch: &Patch, size: f64) -> Vec<Line> {
    let (lamp, normal) = (occluders.polygon(lamp.0), lamp.1);
    let corners = occluders.polygon(blocker);
    let edge = |k: usize| [corners[k], corners[(k + 1) % corners.len()]];
    let in_front = |edge: &[DVec3; 2]| edge.iter().all(|&p| normal.dot(p - lamp[0]) > 0.0);
    (0..corners.len()).map(edge).filter(in_front).flat_map(|edge| borders(lamp, edge, patch, size)).collect()
}

/// Whether there is anything to see on a cell.
fn receives(scene: &Scene, cell: usize) -> bool {
    let reflectance = &scene.material(cell).reflectance;
    (0..scene.bands).any(|band| reflectance.uniform(band) != Some(0.0))
}

/// The first and the last of the lines to which the corners of a lamp throw an edge on the plane of a cell, if they lie
/// close to each other.
fn borders(lamp: &[DVec3], edge: [DVec3; 2], patch: &Patch, size: f64) -> Vec<Line> {
    let images: Vec<Line> = lamp.iter().filter_map(|&corner| image(corner, edge, patch)).collect();
    let Some(&[from, to]) = images.first() else { return Vec::new() };
    let across = patch.normal().cross(to - from).normalize_or_zero();
    let offset = |line: &Line| across.dot(line[0].midpoint(line[1]) - from);
    let (least, greatest) =
        images.iter().map(offset).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
    if images.len() < lamp.len() || greatest - least > NARROW * size {
        return Vec::new();
    }
    let outermost = |line: &Line| offset(line) - least <= SAME * size || greatest - offset(line) <= SAME * size;
    images.into_iter().filter(outermost).collect()
}

/// The image of an edge on the plane of a cell, seen from a point; `None` if the edge does not lie between them.
fn image(eye: DVec3, edge: [DVec3; 2], patch: &Patch) -> Option<Line> {
    let height = |p: DVec3| patch.normal().dot(p - patch.corners()[0]);
    let from = height(eye);
    let [h, g] = edge.map(height);
    let rounding = 1e-9 * from;
    if from <= 0.0 || h < -rounding || g < -rounding || h.max(g) >= from || h.max(g) <= rounding {
        return None;
    }
    let [p, q] = edge;
    Some([(p, h), (q, g)].map(|(p, h)| eye + (p - eye) * (from / (from - h.max(0.0)))))
}

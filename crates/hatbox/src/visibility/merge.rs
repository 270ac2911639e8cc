use crate::mesh::polygon::area_vector;
use crate::scene::Surface;
use glam::DVec3;
use rustc_hash::FxHashMap;

/// Most corners of a merged polygon.
const MAX_CORNERS: usize = 8;
/// Corners lie in one plane, and on one line, if they are off it by less than this fraction of the polygon's size. All
/// corners of faces on a polygon's outline are asked, those too that were left out before: a strip that bends by less than this
/// at each of a hundred faces is not one polygon.
const FLAT: f64 = 1e-7;

/// Convex polygons and what they consist of.
pub(super) struct Merged {
    pub(super) polygons: Vec<Vec<DVec3>>,
    /// The polygon that each face is a part of.
    pub(super) of_surface: Vec<u32>,
}

/// Merges faces that share an edge, lie in one plane and look the same way, as long as the union is convex.
///
/// Each polygon grows across its edges, in order, as far as it can; a grid becomes rows, and the rows one rectangle.
pub(super) fn merged(surfaces: &[Surface]) -> Merged {
    let mut union = Union::new(surfaces);
    for polygon in 0..surfaces.len() {
        while union.grow(polygon) {}
    }
    union.finish()
}

struct Union {
    points: Vec<DVec3>,
    /// The outline of each polygon; empty once it is part of another.
    outlines: Vec<Vec<Corner>>,
    /// The polygon on the left of each directed edge.
    left_of: FxHashMap<[u32; 2], usize>,
    /// What a polygon has become a part of; itself if it has not.
    part_of: Vec<usize>,
}

/// A corner of an outline.
#[derive(Clone)]
struct Corner {
    point: u32,
    /// Corners of faces on the edge that starts here, which are in line with its ends.
    along: Vec<u32>,
}

impl Union {
    fn new(surfaces: &[Surface]) -> Self {
        let mut index_of = FxHashMap::default();
        let mut points = Vec::new();
        let mut corner = |p: DVec3| {
            // Adding zero makes −0 the same as 0.
            let point = *index_of.entry((p + 0.0).to_array().map(f64::to_bits)).or_insert_with(|| {
                points.push(p);
                points.len() as u32 - 1
            });
            Corner { point, along: Vec::new() }
        };
        let outlines: Vec<Vec<Corner>> =
            surfaces.iter().map(|face| face.corners().iter().map(|&p| corner(p)).collect()).collect();
        let part_of = (0..outlines.len()).collect();
        let mut union = Self { points, outlines, left_of: FxHashMap::default(), part_of };
        for polygon in 0..union.outlines.len() {
            union.enter(polygon);
        }
        union
    }

    fn edges(outline: &[Corner]) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..outline.len()).map(|k| [outline[k].point, outline[(k + 1) % outline.len()].point])
    }

    fn enter(&mut self, polygon: usize) {
        for edge in Self::edges(&self.outlines[polygon]) {
            self.left_of.insert(edge, polygon);
        }
    }

    fn leave(&mut self, polygon: usize) {
        for edge in Self::edges(&self.outlines[polygon]) {
            // Where faces overlap, the edge may be another's by now.
            if self.left_of.get(&edge) == Some(&polygon) {
                self.left_of.remove(&edge);
            }
        }
    }

    /// Merges a polygon with the first of its neighbours that it can be merged with; false if there is none.
    fn grow(&mut self, polygon: usize) -> bool {
        let found = Self::edges(&self.outlines[polygon]).find_map(|edge @ [u, v]| {
            let other = *self.left_of.get(&[v, u])?;
            let merged = (other != polygon).then(|| self.joined(polygon, other, edge)).flatten()?;
            Some((other, merged))
        });
        let Some((other, merged)) = found else { return false };
        self.leave(polygon);
        self.leave(other);
        self.outlines[other].clear();
        self.outlines[polygon] = merged;
        self.part_of[other] = polygon;
        self.enter(polygon);
        true
    }

    /// The union of two polygons across the edge u → v of the first; `None` if it is not convex and planar.
    fn joined(&self, a: usize, b: usize, [u, v]: [u32; 2]) -> Option<Vec<Corner>> {
        let (a, b) = (&self.outlines[a], &self.outlines[b]);
        let from = |outline: &[Corner], start: u32| {
            let at = outline.iter().position(|corner| corner.point == start).unwrap_or(0);
            (0..outline.len() - 1).map(|k| outline[(at + k) % outline.len()].clone()).collect::<Vec<_>>()
        };
        // a from v round to u, then b from u round to v, both without the last.
        let mut merged = from(a, v);
        merged.extend(from(b, u));
        let allowed = FLAT * self.size(&merged);
        let normal = self.area_vector(&merged).try_normalize()?;
        let height = |p: u32| normal.dot(self.point(p) - self.point(u)).abs();
        let flat =
            |corner: &Corner| height(corner.point) <= allowed && corner.along.iter().all(|&p| height(p) <= allowed);
        if !merged.iter().all(flat) || self.area_vector(a).dot(self.area_vector(b)) <= 0.0 {
            return None;
        }
        for point in [u, v] {
            let at = merged.iter().position(|corner| corner.point == point)?;
            let before = (at + merged.len() - 1) % merged.len();
            let along: Vec<u32> =
                merged[before].along.iter().copied().chain([point]).chain(merged[at].along.iter().copied()).collect();
            let ends = [merged[before].point, merged[(at + 1) % merged.len()].point];
            if along.iter().all(|&p| self.outside(p, ends, normal).abs() <= allowed) {
                merged[before].along = along;
                merged.remove(at);
            } else if self.outside(point, ends, normal) < 0.0 {
                return None;
            }
        }
        (3..=MAX_CORNERS).contains(&merged.len()).then_some(merged)
    }

    /// The distance of a point from the line through two others, positive to the right of it.
    fn outside(&self, point: u32, ends: [u32; 2], normal: DVec3) -> f64 {
        let [from, to] = ends.map(|end| self.point(end));
        let base = to - from;
        (self.point(point) - from).cross(base).dot(normal) / base.length().max(f64::MIN_POSITIVE)
    }

    fn point(&self, index: u32) -> DVec3 {
        self.points[index as usize]
    }

    fn size(&self, outline: &[Corner]) -> f64 {
        let first = self.point(outline[0].point);
        outline.iter().map(|corner| self.point(corner.point).distance(first)).fold(0.0, f64::max)
    }

    fn corners(&self, outline: &[Corner]) -> Vec<DVec3> {
        outline.iter().map(|corner| self.point(corner.point)).collect()
    }

    fn area_vector(&self, outline: &[Corner]) -> DVec3 {
        area_vector(&self.corners(outline))
    }

    fn finish(self) -> Merged {
        let mut number = vec![u32::MAX; self.outlines.len()];
        let mut polygons = Vec::new();
        for (k, outline) in self.outlines.iter().enumerate().filter(|(_, outline)| !outline.is_empty()) {
            number[k] = polygons.len() as u32;
            polygons.push(self.corners(outline));
        }
        let whole = |mut k: usize| {
            while self.part_of[k] != k {
                k = self.part_of[k];
            }
            number[k]
        };
        Merged { polygons, of_surface: (0..self.outlines.len()).map(whole).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::polygon::area;

    /// Faces of an n × n grid on the unit square, as quads or as triangles, turned out of the axes.
    fn grid(n: usize, triangles: bool) -> Vec<Surface> {
        let turn = glam::DMat3::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1);
        let at = |i: usize, j: usize| turn * DVec3::new(i as f64 / n as f64, j as f64 / n as f64, 0.25);
        let mut faces = Vec::new();
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            if triangles {
                faces.extend([[a, b, c, c], [a, c, d, d]].map(|corners| Surface { corners }));
            } else {
                faces.push(Surface { corners: [a, b, c, d] });
            }
        }
        faces
    }

    #[test]
    fn a_grid_becomes_one_rectangle() {
        let merged = merged(&grid(7, false));
        assert_eq!((merged.polygons.len(), merged.polygons[0].len()), (1, 4));
        assert!(merged.of_surface.iter().all(|&polygon| polygon == 0));
        assert!((area(&merged.polygons[0]) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_wall_of_triangles_keeps_its_area_in_few_polygons() {
        let merged = merged(&grid(7, true));
        let total: f64 = merged.polygons.iter().map(|polygon| area(polygon)).sum();
        assert!((total - 1.0).abs() < 1e-12, "{total}");
        assert!(merged.polygons.len() <= 98 / 5, "{}", merged.polygons.len());
    }

    #[test]
    fn a_strip_that_bends_a_little_at_each_face_stays_near_its_faces() {
        let n = 100;
        // Upwards and sideways; neighbours are in line to 2e-8, the ends of the strip are not.
        let at = |k: usize, y: f64| {
            let (x, bend) = (k as f64, 1e-8 * (k * k) as f64);
            DVec3::new(x, y + bend, bend)
        };
        let face = |k: usize| Surface { corners: [at(k, 0.0), at(k + 1, 0.0), at(k + 1, 1.0), at(k, 1.0)] };
        let faces: Vec<Surface> = (0..n).map(face).collect();
        let merged = merged(&faces);
        assert!((2..n / 2).contains(&merged.polygons.len()), "{}", merged.polygons.len());
        for (face, &polygon) in faces.iter().zip(&merged.of_surface) {
            let whole = &merged.polygons[polygon as usize];
            let normal = area_vector(whole).normalize();
            let allowed = 1.5 * FLAT * whole[0].distance(whole[2]);
            for (k, corner) in face.corners().iter().enumerate() {
                assert!(normal.dot(*corner - whole[0]).abs() <= allowed, "{k}");
                let off = |i: usize| {
                    let (p, q) = (whole[i], whole[(i + 1) % whole.len()]);
                    normal.cross(q - p).normalize().dot(*corner - p).abs()
                };
                let least = (0..whole.len()).map(off).fold(f64::INFINITY, f64::min);
                assert!(least <= allowed, "a long side is near every corner: {least:e}");
            }
        }
    }

    #[test]
    fn what_is_not_convex_or_not_flat_stays_apart() {
        let mut faces = grid(3, false);
        faces.remove(4);
        let merged_ring = merged(&faces);
        assert!(merged_ring.polygons.len() > 1);
        assert!((merged_ring.polygons.iter().map(|p| area(p)).sum::<f64>() - 8.0 / 9.0).abs() < 1e-12);
        let bent = [
            Surface { corners: [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y] },
            Surface {
                corners: [DVec3::Y, DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, 2.0, 0.1), DVec3::new(0.0, 2.0, 0.1)],
            },
        ];
        assert_eq!(merged(&bent).polygons.len(), 2);
    }
}

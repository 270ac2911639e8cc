use crate::scene::Surface;
use glam::DVec3;
use std::collections::HashMap;

/// Most corners of a merged polygon.
const MAX_CORNERS: usize = 8;
/// Corners lie in one plane, and on one line, if they are off it by less than this fraction of the polygon's size.
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
    /// The loop of each polygon, as indices of points; empty once it is part of another.
    loops: Vec<Vec<u32>>,
    /// The polygon on the left of each directed edge.
    left_of: HashMap<[u32; 2], usize>,
    /// What a polygon has become a part of; itself if it has not.
    part_of: Vec<usize>,
}

impl Union {
    fn new(surfaces: &[Surface]) -> Self {
        let mut index_of = HashMap::new();
        let mut points = Vec::new();
        let mut index = |p: DVec3| {
            // Adding zero makes −0 the same as 0.
            *index_of.entry((p + 0.0).to_array().map(f64::to_bits)).or_insert_with(|| {
                points.push(p);
                points.len() as u32 - 1
            })
        };
        let loops: Vec<Vec<u32>> =
            surfaces.iter().map(|face| face.corners().iter().map(|&corner| index(corner)).collect()).collect();
        let part_of = (0..loops.len()).collect();
        let mut union = Self { points, loops, left_of: HashMap::new(), part_of };
        for polygon in 0..union.loops.len() {
            union.enter(polygon);
        }
        union
    }

    fn edges(polygon: &[u32]) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..polygon.len()).map(|k| [polygon[k], polygon[(k + 1) % polygon.len()]])
    }

    fn enter(&mut self, polygon: usize) {
        for edge in Self::edges(&self.loops[polygon]) {
            self.left_of.insert(edge, polygon);
        }
    }

    fn leave(&mut self, polygon: usize) {
        for edge in Self::edges(&self.loops[polygon]) {
            // Where faces overlap, the edge may be another's by now.
            if self.left_of.get(&edge) == Some(&polygon) {
                self.left_of.remove(&edge);
            }
        }
    }

    /// Merges a polygon with the first of its neighbours that it can be merged with; false if there is none.
    fn grow(&mut self, polygon: usize) -> bool {
        let found = Self::edges(&self.loops[polygon]).find_map(|edge @ [u, v]| {
            let other = *self.left_of.get(&[v, u])?;
            let merged = (other != polygon).then(|| self.joined(polygon, other, edge)).flatten()?;
            Some((other, merged))
        });
        let Some((other, merged)) = found else { return false };
        self.leave(polygon);
        self.leave(other);
        self.loops[other].clear();
        self.loops[polygon] = merged;
        self.part_of[other] = polygon;
        self.enter(polygon);
        true
    }

    /// The union of two polygons across the edge u → v of the first; `None` if it is not convex and planar.
    fn joined(&self, a: usize, b: usize, [u, v]: [u32; 2]) -> Option<Vec<u32>> {
        let (a, b) = (&self.loops[a], &self.loops[b]);
        let from = |polygon: &[u32], start: u32| {
            let at = polygon.iter().position(|&p| p == start).unwrap_or(0);
            (0..polygon.len()).map(|k| polygon[(at + k) % polygon.len()]).collect::<Vec<u32>>()
        };
        // a from v round to u, then b from u round to v, both without the last.
        let (around_a, around_b) = (from(a, v), from(b, u));
        let mut merged = around_a[..a.len() - 1].to_vec();
        merged.extend(&around_b[..b.len() - 1]);
        let size = self.size(&merged);
        let normal = self.area_vector(&merged).normalize_or_zero();
        let flat = |p: &u32| normal.dot(self.points[*p as usize] - self.points[u as usize]).abs() <= FLAT * size;
        if normal == DVec3::ZERO || !merged.iter().all(flat) || self.area_vector(a).dot(self.area_vector(b)) <= 0.0 {
            return None;
        }
        for corner in [u, v] {
            let at = merged.iter().position(|&p| p == corner)?;
            let turn = self.turn(&merged, at, normal);
            if turn.abs() <= FLAT * size {
                merged.remove(at);
            } else if turn < 0.0 {
                return None;
            }
        }
        (3..=MAX_CORNERS).contains(&merged.len()).then_some(merged)
    }

    /// The distance of a corner from the line through its neighbours, negative where the loop is concave.
    fn turn(&self, polygon: &[u32], at: usize, normal: DVec3) -> f64 {
        let point = |k: usize| self.points[polygon[k % polygon.len()] as usize];
        let (before, here, after) = (point(at + polygon.len() - 1), point(at), point(at + 1));
        let base = after - before;
        (here - before).cross(base).dot(normal) / base.length().max(f64::MIN_POSITIVE)
    }

    fn size(&self, polygon: &[u32]) -> f64 {
        let first = self.points[polygon[0] as usize];
        polygon.iter().map(|&p| self.points[p as usize].distance(first)).fold(0.0, f64::max)
    }

    fn area_vector(&self, polygon: &[u32]) -> DVec3 {
        let first = self.points[polygon[0] as usize];
        let arm = |p: u32| self.points[p as usize] - first;
        polygon.windows(2).map(|edge| arm(edge[0]).cross(arm(edge[1]))).sum()
    }

    fn finish(self) -> Merged {
        let mut number = vec![u32::MAX; self.loops.len()];
        let mut polygons = Vec::new();
        for (k, polygon) in self.loops.iter().enumerate().filter(|(_, polygon)| !polygon.is_empty()) {
            number[k] = polygons.len() as u32;
            polygons.push(polygon.iter().map(|&p| self.points[p as usize]).collect());
        }
        let whole = |mut k: usize| {
            while self.part_of[k] != k {
                k = self.part_of[k];
            }
            number[k]
        };
        Merged { polygons, of_surface: (0..self.loops.len()).map(whole).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    fn area(polygon: &[DVec3]) -> f64 {
        0.5 * (1..polygon.len() - 1)
            .map(|k| (polygon[k] - polygon[0]).cross(polygon[k + 1] - polygon[0]))
            .sum::<DVec3>()
            .length()
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

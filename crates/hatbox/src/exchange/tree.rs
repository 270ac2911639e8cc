//! The panels in an order in which neighbours follow each other, and the clusters that this makes.
//!
//! Panels of one plane form trees of their own, since a plane neither sees itself nor hides itself from anything: walls,
//! floors and tables are settled against each other in a few steps. What is left (curved things) is divided by place.
//! A cluster's hull is convex: the polygon around coplanar panels, else a box.

use crate::assemble::{FLAT, Panel};
use crate::visibility::Body;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;

/// Panels of a leaf at the most: pairs of leaves are settled panel by panel.
pub(super) const LEAF: usize = 4;
/// Rows of a run at the most: as many are integrated side by side.
const RUN: usize = 32;
/// Fewer coplanar panels than this are no tree of their own.
const FEWEST: usize = 3;
/// Planes are the same if normals and distances agree to so many steps of their size.
const STEPS: f64 = 1e7;

/// Panels that follow each other in the order.
#[derive(Debug, Clone)]
pub(super) struct Cluster {
    /// Places in the order.
    pub(super) range: Range<usize>,
    /// Empty for a leaf.
    pub(super) children: Range<usize>,
    /// Contains all of the panels.
    pub(super) hull: Body,
    /// Point and normal of the panels' common plane.
    pub(super) plane: Option<(DVec3, DVec3)>,
    /// A height up to which all of the panels count as lying in a plane.
    pub(super) flat: f64,
    /// The panels' normals, if they are not those of the plane, and no more than a half-space of them.
    normals: Option<Cone>,
    /// Whether the panels are covered.
    pub(super) covered: bool,
}

/// Directions around an axis: those whose angle with it has at most this sine, if it is less than a right one.
#[derive(Debug, Clone, Copy)]
struct Cone {
    axis: DVec3,
    sine: f64,
}

impl Cone {
    /// Around all of some directions; `None` if no half-space holds them.
    fn around(directions: impl Iterator<Item = DVec3> + Clone) -> Option<Self> {
        let axis = directions.clone().sum::<DVec3>().try_normalize()?;
        let cosine = directions.map(|d| d.dot(axis)).fold(1.0, f64::min);
        (cosine > 0.0).then(|| Self { axis, sine: (1.0 - cosine * cosine).max(0.0).sqrt() })
    }
}

impl Cluster {
    pub(super) fn is_leaf(&self) -> bool {
        self.children.is_empty()
    }

    /// Whether none of the panels sees any of another's: by their planes or their normals, or because they are covered.
    pub(super) fn sees_nothing_of(&self, other: &Self) -> bool {
        self.covered || other.covered || self.faces_away(other)
    }

    fn faces_away(&self, other: &Self) -> bool {
        let flat = self.flat + other.flat;
        let behind = |plane: Option<(DVec3, DVec3)>, corners: &[DVec3]| {
            plane.is_some_and(|(origin, n)| corners.iter().all(|&corner| n.dot(corner - origin) <= flat))
        };
        behind(self.plane, other.hull.corners())
            || behind(other.plane, self.hull.corners())
            || self.turns_its_back_on(bounds(&other.hull))
            || other.turns_its_back_on(bounds(&self.hull))
    }

    /// Whether n·(y − x) ≤ 0 for all normals n and points x of the panels and all points y of a box. With s the sine of the cone
    /// around the axis a, a·d + s |d| ≤ 0 says that d = y − x is at least a right angle away from all of the cone. The left side is
    /// convex, and so greatest at a corner of the box around all d.
    pub(super) fn turns_its_back_on(&self, [other_lo, other_hi]: [DVec3; 2]) -> bool {
        let Some(Cone { axis, sine }) = self.normals else { return false };
        let [lo, hi] = bounds(&self.hull);
        let ends = [other_lo - hi, other_hi - lo];
        let corner = |k: usize| DVec3::new(ends[k & 1].x, ends[k >> 1 & 1].y, ends[k >> 2].z);
        (0..8).map(corner).all(|d| axis.dot(d) + sine * d.length() <= 0.0)
    }
}

/// The corners of the box around a body.
fn bounds(body: &Body) -> [DVec3; 2] {
    let corners = || body.corners().iter().copied();
    [corners().fold(DVec3::INFINITY, DVec3::min), corners().fold(DVec3::NEG_INFINITY, DVec3::max)]
}

/// The clusters of a scene.
#[derive(Debug, Clone)]
pub(super) struct Tree {
    /// The panel at each place.
    pub(super) order: Vec<u32>,
    pub(super) clusters: Vec<Cluster>,
    pub(super) roots: Vec<usize>,
}

impl Tree {
    pub(super) fn new(panels: &[Panel]) -> Self {
        let (mut order, mut parts, mut roots) = (Vec::with_capacity(panels.len()), Vec::new(), Vec::new());
        let (covered, seeing) = (0..panels.len() as u32).partition(|&k| panels[k as usize].covered);
        let groups = groups(panels, seeing).into_iter().chain([(covered, false)]);
        for (mut group, flat) in groups.filter(|(group, _)| !group.is_empty()) {
            let start = order.len();
            let first = &panels[group[0] as usize];
            let plane = flat.then(|| (first.patch.corners()[0], first.normal()));
            roots.push(parts.len());
            parts.push(Part { range: start..start + group.len(), children: 0..0, plane });
            divide(panels, &mut group, parts.len() - 1, &mut parts);
            order.extend(group);
        }
        let clusters = parts.into_par_iter().map(|part| cluster(panels, &order, part)).collect();
        Self { order, clusters, roots }
    }

    /// The largest clusters that are runs of rows: together all panels, in order.
    pub(super) fn runs(&self) -> Vec<usize> {
        let mut runs = Vec::new();
        let mut stack = self.roots.clone();
        while let Some(cluster) = stack.pop() {
            if self.clusters[cluster].range.len() <= RUN {
                runs.push(cluster);
            } else {
                stack.extend(self.clusters[cluster].children.clone());
            }
        }
        runs.sort_unstable_by_key(|&run| self.clusters[run].range.start);
        runs
    }
}

/// A cluster before its hull is known.
struct Part {
    range: Range<usize>,
    children: Range<usize>,
    /// See [`Cluster::plane`].
    plane: Option<(DVec3, DVec3)>,
}

/// Divides a part of the `members` until the leaves are small, and puts the members in the order of the leaves.
fn divide(panels: &[Panel], members: &mut [u32], at: usize, parts: &mut Vec<Part>) {
    if members.len() <= LEAF {
        return;
    }
    let (Range { start, end }, plane) = (parts[at].range.clone(), parts[at].plane);
    let middle = halve(panels, members);
    let (first, (left, right)) = (parts.len(), members.split_at_mut(middle));
    parts.push(Part { range: start..start + middle, children: 0..0, plane });
    parts.push(Part { range: start + middle..end, children: 0..0, plane });
    parts[at].children = first..first + 2;
    divide(panels, left, first, parts);
    divide(panels, right, first + 1, parts);
}

/// Groups of coplanar panels that look the same way, and the rest in one group; whether each is a plane's.
fn groups(panels: &[Panel], members: Vec<u32>) -> Vec<(Vec<u32>, bool)> {
    // Distances from the middle of the scene, so that it may lie anywhere.
    let lo = panels.iter().map(|panel| panel.center).fold(DVec3::INFINITY, DVec3::min);
    let hi = panels.iter().map(|panel| panel.center).fold(DVec3::NEG_INFINITY, DVec3::max);
    let (middle, size) = (lo.midpoint(hi), lo.distance(hi).max(f64::MIN_POSITIVE));
    let mut number = HashMap::new();
    let mut planes: Vec<Vec<u32>> = Vec::new();
    for index in members {
        let panel = &panels[index as usize];
        let n = panel.normal();
        let round = |x: f64| (x * STEPS).round() as i64;
        let key = [round(n.x), round(n.y), round(n.z), round(n.dot(panel.center - middle) / size)];
        let group = *number.entry(key).or_insert(planes.len());
        if group == planes.len() {
            planes.push(Vec::new());
        }
        planes[group].push(index);
    }
    let (flat, single): (Vec<_>, Vec<_>) =
        planes.into_iter().partition(|group| group.len() >= FEWEST && lies_in_one_plane(panels, group));
    let rest: Vec<u32> = single.into_iter().flatten().collect();
    let mut groups: Vec<_> = flat.into_iter().map(|group| (group, true)).collect();
    if !rest.is_empty() {
        groups.push((rest, false));
    }
    groups
}

/// Whether all corners lie in the plane of the first panel, as far as any of the panels is concerned.
fn lies_in_one_plane(panels: &[Panel], group: &[u32]) -> bool {
    let members = || group.iter().map(|&k| &panels[k as usize]);
    let shortest = members().map(Panel::longest_edge).fold(f64::INFINITY, f64::min);
    let first = &panels[group[0] as usize];
    let height = |corner: &DVec3| first.normal().dot(*corner - first.patch.corners()[0]).abs();
    members().flat_map(|panel| panel.patch.corners()).all(|corner| height(corner) <= FLAT * shortest)
}

/// Sorts the members along the longest side of the box around their centres and returns where to divide them: at a
/// multiple of the size of runs or leaves, so that these are full.
fn halve(panels: &[Panel], members: &mut [u32]) -> usize {
    let center = |&k: &u32| panels[k as usize].center;
    let lo = members.iter().map(center).fold(DVec3::INFINITY, DVec3::min);
    let hi = members.iter().map(center).fold(DVec3::NEG_INFINITY, DVec3::max);
    let axis = (0..3).max_by(|&a, &b| (hi - lo)[a].total_cmp(&(hi - lo)[b])).unwrap_or(0);
    let step = if members.len() > RUN { RUN } else { LEAF };
    let middle = (members.len() / 2).div_ceil(step) * step;
    let key = |k: &u32| (center(k)[axis], *k);
    members.select_nth_unstable_by(middle, |a, b| {
        let (a, b) = (key(a), key(b));
        a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
    });
    middle
}

fn cluster(panels: &[Panel], order: &[u32], part: Part) -> Cluster {
    let Part { range, children, plane } = part;
    let members = &order[range.clone()];
    let corners = || members.iter().flat_map(|&k| panels[k as usize].patch.corners().iter().copied());
    let hull = match plane {
        Some((origin, normal)) => polygon_around(origin, normal, corners()),
        None => {
            Body::cuboid(corners().fold(DVec3::INFINITY, DVec3::min), corners().fold(DVec3::NEG_INFINITY, DVec3::max))
        }
    };
    let shortest = members.iter().map(|&k| panels[k as usize].longest_edge()).fold(f64::INFINITY, f64::min);
    let normals =
        if plane.is_some() { None } else { Cone::around(members.iter().map(|&k| panels[k as usize].normal())) };
    let covered = members.iter().all(|&k| panels[k as usize].covered);
    Cluster { range, children, hull, plane, flat: FLAT * shortest, normals, covered }
}

/// The convex hull of points of a plane, or a rectangle around it if it has more than eight corners.
fn polygon_around(origin: DVec3, normal: DVec3, points: impl Iterator<Item = DVec3>) -> Body {
    let e1 = normal.any_orthonormal_vector();
    let e2 = normal.cross(e1);
    let flat: Vec<DVec2> = points.map(|p| DVec2::new((p - origin).dot(e1), (p - origin).dot(e2))).collect();
    let mut hull = convex_hull(flat.clone());
    if hull.len() > 8 {
        let lo = flat.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let hi = flat.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        hull = vec![lo, DVec2::new(hi.x, lo.y), hi, DVec2::new(lo.x, hi.y)];
    }
    let corners: Vec<DVec3> = hull.iter().map(|p| origin + e1 * p.x + e2 * p.y).collect();
    Body::polygon(&corners)
}

/// The corners of the convex hull, counter-clockwise (A. M. Andrew's monotone chain, 1979); corners that are nearly
/// straight are left out on the outside only, so the hull may lose what rounding is.
fn convex_hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let size = points[0].distance(points[points.len() - 1]).max(f64::MIN_POSITIVE);
    let turns_left = |a: DVec2, b: DVec2, c: DVec2| (b - a).perp_dot(c - b) > 1e-12 * size * size;
    let mut hull: Vec<DVec2> = Vec::new();
    let mut chain = |points: &mut dyn Iterator<Item = DVec2>| {
        let start = hull.len();
        for p in points {
            while hull.len() >= start + 2 && !turns_left(hull[hull.len() - 2], hull[hull.len() - 1], p) {
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
    };
    chain(&mut points.iter().copied());
    chain(&mut points.iter().rev().copied());
    hull
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::Facing;
    use crate::element::{ALL, Shape};
    use crate::mesh::Patch;

    /// Unit squares of an n × n floor, and a tilted square above each of them.
    fn panels(n: usize) -> Vec<Panel> {
        let quad = |origin: DVec3, lift: f64| {
            let corners = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, lift), DVec3::new(0.0, 1.0, lift)];
            Patch::new(Shape::Quad, corners.map(|c| origin + c))
        };
        let mut patches = Vec::new();
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i as f64, j as f64))) {
            patches.push(quad(DVec3::new(i, j, 0.0), 0.0));
            patches.push(quad(DVec3::new(i, j, 3.0), 0.01 * (i * n as f64 + j)));
        }
        patches
            .into_iter()
            .map(|patch| Panel::new(patch, ALL[0].element(Shape::Quad).expect("constants"), [0; 4], 0))
            .collect()
    }

    #[test]
    fn every_panel_has_one_place_and_lies_in_its_clusters() {
        let panels = panels(13);
        let tree = Tree::new(&panels);
        let mut seen = tree.order.clone();
        seen.sort_unstable();
        assert!(seen.iter().enumerate().all(|(k, &p)| k == p as usize));
        let mut end = 0;
        for run in tree.runs() {
            let range = tree.clusters[run].range.clone();
            assert!(range.start == end && range.len() <= RUN);
            end = range.end;
        }
        assert_eq!(end, panels.len());
        assert!(tree.clusters.iter().all(|cluster| !cluster.is_leaf() || cluster.range.len() <= LEAF));
        for cluster in &tree.clusters {
            let (lo, hi) = cluster
                .hull
                .corners()
                .iter()
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &c| (lo.min(c), hi.max(c)));
            for &k in &tree.order[cluster.range.clone()] {
                let panel = &panels[k as usize];
                for &corner in panel.patch.corners() {
                    assert!(corner.cmpge(lo - 1e-9).all() && corner.cmple(hi + 1e-9).all());
                }
                if let Some((_, normal)) = cluster.plane {
                    assert!(normal.dot(panel.normal()) > 1.0 - 1e-6);
                }
            }
        }
    }

    #[test]
    fn a_plane_faces_away_from_itself_only() {
        let panels = panels(13);
        let tree = Tree::new(&panels);
        let [floor, above] = [tree.roots[0], tree.roots[tree.roots.len() - 1]].map(|root| &tree.clusters[root]);
        assert!(floor.plane.is_some() && above.plane.is_none());
        assert!(floor.faces_away(floor) && !floor.faces_away(above));
    }

    /// Triangles all over a sphere; those of every other octant look inwards.
    fn ball() -> Vec<Panel> {
        let at = |i: usize, j: usize| {
            let (z, angle) = (1.0 - i as f64 / 12.0, j as f64 * std::f64::consts::TAU / 24.0);
            let (sin, cos) = angle.sin_cos();
            DVec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
        };
        let halves = |(i, j): (usize, usize)| {
            [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
        };
        let triangles = (0..24).flat_map(|i| (0..24).map(move |j| (i, j))).flat_map(halves);
        let large = triangles.filter(|[a, b, c]| (b - a).cross(c - a).length() > 1e-6);
        let panel = |[a, b, c]: [DVec3; 3]| {
            let inwards = (a + b + c).to_array().into_iter().filter(|x| *x > 0.0).count() % 2 == 0;
            let corners = if inwards { [a, c, b, b] } else { [a, b, c, c] };
            let element = ALL[0].element(Shape::Triangle).expect("constants");
            Panel::new(Patch::new(Shape::Triangle, corners), element, [0, 1, 2, 2], 0)
        };
        large.map(panel).collect()
    }

    #[test]
    fn clusters_that_turn_their_backs_have_no_panels_that_see_each_other() {
        let panels = ball();
        let tree = Tree::new(&panels);
        let members = |cluster: &Cluster| tree.order[cluster.range.clone()].iter().map(|&k| &panels[k as usize]);
        let mut away = 0;
        for (one, other) in tree.clusters.iter().flat_map(|one| tree.clusters.iter().map(move |other| (one, other))) {
            if one.sees_nothing_of(other) {
                away += one.range.len() * other.range.len();
                let sees = |a: &Panel| members(other).any(|b| Facing::new(&a.patch, &b.patch).is_some());
                assert!(!members(one).any(sees), "{:?} {:?}", one.range, other.range);
            }
        }
        assert!(away > panels.len() * panels.len(), "over all levels: {away}");
    }

    #[test]
    fn the_hull_of_a_disc_is_a_rectangle_and_of_a_grid_its_four_corners() {
        let disc = (0..40).map(|k| DVec2::from_angle(f64::from(k) * 0.157)).map(|p| DVec3::new(p.x, p.y, 0.0));
        assert_eq!(polygon_around(DVec3::ZERO, DVec3::Z, disc).corners().len(), 4);
        let grid: Vec<DVec2> = (0..49).map(|k| DVec2::new(f64::from(k % 7), f64::from(k / 7))).collect();
        assert_eq!(convex_hull(grid).len(), 4);
    }
}

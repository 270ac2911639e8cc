//! All panels of a scene as a point sees them.
//!
//! What may stand between a point and a cluster of panels is found once, and its parts inherit the proof that nothing does,
//! or the list to be narrowed down, as rows of the dense operator do. With a shaft for each panel, visibility was most of what an
//! estimate of the error took.

use super::views::{Between, PointRow, Viewpoint, Views};
use crate::assemble::Panel;
use crate::exchange::tree::{Cluster, Tree};
use crate::visibility::Body;

/// Panels in clusters.
#[derive(Debug, Clone)]
pub struct Panorama {
    tree: Tree,
}

/// A point looking around.
struct Look<'a, W, F> {
    panorama: &'a Panorama,
    panels: &'a [Panel],
    views: &'a Views<'a>,
    from: &'a Viewpoint,
    body: Body,
    wanted: W,
    give: F,
}

impl Panorama {
    /// Of some panels.
    pub fn new(panels: &[Panel]) -> Self {
        Self { tree: Tree::new(panels) }
    }

    /// Calls `give` with the index of each of the `wanted` panels that a point may see and with what it receives from the
    /// panel's functions, always in the same order. `panels` are those that it was made of.
    pub fn seen_from(
        &self,
        from: &Viewpoint,
        panels: &[Panel],
        views: &Views<'_>,
        wanted: impl Fn(usize) -> bool,
        give: impl FnMut(usize, PointRow),
    ) {
        let body = Body::polygon(&[from.at]);
        let mut look = Look { panorama: self, panels, views, from, body, wanted, give };
        for &root in &self.tree.roots {
            look.at(root, Between::Many);
        }
    }
}

impl<W: Fn(usize) -> bool, F: FnMut(usize, PointRow)> Look<'_, W, F> {
    fn at(&mut self, cluster: usize, inherited: Between<'_>) {
        let cluster = &self.panorama.tree.clusters[cluster];
        let members = || self.panorama.tree.order[cluster.range.clone()].iter().map(|&panel| panel as usize);
        if cluster.covered
            || self.is_turned_away(cluster)
            || (cluster.is_leaf() && !members().any(|panel| (self.wanted)(panel)))
        {
            return;
        }
        let (mut list, skip) = (Vec::new(), [self.views.of_surface(self.from.surface), u32::MAX]);
        let ends = [&self.body, &cluster.hull];
        let Some(between) = self.views.between(ends, skip, inherited, &mut list) else { return };
        for child in cluster.children.clone() {
            self.at(child, between);
        }
        if cluster.is_leaf() {
            let mut list = Vec::new();
            let members = self.panorama.tree.order[cluster.range.clone()].iter().map(|&panel| panel as usize);
            for panel in members.filter(|&panel| (self.wanted)(panel)) {
                if let Some(row) = self.views.point_row(&self.panels[panel], self.from, between, &mut list) {
                    (self.give)(panel, row);
                }
            }
        }
    }

    /// Whether the panels face away, or lie below the point's horizon.
    fn is_turned_away(&self, cluster: &Cluster) -> bool {
        let &Viewpoint { at, normal, .. } = self.from;
        cluster.plane.is_some_and(|(origin, n)| n.dot(at - origin) <= 0.0)
            || cluster.turns_its_back_on([at; 2])
            || cluster.hull.corners().iter().all(|&corner| normal.dot(corner - at) <= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::{ALL, MAX_DOFS, Shape};
    use crate::mesh::Patch;
    use crate::quadrature::sequence::{hash, unit};
    use crate::scene::Surface;
    use crate::visibility::{Bvh, Occluders};
    use glam::DVec3;

    fn random(k: u64) -> DVec3 {
        DVec3::from_array([0, 1, 2].map(|axis| unit(hash(k, axis))))
    }

    /// A floor and a wall of small triangles, and some large ones that stand and lie between them anyhow.
    fn triangles() -> Vec<[DVec3; 3]> {
        let place = |u: u32, v: u32| [f64::from(u) / 6.0, f64::from(v) / 6.0];
        let halves = |[a, b, c, d]: [DVec3; 4]| [[a, b, c], [a, c, d]];
        let cells = (0..36).map(|k| [place(k % 6, k / 6), place(k % 6 + 1, k / 6 + 1)]);
        let floor = cells.clone().flat_map(|[[x, y], [z, w]]| {
            halves([DVec3::new(x, y, 0.0), DVec3::new(z, y, 0.0), DVec3::new(z, w, 0.0), DVec3::new(x, w, 0.0)])
        });
        let wall = cells.flat_map(|[[x, y], [z, w]]| {
            halves([DVec3::new(0.0, x, y), DVec3::new(0.0, z, y), DVec3::new(0.0, z, w), DVec3::new(0.0, x, w)])
        });
        let between = (0..9).map(|k| {
            let center = 0.2 + 0.6 * random(10 * k);
            [1, 2, 3].map(|corner| center + 0.4 * (random(10 * k + corner) - 0.5))
        });
        floor.chain(wall).chain(between).collect()
    }

    /// Clusters save shafts and change nothing.
    #[test]
    fn a_point_sees_of_all_panels_what_it_sees_of_each_on_its_own() {
        let element = ALL[1].element(Shape::Triangle).expect("an element");
        let triangles = triangles();
        let surfaces: Vec<Surface> = triangles.iter().map(|&[a, b, c]| Surface { corners: [a, b, c, c] }).collect();
        let panel = |(surface, &[a, b, c]): (usize, &[DVec3; 3])| {
            Panel::new(Patch::new(Shape::Triangle, [a, b, c, c]), element, [0, 1, 2, 2], surface as u32)
        };
        let panels: Vec<Panel> = triangles.iter().enumerate().map(panel).collect();
        let (occluders, blockers) = (Occluders::new(&surfaces), Bvh::of_surfaces(&surfaces));
        let (views, panorama) = (Views { occluders: &occluders, blockers: &blockers }, Panorama::new(&panels));
        let (mut hidden, mut behind) = (0, 0);
        for (surface, panel) in panels.iter().enumerate() {
            let at = panel.patch.point([0.3, 0.25]);
            let from = Viewpoint { at, normal: panel.normal(), surface: surface as u32 };
            let wanted = |k: usize| k != surface;
            let mut found: Vec<Option<PointRow>> = vec![None; panels.len()];
            panorama.seen_from(&from, &panels, &views, wanted, |k, row| {
                assert!(found[k].replace(row).is_none(), "{k} is given once");
            });
            for (k, found) in found.into_iter().enumerate().filter(|&(k, _)| wanted(k)) {
                let alone = views.point_row(&panels[k], &from, Between::Many, &mut Vec::new());
                let row = |row: Option<PointRow>| match row {
                    None => [0.0; MAX_DOFS],
                    Some(PointRow::Exact(row)) => row,
                    Some(PointRow::Unoccluded(_)) => panic!("few polygons are cut out"),
                };
                let unhidden = crate::assemble::point_row(&panels[k], at, from.normal);
                hidden += usize::from(unhidden.is_some() && row(found).iter().sum::<f64>() == 0.0);
                behind += usize::from(unhidden.is_some_and(|all| all[0] > 1.01 * row(found)[0] && row(found)[0] > 0.0));
                for (a, b) in row(found).into_iter().zip(row(alone)) {
                    assert!((a - b).abs() < 1e-12, "{k} from {surface}: {a} {b}");
                }
            }
        }
        assert!(hidden > 50 && behind > 1000, "{hidden} {behind}");
    }
}

//! The cells as the rays need them, and where on them a point of a face of the input lies.

use crate::element::{Element, Shape};
use crate::mesh::{Mesh, Patch};
use crate::scene::{Scene, Surface};
use crate::space::FunctionSpace;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::sync::Arc;

/// Corners, surfaces and elements of the cells.
#[derive(Debug)]
pub(in crate::exchange) struct Cells {
    mesh: Arc<Mesh>,
    space: FunctionSpace,
    areas: Vec<f64>,
    alike: Option<usize>,
}

impl Cells {
    pub(in crate::exchange) fn new(mesh: &Arc<Mesh>, space: &FunctionSpace) -> Self {
        let areas = (0..mesh.cells.len()).map(|cell| mesh.patch(cell).area()).collect();
        let mut functions = (0..space.cells()).map(|cell| space.range(cell).len());
        let alike = functions.next().filter(|&first| functions.all(|count| count == first));
        Self { mesh: Arc::clone(mesh), space: space.clone(), areas, alike }
    }

    pub(in crate::exchange) fn len(&self) -> usize {
        self.mesh.cells.len()
    }

    pub(in crate::exchange) fn unknowns(&self) -> usize {
        self.space.broken_dofs()
    }

    pub(in crate::exchange) fn patch(&self, cell: usize) -> Patch {
        self.mesh.patch(cell)
    }

    pub(in crate::exchange) fn area(&self, cell: usize) -> f64 {
        self.areas[cell]
    }

    /// The patch of a cell whose map to the reference cell stretches it unevenly.
    pub(in crate::exchange) fn stretched(&self, cell: usize) -> Option<Patch> {
        let quad = self.element(cell).shape == Shape::Quad;
        quad.then(|| self.patch(cell)).filter(|patch| !patch.is_affine())
    }

    pub(in crate::exchange) fn surface(&self, cell: usize) -> u32 {
        self.mesh.cells[cell].surface
    }

    pub(in crate::exchange) fn element(&self, cell: usize) -> &'static Element {
        self.space.element(cell)
    }

    /// The coefficients of a cell.
    pub(in crate::exchange) fn range(&self, cell: usize) -> std::ops::Range<usize> {
        self.space.range(cell)
    }

    /// The functions of a cell, if all cells have as many.
    pub(super) fn alike(&self) -> Option<usize> {
        self.alike
    }

    /// The reference coordinates of a point of a cell's plane.
    fn locate(&self, cell: usize, point: DVec3) -> [f64; 2] {
        if self.element(cell).shape != Shape::Triangle {
            return self.patch(cell).locate(point);
        }
        // What a patch does, without the root for its normal.
        let [a, b, c, _] = self.mesh.cells[cell].vertices.map(|vertex| self.mesh.vertices[vertex as usize]);
        let (u, v, r) = (b - a, c - a, point - a);
        let normal = u.cross(v);
        let square = normal.length_squared();
        if square > 0.0 { [r.cross(v).dot(normal) / square, u.cross(r).dot(normal) / square] } else { [0.0; 2] }
    }

    /// The place of each cell in an order along a curve that fills space: cells that follow each other are neighbours.
    pub(in crate::exchange) fn order(&self) -> Vec<u32> {
        let (lo, hi) = self.mesh.bounds();
        let scale = f64::from(1 << 20) / (hi - lo).max_element().max(f64::MIN_POSITIVE);
        let key = |cell: u32| {
            let patch = self.patch(cell as usize);
            let n = patch.normal();
            let axis = (0..3).max_by(|&a, &b| n[a].abs().total_cmp(&n[b].abs())).unwrap_or(0);
            let side = 2 * axis as u64 + u64::from(n[axis] > 0.0);
            let at = (patch.center() - lo) * scale;
            side << 60 | spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
        };
        let mut order: Vec<(u64, u32)> = (0..self.len() as u32).into_par_iter().map(|cell| (key(cell), cell)).collect();
        order.par_sort_unstable();
        let mut place = vec![0; self.len()];
        for (k, &(_, cell)) in order.iter().enumerate() {
            place[cell as usize] = k as u32;
        }
        place
    }

    /// Beside the mesh, which is the scene's.
    pub(in crate::exchange) fn bytes(&self) -> usize {
        size_of_val(&*self.areas)
    }
}

/// The lower 20 bits, each followed by two zeros.
fn spread(x: f64) -> u64 {
    let mut x = (x.max(0.0) as u64).min((1 << 20) - 1);
    for (shift, mask) in [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        x = (x | x << shift) & mask;
    }
    x
}

/// Up to so many cells of a side are searched one by one.
const FEW: usize = 3;

/// Finds the cell of a face's side at a point: a grid over every face that has more than a few cells.
#[derive(Debug)]
pub(super) struct Locator {
    /// First entry in `cells` of each side: 2 · surface for the front, + 1 for the back.
    first: Vec<u32>,
    cells: Vec<u32>,
    /// For each side, its grid, or `u32::MAX`.
    grid_of: Vec<u32>,
    grids: Vec<Grid>,
}

#[derive(Debug)]
struct Grid {
    origin: DVec3,
    /// In-plane directions, divided by the width of a bin.
    axes: [DVec3; 2],
    size: [u32; 2],
    first: Vec<u32>,
    /// Which of the cells of the side reach into each bin.
    places: Vec<u32>,
    /// How each cell of the side lies on it, if all have one shape and lie there unstretched.
    maps: Option<(Shape, Vec<Map>)>,
}

/// The affine map from a grid's coordinates to a cell's reference coordinates: all that is asked of a cell that may have been
/// hit, in half of a line of the cache.
#[derive(Debug)]
struct Map {
    origin: [f64; 2],
    rows: [[f32; 2]; 2],
}

impl Map {
    /// That of a cell without area is of no use, and asked of nothing: it reaches into no bin.
    fn new(grid: &Grid, patch: &Patch) -> Self {
        let last = if patch.shape() == Shape::Quad { 3 } else { 2 };
        let [a, b, c] = [0, 1, last].map(|k| grid.coordinates(patch.corners()[k]));
        let [[ux, uy], [vx, vy]] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1]]);
        let det = ux * vy - uy * vx;
        let rows = [[vy, -vx], [-uy, ux]].map(|row| row.map(|entry| (entry / det) as f32));
        Self { origin: a, rows }
    }

    /// The reference coordinates of a point, to seven digits times the aspect ratio of the cell.
    fn of(&self, at: [f64; 2]) -> [f64; 2] {
        let [x, y] = [at[0] - self.origin[0], at[1] - self.origin[1]];
        self.rows.map(|[a, b]| f64::from(a) * x + f64::from(b) * y)
    }
}

impl Locator {
    pub(super) fn new(scene: &Scene, cells: &Cells) -> Self {
        let normals: Vec<DVec3> = scene.surfaces.iter().map(surface_normal).collect();
        let side = |cell: usize| {
            let surface = cells.surface(cell) as usize;
            2 * surface + usize::from(normals[surface].dot(cells.patch(cell).normal()) < 0.0)
        };
        let (first, list) = sorted(2 * scene.surfaces.len(), (0..cells.len()).map(|cell| (side(cell), cell as u32)));
        let mut locator = Self { grid_of: vec![u32::MAX; first.len() - 1], first, cells: list, grids: Vec::new() };
        for side in 0..locator.grid_of.len() {
            let on = locator.on(side);
            if on.len() > FEW {
                let grid = Grid::new(&scene.surfaces[side / 2], normals[side / 2], on, cells);
                locator.grid_of[side] = locator.grids.len() as u32;
                locator.grids.push(grid);
            }
        }
        locator
    }

    fn on(&self, side: usize) -> &[u32] {
        &self.cells[self.first[side] as usize..self.first[side + 1] as usize]
    }

    /// Whether a side of a face has cells.
    pub(super) fn has_cells(&self, surface: u32, front: bool) -> bool {
        !self.on(2 * surface as usize + usize::from(!front)).is_empty()
    }

    /// The cell at a point of a side of a face, its shape, and the reference coordinates of the point; `None` if that side has no
    /// cells. A point between cells to rounding belongs to the nearest.
    pub(super) fn find(
        &self,
        cells: &Cells,
        surface: u32,
        front: bool,
        point: DVec3,
    ) -> Option<(u32, Shape, [f64; 2])> {
        let side = 2 * surface as usize + usize::from(!front);
        let on = self.on(side);
        let by_corners = |place: u32| {
            let cell = on[place as usize] as usize;
            (cells.element(cell).shape, cells.locate(cell, point))
        };
        let found = match self.grids.get(self.grid_of[side] as usize) {
            None => deepest(0..on.len() as u32, by_corners),
            Some(grid) => {
                let at = grid.coordinates(point);
                let places = grid.at(at).iter().copied();
                match &grid.maps {
                    Some((shape, maps)) => deepest(places, |place| (*shape, maps[place as usize].of(at))),
                    None => deepest(places, by_corners),
                }
            }
        };
        found.map(|(place, shape, at)| (on[place as usize], shape, at))
    }

    pub(super) fn bytes(&self) -> usize {
        let maps = |grid: &Grid| grid.maps.as_ref().map_or(0, |(_, maps)| size_of_val(&**maps));
        let grid = |grid: &Grid| size_of::<Grid>() + 4 * (grid.first.len() + grid.places.len()) + maps(grid);
        4 * (self.first.len() + self.cells.len() + self.grid_of.len()) + self.grids.iter().map(grid).sum::<usize>()
    }
}

impl Grid {
    /// About one bin per cell.
    fn new(surface: &Surface, normal: DVec3, on: &[u32], cells: &Cells) -> Self {
        let corners = surface.corners();
        let e1 = (corners[1] - corners[0]).normalize_or_zero();
        let e2 = normal.cross(e1);
        let flat = |p: DVec3| DVec2::new((p - corners[0]).dot(e1), (p - corners[0]).dot(e2));
        let bounds = |points: &mut dyn Iterator<Item = DVec2>| {
            points.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)))
        };
        let (low, high) = bounds(&mut corners.iter().map(|&p| flat(p)));
        let extent = (high - low).max(DVec2::splat(1e-300));
        let bin = (extent.x * extent.y / on.len() as f64).sqrt();
        let size = [extent.x, extent.y].map(|length| ((length / bin).ceil() as u32).clamp(1, 1 << 14));
        let scale = [f64::from(size[0]) / extent.x, f64::from(size[1]) / extent.y];
        let origin = corners[0] + e1 * low.x + e2 * low.y;
        let axes = [e1 * scale[0], e2 * scale[1]];
        let mut grid = Self { origin, axes, size, first: Vec::new(), places: Vec::new(), maps: None };
        let shape = cells.element(on[0] as usize).shape;
        let mut maps = Vec::with_capacity(on.len());
        let mut entries = Vec::with_capacity(4 * on.len());
        for (place, &cell) in on.iter().enumerate() {
            let patch = cells.patch(cell as usize);
            if patch.shape() == shape && patch.is_affine() {
                maps.push(Map::new(&grid, &patch));
            }
            if patch.area() == 0.0 {
                continue;
            }
            let bins = patch.corners().iter().map(|&p| grid.coordinates(p));
            // Rounding may put a point into the next bin.
            let (low, high) = bins.fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(lo, hi), [x, y]| {
                ([lo[0].min(x), lo[1].min(y)], [hi[0].max(x), hi[1].max(y)])
            });
            let [x0, y0] = grid.bin([low[0] - 1e-6, low[1] - 1e-6]);
            let [x1, y1] = grid.bin([high[0] + 1e-6, high[1] + 1e-6]);
            for y in y0..=y1 {
                entries.extend((x0..=x1).map(|x| ((y * size[0] + x) as usize, place as u32)));
            }
        }
        (grid.first, grid.places) = sorted((size[0] * size[1]) as usize, entries.iter().copied());
        grid.maps = (maps.len() == on.len()).then_some((shape, maps));
        grid
    }

    fn coordinates(&self, point: DVec3) -> [f64; 2] {
        self.axes.map(|axis| axis.dot(point - self.origin))
    }

    fn bin(&self, at: [f64; 2]) -> [u32; 2] {
        std::array::from_fn(|k| (at[k].max(0.0) as u32).min(self.size[k] - 1))
    }

    /// What reaches into the bin of these coordinates.
    fn at(&self, at: [f64; 2]) -> &[u32] {
        let [x, y] = self.bin(at);
        let bin = (y * self.size[0] + x) as usize;
        &self.places[self.first[bin] as usize..self.first[bin + 1] as usize]
    }
}

/// The normal of a face's front, the side it is counter-clockwise from.
fn surface_normal(surface: &Surface) -> DVec3 {
    surface.patch(DVec3::ZERO).normal()
}

/// The first of some places whose cell a point lies in, or the one that it lies nearest to, with its shape and the reference coordinates there.
#[inline]
fn deepest(
    places: impl Iterator<Item = u32>,
    locate: impl Fn(u32) -> (Shape, [f64; 2]),
) -> Option<(u32, Shape, [f64; 2])> {
    let mut best: Option<(f64, u32, Shape, [f64; 2])> = None;
    for place in places {
        let (shape, at) = locate(place);
        let inside = depth(shape, at);
        if best.is_none_or(|(most, ..)| inside > most) {
            best = Some((inside, place, shape, at));
            if inside >= 0.0 {
                break;
            }
        }
    }
    best.map(|(_, place, shape, at)| (place, shape, at))
}

/// How far inside the reference cell a point is; negative outside.
fn depth(shape: Shape, [x, y]: [f64; 2]) -> f64 {
    match shape {
        Shape::Triangle => x.min(y).min(1.0 - x - y),
        Shape::Quad => x.min(y).min(1.0 - x).min(1.0 - y),
    }
}

/// Entries by key, in their order: where each key's begin, and the entries.
fn sorted(keys: usize, entries: impl Iterator<Item = (usize, u32)> + Clone) -> (Vec<u32>, Vec<u32>) {
    let mut first = vec![0_u32; keys + 1];
    for (key, _) in entries.clone() {
        first[key + 1] += 1;
    }
    for key in 0..keys {
        first[key + 1] += first[key];
    }
    let mut next = first.clone();
    let mut list = vec![0; first[keys] as usize];
    for (key, entry) in entries {
        list[next[key] as usize] = entry;
        next[key] += 1;
    }
    (first, list)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::ALL;
    use crate::mesh::{Cell, Refinement};
    use crate::scene::{Material, Physics};

    /// A face in space: a slender rectangle, a parallelogram, a needle, and a trapezium, which has no affine map.
    const FACES: [&[[f64; 2]]; 4] = [
        &[[0.0, 0.0], [30.0, 0.0], [30.0, 0.2], [0.0, 0.2]],
        &[[0.0, 0.0], [2.0, 0.5], [3.0, 1.5], [1.0, 1.0]],
        &[[0.0, 0.0], [10.0, 0.01], [5.0, 0.02]],
        &[[0.0, 0.0], [2.0, 0.0], [1.5, 1.0], [0.2, 1.0]],
    ];

    #[test]
    fn a_map_finds_the_cell_and_the_place_that_its_corners_do() {
        let (e1, e2) = (DVec3::new(0.6, 0.8, 0.0), DVec3::new(-0.48, 0.36, 0.8));
        for (corners, basis) in FACES.iter().flat_map(|face| [(face, &ALL[0]), (face, &ALL[1])]) {
            let at = |[x, y]: [f64; 2]| DVec3::new(100.0, -7.0, 3.0) + e1 * x + e2 * y;
            let last = corners.len() - 1;
            let shape = if last == 3 { Shape::Quad } else { Shape::Triangle };
            let cell = Cell { shape, vertices: [0, 1, 2, last as u32], material: 0, group: 0, surface: 0 };
            let (vertices, groups) = (corners.iter().map(|&p| at(p)).collect(), vec![String::new()]);
            let mesh = Mesh { vertices, cells: vec![cell], groups, ..Mesh::default() };
            let scene = Scene::new(mesh, vec![Material::diffuse("face", 0.5)], Physics::Light, None).expect("valid");
            let scene = scene.refined(Refinement::Elements(300), basis).expect("refined");
            let space = FunctionSpace::broken(&scene.mesh, basis).expect("elements");
            let cells = Cells::new(&scene.mesh, &space);
            let locator = Locator::new(&scene, &cells);
            let affine = (0..cells.len()).all(|cell| cells.patch(cell).is_affine());
            assert!(locator.grids.iter().all(|grid| grid.maps.is_some() == affine), "{corners:?}");
            for cell in 0..cells.len() {
                let middle = cells.patch(cell).center();
                let (found, shape, at) = locator.find(&cells, 0, true, middle).expect("a cell");
                assert_eq!((found as usize, shape), (cell, cells.element(cell).shape), "{corners:?}");
                let exact = cells.locate(cell, middle);
                assert!((0..2).all(|k| (at[k] - exact[k]).abs() < 1e-3), "{corners:?} {at:?} {exact:?}");
            }
        }
    }
}

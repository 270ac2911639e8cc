//! The cells as the rays need them, 68 bytes each, and where on them a point of a face of the input lies.

use crate::element::{Element, Shape};
use crate::mesh::{Mesh, Patch};
use crate::scene::{Scene, Surface};
use crate::space::FunctionSpace;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Corners, surfaces and elements of the cells.
#[derive(Debug)]
pub(in crate::exchange) struct Cells {
    vertices: Vec<DVec3>,
    corners: Vec<[u32; 4]>,
    surfaces: Vec<u32>,
    elements: Vec<&'static Element>,
    areas: Vec<f64>,
    /// First coefficient of each cell, and their number.
    offsets: Vec<u32>,
}

impl Cells {
    pub(in crate::exchange) fn new(mesh: &Mesh, space: &FunctionSpace) -> Self {
        Self {
            vertices: mesh.vertices.clone(),
            corners: mesh.cells.iter().map(|cell| cell.vertices).collect(),
            surfaces: mesh.cells.iter().map(|cell| cell.surface).collect(),
            elements: (0..space.cells()).map(|cell| space.element(cell)).collect(),
            areas: (0..mesh.cells.len()).map(|cell| mesh.patch(cell).area()).collect(),
            offsets: space.offsets().iter().map(|&offset| offset as u32).collect(),
        }
    }

    pub(in crate::exchange) fn len(&self) -> usize {
        self.corners.len()
    }

    pub(in crate::exchange) fn unknowns(&self) -> usize {
        self.offsets[self.len()] as usize
    }

    pub(in crate::exchange) fn patch(&self, cell: usize) -> Patch {
        Patch::new(self.elements[cell].shape, self.corners[cell].map(|vertex| self.vertices[vertex as usize]))
    }

    pub(in crate::exchange) fn area(&self, cell: usize) -> f64 {
        self.areas[cell]
    }

    /// The patch of a cell whose map to the reference cell stretches it unevenly.
    pub(in crate::exchange) fn stretched(&self, cell: usize) -> Option<Patch> {
        let quad = self.elements[cell].shape == Shape::Quad;
        quad.then(|| self.patch(cell)).filter(|patch| !patch.is_affine())
    }

    pub(in crate::exchange) fn surface(&self, cell: usize) -> u32 {
        self.surfaces[cell]
    }

    pub(in crate::exchange) fn element(&self, cell: usize) -> &'static Element {
        self.elements[cell]
    }

    /// The coefficients of a cell.
    pub(in crate::exchange) fn range(&self, cell: usize) -> std::ops::Range<usize> {
        self.offsets[cell] as usize..self.offsets[cell + 1] as usize
    }

    /// The reference coordinates of a point of a cell's plane.
    fn locate(&self, cell: usize, point: DVec3) -> [f64; 2] {
        if self.elements[cell].shape != Shape::Triangle {
            return self.patch(cell).locate(point);
        }
        // What a patch does, without the root for its normal.
        let [a, b, c, _] = self.corners[cell].map(|vertex| self.vertices[vertex as usize]);
        let (u, v, r) = (b - a, c - a, point - a);
        let normal = u.cross(v);
        let square = normal.length_squared();
        if square > 0.0 { [r.cross(v).dot(normal) / square, u.cross(r).dot(normal) / square] } else { [0.0; 2] }
    }

    /// The place of each cell in an order along a curve that fills space: cells that follow each other are neighbours.
    pub(in crate::exchange) fn order(&self) -> Vec<u32> {
        let lo = self.vertices.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let hi = self.vertices.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
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

    pub(in crate::exchange) fn bytes(&self) -> usize {
        size_of_val(&*self.vertices) + self.len() * (size_of::<[u32; 4]>() + 16 + size_of::<&Element>())
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
    cells: Vec<u32>,
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

    /// The cell at a point of a side of a face, with the reference coordinates of the point; `None` if that side has no
    /// cells. A point between cells to rounding belongs to the nearest.
    pub(super) fn find(&self, cells: &Cells, surface: u32, front: bool, point: DVec3) -> Option<(u32, [f64; 2])> {
        let side = 2 * surface as usize + usize::from(!front);
        let grid = self.grid_of[side];
        let candidates = match self.grids.get(grid as usize) {
            Some(grid) => grid.at(point),
            None => self.on(side),
        };
        let mut best: Option<(f64, u32, [f64; 2])> = None;
        for &cell in candidates {
            let at = cells.locate(cell as usize, point);
            let inside = depth(cells.elements[cell as usize].shape, at);
            if best.is_none_or(|(most, ..)| inside > most) {
                best = Some((inside, cell, at));
                if inside >= 0.0 {
                    break;
                }
            }
        }
        best.map(|(_, cell, at)| (cell, at))
    }

    pub(super) fn bytes(&self) -> usize {
        let grid = |grid: &Grid| size_of::<Grid>() + 4 * (grid.first.len() + grid.cells.len());
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
        let mut grid =
            Self { origin, axes: [e1 * scale[0], e2 * scale[1]], size, first: Vec::new(), cells: Vec::new() };
        let mut entries = Vec::with_capacity(4 * on.len());
        for &cell in on {
            let patch = cells.patch(cell as usize);
            let bins = patch.corners().iter().map(|&p| grid.coordinates(p));
            // Rounding may put a point into the next bin.
            let (low, high) = bins.fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(lo, hi), [x, y]| {
                ([lo[0].min(x), lo[1].min(y)], [hi[0].max(x), hi[1].max(y)])
            });
            let [x0, y0] = grid.bin([low[0] - 1e-6, low[1] - 1e-6]);
            let [x1, y1] = grid.bin([high[0] + 1e-6, high[1] + 1e-6]);
            for y in y0..=y1 {
                entries.extend((x0..=x1).map(|x| ((y * size[0] + x) as usize, cell)));
            }
        }
        (grid.first, grid.cells) = sorted((size[0] * size[1]) as usize, entries.iter().copied());
        grid
    }

    fn coordinates(&self, point: DVec3) -> [f64; 2] {
        self.axes.map(|axis| axis.dot(point - self.origin))
    }

    fn bin(&self, at: [f64; 2]) -> [u32; 2] {
        std::array::from_fn(|k| (at[k].max(0.0) as u32).min(self.size[k] - 1))
    }

    fn at(&self, point: DVec3) -> &[u32] {
        let [x, y] = self.bin(self.coordinates(point));
        let bin = (y * self.size[0] + x) as usize;
        &self.cells[self.first[bin] as usize..self.first[bin + 1] as usize]
    }
}

/// The normal of a face's front, the side it is counter-clockwise from.
fn surface_normal(surface: &Surface) -> DVec3 {
    surface.patch(DVec3::ZERO).normal()
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

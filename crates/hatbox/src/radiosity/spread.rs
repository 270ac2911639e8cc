//! Where the points of an estimate lie: cells have points in proportion to a density, and each point stands for an area.

use crate::mesh::Mesh;

/// Densities of points on the cells of a mesh.
pub(super) struct Spread {
    /// Points per m² relative to one in all.
    density: Vec<f64>,
    /// Sum of density × area up to and with each cell; the last is 1, but for rounding.
    ends: Vec<f64>,
}

impl Spread {
    /// The mean of several densities, each of which counts as much as the others; those that are 0 everywhere do not count.
    pub(super) fn of(densities: &[&[f64]], areas: &[f64]) -> Self {
        let integral = |density: &[f64]| -> f64 { density.iter().zip(areas).map(|(d, area)| d * area).sum() };
        let parts: Vec<(&[f64], f64)> =
            densities.iter().map(|&density| (density, integral(density))).filter(|&(_, sum)| sum > 0.0).collect();
        let count = parts.len().max(1) as f64;
        let mean = |cell: usize| parts.iter().map(|(density, sum)| density[cell] / sum).sum::<f64>() / count;
        let density: Vec<f64> = (0..areas.len()).map(mean).collect();
        let mut end = 0.0;
        let ends = density
            .iter()
            .zip(areas)
            .map(|(density, area)| {
                end += density * area;
                end
            })
            .collect();
        Self { density, ends }
    }

    /// Points per m² of each cell, relative to one in all.
    pub(super) fn density(&self) -> &[f64] {
        &self.density
    }

    /// The cell at a share of all points, from 0 to 1.
    pub(super) fn cell(&self, share: f64) -> usize {
        let target = share * self.total();
        self.ends.partition_point(|&end| end <= target).min(self.ends.len().saturating_sub(1))
    }

    /// What a point of a cell stands for if it is the only one, in m².
    pub(super) fn area(&self, cell: usize) -> f64 {
        self.total() / self.density[cell]
    }

    fn total(&self) -> f64 {
        self.ends.last().copied().unwrap_or(0.0)
    }
}

/// What was seen on some cells, carried over to the others around their vertices: each has the greater of its own and of the
/// mean over its vertices, where a vertex has the mean of the cells around it that have something.
pub(super) fn carried_around(mesh: &Mesh, seen: &[(usize, f64)]) -> Vec<f64> {
    let corners = |cell: usize| mesh.cells[cell].corners().iter().map(|&v| v as usize);
    let mut at = vec![[0.0; 2]; mesh.vertices.len()];
    for &(cell, value) in seen {
        for v in corners(cell) {
            at[v] = [at[v][0] + value, at[v][1] + 1.0];
        }
    }
    let around = |cell: usize| {
        let values = || corners(cell).filter(|&v| at[v][1] > 0.0).map(|v| at[v][0] / at[v][1]);
        values().sum::<f64>() / corners(cell).count() as f64
    };
    let mut values: Vec<f64> = (0..mesh.cells.len()).map(around).collect();
    for &(cell, value) in seen {
        values[cell] = values[cell].max(value);
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::Shape;
    use crate::mesh::Cell;
    use glam::DVec3;

    #[test]
    fn points_stand_for_the_area_of_their_cells() {
        let areas = [1.0, 2.0, 4.0, 0.5];
        let spread = Spread::of(&[&[1.0; 4], &[0.0, 3.0, 0.0, 1.0], &[0.0; 4]], &areas);
        let points = 100_000;
        let mut stood_for = [0.0; 4];
        for k in 0..points {
            let cell = spread.cell((f64::from(k) + 0.5) / f64::from(points));
            stood_for[cell] += spread.area(cell) / f64::from(points);
        }
        for (found, area) in stood_for.iter().zip(areas) {
            assert!((found - area).abs() < 1e-3 * area, "{stood_for:?}");
        }
        assert!(spread.area(1) < 0.3 * spread.area(0), "density 1/7.5 + 3/6.5 against 1/7.5");
    }

    #[test]
    fn what_is_seen_on_a_cell_is_carried_to_those_around_it() {
        let triangle = |vertices: [u32; 3]| Cell {
            shape: Shape::Triangle,
            vertices: [vertices[0], vertices[1], vertices[2], vertices[2]],
            material: 0,
            group: 0,
            surface: 0,
        };
        let cells = vec![triangle([0, 1, 2]), triangle([1, 3, 2]), triangle([3, 4, 5])];
        let mesh = Mesh { vertices: vec![DVec3::ZERO; 6], cells, ..Mesh::default() };
        let carried = carried_around(&mesh, &[(0, 3.0)]);
        assert_eq!(carried, [3.0, 2.0, 0.0], "an edge is two of three corners");
    }
}

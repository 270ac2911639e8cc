//! Noise in what lamps send, averaged where it is no more than noise.
//!
//! What arrives from lamps is not joined: shadows have edges. Where a lamp is seen through slats, each cell sees as much of it as
//! its few points happen to, and what joins cells would average that, as it does of radiosity. Two halves of the points tell how
//! much noise n there is. What averaging changes is the noise that it takes away, nearly n², and what it blurs, b²; it pays where
//! b² < n², which is where it changes less than 2 n². That is asked of a cell together with those that it is joined with.
//!
//! Tried and dropped: to ask each cell alone, and to allow three deviations. Halves differ most where the border of a shadow passes
//! through a cell, and shadows of small lamps were blurred.

use crate::element::MAX_DOFS;
use crate::linalg::{BlockDiagonal, Csr, MultiVector};
use crate::mesh::Mesh;
use crate::space::FunctionSpace;
use arrayvec::ArrayVec;
use rayon::prelude::*;

/// Averaging pays where the square of what it changes is at most so many times that of the noise.
const MOST: f64 = 2.0;
/// Cells of a thread at the least.
const LEAST_CELLS: usize = 1 << 12;

/// Adds the change that averaging makes on cells where it is no more than noise, in each band; what each material receives is
/// kept. The irradiance is that of the same bands, one after the other.
pub(super) fn remove_noise(
    mesh: &Mesh,
    space: &FunctionSpace,
    mass: &BlockDiagonal,
    [change, noise]: [&MultiVector; 2],
    irradiance: &mut [f64],
) {
    let materials = mesh.cells.iter().map(|cell| cell.material as usize + 1).max().unwrap_or(0);
    irradiance.par_chunks_mut(change.rows().max(1)).enumerate().for_each(|(band, irradiance)| {
        of_band((mesh, materials), space, mass, [change, noise].map(|x| x.band(band)), irradiance);
    });
}

/// The same for one band, of a mesh of so many materials.
fn of_band(
    (mesh, materials): (&Mesh, usize),
    space: &FunctionSpace,
    mass: &BlockDiagonal,
    [change, noise]: [&[f64]; 2],
    irradiance: &mut [f64],
) {
    let Some(joined) = space.continuity() else { return };
    // The integrals of a function against those of a cell.
    let integrals = |function: &[f64], cell: usize| {
        let mut integrals = space.range(cell).map(|_| 0.0).collect::<ArrayVec<f64, MAX_DOFS>>();
        mass.rows_times(0, space.range(cell).start, function, &mut integrals);
        integrals
    };
    let squares = |function: &[f64]| -> Vec<f64> {
        let square =
            |cell| integrals(function, cell).iter().zip(&function[space.range(cell)]).map(|(i, f)| i * f).sum();
        cells(space).map(square).collect()
    };
    let pooled = pooled(space, joined, &[change, noise].map(squares));
    let is_noise = |&cell: &usize| pooled[cell][1] > 0.0 && pooled[cell][0] <= MOST * pooled[cell][1];
    let noisy: Vec<usize> = (0..space.cells()).filter(is_noise).collect();
    let mut received = vec![[0.0; 2]; materials];
    for &cell in &noisy {
        let sums: &mut [f64; 2] = &mut received[mesh.cells[cell].material as usize];
        let more: f64 = integrals(change, cell).iter().sum();
        *sums = [sums[0] + more, sums[1] + mesh.patch(cell).area()];
    }
    for cell in noisy {
        let [more, area] = received[mesh.cells[cell].material as usize];
        let places = irradiance[space.range(cell)].iter_mut();
        let changes = &change[space.range(cell)];
        places.zip(changes).for_each(|(place, change)| *place += change - more / area);
    }
}

/// Sums over each cell and those that it is joined with, each as often as it is.
fn pooled(space: &FunctionSpace, joined: &Csr, of_cells: &[Vec<f64>; 2]) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0; 2]; space.dofs()];
    for (cell, (a, b)) in of_cells[0].iter().zip(&of_cells[1]).enumerate() {
        for dof in space.range(cell) {
            joined.row(dof).for_each(|(unknown, _)| sums[unknown] = [sums[unknown][0] + a, sums[unknown][1] + b]);
        }
    }
    let total = |cell: usize| {
        let mut total = [0.0; 2];
        for dof in space.range(cell) {
            joined.row(dof).for_each(|(unknown, _)| total = [total[0] + sums[unknown][0], total[1] + sums[unknown][1]]);
        }
        total
    };
    cells(space).map(total).collect()
}

fn cells(space: &FunctionSpace) -> impl IndexedParallelIterator<Item = usize> {
    (0..space.cells()).into_par_iter().with_min_len(LEAST_CELLS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assemble::mass;
    use crate::element::{ALL, Shape};
    use crate::mesh::Cell;
    use crate::radiosity::Options;
    use crate::scene::{Material, Physics, Scene};
    use glam::DVec3;

    /// Two rows of four squares, each row joined in itself. Halves differ alike in both; averaging changes as little in the first, and
    /// far more in the second, through which a shadow passes.
    #[test]
    fn noise_is_averaged_and_shadows_are_not_and_power_is_kept() {
        let at = |row: u32, k: u32| DVec3::new(f64::from(k / 2), f64::from(k % 2), f64::from(row));
        let vertices = (0..2).flat_map(|row| (0..10).map(move |k| at(row, k))).collect();
        let cell = |index: u32| {
            let first = 10 * (index / 4) + 2 * (index % 4);
            let vertices = [first, first + 2, first + 3, first + 1];
            Cell { shape: Shape::Quad, vertices, material: index / 4, group: 0, surface: index }
        };
        let mesh = Mesh { vertices, cells: (0..8).map(cell).collect(), groups: vec![String::new()], ..Mesh::default() };
        let materials = vec![Material::diffuse("upper", 0.5), Material::diffuse("lower", 0.5)];
        let scene = Scene::new(mesh, materials, Physics::Light, None).expect("valid");
        let space = FunctionSpace::new(&scene, &ALL[2], Options::default().continuity).expect("elements");
        // And the other way round in another band.
        let place = |row: usize, band: usize| if band == 0 { row / 4 } else { 7 - row / 4 };
        let of = |values: [f64; 8]| MultiVector::from_fn(32, 2, |row, band| values[place(row, band)]);
        let change = of([0.02, -0.01, 0.0, 0.01, 0.3, -0.3, 0.3, -0.3]);
        let (noise, mut found) = (of([0.02; 8]), of([1.0; 8]));
        remove_noise(&scene.mesh, &space, &mass(&scene, &space), [&change, &noise], found.as_mut_slice());
        for (k, value) in found.as_slice().iter().enumerate() {
            let (row, band) = (k % 32, k / 32);
            // A quarter of 0.02 stays where it was.
            let expected = [1.015, 0.985, 0.995, 1.005, 1.0, 1.0, 1.0, 1.0][place(row, band)];
            assert!((value - expected).abs() < 1e-12, "{row} {band}: {value} {expected}");
        }
    }
}

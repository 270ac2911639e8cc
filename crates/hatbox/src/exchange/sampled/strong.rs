//! Which faces are lamps.
//!
//! A sky is no lamp: rays find it, and a shadow ray or two to each of its faces are a worse sample of it than they are. The
//! ceiling of a room that glows as a whole is one: of a closed room each wall is about a sixth.

use super::cells::Cells;
use super::lamp_tree::CUT;
use crate::exchange::{Geometry, Params};
use glam::DVec3;
use std::collections::BTreeMap;

/// Cells that are so many times stronger than a mean one are lamps.
const STRONG: f64 = 2.0;
/// Strong cells of one material are left to rays if they look like more than this share of all area: the first, which is more than a
/// wall of a cube, or the second where they are more faces than the least cut has nodes. So is, by the second, a face among as many
/// of whatever materials that are as strong, within a factor: whoever gives a number for each face gives each a material.
const WIDE: [f64; 2] = [0.2, 0.05];
const ALIKE: f64 = 4.0;

/// The cells that shine on each side of a face, face by face, where these are lamps.
pub(super) fn strong_sides(geometry: &Geometry<'_>, cells: &Cells, params: &Params) -> Vec<Vec<u32>> {
    let sides = shining_sides(geometry, cells, params);
    let apparent = apparent_areas(cells, params);
    let areas: Vec<f64> = sides.iter().map(|on| on.iter().map(|&cell| apparent(cell as usize)).sum()).collect();
    let all: f64 = (0..cells.len()).map(&apparent).sum();
    let materials = sides.iter().map(|on| geometry.scene.mesh.cells[on[0] as usize].material);
    let mut of_material: BTreeMap<u32, (usize, f64)> = BTreeMap::new();
    for (material, more) in materials.clone().zip(&areas) {
        let (faces, area) = of_material.entry(material).or_default();
        (*faces, *area) = (*faces + 1, *area + more);
    }
    let strongest = |on: &Vec<u32>| on.iter().map(|&cell| params.strengths[cell as usize]).fold(0.0, f64::max);
    let among = alike(&sides.iter().map(strongest).collect::<Vec<_>>(), &areas);
    let is_wide = |(faces, area): (usize, f64)| area > WIDE[usize::from(faces > CUT)] * all;
    let is_lamp = |(material, among): (u32, (usize, f64))| {
        !is_wide(of_material[&material]) && (among.0 <= CUT || !is_wide(among))
    };
    let are_lamps: Vec<bool> = materials.zip(among).map(is_lamp).collect();
    sides.into_iter().zip(are_lamps).filter(|(_, is_lamp)| *is_lamp).map(|(on, _)| on).collect()
}

/// The strong cells of each side of a face.
fn shining_sides(geometry: &Geometry<'_>, cells: &Cells, params: &Params) -> Vec<Vec<u32>> {
    let mut sides: BTreeMap<(u32, bool), Vec<u32>> = BTreeMap::new();
    for cell in 0..params.strengths.len().min(cells.len()) {
        if params.strengths[cell] > STRONG {
            let surface = cells.surface(cell);
            let front = geometry.surfaces[surface as usize].patch(DVec3::ZERO).normal();
            let side = front.dot(cells.patch(cell).normal()) >= 0.0;
            sides.entry((surface, side)).or_default().push(cell as u32);
        }
    }
    sides.into_values().collect()
}

/// For each, the number of those that are as strong within a factor of [`ALIKE`], and the area of these.
fn alike(strengths: &[f64], areas: &[f64]) -> Vec<(usize, f64)> {
    let mut order: Vec<usize> = (0..strengths.len()).collect();
    order.sort_by(|&a, &b| strengths[a].total_cmp(&strengths[b]));
    let sorted: Vec<f64> = order.iter().map(|&k| strengths[k]).collect();
    // Of all that are weaker.
    let mut before = vec![0.0];
    before.extend(order.iter().scan(0.0, |sum, &k| {
        *sum += areas[k];
        Some(*sum)
    }));
    let of = |&strength: &f64| {
        let start = sorted.partition_point(|&other| other < strength / ALIKE);
        let end = sorted.partition_point(|&other| other <= strength * ALIKE);
        (end - start, before[end] - before[start])
    };
    strengths.iter().map(of).collect()
}

/// The area of a cell; of one farther from the middle of what does not shine than that is on average, as large as it looks from
/// there at that distance: a sun is small, however far, and a sky wide.
fn apparent_areas<'a>(cells: &'a Cells, params: &'a Params) -> impl Fn(usize) -> f64 + 'a {
    let center = |cell: usize| cells.patch(cell).center();
    let is_weak = |&cell: &usize| params.strengths.get(cell).is_none_or(|&strength| strength <= STRONG);
    let weak = || (0..cells.len()).filter(is_weak);
    let area: f64 = weak().map(|cell| cells.area(cell)).sum();
    let middle = weak().map(|cell| cells.area(cell) * center(cell)).sum::<DVec3>() / area;
    let square = weak().map(|cell| cells.area(cell) * center(cell).distance_squared(middle)).sum::<f64>() / area;
    move |cell| {
        let shrunk = square / center(cell).distance_squared(middle);
        // Where everything shines there is no middle.
        cells.area(cell) * if shrunk < 1.0 { shrunk } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_are_alike_that_are_within_a_factor() {
        let found = alike(&[100.0, 1.0, 3.9, 16.0, 4.1], &[1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(found, [(1, 1.0), (2, 5.0), (3, 10.0), (2, 9.0), (3, 12.0)]);
    }
}

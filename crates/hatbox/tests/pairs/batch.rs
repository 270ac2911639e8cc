//! Eight at a time is one at a time.

use crate::{Outline, Random, panel};
use glam::DVec3;
use hatbox::assemble::{Accuracy, Batch, Facing, Found, LANES, Panel, Sight, pair_block};
use hatbox::element::ALL;

/// Panels of all elements and outlines in runs of random lengths, looking at the origin from everywhere.
fn crowd(random: &mut Random) -> Vec<Panel> {
    let mut panels = Vec::new();
    while panels.len() < 220 {
        let basis = &ALL[random.below(ALL.len())];
        let outline = Outline::ALL[random.below(3)];
        let Some(element) = basis.element(outline.shape()) else { continue };
        for _ in 0..=random.below(12) {
            // Trapezia and parallelograms are of one element and mix within a chunk.
            let outline = if outline == Outline::Triangle { outline } else { Outline::ALL[1 + random.below(2)] };
            let way = random.direction();
            let distance = random.size(0.3, 12.0);
            let normal = (random.direction() - 1.5 * way).normalize();
            let frame = random.frame(normal);
            panels.push(panel(outline.corners(random).map(|p| way * distance + frame * p), element));
        }
    }
    panels
}

/// Compares what a chunk says of one of its lanes with the pair on its own.
fn compare(a: &Panel, b: &Panel, lane: usize, found: &Found, accuracy: &Accuracy) {
    let truth =
        pair_block(a, b, Sight::Clear, [1.0; 2], &Accuracy { tolerance: 0.01 * accuracy.tolerance, ..*accuracy });
    let values = truth.values();
    let error: f64 = values.iter().zip(&found.values).map(|(exact, lanes)| (lanes[lane] - exact).abs()).sum();
    let bound = found.errors[lane] + truth.quadrature_error + 1e-13 * truth.sum();
    let names = [a.element.name, b.element.name];
    assert!(error <= bound, "{names:?}: {error:e} > {bound:e} of {:e}", truth.sum());
    let mean = a.area() * b.area() / accuracy.total_area;
    let scale = truth.sum().max(mean);
    // The rung is chosen by the cosines between the centres, which are about the mean ones.
    assert!(found.errors[lane] <= 4.0 * accuracy.tolerance * scale, "{names:?}: {:e} {scale:e}", found.errors[lane]);
}

#[test]
fn blocks_side_by_side_are_those_of_the_pairs() {
    let mut random = Random::new(5);
    let panels = crowd(&mut random);
    let all: Vec<&Panel> = panels.iter().collect();
    let batch = Batch::new(&all);
    for tolerance in [1e-2, 1e-4, 1e-6] {
        let accuracy = Accuracy::new(tolerance, 400.0);
        let (mut done, mut rest) = (0, 0);
        let start = random.below(all.len() - 4);
        let (rows, range) = (start..start + 4, 3..all.len() - 5);
        let mut seen = vec![[0; 4]; all.len()];
        batch.blocks(rows.clone(), range.clone(), &accuracy, |row, first, found| {
            assert_eq!(found.done & found.rest, 0);
            for lane in (0..LANES).filter(|lane| (found.done | found.rest) >> lane & 1 == 1) {
                seen[first + lane][row - start] += 1;
                done += found.done >> lane & 1;
                rest += found.rest >> lane & 1;
                if found.done >> lane & 1 == 1 {
                    compare(all[row], all[first + lane], lane, found, &accuracy);
                }
            }
        });
        for (place, counts) in seen.iter().enumerate() {
            for (k, &count) in counts.iter().enumerate() {
                let faces = range.contains(&place) && Facing::new(&all[start + k].patch, &all[place].patch).is_some();
                assert_eq!(count, i32::from(faces), "row {k}, place {place}");
            }
        }
        assert!(done > 50 && rest > 50, "{done} {rest}: both ways are taken");
    }
}

#[test]
fn masks_choose_among_the_panels() {
    let mut random = Random::new(6);
    let panels = crowd(&mut random);
    let all: Vec<&Panel> = panels.iter().collect();
    let batch = Batch::new(&all);
    let accuracy = Accuracy::new(1e-3, 400.0);
    for round in 0..60 {
        let start = random.below(all.len() - 64);
        let mask = hatbox::quadrature::sequence::hash(round, 0) & hatbox::quadrature::sequence::hash(round, round % 3);
        let row = random.below(all.len());
        let a = all[row];
        let mut seen = 0_u64;
        batch.masked(row, start, mask, &accuracy, |first, found| {
            for lane in (0..LANES).filter(|lane| (found.done | found.rest) >> lane & 1 == 1) {
                let bit = 1 << (first + lane - start);
                assert_eq!(seen & bit, 0, "twice");
                seen |= bit;
                if found.done >> lane & 1 == 1 {
                    compare(a, all[first + lane], lane, found, &accuracy);
                }
            }
        });
        let faces = |k: &usize| mask >> k & 1 == 1 && Facing::new(&a.patch, &all[start + k].patch).is_some();
        let expected = (0..64).filter(faces).fold(0, |bits, k| bits | 1_u64 << k);
        assert_eq!(seen, expected, "round {round}");
    }
}

/// A parallelogram that comes first does not lend its exactness to the trapezia in its chunk.
#[test]
fn trapezia_beside_a_parallelogram_keep_their_own_error() {
    let element = ALL[0].quad.expect("constant quads");
    let at = |corners: [(f64, f64); 4], z: f64| corners.map(|(x, y)| DVec3::new(x, y, z));
    let floor = panel(at([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], 0.0), element);
    let square = panel(at([(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)], 40.0), element);
    // Its first-order node lies where its centre of mass does not.
    let trapezium = |z: f64| panel(at([(0.0, 0.0), (0.05, 1.0), (0.1, 1.0), (1.0, 0.0)], z), element);
    let (near, accuracy) = (trapezium(8.0), Accuracy::new(0.05, 6.0));
    let mut alone = Vec::new();
    for panels in [[&near, &square, &floor], [&square, &near, &floor]] {
        let place = panels.iter().position(|panel| std::ptr::eq(*panel, &raw const near)).expect("in it");
        Batch::new(&panels).masked(2, 0, 1 << place, &accuracy, |_, found| {
            assert_eq!(found.done, 1 << place);
            alone.push((found.values[0][place], found.errors[place]));
        });
    }
    assert_eq!(alone[0], alone[1], "the order in a chunk does not matter");
}

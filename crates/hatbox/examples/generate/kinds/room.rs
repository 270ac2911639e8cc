//! A living room: a table with chairs, a bed, and shelves along two walls that are the fuller the more elements there
//! are to be.

use super::{Face, Inside, Model, block, chance, lamp, matte, standing, table};
use glam::DVec3;

const LOW: DVec3 = DVec3::ZERO;
const HIGH: DVec3 = DVec3::new(6.0, 2.8, 4.5);
/// Triangles without the books.
const BARE: usize = 440;
const BOARDS: usize = 5;

pub(super) fn make(elements: usize) -> Model {
    let inside = Inside::new(LOW, HIGH);
    let lamp_at = ([2.6, 3.4], [1.9, 2.5]);
    let books = elements.saturating_sub(BARE) / 12;
    let (boards, books) = shelf(books);
    let mut wood = table(DVec3::new(3.0, 0.0, 2.2), [1.6, 0.9], 0.74);
    for (x, z) in [(2.6, 1.5), (3.4, 1.5), (2.6, 2.9), (3.4, 2.9)] {
        wood.extend(chair(DVec3::new(x, 0.0, z)));
    }
    wood.extend(boards);
    let bed = standing(DVec3::new(4.6, 0.0, 0.1), DVec3::new(5.8, 0.5, 2.1));
    let mut books = books;
    let third = books.split_off(books.len() / 2);
    Model {
        parts: vec![
            (matte("floor", [0.45, 0.33, 0.22]), vec![inside.floor.whole()]),
            (matte("walls", [0.75, 0.72, 0.66]), inside.walls.iter().map(super::Sheet::whole).collect()),
            (matte("ceiling", [0.85; 3]), inside.ceiling.around(lamp_at.0, lamp_at.1)),
            (lamp([4000.0, 3600.0, 3000.0]), vec![inside.ceiling.part(lamp_at.0, lamp_at.1)]),
            (matte("wood", [0.5, 0.36, 0.24]), wood),
            (matte("linen", [0.8, 0.8, 0.75]), bed),
            (matte("red books", [0.5, 0.15, 0.12]), books),
            (matte("blue books", [0.15, 0.2, 0.45]), third),
        ],
        eye: DVec3::new(5.7, 1.9, 4.3),
        target: DVec3::new(1.5, 0.9, 1.0),
        closed: true,
    }
}

/// A seat on four legs with a back.
fn chair(at: DVec3) -> Vec<Face> {
    let mut faces = table(at, [0.42, 0.42], 0.45);
    let z = if at.z < 2.2 { -0.21 } else { 0.17 };
    let back = at + DVec3::new(-0.21, 0.5, z);
    faces.extend(block(back, back + DVec3::new(0.42, 0.45, 0.04), 0.0));
    faces
}

/// Boards along the wall x = 0 with so many books on them, which stand upright and do not touch one another.
fn shelf(books: usize) -> (Vec<Face>, Vec<Face>) {
    let (depth, gap) = (0.3, 0.01);
    let height = |board: usize| 0.3 + 0.42 * board as f64;
    let plate = |board: usize| {
        let lo = DVec3::new(gap, height(board), 0.3);
        block(lo, DVec3::new(depth, lo.y + 0.03, 4.2), 0.0)
    };
    let per_board = books.div_ceil(BOARDS).max(1);
    let width = 3.8 / per_board as f64;
    let book = |k: usize| {
        let (board, place) = (k / per_board, k % per_board);
        let lo = DVec3::new(gap + 0.02, height(board) + 0.03, 0.35 + width * place as f64);
        let size =
            DVec3::new(0.15 + 0.08 * chance(1, k), 0.2 + 0.15 * chance(2, k), width * (0.6 + 0.35 * chance(3, k)));
        standing(lo, lo + size)
    };
    ((0..BOARDS).flat_map(plate).collect(), (0..books).flat_map(book).collect())
}

//! Two rooms with a lamp in the ceiling of the first, and between them a doorway in a wall of real thickness; or the
//! same with the doorway walled up, where the second room is dark.
//!
//! All surfaces face inwards and close: they are cut along the same planes, so that they meet corner to corner.

use super::glb::{Camera, Material, Part, Scene};
use std::ops::Range;

/// What is in the wall between the rooms.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Door {
    Open,
    WalledUp,
}

const FLOOR: usize = 0;
const WARM: usize = 1;
const COOL: usize = 2;
const WHITE: usize = 3;
const LAMP: usize = 4;

const MATERIALS: [Material; 5] = [
    Material::matte("floor", [0.45, 0.32, 0.2]),
    Material::matte("warm wall", [0.75, 0.68, 0.55]),
    Material::matte("cool wall", [0.45, 0.58, 0.7]),
    Material::matte("white", [0.85, 0.85, 0.85]),
    Material { name: "lamp", reflectance: [0.0; 3], radiance: [2000.0, 1800.0, 1500.0] },
];

/// The planes along which surfaces are cut, in metres: x along the rooms, y up, z to the back.
const PLANES: [&[f64]; 3] = [&[0.0, 1.5, 2.5, 4.0, 4.2, 6.0, 8.2], &[0.0, 2.1, 2.6], &[0.0, 1.5, 2.4, 4.0]];

// Ranges of intervals between those planes.
const ROOM_1: Range<usize> = 0..3;
const WALL: Range<usize> = 3..4;
const ROOM_2: Range<usize> = 4..6;
const HEIGHT: Range<usize> = 0..2;
const DOOR_HEIGHT: Range<usize> = 0..1;
const DEPTH: Range<usize> = 0..3;
const DOOR_WIDTH: Range<usize> = 1..2;

type Quad = [[f64; 3]; 4];

/// The direction in which a surface faces along its axis.
#[derive(Clone, Copy)]
enum Facing {
    Up,
    Down,
}

/// Quads across `axis` at its plane number `at`, over ranges of intervals of the two axes that follow it cyclically.
fn sheet(axis: usize, at: usize, facing: Facing, u: Range<usize>, v: &Range<usize>) -> Vec<Quad> {
    let (u_axis, v_axis) = ((axis + 1) % 3, (axis + 2) % 3);
    let corner = |i: usize, j: usize| {
        let mut corner = [0.0; 3];
        corner[axis] = PLANES[axis][at];
        corner[u_axis] = PLANES[u_axis][i];
        corner[v_axis] = PLANES[v_axis][j];
        corner
    };
    let quad = |i: usize, j: usize| match facing {
        Facing::Up => [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)],
        Facing::Down => [corner(i, j), corner(i, j + 1), corner(i + 1, j + 1), corner(i + 1, j)],
    };
    u.flat_map(|i| v.clone().map(move |j| (i, j))).map(|(i, j)| quad(i, j)).collect()
}

/// The wall towards the other room, with or without the doorway.
fn partition(at: usize, facing: Facing, door: Door) -> Vec<Quad> {
    let mut wall = sheet(0, at, facing, HEIGHT, &DEPTH);
    if door == Door::Open {
        let hole = sheet(0, at, facing, DOOR_HEIGHT, &DOOR_WIDTH);
        wall.retain(|quad| !hole.contains(quad));
    }
    wall
}

/// Floor, walls and ceiling of a room over a range of x; its partition is at the end that `partition` says.
fn room(names: [&'static str; 3], paint: usize, x: &Range<usize>, outer: Vec<Quad>, partition: Vec<Quad>) -> Vec<Part> {
    let walls = [
        sheet(2, DEPTH.start, Facing::Up, x.clone(), &HEIGHT),
        sheet(2, DEPTH.end, Facing::Down, x.clone(), &HEIGHT),
        outer,
        partition,
    ];
    vec![
        Part { name: names[0], material: FLOOR, quads: sheet(1, HEIGHT.start, Facing::Up, DEPTH, x) },
        Part { name: names[1], material: paint, quads: walls.concat() },
        Part { name: names[2], material: WHITE, quads: sheet(1, HEIGHT.end, Facing::Down, DEPTH, x) },
    ]
}

/// The scene, seen through its front walls, whose backs are not there.
pub(super) fn scene(door: Door) -> Scene {
    let (first, last) = (sheet(0, 0, Facing::Up, HEIGHT, &DEPTH), sheet(0, ROOM_2.end, Facing::Down, HEIGHT, &DEPTH));
    let near = partition(WALL.start, Facing::Down, door);
    let far = partition(WALL.end, Facing::Up, door);
    let mut parts = room(["floor 1", "walls 1", "ceiling 1"], WARM, &ROOM_1, first, near);
    let lamp = sheet(1, HEIGHT.end, Facing::Down, DOOR_WIDTH, &(1..2));
    parts[2].quads.retain(|quad| !lamp.contains(quad));
    parts.push(Part { name: "lamp", material: LAMP, quads: lamp });
    parts.extend(room(["floor 2", "walls 2", "ceiling 2"], COOL, &ROOM_2, last, far));
    if door == Door::Open {
        let frame = [
            sheet(1, DOOR_HEIGHT.end, Facing::Down, DOOR_WIDTH, &WALL),
            sheet(2, DOOR_WIDTH.start, Facing::Up, WALL, &DOOR_HEIGHT),
            sheet(2, DOOR_WIDTH.end, Facing::Down, WALL, &DOOR_HEIGHT),
        ];
        parts.push(Part { name: "door frame", material: WHITE, quads: frame.concat() });
        let sill = sheet(1, 0, Facing::Up, DOOR_WIDTH, &WALL);
        parts.push(Part { name: "door sill", material: FLOOR, quads: sill });
    }
    Scene {
        materials: MATERIALS.to_vec(),
        parts,
        camera: Camera { eye: [4.1, 1.5, -7.0], fov_y: 0.7, aspect_ratio: 16.0 / 9.0 },
    }
}

//! Two storeys of rooms on a grid: doorways in walls of real thickness, a stairwell, and in each room a table and a lamp
//! in the ceiling. Everything faces inwards and closes.

use super::{Face, Inside, Model, Sheet, lamp, matte, table};
use glam::DVec3;

const ROOM: DVec3 = DVec3::new(4.0, 2.6, 5.0);
const WALL: f64 = 0.2;
const DOOR: [f64; 2] = [1.0, 2.1];
const STAIRS: [[f64; 2]; 2] = [[0.5, 1.7], [0.5, 1.9]];
/// Triangles of a room with its furniture.
const PER_ROOM: usize = 105;

/// Faces by what they are made of.
#[derive(Default)]
struct Faces {
    floor: Vec<Face>,
    white: Vec<Face>,
    wall: [Vec<Face>; 3],
    wood: Vec<Face>,
    lamp: Vec<Face>,
}

pub(super) fn make(elements: usize) -> Model {
    let rooms = (elements / PER_ROOM / 2).max(2);
    let nx = ((rooms as f64).sqrt().round() as usize).max(2);
    let nz = (rooms / nx).max(1);
    let mut faces = Faces::default();
    for storey in 0..2 {
        for i in 0..nx {
            for k in 0..nz {
                faces.room([i, storey, k], [nx, nz]);
            }
        }
    }
    let Faces { floor, white, wall: [warm, cool, green], wood, lamp: lamps } = faces;
    Model {
        parts: vec![
            (matte("floor", [0.45, 0.32, 0.2]), floor),
            (matte("white", [0.85; 3]), white),
            (matte("warm wall", [0.75, 0.66, 0.52]), warm),
            (matte("cool wall", [0.5, 0.6, 0.7]), cool),
            (matte("green wall", [0.5, 0.66, 0.5]), green),
            (matte("wood", [0.55, 0.4, 0.26]), wood),
            (lamp([3000.0, 2700.0, 2300.0]), lamps),
        ],
        eye: DVec3::new(0.4, 1.7, 4.7),
        target: DVec3::new(4.2, 1.0, 2.4),
        closed: true,
    }
}

impl Faces {
    fn room(&mut self, [i, storey, k]: [usize; 3], [nx, nz]: [usize; 2]) {
        let lo = DVec3::new(i as f64, storey as f64, k as f64) * (ROOM + WALL);
        let inside = Inside::new(lo, lo + ROOM);
        let stairs = i == 0 && k == 0;
        let paint = (i + 2 * k + storey) % 3;
        let [z, x] = STAIRS;
        let floor = if stairs && storey == 1 { inside.floor.around(z, x) } else { vec![inside.floor.whole()] };
        self.floor.extend(floor);
        self.ceiling(&inside, stairs && storey == 0);
        let opens = [i > 0, i + 1 < nx, i == 0 && k > 0, i == 0 && k + 1 < nz];
        let [across_z, across_x] =
            [ROOM.z, ROOM.x].map(|width| [(width - DOOR[0]) / 2.0, f64::midpoint(width, DOOR[0])]);
        let up = [0.0, DOOR[1]];
        let holes = [(up, across_z), (across_z, up), (across_x, up), (up, across_x)];
        for ((wall, open), (u, v)) in inside.walls.iter().zip(opens).zip(holes) {
            let faces = if open { wall.around(u, v) } else { vec![wall.whole()] };
            self.wall[paint].extend(faces);
        }
        if opens[1] {
            self.doorway(lo + DVec3::new(ROOM.x, 0.0, across_z[0]), DVec3::new(WALL, DOOR[1], DOOR[0]), 0);
        }
        if opens[3] {
            self.doorway(lo + DVec3::new(across_x[0], 0.0, ROOM.z), DVec3::new(DOOR[0], DOOR[1], WALL), 2);
        }
        if stairs && storey == 0 {
            let from = lo + DVec3::new(x[0], ROOM.y, z[0]);
            let well = Inside::new(from, from + DVec3::new(x[1] - x[0], WALL, z[1] - z[0]));
            self.white.extend(well.walls.iter().map(Sheet::whole));
        }
        self.wood.extend(table(lo + DVec3::new(2.6, 0.0, 3.4), [1.4, 0.8], 0.74));
    }

    /// The ceiling with its lamp, and a hole for the stairs in the other half.
    fn ceiling(&mut self, inside: &Inside, stairs: bool) {
        let half = ROOM.z / 2.0;
        let near = Sheet { size: [ROOM.x, half], ..inside.ceiling };
        let far = Sheet { origin: near.origin + near.v * half, ..near };
        let [z, x] = STAIRS;
        let first = if stairs { near.around(x, z) } else { vec![near.whole()] };
        let (u, v) = ([1.7, 2.3], [0.4, 1.0]);
        self.white.extend(first);
        self.white.extend(far.around(u, v));
        self.lamp.push(far.part(u, v));
    }

    /// The inside of a doorway but for its two open sides, which are those at wall `open` and the one after it.
    fn doorway(&mut self, lo: DVec3, size: DVec3, open: usize) {
        let inside = Inside::new(lo, lo + size);
        self.floor.push(inside.floor.whole());
        self.white.push(inside.ceiling.whole());
        let walls = inside.walls.iter().enumerate().filter(|(k, _)| k / 2 != open / 2);
        self.white.extend(walls.map(|(_, wall)| wall.whole()));
    }
}

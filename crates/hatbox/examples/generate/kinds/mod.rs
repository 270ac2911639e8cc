//! Scenes of any size, made by rules: the same number gives the same scene.

mod building;
mod city;
mod clutter;
mod glb;
mod room;
mod terrain;

use glam::DVec3;

/// A quad, or a triangle that repeats its last corner; counter-clockwise from the lit side, in metres, y up.
pub(crate) type Face = [DVec3; 4];

/// A diffuse surface.
pub(crate) struct Material {
    pub(crate) name: &'static str,
    pub(crate) reflectance: [f32; 3],
    /// In W/(m² sr) or cd/m².
    pub(crate) radiance: [f32; 3],
}

/// What becomes a file: faces by material, and where to look from.
pub(crate) struct Model {
    pub(crate) parts: Vec<(Material, Vec<Face>)>,
    pub(crate) eye: DVec3,
    pub(crate) target: DVec3,
    /// Whether no light gets out.
    #[allow(dead_code, reason = "for those who check it")]
    pub(crate) closed: bool,
}

/// A kind of scene.
pub(crate) struct Kind {
    pub(crate) name: &'static str,
    #[allow(dead_code, reason = "for those who ask")]
    pub(crate) summary: &'static str,
    /// Makes one of about so many triangles.
    pub(crate) make: fn(usize) -> Model,
}

/// Every kind.
pub(crate) const ALL: &[Kind] = &[
    Kind { name: "room", summary: "a furnished room with shelves of books", make: room::make },
    Kind {
        name: "building",
        summary: "two storeys of rooms with doorways, a table and a lamp in each",
        make: building::make,
    },
    Kind { name: "city", summary: "a city block under an overcast sky", make: city::make },
    Kind { name: "terrain", summary: "a field of craters under a low sun", make: terrain::make },
    Kind { name: "clutter", summary: "a box full of small objects", make: clutter::make },
];

const fn matte(name: &'static str, reflectance: [f32; 3]) -> Material {
    Material { name, reflectance, radiance: [0.0; 3] }
}

const fn lamp(radiance: [f32; 3]) -> Material {
    Material { name: "lamp", reflectance: [0.0; 3], radiance }
}

/// A number from 0 to 1 that follows from what is numbered.
fn chance(seed: u64, index: usize) -> f64 {
    let mut z = (seed << 32).wrapping_add(index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A rectangle with two unit directions; it is lit on the side of u × v.
#[derive(Clone, Copy)]
struct Sheet {
    origin: DVec3,
    u: DVec3,
    v: DVec3,
    size: [f64; 2],
}

impl Sheet {
    /// The part between two lengths along each direction.
    fn part(&self, [x0, x1]: [f64; 2], [y0, y1]: [f64; 2]) -> Face {
        let at = |x, y| self.origin + self.u * x + self.v * y;
        [at(x0, y0), at(x1, y0), at(x1, y1), at(x0, y1)]
    }

    fn whole(&self) -> Face {
        self.part([0.0, self.size[0]], [0.0, self.size[1]])
    }

    /// All but a rectangle, in up to four pieces.
    fn around(&self, x: [f64; 2], y: [f64; 2]) -> Vec<Face> {
        let [w, h] = self.size;
        let pieces = [([0.0, w], [0.0, y[0]]), ([0.0, w], [y[1], h]), ([0.0, x[0]], y), ([x[1], w], y)];
        pieces.into_iter().filter(|(x, y)| x[1] > x[0] && y[1] > y[0]).map(|(x, y)| self.part(x, y)).collect()
    }
}

/// The six sides of a box, lit inside: floor, ceiling, and the walls at the least and greatest x and z.
struct Inside {
    floor: Sheet,
    ceiling: Sheet,
    walls: [Sheet; 4],
}

impl Inside {
    fn new(lo: DVec3, hi: DVec3) -> Self {
        let d = hi - lo;
        let sheet = |origin, u, v, size| Sheet { origin, u, v, size };
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        Self {
            floor: sheet(lo, z, x, [d.z, d.x]),
            ceiling: sheet(DVec3::new(lo.x, hi.y, lo.z), x, z, [d.x, d.z]),
            walls: [
                sheet(lo, y, z, [d.y, d.z]),
                sheet(DVec3::new(hi.x, lo.y, lo.z), z, y, [d.z, d.y]),
                sheet(lo, x, y, [d.x, d.y]),
                sheet(DVec3::new(lo.x, lo.y, hi.z), y, x, [d.y, d.x]),
            ],
        }
    }
}

/// What stands on something is this far above it, in metres: where a block without a bottom stood on a floor, the floor
/// beneath would see its backs.
const GAP: f64 = 0.002;

/// A block, lit outside, turned by an angle about the upright line through its middle.
fn block(lo: DVec3, hi: DVec3, angle: f64) -> Vec<Face> {
    let inside = Inside::new(lo, hi);
    let sides = inside.walls.iter().map(Sheet::whole).chain([inside.floor.whole(), inside.ceiling.whole()]);
    let middle = lo.midpoint(hi);
    let turn = |p: DVec3| middle + glam::DQuat::from_rotation_y(angle) * (p - middle);
    let outwards = |[a, b, c, d]: Face| if angle == 0.0 { [a, d, c, b] } else { [a, d, c, b].map(turn) };
    sides.map(outwards).collect()
}

/// A block that stands on something at the height of `lo`.
fn standing(lo: DVec3, hi: DVec3) -> Vec<Face> {
    block(lo + DVec3::Y * GAP, hi, 0.0)
}

/// A table that stands on the floor at y: a plate on four legs.
fn table(center: DVec3, size: [f64; 2], height: f64) -> Vec<Face> {
    let (half, plate, leg) = (DVec3::new(size[0] / 2.0, 0.0, size[1] / 2.0), 0.04, 0.06);
    let top = center + DVec3::Y * height;
    let mut faces = block(top - half - DVec3::Y * plate, top + half, 0.0);
    for (sx, sz) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        let foot = center + DVec3::new(sx * (half.x - leg), 0.0, sz * (half.z - leg));
        let half = DVec3::new(leg / 2.0, 0.0, leg / 2.0);
        faces.extend(standing(foot - half, foot + half + DVec3::Y * (height - plate - GAP)));
    }
    faces
}

impl Model {
    /// Number of triangles, quads counting twice.
    #[allow(dead_code, reason = "for those who ask")]
    pub(crate) fn triangles(&self) -> usize {
        self.parts.iter().flat_map(|(_, faces)| faces).map(|face| 1 + usize::from(face[2] != face[3])).sum()
    }
}

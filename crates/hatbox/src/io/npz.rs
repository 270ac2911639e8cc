//! The solution as a NumPy archive: everything that a script, or a later run of Hatbox, needs of it.
//!
//! The file is a ZIP archive of `.npy` arrays of plain numbers and fixed-width strings; `numpy.load(path)` opens it
//! without pickling. Loading it gives back the mesh, the materials, the space and the coefficients, bit for bit.
//!
//! With V vertices, N cells, M materials, S surfaces, D broken coefficients, T textures and n bands:
//!
//! | key | shape | type | meaning |
//! |---|---|---|---|
//! | `hatbox_format` | | i4 | version of this table: 1 |
//! | `physics` | | U | `light` (lm/m², lx) or `heat` (W/m²) |
//! | `basis` | | U | as `--basis` names it |
//! | `continuous` | | b1 | whether coefficients at shared nodes were joined by the solve |
//! | `vertices` | V × 3 | f8 | positions in metres |
//! | `cells` | N × 4 | u4 | corners, counter-clockwise from the lit side; a triangle repeats its last |
//! | `corners` | N | u1 | number of corners: 3 or 4 |
//! | `material`, `group`, `surface` | N | u4 | of each cell: index of its material, group and surface |
//! | `uvs` | N × 4 × 2 or 0 | f8 | texture coordinates of the cells' corners (v runs down) |
//! | `normals` | N × 4 × 3 or 0 | f8 | normals that the input gave the cells' corners |
//! | `group_names` | | U | one per group |
//! | `material_names` | M | U | |
//! | `reflectance`, `exitance` | M × n | f8 | R and B⁰ (lm/m² or W/m²); NaN where they vary over the surface |
//! | `reflectance_texture`, `exitance_texture` | M | i4 | k if it is a factor times `texture_k`, otherwise −1 |
//! | `reflectance_factor`, `exitance_factor` | M × n | f8 | that factor; NaN where there is no texture |
//! | `texture_0` … | height × width × channels | f4 | linear values, top row first |
//! | `texture_wrap` | T × 2 | u1 | outside the image, along u and v: 0 repeat, 1 mirror, 2 clamp |
//! | `two_sided` | M | b1 | |
//! | `surfaces` | S × 4 × 3 | f8 | corners of the opaque faces of the input; a triangle repeats its last |
//! | `hidden` | H × 4 × 3 | f8 | the same of pieces that were left out, because others that look the same way lie on them |
//! | `offsets` | N + 1 | u8 | cell c has the coefficients `offsets[c]` to `offsets[c + 1]` |
//! | `nodes` | D × 3 | f8 | where each coefficient is the value (for convenience; not read back) |
//! | `radiosity`, `irradiance` | n × D | f8 | B in lm/m² or W/m², E in lx or W/m², at the nodes |
//! | `camera` | 10 or 0 | f8 | eye, target, up, vertical field of view in radians |
//!
//! A quantity given as a function (by a program, never by a file) is stored as varying, without a texture; it comes
//! back as NaN.

mod load;
mod save;

pub use load::{LoadError, load};
pub use save::save;

/// The version of the table above.
const FORMAT: i32 = 1;

//! The integrals of the finite-element system: mass, load, and the exchange between pairs of panels.

mod batch;
mod forms;
mod pair;
mod panel;

pub use batch::{Batch, Found, LANES};
pub use forms::{function_weighted_mass, load, mass, weighted_mass};
pub use pair::{Accuracy, Block, Facing, Outlook, Sight, facing_block, pair_block, point_row};
pub(crate) use pair::{FLAT, Region};
pub use panel::Panel;

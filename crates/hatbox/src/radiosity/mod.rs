//! The equation put together: from a scene to its radiosity.
//!
//! [`System`] holds what does not depend on the light: the space, the mass matrix and the exchange operator. Solving it
//! is then Δ b = b⁰ + F̂ b with F̂ = M_R Δ⁻¹ S, in the joined space if there is one: the solver sees three operators and a
//! vector, whatever the basis. (On an element of constant R, M_R Δ⁻¹ S is R S; on one of varying R it differs from the
//! generalized form factor ∬R N_i N_j G by a product of two projection errors.)
//!
//! In a joined space the *computation* is Galerkin's on the hats themselves; for linear functions on triangles there are about six
//! times fewer of them than broken ones. The irradiance is always given in the broken space.

mod denoise;
mod direct;
mod gather;
mod indicator;
mod lossless;
mod means;
mod operators;
mod pointwise;
mod products;
mod reconstruct;
mod residual;
mod search;
mod solution;
mod solved;
mod spread;
mod strengths;
mod system;

pub use direct::{Direct, Projected};
pub use gather::{Gather, Sources};
pub use indicator::local_error;
pub(crate) use indicator::roughness;
pub(crate) use lossless::lossless;
pub use reconstruct::{error_of, gathered};
pub use residual::{ErrorEstimate, Estimated, Sampling, estimate_error};
pub use solution::{Shown, Solution};
pub use solved::{Energy, Error, MaterialsError, Options, Solved, solve};
pub(crate) use strengths::strengths;
pub use system::System;

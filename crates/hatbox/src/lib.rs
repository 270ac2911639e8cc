//! Hatbox: Galerkin radiosity.

pub mod assemble;
pub mod bake;
pub mod check;
pub mod element;
pub mod exchange;
pub mod io;
pub mod kernel;
pub mod linalg;
pub mod mesh;
pub mod probe;
pub mod progress;
pub mod quadrature;
pub mod radiosity;
pub mod render;
pub mod report;
pub mod scene;
pub mod solve;
pub mod space;
pub mod view_factors;
pub mod visibility;

//! Hatbox: Galerkin radiosity.

pub mod assemble;
pub mod bake;
pub mod element;
pub mod exchange;
pub mod io;
pub mod kernel;
pub mod linalg;
pub mod mesh;
pub mod progress;
pub mod quadrature;
pub mod radiosity;
pub mod render;
pub mod scene;
pub mod solve;
pub mod space;
pub mod visibility;

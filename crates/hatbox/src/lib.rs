//! Hatbox: Galerkin radiosity.

pub mod bake;
pub mod element;
pub mod io;
pub mod linalg;
pub mod mesh;
pub mod progress;
pub mod radiosity;
pub mod render;
pub mod scene;
pub mod space;

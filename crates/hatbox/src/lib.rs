//! Hatbox: Galerkin radiosity.

pub mod element;
pub mod linalg;
pub mod mesh;
pub mod progress;
pub mod radiosity;
pub mod scene;
pub mod solve;
pub mod space;
pub mod visibility;

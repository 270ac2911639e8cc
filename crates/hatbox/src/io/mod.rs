//! Files: what is read and what is written. Nothing above this module knows of a format.

pub mod atomic;
pub mod checkpoint;
pub mod csv;
pub mod factors;
pub mod npy;
pub mod npz;
pub mod picture;
pub mod read;
pub(crate) mod suggestion;
pub mod unit;
pub mod vtu;
pub mod write;
pub mod write_gltf;

pub use read::{FORMATS, Format, RawScene, ReadError, read_raw, read_scene};
pub use write::{OUTPUTS, Output, WriteError, WriteOptions, write, writer_for};

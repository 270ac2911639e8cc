//! Files: what is read and what is written. Nothing above this module knows of a format.

pub mod read;
pub mod unit;

pub use read::{FORMATS, Format, RawScene, ReadError, read_raw};

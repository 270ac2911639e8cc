//! Files: what Hatbox reads and writes.

pub mod atomic;
pub mod npy;
pub mod npz;

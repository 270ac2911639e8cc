//! How long work reports where it is and learns that it should stop.
//!
//! The library prints nothing; whoever runs it passes a [`Progress`] and draws what it likes.

/// The work was asked to stop; nothing it would have produced exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// A listener to long work. Methods are called from many threads.
pub trait Progress: Sync {
    /// A stage of `total` steps begins.
    fn begin(&self, _stage: &'static str, _total: u64) {}
    /// `steps` more are done.
    fn advance(&self, _steps: u64) {}
    /// The stage is over.
    fn end(&self) {}
    /// Whether the work should stop as soon as it can.
    fn interrupted(&self) -> bool {
        false
    }
}

/// Listens to nothing, never interrupts.
#[derive(Debug, Clone, Copy)]
pub struct Silent;

impl Progress for Silent {}

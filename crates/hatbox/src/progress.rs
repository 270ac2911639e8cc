//! How long work reports where it is, learns that it should stop, and goes on where it was stopped.
//!
//! The library prints nothing; whoever runs it passes a [`Progress`] and draws what it likes.

/// The work was asked to stop; nothing it would have produced exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// A listener to long work. Methods are called from many threads; a stage may begin and end within another.
pub trait Progress: Sync {
    /// A stage of `total` steps begins.
    fn begin(&self, _stage: &'static str, _total: u64) {}
    /// `steps` more are done.
    fn advance(&self, _steps: u64) {}
    /// The stage is over.
    fn end(&self) {}
    /// Something that does not stop the work, but that whoever waits for it wants to know at once.
    fn warn(&self, _text: &str) {}
    /// Whether the work should stop as soon as it can.
    fn interrupted(&self) -> bool {
        false
    }
    /// What an earlier run of the same work kept of a step of the stage that has begun.
    fn recall(&self, _step: u64) -> Option<Vec<u8>> {
        None
    }
    /// A step of the stage is done, and this is what it has found: whoever can, keeps it for another run.
    fn keep(&self, _step: u64, _bytes: &[u8]) {}
    /// Whether [`keep`](Self::keep) does anything.
    fn keeps(&self) -> bool {
        false
    }
}

impl<P: Progress + ?Sized> Progress for &P {
    fn begin(&self, stage: &'static str, total: u64) {
        (**self).begin(stage, total);
    }
    fn advance(&self, steps: u64) {
        (**self).advance(steps);
    }
    fn end(&self) {
        (**self).end();
    }
    fn warn(&self, text: &str) {
        (**self).warn(text);
    }
    fn interrupted(&self) -> bool {
        (**self).interrupted()
    }
    fn recall(&self, step: u64) -> Option<Vec<u8>> {
        (**self).recall(step)
    }
    fn keep(&self, step: u64, bytes: &[u8]) {
        (**self).keep(step, bytes);
    }
    fn keeps(&self) -> bool {
        (**self).keeps()
    }
}

/// A stage that has begun, and ends when this is dropped, where the work is interrupted as well.
#[must_use]
pub struct Stage<'a>(&'a dyn Progress);

impl<'a> Stage<'a> {
    /// Begins a stage of `total` steps.
    pub fn begin(progress: &'a dyn Progress, name: &'static str, total: u64) -> Self {
        progress.begin(name, total);
        Self(progress)
    }
}

impl Drop for Stage<'_> {
    fn drop(&mut self) {
        self.0.end();
    }
}

/// Listens to nothing, never interrupts.
#[derive(Debug, Clone, Copy)]
pub struct Silent;

impl Progress for Silent {}

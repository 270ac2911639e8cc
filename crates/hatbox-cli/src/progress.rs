//! Bars on standard error for the stages of long work.

use crate::interrupt;
use hatbox::progress::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::sync::RwLock;
use std::time::Duration;

/// The stage whose number of steps is a limit and not an expectation: it is counted, not measured.
const COUNTED: &str = "solving";

/// A bar with the expected time for each stage; nothing where standard error is no terminal.
pub(crate) struct Bars {
    visible: bool,
    bar: RwLock<Option<ProgressBar>>,
}

impl Bars {
    pub(crate) fn new(visible: bool) -> Self {
        Self { visible, bar: RwLock::new(None) }
    }

    fn replace(&self, bar: Option<ProgressBar>) {
        if let Ok(mut current) = self.bar.write()
            && let Some(old) = std::mem::replace(&mut *current, bar)
        {
            old.finish_and_clear();
        }
    }
}

impl Progress for Bars {
    fn begin(&self, stage: &'static str, total: u64) {
        let bar = if stage == COUNTED { ProgressBar::no_length() } else { ProgressBar::new(total) };
        bar.set_draw_target(if self.visible { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() });
        bar.set_style(look(stage));
        bar.set_message(stage);
        bar.enable_steady_tick(Duration::from_millis(100));
        self.replace(Some(bar));
    }

    fn advance(&self, steps: u64) {
        if let Ok(bar) = self.bar.read()
            && let Some(bar) = &*bar
        {
            bar.inc(steps);
        }
    }

    fn end(&self) {
        self.replace(None);
    }

    fn interrupted(&self) -> bool {
        interrupt::asked()
    }
}

fn look(stage: &str) -> ProgressStyle {
    let template = match stage {
        COUNTED => "{spinner} {msg}, iteration {pos}",
        _ => "{msg:>20} {wide_bar:.cyan/blue} {percent:>3} %  {eta:>4} left",
    };
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

//! Where long work is, on standard error: bars in a terminal; elsewhere, as in a log, a line now and then.

use crate::interrupt;
use crate::output::note;
use hatbox::progress::Progress;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, stderr};
use std::sync::RwLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// The stage whose number of steps is a limit and not an expectation: it is counted, not measured.
const COUNTED: &str = "solving";
/// Time from line to line at the least, and as a share of all that has passed.
const PAUSE: Duration = Duration::from_secs(30);
const PATIENCE: u64 = 10;

/// The stage that work is in, with the time that it is expected to take.
pub(crate) struct Bars {
    shows: bool,
    /// Time from line to line at the least, where there is no terminal.
    pause: Option<Duration>,
    started: Instant,
    /// Seconds after the start when the next line is due.
    due: AtomicU64,
    bar: RwLock<Option<ProgressBar>>,
}

impl Bars {
    /// Shows something or nothing.
    pub(crate) fn new(shows: bool) -> Self {
        Self::with_pause(shows, (shows && !stderr().is_terminal()).then_some(PAUSE))
    }

    fn with_pause(shows: bool, pause: Option<Duration>) -> Self {
        let due = AtomicU64::new(pause.map_or(u64::MAX, |pause| pause.as_secs()));
        Self { shows, pause, started: Instant::now(), due, bar: RwLock::new(None) }
    }

    fn replace(&self, bar: Option<ProgressBar>) {
        if let Ok(mut current) = self.bar.write()
            && let Some(old) = std::mem::replace(&mut *current, bar)
        {
            old.finish_and_clear();
        }
    }

    /// Whether a line is due, to one of those who ask.
    fn is_due(&self) -> bool {
        let (now, due) = (self.started.elapsed().as_secs(), self.due.load(Ordering::Relaxed));
        let next = now + self.pause.map_or(0, |pause| pause.as_secs()).max(now / PATIENCE);
        now >= due && self.due.compare_exchange(due, next, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }
}

impl Progress for Bars {
    fn begin(&self, stage: &'static str, total: u64) {
        let bar = if stage == COUNTED { ProgressBar::no_length() } else { ProgressBar::new(total) };
        let drawn = self.shows && self.pause.is_none();
        bar.set_draw_target(if drawn { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() });
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
            if self.is_due() {
                note(&line(bar));
            }
        }
    }

    fn end(&self) {
        self.replace(None);
    }

    fn interrupted(&self) -> bool {
        interrupt::asked()
    }
}

/// What a bar says, in words.
fn line(bar: &ProgressBar) -> String {
    let (stage, done) = (bar.message(), bar.position());
    match bar.length() {
        Some(all) => {
            let percent = 100 * done.min(all) / all.max(1);
            format!("{stage}: {percent} %, about {} left", HumanDuration(bar.eta()))
        }
        None => format!("{stage}: iteration {done}"),
    }
}

fn look(stage: &str) -> ProgressStyle {
    let template = match stage {
        COUNTED => "{spinner} {msg}, iteration {pos}",
        _ => "{msg:>20} {wide_bar:.cyan/blue} {percent:>3} %  {eta:>4} left",
    };
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_terminal_a_line_tells_where_work_is() {
        let bars = Bars::with_pause(true, Some(Duration::ZERO));
        bars.begin("casting rays", 400);
        bars.advance(100);
        let text = |bars: &Bars| line(bars.bar.read().expect("no panics").as_ref().expect("a stage"));
        let words = text(&bars);
        assert!(words.starts_with("casting rays: 25 %, about ") && words.ends_with(" left"), "{words}");
        bars.begin(COUNTED, 1000);
        bars.advance(3);
        assert_eq!(text(&bars), "solving: iteration 3");
    }

    #[test]
    fn lines_come_now_and_then() {
        assert!(Bars::with_pause(true, Some(Duration::ZERO)).is_due());
        assert!(!Bars::with_pause(true, Some(PAUSE)).is_due());
        assert!(!Bars::with_pause(true, None).is_due() && !Bars::with_pause(false, None).is_due());
        let late = Bars::with_pause(true, Some(PAUSE));
        late.due.store(0, Ordering::Relaxed);
        assert!(late.is_due());
        assert!(!late.is_due(), "one line is enough");
    }
}

//! Where long work is, on standard error: bars in a terminal; elsewhere, as in a log, a line now and then.

use crate::{interrupt, output};
use hatbox::progress::Progress;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, stderr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, RwLock};
use std::time::{Duration, Instant};

/// The stage whose number of steps is a limit and not an expectation: it is counted, not measured.
const COUNTED: &str = "solving";
/// Time from line to line at the least.
const PAUSE: Duration = Duration::from_secs(30);
/// From line to line this part of all that has passed goes by: a long log stays short.
const PART: f64 = 0.1;
/// Before so much of a stage has passed nobody can tell how long it takes; steps that were kept by an earlier run are taken in at
/// its beginning.
const TELLING: Duration = Duration::from_secs(2);

/// The stage that work is in, with the time that it is expected to take; of stages within others, the innermost.
pub(crate) struct Bars {
    shows: bool,
    /// Time from line to line at the least, where there is no terminal.
    pause: Option<Duration>,
    telling: Duration,
    say: fn(&str),
    started: Instant,
    /// Milliseconds after the start when the next line is due.
    due: AtomicU64,
    stages: RwLock<Vec<Stage>>,
    warned: Mutex<Vec<String>>,
}

struct Stage {
    name: &'static str,
    bar: ProgressBar,
    /// Steps that were done when a stage within it began: a bar that is cleared counts all.
    done: u64,
    began: Instant,
    /// When its speed is measured from, and the steps that were done then.
    from: Mutex<Option<(Instant, u64)>>,
}

impl Bars {
    /// Shows something or nothing.
    pub(crate) fn new(shows: bool) -> Self {
        Self::with(shows, (shows && !stderr().is_terminal()).then_some(PAUSE), TELLING, output::note)
    }

    fn with(shows: bool, pause: Option<Duration>, telling: Duration, say: fn(&str)) -> Self {
        let due = AtomicU64::new(pause.map_or(u64::MAX, |pause| pause.as_millis() as u64));
        let (stages, warned) = (RwLock::default(), Mutex::default());
        Self { shows, pause, telling, say, started: Instant::now(), due, stages, warned }
    }

    /// What has been warned of.
    pub(crate) fn warned(&self) -> Vec<String> {
        self.warned.lock().map_or_else(|_| Vec::new(), |warned| warned.clone())
    }

    /// The bar of the innermost stage, of which so much is done; only one is drawn at a time.
    fn bar(&self, name: &'static str, total: Option<u64>, done: u64, message: String) -> ProgressBar {
        let bar = total.map_or_else(ProgressBar::no_length, ProgressBar::new).with_position(done);
        let drawn = self.shows && self.pause.is_none();
        bar.set_draw_target(if drawn { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() });
        bar.set_style(look(name));
        bar.set_message(message);
        bar.enable_steady_tick(Duration::from_millis(100));
        bar
    }

    /// Whether a line may be due when so much time has passed.
    fn is_late(&self, passed: Duration) -> bool {
        passed.as_millis() as u64 >= self.due.load(Ordering::Relaxed)
    }

    /// Whether a line is due when so much time has passed, to one of those who ask.
    fn is_due(&self, passed: Duration) -> bool {
        let due = self.due.load(Ordering::Relaxed);
        let next = passed + self.pause.unwrap_or_default().max(passed.mul_f64(PART));
        let [now, next] = [passed, next].map(|time| time.as_millis() as u64);
        now >= due && self.due.compare_exchange(due, next, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }
}

impl Progress for Bars {
    fn begin(&self, stage: &'static str, total: u64) {
        let Ok(mut stages) = self.stages.write() else { return };
        let mut message = stage.to_owned();
        if let Some(outer) = stages.last_mut() {
            outer.done = outer.bar.position();
            let iteration = if outer.name == COUNTED { format!(", iteration {}", outer.done) } else { String::new() };
            message = format!("{}{iteration}: {stage}", outer.bar.message());
            outer.bar.finish_and_clear();
        }
        let bar = self.bar(stage, (stage != COUNTED).then_some(total), 0, message);
        stages.push(Stage { name: stage, bar, done: 0, began: Instant::now(), from: Mutex::default() });
    }

    fn advance(&self, steps: u64) {
        if let Ok(stages) = self.stages.read()
            && let Some(stage) = stages.last()
        {
            stage.bar.inc(steps);
            if self.pause.is_some()
                && self.is_late(self.started.elapsed())
                && let Some(line) = stage.line(self.telling)
                && self.is_due(self.started.elapsed())
            {
                (self.say)(&line);
            }
        }
    }

    fn end(&self) {
        if let Ok(mut stages) = self.stages.write() {
            if let Some(stage) = stages.pop() {
                stage.bar.finish_and_clear();
            }
            if let Some(outer) = stages.last_mut() {
                outer.bar = self.bar(outer.name, outer.bar.length(), outer.done, outer.bar.message());
            }
        }
    }

    fn warn(&self, text: &str) {
        let warning = [text.to_owned()];
        match self.stages.read().as_ref().map(|stages| stages.last()) {
            Ok(Some(stage)) => stage.bar.suspend(|| output::warn(&warning)),
            _ => output::warn(&warning),
        }
        if let Ok(mut warned) = self.warned.lock() {
            warned.extend(warning);
        }
    }

    fn interrupted(&self) -> bool {
        interrupt::asked()
    }
}

impl Stage {
    /// Where the stage is, in words, once that can be told.
    fn line(&self, telling: Duration) -> Option<String> {
        let (stage, done) = (self.bar.message(), self.bar.position());
        let Some(all) = self.bar.length() else { return Some(format!("{stage}: iteration {done}")) };
        if self.began.elapsed() < telling {
            return None;
        }
        let mut from = self.from.lock().ok()?;
        let &mut (since, first) = from.get_or_insert((Instant::now(), done));
        let steps = done.checked_sub(first).filter(|&steps| steps > 0)?;
        let left = remaining(since.elapsed(), steps, all.saturating_sub(done));
        Some(format!("{stage}: {} %, about {} left", 100 * done.min(all) / all.max(1), HumanDuration(left)))
    }
}

/// How long the missing steps will take if so many took so long.
fn remaining(passed: Duration, steps: u64, missing: u64) -> Duration {
    passed.mul_f64(missing as f64 / steps as f64)
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

    static SAID: Mutex<Vec<String>> = Mutex::new(Vec::new());

    #[test]
    fn without_a_terminal_lines_tell_where_work_is() {
        let say = |text: &str| SAID.lock().expect("no panics").push(text.to_owned());
        let bars = Bars::with(true, Some(Duration::ZERO), Duration::ZERO, say);
        bars.begin("casting rays", 400);
        // Kept by an earlier run: their speed is not that of the others, and nothing is known of it yet.
        bars.advance(100);
        bars.advance(1);
        bars.due.store(0, Ordering::Relaxed);
        bars.end();
        bars.begin(COUNTED, 1000);
        bars.advance(3);
        let said = SAID.lock().expect("no panics");
        let [rays, solving] = &said[..] else { panic!("{said:?}") };
        assert!(rays.starts_with("casting rays: 25 %, about ") && rays.ends_with(" left"), "{rays}");
        assert_eq!(solving, "solving: iteration 3");
    }

    /// Rays that are cast again while the equation is solved: iterations were counted no more after the first.
    #[test]
    fn a_stage_goes_on_after_one_within_it() {
        let bars = Bars::with(false, None, Duration::ZERO, |_| ());
        let current = || {
            let stages = bars.stages.read().expect("no panics");
            stages.last().map(|stage| (stage.bar.message(), stage.bar.position()))
        };
        bars.begin("estimating the error", 3);
        bars.advance(1);
        bars.begin(COUNTED, 1000);
        bars.advance(2);
        bars.begin("casting rays again", 50);
        bars.advance(7);
        assert_eq!(current(), Some(("estimating the error: solving, iteration 2: casting rays again".to_owned(), 7)));
        bars.end();
        bars.advance(1);
        assert_eq!(current(), Some(("estimating the error: solving".to_owned(), 3)));
        bars.end();
        assert_eq!(current(), Some(("estimating the error".to_owned(), 1)));
        bars.end();
        assert_eq!(current(), None);
    }

    #[test]
    fn what_is_left_takes_as_long_as_what_was_done() {
        assert_eq!(remaining(Duration::from_secs(10), 20, 60), Duration::from_secs(30));
        assert_eq!(remaining(Duration::from_secs(10), 20, 0), Duration::ZERO);
    }

    #[test]
    fn lines_come_now_and_then() {
        let bars = |shows: bool, pause: Option<Duration>| Bars::with(shows, pause, Duration::ZERO, |_| ());
        let late = 20 * PAUSE;
        assert!(!bars(true, None).is_due(late) && !bars(false, None).is_due(late));
        let bars = bars(true, Some(PAUSE));
        assert!(!bars.is_due(PAUSE / 2));
        assert!(bars.is_due(PAUSE));
        assert!(!bars.is_due(PAUSE), "one line is enough");
        assert!(!bars.is_due(PAUSE + PAUSE / 2) && bars.is_due(late));
        // A tenth of what has passed is twice the pause.
        assert!(!bars.is_due(late + PAUSE) && bars.is_due(late + 2 * PAUSE));
    }
}

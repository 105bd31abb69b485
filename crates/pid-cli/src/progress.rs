//! Progress on standard error, and requests to stop.

use std::fmt::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};

/// A line that shows the current step and, from two seconds on, the time left; hidden when standard error
/// is not a terminal.
pub struct Progress {
    bar: ProgressBar,
    started: Instant,
    /// How long the whole takes, as far as is known.
    whole: Arc<Mutex<Option<Duration>>>,
}

/// A run this short needs no time left; nor is a shorter time left worth a word.
const SHORT: Duration = Duration::from_secs(2);
/// Below this share of the whole the time left is a guess.
const LITTLE: f64 = 0.02;

impl Progress {
    /// Shows a first step.
    pub fn start(what: &str) -> Self {
        let bar = ProgressBar::new_spinner();
        let whole = Arc::new(Mutex::new(None));
        let known = whole.clone();
        let left = move |state: &ProgressState, out: &mut dyn Write| {
            let whole = known.lock().ok().and_then(|whole| *whole);
            // A line that cannot be formatted shows nothing.
            let _ = out.write_str(&left(whole, state.elapsed()));
        };
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} [{elapsed}{left}]") {
            bar.set_style(style.with_key("left", left));
        }
        bar.enable_steady_tick(Duration::from_millis(120));
        bar.set_message(what.to_owned());
        Progress {
            bar,
            started: Instant::now(),
            whole,
        }
    }

    /// Shows the current step.
    pub fn step(&self, what: impl Into<String>) {
        self.bar.set_message(what.into());
    }

    /// Says how much of the whole is done, from 0 to 1; the time left follows from it.
    pub fn done(&self, share: f64) {
        if let Ok(mut whole) = self.whole.lock() {
            *whole = expected(self.started.elapsed(), share);
        }
    }

    /// Prints a result above the progress.
    pub fn result(&self, text: &str) {
        self.bar.suspend(|| crate::output::print(text));
    }

    /// Prints a line above the progress.
    pub fn line(&self, text: &str) {
        self.bar.suspend(|| crate::output::message(text));
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// How long the whole takes where a share of it took so long; `None` where the share tells too little.
fn expected(elapsed: Duration, share: f64) -> Option<Duration> {
    (share > LITTLE && share <= 1.0).then(|| elapsed.div_f64(share))
}

/// The time left in words, with what parts it from the time before it.
fn left(whole: Option<Duration>, elapsed: Duration) -> String {
    let left = whole.map_or(Duration::ZERO, |whole| whole.saturating_sub(elapsed));
    match left.as_secs() {
        _ if elapsed < SHORT || left < SHORT => String::new(),
        seconds @ 0..90 => format!(", about {seconds} s left"),
        seconds @ 90..5400 => format!(", about {} min left", (seconds + 30) / 60),
        seconds => format!(", about {} h left", (seconds + 1800) / 3600),
    }
}

/// Set by the first Ctrl-C, SIGTERM or SIGHUP: finish the iteration and keep its result. The second one ends the
/// program at once.
#[derive(Clone, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens to Ctrl-C, SIGTERM and SIGHUP. If that is not possible, the program can still be ended, but keeps
    /// nothing.
    pub fn listen() -> Self {
        let interrupt = Interrupt::default();
        let flag = interrupt.clone();
        let listening = ctrlc::set_handler(move || {
            if flag.0.swap(true, Ordering::Relaxed) {
                std::process::exit(130);
            }
            crate::output::message("stopping after this iteration; once more ends at once");
        });
        if let Err(e) = listening {
            crate::output::message(&format!("Ctrl-C will not be waited for: {e}"));
        }
        interrupt
    }

    /// Whether the user asked to stop.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_follows_from_the_share_that_is_done() {
        let after = |seconds: f64, share: f64, now: f64| {
            let whole = expected(Duration::from_secs_f64(seconds), share);
            left(whole, Duration::from_secs_f64(now))
        };
        assert_eq!(after(10.0, 0.25, 10.0), ", about 30 s left");
        // Between two steps the clock runs on.
        assert_eq!(after(10.0, 0.25, 25.0), ", about 15 s left");
        assert_eq!(after(60.0, 0.1, 60.0), ", about 9 min left");
        assert_eq!(after(3600.0, 0.25, 3600.0), ", about 3 h left");
        for nothing in [
            after(1.0, 0.1, 1.0),
            after(10.0, 0.25, 60.0),
            after(10.0, 0.001, 10.0),
            after(10.0, 1.0, 10.0),
        ] {
            assert_eq!(nothing, "");
        }
    }
}

//! Progress on standard error, and Ctrl-C.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// A line that shows the current step; hidden when standard error is not a terminal.
pub struct Progress(ProgressBar);

impl Progress {
    /// Shows a first step.
    pub fn start(what: &str) -> Self {
        let bar = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} [{elapsed}]") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(120));
        bar.set_message(what.to_owned());
        Progress(bar)
    }

    /// Shows the current step.
    pub fn step(&self, what: impl Into<String>) {
        self.0.set_message(what.into());
    }

    /// Prints a result above the progress.
    pub fn result(&self, text: &str) {
        self.0.suspend(|| crate::output::print(text));
    }

    /// Prints a line above the progress.
    pub fn line(&self, text: &str) {
        self.0.suspend(|| crate::output::message(text));
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Set by the first Ctrl-C: finish the iteration and keep its result. The second one ends the
/// program at once.
#[derive(Clone, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens to Ctrl-C. If that is not possible, the program can still be ended, but keeps
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

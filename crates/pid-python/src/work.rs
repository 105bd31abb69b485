//! Work beside Python: on a thread of its own, told to stop by Ctrl-C.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use simtrue::diagnosis::search::Listener;

use crate::error::raised;

/// How long the calling thread waits before it looks for signals: hardly felt by a person.
const LOOK: Duration = Duration::from_millis(50);
/// Stack of the work, bytes: that of a main thread.
const STACK: usize = 8 << 20;

/// What a running work tells, and whether it shall stop.
pub(crate) struct Watch {
    steps: Mutex<Sender<News>>,
    stop: AtomicBool,
}

enum News {
    Step(String),
    End,
}

impl Listener for Watch {
    fn step(&self, what: &str) {
        if let Ok(steps) = self.steps.lock() {
            // A caller that has gone does not listen any more.
            let _ = steps.send(News::Step(what.to_owned()));
        }
    }

    fn stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Tells the calling thread that the work has ended, even by a panic.
struct AtEnd(Arc<Watch>);

impl Drop for AtEnd {
    fn drop(&mut self) {
        if let Ok(steps) = self.0.steps.lock() {
            let _ = steps.send(News::End);
        }
    }
}

/// Whether a work ends soon with what it has when it is told to stop.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stops {
    /// It does; a second Ctrl-C leaves it behind.
    WithWhatItHas,
    /// It does not: it is left behind.
    Never,
}

/// Runs a work while Python is released. `step`, if not `None`, is called with each of its steps. The
/// result, and whether Ctrl-C cut it short.
///
/// # Errors
/// That of the work; what a signal handler or `step` raises.
pub(crate) fn run<T: Send + 'static, E: std::fmt::Display + Send + 'static>(
    py: Python<'_>,
    stops: Stops,
    step: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Arc<Watch>) -> Result<T, E> + Send + 'static,
) -> PyResult<(T, bool)> {
    let (send, mut news) = channel();
    let watch = Arc::new(Watch {
        steps: Mutex::new(send),
        stop: AtomicBool::new(false),
    });
    let own = watch.clone();
    let thread = thread::Builder::new()
        .name("simtrue".to_owned())
        .stack_size(STACK)
        .spawn(move || {
            let _end = AtEnd(own.clone());
            work(&own)
        })
        .map_err(raised)?;
    let mut cut = false;
    loop {
        let told;
        (news, told) = py.detach(move || {
            let told = news.recv_timeout(LOOK);
            (news, told)
        });
        let heard = match told {
            Ok(News::End) | Err(RecvTimeoutError::Disconnected) => break,
            Ok(News::Step(what)) => match step {
                Some(step) => step.call1((what,)).map(drop),
                None => Ok(()),
            },
            Err(RecvTimeoutError::Timeout) => Ok(()),
        };
        if let Err(error) = heard.and_then(|()| py.check_signals()) {
            watch.stop.store(true, Ordering::Relaxed);
            let waits = stops == Stops::WithWhatItHas && !cut;
            if !waits || !error.is_instance_of::<PyKeyboardInterrupt>(py) {
                return Err(error);
            }
            cut = true;
        }
    }
    match py.detach(|| thread.join()) {
        Ok(Ok(result)) => Ok((result, cut)),
        // Too early for a result.
        Ok(Err(_)) if cut => Err(PyKeyboardInterrupt::new_err(())),
        Ok(Err(error)) => Err(raised(error)),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
            Err(raised(format!(
                "simtrue failed on this input: {}\n  help: this is a fault of simtrue, please report it with the input",
                text.unwrap_or("no message")
            )))
        }
    }
}

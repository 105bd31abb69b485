//! How a search tells what it does, and how it is asked to stop.

use std::sync::Arc;

/// Hears of the steps of a search and may ask it to stop.
pub trait Listener: Send + Sync {
    /// The search begins a step.
    fn step(&self, what: &str);
    /// Whether the search shall end with what it has.
    fn stop(&self) -> bool {
        false
    }
}

/// The listener of a search; by default there is none.
#[derive(Clone, Default)]
pub struct Watch(Option<Arc<dyn Listener>>);

impl Watch {
    /// With a listener.
    pub fn new(listener: Arc<dyn Listener>) -> Self {
        Watch(Some(listener))
    }

    pub(crate) fn step(&self, what: &str) {
        if let Some(listener) = &self.0 {
            listener.step(what);
        }
    }

    pub(crate) fn stopped(&self) -> bool {
        self.0.as_ref().is_some_and(|listener| listener.stop())
    }
}

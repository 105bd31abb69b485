//! The models that can be named: those of the program, then those of `pid-models`.

use std::sync::OnceLock;

use pid_models::{Entry, UnknownModel};

static OWN: OnceLock<&'static [Entry]> = OnceLock::new();

/// Takes the models of the program; the first call counts.
pub(crate) fn add(own: &'static [Entry]) {
    OWN.get_or_init(|| own);
}

/// All of them.
pub(crate) fn all() -> Vec<Entry> {
    let own = OWN.get().copied().unwrap_or_default();
    own.iter().copied().chain(pid_models::all()).collect()
}

/// The one with this name.
pub(crate) fn by_name(name: &str) -> Result<Entry, UnknownModel> {
    pid_models::find(&all(), name)
}

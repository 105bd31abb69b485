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

/// The model with this name, of the program's own or of those that `simtrue models` lists.
///
/// # Errors
/// If there is none; the message names those that are nearest.
pub fn by_name(name: &str) -> Result<Entry, UnknownModel> {
    pid_models::find(&all(), name)
}

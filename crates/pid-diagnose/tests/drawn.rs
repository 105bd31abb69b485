//! Cases of the project's own generator, for what a clone without measured records can test.

use std::path::{Path, PathBuf};

use pid_withheld::{Drawing, Kind, Plan, Truth, lay_out};

/// One-joint robots; their causes are drawn.
const PLAN: Plan = Plan {
    seed: 7,
    cases: 500,
    fewest: 1,
    joints: 1,
    causes: Drawing::All,
};

/// A drawn case in a folder that goes with it.
pub(crate) struct Drawn {
    folder: PathBuf,
    pub(crate) truth: Truth,
}

impl Drawn {
    pub(crate) fn folder(&self) -> &Path {
        self.folder.as_path()
    }
}

impl Drop for Drawn {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(self.folder.ancestors().nth(2).unwrap_or(&self.folder));
    }
}

/// The first case of the plan with stated noise and measured velocities whose cause, or absence of
/// one, is as asked for.
pub(crate) fn first(what: &str, wanted: impl Fn(Option<&Kind>) -> bool) -> Drawn {
    let fits = |truth: &Truth| {
        let known = truth.noise_stated && truth.velocity == "measured";
        known && truth.causes.len() < 2 && wanted(truth.causes.first().map(|c| &c.kind))
    };
    let index = (0..PLAN.cases).find(|&i| PLAN.truth(i).is_ok_and(|t| fits(&t)));
    let index = index.unwrap_or_else(|| panic!("no case of the plan is {what}"));
    let root = std::env::temp_dir().join(format!("pid-drawn-{what}-{}", std::process::id()));
    let folder = lay_out(&PLAN, index, &root).expect("a case");
    let truth = PLAN.truth(index).expect("a case");
    Drawn { folder, truth }
}

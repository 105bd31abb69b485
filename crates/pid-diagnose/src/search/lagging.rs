//! A lag that a velocity reading shows by itself.

use super::settings::Settings;
use crate::case::Case;
use crate::channel;
use crate::diagnosis::{Magnitude, Named};
use crate::effect::Term;

/// A derived velocity that does not follow from its positions as stated.
#[derive(Debug)]
pub(super) struct Lagging {
    pub(super) term: Term,
    pub(super) constant: Magnitude,
    /// Mismatch of reading and positions without the lag over that with it.
    pub(super) ratio: f64,
}

impl Lagging {
    /// The joint whose reading is furthest from its positions, if there is one, with the effect of
    /// the library that is a lag of the reading and nothing else.
    pub(super) fn find(case: &Case, settings: &Settings) -> Option<Self> {
        let effect = settings
            .effects
            .iter()
            .find(|e| e.info().parameters.len() == 1 && e.plain().velocity_lag(&[1.0]).is_some())?;
        let [constant] = effect.info().parameters else {
            return None;
        };
        channel::consistency(case, &settings.criteria)
            .into_iter()
            .enumerate()
            .filter_map(|(joint, c)| c.filter(|c| c.lagging).map(|c| (joint, c)))
            .max_by(|a, b| a.1.mismatch.total_cmp(&b.1.mismatch))
            .map(|(joint, c)| Lagging {
                term: Term {
                    effect: effect.clone(),
                    joint,
                },
                constant: Magnitude {
                    name: constant.name.to_owned(),
                    value: c.lag,
                    unit: constant.si.to_owned(),
                    std: c.lag_std,
                },
                ratio: c.mismatch / c.with_lag.max(1e-12),
            })
    }

    pub(super) fn named(&self) -> Named {
        let info = self.term.effect.info();
        Named {
            effect: info.id.to_owned(),
            joint: self.term.shown_joint(),
            parameters: vec![self.constant.clone()],
            regime: info.regime.to_owned(),
            share: None,
            share_interval: None,
        }
    }
}

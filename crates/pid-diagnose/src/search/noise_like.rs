//! Whether what a model leaves is noise.

use super::whiteness::LAGS;
use crate::criteria::Criteria;
use crate::diagnosis::Residue;
use crate::gap::Floor;

/// Whether innovations have lines or bursts that noise has not.
pub(super) fn lines_and_bursts(criteria: &Criteria, left: &Residue) -> bool {
    let burst = criteria.allowance * criteria.burst(left.of.samples, left.of.windows);
    !(left.line < criteria.line(left.of.frequencies) && left.burst < burst)
}

/// Whether innovations remember their neighbours: the level of the noise was taken from records
/// that hold something else too. Beyond chance and of a size.
fn remember(criteria: &Criteria, left: &Residue) -> bool {
    left.memory > criteria.allowance * criteria.memory(LAGS as f64)
        && left.correlation > criteria.correlation
}

/// What a model leaves.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leaves {
    /// Gap on the test records.
    pub(super) gap: f64,
    /// What noise alone leaves of it.
    pub(super) floor: Floor,
    /// Mean squared innovation, of the nominal structure and of the model.
    pub(super) misfit: (f64, f64),
    /// Lines, bursts and memory of its innovations.
    pub(super) residue: Residue,
    /// Whether the noise is stated.
    pub(super) stated: bool,
    /// Whether the model has a contact or a resonance: their substeps leave memory.
    pub(super) stiff: bool,
}

impl Leaves {
    /// Whether something is left that neither noise nor the model explains; `named`: the model has effects.
    pub(super) fn unexplained(&self, named: bool, criteria: &Criteria) -> bool {
        if named {
            self.beside_effects(criteria)
        } else {
            self.beside_nothing(criteria)
        }
    }

    /// Whether innovations are as large as noise and have neither lines nor bursts.
    fn noise_like(&self, criteria: &Criteria) -> bool {
        self.misfit.1 < criteria.calm && !lines_and_bursts(criteria, &self.residue)
    }

    /// Nothing that is named has to be excused: the nominal structure must leave no more than noise.
    fn beside_nothing(&self, criteria: &Criteria) -> bool {
        let (typical, largest) = if self.noise_like(criteria) && self.stated {
            (criteria.unexplained, criteria.near)
        } else {
            (criteria.near, criteria.nominal_spread)
        };
        self.gap > (typical * self.floor.typical).max(largest * self.floor.largest)
            || self.misfit.1 > criteria.nominal_misfit
            || lines_and_bursts(criteria, &self.residue)
            || remember(criteria, &self.residue)
    }

    fn beside_effects(&self, criteria: &Criteria) -> bool {
        // Free runs from uncertain starts drift; innovations that are noise speak for the model.
        let factor = if self.noise_like(criteria) {
            criteria.calm_factor
        } else {
            1.0
        };
        let allowed = (criteria.unexplained * factor * self.floor.typical)
            .max(criteria.near * self.floor.largest);
        let (nominal, misfit) = self.misfit;
        let nearly_all =
            (misfit - 1.0).max(criteria.negligible) < criteria.negligible * (nominal - 1.0);
        let coloured = self.residue.line
            > criteria.allowance * criteria.line(self.residue.of.frequencies)
            || self.residue.burst > criteria.effect_burst
            || (!self.stiff && remember(criteria, &self.residue));
        self.gap > allowed || misfit > criteria.largest_misfit || (!nearly_all && coloured)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::Extent;

    /// Noise and nothing else.
    const QUIET: Leaves = Leaves {
        gap: 0.010,
        floor: Floor {
            typical: 0.010,
            largest: 0.011,
        },
        misfit: (1.0, 1.0),
        residue: Residue {
            burst: 2.0,
            line: 8.0,
            hum: 8.0,
            of: Extent {
                frequencies: 420.0,
                windows: 175.0,
                samples: 20.0,
            },
            memory: 1.0,
            correlation: 0.01,
            unseen: 1.0,
        },
        stated: true,
        stiff: false,
    };

    fn with(change: impl Fn(&mut Leaves)) -> Leaves {
        let mut leaves = QUIET;
        change(&mut leaves);
        leaves
    }

    #[test]
    fn lines_and_bursts_of_a_contact_do_not_count_where_it_explains_nearly_all() {
        let criteria = Criteria::default();
        let contact = with(|l| (l.misfit, l.residue.line) = ((400.0, 1.5), 60.0));
        assert!(!contact.unexplained(true, &criteria));
        // The same lines beside a cause of which a twentieth is left.
        let half = with(|l| (l.misfit, l.residue.line) = ((10.0, 1.45), 60.0));
        assert!(half.unexplained(true, &criteria));
        // More than the noise in all is never explained.
        let much = with(|l| l.misfit = (400.0, 1.7));
        assert!(much.unexplained(true, &criteria));
    }

    #[test]
    fn nothing_is_missing_only_where_nothing_but_noise_is_left() {
        let criteria = Criteria::default();
        assert!(!QUIET.unexplained(false, &criteria));
        for loud in [
            with(|l| l.gap = 0.020),
            with(|l| l.misfit = (1.3, 1.3)),
            with(|l| l.residue.line = 13.0),
            with(|l| l.residue.burst = 7.0),
            with(|l| (l.residue.memory, l.residue.correlation) = (12.0, 0.07)),
        ] {
            assert!(loud.unexplained(false, &criteria), "{loud:?}");
        }
        // A level that was taken from the records themselves excuses less.
        let drifting = with(|l| l.gap = 0.018);
        assert!(!drifting.unexplained(false, &criteria));
        assert!(with(|l| (l.gap, l.stated) = (0.018, false)).unexplained(false, &criteria));
    }

    #[test]
    fn innovations_that_remember_speak_against_what_is_no_contact() {
        let criteria = Criteria::default();
        let remember = |l: &mut Leaves| {
            (l.misfit, l.residue.memory, l.residue.correlation) = ((1.1, 1.0), 17.0, 0.08);
        };
        assert!(with(remember).unexplained(true, &criteria));
        let contact = |l: &mut Leaves| {
            remember(l);
            l.stiff = true;
        };
        assert!(!with(contact).unexplained(true, &criteria));
        // Beyond chance, but of no size.
        let long = |l: &mut Leaves| (l.residue.memory, l.residue.correlation) = (17.0, 0.01);
        assert!(!with(long).unexplained(true, &criteria));
        assert!(!with(long).unexplained(false, &criteria));
    }

    #[test]
    fn white_innovations_excuse_a_drift_of_free_runs_beside_an_effect() {
        let criteria = Criteria::default();
        let drifting = with(|l| (l.gap, l.misfit.0) = (0.030, 5.0));
        assert!(!drifting.unexplained(true, &criteria));
        let coloured = with(|l| (l.gap, l.misfit.0, l.residue.line) = (0.030, 5.0, 13.0));
        assert!(coloured.unexplained(true, &criteria));
    }
}

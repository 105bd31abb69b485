//! How a sample is cut into substeps of the simulation.

use crate::nominal::Nominal;
use crate::simulate::whole;

/// Longest substep, s.
const LONGEST_STEP: f64 = 2.1e-3;
/// Longest substep with a gear, or of a run whose substeps are as short, s.
const LONGEST_SHORT_STEP: f64 = 0.55e-3;
/// Times the substeps that the length asks for, at most, so that drives read at their starts: three are enough for
/// loops of 200, 500 and 1000 Hz in records of 50 to 1000 Hz.
const FINEST: usize = 3;

/// Substeps of a sample: mass matrix and bias of the links at the coarse ones, the rest at the fine ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Substeps {
    /// Coarse substeps per sample.
    coarse: usize,
    /// Fine substeps per coarse one.
    fine: usize,
}

/// How many of the longest substeps, s, a time takes, s.
fn number(time: f64, longest: f64) -> usize {
    ((time / longest - 1e-6).ceil() as usize).max(1)
}

impl Substeps {
    /// For a robot of a description and a sample time, s; `refined` multiplies both. A drive that reads, or takes
    /// targets, at a rate of its own does so at the start of a substep, as far as its rate and that of the record
    /// allow. The fewest substeps do in which all drives do so; the links' mass matrix and bias need them no finer than
    /// without drives.
    pub(crate) fn of(nominal: &Nominal, h: f64, short: bool, refined: usize) -> Self {
        let loops = (0..nominal.n()).filter_map(|j| nominal.description.servo(j));
        let rates = loops.flat_map(|servo| [servo.rate_hz, servo.shaping.rate_hz]);
        let periods: Vec<f64> = rates.flatten().map(f64::recip).collect();
        Self::meeting(&periods, h)
            .unwrap_or_else(|| Self::apart(&periods, h))
            .shortened(h, short)
            .times(refined)
    }

    /// Of all substeps at whose starts drives of these periods, s, read, those that cost least.
    fn meeting(periods: &[f64], h: f64) -> Option<Self> {
        let least = number(h, LONGEST_STEP);
        let most = FINEST * least;
        let all = (least..=most)
            .flat_map(|coarse| (1..=most / coarse).map(move |fine| Self { coarse, fine }));
        let meets = |own: &Self| {
            let step = h / own.number() as f64;
            periods.iter().all(|period| whole(period / step))
        };
        // Links cost about as much as all else in a substep.
        all.filter(meets)
            .min_by_key(|own| own.coarse + own.number())
    }

    /// Substeps for drives of periods, s, that do not fit the sample.
    fn apart(periods: &[f64], h: f64) -> Self {
        let longest = periods.iter().fold(LONGEST_STEP, |longest, period| {
            let number = (period / LONGEST_STEP).ceil();
            match number > 1.0 {
                true => longest.min(period / number),
                false => longest,
            }
        });
        let coarse = number(h, longest);
        // Between readings that come faster a drive is taken to answer at once.
        let fast = periods.iter().any(|&period| period < h / coarse as f64);
        let fine = if fast { FINEST } else { 1 };
        Self { coarse, fine }
    }

    /// Fine ones as short as those of a gear, where they are to be.
    fn shortened(self, h: f64, short: bool) -> Self {
        let times = match short {
            true => number(h / self.number() as f64, LONGEST_SHORT_STEP),
            false => 1,
        };
        Self {
            fine: self.fine * times,
            ..self
        }
    }

    fn times(self, refined: usize) -> Self {
        Self {
            coarse: self.coarse * refined,
            ..self
        }
    }

    /// Fine substeps per sample.
    pub(crate) fn number(self) -> usize {
        self.coarse * self.fine
    }

    /// Time for which the links are evaluated at the fine substep `i` of a sample time, s, if they are.
    pub(crate) fn links(self, h: f64, i: usize) -> Option<f64> {
        i.is_multiple_of(self.fine).then(|| h / self.coarse as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drives_read_at_the_starts_of_substeps() {
        let of = |rates: &[f64], h: f64| {
            let periods: Vec<f64> = rates.iter().map(|rate| 1.0 / rate).collect();
            Substeps::meeting(&periods, h).map(|own| (own.coarse, own.fine))
        };
        // Without drives as the length asks for.
        assert_eq!(of(&[], 0.02), Some((10, 1)));
        assert_eq!(of(&[], 0.001), Some((1, 1)));
        // Twice in a coarse substep of 2 ms.
        assert_eq!(of(&[1000.0], 0.02), Some((10, 2)));
        assert_eq!(of(&[1000.0], 0.005), Some((5, 1)));
        // Every third substep of 5/3 ms, and with a policy of 50 Hz above it.
        assert_eq!(of(&[200.0], 0.02), Some((12, 1)));
        assert_eq!(of(&[50.0, 1000.0], 0.01), Some((5, 2)));
        assert_eq!(of(&[370.0], 0.02), None);
    }

    #[test]
    fn gears_have_short_substeps() {
        let alone = Substeps {
            coarse: 10,
            fine: 1,
        }
        .shortened(0.02, true);
        assert_eq!((alone.coarse, alone.fine), (10, 4));
        let both = Substeps {
            coarse: 10,
            fine: 2,
        }
        .shortened(0.02, true);
        assert_eq!((both.coarse, both.fine), (10, 4));
    }
}

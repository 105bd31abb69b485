/// Smallest and largest value of some data, which an axis shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    low: f64,
    high: f64,
}

impl Default for Range {
    fn default() -> Self {
        Range {
            low: f64::INFINITY,
            high: f64::NEG_INFINITY,
        }
    }
}

impl Range {
    /// The range of values; those that are not finite do not count.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut range = Self::default();
        range.cover(values);
        range
    }

    /// The range of most of the values, see [`cover_most`](Self::cover_most).
    pub fn of_most(values: impl IntoIterator<Item = f64>) -> Self {
        let mut range = Self::default();
        range.cover_most(values);
        range
    }

    /// Widens the range to hold values.
    pub fn cover(&mut self, values: impl IntoIterator<Item = f64>) {
        for v in values.into_iter().filter(|v| v.is_finite()) {
            self.low = self.low.min(v);
            self.high = self.high.max(v);
        }
    }

    /// Widens the range to hold all but the outermost half percent on either side, with half as
    /// much room again: a single impact must not flatten the rest.
    pub fn cover_most(&mut self, values: impl IntoIterator<Item = f64>) {
        let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let (Some(&least), Some(&most)) = (sorted.first(), sorted.last()) else {
            return;
        };
        let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share).round() as usize];
        let (low, high) = (at(0.005), at(0.995));
        let room = 0.5 * (high - low);
        self.cover([least.max(low - room), most.min(high + room)]);
    }

    /// Limited to another range, widened by a share of it.
    pub fn within(self, other: &Range, share: f64) -> Range {
        let room = share * (other.high - other.low);
        if room.is_finite() && room > 0.0 {
            Range {
                low: self.low.max(other.low - room),
                high: self.high.min(other.high + room),
            }
        } else {
            self
        }
    }

    /// Both ends with a margin, a share of the width; never empty: a single value gets room to both sides.
    pub fn span(self, margin: f64) -> (f64, f64) {
        if self.low > self.high {
            return (0.0, 1.0);
        }
        let size = self.high - self.low;
        if size <= 1e-12 * self.low.abs().max(1e-9) {
            let room = 0.5 * self.low.abs().max(1e-3);
            return (self.low - room, self.high + room);
        }
        (self.low - margin * size, self.high + margin * size)
    }
}

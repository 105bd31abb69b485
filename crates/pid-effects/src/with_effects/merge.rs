//! A model's sparse pattern with further places merged in.

use pid_runtime::dynamics::Pattern;

/// The merged pattern: rows, then columns, increasing.
pub(super) struct Merged {
    rows: Vec<u32>,
    cols: Vec<u32>,
    /// Slot of each entry of the model, increasing.
    inner: Vec<usize>,
    /// Slots of the places of each group, in their order.
    groups: Vec<Vec<usize>>,
}

impl Merged {
    /// Merges the places of groups into a pattern whose entries are sorted.
    pub(super) fn new(
        own: Pattern<'_>,
        groups: impl Iterator<Item = Vec<(u32, u32)>> + Clone,
    ) -> Self {
        let own: Vec<(u32, u32)> = own
            .rows
            .iter()
            .zip(own.cols)
            .map(|(&r, &c)| (r, c))
            .collect();
        let mut all = own.clone();
        all.extend(groups.clone().flatten());
        all.sort_unstable();
        all.dedup();
        let slot = |place: &(u32, u32)| {
            let found = all.binary_search(place);
            found.expect("invariant: all places were put in above")
        };
        Self {
            inner: own.iter().map(slot).collect(),
            groups: groups
                .map(|places| places.iter().map(slot).collect())
                .collect(),
            rows: all.iter().map(|p| p.0).collect(),
            cols: all.iter().map(|p| p.1).collect(),
        }
    }

    pub(super) fn pattern(&self) -> Pattern<'_> {
        Pattern {
            rows: &self.rows,
            cols: &self.cols,
        }
    }

    /// Number of the model's entries.
    pub(super) fn own(&self) -> usize {
        self.inner.len()
    }

    pub(super) fn slots(&self) -> &[Vec<usize>] {
        &self.groups
    }

    /// Moves the model's values, written at the front, to their slots; zero elsewhere.
    pub(super) fn spread(&self, values: &mut [f64]) {
        let mut end = self.rows.len();
        for (i, &slot) in self.inner.iter().enumerate().rev() {
            let value = values[i];
            values[slot + 1..end].fill(0.0);
            values[slot] = value;
            end = slot;
        }
        values[..end].fill(0.0);
    }
}

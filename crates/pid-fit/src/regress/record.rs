//! Prepares records for a regression: filtered states, inputs as they act, the rule of decimation.

use pid_data::signal::{
    FilterError, SignalError, acting_inputs, low_pass_channels, state_from_data,
};
use pid_data::{Dataset, Experiment, InputHold};
use pid_runtime::dynamics::At;

use pid_runtime::memory::Memory;

/// The decimation filter cuts off at this share of the rate after decimation.
const PARALLEL: f64 = 0.4;
/// Samples kept per period of the cut-off of the states' filter.
const PER_PERIOD: f64 = 4.0;

/// Settings of the filters.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Filtering {
    /// Cut-off of the states' filter, Hz; `None` takes the one that
    /// [`pid_data::signal::choose_cutoff`] finds.
    pub cutoff: Option<f64>,
    /// Every n-th sample is kept; `None` for four samples per period of the cut-off.
    pub decimate: Option<usize>,
}

/// Filtered samples of one experiment; channels row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Name of the experiment.
    pub name: String,
    /// Number of joints.
    pub nq: usize,
    /// Number of inputs: one per joint, then states of memories.
    pub nu: usize,
    /// Times, s.
    pub t: Vec<f64>,
    /// Positions, rad or m.
    pub q: Vec<f64>,
    /// Velocities.
    pub v: Vec<f64>,
    /// Accelerations.
    pub a: Vec<f64>,
    /// Inputs.
    pub u: Vec<f64>,
    /// Commanded positions, where recorded.
    pub qref: Option<Vec<f64>>,
    /// Cut-off of the states' filter, Hz.
    pub cutoff: f64,
    /// Every n-th sample is kept.
    pub factor: usize,
    /// Cut-off of the decimation filter, Hz; not applied when every sample is kept.
    pub parallel_cutoff: f64,
    /// Samples at either end that are left out: the filters lack neighbours there.
    pub edge: usize,
}

impl Record {
    /// Arguments of a model at sample `i`.
    pub(crate) fn at<'a>(&'a self, i: usize, p: &'a [f64]) -> At<'a> {
        let own = i * self.nq..(i + 1) * self.nq;
        At {
            q: &self.q[own.clone()],
            v: &self.v[own.clone()],
            a: &self.a[own.clone()],
            u: self.inputs(i),
            p,
        }
    }

    /// Inputs at sample `i`.
    pub(crate) fn inputs(&self, i: usize) -> &[f64] {
        &self.u[i * self.nu..(i + 1) * self.nu]
    }

    /// The inputs at sample `i` with no drive: states of memories alone, behind zeros. `u` is as
    /// long as them.
    pub(crate) fn idle(&self, i: usize, u: &mut [f64]) {
        u.fill(0.0);
        u[self.nq..].copy_from_slice(&self.inputs(i)[self.nq..]);
    }

    /// With the states of memories behind the inputs, from the filtered positions.
    pub fn remembering(mut self, memories: &[Memory]) -> Self {
        if memories.is_empty() {
            return self;
        }
        let states: Vec<Vec<f64>> = memories
            .iter()
            .map(|m| m.states(&self.q, self.nq))
            .collect();
        let rows = self.u.chunks_exact(self.nu).enumerate();
        self.u = rows
            .flat_map(|(i, u)| {
                let own = u.iter().copied();
                own.chain(states.iter().map(move |z| z[i]))
                    .collect::<Vec<_>>()
            })
            .collect();
        self.nu += memories.len();
        self
    }

    /// Filters an experiment: Butterworth of order 4 forward and backward for states and inputs,
    /// central differences, and a decimation for which residual and regressor pass the same filter
    /// (IDIM-LS, M. Gautier, IEEE ICRA 1997).
    ///
    /// # Errors
    /// [`SignalError`] for records that are too short, empty channels and impossible cut-offs.
    pub fn new(
        experiment: &Experiment,
        hold: InputHold,
        filtering: Filtering,
    ) -> Result<Self, SignalError> {
        let (n, nq) = (experiment.len(), experiment.nq);
        let state = state_from_data(experiment, filtering.cutoff)?;
        let fault = |error: FilterError| SignalError::Filter {
            experiment: experiment.name.clone(),
            error,
        };
        let acting = acting_inputs(experiment, hold);
        let u = low_pass_channels(&experiment.t, &acting, nq, state.cutoff).map_err(fault)?;
        let step = experiment.sample_time();
        let factor = filtering
            .decimate
            .unwrap_or_else(|| (1.0 / (PER_PERIOD * state.cutoff * step)).floor() as usize)
            .clamp(1, (n / 10).max(1));
        let parallel_cutoff = PARALLEL / (factor as f64 * step);
        let slowest = match factor {
            1 => state.cutoff,
            _ => parallel_cutoff.min(state.cutoff),
        };
        Ok(Self {
            name: experiment.name.clone(),
            nq,
            nu: nq,
            t: experiment.t.clone(),
            q: state.q,
            v: state.v,
            a: state.a,
            u,
            qref: experiment.qref.clone(),
            cutoff: state.cutoff,
            factor,
            parallel_cutoff,
            edge: ((3.0 / (slowest * step)).ceil() as usize).min(n / 10),
        })
    }

    /// All experiments of a data set that a choice takes, with the states of memories.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of(
        dataset: &Dataset,
        filtering: Filtering,
        memories: &[Memory],
        choice: impl Fn(&Experiment) -> bool,
    ) -> Result<Vec<Self>, SignalError> {
        dataset
            .experiments
            .iter()
            .filter(|e| choice(e))
            .map(|e| Ok(Self::new(e, dataset.input_hold, filtering)?.remembering(memories)))
            .collect()
    }

    /// Samples kept, counted from the first of the record.
    pub fn kept(&self) -> impl Iterator<Item = usize> + '_ {
        (self.edge..self.t.len() - self.edge).step_by(self.factor)
    }

    /// The decimation filter on row-by-row channels; nothing where every sample is kept.
    pub(crate) fn parallel(&self, x: Vec<f64>, columns: usize) -> Vec<f64> {
        if self.factor == 1 || columns == 0 {
            return x;
        }
        // The cut-off lies below half the rate by construction. If no filter can be made, the data
        // stay as they are.
        low_pass_channels(&self.t, &x, columns, self.parallel_cutoff).unwrap_or(x)
    }

    /// The filtering in words.
    pub fn in_words(&self) -> String {
        let states = format!(
            "{}: Butterworth of order 4 both ways at {:.1} Hz, central differences",
            self.name, self.cutoff
        );
        match self.factor {
            1 => states,
            n => format!(
                "{states}; residual and regressor at {:.1} Hz, one sample in {n} kept",
                self.parallel_cutoff
            ),
        }
    }
}

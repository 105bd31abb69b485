//! Filtered motion and inputs at a choice of samples of all records.

use pid_data::signal::{acting_inputs, fill_missing, low_pass_channels, state_from_data};
use pid_data::{Dataset, Experiment};

use crate::criteria::{Criteria, Settings};
use crate::wrap;

/// Cut-off of the filters, Hz: above the motion of arms and drives, below most of the noise of a second
/// difference.
const CUTOFF: f64 = 10.0;
/// And at most this share of the rate.
const SHARE: f64 = 0.15;
/// Missing readings in a row from which a stretch is left out; fewer are bridged.
const BRIDGED: usize = 5;
/// A record whose duration over its median step exceeds so many times its rows is not resampled: its time
/// is no time.
const SPARSE: f64 = 20.0;

/// Motion, inputs and velocities, filtered alike without phase shift, at chosen rows.
#[derive(Debug, Clone, Default)]
pub(crate) struct Motion {
    /// Joints.
    pub(crate) n: usize,
    /// Record and row of each point.
    pub(crate) at: Vec<(usize, usize)>,
    /// Positions, points × joints.
    pub(crate) q: Vec<f64>,
    /// Slopes of the positions.
    pub(crate) v: Vec<f64>,
    /// Their slopes.
    pub(crate) a: Vec<f64>,
    /// Inputs as they act.
    pub(crate) u: Vec<f64>,
    /// Velocities as recorded; NaN where there are none.
    pub(crate) dq: Vec<f64>,
    /// Filtered inputs of each record at all rows, rows × joints; empty for records that are left out.
    pub(crate) inputs: Vec<Vec<f64>>,
    /// Median time step of each record, s.
    pub(crate) steps: Vec<f64>,
}

impl Motion {
    /// Samples of all records, about `points` in all.
    pub(crate) fn sample(data: &Dataset, settings: &Settings) -> Self {
        let rows: usize = data.experiments.iter().map(Experiment::len).sum();
        let stride = rows.div_ceil(settings.points.max(1)).max(1);
        let mut out = Self {
            n: data.nq(),
            ..Self::default()
        };
        for (k, e) in data.experiments.iter().enumerate() {
            let filtered = out
                .add(data, k, (e, stride), &settings.criteria)
                .unwrap_or_default();
            out.inputs.push(filtered);
            out.steps.push(e.sample_time());
        }
        out
    }

    /// Adds one record; `None` if it cannot be filtered.
    fn add(
        &mut self,
        data: &Dataset,
        k: usize,
        (e, stride): (&Experiment, usize),
        criteria: &Criteria,
    ) -> Option<Vec<f64>> {
        let (n, rows) = (self.n, e.len());
        let step = e.sample_time();
        if rows < 30 || step <= 0.0 || e.nu() != n || e.duration() / step > SPARSE * rows as f64 {
            return None;
        }
        let rate = 1.0 / step;
        let cutoff = CUTOFF.min(SHARE * rate);
        let mut bare = e.clone();
        bare.v = None;
        let state = state_from_data(&bare, Some(cutoff)).ok()?;
        let u = acting_inputs(e, data.input_hold);
        if u.iter().any(|u| u.is_nan()) {
            return None;
        }
        let u = low_pass_channels(&e.t, &u, n, cutoff).ok()?;
        let dq = e.v.as_ref().map(|v| filtered_velocities(e, v, cutoff));
        let margin = ((rate / cutoff) as usize).clamp(3, rows / 10);
        let usable = usable(e, margin, criteria);
        for i in (margin..rows - margin)
            .step_by(stride)
            .filter(|&i| usable[i])
        {
            let row = i * n..(i + 1) * n;
            self.at.push((k, i));
            self.q.extend_from_slice(&state.q[row.clone()]);
            self.v.extend_from_slice(&state.v[row.clone()]);
            self.a.extend_from_slice(&state.a[row.clone()]);
            self.u.extend_from_slice(&u[row.clone()]);
            match &dq {
                Some(dq) => self.dq.extend_from_slice(&dq[row]),
                None => self.dq.extend(std::iter::repeat_n(f64::NAN, n)),
            }
        }
        Some(u)
    }

    /// Number of points.
    pub(crate) fn len(&self) -> usize {
        self.at.len()
    }

    /// One column of points × joints.
    pub(crate) fn column<'a>(
        &self,
        x: &'a [f64],
        j: usize,
    ) -> impl Iterator<Item = f64> + Clone + 'a {
        x.iter().skip(j).step_by(self.n.max(1)).copied()
    }

    /// The points without the whole inputs.
    pub(crate) fn points(&self) -> Self {
        Self {
            n: self.n,
            at: self.at.clone(),
            q: self.q.clone(),
            v: self.v.clone(),
            a: self.a.clone(),
            u: self.u.clone(),
            dq: self.dq.clone(),
            inputs: Vec::new(),
            steps: Vec::new(),
        }
    }

    /// The same with the motion of one joint multiplied.
    pub(crate) fn scaled(&self, j: usize, factor: f64) -> Self {
        let mut out = self.points();
        for x in [&mut out.q, &mut out.v, &mut out.a] {
            x.iter_mut()
                .skip(j)
                .step_by(self.n)
                .for_each(|x| *x *= factor);
        }
        out
    }

    /// The same with the motions of two joints exchanged.
    pub(crate) fn exchanged(&self, i: usize, j: usize) -> Self {
        let mut order: Vec<usize> = (0..self.n).collect();
        order.swap(i, j);
        self.ordered(&order)
    }

    /// The same with the motions in another order: that of joint `order[j]` becomes that of joint `j`.
    pub(crate) fn ordered(&self, order: &[usize]) -> Self {
        let mut out = self.points();
        for x in [&mut out.q, &mut out.v, &mut out.a] {
            permuted(x, order);
        }
        out
    }

    /// The same with the inputs in another order.
    pub(crate) fn with_inputs_ordered(mut self, order: &[usize]) -> Self {
        permuted(&mut self.u, order);
        self
    }

    /// The same with an input multiplied.
    pub(crate) fn with_input_scaled(mut self, j: usize, factor: f64) -> Self {
        let n = self.n;
        self.u
            .iter_mut()
            .skip(j)
            .step_by(n)
            .for_each(|u| *u *= factor);
        self
    }

    /// About so many of the points, evenly chosen.
    pub(crate) fn thinned(&self, points: usize) -> Self {
        let step = self.len().div_ceil(points.max(1)).max(1);
        let rows = |x: &[f64]| -> Vec<f64> {
            let kept = x.chunks_exact(self.n).step_by(step);
            kept.flatten().copied().collect()
        };
        Self {
            n: self.n,
            at: self.at.iter().step_by(step).copied().collect(),
            q: rows(&self.q),
            v: rows(&self.v),
            a: rows(&self.a),
            u: rows(&self.u),
            dq: rows(&self.dq),
            inputs: Vec::new(),
            steps: Vec::new(),
        }
    }

    /// The joint moves: positions spread over more than noise. Angles of less than 3 mrad, ways of less than
    /// 3 mm excite nothing.
    pub(crate) fn moves(&self, j: usize) -> bool {
        let (low, high) = self
            .column(&self.q, j)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| {
                (l.min(x), h.max(x))
            });
        high - low > 3e-3
    }
}

fn permuted(x: &mut [f64], order: &[usize]) {
    for row in x.chunks_exact_mut(order.len()) {
        let old = row.to_vec();
        for (value, &from) in row.iter_mut().zip(order) {
            *value = old[from];
        }
    }
}

/// Recorded velocities behind the filter; NaN for joints without.
fn filtered_velocities(e: &Experiment, v: &[f64], cutoff: f64) -> Vec<f64> {
    let n = e.nq;
    let mut out = vec![f64::NAN; v.len()];
    for j in 0..n {
        let mut x = pid_data::signal::column(v, n, j);
        if fill_missing(&e.t, &mut x) == x.len() {
            continue;
        }
        if let Ok(y) = low_pass_channels(&e.t, &x, 1, cutoff) {
            y.iter().enumerate().for_each(|(i, y)| out[i * n + j] = *y);
        }
    }
    out
}

/// Rows that are not near a stretch of missing readings, a hole in time, or a jump.
fn usable(e: &Experiment, margin: usize, criteria: &Criteria) -> Vec<bool> {
    let (rows, n) = (e.len(), e.nq);
    let mut out = vec![true; rows];
    let mut block = |from: usize, to: usize| {
        let (from, to) = (from.saturating_sub(margin), (to + margin).min(rows));
        out[from.min(to)..to].iter_mut().for_each(|x| *x = false);
    };
    let step = e.sample_time();
    for (i, w) in e.t.windows(2).enumerate() {
        if w[1] - w[0] > BRIDGED as f64 * step {
            block(i, i + 2);
        }
    }
    for j in 0..n {
        // What a jump leaves behind the filter fades over two of its margins.
        wrap::breaks(e, j, criteria)
            .into_iter()
            .for_each(|i| block(i.saturating_sub(margin), i + margin));
    }
    for x in [&e.q, &e.u] {
        for j in 0..n {
            let mut start = None;
            for i in 0..=rows {
                let missing = i < rows && x[i * n + j].is_nan();
                match (start, missing) {
                    (None, true) => start = Some(i),
                    (Some(from), false) => {
                        if i - from >= BRIDGED {
                            block(from, i);
                        }
                        start = None;
                    }
                    _ => {}
                }
            }
        }
    }
    out
}

//! Training records as windows with weights, and the setup of their transcription.

use super::error::IdentError;
use super::parameters::{bounds, scales};
use super::settings::{InitialState, Settings, Weighting};
use crate::transcribe::{Body, Loss, Setup, Track};
use pid_data::signal::{StateEstimate, state_from_data};
use pid_data::{Dataset, Experiment, InputHold, Role, windows};
use pid_runtime::dynamics::{At, Hessian};

/// Windows of the training records and the setup of their transcription.
#[derive(Clone)]
pub(super) struct Assembled {
    pub(super) tracks: Vec<Track>,
    /// For the residual; the solved form has unit inertia.
    pub(super) setup: Setup,
    pub(super) lower: Vec<f64>,
    pub(super) upper: Vec<f64>,
    pub(super) fixed: Vec<bool>,
    pub(super) notes: Vec<String>,
}

/// Cuts the training records into windows and weighs them.
pub(super) fn assemble(
    model: &dyn Hessian,
    dataset: &Dataset,
    settings: &Settings,
    start: &[f64],
) -> Result<Assembled, IdentError> {
    let (lower, upper, fixed) = bounds(model, start, &settings.hold);
    let mut tracks = Vec::new();
    let mut records = Vec::new();
    let mut notes = Vec::new();
    let mut inertia = MeanInertia::new(model, start);
    let held = settings.initial_state == InitialState::Measured;
    for (record, experiment) in dataset.with_role(Role::Train).enumerate() {
        let state = state_from_data(experiment, settings.cutoff)?;
        inertia.add(experiment, &state)?;
        if experiment.v.is_none() {
            notes.push(format!(
                "{}: velocities derived from positions, zero-phase filter at {:.1} Hz; they start the windows and are not fitted",
                experiment.name, state.cutoff
            ));
        }
        for range in windows(experiment, settings.horizon) {
            tracks.push(track(
                experiment,
                &state,
                range,
                (held, settings.consistent),
            )?);
            records.push(record);
        }
    }
    let (mut loss, mut priors) = (Loss::Square, Vec::new());
    match &settings.likelihood {
        Some(likelihood) => {
            weigh_by_noise(&mut tracks, &likelihood.noise);
            (loss, priors) = (likelihood.loss, likelihood.priors.clone());
        }
        None => weigh(&mut tracks, &records, model.dims().nq, settings.weighting),
    }
    for j in anchored(model, dataset) {
        for track in &mut tracks {
            anchor(track, j, model.dims().nq);
        }
    }
    let setup = Setup {
        scheme: settings.scheme,
        curvature: settings.curvature,
        scale: scales(model),
        inertia: inertia.mean(),
        hold_initial: held,
        linear_inputs: dataset.input_hold == InputHold::Linear,
        substeps: settings.substeps,
        output: None,
        loss,
        priors,
        bodies_weight: match settings.likelihood {
            Some(_) => STATED,
            None => UNSTATED,
        },
        bodies: bodies(model, settings, start, (&lower, &upper))?,
        lower: lower.clone(),
        upper: upper.clone(),
    };
    Ok(Assembled {
        tracks,
        setup,
        lower,
        upper,
        fixed,
        notes,
    })
}

/// Weighs channels by one over the variances of their noise; a channel of infinite noise is not read.
fn weigh_by_noise(tracks: &mut [Track], noise: &[Option<f64>]) {
    let level = |l: &Option<f64>| l.map_or(0.0, |l| 1.0 / (l * l));
    let weights: Vec<f64> = noise.iter().map(level).collect();
    let unread = |c: usize| noise.get(c) == Some(&Some(f64::INFINITY));
    for track in tracks {
        track.weights.clone_from(&weights);
        for row in track.measured.chunks_exact_mut(weights.len().max(1)) {
            // The value starts the state and is no reading.
            let own = row.iter_mut().enumerate().filter(|(c, _)| unread(*c));
            own.for_each(|(_, x)| *x = f64::NAN);
        }
    }
}

/// Weight of a link's divergence from the start at the solution, in the objective times N. Where
/// noise levels are stated, it is that of a reading one standard deviation off; otherwise that of a
/// reading off by 3 % of the spread of its channel.
const STATED: f64 = 1.0;
const UNSTATED: f64 = 1e-3;

/// The links that stay bodies of positive density. Fails if the start has a link that is none.
fn bodies(
    model: &dyn Hessian,
    settings: &Settings,
    start: &[f64],
    (lower, upper): (&[f64], &[f64]),
) -> Result<Vec<Body>, IdentError> {
    if !settings.consistent {
        return Ok(Vec::new());
    }
    let mut bodies = Body::all(model.params());
    // A link whose parameters are all held stays as it is.
    bodies.retain(|b| b.parameters().iter().any(|j| lower[*j] < upper[*j]));
    let inside = with_bodies(&bodies, start, lower, upper);
    match bodies.iter().find(|b| !b.holds(&inside)) {
        Some(body) => Err(IdentError::NoBody {
            link: body.name().to_owned(),
        }),
        None => Ok(bodies.into_iter().map(|b| b.around(&inside)).collect()),
    }
}

/// Moves a start to links that are bodies, as near as the bounds allow.
pub(super) fn with_bodies(
    bodies: &[Body],
    start: &[f64],
    lower: &[f64],
    upper: &[f64],
) -> Vec<f64> {
    let mut p = start.to_vec();
    bodies.iter().for_each(|b| b.lift(&mut p));
    for ((p, lower), upper) in p.iter_mut().zip(lower).zip(upper) {
        *p = p.clamp(*lower, *upper);
    }
    p
}

/// Coordinates on whose value nothing depends and that no record reads more than once. An example
/// is the coordinate of a lagging velocity reading, of which only the velocity has a meaning. No
/// reading determines where they start.
pub(super) fn anchored(model: &dyn Hessian, dataset: &Dataset) -> Vec<usize> {
    let nq = model.dims().nq;
    let (first, second) = (model.jacobian_pattern(), model.hessian_pattern());
    let used = |j: usize| {
        let places = first.cols.iter().chain(second.cols).chain(second.rows);
        places.into_iter().any(|c| *c as usize == j)
    };
    let read = |j: usize| {
        let readings = |e: &Experiment| {
            let own = e.q.iter().skip(j).step_by(nq);
            own.filter(|q| q.is_finite()).count()
        };
        dataset.with_role(Role::Train).map(readings).max()
    };
    (0..nq)
        .filter(|&j| read(j).unwrap_or(0) <= 1 && !used(j))
        .collect()
}

/// Adds one reading of such a coordinate at the start of a window; it costs nothing at the
/// solution.
fn anchor(track: &mut Track, j: usize, nq: usize) {
    let nx = 2 * nq;
    for (k, row) in track.measured.chunks_exact_mut(nx).enumerate() {
        row[j] = if k == 0 { track.guess[j] } else { f64::NAN };
    }
    let velocity = track.weights[nq + j];
    track.weights[j] = if velocity > 0.0 { velocity } else { 1.0 };
}

/// Makes a window for the discretization. `held`: the initial state is fixed; `smooth`: states
/// start filtered.
fn track(
    experiment: &Experiment,
    state: &StateEstimate,
    range: std::ops::Range<usize>,
    (held, smooth): (bool, bool),
) -> Result<Track, IdentError> {
    let (nq, nu, first) = (experiment.nq, experiment.nu(), range.start);
    let mut track = Track {
        t: experiment.t[range.clone()].to_vec(),
        measured: vec![],
        guess: vec![],
        u: vec![],
        weights: vec![],
    };
    for k in range {
        let row = k * nq..(k + 1) * nq;
        let q = &experiment.q[row.clone()];
        let v = experiment.v.as_ref().map(|v| &v[row.clone()]);
        track.measured.extend_from_slice(q);
        let known = |j: usize| v.map_or(f64::NAN, |v| v[j]);
        track.measured.extend((0..nq).map(known));
        let or = |value: f64, other: f64| if value.is_nan() { other } else { value };
        track
            .guess
            .extend((0..nq).map(|j| match smooth && !(held && k == first) {
                true => state.q[row.start + j],
                false => or(q[j], state.q[row.start + j]),
            }));
        // A window at the start of its record takes the filtered velocity, since a single sample is
        // noisy.
        let filtered = smooth || held && k == first;
        let velocity = |j: usize| if filtered { f64::NAN } else { known(j) };
        track
            .guess
            .extend((0..nq).map(|j| or(velocity(j), state.v[row.start + j])));
        let u = &experiment.u[k * nu..(k + 1) * nu];
        if u.iter().any(|u| u.is_nan()) {
            return Err(IdentError::MissingInput {
                experiment: experiment.name.clone(),
                row: k + 1,
            });
        }
        track.u.extend_from_slice(u);
    }
    Ok(track)
}

/// A record's own variance counts as at least this share of the variance over all records, so that
/// a record without motion gets no huge weight.
const STILL: f64 = 1e-4;

/// Sets the channel weights of all windows; `records` tells which record each belongs to.
fn weigh(tracks: &mut [Track], records: &[usize], nq: usize, weighting: Weighting) {
    let nx = 2 * nq;
    let variance = |tracks: &[Track], channel: usize, record: Option<usize>| -> Option<f64> {
        let values: Vec<f64> = tracks
            .iter()
            .zip(records)
            .filter(|(_, r)| record.is_none_or(|only| only == **r))
            .flat_map(|(t, _)| t.measured.iter().skip(channel).step_by(nx).copied())
            .filter(|x| !x.is_nan())
            .collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / n;
        (variance > 0.0).then_some(variance)
    };
    let count = records.last().map_or(0, |r| r + 1);
    for channel in 0..nx {
        let overall = variance(tracks, channel, None).unwrap_or(1.0);
        let own: Vec<f64> = (0..count)
            .map(|r| match weighting {
                Weighting::Unit => 1.0,
                Weighting::Position => f64::from(u8::from(channel < nq)),
                Weighting::Spread => 1.0 / overall,
                Weighting::Record if channel >= nq => 0.0,
                Weighting::Record => {
                    let own = variance(tracks, channel, Some(r)).unwrap_or(0.0);
                    1.0 / own.max(STILL * overall)
                }
            })
            .collect();
        for (track, &record) in tracks.iter_mut().zip(records) {
            track.weights.push(own[record]);
        }
    }
}

/// Mean diagonal of M over the training samples; fails for a singular M.
struct MeanInertia<'a> {
    model: &'a dyn Hessian,
    p: &'a [f64],
    sum: Vec<f64>,
    count: f64,
}

impl<'a> MeanInertia<'a> {
    fn new(model: &'a dyn Hessian, p: &'a [f64]) -> Self {
        Self {
            model,
            p,
            sum: vec![0.0; model.dims().nq],
            count: 0.0,
        }
    }

    fn add(&mut self, experiment: &Experiment, state: &StateEstimate) -> Result<(), IdentError> {
        let dims = self.model.dims();
        let mut m = vec![0.0; dims.nm()];
        // A hundred samples a record are enough for the size of M and for a structural singularity.
        let stride = experiment.len().div_ceil(100).max(1);
        for k in (0..experiment.len()).step_by(stride) {
            let row = k * dims.nq..(k + 1) * dims.nq;
            let at = At {
                q: &state.q[row.clone()],
                v: &state.v[row.clone()],
                a: &state.a[row.clone()],
                u: &experiment.u[k * dims.nu..(k + 1) * dims.nu],
                p: self.p,
            };
            self.model.mass_matrix(&at, &mut m);
            for j in 0..dims.nq {
                self.sum[j] += m[j * (j + 1) / 2 + j];
            }
            self.count += 1.0;
            if let Some((joint, pivot)) = singular(&mut m, dims.nq) {
                return Err(IdentError::SingularMassMatrix {
                    experiment: experiment.name.clone(),
                    time: experiment.t[k],
                    joint: self.model.joints()[joint].name.to_string(),
                    pivot,
                });
            }
        }
        Ok(())
    }

    fn mean(&self) -> Vec<f64> {
        self.sum.iter().map(|s| s / self.count.max(1.0)).collect()
    }
}

/// The joint whose Cholesky pivot of M is not clearly positive; M is overwritten.
fn singular(m: &mut [f64], n: usize) -> Option<(usize, f64)> {
    for i in 0..n {
        let diagonal = m[i * (i + 1) / 2 + i];
        for j in 0..=i {
            let mut sum = m[i * (i + 1) / 2 + j];
            for k in 0..j {
                sum -= m[i * (i + 1) / 2 + k] * m[j * (j + 1) / 2 + k];
            }
            if i == j {
                if sum.is_nan() || sum <= 1e-12 * diagonal.abs() {
                    return Some((i, sum));
                }
                m[i * (i + 1) / 2 + i] = sum.sqrt();
            } else {
                m[i * (i + 1) / 2 + j] = sum / m[j * (j + 1) / 2 + j];
            }
        }
    }
    None
}

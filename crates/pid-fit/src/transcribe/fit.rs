//! The part of the objective that belongs to one sample.
//!
//! ```text
//! ℓ_k(x, p) = 1/N Σ_c ρ(√w_kc (y_c(x, p) − d_kc))
//! ```
//!
//! with measured `d`, weights `w` (0 where nothing was measured) and the output `y(x, p)`: the
//! state itself, or a map of the user (K. Schäfer et al., equation (1), where it is called c), and
//! the loss ρ(z) = z² unless another is chosen ([`Loss`]).

use super::loss::Loss;
use pid_runtime::generic::functions::PointFunction;
use std::fmt;
use std::sync::Arc;

/// Measured output as a function of state and parameters; without it the state itself is measured.
#[derive(Clone)]
pub struct Output(pub Arc<dyn PointFunction>);

impl fmt::Debug for Output {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Output({} channels)", self.0.outputs())
    }
}

impl PartialEq for Output {
    /// Whether both are the same function object.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// Measured outputs of all samples, and their predictions.
#[derive(Clone)]
pub(super) struct Fit {
    nx: usize,
    np: usize,
    /// `None`: the output is the state.
    output: Option<Output>,
    /// Sample by sample; zeros where nothing was measured.
    measured: Vec<f64>,
    /// Of each entry of `measured`, 1/N included.
    weights: Vec<f64>,
    loss: Loss,
    /// 1/N.
    share: f64,
}

/// Work space for one sample; `z = (x, p)`.
#[derive(Default)]
pub(super) struct FitScratch {
    y: Vec<f64>,
    /// ny × nz.
    jacobian: Vec<f64>,
    /// nz × nz.
    second: Vec<f64>,
    multipliers: Vec<f64>,
}

impl Fit {
    /// No samples yet; `samples` will be N.
    pub(super) fn new(
        nx: usize,
        np: usize,
        output: Option<Output>,
        loss: Loss,
        samples: usize,
    ) -> Self {
        Self {
            loss,
            share: 1.0 / samples.max(1) as f64,
            nx,
            np,
            output,
            measured: Vec::new(),
            weights: Vec::new(),
        }
    }

    /// Number of channels.
    pub(super) fn channels(&self) -> usize {
        self.output.as_ref().map_or(self.nx, |o| o.0.outputs())
    }

    /// Adds a sample: NaN where nothing was measured; weights include 1/N.
    pub(super) fn push(
        &mut self,
        measured: impl Iterator<Item = f64>,
        weights: impl Iterator<Item = f64>,
    ) {
        for (value, weight) in measured.zip(weights) {
            let missing = value.is_nan();
            self.measured.push(if missing { 0.0 } else { value });
            self.weights.push(if missing { 0.0 } else { weight });
        }
    }

    /// Adds a node at which nothing is measured.
    pub(super) fn push_empty(&mut self) {
        let c = self.channels();
        self.measured.extend(std::iter::repeat_n(0.0, c));
        self.weights.extend(std::iter::repeat_n(0.0, c));
    }

    pub(super) fn scratch(&self) -> FitScratch {
        let (c, nz) = (self.channels(), self.nx + self.np);
        let mapped = self.output.is_some();
        FitScratch {
            y: vec![0.0; c],
            jacobian: vec![0.0; if mapped { c * nz } else { 0 }],
            second: vec![0.0; if mapped { nz * nz } else { 0 }],
            multipliers: vec![0.0; c],
        }
    }

    /// Value and first two derivatives of the term of a channel by its deviation `e`; the second is
    /// that of the touching parabola where `majorised`.
    fn slopes(&self, weight: f64, e: f64, majorised: bool) -> (f64, f64) {
        if self.loss.is_square() {
            return (2.0 * weight * e, 2.0 * weight);
        }
        let unit = (weight / self.share).sqrt();
        let second = match majorised {
            true => self.loss.weight(unit * e),
            false => self.loss.curvature(unit * e),
        };
        (
            self.share * unit * self.loss.slope(unit * e),
            weight * second,
        )
    }

    /// Adds `factor ∂²ℓ_k/∂x²`, a diagonal, for outputs that are the state.
    pub(super) fn state_curvature(
        &self,
        k: usize,
        x: &[f64],
        factor: f64,
        gauss_newton: bool,
        mut add: impl FnMut(usize, f64),
    ) {
        let terms = self.weights(k).iter().zip(self.measured(k)).zip(x);
        for (c, ((w, d), x)) in terms.enumerate().filter(|(_, ((w, _), _))| **w != 0.0) {
            add(c, factor * self.slopes(*w, x - d, gauss_newton).1);
        }
    }

    /// Whether the output is the state, so that Hessians are diagonal.
    pub(super) fn is_state(&self) -> bool {
        self.output.is_none()
    }

    /// Weights of a sample.
    pub(super) fn weights(&self, k: usize) -> &[f64] {
        let c = self.channels();
        &self.weights[k * c..(k + 1) * c]
    }

    fn measured(&self, k: usize) -> &[f64] {
        let c = self.channels();
        &self.measured[k * c..(k + 1) * c]
    }

    fn output<'a>(&self, x: &'a [f64], p: &[f64], s: &'a mut FitScratch) -> &'a [f64] {
        match &self.output {
            None => x,
            Some(map) => {
                map.0.value(x, p, &mut s.y);
                &s.y
            }
        }
    }

    /// ℓ_k.
    pub(super) fn value(&self, k: usize, x: &[f64], p: &[f64], s: &mut FitScratch) -> f64 {
        let y = self.output(x, p, s);
        let terms = y.iter().zip(self.measured(k)).zip(self.weights(k));
        // A channel without a measurement does not count, even if its output is not finite.
        terms
            .filter(|(_, w)| **w != 0.0)
            .map(|((y, d), w)| match self.loss {
                Loss::Square => w * (y - d) * (y - d),
                loss => self.share * loss.value((w / self.share).sqrt() * (y - d)),
            })
            .sum()
    }

    /// `√w (y − d)`, NaN where nothing was measured.
    pub(super) fn residual(
        &self,
        k: usize,
        x: &[f64],
        p: &[f64],
        s: &mut FitScratch,
        out: &mut Vec<f64>,
    ) {
        let y = self.output(x, p, s);
        let terms = y.iter().zip(self.measured(k)).zip(self.weights(k));
        out.extend(terms.map(|((y, d), w)| {
            if *w > 0.0 {
                w.sqrt() * (y - d)
            } else {
                f64::NAN
            }
        }));
    }

    /// Adds `factor ∂ℓ_k/∂(x, p)`.
    pub(super) fn gradient(
        &self,
        k: usize,
        (x, p): (&[f64], &[f64]),
        factor: f64,
        s: &mut FitScratch,
        out: &mut [f64],
    ) {
        let (measured, weights) = (self.measured(k), self.weights(k));
        match &self.output {
            None => {
                for i in 0..self.nx {
                    if weights[i] != 0.0 {
                        out[i] += factor * self.slopes(weights[i], x[i] - measured[i], false).0;
                    }
                }
            }
            Some(map) => {
                let nz = self.nx + self.np;
                map.0.jacobian(x, p, &mut s.y, &mut s.jacobian);
                for c in (0..weights.len()).filter(|c| weights[*c] != 0.0) {
                    let slope = factor * self.slopes(weights[c], s.y[c] - measured[c], false).0;
                    for (o, j) in out.iter_mut().zip(&s.jacobian[c * nz..(c + 1) * nz]) {
                        *o += slope * j;
                    }
                }
            }
        }
    }

    /// Adds `factor ∂²ℓ_k/∂(x, p)²`, dense, (nx + np)²; without the curvature of the output if
    /// `gauss_newton`.
    pub(super) fn hessian(
        &self,
        k: usize,
        (x, p): (&[f64], &[f64]),
        factor: f64,
        gauss_newton: bool,
        s: &mut FitScratch,
        out: &mut [f64],
    ) {
        let nz = self.nx + self.np;
        let (measured, weights) = (self.measured(k), self.weights(k));
        let Some(map) = &self.output else {
            self.state_curvature(k, x, factor, gauss_newton, |i, value| {
                out[i * nz + i] += value;
            });
            return;
        };
        map.0.jacobian(x, p, &mut s.y, &mut s.jacobian);
        for c in (0..weights.len()).filter(|c| weights[*c] != 0.0) {
            let row = &s.jacobian[c * nz..(c + 1) * nz];
            let second = self
                .slopes(weights[c], s.y[c] - measured[c], gauss_newton)
                .1;
            for i in (0..nz).filter(|i| row[*i] != 0.0) {
                let slope = factor * second * row[i];
                for (o, j) in out[i * nz..(i + 1) * nz].iter_mut().zip(row) {
                    *o += slope * j;
                }
            }
        }
        if gauss_newton {
            return;
        }
        for c in 0..weights.len() {
            s.multipliers[c] = if weights[c] != 0.0 {
                factor * self.slopes(weights[c], s.y[c] - measured[c], false).0
            } else {
                0.0
            };
        }
        map.0.hessian(x, p, &s.multipliers, &mut s.second);
        for (o, h) in out.iter_mut().zip(&s.second) {
            *o += h;
        }
    }
}

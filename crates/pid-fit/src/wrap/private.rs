//! Parameters with a value of their own in every record: offsets that are set anew, a payload that
//! changes.
//!
//! The model gets one copy of each such parameter per training record, and one more input that
//! names the record. A record without a copy of its own (a test record) takes the mean of the
//! copies.

use std::borrow::Cow;
use std::cell::RefCell;

use pid_data::{Dataset, Role};
use pid_runtime::dynamics::{At, Dims, Hessian, InputInfo, Jacobian, ParamInfo, Pattern};

use pid_runtime::within_dynamics;

/// A request that does not fit the model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PrivateError {
    /// A parameter that does not exist.
    #[error(
        "--private: the model has no parameter `{name}`\n  help: the report lists the model's parameters"
    )]
    UnknownParameter {
        /// Its name.
        name: String,
    },
    /// No training record.
    #[error("data set `{dataset}` has no experiment with role \"train\"")]
    NoTraining {
        /// The data set.
        dataset: String,
    },
}

/// Where an entry of the inner pattern goes: one slot, or one per copy.
#[derive(Debug, Clone)]
enum Target {
    Shared(usize),
    Copies(Vec<usize>),
}

struct Entries {
    rows: Vec<u32>,
    cols: Vec<u32>,
    targets: Vec<Target>,
}

impl Entries {
    /// `places` gives the place of an inner entry for a copy, and whether it differs between copies.
    fn new(
        count: usize,
        copies: usize,
        place: impl Fn(usize, usize) -> (u32, u32),
        own: impl Fn(usize) -> bool,
    ) -> Self {
        let mut all = Vec::new();
        for entry in 0..count {
            let wanted = if own(entry) { copies } else { 1 };
            all.extend((0..wanted).map(|copy| place(entry, copy)));
        }
        all.sort_unstable();
        all.dedup();
        let slot = |p: (u32, u32)| {
            all.binary_search(&p)
                .expect("invariant: every place was put in above")
        };
        let targets = (0..count)
            .map(|entry| match own(entry) {
                true => Target::Copies((0..copies).map(|c| slot(place(entry, c))).collect()),
                false => Target::Shared(slot(place(entry, 0))),
            })
            .collect();
        Self {
            rows: all.iter().map(|p| p.0).collect(),
            cols: all.iter().map(|p| p.1).collect(),
            targets,
        }
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            rows: &self.rows,
            cols: &self.cols,
        }
    }

    fn spread(&self, own: &[f64], copy: Option<usize>, values: &mut [f64]) {
        values.fill(0.0);
        for (value, target) in own.iter().zip(&self.targets) {
            match target {
                Target::Shared(slot) => values[*slot] += value,
                Target::Copies(slots) => match copy {
                    Some(copy) => values[slots[copy]] += value,
                    // The mean of the copies. Nobody asks for second derivatives of records without
                    // a copy.
                    None => {
                        let share = value / slots.len() as f64;
                        slots.iter().for_each(|s| values[*s] += share);
                    }
                },
            }
        }
    }
}

thread_local! {
    /// Inner parameters and derivative values; kept so that evaluations do not allocate.
    static SCRATCH: RefCell<(Vec<f64>, Vec<f64>)> = const { RefCell::new((Vec::new(), Vec::new())) };
}

/// A model whose chosen parameters have a copy per record.
pub struct PerRecord<'m> {
    inner: Box<dyn Hessian + 'm>,
    dims: Dims,
    params: Vec<ParamInfo>,
    inputs: Vec<InputInfo>,
    own: Vec<usize>,
    copies: usize,
    jacobian: Entries,
    hessian: Entries,
}

impl<'m> PerRecord<'m> {
    /// Gives the named parameters one copy per training record, and the records their input.
    ///
    /// # Errors
    /// [`PrivateError`].
    pub fn new(
        inner: Box<dyn Hessian + 'm>,
        names: &[String],
        dataset: &mut Dataset,
    ) -> Result<Self, PrivateError> {
        let records: Vec<String> = dataset
            .with_role(Role::Train)
            .map(|e| e.name.clone())
            .collect();
        if records.is_empty() {
            return Err(PrivateError::NoTraining {
                dataset: dataset.name.clone(),
            });
        }
        let mut own: Vec<usize> = names
            .iter()
            .map(|name| {
                let position = inner.params().iter().position(|p| p.name == *name);
                position.ok_or_else(|| PrivateError::UnknownParameter { name: name.clone() })
            })
            .collect::<Result<_, _>>()?;
        own.sort_unstable();
        own.dedup();
        number_records(dataset, records.len());
        let (before, copies) = (inner.dims(), records.len());
        let dims = Dims {
            nu: before.nu + 1,
            np: before.np + own.len() * (copies - 1),
            ..before
        };
        let mut params = inner.params().to_vec();
        for record in 1..copies {
            for &j in &own {
                let mut info = inner.params()[j].clone();
                info.name = Cow::Owned(format!("{}@{}", info.name, records[record]));
                params.push(info);
            }
        }
        for &j in &own {
            params[j].name = Cow::Owned(format!("{}@{}", inner.params()[j].name, records[0]));
        }
        let mut inputs = inner.inputs().to_vec();
        inputs.push(InputInfo {
            name: Cow::Borrowed("record"),
            unit: Cow::Borrowed("1"),
            joint: None,
        });
        let (jacobian, hessian) = patterns(inner.as_ref(), dims, &own, copies);
        Ok(Self {
            inner,
            dims,
            params,
            inputs,
            own,
            copies,
            jacobian,
            hessian,
        })
    }

    /// The copy that a point's record has.
    fn copy(&self, at: &At<'_>) -> Option<usize> {
        let index = at.u[self.dims.nu - 1].round();
        (index >= 0.0 && index < self.copies as f64).then_some(index as usize)
    }

    /// Calls with the inner inputs and parameters.
    fn within<R>(&self, at: &At<'_>, work: impl FnOnce(&At<'_>) -> R) -> R {
        let np = self.inner.dims().np;
        let mut p = SCRATCH.with(|s| std::mem::take(&mut s.borrow_mut().0));
        p.clear();
        p.extend_from_slice(&at.p[..np]);
        for &j in &self.own {
            let value = |copy: usize| at.p[slot_of(&self.own, np, j, copy)];
            p[j] = match self.copy(at) {
                Some(copy) => value(copy),
                None => (0..self.copies).map(value).sum::<f64>() / self.copies as f64,
            };
        }
        let out = work(&At {
            u: &at.u[..self.dims.nu - 1],
            p: &p,
            ..*at
        });
        SCRATCH.with(|s| s.borrow_mut().0 = p);
        out
    }
}

/// Gives every record an input that is its number among the training records; `count` for one that
/// trains nothing.
fn number_records(dataset: &mut Dataset, count: usize) {
    let mut trained = 0;
    for experiment in &mut dataset.experiments {
        let index = match experiment.role {
            Role::Train => trained,
            Role::Test => count,
        };
        trained += usize::from(experiment.role == Role::Train);
        let nu = experiment.nu();
        let mut u = Vec::with_capacity(experiment.len() * (nu + 1));
        for row in experiment.u.chunks_exact(nu) {
            u.extend_from_slice(row);
            u.push(index as f64);
        }
        experiment.u = u;
    }
}

/// Entries of the Jacobian and of the Hessian for a number of copies of the parameters `own`.
fn patterns(inner: &dyn Hessian, dims: Dims, own: &[usize], copies: usize) -> (Entries, Entries) {
    let before = inner.dims();
    // Position of an inner z for a copy.
    let map = |z: usize, copy: usize| -> u32 {
        let place = match z.checked_sub(before.p()) {
            None => z,
            Some(j) => dims.p() + slot_of(own, before.np, j, copy),
        };
        place as u32
    };
    let private = |z: u32| {
        (z as usize)
            .checked_sub(before.p())
            .is_some_and(|j| own.binary_search(&j).is_ok())
    };
    let first = inner.jacobian_pattern();
    let jacobian = Entries::new(
        first.nnz(),
        copies,
        |e, copy| (first.rows[e], map(first.cols[e] as usize, copy)),
        |e| private(first.cols[e]),
    );
    let second = inner.hessian_pattern();
    let hessian = Entries::new(
        second.nnz(),
        copies,
        |e, copy| {
            let (a, b) = (
                map(second.rows[e] as usize, copy),
                map(second.cols[e] as usize, copy),
            );
            (a.max(b), a.min(b))
        },
        |e| private(second.rows[e]) || private(second.cols[e]),
    );
    (jacobian, hessian)
}

/// Position among the outer parameters of inner parameter j for a copy.
fn slot_of(own: &[usize], np: usize, j: usize, copy: usize) -> usize {
    match (own.binary_search(&j), copy) {
        (Ok(place), 1..) => np + (copy - 1) * own.len() + place,
        _ => j,
    }
}

within_dynamics!(PerRecord);

impl Jacobian for PerRecord<'_> {
    fn jacobian_pattern(&self) -> Pattern<'_> {
        self.jacobian.pattern()
    }
    fn residual_jacobian(&self, at: &At<'_>, r: &mut [f64], values: &mut [f64]) {
        let mut own = SCRATCH.with(|s| std::mem::take(&mut s.borrow_mut().1));
        own.resize(self.jacobian.targets.len(), 0.0);
        self.within(at, |at| self.inner.residual_jacobian(at, r, &mut own));
        self.jacobian.spread(&own, self.copy(at), values);
        SCRATCH.with(|s| s.borrow_mut().1 = own);
    }
}

impl Hessian for PerRecord<'_> {
    fn hessian_pattern(&self) -> Pattern<'_> {
        self.hessian.pattern()
    }
    fn residual_hessian(&self, at: &At<'_>, lambda: &[f64], values: &mut [f64]) {
        let mut own = SCRATCH.with(|s| std::mem::take(&mut s.borrow_mut().1));
        own.resize(self.hessian.targets.len(), 0.0);
        self.within(at, |at| self.inner.residual_hessian(at, lambda, &mut own));
        self.hessian.spread(&own, self.copy(at), values);
        SCRATCH.with(|s| s.borrow_mut().1 = own);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derivatives::derivatives_hold_at;
    use crate::ident::{self, Progress, Settings};
    use crate::synthetic::{Recipe, records};
    use crate::transcribe::Scheme;
    use pid_models::ServoPendulum;
    use pid_runtime::dynamics::Dynamics;
    use pid_runtime::extend::Extended;
    use std::ops::ControlFlow;

    fn boxed() -> Box<dyn Hessian> {
        let terms = ["offset", "stribeck"].map(|t| t.parse().expect("a term"));
        Box::new(Extended::new(&ServoPendulum, &terms).expect("fits"))
    }

    /// Three records, each simulated with an offset of its own.
    fn dataset(offsets: [f64; 3]) -> Dataset {
        let model = boxed();
        let j = model.params().iter().position(|p| p.name == "offset_shaft");
        let mut out: Option<Dataset> = None;
        for (k, offset) in offsets.into_iter().enumerate() {
            let mut p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
            p[j.expect("a parameter")] = offset;
            let recipe = Recipe {
                records: 1,
                seconds: 2.0,
                step: 0.01,
                amplitude: vec![1.0],
                highest: 3.0,
                start: vec![0.1],
                noise: vec![1e-5, 1e-4],
                outliers: (0.0, 1.0),
            };
            let mut made = records(model.as_ref(), &p, &recipe, k as u64).expect("simulates");
            made.experiments[0].name = format!("r{k}");
            match &mut out {
                None => out = Some(made),
                Some(all) => all.experiments.extend(made.experiments),
            }
        }
        out.expect("three records")
    }

    #[test]
    fn every_record_finds_its_own_offset() {
        let offsets = [0.01, -0.02, 0.03];
        let mut data = dataset(offsets);
        let names = ["offset_shaft".to_owned()];
        let model = PerRecord::new(boxed(), &names, &mut data).expect("fits");
        let at = |name: &str| model.params().iter().position(|p| p.name == name);
        let free: Vec<usize> = (0..3)
            .filter_map(|k| at(&format!("offset_shaft@r{k}")))
            .chain(at("viscous_shaft"))
            .collect();
        assert_eq!(free.len(), 4);
        let settings = Settings {
            scheme: Scheme::RungeKutta4,
            hold: (0..model.dims().np).filter(|j| !free.contains(j)).collect(),
            ..Settings::default()
        };
        let go_on = &mut |_: &Progress<'_>| ControlFlow::Continue(());
        let found = ident::identify(&model, &data, &settings, None, go_on).expect("identifies");
        for (k, offset) in offsets.into_iter().enumerate() {
            let value = found.best().parameters[free[k]];
            assert!(
                (value - offset).abs() < 1e-4,
                "record {k}: {value} {offset}"
            );
        }
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let mut data = dataset([0.0; 3]);
        let names = ["offset_shaft".to_owned(), "resistance_shaft".to_owned()];
        let model = PerRecord::new(boxed(), &names, &mut data).expect("fits");
        let d = model.dims();
        let mut z: Vec<f64> = (0..d.nz()).map(|k| (0.4 + 0.9 * k as f64).sin()).collect();
        for (k, info) in model.params().iter().enumerate() {
            z[d.p() + k] = info.nominal + 0.01 * (1.0 + k as f64);
        }
        for record in 0..3 {
            z[d.p() - 1] = f64::from(record);
            // Not along the number of the record, which is no variable.
            derivatives_hold_at(&model, &z, &[1.0], &[d.p() - 1]);
        }
    }
}

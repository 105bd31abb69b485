//! From a few logs of a fleet to its plan: the filter, the quantities that motions determine, and what else would move
//! them.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use pid_data::Dataset;
use pid_fit::regress::base::Base;
use pid_fit::regress::record::{Filtering, Record};
use pid_interpret::nominal::{Nominal, Role};
use pid_runtime::dynamics::Hessian;

use crate::FleetError;
use crate::frame::{Block, Extra, Frame, total};
use crate::measure::{solve, weights};
use crate::plan::{Cause, Held, Kind, Plan, Quantity, Reading, SCHEMA};
use crate::robust::median;

/// A column of which the others explain all but this share says nothing of its own.
const OF_ITS_OWN: f64 = 1e-4;
/// Share of a tolerance by which a parameter is moved to see what follows.
const MOVED: f64 = 0.1;

/// Plans a fleet of a described robot from some of its logs; `cutoff` in Hz, from the noise of these logs if `None`.
///
/// # Errors
/// Logs that no filter takes, or that determine nothing.
pub fn design(
    nominal: &Nominal,
    model: &dyn Hessian,
    logs: &[Dataset],
    cutoff: Option<f64>,
    reading: Reading,
) -> Result<Plan, FleetError> {
    let cutoff = match cutoff {
        Some(cutoff) => cutoff,
        None => typical_cutoff(logs)?,
    };
    let start: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    let sums = |p: &[f64], hold: &[usize], extras: &[Extra]| -> Result<Block, FleetError> {
        let frame = Frame::new(model, p, hold, extras, cutoff);
        let mut blocks = Vec::new();
        for log in logs {
            blocks.extend(frame.blocks(log).map_err(Box::new)?);
        }
        Ok(total(&blocks, model.dims().nq, frame.columns()))
    };
    let bare = Frame::new(model, &start, &[], &[], cutoff);
    let linear = bare.linear().to_vec();
    let base = base(&sums(&start, &[], &[])?)?;
    let names: Vec<&str> = (linear.iter())
        .map(|&j| model.params()[j].name.as_ref())
        .collect();
    let hold: Vec<usize> = base.dependent.iter().map(|&d| linear[d]).collect();
    let kept: Vec<usize> = base.independent.iter().map(|&i| linear[i]).collect();
    let extras = extras(&sums(&start, &hold, &all_extras(model))?, kept.len(), model)?;
    let mut quantities: Vec<Quantity> = (0..base.rank())
        .map(|i| {
            let info = &model.params()[kept[i]];
            Quantity {
                name: info.name.to_string(),
                unit: info.unit.to_string(),
                formula: base.formula(i, &names),
                nominal: info.nominal,
                kind: Kind::Parameter,
            }
        })
        .collect();
    quantities.extend(extras.iter().map(|extra| beside(*extra, model)));
    quantities.extend((0..model.dims().nq).map(|j| residual(j, model)));
    let all = sums(&start, &hold, &extras)?;
    let weights = weights(&all).ok_or(FleetError::NothingDetermined)?;
    let at = |p: &[f64]| -> Result<DVector<f64>, FleetError> {
        solve(&sums(p, &hold, &extras)?, &weights).ok_or(FleetError::NothingDetermined)
    };
    let moved = Moved {
        at: &at,
        start: &start,
        kept: &kept,
        before: at(&start)?,
        quantities: quantities.len(),
    };
    let causes = causes(nominal, model, &kept, &moved)?;
    Ok(Plan {
        schema: SCHEMA,
        robot: nominal.robot().name.clone(),
        reading,
        dates: false,
        cutoff,
        held: hold
            .iter()
            .map(|&j| Held {
                name: model.params()[j].name.to_string(),
                value: start[j],
            })
            .collect(),
        quantities,
        causes,
    })
}

/// The cut-off that the noise of most logs asks for, Hz.
fn typical_cutoff(logs: &[Dataset]) -> Result<f64, FleetError> {
    let mut all = Vec::new();
    for log in logs {
        for experiment in &log.experiments {
            let record = Record::new(experiment, log.input_hold, Filtering::default());
            all.push(record.map_err(Box::new)?.cutoff);
        }
    }
    // One decimal keeps the plan readable.
    Ok((10.0 * median(&all)).round().max(1.0) / 10.0)
}

/// The combinations of parameters that the logs determine, joints weighed by the forces of their drives.
fn base(all: &Block) -> Result<Base, FleetError> {
    let n = all.first().map_or(0, |s| s.b.len());
    let mut a = DMatrix::zeros(n, n);
    for sums in all.iter().filter(|s| s.drive > 0.0) {
        a += &sums.a / sums.drive;
    }
    let base = Base::of(&a);
    match base.rank() {
        0 => Err(FleetError::NothingDetermined),
        _ => Ok(base),
    }
}

/// Offsets and delays of all joints.
fn all_extras(model: &dyn Hessian) -> Vec<Extra> {
    let joints = 0..model.dims().nq;
    let offsets = joints.clone().map(Extra::Offset);
    offsets.chain(joints.map(Extra::Delay)).collect()
}

/// Those that parameters and others do not explain.
fn extras(all: &Block, parameters: usize, model: &dyn Hessian) -> Result<Vec<Extra>, FleetError> {
    let candidates = all_extras(model);
    let n = parameters + candidates.len();
    let mut a = DMatrix::zeros(n, n);
    for sums in all.iter().filter(|s| s.drive > 0.0) {
        a += &sums.a / sums.drive;
    }
    let mut columns: Vec<usize> = (0..n)
        .filter(|&k| k < parameters || a[(k, k)] > 0.0)
        .collect();
    loop {
        let correlation = DMatrix::from_fn(columns.len(), columns.len(), |i, j| {
            let (i, j) = (columns[i], columns[j]);
            a[(i, j)] / (a[(i, i)] * a[(j, j)]).sqrt()
        });
        let inverse = correlation.cholesky().map(|f| f.inverse());
        let own = |at: usize| inverse.as_ref().map_or(0.0, |i| i[(at, at)].recip());
        let weakest = (0..columns.len())
            .filter(|&at| columns[at] >= parameters)
            .min_by(|&x, &y| own(x).total_cmp(&own(y)).then(y.cmp(&x)));
        match weakest {
            Some(at) if own(at) < OF_ITS_OWN => {
                columns.remove(at);
            }
            _ => break,
        }
    }
    let kept = columns.iter().filter(|&&k| k >= parameters);
    Ok(kept.map(|&k| candidates[k - parameters]).collect())
}

fn beside(extra: Extra, model: &dyn Hessian) -> Quantity {
    let joint = |j: usize| model.joints()[j].name.to_string();
    let force = |j: usize| match model.joints()[j].prismatic {
        true => "N",
        false => "N*m",
    };
    let (name, unit, formula, kind) = match extra {
        Extra::Offset(j) => (
            format!("offset_{}", joint(j)),
            force(j),
            "constant force beside the drive's",
            Kind::Offset { joint: joint(j) },
        ),
        Extra::Delay(j) => (
            format!("delay_{}", joint(j)),
            "s",
            "how late the input acts",
            Kind::Delay { joint: joint(j) },
        ),
    };
    Quantity {
        name,
        unit: unit.to_owned(),
        formula: formula.to_owned(),
        nominal: 0.0,
        kind,
    }
}

fn residual(j: usize, model: &dyn Hessian) -> Quantity {
    let joint = model.joints()[j].name.to_string();
    Quantity {
        name: format!("residual_{joint}"),
        unit: "1".to_owned(),
        formula: "logarithm of the share of the drive's force that nothing above explains"
            .to_owned(),
        nominal: 0.0,
        kind: Kind::Residual { joint },
    }
}

/// Values of the columns where the robot is assumed to have these parameters.
type Values<'a> = dyn Fn(&[f64]) -> Result<DVector<f64>, FleetError> + 'a;

/// By how much the values move where a robot differs from its description.
struct Moved<'a> {
    at: &'a Values<'a>,
    start: &'a [f64],
    kept: &'a [usize],
    before: DVector<f64>,
    quantities: usize,
}

impl Moved<'_> {
    /// For changes of parameters by place, each value per unit of `size`. What is assumed wrongly moves values the
    /// other way than it would, assumed rightly.
    fn by(&self, changes: &BTreeMap<usize, f64>, size: f64) -> Result<Vec<f64>, FleetError> {
        let mut p = self.start.to_vec();
        for (&j, change) in changes {
            p[j] += change;
        }
        let after = (self.at)(&p)?;
        let mut moves = vec![0.0; self.quantities];
        for (k, value) in moves.iter_mut().enumerate().take(after.len()) {
            let own = self.kept.get(k).and_then(|j| changes.get(j));
            *value = (own.copied().unwrap_or(0.0) - (after[k] - self.before[k])) / size;
        }
        Ok(moves)
    }
}

/// Parameters that are held though a tolerance leaves them open, and a payload at the tool.
fn causes(
    nominal: &Nominal,
    model: &dyn Hessian,
    kept: &[usize],
    moved: &Moved<'_>,
) -> Result<Vec<Cause>, FleetError> {
    let position = |name: &str| model.params().iter().position(|p| p.name == *name);
    let mut causes = Vec::new();
    for tolerance in nominal.tolerances().iter().filter(|t| t.half_width > 0.0) {
        let Some(at) = position(&tolerance.name).filter(|at| !kept.contains(at)) else {
            continue;
        };
        let step = MOVED * tolerance.half_width;
        let moves = moved.by(&BTreeMap::from([(at, step)]), step)?;
        if moves.iter().any(|m| *m != 0.0) {
            causes.push(Cause {
                name: tolerance.name.clone(),
                unit: model.params()[at].unit.to_string(),
                moves,
            });
        }
    }
    if let Some((changes, mass)) = payload(nominal, &position) {
        causes.push(Cause {
            name: "payload".to_owned(),
            unit: "kg".to_owned(),
            moves: moved.by(&changes, mass)?,
        });
    }
    Ok(causes)
}

/// Changes of the last link's parameters by a small mass at the tool, and that mass, kg.
fn payload(
    nominal: &Nominal,
    position: &dyn Fn(&str) -> Option<usize>,
) -> Option<(BTreeMap<usize, f64>, f64)> {
    let (tool, link) = (nominal.measurement().tool?, nominal.tool_link()?);
    let own = |role: Role| {
        let mut all = nominal.tolerances().iter();
        let found = all.find(|t| t.joint == Some(link) && t.role == role)?;
        Some((position(&found.name)?, found.nominal))
    };
    let (at, mass) = own(Role::Mass)?;
    let added = 1e-3 * mass;
    let mut changes = BTreeMap::from([(at, added)]);
    let mut com = [0.0; 3];
    for (k, own_com) in com.iter_mut().enumerate() {
        let (at, value) = own(Role::CenterOfMass(k))?;
        *own_com = value;
        let next = (mass * value + added * tool[k]) / (mass + added);
        changes.insert(at, next - value);
    }
    // About the common centre of mass, two bodies at a distance add their reduced mass.
    let d = [0, 1, 2].map(|k| tool[k] - com[k]);
    let reduced = mass * added / (mass + added);
    let square: f64 = d.iter().map(|x| x * x).sum();
    for (k, (i, j)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
        .into_iter()
        .enumerate()
    {
        let (at, _) = own(Role::Inertia(k))?;
        let diagonal = if i == j { square } else { 0.0 };
        changes.insert(at, reduced * (diagonal - d[i] * d[j]));
    }
    Some((changes, added))
}

//! Simulation.

use pyo3::prelude::*;
use simtrue::cli::open;
use simtrue::data::{
    Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
};
use simtrue::diagnosis::with_effects::Assembled;
use simtrue::dynamics::Hessian;
use simtrue::fit::integrate::{Drive, Settings, simulate as simulated};
use simtrue::logs::Joint;

use crate::arrays::{array, reals};
use crate::robot::Robot;
use crate::work::{Stops, run};

/// Positions and velocities, one row per time.
type Motion<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);

/// A motion to compute.
struct Asked {
    t: Vec<f64>,
    u: Vec<f64>,
    q0: Vec<f64>,
    v0: Vec<f64>,
    hold: InputHold,
    /// Values of parameters in place of nominal ones.
    values: Vec<(String, f64)>,
}

/// Simulates a robot with its effects. Shapes are those that the Python side has checked: `t` N, `u` N × n,
/// `q0` and `v0` n.
#[pyfunction]
#[pyo3(signature = (robot, t, u, q0, v0, *, linear, values))]
#[allow(clippy::too_many_arguments)] // keyword arguments of Python
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    robot: &Robot,
    t: &[u8],
    u: &[u8],
    q0: &[u8],
    v0: &[u8],
    linear: bool,
    values: Vec<(String, f64)>,
) -> PyResult<Motion<'py>> {
    let asked = Asked {
        t: reals(t),
        u: reals(u),
        q0: reals(q0),
        v0: reals(v0),
        hold: match linear {
            true => InputHold::Linear,
            false => InputHold::ZeroOrder,
        },
        values,
    };
    let (read, declared) = (robot.read.clone(), robot.declared);
    let joints = asked.q0.len();
    let work = move |_: &_| match declared {
        Some(model) => motion(model, &asked),
        None => of_description(&read, asked),
    };
    let ((q, v), _) = run(py, Stops::Never, None, work)?;
    Ok((array(py, &q, Some(joints))?, array(py, &v, Some(joints))?))
}

/// With effects, states that no sensor reads start at rest, and inputs get the columns that these need.
fn of_description(robot: &open::Robot, mut asked: Asked) -> Result<(Vec<f64>, Vec<f64>), String> {
    let nominal = &robot.nominal;
    if nominal.effects().is_empty() {
        let plain = Assembled::without_effects(nominal).map_err(|e| e.to_string())?;
        return motion(plain.model.as_ref(), &asked);
    }
    let mut dataset = as_record(robot, &asked);
    let with = Assembled::new(nominal, &mut dataset).map_err(|e| e.to_string())?;
    let (joints, all) = (asked.q0.len(), with.model.dims().nq);
    let record = dataset.experiments.swap_remove(0);
    let first = |values: &[f64]| -> Vec<f64> {
        let known = values.iter().take(all);
        known
            .map(|x| if x.is_finite() { *x } else { 0.0 })
            .collect()
    };
    asked.q0 = first(&record.q);
    asked.v0 = first(&record.v.unwrap_or_default());
    asked.v0.resize(all, 0.0);
    asked.u = record.u;
    let (q, v) = motion(with.model.as_ref(), &asked)?;
    let kept = |values: &[f64]| -> Vec<f64> {
        let rows = values.chunks_exact(all.max(1));
        rows.flat_map(|row| row[..joints].iter().copied()).collect()
    };
    Ok((kept(&q), kept(&v)))
}

/// The start and the inputs as a record that stands still.
fn as_record(robot: &open::Robot, asked: &Asked) -> Dataset {
    let again = |values: &[f64]| values.repeat(asked.t.len());
    let channels = |joint: Joint| {
        let input = joint.input.unwrap_or(match joint.prismatic {
            true => InputQuantity::Force,
            false => InputQuantity::Torque,
        });
        JointChannels {
            name: joint.name,
            prismatic: joint.prismatic,
            input,
            input_unit: input.unit().to_owned(),
            velocity: VelocityKind::Measured,
        }
    };
    Dataset {
        name: robot.nominal.robot().name.clone(),
        title: String::new(),
        source: String::new(),
        license: String::new(),
        kind: Kind::Simulated,
        input_hold: asked.hold,
        joints: robot.joints().into_iter().map(channels).collect(),
        experiments: vec![Experiment {
            name: "simulation".to_owned(),
            role: Role::Train,
            note: String::new(),
            nq: asked.q0.len(),
            t: asked.t.clone(),
            q: again(&asked.q0),
            v: Some(again(&asked.v0)),
            u: asked.u.clone(),
            tau: None,
            qref: None,
            missing: 0,
            gain_factors: Default::default(),
        }],
        warnings: Vec::new(),
    }
}

fn motion(model: &dyn Hessian, asked: &Asked) -> Result<(Vec<f64>, Vec<f64>), String> {
    let mut p: Vec<f64> = model.params().iter().map(|p| p.nominal).collect();
    for (name, value) in &asked.values {
        let place = model.params().iter().position(|i| i.name == *name);
        let place = place.ok_or_else(|| {
            let names: Vec<&str> = model.params().iter().map(|p| p.name.as_ref()).collect();
            format!(
                "parameters: the robot has no `{name}`\n  help: its parameters are {}",
                names.join(", ")
            )
        })?;
        p[place] = *value;
    }
    let drive = Drive {
        t: &asked.t,
        u: &asked.u,
        hold: asked.hold,
    };
    let found = simulated(model, &p, &asked.q0, &asked.v0, &drive, Settings::default());
    found.map(|m| (m.q, m.v)).map_err(|e| e.to_string())
}

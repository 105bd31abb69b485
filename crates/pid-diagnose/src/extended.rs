//! What the diagnosis found as a description (`extended.toml`).

use pid_data::{Dataset, Role};
use pid_interpret::nominal::{self as description, Gain, Simulated, SimulatedJoint};

use crate::case::{Case, CaseError};
use crate::described::stated;
use crate::first;
use crate::gap::{Gap, gap};
use crate::hypothesis::Hypothesis;
use crate::nominal::Nominal;
use crate::search::{Evidence, intervals};

/// The nominal description of a diagnosed case with the values and effects that the diagnosis
/// found. `case` is the one that was diagnosed, its records in the roles of the data set.
pub fn extended(case: &Case, found: &Evidence) -> description::Nominal {
    let (own, fit) = (&found.case, &found.fit);
    let nominal = &own.nominal.description;
    let values = own.nominal.parameters(&fit.point.theta);
    let mut effects = nominal.effects().to_vec();
    let intervals = intervals(own, &found.criteria, fit);
    let mut at = 0;
    for term in &fit.hypothesis.terms {
        let to = at + term.effect.info().parameters.len();
        effects.push(stated(
            nominal,
            term,
            &fit.point.e[at..to],
            &intervals[at..to],
        ));
        at = to;
    }
    let joints = own.noise.iter().zip(&own.scale);
    let fitted = |name: &String| {
        let of = |case: &Case, role| {
            let mut records = case.records.iter();
            records.any(|r| r.name == *name && r.role == role)
        };
        of(case, Role::Test) && of(own, Role::Train)
    };
    let run = own.run(&fit.hypothesis);
    let simulated = Simulated {
        joints: joints
            .map(|(noise, scale)| SimulatedJoint {
                position_noise: noise.q,
                velocity_noise: noise.v,
                torque_noise: noise.torque,
                passed_noise: noise.passed,
                torque: scale.torque,
                inertia: scale.inertia,
            })
            .collect(),
        substeps: run.finer,
        short_substeps: run.short,
        hidden_states: run.initial_states,
        fitted_records: {
            let names = case.records.iter().map(|r| r.name.clone());
            names.filter(fitted).collect()
        },
    };
    let servos = own.nominal.servos(&fit.point.theta);
    // What is found of the robot changes nothing in a drive that is found to know it.
    let mut terms = fit.hypothesis.terms.iter();
    let knowing = terms
        .any(|term| term.effect.stage().is_some_and(Gain::needs_model))
        .then(|| nominal.clone().with_drive_models());
    knowing
        .as_ref()
        .unwrap_or(nominal)
        .extended(&values, effects, Some(simulated))
        .with_servos(servos)
}

/// Free-run gap of a described robot with its effects, on the test records.
///
/// # Errors
/// As [`Case::new`].
pub fn free_run_gap(nominal: Nominal, dataset: &Dataset) -> Result<Gap, CaseError> {
    let fitted = match nominal.description.simulated() {
        Some(simulated) => simulated.fitted_records.clone(),
        None => Vec::new(),
    };
    let mut case = Case::new(nominal, dataset)?;
    for record in &mut case.records {
        if fitted.contains(&record.name) {
            record.role = Role::Train;
        }
    }
    let theta = vec![0.0; case.nominal.size()];
    let none = Hypothesis::default();
    let case = first::as_described(case);
    Ok(gap(&case, &none, &theta, &[], Role::Test))
}

//! Checks a record against a robot before anything is fitted on it.
//!
//! A log with swapped columns, a wrong sign or degrees for radians costs minutes of fitting and ends in
//! nonsense. [`check`] compares a data set with a nominal description and lists what contradicts it:
//! each [`Finding`] has its place, its numbers, a sentence and a mend. [`fix`] mends what can be
//! mended safely, and [`open`] reads a folder that the reader refuses for repeated time stamps.
//!
//! Three kinds of evidence decide:
//!
//! - the channels by themselves (zero, frozen, doubled, wrapped, holes in time);
//! - recorded velocities against the slopes of the positions (order, sign, unit, unit of time);
//! - recorded inputs against the torque that the nominal robot needs for the recorded motion, `M a + b`
//!   with free friction. The record as it is competes with its alternatives (other order, sign, unit,
//!   gravity, shift of the inputs); an alternative wins that leaves far less of the torque unexplained.
//!
//! Effects that a nominal model lacks (friction laws, delays, payloads, tilts) are not faults of a record:
//! `docs/preflight.md` describes every finding and where the line is drawn.

mod channels;
mod clock;
mod columns;
mod contest;
mod criteria;
mod excitation;
mod faults;
mod finding;
mod fix;
mod gravity;
mod lag;
mod limits;
mod motion;
mod open;
mod orders;
mod read;
mod torque;
mod units;
mod velocity;
mod wrap;

use pid_data::{Dataset, Experiment, InputQuantity};
use pid_interpret::nominal::{Nominal, Velocity};

pub use criteria::{Criteria, Settings};
pub use finding::{Channel, Evidence, Finding, FindingKind, Missing, Severity};
pub use fix::{fix, mended_gravity};
pub use read::{Opened, open};

use contest::Contest;
use motion::Motion;
use torque::Bench;

/// Faults that are looked for one after the other, each with those before it mended; more than a
/// handful in one record is a record of another robot.
const ROUNDS: usize = 6;

/// Everything that is found in a data set of a robot, the worst first.
///
/// The order of joints and of columns is that of the description, base to tip. A data set that does not fit
/// the description (number or kind of joints, units of inputs) gives
/// [`FindingKind::NotComparable`], and only its channels are checked.
pub fn check(data: &Dataset, nominal: &Nominal, settings: &Settings) -> Vec<Finding> {
    let criteria = &settings.criteria;
    let mut work = data.clone();
    let mut out = Vec::new();
    let bench = match bench(data, nominal) {
        Ok(bench) => Some(bench),
        Err(finding) => {
            out.push(*finding);
            None
        }
    };
    let mut take = |work: &mut Dataset, findings: Vec<Finding>| {
        for finding in &findings {
            fix::apply(work, finding);
        }
        out.extend(findings);
    };
    let time = units::time(&work, bench.as_ref(), settings);
    take(&mut work, time.into_iter().collect());
    let wraps = wrap::check(&work, criteria);
    take(&mut work, wraps);
    let mut channels = channels::check(&work, criteria);
    channels.retain(|f| {
        let follows = |j: &usize| follows_targets(data, nominal, *j - 1);
        f.kind != FindingKind::ZeroInput || !f.joints.iter().all(follows)
    });
    let silent = channels
        .iter()
        .any(|f| f.kind == FindingKind::ZeroInput && f.joints.len() == data.nq());
    if let (true, Some(bench)) = (silent, &bench) {
        free_motion(&mut channels, &work, bench, settings);
    }
    take(&mut work, channels);
    let jumps = wrap::jumps(&work, criteria);
    take(&mut work, jumps);
    let filters: Vec<Option<f64>> = nominal
        .measurement()
        .channels
        .iter()
        .map(|c| {
            if let Velocity::Derived { filter_hz } = c.velocity {
                filter_hz
            } else {
                None
            }
        })
        .collect();
    let timing = clock::check(&work, &filters, criteria);
    match bench {
        Some(bench) => {
            let found = against_robot(&mut work, nominal, bench, silent, settings);
            out.extend(found);
        }
        None => {
            let motion = Motion::sample(&work, settings);
            out.extend(velocity::check(&motion, None, criteria));
        }
    }
    out.extend(timing);
    out.sort_by_key(|f| std::cmp::Reverse(f.severity));
    out
}

/// Zero inputs are right where the motion is that of the robot left alone: a swing, a fall.
fn free_motion(findings: &mut [Finding], data: &Dataset, bench: &Bench, settings: &Settings) {
    let motion = Motion::sample(data, settings);
    let torques = bench.torques(&motion);
    let left = gravity::left_of_free_motion(bench, &motion, &torques, &settings.criteria);
    let Some(left) = left.filter(|left| *left < settings.criteria.free) else {
        return;
    };
    for finding in findings
        .iter_mut()
        .filter(|f| f.kind == FindingKind::ZeroInput)
    {
        finding.severity = Severity::Note;
        "all inputs are zero, and the motion is that of the robot left alone"
            .clone_into(&mut finding.sentence);
        "nothing, if the drives were off".clone_into(&mut finding.mend);
        finding.evidence.push(Evidence {
            what: "share of gravity's torque that inertia and friction leave".to_owned(),
            value: left,
            unit: "1".to_owned(),
        });
    }
}

/// Whether a joint has a target for its position loop and no other input.
fn follows_targets(data: &Dataset, nominal: &Nominal, j: usize) -> bool {
    let nothing = |e: &Experiment| {
        let nu = e.nu().max(1);
        e.has_targets() && e.u.iter().skip(j).step_by(nu).all(|u| *u == 0.0)
    };
    let as_input = data.joints[j].input == InputQuantity::Position;
    nominal.servo(j).is_some() && (as_input || data.experiments.iter().all(nothing))
}

/// The robot, if the data can be compared with it.
fn bench(data: &Dataset, nominal: &Nominal) -> Result<Bench, Box<Finding>> {
    let refuse = |text: String| {
        Box::new(Finding::new(
            FindingKind::NotComparable,
            Severity::Wrong,
            format!("the record cannot be compared with the robot: {text}"),
            "make the data set and the description agree in joints and inputs",
        ))
    };
    if nominal.drives().is_some() {
        let mut finding = refuse("its drives move several joints at once".to_owned());
        finding.severity = Severity::Note;
        "nothing: only the channels by themselves are checked".clone_into(&mut finding.mend);
        return Err(finding);
    }
    if (0..data.nq()).any(|j| follows_targets(data, nominal, j)) {
        let mut finding =
            refuse("its inputs are targets of position loops, not torques".to_owned());
        finding.severity = Severity::Note;
        "nothing: only the channels by themselves are checked".clone_into(&mut finding.mend);
        return Err(finding);
    }
    let bench = Bench::new(nominal).map_err(|e| refuse(e.to_string()))?;
    data.check_model(&bench.model)
        .map_err(|e| refuse(e.to_string()))?;
    Ok(bench)
}

/// Order, signs, units, gravity, clock of the inputs, one after the other; then what is stated and told.
fn against_robot(
    work: &mut Dataset,
    nominal: &Nominal,
    mut bench: Bench,
    silent: bool,
    settings: &Settings,
) -> Vec<Finding> {
    let criteria = &settings.criteria;
    let mut out = Vec::new();
    let mut motion = Motion::sample(work, settings);
    for _ in 0..ROUNDS {
        let found = velocity::check(&motion, (!silent).then_some(&bench), criteria).or_else(|| {
            let torques = bench.torques(&motion);
            (!silent)
                .then(|| Contest::new(&bench, &motion, &torques, criteria).best(work))
                .flatten()
        });
        let Some(finding) = found else { break };
        match &finding.kind {
            FindingKind::Gravity { found, .. } => {
                if let Some(k) = bench.gravity {
                    bench.p[k..k + 3].copy_from_slice(found);
                }
            }
            _ => {
                let mended = fix::apply(work, &finding).is_some();
                if !mended {
                    out.push(finding);
                    break;
                }
                motion = Motion::sample(work, settings);
            }
        }
        out.push(finding);
    }
    out.extend(velocity::mismatch(&motion, criteria));
    if motion.len() == 0 {
        return out;
    }
    out.extend(limits::check(&bench, nominal, &motion, criteria));
    let torques = bench.torques(&motion);
    let contest = Contest::new(&bench, &motion, &torques, criteria);
    if !silent {
        out.extend(contest.unexplained());
        out.extend(gravity::check(
            &bench,
            &motion,
            &torques,
            &contest.base,
            criteria,
        ));
        let rigid = torques.with(bench.stated());
        out.extend(gravity::at_rest(
            &bench,
            nominal,
            &motion,
            &rigid,
            &contest.base,
        ));
    }
    if settings.determinable {
        let seconds = work.experiments.iter().map(Experiment::duration).sum();
        out.extend(excitation::check(
            &bench,
            nominal,
            &motion,
            &contest.base,
            seconds,
            criteria,
        ));
    }
    out
}

//! `pid-studies servo`: drawn cases behind position loops, with targets and positions alone, diagnosed
//! blind, then scored by law.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use pid_cli::output;
use pid_cli::progress::Progress;
use pid_diagnose::diagnosis::Verdict;
use pid_diagnose::loop_gain::{LoopGain, Told};
use pid_diagnose::search::Settings;
use pid_fleet::Slice;
use pid_withheld::{Drawing, Law, Loop, Plan, ServoPlan, ServoTruth, Servos};

use crate::Failure;
use crate::withheld::{Outcome, Share, diagnose_some, right, summary, tier};

/// Arguments of `pid-studies servo`.
#[derive(Debug, Clone, Args)]
pub struct ServoArgs {
    /// Number of cases.
    #[arg(long, default_value_t = 24)]
    cases: usize,
    /// Seed of robots, loops, causes, magnitudes, motions and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Most joints of a robot; up to 3, robots have one or two where --fewest is below 3.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=6))]
    joints: u8,
    /// Fewest joints of a robot; from 3 on all are arms of as many as --joints says.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=6))]
    fewest: u8,
    /// One law for all cases: p, pd, pid or cascade.
    #[arg(long, value_parser = law)]
    law: Option<Law>,
    /// Legs of three joints under a policy: damped loops at 1 kHz with unknown gains, targets at 50 Hz.
    #[arg(long, conflicts_with_all = ["law", "joints", "fewest"])]
    legs: bool,
    /// Only elastic joints, and loops that read late, of a size to ring: how often one is told from the other.
    #[arg(long, conflicts_with_all = ["legs", "nulls", "outside"])]
    resonant: bool,
    /// Only loops with a stage that their description does not state: a filter or a largest speed of the target,
    /// feed-forward of gravity or of the target's velocity, a delay of what the loop reads.
    #[arg(long, conflicts_with_all = ["legs", "nulls", "outside", "resonant"])]
    unstated: bool,
    /// Only cases without a cause: the rate of false alarms.
    #[arg(long)]
    nulls: bool,
    /// Only cases with a cause outside the list.
    #[arg(long, conflicts_with = "nulls")]
    outside: bool,
    /// Only the K-th of N parts of the cases, K from 1.
    #[arg(long, value_name = "K/N", default_value = "1/1")]
    slice: Slice,
    /// Folder for cases, causes and diagnoses; results that are there already are kept.
    #[arg(long, short, value_name = "FOLDER", default_value = "simtrue-servo")]
    out: PathBuf,
}

fn law(word: &str) -> Result<Law, String> {
    let mut all = Law::ALL.into_iter();
    all.find(|law| law.word() == word)
        .ok_or_else(|| format!("no law `{word}`: p, pd, pid or cascade"))
}

/// Runs or continues the study and prints a line per case and figures by law.
///
/// # Errors
/// What stops it.
pub fn run(args: &ServoArgs) -> Result<u8, Failure> {
    let (fewest, joints) = crate::joints(args.fewest, args.joints)?;
    let plan = ServoPlan {
        plan: Plan {
            seed: args.seed,
            cases: args.cases,
            fewest,
            joints,
            causes: match (args.nulls, args.outside) {
                (true, _) => Drawing::Nothing,
                (_, true) => Drawing::Outside,
                _ => Drawing::All,
            },
        },
        law: args.law,
        servos: match (args.legs, args.resonant, args.unstated) {
            (true, ..) => Servos::Legs,
            (_, true, _) => Servos::Resonant,
            (.., true) => Servos::Unstated,
            _ => Servos::All,
        },
    };
    let wanted: Vec<usize> = args.slice.of(args.cases).collect();
    let progress = Progress::start("drawing cases");
    let settings = Settings::default();
    let outcomes = diagnose_some(&plan, &wanted, &settings, &args.out, &|done, of| {
        progress.step(format!("{done} of {of} cases"));
    })?;
    drop(progress);
    output::print(&to_text(&outcomes));
    Ok(0)
}

/// A case as one without loops.
fn plain(o: &Outcome<ServoTruth>) -> Outcome {
    Outcome {
        id: o.id.clone(),
        truth: o.truth.truth.clone(),
        diagnosis: o.diagnosis.clone(),
    }
}

/// Figures of one law.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ByLaw {
    /// Verdict right where one cause of the list is hidden, by tier.
    pub right: BTreeMap<String, Share>,
    /// Something named where nothing is.
    pub false_alarms: Share,
    /// `unknown` where the cause is outside the list.
    pub abstained: Share,
    /// `unknown` said of a cause of the list.
    pub gave_up: Share,
    /// `none` said of a cause of the list.
    pub missed: Share,
    /// Gains that are called determined and lie within 5 % of the truth.
    pub gains: Share,
    /// Gains that are called determined, of all that are not exact.
    pub determined: Share,
}

/// A gain as it is in truth.
fn truth_of(own: &Loop, gain: &str) -> Option<f64> {
    match gain {
        "kp" => Some(own.kp),
        "kd" | "kv" => Some(own.kd),
        "ki" => Some(own.ki),
        "gravity" => own.gravity,
        "velocity_feed_forward" => own.target_share,
        "target_speed" => own.target_speed,
        "target_acceleration" => own.target_acceleration,
        "target_average_s" => own.target_average,
        "inertia_feed_forward" => own.inertia,
        "target_filter_s" => own.target_filter,
        "velocity_filter_s" => own.speed_filter,
        "feedback_delay_s" => own.read_late,
        _ => None,
    }
}

/// Whether a gain lies within 5 % of the truth; `None` where the loop has no such.
fn within(truth: &ServoTruth, g: &LoopGain) -> Option<bool> {
    let own = truth.loops.get(g.joint.checked_sub(1)?)?;
    Some((g.value / truth_of(own, &g.gain)? - 1.0).abs() <= 0.05)
}

/// Figures by law.
pub fn by_law(outcomes: &[Outcome<ServoTruth>]) -> BTreeMap<Law, ByLaw> {
    let mut out: BTreeMap<Law, ByLaw> = BTreeMap::new();
    for o in outcomes {
        let Some(first) = o.truth.loops.first() else {
            continue;
        };
        let own = out.entry(first.law).or_default();
        for g in &o.diagnosis.loop_gains {
            own.determined.add(g.told == Told::Determined);
            if let (Told::Determined, Some(holds)) = (g.told, within(&o.truth, g)) {
                own.gains.add(holds);
            }
        }
        let case = plain(o);
        let hit = right(&case);
        let hidden = &case.truth.causes;
        if hidden.is_empty() {
            own.false_alarms.add(!hit);
        } else if hidden.iter().any(|c| c.kind.id() == "unknown") {
            own.abstained.add(hit);
        } else {
            own.right
                .entry(tier(&case).to_owned())
                .or_default()
                .add(hit);
            own.gave_up.add(case.diagnosis.verdict == Verdict::Unknown);
            own.missed.add(case.diagnosis.verdict == Verdict::Nothing);
        }
    }
    out
}

/// Effects that are late.
const LATE: [&str; 5] = [
    "feedback_delay",
    "actuator_lag",
    "input_delay",
    "sensor_delay",
    "command_filter",
];

/// Elastic joints and delays of which the one is named and the other not.
fn apart(outcomes: &[Outcome<ServoTruth>]) -> Share {
    let mut out = Share::default();
    for o in outcomes {
        let [cause] = &o.truth.truth.causes[..] else {
            continue;
        };
        let named = |ids: &[&str]| {
            o.diagnosis
                .effects
                .iter()
                .any(|e| ids.contains(&&*e.effect))
        };
        let (elastic, late) = (named(&["joint_elasticity"]), named(&LATE));
        match cause.kind.id() {
            "joint_elasticity" if o.id.starts_with("resonant") => out.add(elastic && !late),
            "feedback_delay" if o.id.starts_with("resonant") => out.add(late && !elastic),
            _ => {}
        }
    }
    out
}

/// What stands beside the law of a loop.
fn stages(own: &Loop) -> String {
    let all = [
        ("gravity", own.gravity.is_some()),
        ("velocity filter", own.speed_filter.is_some()),
        ("dead band", own.dead_band.is_some()),
        ("steps", own.target_step.is_some()),
        ("slow targets", own.target_rate.is_some()),
        ("slew", own.target_speed.is_some()),
        ("target filter", own.target_filter.is_some()),
    ];
    let there: Vec<&str> = all.iter().filter(|(_, x)| *x).map(|(n, _)| *n).collect();
    there.join(", ")
}

/// A line per case, figures by law, and those of all.
fn to_text(outcomes: &[Outcome<ServoTruth>]) -> String {
    let mut text = String::new();
    // Writing to a text cannot fail.
    for o in outcomes {
        let (case, d) = (plain(o), &o.diagnosis);
        let hidden: Vec<String> = (case.truth.causes.iter())
            .map(|c| format!("{}@{}", c.kind.id(), c.joint + 1))
            .collect();
        let (law, beside) = match o.truth.loops.first() {
            Some(own) => (own.law.word(), stages(own)),
            None => ("", String::new()),
        };
        let _ = writeln!(
            text,
            "{} {} {law} [{beside}] {:?} {} Hz, {} joints: {} -> {} at {:?}, gap {:.4} to {:.4}, floor {:.4}, {:.0} s",
            if right(&case) { "right" } else { "WRONG" },
            o.id,
            o.truth.stated,
            o.truth.rate,
            case.truth.joints,
            if hidden.is_empty() {
                "nothing".to_owned()
            } else {
                hidden.join(" + ")
            },
            d.verdict.word(),
            d.verdict.joint(),
            d.gap_before,
            d.gap_after,
            d.gap_floor,
            d.seconds,
        );
    }
    let of = |x: &Share| format!("{} of {}", x.hits, x.of);
    for (law, own) in by_law(outcomes) {
        let _ = writeln!(text, "law {}", law.word());
        let mut row = |name: &str, x: &Share| {
            let _ = writeln!(text, "  {name:42} {}", of(x));
        };
        for (tier, x) in &own.right {
            row(&format!("effect right, {tier}"), x);
        }
        row("false alarms", &own.false_alarms);
        row("unknown recognised", &own.abstained);
        row("unknown said of a listed effect", &own.gave_up);
        row("none said of an effect", &own.missed);
        row("determined gains within 5 %", &own.gains);
        row("gains that are called determined", &own.determined);
    }
    let told = apart(outcomes);
    if told.of > 0 {
        let _ = writeln!(text, "elasticity told from delay: {}", of(&told));
    }
    let _ = writeln!(text, "all {} cases", outcomes.len());
    let all: Vec<Outcome> = outcomes.iter().map(plain).collect();
    for (name, figures) in summary(&all).lines() {
        let _ = writeln!(text, "  {name:42} {figures}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use pid_withheld::Study;

    /// A drawn case is a folder that the diagnosis reads, whose loops are the drawn ones.
    #[test]
    fn cases_are_read_with_their_loops() {
        let some = Law::ALL.map(|law| (Some(law), Servos::All));
        let more = [Servos::Legs, Servos::Resonant, Servos::Unstated];
        for (law, servos) in some.into_iter().chain(more.map(|own| (None, own))) {
            let plan = ServoPlan {
                plan: Plan {
                    seed: 5,
                    cases: 1,
                    fewest: 1,
                    joints: 2,
                    causes: Drawing::Nothing,
                },
                law,
                servos,
            };
            let legs = servos == Servos::Legs;
            let folder = tempfile::tempdir().expect("a folder");
            let here = pid_withheld::lay_out(&plan, 0, folder.path()).expect("a case");
            let case = pid_diagnose::case::Case::read(&here).expect("a case");
            let (_, truth) = plan.make(0).expect("a case");
            assert_eq!(truth.loops.len(), case.n());
            assert_eq!(case.n() == 3, legs, "{} joints", case.n());
            for (j, own) in truth.loops.iter().enumerate() {
                let servo = case.nominal.description.servo(j).expect("a loop");
                assert_eq!(servo.law.word(), own.law.word());
                assert_eq!(servo.rate_hz, own.rate);
                assert_eq!(servo.shaping.rate_hz, own.target_rate);
            }
        }
    }
}

//! Unknown gains of position loops whose range about their start is too narrow.
//!
//! A gain that is not stated may lie anywhere, and a fit has ranges. Where the fit of the nominal structure ends at
//! the end of the range of such a gain, the range moves there, until no gain is held by it.

use pid_interpret::nominal::{Gain, Role as Part, ServoGain};

use super::begin::reach;
use crate::case::Case;
use crate::fit::{Effort, Point, basis, fit};
use crate::hypothesis::Hypothesis;

/// Deviation, in ranges, from which a gain counts as held by its range.
const HELD: f64 = 0.999;
/// A range that moves up has its middle so many times as far as its end was: it reaches 3.6 times as far.
const UP: f64 = 1.9;
/// Moves at most before the search: the last range reaches 90 times as far as the first.
const MOVES: usize = 4;
/// Steps of each fit: what is asked is whether it runs against a range.
const STEPS: usize = 8;
/// Share of a range below which a gain counts as none: the range would vanish with it.
const NONE: f64 = 1e-3;

/// A case whose unknown gains have ranges that hold the fit of the nominal structure; `None` where they have as
/// it is.
pub(crate) fn centred(case: &Case) -> Option<Case> {
    if unknown(case).is_empty() {
        return None;
    }
    let mut out = case.clone();
    let mut moves = 0;
    let mut theta = vec![0.0; case.nominal.size()];
    while moves < MOVES {
        let at = Point {
            theta,
            e: Vec::new(),
        };
        let effort = Effort::on_the_way(STEPS);
        let found = fit(&out, &basis(&out), &Hypothesis::default(), at, effort);
        theta = found.point.theta;
        if !moved(&mut out, &mut theta) {
            break;
        }
        moves += 1;
    }
    (moves > 0).then_some(out)
}

/// A case whose ranges of unknown gains have moved to where a fit with deviations `theta` ran against them;
/// `None` where it did not.
pub(crate) fn recentred(case: &Case, theta: &[f64]) -> Option<Case> {
    let mut out = case.clone();
    moved(&mut out, &mut theta.to_vec()).then_some(out)
}

/// Moves the ranges of unknown gains that hold a fit, and its deviations with them; whether there are any.
fn moved(case: &mut Case, theta: &mut [f64]) -> bool {
    let mut any = false;
    for (joint, gain, place) in unknown(case) {
        let own = &case.nominal.values[place];
        let end = own.nominal + own.half_width * theta[place];
        if theta[place].abs() < HELD || end.abs() < NONE * own.half_width {
            continue;
        }
        let middle = match end.abs() > own.nominal.abs() {
            true => UP * end,
            false => end,
        };
        let half_width = reach(gain, middle.abs());
        let value = Some(middle);
        let start = ServoGain { value, half_width };
        case.nominal.begin_servo(joint, gain, start);
        theta[place] = (end - middle) / half_width;
        any = true;
    }
    any
}

/// Joints, gains and places of the values that are not stated.
fn unknown(case: &Case) -> Vec<(usize, Gain, usize)> {
    let looped = (0..case.n()).filter_map(|j| Some((j, case.nominal.description.servo(j)?)));
    let each = looped.flat_map(|(j, servo)| {
        let open = servo.gains().filter(|&g| servo.gain(g).value.is_none());
        open.filter_map(move |g| Some((j, g, case.nominal.place(j, Part::Servo(g))?)))
    });
    each.collect()
}

#[cfg(test)]
mod tests {
    use pid_data::{
        Dataset, Experiment, InputHold, InputQuantity, JointChannels, Kind, Role, VelocityKind,
    };

    use super::*;
    use crate::nominal::Nominal;

    const STEP: f64 = 0.01;

    /// A bar that follows its target late, with these gains.
    fn case(kp: &str, kd: &str) -> Case {
        let text = format!(
            "[robot]\nname = \"bar\"\ngravity = [0.0, 0.0, -9.81]\n[tolerance]\nmass_rel = 0.05\ncom_abs_m = 0.003\n\
             inertia_rel = 0.05\nrotor_inertia_rel = 0.05\nmotor_gain_rel = 0.01\nfriction_rel = 0.4\n[[joint]]\nname = \"a\"\ntype = \"revolute\"\n\
             axis = [0.0, 1.0, 0.0]\norigin = [0.0, 0.0, 0.0]\nmass = 1.0\ncom = [0.0, 0.0, -0.1]\n\
             inertia = [0.01, 0.01, 0.001, 0.0, 0.0, 0.0]\nrotor_inertia = 0.01\ncoulomb = 0.1\nviscous = 0.1\n\
             motor_gain = 1.0\ninput = \"torque\"\nvelocity = \"absent\"\n[joint.drive]\nlaw = \"pd\"\nkp = {kp}\nkd = {kd}\n"
        );
        let nominal = Nominal::parse(&text, "nominal.toml".as_ref()).expect("a description");
        let t: Vec<f64> = (0..400).map(|k| STEP * f64::from(k)).collect();
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { t.iter().map(|t| f(*t)).collect() };
        let target = of(&|t| 0.5 * (3.0 * t).sin() + 0.3 * (3.0 * t).cos() - 0.3);
        let record = |role| Experiment {
            name: format!("{role:?}"),
            role,
            note: String::new(),
            nq: 1,
            q: of(&|t| 0.5 * (3.0 * t).sin()),
            t: t.clone(),
            v: None,
            u: target.clone(),
            tau: None,
            qref: Some(target.clone()),
            missing: 0,
        };
        let dataset = Dataset {
            name: "bar".to_owned(),
            title: String::new(),
            source: "simulated".to_owned(),
            license: "none".to_owned(),
            kind: Kind::Simulated,
            input_hold: InputHold::ZeroOrder,
            joints: vec![JointChannels {
                name: "a".to_owned(),
                prismatic: false,
                input: InputQuantity::Position,
                input_unit: "rad".to_owned(),
                velocity: VelocityKind::Absent,
            }],
            experiments: [Role::Train, Role::Test].map(record).to_vec(),
            warnings: Vec::new(),
        };
        Case::new(nominal, &dataset).expect("a case")
    }

    #[test]
    fn a_range_moves_where_a_fit_runs_against_it() {
        let case = case("{ unknown = true }", "{ value = 0.5, tolerance = 0.1 }");
        let open = unknown(&case);
        let [(0, Gain::Kp, kp)] = open[..] else {
            panic!("{open:?}")
        };
        let before = case.nominal.values[kp].clone();
        let mut theta = vec![0.0; case.nominal.size()];
        assert!(recentred(&case, &theta).is_none(), "nothing holds it");
        let kd = case
            .nominal
            .place(0, Part::Servo(Gain::Kd))
            .expect("a gain");
        theta[kd] = 1.0;
        assert!(recentred(&case, &theta).is_none(), "kd is stated");
        for (end, reach) in [(1.0, 1.9 * 1.9 * 1.9), (-1.0, 0.1 * 1.9)] {
            let mut moved_theta = theta.clone();
            moved_theta[kp] = end;
            let mut out = case.clone();
            assert!(moved(&mut out, &mut moved_theta));
            let own = &out.nominal.values[kp];
            let most = own.nominal + own.half_width;
            assert!((most / before.nominal - reach).abs() < 1e-9, "{most}");
            // The fit goes on from where it ended.
            let value = own.nominal + own.half_width * moved_theta[kp];
            let ended = before.nominal + before.half_width * end;
            assert!((value / ended - 1.0).abs() < 1e-9, "{value} {ended}");
        }
    }
}

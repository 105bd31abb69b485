//! The loops by which drives follow the targets of a log, where the robot file is no description of them.
//!
//! A log of commanded positions without an input has its motion from loops inside the drives. An MJCF may
//! state them; of others the gains are unknown.

use pid_data::{Dataset, InputQuantity};
use pid_interpret::nominal::{Gain, Nominal, Servo, ServoGain, ServoLaw};
use pid_logs::Assumption;
use pid_mjcf::Mjcf;

use crate::args::open::DriveArg;

/// How far a gain of a robot file may be from that of the drive, as a share: a choice, as the drawn cases of
/// `pid-studies servo` have it. Gains beyond are an effect of the diagnosis, `servo_gain`.
const TOLERANCE: f64 = 0.3;

/// Loops of an MJCF by the names of their joints.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stated(Vec<(String, Servo)>);

impl Stated {
    /// The position loops of the drives; a joint with several drives has none.
    pub(crate) fn of(model: &Mjcf) -> Self {
        let bodies = model.mechanism.bodies.iter().enumerate();
        let loops = bodies.filter_map(|(k, body)| {
            let mut own = model.actuators.iter().filter(|a| a.body == k);
            let (Some(drive), None) = (own.next(), own.next()) else {
                return None;
            };
            let stated = drive.position_loop()?;
            let mut servo = Servo::new(match stated.kd == 0.0 {
                true => ServoLaw::P,
                false => ServoLaw::Pd,
            });
            for (gain, value) in [(Gain::Kp, stated.kp), (Gain::Kd, stated.kd)] {
                if servo.has(gain) {
                    servo.set(gain, ServoGain::found(value, TOLERANCE * value));
                }
            }
            servo.limit = drive.force_on_joint();
            Some((body.joint.clone(), servo))
        });
        Self(loops.collect())
    }

    fn at(&self, joint: &str) -> Option<&Servo> {
        self.0.iter().find(|(name, _)| name == joint).map(|x| &x.1)
    }
}

/// Whether records have commanded positions and nothing that drives the robot.
pub(crate) fn targets_alone(dataset: &Dataset) -> bool {
    let position = |j: &pid_data::JointChannels| j.input == InputQuantity::Position;
    let nothing = |e: &pid_data::Experiment| e.has_targets() && e.u.iter().all(|u| *u == 0.0);
    dataset.joints.iter().all(position) || dataset.experiments.iter().all(nothing)
}

/// The description with loops that follow the targets, and what was assumed of them; `law`: that of all loops.
pub(crate) fn followed(
    nominal: Nominal,
    stated: &Stated,
    law: Option<DriveArg>,
) -> (Nominal, Vec<Assumption>) {
    if law == Some(DriveArg::None) {
        return (nominal, Vec::new());
    }
    let law = law.and_then(DriveArg::law);
    let names: Vec<String> = (nominal.measurement().channels.iter())
        .map(|channel| channel.name.clone())
        .collect();
    let of_file = |name: &str| {
        stated
            .at(name)
            .filter(|own| law.is_none_or(|law| own.law == law))
    };
    let servos = names.iter().map(|name| {
        let own = of_file(name).cloned();
        Some(own.unwrap_or_else(|| Servo::new(law.unwrap_or(ServoLaw::Pd))))
    });
    let mut assumptions = Vec::new();
    let mut say = |sentence: String| {
        assumptions.push(Assumption {
            place: String::new(),
            sentence,
        });
    };
    let why = "since the logs have commanded positions and no input";
    for name in &names {
        if let Some(own) = of_file(name) {
            let gain = |gain| own.gain(gain).value.unwrap_or(0.0);
            say(format!(
                "joint `{name}` follows its commanded position by the drive of the robot file (kp {}, kd {}, each within {} %), {why}",
                gain(Gain::Kp),
                gain(Gain::Kd),
                100.0 * TOLERANCE
            ));
        }
    }
    let unknown: Vec<String> = (names.iter())
        .filter(|name| of_file(name).is_none())
        .map(|name| format!("`{name}`"))
        .collect();
    if !unknown.is_empty() {
        let word = law.unwrap_or(ServoLaw::Pd).word();
        let other = match law {
            None => "; --drive states another law, or none",
            Some(_) => "",
        };
        let (joint, follow) = match unknown.len() {
            1 => ("joint", "follows its commanded position by a loop"),
            _ => ("joints", "follow their commanded positions by loops"),
        };
        say(format!(
            "{joint} {} {follow} `{word}` of unknown gains, {why}{other}",
            unknown.join(", ")
        ));
    }
    (nominal.with_servos(servos.collect()), assumptions)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use pid_interpret::nominal::Gain;
    use tempfile::TempDir;

    use super::*;
    use crate::args::open::OpenArgs;
    use crate::open::{Opened, open};
    use crate::samples::ARM;

    /// Positions and targets of the arm and nothing else.
    const TARGETS: &str = "t,shoulder_pos,shoulder_pos_target\n0.0,0.0,0.1\n0.01,0.01,0.1\n0.02,0.03,0.2\n0.03,0.06,0.2\n\
                           0.04,0.1,0.3\n0.05,0.15,0.3\n0.06,0.2,0.3\n0.07,0.24,0.3\n0.08,0.27,0.3\n0.09,0.29,0.3\n";

    /// The same arm with a drive of a kind.
    fn mjcf(drive: &str) -> String {
        format!(
            r#"<mujoco><worldbody><body><inertial pos="0 0 -0.17" mass="6" diaginertia="0.085 0.088 0.012"/>
<joint name="shoulder" axis="0 1 0"/></body></worldbody><actuator>{drive}</actuator></mujoco>"#
        )
    }

    fn opened(robot: (&str, &str), args: &OpenArgs) -> Result<(TempDir, Opened), String> {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at(robot.0), robot.1).expect("written");
        let logs: Vec<PathBuf> = ["a.csv", "b.csv"].map(at).to_vec();
        for log in &logs {
            std::fs::write(log, TARGETS).expect("written");
        }
        let opened = open(&at(robot.0), &logs, args).map_err(|error| error.to_string())?;
        Ok((folder, opened))
    }

    fn assumed(opened: &Opened, words: &str) -> bool {
        let mut all = opened.records.assumptions.iter();
        all.any(|a| a.sentence.contains(words))
    }

    #[test]
    fn a_urdf_follows_targets_by_loops_of_unknown_gains_that_its_folder_repeats() {
        let (folder, opened) = opened(("arm.urdf", ARM), &OpenArgs::default()).expect("records");
        let servo = opened.nominal.servo(0).expect("a loop");
        assert_eq!(*servo, Servo::new(ServoLaw::Pd));
        assert!(assumed(&opened, "loop `pd` of unknown gains"));
        assert_eq!(opened.records.warnings, Vec::<String>::new());
        let data = folder.path().join("data");
        opened.write(&data).expect("written");
        let again = Nominal::read(data.join("nominal.toml")).expect("a description");
        let again = again.servo(0).expect("a loop");
        assert_eq!(
            (again.law, again.gain(Gain::Kp)),
            (servo.law, servo.gain(Gain::Kp))
        );
    }

    #[test]
    fn the_user_states_the_law_or_that_drives_are_off() {
        let with = |drive| {
            let drive = Some(drive);
            let args = OpenArgs {
                drive,
                ..OpenArgs::default()
            };
            opened(("arm.urdf", ARM), &args).expect("records").1
        };
        let cascade = with(DriveArg::Cascade);
        assert_eq!(
            *cascade.nominal.servo(0).expect("a loop"),
            Servo::new(ServoLaw::Cascade)
        );
        let off = with(DriveArg::None);
        assert!(!off.nominal.has_servos());
        assert!(
            off.records
                .warnings
                .iter()
                .any(|w| w.contains("no drive of the robot follows them"))
        );
        let args = OpenArgs {
            drive: Some(DriveArg::P),
            ..OpenArgs::default()
        };
        let toml = off.nominal.to_toml().expect("a description");
        let error = opened(("arm.toml", &toml), &args)
            .err()
            .expect("a description states its loops");
        assert!(error.contains("--drive is for robot files"), "{error}");
    }

    #[test]
    fn the_drive_of_an_mjcf_is_its_loop() {
        // Gear 2: the control is twice the joint's position, and the torque twice the force.
        let drive = r#"<position joint="shoulder" gear="2" kp="10" kv="0.5" forcerange="-3 3"/>"#;
        let (_, own) = opened(("arm.xml", &mjcf(drive)), &OpenArgs::default()).expect("records");
        let servo = own.nominal.servo(0).expect("a loop");
        assert_eq!((servo.law, servo.limit), (ServoLaw::Pd, Some(6.0)));
        for (gain, value) in [(Gain::Kp, 40.0), (Gain::Kd, 2.0)] {
            assert_eq!(servo.gain(gain), ServoGain::found(value, 0.3 * value));
        }
        assert!(assumed(&own, "kp 40, kd 2"));
        // A motor states no loop.
        let motor = mjcf(r#"<motor joint="shoulder"/>"#);
        let (_, other) = opened(("arm.xml", &motor), &OpenArgs::default()).expect("records");
        assert_eq!(
            *other.nominal.servo(0).expect("a loop"),
            Servo::new(ServoLaw::Pd)
        );
        // The user's law has none of the file's gains.
        let args = OpenArgs {
            drive: Some(DriveArg::Pid),
            ..OpenArgs::default()
        };
        let (_, third) = opened(("arm.xml", &mjcf(drive)), &args).expect("records");
        assert_eq!(
            *third.nominal.servo(0).expect("a loop"),
            Servo::new(ServoLaw::Pid)
        );
    }

    #[test]
    fn recorded_inputs_act_and_need_no_loop() {
        let folder = tempfile::tempdir().expect("a folder");
        crate::samples::written(folder.path());
        let at = |name: &str| folder.path().join(name);
        let logs = [at("a.csv"), at("b.csv")];
        let opened = open(&at("arm.urdf"), &logs, &OpenArgs::default()).expect("records");
        assert!(!opened.nominal.has_servos() && !opened.records.targets_alone);
        let args = OpenArgs {
            drive: Some(DriveArg::P),
            ..OpenArgs::default()
        };
        let opened = open(&at("arm.urdf"), &logs, &args).expect("records");
        let mut told = opened.records.warnings.iter();
        assert!(told.any(|w| w.contains("--drive is left out")));
        assert!(!opened.nominal.has_servos());
    }
}

//! A robot by its description with its records, for commands that work on a model: a robot file with
//! logs, a folder that holds both, or `--nominal FILE FOLDER`.

use std::path::Path;

use pid_data::Dataset;
use pid_diagnose::with_effects::gain_name;
use pid_interpret::nominal::{Effect, Gain, Nominal, Servo, ServoGain};
use pid_runtime::dynamics::ParamInfo;

use crate::args::source::Source;
use crate::error::{CliError, make_folder, write};
use crate::open::{Opened, as_stated, open, robot_and_logs};
use crate::{check, output};

/// Folder below that of the results with what the run rests on.
const DATA: &str = "data";

/// The description and its records, where the arguments name one. Logs are checked against the robot
/// first, and what was made of them is written below the folder of the results.
///
/// # Errors
/// Files that cannot be read, records that contradict the robot, options that need a declared model.
pub(crate) fn described(source: &Source) -> Result<Option<Opened>, CliError> {
    if let Some((robot, logs)) = robot_and_logs(&source.paths) {
        if let Some(option) = source.of_models() {
            return Err(CliError::OptionOfModels { option });
        }
        let opened = open(robot, logs, &source.open)?;
        check::refuse_wrong(&opened, source.anyway)?;
        opened.write(&source.out.join(DATA))?;
        return Ok(Some(opened));
    }
    let (description, folder) = match (&source.nominal, source.paths.as_slice()) {
        (Some(file), [folder]) => (file.clone(), folder),
        (None, [folder]) if source.urdf.is_none() => {
            let file = folder.join("nominal.toml");
            match file.is_file() {
                true => (file, folder),
                false => return Ok(None),
            }
        }
        _ => return Ok(None),
    };
    Ok(Some(Opened {
        nominal: Nominal::read(description)?,
        records: as_stated(Dataset::read(folder)?),
    }))
}

/// Name of the description with identified values.
const IDENTIFIED: &str = "identified.toml";

/// Writes the description with the values of a fit, in the order of `params`, beside the report. Its
/// tolerances stay, now around these values.
pub(crate) fn write_identified(
    nominal: &Nominal,
    params: &[ParamInfo],
    values: &[f64],
    out: &Path,
) -> Result<(), CliError> {
    let value = |name: &str| Some(values[params.iter().position(|p| p.name == name)?]);
    let own = nominal.tolerances().iter();
    let own: Vec<f64> = own.map(|t| value(&t.name).unwrap_or(t.nominal)).collect();
    let effects = nominal.effects().iter();
    let Some(effects) = effects.map(|e| fitted(nominal, e, &value)).collect() else {
        // The equations of motion took another effect in its place.
        return Ok(());
    };
    let mut extended = nominal.extended(&own, effects, None);
    if nominal.has_servos() {
        extended = extended.with_servos(fitted_loops(nominal, &value));
    }
    let Some(text) = extended.to_toml() else {
        return Ok(());
    };
    make_folder(out)?;
    let file = out.join(IDENTIFIED);
    write(&file, &text)?;
    output::message(&format!("written: {}", file.display()));
    Ok(())
}

/// The position loops with the gains of a fit.
fn fitted_loops(nominal: &Nominal, value: &dyn Fn(&str) -> Option<f64>) -> Vec<Option<Servo>> {
    let joints = nominal.robot().joints.iter().enumerate();
    joints
        .map(|(j, joint)| {
            let mut servo = nominal.servo(j)?.clone();
            let gains: Vec<Gain> = servo.gains().collect();
            for gain in gains {
                if let Some(found) = value(&gain_name(gain, &joint.name)) {
                    servo.set(gain, ServoGain::found(found, servo.gain(gain).half_width));
                }
            }
            Some(servo)
        })
        .collect()
}

/// An effect with the values of a fit; `None` where the fit has not all of them.
fn fitted(
    nominal: &Nominal,
    effect: &Effect,
    value: &dyn Fn(&str) -> Option<f64>,
) -> Option<Effect> {
    let mut own = effect.clone();
    let joint = (effect.joint.as_ref()).map(|joint| &nominal.robot().joints[joint.value].name);
    for parameter in &mut own.parameters {
        let stem = format!("{}_{}", effect.id.value, parameter.name);
        let name = joint.map_or_else(|| stem.clone(), |joint| format!("{stem}_{joint}"));
        parameter.value.value = value(&name)?;
        parameter.interval = None;
    }
    Some(own)
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use pid_interpret::nominal::Role;
    use pid_report::Report;

    use super::*;
    use crate::args::{Cli, Command};
    use crate::samples::written;
    use crate::{identify, simulate};

    /// Runs `identify` or `simulate` on paths below a folder; words that start with `@` are such paths.
    fn run(folder: &Path, line: &str) -> Result<u8, String> {
        let word = |word: &str| match word.strip_prefix('@') {
            Some(name) => folder.join(name).display().to_string(),
            None => word.to_owned(),
        };
        let words = line.split(' ').map(word);
        let cli = Cli::try_parse_from(words).map_err(|e| e.to_string())?;
        let code = match cli.command {
            Some(Command::Identify(args)) => identify::run(&args),
            Some(Command::Simulate(args)) => simulate::run(&args),
            other => panic!("{other:?}"),
        };
        code.map_err(|e| e.to_string())
    }

    fn report(folder: &Path, out: &str) -> Report {
        let file = folder.join(out).join("fit.json");
        let text = std::fs::read_to_string(file).expect("a result");
        Report::from_json(&text).expect("a report")
    }

    /// The record leaves most of the ten parameters of the link open; none may run away.
    #[test]
    fn a_robot_file_and_logs_are_identified_within_tolerances() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = folder.path();
        written(at);
        let line = "simtrue identify @arm.urdf @a.csv @b.csv --out @one";
        assert_eq!(run(at, line), Ok(0));
        let nominal = Nominal::read(at.join("one/identified.toml")).expect("a description");
        let mass = |t: &&pid_interpret::nominal::Tolerance| t.role == Role::Mass;
        let mass = nominal.tolerances().iter().find(mass).expect("a mass");
        assert!((mass.nominal - 6.0).abs() <= 0.3, "{mass:?}");
        // What was assumed of the logs repeats the run.
        let again = "simtrue identify @one/data/nominal.toml @one/data --out @two";
        assert_eq!(run(at, again), Ok(0));
        let folder_alone = "simtrue identify @one/data --out @three";
        assert_eq!(run(at, folder_alone), Ok(0));
        let values = |out: &str| -> Vec<f64> {
            let parameters = report(at, out).parameters.into_iter();
            parameters.map(|p| p.value).collect()
        };
        assert_eq!(values("one"), values("two"));
        assert_eq!(values("one"), values("three"));
    }

    #[test]
    fn a_robot_file_and_logs_are_simulated() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = folder.path();
        written(at);
        assert_eq!(
            run(at, "simtrue simulate @arm.urdf @a.csv @b.csv --out @out"),
            Ok(0)
        );
        let report = report(at, "out");
        let mass = report.parameters.iter().find(|p| p.unit == "kg");
        assert_eq!(mass.expect("a mass").value, 6.0, "nothing is identified");
    }

    /// Targets and positions of a bar that follows slow sines, and its description with a loop.
    fn behind_a_servo(folder: &Path) {
        let joint = "[[joint]]\nname = \"a\"\ntype = \"revolute\"\n";
        let channels =
            format!("{joint}input = \"position\"\ninput_unit = \"rad\"\nvelocity = \"absent\"\n");
        let files = ["train", "test"];
        let mut manifest = format!(
            "name = \"s\"\ntitle = \"s\"\nsource = \"s\"\nlicense = \"s\"\nkind = \"simulated\"\n{channels}"
        );
        for role in files {
            manifest.push_str(&format!(
                "[[experiment]]\nfile = \"{role}.csv\"\nrole = \"{role}\"\n"
            ));
            let rows: String = (0..200)
                .map(|k| {
                    let t = 0.01 * f64::from(k);
                    format!(
                        "{t},{},{}\n",
                        0.29 * (3.0 * t - 0.1).sin(),
                        0.3 * (3.0 * t).sin()
                    )
                })
                .collect();
            std::fs::write(
                folder.join(format!("{role}.csv")),
                format!("t,q1,qref1\n{rows}"),
            )
            .expect("written");
        }
        std::fs::write(folder.join("dataset.toml"), manifest).expect("written");
        let nominal = format!(
            "[robot]\nname = \"s\"\ngravity = [0.0, 0.0, -9.81]\n[tolerance]\nmass_rel = 0.1\ncom_abs_m = 0.0\n\
             inertia_rel = 0.1\nrotor_inertia_rel = 0.1\nmotor_gain_rel = 0.0\nfriction_rel = 0.5\n{joint}\
             axis = [0.0, 1.0, 0.0]\norigin = [0.0, 0.0, 0.0]\nmass = 0.5\ncom = [0.0, 0.0, -0.1]\n\
             inertia = [0.002, 0.002, 0.0005, 0.0, 0.0, 0.0]\nrotor_inertia = 0.01\ncoulomb = 0.05\nviscous = 0.05\n\
             motor_gain = 1.0\ninput = \"torque\"\nvelocity = \"absent\"\n[joint.drive]\nlaw = \"pd\"\nkp = 10.0\nkd = 0.5\n"
        );
        std::fs::write(folder.join("nominal.toml"), nominal).expect("written");
    }

    #[test]
    fn targets_are_simulated_and_their_loop_is_identified() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = folder.path();
        behind_a_servo(at);
        assert_eq!(run(at, "simtrue simulate @. --out @out"), Ok(0));
        assert_eq!(run(at, "simtrue identify @. --out @fit"), Ok(0));
        let found = report(at, "fit");
        let kp = found.parameters.iter().find(|p| p.name == "kp_a");
        let kp = kp.expect("a gain");
        assert_eq!(
            (kp.value, kp.unit.as_str()),
            (10.0, "N*m/rad"),
            "it is exact"
        );
        let written = Nominal::read(at.join("fit/identified.toml")).expect("a description");
        let servo = written.servo(0).expect("a loop");
        assert_eq!(servo.gain(Gain::Kp).value, Some(10.0));
    }

    #[test]
    fn options_and_paths_that_exclude_each_other_are_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = folder.path();
        written(at);
        for (line, message) in [
            (
                "identify @arm.urdf @a.csv --with stribeck",
                "--with belongs",
            ),
            ("identify @arm.urdf", "without a log"),
            ("identify emps @a.csv", "a.csv: no folder"),
            (
                "identify emps @. --map q=[deg]",
                "--map says how logs are read",
            ),
            ("identify @.", "has no nominal.toml"),
            ("identify emps @. @.", "3 paths are given"),
            (
                "simulate @nowhere.urdf @a.csv",
                "nowhere.urdf: cannot be read",
            ),
        ] {
            let error = run(at, &format!("simtrue {line}")).expect_err(line);
            assert!(error.contains(message), "{line}: {error}");
        }
    }
}

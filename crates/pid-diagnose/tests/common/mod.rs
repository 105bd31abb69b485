//! Simulated records of declared machines, as data folders without `nominal.toml`.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::ops::ControlFlow;
use std::path::PathBuf;

use pid_data::{Dataset, Horizon, InputHold};
use pid_diagnose::declared::declared;
use pid_diagnose::effects::by_id;
use pid_diagnose::extended::free_run_gap;
use pid_diagnose::nominal::Nominal;
use pid_diagnose::report::Report;
use pid_diagnose::search::Settings;
use pid_diagnose::servo::commanded;
use pid_diagnose::with_effects::{Assembled, Placed, WithEffects};
use pid_fit::ident::{self, Likelihood};
use pid_fit::integrate::{self, Drive, simulate};
use pid_interpret::Model;
use pid_runtime::dynamics::{At, Dynamics, Jacobian};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Some effects of each kind of cause: a third of the library.
pub(crate) const A_THIRD: [&str; 12] = [
    "actuator_lag",
    "coulomb_asymmetry",
    "encoder_eccentricity",
    "gain_error_nonlinear",
    "input_delay",
    "joint_elasticity",
    "load_dependent_friction",
    "payload",
    "quadratic_drag",
    "sensor_delay",
    "spring",
    "stribeck",
];

/// A search among these effects, where the whole library would say no more and take longer.
pub(crate) fn among(ids: &[&str]) -> Settings {
    let effect = |id: &&str| by_id(id).expect("an effect");
    Settings {
        effects: ids.iter().map(effect).collect(),
        ..Settings::default()
    }
}

const STEP: f64 = 0.004;
const SAMPLES: u32 = 1500;
/// Uniform noise of the readings, standard deviation, rad.
const NOISE: f64 = 1e-4;

/// A data folder of a machine without `nominal.toml`, from rest at `q`, under inputs of an
/// `amplitude`. Joints that slide have a name that starts with `slide`; inputs that the machine
/// does not have are zero.
pub(crate) fn folder(
    name: &str,
    machine: &dyn Jacobian,
    joints: &[&str],
    q: &[f64],
    amplitude: f64,
) -> PathBuf {
    let n = joints.len();
    let out = std::env::temp_dir().join(format!("pid-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&out).expect("a folder");
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut dataset = String::from(
        "name = \"drawn\"\ntitle = \"Links with a spring\"\nsource = \"simulated\"\nlicense = \"none\"\nkind = \"simulated\"\n",
    );
    let mut measurement = String::new();
    for joint in joints {
        let kind = if joint.starts_with("slide") {
            "prismatic"
        } else {
            "revolute"
        };
        write!(
            dataset,
            "\n[[joint]]\nname = \"{joint}\"\ntype = \"{kind}\"\ninput = \"current\"\ninput_unit = \"A\"\nvelocity = \"absent\"\n"
        )
        .expect("a text");
        writeln!(
            measurement,
            "[[joint]]\nname = \"{joint}\"\nq_noise_std = {NOISE:e}"
        )
        .expect("a text");
    }
    for (record, role) in ["train", "train", "test"].iter().enumerate() {
        let waves: Vec<[(f64, f64, f64); 4]> = (0..machine.dims().nu)
            .map(|_| {
                std::array::from_fn(|k| {
                    let f = 0.15 + 0.4 * k as f64 + 0.1 * random.random::<f64>();
                    let phase = std::f64::consts::TAU * random.random::<f64>();
                    (f, amplitude / (1.0 + k as f64), phase)
                })
            })
            .collect();
        let t: Vec<f64> = (0..SAMPLES).map(|k| STEP * f64::from(k)).collect();
        let wave =
            |t: f64, (f, a, p): &(f64, f64, f64)| a * (std::f64::consts::TAU * f * t + p).sin();
        let u: Vec<f64> = (t.iter())
            .flat_map(|&t| {
                waves
                    .iter()
                    .map(move |w| w.iter().map(|w| wave(t, w)).sum::<f64>())
            })
            .collect();
        let p: Vec<f64> = machine.params().iter().map(|p| p.nominal).collect();
        let drive = Drive {
            t: &t,
            u: &u,
            hold: InputHold::ZeroOrder,
        };
        let motion = simulate(
            machine,
            &p,
            q,
            &vec![0.0; n],
            &drive,
            integrate::Settings::default(),
        )
        .expect("a motion");
        let columns = |of: &str| (1..=n).map(|j| format!(",{of}{j}")).collect::<String>();
        let mut text = format!("t{}{}\n", columns("q"), columns("u"));
        for (k, t) in t.iter().enumerate() {
            write!(text, "{t:.3}").expect("a text");
            for q in &motion.q[k * n..(k + 1) * n] {
                let noise = NOISE * 12f64.sqrt() * (random.random::<f64>() - 0.5);
                write!(text, ",{:.9}", q + noise).expect("a text");
            }
            let nu = waves.len();
            let own = &u[k * nu..(k + 1) * nu];
            for j in 0..n {
                write!(text, ",{:.9}", own.get(j).unwrap_or(&0.0)).expect("a text");
            }
            text.push('\n');
        }
        let file = format!("r{record}.csv");
        std::fs::write(out.join(&file), text).expect("a record");
        write!(
            dataset,
            "\n[[experiment]]\nfile = \"{file}\"\nrole = \"{role}\"\n"
        )
        .expect("a text");
    }
    std::fs::write(out.join("dataset.toml"), dataset).expect("a file");
    std::fs::write(out.join("measurement.toml"), measurement).expect("a file");
    out
}

/// What a diagnosis wrote of a declared robot, read by `robot!`'s own checks, against the extended
/// description with its effects: the same forces, in the coordinates of the joints.
pub(crate) fn source_holds(model: &dyn Dynamics, report: &Report) {
    let text = declared(model, &report.extended).expect("a declaration");
    let inside = text.split_once("robot! {").expect(&text).1;
    let inside = inside.rsplit_once('}').expect(&text).0;
    let robots = pid_codegen::robots(inside.parse().expect(&text));
    let robots = robots.unwrap_or_else(|mistakes| panic!("{mistakes:#?}\n{text}"));
    assert_eq!(robots[0].name, format!("{}Extended", model.name()));
    let written = Model::new(&robots[0]).expect("equations");
    let placed = Placed::of(&report.extended).expect("effects");
    let inner = Model::new(report.extended.robot()).expect("equations");
    let with = WithEffects::new(Box::new(inner), &placed).expect("effects");
    let n = with.dims().nq;
    let place = |name: &str| {
        let mut all = with.inputs().iter();
        all.position(|i| i.name == name).expect(name)
    };
    let nominal =
        |model: &dyn Dynamics| -> Vec<f64> { model.params().iter().map(|p| p.nominal).collect() };
    let drives = report.extended.drives();
    for point in 0..20 {
        let wave = |k: usize| (0.3 + 1.7 * k as f64 + 0.61 * f64::from(point)).sin();
        let row = |from: usize, size: f64| -> Vec<f64> {
            (0..n).map(|k| size * wave(from + k)).collect()
        };
        let (q, v, a, u) = (row(0, 1.2), row(20, 1.5), row(40, 3.0), row(60, 2.0));
        let (dq, dv, da) = match drives {
            Some(d) => (d.positions(&q), d.velocities(&v), d.velocities(&a)),
            None => (q.clone(), v.clone(), a.clone()),
        };
        let mut theirs = vec![0.0; n];
        let p = nominal(&with);
        let at = At {
            q: &dq,
            v: &dv,
            a: &da,
            u: &u,
            p: &p,
        };
        with.residual(&at, &mut theirs);
        if let Some(drives) = drives {
            // Equal power: forces on the joints are Rᵀ those on the drives.
            let of = |j: usize| (0..n).map(|k| drives.ratios[k][j] * theirs[k]).sum();
            theirs = (0..n).map(of).collect();
        }
        let inputs: Vec<f64> = (written.inputs().iter())
            .map(|i| u[place(&i.name)])
            .collect();
        let (mut own, p) = (vec![0.0; n], nominal(&written));
        let at = At {
            q: &q,
            v: &v,
            a: &a,
            u: &inputs,
            p: &p,
        };
        written.residual(&at, &mut own);
        let size = own.iter().fold(1e-3_f64, |m, x| m.max(x.abs()));
        for (x, y) in own.iter().zip(&theirs) {
            assert!((x - y).abs() < 1e-11 * size, "{own:?} {theirs:?}\n{text}");
        }
    }
}

/// What a diagnosis wrote, as text: read again, its free runs on the records leave what the diagnosis said.
pub(crate) fn runs_as_diagnosed(report: &Report, dataset: &Dataset) -> String {
    let text = report.extended.to_toml().expect("a description");
    let again = Nominal::parse(&text, "extended.toml".as_ref()).expect("a description");
    let gap = free_run_gap(again, dataset).expect("a gap").total;
    let stated = report.diagnosis().gap_after;
    assert!((gap / stated - 1.0).abs() < 1e-6, "{gap} {stated}\n{text}");
    text
}

/// All parameters by the program with exact derivatives, by their names: targets and positions alone.
pub(crate) fn identified(nominal: &Nominal, dataset: &Dataset) -> BTreeMap<String, f64> {
    let (with, _, values) = identified_model(nominal, dataset);
    let names = with.model.params().iter().map(|p| p.name.to_string());
    names.zip(values).collect()
}

/// The same with the model and the records as it takes them.
pub(crate) fn identified_model(
    nominal: &Nominal,
    dataset: &Dataset,
) -> (Assembled, Dataset, Vec<f64>) {
    let (nominal, mut dataset) = commanded(&nominal.description, dataset).expect("targets");
    let with = Assembled::new(&nominal, &mut dataset).expect("equations");
    let settings = ident::Settings {
        horizon: Horizon::Record,
        likelihood: Some(Likelihood {
            noise: with.noise.clone(),
            priors: with.priors(&nominal),
            ..Likelihood::default()
        }),
        ..ident::Settings::default()
    };
    let mut go_on = |_: &ident::Progress<'_>| ControlFlow::Continue(());
    let model = with.model.as_ref();
    let found = ident::identify(model, &dataset, &settings, None, &mut go_on).expect("a fit");
    let values = found.best().parameters.clone();
    (with, dataset, values)
}

//! Robots, the library's own inverse dynamics of them, and generated code that is built and run.

#![allow(dead_code, reason = "each test uses a part")]

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use pid_effects::constants::{Constant, Constants};
use pid_effects::described::{described, stated};
use pid_effects::effect::{Commands, Effect, Forces, Friction, Site, Term};
use pid_effects::effects::by_id;
use pid_effects::nominal::Nominal;
use pid_effects::with_effects::takes;
use pid_firmware::{File, Options, Precision, Target, export};
use pid_interpret::links::At;
use pid_interpret::nominal::{self as description, Role};
use pid_symbolic::random::Random;

/// The six-axis arm of the models.
pub(crate) fn arm6() -> description::Nominal {
    declared("arm6")
}

/// A model of `pid-models` as a description.
pub(crate) fn declared(name: &str) -> description::Nominal {
    let entry = pid_models::by_name(name).expect("a model");
    description::Nominal::of_declared(entry, None).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// A description with effects of the library.
pub(crate) fn with(
    nominal: &description::Nominal,
    effects: &[(&str, usize, &[f64])],
) -> description::Nominal {
    let values: Vec<f64> = nominal.tolerances().iter().map(|t| t.nominal).collect();
    let all = effects.iter().map(|&(id, joint, e)| {
        let effect = by_id(id).expect("an effect");
        stated(nominal, &Term { effect, joint }, e, &vec![None; e.len()])
    });
    nominal.extended(&values, all.collect(), None)
}

/// The same description, written as a file and read again.
pub(crate) fn reread(nominal: &description::Nominal) -> description::Nominal {
    let text = nominal.to_toml().expect("a file can state it");
    description::Nominal::parse("extended.toml", &text).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// A motion and inputs, each one entry per coordinate.
#[derive(Debug, Clone)]
pub(crate) struct State {
    pub(crate) q: Vec<f64>,
    pub(crate) v: Vec<f64>,
    pub(crate) a: Vec<f64>,
    pub(crate) u: Vec<f64>,
}

/// Drawn states, slow and fast, every entry a number of 32 bits too.
pub(crate) fn states(n: usize, count: usize, seed: u64) -> Vec<State> {
    let mut random = Random::new(seed);
    let mut some = |size: f64| -> Vec<f64> {
        (0..n)
            .map(|_| f64::from(random.uniform(-size, size) as f32))
            .collect()
    };
    (0..count)
        .map(|k| State {
            q: some(3.0),
            v: some([0.02, 2.0][k % 2]),
            a: some(8.0),
            u: some(10.0),
        })
        .collect()
}

/// Per function whether it found numbers, and these.
pub(crate) type Answer = [(bool, Vec<f64>); 3];

/// The library's own laws over plain numbers: torques of the drives, and inputs that act.
pub(crate) struct Library {
    nominal: description::Nominal,
    own: Nominal,
    effects: Vec<(Term, Vec<f64>)>,
}

impl Library {
    pub(crate) fn new(nominal: &description::Nominal) -> Self {
        let mut effects = described(nominal).unwrap_or_else(|e| panic!("{e}"));
        // Those that are no function of a motion: their rows say so.
        effects.retain(|(term, _)| {
            let told = pid_firmware::expression(term.effect.info().id).expect("a row");
            !told.starts_with("nothing")
        });
        Self {
            own: Nominal::new(nominal.clone()),
            nominal: nominal.clone(),
            effects,
        }
    }

    fn constants(&self) -> Constants<'_, f64> {
        let mut constants = Constants::new(&self.own, &vec![0.0; self.own.size()]);
        for (term, e) in &self.effects {
            let law = term.effect.plain();
            law.constants(e, term.joint, &mut constants);
        }
        constants
    }

    /// Torques of the drives.
    pub(crate) fn torque(&self, state: &State) -> Vec<f64> {
        let n = self.own.n();
        let mut q = state.q.clone();
        for (term, e) in &self.effects {
            // The reading of zero is the offset.
            q[term.joint] -= term.effect.plain().sense(e, 0.0, 0.0).0;
        }
        let constants = self.constants();
        let mut work = constants.prepared();
        let mut load = vec![0.0; n];
        let at = At {
            q: &q,
            v: &state.v,
            force: None,
        };
        self.own
            .links
            .evaluate(&mut work, &at, f64::sin_cos, &mut load);
        for i in 0..n {
            for j in 0..n {
                let (row, column) = (i.max(j), i.min(j));
                load[i] += work.mass()[row * (row + 1) / 2 + column] * state.a[j];
            }
        }
        let rest = |j: usize| {
            let mut all = self.nominal.tolerances().iter();
            let sharp = all.find(|t| t.joint == Some(j) && t.role == Role::Sharpness);
            1.0 / sharp.expect("a sharpness").nominal
        };
        let site = |joint: usize| Site {
            joint,
            q: &q,
            v: &state.v,
            load: &load,
            t: 0.0,
            dt: 1.0,
            rest: Some(rest(joint)),
        };
        let (mut value, mut rate) = (vec![0.0; n], vec![0.0; n]);
        let mut friction: Vec<Friction<f64>> = (0..n)
            .map(|j| Friction {
                forward: constants.get(Constant::Coulomb(j)),
                backward: constants.get(Constant::Coulomb(j)),
                viscous: constants.get(Constant::Viscous(j)),
            })
            .collect();
        for (term, e) in &self.effects {
            let law = term.effect.plain();
            let j = term.joint;
            law.friction(e, &site(j), &[], &mut friction[j]);
            let mut forces = Forces {
                value: &mut value,
                rate: &mut rate,
            };
            law.force(e, &site(j), &[], &mut forces, &constants);
        }
        (0..n)
            .map(|j| {
                let f = &friction[j];
                let s = (state.v[j] / rest(j)).tanh();
                let dry = 0.5 * (1.0 + s) * f.forward - 0.5 * (1.0 - s) * f.backward;
                let rotor = constants.get(Constant::Rotor(j)) * state.a[j];
                load[j] + rotor + dry + (f.viscous + rate[j]) * state.v[j] - value[j]
            })
            .collect()
    }

    /// Torques of the drives at inputs: gains times what acts.
    pub(crate) fn driven(&self, u: &[f64]) -> Vec<f64> {
        let constants = self.constants();
        let one = |j: usize| {
            let mut u = u[j];
            for (term, e) in self.effects.iter().filter(|(term, _)| term.joint == j) {
                let now = [u];
                let commands = Commands {
                    u: &now,
                    h: 1.0,
                    linear: false,
                    begin: 0.0,
                    t: 0.0,
                    dt: 1.0,
                };
                u = term.effect.plain().input(e, u, &commands, &mut []);
            }
            constants.get(Constant::Gain(j)) * u
        };
        (0..u.len()).map(one).collect()
    }
}

/// Whether an effect has a law that equations of motion take.
pub(crate) fn is_law(effect: &dyn Effect) -> bool {
    takes(effect).is_ok()
}

/// Largest difference, relative to the largest entry.
pub(crate) fn off(x: &[f64], y: &[f64]) -> f64 {
    assert_eq!(x.len(), y.len());
    let size = x.iter().chain(y).fold(1e-300, |m: f64, x| m.max(x.abs()));
    let off = x.iter().zip(y).map(|(x, y)| (x - y).abs());
    // Not a number counts as far off.
    off.map(|x| if x.is_nan() { f64::INFINITY } else { x / size })
        .fold(0.0, f64::max)
}

/// Generated code on this machine.
pub(crate) struct Built {
    folder: tempfile::TempDir,
    program: PathBuf,
    n: usize,
}

/// Runs a command to its end.
pub(crate) fn run(command: &mut Command) -> Vec<u8> {
    let out = command
        .output()
        .unwrap_or_else(|e| panic!("{command:?}: {e}"));
    assert!(
        out.status.success(),
        "{command:?}\n{}{}",
        String::from_utf8_lossy(&out.stdout),
        String::from_utf8_lossy(&out.stderr)
    );
    out.stdout
}

/// Writes files below a folder.
pub(crate) fn write(folder: &Path, files: &[File]) {
    for file in files {
        let path = folder.join(&file.name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        std::fs::write(path, &file.text).expect("written");
    }
}

/// Cargo on a generated crate, with what this workspace has fetched.
pub(crate) fn cargo(folder: &Path, arguments: &[&str]) {
    let mut command = Command::new(env!("CARGO"));
    command
        .args(arguments)
        .args(["--release", "--offline", "--quiet", "--target-dir"])
        .arg(folder.join("target"))
        .current_dir(folder)
        // A generated crate is built as its user builds it.
        .env_remove("RUSTFLAGS")
        .env_remove("CARGO_BUILD_TARGET");
    run(&mut command);
}

pub(crate) fn files(
    nominal: &description::Nominal,
    target: Target,
    precision: Precision,
) -> Vec<File> {
    let mut options = Options::default();
    options.precision = precision;
    export(nominal, target, &options).unwrap_or_else(|e| panic!("{e}"))
}

/// The text of a file.
pub(crate) fn text<'f>(files: &'f [File], end: &str) -> &'f str {
    let file = files.iter().find(|f| f.name.ends_with(end));
    &file.unwrap_or_else(|| panic!("no {end}")).text
}

/// Start of the identifiers.
pub(crate) fn prefix(files: &[File]) -> String {
    let header = files.iter().find(|f| f.name.ends_with(".h"));
    let name = &header.expect("a header").name;
    let name = name.rsplit('/').next().expect("a name");
    name.trim_end_matches(".h").to_owned()
}

/// A program in C that answers states from its input.
fn driver_in_c(own: &str, n: usize, precision: Precision) -> String {
    let real = match precision {
        Precision::F32 => "float",
        Precision::F64 => "double",
    };
    format!(
        r#"#include "{own}.h"
#include <stdio.h>

static bool take({real} *x)
{{
    double value;
    int j;
    for (j = 0; j < {n}; ++j) {{
        if (scanf("%lf", &value) != 1) {{
            return false;
        }}
        x[j] = ({real})value;
    }}
    return true;
}}

static void give(bool found, const {real} *x)
{{
    int j;
    printf("%d", found);
    for (j = 0; j < {n}; ++j) {{
        printf(" %.17g", (double)x[j]);
    }}
    printf("\n");
}}

int main(void)
{{
    {real} q[{n}], v[{n}], a[{n}], u[{n}], out[{n}];
    bool found;
    while (take(q) && take(v) && take(a) && take(u)) {{
        found = {own}_inverse_dynamics(q, v, a, out);
        give(found, out);
        found = {own}_feed_forward(q, v, a, out);
        give(found, out);
        found = {own}_residual(q, v, a, u, out);
        give(found, out);
    }}
    return 0;
}}
"#
    )
}

/// The same in Rust.
fn driver_in_rust(own: &str, n: usize, precision: Precision) -> String {
    let real = match precision {
        Precision::F32 => "f32",
        Precision::F64 => "f64",
    };
    format!(
        r#"use {own}_feed_forward as robot;

fn give(found: Option<[{real}; {n}]>) {{
    print!("{{}}", u8::from(found.is_some()));
    for x in found.unwrap_or([0.0; {n}]) {{
        print!(" {{:e}}", x as f64);
    }}
    println!();
}}

fn main() {{
    for line in std::io::stdin().lines() {{
        let line = line.unwrap();
        let all: Vec<{real}> = line.split_whitespace().map(|x| x.parse::<f64>().unwrap() as {real}).collect();
        let part = |k: usize| <[{real}; {n}]>::try_from(&all[k * {n}..(k + 1) * {n}]).unwrap();
        let (q, v, a, u) = (part(0), part(1), part(2), part(3));
        give(robot::inverse_dynamics(&q, &v, &a));
        give(robot::feed_forward(&q, &v, &a));
        give(robot::residual(&q, &v, &a, &u));
    }}
}}
"#
    )
}

/// What a compiler of C99 must be content with.
const STRICT: [&str; 6] = [
    "-std=c99",
    "-O2",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-pedantic",
];

fn compile(folder: &Path, more: &[PathBuf]) -> PathBuf {
    let program = folder.join("driver");
    run(Command::new("cc")
        .args(STRICT)
        .arg(format!("-I{}", folder.display()))
        .arg(format!("-I{}", folder.join("include").display()))
        .arg(folder.join("driver.c"))
        .args(more)
        // What nobody calls is left out: the library of Rust has references to its unwinder.
        .args(["-lm", "-Wl,--gc-sections", "-o"])
        .arg(&program));
    program
}

/// The source of C, built as strictly as it says.
pub(crate) fn in_c(nominal: &description::Nominal, precision: Precision) -> Built {
    let folder = tempfile::tempdir().expect("a folder");
    let files = files(nominal, Target::C, precision);
    write(folder.path(), &files);
    let (own, n) = (prefix(&files), nominal.robot().nq());
    let driver = driver_in_c(&own, n, precision);
    std::fs::write(folder.path().join("driver.c"), driver).expect("written");
    let source = folder.path().join(format!("{own}.c"));
    let program = compile(folder.path(), &[source]);
    Built { folder, program, n }
}

/// The crate, called from Rust.
pub(crate) fn in_rust(nominal: &description::Nominal, precision: Precision) -> Built {
    let folder = tempfile::tempdir().expect("a folder");
    let files = files(nominal, Target::Rust, precision);
    write(&folder.path().join("robot"), &files);
    let (own, n) = (prefix(&files), nominal.robot().nq());
    let manifest = format!(
        "[package]\nname = \"driver\"\nversion = \"0.1.0\"\nedition = \"2024\"\n[dependencies]\n\
         {own}_feed_forward = {{ path = \"robot\" }}\n[workspace]\n"
    );
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("Cargo.toml"), manifest).expect("written");
    std::fs::create_dir(at("src")).expect("made");
    let driver = driver_in_rust(&own, n, precision);
    std::fs::write(at("src/main.rs"), driver).expect("written");
    cargo(folder.path(), &["build"]);
    let program = at("target/release/driver");
    Built { folder, program, n }
}

/// The crate as a static library, called from C by its header.
pub(crate) fn in_library(nominal: &description::Nominal, precision: Precision) -> Built {
    let folder = tempfile::tempdir().expect("a folder");
    let files = files(nominal, Target::Rust, precision);
    write(folder.path(), &files);
    let (own, n) = (prefix(&files), nominal.robot().nq());
    let driver = driver_in_c(&own, n, precision);
    std::fs::write(folder.path().join("driver.c"), driver).expect("written");
    // As on a Cortex-M, where nothing unwinds.
    let abort = "profile.release.panic='abort'";
    let library = [
        "rustc",
        "--config",
        abort,
        "--features",
        "c",
        "--crate-type",
        "staticlib",
    ];
    cargo(folder.path(), &library);
    let archive = folder
        .path()
        .join(format!("target/release/lib{own}_feed_forward.a"));
    let program = compile(folder.path(), &[archive]);
    Built { folder, program, n }
}

impl Built {
    /// Answers at states.
    pub(crate) fn answers(&self, states: &[State]) -> Vec<Answer> {
        let mut text = String::new();
        for state in states {
            for x in [&state.q, &state.v, &state.a, &state.u]
                .into_iter()
                .flatten()
            {
                let _ = write!(text, "{x:e} ");
            }
            text.push('\n');
        }
        let mut child = Command::new(&self.program)
            .current_dir(self.folder.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("started");
        let mut input = child.stdin.take().expect("a pipe");
        let writer = std::thread::spawn(move || input.write_all(text.as_bytes()));
        let out = child.wait_with_output().expect("an end");
        writer.join().expect("no panic").expect("written");
        assert!(out.status.success());
        let out = String::from_utf8(out.stdout).expect("text");
        let lines: Vec<&str> = out.lines().collect();
        assert_eq!(lines.len(), 3 * states.len());
        let one = |line: &str| {
            let mut words = line.split(' ');
            let found = words.next() == Some("1");
            let all: Vec<f64> = words.map(|x| x.parse().expect("a number")).collect();
            assert_eq!(all.len(), self.n);
            (found, all)
        };
        let three = |all: &[&str]| [0, 1, 2].map(|k| one(all[k]));
        lines.chunks_exact(3).map(three).collect()
    }
}

/// Agreement in each precision, relative to the largest torque of the state.
pub(crate) const DOUBLE: f64 = 1e-12;
pub(crate) const SINGLE: f64 = 1e-5;

/// Torques, inputs and residual of built code at drawn states.
pub(crate) fn compare(nominal: &description::Nominal, built: &Built, close: f64, what: &str) {
    let library = Library::new(nominal);
    let states = states(nominal.robot().nq(), 60, 7);
    for (state, [torque, input, residual]) in states.iter().zip(built.answers(&states)) {
        let own = library.torque(state);
        assert!(
            torque.0 && off(&torque.1, &own) < close,
            "{what}: {torque:?} {own:?}"
        );
        // The torques that the input makes are those that were asked for.
        let driven = library.driven(&input.1);
        assert!(
            input.0 && off(&driven, &own) < close,
            "{what}: {driven:?} {own:?}"
        );
        let acting = library.driven(&state.u);
        let lacks: Vec<f64> = own.iter().zip(&acting).map(|(x, y)| x - y).collect();
        // The residual is a difference of torques: its error is relative to them.
        let size = own
            .iter()
            .chain(&acting)
            .fold(0.0_f64, |m, x| m.max(x.abs()));
        let error = lacks.iter().zip(&residual.1).map(|(x, y)| (x - y).abs());
        let error = error.fold(0.0, f64::max) / size;
        assert!(
            residual.0 && error < close,
            "{what}: {residual:?} {lacks:?}"
        );
    }
}

//! A crate of Rust: `no_std`, no allocation, no path to a panic.

use std::fmt::Write;

use pid_symbolic::Function;

use crate::equations::Equations;
use crate::names::prefix;
use crate::program::{Language, digits, lines};
use crate::shared::{about, direct, inverse, needed};
use crate::{File, Precision, c};

struct Rust(Precision);

/// Name of the type of numbers.
fn real(precision: Precision) -> &'static str {
    match precision {
        Precision::F32 => "f32",
        Precision::F64 => "f64",
    }
}

/// A function of `libm`.
fn libm(name: &str, precision: Precision) -> String {
    match precision {
        Precision::F32 => format!("libm::{name}f"),
        Precision::F64 => format!("libm::{name}"),
    }
}

impl Language for Rust {
    fn number(&self, x: f64) -> String {
        digits(x, self.0)
    }
    fn call(&self, f: Function, x: &str) -> String {
        let name = match f {
            Function::Sign => return format!("sign({x})"),
            Function::Abs => "fabs",
            Function::Ln => "log",
            f => f.name(),
        };
        format!("{}({x})", libm(name, self.0))
    }
    fn bind(&self, name: &str, value: &str) -> String {
        format!("let {name} = {value};")
    }
    fn sine_cosine(&self, sine: &str, cosine: &str, x: &str) -> Option<String> {
        Some(format!(
            "let ({sine}, {cosine}) = {}({x});",
            libm("sincos", self.0)
        ))
    }
}

/// Files of the crate.
pub(crate) fn files(equations: &Equations, precision: Precision) -> Vec<File> {
    let own = prefix(&equations.name);
    vec![
        File::new("Cargo.toml", manifest(&own)),
        File::new("src/lib.rs", library(equations, precision, &own)),
        File::new(
            format!("include/{own}.h"),
            c::header(equations, precision, &own),
        ),
    ]
}

fn manifest(own: &str) -> String {
    format!(
        r#"[package]
name = "{own}_feed_forward"
version = "0.1.0"
edition = "2024"
publish = false

[features]
# The functions of include/{own}.h, and a handler of panics, which none of them calls. A static library:
# cargo rustc --release --features c --crate-type staticlib --target thumbv7em-none-eabihf
c = []

[dependencies]
libm = "0.2"
"#
    )
}

fn library(equations: &Equations, precision: Precision, own: &str) -> String {
    let n = equations.drives.len();
    let real = real(precision);
    let language = Rust(precision);
    let (body, names) = lines(&equations.graph, &equations.torque, n, &language);
    let about: String = (about(equations).iter())
        .map(|line| format!("//! {line}\n"))
        .collect();
    let joints: Vec<&str> = equations.drives.iter().map(|d| d.name.as_str()).collect();
    let rows = |row: &dyn Fn(usize) -> String| -> String {
        (0..n).map(|j| format!("        {},\n", row(j))).collect()
    };
    let drives = &equations.drives;
    let inputs = rows(&|j| inverse(&drives[j], &format!("tau[{j}]"), &language));
    let residual = rows(&|j| {
        let applied = direct(&drives[j], &format!("u[{j}]"), &language);
        format!("tau[{j}] - {applied}")
    });
    let outputs = names.join(", ");
    let helpers = helpers(equations, &body, precision);
    let interface = interface(own, real, n);
    format!(
        r#"{about}#![no_std]
#![cfg_attr(not(feature = "c"), forbid(unsafe_code))]
#![allow(clippy::all, unused_variables)]

/// Number of coordinates.
pub const N: usize = {n};
/// Names of the joints, in the order of all arrays.
pub const JOINTS: [&str; N] = {joints:?};

/// Torques or forces of the drives along a reference: positions, velocities, accelerations. `None` where
/// one of them is no finite number.
#[must_use]
pub fn inverse_dynamics(q: &[{real}; N], v: &[{real}; N], a: &[{real}; N]) -> Option<[{real}; N]> {{
    finite(torque(q, v, a))
}}

/// The input of each drive along a reference, in its unit. `None` where one of them is no finite number.
#[must_use]
pub fn feed_forward(q: &[{real}; N], v: &[{real}; N], a: &[{real}; N]) -> Option<[{real}; N]> {{
    let tau = inverse_dynamics(q, v, a)?;
    finite([
{inputs}    ])
}}

/// Torques or forces that the drives lack at inputs `u`: zero along a motion of the robot. `None` where one
/// of them is no finite number.
#[must_use]
pub fn residual(
    q: &[{real}; N],
    v: &[{real}; N],
    a: &[{real}; N],
    u: &[{real}; N],
) -> Option<[{real}; N]> {{
    let tau = torque(q, v, a);
    finite([
{residual}    ])
}}

fn finite(x: [{real}; N]) -> Option<[{real}; N]> {{
    for entry in x {{
        if !entry.is_finite() {{
            return None;
        }}
    }}
    Some(x)
}}
{helpers}
#[inline(never)]
fn torque(q: &[{real}; N], v: &[{real}; N], a: &[{real}; N]) -> [{real}; N] {{
{body}    [{outputs}]
}}
{interface}"#
    )
}

/// The functions that the code calls.
fn helpers(equations: &Equations, body: &str, precision: Precision) -> String {
    let own = [SIGN, LIMIT, DROOP, DEAD_ZONE].into_iter();
    let own = own
        .zip(needed(equations, body))
        .filter(|(_, needed)| *needed);
    own.map(|(text, _)| {
        let text = text.replace("REAL", real(precision));
        text.replace("SQRT", &libm("sqrt", precision))
    })
    .collect()
}

const SIGN: &str = "
/// -1, 0 or 1.
fn sign(x: REAL) -> REAL {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        x
    }
}
";
const LIMIT: &str = "
/// `u` within ± `most`.
fn limit(u: REAL, most: REAL) -> REAL {
    if u < -most {
        -most
    } else if u > most {
        most
    } else {
        u
    }
}
";
const DROOP: &str = "
/// The input that acts behind a gain that droops.
fn droop(u: REAL, per_square: REAL) -> REAL {
    u / (1.0 + per_square * u * u)
}

/// The input at which `x` acts, `top` where no input gives as much.
fn undroop(x: REAL, per_square: REAL, top: REAL) -> REAL {
    let left = 1.0 - 4.0 * per_square * x * x;
    if left < 0.0 {
        if x < 0.0 { -top } else { top }
    } else {
        2.0 * x / (1.0 + SQRT(left))
    }
}
";
const DEAD_ZONE: &str = "
/// What of `u` is beyond ± `width`.
fn beyond(u: REAL, width: REAL) -> REAL {
    if u > width {
        u - width
    } else if u < -width {
        u + width
    } else {
        0.0 * u
    }
}

/// The input of which `x` is beyond ± `width`.
fn around(x: REAL, width: REAL) -> REAL {
    if x > 0.0 {
        x + width
    } else if x < 0.0 {
        x - width
    } else {
        x
    }
}
";

/// The functions of the header.
fn interface(own: &str, real: &str, n: usize) -> String {
    let mut out = String::from(
        r#"
#[cfg(feature = "c")]
mod c {
    #[panic_handler]
    fn stop(_: &core::panic::PanicInfo<'_>) -> ! {
        loop {
            core::hint::spin_loop();
        }
    }
"#,
    );
    for (name, inputs) in [
        ("inverse_dynamics", "q, v, a"),
        ("feed_forward", "q, v, a"),
        ("residual", "q, v, a, u"),
    ] {
        let arguments = inputs
            .split(", ")
            .map(|x| format!("{x}: &[{real}; {n}], "))
            .collect::<String>();
        // Writing to a text cannot fail.
        let _ = write!(
            out,
            r#"
    /// See the header.
    #[unsafe(no_mangle)]
    pub extern "C" fn {own}_{name}({arguments}out: &mut [{real}; {n}]) -> bool {{
        let found = super::{name}({inputs});
        *out = found.unwrap_or([0.0; {n}]);
        found.is_some()
    }}
"#
        );
    }
    out += "}\n";
    out
}

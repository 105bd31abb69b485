//! A header and a source of C99.

use pid_symbolic::Function;

use crate::equations::Equations;
use crate::names::prefix;
use crate::program::{Language, digits, lines};
use crate::shared::{about, direct, inverse, needed};
use crate::{File, Precision};

struct C(Precision);

fn real(precision: Precision) -> &'static str {
    match precision {
        Precision::F32 => "float",
        Precision::F64 => "double",
    }
}

/// Suffix of numbers and of functions of `math.h`.
fn suffix(precision: Precision) -> &'static str {
    match precision {
        Precision::F32 => "f",
        Precision::F64 => "",
    }
}

impl Language for C {
    fn number(&self, x: f64) -> String {
        digits(x, self.0) + suffix(self.0)
    }
    fn call(&self, f: Function, x: &str) -> String {
        let name = match f {
            Function::Sign => return format!("sign({x})"),
            Function::Abs => "fabs",
            Function::Ln => "log",
            f => f.name(),
        };
        format!("{name}{}({x})", suffix(self.0))
    }
    fn bind(&self, name: &str, value: &str) -> String {
        format!("const {} {name} = {value};", real(self.0))
    }
}

/// Header and source.
pub(crate) fn files(equations: &Equations, precision: Precision) -> Vec<File> {
    let own = prefix(&equations.name);
    vec![
        File::new(format!("{own}.h"), header(equations, precision, &own)),
        File::new(format!("{own}.c"), source(equations, precision, &own)),
    ]
}

/// The functions of both languages, as C declares them.
pub(crate) fn header(equations: &Equations, precision: Precision, own: &str) -> String {
    let real = real(precision);
    let n = equations.drives.len();
    let about: String = (about(equations).iter())
        .map(|line| format!(" * {line}").trim_end().to_owned() + "\n")
        .collect();
    let guard = format!("{}_H", own.to_ascii_uppercase());
    let [inverse_dynamics, feed_forward, residual] = signatures(own, real, n);
    format!(
        "/*
{about} *
 * Every function writes its last array and returns true. Where an entry is no finite number it writes zeros and
 * returns false. The last array must not overlap the others. Nothing is allocated or kept between calls.
 */
#ifndef {guard}
#define {guard}

#include <stdbool.h>

#ifdef __cplusplus
extern \"C\" {{
#endif

/* Torques or forces of the drives along a reference: positions, velocities, accelerations. */
{inverse_dynamics};

/* The input of each drive along a reference, in its unit. */
{feed_forward};

/* Torques or forces that the drives lack at inputs u: zero along a motion of the robot. */
{residual};

#ifdef __cplusplus
}}
#endif

#endif
"
    )
}

fn signatures(own: &str, real: &str, n: usize) -> [String; 3] {
    let motion = ["q", "v", "a"].map(|x| format!("const {real} {x}[{n}]"));
    let motion = motion.join(", ");
    [
        format!("bool {own}_inverse_dynamics({motion}, {real} tau[{n}])"),
        format!("bool {own}_feed_forward({motion}, {real} u[{n}])"),
        format!("bool {own}_residual({motion}, const {real} u[{n}], {real} r[{n}])"),
    ]
}

fn source(equations: &Equations, precision: Precision, own: &str) -> String {
    let real = real(precision);
    let n = equations.drives.len();
    let language = C(precision);
    let (body, names) = lines(&equations.graph, &equations.torque, n, &language);
    let outputs: String = (names.iter().enumerate())
        .map(|(j, name)| format!("    tau[{j}] = {name};\n"))
        .collect();
    let drives = &equations.drives;
    let rows = |row: &dyn Fn(usize) -> String| (0..n).map(row).collect::<String>();
    let inputs = rows(&|j| {
        let input = inverse(&drives[j], &format!("tau[{j}]"), &language);
        format!("    u[{j}] = {input};\n")
    });
    let rest = rows(&|j| {
        let applied = direct(&drives[j], &format!("u[{j}]"), &language);
        format!("    r[{j}] = tau[{j}] - {applied};\n")
    });
    let helpers = helpers(equations, &body, precision);
    let [inverse_dynamics, feed_forward, residual] = signatures(own, real, n);
    let motion = ["q", "v", "a"].map(|x| format!("const {real} {x}[{n}]"));
    let motion = motion.join(", ");
    format!(
        r#"/* Written by simtrue export; {own}.h says what for. */
#include "{own}.h"

#include <math.h>
{helpers}
static bool settled(int count, {real} *x)
{{
    bool all = true;
    int j;
    for (j = 0; j < count; ++j) {{
        all = all && isfinite(x[j]);
    }}
    for (j = 0; j < count && !all; ++j) {{
        x[j] = {zero};
    }}
    return all;
}}

static void torque({motion}, {real} tau[{n}])
{{
    (void)q;
    (void)v;
    (void)a;
{body}{outputs}}}

{inverse_dynamics}
{{
    torque(q, v, a, tau);
    return settled({n}, tau);
}}

{feed_forward}
{{
    {real} tau[{n}];
    int j;
    if (!{own}_inverse_dynamics(q, v, a, tau)) {{
        for (j = 0; j < {n}; ++j) {{
            u[j] = {zero};
        }}
        return false;
    }}
{inputs}    return settled({n}, u);
}}

{residual}
{{
    {real} tau[{n}];
    torque(q, v, a, tau);
{rest}    return settled({n}, r);
}}
"#,
        zero = language.number(0.0),
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
        text.replace('@', suffix(precision))
    })
    .collect()
}

const SIGN: &str = "
/* -1, 0 or 1. */
static REAL sign(REAL x)
{
    return x > 0.0@ ? 1.0@ : x < 0.0@ ? -1.0@ : x;
}
";
const LIMIT: &str = "
/* u within +- most. */
static REAL limit(REAL u, REAL most)
{
    return u < -most ? -most : u > most ? most : u;
}
";
const DROOP: &str = "
/* The input that acts behind a gain that droops. */
static REAL droop(REAL u, REAL per_square)
{
    return u / (1.0@ + per_square * u * u);
}

/* The input at which x acts, top where no input gives as much. */
static REAL undroop(REAL x, REAL per_square, REAL top)
{
    const REAL left = 1.0@ - 4.0@ * per_square * x * x;
    if (left < 0.0@) {
        return x < 0.0@ ? -top : top;
    }
    return 2.0@ * x / (1.0@ + sqrt@(left));
}
";
const DEAD_ZONE: &str = "
/* What of u is beyond +- width. */
static REAL beyond(REAL u, REAL width)
{
    return u > width ? u - width : u < -width ? u + width : 0.0@ * u;
}

/* The input of which x is beyond +- width. */
static REAL around(REAL x, REAL width)
{
    return x > 0.0@ ? x + width : x < 0.0@ ? x - width : x;
}
";

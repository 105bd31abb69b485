//! A header and a source of C99.

use pid_symbolic::Function;

use crate::equations::Equations;
use crate::input::Step;
use crate::names::prefix;
use crate::program::{Language, digits, lines};
use crate::shared::{about, direct, inverse};
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
    let inputs: String = (0..n)
        .map(|j| {
            let input = inverse(&drives[j], &format!("tau[{j}]"), &language);
            format!("    u[{j}] = {input};\n")
        })
        .collect();
    let rest: String = (0..n)
        .map(|j| {
            let applied = direct(&drives[j], &format!("u[{j}]"), &language);
            format!("    r[{j}] = tau[{j}] - {applied};\n")
        })
        .collect();
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
    let real = real(precision);
    let f = suffix(precision);
    let mut out = String::new();
    let has = |law: fn(&Step) -> bool| equations.drives.iter().any(|d| d.steps.iter().any(law));
    if body.contains("sign(") {
        out += &format!(
            "
/* -1, 0 or 1. */
static {real} sign({real} x)
{{
    return x > 0.0{f} ? 1.0{f} : x < 0.0{f} ? -1.0{f} : x;
}}
"
        );
    }
    if has(|s| matches!(s, Step::Limit(_))) {
        out += &format!(
            "
/* u within +- most. */
static {real} limit({real} u, {real} most)
{{
    return u < -most ? -most : u > most ? most : u;
}}
"
        );
    }
    if has(|s| matches!(s, Step::Droop(_))) {
        out += &format!(
            "
/* The input that acts behind a gain that droops. */
static {real} droop({real} u, {real} per_square)
{{
    return u / (1.0{f} + per_square * u * u);
}}

/* The input at which x acts, top where no input gives as much. */
static {real} undroop({real} x, {real} per_square, {real} top)
{{
    const {real} left = 1.0{f} - 4.0{f} * per_square * x * x;
    if (left < 0.0{f}) {{
        return x < 0.0{f} ? -top : top;
    }}
    return 2.0{f} * x / (1.0{f} + sqrt{f}(left));
}}
"
        );
    }
    if has(|s| matches!(s, Step::DeadZone(_))) {
        out += &format!(
            "
/* What of u is beyond +- width. */
static {real} beyond({real} u, {real} width)
{{
    return u > width ? u - width : u < -width ? u + width : 0.0{f} * u;
}}

/* The input of which x is beyond +- width. */
static {real} around({real} x, {real} width)
{{
    return x > 0.0{f} ? x + width : x < 0.0{f} ? x - width : x;
}}
"
        );
    }
    out
}

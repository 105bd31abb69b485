//! Declarations for `robot!` that nobody would write: mutated real ones, and ones grown from the grammar.
#![allow(dead_code, reason = "each user needs some of it")]

use std::path::Path;

use pid_codegen::diag::Diagnostics;
use pid_symbolic::random::Random;
use proc_macro2::{Delimiter, Group, Ident, Literal, Punct, Spacing, Span, TokenStream, TokenTree};

use super::grammar;

/// Everything that the language has, in small robots.
const DECLARATIONS: [&str; 7] = [
    r#"
    /// Two links with everything a chain has.
    #[allow(deprecated)]
    pub(crate) robot Arm {
        gravity: [0, 0, -g] m/s^2;
        params { g: m/s^2 = 9.81 fixed; m1: kg = 1.0 in 0.1..=5.0; l: mm = 300 in 100..; }
        link l1 { mass: m1; com: [0, 0.01 m, l/2]; inertia at com: diag(_, 0.02 kg*m^2, 0.01 kg*m^2); }
        link l2..=l3 { inertial: free; mass: 2 kg; }
        joint j1: revolute about [0, 0.6, 0.8] { base -> l1 rpy [0, 90, 0] deg; limits: -120..=120 deg; }
        joint j2: prismatic along x { l1 -> l2 at [0, 0, l]; }
        joint flange: fixed { l2 -> l3; }
        per joint j1..=j2 { input drive: A; sharp: 1/s = [50.0, 20.0] in [5.0.., 2.0..=200.0]; }
        per joint j1 { rotor: kg*m^2 = 0.01; armature = rotor; force = 2 N*m/A * drive - 1.0 N*m * tanh(sharp*v * 1 s^2); }
        force on j2 = 3 N/A * drive - 2.0 N/m * (q - l)^2/(0.1 m) + sqrt(m1*2 N^2/kg);
        emit { dynamics, second_derivatives }
    }"#,
    r#"
    pub robot Wrist {
        gravity: [0, 0, -9.81] m/s^2;
        params { r: mm = 40 in 10..=80; rho: kg/m^3 = 2700 in 1000..=9000; n: 1 = 50 fixed; c: 1 = 0.5 in 0..=1; }
        input push: N*m;
        link a { inertial: solid cylinder { density: rho; radius: r; length: 0.3 m; axis: z; } com: [0, 0, 0.15] m; }
        link b { inertial: solid box { mass: 1.5 kg; size: [0.1, 0.2, 0.3] m; } }
        link c { inertial: hollow cylinder { mass: 0.4 kg; outer: r; inner: r/2; length: 20 mm; axis: x; } com: [0.1, 0, 0] m; }
        joint j1: revolute about z { base -> a; }
        joint j2: revolute about y { a -> b at [0, 0, 0.3] m; }
        joint j3: revolute about y { b -> c at [0.2, 0, 0] m; follows -j1/2 - c*j2 + 10 deg; }
        per joint j1, j2 {
            resistance: Ohm = 1.2 in 0.1..=5;
            drive: voltage { gain: 0.05 N*m/A; resistance: resistance; ratio: n; rotor: 1e-5 kg*m^2; }
        }
        motor m4: j1 + 2*j2 { drive: current { gain: 0.7 N*m/A; } dry: N*m = 0.5 in 0..=5; force = -dry*tanh(20 s/rad * v); }
        potential += 0.5*(3 N*m/rad)*(q.j2 - 0.1 rad)^2;
        force on j2 = push;
        emit { dynamics, first_derivatives }
        variant Planar { lock j1 = 90 deg; emit { dynamics } }
    }"#,
    r#"
    robot Cart {
        params { mc: kg = 1.0 in 0.1..=5; mp: kg = 0.2 in 0.01..=1; l: m = 0.5 in 0.1..=1; damping: N*s/m = 0.1 in 0..=1; }
        input push: N;
        coordinates x: mm in -500..=500, th: rad;
        lagrangian = 0.5*(mc + mp)*v.x^2 + mp*l*v.x*v.th*cos(th) + 0.5*mp*l^2*v.th^2 - mp*9.81 m/s^2*l*cos(q.th);
        potential += 3 N/m * x^2;
        force on x = push - damping*v;
        per joint th { viscous: N*m*s/rad = 0.01 in 0..=1; force = -viscous*v; }
        variant Pendulum { lock x = 0 m; }
    }"#,
    r#"
    robot Pendulum {
        gravity: [0, 0, -9.81] m/s^2;
        link rod { inertial: free; mass: 1 kg; com: [0, 0, -0.2] m; inertia at com: diag(0.02, 0.02, 0.001) kg*m^2; }
        joint pivot: revolute about y { base -> rod; }
        per joint { input torque: N*m; dry: N*m = 0.1 in 0.0..=1.0; force = torque - dry*tanh(50 s/rad*v); }
        emit { dynamics, first_derivatives, regressor, base_parameters, lanes }
        expect rank 4; expect rank 4 at nominal;
        limit ops 10_000;
    }"#,
    r#"
    robot Tree {
        gravity: [0, 9.81, 0] m/s^2;
        params { m: kg = 2 in 1..=3; i: kg*m^2 = 0.1 in 0.01..=1; k: N/m = 10 in 0..=100; }
        link body { mass: m; inertia at origin: [xx: i, yy: i, zz: i, xy: 0, xz: 0, yz: 0]; }
        link left { mass: 0.5 kg; com: [0.1, 0, 0] m; }
        link right { mass: 0.5 kg; com: [-0.1, 0, 0] m; inertia at com: diag(1e-3, 1e-3, 1e-3) kg*m^2; }
        joint slide: prismatic along x { base -> body; limits: -0.5..=0.5 m; }
        joint shoulder: revolute about y { body -> left at [0, 0, 0.2] m; }
        joint hip: revolute about z { body -> right at [0, 0, 0.1] m rpy [0, 0, pi/4] rad; }
        force on slide = -k*q;
        emit { dynamics, first_derivatives }
    }"#,
    r#"
    /// From a file.
    pub robot Arm from urdf "planar_arm.urdf" {
        inertial: free; friction: free; armature: fixed;
        gravity: [0, 0, -3.7] m/s^2;
        params { viscous_elbow: N*m*s/rad = 0.3 in 0.0..=2.0; upper_m: kg = 2000 g fixed; }
        emit { dynamics, first_derivatives }
        limit ops 100_000;
    }"#,
    r#"robot Slide { gravity: [0, 0, 0] m/s^2; link a { mass: 1 kg; } joint x: prismatic along x { base -> a; }
        per joint { force = -(2 N*s/m)*v + exp(q/(1 m))*(1 N) - 1 N*atan(q/(2 m)) + abs(q)*(1 N/m); } emit { dynamics } }"#,
];

/// What a slip of the pen may put in place of a token.
const WORDS: [&str; 62] = [
    "q",
    "v",
    "a",
    "t",
    "pi",
    "base",
    "fixed",
    "free",
    "in",
    "at",
    "about",
    "along",
    "com",
    "origin",
    "diag",
    "params",
    "link",
    "joint",
    "per",
    "force",
    "on",
    "motor",
    "drive",
    "torque",
    "current",
    "voltage",
    "gain",
    "ratio",
    "rotor",
    "resistance",
    "armature",
    "input",
    "potential",
    "lagrangian",
    "coordinates",
    "variant",
    "lock",
    "follows",
    "emit",
    "expect",
    "rank",
    "limit",
    "ops",
    "nominal",
    "m1",
    "l1",
    "j1",
    "j2",
    "flange",
    "kg",
    "m",
    "rad",
    "deg",
    "tanh",
    "sqrt",
    "abs",
    "_",
    "x",
    "z",
    "robot",
    "from",
    "type",
];
const NUMBERS: [&str; 14] = [
    "0",
    "1",
    "2",
    "-1",
    "1e308",
    "1e-308",
    "0.5",
    "3m",
    "99999999999",
    "0x10",
    "1_000",
    "9.81f32",
    "\"text\"",
    "'c'",
];
const PUNCTUATION: [char; 15] = [
    ':', ';', ',', '-', '>', '=', '.', '*', '/', '^', '+', '#', '!', '\'', '$',
];

/// A number below `len`.
pub(crate) fn index(random: &mut Random, len: usize) -> usize {
    (random.uniform(0.0, len as f64) as usize).min(len.saturating_sub(1))
}

fn pick<'a>(random: &mut Random, list: &[&'a str]) -> &'a str {
    list[index(random, list.len())]
}

/// An input: half of them mutated declarations, half grown from the grammar, most of those mutated as well.
pub(crate) fn input(random: &mut Random) -> TokenStream {
    let grown = random.uniform(0.0, 1.0) < 0.5;
    let text = match grown {
        true => grammar::robot(random),
        false => pick(random, &DECLARATIONS).to_owned(),
    };
    let Ok(mut tokens) = text.parse::<TokenStream>() else {
        panic!("a declaration of the fuzzer has no tokens:\n{text}");
    };
    let changes = match grown {
        true => index(random, 6).saturating_sub(2),
        false => 1 + index(random, 4),
    };
    for _ in 0..changes {
        let n = count(&tokens);
        if n == 0 {
            break;
        }
        let mut at = index(random, n);
        tokens = mutate(tokens, &mut at, random);
    }
    tokens
}

fn count(stream: &TokenStream) -> usize {
    stream
        .clone()
        .into_iter()
        .map(|t| match t {
            TokenTree::Group(g) => 1 + count(&g.stream()),
            _ => 1,
        })
        .sum()
}

/// Changes the token number `at`, counted through groups, and what stands beside it.
fn mutate(stream: TokenStream, at: &mut usize, random: &mut Random) -> TokenStream {
    let mut out: Vec<TokenTree> = Vec::new();
    let mut rest = stream.into_iter();
    while let Some(t) = rest.next() {
        let here = *at == 0;
        *at = at.wrapping_sub(1);
        if !here {
            out.push(match t {
                TokenTree::Group(g) => {
                    TokenTree::Group(Group::new(g.delimiter(), mutate(g.stream(), at, random)))
                }
                t => t,
            });
            continue;
        }
        match index(random, 10) {
            0 => {}
            1 => out.extend([t.clone(), t]),
            2 => out.push(Ident::new(pick(random, &WORDS), Span::call_site()).into()),
            3 => out.extend([
                t,
                Ident::new(pick(random, &WORDS), Span::call_site()).into(),
            ]),
            4 => out.push(literal(pick(random, &NUMBERS))),
            5 => out.extend([t, punct(random)]),
            6 => out.push(punct(random)),
            7 => out.extend(opened(t)),
            8 => out.push(regrouped(t, random)),
            // The rest of the group, in another order: the next token first.
            _ => {
                out.extend(rest.next());
                out.push(t);
            }
        }
    }
    out.into_iter().collect()
}

fn literal(text: &str) -> TokenTree {
    let literal: Literal = text.parse().unwrap_or_else(|_| Literal::u8_unsuffixed(0));
    literal.into()
}

fn punct(random: &mut Random) -> TokenTree {
    let c = PUNCTUATION[index(random, PUNCTUATION.len())];
    // A lifetime needs a name behind its quote.
    let c = if c == '\'' { '?' } else { c };
    Punct::new(c, Spacing::Alone).into()
}

/// A group without its delimiters.
fn opened(t: TokenTree) -> Vec<TokenTree> {
    match t {
        TokenTree::Group(g) => g.stream().into_iter().collect(),
        t => vec![Group::new(Delimiter::None, t.into()).into()],
    }
}

/// A group in other delimiters, or emptied; a token in parentheses.
fn regrouped(t: TokenTree, random: &mut Random) -> TokenTree {
    let delimiters = [
        Delimiter::Parenthesis,
        Delimiter::Brace,
        Delimiter::Bracket,
        Delimiter::None,
    ];
    let delimiter = delimiters[index(random, 4)];
    let inner = match t {
        TokenTree::Group(_) if random.uniform(0.0, 1.0) < 0.3 => TokenStream::new(),
        TokenTree::Group(g) => g.stream(),
        t => t.into(),
    };
    Group::new(delimiter, inner).into()
}

/// The outcome of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Refused by the grammar.
    Syntax,
    /// Refused by a check.
    Refused,
    /// Expanded to a robot.
    Robot,
}

/// Parses and checks an input; expands it too if `whole` is set or the robot comes from a file.
/// Panics where a promise does not hold: the output is Rust items, a refusal gives a reason, and
/// both ways agree.
pub(crate) fn exercise(input: &TokenStream, whole: bool) -> Outcome {
    let from_file = input.to_string().contains("urdf");
    let checked = match from_file {
        true => Ok(Vec::new()),
        false => pid_codegen::robots(input.clone()),
    };
    if let Err(messages) = &checked {
        assert!(!messages.is_empty(), "refused without a message: {input}");
        messages.iter().for_each(|m| says_why(m, input));
    }
    let mut refused = checked.is_err();
    if whole || from_file {
        let messages = expanded(input);
        messages.iter().for_each(|m| says_why(m, input));
        // Sizes are found by the expansion alone.
        let late = messages.iter().all(|m| m.contains("operations (limit"));
        assert!(
            from_file || late || refused,
            "checked, but not expanded: {messages:?}\n{input}"
        );
        refused |= !messages.is_empty();
    }
    if !refused {
        return Outcome::Robot;
    }
    let mut diag = Diagnostics::new();
    pid_codegen::syntax::parse(input.clone(), &mut diag);
    match diag.is_ok() {
        true => Outcome::Refused,
        false => Outcome::Syntax,
    }
}

fn says_why(message: &str, input: &TokenStream) {
    assert!(
        message.len() > 8 && !message.contains("is a defect of robot!"),
        "{message}\ninput: {input}"
    );
}

/// The messages of an expansion.
fn expanded(input: &TokenStream) -> Vec<String> {
    let folder = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../pid-urdf/tests/robots"
    ));
    let output = pid_codegen::expand_in(input.clone(), folder);
    let file: syn::File = match syn::parse2(output.clone()) {
        Ok(file) => file,
        Err(error) => panic!("{error}\ninput: {input}\noutput: {output}"),
    };
    file.items.iter().filter_map(message).collect()
}

/// The text of a `compile_error!`.
fn message(item: &syn::Item) -> Option<String> {
    match item {
        syn::Item::Macro(m) if m.mac.path.segments.last()?.ident == "compile_error" => {
            Some(m.mac.tokens.to_string())
        }
        _ => None,
    }
}

//! Whatever the tokens, `expand` returns Rust items: it does not panic, and a refused robot says why.

use proc_macro2::{Group, Ident, Literal, Punct, Spacing, Span, TokenStream, TokenTree};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

const ROBOT: &str = r#"
    /// Two links with everything the language has.
    #[allow(deprecated)]
    pub(crate) robot Arm {
        gravity: [0, 0, -g] m/s^2;
        params {
            g: m/s^2 = 9.81 fixed;
            /// A mass.
            m1: kg = 1.0 in 0.1..=5.0;
            l: mm = 300 in 100..;
        }
        link l1 { mass: m1; com: [0, 0.01 m, l/2]; inertia at com: diag(_, 0.02 kg*m^2, 0.01 kg*m^2); }
        link l2..=l3 { inertial: free; mass: 2 kg; }
        joint j1: revolute about [0, 0.6, 0.8] { base -> l1 rpy [0, 90, 0] deg; limits: -120..=120 deg; }
        joint j2: prismatic along x { l1 -> l2 at [0, 0, l]; }
        joint flange: fixed { l2 -> l3; }
        per joint j1..=j2 {
            input drive: A;
            sharp: 1/s = [50.0, 20.0] in [5.0.., 2.0..=200.0];
        }
        per joint j1 { rotor: kg*m^2 = 0.01; armature = rotor; force = 2 N*m/A * drive - 1.0 N*m * tanh(sharp*v * 1 s^2); }
        force on j2 = 3 N/A * drive - 2.0 N/m * (q - l)^2/(0.1 m) + sqrt(m1*2 N^2/kg);
        emit { dynamics, second_derivatives }
    }
"#;

/// What a slip of the pen may put in place of a token.
const WORDS: &[&str] = &[
    "q", "v", "a", "pi", "base", "fixed", "in", "params", "link", "joint", "per", "force", "m1",
    "l1", "j1", "flange", "kg", "m", "rad", "deg", "tanh", "sqrt", "abs", "_", "x", "free",
    "about", "type",
];
const NUMBERS: &[&str] = &[
    "0",
    "1",
    "-1",
    "1e308",
    "1e-308",
    "0.5",
    "3m",
    "99999999999",
    "0x10",
    "\"text\"",
    "'c'",
];
const PUNCTUATION: &[char] = &[
    ':', ';', ',', '-', '>', '=', '.', '*', '/', '^', '+', '#', '!',
];

#[derive(Debug, Clone)]
enum Change {
    Delete,
    Duplicate,
    Word(usize),
    Number(usize),
    Punct(usize),
    Empty,
}

fn change() -> impl Strategy<Value = Change> {
    prop_oneof![
        Just(Change::Delete),
        Just(Change::Duplicate),
        (0..WORDS.len()).prop_map(Change::Word),
        (0..NUMBERS.len()).prop_map(Change::Number),
        (0..PUNCTUATION.len()).prop_map(Change::Punct),
        Just(Change::Empty),
    ]
}

fn count(stream: TokenStream) -> usize {
    stream
        .into_iter()
        .map(|t| match t {
            TokenTree::Group(g) => 1 + count(g.stream()),
            _ => 1,
        })
        .sum()
}

/// Applies a change to the token number `at`, counted through groups.
fn mutate(stream: TokenStream, at: &mut usize, change: &Change) -> TokenStream {
    let mut out: Vec<TokenTree> = Vec::new();
    for t in stream {
        let here = *at == 0;
        *at = at.wrapping_sub(1);
        let t = match t {
            TokenTree::Group(g) if !here => {
                TokenTree::Group(Group::new(g.delimiter(), mutate(g.stream(), at, change)))
            }
            t => t,
        };
        if !here {
            out.push(t);
            continue;
        }
        match change {
            Change::Delete => {}
            Change::Duplicate => out.extend([t.clone(), t]),
            Change::Word(k) => out.push(Ident::new(WORDS[*k], Span::call_site()).into()),
            Change::Number(k) => {
                out.push(NUMBERS[*k].parse::<Literal>().expect("a literal").into())
            }
            Change::Punct(k) => out.push(Punct::new(PUNCTUATION[*k], Spacing::Joint).into()),
            Change::Empty => match t {
                TokenTree::Group(g) => {
                    out.push(Group::new(g.delimiter(), TokenStream::new()).into())
                }
                t => out.push(t),
            },
        }
    }
    out.into_iter().collect()
}

fn robot() -> TokenStream {
    ROBOT.parse().expect("tokens")
}

/// Expands and reads the result as Rust; gives the messages of its `compile_error!`s.
fn messages(input: TokenStream) -> Vec<String> {
    let file: syn::File = syn::parse2(pid_codegen::expand(input)).expect("items");
    file.items
        .iter()
        .filter_map(|item| match item {
            syn::Item::Macro(m) if m.mac.path.segments.last()?.ident == "compile_error" => {
                Some(m.mac.tokens.to_string())
            }
            _ => None,
        })
        .collect()
}

#[test]
fn the_robot_itself_is_accepted() {
    assert_eq!(messages(robot()), Vec::<String>::new());
}

#[test]
fn expansion_is_deterministic() {
    let once = pid_codegen::expand(robot()).to_string();
    assert_eq!(once, pid_codegen::expand(robot()).to_string());
}

#[test]
fn an_empty_call_says_what_is_expected() {
    let all = messages(TokenStream::new());
    assert_eq!(all.len(), 1);
    assert!(all[0].contains("expected `robot Name"), "{all:?}");
}

#[test]
fn deep_and_long_expressions_are_refused() {
    let with = |e: &str| ROBOT.replace("2 N*m/A * drive", e).parse().expect("tokens");
    let deep = format!("{}drive{}", "(".repeat(5000), ")".repeat(5000));
    let minus = format!("{}drive", "- ".repeat(100_000));
    let plus = format!("{}drive", "+ ".repeat(100_000));
    let long = vec!["1 N*m"; 100_000].join(" + ");
    for (e, what) in [
        (deep, "nested"),
        (minus, "nested"),
        (plus, "nested"),
        (long, "more than 512 operands"),
    ] {
        let all = messages(with(&e));
        assert!(all.iter().any(|m| m.contains(what)), "{all:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 400,
        rng_seed: RngSeed::Fixed(7),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn no_change_of_tokens_makes_it_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), change()), 1..4)
    ) {
        let mut tokens = robot();
        for (index, change) in &changes {
            let n = count(tokens.clone());
            if n == 0 {
                break;
            }
            tokens = mutate(tokens, &mut index.index(n), change);
        }
        messages(tokens);
    }
}

//! What is written: the whole expansion of a tiny robot, and properties of large ones. That emitted
//! code computes the right numbers is tested where it is compiled, in `pid-models` and `tests`.

#[path = "../../pid-derive/tests/robots/mod.rs"]
mod robots;

use pid_codegen::emit::{self, Face, Names};
use pid_derive::model::{Expr, Func, Robot};
use proc_macro2::{Ident, Span};
use quote::ToTokens;
use syn::visit::Visit;

fn names(robot: &Robot) -> Names {
    let ident = |name: &str| Ident::new(name, Span::call_site());
    let mut moving: Vec<_> = robot
        .joints
        .iter()
        .filter(|joint| joint.coord.is_some())
        .collect();
    moving.sort_by_key(|joint| joint.coord);
    Names {
        face: Face::Full,
        vis: syn::parse_quote!(pub),
        robot: ident(&robot.name),
        params: robot
            .params
            .iter()
            .map(|param| ident(&param.name))
            .collect(),
        joints: moving.iter().map(|joint| ident(&joint.name)).collect(),
        inputs: robot
            .inputs
            .iter()
            .map(|input| ident(&input.name))
            .collect(),
    }
}

fn expansion(robot: &Robot) -> syn::File {
    let found = pid_derive::identifiability(robot).expect("the robot can be derived");
    let tokens = emit::try_model(robot, &names(robot), &found, usize::MAX)
        .expect("the robot can be derived");
    syn::parse2(tokens).expect("the expansion is a list of items")
}

#[test]
fn the_expansion_of_a_carriage() {
    insta::assert_snapshot!(prettyplease::unparse(&expansion(&robots::carriage())));
}

#[test]
fn the_same_tokens_every_time() {
    let text = || expansion(&robots::tree()).to_token_stream().to_string();
    assert_eq!(text(), text());
}

/// Statements of the longest function.
#[derive(Default)]
struct Longest {
    statements: usize,
    functions: usize,
}

impl<'ast> Visit<'ast> for Longest {
    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.functions += 1;
        let operations = item.block.stmts.iter().filter(|stmt| matches!(stmt, syn::Stmt::Local(local) if local.init.as_ref().is_some_and(|init| !matches!(&*init.expr, syn::Expr::Index(index) if index.expr.to_token_stream().to_string() == "w"))));
        self.statements = self.statements.max(operations.count());
        syn::visit::visit_item_fn(self, item);
    }
}

#[test]
fn functions_of_large_robots_are_split() {
    let mut longest = Longest::default();
    longest.visit_file(&expansion(&robots::arm(6)));
    assert!(
        longest.statements <= emit::functions::BLOCK,
        "{}",
        longest.statements
    );
    assert!(longest.functions > 30, "{}", longest.functions);
}

#[test]
fn functions_and_powers_of_a_force_law() {
    let mut robot = robots::carriage();
    let v = || Box::new(Expr::Velocity(0));
    let cube = Expr::Powi(v(), -5);
    let sign = robots::call(Func::Sign, Expr::Velocity(0));
    robot.joints[0].force = Some(robots::add(cube, sign));
    robot.emit.second_derivatives = false;
    let text = expansion(&robot).to_token_stream().to_string();
    for expected in [
        ":: pid_runtime :: __private :: sign (v [0])",
        ":: pid_runtime :: __private :: dual_sign (v [0])",
        "DualNum :: powi (& v [0] , - 5i32)",
        "1.0 / ({ let s = (v [0] * v [0]) ; s * s } * v [0])",
    ] {
        assert!(text.contains(expected), "{expected}");
    }
    assert!(!text.contains("Hessian for"));
}

/// What programs without `std` cannot have, as words of an expansion.
const BEYOND_CORE: [&str; 6] = [
    ":: std ::",
    "num_dual",
    "Dynamics for",
    "Jacobian for",
    "generic ::",
    "f64 :: tanh",
];

fn core(declaration: &str) -> String {
    let tokens = declaration.parse().expect("tokens");
    pid_codegen::expand_for(tokens, pid_codegen::Face::Core).to_string()
}

#[test]
fn without_std_there_are_functions_on_arrays_alone() {
    const PENDULUM: &str = "pub robot Pendulum {
        gravity: [0, 0, -9.81] m/s^2;
        params { m: kg = 1.0 in 0.1..=5.0; dry: N*m = 0.1 in 0.0..=1.0; }
        link rod { mass: m; com: [0, 0, -0.5] m; }
        joint pivot: revolute about y { base -> rod; }
        force on pivot = -dry*tanh(50 s/rad * v);
        emit { dynamics, second_derivatives, regressor, lanes }
    }";
    let text = core(PENDULUM);
    for expected in [
        ":: pid_runtime :: __private :: real :: tanh",
        ":: pid_runtime :: __private :: real :: sin",
        "pub fn residual",
        "pub fn inverse_dynamics_derivatives",
        "pub fn lagrangian_hessian",
    ] {
        assert!(text.contains(expected), "{expected}\n{text}");
    }
    for beyond in BEYOND_CORE {
        assert!(!text.contains(beyond), "{beyond}\n{text}");
    }
    // With a mistake: the error, and stubs of the same functions.
    let text = core(&PENDULUM.replace("mass: m;", "mass: n;"));
    assert!(
        text.contains("compile_error") && text.contains("pub fn residual"),
        "{text}"
    );
    for beyond in BEYOND_CORE {
        assert!(!text.contains(beyond), "{beyond}\n{text}");
    }
}

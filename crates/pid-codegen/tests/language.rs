//! Declarations that use the whole language expand without a message, and mean what they say.

use pid_codegen::check::{self, Resolved};
use pid_codegen::diag::Diagnostics;
use pid_codegen::syntax;
use pid_derive::model::{Affine, Expr, Inertial, JointKind};

/// A wrist with a coupled motor, a parallelogram, springs, bodies of dimensions, drives, variants.
const WRIST: &str = r#"
    pub robot Wrist {
        gravity: [0, 0, -9.81] m/s^2;
        params {
            r: mm = 40 in 10..=80;
            rho: kg/m^3 = 2700 in 1000..=9000;
            n: 1 = 50 fixed;
            k: N*m/rad = 3.0 in 0..=10;
            c: 1 = 0.5 in 0..=1;
        }
        input push: N*m;
        link a { inertial: solid cylinder { density: rho; radius: r; length: 0.3 m; axis: z; } com: [0, 0, 0.15] m; }
        link b { inertial: solid box { mass: 1.5 kg; size: [0.1, 0.2, 0.3] m; } }
        link c { inertial: hollow cylinder { mass: 0.4 kg; outer: r; inner: r/2; length: 20 mm; axis: x; } com: [0.1, 0, 0] m; }
        link d { inertial: solid sphere { density: 8000 kg/m^3; radius: 30 mm; } }
        joint j1: revolute about z { base -> a; }
        joint j2: revolute about y { a -> b at [0, 0, 0.3] m; }
        joint j3: revolute about y { b -> c at [0.2, 0, 0] m; follows -j1/2 - c*j2 + 10 deg; }
        joint j4: revolute about x { c -> d at [0.2, 0, 0] m; }
        per joint j1, j2 {
            resistance: Ohm = 1.2 in 0.1..=5;
            gain: N*m/A = 0.05 in 0.01..=1;
            drive: voltage { gain: gain; resistance: resistance; ratio: n; rotor: 1e-5 kg*m^2; }
        }
        per joint j3 { damping: N*m*s/rad = 0.2 in 0..=1; force = -damping*v; }
        motor m4: j2 + 2*j4 {
            drive: current { gain: 0.7 N*m/A; }
            dry: N*m = 0.5 in 0..=5;
            armature = 0.01 kg*m^2;
            force = -dry*tanh(20 s/rad * v);
        }
        potential += 0.5*k*(q.j2 - 0.1 rad)^2;
        potential += 0.1 N*m * cos(q.j4);
        force on j4 = push + 0.1 N*m*s/rad * v.m4;
        emit { dynamics, first_derivatives }
        /// The first joint held.
        variant Planar { lock j1 = 90 deg; }
        variant Spin { lock j2..=j2 = 0.5 rad; lock j4 = 0 rad; emit { dynamics } }
    }
"#;

const CART: &str = r#"
    robot Cart {
        params { mc: kg = 1.0 in 0.1..=5; mp: kg = 0.2 in 0.01..=1; l: m = 0.5 in 0.1..=1; damping: N*s/m = 0.1 in 0..=1; }
        input push: N;
        coordinates
            /// Position of the cart.
            x: mm in -500..=500,
            th: rad;
        lagrangian = 0.5*(mc + mp)*v.x^2 + mp*l*v.x*v.th*cos(th) + 0.5*mp*l^2*v.th^2 - mp*9.81 m/s^2*l*cos(q.th);
        potential += 3 N/m * x^2;
        force on x = push - damping*v;
        per joint th { viscous: N*m*s/rad = 0.01 in 0..=1; force = -viscous*v; }
        variant Pendulum { lock x = 0 m; }
    }
"#;

fn resolved(text: &str, variant: Option<usize>) -> Resolved {
    let mut diag = Diagnostics::new();
    let tokens = text.parse().expect("tokens");
    let ast = syntax::parse(tokens, &mut diag).expect("a robot");
    let ast = variant.map_or(ast.clone(), |k| ast.variant(k));
    let resolved = check::resolve(&ast, &mut diag);
    if variant.is_none() {
        assert_eq!(diag.located(), Vec::<String>::new());
    }
    resolved.expect("no errors")
}

#[test]
fn the_whole_language_expands_to_items() {
    for text in [WRIST, CART] {
        resolved(text, None);
        let tokens = pid_codegen::expand(text.parse().expect("tokens"));
        let all = tokens.to_string();
        assert!(!all.contains("compile_error"), "{all:.2000}");
        syn::parse2::<syn::File>(tokens).expect("items");
    }
}

#[test]
fn a_follower_is_an_affine_combination_of_coordinates() {
    let robot = resolved(WRIST, None).robot;
    assert_eq!(robot.nq(), 3);
    let Some(Affine { terms, offset }) = &robot.joints[2].follows else {
        panic!("j3 follows");
    };
    let coords: Vec<usize> = terms.iter().map(|t| t.0).collect();
    assert_eq!(coords, [0, 1]);
    assert_eq!(*offset, Expr::Num(10_f64.to_radians()));
    let motor = &robot.motors[0];
    assert_eq!(motor.moves.terms[0], (1, Expr::Num(1.0)));
    assert_eq!(motor.moves.terms[1].0, 2);
    assert!(motor.armature.is_some() && motor.force.is_some());
}

#[test]
fn variants_lose_coordinates_inputs_and_drive_parameters() {
    let full = resolved(WRIST, None).robot;
    let names = |v: &[pid_derive::model::Param]| -> Vec<String> {
        v.iter().map(|p| p.name.clone()).collect()
    };
    assert!(names(&full.params).contains(&"gain_j1".to_string()));
    let planar = resolved(WRIST, Some(0)).robot;
    assert_eq!((planar.name.as_str(), planar.nq()), ("Planar", 2));
    assert_eq!(planar.docs, ["The first joint held."]);
    assert!(!names(&planar.params).contains(&"gain_j1".to_string()));
    let inputs: Vec<&str> = planar.inputs.iter().map(|u| u.name.as_str()).collect();
    assert_eq!(inputs, ["push", "voltage_j2", "current_m4"]);
    let held = planar.joints[0].follows.as_ref().expect("held");
    assert!(held.terms.is_empty());
    assert_eq!(held.offset, Expr::Num(90_f64.to_radians()));
    assert!(planar.emit.first_derivatives);
    // j2 and j4 held: the motor has nothing to move.
    let spin = resolved(WRIST, Some(1)).robot;
    assert_eq!(spin.nq(), 1);
    assert!(spin.motors[0].moves.terms.is_empty());
    assert!(spin.motors[0].force.is_none());
    assert!(!spin.emit.first_derivatives);
    assert!(!names(&spin.params).contains(&"dry_m4".to_string()));
}

#[test]
fn coordinates_of_a_lagrangian_have_kinds_and_limits() {
    let robot = resolved(CART, None).robot;
    let kinds: Vec<JointKind> = robot.joints.iter().map(|j| j.kind).collect();
    assert_eq!(kinds, [JointKind::Length, JointKind::Angle]);
    assert_eq!(robot.joints[0].limits, Some((-0.5, 0.5)));
    assert_eq!(robot.joints[0].docs, ["Position of the cart."]);
    assert_eq!(robot.inputs[0].coord, None);
    let pendulum = resolved(CART, Some(0)).robot;
    assert_eq!(pendulum.nq(), 1);
}

/// Numbers of a body at the nominal values: mass and diagonal of the inertia.
fn body(text: &str) -> [f64; 4] {
    let robot = format!(
        "robot R {{ gravity: [0, 0, -9.81] m/s^2; link a {{ {text} }} joint j: revolute about [1, 2, 3] {{ base -> a; }} }}"
    );
    let mut diag = Diagnostics::new();
    let ast = syntax::parse(robot.parse().expect("tokens"), &mut diag).expect("a robot");
    let robot = check::resolve(&ast, &mut diag).expect("good").robot;
    let Inertial::Body { mass, inertia, .. } = &robot.links[0].inertial else {
        panic!("a body");
    };
    let mut g = pid_symbolic::Graph::new();
    let symbols = pid_derive::Symbols::new(&mut g, &robot, pid_derive::Blanks::Zero);
    [mass, &inertia.xx, &inertia.yy, &inertia.zz].map(|e| {
        let id = symbols.expression(&mut g, e);
        g.value(id).expect("a constant")
    })
}

/// Mass and principal inertia of a body by summing over a fine grid of its bounding box of half
/// widths `half`.
fn summed(density: f64, half: [f64; 3], inside: impl Fn([f64; 3]) -> bool) -> [f64; 4] {
    const N: usize = 160;
    let cell = |k: usize, h: f64| h * (2.0 * (k as f64 + 0.5) / N as f64 - 1.0);
    let volume = half.iter().map(|h| 2.0 * h / N as f64).product::<f64>();
    let mut out = [0.0; 4];
    for i in 0..N {
        for j in 0..N {
            for k in 0..N {
                let [x, y, z] = [cell(i, half[0]), cell(j, half[1]), cell(k, half[2])];
                if inside([x, y, z]) {
                    let m = density * volume;
                    let parts = [1.0, y * y + z * z, x * x + z * z, x * x + y * y];
                    for (o, p) in out.iter_mut().zip(parts) {
                        *o += m * p;
                    }
                }
            }
        }
    }
    out
}

#[test]
fn homogeneous_bodies_have_the_integrals_of_their_density() {
    let cases = [
        (
            body(
                "inertial: solid cylinder { density: 2 g/cm^3; radius: 0.1 m; length: 0.5 m; axis: y; }",
            ),
            summed(2000.0, [0.1, 0.25, 0.1], |[x, _, z]| x * x + z * z <= 0.01),
        ),
        (
            body(
                "inertial: hollow cylinder { density: 1000 kg/m^3; outer: 0.1 m; inner: 0.06 m; length: 0.3 m; axis: z; }",
            ),
            summed(1000.0, [0.1, 0.1, 0.15], |[x, y, _]| {
                (0.0036..=0.01).contains(&(x * x + y * y))
            }),
        ),
        (
            body("inertial: solid box { density: 500 kg/m^3; size: [0.1, 0.2, 0.4] m; }"),
            summed(500.0, [0.05, 0.1, 0.2], |_| true),
        ),
        (
            body("inertial: solid sphere { density: 3000 kg/m^3; radius: 0.2 m; }"),
            summed(3000.0, [0.2; 3], |[x, y, z]| x * x + y * y + z * z <= 0.04),
        ),
    ];
    for (k, (found, expected)) in cases.iter().enumerate() {
        for (f, e) in found.iter().zip(expected) {
            assert!(
                (f - e).abs() <= 5e-3 * e,
                "case {k}: {found:?} for {expected:?}"
            );
        }
    }
    // A given mass is the mass.
    let [m, xx, ..] = body("inertial: solid box { mass: 6 kg; size: [1, 2, 3] m; }");
    assert_eq!((m, xx), (6.0, 6.5));
}

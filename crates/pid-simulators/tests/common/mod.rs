//! Robots drawn at random, and their equations.

#![allow(dead_code, reason = "each test uses a part")]

use std::fmt::Write;

use pid_derive::mechanism::{Body, Follows, InertiaSource, Mechanism, Place};
use pid_derive::model::Robot;
use pid_interpret::Model;
use pid_interpret::nominal::Nominal;
use pid_runtime::dynamics::{At, Dynamics};
use pid_symbolic::random::Random;

/// Largest difference, relative to the largest entry.
pub(crate) const CLOSE: f64 = 1e-10;

fn three(random: &mut Random, size: f64) -> [f64; 3] {
    std::array::from_fn(|_| random.uniform(-size, size))
}

/// An inertia that a body has: that of three rods of points along turned axes.
fn inertia(random: &mut Random) -> [f64; 6] {
    let [a, b, c] = [0, 1, 2].map(|_| random.uniform(0.002, 0.05));
    Place::new([0.0; 3], three(random, 3.0)).tensor([b + c, a + c, a + b, 0.0, 0.0, 0.0])
}

/// A tree of turning and sliding bodies; `follower`: its last body follows its first.
pub(crate) fn tree(seed: u64, bodies: usize, follower: bool) -> Mechanism {
    let mut random = Random::new(seed);
    let body = |k: usize, random: &mut Random| {
        let raw = three(random, 1.0);
        let size = raw.iter().map(|x| x * x).sum::<f64>().sqrt();
        let parent = (random.uniform(-0.3, 1.0) * k as f64).floor();
        let follows = (follower && k + 1 == bodies).then(|| Follows {
            body: 0,
            ratio: random.uniform(-2.0, 2.0),
            offset: random.uniform(-0.3, 0.3),
        });
        let own = |x: f64| follows.is_none().then_some(x);
        Body {
            joint: format!("joint_{k}"),
            link: format!("link_{k}"),
            prismatic: random.uniform(0.0, 1.0) < 0.35,
            axis: raw.map(|x| x / size),
            parent: (k > 0 && parent >= 0.0).then_some(parent as usize),
            origin: three(random, 0.5),
            rpy: three(random, 3.0),
            limits: (random.uniform(0.0, 1.0) < 0.5).then_some((-2.0, 1.5)),
            mass: random.uniform(0.2, 6.0),
            com: three(random, 0.2),
            inertia: inertia(random),
            source: InertiaSource::Stated,
            rotor: own(random.uniform(0.01, 0.4)),
            coulomb: own(random.uniform(0.1, 2.0)),
            viscous: own(random.uniform(0.1, 2.0)),
            effort: None,
            speed: None,
            follows,
        }
    };
    let bodies = (0..bodies).map(|k| body(k, &mut random)).collect();
    Mechanism {
        name: "Drawn".to_owned(),
        gravity: three(&mut random, 9.81),
        bodies,
    }
}

/// The bodies in the order of another mechanism with joints of the same names.
pub(crate) fn in_order_of(mechanism: &Mechanism, order: &Mechanism) -> Mechanism {
    let place = |name: &str| {
        order
            .bodies
            .iter()
            .position(|b| b.joint == name)
            .expect("a joint")
    };
    let mut out = mechanism.clone();
    for body in &mechanism.bodies {
        let to = |index: usize| place(&mechanism.bodies[index].joint);
        out.bodies[place(&body.joint)] = Body {
            parent: body.parent.map(to),
            follows: body.follows.map(|f| Follows {
                body: to(f.body),
                ..f
            }),
            ..body.clone()
        };
    }
    out
}

/// Mass matrix, row by row, and bias.
pub(crate) struct Equations {
    pub(crate) mass: Vec<Vec<f64>>,
    pub(crate) bias: Vec<f64>,
}

/// Equations at a state, at the nominal parameters of a robot; `rotors`: with rotor inertias.
pub(crate) fn equations(robot: &Robot, rotors: bool, q: &[f64], v: &[f64]) -> Equations {
    let model = Model::new(robot).unwrap_or_else(|e| panic!("{e}"));
    let p: Vec<f64> = (model.params().iter())
        .map(|p| match !rotors && p.name.starts_with("rotor_") {
            true => 0.0,
            false => p.nominal,
        })
        .collect();
    let n = q.len();
    assert_eq!(model.dims().nq, n);
    let zero = vec![0.0; n.max(model.dims().nu)];
    let at = At {
        q,
        v,
        a: &zero[..n],
        u: &zero[..model.dims().nu],
        p: &p,
    };
    let (mut lower, mut bias) = (vec![0.0; n * (n + 1) / 2], vec![0.0; n]);
    model.mass_matrix(&at, &mut lower);
    model.bias(&at, &mut bias);
    let entry = |i: usize, j: usize| lower[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)];
    Equations {
        mass: (0..n)
            .map(|i| (0..n).map(|j| entry(i, j)).collect())
            .collect(),
        bias,
    }
}

/// Equations of a mechanism whose followers count as joints of their own, in the coordinates of the
/// others: `Tᵀ M T`, `Tᵀ b` with `q = T x + o`.
pub(crate) fn reduced(free: &Mechanism, leaders: &Mechanism, x: &[f64], w: &[f64]) -> Equations {
    let n = free.bodies.len();
    let own: Vec<usize> = (0..n)
        .filter(|&k| leaders.bodies[k].follows.is_none())
        .collect();
    let mut t = vec![vec![0.0; own.len()]; n];
    let mut offset = vec![0.0; n];
    for k in 0..n {
        let (leader, ratio, shift) = match leaders.bodies[k].follows {
            Some(f) => (f.body, f.ratio, f.offset),
            None => (k, 1.0, 0.0),
        };
        let column = own
            .iter()
            .position(|&o| o == leader)
            .expect("a leader moves on its own");
        t[k][column] = ratio;
        offset[k] = shift;
    }
    let lift = |x: &[f64]| -> Vec<f64> {
        t.iter()
            .map(|row| row.iter().zip(x).map(|(t, x)| t * x).sum())
            .collect()
    };
    let q: Vec<f64> = lift(x).iter().zip(&offset).map(|(q, o)| q + o).collect();
    let all = equations(&free.robot(), true, &q, &lift(w));
    let entry = |i: usize, j: usize| -> f64 {
        (0..n)
            .map(|k| {
                (0..n)
                    .map(|l| t[k][i] * all.mass[k][l] * t[l][j])
                    .sum::<f64>()
            })
            .sum()
    };
    Equations {
        mass: (0..own.len())
            .map(|i| (0..own.len()).map(|j| entry(i, j)).collect())
            .collect(),
        bias: (0..own.len())
            .map(|i| (0..n).map(|k| t[k][i] * all.bias[k]).sum())
            .collect(),
    }
}

pub(crate) fn same(found: &Equations, expected: &Equations, what: &str) {
    let pairs =
        |x: &Equations| -> Vec<f64> { x.mass.iter().flatten().chain(&x.bias).copied().collect() };
    let (found, expected) = (pairs(found), pairs(expected));
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = expected.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
    for (x, y) in found.iter().zip(&expected) {
        assert!(
            (x - y).abs() <= CLOSE * scale,
            "{what}: {x:e} for {y:e}, scale {scale:e}"
        );
    }
}

/// A state: positions and velocities.
pub(crate) fn state(random: &mut Random, n: usize) -> [Vec<f64>; 2] {
    [3.0, 4.0].map(|size| (0..n).map(|_| random.uniform(-size, size)).collect())
}

/// A chain of two turning links and a slide, with effects.
pub(crate) fn described(effects: &str) -> Nominal {
    behind_loop("", effects)
}

/// A loop that an effect may be a stage of.
pub(crate) const LOOP: &str = "[joint.drive]\nlaw = \"pd\"\nkp = 20.0\nkd = 2.0\n";

/// The same with the table of a loop at the second joint.
pub(crate) fn behind_loop(drive: &str, effects: &str) -> Nominal {
    let mut text = String::from(
        "[robot]\nname = \"arm\"\ngravity = [0.0, 0.0, -9.81]\ntool = [0.1, 0.02, -0.3]\n\
         [tolerance]\nmass_rel = 0.05\ncom_abs_m = 0.003\ninertia_rel = 0.05\nrotor_inertia_rel = 0.05\n\
         motor_gain_rel = 0.01\nfriction_rel = 0.4\n",
    );
    for (name, kind, axis, input) in [
        ("j1", "revolute", "[0.0, 1.0, 0.0]", "current"),
        ("j2", "revolute", "[0.0, 0.6, 0.8]", "current"),
        ("j3", "prismatic", "[1.0, 0.0, 0.0]", "force"),
    ] {
        write!(
            text,
            "[[joint]]\nname = \"{name}\"\ntype = \"{kind}\"\naxis = {axis}\norigin = [0.0, 0.05, -0.4]\nrpy = [0.1, 0.2, -0.3]\n\
             mass = 2.0\ncom = [0.01, 0.02, -0.15]\ninertia = [0.03, 0.031, 0.008, 0.001, 0.0, 0.002]\nrotor_inertia = 0.1\n\
             coulomb = 0.8\nviscous = 0.5\nmotor_gain = 3.0\ninput = \"{input}\"\nvelocity = \"measured\"\ntorque_peak = 20.0\n"
        )
        .expect("a text");
        if name == "j2" {
            text.push_str(drive);
        }
    }
    text.push_str(effects);
    Nominal::parse("arm.toml", &text).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// An effect as a description states it.
pub(crate) fn effect(id: &str, joint: Option<&str>, parameters: &[(&str, f64)]) -> String {
    let joint = joint.map_or(String::new(), |j| format!("joint = \"{j}\"\n"));
    let mut text = format!("[[effect]]\nid = \"{id}\"\n{joint}[effect.parameters]\n");
    for (name, value) in parameters {
        writeln!(text, "{name} = {{ value = {value:?} }}").expect("a text");
    }
    text
}

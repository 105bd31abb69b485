//! Equations for people: their text, and that they equal the graph.

mod robots;

use std::collections::HashMap;

use pid_derive::model::{About, Expr, Inertial, JointKind, Robot};
use pid_derive::readable::{Readable, Variable};
use pid_derive::{Equations, sample};
use pid_symbolic::random::Random;
use pid_symbolic::{Graph, Tape};
use robots::{Builder, Y, diagonal, mul, num, sub};

/// A rod on a horizontal axis, zero when it hangs.
fn pendulum() -> Robot {
    let mut b = Builder::new("Pendulum");
    let m = b.param("m1", "kg", 1.0, 0.5, 2.0);
    let l = b.param("l", "m", 0.5, 0.1, 1.0);
    let iy = b.param("iy1", "kg*m^2", 0.02, 0.001, 0.1);
    let viscous = b.param("viscous_pivot", "N*m*s/rad", 0.1, 0.0, 1.0);
    let torque = b.input("torque_pivot", "N*m", 0);
    let rod = b.link(
        "rod",
        Inertial::Body {
            mass: m,
            com: [num(0.0), num(0.0), robots::neg(l)],
            inertia: diagonal(num(0.0), iy, num(0.0)),
            about: About::Com,
        },
    );
    let joint = b.joint("pivot", JointKind::Revolute(Y), None, rod);
    joint.force = Some(sub(torque, mul(viscous, Expr::Velocity(0))));
    b.robot()
}

fn derive(robot: &Robot) -> (Graph, Equations) {
    let mut g = Graph::new();
    let equations = pid_derive::equations(&mut g, robot).unwrap();
    (g, equations)
}

#[test]
fn a_pendulum_as_text() {
    let robot = pendulum();
    let (g, equations) = derive(&robot);
    assert_eq!(
        Readable::new(&g, &robot, &equations).text(),
        "Pendulum: M(q, p) a + b(q, v, p) = f_L(q, v, p, u)\n\
         M[pivot, pivot] = m1*l^2 + iy1\n\
         b[pivot] = 9.81*m1*l*sin(q.pivot)\n\
         f_L[pivot] = torque_pivot - viscous_pivot*v.pivot\n"
    );
}

#[test]
fn a_pendulum_as_latex() {
    let robot = pendulum();
    let (g, equations) = derive(&robot);
    insta::assert_snapshot!(Readable::new(&g, &robot, &equations).latex());
}

#[test]
fn the_papers_robot_as_text() {
    let robot = robots::two_link();
    let (g, equations) = derive(&robot);
    insta::assert_snapshot!(Readable::new(&g, &robot, &equations).text());
}

#[test]
fn a_long_system_shares_what_it_computes_twice() {
    let robot = robots::arm(6);
    let (g, equations) = derive(&robot);
    let readable = Readable::new(&g, &robot, &equations);
    assert!(readable.shared.len() > 50);
    let latex = readable.latex();
    assert!(latex.contains("\\begin{align*}\n  s_{1} &= "));
}

/// Reads the text back and evaluates it: `+ - * / ^`, brackets, names, functions.
struct Reader<'a> {
    rest: &'a str,
    values: &'a HashMap<String, f64>,
}

impl Reader<'_> {
    fn peek(&mut self) -> char {
        self.rest = self.rest.trim_start();
        self.rest.chars().next().unwrap_or('\0')
    }

    fn eat(&mut self, c: char) -> bool {
        let found = self.peek() == c;
        if found {
            self.rest = &self.rest[1..];
        }
        found
    }

    fn sum(&mut self) -> f64 {
        let mut x = if self.eat('-') {
            -self.product()
        } else {
            self.product()
        };
        loop {
            if self.eat('+') {
                x += self.product();
            } else if self.eat('-') {
                x -= self.product();
            } else {
                return x;
            }
        }
    }

    fn product(&mut self) -> f64 {
        let mut x = self.power();
        loop {
            if self.eat('*') {
                x *= self.power();
            } else if self.eat('/') {
                x /= self.power();
            } else {
                return x;
            }
        }
    }

    fn power(&mut self) -> f64 {
        let x = self.atom();
        if !self.eat('^') {
            return x;
        }
        let minus = self.eat('-');
        let n = self.atom() as i32;
        x.powi(if minus { -n } else { n })
    }

    fn atom(&mut self) -> f64 {
        if self.eat('(') {
            let x = self.sum();
            assert!(self.eat(')'), "`)` at {}", self.rest);
            return x;
        }
        let start = self.peek();
        let word = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '.';
        let end = self.rest.find(|c| !word(c)).unwrap_or(self.rest.len());
        let (name, rest) = self.rest.split_at(end);
        self.rest = rest;
        if start.is_ascii_digit() {
            return name.parse().unwrap();
        }
        if self.eat('(') {
            let x = self.sum();
            assert!(self.eat(')'), "`)` at {}", self.rest);
            return match name {
                "sin" => x.sin(),
                "cos" => x.cos(),
                "tanh" => x.tanh(),
                _ => panic!("function {name}"),
            };
        }
        *self
            .values
            .get(name)
            .unwrap_or_else(|| panic!("name `{name}`"))
    }
}

#[test]
fn the_text_says_what_the_graph_says() {
    for robot in [
        pendulum(),
        robots::two_link(),
        robots::carriage(),
        robots::tree(),
        robots::arm(2),
        robots::arm(3),
        robots::arm(6),
    ] {
        let (g, equations) = derive(&robot);
        let readable = Readable::new(&g, &robot, &equations);
        let outputs = [
            equations.mass_matrix.as_slice(),
            &equations.bias,
            &equations.applied_force,
        ]
        .concat();
        let tape = Tape::new(&g, &outputs);
        let mut random = Random::new(5);
        for _ in 0..3 {
            let z = sample::point(&robot, &mut random);
            let mut expected = vec![0.0; outputs.len()];
            tape.eval(&z, &mut expected);
            let variables = 3 * robot.nq() + robot.inputs.len() + robot.params.len();
            let mut values: HashMap<String, f64> = (0..variables)
                .map(|k| {
                    let name = match readable.variable(k) {
                        Variable::Position(joint) => format!("q.{joint}"),
                        Variable::Velocity(joint) => format!("v.{joint}"),
                        Variable::Acceleration(joint) => format!("a.{joint}"),
                        Variable::Input(name) | Variable::Param(name) => name.to_owned(),
                    };
                    (name, z[k])
                })
                .collect();
            // Line by line, as a person would.
            for line in readable.text().lines().skip(1) {
                let (name, formula) = line.split_once(" = ").unwrap();
                let mut reader = Reader {
                    rest: formula,
                    values: &values,
                };
                let value = reader.sum();
                assert_eq!(reader.rest.trim(), "", "{line}");
                values.insert(name.to_owned(), value);
            }
            let joints = readable.joints();
            let pairs = (0..joints.len()).flat_map(|i| (0..=i).map(move |j| (i, j)));
            let names = pairs
                .map(|(i, j)| format!("M[{}, {}]", joints[i], joints[j]))
                .chain(joints.iter().map(|j| format!("b[{j}]")))
                .chain(joints.iter().map(|j| format!("f_L[{j}]")));
            let scale = expected.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
            for (name, expected) in names.zip(&expected) {
                let found = values.get(&name).copied().unwrap_or(0.0);
                assert!(
                    (found - expected).abs() <= 1e-12 * scale,
                    "{} {name}: {found} for {expected}",
                    robot.name
                );
            }
        }
    }
}

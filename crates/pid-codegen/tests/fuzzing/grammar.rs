//! Declarations grown from the grammar of `robot!`: most of them make sense, some of their numbers,
//! units and names do not.

use pid_symbolic::random::Random;

use super::fuzzing::index;

/// A declaration as text.
pub(crate) fn robot(random: &mut Random) -> String {
    let mut grower = Grower {
        random,
        text: String::new(),
        joints: Vec::new(),
        lengths: Vec::new(),
    };
    grower.robot();
    grower.text
}

struct Grower<'a> {
    random: &'a mut Random,
    text: String,
    /// Moving joints, and whether each is prismatic.
    joints: Vec<String>,
    lengths: Vec<bool>,
}

impl Grower<'_> {
    fn chance(&mut self, p: f64) -> bool {
        self.random.uniform(0.0, 1.0) < p
    }

    fn below(&mut self, n: usize) -> usize {
        index(self.random, n)
    }

    fn pick<'s>(&mut self, list: &[&'s str]) -> &'s str {
        list[self.below(list.len())]
    }

    fn say(&mut self, text: &str) {
        self.text.push_str(text);
        self.text.push(' ');
    }

    /// A number: mostly ordinary, now and then at the edges of what numbers are.
    fn number(&mut self) -> String {
        match self.below(60) {
            0 => "0".to_owned(),
            1 => "-1".to_owned(),
            2 => self
                .pick(&["1e300", "1e-300", "1e308*10", "0/0", "1/0", "2^64", "0.0"])
                .to_owned(),
            3 => "pi".to_owned(),
            _ => format!("{:.2}", self.random.uniform(0.05, 3.0)),
        }
    }

    /// A unit for a role: the right one, one of the same kind, or any.
    fn unit(&mut self, right: &str) -> String {
        match self.below(80) {
            0 => self
                .pick(&[
                    "kg",
                    "m",
                    "rad",
                    "s",
                    "N*m",
                    "furlong",
                    "1",
                    "kg*m^2/s^2",
                    "m/(s*A)",
                    "deg",
                    "mm^-1",
                ])
                .to_owned(),
            1 => format!("{right}*rad/rad"),
            2 => format!("1*{right}").replace("1*", ""),
            _ => right.to_owned(),
        }
    }

    fn robot(&mut self) {
        if self.chance(0.2) {
            self.say("/// Docs.\n");
        }
        let vis = self.pick(&["", "pub", "pub(crate)"]);
        self.say(vis);
        self.say("robot R {");
        if self.chance(0.15) {
            self.system();
        } else {
            self.chain();
        }
        self.forces();
        if self.chance(0.3) {
            self.variant();
        }
        if self.chance(0.9) {
            self.emit();
        }
        if self.chance(0.1) {
            let n = self.below(30);
            self.say(&format!("expect rank {n};"));
        }
        if self.chance(0.1) {
            let n = self.pick(&["0", "100", "1_000", "1000000"]);
            self.say(&format!("limit ops {n};"));
        }
        self.say("}");
    }

    fn emit(&mut self) {
        let parts = self.pick(&[
            "dynamics",
            "dynamics",
            "dynamics, first_derivatives",
            "second_derivatives",
            "dynamics, regressor",
            "base_parameters",
            "",
        ]);
        self.say(&format!("emit {{ {parts} }}"));
    }

    fn range(&mut self) -> String {
        let (a, b) = (self.number(), self.number());
        match self.below(24) {
            0 => format!("in {a}.."),
            1 => format!("in ..={b}"),
            2 => format!("in {a}..={b}"),
            3 => String::new(),
            _ => "in 0.01..=10.0".to_owned(),
        }
    }

    fn param(&mut self, name: &str, unit: &str) {
        let unit = self.unit(unit);
        let value = match self.chance(0.9) {
            true => format!("= {}", self.number()),
            false => String::new(),
        };
        let range = self.range();
        let fixed = if self.chance(0.1) { "fixed" } else { "" };
        self.say(&format!("{name}: {unit} {value} {range} {fixed};"));
    }

    /// Bodies on joints: a tree, with a slip now and then.
    fn chain(&mut self) {
        self.say("gravity: [0, 0, -9.81] m/s^2;");
        let links = 1 + self.below(3);
        self.say("params {");
        for k in 0..links {
            for (name, unit) in [("m", "kg"), ("s", "m"), ("i", "kg*m^2")] {
                if self.chance(0.97) {
                    self.param(&format!("{name}{k}"), unit);
                }
            }
        }
        self.say("}");
        for k in 0..links {
            self.link(k);
        }
        for k in 0..links {
            self.joint(k);
        }
    }

    fn entry(&mut self, name: &str, k: usize, unit: &str) -> String {
        match self.below(24) {
            0 => "_".to_owned(),
            1..=4 => format!("{:.2} {}", self.random.uniform(0.05, 3.0), self.unit(unit)),
            5..=8 => format!(
                "({name}{k} + {:.2} {unit})/2",
                self.random.uniform(0.05, 3.0)
            ),
            9 => format!("-{name}{k}"),
            _ => format!("{name}{k}"),
        }
    }

    fn link(&mut self, k: usize) {
        self.say(&format!("link l{k} {{"));
        match self.below(6) {
            0 => {
                let about = self.pick(&["", "at com", "at origin"]);
                self.say(&format!("inertial: free {about}; mass: 1 kg; com: [0, 0, 0.1] m; inertia at com: diag(0.01, 0.01, 0.01) kg*m^2;"));
            }
            1 => {
                let amount = self.pick(&[
                    "mass: 1 kg;",
                    "density: 2700 kg/m^3;",
                    "mass: m0;",
                    "mass: 2 kg;",
                    "density: m0/(1 m^3);",
                    "",
                ]);
                let shape = self.pick(&[
                    "solid cylinder { @ radius: 30 mm; length: 0.2 m; axis: z; }",
                    "hollow cylinder { @ outer: 30 mm; inner: 20 mm; length: 0.2 m; axis: y; }",
                    "solid box { @ size: [0.1, 0.2, 0.3] m; }",
                    "solid sphere { @ radius: s0; }",
                ]);
                self.say(&format!("inertial: {}", shape.replace('@', amount)));
            }
            _ => {
                let m = self.entry("m", k, "kg");
                let (x, y, z) = (
                    self.entry("s", k, "m"),
                    self.entry("s", k, "m"),
                    self.entry("s", k, "m"),
                );
                let i = self.entry("i", k, "kg*m^2");
                self.say(&format!(
                    "mass: {m}; com: [{x}, {y}, {z}]; inertia at com: diag({i}, {i}, {i});"
                ));
            }
        }
        self.say("}");
    }

    fn vector(&mut self, unit: &str) -> String {
        let (x, y, z) = (self.number(), self.number(), self.number());
        format!("[{x}, {y}, {z}] {}", self.unit(unit))
    }

    fn joint(&mut self, k: usize) {
        let parent = match (k, self.below(30)) {
            (_, 0) => self.pick(&["l0", "l1", "l2", "base", "lx"]).to_owned(),
            (0, _) => "base".to_owned(),
            (_, r) if r < 6 => format!("l{}", self.below(k)),
            _ => format!("l{}", k - 1),
        };
        let motion = self.pick(&[
            "revolute about y",
            "revolute about z",
            "revolute about [1, 2, 3]",
            "prismatic along x",
            "prismatic along z",
            "fixed",
        ]);
        let at = match self.below(3) {
            0 => format!("at {}", self.vector("m")),
            _ => String::new(),
        };
        let rpy = match self.below(4) {
            0 => format!("rpy {}", self.vector("rad")),
            _ => String::new(),
        };
        let follows = match (self.joints.last().cloned(), self.below(8)) {
            (Some(joint), 0) if motion != "fixed" => format!("follows -2*{joint} + 0.1 rad;"),
            _ => String::new(),
        };
        let limits = if self.chance(0.2) {
            "limits: -1..=1 rad;"
        } else {
            ""
        };
        self.say(&format!(
            "joint j{k}: {motion} {{ {parent} -> l{k} {at} {rpy}; {limits} {follows} }}"
        ));
        if motion != "fixed" && follows.is_empty() {
            self.joints.push(format!("j{k}"));
            self.lengths.push(motion.starts_with("prismatic"));
        }
    }

    /// Coordinates with a Lagrangian.
    fn system(&mut self) {
        self.say("params { m: kg = 1 in 0.1..=5; l: m = 0.5 in 0.1..=2; k: N/m = 3 in 0..=9; }");
        self.say("coordinates x: m, th: rad;");
        let kinetic = self.pick(&[
            "0.5*m*v.x^2 + 0.5*m*l^2*v.th^2",
            "0.5*m*(v.x^2 + 2*l*v.x*v.th*cos(th) + l^2*v.th^2)",
            "0.5*m*v.x^2",
            "m*l^2*v.th^2*exp(x/l) + m*v.x^2",
        ]);
        let angle = self.expression(3, "th");
        self.say(&format!(
            "lagrangian = {kinetic} - 0.5*k*x^2 - m*9.81 m/s^2*l*cos({angle});"
        ));
        self.joints.extend(["x".to_owned(), "th".to_owned()]);
        self.lengths.extend([true, false]);
    }

    /// An expression without unit in a variable.
    fn expression(&mut self, depth: usize, x: &str) -> String {
        if depth == 0 {
            return match self.chance(0.6) {
                true => x.to_owned(),
                false => self.number(),
            };
        }
        let a = self.expression(depth - 1, x);
        match self.below(12) {
            0 => format!("({a})^{}", self.pick(&["2", "3", "-1", "0", "64", "65"])),
            1 => format!("-{a}"),
            2 | 3 => {
                let f = self.pick(&[
                    "sin", "cos", "tan", "tanh", "atan", "exp", "ln", "sqrt", "abs", "sign", "max",
                ]);
                format!("{f}({a})")
            }
            4 | 5 => {
                let b = self.expression(depth - 1, x);
                let op = self.pick(&["+", "-", "*", "/"]);
                format!("({a} {op} {b})")
            }
            _ => a,
        }
    }

    fn forces(&mut self) {
        if self.joints.is_empty() {
            return;
        }
        let k = self.below(self.joints.len());
        let (joint, length) = (self.joints[k].clone(), self.lengths[k]);
        let (force, per_velocity, scale) = match length {
            true => ("N", "N*s/m", "1 m/s"),
            false => ("N*m", "N*m*s/rad", "1 rad/s"),
        };
        match self.below(5) {
            0 => {
                let law = self.expression(3, &format!("(v/({scale}))"));
                self.say(&format!("force on {joint} = (1 {force})*{law};"));
            }
            1 => {
                self.say(&format!("per joint {joint} {{ input u: A;"));
                self.param("gain", &format!("{force}/A"));
                self.param("viscous", per_velocity);
                self.say("force = gain*u - viscous*v; }");
            }
            2 => {
                let drive = self.pick(&[
                    "torque;",
                    "current { gain: 0.3 N*m/A; }",
                    "voltage { gain: 0.3 N*m/A; resistance: 2 Ohm; rotor: 1e-4 kg*m^2; }",
                    "current;",
                ]);
                self.say(&format!("per joint {joint} {{ drive: {drive} }}"));
            }
            3 => {
                let all = self.joints.join(" + ");
                self.say(&format!("motor mm: {all} {{"));
                self.param("dry", force);
                self.say(&format!("force = -dry*tanh(v/({scale})); }}"));
            }
            _ => {
                let angle = self.expression(
                    2,
                    &format!("(q.{joint}/({}))", if length { "1 m" } else { "1 rad" }),
                );
                self.say(&format!("potential += (2 J)*{angle};"));
            }
        }
    }

    fn variant(&mut self) {
        self.say("variant V {");
        let locks = 1 + self.below(2);
        for _ in 0..locks {
            if let Some(k) = self.joints.len().checked_sub(1) {
                let k = self.below(k + 1);
                let (joint, length) = (self.joints[k].clone(), self.lengths[k]);
                let value = self.random.uniform(-2.0, 2.0);
                let unit = self.unit(if length { "m" } else { "rad" });
                self.say(&format!("lock {joint} = {value:.2} {unit};"));
            }
        }
        if self.chance(0.3) {
            self.emit();
        }
        self.say("}");
    }
}

//! Robots built by hand, as the checker would hand them over.
#![allow(dead_code, reason = "each test uses some of them")]

use pid_derive::model::{
    About, Blank, Expr, Func, Inertial, Input, Joint, JointKind, Link, Param, Robot, Tensor,
};

pub(crate) fn num(x: f64) -> Expr {
    Expr::Num(x)
}

pub(crate) fn nums(x: [f64; 3]) -> [Expr; 3] {
    x.map(Expr::Num)
}

pub(crate) fn mul(x: Expr, y: Expr) -> Expr {
    Expr::Mul(Box::new(x), Box::new(y))
}

pub(crate) fn add(x: Expr, y: Expr) -> Expr {
    Expr::Add(Box::new(x), Box::new(y))
}

pub(crate) fn sub(x: Expr, y: Expr) -> Expr {
    Expr::Sub(Box::new(x), Box::new(y))
}

pub(crate) fn neg(x: Expr) -> Expr {
    Expr::Neg(Box::new(x))
}

pub(crate) fn call(f: Func, x: Expr) -> Expr {
    Expr::Call(f, Box::new(x))
}

pub(crate) fn diagonal(xx: Expr, yy: Expr, zz: Expr) -> Tensor {
    Tensor {
        xx,
        yy,
        zz,
        xy: num(0.0),
        xz: num(0.0),
        yz: num(0.0),
    }
}

/// A robot under construction.
pub(crate) struct Builder(Robot);

impl Builder {
    pub(crate) fn new(name: &str) -> Self {
        Self(Robot::new(name, nums([0.0, 0.0, -9.81])))
    }

    pub(crate) fn param(
        &mut self,
        name: &str,
        unit: &str,
        nominal: f64,
        lower: f64,
        upper: f64,
    ) -> Expr {
        self.0.params.push(Param {
            name: name.to_owned(),
            docs: vec![format!(" The parameter {name}.")],
            unit: unit.to_owned(),
            nominal,
            lower,
            upper,
            fixed: false,
        });
        Expr::Param(self.0.params.len() - 1)
    }

    pub(crate) fn input(&mut self, name: &str, unit: &str, coord: usize) -> Expr {
        self.0.inputs.push(Input {
            name: name.to_owned(),
            docs: Vec::new(),
            unit: unit.to_owned(),
            coord: Some(coord),
        });
        Expr::Input(self.0.inputs.len() - 1)
    }

    pub(crate) fn link(&mut self, name: &str, inertial: Inertial) -> usize {
        self.0.links.push(Link {
            name: name.to_owned(),
            docs: Vec::new(),
            inertial,
        });
        self.0.links.len() - 1
    }

    pub(crate) fn blank(&mut self, link: usize, entry: &str) -> Expr {
        self.0.blanks.push(Blank {
            link,
            entry: entry.to_owned(),
        });
        Expr::Blank(self.0.blanks.len() - 1)
    }

    pub(crate) fn joint(
        &mut self,
        name: &str,
        kind: JointKind,
        parent: Option<usize>,
        child: usize,
    ) -> &mut Joint {
        let coord = (kind != JointKind::Fixed).then(|| self.0.nq());
        self.0.order.push(self.0.joints.len());
        self.0.joints.push(Joint {
            name: name.to_owned(),
            docs: Vec::new(),
            kind,
            coord,
            follows: None,
            parent,
            child,
            origin: nums([0.0; 3]),
            rpy: nums([0.0; 3]),
            limits: None,
            armature: None,
            force: None,
        });
        self.0.joints.last_mut().expect("just pushed")
    }

    pub(crate) fn robot(self) -> Robot {
        self.0
    }
}

pub(crate) const X: [f64; 3] = [1.0, 0.0, 0.0];
pub(crate) const Y: [f64; 3] = [0.0, 1.0, 0.0];
pub(crate) const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// The paper's two-link robot (K. Schäfer et al., Section V-A), 19 parameters in the order
/// m1 m2 sx1 sy1 sx2 sy2 sz2 iz1 ix2 iy2 iz2, then dry, viscous, gain, sharp by joint.
pub(crate) fn two_link() -> Robot {
    let mut b = Builder::new("TwoLink");
    let m1 = b.param("m1", "kg", 6.0, 0.5, 30.0);
    let m2 = b.param("m2", "kg", 23.0, 1.0, 60.0);
    let [sx1, sy1, sx2, sy2] =
        ["sx1", "sy1", "sx2", "sy2"].map(|name| b.param(name, "m", 0.0, -0.2, 0.2));
    let sz2 = b.param("sz2", "m", 0.2875, 0.0, 0.6);
    let iz1 = b.param("iz1", "kg*m^2", 0.03, 1e-3, 1.0);
    let ix2 = b.param("ix2", "kg*m^2", 0.6912, 1e-3, 5.0);
    let iy2 = b.param("iy2", "kg*m^2", 0.6912, 1e-3, 5.0);
    let iz2 = b.param("iz2", "kg*m^2", 0.115, 1e-3, 5.0);
    let pair = |b: &mut Builder, name: &str, unit: &str, nominal: [f64; 2], upper: f64| {
        [("shoulder", nominal[0]), ("elbow", nominal[1])]
            .map(|(joint, x)| b.param(&format!("{name}_{joint}"), unit, x, 0.0, upper))
    };
    let dry = pair(&mut b, "dry", "N*m", [1.0, 2.0], 20.0);
    let viscous = pair(&mut b, "viscous", "N*m*s/rad", [8.0, 3.0], 30.0);
    let gain = pair(&mut b, "gain", "N*m/A", [0.7, 0.4], 5.0);
    let sharp = pair(&mut b, "sharp", "s/rad", [50.0, 50.0], 200.0);
    let current = [
        b.input("current_shoulder", "A", 0),
        b.input("current_elbow", "A", 1),
    ];

    let (sz1, ix1, iy1) = (b.blank(0, "com z"), b.blank(0, "Ixx"), b.blank(0, "Iyy"));
    let upper = b.link(
        "upper",
        Inertial::Body {
            mass: m1,
            com: [sx1, sy1, sz1],
            inertia: diagonal(ix1, iy1, iz1),
            about: About::Com,
        },
    );
    let fore = b.link(
        "fore",
        Inertial::Body {
            mass: m2,
            com: [sx2, sy2, sz2],
            inertia: diagonal(ix2, iy2, iz2),
            about: About::Com,
        },
    );
    b.joint("shoulder", JointKind::Revolute(Z), None, upper);
    b.joint("elbow", JointKind::Revolute(Y), Some(upper), fore);
    let mut robot = b.robot();
    let laws = dry
        .into_iter()
        .zip(viscous)
        .zip(gain)
        .zip(sharp)
        .zip(current);
    for (k, ((((dry, viscous), gain), sharp), current)) in laws.enumerate() {
        let v = Expr::Velocity(k);
        let friction = add(
            mul(dry, call(Func::Tanh, mul(sharp, v.clone()))),
            mul(viscous, v),
        );
        robot.joints[k].force = Some(sub(mul(gain, current), friction));
    }
    robot
}

/// A carriage on a slanted rail: m a + m g sin(0.3) = u − f v.
pub(crate) fn carriage() -> Robot {
    let mut b = Builder::new("Carriage");
    let m = b.param("mass", "kg", 95.0, 10.0, 200.0);
    let f = b.param("viscous", "N*s/m", 200.0, 0.0, 400.0);
    let u = b.input("force", "N", 0);
    let body = b.link(
        "body",
        Inertial::Body {
            mass: m,
            com: nums([0.1, 0.2, 0.3]),
            inertia: diagonal(num(0.0), num(0.0), num(0.0)),
            about: About::Com,
        },
    );
    let joint = b.joint("rail", JointKind::Prismatic(X), None, body);
    // Pitched by −0.3, the x axis points 0.3 rad upwards.
    joint.rpy = nums([0.0, -0.3, 0.0]);
    joint.force = Some(sub(u, mul(f, Expr::Velocity(0))));
    b.robot()
}

/// A link with the ten standard parameters `name_m … name_iyz`.
fn free(b: &mut Builder, name: &str, scale: f64) -> Inertial {
    let mut next = |entry: &str, unit: &str, nominal: f64, spread: f64| {
        b.param(
            &format!("{name}_{entry}"),
            unit,
            nominal,
            nominal - spread,
            nominal + spread,
        )
    };
    let mass = next("m", "kg", 5.0 * scale, 2.0 * scale);
    let first_moment =
        ["mx", "my", "mz"].map(|entry| next(entry, "kg*m", 0.1 * scale, 0.5 * scale));
    let [xx, yy, zz] =
        ["ixx", "iyy", "izz"].map(|entry| next(entry, "kg*m^2", 0.8 * scale, 0.2 * scale));
    let [xy, xz, yz] =
        ["ixy", "ixz", "iyz"].map(|entry| next(entry, "kg*m^2", 0.02 * scale, 0.05 * scale));
    Inertial::Linear {
        mass,
        first_moment,
        inertia: Tensor {
            xx,
            yy,
            zz,
            xy,
            xz,
            yz,
        },
    }
}

/// A serial arm with general inertia, rotor inertia, friction and drive gain at every joint, and a
/// fixed tool flange. Axes alternate z, y, y, z, y, z, y; offsets are those of a common industrial
/// arm.
pub(crate) fn arm(n: usize) -> Robot {
    let axes = [Z, Y, Y, Z, Y, Z, Y];
    let origins = [
        [0.0, 0.0, 0.345],
        [0.02, 0.0, 0.0],
        [0.0, 0.0, 0.25],
        [0.01, 0.0, 0.255],
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 0.07],
        [0.0, 0.01, 0.05],
    ];
    let mut b = Builder::new(&format!("Arm{n}"));
    let mut parent = None;
    for k in 0..n {
        let inertial = free(&mut b, &format!("l{}", k + 1), 1.0 / (k + 1) as f64);
        let link = b.link(&format!("l{}", k + 1), inertial);
        let dry = b.param(&format!("dry_j{}", k + 1), "N*m", 1.0, 0.0, 5.0);
        let viscous = b.param(&format!("viscous_j{}", k + 1), "N*m*s/rad", 2.0, 0.0, 5.0);
        let gain = b.param(&format!("gain_j{}", k + 1), "N*m/A", 1.0, 0.5, 5.0);
        let rotor = b.param(&format!("rotor_j{}", k + 1), "kg*m^2", 0.1, 0.0, 0.5);
        let u = b.input(&format!("current_j{}", k + 1), "A", k);
        let joint = b.joint(
            &format!("j{}", k + 1),
            JointKind::Revolute(axes[k]),
            parent,
            link,
        );
        joint.origin = nums(origins[k]);
        joint.armature = Some(rotor);
        let v = Expr::Velocity(k);
        let friction = add(
            mul(dry, call(Func::Tanh, mul(num(50.0), v.clone()))),
            mul(viscous, v),
        );
        joint.force = Some(sub(mul(gain, u), friction));
        parent = Some(link);
    }
    let tool = b.link(
        "tool",
        Inertial::Body {
            mass: num(1.2),
            com: nums([0.0, 0.01, 0.05]),
            inertia: diagonal(num(0.002), num(0.003), num(0.001)),
            about: About::Com,
        },
    );
    let flange = b.joint("flange", JointKind::Fixed, parent, tool);
    flange.origin = nums([0.0, 0.0, 0.03]);
    flange.rpy = nums([0.0, 0.0, std::f64::consts::FRAC_PI_2]);
    b.robot()
}

/// A branching tree with slanted axes, a prismatic joint, a rotated base and geometry that is a parameter.
pub(crate) fn tree() -> Robot {
    let mut b = Builder::new("Tree");
    let reach = b.param("reach", "m", 0.4, 0.2, 0.6);
    let stem_inertial = free(&mut b, "stem", 1.0);
    let stem = b.link("stem", stem_inertial);
    let left_inertial = free(&mut b, "left", 0.5);
    let left = b.link("left", left_inertial);
    let right_inertial = free(&mut b, "right", 0.4);
    let right = b.link("right", right_inertial);
    let mut tip = |name: &str| {
        b.link(
            name,
            Inertial::Body {
                mass: num(0.7),
                com: nums([0.02, -0.03, 0.1]),
                inertia: Tensor {
                    xx: num(0.02),
                    yy: num(0.03),
                    zz: num(0.025),
                    xy: num(0.001),
                    xz: num(0.002),
                    yz: num(-0.003),
                },
                about: About::Origin,
            },
        )
    };
    let (slider, clamp) = (tip("slider"), tip("clamp"));
    let slanted = [0.48, 0.6, 0.64];
    b.joint("yaw", JointKind::Revolute(slanted), None, stem).rpy = nums([0.3, -0.7, 1.1]);
    let joint = b.joint("left", JointKind::Revolute(X), Some(stem), left);
    joint.origin = [num(0.1), reach.clone(), num(0.2)];
    joint.rpy = nums([0.2, 0.4, -0.5]);
    let joint = b.joint(
        "right",
        JointKind::Revolute([0.0, -0.6, 0.8]),
        Some(stem),
        right,
    );
    joint.origin = [neg(reach), num(0.0), num(0.1)];
    let joint = b.joint("slide", JointKind::Prismatic(slanted), Some(left), slider);
    joint.origin = nums([0.0, 0.1, 0.3]);
    joint.rpy = nums([1.0, 0.1, 0.2]);
    let joint = b.joint("clamped", JointKind::Fixed, Some(right), clamp);
    joint.origin = nums([0.1, 0.2, 0.3]);
    joint.rpy = nums([-0.4, 0.8, 0.6]);
    b.robot()
}

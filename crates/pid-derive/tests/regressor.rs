//! Regressor and base parameters against the residual itself and counts from the literature.

mod robots;

use pid_derive::model::{Inertial, JointKind, Robot, Tensor};
use pid_derive::regressor::NotLinear;
use pid_derive::{BaseParameters, Equations, Regressor, base_parameters, dense, regressor, sample};
use pid_symbolic::random::Random;
use pid_symbolic::{Graph, Tape};
use robots::{Builder, Y, Z, nums};

struct Derived {
    g: Graph,
    robot: Robot,
    equations: Equations,
    regressor: Regressor,
    base: BaseParameters,
}

fn derive(robot: Robot) -> Derived {
    let mut g = Graph::new();
    let equations = pid_derive::equations(&mut g, &robot).unwrap();
    let regressor = regressor(&mut g, &equations).unwrap();
    let base = base_parameters(&mut g, &robot, &equations, &regressor);
    Derived {
        g,
        robot,
        equations,
        regressor,
        base,
    }
}

impl Derived {
    fn eval(&self, outputs: &[pid_symbolic::Id], z: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; outputs.len()];
        Tape::new(&self.g, outputs).eval(z, &mut out);
        out
    }

    fn name(&self, column: usize) -> String {
        self.robot.params[self.regressor.params[column]]
            .name
            .clone()
    }

    fn formulas(&self) -> Vec<String> {
        (0..self.base.terms.len())
            .map(|k| self.base.formula(k, |column| self.name(column)))
            .collect()
    }

    /// Dense Y at a point.
    fn y(&self, z: &[f64]) -> dense::Matrix {
        let values: Vec<_> = self.regressor.entries.iter().map(|e| e.value).collect();
        let values = self.eval(&values, z);
        let mut y =
            dense::Matrix::zeros(self.equations.residual.len(), self.regressor.params.len());
        for (entry, value) in self.regressor.entries.iter().zip(values) {
            y[(entry.row, entry.col)] = value;
        }
        y
    }

    fn first_param(&self) -> usize {
        3 * self.robot.nq() + self.robot.inputs.len()
    }

    /// p_L of a point.
    fn p(&self, z: &[f64]) -> Vec<f64> {
        self.regressor
            .params
            .iter()
            .map(|&k| z[self.first_param() + k])
            .collect()
    }

    /// β of parameters by column.
    fn beta(&self, p: &[f64]) -> Vec<f64> {
        let of = |terms: &Vec<pid_derive::base_parameters::Term>| {
            terms.iter().map(|t| t.coefficient * p[t.column]).sum()
        };
        self.base.terms.iter().map(of).collect()
    }
}

fn close(x: &[f64], y: &[f64], tolerance: f64) {
    let scale = x.iter().chain(y).fold(1e-300_f64, |s, x| s.max(x.abs()));
    for (x, y) in x.iter().zip(y) {
        assert!((x - y).abs() <= tolerance * scale, "{x} and {y} of {scale}");
    }
}

/// r = Y p + r₀, with Y at other values of p_L; r at u = 0 from the constant columns alone; r from
/// base parameters.
fn check(d: &Derived, points: usize) {
    let (nq, mut random) = (d.robot.nq(), Random::new(11));
    for _ in 0..points {
        let z = sample::point(&d.robot, &mut random);
        let r = d.eval(&d.equations.residual, &z);
        let mut elsewhere = z.clone();
        for &k in &d.regressor.params {
            elsewhere[d.first_param() + k] = random.uniform(-3.0, 3.0);
        }
        let (y, offset, p) = (
            d.y(&elsewhere),
            d.eval(&d.regressor.offset, &elsewhere),
            d.p(&z),
        );
        let product = |columns: &[usize], p: &[f64]| -> Vec<f64> {
            (0..nq)
                .map(|i| {
                    columns
                        .iter()
                        .zip(p)
                        .map(|(&j, p)| y[(i, j)] * p)
                        .sum::<f64>()
                })
                .collect()
        };
        let plus =
            |x: Vec<f64>, y: &[f64]| -> Vec<f64> { x.iter().zip(y).map(|(x, y)| x + y).collect() };
        let all: Vec<usize> = (0..p.len()).collect();
        close(&plus(product(&all, &p), &offset), &r, 1e-12);
        // Through the base parameters, of which the proof is that p enters nowhere else.
        close(
            &plus(product(&d.base.independent, &d.beta(&p)), &offset),
            &r,
            1e-10,
        );

        let mut idle = z.clone();
        idle[3 * nq..d.first_param()].fill(0.0);
        let r = d.eval(&d.equations.residual, &idle);
        let count = d.regressor.constant;
        let offset = d.eval(&d.regressor.constant_offset, &z);
        close(
            &plus(product(&all[..count], &p[..count]), &offset),
            &r,
            1e-12,
        );
        let count = d.base.constant;
        close(
            &plus(
                product(&d.base.independent[..count], &d.beta(&p)[..count]),
                &offset,
            ),
            &r,
            1e-10,
        );
    }
}

#[test]
fn the_residual_is_its_regressor_times_the_parameters() {
    for robot in [
        robots::carriage(),
        robots::arm(2),
        robots::arm(3),
        robots::arm(6),
        robots::arm(7),
    ] {
        let d = derive(robot);
        assert_eq!(d.regressor.params.len(), d.robot.params.len());
        check(&d, 6);
        assert!(
            d.base.gap.0 > 1e-5 && d.base.gap.1 < 1e-11,
            "{:?}",
            d.base.gap
        );
    }
}

#[test]
fn the_sharpness_of_friction_is_left_out() {
    let mut robot = robots::arm(2);
    robot.params.push(pid_derive::model::Param {
        name: "sharp".into(),
        ..robot.params[0].clone()
    });
    let sharp = pid_derive::model::Expr::Param(robot.params.len() - 1);
    let dry = robots::mul(
        pid_derive::model::Expr::Param(10),
        robots::call(
            pid_derive::model::Func::Tanh,
            robots::mul(sharp, pid_derive::model::Expr::Velocity(0)),
        ),
    );
    robot.joints[0].force = Some(robots::neg(dry));
    let d = derive(robot);
    let last = d.robot.params.len() - 1;
    assert!(!d.regressor.params.contains(&last));
    // The coefficient of dry friction is linear, but its column depends on the sharpness; gain's on
    // the current.
    let column = d.regressor.params.iter().position(|&k| k == 10).unwrap();
    assert!(column >= d.regressor.constant);
    check(&d, 6);
}

#[test]
fn the_papers_robot_is_not_linear() {
    let robot = robots::two_link();
    let mut g = Graph::new();
    let equations = pid_derive::equations(&mut g, &robot).unwrap();
    // m1 sx1².
    assert_eq!(
        regressor(&mut g, &equations),
        Err(NotLinear {
            first: 0,
            second: 2
        })
    );
}

/// Without drives: rigid-body parameters only.
fn rigid(mut robot: Robot) -> Robot {
    for joint in &mut robot.joints {
        joint.armature = None;
        joint.force = None;
    }
    robot
}

/// A serial chain of free links with the given axes and origins.
fn chain(joints: &[(JointKind, [f64; 3], [f64; 3])]) -> Robot {
    let mut b = Builder::new("Chain");
    let mut parent = None;
    for (k, (kind, origin, rpy)) in joints.iter().enumerate() {
        let mut next = |entry: &str| b.param(&format!("l{}_{entry}", k + 1), "1", 1.0, 0.5, 1.5);
        let mass = next("m");
        let first_moment = ["mx", "my", "mz"].map(&mut next);
        let [xx, yy, zz] = ["ixx", "iyy", "izz"].map(&mut next);
        let [xy, xz, yz] = ["ixy", "ixz", "iyz"].map(&mut next);
        let inertia = Tensor {
            xx,
            yy,
            zz,
            xy,
            xz,
            yz,
        };
        let link = b.link(
            &format!("l{}", k + 1),
            Inertial::Linear {
                mass,
                first_moment,
                inertia,
            },
        );
        let joint = b.joint(&format!("j{}", k + 1), *kind, parent, link);
        joint.origin = nums(*origin);
        joint.rpy = nums(*rpy);
        parent = Some(link);
    }
    b.robot()
}

#[test]
fn planar_two_link_has_six_and_reads_as_in_the_textbook() {
    // Both axes horizontal and parallel, link length 0.4 along x.
    let d = derive(chain(&[
        (JointKind::Revolute(Y), [0.0; 3], [0.0; 3]),
        (JointKind::Revolute(Y), [0.4, 0.0, 0.0], [0.0; 3]),
    ]));
    assert_eq!(
        d.formulas(),
        [
            "l1_mx + 0.4*l2_m",
            "l1_mz",
            "l1_iyy + 0.4^2*l2_m",
            "l2_mx",
            "l2_mz",
            "l2_iyy",
        ]
    );
    check(&d, 5);
}

#[test]
fn six_revolute_joints_with_a_spherical_wrist_have_the_36_of_the_puma() {
    // Modified Denavit-Hartenberg parameters of the PUMA 560 (B. Armstrong, O. Khatib, J. Burdick,
    // 1986): 36 base inertial parameters (M. Gautier, W. Khalil, 1990) with a vertical first axis.
    use std::f64::consts::FRAC_PI_2 as H;
    let r = |a: f64, d: f64, alpha: f64| {
        (
            JointKind::Revolute(Z),
            [a, -d * alpha.sin(), d * alpha.cos()],
            [alpha, 0.0, 0.0],
        )
    };
    let d = derive(chain(&[
        r(0.0, 0.0, 0.0),
        r(0.0, 0.2435, -H),
        r(0.4318, -0.0934, 0.0),
        r(-0.0203, 0.4331, H),
        r(0.0, 0.0, -H),
        r(0.0, 0.0, H),
    ]));
    assert_eq!(d.base.independent.len(), 36, "{:#?}", d.formulas());
    check(&d, 5);
}

#[test]
fn rank_of_fresh_samples_is_the_number_of_base_parameters() {
    for robot in [rigid(robots::arm(6)), rigid(robots::arm(7))] {
        let d = derive(robot);
        let mut random = Random::new(77);
        let nb = d.base.independent.len();
        let nq = d.robot.nq();
        let motions = 2 * nb;
        let mut stacked = dense::Matrix::zeros(motions * nq, d.regressor.params.len());
        for motion in 0..motions {
            let y = d.y(&sample::point(&d.robot, &mut random));
            for i in 0..nq {
                for j in 0..y.cols() {
                    stacked[(motion * nq + i, j)] = y[(i, j)];
                }
            }
        }
        let all = dense::rank(&stacked);
        assert_eq!(all.rank, nb);
        assert_eq!(dense::rank(&stacked.select(&d.base.independent)).rank, nb);
    }
}

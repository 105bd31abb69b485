//! Models of robots that are known only at run time.
//!
//! A robot declared with `robot!` becomes Rust code; one that is read from a file becomes a
//! [`Model`]: the same derivation and the same exact derivatives (`pid-derive`), evaluated by
//! programs on the expression graph ([`pid_symbolic::program`]). Both have the same faces,
//! [`Hessian`](pid_runtime::dynamics::Hessian) and
//! [`GenericDynamics`](pid_runtime::generic::GenericDynamics), so everything that takes a model
//! takes either.
//!
//! - [`model`]: the model;
//! - [`links`]: mass matrix and bias over any number, with constants that can be changed;
//! - [`kinematics`]: positions of points of a declared robot;
//! - [`nominal`]: a robot's nominal description with tolerances and noise, from a file;
//! - [`check`]: conditions on a robot that a program puts together.
//!
//! # Example
//! A pendulum, its rod 0.5 m long:
//! ```
//! use pid_derive::model::{Expr, Inertial, Joint, JointKind, Link, Param, Robot, Tensor};
//! use pid_interpret::Model;
//! use pid_runtime::dynamics::{At, Dynamics};
//!
//! let zero = || [0.0; 3].map(Expr::Num);
//! let mass = Param {
//!     name: "m".into(), docs: vec![], unit: "kg".into(), nominal: 2.0, lower: 0.1, upper: 5.0, fixed: false,
//! };
//! let rod = Inertial::Linear {
//!     mass: Expr::Param(0),
//!     first_moment: [Expr::Num(0.0), Expr::Num(0.0), Expr::Mul(Box::new(Expr::Num(-0.5)), Box::new(Expr::Param(0)))],
//!     inertia: Tensor { yy: Expr::Mul(Box::new(Expr::Num(0.25)), Box::new(Expr::Param(0))), ..Tensor::default() },
//! };
//! let pivot = Joint {
//!     name: "pivot".into(), docs: vec![], kind: JointKind::Revolute([0.0, 1.0, 0.0]), coord: Some(0), parent: None,
//!     child: 0, origin: zero(), rpy: zero(), follows: None, limits: None, armature: None, force: None,
//! };
//! let model = Model::new(&Robot {
//!     params: vec![mass],
//!     links: vec![Link { name: "rod".into(), docs: vec![], inertial: rod }],
//!     joints: vec![pivot],
//!     order: vec![0],
//!     ..Robot::new("Pendulum", [0.0, 0.0, -9.81].map(Expr::Num))
//! })?;
//! // r = m l² a + m g l sin q.
//! let mut r = [0.0];
//! model.residual(&At { q: &[0.3], v: &[0.0], a: &[1.5], u: &[], p: &[2.0] }, &mut r);
//! assert!((r[0] - 2.0 * (0.25 * 1.5 + 9.81 * 0.5 * 0.3_f64.sin())).abs() < 1e-14);
//! # Ok::<(), pid_interpret::Error>(())
//! ```

pub mod check;
mod error;
mod function;
pub mod kinematics;
pub mod links;
pub mod model;
pub mod nominal;

pub use error::Error;
pub use kinematics::Kinematics;
pub use links::Links;
pub use model::Model;

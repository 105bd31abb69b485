//! The resolved robot: a `robot!` declaration after every name, unit and value has been checked.
//!
//! Nothing here carries spans or tokens; the checker of `pid-codegen` and the reader of URDF make
//! it, this crate reads it. All values are in SI units (radians, metres, kilograms, seconds,
//! amperes).
//!
//! With the feature `serde` a robot can be written and read by `serde`: the compiled robot carries
//! its declaration, and tools that work at run time read it from there. The form belongs to one
//! version of this crate and is not a file format.

#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// A declared robot, ready to be derived.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Robot {
    /// Name of the generated type (`TwoLink`).
    pub name: String,
    /// The user's `///` lines on the robot.
    pub docs: Vec<String>,
    /// Gravity in the base frame, m/s².
    pub gravity: [Expr; 3],
    /// All parameters in order: first the `params` block, then the `per joint` ones, parameter by
    /// parameter in joint order.
    pub params: Vec<Param>,
    /// All inputs, input by input in joint order.
    pub inputs: Vec<Input>,
    /// Links in declaration order; `base` is not among them.
    pub links: Vec<Link>,
    /// Joints in declaration order, fixed ones included.
    pub joints: Vec<Joint>,
    /// Indices into `joints` so that every joint comes after the joint that carries its parent link.
    pub order: Vec<usize>,
    /// Drives that move several joints at once.
    pub motors: Vec<Motor>,
    /// Potential energy U_e(q, p) beside that of gravity, J.
    pub potential: Option<Expr>,
    /// A Lagrangian L(q, v, p) in place of links, J; all joints are then of the kinds
    /// [`JointKind::Angle`] and [`JointKind::Length`], and `order` is empty.
    pub lagrangian: Option<Expr>,
    /// Number of entries written `_`; [`Expr::Blank`] refers to them.
    pub blanks: Vec<Blank>,
    /// The parts that the user asks for.
    pub emit: Emit,
}

impl Robot {
    /// A robot without parts; its derivatives of first and second order are asked for.
    pub fn new(name: impl Into<String>, gravity: [Expr; 3]) -> Self {
        Self {
            name: name.into(),
            docs: Vec::new(),
            gravity,
            params: Vec::new(),
            inputs: Vec::new(),
            links: Vec::new(),
            joints: Vec::new(),
            order: Vec::new(),
            motors: Vec::new(),
            potential: None,
            lagrangian: None,
            blanks: Vec::new(),
            emit: Emit {
                first_derivatives: true,
                second_derivatives: true,
                ..Emit::default()
            },
        }
    }

    /// Number of coordinates: of joints that move on their own.
    pub fn nq(&self) -> usize {
        self.joints.iter().filter(|j| j.coord.is_some()).count()
    }
}

/// A parameter: unknown of the identification, argument of every generated function.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Param {
    /// Name as generated: `m1`, `dry_shoulder`.
    pub name: String,
    /// The user's `///` lines.
    pub docs: Vec<String>,
    /// Unit as printed, ASCII: `kg*m^2`.
    pub unit: String,
    /// Nominal value; the middle of the range if the user gave none.
    pub nominal: f64,
    /// Lower end of the range, `-inf` if none.
    #[cfg_attr(feature = "serde", serde(with = "open::below"))]
    pub lower: f64,
    /// Upper end of the range, `+inf` if none.
    #[cfg_attr(feature = "serde", serde(with = "open::above"))]
    pub upper: f64,
    /// Marked `fixed`: an argument like the others, but held at its nominal value by the identification.
    pub fixed: bool,
}

/// An input of the drives.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Input {
    /// Name as generated: `current_shoulder`.
    pub name: String,
    /// The user's `///` lines.
    pub docs: Vec<String>,
    /// Unit as printed.
    pub unit: String,
    /// Coordinate index of the joint it belongs to, for inputs declared `per joint`.
    pub coord: Option<usize>,
}

/// A rigid body.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Link {
    /// Name as declared.
    pub name: String,
    /// The user's `///` lines.
    pub docs: Vec<String>,
    /// Mass distribution.
    pub inertial: Inertial,
}

/// Mass distribution of a link, in its own frame.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub enum Inertial {
    /// A massless link.
    None,
    /// Mass, centre of mass and inertia tensor.
    Body {
        /// Mass, kg.
        mass: Expr,
        /// Centre of mass, m.
        com: [Expr; 3],
        /// Inertia tensor, kg·m².
        inertia: Tensor,
        /// Point the tensor refers to.
        about: About,
    },
    /// The ten standard parameters, in which the torques are linear: mass, first moment `m·c`,
    /// inertia about the link origin.
    Linear {
        /// Mass, kg.
        mass: Expr,
        /// First moment, kg·m.
        first_moment: [Expr; 3],
        /// Inertia tensor about the link origin, kg·m².
        inertia: Tensor,
    },
}

/// A symmetric 3×3 tensor in the axes of the link frame.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Tensor {
    /// Ixx.
    pub xx: Expr,
    /// Iyy.
    pub yy: Expr,
    /// Izz.
    pub zz: Expr,
    /// Ixy (the entry of the matrix: −∫xy dm).
    pub xy: Expr,
    /// Ixz.
    pub xz: Expr,
    /// Iyz.
    pub yz: Expr,
}

impl From<[Expr; 6]> for Tensor {
    /// Of the entries xx, yy, zz, xy, xz, yz.
    fn from([xx, yy, zz, xy, xz, yz]: [Expr; 6]) -> Self {
        Self {
            xx,
            yy,
            zz,
            xy,
            xz,
            yz,
        }
    }
}

impl Default for Tensor {
    /// The tensor of a point: zero.
    fn default() -> Self {
        let zero = || Expr::Num(0.0);
        Tensor {
            xx: zero(),
            yy: zero(),
            zz: zero(),
            xy: zero(),
            xz: zero(),
            yz: zero(),
        }
    }
}

/// Reference point of an inertia tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub enum About {
    /// The centre of mass.
    Com,
    /// The origin of the link frame.
    Origin,
}

/// A joint between a parent link (or the base) and a child link.
///
/// The joint frame is placed in the parent frame by `origin` and `rpy` (R = Rz(yaw) Ry(pitch)
/// Rx(roll), as in URDF); the child frame equals it at coordinate zero and moves about or along
/// `axis`.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Joint {
    /// Name as declared.
    pub name: String,
    /// The user's `///` lines.
    pub docs: Vec<String>,
    /// Kind of motion.
    pub kind: JointKind,
    /// Index of the coordinate of a joint that moves on its own: these joints in declaration order.
    pub coord: Option<usize>,
    /// How a joint of moving kind without a coordinate moves: with other joints, or, without terms,
    /// held at a value.
    pub follows: Option<Affine>,
    /// Parent link, `None` for the base.
    pub parent: Option<usize>,
    /// Child link.
    pub child: usize,
    /// Origin of the joint frame in the parent frame, m.
    pub origin: [Expr; 3],
    /// Roll, pitch, yaw of the joint frame in the parent frame, rad.
    pub rpy: [Expr; 3],
    /// Range of the coordinate, rad or m.
    pub limits: Option<(f64, f64)>,
    /// Inertia (kg·m²) or mass (kg) of the drive as felt at the joint; adds to the diagonal of M only.
    pub armature: Option<Expr>,
    /// Generalised force on the joint (f_L of the equations), N·m or N. The laws of `per joint` and
    /// `force on` are added up.
    pub force: Option<Expr>,
}

/// `Σ ratio·q + offset`: the position of a joint or drive that moves with coordinates.
///
/// Its velocity is `Σ ratio·v`, and a force f on it is a force `ratio·f` on each of the coordinates
/// (equal power).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Affine {
    /// Coordinates with their ratios; each coordinate once.
    pub terms: Vec<(usize, Expr)>,
    /// Position at zero coordinates, rad or m.
    pub offset: Expr,
}

/// A drive that moves several joints at once, w = Σ ratio·v: a coupled wrist, a differential.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Motor {
    /// Name as declared.
    pub name: String,
    /// The user's `///` lines.
    pub docs: Vec<String>,
    /// How it moves with the coordinates.
    pub moves: Affine,
    /// Inertia (kg·m²) or mass (kg) of the drive: adds `ratioᵢ·ratioⱼ·armature` to M.
    pub armature: Option<Expr>,
    /// Force of the drive, N·m or N: adds `ratio·force` to f_L.
    pub force: Option<Expr>,
}

impl JointKind {
    /// Whether positions of the joint are lengths; angles otherwise.
    pub fn is_length(self) -> bool {
        matches!(self, Self::Prismatic(_) | Self::Length)
    }
}

/// Kind of a joint. Axes are of unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub enum JointKind {
    /// Rotation about the axis.
    Revolute([f64; 3]),
    /// Translation along the axis.
    Prismatic([f64; 3]),
    /// No motion.
    Fixed,
    /// A coordinate of a Lagrangian, an angle.
    Angle,
    /// A coordinate of a Lagrangian, a length.
    Length,
}

/// An entry written `_`: the user says that it does not enter the equations, and
/// [`facts`](mod@crate::facts) proves it.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Blank {
    /// Link the entry belongs to.
    pub link: usize,
    /// Which entry, as in the messages: `Ixx`, `com z`, `mass`.
    pub entry: String,
}

/// Parts that are generated beside the dynamics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Emit {
    /// Jacobian of the residual.
    pub first_derivatives: bool,
    /// Hessian of λᵀ·residual.
    pub second_derivatives: bool,
    /// Regressor.
    pub regressor: bool,
    /// Base parameters; they bring the regressor with them.
    pub base_parameters: bool,
    /// All of these for four nodes at once as well.
    pub lanes: bool,
}

/// An expression in parameters, inputs and coordinates. Units have been checked and angles converted.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub enum Expr {
    /// A number, SI.
    Num(f64),
    /// Parameter, index into [`Robot::params`].
    Param(usize),
    /// Input, index into [`Robot::inputs`].
    Input(usize),
    /// Coordinate q.
    Position(usize),
    /// Velocity v.
    Velocity(usize),
    /// An entry written `_`, index into [`Robot::blanks`].
    Blank(usize),
    /// Negation.
    Neg(Box<Expr>),
    /// Sum.
    Add(Box<Expr>, Box<Expr>),
    /// Difference.
    Sub(Box<Expr>, Box<Expr>),
    /// Product.
    Mul(Box<Expr>, Box<Expr>),
    /// Quotient.
    Div(Box<Expr>, Box<Expr>),
    /// Power with an integer exponent.
    Powi(Box<Expr>, i32),
    /// A function of one argument.
    Call(Func, Box<Expr>),
}

/// Functions of one argument that a force law or a geometry may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub enum Func {
    /// Sine.
    Sin,
    /// Cosine.
    Cos,
    /// Tangent.
    Tan,
    /// Hyperbolic tangent.
    Tanh,
    /// Arc tangent.
    Atan,
    /// Exponential.
    Exp,
    /// Natural logarithm.
    Ln,
    /// Square root.
    Sqrt,
    /// Absolute value; has no second derivative.
    Abs,
    /// Sign; has no second derivative.
    Sign,
}

/// Ends of ranges in formats that have no infinite numbers: an absent number is an open end.
#[cfg(feature = "serde")]
mod open {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    fn write<S: Serializer>(end: f64, to: S) -> Result<S::Ok, S::Error> {
        Some(end).filter(|x| x.is_finite()).serialize(to)
    }

    fn read<'de, D: Deserializer<'de>>(from: D, open: f64) -> Result<f64, D::Error> {
        Ok(Option::deserialize(from)?.unwrap_or(open))
    }

    /// Writing and reading of one end.
    macro_rules! end {
        ($name:ident, $open:expr) => {
            pub(super) mod $name {
                use serde::{Deserializer, Serializer};

                pub(crate) fn serialize<S: Serializer>(
                    end: &f64,
                    to: S,
                ) -> Result<S::Ok, S::Error> {
                    super::write(*end, to)
                }

                pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
                    from: D,
                ) -> Result<f64, D::Error> {
                    super::read(from, $open)
                }
            }
        };
    }
    end!(below, f64::NEG_INFINITY);
    end!(above, f64::INFINITY);
}

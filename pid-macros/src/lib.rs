//! The [`robot!`] macro: a shell around `pid_codegen::expand`.
//!
//! Use it through `simtrue::robot` or `pid_runtime::robot`. The generated code refers to
//! `::pid_runtime`; with the feature `facade` to the crate through which the user has it.

#[cfg(feature = "facade")]
mod path;

use proc_macro::TokenStream;

/// Declares a robot and generates its dynamics with exact derivatives.
///
/// # The model
///
/// A robot is a tree of rigid links on a fixed `base`. The macro derives (Euler-Lagrange)
///
/// ```text
/// r(q, v, a, u, p) = M(q, p) a + b(q, v, p) − f_L(q, v, p, u)
/// ```
///
/// with coordinates q, velocities v, accelerations a, inputs u and parameters p, and generates the
/// parts of r, its exact Jacobian and the exact Hessian of λᵀr. For a robot `TwoLink` it declares
///
/// | item | content |
/// |---|---|
/// | `TwoLink` | the model; implements `pid_runtime::dynamics::{Dynamics, Jacobian, Hessian}` |
/// | `TwoLinkParams` | a field per parameter, with nominal values and bounds |
/// | `TwoLinkParam` | a variant per parameter, with name and unit |
/// | `TwoLinkInputs` | a field per input |
/// | `TwoLinkJoint` | a variant per moving joint |
///
/// # Example
///
/// ```
/// use pid_runtime::robot;
///
/// robot! {
///     /// A pendulum with a motor.
///     pub robot Pendulum {
///         gravity: [0, 0, -9.81] m/s^2;
///
///         params {
///             /// Mass of the bob.
///             m: kg = 1.0 in 0.1..=5.0;
///             /// Length of the rod.
///             l: m  = 0.5 in 0.1..=1.0;
///         }
///
///         link rod { mass: m; com: [0, 0, -l]; }
///
///         joint pivot: revolute about y { base -> rod; }
///
///         per joint {
///             /// Torque of the motor.
///             input torque: N*m;
///             /// Viscous friction.
///             viscous: N*m*s/rad = 0.1 in 0.0..=1.0;
///
///             force = torque - viscous*v;
///         }
///     }
/// }
///
/// let p = PendulumParams::nominal();
/// assert_eq!((p.m, p.l, p.viscous_pivot), (1.0, 0.5, 0.1));
/// ```
///
/// # Language
///
/// Items may come in any order and end in `;` or `}`. `///` comments on the robot, parameters,
/// inputs, links and joints become documentation of the generated items.
///
/// ## `gravity: [gx, gy, gz] m/s^2;`
/// Acceleration of free fall in the frame of the base. Required; entries may be parameters.
///
/// ## `params { name: unit = nominal in lo..=hi; … }`
/// Parameters of the whole robot: nominal value and range in the declared unit. Either may be left
/// out (the nominal value is then the middle of the range, with a warning), ranges may be open:
/// `0.1..`, `..=2.0`. The word `fixed` before `;` keeps the parameter at its nominal value in
/// identifications. Names `q`, `v`, `a`, `t`, `pi` are taken.
///
/// ## `link name { … }`
/// A rigid body with its own frame:
/// - `mass: m;`
/// - `com: [x, y, z];` the centre of mass in the link frame;
/// - `inertia at com: diag(Ixx, Iyy, Izz);` about the centre of mass, or `at origin` about the
///   origin of the link frame, in the axes of the link frame; a full tensor is
///   `[xx: …, yy: …, zz: …, xy: …, xz: …, yz: …]`, where `xy` is the entry of the matrix, −∫xy dm.
///
/// Absent entries are zero. Entries are numbers, parameters and expressions of them, or `_`: "does
/// not enter the equations of motion", which the macro proves or refuses.
///
/// `inertial: free;` declares the ten standard parameters of the link, in which the equations are
/// linear: `l1_m`, `l1_mx`, `l1_my`, `l1_mz` (first moment), `l1_ixx … l1_iyz` (about the link
/// origin); `inertial: free at com;` declares `l1_m`, `l1_sx`, `l1_sy`, `l1_sz` and the inertia
/// about the centre of mass. `mass`, `com` and `inertia` beside it are then numbers: the nominal
/// values.
///
/// `link l1..=l6 { … }` declares several alike.
///
/// ## `joint name: type { parent -> child at [x, y, z] m rpy [r, p, y] rad; limits: lo..=hi rad; }`
/// - types: `revolute about x|y|z|[nx, ny, nz]`, `prismatic along x|y|z|[nx, ny, nz]`, `fixed`;
/// - `at` and `rpy` place the joint frame in the frame of the parent (zero if left out), R = Rz(y)
///   Ry(p) Rx(r) as in URDF. The frame of the child equals it at coordinate zero and moves about or
///   along the axis;
/// - `limits` bound the coordinate.
///
/// Moving joints are the coordinates, in the order of their declaration.
///
/// ## `per joint { … }`, `per joint j1..=j3, j5 { … }`
/// Declarations and laws for every moving joint, or for the named ones:
/// - `input name: unit;`
/// - `name: unit = nominal in lo..=hi;` a parameter of each joint; `= [a, b, …]` gives values and
///   `in [lo..=hi, …]` ranges joint by joint;
/// - `armature = expr;` inertia of the rotor as felt at the joint (kg·m², or kg): adds to the
///   diagonal of M only;
/// - `force = expr;` generalised force on the joint (N·m, or N).
///
/// The generated names carry the name of the joint: `viscous_pivot`. Inside the block the bare name
/// means the joint itself, as do `q` and `v`; `q.elbow`, `v.elbow` and `viscous_elbow` are those of
/// another joint.
///
/// `drive: torque;`, `drive: current { gain: k; }` and `drive: voltage { gain: k; resistance: r; }`
/// declare the input `torque`, `current` or `voltage` and add `n u`, `n k i` or `n k (U − k n v)/R`
/// to the force; `ratio: n;` (1 if left out) and `rotor: j;` (adds `n² j` to the armature) may
/// stand in their braces.
///
/// ## `input name: unit;`
/// An input of the whole robot, for `force on`.
///
/// ## `joint name: … { …; follows ratio*other + offset; }`
/// A joint without a coordinate of its own: its position is a linear combination of other joints,
/// with numbers and parameters as ratios and offset.
///
/// ## `motor name: j5 + j6 { … }`
/// A drive that moves several joints, declarations and laws as in `per joint`. In it `q` and `v`
/// are the combination; with w = C v a force f acts as Cᵀ f, and the armature J adds CᵀJ C to M.
///
/// ## `potential += expr;`
/// Potential energy of springs and the like in `q.joint` and parameters, in J.
///
/// ## `coordinates x: m, th: rad;` and `lagrangian = expr;`
/// In place of gravity, links and joints: any system by its Lagrangian, in J, quadratic in the
/// velocities `v.x`; a bare `x` is the position. `force on x = …;` and `per joint` hold as for
/// joints.
///
/// ## `inertial: solid cylinder { density: rho; radius: r; length: l; axis: z; }` in a link
/// Also `hollow cylinder { outer, inner, length, axis }`, `solid box { size: [a, b, c] m; }`,
/// `solid sphere { radius }`, each with `mass` or `density`; the centre is at the link's `com`.
///
/// ## `variant Name { lock j3..=j6 = 0 rad; emit { … } }`
/// A second model from the same description: locked joints are fixed at the value and lose
/// coordinate, input and drive parameters.
///
/// ## `force on joint = expr;`
/// A law for one joint. All laws of a joint are added up.
///
/// ## `emit { dynamics, first_derivatives, second_derivatives, regressor, base_parameters }`
/// Parts to generate; the first three if left out.
/// - `regressor`: Y of `tau = Y p + tau₀`, for links with `inertial: free` (or numbers); columns
///   are the parameters whose effect depends on motion alone. `pid_runtime::dynamics::Regressor`
///   has all parameters in which r is linear;
/// - `base_parameters`: the smallest set of combinations of them that the torques depend on, as
///   values and as formulas.
///
/// Without the feature `std` of `pid-runtime` a robot has its types and functions on arrays alone, with functions of
/// `libm`: for programs without `std` and without a heap.
///
/// ## `expect rank n;`, `expect rank n at nominal;`
/// The number of combinations of parameters that a motion determines (those marked `fixed` known),
/// at almost all values or at the nominal ones; another number is an error that names the groups of
/// parameters no motion tells apart. Without it such groups are warned of, unless parameters of
/// `inertial: free` are among them, which are never all identifiable. Rank and groups are in the
/// documentation of the robot.
///
/// ## `limit ops n;`
/// Operations that a part of `emit` may take, 250 000 if left out; a larger one is an error with its count.
///
/// ## `robot Name from urdf "path" { … }`
/// The links and joints of a URDF file, its path relative to the folder of `Cargo.toml`; a change
/// of the file builds the crate anew. Everything in the braces may be left out:
/// - `inertial: free;` (ten standard parameters per moving body, as without it) or `fixed` (numbers
///   of the file);
/// - `friction: free;` (`dry_<joint>`, `viscous_<joint>`, as without it) or `fixed`;
///   `armature: free;` (`rotor_<joint>`);
/// - `gravity: [gx, gy, gz] m/s^2;` in numbers, (0, 0, −9.81) if left out;
/// - `params { viscous_elbow: N*m*s/rad = 0.3 in 0.0..=2.0; }` nominal value, range and `fixed` of
///   parameters it has; absent parts stay as the file has them;
/// - `emit { … }`, `expect rank n;`, `limit ops n;` as above.
///
/// ## Expressions
/// `+ - * /`, powers `x^2` with integer exponents, `pi`,
/// `sin cos tan tanh atan exp ln sqrt abs sign`. `abs` and `sign` exclude `second_derivatives`.
///
/// ## Units
/// Every declared quantity has a unit and every use is checked. Products and quotients of powers of
/// `kg`, `m`, `s`, `A`, `K`, `rad`, `N`, `J`, `W`, `V`, `Ohm`, `Hz`, `Pa` and of `g`, `mm`, `cm`,
/// `um`, `ms`, `us`, `mA`, `mN`, `kN`, `mV`, `kW`, `kHz`, `deg`, `mrad`, `rpm`; `1` is the unit of
/// a number. Angles count as dimensionless. A number in an expression takes the unit that follows
/// it (`50 s/rad * v`); the unit after a list holds for the bare numbers in it. Everything is
/// converted to SI: generated functions, nominal values and bounds are in kg, m, s, A, rad, also
/// where the declaration says `mm` or `deg`.
///
/// # Errors
/// Mistakes are reported at the token to change, all of a stage at once: syntax, names, units and
/// values, the tree of links, physics. Until they are mended, uses of the robot elsewhere in the
/// crate give no errors of their own. `#[allow(deprecated)]` on the robot silences warnings (a
/// parameter without effect, a missing nominal value).
#[proc_macro]
pub fn robot(input: TokenStream) -> TokenStream {
    let face = match cfg!(feature = "std") {
        true => pid_codegen::Face::Full,
        false => pid_codegen::Face::Core,
    };
    let code = pid_codegen::expand_for(input.into(), face);
    #[cfg(feature = "facade")]
    let code = path::reached(code);
    code.into()
}

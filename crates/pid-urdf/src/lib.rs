//! URDF: a robot description as a [`Robot`](pid_derive::model::Robot), and identified values written back.
//!
//! ```text
//! text -> Description (what is written, checked, with its places) -> Robot (parameters as Options say)
//! parameter values + Description -> text, everything else as it was
//! ```
//!
//! - [`description`]: links, joints, inertias, `<dynamics>`, limits and `<mimic>` as written, in numbers;
//! - [`reading`]: what is done about inertias that no body has, about links without inertia, and
//!   which joints are held;
//! - [`mod@robot`]: which of the numbers become parameters; fixed joints are merged by the
//!   derivation, mimic joints follow;
//! - [`write`](mod@write): the text with other masses, inertias and friction;
//! - [`names`]: identifiers from the names of a file.
//!
//! The root link is the base, and its mass does not enter. Elements without effect on the dynamics
//! (visuals, collisions, transmissions, extensions) are left alone and kept.
//!
//! # Example
//! ```
//! use pid_urdf::{Description, Options};
//!
//! let text = r#"
//! <robot name="pendulum">
//!   <link name="world"/>
//!   <link name="rod">
//!     <inertial>
//!       <origin xyz="0 0 -0.5"/>
//!       <mass value="2"/>
//!       <inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/>
//!     </inertial>
//!   </link>
//!   <joint name="pivot" type="continuous">
//!     <parent link="world"/> <child link="rod"/> <axis xyz="0 1 0"/>
//!     <dynamics damping="0.1"/>
//!   </joint>
//! </robot>"#;
//! let description = Description::parse("pendulum.urdf", text)?;
//! let robot = pid_urdf::robot(&description, &Options::default())?;
//! assert_eq!(robot.name, "Pendulum");
//! assert_eq!(robot.inputs[0].name, "torque_pivot");
//! # Ok::<(), pid_urdf::UrdfError>(())
//! ```

mod bodies;
pub mod description;
mod error;
pub mod mesh;
pub mod names;
mod read;
pub mod reading;
pub mod robot;
pub mod write;

pub use description::Description;
pub use error::UrdfError;
pub use reading::{Guess, Missing, Reading};
pub use robot::{Inertias, Options, robot};
pub use write::{Lost, Written, write};

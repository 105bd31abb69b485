//! MJCF: a model of MuJoCo as a [`Mechanism`](pid_derive::mechanism::Mechanism) with its drives.
//!
//! ```text
//! text, included files -> elements with their default classes -> bodies with one joint each -> Mechanism
//! ```
//!
//! Read are bodies, frames, hinges and slides with `armature`, `damping`, `frictionloss` and ranges,
//! inertias as stated or of geoms, the settings of the compiler that place things, and drives on
//! joints. What is free is held where the file places it. Contacts, tendons, equalities and springs are
//! not part of a mechanism; those that act on the motion are named in warnings.
//!
//! # Example
//! ```
//! let text = r#"
//! <mujoco model="pendulum">
//!   <worldbody>
//!     <body name="rod" pos="0 0 1">
//!       <joint name="pivot" axis="0 1 0" damping="0.1" range="-90 90"/>
//!       <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.5" mass="0.4"/>
//!     </body>
//!   </worldbody>
//!   <actuator><motor joint="pivot" gear="20" ctrlrange="-1 1"/></actuator>
//! </mujoco>"#;
//! let model = pid_mjcf::Mjcf::parse("pendulum.xml", text)?;
//! let rod = &model.mechanism.bodies[0];
//! assert_eq!((rod.mass, rod.effort), (0.4, Some(20.0)));
//! # Ok::<(), pid_mjcf::MjcfError>(())
//! ```

mod actuator;
mod body;
mod defaults;
mod drives;
mod element;
mod error;
mod geom;
mod mesh;
mod place;
mod read;
mod reader;
mod replicate;

pub use actuator::{Actuator, PositionLoop};
pub use error::MjcfError;
pub use read::Mjcf;

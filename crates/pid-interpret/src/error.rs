use thiserror::Error;

/// Why a robot cannot become a model.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// The robot contradicts itself: it was put together wrongly.
    #[error("robot `{robot}` is put together wrongly: {fault}")]
    Malformed {
        /// Name of the robot.
        robot: String,
        /// The fault.
        fault: crate::check::Fault,
    },
    /// Nothing moves.
    #[error("robot `{robot}` has no moving joint: there is nothing to simulate or to identify")]
    NothingMoves {
        /// Name of the robot.
        robot: String,
    },
    /// The mass matrix is singular at the nominal parameters.
    #[error(
        "the mass matrix of `{robot}` is singular at its nominal parameters: what joint `{joint}` moves has no mass and no \
         inertia about its axis; give a link that it carries a mass or an inertia, or the joint an armature"
    )]
    SingularMass {
        /// Name of the robot.
        robot: String,
        /// Joint at which the factorization stops.
        joint: String,
    },
    /// A Lagrangian that is not quadratic in the velocities.
    #[error(
        "the Lagrangian of `{robot}` is not quadratic in the velocities: its mass matrix depends on them at coordinate \
         `{coordinate}`; kinetic energies are quadratic in the velocities"
    )]
    VelocityInMass {
        /// Name of the robot.
        robot: String,
        /// The coordinate.
        coordinate: String,
    },
    /// No equations of motion.
    #[error(transparent)]
    Derivation(#[from] pid_derive::Error),
}

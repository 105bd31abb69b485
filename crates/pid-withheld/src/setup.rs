//! What the records of a case are made from, and one sample of them.

use pid_interpret::nominal::Nominal;

use crate::causes::Cause;
use crate::mess::Mess;
use crate::plant::Plant;
use crate::position_loop::Loop;
use crate::robot::Robot;

/// Whose records are made.
#[derive(Clone, Copy)]
pub(crate) struct Setup<'a> {
    /// Drives, sensors and motions.
    pub(crate) robot: &'a Robot,
    /// What the controller knows.
    pub(crate) nominal: &'a Nominal,
    /// The robot as it is, without its causes.
    pub(crate) plant: &'a Plant<f64>,
    /// Its deviations from the stated values, in tolerances.
    pub(crate) theta: &'a [f64],
    /// What is withheld.
    pub(crate) causes: &'a [Cause],
    /// `measured`, `derived` or `absent`.
    pub(crate) velocity: &'a str,
    /// How the records are untidy.
    pub(crate) mess: &'a Mess,
    /// Position loops inside the drives: the controller sends targets alone.
    pub(crate) loops: Option<&'a [Loop]>,
}

/// One sample as it is recorded.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Row {
    /// Time since the record began, s.
    pub(crate) t: f64,
    pub(crate) q: Vec<f64>,
    pub(crate) v: Vec<f64>,
    pub(crate) u: Vec<f64>,
}

//! Limits of a motion.

use pid_runtime::dynamics::Hessian;

use super::error::ExciteError;
use super::workspace::Workspace;

/// Limits of a motion, one entry per joint.
#[derive(Debug, Clone)]
pub struct Limits<'a> {
    /// Range of the position, rad or m; `None`: any.
    pub q: Vec<Option<(f64, f64)>>,
    /// Largest |velocity|, rad/s or m/s.
    pub v: Vec<f64>,
    /// Largest |acceleration|, rad/s² or m/s².
    pub a: Vec<f64>,
    /// Largest |force| the motion may need, N·m or N; infinite: any.
    pub force: Vec<f64>,
    /// Boxes in which points of the robot stay; `None`: anywhere.
    pub workspace: Option<Workspace<'a>>,
}

impl Limits<'_> {
    /// Range from which positions are drawn: one turn or two metres where there is no limit.
    pub(super) fn range(&self, joint: usize) -> (f64, f64) {
        self.q[joint].unwrap_or((-std::f64::consts::PI, std::f64::consts::PI))
    }

    /// Whether they are limits of a motion of the model.
    pub(super) fn check(&self, model: &dyn Hessian) -> Result<(), ExciteError> {
        let nq = model.dims().nq;
        for (what, len) in [
            ("positions", self.q.len()),
            ("velocities", self.v.len()),
            ("accelerations", self.a.len()),
            ("forces", self.force.len()),
        ] {
            if len != nq {
                return Err(ExciteError::Count { what, len, nq });
            }
        }
        for (j, joint) in model.joints().iter().enumerate() {
            let bad = |what, value| {
                Err(ExciteError::Limit {
                    joint: joint.name.to_string(),
                    what,
                    value,
                })
            };
            if let Some((low, high)) = self.q[j]
                && !(low.is_finite() && high.is_finite() && low < high)
            {
                return bad("range of the position", high - low);
            }
            if !(self.v[j].is_finite() && self.v[j] > 0.0) {
                return bad("velocity", self.v[j]);
            }
            if !(self.a[j].is_finite() && self.a[j] > 0.0) {
                return bad("acceleration", self.a[j]);
            }
            if self.force[j].is_nan() || self.force[j] <= 0.0 {
                return bad("force", self.force[j]);
            }
        }
        self.workspace.as_ref().map_or(Ok(()), Workspace::check)
    }
}

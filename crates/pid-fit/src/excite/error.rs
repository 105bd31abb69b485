//! Why no motion was found.

/// A random start is tried this often before the limits count as impossible.
pub(super) const TRIES: usize = 200;

/// Why no motion was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExciteError {
    /// A list of the limits has the wrong length.
    #[error("limits of {what} for {len} joints, the model has {nq}")]
    Count {
        /// Which list.
        what: &'static str,
        /// Its length.
        len: usize,
        /// Joints of the model.
        nq: usize,
    },
    /// A limit is not positive, or a range is empty.
    #[error("joint `{joint}`: limit of the {what} is {value}\n  help: give a positive number")]
    Limit {
        /// Name of the joint.
        joint: String,
        /// Which limit.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// Not one box per point.
    #[error("{boxes} boxes for {points} points")]
    Boxes {
        /// Boxes given.
        boxes: usize,
        /// Points.
        points: usize,
    },
    /// An empty box.
    #[error(
        "point `{point}`: the range of {axis} is from {low} to {high}\n  help: give the lower end first"
    )]
    Box {
        /// Name of the point.
        point: String,
        /// Which direction.
        axis: char,
        /// Lower end, m.
        low: f64,
        /// Upper end, m.
        high: f64,
    },
    /// No pose has the points in their boxes.
    #[error(
        "no pose was found with all points in their boxes, in {TRIES} tries: in the best one `{point}` is at {axis} = {value:.4} m, its range is {low} to {high}\n  help: widen the box or the ranges of the positions"
    )]
    OutOfReach {
        /// Name of the point.
        point: String,
        /// Which direction.
        axis: char,
        /// Its coordinate in the best pose, m.
        value: f64,
        /// Lower end, m.
        low: f64,
        /// Upper end, m.
        high: f64,
    },
    /// Settings that no motion can meet.
    #[error("{what} is {value}\n  help: {help}")]
    Setting {
        /// Which setting.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The mend.
        help: &'static str,
    },
    /// The model cannot be evaluated.
    #[error("the force's derivative by `{param}` is not finite within the limits")]
    NotFinite {
        /// Name of the parameter.
        param: String,
    },
    /// No parameter has an effect.
    #[error("no parameter of the model can be determined by a motion within these limits")]
    NothingToDetermine,
    /// Not even at rest.
    #[error(
        "joint `{joint}` needs {needed:.4} at rest, its limit is {limit:.4}, in each of {TRIES} random poses\n  help: raise the limit of the force or change the range of the positions"
    )]
    TooWeak {
        /// The joint that needs most.
        joint: String,
        /// Force it needs in the best pose.
        needed: f64,
        /// Its limit.
        limit: f64,
    },
}

//! The numbers that decide what is a finding.

/// Thresholds, each with the reason for its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Criteria {
    /// A stretch of equal readings counts as frozen from this many rows on. Quantised encoders repeat a
    /// value for some rows at low speed.
    pub frozen_rows: usize,
    /// And from this long on, s: shorter holds of a bus are bridged like single missing samples.
    pub frozen_seconds: f64,
    /// The way of the joint in a frozen stretch, over the range of the channel. 2 % is above the drift
    /// of an integrated velocity over a rest and above a few steps of an encoder.
    pub frozen_way: f64,
    /// Speed in a frozen stretch, over the 95 % quantile of the speed.
    pub frozen_speed: f64,
    /// Jump after a frozen stretch, over the 99.5 % quantile of the steps from row to row.
    pub frozen_jump: f64,
    /// Difference between a velocity that stands still and the slope of the position, over the 95 %
    /// quantile of the speed.
    pub frozen_velocity: f64,
    /// Share of a record up to which a velocity that stands still is doubtful and not wrong: as many lost readings
    /// change no result, and hobby servos of sound logs hold their velocity for 1.7 %.
    pub frozen_share: f64,
    /// Expected number of runs of equal readings by chance, below which a run is none of chance.
    pub frozen_chance: f64,
    /// Rows in a row at a bound that count as saturation.
    pub saturated_rows: usize,
    /// Share of the rows at a bound from which it is said.
    pub saturated_share: f64,
    /// A jump is a whole turn if it differs from it by less than this share of a turn; a joint moves less
    /// than that from row to row.
    pub wrap_share: f64,
    /// A position jumps if it goes faster than this many times the 99.5 % quantile of its speeds. Impacts
    /// change speeds, not positions; twice the quantile is the largest speed of smooth motions.
    pub jump_speed: f64,
    /// And farther than this share of its range: some steps of a coarse encoder.
    pub jump_way: f64,
    /// A step of time is a hole from this many median steps on: half way between one and two.
    pub gap_steps: f64,
    /// A hole is doubtful from this long on, s: in a tenth of a second a joint moves on visibly.
    pub gap_seconds: f64,
    /// Standard deviation of the time steps over their mean from which it is said.
    pub jitter: f64,
    /// Rate that a diagnosis of drives wants, Hz: delays of 5 ms and reversals of 20 ms are the smallest
    /// effects of the library that matter.
    pub rate: f64,
    /// Share of its range that a joint may move from row to row.
    pub step_of_range: f64,
    /// A factor is that of a unit if it is within this factor of it. Units lie a factor of 5.8 apart or
    /// more (9.81 and 57.3), the values of a robot vary by less than 2.
    pub factor_width: f64,
    /// Correlation between a velocity and the slope of a position from which they belong together.
    pub velocity_correlation: f64,
    /// Bounds of the factor between the nominal torque of the rigid robot and the recorded one: an unknown
    /// payload or guessed inertias change it by up to 3, no unit by less than 9.8.
    pub rigid_factor: (f64, f64),
    /// Largest constant torque beside the model, over the root mean square of the torque.
    pub offset: f64,
    /// Share of the mean square of a torque below which differences between explanations do not count.
    pub floor: f64,
    /// Largest share that the tolerances may leave open: at 0.5 a joint whose torque they leave open gains less
    /// than the margin by any explanation, so it decides nothing.
    pub floor_most: f64,
    /// A joint is known if the tolerances leave open less than this share of its torque.
    pub known: f64,
    /// Alternatives are tried if at some joint the share left is above this.
    pub suspicious: f64,
    /// An alternative must reduce the sum over joints of the logarithms of the shares left by this much,
    /// per joint that it changes.
    pub margin: f64,
    /// Fall of the logarithm by which a sign wins at a joint whose torque the tolerances leave open. A right
    /// sign never loses there: friction, which is not negative, explains more of it than of its opposite.
    pub sign_margin: f64,
    /// And leave at most this share of the torque at the joints it changes.
    pub explained: f64,
    /// Gain from which a share left of up to 1 is enough: an effect may hide half a torque, but it does not
    /// make a wrong explanation twenty times better than the record as it is.
    pub clear: f64,
    /// Share left below which an explanation is taken without asking for orders of whole joints, which cost most:
    /// parallel joints of an arm leave 0.08 in a wrong order.
    pub convincing: f64,
    /// Share left from which a torque counts as unexplained.
    pub unexplained: f64,
    /// Share of gravity's torque that inertia and friction leave in the motion of a robot left alone. Slow
    /// driven motion reaches 0.3, since friction can take the part of the drive for a while.
    pub free: f64,
    /// Inputs later than this against the motion are a fault, s. Nothing in a robot makes its input late;
    /// filters of measured currents take up to 5 ms.
    pub late: f64,
    /// Inputs earlier than this are a fault or a long delay, s. The delays of drives and sensors that a
    /// diagnosis looks for reach 30 ms.
    pub early: f64,
    /// A fault of the clock is at least this many rows.
    pub lag_rows: f64,
    /// Least fall of the sum of logarithms by a shift of the inputs, per joint.
    pub lag_margin: f64,
    /// Angle between fitted and stated gravity from which it is said, rad; a base that is tilted by a few
    /// degrees is an effect that the diagnosis looks for.
    pub gravity_note: f64,
    /// And from which it is doubtful, rad.
    pub gravity_doubtful: f64,
    /// Torque or speed over the stated one from which it is said: stated ones are typical, not largest, and
    /// quick records of a robot reach five of them.
    pub above_stated: f64,
    /// A parameter is not determined if the record shrinks its tolerance to no less than this share, where a
    /// rich motion shrinks it below half of that.
    pub undetermined: f64,
}

impl Default for Criteria {
    fn default() -> Self {
        Self {
            frozen_rows: 15,
            frozen_seconds: 0.04,
            frozen_way: 0.02,
            frozen_speed: 0.15,
            frozen_jump: 3.0,
            frozen_velocity: 0.3,
            frozen_share: 0.02,
            frozen_chance: 1e-6,
            saturated_rows: 4,
            saturated_share: 0.01,
            wrap_share: 0.15,
            jump_speed: 6.0,
            jump_way: 0.03,
            gap_steps: 1.5,
            gap_seconds: 0.1,
            jitter: 0.01,
            rate: 100.0,
            step_of_range: 0.1,
            factor_width: 2.2,
            velocity_correlation: 0.8,
            rigid_factor: (0.33, 3.0),
            offset: 0.3,
            floor: 0.01,
            floor_most: 0.5,
            known: 0.2,
            suspicious: 0.1,
            margin: 0.7,
            sign_margin: 0.4,
            explained: 0.5,
            clear: 3.0,
            convincing: 0.03,
            unexplained: 0.6,
            free: 0.1,
            late: 0.012,
            early: 0.045,
            lag_rows: 5.0,
            lag_margin: 0.7,
            gravity_note: 0.05,
            gravity_doubtful: 0.26,
            above_stated: 6.0,
            undetermined: 0.8,
        }
    }
}

/// What a check may be told.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The thresholds.
    pub criteria: Criteria,
    /// Samples, all records together, at which torques are compared. 4000 keep a check of six joints below
    /// two seconds; the comparisons have a few free values each.
    pub points: usize,
    /// Whether it is said what the record determines and which motion is missing.
    pub determinable: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            criteria: Criteria::default(),
            points: 4000,
            determinable: true,
        }
    }
}

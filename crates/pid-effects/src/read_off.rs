//! Parameters whose start values are read off the records.

/// A quantity over which a law bends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Over {
    /// Position of the joint.
    Position,
    /// Absolute value of its velocity.
    Speed,
    /// Absolute value of the torque that its gear passes.
    Load,
}

/// Parameters of a law in which it is not linear, by what tells where they start. Numbers are places
/// among the parameters; the law is linear in the amplitudes beside them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadOff {
    /// A value of a quantity: quantiles of it.
    Place {
        /// The parameter.
        parameter: usize,
        /// The quantity.
        of: Over,
    },
    /// A value of q + r q_before, and the ratio r.
    PlaceOfTwo {
        /// The value.
        parameter: usize,
        /// The ratio.
        ratio: usize,
    },
    /// A time constant: parts of the records' length.
    TimeConstant {
        /// The parameter.
        parameter: usize,
    },
    /// Angular frequency of a force over the time: lines in the spectrum of the missing force.
    TimeWave {
        /// The frequency.
        wave: usize,
    },
    /// Angular frequency of what moves all joints over the time: lines that they share.
    BaseWave {
        /// The frequency.
        wave: usize,
    },
    /// Angular frequency of friction over the position: lines in the missing friction.
    FrictionWave {
        /// The frequency.
        wave: usize,
    },
    /// A force sin(w (q + r q_before)): lines over both positions.
    WaveOfTwo {
        /// The frequency w.
        wave: usize,
        /// The ratio r.
        ratio: usize,
    },
}

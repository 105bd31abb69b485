//! Drives known by their values: gain, viscous and Coulomb friction, however they are written.

/// Speed far beyond any transition at rest, rad/s or m/s.
const FAST: f64 = 1e6;
/// Speeds at which a friction law is evaluated, decades around one.
const SPEEDS: std::ops::RangeInclusive<i32> = -5..=4;
/// A law must agree to this share of its largest force.
const AGREE: f64 = 1e-6;

/// `gain u − viscous v − coulomb s(v)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Law {
    pub(super) gain: f64,
    pub(super) viscous: f64,
    pub(super) coulomb: f64,
}

/// The force on a joint as a function of its possible arguments.
pub(super) struct Drive<'a> {
    pub(super) force: &'a dyn Fn(&At) -> f64,
    pub(super) joint: usize,
    /// Its input.
    pub(super) input: Option<usize>,
    /// Names of all joints and inputs, for messages.
    pub(super) joints: &'a [&'a str],
    pub(super) inputs: &'a [&'a str],
}

impl Drive<'_> {
    /// Gain from a unit input at rest, friction from two high speeds.
    pub(super) fn law(&self) -> Law {
        let offset = (self.force)(&At::default());
        let gain = self
            .input
            .map_or(0.0, |k| (self.force)(&At::default().input(k, 1.0)) - offset);
        let odd = |v: f64| {
            let force = |v: f64| (self.force)(&At::default().speed(self.joint, v));
            0.5 * (force(-v) - force(v))
        };
        let viscous = (odd(2.0 * FAST) - odd(FAST)) / FAST;
        let coulomb = odd(FAST) - viscous * FAST;
        // The rounding of the viscous force at that speed.
        let rounding = 1e-9 * viscous.abs() * FAST;
        Law {
            gain,
            viscous: if viscous.abs() * FAST < AGREE * coulomb.abs() {
                0.0
            } else {
                viscous
            },
            coulomb: if coulomb.abs() <= rounding {
                0.0
            } else {
                coulomb
            },
        }
    }

    /// Whether the drive follows `law`, and the sharpness of its transition, infinite for a jump.
    ///
    /// # Errors
    /// In which way it differs.
    pub(super) fn check(&self, law: Law) -> Result<f64, String> {
        let j = self.joint;
        if ![law.gain, law.viscous, law.coulomb]
            .iter()
            .all(|x| x.is_finite())
        {
            return Err("it is not finite at high speed".to_owned());
        }
        if self.input.is_some() && law.gain == 0.0 {
            return Err("its input has no effect on it at rest".to_owned());
        }
        if law.coulomb < 0.0 || law.viscous < 0.0 {
            return Err(format!(
                "its friction is negative: Coulomb {:.4}, viscous {:.4}",
                law.coulomb, law.viscous
            ));
        }
        let force = |at: &At| (self.force)(at);
        let rest = force(&At::default());
        let size = law.gain.abs() + law.coulomb + law.viscous + rest.abs();
        let differs = |x: f64, y: f64| {
            let off = (x - y).abs();
            off.is_nan() || off > AGREE * size.max(x.abs()).max(y.abs())
        };
        if differs(rest, 0.0) {
            return Err(format!("it is {rest:.4} at rest without input"));
        }
        for k in 0..self.joints.len() {
            for (at, what) in [
                (At::default().position(k, 0.7), "position"),
                (At::default().speed(k, 0.7), "velocity"),
            ] {
                if (k != j || what == "position") && differs(force(&at), 0.0) {
                    return Err(format!("depends on the {what} of `{}`", self.joints[k]));
                }
            }
        }
        for k in 0..self.inputs.len() {
            let own = self.input == Some(k);
            for u in [-3.0, 0.3, 10.0] {
                for v in [0.0, 0.5, -20.0] {
                    let with = force(&At::default().speed(self.joint, v).input(k, u));
                    let without = force(&At::default().speed(self.joint, v));
                    let gain = if own { law.gain } else { 0.0 };
                    if differs(with - without, gain * u) {
                        let name = self.inputs[k];
                        return Err(format!(
                            "is not a constant times `{name}` and a function of the velocity"
                        ));
                    }
                }
            }
        }
        // The transition: odd, from 0 to 1, rising.
        let share =
            |v: f64| (-force(&At::default().speed(self.joint, v)) - law.viscous * v) / law.coulomb;
        let mut last = 0.0;
        for decade in SPEEDS {
            for step in [1.0, 2.0, 5.0] {
                let v = step * 10f64.powi(decade);
                let (ahead, back) = (
                    -force(&At::default().speed(self.joint, v)),
                    force(&At::default().speed(j, -v)),
                );
                if differs(ahead, back) {
                    return Err(format!("its friction at {v} and −{v} differs"));
                }
                if law.coulomb == 0.0 {
                    if differs(ahead, law.viscous * v) {
                        return Err("its friction is not viscous".to_owned());
                    }
                    continue;
                }
                let now = share(v);
                let slack = AGREE * (1.0 + law.viscous * v / law.coulomb);
                if now < last - slack || now > 1.0 + slack {
                    return Err(format!(
                        "its friction is not Coulomb and viscous: {ahead:.4} at a speed of {v}"
                    ));
                }
                last = now;
            }
        }
        if law.coulomb == 0.0 {
            return Ok(f64::INFINITY);
        }
        // tanh(1) = 0.76: the speed at which the transition has come that far, by bisection.
        let (mut low, mut high) = (1e-9_f64, 1e6_f64);
        if share(low) > 1.0_f64.tanh() {
            return Ok(f64::INFINITY);
        }
        for _ in 0..200 {
            let middle = (low * high).sqrt();
            if share(middle) < 1.0_f64.tanh() {
                low = middle;
            } else {
                high = middle;
            }
        }
        Ok(1.0 / low)
    }
}

/// Coordinates, speeds and inputs that are not zero.
#[derive(Debug, Clone, Default)]
pub(super) struct At {
    pub(super) q: Vec<(usize, f64)>,
    pub(super) v: Vec<(usize, f64)>,
    pub(super) u: Vec<(usize, f64)>,
}

impl At {
    fn position(mut self, k: usize, q: f64) -> Self {
        self.q.push((k, q));
        self
    }
    fn speed(mut self, k: usize, v: f64) -> Self {
        self.v.push((k, v));
        self
    }
    fn input(mut self, k: usize, u: f64) -> Self {
        self.u.push((k, u));
        self
    }
}

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
        let rest = (self.force)(&At::default());
        let size = law.gain.abs() + law.coulomb + law.viscous + rest.abs();
        let differs = |x: f64, y: f64| {
            let off = (x - y).abs();
            off.is_nan() || off > AGREE * size.max(x.abs()).max(y.abs())
        };
        if differs(rest, 0.0) {
            return Err(format!("it is {rest:.4} at rest without input"));
        }
        self.depends_on_its_own(&differs)?;
        self.is_linear_in_inputs(law, &differs)?;
        self.rises_to_coulomb(law, &differs)?;
        Ok(self.sharpness(law))
    }

    /// No position and no velocity of another joint acts on it.
    fn depends_on_its_own(&self, differs: &dyn Fn(f64, f64) -> bool) -> Result<(), String> {
        for (k, name) in self.joints.iter().enumerate() {
            for (at, what) in [
                (At::default().position(k, 0.7), "position"),
                (At::default().speed(k, 0.7), "velocity"),
            ] {
                let may = k == self.joint && what == "velocity";
                if !may && differs((self.force)(&at), 0.0) {
                    return Err(format!("depends on the {what} of `{name}`"));
                }
            }
        }
        Ok(())
    }

    /// Its own input acts by the gain at every speed, the others do not act.
    fn is_linear_in_inputs(
        &self,
        law: Law,
        differs: &dyn Fn(f64, f64) -> bool,
    ) -> Result<(), String> {
        for (k, name) in self.inputs.iter().enumerate() {
            let own = self.input == Some(k);
            for u in [-3.0, 0.3, 10.0] {
                for v in [0.0, 0.5, -20.0] {
                    let at = || At::default().speed(self.joint, v);
                    let by_input = (self.force)(&at().input(k, u)) - (self.force)(&at());
                    let gain = if own { law.gain } else { 0.0 };
                    if differs(by_input, gain * u) {
                        return Err(format!(
                            "is not a constant times `{name}` and a function of the velocity"
                        ));
                    }
                }
            }
        }
        Ok(())
    }

    /// Friction at a velocity of the joint.
    fn friction(&self, v: f64) -> f64 {
        -(self.force)(&At::default().speed(self.joint, v))
    }

    /// Share of the Coulomb friction that acts at a velocity.
    fn share(&self, law: Law, v: f64) -> f64 {
        (self.friction(v) - law.viscous * v) / law.coulomb
    }

    /// The friction is odd, and what is not viscous rises from 0 to the Coulomb friction.
    fn rises_to_coulomb(&self, law: Law, differs: &dyn Fn(f64, f64) -> bool) -> Result<(), String> {
        let mut last = 0.0;
        let decades = SPEEDS.flat_map(|decade| [1.0, 2.0, 5.0].map(|x| x * 10f64.powi(decade)));
        for v in decades {
            let ahead = self.friction(v);
            if differs(ahead, -self.friction(-v)) {
                return Err(format!("its friction at {v} and −{v} differs"));
            }
            if law.coulomb == 0.0 {
                if differs(ahead, law.viscous * v) {
                    return Err("its friction is not viscous".to_owned());
                }
                continue;
            }
            let now = self.share(law, v);
            let slack = AGREE * (1.0 + law.viscous * v / law.coulomb);
            if now < last - slack || now > 1.0 + slack {
                return Err(format!(
                    "its friction is not Coulomb and viscous: {ahead:.4} at a speed of {v}"
                ));
            }
            last = now;
        }
        Ok(())
    }

    /// Inverse of the speed at which the transition has come to tanh(1) = 0.76, by bisection.
    fn sharpness(&self, law: Law) -> f64 {
        let (mut low, mut high) = (1e-9_f64, 1e6_f64);
        if law.coulomb == 0.0 || self.share(law, low) > 1.0_f64.tanh() {
            return f64::INFINITY;
        }
        for _ in 0..200 {
            let middle = (low * high).sqrt();
            if self.share(law, middle) < 1.0_f64.tanh() {
                low = middle;
            } else {
                high = middle;
            }
        }
        1.0 / low
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

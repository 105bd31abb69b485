//! Motors that brake by the voltage they induce. With a back-EMF k and a motor gain g, the viscous friction is
//!
//! ```text
//! d + g k,     d alone while the drive is off
//! ```
//!
//! It acts behind effects between drive and motor, as the motor does.

use pid_runtime::chain::Group;
use pid_runtime::dynamics::{At, Dims, Hessian};

use super::super::arguments::widened;
use super::drive::{BACK_EMF, Loop, ON};

/// A motor that brakes.
pub(super) struct Brake {
    /// Viscous friction and motor gain among the parameters.
    viscous: usize,
    gain: usize,
    /// The back-EMF, and the input that is zero while the drive is off, in z.
    back_emf: usize,
    on: Option<usize>,
}

/// Number of arguments: friction, gain, back-EMF, and whether the drive is on.
const ARGUMENTS: usize = 4;

impl Brake {
    /// Of a loop, around a model that has friction and gain of its joint as parameters; `None` without a back-EMF.
    pub(super) fn of(own: &Loop, inner: &dyn Hessian) -> Option<Self> {
        let joint = &inner.joints()[own.joint].name;
        let place = |what: &str| {
            let name = format!("{what}_{joint}");
            inner.params().iter().position(|p| p.name == name)
        };
        Some(Self {
            viscous: place("viscous")?,
            gain: place("gain")?,
            back_emf: own.places[BACK_EMF]?,
            on: own.places[ON],
        })
    }

    /// The friction as a function of the outer variables; `before` are the sizes of the model within.
    pub(super) fn group(&self, before: &Dims, dims: &Dims) -> Group {
        let outer = |parameter: usize| Some(widened(before, dims, before.p() + parameter));
        let arguments = vec![
            outer(self.viscous),
            outer(self.gain),
            Some(self.back_emf),
            self.on,
        ];
        Group {
            replaces: vec![before.p() + self.viscous],
            arguments,
        }
    }

    /// Gain, back-EMF, and 1 while the drive is on.
    fn at(&self, at: &At<'_>, dims: &Dims) -> [f64; 3] {
        let on = self.on.map_or(1.0, |z| at.u[z - dims.u()]);
        [at.p[self.gain], at.p[self.back_emf - dims.p()], on]
    }

    /// Adds what the motor brakes by to the friction among the parameters of the model within.
    pub(super) fn put(&self, at: &At<'_>, dims: &Dims, p: &mut [f64]) {
        let [gain, k, on] = self.at(at, dims);
        p[self.viscous] += gain * k * on;
    }

    /// Slopes of the friction by its arguments.
    pub(super) fn gradient(&self, at: &At<'_>, dims: &Dims) -> [f64; ARGUMENTS] {
        let [gain, k, on] = self.at(at, dims);
        [1.0, k * on, gain * on, gain * k]
    }

    /// Second derivatives times a weight, the lower triangle.
    pub(super) fn curvature(
        &self,
        at: &At<'_>,
        dims: &Dims,
        weight: f64,
    ) -> [f64; ARGUMENTS * ARGUMENTS] {
        let [gain, k, on] = self.at(at, dims);
        let mut out = [0.0; ARGUMENTS * ARGUMENTS];
        for (row, column, x) in [(2, 1, on), (3, 1, k), (3, 2, gain)] {
            out[row * ARGUMENTS + column] = weight * x;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use pid_interpret::nominal as description;
    use pid_runtime::dynamics::{At, Dynamics, ParamInfo};

    use super::super::WithLoops;
    use super::super::tests::{CASCADE, PD, PID, arm_under, described, motor_gains, targets};
    use crate::with_effects::Assembled;
    use crate::with_effects::tests::{ARM, assert_derivatives, at, model, point};

    /// Behind effects of a drive the back-EMF is viscous friction: not slow and not limited as the input is.
    #[test]
    fn a_motor_brakes_behind_the_effects_of_its_drive() {
        let slow = "[[effect]]\nid = \"actuator_lag\"\njoint = \"shoulder\"\n[effect.parameters]\ntime_constant_s = { value = 0.03 }\n\
                    [[effect]]\nid = \"torque_saturation\"\njoint = \"elbow\"\n[effect.parameters]\nlimit_input = { value = 0.1 }\n";
        let arm = ARM.replace("\"current\"", "\"voltage\"");
        let assembled = |drive: &str| {
            let text = format!("{arm}\n{slow}\n[drive]\n{PD}{drive}");
            let nominal = description::Nominal::parse("arm.toml", &text).expect("a description");
            Assembled::new(&nominal, &mut targets())
                .expect("equations")
                .model
        };
        let (plain, with) = (
            assembled(""),
            assembled("back_emf = { value = 0.7, tolerance = 0.1 }\n"),
        );
        let (few, d) = (plain.dims(), with.dims());
        assert_eq!((d.nq, d.nu, d.np), (few.nq, few.nu, few.np + 2));
        let z: Vec<f64> = (0..d.nz())
            .map(|i| 0.3 + 0.4 * (1.3 * i as f64).sin())
            .collect();
        let here = at(&z, &d);
        let of = |name: &str| {
            let k = with.params().iter().position(|p| p.name == name);
            here.p[k.expect(name)]
        };
        let own = |p: &ParamInfo| match p.name.strip_prefix("viscous_") {
            Some(joint) => {
                let braked = of(&format!("gain_{joint}")) * of(&format!("back_emf_{joint}"));
                of(&p.name) + braked
            }
            None => of(&p.name),
        };
        let p: Vec<f64> = plain.params().iter().map(own).collect();
        let (mut r, mut expected) = (vec![0.0; d.nq], vec![0.0; d.nq]);
        with.residual(&here, &mut r);
        plain.residual(&At { p: &p, ..here }, &mut expected);
        for (r, expected) in r.iter().zip(&expected) {
            assert!((r - expected).abs() < 1e-12, "{r} {expected}");
        }
    }

    /// A motor at the voltage u − k v, and none while its drive is off, whatever its loop and its integral do.
    #[test]
    fn a_drive_that_is_off_leaves_no_input() {
        for law in [PD, PID, CASCADE] {
            let arm = ARM.replace("\"current\"", "\"voltage\"");
            let text =
                format!("{arm}\n[drive]\n{law}back_emf = {{ value = 0.7, tolerance = 0.1 }}\n");
            let nominal = description::Nominal::parse("arm.toml", &text).expect("a description");
            let mut dataset = targets();
            let mut second = dataset.experiments[0].clone();
            second.name = "b".to_owned();
            dataset.experiments.push(second);
            let rule = "b=off".parse().expect("a rule");
            let mut dataset = dataset.with_gain_factors(&[rule]).expect("a rule");
            let servos = [nominal.servo(0), None];
            let with = WithLoops::new(model(), &servos, &nominal, &mut dataset);
            let d = with.dims();
            let on: Vec<f64> = (dataset.experiments.iter())
                .map(|e| e.u[d.nu - 1])
                .collect();
            assert_eq!(on, [1.0, 0.0]);
            let mut z = point(&with, 1.0);
            let free: Vec<usize> = (0..d.nz()).collect();
            assert_derivatives(law, &with, &z, &free);

            let (plain, mut targets) = (described(law), targets());
            let servos = [plain.servo(0), None];
            let plain = WithLoops::new(model(), &servos, &plain, &mut targets);
            let few = plain.dims();
            let same = |z: &[f64]| [&z[..d.u() + few.nu], &z[d.p()..d.p() + few.np]].concat();
            let (mut r, mut expected) = (vec![0.0; d.nq], vec![0.0; few.nq]);
            let gain = motor_gains(&at(&z, &d))[0];
            z[d.u() + d.nu - 1] = 1.0;
            with.residual(&at(&z, &d), &mut r);
            plain.residual(&at(&same(&z), &few), &mut expected);
            let v = z[d.v()];
            let place = with
                .params()
                .iter()
                .position(|p| p.name == "back_emf_shoulder");
            expected[0] += gain * z[d.p() + place.expect("a back-EMF")] * v;
            assert!(
                (r[0] - expected[0]).abs() < 1e-12,
                "{law}: {r:?} {expected:?}"
            );

            z[d.u() + d.nu - 1] = 0.0;
            with.residual(&at(&z, &d), &mut r);
            let here = at(&z, &d);
            let expected = arm_under(&here, &[0.0, here.u[1]]);
            assert!(
                (r[0] - expected[0]).abs() < 1e-12,
                "{law}: {r:?} {expected:?}"
            );
        }
    }
}

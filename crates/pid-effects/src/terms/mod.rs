//! Terms of a law without a name: a formula over position, velocity, load and time, term by term.
//!
//! Where something is missing that no effect of the [library](crate::effects) describes, the sum of a
//! few of these terms describes it within the range of the records: broken lines over one quantity
//! (J. H. Friedman, Multivariate Adaptive Regression Splines, Annals of Statistics 19(1), 1991), waves
//! over positions and over the time, and an exponential over the time. A term says what the records
//! show, and not what causes it. Descriptions, identification and simulation take terms as they take
//! effects.

mod base_wave;
mod friction_above_load;
mod friction_above_speed;
mod friction_wave;
mod gain_over_time;
mod hinge;
mod pull_of_two;
mod supply_sag;
mod time_wave;
mod wave_of_two;

pub use base_wave::BaseWave;
pub use friction_above_load::FrictionAboveLoad;
pub use friction_above_speed::FrictionAboveSpeed;
pub use friction_wave::FrictionWave;
pub use gain_over_time::GainOverTime;
pub use hinge::Hinge;
pub use pull_of_two::PullOfTwo;
pub use supply_sag::SupplySag;
pub use time_wave::TimeWave;
pub use wave_of_two::WaveOfTwo;

use std::sync::Arc;

use crate::effect::Effect;
use crate::scalar::Scalar;

/// All terms.
pub fn all() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(Hinge::Above),
        Arc::new(Hinge::Below),
        Arc::new(FrictionAboveSpeed),
        Arc::new(FrictionAboveLoad),
        Arc::new(FrictionWave),
        Arc::new(GainOverTime),
        Arc::new(TimeWave),
        Arc::new(BaseWave),
        Arc::new(WaveOfTwo::Own),
        Arc::new(WaveOfTwo::Before),
        Arc::new(PullOfTwo),
        Arc::new(SupplySag),
    ]
}

/// max(x, 0), rounded where absolute values are.
fn positive<D: Scalar>(x: D) -> D {
    (x + x.magnitude()) * 0.5
}

/// Its slope, in the smooth form.
fn rises<D: Scalar>(x: D) -> D {
    (x / x.magnitude() + 1.0) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::constants::Constants;
    use crate::effect::{Forces, Friction, Law, Site};
    use crate::nominal::Nominal;
    use num_dual::Dual64;

    /// Additional force on both joints of an arm at a motion: friction acts against it.
    fn force<D: Scalar>(law: &dyn Law<D>, e: &[D], q: &[D], v: &[D], t: f64) -> [D; 2] {
        let nominal = Nominal::parse(include_str!("../with_effects/arm.toml"), "arm".as_ref());
        let nominal = nominal.expect("a robot");
        let site = Site {
            joint: 1,
            q,
            v,
            load: &[D::constant(0.3), D::constant(-0.7)],
            t,
            dt: 0.0,
            rest: None,
        };
        let (mut value, mut rate) = ([D::nil(); 2], [D::nil(); 2]);
        let mut forces = Forces {
            value: &mut value,
            rate: &mut rate,
        };
        law.force(e, &site, &[], &mut forces, &Constants::none(&nominal));
        let mut f = Friction {
            forward: D::nil(),
            backward: D::nil(),
            viscous: D::nil(),
        };
        law.friction(e, &site, &[], &mut f);
        let dry = match v[1].value() > 0.0 {
            true => -f.forward,
            false => f.backward,
        };
        [value[0], value[1] + dry]
    }

    #[test]
    fn terms_are_absent_where_their_amplitudes_are_zero() {
        for term in all() {
            let info = term.info();
            let mut e: Vec<f64> = (0..info.parameters.len())
                .map(|i| 0.4 + 0.3 * i as f64)
                .collect();
            for &a in info.amplitudes {
                e[a] = 0.0;
            }
            let acted = force(term.plain(), &e, &[0.3, 0.9], &[-1.0, 2.0], 0.8);
            assert_eq!(acted, [0.0; 2], "{}", info.id);
            let commands = crate::effect::Commands {
                u: &[2.0, 2.0],
                h: 0.1,
                linear: false,
                begin: 0.0,
                t: 0.05,
                dt: 0.01,
            };
            let base = term.plain().base_acceleration(&e, 0.8);
            assert!(base.is_none_or(|a| a == [0.0; 3]), "{}", info.id);
            assert_eq!(term.plain().input(&e, 2.0, &commands, &mut []), 2.0);
        }
    }

    #[test]
    fn forces_are_those_of_the_equations() {
        let of = |id: &str, e: &[f64], q: &[f64], v: &[f64], t: f64| {
            let term = all().into_iter().find(|t| t.info().id == id).expect(id);
            force(term.plain(), e, q, v, t)
        };
        let (still, up) = ([0.0, 0.0], [0.0, 2.0]);
        let near = |x: [f64; 2], y: [f64; 2]| {
            let off = (x[0] - y[0]).abs().max((x[1] - y[1]).abs());
            assert!(off < 1e-12, "{x:?} {y:?}");
        };
        near(
            of("hinge_above", &[3.0, 0.5], &[0.0, 0.7], &still, 0.0),
            [0.0, -0.6],
        );
        near(
            of("hinge_above", &[3.0, 0.5], &[0.0, 0.4], &still, 0.0),
            [0.0, 0.0],
        );
        near(
            of("hinge_below", &[3.0, 0.5], &[0.0, 0.4], &still, 0.0),
            [0.0, 0.3],
        );
        near(
            of("hinge_below", &[3.0, 0.5], &[0.0, 0.7], &still, 0.0),
            [0.0, 0.0],
        );
        near(
            of("friction_above_speed", &[0.2, 0.5], &[0.0; 2], &up, 0.0),
            [0.0, -0.3],
        );
        near(
            of(
                "friction_above_speed",
                &[0.2, 0.5],
                &[0.0; 2],
                &[0.0, -2.0],
                0.0,
            ),
            [0.0, 0.3],
        );
        near(
            of("friction_above_load", &[0.5, 0.3], &[0.0; 2], &up, 0.0),
            [0.0, -0.2],
        );
        let wave = of("friction_wave", &[0.2, 0.1, 3.0], &[0.0, 0.7], &up, 0.0);
        near(wave, [0.0, -(0.2 * 2.1_f64.sin() + 0.1 * 2.1_f64.cos())]);
        let wave = of("time_wave", &[0.2, 0.1, 3.0], &[0.0; 2], &still, 0.7);
        near(wave, [0.0, 0.2 * 2.1_f64.sin() + 0.1 * 2.1_f64.cos()]);
        let (q, phase) = ([0.4, 0.7], 3.0_f64 * (0.7 - 2.0 * 0.4));
        let both = 0.2 * phase.sin() + 0.1 * phase.cos();
        near(
            of("wave_of_two", &[0.2, 0.1, 3.0, -2.0], &q, &still, 0.0),
            [0.0, both],
        );
        near(
            of(
                "wave_of_two_before",
                &[0.2, 0.1, 3.0, -2.0],
                &q,
                &still,
                0.0,
            ),
            [both, 0.0],
        );
        // −k max(q₂ + r q₁ − a, 0) on the second, r times that on the first.
        near(
            of("pull_of_two", &[3.0, 2.0, 0.5], &q, &still, 0.0),
            [-6.0, -3.0],
        );
        near(
            of("pull_of_two", &[3.0, 2.0, 1.6], &q, &still, 0.0),
            [0.0, 0.0],
        );
    }

    #[test]
    fn terms_over_the_time_or_all_inputs_are_no_equations_of_motion() {
        use crate::with_effects::{Obstacle, takes};
        for term in all() {
            let over_time = term.info().class == crate::effect::Class::Time;
            let expected = match term.info().id {
                "supply_sag" => Err(Obstacle::Inputs),
                _ if over_time => Err(Obstacle::Time),
                _ => Ok(()),
            };
            assert_eq!(takes(&*term), expected, "{}", term.info().id);
        }
    }

    #[test]
    fn a_pull_of_two_has_a_potential() {
        // ∂f₁/∂q₂ = ∂f₂/∂q₁.
        let slope = |row: usize, column: usize| {
            let mut q = [Dual64::from(0.4), Dual64::from(0.7)];
            q[column].eps = 1.0;
            let e = [3.0, -0.8, 0.1].map(Dual64::from);
            force(PullOfTwo.dual(), &e, &q, &[Dual64::from(0.0); 2], 0.0)[row].eps
        };
        assert!(slope(0, 1).abs() > 1.0);
        assert!((slope(0, 1) - slope(1, 0)).abs() < 1e-12);
    }
}

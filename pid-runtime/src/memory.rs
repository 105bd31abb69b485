//! Friction with a memory: states that depend on the motion so far.
//!
//! Before two surfaces slide, their contacts yield like springs: the friction follows the
//! displacement since the last reversal and reaches its level over a width. A contact of width δ is
//! a stop operator, `ż = q̇/δ` within −1 ≤ z ≤ 1. It is rate-independent: z follows from the
//! positions alone, without integration over time. Several contacts side by side, `f = Σ c_k z_k`
//! with c_k ≥ 0, make any hysteresis whose first curve levels off, and f is linear in the levels
//! c_k. Over a closed cycle each takes up energy. Sources: W. D. Iwan, J. Appl. Mech. 33, 1966
//! (contacts in parallel); F. Al-Bender, V. Lampaert, J. Swevers, IEEE Trans. Automatic Control 50,
//! 2005 (generalised Maxwell slip).

/// Widths of contacts at revolute joints, rad, and their words in names.
const ROTATION: [(f64, &str); 3] = [(1e-4, "100urad"), (1e-3, "1mrad"), (1e-2, "10mrad")];
/// Widths of contacts at prismatic joints, m, and their words in names.
const TRANSLATION: [(f64, &str); 3] = [(1e-6, "1um"), (1e-5, "10um"), (1e-4, "100um")];

/// Widths of the contacts of a joint, and their words in names.
pub(crate) fn widths(prismatic: bool) -> [(f64, &'static str); 3] {
    match prismatic {
        true => TRANSLATION,
        false => ROTATION,
    }
}

/// The state of one contact.
#[derive(Debug, Clone, PartialEq)]
pub struct Memory {
    /// One joint, or two whose sum a motor turns with.
    pub joints: Vec<usize>,
    /// Displacement from 0 to the full level, rad or m.
    pub width: f64,
}

impl Memory {
    /// z at every sample of positions, row by row with `nq` of them: the mean of those from either
    /// extreme at the start, which are the same once the joint has moved two widths one way.
    pub fn states(&self, q: &[f64], nq: usize) -> Vec<f64> {
        let mut last: Option<f64> = None;
        let (mut low, mut high) = (-1.0_f64, 1.0_f64);
        q.chunks_exact(nq)
            .map(|q| {
                let position: f64 = self.joints.iter().map(|&j| q[j]).sum();
                let moved = (position - last.unwrap_or(position)) / self.width;
                last = Some(position);
                low = (low + moved).clamp(-1.0, 1.0);
                high = (high + moved).clamp(-1.0, 1.0);
                0.5 * (low + high)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn contact(width: f64) -> Memory {
        Memory {
            joints: vec![0],
            width,
        }
    }

    #[test]
    fn a_contact_yields_over_its_width_and_slides_beyond() {
        let q: Vec<f64> = [0.0, 0.5, 5.0, 4.5, 3.0, -5.0, -4.0].to_vec();
        let z = contact(2.0).states(&q, 1);
        // Unknown within its band at first; known after a motion of two widths one way.
        assert_eq!(z[0], 0.0);
        assert_eq!(z[2..], [1.0, 0.75, 0.0, -1.0, -0.5]);
    }

    #[test]
    fn a_motor_of_two_joints_moves_with_their_sum() {
        let q = [0.0, 9.0, 0.1, 0.0, 9.0, 0.3, 0.5, 9.0, 0.1];
        let both = Memory {
            joints: vec![0, 2],
            width: 1.0,
        };
        let sum = [0.1, 0.3, 0.6];
        let (a, b) = (both.states(&q, 3), contact(1.0).states(&sum, 1));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-15));
    }

    proptest! {
        /// The work over any path is at least the change of the stored energy, δ z²/2 (once the
        /// state is known).
        #[test]
        fn no_path_gains_energy(steps in prop::collection::vec(-0.7_f64..0.7, 2..60), width in 0.1_f64..2.0) {
            let mut q = vec![0.0, 5.0];
            for s in &steps {
                q.push(q[q.len() - 1] + s);
            }
            let z = contact(width).states(&q, 1);
            let mut work = 0.0;
            for k in 2..q.len() {
                // z is piecewise linear in q: exact up to its end, and constant there from then on.
                let (d, from) = (q[k] - q[k - 1], z[k - 1]);
                let end = d.signum();
                let yielding = (width * (end - from)).abs().min(d.abs());
                let at = from + end * yielding / width;
                prop_assert!((at - z[k]).abs() < 1e-12);
                work += end * yielding * 0.5 * (from + at) + (d - end * yielding) * end;
                let stored = 0.5 * width * (z[k].powi(2) - z[1].powi(2));
                prop_assert!(work >= stored - 1e-12, "{work} {stored}");
            }
        }

        /// Rate-independent: samples in between change nothing.
        #[test]
        fn samples_in_between_change_nothing(turns in prop::collection::vec(-3.0_f64..3.0, 2..12), parts in 2_usize..9) {
            let fine: Vec<f64> = turns
                .windows(2)
                .flat_map(|w| (0..parts).map(move |k| w[0] + (w[1] - w[0]) * k as f64 / parts as f64))
                .chain(turns.last().copied())
                .collect();
            let coarse = contact(0.8).states(&turns, 1);
            let z = contact(0.8).states(&fine, 1);
            for (k, z_k) in coarse.iter().enumerate() {
                prop_assert!((z[k * parts] - z_k).abs() < 1e-12);
            }
        }
    }
}

use num_dual::Dual64;

use super::*;
use crate::effect::{Commands, Term};
use crate::nominal::Nominal;
use crate::substeps::Substeps;

/// Sample time, s, and samples of the runs.
const H: f64 = 4e-3;
const SAMPLES: usize = 100;

/// Moves a machine on under inputs or targets of each joint at the samples; the links are evaluated at every
/// substep, or held.
fn driven<D: Pick>(
    machine: &mut Machine<'_, D>,
    state: &mut State<D>,
    u: &[Vec<f64>],
    steps: Substeps,
    held: bool,
) {
    let dt = H / steps.number() as f64;
    for k in 0..u[0].len() {
        for i in 0..steps.number() {
            let commands: Vec<Commands<'_>> = u
                .iter()
                .map(|u| Commands {
                    u,
                    h: H,
                    linear: false,
                    begin: 0.0,
                    t: k as f64 * H + i as f64 * dt,
                    dt,
                })
                .collect();
            let links = if held { steps.links(H, i) } else { Some(dt) };
            machine.step(state, &commands, links);
        }
    }
}

/// Link positions of a six-joint arm whose second joint has a gear, after a motion under
/// current; the links are evaluated at every fine substep, or held.
fn run(effect: &str, e: &[f64], refined: usize, held: bool) -> Vec<f64> {
    let wave = |j: usize, k: usize| (0.3 + 0.05 * (k as f64 * (0.2 + 0.1 * j as f64)).sin()) * 9.0;
    let u: Vec<Vec<f64>> = (0..6)
        .map(|j| (0..SAMPLES).map(|k| wave(j, k)).collect())
        .collect();
    under(&u, &[effect], e, refined, held)
}

/// The same under inputs of each joint at the samples.
fn under(u: &[Vec<f64>], effects: &[&str], e: &[f64], refined: usize, held: bool) -> Vec<f64> {
    let text = include_str!("../../robots/ur10e.toml");
    let nominal = Nominal::parse(text, "ur10e.toml".as_ref()).unwrap();
    let term = |id: &&str| Term {
        effect: crate::effects::by_id(id).unwrap(),
        joint: 1,
    };
    let hypothesis = Hypothesis::new(effects.iter().map(term).collect());
    let constants = Constants::new(&nominal, &vec![0.0; nominal.size()]);
    let mut machine = Machine::<f64>::new(constants, &hypothesis, e.to_vec());
    let steps = Substeps::of(&nominal, H, true, refined);
    let mut state = machine.rest(&[0.3, -0.8, 0.9, 0.2, 0.4, 0.1], &[0.0; 6], &[0.0; 6]);
    driven(&mut machine, &mut state, u, steps, held);
    state.q
}

/// Every joint gets less by the inputs of all, as under inputs that are less by hand.
#[test]
fn a_supply_that_sags_takes_from_every_joint() {
    let wave = |j: usize, k: usize| 3.0 - 1.4 * (j as f64 + 0.11 * (j + 1) as f64 * k as f64).sin();
    let u: Vec<Vec<f64>> = (0..6)
        .map(|j| {
            (0..SAMPLES)
                .map(|k| (-1.0_f64).powi(j as i32) * wave(j, k))
                .collect()
        })
        .collect();
    let loss = 0.01;
    let mut less = u.clone();
    for k in 0..SAMPLES {
        let all: f64 = u.iter().map(|u| u[k].abs()).sum();
        for own in &mut less {
            own[k] *= 1.0 - loss * all;
        }
    }
    let sagged = under(&u, &["supply_sag"], &[loss], 1, false);
    let by_hand = under(&less, &["supply_sag"], &[0.0], 1, false);
    assert!(distance(&sagged, &by_hand) < 1e-9, "{sagged:?} {by_hand:?}");
    let full = under(&u, &["supply_sag"], &[0.0], 1, false);
    assert!(distance(&sagged, &full) > 1e-2, "{sagged:?} {full:?}");
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |d, (a, b)| (a - b).abs().max(d))
}

/// A drive that acts late takes back nothing of what others make of its input, whatever their order.
#[test]
fn a_late_input_passes_through_the_others() {
    let wave = |j: usize, k: usize| 3.0 * (0.3 * (j + 1) as f64 + 0.17 * k as f64).sin();
    let u: Vec<Vec<f64>> = (0..6)
        .map(|j| (0..SAMPLES).map(|k| wave(j, k)).collect())
        .collect();
    for (other, e) in [
        ("gain_error_nonlinear", 0.05),
        ("current_offset", 0.8),
        ("actuator_lag", 0.02),
        ("torque_saturation", 1.5),
    ] {
        let late = 2.5 * H;
        let first = under(&u, &["input_delay", other], &[late, e], 1, false);
        let last = under(&u, &[other, "input_delay"], &[e, late], 1, false);
        let apart = distance(&first, &last);
        assert!(apart < 1e-12, "{other}: {apart}");
        // Each of the two counts.
        for (alone, e) in [("input_delay", late), (other, e)] {
            let apart = distance(&first, &under(&u, &[alone], &[e], 1, false));
            assert!(apart > 1e-6, "{other} without {alone}: {apart}");
        }
    }
}

/// One joint sticks below its level of friction and slides beyond it. Two whose matrix is not
/// symmetric, as none of a robot is, have no consistent state: the second slides only while the
/// first sticks, and the first only while the second slides.
#[test]
fn friction_settles_and_what_does_not_is_counted() {
    let text = include_str!("../../robots/ur10e.toml");
    let nominal = Nominal::parse(text, "ur10e.toml".as_ref()).unwrap();
    let nothing = Hypothesis::default();
    let constants = Constants::new(&nominal, &vec![0.0; nominal.size()]);
    let mut machine = Machine::<f64>::new(constants, &nothing, Vec::new());
    machine.levels.fill(Some((0.5, 0.5)));
    machine.matrix[0] = 4.0;
    for (pull, expected) in [(0.4, 0.0), (1.5, 0.25), (-1.5, -0.25)] {
        machine.rhs[0] = pull;
        machine.solve(1);
        assert_eq!((machine.next[0], machine.unsettled), (expected, 0));
    }
    machine.status.fill(0);
    machine.matrix[..4].copy_from_slice(&[2.0, -10.0, 0.0, 2.0]);
    machine.rhs[..2].copy_from_slice(&[0.0, 2.5]);
    machine.solve(2);
    assert_eq!(machine.unsettled, 1);
}

#[test]
fn links_held_over_fine_substeps_keep_the_order_of_the_steps() {
    let spring = [1e-4, 1e-3];
    let exact = run("joint_elasticity", &spring, 32, false);
    let error = |refined: usize| distance(&run("joint_elasticity", &spring, refined, true), &exact);
    let errors = [1, 2, 4].map(error);
    for pair in errors.windows(2) {
        assert!(pair[1] < 0.3 * pair[0], "{errors:?}");
    }
}

#[test]
fn links_held_over_fine_substeps_cost_little_accuracy_in_contacts() {
    let play = [0.01, 1e-4, 1e-3, 0.0];
    let exact = run("backlash", &play, 32, false);
    let error = |held: bool| distance(&run("backlash", &play, 1, held), &exact);
    // In rad; the gap is a thousand times wider.
    let (held, own) = (error(true), error(false));
    assert!(held < 2e-5 && held < 10.0 * own, "{held} {own}");
}

/// A bar that turns about an upright axis without friction, behind a loop; its position after `seconds`
/// towards a target of 0.4 rad from rest at zero.
fn behind(drive: &str, seconds: f64, finer: usize) -> (f64, f64) {
    let text = include_str!("../../tests/pendulum.toml")
        .replace("[0.0, 0.0, -9.81]", "[0.0, 0.0, 0.0]")
        .replace("coulomb = 0.1", "coulomb = 0.0");
    let nominal = Nominal::parse(&(text + drive), "nominal.toml".as_ref()).unwrap();
    let nothing = Hypothesis::default();
    let constants = Constants::new(&nominal, &vec![0.0; nominal.size()]);
    let mut machine = Machine::<f64>::new(constants, &nothing, Vec::new());
    let steps = Substeps::of(&nominal, H, false, finer);
    let samples = (seconds / H).round() as usize;
    let mut state = machine.rest(&[0.0], &[0.0], &[0.4]);
    driven(&mut machine, &mut state, &[vec![0.4; samples]], steps, true);
    (state.q[0], state.v[0])
}

/// Inertia of the bar about its axis and its viscous friction: 1.5 kg at 0.2 m, its own and the rotor's.
const BAR: (f64, f64) = (1.5 * 0.04 + 0.02 + 0.02, 0.08);

#[test]
fn a_pd_loop_answers_as_its_equation_does() {
    let (inertia, viscous) = BAR;
    let drive = "[joint.drive]\nlaw = \"pd\"\nkp = 2.0\nkd = 0.1\n";
    // I a + (f + g kd) v + g kp (q − r) = 0 from rest, underdamped.
    let (stiffness, damping) = (1.8 * 2.0, viscous + 1.8 * 0.1);
    let (decay, square) = (0.5 * damping / inertia, stiffness / inertia);
    let omega = (square - decay * decay).sqrt();
    let exact = |t: f64| {
        let (s, c) = (omega * t).sin_cos();
        0.4 - 0.4 * (-decay * t).exp() * (c + decay / omega * s)
    };
    let error = |finer: usize| (behind(drive, 0.6, finer).0 - exact(0.6)).abs();
    let errors = [1, 2, 4].map(error);
    assert!(errors[0] < 1e-4, "{errors:?}");
    for pair in errors.windows(2) {
        assert!(pair[1] < 0.3 * pair[0], "{errors:?}");
    }
}

#[test]
fn a_loop_far_stiffer_than_the_substeps_stays_at_its_target() {
    // An explicit step stays stable up to kd = 55: 1.8 kd dt / I < 2.
    let drive = "[joint.drive]\nlaw = \"pd\"\nkp = 1e5\nkd = 1e3\n";
    let (q, v) = behind(drive, 1.0, 1);
    assert!((q - 0.4).abs() < 1e-3 && v.abs() < 1e-2, "{q} {v}");
}

#[test]
fn a_limited_loop_brings_its_limit_and_an_integral_removes_the_error() {
    let (inertia, viscous) = BAR;
    let limited = "[joint.drive]\nlaw = \"p\"\nkp = 200.0\nlimit = 0.05\n";
    let (q, _) = behind(limited, 0.4, 1);
    // Under a constant torque: v = w (1 − exp(−t/T)), T = I/f.
    let (time, speed) = (inertia / viscous, 1.8 * 0.05 / viscous);
    let exact = speed * (0.4 - time * (1.0 - (-0.4 / time).exp()));
    assert!((q / exact - 1.0).abs() < 1e-3, "{q} {exact}");
    let pid = "[joint.drive]\nlaw = \"pid\"\nkp = 2.0\nkd = 0.4\nki = 3.0\n";
    let (q, v) = behind(pid, 12.0, 1);
    assert!((q - 0.4).abs() < 1e-4 && v.abs() < 1e-4, "{q} {v}");
}

#[test]
fn a_slow_loop_holds_its_output_between_its_readings() {
    let (inertia, viscous) = BAR;
    // At 25 Hz: every 40 ms, ten samples.
    let drive = "[joint.drive]\nlaw = \"pd\"\nkp = 2.0\nkd = 0.2\nrate_hz = 25.0\n";
    let (mut q, mut v, time) = (0.0, 0.0, inertia / viscous);
    for _ in 0..10 {
        let torque = 1.8 * (2.0 * (0.4 - q) - 0.2 * v);
        let (end, fade) = (torque / viscous, (-0.04 / time).exp());
        q += end * 0.04 + (v - end) * time * (1.0 - fade);
        v = end + (v - end) * fade;
    }
    let (found, _) = behind(drive, 0.4, 1);
    assert!((found - q).abs() < 1e-5, "{found} {q}");
}

/// Gains of the loops and of the motors, and targets, of a slide along the vertical that carries a bar.
const LIFT: ([f64; 2], [f64; 2], [f64; 2]) = ([400.0, 20.0], [2.0, 1.8], [0.05, 0.8]);

/// Its positions after `seconds` from rest at zero on a supply that sags so much per input.
fn lifted<D: Pick>(loss: D, seconds: f64) -> Vec<D> {
    let ([kp, kp_bar], [gain, gain_bar], targets) = LIFT;
    let text = format!(
        "[robot]\nname = \"lift\"\ngravity = [0.0, 0.0, -9.81]\ntool = [0.0, 0.0, -0.3]\ninput_noise = 0.001\n\
         [tolerance]\nmass_rel = 0.05\ncom_abs_m = 0.003\ninertia_rel = 0.05\nrotor_inertia_rel = 0.05\n\
         motor_gain_rel = 0.01\nfriction_rel = 0.4\n\
         [[joint]]\nname = \"slide\"\ntype = \"prismatic\"\naxis = [0.0, 0.0, 1.0]\norigin = [0.0, 0.0, 0.0]\nmass = 2.0\n\
         com = [0.0, 0.0, 0.0]\ninertia = [0.01, 0.01, 0.01, 0.0, 0.0, 0.0]\nrotor_inertia = 0.5\ncoulomb = 0.0\n\
         viscous = 60.0\nmotor_gain = {gain}\ninput = \"current\"\ntorque_peak = 60.0\nvelocity = \"absent\"\n\
         q_noise_std = 1e-4\n[joint.drive]\nlaw = \"p\"\nkp = {kp:?}\n\
         [[joint]]\nname = \"bar\"\ntype = \"revolute\"\naxis = [0.0, 1.0, 0.0]\norigin = [0.0, 0.0, 0.0]\nmass = 1.5\n\
         com = [0.0, 0.0, -0.2]\ninertia = [0.02, 0.02, 0.001, 0.0, 0.0, 0.0]\nrotor_inertia = 0.02\ncoulomb = 0.0\n\
         viscous = 0.8\nmotor_gain = {gain_bar}\ninput = \"current\"\ntorque_peak = 4.5\nvelocity = \"absent\"\n\
         q_noise_std = 1e-4\n[joint.drive]\nlaw = \"p\"\nkp = {kp_bar:?}\n"
    );
    let nominal = Nominal::parse(&text, "nominal.toml".as_ref()).unwrap();
    let sag = Hypothesis::new(vec![Term {
        effect: crate::effects::by_id("supply_sag").unwrap(),
        joint: 0,
    }]);
    let theta = vec![D::nil(); nominal.size()];
    let mut machine = Machine::new(Constants::new(&nominal, &theta), &sag, vec![loss]);
    let steps = Substeps::of(&nominal, H, false, 1);
    let samples = (seconds / H).round() as usize;
    let u = targets.map(|r| vec![r; samples]);
    let mut state = machine.rest(&[0.0; 2], &[0.0; 2], &targets);
    driven(&mut machine, &mut state, &u, steps, true);
    state.q
}

/// At rest each drive holds its weight with what the supply leaves of its loop's output.
#[test]
fn a_supply_that_sags_takes_from_the_outputs_of_loops() {
    let (kp, gain, targets) = LIFT;
    let loss = 0.006;
    let q = lifted(loss, 12.0);
    let u = [0, 1].map(|j| kp[j] * (targets[j] - q[j]));
    let left = 1.0 - loss * (u[0].abs() + u[1].abs());
    let weights = [3.5 * 9.81, 1.5 * 9.81 * 0.2 * q[1].sin()];
    for j in 0..2 {
        let brought = gain[j] * u[j] * left;
        assert!(
            (brought / weights[j] - 1.0).abs() < 1e-6,
            "{brought} {weights:?}"
        );
    }
    assert!(left < 0.9, "{left}");
    // On the way there slopes are those of differences.
    let slopes = lifted(Dual64::new(loss, 1.0), 0.2);
    let [up, down] = [1e-6, -1e-6].map(|step| lifted(loss + step, 0.2));
    for j in 0..2 {
        let difference = (up[j] - down[j]) / 2e-6;
        let apart = (slopes[j].eps - difference).abs();
        assert!(
            apart < 1e-6 * difference.abs(),
            "{} {difference}",
            slopes[j].eps
        );
    }
}

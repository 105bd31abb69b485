use super::*;
use crate::effect::{Commands, Term};
use crate::nominal::Nominal;
use crate::predict::Substeps;

/// Sample time, s, and samples of the runs.
const H: f64 = 4e-3;
const SAMPLES: usize = 100;

/// Link positions of a six-joint arm whose second joint has a gear, after a motion under
/// current; the links are evaluated at every fine substep, or held.
fn run(effect: &str, e: &[f64], refined: usize, held: bool) -> Vec<f64> {
    let text = include_str!("../../robots/ur10e.toml");
    let nominal = Nominal::parse(text, "ur10e.toml".as_ref()).unwrap();
    let n = nominal.n();
    let effect = crate::effects::all()
        .into_iter()
        .find(|x| x.info().id == effect)
        .unwrap();
    let hypothesis = Hypothesis::new(vec![Term { effect, joint: 1 }]);
    let constants = Constants::new(&nominal, &vec![0.0; nominal.size()]);
    let mut machine = Machine::<f64>::new(constants, &hypothesis, e.to_vec());
    let steps = Substeps::new(H, true, refined);
    let dt = H / steps.number() as f64;
    let u: Vec<Vec<f64>> = (0..n)
        .map(|j| {
            let wave = |k: usize| (0.3 + 0.05 * (k as f64 * (0.2 + 0.1 * j as f64)).sin()) * 9.0;
            (0..SAMPLES).map(wave).collect()
        })
        .collect();
    let mut state = machine.rest(&[0.3, -0.8, 0.9, 0.2, 0.4, 0.1], &[0.0; 6], &[0.0; 6]);
    for k in 0..SAMPLES {
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
            machine.step(&mut state, &commands, links);
        }
    }
    state.q
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |d, (a, b)| (a - b).abs().max(d))
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

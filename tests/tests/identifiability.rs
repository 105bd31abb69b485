//! The rank that `robot!` proves against the rank of the sensitivities of simulated trajectories.

use faer::Mat;
use num_dual::{Dual64, DualNum};
use pid_data::InputHold;
use pid_fit::integrate::{self, Drive, Settings};
use pid_models::TwoLink;
use pid_models::two_link::TwoLinkParams;
use pid_runtime::dynamics::Dynamics;
use pid_runtime::generic::GenericDynamics;

const NQ: usize = 2;

/// Currents that move both joints through standstill again and again.
fn currents(t: f64) -> [f64; 2] {
    [
        14.0 * (2.1 * t).sin() + 9.0 * (5.3 * t + 0.4).sin() + 6.0 * (11.7 * t).cos(),
        90.0 * (1.3 * t + 0.2).sin() + 50.0 * (4.1 * t).cos() + 25.0 * (9.1 * t + 1.0).sin(),
    ]
}

/// Derivative of the state by the forward dynamics, over any dual number.
fn flow<D: DualNum<Primitive = f64> + Copy>(u: [f64; NQ], x: &[D; 4], p: &[D]) -> [D; 4] {
    let u = u.map(D::from);
    let mut a = [D::from(0.0); NQ];
    TwoLink
        .vector_field_generic(&x[..NQ], &x[NQ..], &u, p, &mut a)
        .expect("the mass matrix is regular");
    [x[2], x[3], a[0], a[1]]
}

/// States at every tenth step of the classical Runge-Kutta method: what the parameters do to each
/// of its stages passes through the forward dynamics, so its sensitivities have the null space of
/// the continuous ones.
fn trajectory<D: DualNum<Primitive = f64> + Copy>(p: &[D], steps: usize, h: f64) -> Vec<[D; 4]> {
    let add = |x: &[D; 4], k: &[D; 4], c: f64| std::array::from_fn(|i| x[i] + k[i] * c);
    let mut x = [0.3, 0.4, 0.0, 0.0].map(D::from);
    let mut states = Vec::new();
    for step in 0..steps {
        // Inputs are held over a step.
        let u = currents(step as f64 * h);
        let k1 = flow(u, &x, p);
        let k2 = flow(u, &add(&x, &k1, h / 2.0), p);
        let k3 = flow(u, &add(&x, &k2, h / 2.0), p);
        let k4 = flow(u, &add(&x, &k3, h), p);
        x = std::array::from_fn(|i| x[i] + (k1[i] + k2[i] * 2.0 + k3[i] * 2.0 + k4[i]) * (h / 6.0));
        if step % 10 == 9 {
            states.push(x);
        }
    }
    states
}

/// ∂(states)/∂p, column by column.
fn sensitivities(p: &[f64]) -> Vec<Vec<f64>> {
    let (steps, h) = (4000, 1e-3);
    (0..p.len())
        .map(|k| {
            let dual: Vec<Dual64> = p
                .iter()
                .enumerate()
                .map(|(j, &x)| {
                    if j == k {
                        Dual64::from(x).derivative()
                    } else {
                        x.into()
                    }
                })
                .collect();
            let states = trajectory(&dual, steps, h);
            states.iter().flatten().map(|x| x.eps).collect()
        })
        .collect()
}

/// Singular values of ∂(states)/∂p, columns of length one, descending; `held` parameters left out.
fn singular_values(p: &[f64], held: &[usize]) -> Vec<f64> {
    of_columns(&sensitivities(p), held)
}

fn of_columns(all: &[Vec<f64>], held: &[usize]) -> Vec<f64> {
    let columns = all.iter().enumerate().filter(|(k, _)| !held.contains(k));
    let columns: Vec<&[f64]> = columns.map(|(_, column)| column.as_slice()).collect();
    let rows = columns[0].len();
    let length = |c: &[f64]| c.iter().map(|x| x * x).sum::<f64>().sqrt();
    let s = Mat::from_fn(rows, columns.len(), |i, j| {
        let length = length(columns[j]);
        if length > 0.0 {
            columns[j][i] / length
        } else {
            0.0
        }
    });
    s.singular_values().expect("finite sensitivities")
}

/// The rank is where the widest gap lies, which must be wide.
fn rank(singular: &[f64]) -> usize {
    let relative: Vec<f64> = singular
        .iter()
        .map(|s| (s / singular[0]).max(1e-16))
        .collect();
    let (rank, ratio) = (1..relative.len())
        .map(|k| (k, relative[k - 1] / relative[k]))
        .fold((relative.len(), 1.0), |best, next| {
            if next.1 > best.1 { next } else { best }
        });
    assert!(ratio > 1e4, "no gap in {relative:?}");
    rank
}

#[test]
fn the_trajectories_of_the_papers_robot_have_the_rank_that_the_macro_proves() {
    let found = TwoLink.identifiability().expect("generated models know it");
    assert_eq!((TwoLink::RANK, TwoLink::RANK_NOMINAL), (14, 13));
    assert_eq!(
        (found.all.params, found.all.generic, found.all.nominal),
        (19, 14, 13)
    );

    let nominal = TwoLinkParams::nominal();
    // Away from the symmetric values, with centres of mass off the axes.
    let generic = TwoLinkParams {
        sx1: 0.05,
        sy1: -0.04,
        sx2: 0.03,
        sy2: 0.06,
        ix2: 0.9,
        sharp_shoulder: 20.0,
        sharp_elbow: 15.0,
        ..nominal
    };
    assert_eq!(
        rank(&singular_values(&generic.as_array(), &[])),
        found.all.generic
    );
    assert_eq!(
        rank(&singular_values(&nominal.as_array(), &[])),
        found.all.nominal
    );
}

#[test]
fn known_gains_take_one_direction_away() {
    let gains: Vec<usize> = TwoLink
        .params()
        .iter()
        .enumerate()
        .filter(|(_, param)| param.name.starts_with("gain"))
        .map(|(k, _)| k)
        .collect();
    assert_eq!(gains.len(), 2);
    let p = TwoLinkParams {
        sx1: 0.05,
        sy1: -0.04,
        sx2: 0.03,
        sy2: 0.06,
        ix2: 0.9,
        ..TwoLinkParams::nominal()
    };
    assert_eq!(rank(&singular_values(&p.as_array(), &gains)), 13);
    assert_eq!(
        rank(&singular_values(
            &TwoLinkParams::nominal().as_array(),
            &gains
        )),
        12
    );
}

/// Each parameter in turn marked `fixed`: the rank of what is left, and whether the mark removes a
/// lost direction.
#[test]
fn each_parameter_known_leaves_the_rank_that_the_declaration_with_fixed_has() {
    let source = std::fs::read_to_string("../models/src/two_link.rs").expect("beside this crate");
    let p = TwoLinkParams {
        sx1: 0.05,
        sy1: -0.04,
        sx2: 0.03,
        sy2: 0.06,
        ix2: 0.9,
        sharp_shoulder: 20.0,
        sharp_elbow: 15.0,
        ..TwoLinkParams::nominal()
    };
    let columns = sensitivities(&p.as_array());
    let mut robot = pid_codegen::robots(declaration(&source)).expect("the model is accepted");
    let mut kept = 0;
    for k in 0..TwoLink::NP {
        for (j, param) in robot[0].params.iter_mut().enumerate() {
            param.fixed = j == k;
        }
        let found = pid_derive::identifiability(&robot[0]).expect("it can be derived");
        let expected = found.free.generic.rank;
        assert_eq!(found.free.generic.params.len(), TwoLink::NP - 1);
        let name = &robot[0].params[k].name;
        assert_eq!(
            rank(&of_columns(&columns, &[k])),
            expected,
            "`{name}` known"
        );
        kept += usize::from(expected == TwoLink::RANK);
    }
    // All but sharpness and centre of mass of link 2 can be traded against others: knowing one costs no rank.
    let own = TwoLink::NP - kept;
    let alone = ["sx2", "sy2", "sz2", "sharp_shoulder", "sharp_elbow"];
    assert_eq!(own, alone.len());
}

/// The contents of `robot! { … }`.
fn declaration(source: &str) -> proc_macro2::TokenStream {
    let start = source.find("robot! {").expect("a declaration") + "robot! {".len();
    let end = start + source[start..].find("\n}\n").expect("its end");
    source[start..end].parse().expect("tokens")
}

#[test]
fn the_trajectory_is_the_one_that_the_simulation_gives() {
    let p = TwoLinkParams::nominal().as_array();
    let (steps, h) = (1000_u32, 1e-3);
    let t: Vec<f64> = (0..=steps).map(|k| f64::from(k) * h).collect();
    let u: Vec<f64> = t.iter().flat_map(|&t| currents(t)).collect();
    let drive = Drive {
        t: &t,
        u: &u,
        hold: InputHold::ZeroOrder,
    };
    let (q0, v0) = ([0.3, 0.4], [0.0, 0.0]);
    let simulated = integrate::simulate(&TwoLink, &p, &q0, &v0, &drive, Settings::default())
        .expect("the motion can be simulated");
    let ours = trajectory(&p, steps as usize, h);
    let last = ours.last().expect("there are steps");
    let end = steps as usize * NQ;
    let expected = [&simulated.q[end..], &simulated.v[end..]].concat();
    for (x, y) in last.iter().zip(&expected) {
        assert!(
            (x - y).abs() < 1e-6 * (1.0 + y.abs()),
            "{last:?} for {expected:?}"
        );
    }
}

use super::*;
use crate::nlp::SparsePattern;
use crate::solver::kkt::layout::Layout;
use crate::solver::kkt::ldl::SparseLdl;
use crate::solver::kkt::sparse::SparseKkt;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Deterministic numbers in [-1, 1).
struct Numbers(ChaCha8Rng);

impl Numbers {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn next(&mut self) -> f64 {
        self.0.random_range(-1.0..1.0)
    }
}

/// Dense steps, but for `kinematic` leading rows without parameters that have one component of the
/// next state each.
fn layout(
    (nx, ny, np): (usize, usize, usize),
    kinematic: usize,
    steps: &[usize],
    held: bool,
) -> Layout {
    let width = (nx + ny + np) as u32;
    let first_p = (nx + ny) as u32;
    Layout {
        nx,
        ny,
        np,
        windows: Layout::windows(nx, ny, steps, held),
        step_jacobian: (0..ny as u32)
            .flat_map(|r| (0..width).map(move |c| (r as usize, c as usize)))
            .filter(|&(r, c)| {
                let own = c < nx || c >= ny + kinematic || c < ny || c - ny == r;
                r >= kinematic || own && c < nx + ny
            })
            .map(|(r, c)| (r as u32, c as u32))
            .collect(),
        step_hessian: (0..width)
            .flat_map(|r| (0..=r.min(first_p - 1)).map(move |c| (r, c)))
            .collect(),
        parameter_hessian: (0..np as u32)
            .flat_map(|r| (0..=r).map(move |c| (r, c)))
            .collect(),
    }
}

/// `‖b − K s‖∞ / (‖K‖∞ ‖s‖∞ + ‖b‖∞)` for a solution s of the system with right-hand side b (J. L.
/// Rigal, J. Gaches, J. ACM 14 (1967)).
fn backward_error(
    (hessian, jacobian): &(SparsePattern, SparsePattern),
    values: KktValues<'_>,
    fixed: &[bool],
    (rx, rc): (&[f64], &[f64]),
    (dx, dl): (&[f64], &[f64]),
) -> f64 {
    let (n, m) = (rx.len(), rc.len());
    let (mut top, mut bottom) = (vec![0.0; n], vec![0.0; m]);
    hessian.symmetric_multiply_add(values.hessian, dx, &mut top);
    jacobian.transpose_multiply_add(values.jacobian, dl, &mut top);
    jacobian.multiply_add(values.jacobian, dx, &mut bottom);
    // Row sums of absolute values.
    let mut sums: Vec<f64> = values.sigma.to_vec();
    sums.resize(n + m, 0.0);
    for ((&i, &j), a) in hessian.rows.iter().zip(&hessian.cols).zip(values.hessian) {
        sums[i as usize] += a.abs();
        if i != j {
            sums[j as usize] += a.abs();
        }
    }
    for ((&i, &j), a) in jacobian
        .rows
        .iter()
        .zip(&jacobian.cols)
        .zip(values.jacobian)
    {
        sums[n + i as usize] += a.abs();
        sums[j as usize] += a.abs();
    }
    let free = (0..n).filter(|i| !fixed[*i]);
    let rows = free.map(|i| rx[i] - top[i] - values.sigma[i] * dx[i]);
    let rows = rows.chain((0..m).map(|i| rc[i] - bottom[i]));
    let residual = rows.fold(0.0_f64, |a, r| a.max(r.abs()));
    let largest = |v: &[f64]| v.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    let size = largest(dx).max(largest(dl));
    residual / (largest(&sums) * size + largest(rx).max(largest(rc)))
}

/// Solves random systems of the structure and holds the solution against the matrix itself.
fn check(
    (nx, ny, np): (usize, usize, usize),
    kinematic: usize,
    steps: &[usize],
    held: bool,
    growth: f64,
    tolerance: f64,
) -> StructuredKkt {
    let layout = layout((nx, ny, np), kinematic, steps, held);
    let mut numbers = Numbers::new(nx as u64 * 31 + np as u64 + steps[0] as u64);
    let (n, m) = (layout.n(), layout.m());
    let fixed: Vec<bool> = (0..np).map(|j| j == 1).collect();
    let mut jacobian = Vec::new();
    for _ in 0..layout.steps() {
        for &(r, c) in &layout.step_jacobian {
            let (r, c) = (r as usize, c as usize);
            // y = growth * x + small coupling The rows of a step are rotated, so that its
            // factorization has to pivot; kinematic ones stand first and meet the first components
            // of the next state.
            let ns = ny - nx;
            let r = match r.checked_sub(kinematic) {
                Some(rest) => match (rest + 2) % (ny - kinematic) {
                    stage if stage < ns => stage,
                    core => core + kinematic,
                },
                None => ns + r,
            };
            let base = if c >= nx && c < nx + ny {
                if c - nx == r {
                    -1.0
                } else {
                    0.02 * numbers.next()
                }
            } else if c < nx {
                if r >= ny - nx && c == r - (ny - nx) {
                    growth
                } else {
                    0.02 * numbers.next()
                }
            } else {
                0.3 * numbers.next()
            };
            jacobian.push(base);
        }
    }
    let mut hessian = Vec::new();
    for _ in 0..layout.node_values() {
        hessian.push(0.02 * numbers.next());
    }
    hessian.resize(hessian.len() + layout.nodes() * nx, 1.0);
    for &(r, c) in &layout.parameter_hessian {
        hessian.push(if r == c { 3.0 } else { 0.1 * numbers.next() });
    }
    let sigma: Vec<f64> = (0..n).map(|_| 0.01 + 0.01 * numbers.next().abs()).collect();
    let mut kkt = StructuredKkt::new(layout.clone(), &fixed, 7);
    let info = kkt
        .factorise(KktValues {
            hessian: &hessian,
            jacobian: &jacobian,
            sigma: &sigma,
        })
        .expect("factorises");
    let held_var = |i: usize| {
        (i >= layout.p() && fixed[i - layout.p()])
            || held && layout.windows.iter().any(|w| (w.x..w.x + nx).contains(&i))
    };
    let truth: Vec<f64> = (0..n)
        .map(|i| if held_var(i) { 0.0 } else { numbers.next() })
        .collect();
    let multipliers: Vec<f64> = (0..m).map(|_| numbers.next()).collect();
    let (mut rx, mut rc) = (vec![0.0; n], vec![0.0; m]);
    layout
        .hessian_pattern()
        .symmetric_multiply_add(&hessian, &truth, &mut rx);
    layout
        .jacobian_pattern()
        .transpose_multiply_add(&jacobian, &multipliers, &mut rx);
    layout
        .jacobian_pattern()
        .multiply_add(&jacobian, &truth, &mut rc);
    for i in 0..n {
        rx[i] += sigma[i] * truth[i];
    }
    assert_eq!(
        (info.delta_x, info.shift),
        (0.0, 0.0),
        "convex problem needs no regularisation"
    );
    let (mut dx, mut dl) = (vec![0.0; n], vec![0.0; m]);
    let relative = kkt.solve(&rx, &rc, &mut dx, &mut dl);
    assert!(relative < 1e-11, "residual {relative:e}");

    // The whole matrix by another factorization: both solutions are exact for a matrix near the given one.
    let fixed: Vec<bool> = (0..n).map(held_var).collect();
    let patterns = (layout.hessian_pattern(), layout.jacobian_pattern());
    let mut whole = SparseKkt::of(n, m, &patterns.0, &patterns.1, &fixed);
    let values = KktValues {
        hessian: &hessian,
        jacobian: &jacobian,
        sigma: &sigma,
    };
    let info = whole.factorise(values).expect("factorises");
    assert_eq!((info.delta_x, info.delta_c), (0.0, 0.0));
    let (mut other_x, mut other_l) = (vec![0.0; n], vec![0.0; m]);
    whole.solve(&rx, &rc, &mut other_x, &mut other_l);
    for (name, x, l) in [("structured", &dx, &dl), ("sparse", &other_x, &other_l)] {
        let error = backward_error(&patterns, values, &fixed, (&rx, &rc), (x, l));
        assert!(error < 1e-12, "{name}: backward error {error:e}");
    }

    for i in 0..n {
        assert!(
            (dx[i] - truth[i]).abs() < tolerance,
            "x[{i}]: {} {}",
            dx[i],
            truth[i]
        );
    }
    for i in 0..m {
        assert!(
            (dl[i] - multipliers[i]).abs() < tolerance,
            "λ[{i}]: {} {}",
            dl[i],
            multipliers[i]
        );
    }
    kkt
}

#[test]
fn one_window_without_stages() {
    check((4, 4, 5), 0, &[50], false, 1.0, 1e-9);
}

#[test]
fn stage_variables_and_several_windows() {
    check((4, 6, 3), 0, &[13, 1, 40], false, 0.98, 1e-9);
}

#[test]
fn kinematic_rows_are_substituted() {
    for (sizes, kinematic) in [
        ((4, 4, 5), 2),
        ((4, 6, 3), 2),
        ((4, 6, 3), 3),
        ((2, 2, 4), 2),
        ((6, 9, 0), 3),
    ] {
        let plan = plan::Plan::new(
            &layout(sizes, kinematic, &[3], false),
            &(0..sizes.2 as u32).map(Some).collect::<Vec<_>>(),
            sizes.2,
        );
        assert!(plan.sizes.ne >= kinematic, "{sizes:?}: {}", plan.sizes.ne);
        check(sizes, kinematic, &[23, 1, 8], false, 0.98, 1e-9);
        check(sizes, kinematic, &[40], true, 1.05, 1e-8);
    }
}

#[test]
fn held_initial_states() {
    check((2, 2, 3), 0, &[9, 21], true, 1.0, 1e-9);
}

#[test]
fn unstable_plant_over_a_long_horizon() {
    // 1.1^600 = 7e24: a condensing over the whole horizon has no correct digit.
    check((2, 2, 3), 0, &[600], false, 1.1, 1e-6);
}

/// 60⁷ = 3e12: over a segment of seven steps no digit of the condensed cost is left, over four
/// enough of them.
#[test]
fn states_that_grow_much_over_a_step_make_segments_short() {
    let kkt = check((2, 2, 3), 0, &[60, 5], false, 60.0, 1e-6);
    assert!(kkt.steps < 7 && kkt.next < 7, "{} steps", kkt.steps);
}

#[test]
fn segments_are_long_again_once_states_grow_little() {
    let layout = layout((2, 2, 0), 0, &[60], false);
    let mut hessian = vec![0.0; layout.node_values()];
    hessian.extend(vec![1.0; layout.nodes() * 2]);
    let sigma = vec![0.0; layout.n()];
    let mut kkt = StructuredKkt::new(layout.clone(), &[], 10);
    for (growth, steps) in [(1.0, 10), (100.0, 1), (1.0, 1), (1.0, 10)] {
        let step = layout.step_jacobian.iter().map(|&(r, c)| match c {
            c if c == r => growth,
            c if c == r + 2 => -1.0,
            _ => 0.0,
        });
        let jacobian: Vec<f64> = (0..layout.steps()).flat_map(|_| step.clone()).collect();
        kkt.factorise(KktValues {
            hessian: &hessian,
            jacobian: &jacobian,
            sigma: &sigma,
        })
        .expect("factorises");
        assert_eq!(kkt.steps, steps, "after growth by {growth} a step");
    }
}

/// States of curvature 1e10 give links a compliance below the static regularisation. Near the
/// solution of a long record it shrinks with the compliance, and the defects are closed; far from
/// it they are closed in part.
#[test]
fn stiff_links_close_their_defects_near_the_solution() {
    let layout = layout((1, 1, 0), 0, &[LONG], false);
    let step = layout.step_jacobian.iter();
    let step = step.map(|&(r, c)| if c == r { 1.0 } else { -1.0 });
    let jacobian: Vec<f64> = (0..layout.steps()).flat_map(|_| step.clone()).collect();
    let mut hessian = vec![0.0; layout.node_values()];
    hessian.extend(vec![1e10; layout.nodes()]);
    let (n, m) = (layout.n(), layout.m());
    let values = KktValues {
        hessian: &hessian,
        jacobian: &jacobian,
        sigma: &vec![0.0; n],
    };
    let mut kkt = StructuredKkt::new(layout, &[], 10);
    let mut numbers = Numbers::new(5);
    let rc: Vec<f64> = (0..m).map(|_| numbers.next()).collect();
    let mut left = |error: f64| {
        kkt.expect_error(error);
        kkt.factorise(values).expect("factorises");
        let (mut dx, mut dl) = (vec![0.0; n], vec![0.0; m]);
        kkt.solve(&vec![0.0; n], &rc, &mut dx, &mut dl);
        let defects = rc.iter().zip(dx.windows(2));
        let open = defects.map(|(c, x)| (c - (x[0] - x[1])).abs());
        open.fold(0.0_f64, f64::max)
    };
    let (near, far) = (left(1e-3), left(10.0));
    assert!(near < 1e-12, "{near:e} left open");
    assert!(far > 1e-3, "{far:e} left open");
}

/// The reduced Hessian carries errors of three times its size in two directions. Refinement makes
/// the solution worse; conjugate residuals need one direction more than there are errors.
#[test]
fn conjugate_residuals_get_over_errors_of_the_reduced_hessian() {
    let (layout, fixed) = (layout((2, 2, 5), 0, &[30], false), [false; 5]);
    let mut numbers = Numbers::new(3);
    let jacobian: Vec<f64> = (0..layout.steps())
        .flat_map(|_| &layout.step_jacobian)
        .map(|&(r, c)| match c {
            c if c == r => 0.9,
            c if c == r + 2 => -1.0,
            _ => 0.3 * numbers.next(),
        })
        .collect();
    let mut hessian = vec![0.0; layout.node_values()];
    hessian.extend(vec![1.0; layout.nodes() * 2]);
    hessian.extend(
        layout
            .parameter_hessian
            .iter()
            .map(|(r, c)| f64::from(u8::from(r == c))),
    );
    let sigma = vec![0.01; layout.n()];
    let values = KktValues {
        hessian: &hessian,
        jacobian: &jacobian,
        sigma: &sigma,
    };
    let mut kkt = StructuredKkt::new(layout.clone(), &fixed, 10);
    kkt.factorise(values).expect("factorises");
    // The right-hand side changes, the factorization does not.
    let mut other = hessian.clone();
    let own = layout.node_values() + layout.nodes() * 2;
    for (i, v) in [(0, 4.0), (3, -0.5)] {
        let size = kkt.reduced.hessian[(i, i)];
        kkt.reduced.modification[(i, i)] += v * size;
        let at = layout
            .parameter_hessian
            .iter()
            .position(|&e| e == (i as u32, i as u32));
        other[own + at.expect("a diagonal entry")] += v * size;
    }
    let (n, m) = (layout.n(), layout.m());
    let rx: Vec<f64> = (0..n).map(|_| numbers.next()).collect();
    let rc: Vec<f64> = (0..m).map(|_| numbers.next()).collect();
    let (mut dx, mut dl) = (vec![0.0; n], vec![0.0; m]);
    let refined = kkt.refine(&rx, &rc, &mut dx, &mut dl);
    assert!(refined > 0.1, "refinement alone leaves {refined:e}");
    let left = kkt.conjugate(&rx, &rc, &mut dx, &mut dl);
    assert!(left < 1e-10, "{left:e}");
    let patterns = (layout.hessian_pattern(), layout.jacobian_pattern());
    let changed = KktValues {
        hessian: &other,
        ..values
    };
    let error = backward_error(&patterns, changed, &vec![false; n], (&rx, &rc), (&dx, &dl));
    assert!(error < 1e-11, "backward error {error:e}");
}

#[test]
fn negative_curvature_in_a_parameter_is_reflected() {
    let layout = layout((2, 2, 3), 0, &[30], false);
    let fixed = [false; 3];
    let jacobian: Vec<f64> = (0..layout.steps())
        .flat_map(|_| layout.step_jacobian.clone())
        .map(|(r, c)| match c {
            c if c == r => 1.0,
            c if c == r + 2 => -1.0,
            c if c >= 4 => 1e-3,
            _ => 0.0,
        })
        .collect();
    let mut hessian = vec![0.0; layout.node_values()];
    hessian.extend(vec![1.0; layout.nodes() * 2]);
    for &(r, c) in &layout.parameter_hessian {
        hessian.push(if r == c {
            [5.0, -5.0, 5.0][r as usize]
        } else {
            0.0
        });
    }
    let sigma = vec![0.0; layout.n()];
    let mut kkt = StructuredKkt::new(layout.clone(), &fixed, 10);
    let info = kkt
        .factorise(KktValues {
            hessian: &hessian,
            jacobian: &jacobian,
            sigma: &sigma,
        })
        .expect("factorises");
    assert!(
        info.shift > 9.0 && info.shift < 11.0,
        "shift {}",
        info.shift
    );
    let (n, m) = (layout.n(), layout.m());
    let rx: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
    let (mut dx, mut dl) = (vec![0.0; n], vec![0.0; m]);
    kkt.solve(&rx, &vec![0.0; m], &mut dx, &mut dl);
    let slope: f64 = dx.iter().zip(&rx).map(|(a, b)| a * b).sum();
    assert!(slope > 0.0, "the step is not a descent direction: {slope}");

    // Inertia of the whole regularised matrix, by an independent factorization.
    let mut triplets: Vec<(u32, u32)> = Vec::new();
    let (h, j) = (layout.hessian_pattern(), layout.jacobian_pattern());
    triplets.extend(h.rows.iter().zip(&h.cols).map(|(&r, &c)| (r, c)));
    triplets.extend(j.rows.iter().zip(&j.cols).map(|(&r, &c)| (n as u32 + r, c)));
    let mut ldl = SparseLdl::new(n + m, &triplets);
    for (k, v) in hessian.iter().chain(&jacobian).enumerate() {
        ldl.add(k, *v);
    }
    (n..n + m).for_each(|i| ldl.add_diagonal(i, -1e-9));
    assert_eq!(
        ldl.factorise().negative,
        m + 1,
        "the unmodified matrix has one eigenvalue too many"
    );
}

/// The limit holds for the norm in the parameters; the solution is that of the matrix with raised
/// eigenvalues, and descends.
#[test]
fn limited_steps_solve_the_lifted_system() {
    let layout = layout((2, 2, 3), 0, &[30, 7], false);
    let mut numbers = Numbers::new(11);
    let jacobian: Vec<f64> = (0..layout.steps())
        .flat_map(|_| layout.step_jacobian.clone())
        .map(|(r, c)| match c {
            c if c == r => 1.0,
            c if c == r + 2 => -1.0,
            c if c >= 4 => 0.05 * numbers.next(),
            _ => 0.0,
        })
        .collect();
    let mut hessian = vec![0.0; layout.node_values()];
    hessian.extend(vec![1.0; layout.nodes() * 2]);
    for &(r, c) in &layout.parameter_hessian {
        hessian.push(if r == c {
            [5.0, -5.0, 1e-3][r as usize]
        } else {
            0.0
        });
    }
    let (n, m, p) = (layout.n(), layout.m(), layout.p());
    let sigma = vec![0.0; n];
    let mut kkt = StructuredKkt::new(layout, &[false; 3], 10);
    kkt.factorise(KktValues {
        hessian: &hessian,
        jacobian: &jacobian,
        sigma: &sigma,
    })
    .expect("factorises");
    let rx: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
    let (mut dx, mut dl, rc) = (vec![0.0; n], vec![0.0; m], vec![0.0; m]);
    assert_eq!(kkt.limit(1.0), None, "nothing is solved for yet");
    kkt.solve(&rx, &rc, &mut dx, &mut dl);
    let norm = |dx: &[f64]| dx[p..].iter().map(|d| d * d).sum::<f64>().sqrt();
    let free = norm(&dx);
    for share in [0.5, 0.1, 1e-3] {
        let radius = share * free;
        let before = kkt.limit(radius).expect("a solution is at hand");
        assert!(
            (before - norm(&dx)).abs() <= 1e-6 * before,
            "{before} for {}",
            norm(&dx)
        );
        let relative = kkt.solve(&rx, &rc, &mut dx, &mut dl);
        let found = norm(&dx);
        assert!(relative < 1e-10, "residual {relative:e}");
        assert!(
            found <= radius * (1.0 + 1e-6) && found > 0.8 * radius,
            "{found} for {radius}"
        );
        let slope: f64 = dx.iter().zip(&rx).map(|(a, b)| a * b).sum();
        assert!(slope > 0.0, "the step is not a descent direction: {slope}");
    }
}

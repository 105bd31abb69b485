//! Known problems with published optima (W. Hock, K. Schittkowski, Test Examples for Nonlinear
//! Programming Codes, 1981), exact derivatives by hyper-dual numbers.

use super::*;
use crate::nlp::{SparsePattern, check_point};
use crate::solver::kkt::sparse::SparseKkt;
use crate::solver::{Barrier, Interrupt, Oracle};
use num_dual::{DualNum, HyperDual64};

trait Formula {
    const N: usize;
    const M: usize;
    fn bounds(j: usize) -> (f64, f64);
    fn range(_: usize) -> (f64, f64) {
        (0.0, 0.0)
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D;
    fn constraint<D: DualNum<Primitive = f64> + Copy>(i: usize, x: &[D]) -> D;
}

struct Dense<F> {
    jacobian: SparsePattern,
    hessian: SparsePattern,
    formula: std::marker::PhantomData<F>,
}

impl<F: Formula> Dense<F> {
    fn new() -> Self {
        let (mut jacobian, mut hessian) = (SparsePattern::default(), SparsePattern::default());
        (0..F::M).for_each(|i| (0..F::N).for_each(|j| jacobian.push(i, j)));
        (0..F::N).for_each(|i| (0..=i).for_each(|j| hessian.push(i, j)));
        Self {
            jacobian,
            hessian,
            formula: std::marker::PhantomData,
        }
    }

    fn seeded(x: &[f64], i: usize, j: usize) -> Vec<HyperDual64> {
        x.iter()
            .enumerate()
            .map(|(k, &v)| {
                HyperDual64::new(
                    v,
                    f64::from(u8::from(k == i)),
                    f64::from(u8::from(k == j)),
                    0.0,
                )
            })
            .collect()
    }
}

impl<F: Formula> Nlp for Dense<F> {
    fn n(&self) -> usize {
        F::N
    }
    fn m(&self) -> usize {
        F::M
    }
    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        for j in 0..F::N {
            (lower[j], upper[j]) = F::bounds(j);
        }
    }
    fn constraint_bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        for i in 0..F::M {
            (lower[i], upper[i]) = F::range(i);
        }
    }
    fn objective(&mut self, x: &[f64]) -> f64 {
        F::objective(x)
    }
    fn gradient(&mut self, x: &[f64], gradient: &mut [f64]) {
        for j in 0..F::N {
            gradient[j] = F::objective(&Self::seeded(x, j, j)).eps1;
        }
    }
    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        (0..F::M).for_each(|i| c[i] = F::constraint(i, x));
    }
    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian
    }
    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        for i in 0..F::M {
            for j in 0..F::N {
                values[i * F::N + j] = F::constraint(i, &Self::seeded(x, j, j)).eps1;
            }
        }
    }
    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian
    }
    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        let mut k = 0;
        for i in 0..F::N {
            for j in 0..=i {
                let z = Self::seeded(x, i, j);
                values[k] = sigma * F::objective(&z).eps1eps2;
                for (c, l) in lambda.iter().enumerate() {
                    values[k] += l * F::constraint(c, &z).eps1eps2;
                }
                k += 1;
            }
        }
    }
}

fn run<F: Formula>(x0: &[f64], settings: &Settings) -> (Solution, crate::nlp::PointCheck) {
    let mut problem = Dense::<F>::new();
    let mut kkt = SparseKkt::new(&problem);
    let solution = solve(&mut problem, &mut kkt, x0, settings, &mut |_, _| {
        ControlFlow::Continue(())
    });
    let check = check_point(&mut problem, &solution.x, &solution.lambda);
    (solution, check)
}

fn solves<F: Formula>(x0: &[f64], optimum: f64) -> Solution {
    let (solution, check) = run::<F>(x0, &Settings::default());
    assert_eq!(
        solution.status,
        Status::Solved,
        "{:#?}",
        solution.log.last()
    );
    assert!(
        (solution.objective - optimum).abs() < 1e-6 * optimum.abs().max(1.0),
        "{} instead of {optimum}",
        solution.objective
    );
    assert!(
        check.finite && check.primal_inf < 1e-7 && check.dual_inf < 1e-6,
        "{check:?}"
    );
    solution
}

const FREE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

/// HS6: a curved equality.
struct Hs6;
impl Formula for Hs6 {
    const N: usize = 2;
    const M: usize = 1;
    fn bounds(_: usize) -> (f64, f64) {
        FREE
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        (x[0] - 1.0).powi(2)
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(_: usize, x: &[D]) -> D {
        (x[1] - x[0] * x[0]) * 10.0
    }
}

/// HS7.
struct Hs7;
impl Formula for Hs7 {
    const N: usize = 2;
    const M: usize = 1;
    fn bounds(_: usize) -> (f64, f64) {
        FREE
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        (x[0] * x[0] + 1.0).ln() - x[1]
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(_: usize, x: &[D]) -> D {
        (x[0] * x[0] + 1.0).powi(2) + x[1] * x[1] - 4.0
    }
}

/// HS1: Rosenbrock's function with a bound.
struct Hs1;
impl Formula for Hs1 {
    const N: usize = 2;
    const M: usize = 0;
    fn bounds(j: usize) -> (f64, f64) {
        if j == 1 { (-1.5, f64::INFINITY) } else { FREE }
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        (x[1] - x[0] * x[0]).powi(2) * 100.0 + (-x[0] + 1.0).powi(2)
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(_: usize, x: &[D]) -> D {
        x[0]
    }
}

/// HS71 with its inequality as a range.
struct Hs71;
impl Formula for Hs71 {
    const N: usize = 4;
    const M: usize = 2;
    fn bounds(_: usize) -> (f64, f64) {
        (1.0, 5.0)
    }
    fn range(i: usize) -> (f64, f64) {
        [(25.0, f64::INFINITY), (40.0, 40.0)][i]
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2]
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(i: usize, x: &[D]) -> D {
        if i == 0 {
            x[0] * x[1] * x[2] * x[3]
        } else {
            x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3]
        }
    }
}

/// A plane, its equation three times, a row without bounds; the distance to the origin.
struct Redundant;
impl Formula for Redundant {
    const N: usize = 3;
    const M: usize = 4;
    fn bounds(_: usize) -> (f64, f64) {
        FREE
    }
    fn range(i: usize) -> (f64, f64) {
        if i == 3 { FREE } else { (0.0, 0.0) }
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(i: usize, x: &[D]) -> D {
        match i {
            0 => x[0] + x[1] + x[2] - 3.0,
            1 => (x[0] + x[1] + x[2] - 3.0) * 2.0,
            2 => x[0] - x[1] + (x[1] * 2.0 + x[2] - 3.0),
            _ => x[0].exp() * 50.0,
        }
    }
}

/// The constraint's gradient vanishes at the only feasible point of its variable: no multiplier exists.
struct NoMultiplier;
impl Formula for NoMultiplier {
    const N: usize = 2;
    const M: usize = 1;
    fn bounds(_: usize) -> (f64, f64) {
        FREE
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        x[0] + (x[1] - 1.0).powi(2)
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(_: usize, x: &[D]) -> D {
        x[0] * x[0]
    }
}

/// A line that falls without end inside its only constraint.
struct Falling;
impl Formula for Falling {
    const N: usize = 2;
    const M: usize = 1;
    fn bounds(j: usize) -> (f64, f64) {
        if j == 0 { (0.0, f64::INFINITY) } else { FREE }
    }
    fn range(_: usize) -> (f64, f64) {
        (f64::NEG_INFINITY, 1.0)
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        -x[0]
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(_: usize, x: &[D]) -> D {
        x[1] * x[1] - x[0]
    }
}

/// Held variables only; the row holds where `x₁ x₂ = 6`.
struct Held<const SECOND: u32>;
impl<const SECOND: u32> Formula for Held<SECOND> {
    const N: usize = 2;
    const M: usize = 1;
    fn bounds(j: usize) -> (f64, f64) {
        let value = [2.0, f64::from(SECOND)][j];
        (value, value)
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        x[0] + x[1]
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(_: usize, x: &[D]) -> D {
        x[0] * x[1] - 6.0
    }
}

/// Two half planes that do not meet.
struct Apart;
impl Formula for Apart {
    const N: usize = 2;
    const M: usize = 2;
    fn bounds(_: usize) -> (f64, f64) {
        FREE
    }
    fn range(i: usize) -> (f64, f64) {
        [(1.0, f64::INFINITY), (f64::NEG_INFINITY, -1.0)][i]
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        (x[0] - 3.0).powi(2) + x[1].powi(2)
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(_: usize, x: &[D]) -> D {
        x[0] + x[1]
    }
}

/// No point of the line is on the circle.
struct Infeasible;
impl Formula for Infeasible {
    const N: usize = 2;
    const M: usize = 1;
    fn bounds(_: usize) -> (f64, f64) {
        FREE
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        x[0]
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(_: usize, x: &[D]) -> D {
        x[0] * x[0] + x[1] * x[1] + 1.0
    }
}

/// Its value carries the error of an iterative evaluation, which its derivatives do not have.
struct Rough;
impl Formula for Rough {
    const N: usize = 2;
    const M: usize = 0;
    fn bounds(_: usize) -> (f64, f64) {
        FREE
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        let error = 1e-12 * (1e15 * (x[0].re() + x[1].re())).sin();
        let d = x[0] - x[1];
        (x[0].exp() - x[0] + d * d + d * d * d * 0.1) * 50.0 + error
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(_: usize, _: &[D]) -> D {
        unreachable!("no constraints")
    }
}

/// Its row carries an error far above the tolerance asked for, as sums over long records do.
struct RoughRow;
impl Formula for RoughRow {
    const N: usize = 2;
    const M: usize = 1;
    fn bounds(_: usize) -> (f64, f64) {
        FREE
    }
    fn objective<D: DualNum<Primitive = f64> + Copy>(x: &[D]) -> D {
        let d = x[0] - x[1] * 2.0;
        x[0].exp() + x[1] * x[1] + d * d
    }
    fn constraint<D: DualNum<Primitive = f64> + Copy>(_: usize, x: &[D]) -> D {
        let error = 1e-9 * (1e15 * (x[0].re() - x[1].re())).sin();
        x[0] * x[0] + x[1] - 1.0 + error
    }
}

#[test]
fn published_optima() {
    let hs6 = solves::<Hs6>(&[-1.2, 1.0], 0.0);
    assert!((hs6.x[0] - 1.0).abs() < 1e-6 && (hs6.x[1] - 1.0).abs() < 1e-6);
    solves::<Hs7>(&[2.0, 2.0], -(3.0_f64.sqrt()));
    solves::<Hs1>(&[-2.0, 1.0], 0.0);
    let hs71 = solves::<Hs71>(&[1.0, 5.0, 5.0, 1.0], 17.014_017_289_16);
    assert!((hs71.x[1] - 4.742_999_4).abs() < 1e-6, "{:?}", hs71.x);
}

#[test]
fn infeasible_constraints_are_called_so() {
    let (solution, check) = run::<Infeasible>(&[1.0, 1.0], &Settings::default());
    assert_eq!(solution.status, Status::LocallyInfeasible);
    assert!(check.primal_inf >= 1.0);
}

#[test]
fn a_start_that_cannot_be_evaluated_is_called_so() {
    let (solution, _) = run::<Hs6>(&[f64::NAN, 1.0], &Settings::default());
    assert_eq!(solution.status, Status::CannotEvaluate);
}

#[test]
fn limits_and_interrupts_keep_the_best_point() {
    let settings = Settings {
        max_iterations: 3,
        ..Settings::default()
    };
    let (solution, _) = run::<Hs1>(&[-2.0, 1.0], &settings);
    assert_eq!(solution.status, Status::IterationLimit);
    assert!(solution.objective < 909.0, "better than the start");

    let mut problem = Dense::<Hs1>::new();
    let mut kkt = SparseKkt::new(&problem);
    let solution = solve(
        &mut problem,
        &mut kkt,
        &[-2.0, 1.0],
        &Settings::default(),
        &mut |line, _| {
            if line.iteration == 5 {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        },
    );
    assert_eq!(
        (solution.status, solution.log.len()),
        (Status::Interrupted, 6)
    );
}

#[test]
fn every_barrier_strategy_reaches_the_optimum() {
    for oracle in [Oracle::Loqo, Oracle::Probing, Oracle::Quality] {
        let settings = Settings {
            barrier: Barrier::Adaptive(oracle),
            ..Settings::default()
        };
        let (solution, check) = run::<Hs71>(&[1.0, 5.0, 5.0, 1.0], &settings);
        assert_eq!(solution.status, Status::Solved, "{oracle:?}");
        assert!((solution.objective - 17.014_017_289_16).abs() < 1e-7);
        assert!(
            check.dual_inf < 1e-6 && check.primal_inf < 1e-7,
            "{check:?}"
        );
    }
}

#[test]
fn disjoint_half_planes_are_called_infeasible_at_the_least_violation() {
    let (solution, check) = run::<Apart>(&[1.0, 1.0], &Settings::default());
    assert_eq!(solution.status, Status::LocallyInfeasible);
    // The least largest violation is 1; the least sum of violations 2 is reached anywhere between.
    let sum = solution.x[0] + solution.x[1];
    assert!(
        sum.abs() <= 1.0 + 1e-6 && check.primal_inf <= 2.0 + 1e-6,
        "{check:?}"
    );
}

#[test]
fn dependent_equations_and_rows_without_bounds_do_no_harm() {
    let solution = solves::<Redundant>(&[5.0, -1.0, 0.5], 3.0);
    assert!(solution.x.iter().all(|x| (x - 1.0).abs() < 1e-7));
    assert!(solution.lambda[3].abs() < 1e-12, "no bound, no multiplier");
}

#[test]
fn an_optimum_without_multipliers_is_approached() {
    let (solution, check) = run::<NoMultiplier>(&[1.0, 3.0], &Settings::default());
    assert!(check.primal_inf < 1e-6, "{:?} {check:?}", solution.status);
    assert!((solution.x[1] - 1.0).abs() < 1e-4, "{:?}", solution.x);
}

#[test]
fn an_unbounded_direction_is_called_so() {
    let (solution, _) = run::<Falling>(&[1.0, 0.0], &Settings::default());
    let lines: Vec<String> = solution.log.iter().map(Iteration::line).collect();
    assert_eq!(solution.status, Status::Unbounded, "{}", lines.join("\n"));
    assert!(solution.objective < -1e10, "the best point is kept");
}

#[test]
fn held_variables_alone() {
    let (solution, _) = run::<Held<3>>(&[0.0, 0.0], &Settings::default());
    assert_eq!(
        (solution.status, solution.x),
        (Status::Solved, vec![2.0, 3.0])
    );
    let (solution, check) = run::<Held<4>>(&[0.0, 0.0], &Settings::default());
    assert_eq!(solution.status, Status::LocallyInfeasible);
    assert_eq!(check.primal_inf, 2.0);
}

#[test]
fn a_time_limit_keeps_the_start() {
    let settings = Settings {
        max_time: Some(std::time::Duration::ZERO),
        ..Settings::default()
    };
    let (solution, _) = run::<Hs1>(&[-2.0, 1.0], &settings);
    assert_eq!(solution.status, Status::TimeLimit);
    assert_eq!(solution.x, [-2.0, 1.0]);
    assert_eq!(solution.objective, 909.0);
}

#[test]
fn a_raised_flag_interrupts() {
    let interrupt = Interrupt::default();
    let settings = Settings {
        interrupt: Some(interrupt.clone()),
        ..Settings::default()
    };
    let mut problem = Dense::<Hs1>::new();
    let mut kkt = SparseKkt::new(&problem);
    let mut raise = |line: &Iteration, _: &[f64]| {
        if line.iteration == 4 {
            interrupt.stop();
        }
        ControlFlow::Continue(())
    };
    let solution = solve(&mut problem, &mut kkt, &[-2.0, 1.0], &settings, &mut raise);
    assert_eq!(
        (solution.status, solution.log.len()),
        (Status::Interrupted, 5)
    );
    let least = solution.log.iter().map(|l| l.objective);
    assert_eq!(solution.objective, least.fold(f64::INFINITY, f64::min));
}

#[test]
fn a_warm_start_needs_fewer_iterations() {
    let settings = Settings::default();
    let (cold, _) = run::<Hs71>(&[1.0, 5.0, 5.0, 1.0], &settings);
    let mut problem = Dense::<Hs71>::new();
    let mut kkt = SparseKkt::new(&problem);
    let mut quiet = |_: &Iteration, _: &[f64]| ControlFlow::Continue(());
    let start = Start::warm(&cold);
    let warm = solve_from(&mut problem, &mut kkt, &start, &settings, &mut quiet);
    assert_eq!(warm.status, Status::Solved);
    assert!((warm.objective - cold.objective).abs() < 1e-7);
    assert!(
        warm.log.len() <= 4 && warm.log.len() < cold.log.len(),
        "{} against {}",
        warm.log.len(),
        cold.log.len()
    );
}

/// Last steps are shorter than the objective can show; the optimality error judges them.
#[test]
fn errors_of_the_objective_do_not_keep_from_the_optimum() {
    let settings = Settings {
        tol: 1e-10,
        ..Settings::default()
    };
    for k in 0..100 {
        let start = f64::from(k) * 1e-3;
        let (solution, check) = run::<Rough>(&[0.3 + start, -0.2 - start], &settings);
        let ended = (solution.status, solution.log.len());
        assert_eq!(solution.status, Status::Solved, "{k}: {ended:?}");
        assert!(solution.log.len() < 15, "{k}: {ended:?}");
        assert!(check.dual_inf < 1e-8, "{k}: {check:?}");
    }
}

/// What the filter refuses at an acceptable point are errors of evaluation: no feasibility problem
/// is solved there.
#[test]
fn errors_of_a_row_are_not_restored() {
    let settings = Settings {
        tol: 1e-13,
        ..Settings::default()
    };
    for k in 0..50 {
        let start = f64::from(k) * 1e-2;
        let (solution, check) = run::<RoughRow>(&[0.3 + start, -0.2 - start], &settings);
        let ended = (solution.status, solution.counts, solution.log.len());
        assert!(solution.status.converged(), "{k}: {ended:?}");
        assert_eq!(solution.counts.restorations, 0, "{k}: {ended:?}");
        assert!(
            check.primal_inf < 1e-8 && check.dual_inf < 1e-6,
            "{k}: {check:?}"
        );
    }
}

/// Second-order corrections solve again with the right-hand side of the step, after errors were
/// computed to judge it.
#[test]
fn errors_leave_the_right_hand_side_of_the_step() {
    let mut problem = Dense::<Hs71>::new();
    let mut kkt = SparseKkt::new(&problem);
    let (n, m) = (problem.n(), problem.m());
    let settings = Settings::default();
    let (mut standard, x) = Standard::new(&mut problem, &[1.0, 5.0, 5.0, 1.0], 1e-2, &settings);
    let mut adapted = StandardKkt::new(&mut kkt, n, m, &standard.slack_rows);
    let mut solver = Solver::new(&mut standard, &mut adapted, &settings, Instant::now());
    solver.current.x.copy_from_slice(&x);
    solver.start().expect("evaluates");
    solver.iterate().expect("steps");
    solver.load_rhs(solver.mu);
    let loaded = solver.rx.clone();
    assert!(solver.errors(solver.mu).dual > 1e-3);
    assert!(!solver.error_falls(0.0, 0.0), "no error is below none");
    assert_eq!(solver.rx, loaded);
}

use super::*;
use crate::nlp::SparsePattern;
use crate::solver::kkt::sparse::SparseKkt;

/// Rosenbrock's function on or inside a circle of radius √r, in a box; first points where it is not
/// a number if `broken`.
struct Circle {
    jacobian: SparsePattern,
    hessian: SparsePattern,
    range: (f64, f64),
    broken: bool,
}

impl Circle {
    fn new(range: (f64, f64)) -> Self {
        let (mut jacobian, mut hessian) = (SparsePattern::default(), SparsePattern::default());
        (0..2).for_each(|j| jacobian.push(0, j));
        (0..2).for_each(|i| (0..=i).for_each(|j| hessian.push(i, j)));
        Self {
            jacobian,
            hessian,
            range,
            broken: false,
        }
    }
}

impl Nlp for Circle {
    fn n(&self) -> usize {
        2
    }
    fn m(&self) -> usize {
        1
    }
    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        lower.fill(-2.0);
        upper.fill(2.0);
    }
    fn constraint_bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        (lower[0], upper[0]) = self.range;
    }
    fn objective(&mut self, x: &[f64]) -> f64 {
        if self.broken {
            return f64::NAN;
        }
        100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2)
    }
    fn gradient(&mut self, x: &[f64], g: &mut [f64]) {
        let r = x[1] - x[0] * x[0];
        g[0] = -400.0 * r * x[0] - 2.0 * (1.0 - x[0]);
        g[1] = 200.0 * r;
    }
    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        c[0] = x[0] * x[0] + x[1] * x[1];
    }
    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian
    }
    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        values.copy_from_slice(&[2.0 * x[0], 2.0 * x[1]]);
    }
    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian
    }
    fn hessian(&mut self, x: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        values[0] = sigma * (1200.0 * x[0] * x[0] - 400.0 * x[1] + 2.0) + 2.0 * lambda[0];
        values[1] = -400.0 * sigma * x[0];
        values[2] = 200.0 * sigma + 2.0 * lambda[0];
    }
}

fn run(problem: &mut Circle, memory: Option<usize>, settings: &Settings) -> Solution {
    let mut kkt = SparseKkt::new(problem);
    solve(
        problem,
        &mut kkt,
        &[0.3, 1.2],
        memory,
        settings,
        &mut |_, _| ControlFlow::Continue(()),
    )
}

#[test]
fn converges_to_the_optimum_with_either_hessian() {
    for memory in [None, Some(20)] {
        // On the circle of radius √2 the optimum is (1, 1) with a multiplier of zero.
        let found = run(&mut Circle::new((2.0, 2.0)), memory, &Settings::default());
        assert_eq!(found.status, Status::Solved, "{memory:?}");
        assert!((found.x[0] - 1.0).abs() < 1e-6 && (found.x[1] - 1.0).abs() < 1e-6);
        // Inside the unit circle the row is active: 2 λ x_j = −∂f/∂x_j.
        let mut inside = Circle::new((f64::NEG_INFINITY, 1.0));
        let found = run(&mut inside, memory, &Settings::default());
        assert_eq!(found.status, Status::Solved, "{memory:?}");
        assert!((found.x[0].hypot(found.x[1]) - 1.0).abs() < 1e-7);
        let mut g = [0.0; 2];
        inside.gradient(&found.x, &mut g);
        assert!(found.lambda[0] > 0.0);
        for (g, x) in g.iter().zip(&found.x) {
            assert!((g + 2.0 * found.lambda[0] * x).abs() < 1e-5);
        }
    }
}

#[test]
fn contradictory_rows_end_as_infeasible() {
    // The box ends at radius √8.
    let found = run(&mut Circle::new((20.0, 20.0)), None, &Settings::default());
    assert_eq!(found.status, Status::LocallyInfeasible);
}

#[test]
fn limits_and_broken_starts_have_their_status() {
    let mut broken = Circle::new((2.0, 2.0));
    broken.broken = true;
    let status = |p: &mut Circle, s: &Settings| run(p, None, s).status;
    assert_eq!(
        status(&mut broken, &Settings::default()),
        Status::CannotEvaluate
    );
    let limit = Settings {
        max_iterations: 2,
        ..Settings::default()
    };
    let mut good = Circle::new((2.0, 2.0));
    assert_eq!(status(&mut good, &limit), Status::IterationLimit);
    let limit = Settings {
        max_time: Some(Duration::ZERO),
        ..Settings::default()
    };
    assert_eq!(status(&mut good, &limit), Status::TimeLimit);
    let interrupt = Interrupt::default();
    interrupt.stop();
    let limit = Settings {
        interrupt: Some(interrupt),
        ..Settings::default()
    };
    assert_eq!(status(&mut good, &limit), Status::Interrupted);
}

/// `−x₀`, or `−x₀²` if `curved`, for `x₀ ≥ 0` and `x₁² − x₀ ≤ 1`: no minimum.
struct Falling {
    jacobian: SparsePattern,
    hessian: SparsePattern,
    curved: bool,
}

impl Nlp for Falling {
    fn n(&self) -> usize {
        2
    }
    fn m(&self) -> usize {
        1
    }
    fn bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        lower.copy_from_slice(&[0.0, f64::NEG_INFINITY]);
        upper.fill(f64::INFINITY);
    }
    fn constraint_bounds(&self, lower: &mut [f64], upper: &mut [f64]) {
        (lower[0], upper[0]) = (f64::NEG_INFINITY, 1.0);
    }
    fn objective(&mut self, x: &[f64]) -> f64 {
        if self.curved { -x[0] * x[0] } else { -x[0] }
    }
    fn gradient(&mut self, x: &[f64], g: &mut [f64]) {
        g[0] = if self.curved { -2.0 * x[0] } else { -1.0 };
        g[1] = 0.0;
    }
    fn constraints(&mut self, x: &[f64], c: &mut [f64]) {
        c[0] = x[1] * x[1] - x[0];
    }
    fn jacobian_pattern(&self) -> &SparsePattern {
        &self.jacobian
    }
    fn jacobian(&mut self, x: &[f64], values: &mut [f64]) {
        values.copy_from_slice(&[-1.0, 2.0 * x[1]]);
    }
    fn hessian_pattern(&self) -> &SparsePattern {
        &self.hessian
    }
    fn hessian(&mut self, _: &[f64], sigma: f64, lambda: &[f64], values: &mut [f64]) {
        values[0] = if self.curved { -2.0 * sigma } else { 0.0 };
        values[1] = 2.0 * lambda[0];
    }
}

fn fall(curved: bool, memory: Option<usize>, divergence: f64) {
    let (mut jacobian, mut hessian) = (SparsePattern::default(), SparsePattern::default());
    for j in 0..2 {
        jacobian.push(0, j);
        hessian.push(j, j);
    }
    let mut problem = Falling {
        jacobian,
        hessian,
        curved,
    };
    let mut kkt = SparseKkt::new(&problem);
    let settings = Settings {
        divergence,
        ..Settings::default()
    };
    let found = solve(
        &mut problem,
        &mut kkt,
        &[1.0, 0.0],
        memory,
        &settings,
        &mut |_, _| ControlFlow::Continue(()),
    );
    let lines: Vec<String> = found.log.iter().map(Iteration::line).collect();
    let told = format!("{curved} {memory:?}\n{}", lines.join("\n"));
    assert_eq!(found.status, Status::Unbounded, "{told}");
    assert!(
        found.objective < -divergence.min(1e10),
        "the best point is kept: {told}"
    );
}

#[test]
fn an_unbounded_direction_is_called_so() {
    for divergence in [1e10, Settings::default().divergence] {
        fall(false, None, divergence);
        fall(true, None, divergence);
    }
}

#[test]
fn an_unbounded_direction_is_called_so_without_second_derivatives() {
    fall(true, Some(20), 1e10);
}

//! Problems 1 to 30.

use super::*;

/// Rosenbrock's function.
fn rosenbrock<D: Number>(x1: D, x2: D) -> D {
    (x2 - x1 * x1).powi(2) * 100.0 + (x1 - 1.0).powi(2)
}

problems! {
    Hs1 1 from [-2.0, 1.0], in [(-INF, INF), (-1.5, INF)], to 0.0;
    (x1 x2) => (rosenbrock(x1, x2), vec![]);

    Hs2 2 from [-2.0, 1.0], in [(-INF, INF), (1.5, INF)], to 0.050_426_187_9;
    (x1 x2) => (rosenbrock(x1, x2), vec![]);

    Hs3 3 from [10.0, 1.0], in [(-INF, INF), (0.0, INF)], to 0.0;
    (x1 x2) => (x2 + (x2 - x1).powi(2) * 1e-5, vec![]);

    Hs4 4 from [1.125, 0.125], in [(1.0, INF), (0.0, INF)], to 8.0 / 3.0;
    (x1 x2) => ((x1 + 1.0).powi(3) / 3.0 + x2, vec![]);

    Hs5 5 from [0.0, 0.0], in [(-1.5, 4.0), (-3.0, 3.0)], to -0.5 * 3.0_f64.sqrt() - std::f64::consts::FRAC_PI_3;
    (x1 x2) => ((x1 + x2).sin() + (x1 - x2).powi(2) - x1 * 1.5 + x2 * 2.5 + 1.0, vec![]);

    Hs6 6 from [-1.2, 1.0], in free(2), to 0.0;
    (x1 x2) => ((x1 - 1.0).powi(2), vec![eq((x2 - x1 * x1) * 10.0)]);

    Hs7 7 from [2.0, 2.0], in free(2), to -3.0_f64.sqrt();
    (x1 x2) => ((x1 * x1 + 1.0).ln() - x2, vec![eq((x1 * x1 + 1.0).powi(2) + x2 * x2 - 4.0)]);

    Hs8 8 from [2.0, 1.0], in free(2), to -1.0;
    (x1 x2) => (k(-1.0), vec![eq(x1 * x1 + x2 * x2 - 25.0), eq(x1 * x2 - 9.0)]);

    Hs9 9 from [0.0, 0.0], in free(2), to -0.5;
    (x1 x2) => {
        let pi = std::f64::consts::PI;
        ((x1 * (pi / 12.0)).sin() * (x2 * (pi / 16.0)).cos(), vec![eq(x1 * 4.0 - x2 * 3.0)])
    };

    Hs10 10 from [-10.0, 10.0], in free(2), to -1.0;
    (x1 x2) => (x1 - x2, vec![ge(x1 * x1 * -3.0 + x1 * x2 * 2.0 - x2 * x2 + 1.0)]);

    Hs11 11 from [4.9, 0.1], in free(2), to -8.498_464_223;
    (x1 x2) => ((x1 - 5.0).powi(2) + x2 * x2 - 25.0, vec![ge(x2 - x1 * x1)]);

    Hs12 12 from [0.0, 0.0], in free(2), to -30.0;
    (x1 x2) => (
        x1 * x1 * 0.5 + x2 * x2 - x1 * x2 - x1 * 7.0 - x2 * 7.0,
        vec![ge(k::<D>(25.0) - x1 * x1 * 4.0 - x2 * x2)],
    );

    /// The optimum (1, 0) is no Karush-Kuhn-Tucker point: the gradients of the active constraints
    /// are parallel there.
    Hs13 13 from [-2.0, -2.0], in positive(2), to 1.0;
    (x1 x2) => ((x1 - 2.0).powi(2) + x2 * x2, vec![ge((-x1 + 1.0).powi(3) - x2)]);

    Hs14 14 from [2.0, 2.0], in free(2), to 9.0 - 2.875 * 7.0_f64.sqrt();
    (x1 x2) => (
        (x1 - 2.0).powi(2) + (x2 - 1.0).powi(2),
        vec![ge(-x1 * x1 * 0.25 - x2 * x2 + 1.0), eq(x1 - x2 * 2.0 + 1.0)],
    );

    Hs15 15 from [-2.0, 1.0], in [(-INF, 0.5), (-INF, INF)], to 306.5;
    (x1 x2) => (rosenbrock(x1, x2), vec![ge(x1 * x2 - 1.0), ge(x1 + x2 * x2)]);

    Hs16 16 from [-2.0, 1.0], in [(-0.5, 0.5), (-INF, 1.0)], to 0.25;
    (x1 x2) => (rosenbrock(x1, x2), vec![ge(x1 + x2 * x2), ge(x1 * x1 + x2)]);

    Hs17 17 from [-2.0, 1.0], in [(-0.5, 0.5), (-INF, 1.0)], to 1.0;
    (x1 x2) => (rosenbrock(x1, x2), vec![ge(x2 * x2 - x1), ge(x1 * x1 - x2)]);

    Hs18 18 from [2.0, 2.0], in [(2.0, 50.0), (0.0, 50.0)], to 5.0;
    (x1 x2) => (x1 * x1 * 0.01 + x2 * x2, vec![ge(x1 * x2 - 25.0), ge(x1 * x1 + x2 * x2 - 25.0)]);

    Hs19 19 from [20.1, 5.84], in [(13.0, 100.0), (0.0, 100.0)], to -6_961.813_81;
    (x1 x2) => (
        (x1 - 10.0).powi(3) + (x2 - 20.0).powi(3),
        vec![
            ge((x1 - 5.0).powi(2) + (x2 - 5.0).powi(2) - 100.0),
            ge(-(x2 - 5.0).powi(2) - (x1 - 6.0).powi(2) + 82.81),
        ],
    );

    Hs20 20 from [-2.0, 1.0], in [(-0.5, 0.5), (-INF, INF)], to 81.5 - 25.0 * 3.0_f64.sqrt();
    (x1 x2) => (
        rosenbrock(x1, x2),
        vec![ge(x1 + x2 * x2), ge(x1 * x1 + x2), ge(x1 * x1 + x2 * x2 - 1.0)],
    );

    Hs21 21 from [-1.0, -1.0], in [(2.0, 50.0), (-50.0, 50.0)], to -99.96;
    (x1 x2) => (x1 * x1 * 0.01 + x2 * x2 - 100.0, vec![ge(x1 * 10.0 - x2 - 10.0)]);

    Hs22 22 from [2.0, 2.0], in free(2), to 1.0;
    (x1 x2) => (
        (x1 - 2.0).powi(2) + (x2 - 1.0).powi(2),
        vec![ge(-x1 - x2 + 2.0), ge(x2 - x1 * x1)],
    );

    Hs23 23 from [3.0, 1.0], in each(2, -50.0, 50.0), to 2.0;
    (x1 x2) => (
        x1 * x1 + x2 * x2,
        vec![
            ge(x1 + x2 - 1.0),
            ge(x1 * x1 + x2 * x2 - 1.0),
            ge(x1 * x1 * 9.0 + x2 * x2 - 9.0),
            ge(x1 * x1 - x2),
            ge(x2 * x2 - x1),
        ],
    );

    Hs24 24 from [1.0, 0.5], in positive(2), to -1.0;
    (x1 x2) => {
        let r = 3.0_f64.sqrt();
        (
            ((x1 - 3.0).powi(2) - 9.0) * x2.powi(3) / (27.0 * r),
            vec![ge(x1 / r - x2), ge(x1 + x2 * r), ge(-x1 - x2 * r + 6.0)],
        )
    };

    Hs25 25 from [100.0, 12.5, 3.0], in [(0.1, 100.0), (0.0, 25.6), (0.0, 5.0)], to 0.0;
    (x1 x2 x3) => {
        let residual = |i: u32| {
            let share = 0.01 * f64::from(i);
            let u = 25.0 + (-50.0 * share.ln()).powf(2.0 / 3.0);
            let power = ((-x2 + u).ln() * x3).exp();
            (-(power / x1)).exp() - share
        };
        (sum((1..=99).map(|i| residual(i).powi(2))), vec![])
    };

    Hs26 26 from [-2.6, 2.0, 2.0], in free(3), to 0.0;
    (x1 x2 x3) => (
        (x1 - x2).powi(2) + (x2 - x3).powi(4),
        vec![eq((x2 * x2 + 1.0) * x1 + x3.powi(4) - 3.0)],
    );

    Hs27 27 from [2.0, 2.0, 2.0], in free(3), to 0.04;
    (x1 x2 x3) => (
        (x1 - 1.0).powi(2) * 0.01 + (x2 - x1 * x1).powi(2),
        vec![eq(x1 + x3 * x3 + 1.0)],
    );

    Hs28 28 from [-4.0, 1.0, 1.0], in free(3), to 0.0;
    (x1 x2 x3) => (
        (x1 + x2).powi(2) + (x2 + x3).powi(2),
        vec![eq(x1 + x2 * 2.0 + x3 * 3.0 - 1.0)],
    );

    Hs29 29 from [1.0, 1.0, 1.0], in free(3), to -16.0 * 2.0_f64.sqrt();
    (x1 x2 x3) => (
        -x1 * x2 * x3,
        vec![ge(-x1 * x1 - x2 * x2 * 2.0 - x3 * x3 * 4.0 + 48.0)],
    );

    Hs30 30 from [1.0, 1.0, 1.0], in [(1.0, 10.0), (-10.0, 10.0), (-10.0, 10.0)], to 1.0;
    (x1 x2 x3) => (x1 * x1 + x2 * x2 + x3 * x3, vec![ge(x1 * x1 + x2 * x2 - 1.0)]);
}

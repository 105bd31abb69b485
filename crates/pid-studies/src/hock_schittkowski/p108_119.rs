//! Problems 108 to 119 (117 stands with its dual, 86).

use super::tables::{EQUILIBRIUM, HS119_A, HS119_A_REST, HS119_B, HS119_C};
use super::*;

/// Mass balances of the problems 111 and 112 for the amounts `y`.
fn balances<D: Number>(y: &[D]) -> Vec<Row<D>> {
    vec![
        eq(y[0] + y[1] * 2.0 + y[2] * 2.0 + y[5] + y[9] - 2.0),
        eq(y[3] + y[4] * 2.0 + y[5] + y[6] - 1.0),
        eq(y[2] + y[6] + y[7] + y[8] * 2.0 + y[9] - 1.0),
    ]
}

problems! {
    Hs108 108 from [1.0; 9], in {
        let mut bounds = free(9);
        bounds[8].0 = 0.0;
        bounds
    }, to -0.866_025_403_8;
    (x1 x2 x3 x4 x5 x6 x7 x8 x9) => {
        let disc = |a: D, b: D| ge(-a * a - b * b + 1.0);
        (
            (x1 * x4 - x2 * x3 + x3 * x9 - x5 * x9 + x5 * x8 - x6 * x7) * -0.5,
            vec![
                disc(x3, x4),
                ge(-x9 * x9 + 1.0),
                disc(x5, x6),
                disc(x1, x2 - x9),
                disc(x1 - x5, x2 - x6),
                disc(x1 - x7, x2 - x8),
                disc(x3 - x5, x4 - x6),
                disc(x3 - x7, x4 - x8),
                disc(x7, x8 - x9),
                ge(x1 * x4 - x2 * x3),
                ge(x3 * x9),
                ge(-x5 * x9),
                ge(x5 * x8 - x6 * x7),
            ],
        )
    };

    /// Power flow.
    Hs109 109 from [0.0; 9],
        in [(0.0, INF), (0.0, INF), (-0.55, 0.55), (-0.55, 0.55), (196.0, 252.0), (196.0, 252.0),
            (196.0, 252.0), (-400.0, 800.0), (-400.0, 800.0)],
        to 0.536_206_927_538e4;
    (x1 x2 x3 x4 x5 x6 x7 x8 x9) => {
        let (a, b, c) = (50.176, 0.25_f64.sin(), 0.25_f64.cos());
        let s = |angle: D| (angle - 0.25).sin();
        let cs = |angle: D| (angle - 0.25).cos();
        let shunt = 0.7533e-3 * a;
        (
            x1 * 3.0 + x1.powi(3) * 1e-6 + x2 * 2.0 + x2.powi(3) * 0.522_074e-6,
            vec![
                ge(x4 - x3 + 0.55),
                ge(x3 - x4 + 0.55),
                ge(-x1 * x1 - x8 * x8 + 2.25e6),
                ge(-x2 * x2 - x9 * x9 + 2.25e6),
                eq(x5 * x6 * s(-x3) + x5 * x7 * s(-x4) + x5 * x5 * (2.0 * b) - x1 * a + 400.0 * a),
                eq(x5 * x6 * s(x3) + x6 * x7 * s(x3 - x4) + x6 * x6 * (2.0 * b) - x2 * a + 400.0 * a),
                eq(x5 * x7 * s(x4) + x6 * x7 * s(x4 - x3) + x7 * x7 * (2.0 * b) + 881.779 * a),
                eq(x8 * a + x5 * x6 * cs(-x3) + x5 * x7 * cs(-x4) - 200.0 * a - x5 * x5 * (2.0 * c)
                    + x5 * x5 * shunt),
                eq(x9 * a + x5 * x6 * cs(x3) + x6 * x7 * cs(x3 - x4) - x6 * x6 * (2.0 * c)
                    + x6 * x6 * shunt - 200.0 * a),
                eq(x5 * x7 * cs(x4) + x6 * x7 * cs(x4 - x3) - x7 * x7 * (2.0 * c) - 22.938 * a
                    + x7 * x7 * shunt),
            ],
        )
    };

    Hs110 110 from [9.0; 10], in each(10, 2.001, 9.999), to -45.778_469_71;
    (slice x) => {
        let term = |x: &D| (*x - 2.0).ln().powi(2) + (-*x + 10.0).ln().powi(2);
        let product = x.iter().fold(D::one(), |a, b| a * *b);
        (sum(x.iter().map(term)) - product.powf(0.2), vec![])
    };

    /// Chemical equilibrium in logarithms of the amounts.
    Hs111 111 from [-2.3; 10], in each(10, -100.0, 100.0), to -47.761_090_26;
    (slice x) => {
        let y: Vec<D> = x.iter().map(|x| x.exp()).collect();
        let total = sum(y.iter().copied()).ln();
        let f = sum((0..10).map(|j| y[j] * (x[j] - total + EQUILIBRIUM[j])));
        (f, balances(&y))
    };

    /// Chemical equilibrium in the amounts: the same problem as 111; the book prints −47.707579,
    /// the value of a point that is not converged.
    Hs112 112 from [0.1; 10], in each(10, 1e-6, INF), to -47.707_579, refined -47.761_090_26;
    (slice x) => {
        let total = sum(x.iter().copied()).ln();
        (sum((0..10).map(|j| x[j] * (x[j].ln() - total + EQUILIBRIUM[j]))), balances(x))
    };

    Hs113 113 from [2.0, 3.0, 5.0, 5.0, 1.0, 2.0, 7.0, 3.0, 6.0, 10.0], in free(10), to 24.306_209_1;
    (x1 x2 x3 x4 x5 x6 x7 x8 x9 x10) => (
        x1 * x1 + x2 * x2 + x1 * x2 - x1 * 14.0 - x2 * 16.0 + (x3 - 10.0).powi(2) + (x4 - 5.0).powi(2) * 4.0
            + (x5 - 3.0).powi(2) + (x6 - 1.0).powi(2) * 2.0 + x7 * x7 * 5.0 + (x8 - 11.0).powi(2) * 7.0
            + (x9 - 10.0).powi(2) * 2.0 + (x10 - 7.0).powi(2) + 45.0,
        vec![
            ge(x1 * -4.0 - x2 * 5.0 + x7 * 3.0 - x8 * 9.0 + 105.0),
            ge(x1 * -10.0 + x2 * 8.0 + x7 * 17.0 - x8 * 2.0),
            ge(x1 * 8.0 - x2 * 2.0 - x9 * 5.0 + x10 * 2.0 + 12.0),
            ge((x1 - 2.0).powi(2) * -3.0 - (x2 - 3.0).powi(2) * 4.0 - x3 * x3 * 2.0 + x4 * 7.0 + 120.0),
            ge(x1 * x1 * -5.0 - x2 * 8.0 - (x3 - 6.0).powi(2) + x4 * 2.0 + 40.0),
            ge((x1 - 8.0).powi(2) * -0.5 - (x2 - 4.0).powi(2) * 2.0 - x5 * x5 * 3.0 + x6 + 30.0),
            ge(-x1 * x1 - (x2 - 2.0).powi(2) * 2.0 + x1 * x2 * 2.0 - x5 * 14.0 + x6 * 6.0),
            ge(x1 * 3.0 - x2 * 6.0 - (x9 - 8.0).powi(2) * 12.0 + x10 * 7.0),
        ],
    );

    /// Alkylation process.
    Hs114 114 from [1745.0, 12_000.0, 110.0, 3048.0, 1974.0, 89.2, 92.8, 8.0, 3.6, 145.0],
        in [(1e-5, 2000.0), (1e-5, 16_000.0), (1e-5, 120.0), (1e-5, 5000.0), (1e-5, 2000.0), (85.0, 93.0),
            (90.0, 95.0), (3.0, 12.0), (1.2, 4.0), (145.0, 162.0)],
        to -1_768.806_96;
    (x1 x2 x3 x4 x5 x6 x7 x8 x9 x10) => {
        let g1 = x10 * -0.222 - x9 * 0.9 + 35.82;
        let g2 = x7 * 3.0 - x10 * 0.99 - 133.0;
        let g5 = x1 * 1.12 + x1 * x8 * 0.131_67 - x1 * x8 * x8 * 0.006_67 - x4 * 0.99;
        let g6 = x8 * 1.098 - x8 * x8 * 0.038 + x6 * 0.325 - x7 * 0.99 + 57.425;
        let ninety_nine = 1.0 / 0.99 - 0.99;
        (
            x1 * 5.04 + x2 * 0.035 + x3 * 10.0 + x5 * 3.36 - x4 * x7 * 0.063,
            vec![
                ge(g1),
                ge(g2),
                ge(-g1 + x9 * (1.0 / 0.9 - 0.9)),
                ge(-g2 + x10 * ninety_nine),
                ge(g5),
                ge(g6),
                ge(-g5 + x4 * ninety_nine),
                ge(-g6 + x7 * ninety_nine),
                eq(x4 * 1.22 - x1 - x5),
                eq(x3 * 98_000.0 / (x4 * x9 + x3 * 1000.0) - x6),
                eq((x2 + x5) / x1 - x8),
            ],
        )
    };

    /// Membrane separation in three stages.
    Hs116 116 from [0.5, 0.8, 0.9, 0.1, 0.14, 0.5, 489.0, 80.0, 650.0, 450.0, 150.0, 150.0, 150.0],
        in [(0.1, 1.0), (0.1, 1.0), (0.1, 1.0), (1e-4, 0.1), (0.1, 0.9), (0.1, 0.9), (0.1, 1000.0),
            (0.1, 1000.0), (500.0, 1000.0), (0.1, 500.0), (1.0, 150.0), (1e-4, 150.0), (1e-4, 150.0)],
        to 97.588_409;
    (x1 x2 x3 x4 x5 x6 x7 x8 x9 x10 x11 x12 x13) => {
        let f = x11 + x12 + x13;
        let stage = |out: D, x: D| ge(out - x * 0.034_75 - x * out * 0.975 + x * x * 0.009_75);
        (
            f,
            vec![
                ge(x3 - x2),
                ge(x2 - x1),
                ge(x7 * -0.002 + x8 * 0.002 + 1.0),
                within(50.0, f, 250.0),
                ge(x13 - x10 * 1.262_626 + x3 * x10 * 1.231_059),
                stage(x5, x2),
                stage(x6, x3),
                stage(x4, x1),
                ge(x5 * x7 - x1 * x8 - x4 * x7 + x4 * x8),
                ge((x2 * x9 + x5 * x8 - x1 * x8 - x6 * x9) * -0.002 - x5 - x6 + 1.0),
                ge(x2 * x9 - x3 * x10 - x6 * x9 - x2 * 500.0 + x6 * 500.0 + x2 * x10),
                ge(x2 - 0.9 - (x2 * x10 - x3 * x10) * 0.002),
                ge(x11 - x8 * 1.262_626 + x1 * x8 * 1.231_059),
                ge(x12 - x9 * 1.262_626 + x2 * x9 * 1.231_059),
            ],
        )
    };

    Hs118 118 from [20.0, 55.0, 15.0, 20.0, 60.0, 20.0, 20.0, 60.0, 20.0, 20.0, 60.0, 20.0, 20.0, 60.0, 20.0],
        in {
            let mut bounds = vec![(8.0, 21.0), (43.0, 57.0), (3.0, 16.0)];
            for _ in 1..5 {
                bounds.extend([(0.0, 90.0), (0.0, 120.0), (0.0, 60.0)]);
            }
            bounds
        },
        to 664.820_450_0;
    (slice x) => {
        let cost = |k: usize| {
            let (a, b, c) = (x[3 * k], x[3 * k + 1], x[3 * k + 2]);
            a * 2.3 + a * a * 1e-4 + b * 1.7 + b * b * 1e-4 + c * 2.2 + c * c * 1.5e-4
        };
        let mut rows = Vec::new();
        for j in 1..5 {
            rows.push(within(0.0, x[3 * j] - x[3 * j - 3] + 7.0, 13.0));
            rows.push(within(0.0, x[3 * j + 1] - x[3 * j - 2] + 7.0, 14.0));
            rows.push(within(0.0, x[3 * j + 2] - x[3 * j - 1] + 7.0, 13.0));
        }
        for (k, demand) in [60.0, 50.0, 70.0, 85.0, 100.0].into_iter().enumerate() {
            rows.push(ge(x[3 * k] + x[3 * k + 1] + x[3 * k + 2] - demand));
        }
        (sum((0..5).map(cost)), rows)
    };

    /// Colville's seventh problem.
    Hs119 119 from [10.0; 16], in each(16, 0.0, 5.0), to 244.899_698;
    (slice x) => {
        let g: Vec<D> = x.iter().map(|x| *x * *x + *x + 1.0).collect();
        let mut f = sum(g.iter().map(|g| *g * *g));
        for &(i, j) in HS119_A.iter().chain(&HS119_A_REST) {
            f += g[i - 1] * g[j - 1];
        }
        let row = |i: usize| {
            let mut row = sum((0..8).map(|j| x[j] * HS119_B[i][j])) + x[8 + i] - HS119_C[i];
            if i == 6 {
                row -= x[8] * 0.36;
            }
            eq(row)
        };
        (f, (0..8).map(row).collect())
    };
}

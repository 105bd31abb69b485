//! Problems 31 to 58.

use super::tables::{COLVILLE, HS57_A, HS57_B};
use super::*;

problems! {
    Hs31 31 from [1.0, 1.0, 1.0], in [(-10.0, 10.0), (1.0, 10.0), (-10.0, 1.0)], to 6.0;
    (x1 x2 x3) => (x1 * x1 * 9.0 + x2 * x2 + x3 * x3 * 9.0, vec![ge(x1 * x2 - 1.0)]);

    Hs32 32 from [0.1, 0.7, 0.2], in positive(3), to 1.0;
    (x1 x2 x3) => (
        (x1 + x2 * 3.0 + x3).powi(2) + (x1 - x2).powi(2) * 4.0,
        vec![ge(x2 * 6.0 + x3 * 4.0 - x1.powi(3) - 3.0), eq(-x1 - x2 - x3 + 1.0)],
    );

    Hs33 33 from [0.0, 0.0, 3.0], in [(0.0, INF), (0.0, INF), (0.0, 5.0)], to 2.0_f64.sqrt() - 6.0;
    (x1 x2 x3) => (
        (x1 - 1.0) * (x1 - 2.0) * (x1 - 3.0) + x3,
        vec![ge(x3 * x3 - x2 * x2 - x1 * x1), ge(x1 * x1 + x2 * x2 + x3 * x3 - 4.0)],
    );

    Hs34 34 from [0.0, 1.05, 2.9], in [(0.0, 100.0), (0.0, 100.0), (0.0, 10.0)], to -(10.0_f64.ln().ln());
    (x1 x2 x3) => (-x1, vec![ge(x2 - x1.exp()), ge(x3 - x2.exp())]);

    Hs35 35 from [0.5, 0.5, 0.5], in positive(3), to 1.0 / 9.0;
    (x1 x2 x3) => (
        x1 * -8.0 - x2 * 6.0 - x3 * 4.0 + x1 * x1 * 2.0 + x2 * x2 * 2.0 + x3 * x3 + x1 * x2 * 2.0
            + x1 * x3 * 2.0 + 9.0,
        vec![ge(-x1 - x2 - x3 * 2.0 + 3.0)],
    );

    Hs36 36 from [10.0, 10.0, 10.0], in [(0.0, 20.0), (0.0, 11.0), (0.0, 42.0)], to -3300.0;
    (x1 x2 x3) => (-x1 * x2 * x3, vec![ge(-x1 - x2 * 2.0 - x3 * 2.0 + 72.0)]);

    Hs37 37 from [10.0, 10.0, 10.0], in each(3, 0.0, 42.0), to -3456.0;
    (x1 x2 x3) => {
        let girth = x1 + x2 * 2.0 + x3 * 2.0;
        (-x1 * x2 * x3, vec![ge(-girth + 72.0), ge(girth)])
    };

    Hs38 38 from [-3.0, -1.0, -3.0, -1.0], in each(4, -10.0, 10.0), to 0.0;
    (x1 x2 x3 x4) => (
        (x2 - x1 * x1).powi(2) * 100.0 + (x1 - 1.0).powi(2) + (x4 - x3 * x3).powi(2) * 90.0
            + (x3 - 1.0).powi(2) + ((x2 - 1.0).powi(2) + (x4 - 1.0).powi(2)) * 10.1
            + (x2 - 1.0) * (x4 - 1.0) * 19.8,
        vec![],
    );

    Hs39 39 from [2.0; 4], in free(4), to -1.0;
    (x1 x2 x3 x4) => (-x1, vec![eq(x2 - x1.powi(3) - x3 * x3), eq(x1 * x1 - x2 - x4 * x4)]);

    Hs40 40 from [0.8; 4], in free(4), to -0.25;
    (x1 x2 x3 x4) => (
        -x1 * x2 * x3 * x4,
        vec![eq(x1.powi(3) + x2 * x2 - 1.0), eq(x1 * x1 * x4 - x3), eq(x4 * x4 - x2)],
    );

    Hs41 41 from [2.0; 4], in [(0.0, 1.0), (0.0, 1.0), (0.0, 1.0), (0.0, 2.0)], to 52.0 / 27.0;
    (x1 x2 x3 x4) => (-x1 * x2 * x3 + 2.0, vec![eq(x1 + x2 * 2.0 + x3 * 2.0 - x4)]);

    Hs42 42 from [1.0; 4], in free(4), to 28.0 - 10.0 * 2.0_f64.sqrt();
    (x1 x2 x3 x4) => (
        (x1 - 1.0).powi(2) + (x2 - 2.0).powi(2) + (x3 - 3.0).powi(2) + (x4 - 4.0).powi(2),
        vec![eq(x1 - 2.0), eq(x3 * x3 + x4 * x4 - 2.0)],
    );

    Hs43 43 from [0.0; 4], in free(4), to -44.0;
    (x1 x2 x3 x4) => (
        x1 * x1 + x2 * x2 + x3 * x3 * 2.0 + x4 * x4 - x1 * 5.0 - x2 * 5.0 - x3 * 21.0 + x4 * 7.0,
        vec![
            ge(-x1 * x1 - x2 * x2 - x3 * x3 - x4 * x4 - x1 + x2 - x3 + x4 + 8.0),
            ge(-x1 * x1 - x2 * x2 * 2.0 - x3 * x3 - x4 * x4 * 2.0 + x1 + x4 + 10.0),
            ge(x1 * x1 * -2.0 - x2 * x2 - x3 * x3 - x1 * 2.0 + x2 + x4 + 5.0),
        ],
    );

    Hs44 44 from [0.0; 4], in positive(4), to -15.0;
    (x1 x2 x3 x4) => (
        x1 - x2 - x3 - x1 * x3 + x1 * x4 + x2 * x3 - x2 * x4,
        vec![
            ge(-x1 - x2 * 2.0 + 8.0),
            ge(x1 * -4.0 - x2 + 12.0),
            ge(x1 * -3.0 - x2 * 4.0 + 12.0),
            ge(x3 * -2.0 - x4 + 8.0),
            ge(-x3 - x4 * 2.0 + 8.0),
            ge(-x3 - x4 + 5.0),
        ],
    );

    Hs45 45 from [2.0; 5], in [(0.0, 1.0), (0.0, 2.0), (0.0, 3.0), (0.0, 4.0), (0.0, 5.0)], to 1.0;
    (x1 x2 x3 x4 x5) => (-x1 * x2 * x3 * x4 * x5 / 120.0 + 2.0, vec![]);

    Hs46 46 from [0.5 * 2.0_f64.sqrt(), 1.75, 0.5, 2.0, 2.0], in free(5), to 0.0;
    (x1 x2 x3 x4 x5) => (
        (x1 - x2).powi(2) + (x3 - 1.0).powi(2) + (x4 - 1.0).powi(4) + (x5 - 1.0).powi(6),
        vec![eq(x1 * x1 * x4 + (x4 - x5).sin() - 1.0), eq(x2 + x3.powi(4) * x4 * x4 - 2.0)],
    );

    Hs47 47 from [2.0, 2.0_f64.sqrt(), -1.0, 2.0 - 2.0_f64.sqrt(), 0.5], in free(5), to 0.0;
    (x1 x2 x3 x4 x5) => (
        (x1 - x2).powi(2) + (x2 - x3).powi(3) + (x3 - x4).powi(4) + (x4 - x5).powi(4),
        vec![
            eq(x1 + x2 * x2 + x3.powi(3) - 3.0),
            eq(x2 - x3 * x3 + x4 - 1.0),
            eq(x1 * x5 - 1.0),
        ],
    );

    Hs48 48 from [3.0, 5.0, -3.0, 2.0, -2.0], in free(5), to 0.0;
    (x1 x2 x3 x4 x5) => (
        (x1 - 1.0).powi(2) + (x2 - x3).powi(2) + (x4 - x5).powi(2),
        vec![eq(x1 + x2 + x3 + x4 + x5 - 5.0), eq(x3 - (x4 + x5) * 2.0 + 3.0)],
    );

    Hs49 49 from [10.0, 7.0, 2.0, -3.0, 0.8], in free(5), to 0.0;
    (x1 x2 x3 x4 x5) => (
        (x1 - x2).powi(2) + (x3 - 1.0).powi(2) + (x4 - 1.0).powi(4) + (x5 - 1.0).powi(6),
        vec![eq(x1 + x2 + x3 + x4 * 4.0 - 7.0), eq(x3 + x5 * 5.0 - 6.0)],
    );

    Hs50 50 from [35.0, -31.0, 11.0, 5.0, -5.0], in free(5), to 0.0;
    (x1 x2 x3 x4 x5) => (
        (x1 - x2).powi(2) + (x2 - x3).powi(2) + (x3 - x4).powi(4) + (x4 - x5).powi(2),
        vec![
            eq(x1 + x2 * 2.0 + x3 * 3.0 - 6.0),
            eq(x2 + x3 * 2.0 + x4 * 3.0 - 6.0),
            eq(x3 + x4 * 2.0 + x5 * 3.0 - 6.0),
        ],
    );

    Hs51 51 from [2.5, 0.5, 2.0, -1.0, 0.5], in free(5), to 0.0;
    (x1 x2 x3 x4 x5) => (
        (x1 - x2).powi(2) + (x2 + x3 - 2.0).powi(2) + (x4 - 1.0).powi(2) + (x5 - 1.0).powi(2),
        vec![eq(x1 + x2 * 3.0 - 4.0), eq(x3 + x4 - x5 * 2.0), eq(x2 - x5)],
    );

    Hs52 52 from [2.0; 5], in free(5), to 1859.0 / 349.0;
    (x1 x2 x3 x4 x5) => (
        (x1 * 4.0 - x2).powi(2) + (x2 + x3 - 2.0).powi(2) + (x4 - 1.0).powi(2) + (x5 - 1.0).powi(2),
        vec![eq(x1 + x2 * 3.0), eq(x3 + x4 - x5 * 2.0), eq(x2 - x5)],
    );

    Hs53 53 from [2.0; 5], in each(5, -10.0, 10.0), to 176.0 / 43.0;
    (x1 x2 x3 x4 x5) => (
        (x1 - x2).powi(2) + (x2 + x3 - 2.0).powi(2) + (x4 - 1.0).powi(2) + (x5 - 1.0).powi(2),
        vec![eq(x1 + x2 * 3.0), eq(x3 + x4 - x5 * 2.0), eq(x2 - x5)],
    );

    Hs54 54 from [6e3, 1.5, 4e6, 2.0, 3e-3, 5e7],
        in [(0.0, 2e4), (-10.0, 10.0), (0.0, 1e7), (0.0, 20.0), (-1.0, 1.0), (0.0, 2e8)],
        to -(-27.0_f64 / 280.0).exp();
    (x1 x2 x3 x4 x5 x6) => {
        let h = ((x1 - 1e4).powi(2) / 6.4e7 + (x1 - 1e4) * (x2 - 1.0) / 2e4 + (x2 - 1.0).powi(2)) / 0.96
            + (x3 - 2e6).powi(2) / 4.9e13
            + (x4 - 10.0).powi(2) / 2.5e3
            + (x5 - 1e-3).powi(2) / 2.5e-3
            + (x6 - 1e8).powi(2) / 2.5e17;
        (-(h * -0.5).exp(), vec![eq(x1 + x2 * 4e3 - 1.76e4)])
    };

    /// The six equalities are linearly dependent.
    Hs55 55 from [1.0, 2.0, 0.0, 0.0, 0.0, 2.0],
        in [(0.0, 1.0), (0.0, INF), (0.0, INF), (0.0, 1.0), (0.0, INF), (0.0, INF)], to 19.0 / 3.0;
    (x1 x2 x3 x4 x5 x6) => (
        x1 + x2 * 2.0 + x5 * 4.0 + (x1 * x4).exp(),
        vec![
            eq(x1 + x2 * 2.0 + x5 * 5.0 - 6.0),
            eq(x1 + x2 + x3 - 3.0),
            eq(x4 + x5 + x6 - 2.0),
            eq(x1 + x4 - 1.0),
            eq(x2 + x5 - 2.0),
            eq(x3 + x6 - 2.0),
        ],
    );

    Hs56 56 from {
        let a = (1.0_f64 / 4.2).sqrt().asin();
        [1.0, 1.0, 1.0, a, a, a, (5.0_f64 / 7.2).sqrt().asin()]
    }, in free(7), to -3.456;
    (x1 x2 x3 x4 x5 x6 x7) => (
        -x1 * x2 * x3,
        vec![
            eq(x1 - x4.sin().powi(2) * 4.2),
            eq(x2 - x5.sin().powi(2) * 4.2),
            eq(x3 - x6.sin().powi(2) * 4.2),
            eq(x1 + x2 * 2.0 + x3 * 2.0 - x7.sin().powi(2) * 7.2),
        ],
    );

    Hs57 57 from [0.42, 5.0], in [(0.4, INF), (-4.0, INF)], to 0.028_459_669_72;
    (x1 x2) => {
        let residual = |(&a, &b): (&f64, &f64)| {
            -x1 - (-x1 + 0.49) * (-x2 * (a - 8.0)).exp() + b
        };
        (
            sum(HS57_A.iter().zip(&HS57_B).map(|data| residual(data).powi(2))),
            vec![ge(x2 * 0.49 - x1 * x2 - 0.09)],
        )
    };

    /// Two rows meet at the optimum, x₁² = x₂ and x₁² + x₂² = 1: x₂ is the golden ratio less one.
    /// The book's value is rounded.
    Hs58 58 from [-2.0, 1.0], in [(-2.0, 0.5), (-INF, INF)], to 3.190_333_549_57,
        refined (1.0 + (0.5 * (5.0_f64.sqrt() - 1.0)).sqrt()).powi(2);
    (x1 x2) => (
        (x2 - x1 * x1).powi(2) * 100.0 + (x1 - 1.0).powi(2),
        vec![ge(x2 * x2 - x1), ge(x1 * x1 - x2), ge(x1 * x1 + x2 * x2 - 1.0)],
    );

    /// Colville's first problem.
    Hs86 86 from [0.0, 0.0, 0.0, 0.0, 1.0], in positive(5), to -32.348_678_97;
    (slice x) => {
        let t = &COLVILLE;
        let quadratic = (0..5).flat_map(|i| (0..5).map(move |j| x[i] * x[j] * t.c[i][j]));
        let f = sum(quadratic)
            + sum((0..5).map(|j| x[j] * t.e[j] + x[j].powi(3) * t.d[j]));
        (f, (0..10).map(|i| ge(sum((0..5).map(|j| x[j] * t.a[i][j])) - t.b[i])).collect())
    };

    /// Colville's second problem, the dual of the first.
    Hs117 117 from {
        let mut x = [0.001; 15];
        x[6] = 60.0;
        x
    }, in positive(15), to 32.348_678_97;
    (slice x) => {
        let t = &COLVILLE;
        let y = &x[10..];
        let quadratic = (0..5).flat_map(|i| (0..5).map(move |j| y[i] * y[j] * t.c[i][j]));
        let f = sum(quadratic) - sum((0..10).map(|j| x[j] * t.b[j]))
            + sum((0..5).map(|j| y[j].powi(3) * (2.0 * t.d[j])));
        let row = |j: usize| {
            sum((0..5).map(|i| y[i] * (2.0 * t.c[i][j]))) + y[j] * y[j] * (3.0 * t.d[j]) + t.e[j]
                - sum((0..10).map(|i| x[i] * t.a[i][j]))
        };
        (f, (0..5).map(|j| ge(row(j))).collect())
    };
}

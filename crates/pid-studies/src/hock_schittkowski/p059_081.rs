//! Problems 59 to 81.

use super::tables::{HS70_C, HS70_Y};
use super::*;

/// 2π in the digits of the published formula of problem 70.
const TURN: f64 = 62832.0 / 10_000.0;

/// Distribution function of the standard normal distribution by its power series around 0,
/// Φ(z) = ½ + φ(z) Σ z^(2i+1) / (1·3·5…(2i+1)); constant where the density is below the rounding of 1.
fn normal<D: Number>(z: D) -> D {
    let value = z.re();
    if value.abs() > 9.0 {
        return k(if value > 0.0 { 1.0 } else { 0.0 });
    }
    let (mut term, mut total) = (z, z);
    for i in 1..200 {
        term = term * z * z / f64::from(2 * i + 1);
        total += term;
    }
    let density = (z * z * -0.5).exp() / (2.0 * std::f64::consts::PI).sqrt();
    density * total + 0.5
}

/// Problems 68 and 69: cost of a control chart.
fn chart<D: Number>(x: &[D], [a, b, d, n]: [f64; 4]) -> (D, Vec<Row<D>>) {
    let &[x1, x2, x3, x4] = x else {
        unreachable!("four variables")
    };
    let e = x1.exp() - 1.0;
    let f = (k::<D>(a * n) - (e * b - x3) * x4 / (e + x4)) / x1;
    let shift = d * n.sqrt();
    (
        f,
        vec![
            eq(x3 - normal(-x2) * 2.0),
            eq(x4 - normal(-x2 + shift) - normal(-x2 - shift)),
        ],
    )
}

/// Problems 74 and 75: static power scheduling.
fn scheduling<D: Number>(x: &[D], a: f64) -> (D, Vec<Row<D>>) {
    let &[x1, x2, x3, x4] = x else {
        unreachable!("four variables")
    };
    let s = |angle: D| (angle - 0.25).sin() * 1000.0;
    (
        x1 * 3.0 + x1.powi(3) * 1e-6 + x2 * 2.0 + x2.powi(3) * (2e-6 / 3.0),
        vec![
            ge(x4 - x3 + a),
            ge(x3 - x4 + a),
            eq(s(-x3) + s(-x4) + 894.8 - x1),
            eq(s(x3) + s(x3 - x4) + 894.8 - x2),
            eq(s(x4) + s(x4 - x3) + 1294.8),
        ],
    )
}

/// Constraints of the problems 78, 80 and 81.
fn powell<D: Number>(x: &[D]) -> Vec<Row<D>> {
    vec![
        eq(sum(x.iter().map(|x| x.powi(2))) - 10.0),
        eq(x[1] * x[2] - x[3] * x[4] * 5.0),
        eq(x[0].powi(3) + x[1].powi(3) + 1.0),
    ]
}

fn product<D: Number>(x: &[D]) -> D {
    x.iter().fold(D::one(), |a, b| a * *b)
}

fn powell_bounds() -> [(f64, f64); 5] {
    [
        (-2.3, 2.3),
        (-2.3, 2.3),
        (-3.2, 3.2),
        (-3.2, 3.2),
        (-3.2, 3.2),
    ]
}

problems! {
    Hs59 59 from [90.0, 10.0], in [(0.0, 75.0), (0.0, 65.0)], to -7.804_226_324;
    (x1 x2) => (
        x1 * 3.8112 - x1.powi(2) * 0.126_94 + x1.powi(3) * 2.0567e-3 - x1.powi(4) * 1.0345e-5
            + x2 * 6.8306 - x1 * x2 * 0.030_234 + x2 * x1.powi(2) * 1.281_34e-3
            - x2 * x1.powi(3) * 3.5256e-5 + x2 * x1.powi(4) * 2.266e-7 - x2.powi(2) * 0.256_45
            + x2.powi(3) * 3.4604e-3 - x2.powi(4) * 1.3514e-5 + k::<D>(28.106) / (x2 + 1.0)
            + x1.powi(2) * x2.powi(2) * 5.2375e-6 + x1.powi(3) * x2.powi(2) * 6.3e-8
            - x1.powi(3) * x2.powi(3) * 7e-10 - x1 * x2.powi(2) * 3.4054e-4
            + x1 * x2.powi(3) * 1.6638e-6 + (x1 * x2 * 0.0005).exp() * 2.8673 - 75.196,
        vec![
            ge(x1 * x2 - 700.0),
            ge(x2 - x1.powi(2) / 125.0),
            ge((x2 - 50.0).powi(2) - (x1 - 55.0) * 5.0),
        ],
    );

    Hs60 60 from [2.0; 3], in each(3, -10.0, 10.0), to 0.032_568_200_25;
    (x1 x2 x3) => (
        (x1 - 1.0).powi(2) + (x1 - x2).powi(2) + (x2 - x3).powi(4),
        vec![eq(x1 * (x2 * x2 + 1.0) + x3.powi(4) - (4.0 + 3.0 * 2.0_f64.sqrt()))],
    );

    Hs61 61 from [0.0; 3], in free(3), to -143.646_142_2;
    (x1 x2 x3) => (
        x1 * x1 * 4.0 + x2 * x2 * 2.0 + x3 * x3 * 2.0 - x1 * 33.0 + x2 * 16.0 - x3 * 24.0,
        vec![eq(x1 * 3.0 - x2 * x2 * 2.0 - 7.0), eq(x1 * 4.0 - x3 * x3 - 11.0)],
    );

    Hs62 62 from [0.7, 0.2, 0.1], in each(3, 0.0, 1.0), to -26_272.514_48;
    (x1 x2 x3) => (
        (((x1 + x2 + x3 + 0.03) / (x1 * 0.09 + x2 + x3 + 0.03)).ln() * 255.0
            + ((x2 + x3 + 0.03) / (x2 * 0.07 + x3 + 0.03)).ln() * 280.0
            + ((x3 + 0.03) / (x3 * 0.13 + 0.03)).ln() * 290.0)
            * -32.174,
        vec![eq(x1 + x2 + x3 - 1.0)],
    );

    Hs63 63 from [2.0; 3], in positive(3), to 961.715_172_1;
    (x1 x2 x3) => (
        -x1 * x1 - x2 * x2 * 2.0 - x3 * x3 - x1 * x2 - x1 * x3 + 1000.0,
        vec![
            eq(x1 * 8.0 + x2 * 14.0 + x3 * 7.0 - 56.0),
            eq(x1 * x1 + x2 * x2 + x3 * x3 - 25.0),
        ],
    );

    Hs64 64 from [1.0; 3], in each(3, 1e-5, INF), to 6_299.842_428;
    (x1 x2 x3) => (
        x1 * 5.0 + k::<D>(5e4) / x1 + x2 * 20.0 + k::<D>(7.2e4) / x2 + x3 * 10.0 + k::<D>(1.44e5) / x3,
        vec![ge(k::<D>(1.0) - k::<D>(4.0) / x1 - k::<D>(32.0) / x2 - k::<D>(120.0) / x3)],
    );

    Hs65 65 from [-5.0, 5.0, 0.0], in [(-4.5, 4.5), (-4.5, 4.5), (-5.0, 5.0)], to 0.953_528_856_7;
    (x1 x2 x3) => (
        (x1 - x2).powi(2) + (x1 + x2 - 10.0).powi(2) / 9.0 + (x3 - 5.0).powi(2),
        vec![ge(-x1 * x1 - x2 * x2 - x3 * x3 + 48.0)],
    );

    Hs66 66 from [0.0, 1.05, 2.9], in [(0.0, 100.0), (0.0, 100.0), (0.0, 10.0)], to 0.518_163_274_1;
    (x1 x2 x3) => (x3 * 0.2 - x1 * 0.8, vec![ge(x2 - x1.exp()), ge(x3 - x2.exp())]);

    Hs68 68 from [1.0; 4], in [(1e-4, 100.0), (0.0, 100.0), (0.0, 2.0), (0.0, 2.0)], to -0.920_425_026;
    (slice x) => chart(x, [1e-4, 1.0, 1.0, 24.0]);

    Hs69 69 from [1.0; 4], in [(1e-4, 100.0), (0.0, 100.0), (0.0, 2.0), (0.0, 2.0)], to -956.712_88;
    (slice x) => chart(x, [0.1, 1000.0, 1.0, 4.0]);

    Hs70 70 from [2.0, 4.0, 0.04, 2.0], in [(1e-5, 100.0), (1e-5, 100.0), (1e-5, 1.0), (1e-5, 100.0)],
        to 0.007_498_464;
    (x1 x2 x3 x4) => {
        let b = x3 + (-x3 + 1.0) * x4;
        let part = |shape: D, rate: D, c: f64| {
            let scale = k::<D>(1.0) / (k::<D>(1.0) + k::<D>(1.0) / (shape * 12.0));
            scale * (rate.ln() * shape).exp() * (shape / TURN).sqrt()
                * ((shape - 1.0) * (c / 7.658_f64).ln()).exp()
                * (shape - rate * shape * (c / 7.658)).exp()
        };
        let residual = |(&c, &y): (&f64, &f64)| {
            x3 * part(x2, b, c) + (-x3 + 1.0) * part(x1, b / x4, c) - y
        };
        (sum(HS70_C.iter().zip(&HS70_Y).map(|data| residual(data).powi(2))), vec![ge(b)])
    };

    Hs71 71 from [1.0, 5.0, 5.0, 1.0], in each(4, 1.0, 5.0), to 17.014_017_3;
    (x1 x2 x3 x4) => (
        x1 * x4 * (x1 + x2 + x3) + x3,
        vec![
            ge(x1 * x2 * x3 * x4 - 25.0),
            eq(x1 * x1 + x2 * x2 + x3 * x3 + x4 * x4 - 40.0),
        ],
    );

    Hs72 72 from [1.0; 4], in [(1e-3, 4e5), (1e-3, 3e5), (1e-3, 2e5), (1e-3, 1e5)], to 727.679_37;
    (x1 x2 x3 x4) => {
        let over = |a: f64, x: D| k::<D>(a) / x;
        (
            x1 + x2 + x3 + x4 + 1.0,
            vec![
                ge(-over(4.0, x1) - over(2.25, x2) - over(1.0, x3) - over(0.25, x4) + 0.0401),
                ge(-over(0.16, x1) - over(0.36, x2) - over(0.64, x3) - over(0.64, x4) + 0.010_085),
            ],
        )
    };

    Hs73 73 from [1.0; 4], in positive(4), to 29.894_378;
    (x1 x2 x3 x4) => {
        let spread = x1 * x1 * 0.28 + x2 * x2 * 0.19 + x3 * x3 * 20.5 + x4 * x4 * 0.62;
        (
            x1 * 24.55 + x2 * 26.75 + x3 * 39.0 + x4 * 40.5,
            vec![
                ge(x1 * 2.3 + x2 * 5.6 + x3 * 11.1 + x4 * 1.3 - 5.0),
                ge(x1 * 12.0 + x2 * 11.9 + x3 * 41.8 + x4 * 52.1 - 21.0 - spread.sqrt() * 1.645),
                eq(x1 + x2 + x3 + x4 - 1.0),
            ],
        )
    };

    Hs74 74 from [0.0; 4], in [(0.0, 1200.0), (0.0, 1200.0), (-0.55, 0.55), (-0.55, 0.55)], to 5_126.498_1;
    (slice x) => scheduling(x, 0.55);

    Hs75 75 from [0.0; 4], in [(0.0, 1200.0), (0.0, 1200.0), (-0.48, 0.48), (-0.48, 0.48)], to 5_174.412_9;
    (slice x) => scheduling(x, 0.48);

    Hs76 76 from [0.5; 4], in positive(4), to -4.681_818_181;
    (x1 x2 x3 x4) => (
        x1 * x1 + x2 * x2 * 0.5 + x3 * x3 + x4 * x4 * 0.5 - x1 * x3 + x3 * x4 - x1 - x2 * 3.0 + x3 - x4,
        vec![
            ge(-x1 - x2 * 2.0 - x3 - x4 + 5.0),
            ge(x1 * -3.0 - x2 - x3 * 2.0 + x4 + 4.0),
            ge(x2 + x3 * 4.0 - 1.5),
        ],
    );

    Hs77 77 from [2.0; 5], in free(5), to 0.241_505_13;
    (x1 x2 x3 x4 x5) => (
        (x1 - 1.0).powi(2) + (x1 - x2).powi(2) + (x3 - 1.0).powi(2) + (x4 - 1.0).powi(4)
            + (x5 - 1.0).powi(6),
        vec![
            eq(x1 * x1 * x4 + (x4 - x5).sin() - 2.0 * 2.0_f64.sqrt()),
            eq(x2 + x3.powi(4) * x4 * x4 - 8.0 - 2.0_f64.sqrt()),
        ],
    );

    Hs78 78 from [-2.0, 1.5, 2.0, -1.0, -1.0], in free(5), to -2.919_700_41;
    (slice x) => (product(x), powell(x));

    Hs79 79 from [2.0; 5], in free(5), to 0.078_776_820_9;
    (x1 x2 x3 x4 x5) => {
        let r = 2.0_f64.sqrt();
        (
            (x1 - 1.0).powi(2) + (x1 - x2).powi(2) + (x2 - x3).powi(2) + (x3 - x4).powi(4)
                + (x4 - x5).powi(4),
            vec![
                eq(x1 + x2 * x2 + x3.powi(3) - 2.0 - 3.0 * r),
                eq(x2 - x3 * x3 + x4 + 2.0 - 2.0 * r),
                eq(x1 * x5 - 2.0),
            ],
        )
    };

    Hs80 80 from [-2.0, 2.0, 2.0, -1.0, -1.0], in powell_bounds(), to 0.053_949_847_8;
    (slice x) => (product(x).exp(), powell(x));

    Hs81 81 from [-2.0, 2.0, 2.0, -1.0, -1.0], in powell_bounds(), to 0.053_949_847_8;
    (slice x) => (
        product(x).exp() - (x[0].powi(3) + x[1].powi(3) + 1.0).powi(2) * 0.5,
        powell(x),
    );
}

//! Four nodes at once against the same nodes one by one, for every model.

use pid_fit::transcribe::ExplicitForm;
use pid_models::{Arm6, all};
use pid_runtime::dynamics::{At, Dynamics, Hessian};
use pid_runtime::lanes::{LANES, Lane, LanesAt};
use pid_tests::mismatched::Geared;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Four nodes with common parameters, and multipliers at each.
struct Nodes {
    q: Vec<Lane>,
    v: Vec<Lane>,
    a: Vec<Lane>,
    u: Vec<Lane>,
    p: Vec<f64>,
    lambda: Vec<Lane>,
}

impl Nodes {
    fn new(model: &dyn Dynamics, rng: &mut ChaCha8Rng) -> Self {
        let d = model.dims();
        let mut lanes = |n: usize, scale: f64| -> Vec<Lane> {
            (0..n)
                .map(|_| std::array::from_fn(|_| scale * rng.random_range(-1.0..1.0)))
                .collect()
        };
        let (q, v, a) = (lanes(d.nq, 3.2), lanes(d.nq, 4.0), lanes(d.nq, 20.0));
        let (u, lambda) = (lanes(d.nu, 30.0), lanes(d.nq, 1.0));
        // Near nominal, where the bodies are those of matter; zeros are moved.
        let nominal = model.params().iter().map(|p| p.nominal);
        let p = nominal
            .map(|x| match x == 0.0 {
                true => 0.001 * rng.random_range(-1.0..1.0),
                false => x * rng.random_range(0.95..1.05),
            })
            .collect();
        Self {
            q,
            v,
            a,
            u,
            p,
            lambda,
        }
    }

    fn at(&self) -> LanesAt<'_> {
        LanesAt {
            q: &self.q,
            v: &self.v,
            a: &self.a,
            u: &self.u,
            p: &self.p,
        }
    }

    /// One node: its arguments and multipliers.
    fn with_node<T>(&self, lane: usize, f: impl FnOnce(&At<'_>, &[f64]) -> T) -> T {
        let pick = |x: &[Lane]| -> Vec<f64> { x.iter().map(|x| x[lane]).collect() };
        let (q, v, a, u) = (pick(&self.q), pick(&self.v), pick(&self.a), pick(&self.u));
        let at = At {
            q: &q,
            v: &v,
            a: &a,
            u: &u,
            p: &self.p,
        };
        f(&at, &pick(&self.lambda))
    }
}

/// `found` equals the values of each node to `tolerance` of the largest of them, or of `least`.
fn check(
    what: &str,
    found: &[Lane],
    (tolerance, least): (f64, f64),
    one: impl Fn(usize, &mut [f64]),
) {
    for lane in 0..LANES {
        let mut expected = vec![f64::NAN; found.len()];
        one(lane, &mut expected);
        let scale = expected.iter().fold(least, |m: f64, x| m.max(x.abs()));
        for (k, (found, x)) in found.iter().zip(&expected).enumerate() {
            let error = (found[lane] - x).abs();
            assert!(
                error <= tolerance * scale,
                "{what}[{k}], lane {lane}: {} for {x}, scale {scale}",
                found[lane]
            );
        }
    }
}

fn check_model(name: &str, model: &dyn Hessian, tolerance: f64) {
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    let d = model.dims();
    let (nj, nh) = (
        model.jacobian_pattern().nnz(),
        model.hessian_pattern().nnz(),
    );
    let lanes = |n: usize| vec![[f64::NAN; LANES]; n];
    // Far from rest the terms `dry sharp (1 − tanh²)` of J and those of H are small differences,
    // good to a few units of what they are differences of. Models without a parameter for it have a
    // sharpness of at most 200.
    let largest = |stem: &str| {
        let own = model.params().iter().filter(|p| p.name.starts_with(stem));
        own.fold(0.0, |m: f64, p| m.max(p.nominal))
    };
    let sharp = match largest("sharp") {
        0.0 => 200.0,
        sharp => sharp,
    };
    let friction = 0.1 * largest("dry") * sharp;
    let exact = (tolerance, 0.0);
    for _ in 0..50 {
        let nodes = Nodes::new(model, &mut rng);
        let at = nodes.at();
        let mut out = lanes(d.nq);
        model.residual_lanes(&at, &mut out);
        check(&format!("{name} r"), &out, exact, |lane, r| {
            nodes.with_node(lane, |at, _| model.residual(at, r));
        });

        model.applied_force_lanes(&at, &mut out);
        check(&format!("{name} f"), &out, exact, |lane, f| {
            nodes.with_node(lane, |at, _| model.applied_force(at, f));
        });

        let mut out = lanes(d.nm());
        model.mass_matrix_lanes(&at, &mut out);
        check(&format!("{name} M"), &out, exact, |lane, m| {
            nodes.with_node(lane, |at, _| model.mass_matrix(at, m));
        });

        let (mut r, mut out) = (lanes(d.nq), lanes(nj));
        model.residual_jacobian_lanes(&at, &mut r, &mut out);
        check(
            &format!("{name} J"),
            &out,
            (tolerance, friction),
            |lane, values| {
                let mut r = vec![0.0; d.nq];
                nodes.with_node(lane, |at, _| model.residual_jacobian(at, &mut r, values));
            },
        );
        check(&format!("{name} r of J"), &r, exact, |lane, r| {
            nodes.with_node(lane, |at, _| model.residual(at, r));
        });

        let mut out = lanes(nh);
        model.residual_hessian_lanes(&at, &nodes.lambda, &mut out);
        check(
            &format!("{name} H"),
            &out,
            (tolerance, friction * sharp),
            |lane, values| {
                nodes.with_node(lane, |at, lambda| {
                    model.residual_hessian(at, lambda, values);
                });
            },
        );
    }
}

#[test]
fn four_nodes_at_once_equal_one_by_one() {
    for entry in all() {
        check_model(entry.name, entry.model, 1e-14);
    }
    check_model("arm with rotors", &Geared::new(&Arm6), 1e-14);
}

/// A model without lanes of its own evaluates its nodes one by one, through a model that has them.
#[test]
fn models_without_lanes_of_their_own_evaluate_node_by_node() {
    for entry in all().iter().filter(|e| e.model.dims().nq <= 4) {
        let explicit = ExplicitForm::new(entry.model);
        check_model(entry.name, &explicit, 0.0);
    }
}

#[test]
#[should_panic(expected = "`q` must have 6 entries, the dimensions of the model, but has 5")]
fn wrong_length_names_the_argument() {
    let model = pid_models::Arm6;
    let (five, six) = ([[0.0; LANES]; 5], [[0.0; LANES]; 6]);
    let at = LanesAt {
        q: &five,
        v: &six,
        a: &six,
        u: &six,
        p: &[0.0; 84],
    };
    model.residual_lanes(&at, &mut [[0.0; LANES]; 6]);
}

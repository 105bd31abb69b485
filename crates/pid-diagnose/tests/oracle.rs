//! Two derivations of the same physics: the programs on the compiler's equations, by which records
//! are diagnosed, and the study's own linkage, by which withheld cases are simulated.

use std::fmt::Write;

use pid_diagnose::constants::{Constant, Constants};
use pid_diagnose::nominal::Nominal;
use pid_diagnose::scalar::Lanes;
use pid_interpret::links::{At, Links};
use pid_withheld::linkage::Surroundings;
use pid_withheld::plant::{PER_JOINT, Plant};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A description of one to seven joints: chains and branches, slides and hinges, axes of the frames
/// and others.
fn drawn(random: &mut ChaCha8Rng) -> Nominal {
    let mut x = |low: f64, high: f64| random.random_range(low..high);
    let n = 1 + x(0.0, 7.0) as usize;
    let mut text = format!(
        "[robot]\nname = \"drawn\"\ngravity = [{}, {}, {}]\ntool = [{}, {}, {}]\n[tolerance]\nmass_rel = 0.05\ncom_abs_m = 0.01\n\
         inertia_rel = 0.1\nrotor_inertia_rel = 0.1\nmotor_gain_rel = 0.02\nfriction_rel = 0.2\n",
        x(-3.0, 3.0),
        x(-3.0, 3.0),
        x(-10.0, 10.0),
        x(-0.3, 0.3),
        x(-0.3, 0.3),
        x(-0.3, 0.3),
    );
    for k in 0..n {
        let kind = if x(0.0, 1.0) < 0.25 {
            "prismatic"
        } else {
            "revolute"
        };
        let axis = match x(0.0, 5.0) as usize {
            0 => [1.0, 0.0, 0.0],
            1 => [0.0, -1.0, 0.0],
            2 | 3 => [0.0, 0.0, 1.0],
            _ => [x(-1.0, 1.0), x(-1.0, 1.0), x(0.1, 1.0)],
        };
        let parent = match (x(0.0, 1.0) < 0.3, k) {
            (false, _) | (_, 0) => String::new(),
            _ => match x(0.0, k as f64 + 1.0) as usize {
                0 => "parent = \"base\"\n".to_owned(),
                p => format!("parent = \"j{}\"\n", p - 1),
            },
        };
        let rpy = match x(0.0, 3.0) as usize {
            0 => [0.0; 3],
            1 => [std::f64::consts::FRAC_PI_2, 0.0, 0.0],
            _ => [x(-3.0, 3.0), x(-1.5, 1.5), x(-3.0, 3.0)],
        };
        write!(
            text,
            "[[joint]]\nname = \"j{k}\"\ntype = \"{kind}\"\naxis = {axis:?}\n{parent}origin = {:?}\nrpy = {rpy:?}\nmass = {}\ncom = {:?}\n\
             inertia = {:?}\nrotor_inertia = 0.1\ncoulomb = 0.1\nviscous = 0.1\nmotor_gain = 1.0\ninput = \"current\"\nvelocity = \"measured\"\n",
            [x(-0.5, 0.5), x(-0.5, 0.5), x(-0.5, 0.5)],
            x(0.2, 5.0),
            [x(-0.2, 0.2), x(-0.2, 0.2), x(-0.2, 0.2)],
            [x(0.02, 0.03), x(0.02, 0.03), x(0.02, 0.03), x(-0.003, 0.003), x(-0.003, 0.003), x(-0.003, 0.003)],
        )
        .expect("a text");
    }
    Nominal::parse(&text, "nominal.toml".as_ref()).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// M (row by row), b, Jᵀ f of the force (1, −2, 3) N on the tool.
type Physics = [Vec<f64>; 3];

const FORCE: [f64; 3] = [1.0, -2.0, 3.0];

fn programs(nominal: &Nominal, q: &[f64], v: &[f64]) -> Physics {
    let n = q.len();
    let links: &Links = &nominal.links;
    let p = nominal.parameters(&vec![0.0; nominal.size()]);
    let mut work = links.prepare(&p, &links.constants(&p));
    let (mut bias, mut pushed) = (vec![0.0; n], vec![0.0; n]);
    let mut at = At { q, v, force: None };
    links.evaluate(&mut work, &at, f64::sin_cos, &mut bias);
    at.force = Some(FORCE);
    links.evaluate(&mut work, &at, f64::sin_cos, &mut pushed);
    let entry = |k: usize| {
        let (i, j) = ((k / n).max(k % n), (k / n).min(k % n));
        work.mass()[i * (i + 1) / 2 + j]
    };
    let push = bias.iter().zip(&pushed).map(|(b, p)| b - p).collect();
    [(0..n * n).map(entry).collect(), bias, push]
}

fn linkage(plant: &Plant<f64>, q: &[f64], v: &[f64]) -> Physics {
    let n = q.len();
    let run = |tip_force: Option<[f64; 3]>| {
        let around = Surroundings {
            gravity: plant.gravity,
            tip_force,
        };
        let (mut mass, mut bias) = (vec![0.0; n * n], vec![0.0; n]);
        plant
            .linkage()
            .mass_and_bias(&around, (q, v), &mut mass, &mut bias);
        (mass, bias)
    };
    let ((mass, bias), (_, pushed)) = (run(None), run(Some(FORCE)));
    let push = bias.iter().zip(&pushed).map(|(b, p)| b - p).collect();
    [mass, bias, push]
}

/// Largest difference of M, b and Jᵀ f, each relative to its largest entry.
fn difference(a: &Physics, b: &Physics) -> f64 {
    let largest = |x: &[f64]| x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    // What a force on the tool does is the difference of two biases: its rounding is theirs.
    let scales = [
        largest(&a[0]),
        largest(&a[1]).max(1e-3),
        largest(&a[2]).max(largest(&a[1])).max(1e-3),
    ];
    (0..3)
        .flat_map(|k| {
            a[k].iter()
                .zip(&b[k])
                .map(move |(x, y)| (x - y).abs() / scales[k])
        })
        .fold(0.0, f64::max)
}

#[test]
fn programs_and_linkage_agree_on_fifty_drawn_trees() {
    let mut random = ChaCha8Rng::seed_from_u64(33);
    let mut worst = 0.0_f64;
    for case in 0..50 {
        let nominal = drawn(&mut random);
        let n = nominal.n();
        let plant = Plant::<f64>::new(&nominal.description, &vec![0.0; n * PER_JOINT]);
        for _ in 0..3 {
            let mut draw = |most: f64| -> Vec<f64> {
                (0..n).map(|_| random.random_range(-most..most)).collect()
            };
            let (q, v) = (draw(3.0), draw(4.0));
            let off = difference(&programs(&nominal, &q, &v), &linkage(&plant, &q, &v));
            assert!(off < 1e-13, "tree {case} of {n} joints: {off:.1e}");
            worst = worst.max(off);
        }
    }
    assert!(worst > 0.0, "two derivations round differently");
}

#[test]
fn a_mistake_in_one_is_seen_by_the_other() {
    let mut random = ChaCha8Rng::seed_from_u64(34);
    // A chain of hinges, so that every joint feels the last link; on a branch of its own a link may
    // turn about one axis alone.
    let chain = |nominal: &Nominal| {
        let mut joints = nominal.description.robot().joints.iter().enumerate();
        joints.all(|(k, j)| !j.kind.is_length() && j.parent == k.checked_sub(1))
    };
    let nominal = (0..200)
        .map(|_| drawn(&mut random))
        .find(|nominal| nominal.n() >= 4 && chain(nominal))
        .expect("a chain of four joints");
    let n = nominal.n();
    let q: Vec<f64> = (0..n).map(|k| 0.4 + 0.3 * k as f64).collect();
    let v: Vec<f64> = (0..n).map(|k| 1.0 - 0.5 * k as f64).collect();
    let right = programs(&nominal, &q, &v);
    let mistaken = |change: &dyn Fn(&mut Plant<f64>)| {
        let mut plant = Plant::<f64>::new(&nominal.description, &vec![0.0; n * PER_JOINT]);
        change(&mut plant);
        difference(&right, &linkage(&plant, &q, &v))
    };
    assert!(mistaken(&|_| {}) < 1e-13);
    // A product of inertia of the other sign, as −∫xz dm is often taken; the link's arm in the wrong axes.
    let last = n - 1;
    assert!(mistaken(&|p| p.bodies[last].inertia[4] *= -1.0) > 1e-6);
    assert!(mistaken(&|p| p.hinges[last].origin.swap(0, 1)) > 1e-6);
}

#[test]
fn derivatives_of_programs_are_those_of_differences() {
    let mut random = ChaCha8Rng::seed_from_u64(35);
    for _ in 0..5 {
        let nominal = drawn(&mut random);
        let (n, size) = (nominal.n(), nominal.size());
        let draw = |random: &mut ChaCha8Rng, count: usize| -> Vec<f64> {
            (0..count).map(|_| random.random_range(-1.0..1.0)).collect()
        };
        let (q, v) = (draw(&mut random, n), draw(&mut random, n));
        let direction = draw(&mut random, size + 2 * n);
        let at = |step: f64| {
            let moved = |x: &[f64], from: usize| -> Vec<f64> {
                x.iter()
                    .enumerate()
                    .map(|(k, x)| x + step * direction[from + k])
                    .collect()
            };
            let theta = moved(&vec![0.0; size], 0);
            let p = nominal.parameters(&theta);
            let mut work = nominal.links.prepare(&p, &nominal.links.constants(&p));
            let mut bias = vec![0.0; n];
            let (q, v) = (moved(&q, size), moved(&v, size + n));
            let at = At {
                q: &q,
                v: &v,
                force: Some(FORCE),
            };
            nominal
                .links
                .evaluate(&mut work, &at, f64::sin_cos, &mut bias);
            bias.extend(work.mass());
            bias
        };
        let lift = |x: &[f64], from: usize| -> Vec<Lanes<4>> {
            let one = |(k, x): (usize, &f64)| {
                let mut lane = Lanes {
                    re: *x,
                    eps: [0.0; 4],
                };
                lane.eps[2] = direction[from + k];
                lane
            };
            x.iter().enumerate().map(one).collect()
        };
        let theta = lift(&vec![0.0; size], 0);
        let p = nominal.parameters(&theta);
        let mut work = nominal.links.prepare(&p, &nominal.links.constants(&p));
        let mut bias = vec![
            Lanes {
                re: 0.0,
                eps: [0.0; 4]
            };
            n
        ];
        let (dual_q, dual_v) = (lift(&q, size), lift(&v, size + n));
        let force = FORCE.map(|re| Lanes { re, eps: [0.0; 4] });
        let place = At {
            q: &dual_q,
            v: &dual_v,
            force: Some(force),
        };
        nominal.links.evaluate(
            &mut work,
            &place,
            pid_diagnose::scalar::Scalar::sine_cosine,
            &mut bias,
        );
        bias.extend(work.mass());
        let (ahead, back, here) = (at(1e-5), at(-1e-5), at(0.0));
        let scale = here.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
        for (k, x) in bias.iter().enumerate() {
            assert!((x.re - here[k]).abs() < 1e-12 * scale);
            let slope = (ahead[k] - back[k]) / 2e-5;
            assert!(
                (x.eps[2] - slope).abs() < 1e-6 * scale,
                "{} {slope}",
                x.eps[2]
            );
            assert_eq!((x.eps[0], x.eps[1], x.eps[3]), (0.0, 0.0, 0.0));
        }
    }
}

#[test]
fn a_payload_is_a_body_more() {
    let nominal = drawn(&mut ChaCha8Rng::seed_from_u64(36));
    let n = nominal.n();
    let theta = vec![0.0; nominal.size()];
    let mut constants = Constants::<f64>::new(&nominal, &theta);
    let (body, at) = constants.tool().expect("a body");
    let before = constants.get(Constant::Mass(body));
    constants.add_point_mass(body, 0.7, at);
    assert_eq!(constants.get(Constant::Mass(body)), before + 0.7);
    let mut plant = Plant::<f64>::new(&nominal.description, &vec![0.0; n * PER_JOINT]);
    let tool = plant.tool;
    pid_withheld::rigid::add_point(&mut plant.bodies[n - 1], 0.7, tool);
    for (k, x) in plant.bodies[n - 1].inertia.iter().enumerate() {
        let own = constants.get(Constant::Inertia(body, k));
        assert!((own - x).abs() < 1e-14, "{own} {x}");
    }
}

//! Properties on random expressions: folding keeps values, derivatives are those of num-dual and of
//! central differences, plans compute what the interpreter computes.

use num_dual::{Dual64, HyperDual64};
use pid_symbolic::program::{LANES, Scratch};
use pid_symbolic::{Cost, Function, Graph, Id, Node, Plan, Program, Tape, diff, pattern, schedule};
use proptest::prelude::*;

const VARS: usize = 4;

/// An expression as a program: each step uses results of earlier ones. Constants and signs that
/// fold occur often.
#[derive(Debug, Clone)]
enum Step {
    Const(f64),
    Neg(usize),
    Add(usize, usize),
    Sub(usize, usize),
    Mul(usize, usize),
    Div(usize, usize),
    Powi(usize, i32),
    Call(Function, usize),
}

fn step() -> impl Strategy<Value = Step> {
    let at = || 0usize..64;
    prop_oneof![
        2 => prop_oneof![Just(0.0), Just(1.0), Just(-1.0), Just(2.0), -3.0..3.0f64].prop_map(Step::Const),
        2 => at().prop_map(Step::Neg),
        4 => (at(), at()).prop_map(|(x, y)| Step::Add(x, y)),
        4 => (at(), at()).prop_map(|(x, y)| Step::Sub(x, y)),
        6 => (at(), at()).prop_map(|(x, y)| Step::Mul(x, y)),
        1 => (at(), at()).prop_map(|(x, y)| Step::Div(x, y)),
        1 => (at(), -3..6).prop_map(|(x, n)| Step::Powi(x, n)),
        3 => (proptest::sample::select(Function::ALL.to_vec()), at()).prop_map(|(f, x)| Step::Call(f, x)),
    ]
}

fn program() -> impl Strategy<Value = (Vec<Step>, Vec<f64>)> {
    (
        proptest::collection::vec(step(), 1..40),
        proptest::collection::vec(-2.0..2.0f64, VARS),
    )
}

/// Operands are drawn into a range where functions are smooth and values moderate, without changing
/// the kind of graph: arguments of `ln`, `sqrt` and denominators become 1 + x².
fn build(g: &mut Graph, steps: &[Step]) -> Vec<Id> {
    let mut ids: Vec<Id> = (0..VARS).map(|i| g.var(i)).collect();
    for step in steps {
        let at = |k: usize| ids[k % ids.len()];
        let positive = |g: &mut Graph, x: Id| {
            let (one, square) = (g.one(), g.mul(x, x));
            g.add(one, square)
        };
        let id = match *step {
            Step::Const(c) => g.constant(c),
            Step::Neg(x) => g.neg(at(x)),
            Step::Add(x, y) => g.add(at(x), at(y)),
            Step::Sub(x, y) => g.sub(at(x), at(y)),
            Step::Mul(x, y) => g.mul(at(x), at(y)),
            Step::Div(x, y) => {
                let y = positive(g, at(y));
                g.div(at(x), y)
            }
            Step::Powi(x, n) if n < 0 => {
                let x = positive(g, at(x));
                g.powi(x, n)
            }
            Step::Powi(x, n) => g.powi(at(x), n),
            Step::Call(f @ (Function::Ln | Function::Sqrt), x) => {
                let x = positive(g, at(x));
                g.call(f, x)
            }
            // Poles, overflow and kinks: the sine stays inside.
            Step::Call(f @ (Function::Tan | Function::Exp), x) => {
                let x = g.sin(at(x));
                g.call(f, x)
            }
            Step::Call(f, x) => g.call(f, at(x)),
        };
        ids.push(id);
    }
    ids
}

/// The same program on numbers, nothing folded. `None` where it comes near a kink or leaves a
/// moderate range, where rounding would be the subject.
fn plain(steps: &[Step], vars: &[f64]) -> Option<Vec<f64>> {
    let mut values = vars.to_vec();
    for step in steps {
        let at = |k: usize| values[k % values.len()];
        let value = match *step {
            Step::Const(c) => c,
            Step::Neg(x) => -at(x),
            Step::Add(x, y) => at(x) + at(y),
            Step::Sub(x, y) => at(x) - at(y),
            Step::Mul(x, y) => at(x) * at(y),
            Step::Div(x, y) => at(x) / (1.0 + at(y) * at(y)),
            Step::Powi(x, n) if n < 0 => (1.0 + at(x) * at(x)).powi(n),
            Step::Powi(x, n) => at(x).powi(n),
            Step::Call(f @ (Function::Ln | Function::Sqrt), x) => f.apply(1.0 + at(x) * at(x)),
            Step::Call(f @ (Function::Tan | Function::Exp), x) => f.apply(at(x).sin()),
            Step::Call(Function::Abs | Function::Sign, x) if at(x).abs() < 1e-2 => return None,
            Step::Call(f, x) => f.apply(at(x)),
        };
        if value.abs() > 50.0 {
            return None;
        }
        values.push(value);
    }
    Some(values)
}

fn evaluate(g: &Graph, outputs: &[Id], vars: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; outputs.len()];
    Tape::new(g, outputs).eval(vars, &mut out);
    out
}

fn close(found: f64, expected: f64, tolerance: f64, scale: f64) -> Result<(), TestCaseError> {
    prop_assert!(
        (found - expected).abs() <= tolerance * (scale + expected.abs()),
        "{found:e} for {expected:e}"
    );
    Ok(())
}

/// Runs a plan block by block on a poisoned workspace, as the emitted functions would.
fn run(g: &Graph, plan: &Plan, outputs: &[Id], vars: &[f64]) -> Vec<f64> {
    let mut slots = vec![f64::NAN; plan.slots];
    let mut out = vec![f64::NAN; outputs.len()];
    for block in &plan.blocks {
        // Only what this block loads or computes is visible.
        let mut local = vec![None; g.len()];
        for &(id, slot) in &block.loads {
            local[id.index()] = Some(slots[slot]);
        }
        let at = |local: &[Option<f64>], id: Id| match g.node(id) {
            Node::Const(c) => c.value(),
            Node::Var(i) => vars[i as usize],
            _ => local[id.index()].expect("loaded or computed before use"),
        };
        for &id in &block.nodes {
            let value = match g.node(id) {
                Node::Const(_) | Node::Var(_) => unreachable!("leaves are not scheduled"),
                Node::Neg(x) => -at(&local, x),
                Node::Add(x, y) => at(&local, x) + at(&local, y),
                Node::Sub(x, y) => at(&local, x) - at(&local, y),
                Node::Mul(x, y) => at(&local, x) * at(&local, y),
                Node::Div(x, y) => at(&local, x) / at(&local, y),
                Node::Powi(x, n) => at(&local, x).powi(n),
                Node::Call(f, x) => f.apply(at(&local, x)),
            };
            local[id.index()] = Some(value);
        }
        for &(id, slot) in &block.stores {
            slots[slot] = at(&local, id);
        }
        for &position in &block.outputs {
            out[position] = at(&local, outputs[position]);
        }
    }
    out
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, rng_seed: proptest::test_runner::RngSeed::Fixed(7), ..ProptestConfig::default() })]

    #[test]
    fn folding_preserves_values((steps, vars) in program()) {
        let Some(expected) = plain(&steps, &vars) else { return Ok(()) };
        let mut g = Graph::new();
        let ids = build(&mut g, &steps);
        for (found, expected) in evaluate(&g, &ids, &vars).into_iter().zip(expected) {
            close(found, expected, 1e-10, 1.0)?;
        }
    }

    #[test]
    fn batches_equal_single_points((steps, vars) in program(), points in 1usize..20) {
        let mut g = Graph::new();
        let ids = build(&mut g, &steps);
        let tape = Tape::new(&g, &ids);
        let at = |point: usize| vars.iter().map(|x| x * (1.0 + 0.01 * point as f64)).collect::<Vec<_>>();
        let mut columns = vec![0.0; VARS * points];
        for point in 0..points {
            for (i, x) in at(point).into_iter().enumerate() {
                columns[i * points + point] = x;
            }
        }
        let mut out = vec![0.0; ids.len() * points];
        tape.eval_batch(points, &columns, &mut out);
        for point in 0..points {
            for (k, expected) in evaluate(&g, &ids, &at(point)).into_iter().enumerate() {
                prop_assert_eq!(out[k * points + point].to_bits(), expected.to_bits());
            }
        }
    }

    #[test]
    fn derivatives_equal_num_dual((steps, vars) in program()) {
        let Some(size) = plain(&steps, &vars) else { return Ok(()) };
        let mut g = Graph::new();
        let output = *build(&mut g, &steps).last().expect("there are variables");
        let wrt: Vec<Id> = (0..VARS).map(|i| g.var(i)).collect();
        let gradient = diff::gradient(&mut g, output, &wrt);
        let hessian = diff::hessian(&mut g, output, &wrt);
        let tape = Tape::new(&g, &[output]);
        let scale = size.iter().fold(1.0_f64, |scale, x| scale.max(x.abs()));

        let found = evaluate(&g, &gradient, &vars);
        let mut dense = [[0.0; VARS]; VARS];
        let values: Vec<Id> = hessian.iter().map(|entry| entry.value).collect();
        for (entry, value) in hessian.iter().zip(evaluate(&g, &values, &vars)) {
            prop_assert!(entry.row >= entry.col);
            dense[entry.row][entry.col] = value;
        }
        // One direction for all: the sum of the columns.
        let one = g.one();
        let ones: Vec<(Id, Id)> = wrt.iter().map(|&var| (var, one)).collect();
        let along = diff::directional(&mut g, &[output], &ones);
        let along = evaluate(&g, &along, &vars)[0];

        let mut slope = 0.0;
        let mut largest = scale;
        for i in 0..VARS {
            let mut z: Vec<Dual64> = vars.iter().map(|&x| Dual64::from(x)).collect();
            z[i].eps = 1.0;
            let mut y = [Dual64::from(0.0)];
            tape.eval(&z, &mut y);
            // Large slopes come with cancellations of their size.
            largest = largest.max(y[0].eps.abs());
            if largest > 1e6 {
                return Ok(());
            }
            close(found[i], y[0].eps, 1e-9, largest)?;
            slope += y[0].eps;
            for j in 0..=i {
                let mut z: Vec<HyperDual64> = vars.iter().map(|&x| HyperDual64::from(x)).collect();
                z[i].eps1 = 1.0;
                z[j].eps2 = 1.0;
                let mut y = [HyperDual64::from(0.0)];
                tape.eval(&z, &mut y);
                if y[0].eps1eps2.abs() < 1e6 {
                    close(dense[i][j], y[0].eps1eps2, 1e-7, largest * largest)?;
                }
            }
        }
        close(along, slope, 1e-9, largest)?;
    }

    #[test]
    fn gradient_equals_central_differences((steps, vars) in program()) {
        let mut g = Graph::new();
        let output = *build(&mut g, &steps).last().expect("there are variables");
        let wrt: Vec<Id> = (0..VARS).map(|i| g.var(i)).collect();
        let gradient = diff::gradient(&mut g, output, &wrt);
        let found = evaluate(&g, &gradient, &vars);
        let at = |i: usize, h: f64| {
            let mut z = vars.clone();
            z[i] += h;
            plain(&steps, &z).map(|values| *values.last().expect("there are variables"))
        };
        for (i, found) in found.into_iter().enumerate() {
            let slope = |h: f64| Some((at(i, h)? - at(i, -h)?) / (2.0 * h));
            let (Some(fine), Some(coarse)) = (slope(1e-5), slope(2e-5)) else { continue };
            // Where the two steps disagree the function is too rough for finite differences.
            if (fine - coarse).abs() < 1e-6 * (1.0 + fine.abs()) {
                close(found, fine, 1e-5, 1.0)?;
            }
        }
    }

    #[test]
    fn plans_compute_what_the_tape_computes((steps, vars) in program(), limit in 1usize..12) {
        let mut g = Graph::new();
        let ids = build(&mut g, &steps);
        let plan = Plan::new(&g, &ids, limit);
        prop_assert!(plan.blocks.iter().all(|block| block.nodes.len() <= limit));
        prop_assert_eq!(plan.operations(), schedule::order(&g, &ids).len());
        let (found, expected) = (run(&g, &plan, &ids, &vars), evaluate(&g, &ids, &vars));
        for (found, expected) in found.into_iter().zip(expected) {
            prop_assert_eq!(found.to_bits(), expected.to_bits());
        }
    }

    /// Few outputs, so that products are used once and fused; some variables and constants among them.
    #[test]
    fn programs_compute_what_the_tape_computes((steps, vars) in program(), stride in 1usize..40) {
        let mut g = Graph::new();
        let ids: Vec<Id> = build(&mut g, &steps).into_iter().rev().step_by(stride).collect();
        let program = Program::new(&g, &ids);
        let expected = evaluate(&g, &ids, &vars);
        prop_assert!(program.vars() <= VARS);
        prop_assert_eq!(program.outputs(), ids.len());

        // The second evaluation finds what the first one left.
        let (mut scratch, mut found) = (Scratch::new(), vec![f64::NAN; ids.len()]);
        for _ in 0..2 {
            let read = program.vars();
            program.eval(&mut scratch, |z| z.copy_from_slice(&vars[..read]), [&mut found]);
            for (found, expected) in found.iter().zip(&expected) {
                prop_assert_eq!(found.to_bits(), expected.to_bits());
            }
        }
        let mut lanes = vec![[f64::NAN; LANES]; ids.len()];
        let at = |lane: usize, x: f64| x * (1.0 + 0.01 * lane as f64);
        let fill = |z: &mut [[f64; LANES]]| {
            for (z, &x) in z.iter_mut().zip(&vars) {
                *z = std::array::from_fn(|lane| at(lane, x));
            }
        };
        program.eval_lanes(&mut Scratch::new(), fill, [&mut lanes]);
        for lane in 0..LANES {
            let z: Vec<f64> = vars.iter().map(|&x| at(lane, x)).collect();
            for (found, expected) in lanes.iter().zip(evaluate(&g, &ids, &z)) {
                prop_assert_eq!(found[lane].to_bits(), expected.to_bits());
            }
        }
    }

    #[test]
    fn an_expression_found_zero_is_zero((steps, vars) in program()) {
        let Some(expected) = plain(&steps, &vars) else { return Ok(()) };
        let mut g = Graph::new();
        let ids = build(&mut g, &steps);
        for (zero, value) in pattern::zeros(&g, &ids).into_iter().zip(expected) {
            prop_assert!(!zero || value.abs() < 1e-9, "{value}");
        }
    }

    /// Copies of one expression in another variable order, signs spread differently: folded to the same node.
    #[test]
    fn signs_and_order_do_not_matter(x in 0usize..VARS, y in 0usize..VARS, c in -3.0..3.0f64) {
        let mut g = Graph::new();
        let (x, y, c) = (g.var(x), g.var(y), g.constant(c));
        let (cx, minus_y) = (g.mul(c, x), g.neg(y));
        let left = g.mul(cx, minus_y);
        let (yx, minus_c) = (g.mul(y, x), g.neg(c));
        let right = g.mul(yx, minus_c);
        prop_assert_eq!(left, right);
        let (difference, mirrored) = (g.sub(x, y), g.sub(y, x));
        let sum = g.add(difference, mirrored);
        prop_assert!(g.is_zero(sum));
        prop_assert_eq!(Cost::of(&g, &[sum]).total(), 0);
    }
}

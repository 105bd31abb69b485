use super::super::study::Job;
use super::super::vs050::Arm;
use super::super::{Plan, robot};
use super::*;

fn outcome(nodes: Option<usize>, hessian: Second, lift: bool, record: &Findings) -> Outcome {
    let states = record.dataset.experiments[0].t.len() * 4;
    Outcome {
        job: Job {
            nodes,
            scheme: Scheme::ExplicitEuler,
            substeps: 1,
            hessian,
            lift,
            start: 0,
        },
        objective: Some(0.1 * (1.0 + nodes.unwrap_or(300) as f64)),
        accurate: vec![Some(0.1), None, Some(0.3)],
        converged: true,
        limited: false,
        status: "converged".to_owned(),
        iterations: 12,
        seconds: 0.1,
        parameters: robot::truth(),
        undetermined: 3,
        motion: vec![0.1; states],
    }
}

fn findings() -> Findings {
    let dataset = robot::records().expect("simulated");
    let size = |nodes, n| Size {
        nodes,
        n,
        m: if nodes == Some(1) { 0 } else { n - 19 },
        nnz: [5 * n, if nodes == Some(1) { 0 } else { 7 * n }, 9 * n],
    };
    let mut f = Findings {
        program: "pid 0".to_owned(),
        command: "pid-studies paper --quick".to_owned(),
        seed: 1,
        plan: Plan {
            nodes: vec![1, 5],
            counted: vec![1, 5],
            starts: 1,
            max_iterations: 10,
            limit: 1.0,
            arm_starts: 1,
            schemes: vec![(Scheme::Trapezoidal, 1)],
        },
        sizes: vec![size(Some(1), 23), size(Some(5), 39), size(None, 1223)],
        outcomes: Vec::new(),
        seconds: 1.0,
        interrupted: true,
        arm: Arm {
            starts: 1,
            parameters: 5,
            fits: Vec::new(),
            records: vec!["sway".to_owned()],
            dataset: dataset.clone(),
        },
        starts: Vec::new(),
        dataset,
    };
    f.outcomes = [Some(1), Some(5), None]
        .into_iter()
        .flat_map(|nodes| [(nodes, false), (nodes, true)])
        .map(|(nodes, lift)| outcome(nodes, Second::Exact, lift, &f))
        .collect();
    f
}

/// Figures 2 (two joints), 3 and 4, and two joints of the record of the arm.
#[test]
fn the_page_is_in_order() {
    let html = html(&findings());
    let counted = pid_page_check::page(&html).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(counted.plots, 6);
    for part in [
        "objective J, dimensionless</text>",
        "θ1, rad</text>",
        "<dd>pid-studies paper --quick</dd>",
    ] {
        assert!(html.contains(part), "{part}");
    }
}

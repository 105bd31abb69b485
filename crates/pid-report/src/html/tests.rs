use super::*;
use crate::{
    CheckRow, DataSection, Direction, ForceBin, ForceTrace, ModelSection, OutcomeSection,
    SCHEMA_VERSION, Setting, StartRow, Trace,
};
use pid_data::{Dataset, Role};

const MANIFEST: &str = "name = \"cart\"\ntitle = \"Cart <1> & track\"\nsource = \"s\"\nlicense = \"l\"\nkind = \"simulated\"\n\
    [[joint]]\nname = \"x\"\ntype = \"prismatic\"\ninput = \"force\"\ninput_unit = \"N\"\nvelocity = \"absent\"\n\
    [[experiment]]\nfile = \"a.csv\"\nrole = \"train\"\n";

fn parameter(name: &str, bounds: (Option<f64>, Option<f64>), at: Option<Bound>) -> ParameterRow {
    ParameterRow {
        name: name.to_owned(),
        unit: "kg*m^2".to_owned(),
        doc: "inertia".to_owned(),
        start: 1.0,
        value: 2.0,
        deviation: at.is_none().then_some(0.1),
        lower: bounds.0,
        upper: bounds.1,
        at_bound: at,
        fixed: false,
        reference: Some(1.9),
    }
}

fn force() -> MissingForce {
    let bin = |direction, at, spread| ForceBin {
        direction,
        at,
        mean: at,
        spread,
        count: 3,
    };
    let bins = vec![
        bin(Direction::Forward, 0.1, 0.2),
        // A class of equal samples has no spread to draw.
        bin(Direction::Forward, 0.2, 0.0),
        bin(Direction::Backward, -0.1, 0.1),
    ];
    let trace = |y: [f64; 3]| Trace {
        x: vec![0.0, 0.5, 1.0],
        y: y.map(Some).to_vec(),
    };
    let over_time = ["a", "b", "c"].map(|name| ForceTrace {
        experiment: name.to_owned(),
        role: Role::Train,
        w: trace([0.1, -0.2, 0.3]),
        band: Some(trace([0.1, 0.1, 0.2])),
    });
    MissingForce {
        joint: "x".to_owned(),
        unit: "N".to_owned(),
        position_unit: "m".to_owned(),
        velocity_unit: "m/s".to_owned(),
        rms: 0.1,
        total_rms: 1.0,
        share: 0.1,
        band_rms: Some(0.05),
        over_time: over_time.to_vec(),
        samples: vec![[0.0, 0.1, 0.2], [0.1, -0.1, -0.2], [0.2, 0.3, 0.1]],
        by_velocity: bins.clone(),
        by_position: bins,
    }
}

fn motion_with_a_gap() -> Motion {
    let trace = Trace {
        x: vec![0.0, 0.5, 1.0, 1.5],
        y: vec![Some(0.0), Some(0.2), None, Some(0.1)],
    };
    Motion {
        experiment: "a".to_owned(),
        role: Role::Train,
        how: "restarted every 1 s".to_owned(),
        joints: vec![MotionJoint {
            joint: "x".to_owned(),
            unit: "m".to_owned(),
            velocity_unit: "m/s".to_owned(),
            q_measured: trace.clone(),
            q_simulated: trace.clone(),
            v_measured: None,
            v_simulated: trace,
        }],
    }
}

fn report() -> Report {
    let csv = "t,q1,u1\n0,0,1\n0.1,0.1,1\n0.2,0.3,1\n";
    let dataset = Dataset::from_embedded(&[("dataset.toml", MANIFEST), ("a.csv", csv)])
        .unwrap_or_else(|e| panic!("{e}"));
    let start = |index| StartRow {
        index,
        objective: Some(1.0 + index as f64),
        iterations: 3,
        seconds: 0.1,
        status: "converged".to_owned(),
    };
    Report {
        schema_version: SCHEMA_VERSION,
        program: "pid 0".to_owned(),
        title: "Cart <1> & track".to_owned(),
        model: ModelSection {
            name: "Cart".to_owned(),
            source: "compiled".to_owned(),
            nq: 1,
            nu: 1,
            np: 3,
        },
        data: DataSection::of(&dataset),
        settings: vec![Setting::new("scheme", "trapezoidal")],
        outcome: OutcomeSection {
            verdict: Verdict::Good,
            status: "converged".to_owned(),
            iterations: 3,
            preparing_iterations: 0,
            objective: Some(1.0),
            seconds: 0.1,
            checks: vec![CheckRow {
                name: "feasibility".to_owned(),
                value: 1e-9,
                tolerance: 1e-8,
            }],
        },
        iterations: Vec::new(),
        parameters: vec![
            parameter("a", (Some(0.1), Some(10.0)), None),
            parameter("b", (None, Some(2.0)), Some(Bound::Upper)),
            parameter("c", (Some(2.0), Some(2.0)), Some(Bound::Lower)),
        ],
        correlations: Vec::new(),
        starts: vec![start(0), start(1)],
        findings: vec!["a < b".to_owned()],
        motions: vec![motion_with_a_gap()],
        free_run: Vec::new(),
        missing_force: vec![force()],
        notes: vec!["n".to_owned()],
    }
}

/// Two plots of a motion, two of a force against velocity and position, three of it over time.
#[test]
fn the_page_is_in_order_and_says_where_it_comes_from() {
    let html = report().to_html();
    let counted = pid_page_check::page(&html).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((counted.plots, counted.bars), (7, 0));
    for part in [
        "<h1>Cart &lt;1&gt; &amp; track</h1>",
        "<dd>cart, 1 record</dd>",
        "<dd>scheme trapezoidal</dd>",
        "Missing force on x against velocity; velocity from",
        "position, m</text>",
        "w, N</text>",
    ] {
        assert!(html.contains(part), "{part}");
    }
    // Of three classes on either axis one has no spread.
    assert_eq!(html.matches("class=\"spread").count(), 4);
}

/// An identification that failed has no motions, forces, runs or objective.
#[test]
fn an_empty_report_is_a_page_too() {
    let mut report = report();
    report.motions.clear();
    report.missing_force.clear();
    report.starts.clear();
    report.findings.clear();
    report.parameters.clear();
    report.outcome.objective = None;
    let counted = pid_page_check::page(&report.to_html()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(counted.plots, 0);
}

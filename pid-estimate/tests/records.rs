//! Measured records: residuals of regressions beside the figures in the data sets' own descriptions.

mod common;

use common::records;
use pid_estimate::extend::Extended;
use pid_estimate::record::Filtering;
use pid_estimate::regress::{Options, Regression, regress};
use pid_models::{Emps, Panda, Tx40};
use pid_runtime::data::Dataset;
use pid_runtime::dynamics::{Dynamics, Hessian};

fn run(model: &dyn Hessian, dataset: &Dataset, terms: &[&str], filtering: Filtering) -> Regression {
    let terms: Vec<_> = terms.iter().map(|t| t.parse().expect("a term")).collect();
    let model = Extended::new(model, &terms).expect("fits");
    let start: Vec<f64> = model.params().iter().map(|i| i.nominal).collect();
    let options = Options {
        filtering,
        poses: 1000,
        ..Options::default()
    };
    regress(&model, dataset, &start, &options).expect("regresses")
}

fn overall(found: &Regression, records: &str) -> f64 {
    let row = found
        .errors
        .iter()
        .find(|e| e.records == records)
        .expect("judged");
    row.overall.expect("the drive acts")
}

#[test]
fn emps_with_friction_that_differs_between_the_directions() {
    let Some(dataset) = records("emps") else {
        return;
    };
    let filtering = Filtering {
        cutoff: Some(100.0),
        decimate: Some(10),
    };
    let plain = run(&Emps, &dataset, &[], filtering);
    let found = run(&Emps, &dataset, &["asymmetric"], filtering);
    assert!(
        overall(&found, "train (all)") < 0.0311
            && overall(&found, "train (all)") < overall(&plain, "train (all)")
    );
    assert!(
        overall(&found, "test (all)") < 0.054
            && overall(&found, "test (all)") < overall(&plain, "test (all)")
    );
    // The published mass is that of a fit of the same records by others.
    let mass = found
        .rows
        .iter()
        .find(|r| r.formula == "mass")
        .expect("determined");
    assert!((mass.value - 95.1089).abs() < 0.5, "{}", mass.value);
}

#[test]
fn the_wrist_motor_of_the_tx40_is_pinned_where_it_was_published() {
    let Some(dataset) = records("staubli_tx40") else {
        return;
    };
    let filtering = Filtering {
        cutoff: Some(60.0),
        decimate: None,
    };
    let found = run(&Tx40, &dataset, &[], filtering);
    for (name, published) in [
        ("viscous_wrist", 0.6086),
        ("dry_wrist", 2.108),
        ("viscous_j1", 8.028),
    ] {
        let row = found
            .rows
            .iter()
            .find(|r| r.formula == name)
            .expect("determined by itself");
        assert!(
            row.pinned() && (row.value / published - 1.0).abs() < 0.1,
            "{name} {}",
            row.value
        );
    }
    assert_eq!(found.indefinite.1, Some(0.0));
}

#[test]
fn consistent_values_of_the_panda_carry_over_better() {
    let Some(dataset) = records("panda") else {
        return;
    };
    let filtering = Filtering {
        cutoff: Some(10.0),
        decimate: None,
    };
    let found = run(&Panda, &dataset, &["armature", "offset"], filtering);
    let (_, _, errors) = found.consistent.as_ref().expect("asked for");
    let test = errors
        .iter()
        .find(|e| e.records == "test (all)")
        .and_then(|e| e.overall);
    assert!(test.expect("judged") < overall(&found, "test (all)"));
    // Unconstrained least squares leaves masses that no robot has; consistent values do not.
    assert!(found.indefinite.0 > 0.5);
    assert_eq!(found.indefinite.1, Some(0.0));
}

//! A servo in closed loop and switched off: one model on both kinds of measured records.

use std::ops::ControlFlow;

use crate::common::records;
use pid_data::Horizon;
use pid_fit::gap::metrics::{FreeRunSettings, StartVelocity, free_run_table};
use pid_fit::ident::{InitialState, Method, Prepare, Progress, Settings, Weighting, identify};
use pid_fit::wrap::controllers::Controllers;
use pid_models::ServoPendulum;
use pid_runtime::control::ClosedLoop;
use pid_runtime::dynamics::Dynamics;
use pid_runtime::extend::Extended;

/// The firmware's law: duty = clip(kp · 4096/2π/(256 · 885) (qref − q)), at a supply of 7.3 V.
fn controllers() -> Controllers {
    let mut text = String::from("[[record]]\nname = \"drop_*\"\noff = true\n");
    for kp in [100, 200, 400, 800] {
        let p = f64::from(kp) * 4096.0 / std::f64::consts::TAU / (256.0 * 885.0) * 7.3;
        text += &format!("[[record]]\nname = \"*_kp{kp}\"\np = [{p}]\nlimit = [7.3]\n");
    }
    Controllers::parse("servo.toml", &text, 1).expect("readable")
}

#[test]
fn one_servo_model_follows_closed_loop_and_falling_records() {
    let (Some(driven), Some(falling)) = (records("bam_xl330"), records("bam_xl330_drop")) else {
        return;
    };
    let mut dataset = controllers().close(driven).expect("commands recorded");
    let falling = controllers().close(falling).expect("drive off");
    dataset.experiments.extend(falling.experiments);
    let terms = ["offset", "load"].map(|t| t.parse().expect("a term"));
    let extended = Extended::new(&ServoPendulum, &terms).expect("fits");
    let model = ClosedLoop::new(Box::new(extended)).expect("one input");
    let position = |name: &str| model.params().iter().position(|p| p.name == name);
    let settings = Settings {
        method: Method::Shooting,
        prepare: Prepare::Nothing,
        weighting: Weighting::Position,
        initial_state: InitialState::Free,
        horizon: Horizon::Record,
        hold: ["m", "l"].iter().filter_map(|n| position(n)).collect(),
        ..Settings::default()
    };
    let go_on = &mut |_: &Progress<'_>| ControlFlow::Continue(());
    let found = identify(&model, &dataset, &settings, None, go_on).expect("identifies");
    assert!(found.best().status.converged(), "{:?}", found.best().status);
    let runs = FreeRunSettings {
        start: StartVelocity::Estimated,
        ..FreeRunSettings::new(Horizon::Record)
    };
    let table = free_run_table(&model, &found.best().parameters, &dataset, &runs).expect("runs");
    // Mean absolute errors in rad; the best known: 0.0325, 0.0366, 0.0211.
    for (name, limit) in [
        ("sin_sin_kp200", 0.0325),
        ("sin_time_square_kp800", 0.0366),
        ("drop_kp200", 0.0211),
    ] {
        let score = table
            .experiments
            .iter()
            .find(|s| s.experiments[0] == name)
            .expect("a record");
        let mae = score.joints[0].q.expect("compared").mae;
        assert!(mae < limit, "{name}: {mae}");
    }
}

//! Intervals of identifications hold the truth as often as they say.

use std::ops::ControlFlow;

use pid_fit::ident::{Likelihood, Settings};
use pid_fit::synthetic::Recipe;
use pid_fit::transcribe::{Loss, Scheme};
use pid_models::ServoPendulum;
use pid_runtime::dynamics::Dynamics;
use pid_studies::intervals::{Study, coverage};

#[test]
fn intervals_of_a_servo_hold_the_truth() {
    let truth: Vec<f64> = ServoPendulum.params().iter().map(|p| p.nominal).collect();
    let recipe = Recipe {
        records: 2,
        seconds: 3.0,
        step: 0.02,
        amplitude: vec![1.5],
        highest: 3.0,
        start: vec![0.2],
        noise: vec![2e-3, 5e-2],
        outliers: (0.0, 1.0),
    };
    for loss in [Loss::Square, Loss::StudentT { freedom: 4.0 }] {
        let settings = Settings {
            scheme: Scheme::RungeKutta4,
            substeps: 2,
            likelihood: Some(Likelihood {
                loss,
                ..Likelihood::default()
            }),
            ..Settings::default()
        };
        let go_on = |_: usize| ControlFlow::Continue(());
        let study = Study {
            sets: 40,
            seed: 1,
            profiled: (0..truth.len()).collect(),
        };
        let found = coverage(&ServoPendulum, &truth, &recipe, &settings, &study, &go_on)
            .expect("identifies");
        assert_eq!(found.sets.1, 0, "{found:?}");
        // Of mass, length, gain, resistance, rotor and friction, the motion tells the ratios only:
        // some are held.
        assert!(found.rows.len() >= 3 && !found.held.is_empty(), "{found:?}");
        // 40 sets of one parameter: 95 % ± 3.4 % (one deviation); they are correlated among each other.
        let overall = found.overall();
        assert!((0.88..=1.0).contains(&overall), "{loss:?}: {found:?}");
        for row in found.rows.iter().filter(|r| r.sets > 35) {
            assert!(row.share > 0.83, "{loss:?}: {row:?}");
            // Square loss: stated deviations are those of the scatter (known to 1/√80 = 11 %).
            let ratio = row.stated / row.scatter;
            assert!((0.7..1.5).contains(&ratio), "{loss:?}: {row:?}");
            // Profiles agree where the posterior is nearly normal.
            let (share, sets) = row.profile.expect("was asked for");
            assert_eq!(sets, 40, "{loss:?}: {row:?}");
            assert!((share - row.share).abs() < 0.08, "{loss:?}: {row:?}");
        }
    }
}

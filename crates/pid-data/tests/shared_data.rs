//! Measured records kept beside the workspace: read them all, and repeat the published
//! identification of the EMPS axis.

use pid_data::signal;
use pid_data::{DataWarning, Dataset, Role};
use pid_records::shared;

#[test]
fn every_shared_data_set_is_read_and_warned_of_where_its_velocities_are_no_readings() {
    let Some(root) = shared("data") else { return };
    for entry in std::fs::read_dir(root).unwrap() {
        let folder = entry.unwrap().path();
        if folder.is_dir() {
            let dataset = Dataset::read(&folder).unwrap_or_else(|e| panic!("{e}"));
            let differences = dataset.warnings.iter().map(|w| match w {
                DataWarning::VelocityIsDifference { joint, .. } => *joint,
                other => panic!("{}: {other}", dataset.name),
            });
            let differences: Vec<usize> = differences.collect();
            // The recorder of the double pendulum differentiates its positions; the other
            // velocities are readings.
            let expected: &[usize] = match folder.file_name().and_then(|n| n.to_str()) {
                Some("dfki_double_pendulum") => &[1, 2],
                _ => &[],
            };
            assert_eq!(differences, expected, "{}", dataset.name);
            assert!(dataset.with_role(Role::Test).count() > 0);
            for e in &dataset.experiments {
                let s = signal::state_from_data(e, None).unwrap_or_else(|e| panic!("{e}"));
                assert!(
                    s.a.iter().all(|a| a.is_finite()),
                    "{} {}",
                    dataset.name,
                    e.name
                );
                eprintln!("{} {}: cut-off {:.1} Hz", dataset.name, e.name, s.cutoff);
            }
        }
    }
}

/// Least squares by normal equations and Gauss elimination; the columns are scaled by their size.
fn least_squares(rows: &[[f64; 4]], rhs: &[f64]) -> [f64; 4] {
    let mut scale = [0.0; 4];
    for row in rows {
        for (s, x) in scale.iter_mut().zip(row) {
            *s += x * x;
        }
    }
    let scale = scale.map(f64::sqrt);
    let mut m = [[0.0; 5]; 4];
    for (row, y) in rows.iter().zip(rhs) {
        for i in 0..4 {
            for j in 0..4 {
                m[i][j] += row[i] * row[j] / (scale[i] * scale[j]);
            }
            m[i][4] += row[i] * y / scale[i];
        }
    }
    for i in 0..4 {
        let pivot = m[i];
        for (k, row) in m.iter_mut().enumerate() {
            if k != i {
                let f = row[i] / pivot[i];
                for (x, p) in row.iter_mut().zip(pivot) {
                    *x -= f * p;
                }
            }
        }
    }
    std::array::from_fn(|i| m[i][4] / m[i][i] / scale[i])
}

/// A. Janot, M. Gautier, M. Brunot, 2019: filter at 100 Hz, differentiate, decimate by ten, least
/// squares. Published: M = 95.1089 kg, Fv = 203.5034 N·s/m, Fc = 20.3935 N, offset = −3.1648 N.
#[test]
fn the_emps_procedure_gives_the_published_parameters() {
    let Some(folder) = shared("data/emps") else {
        return;
    };
    let dataset = Dataset::read(&folder).unwrap();
    let train = dataset.with_role(Role::Train).next().unwrap();
    let rate = 1.0 / train.sample_time();
    let filter = signal::Butterworth::low_pass(4, 100.0, rate).unwrap();
    let q = filter.both_ways(&train.q);
    let v = signal::central_differences(&train.t, &q);
    let a = signal::central_differences(&train.t, &v);
    // The filter knows nothing beyond the ends of the record: 50 samples are left out at each.
    let inner = 50..train.len() - 50;
    let columns: Vec<f64> = inner
        .clone()
        .flat_map(|i| [a[i], v[i], v[i].signum(), 1.0])
        .collect();
    let rows: Vec<[f64; 4]> = signal::decimate(&columns, 4, 10)
        .unwrap()
        .chunks_exact(4)
        .map(|c| [c[0], c[1], c[2], c[3]])
        .collect();
    let force = signal::decimate(&train.u[inner], 1, 10).unwrap();
    let p = least_squares(&rows, &force);
    eprintln!(
        "M = {:.3}, Fv = {:.2}, Fc = {:.3}, offset = {:.3}",
        p[0], p[1], p[2], p[3]
    );
    for (found, published) in p.iter().zip([95.1089, 203.5034, 20.3935, -3.1648]) {
        assert!(
            (found / published - 1.0).abs() < 5e-3,
            "{found} for {published}"
        );
    }
}

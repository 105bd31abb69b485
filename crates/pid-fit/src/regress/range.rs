//! The range of motion and load of the fitted records, and where other records leave it.

use pid_runtime::dynamics::Dynamics;

use crate::regress::record::Record;

/// A record may leave a range by this share of its width without a remark.
const MARGIN: f64 = 0.05;

/// Range of one joint over some records.
#[derive(Debug, Clone, PartialEq)]
pub struct Range {
    /// Name of the joint.
    pub joint: String,
    /// Least and greatest position, velocity, and input.
    pub bounds: [(f64, f64); 3],
    /// Units of them.
    pub units: [String; 3],
}

/// A record that leaves the range.
#[derive(Debug, Clone, PartialEq)]
pub struct Excess {
    /// Name of the record.
    pub record: String,
    /// Name of the joint.
    pub joint: String,
    /// `position`, `velocity` or `input`.
    pub quantity: &'static str,
    /// Least and greatest value in the record.
    pub reached: (f64, f64),
    /// The range that was left.
    pub range: (f64, f64),
    /// Unit of both.
    pub unit: String,
    /// Share of the samples outside.
    pub share: f64,
}

const QUANTITIES: [&str; 3] = ["position", "velocity", "input"];

/// Positions, velocities, inputs, with the number of each in a row.
fn channels(record: &Record) -> [(&[f64], usize); 3] {
    let nq = record.nq;
    [(&record.q, nq), (&record.v, nq), (&record.u, record.nu)]
}

/// Ranges of all joints over records.
pub fn of(model: &dyn Dynamics, records: &[Record]) -> Vec<Range> {
    let nq = model.dims().nq;
    (0..nq)
        .map(|j| {
            let joint = &model.joints()[j];
            let mut bounds = [(f64::INFINITY, f64::NEG_INFINITY); 3];
            for record in records {
                for (bound, (channel, width)) in bounds.iter_mut().zip(channels(record)) {
                    for &x in channel.iter().skip(j).step_by(width) {
                        *bound = (bound.0.min(x), bound.1.max(x));
                    }
                }
            }
            let input = model
                .inputs()
                .get(j)
                .map_or(String::new(), |i| i.unit.to_string());
            Range {
                joint: joint.name.to_string(),
                bounds,
                units: [
                    joint.unit().to_owned(),
                    joint.velocity_unit().to_owned(),
                    input,
                ],
            }
        })
        .collect()
}

/// Where records leave ranges by more than a twentieth of their width.
pub fn excess(ranges: &[Range], records: &[Record]) -> Vec<Excess> {
    let mut out = Vec::new();
    for record in records {
        for (j, range) in ranges.iter().enumerate() {
            for (k, (channel, width)) in channels(record).into_iter().enumerate() {
                let (low, high) = range.bounds[k];
                let margin = MARGIN * (high - low);
                let values = || channel.iter().skip(j).step_by(width);
                let outside = values()
                    .filter(|x| **x < low - margin || **x > high + margin)
                    .count();
                if outside > 0 {
                    out.push(Excess {
                        record: record.name.clone(),
                        joint: range.joint.clone(),
                        quantity: QUANTITIES[k],
                        reached: values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &x| {
                            (a.min(x), b.max(x))
                        }),
                        range: (low, high),
                        unit: range.units[k].clone(),
                        share: outside as f64 / record.t.len().max(1) as f64,
                    });
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use pid_models::Emps;

    fn record(reach: f64) -> Record {
        let n = 101;
        let wave = |f: f64| {
            (0..n)
                .map(|i| f * (i as f64 / 50.0 - 1.0))
                .collect::<Vec<f64>>()
        };
        Record {
            name: "r".into(),
            nq: 1,
            nu: 1,
            t: (0..n).map(f64::from).collect(),
            q: wave(reach),
            v: wave(1.0),
            a: wave(0.0),
            u: wave(2.0),
            qref: None,
            cutoff: 1.0,
            factor: 1,
            parallel_cutoff: 1.0,
            edge: 0,
        }
    }

    #[test]
    fn a_record_that_reaches_farther_is_named_with_its_share() {
        let ranges = of(&Emps, &[record(0.2)]);
        assert_eq!(ranges[0].bounds[0], (-0.2, 0.2));
        assert!(excess(&ranges, &[record(0.21)]).is_empty());
        let found = excess(&ranges, &[record(0.4)]);
        assert_eq!(found.len(), 1);
        assert_eq!(
            (found[0].quantity, found[0].unit.as_str()),
            ("position", "m")
        );
        // |x| > 0.22 of ±0.4: 45 %.
        assert!((found[0].share - 0.45).abs() < 0.02, "{}", found[0].share);
    }
}

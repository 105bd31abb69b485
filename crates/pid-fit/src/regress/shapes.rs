//! Shape parameters of force terms (Stribeck velocities), sought over a grid of their ranges.
//!
//! A shape moves one column of the regressor, that of its coefficient. One pass over the records
//! makes the normal equations with that column at every value of the grid; each trial then selects
//! columns of them.

use pid_runtime::dynamics::ParamInfo;

use crate::regress::columns::LinearModel;
use crate::regress::normal::{Normal, Sums};
use crate::regress::record::Record;
use crate::regress::solution::{self, How, RegressionError};

/// Values of each shape parameter that are tried over its range.
const SHAPES: usize = 12;
/// Passes over all of them.
const PASSES: usize = 3;

/// Sets the shape parameters that are not in `hold` by coordinate search over a logarithmic grid of
/// their ranges: the sum of logarithms of the joints' residual variances at the best linear
/// parameters (the likelihood with the joints' variances eliminated) decides.
///
/// # Errors
/// [`RegressionError`] where the linear parameters cannot be found.
pub fn tune(
    split: &mut LinearModel<'_>,
    records: &[Record],
    rest: &[f64],
    hold: &[usize],
    how: &How,
) -> Result<(), RegressionError> {
    let params = split.model().params();
    let sought = |j: &usize| {
        let i = &params[*j];
        !hold.contains(j) && i.doc.starts_with("term ") && i.lower > 0.0 && i.upper.is_finite()
    };
    let shapes: Vec<(usize, Vec<f64>)> = split
        .held()
        .iter()
        .copied()
        .filter(sought)
        .map(|j| (j, grid(&params[j])))
        .collect();
    let wide = split.with_variants(&shapes);
    if wide.variants().is_empty() {
        return Ok(());
    }
    let total = Normal::new(&wide, records, Some(rest)).total(|_| true);
    let columns = split.linear().len();
    let mut first = Vec::new();
    let mut end = columns;
    for variant in wide.variants() {
        first.push(end);
        end += variant.values.len();
    }
    // Priors are of shared parameters and do not decide between shapes; deviations of gains move no
    // value.
    let how = How {
        weights: how.weights,
        ..How::default()
    };
    let cost = |choice: &[usize]| -> Result<f64, RegressionError> {
        let mut selected: Vec<usize> = (0..columns).collect();
        for ((variant, first), k) in wide.variants().iter().zip(&first).zip(choice) {
            selected[variant.column] = first + k;
        }
        let sums: Vec<Sums> = total.iter().map(|s| s.select(&selected)).collect();
        let p = solution::estimate(&sums, &how)?.columns();
        Ok(sums
            .iter()
            .map(|s| s.count as f64 * s.residual(&p).max(f64::MIN_POSITIVE).ln())
            .sum())
    };
    let nearest = |v: &crate::regress::columns::Variant| {
        let here = split.held_value(v.shape).ln();
        (0..v.values.len())
            .min_by(|&a, &b| {
                let far = |k: usize| (v.values[k].ln() - here).abs();
                far(a).total_cmp(&far(b))
            })
            .unwrap_or(0)
    };
    let start: Vec<usize> = wide.variants().iter().map(nearest).collect();
    let sizes: Vec<usize> = (wide.variants().iter()).map(|v| v.values.len()).collect();
    let choice = descend(start, &sizes, cost)?;
    for (variant, k) in wide.variants().iter().zip(choice) {
        split.set(variant.shape, variant.values[k]);
    }
    Ok(())
}

/// Coordinate search: in turn each of the choices takes its best place among so many, until none
/// changes.
fn descend(
    mut choice: Vec<usize>,
    sizes: &[usize],
    cost: impl Fn(&[usize]) -> Result<f64, RegressionError>,
) -> Result<Vec<usize>, RegressionError> {
    let mut best = cost(&choice)?;
    for _ in 0..PASSES {
        let before = choice.clone();
        for (place, &size) in sizes.iter().enumerate() {
            for k in 0..size {
                let kept = choice[place];
                if k == kept {
                    continue;
                }
                choice[place] = k;
                let here = cost(&choice)?;
                if here < best {
                    best = here;
                } else {
                    choice[place] = kept;
                }
            }
        }
        if choice == before {
            break;
        }
    }
    Ok(choice)
}

fn grid(info: &ParamInfo) -> Vec<f64> {
    let ratio = (info.upper / info.lower).ln() / (SHAPES - 1) as f64;
    (0..SHAPES)
        .map(|k| info.lower * (ratio * k as f64).exp())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regress::record::Filtering;
    use crate::synthetic::{Recipe, records};
    use pid_models::Emps;
    use pid_runtime::dynamics::Dynamics;
    use pid_runtime::extend::Extended;

    /// The columns of the variants are those of the model held at the same values.
    #[test]
    fn one_pass_holds_every_value() {
        let terms = ["stribeck", "saturating"].map(|t| t.parse().expect("a term"));
        let model = Extended::new(&Emps, &terms).expect("fits");
        let mut p: Vec<f64> = model.params().iter().map(|i| i.nominal).collect();
        let at = |name: &str| {
            let of = model.params().iter().position(|i| i.name == name);
            of.expect("a parameter")
        };
        let recipe = Recipe {
            records: 1,
            seconds: 3.0,
            step: 1e-3,
            amplitude: vec![100.0],
            highest: 3.0,
            start: vec![0.0],
            noise: vec![1e-9, f64::INFINITY],
            outliers: (0.0, 1.0),
        };
        p[at("stribeck_x")] = 15.0;
        p[at("stribeck_velocity_x")] = 0.02;
        let dataset = records(&model, &p, &recipe, 1).expect("simulates");
        let filtering = Filtering {
            cutoff: Some(60.0),
            decimate: None,
        };
        let made = Record::of(&dataset, filtering, &[], |_| true).expect("filters");
        let shapes = ["stribeck_velocity_x", "saturating_velocity_x"].map(at);
        let split = LinearModel::new(&model, &p, &[]);
        let grids = shapes.map(|s| (s, vec![0.01, 0.03]));
        let wide = split.with_variants(&grids);
        let total = Normal::new(&wide, &made, Some(&[2e-3])).total(|_| true);
        let n = split.linear().len();
        for (a, b) in [(0, 0), (1, 0), (0, 1)] {
            let mut own = LinearModel::new(&model, &p, &[]);
            own.set(shapes[0], grids[0].1[a]);
            own.set(shapes[1], grids[1].1[b]);
            let expected = Normal::new(&own, &made, Some(&[2e-3])).total(|_| true);
            let mut selected: Vec<usize> = (0..n).collect();
            for (variant, first) in wide.variants().iter().zip([n, n + 2]) {
                let k = if variant.shape == shapes[0] { a } else { b };
                selected[variant.column] = first + k;
            }
            let found = total[0].select(&selected);
            let error = (&found.a - &expected[0].a).norm() / expected[0].a.norm();
            assert!(error < 1e-12, "{error}");
        }
        // The search finds the velocity of the record, to a step of the grid.
        let mut split = LinearModel::new(&model, &p, &[]);
        tune(&mut split, &made, &[2e-3], &[shapes[1]], &How::default()).expect("solvable");
        let found = split.held_value(shapes[0]);
        assert!((0.013..0.031).contains(&found), "{found}");
    }
}

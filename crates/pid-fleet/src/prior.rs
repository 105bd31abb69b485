//! What a fleet says of its next unit, as a nominal description.

use pid_interpret::nominal::Nominal;

use crate::collect::Summary;
use crate::plan::{Kind, Plan};

/// Half widths of the description are so many deviations of the fleet: 95 % of its units.
const WIDTH: f64 = 1.96;

/// The description of the next unit: values at the mean of the fleet, half widths of 1.96 deviations (spread, and what
/// is not known of the mean), at most the stated ones where a value stands for a combination; and the parameters that
/// kept their stated value since the fleet does not tell them. `None` for a mechanism that no description states.
pub fn prior(nominal: &Nominal, plan: &Plan, summary: &Summary) -> Option<(String, Vec<String>)> {
    let (mut values, mut widths, mut kept) = (Vec::new(), Vec::new(), Vec::new());
    for tolerance in nominal.tolerances() {
        let place = (plan.quantities.iter())
            .position(|q| q.kind == Kind::Parameter && q.name == tolerance.name);
        let over = place.and_then(|k| summary.quantities.get(k));
        let told = over.filter(|o| {
            // A sign that no body has, or less than what was stated, tells nothing.
            let same_side = o.mean * tolerance.nominal > 0.0;
            same_side && o.deviation < tolerance.half_width
        });
        match told {
            Some(over) => {
                values.push(over.mean);
                let own = WIDTH * over.spread.hypot(over.deviation);
                // Of a combination, the others keep their share.
                widths.push(match over.formula == over.name {
                    true => own,
                    false => own.min(tolerance.half_width),
                });
            }
            None => {
                values.push(tolerance.nominal);
                widths.push(tolerance.half_width);
                if tolerance.half_width > 0.0 {
                    kept.push(tolerance.name.clone());
                }
            }
        }
    }
    let effects = nominal.effects().to_vec();
    let next = nominal
        .extended(&values, effects, nominal.simulated().cloned())
        .with_half_widths(&widths);
    Some((next.to_toml()?, kept))
}

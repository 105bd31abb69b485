use crate::number;

/// What an axis shows: a quantity with its unit, from one end to the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    quantity: String,
    unit: String,
    low: f64,
    high: f64,
    log: bool,
}

impl Axis {
    /// An axis from `low` to `high`. A number without unit has the unit `"1"`, which is written
    /// "dimensionless".
    pub fn new(quantity: &str, unit: &str, (low, high): (f64, f64)) -> Self {
        let (low, high) = match low < high && low.is_finite() && high.is_finite() {
            true => (low, high),
            false => (0.0, 1.0),
        };
        Self {
            quantity: quantity.to_owned(),
            unit: if unit == "1" { "dimensionless" } else { unit }.to_owned(),
            low,
            high,
            log: false,
        }
    }

    /// An axis that counts in powers of ten. Both ends are above zero.
    pub fn log(quantity: &str, unit: &str, (low, high): (f64, f64)) -> Self {
        let ends = match low > 0.0 && high > low {
            true => (low, high),
            false => (1.0, 10.0),
        };
        Self {
            log: true,
            ..Self::new(quantity, unit, ends)
        }
    }

    /// The label, "quantity, unit".
    pub fn label(&self) -> String {
        format!("{}, {}", self.quantity, self.unit)
    }

    /// "quantity from low to high unit".
    pub(crate) fn words(&self) -> String {
        let unit = match self.unit.as_str() {
            "dimensionless" => String::new(),
            unit => format!(" {unit}"),
        };
        let end = |x: f64| tick(three_digits(x));
        format!(
            "{} from {} to {}{unit}",
            self.quantity,
            end(self.low),
            end(self.high)
        )
    }

    /// Where a value lies: 0 at the low end, 1 at the high one. At most ten widths outside, and
    /// `None` for what has no place.
    pub(crate) fn share(&self, x: f64) -> Option<f64> {
        let share = if self.log {
            (x / self.low).ln() / (self.high / self.low).ln()
        } else {
            (x - self.low) / (self.high - self.low)
        };
        (!share.is_nan()).then(|| share.clamp(-10.0, 10.0))
    }

    /// Round values along the axis with their labels.
    pub(crate) fn ticks(&self) -> Vec<(f64, String)> {
        if self.log {
            return self.log_ticks();
        }
        // Three to six intervals: labels of seven characters fit between two of them.
        let raw = (self.high - self.low) / 6.0;
        let power = 10f64.powf(raw.log10().floor());
        let step = [1.0, 2.0, 2.5, 5.0, 10.0]
            .into_iter()
            .map(|s| s * power)
            .find(|s| *s >= 0.999 * raw)
            .unwrap_or(raw);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        let values = (first..=last).map(|i| i as f64 * step);
        values.map(|x| (x, tick_of_step(x, step))).collect()
    }

    fn log_ticks(&self) -> Vec<(f64, String)> {
        let decades = (self.high / self.low).log10();
        let factors: &[f64] = match decades {
            d if d > 3.0 => &[1.0],
            d if d > 0.7 => &[1.0, 2.0, 5.0],
            _ => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0],
        };
        // Not more than seven labels.
        let every = (decades / 7.0).ceil().max(1.0) as usize;
        let (first, last) = (
            self.low.log10().floor() as i32,
            self.high.log10().ceil() as i32,
        );
        (first..=last)
            .step_by(every)
            .flat_map(|e| factors.iter().map(move |f| f * 10f64.powi(e)))
            .filter(|x| (self.low..=self.high).contains(x))
            .map(|x| (x, tick(three_digits(x))))
            .collect()
    }
}

fn three_digits(x: f64) -> f64 {
    format!("{x:.2e}").parse().unwrap_or(x)
}

/// A label of a scale of whole steps, without rounding dust.
fn tick_of_step(x: f64, step: f64) -> String {
    let x = (x / step).round() * step;
    // Steps have two digits at most: what is smaller is dust.
    let decimals = (1.0 - step.log10().floor()).clamp(0.0, 12.0) as usize;
    tick(format!("{x:.decimals$}").parse().unwrap_or(x))
}

/// A number as a label: up to six significant digits, a true minus sign.
pub fn tick(v: f64) -> String {
    match v.abs() < 1e-12 {
        true => "0".to_owned(),
        false => number::within(v, 6, -4..5),
    }
}

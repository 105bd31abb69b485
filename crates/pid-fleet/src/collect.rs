//! All results of a fleet as one summary.
//!
//! A value `y_ij` of the unit i in its log j is `μ + b_i + c_ij + e_ij`: the mean of the fleet, what is
//! the unit's own (spread τ), what changes from log to log (ω), and what the log tells wrongly (the
//! jackknife's deviation, which the quantity's median over the fleet steadies). ω follows from
//! differences between neighbouring logs of a unit, μ and τ from the units' levels; both by
//! [`robust`](crate::robust). A trend that all units share is taken out before single ones are looked at.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::FleetError;
use crate::blame::{Correlation, Suspect, suspects};
use crate::drift::{Change, Series, change};
use crate::plan::{Fleet, Plan};
use crate::robust::{common, excess, median};
use crate::run::{Entry, plan_digest};
use crate::standing_out::{rejected, two_sided};

/// Expected share of false ones among the units that are named, unless stated otherwise.
pub const RATE: f64 = 0.01;
/// A common drift is one if nothing of its size is this likely without.
const COMMON: f64 = 0.01;
/// Beyond so many deviations of the fleet, 0.27 % of normal units lie.
const FAR: f64 = 3.0;

/// What a fleet tells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Version of this form.
    pub schema_version: u32,
    /// Program and version.
    pub program: String,
    /// Name of the robot.
    pub robot: String,
    /// Whether times are days since 1970-01-01.
    pub dates: bool,
    /// Expected share of false ones among the units that are named.
    pub rate: f64,
    /// Number of logs.
    pub logs: usize,
    /// Logs that do not count, and why.
    pub gaps: Vec<Gap>,
    /// What is measured, over all units.
    pub quantities: Vec<Over>,
    /// The units, by name.
    pub units: Vec<Unit>,
}

/// A log that does not count.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gap {
    /// Number of the job.
    pub job: usize,
    /// Its unit.
    pub unit: String,
    /// The log.
    pub log: String,
    /// What happened.
    pub what: Lost,
    /// In words; empty for a missing result.
    pub why: String,
}

/// Why a log does not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lost {
    /// No result is there.
    Missing,
    /// The result cannot be read.
    Corrupt,
    /// The result is of another plan.
    Stale,
    /// The log tells nothing.
    Failed,
}

impl Lost {
    /// In one word.
    pub fn word(self) -> &'static str {
        match self {
            Lost::Missing => "missing",
            Lost::Corrupt => "corrupt",
            Lost::Stale => "stale",
            Lost::Failed => "failed",
        }
    }
}

/// A quantity over all units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Over {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// In words.
    pub formula: String,
    /// Value of the description.
    pub nominal: f64,
    /// Mean of the fleet.
    pub mean: f64,
    /// Its deviation.
    pub deviation: f64,
    /// Spread between units, a standard deviation.
    pub spread: f64,
    /// What changes from log to log of a unit beyond what the logs tell wrongly, a standard deviation.
    pub within: f64,
    /// What a log tells wrongly, the median of the deviations.
    pub of_a_log: f64,
    /// Trend that all units share, per unit of time, and its deviation; `None` where no unit has logs enough.
    pub trend: Option<(f64, f64)>,
    /// Whether the trend is beyond chance; it is then taken out of the units' values.
    pub drifts: bool,
    /// Share of the units beyond three deviations of the fleet; 0.0027 if the spread is normal.
    pub far: f64,
}

/// A unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    /// Name.
    pub name: String,
    /// Logs that count.
    pub logs: usize,
    /// First and last time.
    pub time: (f64, f64),
    /// Level of each quantity, before a change if there is one.
    pub level: Vec<f64>,
    /// Distance of each from the mean of the fleet, in deviations.
    pub z: Vec<f64>,
    /// Probability of such a distance in a healthy unit (the least of the quantities', times their number).
    pub p: f64,
    /// Whether its level stands out.
    pub deviates: bool,
    /// What explains its level, best first; empty for a unit that does not stand out.
    pub suspects: Vec<Suspect>,
    /// Its change, if it has one beyond chance.
    pub change: Option<Changed>,
    /// Values of the quantity that stands out most over time, with their deviations; empty for others.
    pub course: Vec<(f64, f64, f64)>,
    /// Which quantity that is.
    pub shown: Option<usize>,
}

/// A change, and what explains it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Changed {
    /// When and by how much.
    pub change: Change,
    /// What explains it, best first.
    pub suspects: Vec<Suspect>,
}

/// Logs of one unit in the order of time; values quantity by quantity.
struct Course {
    name: String,
    times: Vec<f64>,
    values: Vec<Vec<f64>>,
    deviations: Vec<Vec<f64>>,
}

/// Reads all results of a fleet and compares the units; `rate` is the expected share of false ones among those named.
///
/// # Errors
/// A plan that cannot be read, or too few units with results.
pub fn collect(fleet: &Fleet, rate: f64) -> Result<Summary, FleetError> {
    let (mut courses, gaps) = courses(fleet)?;
    if courses.len() < 3 {
        return Err(FleetError::TooFew {
            units: courses.len(),
        });
    }
    let plan = &fleet.plan;
    let mut quantities: Vec<Over> = (0..plan.quantities.len())
        .map(|k| over(plan, k, &mut courses))
        .collect();
    let changes: Vec<Option<Change>> = courses
        .iter()
        .map(|c| {
            change(Series {
                times: &c.times,
                values: &c.values,
                deviations: &c.deviations,
            })
        })
        .collect();
    let p: Vec<f64> = changes
        .iter()
        .map(|c| c.as_ref().map_or(1.0, |c| c.p))
        .collect();
    let changed: Vec<Option<Change>> = (changes.into_iter().zip(rejected(&p, rate)))
        .map(|(change, beyond)| change.filter(|_| beyond))
        .collect();
    let levels: Vec<Levels> = (courses.iter().zip(&changed))
        .map(|(course, change)| course.levels(change.as_ref()))
        .collect();
    for (k, over) in quantities.iter_mut().enumerate() {
        spread(over, &levels, k);
    }
    let within = Correlation::of(&differences(&courses), quantities.len());
    let units = units(
        plan,
        &quantities,
        rate,
        &courses,
        (&levels, changed),
        &within,
    );
    Ok(Summary {
        schema_version: 1,
        program: concat!("simtrue ", env!("CARGO_PKG_VERSION")).to_owned(),
        robot: plan.robot.clone(),
        dates: plan.dates,
        rate,
        logs: fleet.jobs.len(),
        gaps,
        quantities,
        units,
    })
}

/// Level of each quantity and its deviation.
type Levels = Vec<(f64, f64)>;

/// Time, values and deviations of a log.
type Row = (f64, Vec<f64>, Vec<f64>);

/// Results by unit, and what does not count.
fn courses(fleet: &Fleet) -> Result<(Vec<Course>, Vec<Gap>), FleetError> {
    let digest = plan_digest(&fleet.folder)?;
    let expected = fleet.plan.quantities.len();
    let mut gaps = Vec::new();
    let mut units: BTreeMap<&str, Vec<Row>> = BTreeMap::new();
    for (job, task) in fleet.jobs.iter().enumerate() {
        let path = fleet.result(job);
        let read = Entry::read(&path);
        let (what, why) = match read {
            Err(_) if !path.exists() => (Lost::Missing, String::new()),
            Err(why) => (Lost::Corrupt, format!("{}: {why}", path.display())),
            Ok(entry) if entry.plan != digest => {
                (Lost::Stale, "the result is of another plan".to_owned())
            }
            Ok(Entry {
                job: own,
                measured: Some(m),
                ..
            }) if own == job && m.values.len() == expected && m.deviations.len() == expected => {
                let rows = units.entry(&task.unit).or_default();
                rows.push((task.time, m.values, m.deviations));
                continue;
            }
            Ok(Entry { error: Some(e), .. }) => (Lost::Failed, e),
            Ok(_) => {
                let why = format!("{}: it is of another job", path.display());
                (Lost::Corrupt, why)
            }
        };
        gaps.push(Gap {
            job,
            unit: task.unit.clone(),
            log: task.log.display().to_string(),
            what,
            why,
        });
    }
    let courses = units.into_iter().map(|(name, mut rows)| {
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        let column = |of: &dyn Fn(&Row) -> f64| rows.iter().map(of).collect();
        Course {
            name: name.to_owned(),
            times: rows.iter().map(|r| r.0).collect(),
            values: (0..expected).map(|k| column(&|r| r.1[k])).collect(),
            deviations: (0..expected).map(|k| column(&|r| r.2[k])).collect(),
        }
    });
    Ok((courses.collect(), gaps))
}

/// What logs and time do to a quantity. Deviations are widened by what changes from log to log, and a common trend is
/// taken out.
fn over(plan: &Plan, k: usize, courses: &mut [Course]) -> Over {
    let quantity = &plan.quantities[k];
    let all: Vec<f64> = courses
        .iter()
        .flat_map(|c| c.deviations[k].iter().copied())
        .collect();
    let of_a_log = median(&all);
    // Twelve blocks tell a deviation to a fifth; the fleet's steadies it.
    for course in courses.iter_mut() {
        for s in &mut course.deviations[k] {
            *s = (0.5 * (*s * *s + of_a_log * of_a_log)).sqrt();
        }
    }
    let (mut steps, mut variances) = (Vec::new(), Vec::new());
    for course in courses.iter() {
        for (y, s) in course.values[k]
            .windows(2)
            .zip(course.deviations[k].windows(2))
        {
            steps.push(y[1] - y[0]);
            variances.push(s[0] * s[0] + s[1] * s[1]);
        }
    }
    let within = (0.5 * excess(&steps, &variances)).sqrt();
    for course in courses.iter_mut() {
        for s in &mut course.deviations[k] {
            *s = s.hypot(within);
        }
    }
    let slopes: Vec<(f64, f64)> = courses.iter().filter_map(|c| c.slope(k)).collect();
    let (values, variances): (Vec<f64>, Vec<f64>) = slopes.into_iter().unzip();
    let trend = common(&values, &variances).map(|t| (t.mean, t.deviation));
    let likely =
        |(mean, deviation): (f64, f64)| two_sided(mean / deviation) * plan.quantities.len() as f64;
    let drifts = trend.is_some_and(|t| likely(t) < COMMON);
    if let Some((slope, _)) = trend.filter(|_| drifts) {
        let times: Vec<f64> = courses
            .iter()
            .flat_map(|c| c.times.iter().copied())
            .collect();
        let middle = median(&times);
        for course in courses.iter_mut() {
            for (y, t) in course.values[k].iter_mut().zip(&course.times) {
                *y -= slope * (t - middle);
            }
        }
    }
    Over {
        name: quantity.name.clone(),
        unit: quantity.unit.clone(),
        formula: quantity.formula.clone(),
        nominal: quantity.nominal,
        mean: 0.0,
        deviation: 0.0,
        spread: 0.0,
        within,
        of_a_log,
        trend,
        drifts,
        far: 0.0,
    }
}

/// Mean and spread of a quantity between units.
fn spread(over: &mut Over, levels: &[Levels], k: usize) {
    let values: Vec<f64> = levels.iter().map(|l| l[k].0).collect();
    let variances: Vec<f64> = levels.iter().map(|l| l[k].1.powi(2)).collect();
    if let Some(found) = common(&values, &variances) {
        (over.mean, over.deviation, over.spread) = (found.mean, found.deviation, found.spread);
    }
    let far = levels.iter().filter(|l| over.z(l[k]).abs() > FAR).count();
    over.far = far as f64 / levels.len() as f64;
}

impl Over {
    /// Distance of a level, value and deviation, from the mean of the fleet.
    fn z(&self, (value, deviation): (f64, f64)) -> f64 {
        (value - self.mean) / self.apart(deviation)
    }

    /// Deviation of a healthy unit's level from the mean.
    fn apart(&self, deviation: f64) -> f64 {
        self.spread.hypot(deviation)
    }
}

impl Course {
    /// Weighted slope over time and its variance; `None` with fewer than three logs.
    fn slope(&self, k: usize) -> Option<(f64, f64)> {
        let rows = || {
            self.times
                .iter()
                .zip(&self.values[k])
                .zip(&self.deviations[k])
        };
        let w: f64 = rows().map(|(_, s)| 1.0 / (s * s)).sum();
        let mean = |of: fn((f64, f64)) -> f64| {
            rows()
                .map(|((t, y), s)| of((*t, *y)) / (s * s))
                .sum::<f64>()
                / w
        };
        let (t0, y0) = (mean(|r| r.0), mean(|r| r.1));
        let square: f64 = rows().map(|((t, _), s)| ((t - t0) / s).powi(2)).sum();
        let product: f64 = rows()
            .map(|((t, y), s)| (t - t0) * (y - y0) / (s * s))
            .sum();
        (self.times.len() > 2 && square > 0.0).then(|| (product / square, 1.0 / square))
    }

    /// Level of each quantity with its deviation, before the change if there is one.
    fn levels(&self, change: Option<&Change>) -> Levels {
        if let Some(change) = change {
            return change.before.clone();
        }
        let own = self.values.iter().zip(&self.deviations);
        own.map(|(values, deviations)| {
            let w: f64 = deviations.iter().map(|s| 1.0 / (s * s)).sum();
            let sum: f64 = values
                .iter()
                .zip(deviations)
                .map(|(y, s)| y / (s * s))
                .sum();
            (sum / w, w.sqrt().recip())
        })
        .collect()
    }
}

/// Differences between neighbouring logs, in their deviations.
fn differences(courses: &[Course]) -> Vec<Vec<f64>> {
    let mut rows = Vec::new();
    for course in courses {
        for j in 1..course.times.len() {
            let each = course.values.iter().zip(&course.deviations);
            rows.push(
                each.map(|(y, s)| (y[j] - y[j - 1]) / s[j].hypot(s[j - 1]))
                    .collect(),
            );
        }
    }
    rows
}

/// Every unit, with what explains those that stand out.
fn units(
    plan: &Plan,
    quantities: &[Over],
    rate: f64,
    courses: &[Course],
    (levels, changed): (&[Levels], Vec<Option<Change>>),
    within: &Correlation,
) -> Vec<Unit> {
    let z: Vec<Vec<f64>> = levels
        .iter()
        .map(|l| quantities.iter().zip(l).map(|(q, l)| q.z(*l)).collect())
        .collect();
    let between = Correlation::of(&z, quantities.len());
    let p: Vec<f64> = z
        .iter()
        .map(|z| {
            let least = z.iter().map(|z| two_sided(*z)).fold(1.0, f64::min);
            (least * quantities.len() as f64).min(1.0)
        })
        .collect();
    let deviates = rejected(&p, rate);
    let each = courses.iter().zip(levels).zip(z).zip(changed).enumerate();
    each.map(|(i, (((course, level), z), change))| {
        let shift: Vec<f64> = (level.iter().zip(quantities))
            .map(|(l, q)| l.0 - q.mean)
            .collect();
        let apart: Vec<f64> = (level.iter().zip(quantities))
            .map(|(l, q)| q.apart(l.1))
            .collect();
        let most = |x: &mut dyn Iterator<Item = f64>| {
            x.enumerate()
                .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
                .map(|(k, _)| k)
        };
        let shown = match &change {
            Some(c) => most(&mut c.by.iter().map(|(by, deviation)| by / deviation)),
            None if deviates[i] => most(&mut z.iter().copied()),
            None => None,
        };
        let course_of = |k: usize| {
            let rows = course
                .times
                .iter()
                .zip(&course.values[k])
                .zip(&course.deviations[k]);
            rows.map(|((t, y), s)| (*t, *y, *s)).collect()
        };
        Unit {
            name: course.name.clone(),
            logs: course.times.len(),
            time: (course.times[0], course.times[course.times.len() - 1]),
            p: p[i],
            deviates: deviates[i],
            suspects: match deviates[i] {
                true => suspects(plan, &between, &shift, &apart),
                false => Vec::new(),
            },
            change: change.map(|change| {
                let (by, own): (Vec<f64>, Vec<f64>) = change.by.iter().copied().unzip();
                Changed {
                    suspects: suspects(plan, within, &by, &own),
                    change,
                }
            }),
            level: level.iter().map(|l| l.0).collect(),
            z,
            course: shown.map_or_else(Vec::new, course_of),
            shown,
        }
    })
    .collect()
}

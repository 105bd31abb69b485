//! Names the effect that an identified model lacks, after the fit.

use std::path::Path;

use pid_data::Dataset;
use pid_diagnose::diagnosis::{Diagnosis, Verdict};
use pid_diagnose::nominal::Nominal;
use pid_diagnose::report::Report;
use pid_diagnose::search::Settings;
use pid_page::number::{probability, short};

use crate::error::CliError;
use crate::source::Subject;
use crate::{diagnose, output};

/// Folder of its report in that of the results.
const FOLDER: &str = "diagnosis";

/// A diagnosis and its sentence for the findings.
pub(crate) struct Cause {
    report: Report,
    /// For the findings.
    pub(crate) sentence: String,
}

impl Cause {
    /// Looks for it, from the nominal description the model came from or its declaration.
    pub(crate) fn find(subject: &Subject, dataset: &Dataset) -> Result<Self, CliError> {
        let settings = Settings::default();
        let report = match subject.nominal() {
            Some((nominal, with)) => {
                let nominal = Nominal::new(nominal.clone());
                let dataset = with.read.as_ref().unwrap_or(dataset);
                Report::new(nominal, dataset, &settings, false)?
            }
            None => Report::of_dataset(subject.model(), dataset, &settings, false)?,
        };
        let sentence = sentence(report.diagnosis(), dataset);
        Ok(Self { report, sentence })
    }

    /// Writes its report below `out` and prints the summary, unless JSON is printed.
    pub(crate) fn deliver(&self, out: &Path, as_json: bool) -> Result<(), CliError> {
        let folder = out.join(FOLDER);
        self.report.write(&folder)?;
        let written = format!(
            "written: {}, {}",
            folder.join("report.html").display(),
            folder.join("diagnosis.json").display()
        );
        let summary = diagnose::summary(self.report.diagnosis());
        match as_json {
            true => output::message(&written),
            false => output::print(&format!("\nDiagnosis of {summary}\n{written}\n")),
        }
        Ok(())
    }
}

fn sentence(d: &Diagnosis, dataset: &Dataset) -> String {
    let place = |joint: Option<usize>| {
        let channel = joint.and_then(|j| dataset.joints.get(j.checked_sub(1)?));
        channel.map_or(String::new(), |c| format!(" at joint {}", c.name))
    };
    let gap = format!(
        "the gap on the test records falls from {} to {} (floor {})",
        short(d.gap_before),
        short(d.gap_after),
        short(d.gap_floor)
    );
    let named: Vec<String> = d
        .effects
        .iter()
        .map(|e| format!("{}{}", e.effect, place(e.joint)))
        .collect();
    let what = match (named.is_empty(), &d.verdict) {
        (true, Verdict::Nothing) => "no effect of the library is missing".to_owned(),
        (true, _) => "no effect of the library explains what is missing".to_owned(),
        (false, Verdict::Unknown) => format!("{} explains a part; {gap}", named.join(" and ")),
        (false, _) => format!("{}; {gap}", named.join(" and ")),
    };
    format!(
        "Cause, from the nominal values: {what}. Confidence {}; see {FOLDER}/report.html.",
        probability(d.confidence)
    )
}

#[cfg(test)]
mod tests {
    use super::Cause;
    use crate::args::{Cli, Command};
    use crate::source;
    use clap::Parser;

    /// f = −8 N·m exp(−(v / 0.8 rad/s)²) tanh(50 v) at the elbow, whose dry friction is 2 N·m (`demo`).
    #[test]
    fn the_effect_of_the_embedded_data_is_found() {
        let cli = Cli::try_parse_from(["simtrue", "identify"]).unwrap();
        let Some(Command::Identify(args)) = cli.command else {
            panic!("identify")
        };
        let (subject, dataset) = source::load(&args.source).unwrap();
        let cause = Cause::find(&subject, &dataset).unwrap();
        let found = cause.report.diagnosis();
        assert_eq!(found.verdict.word(), "stribeck");
        assert_eq!(found.verdict.joint(), Some(2));
        assert!(
            cause.sentence.contains("stribeck at joint elbow; the gap"),
            "{}",
            cause.sentence
        );
        assert!(found.gap_after < 1.1 * found.gap_floor, "{found:?}");
        for (name, truth) in [("static_to_coulomb", 5.0), ("stribeck_velocity", 0.8)] {
            let parameters = &found.effects[0].parameters;
            let value = parameters.iter().find(|p| p.name == name).unwrap().value;
            assert!((value / truth - 1.0).abs() < 0.1, "{name}: {value}");
        }
    }
}

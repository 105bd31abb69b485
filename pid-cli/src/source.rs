//! Model and data from the arguments, results into their folder.

use std::path::Path;

use pid_models::Entry;
use pid_runtime::data::Dataset;
use pid_runtime::report::Report;

use crate::args::Source;
use crate::error::{CliError, make_folder, write};
use crate::{demo, output};

/// The model and the data asked for, or the embedded ones; checked against each other.
pub(crate) fn load(source: &Source) -> Result<(Entry, Dataset), CliError> {
    let name = source.model.as_deref().unwrap_or(demo::MODEL);
    let model = pid_models::by_name(name)?;
    let dataset = match &source.folder {
        Some(folder) => Dataset::read(folder)?,
        None => demo::dataset()?,
    };
    dataset.check_model(model)?;
    let entry = pid_models::all()
        .into_iter()
        .find(|e| e.model.name() == model.name())
        .expect("invariant: by_name returns a model of all()");
    Ok((entry, dataset))
}

/// Writes fit.json and report.html and prints the summary.
pub(crate) fn deliver(report: &Report, out: &Path) -> Result<(), CliError> {
    make_folder(out)?;
    let (json, html) = (out.join("fit.json"), out.join("report.html"));
    write(&json, &report.to_json()?)?;
    write(&html, &report.to_html())?;
    output::print(&report.to_text());
    output::print(&format!(
        "\nwritten: {}, {}\n",
        html.display(),
        json.display()
    ));
    Ok(())
}

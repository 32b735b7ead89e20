//! `report`: the page that tells the story of a study to someone who was not there.

mod discovery;
mod kinematics;
mod methods;
mod overview;
mod parameters;
mod skeleton;
mod words;
mod wrench;

use crate::command::compare::compare;
use crate::command::parameters::parameters as identified;
use crate::error::PipelineError;
use crate::study::Study;
use crate::workspace::Workspace;
use aloft_report::{Page, render};
use std::path::{Path, PathBuf};

/// Builds the page and writes it; returns where.
pub fn write(study: &Study, out: Option<&Path>) -> Result<PathBuf, PipelineError> {
    let html = render(&page(study)?).map_err(|e| PipelineError::request(e.to_string()))?;
    let path = out.map_or_else(|| study.workspace.join("report.html"), Path::to_path_buf);
    std::fs::write(&path, html).map_err(PipelineError::io("write", &path))?;
    Ok(path)
}

fn page(study: &Study) -> Result<Page, PipelineError> {
    let ws = Workspace::open(&study.workspace);
    let comparison = compare(study)?;
    let found = identified(study, None)?;
    let mut sections = vec![overview::overview(&comparison, &found)];
    sections.push(overview::recordings(study, &ws, &comparison));
    sections.push(wrench::wrench(study, &ws, &comparison)?);
    sections.push(wrench::where_it_fails(&comparison));
    sections.extend(discovery::missing(study));
    sections.extend(discovery::ladder(study)?);
    sections.push(parameters::identified(&found));
    sections.extend(kinematics::kinematics(study, &ws)?);
    sections.push(methods::methods(study, &found));
    Ok(Page {
        title: format!("{}: mass properties from flight", study.facts.person.name),
        subtitle: format!(
            "{} · {} recordings · {} flights · body mass {} kg",
            study.config.name,
            study.included().count(),
            comparison.parameters.flights,
            study.facts.person.mass_kg
        ),
        sections,
        footer: vec![format!(
            "aloft {} · pipeline {} · facts from {}",
            env!("CARGO_PKG_VERSION"),
            study.config.name,
            if study.facts.sources.is_empty() { "the pipeline".to_owned() } else { study.facts.sources.join(" and ") }
        )],
    })
}

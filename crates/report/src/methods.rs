//! The methods paragraph to paste into a paper, the provenance of the numbers, and commands for
//! further analysis.

use super::STUDY;
use super::story::Story;
use aloft_page::{Block, Chapter, Light, Section, Table};
use aloft_pipeline::graph::Stage;
use aloft_pipeline::stages::STAGES;
use aloft_study::commands::command;
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::{Manifest, WHOLE_STUDY};
use std::collections::BTreeSet;

/// The chapter.
///
/// # Errors
/// Results that are damaged.
pub fn chapter(story: &Story<'_>) -> Result<Chapter, PipelineError> {
    let line = |words: &str, what: &str| format!("{}   # {what}", command(story.session, words, None));
    let judged = story.comparison.as_ref().is_none_or(|v| v.limits.is_empty());
    let mut commands =
        vec![line("compare", if judged { "where the model fails" } else { "beside plates and free fall" })];
    if judged {
        // these refuse where nothing can be told
        commands.push(line("discover", "which effect is missing"));
        commands.push(line("parameters", "all parameters with intervals"));
    }
    commands.push(line("status", "what is done, stale or failed"));
    let sections = vec![
        Section::new("paragraph", "A paragraph to paste", "", vec![Block::Copy { text: paragraph(story)? }]),
        Section::new(
            "provenance",
            "Where the numbers come from",
            "Version of each stage's code, number of results, run time and parameters.",
            vec![provenance(story)?.into()],
        ),
        Section::new("go-on", "How to go on", "", vec![Block::Commands { lines: commands }]),
    ];
    Ok(Chapter {
        id: "methods".into(),
        title: "Methods".into(),
        group: STUDY.into(),
        light: Light::Neutral,
        word: String::new(),
        sections,
    })
}

fn paragraph(story: &Story<'_>) -> Result<String, PipelineError> {
    let text = match &story.subject {
        Some(subject) => aloft_analysis::methods::paragraph(story.session, &story.ws, subject)?,
        None => String::new(),
    };
    Ok(format!("{text} Software: aloft {}.", programs(story)?).trim_start().to_owned())
}

/// Versions of the program that produced the results.
fn programs(story: &Story<'_>) -> Result<String, PipelineError> {
    let mut made = BTreeSet::new();
    for stage in STAGES {
        made.extend(manifests(story, stage)?.into_iter().map(|m| m.program));
    }
    Ok(made.into_iter().collect::<Vec<_>>().join(" and "))
}

/// Manifests of the results of a stage.
fn manifests(story: &Story<'_>, stage: &Stage) -> Result<Vec<Manifest>, PipelineError> {
    let names = stage.tasks(story.session).into_iter().map(|t| t.map_or(WHOLE_STUDY, |t| t.name.as_str()));
    names.filter_map(|name| story.ws.manifest(stage.name, name).transpose()).collect()
}

/// Provenance table: what each stage read.
fn provenance(story: &Story<'_>) -> Result<Table, PipelineError> {
    let mut rows = Vec::new();
    for stage in STAGES {
        let manifests = manifests(story, stage)?;
        let Some(first) = manifests.first() else { continue };
        let seconds: f64 = manifests.iter().map(|m| m.seconds).sum();
        let ok = manifests.iter().filter(|m| m.is_ok()).count();
        rows.push(vec![
            stage.name.to_owned(),
            first.version.to_string(),
            format!("{ok} of {}", stage.tasks(story.session).len()),
            format!("{seconds:.2}"),
            blake3::hash(first.parameters.to_string().as_bytes()).to_hex()[..12].to_owned(),
            stage.gives.to_owned(),
        ]);
    }
    Ok(Table::new(
        "Stages",
        "The hash is that of the parameters of the stage; equal hashes mean equal settings.",
        &["stage", "version", "results", "time, s", "settings", "gives"],
        rows,
    ))
}

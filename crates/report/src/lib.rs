//! `report`: an HTML page that presents the results of a study to readers who did not take part in
//! it.
//!
//! There is one file per chapter. `story` reads the workspace once; `lights` holds the limits for
//! judgements; the chapters select and present the results.

mod anthropometry;
mod calibration;
mod candidates;
mod discovery;
mod drawn_effects;
mod filtering;
mod flights;
mod group;
mod group_headline;
mod headline;
mod joints;
mod kinematics;
mod ladder;
mod lights;
mod methods;
mod overview;
mod pair;
mod parameters;
mod place_errors;
mod player;
mod prediction;
mod residuals;
mod series;
mod session;
mod set;
mod story;
mod sureness;
mod switches;
mod trial;
mod wording;

use aloft_analysis::outputs::{REPORT, begin};
use aloft_page::{Chapter, Live, Page, render, render_live};
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::theirs::{refuse_foreign, write_own};
pub use group::{Absent, Member};
pub use pair::side_by_side;
use rayon::prelude::*;
pub use set::{SetReport, write_set};
use std::path::{Path, PathBuf};
use story::{Story, TrialStory};
use switches::Offered;
pub use switches::{numbers as switch_numbers, panel_state};

/// Heading of the chapters about the whole study.
const STUDY: &str = "Study";
/// Heading of the chapters about single recordings.
const RECORDINGS: &str = "Recordings";

/// What a message calls a page.
const PAGE: &str = "page";

/// True for the text of a page that Aloft made: it says so in its head, or, of earlier versions,
/// holds the symbols of the lights.
fn is_page(text: &[u8]) -> bool {
    let holds = |text: &[u8], part: &str| text.windows(part.len()).any(|w| w == part.as_bytes());
    let head = &text[..text.len().min(1000)];
    head.starts_with(b"<!doctype html>")
        && (holds(head, "<meta name=\"generator\" content=\"aloft\">") || holds(text, "<symbol id=\"light-good\""))
}

/// Builds the page and writes it; returns its path. Only a page that Aloft made is replaced.
pub fn write(session: &SubjectSession, out: Option<&Path>) -> Result<PathBuf, PipelineError> {
    Ok(write_page(session, out)?.0)
}

/// The same; returns also how many switches the page has, or why none, in a few words.
fn write_page(session: &SubjectSession, out: Option<&Path>) -> Result<(PathBuf, String), PipelineError> {
    if let Some(path) = out {
        refuse_foreign(path, PAGE, is_page)?;
    }
    let recording = if out.is_none() { Some(begin(&session.workspace, &[REPORT], &[session])?) } else { None };
    let (page, offered) = page(session, true)?;
    let html = match &offered.panel {
        Some(sent) => render_live(&page, &sent.panel()),
        None => render(&page),
    };
    let html = html.map_err(|e| PipelineError::request(e.to_string()))?;
    let path = out.map_or_else(|| session.workspace.join(REPORT), Path::to_path_buf);
    write_own(&path, html.as_bytes(), PAGE, is_page)?;
    if let Some(recording) = recording {
        recording.done()?;
    }
    Ok((path, offered.brief))
}

/// Builds the page with a live panel, for a server.
pub fn live(session: &SubjectSession, live: &Live<'_>) -> Result<String, PipelineError> {
    render_live(&page(session, false)?.0, live).map_err(|e| PipelineError::request(e.to_string()))
}

/// Builds the page of a study of several subjects and writes it; the subjects' own pages are
/// written by [`write()`].
pub fn write_group(
    title: &str,
    members: &[Member<'_>],
    absent: &[Absent],
    out: &Path,
) -> Result<PathBuf, PipelineError> {
    let html = render(&group::page(title, members, absent)?).map_err(|e| PipelineError::request(e.to_string()))?;
    write_own(out, html.as_bytes(), PAGE, is_page)?;
    Ok(out.to_path_buf())
}

/// The page; with its own switches, if they are asked for and there are any.
fn page(now: &SubjectSession, switches: bool) -> Result<(Page, Offered), PipelineError> {
    let session = &aloft_pipeline::made::as_made(now)?;
    let story = Story::read(session, now)?;
    let mut chapters = vec![overview::chapter(&story)?];
    chapters.extend(prediction::chapter(&story));
    chapters.push(discovery::chapter(&story));
    chapters.extend(parameters::chapter(&story)?);
    chapters.push(kinematics::chapter(&story)?);
    chapters.push(methods::chapter(&story)?);
    let shown: Vec<_> = story.trials.iter().filter(|t| t.entry.role.is_dynamic() || !t.failures.is_empty()).collect();
    let recordings: Result<Vec<Chapter>, PipelineError> = shown.par_iter().map(|t| trial::chapter(&story, t)).collect();
    chapters.extend(recordings?);
    let person = &session.facts.person;
    // those identified from, or else those found
    let found = || story.dynamic().filter_map(TrialStory::n_flights).sum::<usize>();
    let flights = story.found.as_ref().map_or_else(found, |f| f.parameters.n_flights());
    let mut facts = vec![session.config.name.clone()];
    if wording::short(&person.name) != person.name {
        facts.push(person.name.clone());
    }
    facts.push(wording::count(session.included().count(), "recording"));
    facts.push(wording::count(flights, "flight"));
    facts.push(format!("mass {} kg", person.mass_kg));
    facts.extend(person.height_m.map(|h| format!("height {h} m")));
    let sources = &session.facts.sources;
    let offered = if switches { switches::sent(&story) } else { Offered::default() };
    let mut footer = vec![format!(
        "aloft {} · pipeline {} · facts from {} · every number of a figure or table: its CSV button; full rate: the Parquet tables of the workspace",
        env!("CARGO_PKG_VERSION"),
        session.config.name,
        if sources.is_empty() { "the pipeline".to_owned() } else { sources.join(" and ") }
    )];
    footer.extend(offered.without.clone());
    let page = Page {
        title: format!("{}: mass properties from flight", wording::short(&person.name)),
        subtitle: facts.join(" · "),
        chapters,
        footer,
    };
    Ok((page, offered))
}

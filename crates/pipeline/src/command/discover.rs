//! `discover`: which effect is missing, from the motion and the flights that the stages left.

use crate::error::PipelineError;
use crate::graph::Job;
use crate::revision::{ModelEffect, Revisions};
use crate::stages::regressor::TrialRows;
use crate::study::Study;
use crate::workspace::{WHOLE_STUDY, Workspace, write_json};
use aloft_body::BaseParameters;
use aloft_discover::{Body, DiscoverOptions, Discovery, Session, TrialInput, catalogue, discover as rank, scene_of};
use aloft_identify::LinkPrior;
use aloft_regressor::WeakOptions;
use rayon::prelude::*;
use std::path::PathBuf;

/// Ranks the whole catalogue against the present model; keeps the answer beside the results for `effect add` and `report`.
pub fn discover(study: &Study, options: &DiscoverOptions) -> Result<Discovery, PipelineError> {
    let ws = Workspace::open(&study.workspace);
    let ready: Vec<(String, String)> = study
        .included()
        .filter(|t| t.role.is_dynamic() && ws.manifest("regressor", &t.name).is_some_and(|m| m.is_ok()))
        .map(|t| ("regressor".to_owned(), t.name.clone()))
        .collect();
    if ready.is_empty() {
        return Err(PipelineError::request_hint(
            format!("no trial in {} has rows", study.workspace.display()),
            format!("run `aloft run {}` first", study.config_path.display()),
        ));
    }
    let out = ws.place("regressor", WHOLE_STUDY);
    let job = Job { study, trial: None, workspace: &ws, inputs: &ready, out: &out };
    let fail = |f: crate::error::StageFailure| PipelineError::Request { problem: f.problem, hint: f.hint };
    let rows: Vec<TrialRows> =
        ready.par_iter().map(|(_, name)| TrialRows::load(&job, name)).collect::<Result<_, _>>().map_err(fail)?;
    let Some(first) = rows.first() else { return Err(PipelineError::request("no trial has rows")) };
    let subject = &first.subject;
    let base = BaseParameters::of(&subject.model);
    let wrong = |e: &dyn std::fmt::Display| PipelineError::request(e.to_string());
    let phi = subject.prior_phi();
    let prior = if study.object.is_some() {
        None
    } else {
        let links = LinkPrior::of_subject(subject).map_err(|e| wrong(&e))?;
        Some(links.base(&base).map_err(|e| wrong(&e))?)
    };
    let centers = rows.iter().map(|r| r.plate_centers_m.clone()).find(|c| !c.is_empty()).unwrap_or_default();
    let body = Body {
        model: &subject.model,
        base: &base,
        phi: &phi,
        prior: prior.as_ref(),
        mass_kg: subject.facts.mass_kg,
        plate_centers_m: &centers,
    };
    let trials: Vec<TrialInput<'_>> = rows
        .iter()
        .map(|r| TrialInput {
            motion: &r.motion,
            stretches: &r.stretches,
            measured: r.wrench.as_deref(),
            plates: &r.plates,
            group: None,
            session_time_s: 0.0,
        })
        .collect();
    let scene = scene_of(&body, &trials);
    let window = study.config.regressor.window_s;
    let weak = WeakOptions { window_s: (window > 0.0).then_some(window), ..WeakOptions::default() };
    let session = Session::new(&body, &scene, &trials, &weak).map_err(|e| wrong(&e))?;
    let accepted = study.effects.iter().map(|e: &ModelEffect| e.choice(&scene)).collect::<Result<Vec<_>, _>>()?;
    let found = rank(&session, &catalogue(), &accepted, options).map_err(|e| wrong(&e))?;
    write_json(&study.workspace.join("discovery.json"), &found)?;
    // the answer to each revision of the model stays, so that the report can tell the story from its beginning
    let revision = Revisions::load(&study.workspace)?.revisions.len().saturating_sub(1);
    let kept = answer_of(study, revision);
    if let Some(folder) = kept.parent() {
        std::fs::create_dir_all(folder).map_err(PipelineError::io("create", folder))?;
    }
    write_json(&kept, &found)?;
    Ok(found)
}

/// Where the answer to a revision of the model is kept.
pub fn answer_of(study: &Study, revision: usize) -> PathBuf {
    study.workspace.join("discoveries").join(format!("revision_{revision}.json"))
}

/// Options for some effects only, or without some.
pub fn options(only: Vec<String>, without: Vec<String>) -> DiscoverOptions {
    DiscoverOptions { only, without, ..DiscoverOptions::default() }
}

//! Checks that every entry of the explicit slices conforms: stages, effects, built-in
//! configurations; and that the documents list them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_pipeline::graph::{Need, Stage};
use aloft_pipeline::stages::STAGES;
use aloft_study::catalog;
use aloft_study::subject_session::{Overrides, SubjectSession};
use std::path::Path;

fn document(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(name)).unwrap()
}

#[test]
fn stages_read_only_what_stands_before_them() {
    for (i, stage) in STAGES.iter().enumerate() {
        assert!(STAGES[..i].iter().all(|s| s.name != stage.name), "{} twice", stage.name);
        for need in stage.needs {
            let name = match need {
                Need::Recording => continue,
                Need::Same(n)
                | Need::Once(n)
                | Need::Every(n, _)
                | Need::Merged(n, _)
                | Need::EveryOrStaticFrames(n, _) => n,
            };
            assert!(
                STAGES[..i].iter().any(|s| s.name == *name),
                "{} reads {name}, which does not stand before it",
                stage.name
            );
        }
    }
}

#[test]
fn architecture_has_the_stage_table() {
    let page = document("ARCHITECTURE.md");
    for stage in STAGES {
        let row = format!("| `{}` | {} | {} |", stage.name, stage.reads, stage.gives);
        assert!(page.contains(&row), "ARCHITECTURE.md lacks the row\n{row}");
    }
}

#[test]
fn readme_names_the_commands_that_checks_run() {
    let checks = document(".ci/run");
    let readme = document("README.md");
    let test = "cargo test --release --workspace";
    assert!(checks.contains(test) && readme.contains(test));
}

#[test]
fn every_built_in_configuration_parses() {
    let nowhere = Path::new("");
    for name in catalog::names("models") {
        let spec: aloft_body::ModelSpec = catalog::load("models", &name, nowhere).unwrap();
        aloft_body::Model::from_spec(&spec).unwrap();
    }
    for set in catalog::all::<aloft_trial::MarkerSet>("markersets").unwrap() {
        let spec: aloft_body::ModelSpec = catalog::load("models", &set.model, nowhere).unwrap();
        for marker in &set.markers {
            assert!(spec.links.iter().any(|l| l.name == marker.link), "{}: {} sits on no link", set.name, marker.label);
        }
    }
    assert!(catalog::all::<aloft_scale::Anthropometry>("anthropometry").unwrap().len() >= 3);
    assert!(!catalog::all::<aloft_scale::ObjectSpec>("objects").unwrap().is_empty());
    assert!(catalog::all::<aloft_simulate::Scenario>("scenarios").unwrap().len() >= 5);
}

#[test]
fn every_shipped_pipeline_parses() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines");
    let mut n = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        aloft_study::ranges::parse_yaml::<aloft_study::config::PipelineConfig>(&path.display().to_string(), &text)
            .unwrap();
        n += 1;
    }
    assert!(n >= 4);
}

#[test]
fn effects_are_documented_under_four_headings() {
    for effect in aloft_effects::EFFECTS {
        for heading in ["Physics", "Equation", "Identifiability", "References"] {
            assert!(effect.about().documentation.contains(heading), "{} lacks {heading}", effect.id());
        }
    }
}

#[test]
fn a_new_cut_off_leaves_weak_rows_and_what_they_need_alone() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let before = SubjectSession::open(&root.join("pipelines/demo.yaml"), &Overrides::default()).unwrap();
    let mut after = before.clone();
    after.config.filter.cutoff_hz *= 0.5;
    let parameters = |stage: &Stage, session: &SubjectSession| -> Vec<serde_json::Value> {
        stage.tasks(session).into_iter().map(|t| (stage.parameters)(session, t)).collect()
    };
    let changed = |stage: &Stage| parameters(stage, &before) != parameters(stage, &after);
    let stale: Vec<&str> = STAGES.iter().filter(|s| changed(s)).map(|s| s.name).collect();
    assert_eq!(stale, ["filter", "acceleration", "compare"]);
    // nothing that weak rows are made from is made from a stale result
    let mut needed = vec!["regressor"];
    let mut at = 0;
    while at < needed.len() {
        let stage = STAGES.iter().find(|s| s.name == needed[at]).unwrap();
        for need in stage.needs {
            if let Need::Same(n)
            | Need::Once(n)
            | Need::Every(n, _)
            | Need::Merged(n, _)
            | Need::EveryOrStaticFrames(n, _) = need
                && !needed.contains(n)
            {
                needed.push(n);
            }
        }
        at += 1;
    }
    assert!(needed.iter().all(|n| !stale.contains(n)), "{needed:?}");
}

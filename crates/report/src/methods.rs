//! The methods paragraph to paste into a paper, the provenance of the numbers, and commands for
//! further analysis.

use super::STUDY;
use super::commands::command;
use super::story::Story;
use aloft_page::{Block, Chapter, Light, Section, Table};
use aloft_pipeline::stages::STAGES;
use aloft_workspace::manifest::WHOLE_STUDY;

/// The chapter.
pub fn chapter(story: &Story<'_>) -> Chapter {
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
        Section::new("paragraph", "A paragraph to paste", "", vec![Block::Copy { text: paragraph(story) }]),
        Section::new(
            "provenance",
            "Where the numbers come from",
            "Version of each stage's code, number of results, run time and parameters.",
            vec![provenance(story).into()],
        ),
        Section::new("go-on", "How to go on", "", vec![Block::Commands { lines: commands }]),
    ];
    Chapter { id: "methods".into(), title: "Methods".into(), group: STUDY.into(), light: Light::Neutral, sections }
}

fn paragraph(story: &Story<'_>) -> String {
    let session = story.session;
    let f = &session.config.filter;
    let mut text = String::new();
    if let Some(robot) = &session.robot {
        text = format!(
            "{} For frame-wise comparison they were filtered forward and backward (Butterworth, order {} a pass, {} Hz). ",
            robot.kinematics_in_words(),
            f.order,
            f.cutoff_hz
        );
    } else {
        text.push_str(&format!(
            "Marker trajectories were brought to SI units and one world frame with Z up; gaps up to {} s were filled. ",
            session.config.import.fill_gaps_s
        ));
        text.push_str(&if let Some(osim) = &session.osim {
        osim.kinematics_in_words()
    } else if session.object.is_some() {
        "Link frames follow the object description; the hinge was found from motion and refined over all recordings. ".to_owned()
    } else {
        format!(
            "A model of {} links was scaled to the static trial (hip centres after {}, inertias from tables: {}) and its joint centres, hinge axes and \
             marker places were refined over the dynamic trials on markers alone. ",
            session.model.links.len(),
            capital(&session.config.scale.hip),
            session.anthropometry.title
        )
    });
        text.push_str(&format!(
        "Joint coordinates were found frame by frame by weighted non-linear least squares and, for frame-wise comparison, filtered forward and \
         backward (Butterworth, order {} a pass, {} Hz). ",
        f.order, f.cutoff_hz
    ));
    }
    if let Some(found) = &story.found {
        let p = &found.parameters;
        text.push_str(&format!(
            "Base parameters were identified from {} flights with {} rows ({}), after Ayusawa, Venture and Nakamura (2010); the body mass of {} kg \
             fixed the scale. ",
            p.n_stretches,
            found.rows_used,
            p.estimator.name().replace('_', " "),
            session.facts.person.mass_kg
        ));
        if !p.effects.is_empty() {
            let names: Vec<&str> = p.effects.iter().map(|e| e.name.as_str()).collect();
            text.push_str(&format!("Fitted with them: {}. ", names.join(", ")));
        }
    }
    for difference in aloft_pipeline::made::differences(session, &story.ws) {
        text.push_str(&format!("{difference}. "));
    }
    text.push_str(&format!("Software: aloft {}.", programs(story)));
    text
}

/// Versions of the program that produced the results.
fn programs(story: &Story<'_>) -> String {
    let made = STAGES.iter().flat_map(|stage| {
        let names = stage.tasks(story.session).into_iter().map(|t| t.map_or(WHOLE_STUDY, |t| t.name.as_str()));
        names.filter_map(|n| Some(story.ws.manifest(stage.name, n)?.program)).collect::<Vec<_>>()
    });
    made.collect::<std::collections::BTreeSet<String>>().into_iter().collect::<Vec<_>>().join(" and ")
}

/// Provenance table: what each stage read.
fn provenance(story: &Story<'_>) -> Table {
    let rows = STAGES
        .iter()
        .filter_map(|stage| {
            let tasks = stage.tasks(story.session);
            let manifests: Vec<_> = tasks
                .iter()
                .filter_map(|t| story.ws.manifest(stage.name, t.map_or(WHOLE_STUDY, |t| t.name.as_str())))
                .collect();
            let first = manifests.first()?;
            let seconds: f64 = manifests.iter().map(|m| m.seconds).sum();
            let ok = manifests.iter().filter(|m| m.is_ok()).count();
            Some(vec![
                stage.name.to_owned(),
                first.version.to_string(),
                format!("{ok} of {}", tasks.len()),
                format!("{seconds:.2}"),
                blake3::hash(first.parameters.to_string().as_bytes()).to_hex()[..12].to_owned(),
                stage.gives.to_owned(),
            ])
        })
        .collect();
    Table::new(
        "Stages",
        "The hash is that of the parameters of the stage; equal hashes mean equal settings.",
        &["stage", "version", "results", "time, s", "settings", "gives"],
        rows,
    )
}

/// An author's name, capitalised.
fn capital(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map_or(String::new(), |c| c.to_uppercase().chain(letters).collect())
}

//! Measured and predicted wrench for each model and recording.

use super::story::Story;
use super::wording::{number, three};
use super::{STUDY, residuals, series};
use aloft_analysis::compare::{ComparisonView, errors_of, judged_on, mean};
use aloft_analysis::wording::model_word;
use aloft_page::{Block, Cell, Chapter, Section, Table};

/// The chapter; none if nothing was compared.
pub fn chapter(story: &Story<'_>) -> Option<Chapter> {
    let view = story.comparison.as_ref()?;
    let c = &view.comparison;
    let mut sections = vec![curves(story, view)];
    sections.extend(residuals::sections(c));
    sections.push(by_trial(story, view));
    Some(Chapter {
        id: "prediction".into(),
        title: "Measured against predicted".into(),
        group: STUDY.into(),
        light: Default::default(),
        word: String::new(),
        sections,
    })
}

/// Curves of one held-out recording, and a comparison of the models.
fn curves(story: &Story<'_>, view: &ComparisonView) -> Section {
    let c = &view.comparison;
    let held = |t: &&aloft_compare::TrialComparison| t.held_out_contact && t.contact.frames > 0;
    let example = c.first.trials.iter().find(held).or_else(|| c.first.trials.first());
    let mut blocks = Vec::new();
    let figure = example
        .and_then(|e| story.trials.iter().find(|t| t.entry.name == e.trial))
        .and_then(|t| series::wrench(story, t));
    blocks.extend(figure.map(Block::from));
    blocks.push(model_table(view).into());
    let f = &c.first.flight;
    if f.frames > 0 {
        blocks.push(Block::text(format!(
            "In flight a perfect model needs no wrench beside its effects. The residual of the model there has a root mean square of {} N and {} N·m, \
             frame by frame over {} frames.",
            three(&f.residual_force_n.rms),
            three(&f.residual_moment_nm.rms),
            f.frames
        )));
    }
    Section::new(
        "wrench",
        "The wrench",
        "External wrench that the recorded motion requires: of the identified model where there is one, as measured by the plates, and of the body \
         from tables. Each recording has its curves in its own chapter.",
        blocks,
    )
}

/// Errors of every model on the same frames of the same motion.
pub fn model_table(view: &ComparisonView) -> Table {
    let c = &view.comparison;
    let mut rows: Vec<Vec<String>> = c
        .models()
        .map(|m| {
            let (f, n, wf, wn) = errors_of(m);
            vec![model_word(&m.model).to_owned(), three(&f), three(&n), number(mean(&wf)), number(mean(&wn))]
        })
        .collect();
    if let Some(floor) = &c.noise_floor {
        let (frames, windows) = if c.first.held_out.frames > 0 {
            (&floor.contact, &floor.contact_weak)
        } else {
            (&floor.flight, &floor.flight_weak)
        };
        rows.push(vec![
            "noise floor".into(),
            three(&frames.force_n.mae),
            three(&frames.moment_nm.mae),
            number(mean(&windows.force_n.mae)),
            number(mean(&windows.moment_nm.mae)),
        ]);
    }
    Table::new(
        &format!("Mean absolute error on {}", judged_on(c)),
        &format!(
            "Root axes. Frame by frame, and over windows of {} s, where noise averages out and the model shows. These are mean absolute errors of single axes. The error at the top of the page is the root mean square of force and moment together, and is larger. The noise floor is the error of a perfect model on these recordings.",
            c.options.window_s
        ),
        &["model", "force x y z, N", "moment x y z, N·m", "windows: force, N", "windows: moment, N·m"],
        rows,
    )
}

/// Errors of each recording.
fn by_trial(story: &Story<'_>, view: &ComparisonView) -> Section {
    let rows = view
        .comparison
        .first
        .trials
        .iter()
        .map(|t| {
            let link = story
                .trials
                .iter()
                .find(|s| s.entry.name == t.trial)
                .map_or(String::new(), |s| format!("#{}", s.anchor()));
            let size = |frames: usize, v: f64| if frames > 0 { number(v) } else { "–".to_owned() };
            let held = match (t.held_out_contact, t.held_out_flight) {
                (true, true) => "contact and flight",
                (true, false) => "contact",
                (false, true) => "flight",
                (false, false) => "nothing",
            };
            vec![
                Cell::from(t.trial.clone()).to(link),
                held.into(),
                t.contact.frames.to_string().into(),
                size(t.contact.frames, t.contact.force_n.mean_mae()).into(),
                size(t.contact.frames, t.contact.moment_nm.mean_mae()).into(),
                t.flight.frames.to_string().into(),
                size(t.flight.frames, t.flight.force_n.mean_mae()).into(),
                size(t.flight.frames, t.flight.moment_nm.mean_mae()).into(),
            ]
        })
        .collect();
    let table = Table::new(
        "Error by recording",
        "Mean absolute error of the identified model, mean of the axes.",
        &[
            "recording",
            "held out",
            "contact frames",
            "contact: force, N",
            "contact: moment, N·m",
            "flight frames",
            "flight: force, N",
            "flight: moment, N·m",
        ],
        rows,
    );
    Section::new("by-recording", "Recording by recording", "", vec![table.into()])
}

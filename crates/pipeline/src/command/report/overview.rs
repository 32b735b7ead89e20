//! What was identified, how well it predicts, and what came in.

use super::words::{card, number, three};
use crate::command::compare::{ComparisonView, errors_of, judged_on, mean};
use crate::command::parameters::ParametersView;
use crate::stages::STAGES;
use crate::study::Study;
use crate::workspace::{WHOLE_STUDY, Workspace};
use aloft_report::{Block, Light, Section, Table};

pub fn overview(view: &ComparisonView, found: &ParametersView) -> Section {
    let c = &view.comparison;
    let (force, moment, _, _) = errors_of(&c.first);
    let prior = c.beside.iter().find(|m| m.model == "prior").map(errors_of);
    let ratio = view.parameters.sigma_ratio;
    let rms: Vec<f64> = view.kinematics.iter().filter_map(|k| k.marker_rms_mm).collect();
    let mean_rms = rms.iter().sum::<f64>() / rms.len().max(1) as f64;
    let beside = |own: f64, prior: Option<f64>, unit: &str| {
        let light = match prior {
            Some(p) if own < 0.95 * p => Light::Good,
            Some(p) if own > 1.05 * p => Light::Poor,
            _ => Light::Fair,
        };
        (prior.map_or(String::new(), |p| format!("prior {} {unit}", number(p))), light)
    };
    let (force_note, force_light) = beside(mean(&force), prior.map(|p| mean(&p.0)), "N");
    let (moment_note, moment_light) = beside(mean(&moment), prior.map(|p| mean(&p.1)), "N·m");
    let cards = vec![
        card(
            "Flights used",
            view.parameters.flights.to_string(),
            format!("{} rows", view.parameters.rows),
            Light::Neutral,
        ),
        card(&format!("Force error, {}", judged_on(c)), format!("{} N", number(mean(&force))), force_note, force_light),
        card("Moment error", format!("{} N·m", number(mean(&moment))), moment_note, moment_light),
        card(
            "Singular-value gap σ_N−1 / σ_N",
            number(ratio),
            "how clearly the motion shows the parameters".to_owned(),
            if ratio >= 20.0 {
                Light::Good
            } else if ratio >= 3.0 {
                Light::Fair
            } else {
                Light::Poor
            },
        ),
        card(
            "Marker error, RMS",
            format!("{} mm", number(mean_rms)),
            "usual limit 20 mm".to_owned(),
            if mean_rms < 10.0 {
                Light::Good
            } else if mean_rms < 20.0 {
                Light::Fair
            } else {
                Light::Poor
            },
        ),
    ];
    let mut blocks = vec![Block::Cards { cards }];
    let gate = &found.parameters.gate;
    if gate.passed {
        blocks.push(Block::Remark {
            text: "The motion determines the parameters; intervals stand beside every number.".into(),
            light: Light::Good,
        });
    }
    for reason in &gate.reasons {
        blocks.push(Block::Remark { text: reason.clone(), light: if gate.passed { Light::Fair } else { Light::Poor } });
    }
    for advice in gate.advice.iter().take(4) {
        blocks.push(Block::Remark { text: advice.clone(), light: Light::Neutral });
    }
    blocks.push(Block::Table { table: model_table(view) });
    for line in &c.words {
        blocks.push(Block::Text { text: line.clone() });
    }
    Section {
        id: "overview".into(),
        title: "Overview".into(),
        lead: "What was identified from motion in the air alone, and how well it predicts what plates measured.".into(),
        blocks,
    }
}

pub fn model_table(view: &ComparisonView) -> Table {
    let c = &view.comparison;
    let mut rows: Vec<Vec<String>> = c
        .models()
        .map(|m| {
            let (f, n, wf, wn) = errors_of(m);
            vec![m.model.clone(), three(&f), three(&n), number(mean(&wf)), number(mean(&wn))]
        })
        .collect();
    if let Some(floor) = &c.noise_floor {
        let (frames, windows) = if c.first.held_out.frames > 0 {
            (&floor.contact, &floor.contact_weak)
        } else {
            (&floor.flight, &floor.flight_weak)
        };
        rows.push(vec![
            "noise alone".into(),
            three(&frames.force_n.mae),
            three(&frames.moment_nm.mae),
            number(mean(&windows.force_n.mae)),
            number(mean(&windows.moment_nm.mae)),
        ]);
    }
    Table {
        caption: format!(
            "Mean absolute error on {} (root axes; frames, and windows of {} s)",
            judged_on(c),
            c.options.window_s
        ),
        header: ["model", "force x y z, N", "moment x y z, N·m", "windows, N", "windows, N·m"]
            .map(str::to_owned)
            .to_vec(),
        rows,
    }
}

pub fn recordings(study: &Study, ws: &Workspace, view: &ComparisonView) -> Section {
    let rows = study
        .trials
        .iter()
        .map(|t| {
            let import = ws.manifest("import", &t.name);
            let get = |key: &str| {
                import.as_ref().and_then(|m| m.summary.get(key)).map_or("–".to_owned(), ToString::to_string)
            };
            let kin = view.kinematics.iter().find(|k| k.trial == t.name);
            let state = match (&t.excluded, &import) {
                (Some(reason), _) => format!("excluded: {reason}"),
                (None, Some(m)) if m.is_ok() => "good".to_owned(),
                (None, Some(_)) => "failed".to_owned(),
                (None, None) => "not run".to_owned(),
            };
            vec![
                t.name.clone(),
                t.role.word().to_owned(),
                state,
                get("frames"),
                get("rate_hz"),
                get("markers"),
                get("filled_gaps"),
                get("plates"),
                kin.and_then(|k| k.marker_rms_mm).map_or("–".into(), number),
                kin.and_then(|k| k.flights).map_or("–".into(), |n| n.to_string()),
                kin.and_then(|k| k.gravity_error_percent).map_or("–".into(), |g| format!("{g:+.2}")),
            ]
        })
        .collect();
    let mut blocks = vec![Block::Table {
        table: Table {
            caption: "Every recording".into(),
            header: [
                "trial",
                "role",
                "state",
                "frames",
                "Hz",
                "markers",
                "gaps filled",
                "plates",
                "marker RMS, mm",
                "flights",
                "fall against g, %",
            ]
            .map(str::to_owned)
            .to_vec(),
            rows,
        },
    }];
    for stage in STAGES {
        for task in stage.tasks(study) {
            let name = task.map_or(WHOLE_STUDY, |t| t.name.as_str());
            let Some(m) = ws.manifest(stage.name, name) else { continue };
            if let crate::workspace::Outcome::Failed(f) = &m.outcome {
                let hint = f.hint.as_ref().map_or(String::new(), |h| format!(" Hint: {h}."));
                blocks.push(Block::Remark {
                    text: format!("{} of {name} failed: {}.{hint}", stage.name, f.problem),
                    light: Light::Poor,
                });
            }
        }
    }
    Section {
        id: "recordings".into(),
        title: "Recordings".into(),
        lead: "What came in. In flight the centre of mass should fall with g: the last column says how nearly it does, with the prior's masses.".into(),
        blocks,
    }
}

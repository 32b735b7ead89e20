//! A paragraph to paste, and commands to go on.

use crate::command::parameters::ParametersView;
use crate::runner::stage_index;
use crate::stages::STAGES;
use crate::study::Study;
use aloft_report::{Block, Section};

pub fn methods(study: &Study, found: &ParametersView) -> Section {
    let f = &study.config.filter;
    let object = study.object.is_some();
    let mut text = format!(
        "Marker trajectories were brought to SI units and one world frame with Z up; gaps up to {} s were filled. ",
        study.config.import.fill_gaps_s
    );
    text.push_str(&if object {
        "Link frames follow the object description; the hinge was found from motion and refined over all recordings. ".to_owned()
    } else {
        format!(
            "A model of 15 links and 34 joint degrees of freedom was scaled to the static trial (hip centres after {}, inertial prior: {}) and its joint centres, hinge axes and marker places were refined over the dynamic trials on markers alone. ",
            study.config.scale.hip, study.anthropometry.title
        )
    });
    text.push_str(&format!(
        "Joint coordinates were found frame by frame by weighted non-linear least squares and, for frame-wise comparison, filtered forward and backward (Butterworth, order {} a pass, {} Hz). ",
        f.order, f.cutoff_hz
    ));
    text.push_str(&format!(
        "Base parameters were identified from {} flights with {} rows ({}), after Ayusawa, Venture and Nakamura (2010); the body mass of {} kg fixed the scale.",
        found.parameters.n_stretches, found.rows_used, found.parameters.estimator.name(), study.facts.person.mass_kg
    ));
    let first = STAGES.get(stage_index("ik").unwrap_or(0)).map_or("ik", |s| s.name);
    let p = study.config_path.display();
    Section {
        id: "methods".into(),
        title: "Methods, and what to do next".into(),
        lead: "A paragraph to paste, and commands to go on.".into(),
        blocks: vec![
            Block::Text { text },
            Block::Commands {
                lines: vec![
                    format!("aloft compare {p}            # where the model fails"),
                    format!("aloft discover {p}           # which effect is missing"),
                    format!("aloft parameters {p}         # every number with its interval"),
                    format!("aloft status {p}             # what is done, stale or failed"),
                    format!("aloft run {p} --from {first}     # again from one stage on"),
                ],
            },
        ],
    }
}

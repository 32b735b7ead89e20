//! Measured against predicted wrench, and where the error sits.

use super::words::three;
use crate::command::compare::ComparisonView;
use crate::error::PipelineError;
use crate::study::Study;
use crate::table::Table as NumberTable;
use crate::workspace::{WHOLE_STUDY, Workspace};
use aloft_report::{Block, Figure, Section, Series, Shade, Table};

pub fn shades(time: &[f64], in_flight: &[f64]) -> Vec<Shade> {
    let mut out = Vec::new();
    let mut start = None;
    for i in 0..=time.len() {
        let on = i < time.len() && in_flight[i] > 0.5;
        match (start, on) {
            (None, true) => start = Some(time[i]),
            (Some(s), false) => {
                out.push(Shade { from: s, to: time[i - 1] });
                start = None;
            }
            _ => {}
        }
    }
    out
}

pub fn wrench(study: &Study, ws: &Workspace, view: &ComparisonView) -> Result<Section, PipelineError> {
    let c = &view.comparison;
    let mut order: Vec<&str> = c
        .first
        .trials
        .iter()
        .filter(|t| t.held_out_contact && t.contact.frames > 0)
        .map(|t| t.trial.as_str())
        .collect();
    if order.is_empty() {
        order = c.first.trials.iter().map(|t| t.trial.as_str()).collect();
    }
    let components = [
        ("force_x_n", "Fx, N"),
        ("force_y_n", "Fy, N"),
        ("force_z_n", "Fz, N"),
        ("moment_x_nm", "Mx, N·m"),
        ("moment_y_nm", "My, N·m"),
        ("moment_z_nm", "Mz, N·m"),
    ];
    let titles: Vec<&str> = components.iter().map(|x| x.1).collect();
    let mut blocks = Vec::new();
    for trial in order.iter().take(3) {
        let path = ws.place("compare", WHOLE_STUDY).join(format!("series_{trial}.parquet"));
        if !path.is_file() {
            continue;
        }
        let mut columns = NumberTable::read(&path)?.into_map();
        let time = columns.remove("time_s").unwrap_or_default();
        let in_flight = columns.remove("in_flight").unwrap_or_default();
        let step = (time.len() / 1200).max(1);
        let thin = |v: &[f64]| v.iter().step_by(step).copied().collect::<Vec<f64>>();
        let mut series = Vec::new();
        for model in ["measured", "identified", "prior"] {
            for (panel, (key, _)) in components.iter().enumerate() {
                if let Some(values) = columns.get(&format!("{model}.{key}")) {
                    let line = Series::line(model, thin(&time), thin(values)).in_panel(panel);
                    series.push(if model == "prior" { line.dashed() } else { line });
                }
            }
        }
        let caption = format!("{trial}: measured and predicted wrench on the root, root axes (flights shaded)");
        blocks.push(Block::Figure {
            figure: Figure::panels(&caption, "time, s", &titles, series, &shades(&time, &in_flight), &[]),
        });
    }
    let f = &c.first.flight;
    blocks.push(Block::Text {
        text: format!(
            "In flight nothing may act: what the model still predicts there has a root mean square of {} N and {} N·m over {} frames.",
            three(&f.residual_force_n.rms),
            three(&f.residual_moment_nm.rms),
            f.frames
        ),
    });
    let _ = study;
    Ok(Section {
        id: "wrench".into(),
        title: "Measured against predicted".into(),
        lead: "The external wrench that the identified body needs for its motion, beside what the plates measured and what the anthropometric prior predicts.".into(),
        blocks,
    })
}

pub fn where_it_fails(view: &ComparisonView) -> Section {
    let c = &view.comparison;
    let rows = c
        .first
        .breakdown
        .iter()
        .map(|g| {
            vec![
                format!("{:?}: {}", g.by, g.name),
                g.errors.frames.to_string(),
                three(&g.errors.force_n.mae),
                three(&g.errors.moment_nm.mae),
            ]
        })
        .collect();
    Section {
        id: "residuals".into(),
        title: "Where the error sits".into(),
        lead: "Mean absolute error by phase, flight, time in flight, speed, acceleration, turning and posture.".into(),
        blocks: vec![Block::Table {
            table: Table {
                caption: "Error in groups of frames".into(),
                header: ["group", "frames", "force x y z, N", "moment x y z, N·m"].map(str::to_owned).to_vec(),
                rows,
            },
        }],
    }
}

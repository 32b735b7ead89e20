//! How well the model follows the markers.

use super::skeleton::skeleton;
use crate::error::PipelineError;
use crate::study::Study;
use crate::workspace::{Workspace, read_json};
use aloft_report::{Block, Figure, HeatMap, Section};

pub fn kinematics(study: &Study, ws: &Workspace) -> Result<Vec<Section>, PipelineError> {
    let mut map = HeatMap { x: Vec::new(), y: Vec::new(), z: Vec::new(), unit: "mm".into() };
    for t in study.included().filter(|t| t.role.is_dynamic()) {
        let path = ws.place("ik", &t.name).join("report.json");
        let Ok(report) = read_json::<serde_json::Value>(&path) else { continue };
        map.x.push(t.name.clone());
        for m in report["markers"].as_array().into_iter().flatten() {
            let label = m["label"].as_str().unwrap_or_default();
            let row = map.y.iter().position(|y| y == label).unwrap_or_else(|| {
                map.y.push(label.to_owned());
                map.z.push(Vec::new());
                map.y.len() - 1
            });
            let width = map.x.len();
            map.z[row].resize(width - 1, f64::NAN);
            map.z[row].push(m["rms_m"].as_f64().map_or(f64::NAN, |v| v * 1e3));
        }
    }
    let width = map.x.len();
    map.z.iter_mut().for_each(|r| r.resize(width, f64::NAN));
    let mut blocks = vec![Block::Figure {
        figure: Figure::heat_map("Root mean square distance of each marker from the model", &map),
    }];
    if let Some(figure) = skeleton(study, ws)? {
        blocks.push(Block::Figure { figure });
    }
    Ok(vec![Section {
        id: "kinematics".into(),
        title: "Kinematics".into(),
        lead: "How well the model follows the markers.".into(),
        blocks,
    }])
}

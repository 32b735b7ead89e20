//! Distribution of the error: maps over groups of frames, and the segments that may cause it.

use super::wording::number;
use aloft_compare::{Comparison, Group, GroupedBy};
use aloft_page::{Block, Columns, Dots, Figure, HeatMap, Section, Table, Words};

/// Maps by groups of frames, and attribution of the error to segments.
pub fn sections(c: &Comparison) -> Vec<Section> {
    let mut out = Vec::new();
    let some = |wanted: &dyn Fn(GroupedBy) -> bool| -> Vec<&Group> {
        c.first.breakdown.iter().filter(|g| wanted(g.by) && g.errors.frames > 0).collect()
    };
    let groups = some(&|by| !single(by));
    let (trials, flights) = (some(&|by| by == GroupedBy::Trial), some(&|by| by == GroupedBy::Flight));
    if !groups.is_empty() {
        let mut blocks = maps(&groups, "what frames have in common");
        for (what, by, list) in
            [("Recording by recording", "recording", &trials), ("Flight by flight", "flight", &flights)]
        {
            if list.len() > 1 {
                blocks.push(Block::Folded { title: format!("{what} ({})", list.len()), blocks: maps(list, by) });
            }
        }
        let all: Vec<&Group> = c.first.breakdown.iter().collect();
        blocks.push(Block::Folded { title: "The numbers".into(), blocks: vec![table(&all).into()] });
        out.push(Section::new(
            "residuals",
            "Where the error sits",
            "A model that only lacks precision errs everywhere alike. A row that stands out says in which motion something is missing: \
             error that grows with speed points to drag, with time in flight to velocity or gravity, with turning to inertia.",
            blocks,
        ));
    }
    if let Some(section) = segments(c) {
        out.push(section);
    }
    out
}

/// True for groups that are a single flight or trial: they have maps of their own.
fn single(by: GroupedBy) -> bool {
    matches!(by, GroupedBy::Flight | GroupedBy::Trial)
}

fn label(g: &Group) -> String {
    if single(g.by) { g.name.clone() } else { format!("{}: {}", g.by.word(), g.name) }
}

fn maps(groups: &[&Group], by: &str) -> Vec<Block> {
    let names: Vec<String> = groups.iter().map(|g| label(g)).collect();
    let map = |title: &str, unit: &str, get: &dyn Fn(&Group) -> [f64; 6]| {
        let axes = ["root x", "root y", "root z", "world x", "world y", "world z"];
        let values: Vec<Vec<f64>> = groups.iter().map(|g| get(g).to_vec()).collect();
        // contact and flight differ by nature, so a row is shaded relative to the rows of its own
        // kind
        let usual = |by: GroupedBy, axis: usize| {
            let own: Vec<f64> = groups.iter().zip(&values).filter(|(g, _)| g.by == by).map(|(_, v)| v[axis]).collect();
            own.iter().sum::<f64>() / own.len() as f64
        };
        let z = groups.iter().zip(&values).map(|(g, row)| (0..6).map(|i| row[i] / usual(g.by, i)).collect()).collect();
        let map = HeatMap {
            x_title: "axis".into(),
            x: Columns::Names(axes.iter().map(|a| (*a).to_owned()).collect()),
            y: names.clone(),
            z,
            unit: "error / mean of its kind".to_owned(),
            step: 1e-3,
            top: Some(2.5),
            values: Some((values, unit.to_owned())),
        };
        let caption = format!(
            "Mean absolute error of the identified model in {unit}, by {by} and axis, in root and in world axes. Shades compare a row with the \
             others of its kind: a dark row errs twice as much as they do on average."
        );
        Block::from(Figure::heat_map(Words::new(title, &caption), &map))
    };
    let six = |a: [f64; 3], b: [f64; 3]| [a[0], a[1], a[2], b[0], b[1], b[2]];
    vec![
        map("Force error", "N", &|g| six(g.errors.force_n.mae, g.errors.force_world_n.mae)),
        map("Moment error", "N·m", &|g| six(g.errors.moment_nm.mae, g.errors.moment_world_nm.mae)),
    ]
}

fn table(groups: &[&Group]) -> Table {
    let rows = groups
        .iter()
        .map(|g| {
            let mut row = vec![label(g), g.errors.frames.to_string()];
            row.extend(g.errors.force_n.mae.iter().chain(&g.errors.moment_nm.mae).map(|v| number(*v)));
            row
        })
        .collect();
    Table::new(
        "Error in groups of frames",
        "Mean absolute error, root axes.",
        &["group", "frames", "Fx, N", "Fy, N", "Fz, N", "Mx, N·m", "My, N·m", "Mz, N·m"],
        rows,
    )
}

fn segments(c: &Comparison) -> Option<Section> {
    let s = &c.first.segments;
    if s.len() < 2 {
        return None;
    }
    let names: Vec<String> = s.iter().map(|x| x.link.clone()).collect();
    let kinds = [
        Dots::new("a change of its mass parameters", s.iter().map(|x| 100.0 * x.inertia_share).collect()),
        Dots::new("a drag force on it", s.iter().map(|x| 100.0 * x.drag_share).collect()),
    ];
    let words = Words::new(
        "Which segment could carry the error",
        "Share of the mean square error that a change of this one segment would explain. Shares overlap and do not add up: a large one says where to look, not what is wrong.",
    );
    let figure = Figure::dots(words, "share of the mean square error, %", &names, &kinds, &[]);
    Some(Section::new("segments", "Segment by segment", "", vec![figure.into()]))
}

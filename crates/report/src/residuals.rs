//! Distribution of the error: maps over groups of frames, and the segments that may cause it.

use super::headline::times_floor_by_axis;
use super::wording::number;
use aloft_compare::{Comparison, Group, GroupedBy, NoiseFloor, WindowErrors};
use aloft_page::{Block, Columns, Dots, Figure, HeatMap, Scale, Section, Table, Words};

/// Fewest windows of a group that is shown.
const FEWEST_WINDOWS: usize = 3;
/// Columns of the maps.
const AXES: [&str; 6] = ["force x", "force y", "force z", "moment x", "moment y", "moment z"];

/// Maps by groups of frames, and attribution of the error to segments.
pub fn sections(c: &Comparison) -> Vec<Section> {
    let mut out = Vec::new();
    let some = |wanted: &dyn Fn(GroupedBy) -> bool| -> Vec<&Group> {
        c.first.breakdown.iter().filter(|g| wanted(g.by) && g.errors.frames > 0).collect()
    };
    let groups = some(&|by| !single(by));
    let (trials, flights) = (some(&|by| by == GroupedBy::Trial), some(&|by| by == GroupedBy::Flight));
    if !groups.is_empty() {
        let mut blocks = maps(&groups, "kind of motion", c.noise_floor.as_ref());
        for (what, by, list) in
            [("Recording by recording", "recording", &trials), ("Flight by flight", "flight", &flights)]
        {
            if list.len() > 1 {
                blocks.push(Block::Folded {
                    title: format!("{what} ({})", list.len()),
                    blocks: maps(list, by, c.noise_floor.as_ref()),
                });
            }
        }
        let all: Vec<&Group> = c.first.breakdown.iter().collect();
        blocks.push(Block::Folded { title: "The numbers".into(), blocks: vec![table(&all).into()] });
        out.push(Section::new(
            "residuals",
            "Location of the error",
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

fn maps(groups: &[&Group], by: &str, floor: Option<&NoiseFloor>) -> Vec<Block> {
    // a map in multiples of the floor shows what is left; without a floor, in newtons
    let six = |e: &WindowErrors| {
        let (f, m) = (e.force_n.rmse, e.moment_nm.rmse);
        [f[0], f[1], f[2], m[0], m[1], m[2]]
    };
    let ratio = |g: &Group| -> Option<Vec<f64>> {
        let own = g.floor(floor).filter(|f| f.windows.windows > 0 && g.windows.windows >= FEWEST_WINDOWS)?;
        Some(six(&g.windows).iter().zip(six(&own.windows)).map(|(e, f)| e / f).collect())
    };
    let rows: Vec<(String, Vec<f64>)> = groups.iter().filter_map(|g| Some((label(g), ratio(g)?))).collect();
    if rows.is_empty() {
        return vec![Block::text(
            "No noise floor is known for these groups, or they have too few windows; the numbers are in the table below.",
        )];
    }
    let (names, z) = rows.into_iter().unzip();
    let map = HeatMap {
        x_title: String::new(),
        x: Columns::Names(AXES.iter().map(|a| (*a).to_owned()).collect()),
        y: names,
        z,
        unit: "error / noise floor".into(),
        step: 1e-3,
        scale: Scale::TimesFloor,
        recording: String::new(),
    };
    let caption = format!(
        "Error over weak windows by {by} and world axis, in multiples of the error of a perfect model on these recordings there. A cell without colour is at its floor."
    );
    vec![Figure::heat_map(Words::new("Residual error in multiples of the noise floor", &caption), &map).into()]
}

/// What remains of the present model, by axis, in multiples of the floor; none if no floor is
/// known.
pub fn remains(c: &Comparison, place: &str) -> Option<Figure> {
    let all = times_floor_by_axis(c, place);
    if all.len() != 6 || !all.iter().any(|x| x.1.is_finite()) {
        return None;
    }
    let values: Vec<f64> = all.iter().map(|x| x.1).collect();
    let map = HeatMap {
        x_title: String::new(),
        x: Columns::Names(["x", "y", "z"].map(str::to_owned).to_vec()),
        y: vec!["force".into(), "moment".into()],
        z: vec![values[..3].to_vec(), values[3..].to_vec()],
        unit: "error / noise floor".into(),
        step: 1e-3,
        scale: Scale::TimesFloor,
        recording: String::new(),
    };
    let title = format!("Residual error in {place}");
    Some(Figure::heat_map(Words::new(&title, "By world axis, in multiples of the noise floor."), &map))
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
        "Mean absolute error, root axes. Posture is the radius of gyration: the distance of the masses from the centre of mass.",
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
        "Segments that could explain the error",
        "Share of the mean square error that a change of this one segment would explain. Shares overlap and do not add up: they indicate a location, not a cause.",
    );
    let figure = Figure::dots(words, "share of the mean square error, %", &names, &kinds, &[]);
    Some(Section::new("segments", "Segment by segment", "", vec![figure.into()]))
}

//! The revisions of the model and the error that each of them left.

use super::story::Story;
use super::wording::{maybe, number, plus_minus};
use aloft_analysis::compare::JudgedOn;
use aloft_analysis::history::HistoryRow;
use aloft_page::{Block, Cell, Figure, Light, Panel, Section, Series, Table, Words};
use aloft_study::revision::Judged;

/// The section; none if the model was never changed.
pub fn section(story: &Story<'_>) -> Option<Section> {
    let rungs = &story.history.revisions;
    if rungs.len() < 2 {
        return None;
    }
    let x: Vec<f64> = (0..rungs.len()).map(|i| i as f64).collect();
    let of = |get: &dyn Fn(&HistoryRow) -> Option<f64>| {
        rungs.iter().map(|r| get(r).unwrap_or(f64::NAN)).collect::<Vec<f64>>()
    };
    let judged_on = rungs.iter().rev().find_map(|r| r.judged_on);
    let judged = judged_on.map_or("held-out motion", JudgedOn::words);
    let ticks: Vec<String> = rungs
        .iter()
        .map(|r| if r.revision == 0 { "0: plain".to_owned() } else { format!("{}: {}", r.revision, r.action) })
        .collect();
    let place = |title: &str, get: &dyn Fn(&HistoryRow) -> Option<Judged>| Panel {
        title: title.to_owned(),
        y: "error, N".into(),
        ticks: ticks.clone(),
        series: vec![
            Series::line("held-out error", x.clone(), of(&|r| get(r).map(|j| j.error_n))).with_points().coloured("$c0"),
            Series::line("noise floor", x.clone(), of(&|r| get(r).and_then(|j| j.noise_n))).dashed().coloured("$dim"),
        ],
        from_zero: true,
        ..Panel::default()
    };
    let panels: Vec<Panel> = [place("In flight", &|r| r.flight), place("In held-out contact", &|r| r.contact)]
        .into_iter()
        .filter(|p| p.series[0].y.iter().any(|v| v.is_finite()))
        .collect();
    let words = Words::new(
        "Held-out error by model revision",
        "Held-out error over weak windows (moments over a lever of 0.1 m) of each revision of the model, and what a perfect model would leave (the noise floor).",
    );
    let figure = Figure::panels(words, "revision of the model", panels.len(), &panels, &[]);
    let any_void = rungs.iter().any(|r| r.void.is_some());
    let mut header =
        vec!["revision", "effects", "error, N", "noise, N", "σ_N−1 / σ_N", "coefficients", "largest change"];
    if any_void {
        header.push("remark");
    }
    let table = Table::new(
        "Revisions",
        "Coefficients with 95 % intervals, and the base parameter that changed most against the revision before.",
        &header,
        rungs.iter().map(|r| row(r, any_void)).collect(),
    );
    let lead = format!(
        "Each revision of the model and the error that it left on {judged}. A gain that is paid for with worse markers is void."
    );
    let mut blocks: Vec<Block> = vec![figure.into(), table.into()];
    // compare the first and the last revision on the same motion: that on which the last was judged
    let in_flight = judged_on == Some(JudgedOn::Flight);
    let on = |r: &HistoryRow| if in_flight { r.flight } else { r.contact };
    if let (Some(first), Some(last)) = (rungs.first().and_then(on), rungs.last())
        && let Some((first, now, floor)) = on(last).and_then(|j| Some((first.error_n, j.error_n, j.noise_n?)))
    {
        let at_floor = on(last).and_then(|j| j.at_floor()).unwrap_or(now < 1.1 * floor);
        let light = if last.void.is_some() {
            Light::Poor
        } else if at_floor {
            Light::Good
        } else {
            Light::Fair
        };
        let where_it_is = if at_floor { "at the noise floor" } else { "above the noise floor" };
        let text = format!(
            "From {} N to {} N; a perfect model would leave {} N: {where_it_is}.",
            number(first),
            number(now),
            number(floor)
        );
        blocks.insert(0, Block::remark(light, text));
    }
    Some(Section::new("ladder", "The ladder", &lead, blocks))
}

fn row(r: &HistoryRow, with_remark: bool) -> Vec<Cell> {
    let coefficients: Vec<String> =
        r.coefficients.iter().map(|c| format!("{} {}", c.name, plus_minus(c.value, c.ci95))).collect();
    let mut cells: Vec<Cell> = vec![
        format!("{} ({})", r.revision, r.action).into(),
        if r.effects.is_empty() { "none".into() } else { r.effects.join(", ").into() },
        maybe(r.held_out_error).into(),
        maybe(r.noise_floor).into(),
        maybe(r.sigma_ratio).into(),
        coefficients.join("; ").into(),
        r.largest_change.as_ref().map_or("–".into(), |(name, by)| format!("{name} by {}", number(*by)).into()),
    ];
    if with_remark {
        cells.push(r.void.clone().unwrap_or_default().into());
    }
    cells
}

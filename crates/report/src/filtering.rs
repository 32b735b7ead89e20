//! Winter's residual analysis as a table, for choosing a cut-off frequency.

use super::story::Story;
use super::wording::{maybe, number};
use aloft_page::{Cell, Figure, Line, Panel, Section, Series, Table, Words};

/// The section; none if no recording was analysed.
pub fn section(story: &Story<'_>) -> Option<Section> {
    let all: Vec<_> = story.dynamic().filter_map(|t| Some((t, t.analysis.as_ref()?))).collect();
    if all.is_empty() {
        return None;
    }
    let f = &story.session.config.filter;
    let many = all.len() > 4;
    let series = all
        .iter()
        .map(|(t, a)| {
            let y = a.residual_rms.iter().map(|r| 1e3 * r).collect();
            let s = Series::line(t.entry.name.clone(), a.cutoff_hz.clone(), y);
            if many { Series { quiet: true, ..s.coloured("c0") } } else { s }
        })
        .collect();
    let panel = Panel {
        y: "residual, mm".into(),
        series,
        lines: vec![Line { at: f.cutoff_hz, upright: true, label: format!("chosen: {} Hz", f.cutoff_hz) }],
        log: true,
        ..Panel::default()
    };
    let words = Words::new(
        "Effect of the cut-off frequency",
        "Root mean square of the root's path less its filtered path, one curve a recording. At high cut-offs only noise is removed and the curve is \
         nearly level; where it rises, the filter also removes motion.",
    );
    let figure = Figure::panels(words, "cut-off, Hz", 1, &[panel], &[]);
    let rows = all
        .iter()
        .map(|(t, a)| {
            let at = |hz: f64| {
                let i = (0..a.cutoff_hz.len())
                    .min_by(|i, j| (a.cutoff_hz[*i] - hz).abs().total_cmp(&(a.cutoff_hz[*j] - hz).abs()));
                i.and_then(|i| a.residual_rms.get(i)).map_or("–".to_owned(), |r| number(1e3 * r))
            };
            vec![
                Cell::from(t.entry.name.clone()).to(format!("#{}", t.anchor())),
                maybe(a.noise_rms.map(|n| 1e3 * n)).into(),
                maybe(a.suggested_cutoff_hz).into(),
                at(f.cutoff_hz).into(),
                at(6.0).into(),
                at(15.0).into(),
            ]
        })
        .collect();
    let chosen = format!("residual at {} Hz, mm", f.cutoff_hz);
    let table = Table::new(
        "Suggested cut-offs",
        "Noise by extrapolating the straight part to zero; the suggestion is where signal lost and noise kept are of one size. A dash: no straight part was found.",
        &["recording", "noise, mm", "suggested, Hz", &chosen, "at 6 Hz, mm", "at 15 Hz, mm"],
        rows,
    );
    let lead = format!(
        "The filter in use: Butterworth, order {} a pass, forward and backward, {} Hz. It is used for the frame-wise comparison only; weak rows, which determine the parameters, are not filtered.",
        f.order, f.cutoff_hz
    );
    Some(Section::new("filter", "Choosing the filter", &lead, vec![figure.into(), table.into()]))
}

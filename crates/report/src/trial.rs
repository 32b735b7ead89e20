//! The chapter about one recording.

use super::story::{Story, TrialStory};
use super::wording::{anchor, card, maybe, number};
use super::{RECORDINGS, lights, player, series};
use aloft_page::{Block, Card, Chapter, Columns, Figure, HeatMap, Light, Section, Table, Words};
use aloft_workspace::error::PipelineError;

/// Number of columns in the map of marker errors over time.
const COLUMNS: usize = 110;

/// The chapter.
///
/// # Errors
/// The recording was imported and cannot be read.
pub fn chapter(story: &Story<'_>, t: &TrialStory<'_>) -> Result<Chapter, PipelineError> {
    let name = &t.entry.name;
    let id = |what: &str| anchor(what, name);
    let mut first = Vec::new();
    if let Some(reason) = &t.entry.excluded {
        first.push(Block::remark(Light::Neutral, format!("Left out: {reason}")));
    }
    let remarks = lights::remarks(t);
    first.push(Block::Cards { cards: cards(story, t) });
    if remarks.is_empty() && t.entry.excluded.is_none() && t.motion.is_some() {
        first.push(Block::remark(lights::trial(t), "No warning."));
    }
    let block = |(light, text): &(Light, String)| Block::remark(*light, text.clone());
    first.extend(remarks.iter().take(6).map(block));
    if remarks.len() > 6 {
        let rest = remarks.iter().skip(6).map(block).collect();
        first.push(Block::Folded { title: format!("{} more remarks", remarks.len() - 6), blocks: rest });
    }
    let file = t.entry.file.file_name().map(|f| f.to_string_lossy().into_owned()).unwrap_or_default();
    let lead = format!("{file}: {}, {} s.", t.entry.role.word(), maybe(t.duration_s()));
    let mut sections = vec![Section::new(id("about"), "Quality", &lead, first)];
    let mut add = |key: &str, title: &str, blocks: Vec<Block>| {
        if !blocks.is_empty() {
            sections.push(Section::new(id(key), title, "", blocks));
        }
    };
    let beside = |left: Option<Figure>, right: Option<Figure>| match (left, right) {
        (Some(left), Some(right)) => vec![Block::Beside { left: vec![left.into()], right: vec![right.into()] }],
        (left, right) => left.into_iter().chain(right).map(Block::from).collect(),
    };
    let mut motion = beside(player::figure(story, t)?, series::wrench(story, t));
    motion.extend(flights(story, t).map(Block::from));
    add("motion", "Motion, measured and predicted", motion);
    add("markers", "Markers over time", markers(t).into_iter().map(Block::from).collect());
    // the quality of the recording follows its motion
    if sections.len() > 1 {
        sections[..2].rotate_left(1);
    }
    Ok(Chapter {
        id: t.anchor(),
        title: name.clone(),
        group: RECORDINGS.into(),
        light: lights::trial(t),
        word: String::new(),
        sections,
    })
}

fn cards(story: &Story<'_>, t: &TrialStory<'_>) -> Vec<Card> {
    let mut cards = Vec::new();
    let k = t.kinematics.as_ref();
    if let Some(mm) = k.and_then(|k| k.marker_rms_mm) {
        cards.push(card(
            "Marker error, RMS",
            format!("{} mm", number(mm)),
            lights::usual_limit(),
            lights::marker_rms(mm),
        ));
    }
    if let Some(p) = t.missing_percent() {
        let filled = t.noted("filled_gaps").unwrap_or(0.0);
        cards.push(card(
            "Missing samples",
            format!("{p:.1} %"),
            format!("{filled:.0} gaps filled"),
            lights::missing(p),
        ));
    }
    if let Some(n) = t.n_flights() {
        cards.push(card("Flights", n.to_string(), "", Light::Neutral));
    }
    if let Some(g) = k.and_then(|k| k.gravity_error_percent) {
        cards.push(card(
            "Fall against g",
            format!("{g:+.2} %"),
            "mean over flights, masses of the tables",
            lights::free_fall(g),
        ));
    }
    let compared = story.comparison.as_ref();
    let of = |m: &aloft_compare::ModelComparison| m.trials.iter().find(|c| c.trial == t.entry.name).cloned();
    if let Some((view, own)) = compared.and_then(|v| Some((v, of(&v.comparison.first)?))) {
        let prior = view.comparison.beside.iter().find(|m| m.model == "prior").and_then(of);
        let contact = own.contact.frames > 0;
        let errors = |c: &aloft_compare::TrialComparison| if contact { c.contact.clone() } else { c.flight.clone() };
        let held = if contact { own.held_out_contact } else { own.held_out_flight };
        let place = format!("{}{}", if contact { "contact" } else { "flight" }, if held { ", held out" } else { "" });
        if errors(&own).frames > 0 {
            let (f, p) = (errors(&own).force_n.mean_mae(), prior.as_ref().map(|p| errors(p).force_n.mean_mae()));
            let beside =
                |p: Option<f64>, unit: &str| p.map_or(String::new(), |p| format!("; tables {} {unit}", number(p)));
            cards.push(card(
                "Force error",
                format!("{} N", number(f)),
                format!("{place}{}", beside(p, "N")),
                Light::Neutral,
            ));
            let (n, p) = (errors(&own).moment_nm.mean_mae(), prior.as_ref().map(|p| errors(p).moment_nm.mean_mae()));
            cards.push(card(
                "Moment error",
                format!("{} N·m", number(n)),
                format!("{place}{}", beside(p, "N·m")),
                Light::Neutral,
            ));
        }
    }
    cards
}

/// The flights of a recording.
fn flights(story: &Story<'_>, t: &TrialStory<'_>) -> Option<Table> {
    let report = t.flights.as_ref()?;
    let g = story.session.facts.gravity_mps2;
    let word = |v: &dyn std::fmt::Debug| format!("{v:?}").to_lowercase();
    let rows: Vec<Vec<String>> = report
        .flights
        .iter()
        .enumerate()
        .map(|(i, f)| {
            let a = f.mean_acceleration_mps2;
            vec![
                (i + 1).to_string(),
                format!("{:.3}", f.start as f64 / report.rate_hz),
                format!("{:.3}", f.end as f64 / report.rate_hz),
                format!("{:.3}", f.duration_s(report.rate_hz)),
                number(a[2]),
                if a[2].is_finite() && g > 0.0 { format!("{:+.2}", (-a[2] / g - 1.0) * 100.0) } else { "–".into() },
                format!("{} / {}", word(&f.takeoff_source), word(&f.landing_source)),
            ]
        })
        .collect();
    (!rows.is_empty()).then(|| {
        Table::new(
            "Flights",
            "Vertical acceleration of the centre of mass, masses of the tables; it should be −g.",
            &["flight", "from, s", "to, s", "length, s", "acceleration, m/s²", "against g, %", "edges told by"],
            rows,
        )
    })
}

/// Error of each marker over time.
fn markers(t: &TrialStory<'_>) -> Option<Figure> {
    let motion = t.motion.as_ref()?;
    let (n, labels) = (motion.n_frames(), &motion.marker_labels);
    if n == 0 || labels.is_empty() {
        return None;
    }
    let width = n.min(COLUMNS);
    let bin = |c: usize| (c * n / width)..((c + 1) * n / width).max(c * n / width + 1);
    let mut rows: Vec<(String, Vec<f64>)> = labels
        .iter()
        .enumerate()
        .map(|(m, label)| {
            let row = (0..width)
                .map(|c| {
                    let values = bin(c).map(|f| motion.residual_m[f * labels.len() + m]).filter(|v| v.is_finite());
                    values.fold(f64::NAN, |a, b| if a > b { a } else { b }) * 1e3
                })
                .collect();
            (label.clone(), row)
        })
        .collect();
    let worst = |r: &[f64]| r.iter().filter(|v| v.is_finite()).fold(0.0_f64, |a, b| a.max(*b));
    rows.sort_by(|a, b| worst(&b.1).total_cmp(&worst(&a.1)));
    let map = HeatMap {
        x_title: "time, s".into(),
        x: Columns::Values((0..width).map(|c| (bin(c).start + bin(c).end - 1) as f64 / 2.0 / motion.rate_hz).collect()),
        y: rows.iter().map(|r| r.0.clone()).collect(),
        z: rows.into_iter().map(|r| r.1).collect(),
        unit: "error, mm".into(),
        step: 0.02,
        recording: t.entry.name.clone(),
        ..HeatMap::default()
    };
    let words = Words::new(
        "Distance of each marker from the model over time",
        "The largest in each stretch of time, the worst marker on top; blank where the marker was not seen. A dark patch in one row is a swapped or \
         slipping marker, a dark column a frame that inverse kinematics could not fit.",
    );
    Some(Figure::heat_map(words, &map))
}

//! Identified parameters with intervals, compared with the prior.

use super::STUDY;
use super::anthropometry;
use super::lights;
use super::story::Story;
use super::wording::{card, maybe, number, plus_minus, three};
use aloft_identify::{BaseEstimate, EffectEstimate, Origin, Parameters, half_of};
use aloft_page::{Block, Chapter, Dots, Figure, Light, Section, Table, Words};
use aloft_workspace::error::PipelineError;

/// The chapter; none if nothing was identified.
///
/// # Errors
/// The anatomy of the body is there and cannot be read.
pub fn chapter(story: &Story<'_>) -> Result<Option<Chapter>, PipelineError> {
    let Some(found) = &story.found else { return Ok(None) };
    let p = &found.parameters;
    let reservation = story.comparison.as_ref().and_then(|v| v.parameters.reservation);
    let light = match (p.gate.passed && reservation.is_none(), p.gate.reasons.is_empty()) {
        (true, true) => Light::Good,
        (true, false) => Light::Fair,
        (false, _) => Light::Poor,
    };
    let mut sections = vec![trust(p, reservation)];
    sections.extend(anthropometry::section(story, p)?);
    sections.push(base(p));
    Ok(Some(Chapter {
        id: "parameters".into(),
        title: "Identified parameters".into(),
        group: STUDY.into(),
        light,
        word: String::new(),
        sections,
    }))
}

/// How far the numbers can be trusted.
fn trust(p: &Parameters, reservation: Option<&str>) -> Section {
    let of = |word: &str| p.base.iter().filter(|b| b.determined_by() == word).count();
    let table = p.base.iter().filter(|b| b.from == Origin::Table).count();
    let nothing = p.base.iter().filter(|b| b.from == Origin::NotDetermined).count();
    let rest = match (table, nothing) {
        (n, 0) => format!("{n} from tables"),
        (0, n) => format!("{n} not determined"),
        (n, m) => format!("{n} from tables, {m} not determined"),
    };
    let mut blocks = vec![Block::Cards {
        cards: vec![
            card(
                "Singular-value gap σ_N−1 / σ_N",
                number(p.sigma.ratio),
                "20 is clear, below 3 the parameters are not determined",
                lights::gap(p.sigma.ratio),
            ),
            card("σ₁", number(p.sigma.max), "largest singular value", Light::Neutral),
            card("σ_N−1", number(p.sigma.second), "the least of what motion shows", Light::Neutral),
            card("σ_N", number(p.sigma.min), "zero for an exact model: scale is left to the body mass", Light::Neutral),
            card(
                "Base parameters",
                p.base.len().to_string(),
                format!("{} well, {} partly seen, {rest}", of("well"), of("partly")),
                Light::Neutral,
            ),
        ],
    }];
    let light = if p.gate.passed { Light::Fair } else { Light::Poor };
    blocks.extend(reservation.map(|words| Block::remark(Light::Poor, format!("The held-out error is poor: {words}."))));
    blocks.extend(p.gate.reasons.iter().map(|r| Block::remark(light, r.clone())));
    blocks.push(Block::text(format!(
        "Estimator: {}; weight of the tables {}; {} stretches of {} recordings. Intervals: {}.",
        p.estimator.name().replace('_', " "),
        number(p.prior_weight),
        p.n_stretches,
        p.n_trials,
        p.se_from
    )));
    if !p.effects.is_empty() {
        let value = |e: &EffectEstimate| match &e.not_determined {
            Some(why) => format!("not determined: {why}"),
            None => plus_minus(e.value, e.ci95),
        };
        let rows = p.effects.iter().map(|e| vec![e.name.clone(), value(e)]).collect();
        let table = Table::new(
            "Effects in the model",
            "Fitted together with the mass parameters; 95 % intervals.",
            &["coefficient", "value"],
            rows,
        );
        blocks.push(table.into());
    }
    Section::new(
        "trust",
        "Reliability of the parameters",
        "Motion in flight determines combinations of mass, first moment and inertia. The others are taken from tables and are marked so.",
        blocks,
    )
}

/// Every base parameter.
fn base(p: &Parameters) -> Section {
    let has_prior = p.base.iter().any(|b| b.prior_sd.is_some_and(|s| s > 0.0));
    let mut blocks = Vec::new();
    if has_prior {
        // the change from the prior in prior standard deviations, so that kg, kg·m and kg·m² share
        // one axis
        let mut chosen: Vec<&BaseEstimate> =
            p.base.iter().filter(|b| b.prior.is_some() && b.prior_sd.is_some_and(|s| s > 0.0)).collect();
        let change = |b: &BaseEstimate| (b.value - b.prior.unwrap_or(f64::NAN)) / b.prior_sd.unwrap_or(f64::NAN);
        chosen.sort_by(|a, b| change(b).abs().total_cmp(&change(a).abs()));
        chosen.truncate(20);
        let names: Vec<String> = chosen.iter().map(|b| b.name.clone()).collect();
        let values: Vec<f64> = chosen.iter().map(|b| change(b)).collect();
        let half_sd = |b: &BaseEstimate| half_of(b.ci95).unwrap_or(f64::NAN) / b.prior_sd.unwrap_or(f64::NAN);
        let half: Vec<f64> = chosen.iter().map(|b| half_sd(b)).collect();
        let words = Words::new(
            "What the motion changed most",
            "The twenty base parameters that moved farthest from the tables, in standard deviations of the tables, with 95 % intervals. An \
             interval that excludes zero is news about this body.",
        );
        let kinds = [Dots::with_half("", values, &half)];
        let line = aloft_page::Line { at: 0.0, upright: true, label: "tables".into() };
        blocks.push(Figure::dots(words, "change, standard deviations of the tables", &names, &kinds, &[line]).into());
    }
    let rows = p
        .base
        .iter()
        .map(|b| {
            vec![
                b.name.clone(),
                number(b.value),
                maybe(half_of(b.ci95)),
                b.prior.map_or("–".into(), number),
                b.unit.clone(),
                b.determined_by().to_owned(),
                b.formula.clone(),
            ]
        })
        .collect();
    let table = Table::new(
        &format!("All {} base parameters", p.base.len()),
        "With 95 % intervals, how well the motion determines each, and the regrouping formula.",
        &["parameter", "value", "± 95 %", "tables", "unit", "seen", "regrouping"],
        rows,
    );
    blocks.push(if p.base.len() > 24 {
        Block::Folded { title: format!("All {} base parameters", p.base.len()), blocks: vec![table.into()] }
    } else {
        table.into()
    });
    Section::new("base-parameters", "Base parameters", "", blocks)
}

/// The links as a table.
pub fn link_table(p: &Parameters) -> Table {
    let rows = p
        .links
        .iter()
        .map(|l| {
            vec![
                l.name.clone(),
                plus_minus(l.mass_kg, l.ci95.mass_kg),
                number(l.prior.mass_kg),
                three(&l.com_m),
                three(&l.prior.com_m.into()),
                three(&[l.inertia_kgm2[0][0], l.inertia_kgm2[1][1], l.inertia_kgm2[2][2]]),
                l.words.clone(),
            ]
        })
        .collect();
    Table::new(
        "Physically consistent links",
        "One set of links among those that agree with the base parameters: positive masses, inertias that a body can have, nearest to the tables. \
         Inertia about the centre of mass, link axes.",
        &[
            "link",
            "mass, kg",
            "tables, kg",
            "centre of mass x y z, m",
            "tables x y z, m",
            "Ixx Iyy Izz, kg·m²",
            "in words",
        ],
        rows,
    )
}

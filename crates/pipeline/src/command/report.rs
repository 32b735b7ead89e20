//! `report`: the page that tells the story of a study to someone who was not there.

use crate::artifact::{load_motion, load_trial};
use crate::command::compare::{ComparisonView, compare, errors_of, judged_on, mean};
use crate::command::effect::{HistoryRow, history};
use crate::command::parameters::{ParametersView, parameters};
use crate::error::PipelineError;
use crate::runner::stage_index;
use crate::stages::STAGES;
use crate::study::Study;
use crate::table::Table as NumberTable;
use crate::workspace::{WHOLE_STUDY, Workspace, read_json};
use aloft_body::{State, Subject};
use aloft_discover::{Discovery, Verdict};
use aloft_report::{Animation, Block, Card, Figure, HeatMap, Light, Page, Section, Series, Shade, Table, render};
use std::path::{Path, PathBuf};

/// Builds the page and writes it; returns where.
pub fn write(study: &Study, out: Option<&Path>) -> Result<PathBuf, PipelineError> {
    let html = render(&page(study)?).map_err(|e| PipelineError::request(e.to_string()))?;
    let path = out.map_or_else(|| study.workspace.join("report.html"), Path::to_path_buf);
    std::fs::write(&path, html).map_err(PipelineError::io("write", &path))?;
    Ok(path)
}

fn page(study: &Study) -> Result<Page, PipelineError> {
    let ws = Workspace::open(&study.workspace);
    let comparison = compare(study)?;
    let found = parameters(study, None)?;
    let mut sections = vec![overview(&comparison, &found)];
    sections.push(recordings(study, &ws, &comparison));
    sections.push(wrench(study, &ws, &comparison)?);
    sections.push(where_it_fails(&comparison));
    sections.extend(missing(study));
    sections.extend(ladder(study)?);
    sections.push(identified(&found));
    sections.extend(kinematics(study, &ws)?);
    sections.push(methods(study, &found));
    Ok(Page {
        title: format!("{}: mass properties from flight", study.facts.person.name),
        subtitle: format!(
            "{} · {} recordings · {} flights · body mass {} kg",
            study.config.name,
            study.included().count(),
            comparison.parameters.flights,
            study.facts.person.mass_kg
        ),
        sections,
        footer: vec![format!(
            "aloft {} · pipeline {} · facts from {}",
            env!("CARGO_PKG_VERSION"),
            study.config.name,
            if study.facts.sources.is_empty() { "the pipeline".to_owned() } else { study.facts.sources.join(" and ") }
        )],
    })
}

fn number(x: f64) -> String {
    if !x.is_finite() {
        return "–".to_owned();
    }
    let a = x.abs();
    if a >= 100.0 {
        format!("{x:.0}")
    } else if a >= 10.0 {
        format!("{x:.1}")
    } else if a >= 0.1 {
        format!("{x:.2}")
    } else if a >= 0.001 {
        format!("{x:.4}")
    } else if a == 0.0 {
        "0".to_owned()
    } else {
        format!("{x:.2e}")
    }
}

fn three(v: &[f64; 3]) -> String {
    v.iter().map(|x| number(*x)).collect::<Vec<_>>().join("  ")
}

fn card(label: &str, value: String, note: String, light: Light) -> Card {
    Card { label: label.to_owned(), value, note, light }
}

fn overview(view: &ComparisonView, found: &ParametersView) -> Section {
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

fn model_table(view: &ComparisonView) -> Table {
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

fn recordings(study: &Study, ws: &Workspace, view: &ComparisonView) -> Section {
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

fn shades(time: &[f64], in_flight: &[f64]) -> Vec<Shade> {
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

fn wrench(study: &Study, ws: &Workspace, view: &ComparisonView) -> Result<Section, PipelineError> {
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

fn where_it_fails(view: &ComparisonView) -> Section {
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

/// What the last `discover` said, where there was one.
fn missing(study: &Study) -> Option<Section> {
    let d: Discovery = read_json(&study.workspace.join("discovery.json")).ok()?;
    let light = match d.verdict {
        Verdict::NothingMissing => Light::Good,
        Verdict::Supported | Verdict::OneOf => Light::Fair,
        Verdict::NotDetectable => Light::Neutral,
    };
    let ranked: Vec<_> = d.candidates.iter().filter(|c| !c.placebo).take(12).collect();
    let names: Vec<String> = ranked.iter().map(|c| c.key.clone()).collect();
    let ratios = ranked.iter().map(|c| c.held_out_ratio).collect();
    let halves = ranked.iter().map(|c| (c.ci95[1] - c.ci95[0]) / 2.0).collect();
    let mut blocks = vec![
        Block::Remark { text: d.words.clone(), light },
        Block::Cards {
            cards: vec![
                card(
                    "Held-out error before",
                    format!("{} N", number(d.held_out_error)),
                    format!("{:.2} % of body weight", 100.0 * d.held_out_error_of_weight),
                    Light::Neutral,
                ),
                card(
                    "With the effects found",
                    format!("{} N", number(d.held_out_error_after)),
                    String::new(),
                    Light::Neutral,
                ),
                card(
                    "Noise of the markers alone",
                    format!("{} N", number(d.noise_floor)),
                    "what no model can remove".into(),
                    Light::Neutral,
                ),
            ],
        },
        Block::Figure {
            figure: Figure::bars(
                "Held-out error with each effect over that without (95 % interval); 1 means that it explains nothing",
                "ratio",
                &names,
                &[("held-out ratio".to_owned(), ratios, halves)],
            ),
        },
    ];
    let rows = ranked
        .iter()
        .map(|c| {
            let first = c.coefficients.first();
            let like: Vec<&str> =
                c.confused_with.iter().filter(|x| x.p_value > 0.05).map(|x| x.effect.as_str()).collect();
            vec![
                c.key.clone(),
                format!("{:.3} ({:.2} to {:.2})", c.held_out_ratio, c.ci95[0], c.ci95[1]),
                first.map_or("–".into(), |e| {
                    format!("{} {} ± {} {}", e.name, number(e.value), number(1.96 * e.se), e.unit)
                }),
                number(c.minimum_detectable),
                if like.is_empty() { "–".into() } else { like.join(", ") },
                if c.believed { "yes".into() } else { "no".into() },
            ]
        })
        .collect();
    blocks.push(Block::Table {
        table: Table {
            caption: "Candidates: physics and measurement artefacts in one ranking".into(),
            header: [
                "effect",
                "held-out ratio",
                "coefficient",
                "smallest that would be seen",
                "cannot be told from",
                "believed",
            ]
            .map(str::to_owned)
            .to_vec(),
            rows,
        },
    });
    blocks.extend(d.advice.iter().map(|a| Block::Text { text: format!("Next recording: {a}") }));
    Some(Section {
        id: "missing".into(),
        title: "What is missing".into(),
        lead: "Every effect was refitted together with the inertial parameters and judged on flights or trials that took no part.".into(),
        blocks,
    })
}

/// The revisions of the model, where there is more than one.
fn ladder(study: &Study) -> Result<Option<Section>, PipelineError> {
    let h = history(study)?;
    if h.revisions.len() < 2 {
        return Ok(None);
    }
    let x: Vec<f64> = h.revisions.iter().map(|r| r.revision as f64).collect();
    let of = |get: &dyn Fn(&HistoryRow) -> Option<f64>| {
        h.revisions.iter().map(|r| get(r).unwrap_or(f64::NAN)).collect::<Vec<f64>>()
    };
    let mut error = Series::line("held-out error", x.clone(), of(&|r| r.held_out_error));
    error.mode = "lines+markers";
    let floor = Series::line("noise alone", x, of(&|r| r.noise_floor)).dashed();
    let rows = h
        .revisions
        .iter()
        .map(|r| {
            vec![
                format!("{} ({})", r.revision, r.action),
                if r.effects.is_empty() { "none".into() } else { r.effects.join(", ") },
                r.held_out_error.map_or("–".into(), number),
                r.noise_floor.map_or("–".into(), number),
                r.coefficients
                    .iter()
                    .map(|c| format!("{} {} ± {}", c.name, number(c.value), number(1.96 * c.se)))
                    .collect::<Vec<_>>()
                    .join("; "),
                r.void.clone().unwrap_or_default(),
            ]
        })
        .collect();
    Ok(Some(Section {
        id: "ladder".into(),
        title: "The ladder".into(),
        lead: "Each revision of the model and the error that it left on held-out motion.".into(),
        blocks: vec![
            Block::Figure {
                figure: Figure::lines(
                    "Held-out error (weak windows) of each model revision",
                    "revision",
                    "N",
                    vec![error, floor],
                ),
            },
            Block::Table {
                table: Table {
                    caption: "Revisions".into(),
                    header: ["revision", "effects", "held-out error, N", "noise, N", "coefficients", "remark"]
                        .map(str::to_owned)
                        .to_vec(),
                    rows,
                },
            },
        ],
    }))
}

fn identified(found: &ParametersView) -> Section {
    let p = &found.parameters;
    let rows = p
        .base
        .iter()
        .map(|b| {
            vec![
                b.name.clone(),
                number(b.value),
                number(1.96 * b.se),
                b.prior.map_or("–".into(), number),
                b.unit.clone(),
                format!("{:?}", b.seen).to_lowercase(),
                b.formula.clone(),
            ]
        })
        .collect();
    let mut blocks = vec![Block::Text {
        text: format!(
            "Singular values: σ₁ {}, σ_N−1 {}, σ_N {}. Estimator: {}; intervals: {}.",
            number(p.sigma.max),
            number(p.sigma.second),
            number(p.sigma.min),
            p.estimator.name(),
            p.se_from
        ),
    }];
    for e in &p.effects {
        blocks.push(Block::Text { text: format!("Effect {}: {} ± {}", e.name, number(e.value), number(1.96 * e.se)) });
    }
    if !p.links.is_empty() {
        let names: Vec<String> = p.links.iter().map(|l| l.name.clone()).collect();
        let masses = p.links.iter().map(|l| l.mass_kg).collect();
        let spread = p.links.iter().map(|l| 1.96 * l.sd.mass_kg).collect();
        let prior = p.links.iter().map(|l| l.prior.mass_kg).collect();
        blocks.push(Block::Figure {
            figure: Figure::bars(
                "Mass of each link: identified (95 % interval) and prior",
                "kg",
                &names,
                &[("identified".to_owned(), masses, spread), ("prior".to_owned(), prior, vec![f64::NAN; names.len()])],
            ),
        });
        blocks.push(Block::Table {
            table: Table {
                caption: "Physically consistent links".into(),
                header: ["link", "mass, kg", "prior, kg", "centre of mass, m", "prior, m", "in words"]
                    .map(str::to_owned)
                    .to_vec(),
                rows: p
                    .links
                    .iter()
                    .map(|l| {
                        vec![
                            l.name.clone(),
                            number(l.mass_kg),
                            number(l.prior.mass_kg),
                            three(&l.com_m),
                            three(&l.prior.com_m.into()),
                            l.words.clone(),
                        ]
                    })
                    .collect(),
            },
        });
    }
    blocks.push(Block::Table {
        table: Table {
            caption: "Base parameters with the regrouping".into(),
            header: ["parameter", "value", "± 95 %", "prior", "unit", "seen", "regrouping"].map(str::to_owned).to_vec(),
            rows,
        },
    });
    Section {
        id: "parameters".into(),
        title: "Identified parameters".into(),
        lead: "The combinations of mass, first moment and inertia that motion in the air can tell, and links that agree with them.".into(),
        blocks,
    }
}

fn kinematics(study: &Study, ws: &Workspace) -> Result<Vec<Section>, PipelineError> {
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

/// About four seconds of the liveliest trial: around its first flight where there is one.
fn skeleton(study: &Study, ws: &Workspace) -> Result<Option<Figure>, PipelineError> {
    let subject: Subject = read_json(&ws.place("calibrate", WHOLE_STUDY).join("subject.json"))?;
    let model = &subject.model;
    let candidates =
        study.included().filter(|t| t.role.is_dynamic() && ws.manifest("ik", &t.name).is_some_and(|m| m.is_ok()));
    let mut best: Option<(&str, usize)> = None;
    for t in candidates {
        let first = read_json::<aloft_flight::FlightReport>(&ws.place("flight", &t.name).join("flights.json"))
            .ok()
            .and_then(|r| r.flights.first().map(|f| f.start));
        if let Some(start) = first {
            best = Some((t.name.as_str(), start));
            break;
        }
        best = best.or(Some((t.name.as_str(), 0)));
    }
    let Some((name, start)) = best else { return Ok(None) };
    let motion = load_motion(&ws.place("ik", name))?;
    let trial = load_trial(&ws.place("import", name))?;
    let rate = motion.rate_hz;
    let from = start.saturating_sub((0.8 * rate) as usize);
    let to = (from + (2.4 * rate) as usize).min(motion.n_frames());
    let step = ((rate / 30.0).round() as usize).max(1);
    let mut a = Animation {
        times_s: Vec::new(),
        bones: bones(&subject),
        joints: Vec::new(),
        measured: Vec::new(),
        modelled: Vec::new(),
        forces: Vec::new(),
    };
    let mut state = State::new(model);
    for f in (from..to).step_by(step).filter(|f| motion.is_valid(*f)) {
        state.forward_position(model, motion.q(f));
        a.times_s.push(f as f64 / rate);
        let mut joints: Vec<[f64; 3]> = state.world_from_link.iter().map(|w| w.translation.vector.into()).collect();
        joints.extend(tips(&subject).iter().map(|(link, tip)| <[f64; 3]>::from(state.point_in_world(*link, tip))));
        a.joints.push(joints);
        a.modelled.push(subject.markers.iter().map(|m| state.point_in_world(m.link, &m.position_m).into()).collect());
        a.measured.push(
            subject
                .markers
                .iter()
                .map(|m| {
                    trial
                        .markers
                        .index(&m.label)
                        .and_then(|i| trial.markers.position(i, f))
                        .map_or([f64::NAN; 3], |p| p.into())
                })
                .collect(),
        );
        a.forces.push(
            trial
                .plates
                .iter()
                .filter_map(|p| {
                    let i = (f as f64 / rate * p.rate_hz).round() as usize;
                    let (force, moment) = (p.force_n.get(i)?, p.moment_nm.get(i)?);
                    // centre of pressure on the floor, z = 0; below 20 N there is none
                    (force.z > 20.0).then(|| {
                        let at = [-moment.y / force.z, moment.x / force.z, 0.0];
                        [at, [at[0] + force.x / 1000.0, at[1] + force.y / 1000.0, force.z / 1000.0]]
                    })
                })
                .collect(),
        );
    }
    Ok((!a.times_s.is_empty()).then(|| {
        Figure::animation(
            &format!("{name}: model, markers and plate forces (1 m for 1000 N); drag to turn, Play to run"),
            &a,
        )
    }))
}

/// Ends of links that carry no other link: the mean of their markers.
fn tips(subject: &Subject) -> Vec<(usize, nalgebra::Vector3<f64>)> {
    (0..subject.model.n_links())
        .filter(|i| !subject.model.links.iter().any(|l| l.parent == Some(*i)))
        .filter_map(|i| {
            let own: Vec<_> = subject.markers.iter().filter(|m| m.link == i).map(|m| m.position_m).collect();
            let far = own.into_iter().max_by(|a, b| a.norm().total_cmp(&b.norm()))?;
            Some((i, far))
        })
        .collect()
}

fn bones(subject: &Subject) -> Vec<(usize, usize)> {
    let n = subject.model.n_links();
    let mut out: Vec<(usize, usize)> =
        subject.model.links.iter().enumerate().filter_map(|(i, l)| l.parent.map(|p| (p, i))).collect();
    out.extend(tips(subject).iter().enumerate().map(|(k, (link, _))| (*link, n + k)));
    out
}

fn methods(study: &Study, found: &ParametersView) -> Section {
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

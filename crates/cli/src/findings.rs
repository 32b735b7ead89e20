//! Output of `discover` and `effect` as tables and text.

use crate::args::PipelineArgs;
use crate::errors::{figure, judgement};
use crate::next;
use crate::render::{beside, command, half, out, significant, unit};
use crate::screen::{Cell, cut, labelled, table};
use crate::stop::Stop;

use aloft_analysis::discover::DiscoveryView;
use aloft_analysis::effect::EffectLine;
use aloft_analysis::next_step::{self, Because, NextStep};
use aloft_analysis::verdict;
use aloft_compare::Signal;
use aloft_discover::{Candidate, Discovery, Estimate, JointDiscovery, JointFinding, SelfTest, Verdict};
use aloft_effects::{ActsIn, EffectKind};
use aloft_study::subject_session::SubjectSession;

/// Candidates shown without `--details`.
const SHORT: usize = 6;

/// The catalogue of effects, by family.
pub fn effects(list: &[EffectLine]) -> Result<(), Stop> {
    for (family, title) in [
        ("forces", "Forces, masses and gravity"),
        ("kinematics", "Errors of cameras, markers and skeleton"),
        ("plates", "Errors of force plates and of the weight"),
        ("joints", "Friction and drives of a robot's joints"),
        ("own", "Written as formulas"),
    ] {
        let of: Vec<&EffectLine> = list.iter().filter(|e| e.family == family).collect();
        if of.is_empty() {
            continue;
        }
        out(title)?;
        let own = family == "own";
        let mut t = if own {
            table(&["  effect", "what", "acts in", "from"]).left(&[2, 3]).wrapped(1)
        } else {
            table(&["  effect", "what", "acts in"]).left(&[2]).wrapped(1)
        };
        for e in of {
            let kind = if e.kind == EffectKind::Artefact && own { " (artefact)" } else { "" };
            let mut cells = vec![format!("  {}", e.id), format!("{}{kind}", e.title), acts(e.acts).to_owned()];
            if own {
                cells.push(e.from.clone());
            }
            t.add_row(cells);
        }
        out(format!("{t}\n"))?;
    }
    out(labelled(
        "",
        "`aloft effect show NAME` explains one; `aloft discover P.yaml` ranks them all on your recordings.",
    ))
}

fn acts(acts: ActsIn) -> &'static str {
    match acts {
        ActsIn::Flight => "flight",
        ActsIn::Contact => "contact",
        ActsIn::Both => "both",
        ActsIn::Joints => "joints",
    }
}

fn names(list: &[String]) -> String {
    list.join(", ")
}

/// The discovery as text.
pub fn discovery(view: &DiscoveryView, details: bool) -> Result<(), Stop> {
    let d = &view.discovery;
    out(labelled("verdict: ", &verdict::sentence(d)))?;
    if let Some(words) = &view.discovery.to_correct {
        out(labelled("first: ", &crate::screen::paint(words, Signal::Poor)))?;
    }
    errors(view)?;
    if let Some(words) = verdict::how_sure(d) {
        out(labelled("sure: ", &words))?;
    }
    let said = view.discovery.to_correct.as_ref().is_some_and(|words| d.words.contains(words));
    if !said && (d.found.is_empty() || d.verdict == Verdict::Unexplained) {
        out(labelled("", &d.words))?;
    }
    if let Some(words) = verdict::not_excluded(d) {
        out(labelled("not excluded: ", &words))?;
    }
    for found in &d.found {
        let estimates: Vec<&Estimate> = found.coefficients.iter().chain(&found.nonlinear).collect();
        let mut t = table(&[found.key.as_str(), "value", "± 95 %", "unit"]).left(&[3]);
        for c in estimates {
            let half = if c.at_bound { "at its bound".to_owned() } else { half(c.ci95) };
            t.add_row([format!("  {}", c.name), beside(c.value, c.ci95), half, unit(&c.unit)]);
        }
        out(t)?;
        if !found.trials.is_empty() {
            out(labelled("  acts in ", &names(&found.trials)))?;
        }
        if found.sized_with_contact {
            out(labelled("  sizes from ", "flights and contact together"))?;
        }
        if let Some(words) = found.other_links() {
            out(labelled("  link not certain: ", &words))?;
        }
    }
    if let Some(j) = &d.joints {
        joints(j, details)?;
    }
    out("")?;
    candidates(view, details)?;
    if let Some(open) = &d.open {
        crate::laws::laws(open)?;
    }
    if let Some(words) = no_better(d) {
        out(labelled("not named: ", &words))?;
    }
    for w in &d.warnings {
        out(labelled("left out: ", w))?;
    }
    for n in &d.not_tried {
        out(labelled("left out: ", &n.to_string()))?;
    }
    if details {
        rounds(d)?;
    }
    for a in d.advice.iter().filter(|a| view.discovery.to_correct.as_ref() != Some(a)) {
        out(labelled("advice: ", a))?;
    }
    Ok(())
}

/// What the torques of a robot's joints leave, the joints farthest above their floor first.
fn joints(j: &JointDiscovery, details: bool) -> Result<(), Stop> {
    out("")?;
    out(labelled("torques: ", &j.words))?;
    if !j.judged {
        return Ok(());
    }
    let mut all: Vec<&JointFinding> = j.joints.iter().collect();
    let ratio = |j: &JointFinding| if j.times_floor().is_finite() { j.times_floor() } else { 0.0 };
    all.sort_by(|a, b| ratio(b).total_cmp(&ratio(a)));
    let mut t =
        table(&["joint", "error", "with found", "floor", "unit", "times floor", "verdict", "best law", "left %"])
            .left(&[4, 6, 7])
            .optional(&[8, 7]);
    let shown = if details { all.len() } else { SHORT };
    for (i, f) in all.iter().enumerate() {
        if i >= shown && matches!(f.verdict, Verdict::NothingMissing | Verdict::NotDetectable) {
            continue;
        }
        let best = f.candidates.first();
        let keys: Vec<&str> =
            j.found.iter().filter(|k| k.key.ends_with(&format!("[{}]", f.joint))).map(|k| k.effect.as_str()).collect();
        t.add_row([
            f.joint.clone(),
            figure(Some(f.held_out_error).filter(|e| e.is_finite())),
            if keys.is_empty() { "–".to_owned() } else { figure(Some(f.held_out_error_after)) },
            figure(Some(f.noise_floor).filter(|e| e.is_finite())),
            f.unit.clone(),
            if f.times_floor().is_finite() { significant(f.times_floor(), 2) } else { "–".to_owned() },
            word(f.verdict).to_owned(),
            best.map_or("–".to_owned(), |c| c.effect.clone()),
            best.map_or("–".to_owned(), |c| format!("{:.0}", 100.0 * c.held_out_ratio)),
        ]);
    }
    out(t)?;
    let more = all.len().saturating_sub(shown);
    if more > 0 {
        out(format!("… and {more} more: --details"))?;
    }
    for found in &j.found {
        let estimates: Vec<&Estimate> = found.coefficients.iter().chain(&found.nonlinear).collect();
        let mut t = table(&[found.key.as_str(), "value", "± 95 %", "unit"]).left(&[3]);
        for c in estimates {
            let half = if c.at_bound { "at its bound".to_owned() } else { half(c.ci95) };
            t.add_row([format!("  {}", c.name), beside(c.value, c.ci95), half, unit(&c.unit)]);
        }
        out(t)?;
    }
    Ok(())
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Supported => "supported",
        Verdict::OneOf => "one of several",
        Verdict::NothingMissing => "nothing missing",
        Verdict::Unexplained => "unexplained",
        Verdict::NotDetectable => "–",
    }
}

/// The next step, and every further effect or law that the answer names.
pub fn next(view: &DiscoveryView, session: &SubjectSession, current: bool, at: &PipelineArgs) -> Result<(), Stop> {
    let d = &view.discovery;
    let step = next_step::next_step_of(session, current)?;
    // its advice stands above
    command("next", &next::command_for(&step, &session.id, at));
    if let NextStep::Add { key, because } = &step {
        let laws = d.open.iter().flat_map(|o| &o.laws).map(|l| &l.id);
        let in_joints = d.joints.iter().flat_map(|j| &j.found);
        let all: Vec<&String> = if *because == Because::Law {
            laws.collect()
        } else {
            d.found.iter().chain(in_joints).map(|f| &f.key).collect()
        };
        for other in all.into_iter().filter(|k| *k != key) {
            command("then", &next::add(other, &session.id, at));
        }
        if *because == Because::OneOf {
            for other in as_likely(d, key) {
                command("or", &next::add(other, &session.id, at));
            }
        }
    }
    Ok(())
}

/// Keys of the effects that the recordings cannot tell from the one that is proposed, those that
/// leave less of the error first.
fn as_likely<'d>(d: &'d Discovery, key: &str) -> Vec<&'d String> {
    let id = key.split('[').next().unwrap_or(key);
    let class = d.groups.iter().find(|g| g.effects.iter().any(|e| e == id));
    let is_found = |id: &str| d.found.iter().any(|f| f.effect == id);
    let others = class.into_iter().flat_map(|g| &g.effects).filter(|e| *e != id && !is_found(e));
    let mut all: Vec<&Candidate> = others.filter_map(|id| d.candidates.iter().find(|c| c.effect == *id)).collect();
    all.sort_by(|a, b| a.held_out_ratio.total_cmp(&b.held_out_ratio));
    all.into_iter().map(|c| &c.key).collect()
}

/// The error of the model now, and with the effects found.
fn errors(view: &DiscoveryView) -> Result<(), Stop> {
    let d = &view.discovery;
    if view.errors.is_empty() {
        return out(labelled(
            "",
            &format!(
                "held-out error {} N ({} % of body weight); noise floor {}",
                significant(d.held_out_error, 3),
                significant(100.0 * d.held_out_error_of_weight, 2),
                aloft_compare::floor_in_words(d.noise_floor, d.noise_floor_ci95)
            ),
        ));
    }
    let laws = d.open.iter().flat_map(|o| &o.laws);
    let with = names(&d.found.iter().map(|f| f.key.clone()).chain(laws.map(|l| l.id.clone())).collect::<Vec<_>>());
    let header =
        ["held out", "model", "error N", "force N", "moment N·m", "floor N", "floor 95 %", "times floor", "judged"];
    let mut t = table(&header).left(&[1]).wrapped(8).optional(&[6, 3, 4]);
    for e in &view.errors {
        let after = view.errors_after.iter().find(|a| a.judged_on == e.judged_on);
        for (model, e) in [("now", Some(e)), (&cut(&format!("+ {with}"), 24), after)] {
            let Some(e) = e else { continue };
            let interval = e
                .noise_floor_ci95
                .map_or("–".to_owned(), |[a, b]| format!("{} to {}", significant(a, 3), significant(b, 3)));
            t.add_row([
                Cell::from(format!("in {}", e.judged_on)),
                model.into(),
                figure(Some(e.held_out_error)).into(),
                figure(e.held_out_force_n).into(),
                figure(e.held_out_moment_nm).into(),
                figure(e.noise_floor).into(),
                interval.into(),
                e.times_floor.map_or("–".to_owned(), |t| significant(t, 2)).into(),
                judgement(e),
            ]);
        }
    }
    out(t)?;
    if view.errors_after.is_empty() && !d.found.is_empty() {
        out(labelled("", &format!("with {with} about {} N are expected", significant(d.held_out_error_after, 3))))?;
    }
    Ok(())
}

/// Generalisations of what is named that fit no better: a rotor that contains the flywheel.
fn no_better(d: &Discovery) -> Option<String> {
    let named = |id: &str| d.effects.iter().any(|e| e == id);
    let ratio = |id: &str| d.candidates.iter().find(|c| c.effect == id).map(|c| c.held_out_ratio);
    let wider: Vec<(&str, &str)> = d
        .candidates
        .iter()
        .filter(|c| c.believed && !named(&c.effect))
        .filter_map(|c| {
            // none: a law of the user's own contains no other
            let contains = aloft_effects::effect(&c.effect).ok()?.about().contains;
            let of = contains.iter().find(|id| named(id))?;
            (c.held_out_ratio > 0.9 * ratio(of)?).then_some((c.effect.as_str(), *of))
        })
        .collect();
    let of = wider.first()?.1;
    let names: Vec<&str> = wider.iter().map(|w| w.0).collect();
    let (verb, fit) = if names.len() > 1 { ("contain", "fit") } else { ("contains", "fits") };
    Some(format!("{}: {verb} {of} as a special case and {fit} no better", names.join(", ")))
}

/// The kind of motion whose candidates come first: where the named effect was judged, else where
/// the model stands farthest above its floor.
fn first_place(view: &DiscoveryView) -> String {
    let d = &view.discovery;
    let named = d.found.first().and_then(|f| d.candidates.iter().find(|c| c.effect == f.effect));
    let tried = |place: &str| d.candidates.iter().any(|c| c.judged_on == place);
    let above = view.errors.iter().filter(|e| e.at_floor != Some(true) && tried(&e.judged_on));
    let worst = above.max_by(|a, b| a.times_floor.unwrap_or(0.0).total_cmp(&b.times_floor.unwrap_or(0.0)));
    let rounds = d.rounds.first().map(|r| &r.judged_on);
    named.map(|c| &c.judged_on).or(worst.map(|e| &e.judged_on)).or(rounds).cloned().unwrap_or_default()
}

/// The best candidates of the ranking; with `details` all of them, with what decided on each.
fn candidates(view: &DiscoveryView, details: bool) -> Result<(), Stop> {
    let d = &view.discovery;
    let mut all: Vec<&Candidate> = d.candidates.iter().collect();
    // shares of different errors do not stand in one order
    let place = first_place(view);
    all.sort_by_key(|c| c.judged_on != place);
    // the column `in` only where there is something to tell apart
    let places = usize::from(all.iter().any(|c| c.judged_on != place));
    let mut header = vec!["candidate"];
    header.extend(["in"].iter().take(places));
    header.extend(["left %", "95 %"]);
    let decided = header.len();
    header.extend(["decided"].iter().take(usize::from(details)));
    header.extend(["coefficient", "± 95 %", "detectable", "unit"]);
    let size = header.len() - 4;
    header.extend(["of"].iter().take(usize::from(details)));
    header.push("probability");
    let left: Vec<usize> = (1..=places).chain(size + 3..header.len() - 1).collect();
    let t = table(&header).left(&left);
    let mut t = if details { t.wrapped(decided) } else { t.optional(&[size + 2, 2 + places]) };
    let shown = if details { all.len() } else { SHORT };
    for c in all.iter().take(shown) {
        let first = verdict::shown_coefficient(c);
        let mut row = vec![c.key.clone()];
        row.extend((places > 0).then(|| c.judged_on.clone()));
        row.extend([
            format!("{:.0}", 100.0 * c.held_out_ratio),
            format!("{:.0} to {:.0}", 100.0 * c.ci95[0], 100.0 * c.ci95[1]),
        ]);
        row.extend(details.then(|| verdict::decided(c, d)));
        row.extend([
            first.map_or("–".into(), |e| if e.at_bound { significant(e.value, 3) } else { beside(e.value, e.ci95) }),
            first.map_or("–".into(), uncertainty),
            significant(c.minimum_detectable, 2),
            first.map_or(String::new(), |e| unit(&e.unit)),
        ]);
        row.extend(details.then(|| first.map_or(String::new(), |e| e.name.clone())));
        row.push(verdict::probability_of(c, d));
        t.add_row(row);
    }
    let left_out = t.left_out().join(", ");
    out(t)?;
    let more = all.len().saturating_sub(shown);
    let missing = [
        (more > 0).then(|| format!("… and {more} more")),
        (!left_out.is_empty()).then(|| format!("columns left out: {left_out}")),
    ];
    let missing: Vec<String> = missing.into_iter().flatten().collect();
    if !missing.is_empty() {
        out(format!("{}: --details", missing.join("; ")))?;
    }
    let of = if places > 0 { "there".to_owned() } else { format!("in {place}") };
    out(labelled(
        "",
        &format!("left %: share of the held-out error {of} that remains with the candidate; {}", verdict::SHOWN),
    ))
}

/// Half of a 95 % interval, or why there is none that says anything.
fn uncertainty(e: &Estimate) -> String {
    const SAYS_NOTHING: f64 = 100.0;
    match e.ci95 {
        _ if e.at_bound => "at bound".to_owned(),
        Some([a, b]) if 0.5 * (b - a) > SAYS_NOTHING * e.value.abs() && e.value != 0.0 => "unknown".to_owned(),
        ci95 => half(ci95),
    }
}

/// How each round was decided.
fn rounds(d: &Discovery) -> Result<(), Stop> {
    out("")?;
    for (i, r) in d.rounds.iter().enumerate() {
        let model = if r.model.is_empty() { "without effects".to_owned() } else { format!("with {}", names(&r.model)) };
        let told = format!("{} flights or trials, model {model}: {}", r.clusters, r.words);
        out(labelled(&format!("question {}: ", i + 1), &told))?;
    }
    Ok(())
}

/// How often injected effects are identified correctly.
pub fn self_test(s: &SelfTest) -> Result<(), Stop> {
    out("effects injected into these recordings, at multiples of the minimum detectable size")?;
    let mut t = table(&["× detectable", "injected", "right name", "right name or class", "wrong name", "missed"]);
    let percent = |x: f64| format!("{:.0} %", 100.0 * x);
    for row in &s.summary {
        t.add_row([
            significant(row.multiple, 2),
            row.injections.to_string(),
            percent(row.hit),
            percent(row.right),
            percent(row.wrong),
            percent((1.0 - row.right - row.wrong).max(0.0)),
        ]);
    }
    out(format!("{t}\n"))?;
    let mut t = table(&["effect", "× detectable", "size", "outcome", "named"]).left(&[3]).wrapped(4);
    for i in &s.injections {
        t.add_row([
            i.key.clone(),
            significant(i.multiple, 2),
            significant(i.size, 3),
            i.outcome.clone(),
            names(&i.named),
        ]);
    }
    out(t)
}

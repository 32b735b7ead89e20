//! Laws that are written while the results are looked at: what they may name, whether they hold
//! together, and keeping them as files of effects.

use crate::effect::Asked;
use aloft_body::JointKind;
use aloft_effects::{EFFECTS, EffectsError, FormulaEffect, quantities};
use aloft_study::effects::OwnEffect;
use aloft_study::ranges;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use serde::Serialize;
use std::path::PathBuf;

/// Functions of one argument.
const FUNCTIONS: [&str; 12] =
    ["sin", "cos", "tan", "asin", "acos", "atan", "tanh", "exp", "ln", "sqrt", "abs", "signum"];

/// What a law may name.
#[derive(Debug, Clone, Serialize)]
pub struct Vocabulary {
    /// Links, with `body` for the centre of mass of the whole body and `all` for every link.
    pub links: Vec<String>,
    /// Quantities with their units.
    pub quantities: Vec<(String, String)>,
    /// Functions of one argument.
    pub functions: Vec<String>,
}

/// What a law of this study may name.
///
/// # Errors
/// The body cannot be read.
pub fn vocabulary(session: &SubjectSession) -> Result<Vocabulary, PipelineError> {
    let scene = Asked::read(session)?.scene(session)?;
    let each = quantities().flat_map(|g| g.each().map(move |name| (name.to_owned(), g.unit.to_owned())));
    let mut quantities: Vec<(String, String)> = each.collect();
    let mut links = vec!["body".to_owned(), "all".to_owned()];
    for link in &scene.model.links {
        links.push(link.name.clone());
        let unit = match link.joint.kind {
            JointKind::Revolute(_) => ["rad", "rad/s"],
            JointKind::Prismatic(_) => ["m", "m/s"],
            _ => continue,
        };
        quantities
            .extend(["q", "qd"].iter().zip(unit).map(|(stem, u)| (format!("{stem}_{}", link.name), u.to_owned())));
    }
    Ok(Vocabulary { links, quantities, functions: FUNCTIONS.map(str::to_owned).to_vec() })
}

/// Why a law cannot be, in one sentence, with the place in its formulas.
#[derive(Debug, Clone, Serialize)]
pub struct LawProblem {
    /// One sentence.
    pub problem: String,
    /// Where: `force[2]`, `coefficients[0].unit` …; empty if it is not one place.
    pub entry: String,
    /// Characters of the formula before the place.
    pub position: Option<usize>,
}

impl LawProblem {
    fn of(entry: &str, problem: impl Into<String>) -> Self {
        Self { problem: problem.into(), entry: entry.to_owned(), position: None }
    }
}

/// `force[2]` as people say it: `force z`.
fn place_in_words(entry: &str) -> String {
    let axis = |k: &str| ["x", "y", "z"].get(k.parse::<usize>().ok()?).copied();
    match entry.strip_suffix(']').and_then(|e| e.split_once('[')) {
        Some((what @ ("force" | "moment"), k)) => format!("{what} {}", axis(k).unwrap_or(k)),
        _ => entry.to_owned(),
    }
}

/// Checks a law: its name, numbers, units and formulas.
///
/// # Errors
/// The first thing that is wrong.
pub fn checked(session: &SubjectSession, law: &FormulaEffect) -> Result<OwnEffect, LawProblem> {
    let word = |c: (usize, char)| c.1 == '_' || c.1.is_ascii_alphabetic() || (c.0 > 0 && c.1.is_ascii_digit());
    if law.id.is_empty() || law.id.len() > 60 || !law.id.chars().enumerate().all(word) {
        return Err(LawProblem::of(
            "id",
            "the name of the law must be letters, digits and `_`, beginning with a letter",
        ));
    }
    if EFFECTS.iter().any(|e| e.is_called(&law.id)) {
        return Err(LawProblem::of("id", format!("`{}` is an effect of the catalogue; choose another name", law.id)));
    }
    if session.own_effects.iter().any(|o| o.spec.id == law.id) {
        return Err(LawProblem::of(
            "id",
            format!("the pipeline has an effect `{}` already; choose another name", law.id),
        ));
    }
    if law.force.is_none() && law.moment.is_none() && law.parts.is_empty() {
        return Err(LawProblem::of("force[0]", "the law has neither a force nor a moment"));
    }
    let other = |e: PipelineError| LawProblem::of("", e.to_string().lines().next().unwrap_or_default());
    let own = OwnEffect::described(law).map_err(other)?;
    let text = OwnEffect::text_of(law).map_err(other)?;
    ranges::parse::<FormulaEffect>("the law", &text).map_err(other)?;
    let scene = Asked::read(session).and_then(|a| a.scene(session)).map_err(other)?;
    match law.compile(&scene) {
        Ok(_) => Ok(own),
        Err(EffectsError::Formula(f)) => Err(LawProblem {
            problem: format!("{}, at `{}`: {}", place_in_words(&f.entry), rest(&f.formula, f.position), f.problem),
            entry: f.entry.clone(),
            position: Some(f.position),
        }),
        Err(EffectsError::Place { place, problem, .. }) => {
            Err(LawProblem { problem: format!("{place}: {problem}"), entry: place, position: None })
        }
        Err(e) => Err(LawProblem::of("", e.to_string())),
    }
}

/// A formula from a place on, shortened.
fn rest(formula: &str, position: usize) -> String {
    let rest: String = formula.chars().skip(position).collect();
    match rest.chars().count() {
        0 => "the end".to_owned(),
        n if n > 16 => rest.chars().take(15).chain(['…']).collect(),
        _ => rest,
    }
}

/// Writes a law as a file in the folder `effects` beside the pipeline.
///
/// # Errors
/// A file of this name exists; the folder cannot be written.
pub fn keep(session: &SubjectSession, law: &OwnEffect) -> Result<PathBuf, PipelineError> {
    let folder = session.effects_folder();
    let path = folder.join(format!("{}.yaml", law.spec.id));
    if path.symlink_metadata().is_ok() {
        return Err(PipelineError::request_hint(
            format!("{} exists already", path.display()),
            "give the law another name, or move the file",
        ));
    }
    aloft_workspace::disk::create_dir_all(&folder)?;
    aloft_workspace::theirs::write_new(&path, OwnEffect::text_of(&law.spec)?.as_bytes())?;
    Ok(path)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use aloft_study::subject_session::Overrides;

    fn session(folder: &std::path::Path) -> SubjectSession {
        let pipeline = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines/demo.yaml");
        let overrides = Overrides { workspace: Some(folder.to_path_buf()), ..Overrides::default() };
        let session = SubjectSession::open(&pipeline, &overrides).unwrap();
        let selection = aloft_pipeline::runner::Selection::default();
        aloft_pipeline::runner::run(&session, &selection, &aloft_pipeline::runner::Silent).unwrap();
        session
    }

    fn law(force: &str, unit: &str) -> FormulaEffect {
        let text = format!(
            "{{id: mine, point: {{link: link1}}, force: [\"0\", \"0\", \"{force}\"], coefficients: [{{name: c, unit: {unit}}}]}}"
        );
        ranges::parse("law", &text).unwrap()
    }

    #[test]
    fn every_quantity_is_one_of_formulas_with_its_unit_and_problems_are_one_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let session = session(folder.path());
        let words = vocabulary(&session).unwrap();
        assert!(words.links.contains(&"link1".to_owned()) && words.quantities.iter().any(|q| q.0 == "qd_link1"));
        for (name, unit) in &words.quantities {
            // a coefficient of another unit must be refused, one of the right unit taken
            let right = match unit.as_str() {
                "1" => "N",
                "m" => "N/m",
                "m/s" => "N*s/m",
                "m/s²" => "N*s^2/m",
                "rad/s" => "N*s",
                "rad/s²" => "N*s^2",
                "s" => "N/s",
                "kg" => "N/kg",
                "kg/m³" => "N*m^3/kg",
                "rad" => "N",
                other => panic!("{name} has the unit {other}"),
            };
            let made = checked(&session, &law(&format!("c * {name}"), right));
            assert!(made.is_ok(), "{name}, {unit}: {:?}", made.err());
            assert!(checked(&session, &law(&format!("c * {name}"), "N*m*kg")).is_err(), "{name}");
        }
        for f in &words.functions {
            assert!(checked(&session, &law(&format!("c * {f}(0.5)"), "N")).is_ok(), "{f}");
        }
        for (force, told) in
            [("c * vx", "`vx`"), ("c * (v_x", "force z"), ("c + 1 m", "force z"), ("c * c * v_x", "force z")]
        {
            let problem = checked(&session, &law(force, "N*s/m")).unwrap_err();
            assert!(problem.problem.contains(told) && !problem.problem.contains('\n'), "{force}: {}", problem.problem);
            assert_eq!(problem.entry, "force[2]");
        }
        let named = |id: &str| FormulaEffect { id: id.to_owned(), ..law("c", "N") };
        for id in ["", "a b", "../x", "quadratic_drag", "1a"] {
            assert_eq!(checked(&session, &named(id)).unwrap_err().entry, "id", "{id}");
        }
    }
}

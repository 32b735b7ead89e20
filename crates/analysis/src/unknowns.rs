//! Unknowns of a catalogue effect: its coefficients and parameters with units and bounds.

use aloft_body::{Model, ModelSpec, Phi};
use aloft_effects::{Effect, ParameterKind, Scene, Target};
use aloft_study::catalog;
use aloft_workspace::error::PipelineError;
use nalgebra::Vector3;
use std::fmt::Write as _;
use std::path::Path;

/// Example bodies on which the unknowns of effects are listed: a person on two plates, and an
/// object of two links.
#[derive(Debug)]
pub struct Examples {
    /// A person of 15 links on two plates.
    pub person: Scene,
    /// Two links with one hinge.
    pub chain: Scene,
    /// The same with an encoder and a named motor on its hinge.
    pub robot: Scene,
}

impl Examples {
    /// From the built-in models.
    ///
    /// # Errors
    /// [`PipelineError`] when a built-in model cannot be read.
    pub fn built_in() -> Result<Self, PipelineError> {
        let mut robot = scene("two_link", 0)?;
        robot.model.encoders = true;
        if let Some(link) = robot.model.links.last() {
            let _ = robot.model.joint_names.insert(link.name.clone(), "joint".to_owned());
        }
        Ok(Self { person: scene("human34", 2)?, chain: scene("two_link", 0)?, robot })
    }
}

/// A body without numbers of its own, on which effects list what they would fit.
fn scene(name: &str, plates: usize) -> Result<Scene, PipelineError> {
    let spec: ModelSpec = catalog::load("models", name, Path::new(""))?;
    let model = Model::from_spec(&spec).map_err(|e| PipelineError::request(e.to_string()))?;
    let mut phi = Phi::zeros();
    phi[0] = 1.0;
    for i in 4..7 {
        phi[i] = 0.01;
    }
    let centres: Vec<Vector3<f64>> = (0..plates).map(|i| Vector3::new(i as f64, 0.0, 0.0)).collect();
    Ok(Scene::new(&model, &vec![phi; model.n_links()], &centres))
}

/// Markdown with one row for each coefficient and parameter, the reason why some have no bound, and
/// how to add the effect.
pub fn table(effect: &dyn Effect, examples: &Examples) -> String {
    let mut out = "## Coefficients\n\n| on | name | unit | bounds | enters |\n|---|---|---|---|---|\n".to_owned();
    let mut seen: Vec<&str> = Vec::new();
    let mut keys: Vec<String> = Vec::new();
    for scene in [&examples.person, &examples.chain, &examples.robot] {
        let targets = effect.targets(scene);
        for target in &targets {
            let words = on(*target);
            if seen.contains(&words) {
                continue;
            }
            seen.push(words);
            let label = target.label(scene);
            keys.push(if label.is_empty() { effect.id().to_owned() } else { format!("{}[{label}]", effect.id()) });
            let mut row = |name: &str, of: &str, bounds: &str, enters: &str| {
                let _ = writeln!(out, "| {words} | `{name}` | {} | {bounds} | {enters} |", unit(of));
            };
            for c in effect.coefficients(scene, *target) {
                row(&c.name, &c.unit, &bounds(c.lower, c.upper), "linearly");
            }
            for p in effect.nonlinear(scene, *target) {
                // a point on a link is bounded about a position on this example's link
                let about = if matches!(p.kind, ParameterKind::PointOnLink(_)) { " (example)" } else { "" };
                row(&p.name, &p.unit, &format!("{}{about}", bounds(p.lower, p.upper)), "nonlinearly");
            }
        }
    }
    if !effect.about().unbounded.is_empty() {
        let _ = write!(out, "\nWhere a bound is missing: {}.\n", effect.about().unbounded);
    }
    let keys: Vec<String> = keys.iter().map(|k| format!("`aloft effect add P.yaml '{k}'`")).collect();
    let _ = write!(out, "\nAdd it: {}.\n", keys.join(", or "));
    out
}

fn on(target: Target) -> &'static str {
    match target {
        Target::Body => "the whole body, or all plates",
        Target::EveryLink => "one coefficient a link",
        Target::Shape => "the shape of every link",
        Target::Link(_) => "one link",
        Target::Plate(_) => "one plate",
        Target::Joint(_) => "one joint",
    }
}

fn bounds(low: f64, high: f64) -> String {
    match (low.is_finite(), high.is_finite()) {
        (false, false) => "any".to_owned(),
        (true, false) => format!("≥ {}", digits(low)),
        (false, true) => format!("≤ {}", digits(high)),
        (true, true) => format!("{} to {}", digits(low), digits(high)),
    }
}

/// A unit in readable form.
pub fn unit(text: &str) -> String {
    text.replace('*', "·").replace("^2", "²").replace("^3", "³")
}

fn digits(x: f64) -> String {
    let rounded = (x * 1e6).round() / 1e6;
    format!("{rounded}")
}

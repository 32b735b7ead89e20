//! What an effect is: names, coefficients, bounds, and the law that gives its columns.

use crate::{Columns, EffectFrame, Scene, Series};
use aloft_body::Phi;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Whether nature or the measurement makes the effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EffectKind {
    /// A force that acted.
    Physics,
    /// A fault of the measurement or of its processing.
    Artefact,
}

/// Where an effect acts, and so on which windows it is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActsIn {
    /// In the air only.
    Flight,
    /// On the plates only.
    Contact,
    /// Always.
    Both,
}

impl ActsIn {
    /// True when the effect is seen in flights.
    pub fn in_flight(self) -> bool {
        self != Self::Contact
    }
    /// True when the effect is seen in contact.
    pub fn in_contact(self) -> bool {
        self != Self::Flight
    }
}

/// On what an effect acts: one of the choices among which a ranking selects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Target {
    /// The whole body (or all plates) with one set of coefficients.
    Body,
    /// The whole body, a coefficient for every link.
    EveryLink,
    /// The whole body, coefficients for the shape of every link.
    Shape,
    /// One link, by index.
    Link(usize),
    /// One plate, by index.
    Plate(usize),
}

impl Target {
    /// Short name for columns and reports: nothing for the body, `links`, `shape`, a link's name, `plate1` …
    pub fn label(&self, scene: &Scene) -> String {
        match self {
            Self::Body => String::new(),
            Self::EveryLink => "links".to_owned(),
            Self::Shape => "shape".to_owned(),
            Self::Link(i) => scene.model.links.get(*i).map_or_else(|| format!("link{i}"), |l| l.name.clone()),
            Self::Plate(i) => format!("plate{}", i + 1),
        }
    }
}

/// An unknown that the effect's wrench is proportional to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Coefficient {
    /// Name.
    pub name: String,
    /// SI unit; `1` for none.
    pub unit: String,
    /// Smallest plausible value (physics may forbid a sign).
    pub lower: f64,
    /// Largest plausible value.
    pub upper: f64,
}

impl Coefficient {
    /// Any finite value.
    pub fn free(name: impl Into<String>, unit: &str) -> Self {
        Self::within(name, unit, f64::NEG_INFINITY, f64::INFINITY)
    }
    /// Zero or more.
    pub fn positive(name: impl Into<String>, unit: &str) -> Self {
        Self::within(name, unit, 0.0, f64::INFINITY)
    }
    /// Within bounds.
    pub fn within(name: impl Into<String>, unit: &str, lower: f64, upper: f64) -> Self {
        Self { name: name.into(), unit: unit.to_owned(), lower, upper }
    }
    /// Three components `x`, `y`, `z` of a vector, any sign.
    pub fn vector(prefix: &str, unit: &str) -> Vec<Self> {
        ["x", "y", "z"].iter().map(|axis| Self::free(format!("{prefix}_{axis}"), unit)).collect()
    }
}

/// An unknown on which the columns themselves depend.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NonlinearParameter {
    /// Name.
    pub name: String,
    /// SI unit; `1` for none.
    pub unit: String,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Step of finite differences and unit of trust: a change that alters the columns noticeably.
    pub scale: f64,
}

impl NonlinearParameter {
    /// A parameter with its bounds.
    pub fn new(name: impl Into<String>, unit: &str, lower: f64, upper: f64, scale: f64) -> Self {
        Self { name: name.into(), unit: unit.to_owned(), lower, upper, scale }
    }
    /// Three components of a point, each within `reach` of `centre`.
    pub fn point(prefix: &str, centre: [f64; 3], reach: f64) -> Vec<Self> {
        ["x", "y", "z"]
            .iter()
            .zip(centre)
            .map(|(axis, c)| Self::new(format!("{prefix}_{axis}"), "m", c - reach, c + reach, 0.2 * reach.min(0.5)))
            .collect()
    }
}

/// How the wrench of an effect comes about.
#[derive(Debug, Clone, Copy)]
pub enum WrenchLaw {
    /// From one instant: writes the columns of frame `i` of `out`.
    Frame(fn(&EffectFrame<'_>, Target, &[f64], &mut Columns, usize)),
    /// From the course of the motion (derivatives, oscillators).
    Series(fn(&Series<'_>, Target, &[f64], &mut Columns)),
}

/// A change of inertial parameters: one stack of φ (a link each) per coefficient, kg, kg·m, kg·m² per unit of the coefficient.
pub type InertiaLaw = fn(&Scene, Target, &[f64]) -> Vec<Vec<Phi>>;

/// An effect of the catalogue.
#[derive(Debug)]
pub struct EffectDefinition {
    /// Identifier in YAML and JSON.
    pub id: &'static str,
    /// A few words.
    pub title: &'static str,
    /// Physics or artefact.
    pub kind: EffectKind,
    /// Where it acts.
    pub acts: ActsIn,
    /// What it cannot be told from by any recording of the same kind; empty for none.
    pub class: &'static str,
    /// Effects of which this one is a generalisation: it contains them, so it only counts where it does better.
    pub contains: &'static [&'static str],
    /// True when it shows only as a difference between groups of trials.
    pub by_group: bool,
    /// Why coefficients that lack a bound lack it; empty where each has two.
    pub unbounded: &'static str,
    /// On what it may act.
    pub targets: fn(&Scene) -> Vec<Target>,
    /// Linear unknowns.
    pub coefficients: fn(&Scene, Target) -> Vec<Coefficient>,
    /// Nonlinear unknowns.
    pub nonlinear: fn(&Scene, Target) -> Vec<NonlinearParameter>,
    /// Values of the nonlinear unknowns to start from.
    pub starts: fn(&Scene, Target) -> Vec<Vec<f64>>,
    /// The wrench, if there is one.
    pub wrench: Option<WrenchLaw>,
    /// The change of inertia, if there is one; the body then feels `−Y δφ` in addition.
    pub inertia: Option<InertiaLaw>,
    /// Markdown with the headings Physics, Equation, Identifiability, References.
    pub documentation: &'static str,
}

/// No nonlinear unknowns.
pub(crate) fn none(_: &Scene, _: Target) -> Vec<NonlinearParameter> {
    Vec::new()
}

/// One start without nonlinear unknowns.
pub(crate) fn one_start(_: &Scene, _: Target) -> Vec<Vec<f64>> {
    vec![Vec::new()]
}

/// The whole body.
pub(crate) fn body(_: &Scene) -> Vec<Target> {
    vec![Target::Body]
}

/// Every link.
pub(crate) fn links(scene: &Scene) -> Vec<Target> {
    (0..scene.model.n_links()).map(Target::Link).collect()
}

/// The whole body, and a coefficient for each link where there are few.
pub(crate) fn body_or_links(scene: &Scene) -> Vec<Target> {
    if (2..=3).contains(&scene.model.n_links()) { vec![Target::Body, Target::EveryLink] } else { vec![Target::Body] }
}

/// The same, and coefficients for the shape of each link where there are few.
pub(crate) fn body_links_or_shape(scene: &Scene) -> Vec<Target> {
    let mut out = body_or_links(scene);
    if out.len() > 1 {
        out.push(Target::Shape);
    }
    out
}

/// Every plate.
pub(crate) fn plates(scene: &Scene) -> Vec<Target> {
    (0..scene.n_plates()).map(Target::Plate).collect()
}

/// All plates together, and each alone.
pub(crate) fn all_or_one_plate(scene: &Scene) -> Vec<Target> {
    match scene.n_plates() {
        0 => Vec::new(),
        1 => vec![Target::Body],
        n => std::iter::once(Target::Body).chain((0..n).map(Target::Plate)).collect(),
    }
}

/// The link of a target; the root where it names none.
pub(crate) fn link_of(target: Target) -> usize {
    match target {
        Target::Link(i) => i,
        _ => 0,
    }
}

/// True when a plate takes part in a target.
pub(crate) fn plate_in(target: Target, plate: usize) -> bool {
    match target {
        Target::Plate(i) => i == plate,
        _ => true,
    }
}

/// Base axis `k` of the world.
pub(crate) fn axis(k: usize) -> nalgebra::Vector3<f64> {
    let mut e = nalgebra::Vector3::zeros();
    e[k] = 1.0;
    e
}

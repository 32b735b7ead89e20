//! Format of effects written by users: the law, its point, its unknowns.

use crate::{ActsIn, EffectKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// An effect as a user writes it: one law at the top level, or several under `parts` that share the
/// unknowns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FormulaEffect {
    /// Identifier, not one of the catalogue; what `effect add` and the tables call it.
    pub id: String,
    /// A few words.
    #[serde(default)]
    pub title: String,
    /// Where the force acts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<FormulaPoint>,
    /// Axes of vectors and of the law.
    #[serde(default)]
    pub axes: FormulaAxes,
    /// Force in N, three formulas (x, y, z); none when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force: Option<[String; 3]>,
    /// Free moment in N·m, three formulas; none when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment: Option<[String; 3]>,
    /// Laws at several points, instead of one at the top level.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<FormulaPart>,
    /// Unknowns that the law is linear in.
    pub coefficients: Vec<FormulaCoefficient>,
    /// Further unknowns, bounded, that the law is not linear in.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<FormulaParameter>,
    /// Known numbers with units.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub constants: Vec<FormulaConstant>,
    /// Formulas with a name, for use in the law and in later definitions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub definitions: Vec<FormulaDefinition>,
    /// Name of a parameter or constant in s, at most 0.4 s: the law is that of the motion so much
    /// earlier. The force acts where the point is now, and along the axes as they are now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay: Option<String>,
    /// Where it acts: `flight`, `contact` or `both`.
    #[serde(default = "both")]
    pub acts: ActsIn,
    /// `physics` or `artefact`.
    #[serde(default = "physics")]
    pub kind: EffectKind,
    /// Text for people (Markdown).
    #[serde(default)]
    pub documentation: String,
}

impl FormulaEffect {
    /// Names of links at which its laws act, `body` and `all` among them.
    pub fn links(&self) -> impl Iterator<Item = &str> {
        self.point.iter().chain(self.parts.iter().map(|p| &p.point)).map(|p| p.link.as_str())
    }

    /// True if two definitions state the same law, whatever their titles and texts say.
    pub fn is_same_law(&self, other: &Self) -> bool {
        let bare = |e: &Self| Self { title: String::new(), documentation: String::new(), ..e.clone() };
        bare(self) == bare(other)
    }
}

fn both() -> ActsIn {
    ActsIn::Both
}
fn physics() -> EffectKind {
    EffectKind::Physics
}

/// One law at one point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FormulaPart {
    /// Where the force acts.
    pub point: FormulaPoint,
    /// Axes of vectors and of the law.
    #[serde(default)]
    pub axes: FormulaAxes,
    /// Force in N, three formulas (x, y, z); none when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force: Option<[String; 3]>,
    /// Free moment in N·m, three formulas; none when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment: Option<[String; 3]>,
}

/// A point of a link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FormulaPoint {
    /// Name of the link; `body` for the centre of mass of the whole body; `all` for every link,
    /// each at its own point.
    pub link: String,
    /// Place in its frame, m; the link's centre of mass when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub position_m: Option<[f64; 3]>,
}

/// Axes in which vectors are written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FormulaAxes {
    /// The room's.
    #[default]
    World,
    /// The link's.
    Link,
}

/// An unknown of a user's law.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FormulaCoefficient {
    /// Name in the formulas.
    pub name: String,
    /// SI unit, for example `kg/m`, `N*s/m`, `1`.
    pub unit: String,
    /// Smallest plausible value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -1e15, max = 1e15))]
    pub lower: Option<f64>,
    /// Largest plausible value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -1e15, max = 1e15))]
    pub upper: Option<f64>,
}

/// An unknown that the law is not linear in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FormulaParameter {
    /// Name in the formulas.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// Lower bound.
    #[schemars(range(min = -1e15, max = 1e15))]
    pub lower: f64,
    /// Upper bound.
    #[schemars(range(min = -1e15, max = 1e15))]
    pub upper: f64,
    /// Where the search begins; five values across the bounds when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -1e15, max = 1e15))]
    pub start: Option<f64>,
}

/// A known number with a unit, for example a density.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FormulaConstant {
    /// Name in the formulas.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// Value.
    #[schemars(range(min = -1e30, max = 1e30))]
    pub value: f64,
}

/// A formula with a name, which other formulas use in its place. Its unit follows from what it is
/// made of. Quantities in it are those of the point and in the axes of the law that uses it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FormulaDefinition {
    /// Name in the formulas.
    pub name: String,
    /// The formula; it may use the definitions before it.
    pub formula: String,
}

impl FormulaEffect {
    /// All laws, each with its position in the file: empty for the top level, else `parts[1].`.
    pub(crate) fn laws(&self) -> Vec<(String, FormulaPart)> {
        let mut out = Vec::new();
        if let Some(point) = &self.point {
            let (axes, force, moment) = (self.axes, self.force.clone(), self.moment.clone());
            out.push((String::new(), FormulaPart { point: point.clone(), axes, force, moment }));
        }
        out.extend(self.parts.iter().enumerate().map(|(i, p)| (format!("parts[{i}]."), p.clone())));
        out
    }
}

//! How well the motion determines a value, and where the value comes from.

use serde::{Deserialize, Serialize};

/// How well the motion determines a parameter or a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Determination {
    /// Determined by the motion: the interval is below 30 % of the prior's, or of 10 % of the
    /// body's own scale.
    Well,
    /// Partly determined by the motion: below 70 %.
    Partly,
    /// Not determined: the value is that of the prior, or noise without a prior.
    Hardly,
}

/// Source of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// The recorded motion.
    Motion,
    /// The table of body proportions (or the description of the object): motion did not determine
    /// it.
    Table,
    /// A scale.
    Scale,
    /// None: motion did not determine it, and the estimator uses no table.
    #[default]
    NotDetermined,
}

impl Origin {
    /// Origin of an estimate, from how well motion determines it and whether a table exists.
    pub(crate) fn of(determination: Determination, has_table: bool) -> Self {
        match (determination, has_table) {
            (Determination::Well | Determination::Partly, _) => Self::Motion,
            (Determination::Hardly, true) => Self::Table,
            (Determination::Hardly, false) => Self::NotDetermined,
        }
    }

    /// In words.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Motion => "motion",
            Self::Table => "from tables",
            Self::Scale => "scale",
            Self::NotDetermined => "not determined",
        }
    }
}

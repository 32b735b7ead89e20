//! Errors of this crate.

/// Errors of this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EffectsError {
    /// No effect of this name.
    #[error("there is no effect `{name}`; there are {known}")]
    Unknown {
        #[doc(hidden)]
        name: String,
        #[doc(hidden)]
        known: String,
    },
    /// The effect needs a target, and none is given.
    #[error("`{effect}` needs a target; {known}")]
    NoTarget {
        #[doc(hidden)]
        effect: String,
        #[doc(hidden)]
        known: String,
    },
    /// The effect does not act on this target.
    #[error("`{effect}` cannot act on `{target}`; {known}")]
    Target {
        #[doc(hidden)]
        effect: String,
        #[doc(hidden)]
        target: String,
        #[doc(hidden)]
        known: String,
    },
    /// A vector has another length than is needed.
    #[error("trial `{trial}`: {what}: expected {expected}, found {found}")]
    Length {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        what: &'static str,
        #[doc(hidden)]
        expected: usize,
        #[doc(hidden)]
        found: usize,
    },
    /// A number that cannot be.
    #[error("`{effect}`: {what} is {found}, expected {expected}")]
    Value {
        #[doc(hidden)]
        effect: String,
        #[doc(hidden)]
        what: String,
        #[doc(hidden)]
        found: f64,
        #[doc(hidden)]
        expected: String,
    },
    /// A formula that cannot be read, or whose units do not fit.
    #[error(transparent)]
    Formula(Box<FormulaProblem>),
    /// A name, unit or bound of a user-written effect that cannot be.
    #[error("effect `{effect}`, {place}: {problem}")]
    Place {
        /// The effect.
        effect: String,
        /// Where in its description: `coefficients[0].unit`, `parts[1].point.link` …
        place: String,
        /// What is wrong there.
        problem: String,
    },
    /// Anything else that is asked of an effect and that cannot be.
    #[error("effect `{effect}`: {problem}")]
    Spec {
        #[doc(hidden)]
        effect: String,
        #[doc(hidden)]
        problem: String,
    },
}

/// What is wrong in a formula, and where.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("effect `{effect}`, {entry}: {problem}\n  {formula}\n  {:>1$}", "^", position + 1)]
pub struct FormulaProblem {
    /// The effect.
    pub effect: String,
    /// Which formula: `force[0]`, `moment[2]` …
    pub entry: String,
    /// The formula.
    pub formula: String,
    /// Characters before the place (from zero).
    pub position: usize,
    /// What is wrong there.
    pub problem: String,
}

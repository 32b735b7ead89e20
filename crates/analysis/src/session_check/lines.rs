//! The lines of the session check.

use serde::Serialize;

/// How a measurement stands to its expectation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LineStatus {
    /// The interval holds the expectation.
    Agrees,
    /// It does not.
    Differs,
    /// A reading without an interval or without an expectation.
    Reading,
}

impl LineStatus {
    /// Word used in tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::Agrees => "agrees",
            Self::Differs => "differs",
            Self::Reading => "–",
        }
    }
}

/// One line of the check.
#[derive(Debug, Clone, Serialize)]
pub struct SessionLine {
    /// Identifier for programs.
    pub id: &'static str,
    /// What is measured.
    pub what: String,
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: &'static str,
    /// 95 % interval, if known.
    pub ci95: Option<[f64; 2]>,
    /// What the value should be, if something says it.
    pub expected: Option<f64>,
    /// Number of observations.
    pub n: usize,
    /// How it stands.
    #[serde(rename = "standing")]
    pub status: LineStatus,
    /// Explanation, and what to do.
    pub words: String,
}

/// The check of one session.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SessionCheck {
    /// Lines, in the order of reading; empty before a run.
    pub lines: Vec<SessionLine>,
}

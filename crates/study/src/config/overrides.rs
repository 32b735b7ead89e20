//! Settings that differ between subjects, sessions or trials.

use super::sections::{
    CalibrateConfig, CompareConfig, CorrectionsConfig, FilterConfig, FlightConfig, IdentifyConfig, IkConfig,
    ImportConfig, RegressorConfig, ScaleConfig,
};
use super::subjects::SubjectConfig;
use super::trials::TrialsConfig;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings for some subjects, sessions or trials. What is nearer to the trial wins: study,
/// subject, session, trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Override {
    /// Name or pattern of the subject; all where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subject: Option<String>,
    /// Name or pattern of the session; all where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub session: Option<String>,
    /// Name or pattern of the trial; then `set` may hold `import`, `ik` and `flight` only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trial: Option<String>,
    /// The settings: sections as in the pipeline, with just what differs.
    pub set: Sections,
}

impl Override {
    /// What cannot be, in words.
    pub fn check(&self) -> Result<(), String> {
        if self.trial.is_some() {
            let s = &self.set;
            let wrong = [
                ("marker_set", s.marker_set.is_some()),
                ("object", s.object.is_some()),
                ("subject", s.subject.is_some()),
                ("trials", s.trials.is_some()),
                ("corrections", s.corrections.is_some()),
                ("scale", s.scale.is_some()),
                ("calibrate", s.calibrate.is_some()),
                ("filter", s.filter.is_some()),
                ("regressor", s.regressor.is_some()),
                ("identify", s.identify.is_some()),
                ("compare", s.compare.is_some()),
            ];
            if let Some((name, _)) = wrong.iter().find(|(_, set)| *set) {
                return Err(format!(
                    "`{name}` holds for all trials of a session and cannot differ for a single trial; \
                     expected `import`, `ik` or `flight`, or leave `trial` out"
                ));
            }
            if s.flight.as_ref().is_some_and(|f| f.margin_s != FlightConfig::default().margin_s) {
                return Err(
                    "`flight: margin_s` holds for all trials of a session and cannot differ for a single trial"
                        .to_owned(),
                );
            }
        } else if self.subject.is_none() && self.session.is_none() {
            return Err("an override names whom it is for: `subject`, `session` or `trial`".to_owned());
        }
        Ok(())
    }
}

/// The sections of a pipeline that may differ between subjects and sessions; also what a file
/// `overrides.yaml` beside the recordings of a subject or session may hold.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sections {
    /// Marker set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub marker_set: Option<String>,
    /// Object description.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<String>,
    /// Facts about the subject.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subject: Option<SubjectConfig>,
    /// Which recordings play which part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trials: Option<TrialsConfig>,
    /// Reading of recordings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub import: Option<ImportConfig>,
    /// Corrections of recordings and facts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrections: Option<CorrectionsConfig>,
    /// Static trial to subject.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<ScaleConfig>,
    /// Refinement of geometry.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrate: Option<CalibrateConfig>,
    /// Markers to joint motion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ik: Option<IkConfig>,
    /// Low-pass filter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filter: Option<FilterConfig>,
    /// Search for free flight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flight: Option<FlightConfig>,
    /// Rows and factors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regressor: Option<RegressorConfig>,
    /// Estimation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identify: Option<IdentifyConfig>,
    /// Model against measurement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compare: Option<CompareConfig>,
}

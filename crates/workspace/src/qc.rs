//! The complete list of quality-control reasons. Tables, reports and other programs may rely on
//! these words; each has one meaning and one recommendation.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Severity of a reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum QcLevel {
    /// No problem.
    Ok,
    /// Results may be affected.
    Warning,
    /// There is no result.
    Failed,
    /// Excluded on purpose.
    Excluded,
}

impl QcLevel {
    /// Word used in tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Failed => "failed",
            Self::Excluded => "excluded",
        }
    }
}

macro_rules! reasons {
    ($($variant:ident, $code:literal, $level:ident, $meaning:literal, $advice:literal;)*) => {
        /// Why a trial deserves attention, or has no result.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
        #[serde(rename_all = "snake_case")]
        pub enum QcReason {
            $(#[doc = $meaning] $variant,)*
        }
        impl QcReason {
            /// Every reason, in the order of this list.
            pub const ALL: &[Self] = &[$(Self::$variant,)*];
            /// Word used in tables.
            pub fn code(self) -> &'static str {
                match self { $(Self::$variant => $code,)* }
            }
            /// Meaning of the reason.
            pub fn meaning(self) -> &'static str {
                match self { $(Self::$variant => $meaning,)* }
            }
            /// What to do about it.
            pub fn advice(self) -> &'static str {
                match self { $(Self::$variant => $advice,)* }
            }
            /// Severity.
            pub fn level(self) -> QcLevel {
                match self { $(Self::$variant => QcLevel::$level,)* }
            }
        }
    };
}

reasons! {
    Excluded, "excluded", Excluded, "The pipeline leaves the trial, subject or session out, with a reason.", "See `exclude` in the pipeline.";
    UnreadableFile, "unreadable_file", Failed, "The file is damaged, empty or not a recording.", "Export or copy it again; `aloft inspect FILE` says where reading stopped.";
    MissingJoint, "missing_joint", Failed, "The robot's log has no column for a joint of the model.", "Name the column after the joint, or fix the joint in the model file.";
    CopiedRecording, "copied_recording", Failed, "The file has the same content as another recording of the session; the same data must not count twice.", "Delete the copy, or exclude it under `trials: {exclude: …}`.";
    SeveralPeople, "several_people", Failed, "The recording holds markers of several people, none of whom has the subject's name.", "Name the person to use: `import: {person: …}`.";
    NoMarkers, "no_markers", Failed, "No marker of the set is in the recording.", "Choose another `marker_set`, or map labels under `import: {aliases}`.";
    TruncatedFile, "truncated_file", Failed, "File truncated: fewer than half of the declared frames are present.", "Copy it again, or set `import: {least_fraction: …}` to use what is there.";
    EmptyTrial, "empty_trial", Failed, "No marker is visible in any frame.", "Exclude the trial, or export it again.";
    SubjectUnknown, "subject_unknown", Failed, "The subject cannot be processed: body mass, recordings or settings are missing.", "Complete participants.tsv, subject.yaml or the pipeline.";
    ScalingFailed, "scaling_failed", Failed, "The subject's model could not be made from the static trial.", "Look at the static trial; name `static_frames` of another trial.";
    IkFailed, "ik_failed", Failed, "Inverse kinematics gave no frame.", "Look at the recording: too few markers on the root segment.";
    StageFailed, "stage_failed", Failed, "Another stage failed; the message names it.", "See the message and its hint.";
    Blocked, "blocked", Failed, "An earlier stage of this trial or of the whole subject failed.", "Fix the earlier failure first.";
    NotRun, "not_run", Warning, "Results are missing, or made from other inputs or parameters than the present ones.", "Run again.";
    FramesLost, "frames_lost", Warning, "The file ends before its declared last frame.", "Copy the recording again.";
    MissingMarker, "missing_marker", Warning, "A marker of the set is missing.", "No action needed if the segment has three other markers.";
    HeldMarker, "held_marker", Warning, "A marker repeats one position exactly while others move: a copy, no measurement. It is missing there.", "Export the recording again without filled gaps; no action needed if the segment has three other markers.";
    LongGap, "long_gap", Warning, "A gap is too long to be filled.", "Label the trial again, or accept frames without a result.";
    Spikes, "spikes", Warning, "A marker jumps.", "Set `import: {repair: true}`, or clean the trial.";
    LabelSwap, "label_swap", Warning, "Two labels are exchanged for some frames.", "Set `import: {repair: true}`, or label the trial again.";
    LabelsExchanged, "labels_exchanged", Warning, "Labels of a rigid segment are on other markers than in the static trial; they were exchanged back.", "Check the labels that `aloft explain` names; label the trial again.";
    NoisyMarker, "noisy_marker", Warning, "A marker is noisier than usual.", "Check the cameras and how the marker is attached.";
    ShortTrial, "short_trial", Warning, "The recording is very short.", "Check that it was exported whole.";
    PlateSaturated, "plate_saturated", Warning, "A force plate is saturated.", "Raise the amplifier's range.";
    PlateIncomplete, "plate_incomplete", Warning, "A force plate lacks samples.", "Export the recording again.";
    ColumnsNotUsed, "columns_not_used", Warning, "Columns of the force file belong to no plate and are not used.", "Assign them to plates under `import: {forces: …}`, unless they are no forces.";
    ClocksDiffer, "clocks_differ", Warning, "Times do not fit the stated rate, are in another unit, or differ between markers and forces.", "Compare the numbers that `aloft explain` gives; `import: {force_times: from_first_frame}` where both files start together.";
    ScalingErrorLarge, "scaling_error_large", Warning, "Markers of the static trial deviate from their rigid segments by more than 10 mm (RMS).", "Look for labels on wrong markers in the static trial.";
    IkErrorLarge, "ik_error_large", Warning, "Marker error exceeds its limit of 20 mm (RMS).", "Look at labels and at the static trial.";
    UnsolvedFrames, "unsolved_frames", Warning, "Some frames could not be solved.", "Fill gaps of the root segment's markers.";
    NoFlight, "no_flight", Warning, "No flight was found in a trial meant to identify from.", "Look at `flight` in the pipeline, or hold the trial out.";
    FreeFallOff, "free_fall_off", Warning, "The free acceleration in flight differs from the stated gravity in size or direction, beyond its uncertainty.", "`aloft explain PIPELINE TRIAL flight` names the ratio and what explains it: frame rate, unit of length, body-weight support, vertical.";
    ComparisonLarge, "comparison_large", Warning, "Model and measurement differ by more than 5 % of body weight (mean absolute force).", "See `aloft compare` and `aloft discover`.";
    WeaklyIdentified, "weakly_identified", Warning, "The flights of this session do not determine all parameters.", "Record more flights, with stronger motion of the limbs.";
    PartlyMeasured, "partly_measured", Ok, "The plates do not measure all contact in some frames under load (a foot beside them, a hold, a chair, a helper); these frames are left out.", "`aloft explain` says how many and why; no action needed if enough contact remains.";
    UntaredPlate, "untared_plate", Warning, "A plate is never unloaded, so that its zero is not known; the comparison takes one constant off.", "Let the subject step off the plates once in each recording.";
    Remarks, "remarks", Warning, "A stage reported other remarks.", "`aloft explain` shows them.";
}

impl From<&aloft_trial::QualityReason> for QcReason {
    fn from(reason: &aloft_trial::QualityReason) -> Self {
        use aloft_trial::QualityReason as Q;
        match reason {
            Q::EmptyTrial => Self::EmptyTrial,
            Q::NoMarkers => Self::NoMarkers,
            Q::ShortTrial { .. } => Self::ShortTrial,
            Q::MissingMarker { .. } => Self::MissingMarker,
            Q::LongGap { .. } => Self::LongGap,
            Q::Spikes { .. } => Self::Spikes,
            Q::LabelSwap { .. } => Self::LabelSwap,
            Q::NoisyMarker { .. } => Self::NoisyMarker,
            Q::NoPlates | Q::PlateSilent { .. } => Self::Remarks,
            Q::PlateSaturated { .. } => Self::PlateSaturated,
            Q::PlateIncomplete { .. } => Self::PlateIncomplete,
            Q::ColumnsNotUsed { .. } => Self::ColumnsNotUsed,
        }
    }
}

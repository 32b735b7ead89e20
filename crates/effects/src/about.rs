//! Declarations of an effect: all properties that other crates use, apart from its law.

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
    /// Between two links: no force on the body as a whole. It shows in the torques of a robot's
    /// joints only.
    Joints,
}

impl ActsIn {
    /// True when the effect acts in flights.
    pub fn in_flight(self) -> bool {
        matches!(self, Self::Flight | Self::Both)
    }
    /// True when the effect acts in contact.
    pub fn in_contact(self) -> bool {
        matches!(self, Self::Contact | Self::Both)
    }
    /// True when the effect shows in the torques of joints, and nowhere else.
    pub fn in_joints(self) -> bool {
        self == Self::Joints
    }
}

/// Family of an effect. A ranking demands more of errors that every recording has to some degree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Forces, masses and gravity.
    Forces,
    /// Errors in the position of the body from cameras, markers and skeleton, and in the limits of
    /// its flights.
    Kinematics,
    /// Errors of force plates, and of the scale that weighed the body.
    Plates,
    /// Friction and drives of a robot's joints, judged on its torques.
    Joints,
}

/// The additional recording that distinguishes an effect from others.
///
/// In order of precedence: if two effects name different recordings, the one earlier in this list
/// distinguishes them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Separation {
    /// A known time, length or weight.
    KnownFall,
    /// Another orientation of the laboratory axes.
    TurnedLaboratory,
    /// Motion with and against a flow of air.
    WithAndAgainst,
    /// The same motion at other places.
    OtherPlaces,
    /// Spins in both senses.
    BothSenses,
    /// Trials with and without a load.
    WithAndWithoutLoad,
    /// Motions with and without impacts.
    Impacts,
    /// A known weight on each plate.
    KnownWeight,
    /// More of the same motion, longer and faster.
    LongerFlights,
    /// One joint moved alone, slowly and fast, in both directions, with stops.
    JointAlone,
}

impl Separation {
    /// The recording in words, to follow "they are told apart by …".
    pub fn describe(self) -> &'static str {
        match self {
            Self::KnownFall => "a dropped ball of known fall, a clock pulse, a calibrated wand, the weight on a plate",
            Self::TurnedLaboratory => {
                "a second orientation of the laboratory axes (turn the calibration frame), or a plumb line"
            }
            Self::WithAndAgainst => "motion with and against the wind at several speeds",
            Self::OtherPlaces => "the same motion at other places of the volume, and turned by a right angle",
            Self::BothSenses => "spins in both senses about several axes",
            Self::WithAndWithoutLoad => "trials with and without the load",
            Self::Impacts => "a motion without impacts beside one with them, and markers on bone",
            Self::KnownWeight => "standing still on each plate in turn with a certified weight",
            Self::LongerFlights => "longer flights with spin in both senses and at several speeds",
            Self::JointAlone => "moving the joint alone, slowly and fast, in both directions and with stops",
        }
    }
}

/// Names and properties of an effect that do not depend on the body. Effects state the differences
/// from [`About::PLAIN`].
#[derive(Debug, Clone, Copy)]
pub struct About<'a> {
    /// Identifier in YAML and JSON.
    pub id: &'a str,
    /// Other identifiers that name the same effect in YAML and arguments.
    pub other_ids: &'a [&'a str],
    /// Title in a few words.
    pub title: &'a str,
    /// Physics or artefact.
    pub kind: EffectKind,
    /// Where it acts.
    pub acts: ActsIn,
    /// Family of the effect.
    pub family: Family,
    /// Exact aliases: effects that no recording of the same kind can distinguish from this one;
    /// empty for none.
    pub class: &'a str,
    /// Effects of the catalogue that no recording can distinguish from this one when both act on
    /// the whole body or on all plates: they are always named together.
    pub aliases: &'a [&'a str],
    /// Effects of which this one is a generalisation: it contains them, so it only counts if it
    /// does better.
    pub contains: &'a [&'a str],
    /// Simpler effects that this one becomes as a place in the room or a speed goes to infinity: a
    /// rope over a distant pulley is a constant force.
    pub becomes: &'a [&'a str],
    /// The recording that distinguishes it from most other effects.
    pub separated_by: Separation,
    /// Effects that need a different recording to be distinguished, with that recording in words.
    /// One of the two effects has to state it.
    pub told_from: &'a [(&'a str, &'a str)],
    /// True if it appears only as a difference between groups of trials.
    pub by_group: bool,
    /// Changes the inertia that tables give to a link, in all recordings: part of the body where
    /// there are no tables, and beside a prior from tables its column is the body's own.
    pub of_tables: bool,
    /// Standard deviation that its coefficients (linear, all in one unit) have in ordinary
    /// recordings of a person, the same in every trial: the intervals and the evidence of other
    /// effects include it. Zero for an effect that ordinary recordings do not have.
    pub usual_sd: f64,
    /// True if it depends on the time of a recording in the session.
    pub uses_session_time: bool,
    /// True if free fall in flights alone, without plates or a model, reveals the errors of time,
    /// length or weight that resemble it.
    pub shows_in_free_fall: bool,
    /// True for an error that the readings of unloaded plates show directly: it is not sought where
    /// every recording has such readings.
    pub shows_unloaded: bool,
    /// Coefficients (the beginnings of their names) that accompany what makes the effect: moments
    /// beside a force, damping beside a stiffness. Alone they are another effect.
    pub accompanying: &'a [&'a str],
    /// Reason why coefficients have no bound; empty if each has two.
    pub unbounded: &'a str,
    /// Markdown with the headings Physics, Equation, Identifiability, References.
    pub documentation: &'a str,
}

impl About<'_> {
    /// True for a coefficient that only accompanies what makes the effect.
    pub fn is_accompanied_by(&self, coefficient: &str) -> bool {
        self.accompanying.iter().any(|start| coefficient.starts_with(start))
    }

    /// A force that acts in flight and contact, without aliases or special properties.
    pub const PLAIN: About<'static> = About {
        id: "",
        other_ids: &[],
        title: "",
        kind: EffectKind::Physics,
        acts: ActsIn::Both,
        family: Family::Forces,
        class: "",
        aliases: &[],
        contains: &[],
        becomes: &[],
        separated_by: Separation::LongerFlights,
        told_from: &[],
        by_group: false,
        of_tables: false,
        usual_sd: 0.0,
        uses_session_time: false,
        shows_in_free_fall: false,
        shows_unloaded: false,
        accompanying: &[],
        unbounded: "",
        documentation: "",
    };

    /// A law of a robot's joint.
    pub const OF_JOINTS: About<'static> = About {
        acts: ActsIn::Joints,
        family: Family::Joints,
        separated_by: Separation::JointAlone,
        unbounded: "drives differ by orders of magnitude",
        ..Self::PLAIN
    };
}

impl<'a> About<'a> {
    /// The recording that distinguishes two effects, in words: the one that either of them states
    /// for this pair, otherwise the one of the two that takes precedence.
    pub fn told_apart_by(&self, other: &About<'a>) -> &'a str {
        let stated = |a: &About<'a>, b: &About<'a>| a.told_from.iter().find(|t| t.0 == b.id).map(|t| t.1);
        stated(self, other)
            .or_else(|| stated(other, self))
            .unwrap_or_else(|| self.separated_by.min(other.separated_by).describe())
    }
}

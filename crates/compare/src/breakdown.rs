//! The error in groups: by phase, flight, time in flight, speed, acceleration, turning, posture.

use crate::errors::{WrenchErrors, WrenchSums};
use crate::frames::{FrameRecord, TrialFrames};
use crate::{Phase, TrialInput};
use serde::{Deserialize, Serialize};

/// By what frames are grouped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroupedBy {
    /// Contact, take-off, landing, flight.
    Phase,
    /// Each flight.
    Flight,
    /// Fifths of a flight's duration.
    TimeInFlight,
    /// Speed of the centre of mass, m/s.
    Speed,
    /// Acceleration of the centre of mass, m/s².
    Acceleration,
    /// Angular speed of the root, rad/s.
    Turning,
    /// Height of the centre of mass over the lowest link, m: small when crouched.
    Posture,
}

/// One group of frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Group {
    /// By what.
    pub by: GroupedBy,
    /// Name: a phase, `trial #flight`, or the range with its unit.
    pub name: String,
    /// Lower end of the range, for groups that are ranges.
    pub from: Option<f64>,
    /// Upper end of the range.
    pub to: Option<f64>,
    /// Errors of its frames.
    pub errors: WrenchErrors,
}

/// Which frames of each trial a total is made of.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Counting {
    /// Take trials that are not held out, too, because none is.
    all_contact: bool,
    all_flight: bool,
}

impl Counting {
    /// Held-out frames where there are any, else all.
    pub fn new(inputs: &[TrialInput<'_>], frames: &[TrialFrames]) -> Self {
        let any = |contact: bool| {
            inputs.iter().zip(frames).any(|(input, t)| {
                let held_out = if contact { input.held_out_contact } else { input.held_out_flight };
                held_out && t.records.iter().any(|r| r.place.phase.is_contact() == contact)
            })
        };
        Self { all_contact: !any(true), all_flight: !any(false) }
    }
    pub fn contact(&self, input: &TrialInput<'_>) -> bool {
        self.all_contact || input.held_out_contact
    }
    pub fn flight(&self, input: &TrialInput<'_>) -> bool {
        self.all_flight || input.held_out_flight
    }
    pub fn counts(&self, input: &TrialInput<'_>, record: &FrameRecord) -> bool {
        if record.place.phase.is_contact() { self.contact(input) } else { self.flight(input) }
    }
}

const FIFTHS: usize = 5;
const QUARTERS: usize = 4;

/// All groups of one model.
pub(crate) fn breakdown(
    inputs: &[TrialInput<'_>],
    frames: &[TrialFrames],
    counting: &Counting,
    which: usize,
) -> Vec<Group> {
    let counted: Vec<(usize, &FrameRecord)> = inputs
        .iter()
        .zip(frames)
        .enumerate()
        .flat_map(|(i, (input, t))| t.records.iter().filter(|r| counting.counts(input, r)).map(move |r| (i, r)))
        .collect();
    let mut groups = Vec::new();
    let mut push = |by, name: String, range: Option<(f64, f64)>, keep: &dyn Fn(usize, &FrameRecord) -> bool| {
        let mut sums = WrenchSums::default();
        for (_, r) in counted.iter().filter(|(trial, r)| keep(*trial, r)) {
            sums.add(&r.residual[which], &r.world_from_root.rotation);
        }
        let errors = sums.errors();
        if errors.frames > 0 {
            groups.push(Group { by, name, from: range.map(|r| r.0), to: range.map(|r| r.1), errors });
        }
    };
    for phase in Phase::ALL {
        push(GroupedBy::Phase, phase.word().to_owned(), None, &|_, r| r.place.phase == phase);
    }
    for (i, input) in inputs.iter().enumerate() {
        for flight in 0..input.flights.len() {
            let name = format!("{} #{}", input.motion.trial, flight + 1);
            push(GroupedBy::Flight, name, None, &|trial, r| trial == i && r.place.flight == Some(flight));
        }
    }
    for fifth in 0..FIFTHS {
        let (from, to) = (fifth as f64 / FIFTHS as f64, (fifth + 1) as f64 / FIFTHS as f64);
        let name = format!("{:.0} to {:.0} % of the flight", 100.0 * from, 100.0 * to);
        push(GroupedBy::TimeInFlight, name, Some((from, to)), &|_, r| {
            r.place.flight.is_some() && r.place.fraction >= from && (r.place.fraction < to || fifth + 1 == FIFTHS)
        });
    }
    // ranges over contact where there is any; a flight is free of half of these questions
    let contact = counted.iter().any(|(_, r)| r.place.phase.is_contact());
    let of_interest = |r: &FrameRecord| r.place.phase.is_contact() == contact;
    type Feature = fn(&FrameRecord) -> f64;
    let features: [(GroupedBy, &str, Feature); 4] = [
        (GroupedBy::Speed, "m/s", |r| r.features.speed),
        (GroupedBy::Acceleration, "m/s²", |r| r.features.acceleration),
        (GroupedBy::Turning, "rad/s", |r| r.features.turning),
        (GroupedBy::Posture, "m", |r| r.features.posture),
    ];
    for (by, unit, feature) in features {
        let mut values: Vec<f64> = counted.iter().filter(|(_, r)| of_interest(r)).map(|(_, r)| feature(r)).collect();
        values.sort_by(f64::total_cmp);
        let Some(last) = values.last().copied() else { continue };
        for quarter in 0..QUARTERS {
            let from = values[quarter * (values.len() - 1) / QUARTERS];
            let to = values[(quarter + 1) * (values.len() - 1) / QUARTERS];
            let name = format!("{from:.2} to {to:.2} {unit}");
            push(by, name, Some((from, to)), &|_, r| {
                let x = feature(r);
                of_interest(r) && x >= from && (x < to || (quarter + 1 == QUARTERS && x <= last))
            });
        }
    }
    groups
}

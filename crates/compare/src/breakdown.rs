//! The error in groups: by phase, flight, time in flight, speed, acceleration, turning, posture.
//!
//! Groups follow from the motion alone, not from a model, so that all models and the noise floor
//! are evaluated on the same frames and windows. A window belongs to the groups of its middle
//! frame.

use crate::errors::{Sums, WindowErrors, WrenchErrors, WrenchSums};
use crate::frames::{FrameRecord, TrialFrames};
use crate::input::TrialFacts;
use crate::phase::Phase;
use crate::windows::TrialWindows;
use aloft_signal::quantile_of_sorted;
use serde::{Deserialize, Serialize};

/// Criterion by which frames are grouped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroupedBy {
    /// Each trial.
    Trial,
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
    /// Radius of gyration of the links' centres of mass about that of the body, m: small when
    /// crouched or tucked.
    Posture,
}

impl GroupedBy {
    /// Name used in tables and for `--by`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Trial => "trial",
            Self::Phase => "phase",
            Self::Flight => "flight",
            Self::TimeInFlight => "time in flight",
            Self::Speed => "speed",
            Self::Acceleration => "acceleration",
            Self::Turning => "turning",
            Self::Posture => "posture",
        }
    }
}

/// One group of frames and of the weak windows centred on them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Group {
    /// Grouping criterion.
    pub by: GroupedBy,
    /// Name: a phase, `trial #flight`, or the range with its unit.
    pub name: String,
    /// Lower end of the range, for groups that are ranges.
    pub from: Option<f64>,
    /// Upper end of the range.
    pub to: Option<f64>,
    /// Errors of its frames.
    pub errors: WrenchErrors,
    /// Errors of its windows.
    pub windows: WindowErrors,
}

/// Error that a perfect model would leave in one group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroupFloor {
    /// Grouping criterion.
    pub by: GroupedBy,
    /// Name.
    pub name: String,
    /// On its frames.
    pub errors: WrenchErrors,
    /// On its windows.
    pub windows: WindowErrors,
}

/// Selects the frames of each trial that enter a total.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Counting {
    /// Include trials that are not held out, because none is.
    all_contact: bool,
    all_flight: bool,
}

impl Counting {
    /// Selects held-out frames if there are any, else all.
    pub fn new(inputs: &[TrialFacts], frames: &[TrialFrames]) -> Self {
        let any = |contact: bool| {
            inputs.iter().zip(frames).any(|(input, t)| {
                let held_out = if contact { input.held_out_contact } else { input.held_out_flight };
                held_out && t.records.iter().any(|r| r.place.phase.is_contact() == contact)
            })
        };
        Self { all_contact: !any(true), all_flight: !any(false) }
    }
    pub fn contact(&self, input: &TrialFacts) -> bool {
        self.all_contact || input.held_out_contact
    }
    pub fn flight(&self, input: &TrialFacts) -> bool {
        self.all_flight || input.held_out_flight
    }
    pub fn counts(&self, input: &TrialFacts, record: &FrameRecord) -> bool {
        if record.place.phase.is_contact() { self.contact(input) } else { self.flight(input) }
    }
}

const FIFTHS: usize = 5;
const QUARTERS: usize = 4;

/// The groups, and the groups of every frame.
#[derive(Debug, Clone)]
pub(crate) struct Grouping {
    heads: Vec<Head>,
    /// `[trial][frame]`: indices of groups; empty for frames that do not count.
    of_frame: Vec<Vec<Vec<u16>>>,
}

#[derive(Debug, Clone)]
struct Head {
    by: GroupedBy,
    name: String,
    range: Option<(f64, f64)>,
}

/// Sums of every group.
#[derive(Clone)]
pub(crate) struct GroupSums {
    frames: Vec<WrenchSums>,
    windows: Vec<Sums>,
}

impl GroupSums {
    pub fn new(grouping: &Grouping) -> Self {
        let n = grouping.heads.len();
        Self { frames: vec![WrenchSums::default(); n], windows: vec![Sums::default(); n] }
    }
    pub fn add_frame(
        &mut self,
        grouping: &Grouping,
        trial: usize,
        frame: usize,
        e: &nalgebra::Vector6<f64>,
        rotation: &nalgebra::UnitQuaternion<f64>,
    ) {
        for &g in grouping.groups(trial, frame) {
            self.frames[usize::from(g)].add(e, rotation);
        }
    }
    pub fn add_window(&mut self, grouping: &Grouping, trial: usize, centre: usize, e: &nalgebra::Vector6<f64>) {
        for &g in grouping.groups(trial, centre) {
            self.windows[usize::from(g)].add(e);
        }
    }
    pub fn floors(&self, grouping: &Grouping) -> Vec<GroupFloor> {
        let of = |((head, f), w): ((&Head, &WrenchSums), &Sums)| GroupFloor {
            by: head.by,
            name: head.name.clone(),
            errors: f.errors(),
            windows: w.windows(),
        };
        grouping.heads.iter().zip(&self.frames).zip(&self.windows).map(of).collect()
    }
}

impl Grouping {
    /// Groups of the frames that count.
    pub fn new(inputs: &[TrialFacts], frames: &[TrialFrames], counting: &Counting) -> Self {
        let counted: Vec<(usize, &FrameRecord)> = inputs
            .iter()
            .zip(frames)
            .enumerate()
            .flat_map(|(i, (input, t))| t.records.iter().filter(|r| counting.counts(input, r)).map(move |r| (i, r)))
            .collect();
        let mut out =
            Self { heads: Vec::new(), of_frame: inputs.iter().map(|t| vec![Vec::new(); t.n_frames]).collect() };
        // counted frames are ordered by trial; this selects those of one trial
        let of_trial = |i: usize| {
            let start = counted.partition_point(|(trial, _)| *trial < i);
            &counted[start..start + counted[start..].partition_point(|(trial, _)| *trial == i)]
        };
        let mut push =
            |by, name: String, range, within: &[(usize, &FrameRecord)], keep: &dyn Fn(&FrameRecord) -> bool| {
                // none: a table with as many groups is full
                let Ok(index) = u16::try_from(out.heads.len()) else { return };
                let mut any = false;
                for (trial, r) in within.iter().filter(|(_, r)| keep(r)) {
                    out.of_frame[*trial][r.frame].push(index);
                    any = true;
                }
                if any {
                    out.heads.push(Head { by, name, range });
                }
            };
        for (i, input) in inputs.iter().enumerate() {
            push(GroupedBy::Trial, input.name.clone(), None, of_trial(i), &|_| true);
        }
        for phase in Phase::ALL {
            push(GroupedBy::Phase, phase.word().to_owned(), None, &counted, &|r| r.place.phase == phase);
        }
        for (i, input) in inputs.iter().enumerate() {
            for flight in 0..input.flights {
                let name = format!("{} #{}", input.name, flight + 1);
                push(GroupedBy::Flight, name, None, of_trial(i), &|r| r.place.flight == Some(flight));
            }
        }
        for fifth in 0..FIFTHS {
            let (from, to) = (fifth as f64 / FIFTHS as f64, (fifth + 1) as f64 / FIFTHS as f64);
            let name = format!("{:.0} to {:.0} % of the flight", 100.0 * from, 100.0 * to);
            push(GroupedBy::TimeInFlight, name, Some((from, to)), &counted, &|r| {
                r.place.flight.is_some() && r.place.fraction >= from && (r.place.fraction < to || fifth + 1 == FIFTHS)
            });
        }
        // ranges over contact if there is any; half of these criteria mean nothing in flight
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
            let mut values: Vec<f64> =
                counted.iter().filter(|(_, r)| of_interest(r)).map(|(_, r)| feature(r)).collect();
            values.sort_by(f64::total_cmp);
            let Some(last) = values.last().copied() else { continue };
            // as many decimals as distinguish the quartiles
            let bound = |q: usize| quantile_of_sorted(&values, q, QUARTERS).unwrap_or(f64::NAN);
            let quarters = (1..=QUARTERS).map(|q| bound(q) - bound(q - 1));
            let finest = quarters.filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
            let decimals = if finest.is_finite() { (1.0 - finest.log10().floor()).clamp(2.0, 6.0) as usize } else { 2 };
            for quarter in 0..QUARTERS {
                let (from, to) = (bound(quarter), bound(quarter + 1));
                let name = format!("{from:.decimals$} to {to:.decimals$} {unit}");
                push(by, name, Some((from, to)), &counted, &|r| {
                    let x = feature(r);
                    of_interest(r) && x >= from && (x < to || (quarter + 1 == QUARTERS && x <= last))
                });
            }
        }
        out
    }

    fn groups(&self, trial: usize, frame: usize) -> &[u16] {
        self.of_frame[trial].get(frame).map_or(&[], Vec::as_slice)
    }

    /// All groups of one model.
    pub fn breakdown(&self, frames: &[TrialFrames], windows: &[TrialWindows], which: usize) -> Vec<Group> {
        let mut sums = GroupSums::new(self);
        for (trial, (t, windows)) in frames.iter().zip(windows).enumerate() {
            for r in &t.records {
                sums.add_frame(self, trial, r.frame, &r.residual[which], &r.world_from_root.rotation);
            }
            for w in &windows.windows {
                sums.add_window(self, trial, w.centre, &w.residual[which]);
            }
        }
        let of = |((head, f), w): ((&Head, &WrenchSums), &Sums)| Group {
            by: head.by,
            name: head.name.clone(),
            from: head.range.map(|r| r.0),
            to: head.range.map(|r| r.1),
            errors: f.errors(),
            windows: w.windows(),
        };
        self.heads.iter().zip(&sums.frames).zip(&sums.windows).map(of).collect()
    }
}

//! What the plates of a session read while nothing stands on them.

use crate::results::Results;
use aloft_compare::{OffsetRange, TareReadings};
use aloft_flight::{PlateTare, TareSource};
use aloft_workspace::artifact::{plate_centres, trial_rate};
use aloft_workspace::error::StageFailure;
use nalgebra::{Vector3, Vector6};
use std::sync::OnceLock;

/// Readings of a trial's plates in its flights; none if they were not tared from flights.
pub(crate) fn tare_readings(results: Results<'_>, name: &str) -> Result<TareReadings, StageFailure> {
    let tares = results.load_tares(name)?;
    let Some(first) = tares.first() else { return Ok(TareReadings::default()) };
    let alike = |t: &PlateTare| t.source == TareSource::Flights && t.times_s == first.times_s;
    if !tares.iter().all(alike) {
        return Ok(TareReadings::default());
    }
    let centres = plate_centres(&results.place("import", name)?)?;
    let join = |(f, m): (&Vector3<f64>, &Vector3<f64>)| Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z);
    let of = |t: &PlateTare| t.force_n.iter().zip(&t.moment_nm).map(join).collect();
    let plates = centres.into_iter().zip(tares.iter().map(of)).collect();
    let flights = results.load_flights(name)?.flights;
    let frames: usize = flights.iter().map(aloft_flight::Flight::n_frames).sum();
    let rate_hz = trial_rate(&results.place("import", name)?)?;
    // 10 ms at both ends of each flight are left out of its reading
    let length_s = frames as f64 / rate_hz / flights.len().max(1) as f64 - 0.02;
    Ok(TareReadings { times_s: first.times_s.clone(), plates, length_s })
}

/// Readings of unloaded plates in all trials of a session, read from their results once, and only
/// if some trial does not show its own.
#[derive(Debug)]
pub struct SessionZeros<'a> {
    results: Results<'a>,
    trials: &'a [String],
    read: OnceLock<Result<Vec<TrialZeros>, StageFailure>>,
}

/// The readings of one trial that say what a plate reads unloaded.
#[derive(Debug)]
struct TrialZeros {
    trial: String,
    /// By plate, in order: whether it was read in flights, and its mean.
    known: Vec<(String, bool, Vector6<f64>)>,
}

impl TrialZeros {
    /// Of a plate; `from_flights` leaves out readings outside flights.
    fn of(&self, plate: &str, from_flights: bool) -> Option<Vector6<f64>> {
        let fit = |known: &&(String, bool, Vector6<f64>)| known.0 == plate && (known.1 || !from_flights);
        self.known.iter().find(fit).map(|known| known.2)
    }
}

impl<'a> SessionZeros<'a> {
    /// Of these trials.
    pub fn new(results: Results<'a>, trials: &'a [String]) -> Self {
        Self { results, trials, read: OnceLock::new() }
    }

    /// Those of the trials other than `name`, in order. Trials that are not among the inputs of the
    /// stage are left out; tares that are there and cannot be read are an error.
    fn others(&self, name: &str) -> Result<Vec<&TrialZeros>, StageFailure> {
        let read = || {
            let of = |trial: &String| {
                let Some(tares) = self.results.load_tares_if_any(trial)? else { return Ok(None) };
                // readings without noise say nothing: software set them to zero
                let told = tares.iter().filter(|t| t.source != TareSource::None && t.noise_n > 0.0);
                let known = told.map(|t| (t.plate.clone(), t.source == TareSource::Flights, mean(t))).collect();
                Ok(Some(TrialZeros { trial: trial.clone(), known }))
            };
            self.trials.iter().filter_map(|trial| of(trial).transpose()).collect()
        };
        let all = self.read.get_or_init(read).as_ref().map_err(StageFailure::clone)?;
        Ok(all.iter().filter(|t| t.trial != name).collect())
    }
}

/// What is known of a trial's unloaded plates.
pub(crate) struct Zero {
    /// True if the reading of some plate, unloaded, is not known.
    pub unknown: bool,
    /// Range of the constant that is left in the wrench of those plates, by the other trials.
    pub range: Option<OffsetRange>,
}

impl Zero {
    /// From the tares of the trial and of the session. A plate is unknown if the trial never
    /// unloads it, or if what was taken for its unloaded reading is far from those in flights of
    /// other trials: a foot that rests lightly on a plate is as quiet as none.
    ///
    /// # Errors
    /// The tares of another trial cannot be read.
    pub fn of(name: &str, tares: &[PlateTare], session: &SessionZeros<'_>) -> Result<Self, StageFailure> {
        let doubtful = |t: &PlateTare| -> Result<bool, StageFailure> {
            let others = session.others(name)?;
            let shown: Vec<Vector6<f64>> = others.iter().filter_map(|o| o.of(&t.plate, true)).collect();
            Ok(OffsetRange::of(&shown).is_some_and(|range| !range.contains(&mean(t))))
        };
        let mut unknown: Vec<&PlateTare> = Vec::new();
        for t in tares {
            if t.source == TareSource::None || (t.source == TareSource::OwnReadings && doubtful(t)?) {
                unknown.push(t);
            }
        }
        if unknown.is_empty() {
            return Ok(Self { unknown: false, range: None });
        }
        // what is left of a plate's constant after its tare was taken off
        let others = session.others(name)?;
        let left: Vec<Vector6<f64>> = others
            .iter()
            .filter_map(|o| unknown.iter().map(|t| Some(o.of(&t.plate, false)? - mean(t))).sum())
            .collect();
        Ok(Self { unknown: true, range: OffsetRange::of(&left) })
    }
}

/// Mean reading of a tare: force, then moment about the world origin.
fn mean(tare: &PlateTare) -> Vector6<f64> {
    let of = |v: &[Vector3<f64>]| v.iter().sum::<Vector3<f64>>() / v.len().max(1) as f64;
    let (force, moment) = (of(&tare.force_n), of(&tare.moment_nm));
    Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
}

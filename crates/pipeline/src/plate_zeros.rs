//! What the plates of a session read while nothing stands on them.

use crate::results::Results;
use aloft_compare::{OffsetRange, TareReadings};
use aloft_flight::{PlateTare, TareSource};
use aloft_workspace::artifact::{plate_centres, trial_rate};
use aloft_workspace::error::StageFailure;
use nalgebra::{Vector3, Vector6};

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

/// What is known of a trial's unloaded plates.
pub(crate) struct Zero {
    /// True if the reading of some plate, unloaded, is not known.
    pub unknown: bool,
    /// Range of the constant that is left in the wrench of those plates, by the other trials.
    pub range: Option<OffsetRange>,
}

impl Zero {
    /// From the tares of the trial and of `others`. A plate is unknown if the trial never unloads
    /// it, or if what was taken for its unloaded reading is far from those in flights of other
    /// trials: a foot that rests lightly on a plate is as quiet as none. Readings without noise say
    /// nothing: software set them to zero where the plate was unloaded.
    pub fn of(results: Results<'_>, name: &str, tares: &[PlateTare], others: &[String]) -> Self {
        let theirs: Vec<Vec<PlateTare>> =
            others.iter().filter(|o| *o != name).filter_map(|o| results.load_tares(o).ok()).collect();
        let reading = |trial: &[PlateTare], plate: &str, from_flights: bool| {
            let fit = |t: &&PlateTare| {
                let known = t.source == TareSource::Flights || (!from_flights && t.source != TareSource::None);
                t.plate == plate && known && t.noise_n > 0.0
            };
            trial.iter().find(fit).map(mean)
        };
        let doubtful = |t: &PlateTare| {
            let shown: Vec<Vector6<f64>> = theirs.iter().filter_map(|o| reading(o, &t.plate, true)).collect();
            OffsetRange::of(&shown).is_some_and(|range| !range.contains(&mean(t)))
        };
        let unknown: Vec<&PlateTare> = tares
            .iter()
            .filter(|t| t.source == TareSource::None || (t.source == TareSource::OwnReadings && doubtful(t)))
            .collect();
        // what is left of a plate's constant after its tare was taken off
        let left: Vec<Vector6<f64>> = theirs
            .iter()
            .filter_map(|o| unknown.iter().map(|t| Some(reading(o, &t.plate, false)? - mean(t))).sum())
            .collect();
        Self { unknown: !unknown.is_empty(), range: if unknown.is_empty() { None } else { OffsetRange::of(&left) } }
    }
}

/// Mean reading of a tare: force, then moment about the world origin.
fn mean(tare: &PlateTare) -> Vector6<f64> {
    let of = |v: &[Vector3<f64>]| v.iter().sum::<Vector3<f64>>() / v.len().max(1) as f64;
    let (force, moment) = (of(&tare.force_n), of(&tare.moment_nm));
    Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
}

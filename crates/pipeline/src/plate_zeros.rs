//! What the plates of a session read while nothing stands on them.

use crate::results::Results;
use aloft_compare::{OffsetRange, TareReadings};
use aloft_flight::{PlateTare, TareSource};
use aloft_workspace::artifact::{plate_centers, trial_rate};
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
    let centers = plate_centers(&results.place("import", name)?)?;
    let join = |(f, m): (&Vector3<f64>, &Vector3<f64>)| Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z);
    let of = |t: &PlateTare| t.force_n.iter().zip(&t.moment_nm).map(join).collect();
    let plates = centers.into_iter().zip(tares.iter().map(of)).collect();
    let flights = results.load_flights(name)?.flights;
    let frames: usize = flights.iter().map(aloft_flight::Flight::n_frames).sum();
    let rate_hz = trial_rate(&results.place("import", name)?)?;
    // 10 ms at both ends of each flight are left out of its reading
    let length_s = frames as f64 / rate_hz / flights.len().max(1) as f64 - 0.02;
    Ok(TareReadings { times_s: first.times_s.clone(), plates, length_s })
}

/// Range of the unloaded reading of a trial's plates, summed over those that it never unloads, by the
/// other trials in which all of them are unloaded at some time. Readings without noise say nothing:
/// software set them to zero where the plate was unloaded.
pub(crate) fn offset_range(
    results: Results<'_>,
    name: &str,
    tares: &[PlateTare],
    others: &[String],
) -> Option<OffsetRange> {
    let unknown: Vec<&str> = tares.iter().filter(|t| t.source == TareSource::None).map(|t| t.plate.as_str()).collect();
    let readings: Vec<Vector6<f64>> = others
        .iter()
        .filter(|o| *o != name)
        .filter_map(|o| {
            let theirs = results.load_tares(o).ok()?;
            let of = |plate: &&str| {
                let tare =
                    theirs.iter().find(|t| t.plate == **plate && t.source != TareSource::None && t.noise_n > 0.0)?;
                let mean = |v: &[Vector3<f64>]| v.iter().sum::<Vector3<f64>>() / v.len().max(1) as f64;
                let (force, moment) = (mean(&tare.force_n), mean(&tare.moment_nm));
                Some(Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z))
            };
            unknown.iter().map(of).sum::<Option<Vector6<f64>>>()
        })
        .collect();
    OffsetRange::of(&readings)
}

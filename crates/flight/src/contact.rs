//! Flights bounded by contact sensors: a foot's switch or force sensor says when something touches
//! the body.

use crate::{EdgeSource, Flight, FlightReport, FlightWarning, Rejected, RejectionReason};
use std::ops::Range;

/// Share of a flight in contact above which sensor and motion contradict each other.
const CONTRADICTION: f64 = 0.5;

/// What one sensor says at the frames of the motion.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactSensor {
    /// Name, as in the log.
    pub name: String,
    /// True in contact; frames without a value are false.
    pub touching: Vec<bool>,
}

impl ContactSensor {
    fn in_contact(&self, frames: Range<usize>) -> usize {
        frames.filter(|f| self.touching.get(*f).copied().unwrap_or(false)).count()
    }

    fn contradicts(&self, flight: &Flight) -> bool {
        self.in_contact(flight.frames()) as f64 > CONTRADICTION * flight.n_frames() as f64
    }
}

/// Cuts what the sensors call contact out of the flights; pieces shorter than `min_duration_s` are
/// no flights. A sensor that says contact during more than half of a flight, in which the body
/// falls freely by its motion, is wrong: it is named in a warning and not used. Mean accelerations
/// stay those of the flights as they were found.
pub fn bounded_by_contact(report: FlightReport, sensors: &[ContactSensor], min_duration_s: f64) -> FlightReport {
    let mut out = report;
    let mut used: Vec<&ContactSensor> = Vec::new();
    for sensor in sensors {
        let wrong = out.flights.iter().filter(|f| sensor.contradicts(f)).count();
        if wrong > 0 {
            let flights = out.flights.len();
            out.warnings.push(FlightWarning::ContactInFlight { sensor: sensor.name.clone(), wrong, flights });
        } else {
            used.push(sensor);
        }
    }
    let touching = |f: usize| used.iter().any(|s| s.touching.get(f).copied().unwrap_or(false));
    let mut flights = Vec::new();
    for flight in std::mem::take(&mut out.flights) {
        for free in flight.frames().collect::<Vec<_>>().chunk_by(|a, b| touching(*a) == touching(*b)) {
            let (start, end) = (free[0], free[free.len() - 1] + 1);
            if touching(start) {
                continue;
            }
            let piece = Flight {
                start,
                end,
                takeoff_source: if start > flight.start { EdgeSource::Contact } else { flight.takeoff_source },
                landing_source: if end < flight.end { EdgeSource::Contact } else { flight.landing_source },
                ..flight.clone()
            };
            if piece == flight || piece.duration_s(out.rate_hz) >= min_duration_s {
                flights.push(piece);
            } else {
                out.rejected.push(Rejected { start, end, reason: RejectionReason::TooShort });
            }
        }
    }
    out.flights = flights;
    out.rejected.sort_by_key(|r| (r.start, r.end));
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FlightSource;

    fn report(flights: &[(usize, usize)]) -> FlightReport {
        let of = |r: &(usize, usize)| Flight {
            start: r.0,
            end: r.1,
            source: FlightSource::Motion,
            takeoff_source: EdgeSource::Motion,
            landing_source: EdgeSource::Motion,
            mean_acceleration_mps2: [0.0, 0.0, -9.8],
        };
        FlightReport { rate_hz: 100.0, flights: flights.iter().map(of).collect(), ..FlightReport::default() }
    }

    fn sensor(name: &str, contact: &[(usize, usize)]) -> ContactSensor {
        let touching = (0..300).map(|f| contact.iter().any(|c| (c.0..c.1).contains(&f))).collect();
        ContactSensor { name: name.to_owned(), touching }
    }

    fn edges(report: &FlightReport) -> Vec<(usize, usize)> {
        report.flights.iter().map(|f| (f.start, f.end)).collect()
    }

    #[test]
    fn contact_cuts_the_edges_and_the_middle_of_flights() {
        let left = sensor("contact_l_foot", &[(0, 54), (95, 150), (148, 160)]);
        let right = sensor("contact_r_foot", &[(0, 50), (190, 193)]);
        let found = bounded_by_contact(report(&[(50, 100), (160, 220)]), &[left, right], 0.12);
        assert_eq!(edges(&found), [(54, 95), (160, 190), (193, 220)]);
        let sources: Vec<_> = found.flights.iter().map(|f| (f.takeoff_source, f.landing_source)).collect();
        assert_eq!(sources[0], (EdgeSource::Contact, EdgeSource::Contact));
        assert_eq!(sources[1], (EdgeSource::Motion, EdgeSource::Contact));
        assert!(found.warnings.is_empty());
    }

    #[test]
    fn short_pieces_are_no_flights() {
        let found = bounded_by_contact(report(&[(50, 100)]), &[sensor("a", &[(60, 62)])], 0.12);
        assert_eq!(edges(&found), [(62, 100)]);
        assert_eq!((found.rejected[0].start, found.rejected[0].end), (50, 60));
    }

    #[test]
    fn a_sensor_that_is_always_on_is_named_once_and_not_used() {
        let stuck = sensor("contact_l_foot", &[(0, 300)]);
        let found = bounded_by_contact(
            report(&[(50, 100), (160, 220)]),
            &[stuck, sensor("contact_r_foot", &[(97, 160)])],
            0.12,
        );
        assert_eq!(edges(&found), [(50, 97), (160, 220)]);
        assert_eq!(found.warnings.len(), 1);
        let words = found.warnings[0].to_string();
        assert!(words.contains("`contact_l_foot`") && words.contains("2 of 2 flights"), "{words}");
    }
}

//! Body mass from the impulse of the force plates between two flights, beside the stated mass.

use crate::kinematics::KinematicsRow;
use aloft_flight::ImpulseMass;
use aloft_identify::half95;
use aloft_signal::mean_and_deviation;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::workspace::Workspace;
use serde::Serialize;

/// Body mass from the impulse of the force plates between flights, compared with the stated mass.
#[derive(Debug, Clone, Serialize)]
pub struct ImpulseMassView {
    /// Mean over contacts, kg.
    pub mass_kg: f64,
    /// 95 % interval of the mean, kg; none for one contact.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ci95: Option<[f64; 2]>,
    /// Smallest and largest, kg.
    pub range_kg: [f64; 2],
    /// Contacts between two flights.
    pub contacts: usize,
    /// Stated mass, kg.
    pub stated_kg: f64,
    /// What to check if the two masses disagree.
    pub doubt: Option<String>,
    /// What to correct first, where the two differ so much that no other number of the comparison
    /// can be trusted although bodies fall freely in flight.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wrong: Option<String>,
}

/// Mean of the masses that single contacts between two flights gave, half of its 95 % interval
/// (none for one contact), and their number.
pub(crate) fn mass_by_impulse(masses: &[f64]) -> Option<(f64, Option<f64>, usize)> {
    /// Velocities of a table's centre of mass, 95 %, common to all contacts.
    const COMMON: f64 = 0.01;
    let (value, deviation) = mean_and_deviation(masses)?;
    let n = masses.len();
    let half = half95(deviation / (n as f64).sqrt(), (n - 1) as f64).filter(|h| h.is_finite());
    Some((value, half.map(|h| h.hypot(COMMON * value)), n))
}

/// Relative difference between the two masses above which they are doubted.
const MASS_DOUBT: f64 = 0.02;
/// Relative difference above which nothing else of the comparison is trusted.
const MASS_WRONG: f64 = 0.1;
/// Deviation from free fall in flight below which nothing carries the body, percent of g.
const FREE_FALL_PERCENT: f64 = 5.0;

/// Mass from impulse over all trials with plates and at least two flights; `rows` are those of
/// [`crate::kinematics`].
///
/// # Errors
/// A result of the stage `flight` exists and cannot be read.
pub fn impulse_mass(
    session: &SubjectSession,
    ws: &Workspace,
    rows: &[KinematicsRow],
) -> Result<Option<ImpulseMassView>, PipelineError> {
    let mut masses: Vec<f64> = Vec::new();
    for t in session.included().filter(|t| t.role.is_dynamic()) {
        let path = ws.place("flight", &t.name).join("impulse_mass.json");
        let own: Option<Vec<ImpulseMass>> = read_json_if_there(&path)?;
        masses.extend(own.into_iter().flatten().map(|m| m.mass_kg));
    }
    Ok(of_masses(session, masses, rows))
}

fn of_masses(session: &SubjectSession, mut masses: Vec<f64>, rows: &[KinematicsRow]) -> Option<ImpulseMassView> {
    let (mass_kg, half, contacts) = mass_by_impulse(&masses)?;
    masses.sort_by(f64::total_cmp);
    let (first, last) = (*masses.first()?, *masses.last()?);
    let stated_kg = session.facts.person.mass_kg;
    let off = mass_kg / stated_kg - 1.0;
    // effects of the model act on the impulse, too, and may account for the difference
    let doubt = (masses.len() >= 3 && off.abs() > MASS_DOUBT && session.effects.is_empty()).then(|| {
        format!(
            "{:+.1} % of the stated {stated_kg:.2} kg: the stated mass, the plates' gain or their tare at rest is wrong, a \
             foot was beside the plates, or something else holds the body",
            100.0 * off
        )
    });
    // what carries the body shows in flight as well; a wrong mass or gain does not
    let mut falls: Vec<f64> = rows.iter().filter_map(|k| k.gravity_error_percent).map(f64::abs).collect();
    let free = !falls.is_empty() && aloft_signal::median(&mut falls) < FREE_FALL_PERCENT;
    let wrong = (contacts >= 2 && off.abs() > MASS_WRONG && free && session.effects.is_empty()).then(|| {
        format!(
            "the force plates give a body mass of {mass_kg:.1} kg and {stated_kg:.1} kg is stated: correct `mass_kg` (or the plates' scale), then run again"
        )
    });
    let ci95 = half.map(|h| [mass_kg - h, mass_kg + h]);
    Some(ImpulseMassView { mass_kg, ci95, range_kg: [first, last], contacts, stated_kg, doubt, wrong })
}

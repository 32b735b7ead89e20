//! `audit`: whether an OpenSim model balances with its own motion, in flight and on plates.
//!
//! In flight the motion of all bodies together needs no force but gravity, on plates just the
//! measured one, whatever the joints and muscles do. The model's masses, its scaled geometry and
//! the coordinates that its inverse kinematics gave are judged together by what is left over.

use aloft_body::subject::PriorSd;
use aloft_body::{BaseParameters, ModelMarker, Motion, PersonFacts, Subject};
use aloft_compare::{Body, Candidate, CompareOptions, Noise, SegmentShare, TrialInput, compare, measured_wrench};
use aloft_filter::smooth;
use aloft_flight::{FlightOptions, TareSource, coverage, find_flights, tare};
use aloft_pipeline::recording::read_file;
use aloft_pipeline::stages::filter::low_pass;
use aloft_robot::osim::OsimModel;
use aloft_study::config::FilterConfig;
use aloft_trial::mot::Table;
use aloft_trial::{ImportOptions, Trial, UpAxis};
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A recording for an audit.
#[derive(Debug, Clone)]
pub struct AuditTrial {
    /// Coordinates that inverse kinematics gave (MOT or STO).
    pub motion: PathBuf,
    /// Markers (TRC).
    pub markers: PathBuf,
    /// Ground reactions (MOT); none leaves contact out.
    pub forces: Option<PathBuf>,
}

/// Result of an audit.
#[derive(Debug, Clone, Serialize)]
pub struct Audit {
    /// Version of this structure.
    pub version: u32,
    /// Model file.
    pub file: String,
    /// Mass of all bodies, kg.
    pub mass_kg: f64,
    /// Every body with its mass.
    pub bodies: Vec<AuditBody>,
    /// Coordinates that the motion does not state; they are at their defaults.
    pub at_default: Vec<String>,
    /// Every recording.
    pub trials: Vec<AuditedTrial>,
    /// Root mean square error over weak windows in flight, N (moment over a lever of 0.1 m); none
    /// without flights.
    pub flight_error_n: Option<f64>,
    /// The same in contact that the plates measure completely.
    pub contact_error_n: Option<f64>,
    /// Link by link: the share of the error in contact that a change of this body's inertia alone
    /// would take away (in flight where there is no contact).
    pub segments: Vec<SegmentShare>,
    /// Mass that the plates carry for this motion, kg: median over recordings; none without
    /// contact.
    pub plates_mass_kg: Option<f64>,
    /// What stands out, in words.
    pub words: Vec<String>,
}

/// One body of the model.
#[derive(Debug, Clone, Serialize)]
pub struct AuditBody {
    /// Name.
    pub name: String,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Smallest eigenvalue of the second moments of mass, kg·m²; below zero no body with positive
    /// density has this inertia.
    pub least_second_moment_kgm2: f64,
}

/// One recording.
#[derive(Debug, Clone, Serialize)]
pub struct AuditedTrial {
    /// Name.
    pub trial: String,
    /// Root mean square distance between recorded markers and those of the model, mm.
    pub marker_rms_mm: Option<f64>,
    /// Flights.
    pub flights: usize,
    /// Acceleration of the model's centre of mass in flight over gravity.
    pub fall_over_gravity: Option<f64>,
    /// Error in flight, N.
    pub flight_error_n: Option<f64>,
    /// Error in contact, N.
    pub contact_error_n: Option<f64>,
    /// Time in contact that the plates measure completely, s.
    pub contact_s: f64,
    /// Mean load of the plates over the load that the motion requires with the model's mass.
    pub load_ratio: Option<f64>,
}

/// Everything of one recording that the comparison borrows.
struct Prepared {
    motion: Motion,
    filtered: Motion,
    measured: Option<aloft_compare::Measured>,
    flights: Vec<Range<usize>>,
    complete: Vec<bool>,
    untared: bool,
    report: AuditedTrial,
}

/// Matches files by the name of the markers' file, of which the others begin with the name.
///
/// # Errors
/// A motion for which no markers were given.
pub fn matched(motion: &[PathBuf], markers: &[PathBuf], forces: &[PathBuf]) -> Result<Vec<AuditTrial>, PipelineError> {
    let stem = |p: &PathBuf| aloft_study::recordings::stem_of(p);
    // the longest name decides: `walk1` and `walk10`
    let own = |name: &str, of: &PathBuf| {
        let other = stem(of);
        let rest = other.strip_prefix(name);
        rest.is_some_and(|r| !r.starts_with(|c: char| c.is_ascii_digit()))
    };
    motion
        .iter()
        .map(|m| {
            let found = markers.iter().filter(|t| own(&stem(t), m)).max_by_key(|t| stem(t).len());
            let markers = found.cloned().ok_or_else(|| {
                PipelineError::request_hint(
                    format!("{}: no markers of this recording among those given", m.display()),
                    "`DJ1_ik.mot` belongs to `DJ1.trc`: give it under --markers, or leave the motion out",
                )
            })?;
            let forces = forces.iter().find(|f| own(&stem(&markers), f)).cloned();
            Ok(AuditTrial { motion: m.clone(), markers, forces })
        })
        .collect()
}

fn text(path: &Path) -> Result<String, PipelineError> {
    input::lossy(path)
}

/// Audits a model with the motion of some recordings.
///
/// # Errors
/// Files that cannot be read; a model with parts that are not supported; a motion without the
/// model's coordinates or with other times than the markers.
pub fn audit(file: &Path, trials: &[AuditTrial]) -> Result<Audit, PipelineError> {
    let shown = file.display().to_string();
    let wrong = |e: &dyn std::fmt::Display| PipelineError::request(e.to_string());
    let osim = OsimModel::parse(&shown, &text(file)?).map_err(|e| {
        PipelineError::request_hint(
            e.to_string(),
            "models of OpenSim 4 with pins, balls, sliders, welds and custom joints are read",
        )
    })?;
    let subject = subject_of(&osim);
    let base = BaseParameters::of(&osim.model);
    let phi = subject.prior_phi();
    let mut at_default = Vec::new();
    let prepared: Vec<Prepared> =
        trials.iter().map(|t| prepare(&osim, &subject, t, &mut at_default)).collect::<Result<_, PipelineError>>()?;
    let inputs: Vec<TrialInput<'_>> = prepared
        .iter()
        .map(|p| TrialInput {
            unfiltered: Some(&p.motion),
            measured: p.measured.as_ref(),
            complete: Some(&p.complete),
            untared: p.untared,
            ..TrialInput::new(&p.filtered, &p.flights)
        })
        .collect();
    let body = Body { model: &osim.model, base: &base, prior: &phi };
    let options = CompareOptions { noise_draws: 0, mass_kg: None, ..CompareOptions::default() };
    let candidate = Candidate::links("model", &base, &phi);
    let (found, _) = compare(&body, &[candidate], &inputs, Noise::Unknown, &options).map_err(|e| wrong(&e))?;
    let size = |w: &aloft_compare::WindowErrors| (w.windows > 0).then(|| w.size());
    let first = &found.first;
    let mut reports: Vec<AuditedTrial> = prepared.into_iter().map(|p| p.report).collect();
    for report in &mut reports {
        if let Some(own) = first.trials.iter().find(|t| t.trial == report.trial) {
            (report.flight_error_n, report.contact_error_n) = (size(&own.flight_weak), size(&own.contact_weak));
        }
    }
    let mut ratios: Vec<f64> = reports.iter().filter_map(|r| r.load_ratio).collect();
    let plates_mass_kg = (!ratios.is_empty()).then(|| aloft_signal::median(&mut ratios) * osim.mass_kg());
    let bodies = bodies_of(&osim);
    let sliders = |s: &SegmentShare| osim.inertias_of(&s.link).is_some_and(|i| i.mass_kg > 0.0);
    let mut audit = Audit {
        version: 1,
        file: shown,
        mass_kg: osim.mass_kg(),
        bodies,
        at_default,
        flight_error_n: size(&first.flight_weak),
        contact_error_n: size(&first.held_out_weak),
        segments: first.segments.iter().filter(|s| sliders(s)).cloned().collect(),
        plates_mass_kg,
        trials: reports,
        words: Vec::new(),
    };
    audit.words = sentences(&audit);
    Ok(audit)
}

fn subject_of(osim: &OsimModel) -> Subject {
    let markers = osim.markers.iter().map(|m| ModelMarker {
        label: m.name.clone(),
        link: m.link,
        position_m: m.position_m,
        weight: 1.0,
    });
    Subject {
        facts: PersonFacts { name: osim.name.clone(), sex: None, height_m: None, mass_kg: osim.mass_kg() },
        markers: markers.collect(),
        prior: osim.inertias.clone(),
        prior_sd: vec![PriorSd { mass_rel: 0.1, com_m: 0.01, radius_rel: 0.1, together: 0.0 }; osim.inertias.len()],
        static_q: osim.model.neutral(),
        provenance: Vec::new(),
        model: osim.model.clone(),
        estimated: None,
        boxes: Vec::new(),
    }
}

fn bodies_of(osim: &OsimModel) -> Vec<AuditBody> {
    let links = osim.model.links.iter().zip(&osim.inertias).filter(|(_, i)| i.mass_kg > 0.0);
    links
        .map(|(link, i)| {
            let second = nalgebra::Matrix3::identity() * (0.5 * i.inertia_com_kgm2.trace()) - i.inertia_com_kgm2;
            AuditBody {
                name: link.name.clone(),
                mass_kg: i.mass_kg,
                least_second_moment_kgm2: second.symmetric_eigenvalues().min(),
            }
        })
        .collect()
}

/// Reads one recording and puts the model through its motion.
fn prepare(
    osim: &OsimModel,
    subject: &Subject,
    files: &AuditTrial,
    at_default: &mut Vec<String>,
) -> Result<Prepared, PipelineError> {
    let name = aloft_study::recordings::stem_of(&files.markers);
    let options = ImportOptions { up_axis: Some(UpAxis::Y), ..ImportOptions::default() };
    let mut trial = read_file(&name, &files.markers, files.forces.as_deref(), &options)
        .map_err(|f| PipelineError::Request { problem: f.problem, hint: f.hint })?;
    let motion = motion_of(osim, &trial, &files.motion, at_default)?;
    let wrong = |e: &dyn std::fmt::Display| PipelineError::request(format!("{name}: {e}"));
    let phi = subject.prior_phi();
    let report =
        find_flights(&trial, Some((&osim.model, &phi, &motion)), &FlightOptions::default()).map_err(|e| wrong(&e))?;
    let tares = tare(&mut trial, &report.flights);
    let threshold_n = FlightOptions::default().threshold_n;
    let covered = coverage(&trial, subject, &motion, &report.flights, threshold_n).map_err(|e| wrong(&e))?;
    let filter = low_pass(&FilterConfig::default());
    let filtered = smooth(&osim.model, &motion, Some(filter)).map_err(|e| wrong(&e))?;
    let (rate_hz, n) = (motion.rate_hz, motion.n_frames());
    let measured = if trial.plates.is_empty() {
        None
    } else {
        Some(measured_wrench(&name, &trial.plates, rate_hz, n, Some(filter)).map_err(|e| wrong(&e))?)
    };
    let flights: Vec<Range<usize>> = report.flights.iter().map(aloft_flight::Flight::frames).collect();
    let mut complete = covered.mask();
    complete.resize(n, false);
    flights.iter().for_each(|f| complete[f.start.min(n)..f.end.min(n)].fill(true));
    Ok(Prepared {
        report: AuditedTrial {
            trial: name.clone(),
            marker_rms_mm: marker_rms_mm(subject, &trial, &motion),
            flights: flights.len(),
            fall_over_gravity: report.free_fall.as_ref().and_then(|f| f.ratio),
            flight_error_n: None,
            contact_error_n: None,
            contact_s: covered.complete_s(),
            load_ratio: covered.load_ratio,
        },
        untared: measured.is_some() && tares.iter().any(|t| t.source == TareSource::None),
        motion,
        filtered,
        measured,
        flights,
        complete,
    })
}

/// The motion of the model's bodies at the frames of the markers.
fn motion_of(
    osim: &OsimModel,
    trial: &Trial,
    file: &Path,
    at_default: &mut Vec<String>,
) -> Result<Motion, PipelineError> {
    let table = Table::from_mot(&file.display().to_string(), &text(file)?)
        .map_err(|e| PipelineError::request(e.to_string()))?;
    let says = |key: &str| {
        table.header.iter().find_map(|l| {
            let (k, v) = l.split_once('=')?;
            k.trim().eq_ignore_ascii_case(key).then(|| v.trim().to_lowercase())
        })
    };
    let degrees = says("inDegrees").is_some_and(|v| v == "yes" || v == "true");
    // columns are names of coordinates, or paths such as /jointset/hip_r/hip_flexion_r/value
    let column = |coordinate: &str| {
        table.labels.iter().position(|l| {
            l == coordinate || l.strip_suffix("/value").is_some_and(|p| p.rsplit('/').next() == Some(coordinate))
        })
    };
    let columns: Vec<(&str, bool, usize)> =
        osim.coordinates.iter().filter_map(|(c, angle)| Some((c.as_str(), *angle, column(c)?))).collect();
    if columns.is_empty() {
        return Err(PipelineError::request_hint(
            format!("{}: no column is a coordinate of the model", file.display()),
            format!(
                "expected {}",
                osim.coordinates.iter().take(6).map(|c| c.0.as_str()).collect::<Vec<_>>().join(", ")
            ),
        ));
    }
    for (c, _) in &osim.coordinates {
        if column(c).is_none() && !at_default.contains(c) {
            at_default.push(c.clone());
        }
    }
    let times = table.columns.first().map_or(&[][..], Vec::as_slice);
    let (rate_hz, n) = (trial.markers.rate_hz, trial.markers.n_frames);
    let turned = UnitQuaternion::from_rotation_matrix(&trial.world_from_source);
    let mut q = Vec::with_capacity(n * osim.model.nq);
    let mut met = 0;
    for frame in 0..n {
        let t = trial.start_s + frame as f64 / rate_hz;
        let row = times.partition_point(|x| *x < t - 0.5 / rate_hz);
        match times.get(row).filter(|x| (**x - t).abs() <= 0.5 / rate_hz) {
            Some(_) => {
                met += 1;
                let value = |angle: bool, i: usize| {
                    let v = table.columns[i][row];
                    if angle && degrees { v.to_radians() } else { v }
                };
                let values: BTreeMap<String, f64> =
                    columns.iter().map(|(c, angle, i)| ((*c).to_owned(), value(*angle, *i))).collect();
                q.extend(osim.posture(&values, &turned));
            }
            None => q.extend(std::iter::repeat_n(f64::NAN, osim.model.nq)),
        }
    }
    if 2 * met < n {
        return Err(PipelineError::request_hint(
            format!("{}: only {met} of the {n} frames of {} have a row", file.display(), trial.name),
            "give the markers and the motion of the same recording",
        ));
    }
    Ok(Motion {
        trial: trial.name.clone(),
        rate_hz,
        nq: osim.model.nq,
        nv: osim.model.nv,
        q,
        v: Vec::new(),
        a: Vec::new(),
        marker_labels: Vec::new(),
        residual_m: Vec::new(),
        q_sd: Vec::new(),
    })
}

/// Distance between recorded markers and those of the model, mm.
fn marker_rms_mm(subject: &Subject, trial: &Trial, motion: &Motion) -> Option<f64> {
    let mut state = aloft_body::State::new(&subject.model);
    let index: Vec<Option<usize>> = subject.markers.iter().map(|m| trial.markers.index(&m.label)).collect();
    let (mut sum, mut n) = (0.0, 0.0);
    for frame in 0..motion.n_frames().min(trial.markers.n_frames) {
        if !motion.is_valid(frame) {
            continue;
        }
        state.forward_position(&subject.model, motion.q(frame));
        for (marker, i) in subject.markers.iter().zip(&index) {
            let Some(seen) = i.and_then(|i| trial.markers.position(i, frame)) else { continue };
            let at: Vector3<f64> = state.point_in_world(marker.link, &marker.position_m);
            sum += (at - seen).norm_squared();
            n += 1.0;
        }
    }
    (n > 0.0).then(|| 1e3 * f64::sqrt(sum / n))
}

/// Share of body weight that an error in contact exceeds where a model does not balance.
const LARGE: f64 = 0.05;

fn sentences(a: &Audit) -> Vec<String> {
    let weight_n = a.mass_kg * aloft_body::STANDARD_GRAVITY_MPS2;
    let mut out = Vec::new();
    for (error, place) in [(a.flight_error_n, "in flight"), (a.contact_error_n, "on the plates")] {
        if let Some(e) = error {
            let share = 100.0 * e / weight_n;
            let verdict = if e > LARGE * weight_n { "does not balance" } else { "balances within 5 % of its weight" };
            out.push(format!("{place} the model {verdict}: {e:.1} N over windows, {share:.1} % of its weight"));
        }
    }
    if let Some(m) = a.plates_mass_kg
        && (m / a.mass_kg - 1.0).abs() > 0.03
    {
        out.push(format!(
            "the model has {:.1} kg, and the plates carry {m:.1} kg for this motion ({:+.0} %): its mass, or the gain of all plates",
            a.mass_kg,
            100.0 * (m / a.mass_kg - 1.0)
        ));
    }
    let falls: Vec<f64> = a.trials.iter().filter_map(|t| t.fall_over_gravity).collect();
    if !falls.is_empty() {
        let mean = falls.iter().sum::<f64>() / falls.len() as f64;
        if (mean - 1.0).abs() > 0.03 {
            out.push(format!(
                "its centre of mass falls with {mean:.3} g: masses of segments against each other, geometry, or the coordinates"
            ));
        }
    }
    for b in a.bodies.iter().filter(|b| b.least_second_moment_kgm2 < -1e-9) {
        out.push(format!("no body of positive density has the inertia of `{}`", b.name));
    }
    if !a.at_default.is_empty() {
        out.push(format!("not in the motion, so at their defaults: {}", a.at_default.join(", ")));
    }
    out
}

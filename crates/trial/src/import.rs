//! Imports C3D, or TRC with MOT, as a [`Trial`] in SI units and the world frame.

use crate::frozen::frozen_to_missing;
use crate::limits::leave_out_stuck;
use crate::mot::{first_time_s, read_ground_reactions};
use crate::options::{disambiguate, require_content, to_world};
use crate::people;
use crate::possible::{is_not_seen, require_possible};
use crate::recorded;
use crate::segments::add_segments;
use crate::trc::read_trc;
use crate::{ComputedPoint, Event, ImportOptions, Markers, Plate, Trial, TrialError, UpAxis, Warning, WarningKind};
use aloft_c3d::{C3dFile, PointKind, is_unlabelled, metres_per, split_subject, strip_subject};
use nalgebra::Vector3;
use std::borrow::Cow;
use std::collections::BTreeSet;

impl Trial {
    /// Reads a C3D file from memory. `name` is the trial's name (the file's stem).
    ///
    /// Lengths become metres, plates become wrenches on the subject about the world origin, and
    /// events count seconds from the first frame. Unlabelled points (`*12`) are dropped; repeated
    /// labels are kept and numbered. Irregularities are listed in `warnings`.
    ///
    /// # Errors
    /// The bytes are not C3D, or contain no frames, no labelled marker, or no usable rate or unit.
    pub fn from_c3d(name: &str, bytes: &[u8], options: &ImportOptions) -> Result<Self, TrialError> {
        if bytes.is_empty() {
            return Err(TrialError::EmptyFile { trial: name.to_owned() });
        }
        let file = C3dFile::from_bytes(bytes)
            .map_err(|e| TrialError::Unreadable { trial: name.to_owned(), problem: e.to_string() })?;
        Self::from_c3d_file(name, &file, options)
    }

    /// As [`Trial::from_c3d`], from a file already parsed.
    ///
    /// # Errors
    /// No frames, no labelled marker, no usable rate or unit.
    pub fn from_c3d_file(name: &str, file: &C3dFile, options: &ImportOptions) -> Result<Self, TrialError> {
        let trial = Self::contents_of_c3d(name, file, options)?;
        require_content(&trial, || format!("{} points, none of them a labelled marker", file.points.len()))?;
        people::require_one(&trial)?;
        Ok(trial)
    }

    /// What a C3D file holds, also where that is no motion: plates or channels without any marker.
    /// For looking at a file; [`Trial::from_c3d_file`] is for using it.
    ///
    /// # Errors
    /// Points in a unit that is not a length; no rate.
    pub fn contents_of_c3d(name: &str, file: &C3dFile, options: &ImportOptions) -> Result<Self, TrialError> {
        let file = &*with_rate(file, options.rate_hz);
        if file.point_rate_hz == 0.0 {
            return Err(TrialError::Rate { trial: name.to_owned(), place: "C3D", found: 0.0 });
        }
        let mut trial = Self { name: name.to_owned(), ..Self::default() };
        if let Some(rate) = options.rate_hz {
            trial.warn(
                WarningKind::Clock,
                format!("the rate is {rate} Hz, as the pipeline states (`import: {{rate_hz: …}}`)"),
            );
        }
        trial.warnings.extend(file.warnings.iter().cloned().map(aloft_c3d::Warning::with_kind));
        read_points(&mut trial, file, options)?;
        read_plates(&mut trial, file, options);
        leave_out_stuck(&mut trial);
        read_events(&mut trial, file);
        trial.recorded = recorded::of_c3d(file);
        trial.start_s = (f64::from(file.first_frame) - 1.0).max(0.0) / file.point_rate_hz;
        require_possible(&trial)?;
        frozen_to_missing(&mut trial);
        let screen = file.groups.get("POINT", "Y_SCREEN").and_then(|p| p.string());
        to_world(&mut trial, options, screen.as_deref().and_then(UpAxis::parse), UpAxis::Z);
        correct_reaction_sign(&mut trial);
        Ok(trial)
    }

    /// Plates of a MOT or STO text without the markers that belong to them; none where its columns
    /// are something else. For looking at a file.
    ///
    /// # Errors
    /// Malformed line (the error names it).
    pub fn contents_of_mot(name: &str, text: &str, options: &ImportOptions) -> Result<Self, TrialError> {
        let mut trial = Self { name: name.to_owned(), ..Self::default() };
        let start_s = first_time_s(name, text)?;
        trial.start_s = start_s;
        read_ground_reactions(&mut trial, text, start_s, options)?;
        leave_out_stuck(&mut trial);
        require_possible(&trial)?;
        to_world(&mut trial, options, None, UpAxis::Y);
        Ok(trial)
    }

    /// Reads TRC markers and, where given, ground reactions from MOT or STO text.
    ///
    /// # Errors
    /// Malformed line (the error names it), or no frames or markers.
    pub fn from_trc_mot(
        name: &str,
        trc_text: &str,
        mot_text: Option<&str>,
        options: &ImportOptions,
    ) -> Result<Self, TrialError> {
        let trial = Self::contents_of_trc_mot(name, trc_text, mot_text, options)?;
        people::require_one(&trial)?;
        Ok(trial)
    }

    /// What a TRC file and its forces hold, also where that is several people. For looking at a
    /// file; [`Trial::from_trc_mot`] is for using it.
    ///
    /// # Errors
    /// Malformed line (the error names it), or no frames or markers.
    pub fn contents_of_trc_mot(
        name: &str,
        trc_text: &str,
        mot_text: Option<&str>,
        options: &ImportOptions,
    ) -> Result<Self, TrialError> {
        if trc_text.trim().is_empty() {
            return Err(TrialError::EmptyFile { trial: name.to_owned() });
        }
        let mut trial = Self { name: name.to_owned(), ..Self::default() };
        let start_s = read_trc(&mut trial, trc_text, options)?;
        trial.markers.rate_hz = options.rate_hz.unwrap_or(trial.markers.rate_hz);
        require_content(&trial, || "no labels".to_owned())?;
        trial.start_s = start_s;
        trial.recorded = [Some(trc_text), mot_text].into_iter().flatten().find_map(recorded_in_header);
        if let Some(text) = mot_text {
            read_ground_reactions(&mut trial, text, start_s, options)?;
            leave_out_stuck(&mut trial);
        }
        require_possible(&trial)?;
        frozen_to_missing(&mut trial);
        to_world(&mut trial, options, None, UpAxis::Y);
        correct_reaction_sign(&mut trial);
        Ok(trial)
    }
}

/// The file with another rate of its points: its channels keep their samples a frame.
fn with_rate(file: &C3dFile, rate_hz: Option<f64>) -> Cow<'_, C3dFile> {
    let Some(rate_hz) = rate_hz.filter(|rate| *rate != file.point_rate_hz) else { return Cow::Borrowed(file) };
    let mut other = file.clone();
    // channels and poses keep their samples a frame
    let scaled = |rate: f64, a_frame: usize| match file.point_rate_hz {
        known if known > 0.0 => rate * rate_hz / known,
        _ => rate_hz * a_frame.max(1) as f64,
    };
    other.analog_rate_hz = scaled(file.analog_rate_hz, file.samples_per_frame());
    other.poses.rate_hz = scaled(file.poses.rate_hz, 1);
    other.point_rate_hz = rate_hz;
    Cow::Owned(other)
}

/// The date in the header of a TRC (a line of keys above a line of values) or MOT (`key=value`)
/// text.
fn recorded_in_header(text: &str) -> Option<recorded::RecordedAt> {
    let lines: Vec<&str> = text.lines().take(30).take_while(|l| !l.trim().eq_ignore_ascii_case("endheader")).collect();
    let mut pairs: Vec<(String, String)> = lines
        .iter()
        .filter_map(|l| l.split_once('='))
        .map(|(key, value)| (key.trim().to_owned(), value.trim().to_owned()))
        .collect();
    if let (Some(keys), Some(values)) = (lines.get(1), lines.get(2)) {
        let cells = |l: &str| l.split('\t').map(|c| c.trim().to_owned()).collect::<Vec<_>>();
        pairs.extend(cells(keys).into_iter().zip(cells(values)));
    }
    recorded::of_pairs(&pairs, "header")
}

/// Reads markers (metres) and computed points (unit of the source), in source axes.
fn read_points(trial: &mut Trial, file: &C3dFile, options: &ImportOptions) -> Result<(), TrialError> {
    let metres = length_unit(trial, file, options)?;
    let markers: Vec<usize> = (0..file.points.len()).filter(|&i| file.points[i].kind == PointKind::Marker).collect();
    let use_descriptions = options.full_names && labels_were_cut(file, &markers);
    if use_descriptions {
        trial.warn(
            WarningKind::Labels,
            "labels are cut to four characters and repeat: full names taken from POINT:DESCRIPTIONS",
        );
    }
    let stored_label = |index: usize| {
        let point = &file.points[index];
        if use_descriptions { point.description.trim() } else { point.label.trim() }
    };
    let (named, unlabelled): (Vec<usize>, Vec<usize>) =
        markers.iter().partition(|&&i| !is_unlabelled(split_subject(stored_label(i)).0));
    let stored: Vec<String> = named.iter().map(|&i| stored_label(i).to_owned()).collect();
    let chosen = people::choose(&stored, options.strip_prefix, &options.people, &people::stated_people(file));
    let mut labels = Vec::new();
    let mut tracks = Vec::new();
    for (&index, label) in named.iter().zip(&chosen.labels) {
        let Some(label) = label else { continue };
        let point = &file.points[index];
        labels.push(label.clone());
        tracks.push(
            point
                .xyz
                .iter()
                .map(|stored| {
                    let [x, y, z] = stored.map(f64::from);
                    let p = Vector3::new(x, y, z) * metres;
                    if p.iter().all(|x| x.is_finite()) && !is_not_seen(stored) { p } else { Vector3::repeat(f64::NAN) }
                })
                .collect::<Vec<_>>(),
        );
    }
    if !unlabelled.is_empty() {
        trial.warn(WarningKind::Labels, format!("{} unlabelled points (`*…`) left out", unlabelled.len()));
    }
    chosen.tell(trial);
    disambiguate(&mut labels, &mut trial.warnings);
    trial.markers = Markers {
        rate_hz: file.point_rate_hz,
        first_frame: file.first_frame,
        n_frames: file.n_frames,
        labels,
        trajectories: tracks,
    };
    for track in &mut trial.markers.trajectories {
        track.resize(file.n_frames, Vector3::repeat(f64::NAN));
    }
    add_segments(trial, file, metres);
    warn_of_scale(trial);

    for point in file.points.iter().filter(|p| p.kind != PointKind::Marker) {
        trial.computed.push(ComputedPoint {
            label: strip_subject(&point.label).to_owned(),
            kind: point.kind,
            unit: computed_unit(file, point.kind),
            values: point.xyz.iter().map(|p| Vector3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]))).collect(),
        });
    }
    Ok(())
}

/// Unit of a kind of computed point: POINT:ANGLE_UNITS etc. where present, otherwise the unit that
/// common programs write.
fn computed_unit(file: &C3dFile, kind: PointKind) -> String {
    let (parameter, habit) = match kind {
        PointKind::Angle => ("ANGLE_UNITS", "deg"),
        PointKind::Force => ("FORCE_UNITS", "N"),
        PointKind::Moment => ("MOMENT_UNITS", "Nmm"),
        PointKind::Power => ("POWER_UNITS", "W"),
        PointKind::Scalar | PointKind::Marker => ("SCALAR_UNITS", ""),
    };
    if let Some(stated) = file.groups.get("POINT", parameter).and_then(|p| p.string())
        && !stated.is_empty()
    {
        return stated;
    }
    habit.to_owned()
}

/// Metres per unit of the markers; a file without a unit is read as millimetres.
fn length_unit(trial: &mut Trial, file: &C3dFile, options: &ImportOptions) -> Result<f64, TrialError> {
    let stated = options.point_unit.as_deref().unwrap_or(&file.point_unit).trim();
    if let Some(metres) = metres_per(stated) {
        return Ok(metres);
    }
    if file.points.is_empty() && file.poses.segments.is_empty() {
        return Ok(1e-3);
    }
    if !stated.is_empty() {
        return Err(TrialError::Unit { trial: trial.name.clone(), place: "POINT:UNITS", found: stated.to_owned() });
    }
    trial.warn(WarningKind::Missing, "POINT:UNITS is not stated: read as mm");
    Ok(1e-3)
}

/// Warns if the extent of all markers is implausibly small or large.
fn warn_of_scale(trial: &mut Trial) {
    let mut low = Vector3::repeat(f64::INFINITY);
    let mut high = Vector3::repeat(f64::NEG_INFINITY);
    for p in trial.markers.trajectories.iter().flatten().filter(|p| p.iter().all(|x| x.is_finite())) {
        low = low.inf(p);
        high = high.sup(p);
    }
    let size = (high - low).norm();
    if size.is_finite() && trial.markers.labels.len() > 1 && !(0.02..200.0).contains(&size) {
        trial.warn(
            WarningKind::Units,
            format!(
                "all markers lie within {size:.4} m: the unit of the source is probably wrong; hint: state `point_unit`"
            ),
        );
    }
}

/// True when labels of at most four characters repeat while all descriptions are present and
/// different.
fn labels_were_cut(file: &C3dFile, markers: &[usize]) -> bool {
    let mut labels = BTreeSet::new();
    let mut descriptions = BTreeSet::new();
    let mut repeats = false;
    for &index in markers {
        let point = &file.points[index];
        let (label, description) = (point.label.trim(), point.description.trim());
        if label.starts_with('*') {
            continue;
        }
        if label.chars().count() > 4 || description.is_empty() || !descriptions.insert(description) {
            return false;
        }
        repeats |= !labels.insert(label);
    }
    repeats
}

/// Reads plates as wrenches in SI units and source axes.
fn read_plates(trial: &mut Trial, file: &C3dFile, options: &ImportOptions) {
    // A corrected unit also applies to corners and moment arms.
    let corrected = options.point_unit.as_ref().filter(|unit| **unit != file.point_unit).map(|unit| {
        let mut copy = file.clone();
        copy.point_unit.clone_from(unit);
        copy
    });
    let file = corrected.as_ref().unwrap_or(file);
    for (index, description) in file.plates.iter().enumerate() {
        let wrench = match file.plate_wrench(index) {
            Ok(wrench) => wrench,
            Err(problem) => {
                trial.warn(WarningKind::Plates, format!("{problem}; plate {} is left out", index + 1));
                continue;
            }
        };
        trial.warnings.extend(wrench.warnings.iter().cloned().map(aloft_c3d::Warning::with_kind));
        let metres = file.metres_per_point_unit().unwrap_or(1e-3);
        let corners_m: Vec<_> = description.corners.iter().map(|c| Vector3::new(c[0], c[1], c[2]) * metres).collect();
        let known = corners_m.iter().any(|c| c.norm() > 0.0);
        if !known {
            trial.warn(
                WarningKind::Plates,
                format!("plate {}: corners are all zero; its place is taken as the origin", index + 1),
            );
        }
        trial.plates.push(Plate {
            name: format!("FP{}", index + 1),
            rate_hz: file.analog_rate_hz,
            corners_m: if known { corners_m } else { Vec::new() },
            force_n: wrench.force_n.iter().map(|f| Vector3::from(*f)).collect(),
            moment_nm: wrench.moment_nm.iter().map(|m| Vector3::from(*m)).collect(),
        });
    }
}

/// Reads events, in seconds since the first frame of this recording; events outside it are kept
/// with a warning.
fn read_events(trial: &mut Trial, file: &C3dFile) {
    let start_s = (f64::from(file.first_frame) - 1.0).max(0.0) / file.point_rate_hz;
    let length_s = file.n_frames as f64 / file.point_rate_hz;
    let mut outside = 0;
    for event in &file.events {
        let time_s = event.time_s - start_s;
        outside += usize::from(!(-0.5 / file.point_rate_hz..=length_s).contains(&time_s));
        // Some files keep the name in the context and leave the label empty.
        let (label, context) = match (event.label.trim(), event.context.trim()) {
            ("", context) => (context, ""),
            pair => pair,
        };
        trial.events.push(Event { label: label.to_owned(), context: context.to_owned(), time_s });
    }
    trial.events.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    if outside > 0 {
        trial.warn(WarningKind::Events, format!("{outside} events lie outside of the recording"));
    }
}

/// Ensures that the reaction on the subject points up. A plate whose loaded samples point down
/// stores the action on the plate; it is inverted, with a warning.
fn correct_reaction_sign(trial: &mut Trial) {
    for plate in &mut trial.plates {
        let strongest = plate.force_n.iter().map(|f| f.z.abs()).filter(|z| z.is_finite()).fold(0.0, f64::max);
        if strongest < 50.0 {
            continue;
        }
        let loaded: f64 =
            plate.force_n.iter().map(|f| f.z).filter(|z| z.is_finite() && z.abs() > 0.3 * strongest).sum();
        if loaded < 0.0 {
            for vector in plate.force_n.iter_mut().chain(&mut plate.moment_nm) {
                *vector = -*vector;
            }
            let message = format!(
                "plate `{}` pushes the subject down: the source stores the action on the plate; \
                 all its forces and moments are turned",
                plate.name
            );
            trial.warnings.push(Warning::new(WarningKind::Plates, message));
        }
    }
}

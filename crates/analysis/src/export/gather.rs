//! Converts the results in a workspace into the input of the export formats.

use crate::compare::compare_if_made;
use crate::parameters::parameters;
use aloft_body::{LinkInertia, Subject};
use aloft_compare::{Grade, measured_wrench};
use aloft_export::{
    Convention, FileCoordinates, InertiaSource, LinkKnown, OsimFile, PlateAtFrames, RobotFile, SourceFile,
    SubjectExport, TrialExport, with_half,
};
use aloft_flight::{Flight, FlightReport, PlateTare, apply_tare};
use aloft_identify::half_of;
use aloft_pipeline::selection::trial_filter;
use aloft_pipeline::stages::STAGES;
use aloft_pipeline::stages::filter::low_pass;
use aloft_pipeline::stages::osim::COORDINATES;
use aloft_robot::osim::RigidTree;
use aloft_study::commands::command;
use aloft_study::subject_session::{SubjectSession, TrialEntry};
use aloft_workspace::artifact::{load_motion, load_trial};
use aloft_workspace::disk::is_there;
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use aloft_workspace::json::{read_json, read_json_if_there};
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::table::Table;
use aloft_workspace::workspace::Workspace;

/// Program and version, for headers.
pub fn program() -> String {
    format!("aloft {}", env!("CARGO_PKG_VERSION"))
}

/// The subject with the best inertial parameters available.
pub(super) fn subject(
    session: &SubjectSession,
    ws: &Workspace,
    convention: Convention,
) -> Result<SubjectExport, PipelineError> {
    let place = ws.place("calibrate", WHOLE_STUDY).join("subject.json");
    let subject: Subject = read_json_if_there(&place)?.ok_or_else(|| {
        PipelineError::request_hint(
            format!("there is no model in {} yet", session.workspace.display()),
            format!("run `{}` first", command(session, "run", None)),
        )
    })?;
    let (links, known, source) = inertias(session, &subject)?;
    let locked = read_json(&ws.place("scale", WHOLE_STUDY).join("locked.json"))?;
    let mut made = SubjectExport::new(subject, links, source, convention, locked, &program())
        .map_err(|e| PipelineError::request(e.to_string()))?;
    made.known = known;
    made.robot_files = robot_files(session, &made.source)?;
    made.osim_file = osim_file(session, &made)?;
    made.of_study = [session.id.subject.clone(), session.id.session.clone()];
    Ok(made)
}

/// The model files of a robot with the comment that says how their inertials were made.
fn robot_files(session: &SubjectSession, source: &InertiaSource) -> Result<Vec<RobotFile>, PipelineError> {
    let Some(robot) = &session.robot else { return Ok(Vec::new()) };
    let provenance = provenance(session, source)?;
    robot
        .files
        .iter()
        .map(|path| {
            let text = input::text(path)?;
            let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            let model =
                aloft_robot::RobotModel::parse(&name, &text).map_err(|e| PipelineError::request(e.to_string()))?;
            Ok(RobotFile { name, text, model, provenance: provenance.clone() })
        })
        .collect()
}

/// The imported OpenSim model with the tree that the results were made with.
fn osim_file(session: &SubjectSession, made: &SubjectExport) -> Result<Option<OsimFile>, PipelineError> {
    let Some(osim) = &session.osim else { return Ok(None) };
    let bytes = input::bytes(&osim.path)?;
    let seen: Vec<String> = made.subject.markers.iter().map(|m| m.label.clone()).collect();
    let tree = RigidTree::of(&osim.model, Some(&seen)).map_err(|e| PipelineError::request(e.to_string()))?;
    Ok(Some(OsimFile {
        name: osim.name.clone(),
        text: String::from_utf8_lossy(&bytes).into_owned(),
        model: osim.model.clone(),
        scale: made.subject.facts.mass_kg / tree.mass_kg(),
        tree,
        provenance: provenance(session, &made.source)?,
    }))
}

/// Values of the imported model's coordinates in a recording.
fn file_coordinates(
    session: &SubjectSession,
    ws: &Workspace,
    name: &str,
) -> Result<Option<FileCoordinates>, PipelineError> {
    let place = ws.place("ik", name).join(COORDINATES);
    let Some(osim) = &session.osim else { return Ok(None) };
    if !is_there(&place)? {
        return Ok(None);
    }
    let table = Table::read(&place)?;
    let names = table.names().to_vec();
    let angle = |name: &String| osim.model.all_coordinates().iter().any(|c| c.name == *name && c.in_degrees);
    let is_angle = names.iter().map(angle).collect();
    let values = table.rows(0, names.len());
    Ok(Some(FileCoordinates { names, is_angle, values }))
}

/// How inertias were identified, for a comment in a model file.
fn provenance(session: &SubjectSession, source: &InertiaSource) -> Result<String, PipelineError> {
    let mut provenance = format!("Inertials identified by {} from motion in flight.\n", program());
    if let InertiaSource::Identified { rows, remarks, .. } = source {
        let found = parameters(session, None)?;
        let p = &found.parameters;
        provenance += &format!(
            "     {} in {} recordings, {rows} rows, total mass {} kg from a scale, prior: the same file.\n     \
             Each link: mass in kg and centre of mass in m, with half widths of 95 % intervals.\n",
            p.stretches(),
            p.n_trials,
            p.mass_kg
        );
        for remark in remarks {
            provenance += &format!("     CAUTION: {remark}.\n");
        }
        for link in &p.links {
            let com: Vec<String> = (0..3).map(|k| with_half(link.com_m[k], half_of(link.ci95.com_m[k]))).collect();
            provenance += &format!(
                "     {}: {} kg at {}{}\n",
                link.name,
                with_half(link.mass_kg, half_of(link.ci95.mass_kg)),
                com.join(", "),
                Some(link.from.from_table())
                    .filter(|v| !v.is_empty())
                    .map_or(String::new(), |v| format!("; near the prior: {v}"))
            );
        }
    }
    Ok(provenance)
}

/// Inertias of the links, how well each is known, and where they come from.
///
/// # Errors
/// Parameters or a comparison are there and cannot be read: those of tables would stand in their
/// place.
fn inertias(
    session: &SubjectSession,
    subject: &Subject,
) -> Result<(Vec<LinkInertia>, Vec<LinkKnown>, InertiaSource), PipelineError> {
    let prior = |reason: String| Ok((subject.prior.clone(), Vec::new(), InertiaSource::Prior { reason }));
    let found = match parameters(session, None) {
        Ok(found) => found,
        // its words say why nothing was identified
        Err(PipelineError::Request { problem, .. }) => return prior(problem),
        Err(e) => return Err(e),
    };
    let gate = &found.parameters.gate;
    if !gate.passed {
        return prior(format!("the identification was not accepted ({})", gate.reasons.join("; ")));
    }
    if found.parameters.links.len() != subject.model.n_links() {
        return prior("the identification gave base parameters but no links".to_owned());
    }
    let errors = compare_if_made(session)?.map(|v| v.errors).unwrap_or_default();
    let in_flight = errors.iter().find(|e| e.judged_on == "flight");
    if let Some((own_n, tables_n)) = in_flight.and_then(|e| Some((e.held_out_error, e.tables_error?)))
        && own_n >= tables_n
    {
        return prior(format!(
            "on held-out flights the identified body errs by {own_n:.3} N, no less than the one that it was to replace, {tables_n:.3} N"
        ));
    }
    let poor = errors.iter().filter(|e| e.grade == Grade::Poor).filter_map(|e| {
        let times = e.times_floor?;
        let why = match e.because {
            Some(_) => "the recordings have to be corrected first (`aloft run` says what)",
            None => "something is missing from the model and may bias the inertias (`aloft discover`)",
        };
        Some(format!(
            "the held-out error in {} is {} times its noise floor, {}: {why}",
            e.judged_on,
            aloft_compare::significant(times, 2),
            e.judged
        ))
    });
    let poor: Vec<String> = poor.collect();
    let links = found.parameters.links.iter().map(aloft_identify::LinkEstimate::inertia).collect();
    let named = |l: &aloft_identify::LinkEstimate| {
        Some(l.from.from_table()).filter(|values| !values.is_empty()).map(|values| format!("{}: {values}", l.name))
    };
    let from_table = found.parameters.links.iter().filter_map(named).collect();
    let (rows, remarks) = (found.rows_used.to_owned(), [poor, gate.reasons.clone()].concat());
    let known = found.parameters.links.iter().map(|l| LinkKnown {
        mass_kg: half_of(l.ci95.mass_kg),
        com_m: l.ci95.com_m.map(half_of),
        from: l.from.describe(),
    });
    let intervals = found.parameters.intervals_hold().to_owned();
    Ok((links, known.collect(), InertiaSource::Identified { rows, remarks, from_table, intervals }))
}

/// Trials to export.
pub(super) fn entries<'s>(
    session: &'s SubjectSession,
    patterns: &[String],
) -> Result<Vec<&'s TrialEntry>, PipelineError> {
    let filter = trial_filter(&[session], patterns)?;
    Ok(session.included().filter(|t| filter.as_ref().is_none_or(|f| f.is_match(&t.name))).collect())
}

/// Data of one trial, or the reason why it cannot be exported.
pub(super) fn trial(
    session: &SubjectSession,
    ws: &Workspace,
    subject: &SubjectExport,
    entry: &TrialEntry,
) -> Result<Result<TrialExport, String>, PipelineError> {
    let name = &entry.name;
    let is_ok = |stage: &str| Ok::<_, PipelineError>(ws.usable(stage, name)?.is_some());
    if !is_ok("import")? {
        return Ok(Err("it was not imported; see `aloft status`".to_owned()));
    }
    let mut trial = load_trial(&ws.place("import", name))?;
    let motion = |stage: &str| is_ok(stage)?.then(|| load_motion(&ws.place(stage, name))).transpose();
    let (solved, filtered) = (motion("ik")?, motion("filter")?);
    let solved_ok = solved.is_some();
    let mut flights = Vec::new();
    if is_ok("flight")? {
        let folder = ws.place("flight", name);
        let tares: Vec<PlateTare> = read_json(&folder.join("tare.json"))?;
        apply_tare(&mut trial, &tares);
        let report: FlightReport = read_json(&folder.join("flights.json"))?;
        flights = report.flights.iter().map(Flight::frames).collect();
    }
    let (rate_hz, n_frames) = (trial.markers.rate_hz, trial.markers.n_frames);
    let mut plates = Vec::new();
    for plate in &trial.plates {
        match measured_wrench(
            name,
            std::slice::from_ref(plate),
            rate_hz,
            n_frames,
            Some(low_pass(&session.config.filter)),
        ) {
            Ok(measured) => plates.push(PlateAtFrames { name: plate.name.clone(), wrench: measured.filtered }),
            Err(e) => return Ok(Err(e.to_string())),
        }
    }
    let is_c3d = entry.file.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d"));
    let c3d = if is_c3d { Some(input::bytes(&entry.file)?) } else { None };
    let file = entry.file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let mut out = TrialExport {
        name: name.clone(),
        role: entry.role.word().to_owned(),
        trial,
        motion: solved,
        filtered,
        flights,
        plates,
        source: SourceFile { name: file, c3d },
        file_coordinates: if solved_ok { file_coordinates(session, ws, name)? } else { None },
        solved: None,
        smooth: None,
        forces: None,
    };
    Ok(out.prepare(subject).map(|()| out).map_err(|e| e.to_string()))
}

/// Remarks for readers of a trial's files.
pub(super) fn trial_remarks(subject: &SubjectExport, trial: &TrialExport) -> Vec<String> {
    let mut out = Vec::new();
    let Some(series) = &trial.smooth else { return out };
    for (joint, frames) in &series.near_gimbal_lock {
        let link = &subject.subject.model.links[*joint].name;
        out.push(format!(
            "{}: {frames} of {} frames of `{link}` are nearer than 5° to gimbal lock: its angles are right, their rates and forces mean little there \
             (`orientation` in the tables has no such places)",
            trial.name, series.n_frames
        ));
    }
    let missing = (0..series.n_frames).filter(|f| series.values.get(f * series.n).is_none_or(|v| v.is_nan())).count();
    if missing > 0 {
        out.push(format!("{}: {missing} of {} frames could not be solved (NaN)", trial.name, series.n_frames));
    }
    out
}

/// Hash of everything that the exported files are made from.
pub(super) fn state(session: &SubjectSession, ws: &Workspace, convention: Convention) -> Result<String, PipelineError> {
    let mut hasher = blake3::Hasher::new();
    let mut add = |text: &str| {
        hasher.update(&(text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    };
    add(&program());
    add(convention.word());
    add(&session.config_text);
    for stage in STAGES {
        for task in stage.tasks(session) {
            let name = task.map_or(WHOLE_STUDY, |t| &t.name);
            add(stage.name);
            add(name);
            add(&ws.output(stage.name, name)?);
        }
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// Recordings with their hashes, relative to the data folder.
pub(super) fn recordings(session: &SubjectSession, ws: &Workspace) -> Result<Vec<(String, String)>, PipelineError> {
    let mut out = Vec::new();
    for path in session.included().flat_map(|t| std::iter::once(&t.file).chain(&t.forces)) {
        let relative = path.strip_prefix(&session.data).unwrap_or(path);
        let name = relative.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect::<Vec<_>>();
        // a recording that is gone has no results to export
        let hash = if is_there(path)? { ws.input_hash(path)? } else { "unreadable".to_owned() };
        out.push((name.join("/"), hash));
    }
    Ok(out)
}

/// Stages with their version and the pipeline section of the same name.
pub(super) fn stages(session: &SubjectSession, ws: &Workspace) -> Result<Vec<(String, u32, String)>, PipelineError> {
    // none: every configuration can be written
    let sections = serde_json::to_value(&session.config).ok().unwrap_or_default();
    STAGES
        .iter()
        .filter_map(|stage| {
            let ran = stage
                .tasks(session)
                .into_iter()
                .find_map(|t| ws.manifest(stage.name, t.map_or(WHOLE_STUDY, |t| &t.name)).transpose());
            let parameters = sections.get(stage.name).map(ToString::to_string).unwrap_or_else(|| "{}".to_owned());
            ran.map(|m| Ok((stage.name.to_owned(), m?.version, parameters)))
        })
        .collect()
}

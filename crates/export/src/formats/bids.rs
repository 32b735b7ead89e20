//! BIDS-Motion, as a derived data set:
//! `BIDS/sub-…/motion/sub-…_task-…_tracksys-optical_…_motion.tsv` without header, its columns named
//! in `_channels.tsv`, rates and counts in `_motion.json`, flights and the recording's own events
//! in `_events.tsv`.
//!
//! Trailing digits of a trial's name become the run (`jump01`: task jump, run 01). BIDS labels
//! contain only letters and digits; characters dropped from a name are encoded after `desc-aloft`
//! (`throws_01`: task throws, run 01, `desc-aloft6u`: byte 6 was `_`; `d` for `-`, `p` for `.`, `s`
//! for a blank, `x` with two hexadecimal digits for others), so that no two recordings share a
//! name. Missing values are `n/a`. BIDS has no force plates, so forces are of type MISC, and so are
//! translations along joints, which are no positions of points.

use crate::channels::{Channel, channels};
use crate::number::fixed;
use crate::{ExportError, Format, OutFile, SubjectExport, TrialExport, names};
use aloft_body::Sex;
use serde_json::{Value, json};

/// The format.
pub static FORMAT: Format = Format {
    name: "bids",
    title: "BIDS-Motion derivative: motion, channels, events, participants",
    readers: "BIDS tools, MNE, FieldTrip, pandas",
    trial: Some(write),
    subject: Some(write_dataset),
};

fn pretty(value: &Value) -> String {
    format!("{value:#}\n")
}

/// Label of the subject: its unique name in the study if there are several subjects.
fn label(subject: &SubjectExport) -> String {
    match &subject.of_study[0] {
        Some(name) => names::bids(name.strip_prefix("sub-").unwrap_or(name)),
        None => {
            let plain = names::alphanumeric(subject.id.strip_prefix("sub-").unwrap_or(&subject.id));
            if plain.is_empty() { "01".to_owned() } else { plain }
        }
    }
}

/// `task-jump` and the common beginning of the files, with `run-01`, for `jump01`.
fn entities(subject: &SubjectExport, trial: &TrialExport) -> (String, String) {
    let stem = trial.name.trim_end_matches(|c: char| c.is_ascii_digit());
    let run = &trial.name[stem.len()..];
    let task = names::alphanumeric(if stem.is_empty() { &trial.name } else { stem });
    // no other name with the same dropped bytes has the task `0`
    let task = if task.is_empty() { "0".to_owned() } else { task };
    let sub = label(subject);
    let run = if run.is_empty() || stem.is_empty() { String::new() } else { format!("_run-{run}") };
    let ses = subject.of_study[1].as_ref().map(|s| names::bids(s.strip_prefix("ses-").unwrap_or(s)));
    let (folder, of) = ses.map_or_else(
        || (format!("sub-{sub}"), format!("sub-{sub}")),
        |ses| (format!("sub-{sub}/ses-{ses}"), format!("sub-{sub}_ses-{ses}")),
    );
    let lost = names::dropped(&trial.name);
    let (task, run, lost) = if task.len() + run.len() + lost.len() > 80 {
        (task[..task.len().min(20)].to_owned(), String::new(), names::hashed(&trial.name))
    } else {
        (task, run, lost)
    };
    let base = format!("BIDS/{folder}/motion/{of}_task-{task}_tracksys-optical{run}_desc-aloft{lost}");
    (task, base)
}

fn write_dataset(subject: &SubjectExport) -> Result<Vec<OutFile>, ExportError> {
    let (name, version) = subject.program.split_once(' ').unwrap_or((&subject.program, ""));
    let description = json!({
        "Name": format!("Motion and mass properties of {}", subject.id),
        "BIDSVersion": "1.9.0",
        "DatasetType": "derivative",
        "GeneratedBy": [{"Name": name, "Version": version}],
    });
    let facts = &subject.subject.facts;
    let sex = match facts.sex {
        Some(Sex::Female) => "F",
        Some(Sex::Male) => "M",
        None => "n/a",
    };
    let height = facts.height_m.map_or("n/a".to_owned(), |h| fixed(h, 4));
    let participants = format!(
        "participant_id\tsex\theight\tmass\nsub-{}\t{sex}\t{height}\t{}\n",
        label(subject),
        fixed(facts.mass_kg, 4)
    );
    let columns = json!({
        "sex": {"Description": "sex", "Levels": {"F": "female", "M": "male"}},
        "height": {"Description": "stature", "Units": "m"},
        "mass": {"Description": "body mass from a scale", "Units": "kg"},
    });
    let readme = "Motion-BIDS derivative: cleaned markers, joint angles, forces. Columns of each _motion.tsv are the rows of its _channels.tsv.\n";
    let file = |path: &str, text: String, what: &str| OutFile::text(format!("BIDS/{path}"), text, what);
    Ok(vec![
        file("dataset_description.json", pretty(&description), "what the BIDS data set is"),
        file("participants.tsv", participants, "the subject"),
        file("participants.json", pretty(&columns), "columns of participants.tsv"),
        file("README", readme.to_owned(), "what the BIDS data set holds"),
    ])
}

/// Type and placement of a channel in BIDS; none for series that BIDS-Motion does not support.
fn kind(channel: &Channel) -> Option<&'static str> {
    Some(match channel.quantity {
        "marker" | "joint_centre" | "centre_of_mass" | "centre_of_pressure" => "POS",
        "orientation" => "ORNT",
        // a translation along a joint is no position of a point
        "coordinate" if channel.unit == "m" => "MISC",
        "coordinate" => "JNTANG",
        "ground_force" | "ground_moment" => "MISC",
        _ => return None,
    })
}

fn write(subject: &SubjectExport, trial: &TrialExport) -> Result<Vec<OutFile>, ExportError> {
    let (task, base) = entities(subject, trial);
    let all: Vec<Channel> = channels(subject, trial).into_iter().filter(|c| kind(c).is_some()).collect();
    let mut table = "name\tcomponent\ttype\ttracked_point\tunits\treference_frame\n".to_owned();
    for c in &all {
        let component = match (c.quantity, c.axis) {
            ("orientation", axis) => format!("quat_{axis}"),
            (_, "") => "n/a".to_owned(),
            (_, axis) => axis.to_owned(),
        };
        let axis = if c.axis.is_empty() { String::new() } else { format!("_{}", c.axis) };
        let units = if c.unit == "1" { "n/a" } else { c.unit };
        let frame = if c.quantity == "coordinate" { "joint" } else { "laboratory" };
        let name = format!("{}_{}{axis}", c.quantity, names::label(&c.name));
        let kind = kind(c).unwrap_or("MISC");
        table.push_str(&format!("{name}\t{component}\t{kind}\t{}\t{units}\t{frame}\n", names::label(&c.name)));
    }
    let mut motion = String::new();
    for f in 0..trial.n_frames() {
        for (k, c) in all.iter().enumerate() {
            if k > 0 {
                motion.push('\t');
            }
            motion.push_str(&if c.values[f].is_finite() { fixed(c.values[f], 7) } else { "n/a".to_owned() });
        }
        motion.push('\n');
    }
    let count = |of: &str| all.iter().filter(|c| kind(c) == Some(of)).count();
    let points: std::collections::BTreeSet<&str> = all.iter().map(|c| c.name.as_str()).collect();
    let about = json!({
        "TaskName": task,
        "SamplingFrequency": trial.rate_hz(),
        "SamplingFrequencyEffective": trial.rate_hz(),
        "TrackingSystemName": "optical",
        "SoftwareVersions": subject.program,
        "MotionChannelCount": all.len(),
        "TrackedPointsCount": points.len(),
        "POSChannelCount": count("POS"),
        "ORNTChannelCount": count("ORNT"),
        "JNTANGChannelCount": count("JNTANG"),
        "MISCChannelCount": count("MISC"),
        "RecordingDuration": trial.n_frames() as f64 / trial.rate_hz(),
        "Sources": [trial.source.name],
    });
    let frames = json!({"reference_frame": {
        "Description": "frames in which channels are given",
        "Levels": {
            "laboratory": {
                "SpatialAxes": "n/a",
                "RotationRule": "right-hand",
                "RotationOrder": "n/a",
                "Description": "right-handed laboratory axes of the recording, Z up; orientations are quaternions of a link in its parent (the root: in the laboratory)",
            },
            "joint": {
                "SpatialAxes": "ASR",
                "RotationRule": "right-hand",
                "RotationOrder": "see the table of coordinates in the export's README",
                "Description": format!("turns about axes of the moving link (x forward, y up, z right), convention `{}`", subject.coordinates.convention.word()),
            },
        },
    }});
    let mut events = "onset\tduration\ttrial_type\n".to_owned();
    let mut rows: Vec<(f64, f64, String)> = trial
        .flights
        .iter()
        .map(|r| (trial.time_s(r.start), r.len() as f64 / trial.rate_hz(), "flight".to_owned()))
        .collect();
    rows.extend(trial.trial.events.iter().map(|e| {
        let words = format!("{} {}", e.context, e.label);
        (e.time_s, 0.0, words.trim().replace(['\t', '\n'], " "))
    }));
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (onset, duration, what) in rows {
        events.push_str(&format!("{}\t{}\t{what}\n", fixed(onset, 6), fixed(duration, 6)));
    }
    let t = &trial.name;
    Ok(vec![
        OutFile::text(format!("{base}_motion.tsv"), motion, format!("{} channels of {t}, no header", all.len())),
        OutFile::text(format!("{base}_motion.json"), pretty(&about), format!("rates and counts of {t}")),
        OutFile::text(format!("{base}_channels.tsv"), table, format!("columns of the motion table of {t}")),
        OutFile::text(format!("{base}_channels.json"), pretty(&frames), format!("reference frames of {t}")),
        OutFile::text(format!("{base}_events.tsv"), events, format!("flights and events of {t}")),
    ])
}

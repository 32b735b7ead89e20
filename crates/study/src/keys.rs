//! Keys of the files that a laboratory writes beside its recordings (`subject.yaml`, `object.yaml`,
//! `robot.yaml`): those that are read, and those that only describe the recordings for people.
//!
//! A key that resembles one that is read is refused: a misspelt one would count as not given, and
//! the result would be that of another body. So is every unknown key inside a mapping that is read,
//! such as `noise`. What else a laboratory notes beside them is its own business.

use crate::nearest::nearest;
use crate::place::error_at;
use aloft_workspace::error::PipelineError;
use serde_yaml::Value;

/// Keys of a mapping.
pub(crate) struct Keys {
    /// Keys whose values are used.
    pub read: &'static [&'static str],
    /// Keys that describe the recordings for people; their values are not used.
    pub told: &'static [&'static str],
    /// Keys of the mappings under some of them; `*` stands for every key.
    pub inside: &'static [(&'static str, &'static Keys)],
}

/// Keys that describe any recording or subject.
const COMMON: [&str; 33] = [
    "notes",
    "note",
    "comment",
    "comments",
    "remarks",
    "description",
    "id",
    "title",
    "date",
    "version",
    "source",
    "licence",
    "license",
    "doi",
    "authors",
    "laboratory",
    "operator",
    "group",
    "condition",
    "session",
    "subject",
    "software",
    "units",
    "marker_set",
    "static_extra_markers",
    "plates",
    "capture",
    "recordings",
    "files",
    "columns",
    "links",
    "task",
    "protocol",
];
/// Keys that describe a person.
const PERSON: [&str; 12] = [
    "age",
    "age_years",
    "birth_date",
    "birth_year",
    "dominant_leg",
    "dominant_hand",
    "dominant_side",
    "handedness",
    "footwear",
    "shoes",
    "clothing",
    "leg_length_m",
];
const LAB: [&str; 11] = [
    "up_axis",
    "forward_axis",
    "point_rate_hz",
    "analog_rate_hz",
    "name",
    "room",
    "system",
    "cameras",
    "units",
    "notes",
    "note",
];

const fn joined<const A: usize, const B: usize, const N: usize>(
    a: [&'static str; A],
    b: [&'static str; B],
) -> [&'static str; N] {
    let mut out = [""; N];
    let mut i = 0;
    while i < N {
        out[i] = if i < A { a[i] } else { b[i - A] };
        i += 1;
    }
    out
}
static TOLD_OF_PERSON: [&str; 45] = joined(COMMON, PERSON);
static TOLD: [&str; 35] = joined(COMMON, ["static_trial", "calibration_trials"]);
static TOLD_OF_ROBOT: [&str; 35] = joined(COMMON, ["total_mass_uncertainty_kg", "serial_number"]);

static OF_LAB: Keys = Keys { read: &["gravity"], told: &LAB, inside: &[] };

/// `subject.yaml`, and the laboratory's file of a subject.
pub(crate) static SUBJECT: Keys = Keys {
    read: &["name", "sex", "height_m", "mass_kg", "total_mass_kg", "gravity_m_s2", "gravity_mps2", "lab", "trials"],
    told: &TOLD_OF_PERSON,
    inside: &[("lab", &OF_LAB)],
};

/// `object.yaml`.
pub(crate) static OBJECT: Keys = Keys {
    read: &["name", "mass_kg", "total_mass_kg", "gravity_m_s2", "gravity_mps2", "lab", "trials"],
    told: &TOLD,
    inside: &[("lab", &OF_LAB)],
};

/// `robot.yaml`.
pub(crate) static ROBOT: Keys = Keys {
    read: &[
        "name",
        "mass_kg",
        "total_mass_kg",
        "gravity_m_s2",
        "gravity_mps2",
        "gravity_direction",
        "lab",
        "trials",
        "base_link",
        "joints",
        "model",
        "imu",
        "noise",
        "topics",
        "markers",
    ],
    told: &TOLD_OF_ROBOT,
    inside: &[
        ("lab", &OF_LAB),
        ("model", &Keys { read: &["urdf", "mjcf"], told: &["note", "notes"], inside: &[] }),
        (
            "imu",
            &Keys {
                read: &["link", "position_m", "rpy_rad"],
                told: &["axes", "note", "notes", "type", "name"],
                inside: &[],
            },
        ),
        (
            "noise",
            &Keys {
                read: &["position_m", "orientation_deg", "dq_rad_s", "torque_nm", "gyro_rad_s", "acc_m_s2"],
                told: &["note", "notes"],
                inside: &[],
            },
        ),
        (
            "markers",
            &Keys {
                read: &[],
                told: &[],
                inside: &[("*", &Keys { read: &["link", "position_m"], told: &["note", "notes"], inside: &[] })],
            },
        ),
    ],
};

/// Refuses a text of YAML with a key that is a slip of one that is read.
///
/// # Errors
/// The place of the first such key, with the name that was probably meant.
pub(crate) fn refuse_unknown(keys: &Keys, file: &str, text: &str, all: &Value) -> Result<(), PipelineError> {
    let Some((path, key, within)) = unknown(keys, all, &mut Vec::new()) else { return Ok(()) };
    let known: Vec<&str> = within.read.iter().chain(within.told).copied().collect();
    let near = nearest(&key, &known).first().map(|name| format!("did you mean `{name}`? "));
    let hint = format!(
        "{}read {} {}; describe a recording in words under `notes`",
        near.unwrap_or_default(),
        if within.read.len() == 1 { "is" } else { "are" },
        within.read.join(", ")
    );
    let whose = if path.is_empty() { String::new() } else { format!(" in `{}`", path.join(".")) };
    let at = place(text, &key).map(|at| (at, key.len()));
    Err(error_at(file, text, at, &format!("unknown key `{key}`{whose}"), Some(hint)))
}

/// The first key that is not known: the keys above it, itself, and what is known there.
fn unknown<'k>(keys: &'k Keys, value: &Value, path: &mut Vec<String>) -> Option<(Vec<String>, String, &'k Keys)> {
    for (key, inner) in value.as_mapping()? {
        let key = match key.as_str() {
            Some(key) => key.to_owned(),
            // none: what was read can be written
            None => serde_yaml::to_string(key).ok().unwrap_or_default().trim().to_owned(),
        };
        let own = keys.inside.iter().find(|(name, _)| *name == key || *name == "*").map(|(_, own)| *own);
        let is_known = own.is_some() || keys.read.contains(&key.as_str()) || keys.told.contains(&key.as_str());
        if !is_known && (!path.is_empty() || resembles(&key, keys.read)) {
            return Some((path.clone(), key, keys));
        }
        if let Some(own) = own {
            path.push(key);
            if let Some(found) = unknown(own, inner, path) {
                return Some(found);
            }
            path.pop();
        }
    }
    None
}

/// Whether a key is a slip of one that is read, or of its first words: `gravty` of `gravity_m_s2`.
fn resembles(key: &str, read: &[&str]) -> bool {
    let key = key.to_lowercase();
    let beginnings = |name: &str| -> Vec<String> {
        let ends = name.match_indices('_').map(|(at, _)| at).chain([name.len()]);
        ends.map(|end| name[..end].to_owned()).filter(|beginning| beginning.len() > 3).collect()
    };
    let near = |beginning: &String| {
        let slips = if beginning.len() > 5 { 2 } else { 1 };
        strsim::damerau_levenshtein(&key, beginning) <= slips
    };
    read.iter().flat_map(|name| beginnings(name)).any(|beginning| near(&beginning))
}

/// Byte of the first place at which a text has `key:`.
fn place(text: &str, key: &str) -> Option<usize> {
    let joins = |c: char| c.is_alphanumeric() || "_-".contains(c);
    text.match_indices(key).map(|(at, _)| at).find(|at| {
        let before = text[..*at].chars().next_back().is_some_and(joins);
        let rest = text[at + key.len()..].trim_start_matches(['"', '\'']).trim_start_matches(' ');
        !before && rest.starts_with(':')
    })
}

/// Refuses a column of a table of participants or sessions that is a slip of one that is read.
/// Other columns are the study's own business: BIDS allows any.
pub(crate) fn slip(column: &str, read: &[&'static str]) -> Option<&'static str> {
    let column = column.to_lowercase();
    let near = |known: &&&str| {
        let slips = if known.len() > 5 { 2 } else { 1 };
        known.len() > 3 && strsim::damerau_levenshtein(&column, known) <= slips
    };
    if read.contains(&column.as_str()) { None } else { read.iter().find(near).copied() }
}

//! Facts about the subject or object, from the pipeline or from the laboratory's files beside the
//! recordings.

use crate::config::{GRAVITY_MPS2, HEIGHT_M, MASS_KG, PipelineConfig, SubjectConfig};
use crate::keys;
use crate::opencap;
use crate::place::error_at_key;
use crate::place::{error_at, find};
use crate::quote;
use crate::ranges;
use crate::recordings::SessionId;
use aloft_body::{PersonFacts, Sex};
use aloft_trial::missing::is_missing;
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Facts about the subject or object, and the laboratory's gravity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Facts {
    /// Name, sex, height, mass.
    pub person: PersonFacts,
    /// Magnitude of gravity, m/s².
    pub gravity_mps2: f64,
    /// Source of each fact, for the report.
    pub sources: Vec<String>,
    /// Recordings in the order in which the laboratory lists them (`trials: [{file: …}, …]`),
    /// without extensions; empty if it does not.
    #[serde(default)]
    pub recordings: Vec<String>,
    /// The stated body mass, kg, where `corrections` replaces it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stated_mass_kg: Option<f64>,
}

impl Facts {
    /// Gravity in the world frame, m/s².
    pub fn gravity(&self) -> nalgebra::Vector3<f64> {
        nalgebra::Vector3::new(0.0, 0.0, -self.gravity_mps2)
    }
}

/// Masses that a person can have, kg: the heaviest whose mass is known had 635 kg. Objects and
/// robots may be lighter and heavier.
const PERSON_KG: [f64; 2] = [1.0, 650.0];

/// Refuses a mass that no person has: most often it is in another unit.
///
/// # Errors
/// A mass outside 1 to 650 kg.
pub(crate) fn check_person_kg(mass_kg: f64) -> Result<(), PipelineError> {
    if (PERSON_KG[0]..=PERSON_KG[1]).contains(&mass_kg) {
        return Ok(());
    }
    Err(PipelineError::request_hint(
        format!("a person of {mass_kg} kg, expected {} to {} kg", PERSON_KG[0], PERSON_KG[1]),
        "state the mass in kg; an object has `object: …` in its pipeline, a robot `robot: …`",
    ))
}

/// Places where facts may be stored.
#[derive(Debug)]
pub(crate) struct FactPlaces<'a> {
    /// Folder of the recordings.
    pub data: &'a Path,
    /// The subject's folder, in a study of several subjects.
    pub subject_folder: Option<&'a Path>,
    /// The whole study's folder.
    pub root: &'a Path,
    /// Subject and session.
    pub id: &'a SessionId,
    /// A model file that states the body's mass: its name and the mass, kg.
    pub model: Option<(&'a str, f64)>,
    /// The object's description: its name and the total mass that it states, kg.
    pub object: Option<(&'a str, f64)>,
}

/// What `subject.yaml` or `object.yaml` beside the recordings may say; further keys describe the
/// recordings ([`crate::keys`]). Ranges are those of the pipeline's settings of the same kind.
#[derive(Debug, Default, Clone, Deserialize, JsonSchema)]
struct FactsFile {
    name: Option<String>,
    sex: Option<String>,
    /// Stature, m.
    #[schemars(range(min = HEIGHT_M.0, max = HEIGHT_M.1))]
    height_m: Option<f64>,
    /// Mass from a scale, kg.
    #[schemars(range(min = MASS_KG.0, max = MASS_KG.1))]
    mass_kg: Option<f64>,
    /// Mass from a scale, kg.
    #[schemars(range(min = MASS_KG.0, max = MASS_KG.1))]
    total_mass_kg: Option<f64>,
    /// Magnitude of gravity, m/s².
    #[serde(alias = "gravity_mps2")]
    #[schemars(range(min = GRAVITY_MPS2.0, max = GRAVITY_MPS2.1))]
    gravity_m_s2: Option<f64>,
    lab: Option<LabFacts>,
    /// Recordings, as a list of names or of entries with `file`; any other shape is the
    /// laboratory's own account of the session.
    #[schemars(with = "serde_json::Value")]
    trials: Option<serde_yaml::Value>,
}

#[derive(Debug, Default, Clone, Deserialize, JsonSchema)]
struct LabFacts {
    /// Vector or magnitude, m/s²; checked where it is read.
    #[schemars(with = "serde_json::Value")]
    gravity: Option<serde_yaml::Value>,
}

impl LabFacts {
    /// Magnitude of gravity, m/s²; an error if it is not valid.
    fn gravity_mps2(&self) -> Result<Option<f64>, String> {
        use serde_yaml::Value;
        let number = |v: &Value| match v {
            Value::Number(n) => n.as_f64().filter(|x| x.is_finite()),
            _ => None,
        };
        let size = match &self.gravity {
            None | Some(Value::Null) => return Ok(None),
            Some(Value::Sequence(v)) if v.len() == 3 => {
                v.iter().map(number).collect::<Option<Vec<f64>>>().map(|g| g.iter().map(|x| x * x).sum::<f64>().sqrt())
            }
            Some(other) => number(other).map(f64::abs),
        };
        let (low, high) = GRAVITY_MPS2;
        match size {
            Some(g) if (low..=high).contains(&g) => Ok(Some(g)),
            // none: what was read can be written
            _ => Err(format!(
                "`lab.gravity` is {}, expected three numbers or one, of a magnitude from {low} to {high} m/s²",
                serde_yaml::to_string(&self.gravity).ok().unwrap_or_default().trim().replace('\n', " ")
            )),
        }
    }
}

impl FactsFile {
    /// Takes facts that are missing here from `other`.
    fn or(self, other: Self) -> Self {
        Self {
            name: self.name.or(other.name),
            sex: self.sex.or(other.sex),
            height_m: self.height_m.or(other.height_m),
            mass_kg: self.mass_kg.or(other.mass_kg),
            total_mass_kg: self.total_mass_kg.or(other.total_mass_kg),
            gravity_m_s2: self.gravity_m_s2.or(other.gravity_m_s2),
            lab: self.lab.or(other.lab),
            trials: self.trials.or(other.trials),
        }
    }
}

/// Facts from files beside the recordings, the nearest first: the session's file, its row in the
/// subject's `sessions.tsv`, the subject's file, the laboratory's file of that subject, its row in
/// `participants.tsv`.
fn beside(at: &FactPlaces<'_>) -> Result<(FactsFile, Vec<String>), PipelineError> {
    let mut found = Vec::new();
    found.extend(facts_file(at.data)?);
    if let (Some(folder), Some(subject)) = (at.subject_folder, &at.id.subject) {
        if let Some(session) = &at.id.session {
            for name in ["sessions.tsv".to_owned(), format!("{subject}_sessions.tsv")] {
                found.extend(row_of(&folder.join(&name), "session_id", session)?.map(|f| (f, name)));
            }
            found.extend(facts_file(folder)?);
        }
        for name in [format!("{subject}.yaml"), format!("subjects/{subject}.yaml")] {
            found.extend(one_file(&at.root.join(&name))?.map(|f| (f, name)));
        }
        let row = row_of(&at.root.join(PARTICIPANTS), "participant_id", subject)?;
        found.extend(row.map(|f| (f, PARTICIPANTS.to_owned())));
    } else if found.is_empty() {
        found.extend(participants(at.data)?.map(|f| (f, PARTICIPANTS.to_owned())));
        // the data folder is one subject's folder of a study
        if let (true, Ok(folder)) = (found.is_empty(), at.data.canonicalize())
            && let (Some(parent), Some(name)) = (folder.parent(), folder.file_name())
        {
            let row = row_of(&parent.join(PARTICIPANTS), "participant_id", &name.to_string_lossy())?;
            found.extend(row.map(|f| (f, PARTICIPANTS.to_owned())));
        }
    }
    if let (true, Some(path)) = (found.is_empty(), opencap::beside(at.data)) {
        let stated = opencap::read(&path)?;
        let facts = FactsFile {
            name: stated.name,
            sex: stated.sex.map(str::to_owned),
            height_m: stated.height_m,
            mass_kg: stated.mass_kg,
            ..FactsFile::default()
        };
        found.push((facts, opencap::METADATA.to_owned()));
    }
    let sources = found.iter().map(|f| f.1.clone()).collect();
    Ok((found.into_iter().fold(FactsFile::default(), |facts, (more, _)| facts.or(more)), sources))
}

/// The name of the subject that a file in this folder states; none where the file cannot be read,
/// which a run reports.
pub fn stated_name(folder: &Path) -> Option<String> {
    // none: opening the study reads the same file and names what is wrong
    facts_file(folder).ok()?.and_then(|(facts, _)| facts.name)
}

fn facts_file(folder: &Path) -> Result<Option<(FactsFile, String)>, PipelineError> {
    for name in ["subject.yaml", "subject.yml", "object.yaml", "object.yml", "robot.yaml", "robot.yml"] {
        if let Some(facts) = one_file(&folder.join(name))? {
            return Ok(Some((facts, name.to_owned())));
        }
    }
    Ok(None)
}

fn one_file(path: &Path) -> Result<Option<FactsFile>, PipelineError> {
    if !input::is_there(path) {
        return Ok(None);
    }
    let text = input::text(path)?;
    let name = path.display().to_string();
    let of_kind = match path.file_stem().and_then(|s| s.to_str()) {
        Some("robot") => &keys::ROBOT,
        Some("object") => &keys::OBJECT,
        _ => &keys::SUBJECT,
    };
    keys::refuse_unknown(of_kind, &name, &text, &ranges::parse_yaml(&name, &text)?)?;
    // `gravity_mps2`, the pipeline's name, has the same range as `gravity_m_s2`
    let facts: FactsFile = ranges::parse(&name, &text)?;
    let again = facts.gravity_m_s2.filter(|g| !(GRAVITY_MPS2.0..=GRAVITY_MPS2.1).contains(g));
    let (key, wrong) = match (facts.lab.as_ref().map(LabFacts::gravity_mps2), again) {
        (_, Some(g)) => (
            "gravity_mps2",
            Some(format!("`gravity_mps2` is {g}, expected a number from {} to {}", GRAVITY_MPS2.0, GRAVITY_MPS2.1)),
        ),
        (Some(Err(problem)), _) => ("lab.gravity", Some(problem)),
        _ => ("", None),
    };
    match wrong {
        Some(problem) => Err(error_at(&name, &text, find(&text, key).map(|at| (at, 1)), &problem, None)),
        None => Ok(Some(facts)),
    }
}

/// Finds the facts; an error if the mass is not known.
pub(crate) fn find_facts(
    config: &PipelineConfig,
    at: &FactPlaces<'_>,
    file: &str,
    text: &str,
) -> Result<Facts, PipelineError> {
    let (facts, mut sources) = beside(at)?;
    let s = &config.subject;
    if s != &SubjectConfig::default() {
        sources.push("the pipeline".to_owned());
    }
    // none: reading the facts has refused any other gravity
    let gravity_in_lab = facts.lab.as_ref().and_then(|l| l.gravity_mps2().ok().flatten());
    let stated = s.mass_kg.or(facts.mass_kg).or(facts.total_mass_kg);
    if let (None, Some((name, _))) = (stated, at.model) {
        sources.push(format!("{name} (body mass)"));
    }
    // a file beside the recordings is of this object, the description of objects of its kind
    let of_object = at.object.filter(|_| stated.is_none());
    if let Some((name, _)) = of_object {
        sources.push(format!("the object `{name}` (total mass)"));
    }
    let stated = stated.or(of_object.map(|o| o.1));
    // no scale knows more digits
    let of_model = at.model.map(|m| (100.0 * m.1).round() / 100.0);
    let mass_kg = stated.or(of_model).ok_or_else(|| {
        error_at_key(
            file,
            text,
            "subject",
            match &at.id.subject {
                None => "the body mass is not known: neither the pipeline nor a file beside the recordings states it".to_owned(),
                Some(s) => format!("the body mass of {s} is not known: neither participants.tsv nor a subject.yaml states it"),
            },
            Some(match &at.id.subject {
                None => "add `subject: {mass_kg: …}` to the pipeline, or put a subject.yaml with mass_kg beside the recordings"
                    .to_owned(),
                Some(s) => format!(
                    "give participants.tsv a column `mass` (kg), or put `mass_kg: …` into {}",
                    at.subject_folder.unwrap_or(at.root).join("subject.yaml").display()
                ) + &format!(
                    ", or add `overrides: [{{subject: {}, set: {{subject: {{mass_kg: …}}}}}}]`",
                    quote::yaml(&quote::pattern(s))
                ),
            }),
        )
    })?;
    let sex = match s.sex.clone().or(facts.sex).as_deref().map(str::to_ascii_lowercase).as_deref() {
        Some("f" | "female") => Some(Sex::Female),
        Some("m" | "male") => Some(Sex::Male),
        None => None,
        Some(word) if is_missing(word) => None,
        Some(other) => {
            return Err(error_at_key(file, text, "sex", format!("sex is `{other}`, expected F or M"), None));
        }
    };
    Ok(Facts {
        person: PersonFacts {
            name: s
                .name
                .clone()
                .or(facts.name)
                .or_else(|| at.id.subject.clone())
                .unwrap_or_else(|| config.name.clone()),
            sex,
            height_m: s.height_m.or(facts.height_m),
            mass_kg,
        },
        gravity_mps2: s
            .gravity_mps2
            .or(facts.gravity_m_s2)
            .or(gravity_in_lab)
            .unwrap_or(aloft_body::STANDARD_GRAVITY_MPS2),
        sources,
        recordings: facts.trials.as_ref().map(listed).unwrap_or_default(),
        stated_mass_kg: None,
    })
}

/// Names of recordings in a list, without extensions.
fn listed(trials: &serde_yaml::Value) -> Vec<String> {
    let name = |entry: &serde_yaml::Value| {
        let file = entry.as_str().or_else(|| entry.get("file")?.as_str())?;
        Some(crate::recordings::stem_of(Path::new(file)))
    };
    trials.as_sequence().map(|list| list.iter().filter_map(name).collect()).unwrap_or_default()
}

/// Name of the table of participants (BIDS).
pub const PARTICIPANTS: &str = "participants.tsv";

/// Columns that are read; others are the study's own business.
const READ_COLUMNS: [&str; 12] = [
    "participant_id",
    "session_id",
    "sex",
    "height",
    "height_m",
    "stature",
    "height_cm",
    "mass",
    "mass_kg",
    "weight",
    "weight_kg",
    "body_mass",
];

/// A table with tab-separated columns.
struct Tsv {
    path: PathBuf,
    header: Vec<String>,
    /// Rows with their line numbers in the file, counted from 1.
    rows: Vec<(usize, Vec<String>)>,
}

impl Tsv {
    fn read(path: &Path) -> Result<Option<Self>, PipelineError> {
        if !input::is_there(path) {
            return Ok(None);
        }
        let bytes = input::bytes(path)?;
        let text = String::from_utf8_lossy(&bytes);
        let cells = |l: &str| l.split('\t').map(|c| c.trim().trim_matches('"').to_owned()).collect::<Vec<String>>();
        let mut lines = text.trim_start_matches('\u{feff}').lines();
        let header = cells(lines.next().unwrap_or_default());
        let rows = lines.enumerate().filter(|(_, l)| !l.trim().is_empty()).map(|(i, l)| (i + 2, cells(l))).collect();
        Ok(Some(Self { path: path.to_path_buf(), header, rows }))
    }

    fn get<'t>(&self, row: &'t [String], names: &[&str]) -> Option<&'t str> {
        let column = self.header.iter().position(|h| names.contains(&h.to_ascii_lowercase().as_str()))?;
        // a participant may be called `na`
        let missing = |v: &str| match names {
            ["participant_id" | "session_id"] => v.is_empty() || v.eq_ignore_ascii_case("n/a"),
            _ => is_missing(v),
        };
        row.get(column).map(String::as_str).filter(|v| !missing(v))
    }

    fn row(&self, key: &str, name: &str) -> Option<&(usize, Vec<String>)> {
        self.rows.iter().find(|(_, r)| self.get(r, &[key]).is_some_and(|v| same_name(v, name)))
    }

    /// The number in the first of these columns that exists; `unit` gives the size of the unit for
    /// each value.
    fn number(
        &self,
        (line, row): &(usize, Vec<String>),
        names: &[&str],
        (low, high): (f64, f64),
        unit: impl Fn(f64) -> f64,
    ) -> Result<Option<f64>, PipelineError> {
        let Some(cell) = self.get(row, names) else { return Ok(None) };
        let number = cell.replace(',', ".").parse::<f64>().ok().map(|x| x * unit(x));
        match number.filter(|x| (low..=high).contains(x)) {
            Some(x) => Ok(Some(x)),
            None => Err(PipelineError::request_hint(
                format!(
                    "{}: line {line}: `{}` is `{cell}`, expected a number from {low} to {high} or n/a",
                    self.path.display(),
                    names.iter().find(|n| self.header.iter().any(|h| h.eq_ignore_ascii_case(n))).unwrap_or(&"value")
                ),
                "correct the table; stature in m (or cm, above 3), mass in kg",
            )),
        }
    }

    fn facts(&self, row: &(usize, Vec<String>), key: &str) -> Result<FactsFile, PipelineError> {
        for column in &self.header {
            if let Some(meant) = keys::slip(column, &READ_COLUMNS) {
                return Err(PipelineError::request_hint(
                    format!("{}: line 1: unknown column `{column}`", self.path.display()),
                    format!(
                        "did you mean `{meant}`? stature is read in m (or cm, above 3), mass in kg; rename the column if it is neither"
                    ),
                ));
            }
        }
        // values above 3 are centimetres
        let metres = |h: f64| if h > 3.0 { 0.01 } else { 1.0 };
        let height = match self.number(row, &["height", "height_m", "stature"], HEIGHT_M, metres)? {
            Some(height) => Some(height),
            None => self.number(row, &["height_cm"], HEIGHT_M, |_| 0.01)?,
        };
        Ok(FactsFile {
            name: (key == "participant_id").then(|| self.get(&row.1, &[key]).map(str::to_owned)).flatten(),
            sex: self.get(&row.1, &["sex"]).map(str::to_owned),
            height_m: height,
            mass_kg: self.number(row, &["mass", "mass_kg", "weight", "weight_kg", "body_mass"], MASS_KG, |_| 1.0)?,
            ..FactsFile::default()
        })
    }
}

/// True if two names denote the same subject: `sub-01` and `01` are equal.
fn same_name(a: &str, b: &str) -> bool {
    let bare = |s: &str| s.strip_prefix("sub-").or_else(|| s.strip_prefix("ses-")).unwrap_or(s).to_owned();
    a == b || bare(a) == bare(b)
}

/// Facts from the row of a table with that name.
fn row_of(path: &Path, key: &str, name: &str) -> Result<Option<FactsFile>, PipelineError> {
    let table = Tsv::read(path)?;
    table.and_then(|t| t.row(key, name).map(|r| t.facts(r, key))).transpose()
}

/// Identifiers in a folder's `participants.tsv`, in order; none without such a table.
pub(crate) fn participant_ids(folder: &Path) -> Result<Vec<String>, PipelineError> {
    let table = Tsv::read(&folder.join(PARTICIPANTS))?;
    Ok(table
        .map(|t| t.rows.iter().filter_map(|(_, r)| t.get(r, &["participant_id"]).map(str::to_owned)).collect())
        .unwrap_or_default())
}

/// The row of `participants.tsv` (BIDS) for this folder: the one whose `participant_id` names the
/// folder, or the only one.
fn participants(data: &Path) -> Result<Option<FactsFile>, PipelineError> {
    let path = data.join(PARTICIPANTS);
    let Some(table) = Tsv::read(&path)? else { return Ok(None) };
    let folder = data.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let row = table.row("participant_id", &folder).or(match table.rows.as_slice() {
        [only] => Some(only),
        _ => None,
    });
    let Some(row) = row else {
        return Err(PipelineError::request_hint(
            format!("{}: {} participants and none is called `{folder}`", path.display(), table.rows.len()),
            "name the subject in the pipeline, or keep each participant's recordings in a folder of that name",
        ));
    };
    table.facts(row, "participant_id").map(Some)
}

//! Recordings of a session that hold the same samples as another one: a part that was cut out, or a
//! recording that was exported twice. The same data would count as further evidence. A copy with
//! other marker positions (processed again, or with added noise) still has the same plate forces.

use aloft_pipeline::stages::import::ImportRecord;
use aloft_study::subject_session::SubjectSession;
use aloft_trial::share_in_common;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::workspace::Workspace;

/// Share of the samples of the shorter recording from which two hold the same motion.
const SAME: f64 = 0.3;
/// Pairs that are named.
const NAMED: usize = 3;

/// Two recordings that share samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Repeated {
    /// The recording that comes first by name.
    pub first: String,
    /// The other one.
    pub second: String,
    /// Share of the samples of the shorter one that both have (estimated).
    pub share: f64,
    /// What they share.
    pub samples: Samples,
}

/// Samples that two recordings share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Samples {
    /// Positions of markers.
    Markers,
    /// Forces of plates, beside other positions of the markers: the cameras were processed again,
    /// noise was added, or the forces of another recording were written into the file.
    Plates,
}

/// Pairs of imported recordings that share samples; each recording is named once as the second.
///
/// # Errors
/// A recording was imported and its result cannot be read.
pub fn repeated(session: &SubjectSession) -> Result<Vec<Repeated>, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let mut sketches: Vec<(&str, [Vec<u64>; 2])> = Vec::new();
    for t in session.included().filter(|t| t.role.is_dynamic()) {
        // logs of robots have no such record
        if ws.usable("import", &t.name)?.is_some()
            && let Some(r) = read_json_if_there::<ImportRecord>(&ws.place("import", &t.name).join("quality.json"))?
        {
            sketches.push((t.name.as_str(), [r.samples, r.plate_samples]));
        }
    }
    let mut out = Vec::new();
    for (i, (second, b)) in sketches.iter().enumerate() {
        let shared = |(first, a): &(&str, [Vec<u64>; 2])| {
            [Samples::Markers, Samples::Plates].into_iter().zip(a.iter().zip(b)).find_map(|(samples, (a, b))| {
                let share = share_in_common(a, b).filter(|s| *s > SAME)?;
                Some(Repeated { first: (*first).to_owned(), second: (*second).to_owned(), share, samples })
            })
        };
        out.extend(sketches[..i].iter().find_map(shared));
    }
    Ok(out)
}

/// What to say of recordings that share samples; none without any.
pub fn repeated_words(pairs: &[Repeated]) -> Option<String> {
    let pair = |r: &Repeated| {
        let of = match r.samples {
            Samples::Markers => "",
            Samples::Plates => "the plates of ",
        };
        format!("`{}` and `{}` ({:.0} % of {of}the shorter one)", r.first, r.second, 100.0 * r.share)
    };
    let mut named: Vec<String> = pairs.iter().take(NAMED).map(pair).collect();
    if pairs.len() > NAMED {
        named.push(format!("and {} more", pairs.len() - NAMED));
    }
    (!pairs.is_empty())
        .then(|| format!("recordings hold the same samples: {}; the same data count twice", named.join(", ")))
}

/// The way out.
pub const EXCLUDE: &str = "exclude one of each pair under `trials: {exclude: …}`, then `aloft run` again";

/// Refuses a session in which recordings share samples: its evidence would count twice.
///
/// # Errors
/// A request that names the recordings.
pub fn refuse_repeated(session: &SubjectSession) -> Result<(), PipelineError> {
    repeated_words(&repeated(session)?).map_or(Ok(()), |words| Err(PipelineError::request_hint(words, EXCLUDE)))
}

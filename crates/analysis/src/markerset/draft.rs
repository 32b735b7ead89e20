//! `markerset draft`: proposes a marker set for the recordings of a laboratory.
//!
//! Labels that the built-in sets or common words explain give link and landmark. The other markers
//! go to the link with which they move: the one whose markers keep their distances to them over the
//! dynamic recordings. Groups of markers of which no label is understood are placed by where they
//! are on the standing body. Sides are compared with the two halves of the body. Every line says
//! what it rests on; a person has to confirm it.

use super::axes::SegmentAxes;
use super::cluster::{against, distance_sd, groups, within};
use super::known::{Labels, Place, side_of};
use aloft_pipeline::recording::read_file;
use aloft_study::recordings::{recordings_below, stem_of};
use aloft_study::{catalog, quote};
use aloft_trial::{ImportOptions, MarkerSet, Trial};
use aloft_workspace::error::PipelineError;
use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

/// Most recordings that are read.
const READ: usize = 12;
/// Markers of one segment keep their distances to about this, m.
const TOGETHER_M: f64 = 0.012;
/// Markers of a rigid cluster keep their distances to about this, m; a cluster has at least three.
const CLUSTER_M: f64 = 0.006;
const OF_CLUSTER: usize = 3;
/// A cluster moves with markers whose distances to it vary by less than this, m, or by less than so
/// many times its own.
const BELONGS_M: f64 = 0.008;
const BELONGS: f64 = 3.0;
/// A marker moves with another link than its label says where the other's distances vary by less
/// than this share of its own …
const OTHER_LINK: f64 = 0.4;
/// … and its own by more than this, m.
const LOOSE_M: f64 = 0.025;

/// One proposed marker.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DraftedMarker {
    /// Label as recorded.
    pub label: String,
    /// Link; none where nothing tells it.
    pub link: Option<String>,
    /// Landmark.
    pub landmark: Option<String>,
    /// Seen in the static trial only.
    pub static_only: bool,
    /// Missing in some recordings.
    pub optional: bool,
    /// False for points that are not on the skin of the link.
    pub tracking: bool,
    /// What the proposal rests on, and doubts.
    pub because: String,
    /// The doubts; none where the proposal is clear.
    pub doubts: Vec<String>,
}

/// A proposed marker set.
#[derive(Debug, Clone, Serialize)]
pub struct Draft {
    /// Version of this structure.
    pub version: u32,
    /// Name, from the folder.
    pub name: String,
    /// Model whose links the markers name.
    pub model: String,
    /// Static recording, or the one whose first frames stand for it.
    pub standing: String,
    /// Recordings that were compared.
    pub recordings: usize,
    /// Recordings that cannot be read, with the reason; the draft rests on the others.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub not_read: Vec<String>,
    /// The markers, in the order of the recording.
    pub markers: Vec<DraftedMarker>,
}

/// Proposes a marker set for the recordings of a folder.
///
/// # Errors
/// No recording can be read.
pub fn draft(folder: &Path) -> Result<Draft, PipelineError> {
    let sets: Vec<MarkerSet> = catalog::all("markersets")?;
    draft_with(folder, &sets)
}

/// The same with given sets as the labels that are known.
pub(super) fn draft_with(folder: &Path, sets: &[MarkerSet]) -> Result<Draft, PipelineError> {
    if !folder.is_dir() {
        return Err(PipelineError::no_folder(&folder.display().to_string()));
    }
    let mut files = recordings_below(folder)?;
    let still = |stem: &str| ["static", "cal", "tpose", "t-pose", "neutral"].iter().any(|w| stem.contains(w));
    files.sort_by_key(|f| (!still(&stem_of(f).to_lowercase()), f.clone()));
    files.truncate(READ);
    let read: Vec<Result<Trial, String>> = files
        .par_iter()
        .map(|f| read_file(&stem_of(f), &folder.join(f), None, &ImportOptions::default()).map_err(|e| e.problem))
        .collect();
    let (mut trials, mut not_read, mut problem) = (Vec::new(), Vec::new(), None);
    for (file, read) in files.iter().zip(read) {
        match read {
            Ok(trial) if trial.markers.labels.is_empty() => {}
            Ok(trial) => trials.push(trial),
            Err(why) => {
                not_read.push(format!("{}: {why}", file.display()));
                problem.get_or_insert(why);
            }
        }
    }
    let trials: Vec<Trial> = trials;
    if trials.is_empty() {
        return Err(PipelineError::request_hint(
            format!("{}: no recording with markers could be read", folder.display()),
            problem.unwrap_or_else(|| "expected .c3d or .trc files".to_owned()),
        ));
    }
    let (standing, moving): (Vec<&Trial>, Vec<&Trial>) =
        trials.iter().partition(|t| still(&t.name.to_lowercase()) && trials.len() > 1);
    let stand = standing.first().copied().unwrap_or(&trials[0]);
    let name = folder
        .canonicalize()
        .ok()
        .and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()))
        .unwrap_or_else(|| "laboratory".to_owned());
    let markers = Work::new(stand, &standing, &moving, sets).markers();
    Ok(Draft {
        version: 1,
        model: model_of(&markers).to_owned(),
        name: name.replace(|c: char| !c.is_alphanumeric() && c != '-' && c != '_', "-").to_lowercase(),
        standing: stand.name.clone(),
        recordings: trials.len(),
        not_read,
        markers,
    })
}

/// The smallest built-in model that has all proposed links.
fn model_of(markers: &[DraftedMarker]) -> &'static str {
    let has = |stem: &str| markers.iter().filter_map(|m| m.link.as_deref()).any(|l| l.starts_with(stem));
    if ["upper_arm", "forearm", "hand"].iter().any(|s| has(s)) {
        "human34"
    } else if has("torso") {
        "legs_pelvis_trunk"
    } else {
        "legs_pelvis"
    }
}

struct Work<'a> {
    stand: &'a Trial,
    moving: &'a [&'a Trial],
    labels: Vec<String>,
    statics: BTreeSet<&'a str>,
    known: Labels,
    sd: nalgebra::DMatrix<f64>,
    /// Mean position in the standing recording.
    at: Vec<Option<Vector3<f64>>>,
}

impl<'a> Work<'a> {
    fn new(stand: &'a Trial, standing: &[&'a Trial], moving: &'a [&'a Trial], sets: &[MarkerSet]) -> Self {
        let mut labels: Vec<String> = Vec::new();
        for t in standing.iter().chain(moving) {
            for l in &t.markers.labels {
                // unlabelled trajectories
                let nameless = l.trim().is_empty() || l.starts_with('*') || l.to_lowercase().starts_with("unlabel");
                if !nameless && !labels.contains(l) && !t.markers.trajectories.is_empty() {
                    labels.push(l.clone());
                }
            }
        }
        let of_moving: BTreeSet<&str> =
            moving.iter().flat_map(|t| t.markers.labels.iter().map(String::as_str)).collect();
        let statics = standing
            .iter()
            .flat_map(|t| t.markers.labels.iter().map(String::as_str))
            .filter(|l| !moving.is_empty() && !of_moving.contains(l))
            .collect();
        let all: Vec<&Trial> = if moving.is_empty() { vec![stand] } else { moving.to_vec() };
        let sd = distance_sd(&labels, &all);
        let at = labels
            .iter()
            .map(|l| {
                let track = &stand.markers.trajectories[stand.markers.index(l)?];
                let seen: Vec<&Vector3<f64>> = track.iter().filter(|p| p.x.is_finite()).take(50).collect();
                (!seen.is_empty()).then(|| seen.iter().copied().sum::<Vector3<f64>>() / seen.len() as f64)
            })
            .collect();
        Self { stand, moving, labels, statics, known: Labels::of(sets), sd, at }
    }

    fn markers(&self) -> Vec<DraftedMarker> {
        let n = self.labels.len();
        let mut place: Vec<Option<Place>> = self.labels.iter().map(|l| self.known.place(l)).collect();
        self.doubt_labels(&mut place);
        self.by_clusters(&mut place);
        self.by_rigidity(&mut place);
        self.by_position(&mut place);
        let right = self.right_of_body(&place);
        let mut taken: BTreeMap<String, String> = BTreeMap::new();
        (0..n)
            .map(|i| {
                let label = self.labels[i].clone();
                let found = place[i].clone();
                let present = self.moving.iter().filter(|t| t.markers.index(&label).is_some()).count();
                let static_only = self.statics.contains(label.as_str());
                let mut because = found.as_ref().map_or_else(|| "link unknown".to_owned(), |p| p.how.clone());
                let mut landmark = found.as_ref().and_then(|p| p.landmark.clone());
                // several markers on a landmark of the middle are averaged
                if let Some(name) = landmark.clone().filter(|n| n.ends_with("_r") || n.ends_with("_l")) {
                    if let Some(first) = taken.get(&name) {
                        let _ = write!(because, "; `{name}` is already at {first}");
                        landmark = None;
                    } else {
                        taken.insert(name, label.clone());
                    }
                }
                let mut doubts = found.as_ref().map(|p| p.doubts.clone()).unwrap_or_default();
                doubts.extend(self.side_doubt(i, found.as_ref(), right));
                for doubt in &doubts {
                    let _ = write!(because, "; CHECK: {doubt}");
                }
                DraftedMarker {
                    label,
                    link: found.as_ref().map(|p| p.link.clone()),
                    landmark,
                    static_only,
                    optional: !static_only && present < self.moving.len(),
                    tracking: found.as_ref().is_none_or(|p| p.tracking),
                    because,
                    doubts,
                }
            })
            .collect()
    }

    /// Members of every link so far.
    fn members(&self, place: &[Option<Place>]) -> BTreeMap<String, Vec<usize>> {
        let mut of: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (i, p) in place.iter().enumerate() {
            if let Some(p) = p.as_ref().filter(|p| p.tracking && !self.statics.contains(self.labels[i].as_str())) {
                of.entry(p.link.clone()).or_default().push(i);
            }
        }
        of
    }

    /// The link with which a marker moves, the variation of its distances there, and in the next.
    fn nearest_link(
        &self,
        marker: usize,
        members: &BTreeMap<String, Vec<usize>>,
    ) -> Option<(String, f64, Option<f64>)> {
        let mut each: Vec<(f64, &String)> =
            members.iter().filter_map(|(link, own)| Some((against(&self.sd, marker, own)?, link))).collect();
        each.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (first, link) = each.first()?;
        Some(((*link).clone(), *first, each.get(1).map(|e| e.0)))
    }

    /// Remarks where a marker moves with another link than its label says.
    fn doubt_labels(&self, place: &mut [Option<Place>]) {
        let members = self.members(place);
        let doubts: Vec<Option<String>> = place
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let p = p.as_ref().filter(|p| p.tracking)?;
                let own = against(&self.sd, i, members.get(&p.link)?)?;
                let (link, other, _) = self.nearest_link(i, &members)?;
                let elsewhere = link != p.link && other < OTHER_LINK * own && own > LOOSE_M;
                elsewhere.then(|| {
                    format!(
                        "it moves with {link} (distances vary by {:.0} mm, to {} by {:.0} mm)",
                        1e3 * other,
                        p.link,
                        1e3 * own
                    )
                })
            })
            .collect();
        for (p, doubt) in place.iter_mut().zip(doubts) {
            if let (Some(p), Some(doubt)) = (p, doubt) {
                p.doubts.push(doubt);
            }
        }
    }

    /// Puts rigid clusters that labels do not explain on the segment beside whose axis they stand.
    /// The axes come from the landmarks of the static trial, which may be seen there alone (CAST).
    fn by_clusters(&self, place: &mut [Option<Place>]) {
        let named = place.iter().zip(&self.at).filter_map(|(p, at)| Some((p.as_ref()?.landmark.clone()?, (*at)?)));
        let axes = SegmentAxes::of(&named.collect());
        let open: Vec<usize> = (0..place.len())
            .filter(|&i| place[i].is_none() && self.at[i].is_some() && !self.statics.contains(self.labels[i].as_str()))
            .collect();
        let members = self.members(place);
        for group in groups(&self.sd, &open, CLUSTER_M).into_iter().filter(|g| g.len() >= OF_CLUSTER) {
            let own = within(&self.sd, &group);
            let near: Vec<f64> = group.iter().filter_map(|i| self.nearest_link(*i, &members)).map(|n| n.1).collect();
            let with_others = near.iter().sum::<f64>() / near.len().max(1) as f64;
            if !near.is_empty() && with_others < BELONGS_M.max(BELONGS * own) {
                // it moves with markers whose labels are understood
                continue;
            }
            let points: Vec<Vector3<f64>> = group.iter().filter_map(|i| self.at[*i]).collect();
            let centre = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
            let Some(found) = axes.nearest(&centre) else { continue };
            let doubts: Vec<String> = found.doubtful.iter().map(|other| format!("{other} is nearly as near")).collect();
            let how = format!(
                "rigid cluster of {} (distances vary by {:.1} mm), {:.0} mm beside the axis of {}",
                group.len(),
                1e3 * own,
                1e3 * found.distance_m,
                found.link
            );
            for i in group {
                place[i] = Some(Place {
                    link: found.link.clone(),
                    landmark: None,
                    tracking: true,
                    how: how.clone(),
                    doubts: doubts.clone(),
                });
            }
        }
    }

    /// Puts markers that labels do not explain on the link with which they move.
    fn by_rigidity(&self, place: &mut [Option<Place>]) {
        let members = self.members(place);
        for i in 0..place.len() {
            if place[i].is_some() || self.statics.contains(self.labels[i].as_str()) {
                continue;
            }
            let Some((link, own, next)) = self.nearest_link(i, &members) else { continue };
            if own > LOOSE_M {
                continue;
            }
            let beside = next.map_or(String::new(), |n| format!(" (next link {:.0} mm)", 1e3 * n));
            let how = format!("moves with {link}: distances vary by {:.0} mm{beside}", 1e3 * own);
            place[i] = Some(Place { link, landmark: None, tracking: true, how, doubts: Vec::new() });
        }
        // markers of the static trial sit where their nearest neighbours do
        for i in 0..place.len() {
            if place[i].is_some() || !self.statics.contains(self.labels[i].as_str()) {
                continue;
            }
            let Some(own) = self.at[i] else { continue };
            let near = members
                .iter()
                .flat_map(|(link, m)| m.iter().filter_map(move |j| Some((link, (self.at[*j]? - own).norm()))))
                .min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((link, distance)) = near.filter(|(_, d)| *d < 0.12) {
                let how = format!("static only; {:.0} mm from a marker of {link}", 1e3 * distance);
                place[i] = Some(Place { link: link.clone(), landmark: None, tracking: true, how, doubts: Vec::new() });
            }
        }
    }

    /// Places whole groups that move together and of which no label is understood, by where they
    /// are on the standing body.
    fn by_position(&self, place: &mut [Option<Place>]) {
        let open: Vec<usize> = (0..place.len()).filter(|i| place[*i].is_none() && self.at[*i].is_some()).collect();
        let seen: Vec<Vector3<f64>> = self.at.iter().flatten().copied().collect();
        if open.is_empty() || seen.len() < 6 {
            return;
        }
        let low = seen.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        let high = seen.iter().map(|p| p.z).fold(f64::NEG_INFINITY, f64::max);
        let middle = seen.iter().sum::<Vector3<f64>>() / seen.len() as f64;
        let Some(right) = self.right_of_body(place).or_else(|| self.right_by_shape(&seen, &middle)) else { return };
        // the highest marker is on the head only where some reach it
        let tall = if self.stand.markers.labels.is_empty() { 1.7 } else { (high - low).max(0.5) };
        for group in groups(&self.sd, &open, TOGETHER_M) {
            let points: Vec<Vector3<f64>> = group.iter().filter_map(|i| self.at[*i]).collect();
            let centre = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
            let height = (centre.z - low) / tall;
            let lateral = (Vector2::new(centre.x - middle.x, centre.y - middle.y)).dot(&right) / tall;
            let side = if lateral > 0.0 { "r" } else { "l" };
            let link = match height {
                h if h < 0.06 => format!("foot_{side}"),
                h if h < 0.27 => format!("shank_{side}"),
                h if h < 0.50 && lateral.abs() < 0.12 => format!("thigh_{side}"),
                h if h < 0.50 => format!("hand_{side}"),
                h if h < 0.60 && lateral.abs() < 0.12 => "pelvis".to_owned(),
                h if h < 0.64 => format!("forearm_{side}"),
                h if h < 0.80 && lateral.abs() > 0.12 => format!("upper_arm_{side}"),
                h if h < 0.90 => "torso".to_owned(),
                _ => "head".to_owned(),
            };
            let how = format!(
                "placed by height ({:.0} % of the markers' extent) and side; moves together with {} others",
                100.0 * height,
                group.len() - 1
            );
            for i in group {
                place[i] = Some(Place {
                    link: link.clone(),
                    landmark: None,
                    tracking: true,
                    how: how.clone(),
                    doubts: vec!["nothing else says where it is".to_owned()],
                });
            }
        }
    }

    /// Direction to the right of the standing body in the horizontal plane, from markers whose
    /// labels say their sides.
    fn right_of_body(&self, place: &[Option<Place>]) -> Option<Vector2<f64>> {
        let mut sums = [(Vector2::zeros(), 0.0); 2];
        for (p, at) in place.iter().zip(&self.at) {
            let (Some(p), Some(at)) = (p, at) else { continue };
            let name = p.landmark.as_deref().unwrap_or(&p.link);
            let side = if name.ends_with("_r") {
                0
            } else if name.ends_with("_l") {
                1
            } else {
                continue;
            };
            sums[side].0 += Vector2::new(at.x, at.y);
            sums[side].1 += 1.0;
        }
        let [(r, n), (l, m)] = sums;
        (n >= 2.0 && m >= 2.0).then(|| r / n - l / m).filter(|d| d.norm() > 0.03).map(|d| d.normalize())
    }

    /// The same without labels: across the widest horizontal extent, with the feet pointing
    /// forwards.
    fn right_by_shape(&self, seen: &[Vector3<f64>], middle: &Vector3<f64>) -> Option<Vector2<f64>> {
        let flat: Vec<Vector2<f64>> = seen.iter().map(|p| Vector2::new(p.x - middle.x, p.y - middle.y)).collect();
        let cross = flat.iter().fold(nalgebra::Matrix2::zeros(), |s, p| s + p * p.transpose()).symmetric_eigen();
        let widest = if cross.eigenvalues[0] > cross.eigenvalues[1] { 0 } else { 1 };
        let across: Vector2<f64> = cross.eigenvectors.column(widest).into();
        let low = seen.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        let mean = |from: f64, to: f64| {
            let part: Vec<&Vector2<f64>> =
                seen.iter().zip(&flat).filter(|(p, _)| (from..to).contains(&(p.z - low))).map(|x| x.1).collect();
            (!part.is_empty()).then(|| part.iter().copied().sum::<Vector2<f64>>() / part.len() as f64)
        };
        // feet reach forwards of the shanks
        let forward = mean(0.0, 0.06)? - mean(0.12, 0.45)?;
        let right = Vector2::new(forward.y, -forward.x);
        Some(if across.dot(&right) > 0.0 { across } else { -across })
    }

    /// A doubt where label and position disagree about the side.
    fn side_doubt(&self, i: usize, place: Option<&Place>, right: Option<Vector2<f64>>) -> Option<String> {
        let (right, at, place) = (right?, self.at[i]?, place?);
        let name = place.landmark.as_deref().unwrap_or(&place.link);
        let stated = match name.rsplit('_').next() {
            Some("r") => 1.0,
            Some("l") => -1.0,
            _ => return None,
        };
        // a label without a side got its own from a group
        side_of(&self.labels[i])?;
        let seen: Vec<Vector3<f64>> = self.at.iter().flatten().copied().collect();
        let middle = seen.iter().sum::<Vector3<f64>>() / seen.len() as f64;
        let lateral = Vector2::new(at.x - middle.x, at.y - middle.y).dot(&right);
        (stated * lateral < -0.04)
            .then(|| format!("it stands {:.0} mm on the other side of the body", 1e3 * lateral.abs()))
    }
}

/// The draft as a marker-set file.
pub fn to_yaml(draft: &Draft) -> String {
    let mut t = String::new();
    let mut line = |s: String| {
        let _ = writeln!(t, "{s}");
    };
    line(format!(
        "# Drafted by `aloft markerset draft` from {} recordings; standing: {}. Look through every line, above all through",
        draft.recordings,
        quote::visible(&draft.standing)
    ));
    line("# those with CHECK, and complete landmarks; then: aloft markerset check THIS_FILE".to_owned());
    line(format!("name: {}", quote::yaml(&draft.name)));
    line(format!("title: {}", quote::yaml_quoted(&format!("Drafted from {}", draft.standing))));
    line(format!("model: {}", draft.model));
    line("marker_radius_m: 0.007   # half of a marker's diameter, m: correct it".to_owned());
    line("markers:".to_owned());
    let order = [
        "head",
        "torso",
        "upper_arm_l",
        "forearm_l",
        "hand_l",
        "upper_arm_r",
        "forearm_r",
        "hand_r",
        "pelvis",
        "thigh_l",
        "shank_l",
        "foot_l",
        "thigh_r",
        "shank_r",
        "foot_r",
    ];
    for link in order {
        let own: Vec<&DraftedMarker> = draft.markers.iter().filter(|m| m.link.as_deref() == Some(link)).collect();
        if own.is_empty() {
            continue;
        }
        line(format!("  # {link}"));
        for m in own {
            let mut parts = vec![format!("label: {}", quote::yaml_quoted(&m.label)), format!("link: {link}")];
            parts.extend(m.landmark.iter().map(|l| format!("landmark: {l}")));
            for (key, holds) in
                [("static_only: true", m.static_only), ("optional: true", m.optional), ("tracking: false", !m.tracking)]
            {
                if holds {
                    parts.push(key.to_owned());
                }
            }
            line(format!("  - {{ {} }}   # {}", parts.join(", "), quote::visible(&m.because)));
        }
    }
    let open: Vec<&DraftedMarker> = draft.markers.iter().filter(|m| m.link.is_none()).collect();
    if !open.is_empty() {
        line("  # no link was found for these".to_owned());
        for m in open {
            line(format!("  # - {{ label: {}, link: ? }}", quote::yaml_quoted(&m.label)));
        }
    }
    t
}

/// Writes the file; nothing is overwritten.
///
/// # Errors
/// The file is there already, or cannot be written.
pub fn write_new(file: &Path, text: &str) -> Result<(), PipelineError> {
    aloft_workspace::theirs::write_new(file, text.as_bytes())
}

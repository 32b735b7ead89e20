//! What a label says: labels of the built-in sets, and words that laboratories use.

use aloft_trial::MarkerSet;
use std::collections::BTreeMap;

/// A marker's place as its label says it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Place {
    pub link: String,
    pub landmark: Option<String>,
    /// False for points that are not fixed to the link's skin (patella, computed joint centres).
    pub tracking: bool,
    /// The source, for the comment beside the marker.
    pub how: String,
    /// Doubts about the proposal.
    pub doubts: Vec<String>,
}

/// The label reduced to lower-case letters and digits.
fn bare(label: &str) -> String {
    let label = label.rsplit(':').next().unwrap_or(label);
    label.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// Labels of marker sets, with the places that they have there.
pub(super) struct Labels {
    of: BTreeMap<String, BTreeMap<Known, Vec<String>>>,
}

/// Link, landmark, and whether the marker is tracked.
type Known = (String, Option<String>, bool);

impl Labels {
    pub fn of(sets: &[MarkerSet]) -> Self {
        let mut of: BTreeMap<String, BTreeMap<_, Vec<String>>> = BTreeMap::new();
        let worn = |s: &&MarkerSet| s.markerless.is_none() && s.markers.iter().any(|m| m.link == "pelvis");
        for set in sets.iter().filter(worn) {
            for m in &set.markers {
                for label in std::iter::once(&m.label).chain(&m.aliases) {
                    let places = of.entry(bare(label)).or_default();
                    let sets = places.entry((m.link.clone(), m.landmark.clone(), m.tracking)).or_default();
                    if !sets.contains(&set.name) {
                        sets.push(set.name.clone());
                    }
                }
            }
        }
        Self { of }
    }

    /// Place of a label: that of the built-in sets if they agree, else what its words say.
    pub fn place(&self, label: &str) -> Option<Place> {
        let by_words = place_by_name(label);
        let Some(places) = self.of.get(&bare(label)) else { return by_words };
        let best = places.iter().max_by_key(|(place, sets)| {
            let agrees = by_words.as_ref().is_some_and(|w| w.link == place.0);
            (sets.len(), agrees)
        })?;
        let ((link, landmark, tracking), sets) = best;
        let also = places.len() - 1;
        let doubt = if also > 0 {
            format!("; {also} other meaning{} exist", if also == 1 { "" } else { "s" })
        } else {
            String::new()
        };
        let how = format!("label of {}{doubt}", sets.join(", "));
        Some(Place { link: link.clone(), landmark: landmark.clone(), tracking: *tracking, how, doubts: Vec::new() })
    }
}

/// Words in labels: any of these in the label without its side, the link without its side, and the
/// landmark. The first line that fits wins, so that narrower words stand first.
const WORDS: &[(&[&str], &str, Option<&str>)] = &[
    (&["asis", "ias", "asi"], "pelvis", Some("asis")),
    (&["psis", "ips", "psi"], "pelvis", Some("psis")),
    (&["sacr", "sacrum", "vsac"], "pelvis", Some("sacrum")),
    (&["iliac", "crest", "iliccrest"], "pelvis", None),
    (&["hjc", "hipcent", "hipjoint"], "pelvis", Some("hip_centre")),
    (
        &["mknee", "kneemed", "medknee", "kneem", "medialknee", "mfc", "fme", "mepi", "medcond", "femmed"],
        "thigh",
        Some("knee_medial"),
    ),
    (&["knee", "kne", "lfc", "fle", "lepi", "latcond", "femlat"], "thigh", Some("knee_lateral")),
    (&["mank", "anklemed", "medank", "mmal", "medmal", "tam", "ankm"], "shank", Some("ankle_medial")),
    (&["ank", "lmal", "latmal", "fal", "malleolus"], "shank", Some("ankle_lateral")),
    (&["heel", "hee", "calc", "cal", "fcc"], "foot", Some("heel")),
    (&["5meta", "meta5", "mt5", "mth5", "5mt", "fm5", "vmh", "met5", "p5mt", "d5m"], "foot", Some("mt5")),
    (&["1meta", "meta1", "mt1", "mth1", "1mt", "fm1", "fmh", "met1", "p1mt", "d1m"], "foot", Some("mt1")),
    (&["toe", "hallux", "2meta", "meta2", "mt2", "mth2", "2mt", "fm2", "smh", "met2", "d2m"], "foot", Some("toe")),
    (&["foot", "mfs", "mfl", "forefoot"], "foot", None),
    (&["troch", "ftc"], "thigh", Some("trochanter")),
    (&["thigh", "thi", "thap", "thad", "femur"], "thigh", None),
    (&["shank", "tib", "shin", "ttc", "fax", "leg"], "shank", None),
    (&["acr", "shoulder", "sho", "sae", "saj"], "torso", Some("acromion")),
    (&["melb", "elbowmed", "elbmed", "elbm", "medelb", "hme", "mel"], "upper_arm", Some("elbow_medial")),
    (&["elb", "elbow", "hle", "lel"], "upper_arm", Some("elbow_lateral")),
    (&["wristrad", "wra", "rsp", "radius", "lwrist", "wristthumb"], "hand", Some("wrist_radial")),
    (&["wristuln", "wrb", "usp", "ulna", "mwrist", "wristpink"], "hand", Some("wrist_ulnar")),
    (&["wrist", "wri"], "hand", Some("wrist")),
    (&["fin", "hand", "hm2", "hm3"], "hand", Some("hand_distal")),
    (&["forearm", "frm", "fra", "farm"], "forearm", None),
    (&["upperarm", "upa", "uparm", "humer", "uarm", "biceps"], "upper_arm", None),
];

/// Words of points that exist once.
const CENTRAL: &[(&[&str], &str, Option<&str>)] = &[
    (&["sacr", "sacrum", "vsac", "s1", "s2", "l5s1"], "pelvis", Some("sacrum")),
    (&["c7", "cv7"], "torso", Some("c7")),
    (&["t10", "tv10"], "torso", Some("t10")),
    (&["clav", "ij", "sjn", "jugular", "suprastern", "manubrium"], "torso", Some("suprasternale")),
    (&["xiph", "strn", "px", "sxs", "sternum"], "torso", Some("xiphoid")),
    (&["t2", "t4", "t5", "t6", "t8", "t12", "scap", "back", "spine", "chest"], "torso", None),
    (&["vertex", "tophead", "headtop"], "head", Some("vertex")),
    (&["head", "glab", "fhd", "bhd"], "head", None),
];

fn place_by_name(label: &str) -> Option<Place> {
    let text = bare(label);
    let found = |list: &'static [(&[&str], &'static str, Option<&'static str>)], rest: &str| {
        // two letters decide only as the whole label
        let fits = |w: &&str| if w.len() <= 2 { rest == *w } else { rest.contains(*w) };
        list.iter().find_map(|(words, link, landmark)| words.iter().find(|w| fits(w)).map(|w| (*w, *link, *landmark)))
    };
    let patella = text.contains("patel") || text.ends_with("pat");
    if let Some((side, rest)) = side_of(label)
        && let Some((word, link, landmark)) = found(WORDS, &rest)
    {
        let central = matches!(link, "pelvis" | "torso");
        let link = if central { link.to_owned() } else { format!("{link}_{side}") };
        let landmark = landmark.map(|l| if l == "sacrum" { l.to_owned() } else { format!("{l}_{side}") });
        let tracking = !patella && landmark.as_deref().is_none_or(|l| !l.starts_with("hip_centre"));
        return Some(Place { link, landmark, tracking, how: format!("`{word}` in the label"), doubts: Vec::new() });
    }
    let (word, link, landmark) = found(CENTRAL, &text)?;
    let how = format!("`{word}` in the label");
    Some(Place {
        link: link.to_owned(),
        landmark: landmark.map(str::to_owned),
        tracking: true,
        how,
        doubts: Vec::new(),
    })
}

/// Side that a label states, `l` or `r`, and the label without it, lower-case letters and digits.
pub(super) fn side_of(label: &str) -> Option<(char, String)> {
    let label = label.rsplit(':').next().unwrap_or(label);
    let lower = label.to_lowercase();
    for (word, side) in [("left", 'l'), ("right", 'r')] {
        if let Some(at) = lower.find(word) {
            let rest = format!("{}{}", &lower[..at], &lower[at + word.len()..]);
            return Some((side, bare(&rest)));
        }
    }
    let mut backwards = lower.chars().rev();
    if let (Some(last @ ('l' | 'r')), Some('_' | '.' | '-' | ' ')) = (backwards.next(), backwards.next()) {
        return Some((last, bare(&lower[..lower.len() - 2])));
    }
    let mut letters = lower.chars();
    if let Some(first @ ('l' | 'r')) = letters.next() {
        let rest: String = letters.collect();
        return Some((first, bare(&rest)));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_labels() {
        let at = |label: &str| place_by_name(label).map(|p| (p.link, p.landmark.unwrap_or_default()));
        let is = |link: &str, landmark: &str| Some((link.to_owned(), landmark.to_owned()));
        assert_eq!(at("R_knee_lat"), is("thigh_r", "knee_lateral_r"));
        assert_eq!(at("Left Medial Malleolus (LMMAL)"), is("shank_l", "ankle_medial_l"));
        assert_eq!(at("ankle_r"), is("shank_r", "ankle_lateral_r"));
        assert_eq!(at("L.5th_meta5"), is("foot_l", "mt5_l"));
        assert_eq!(at("RThigh2"), is("thigh_r", ""));
        assert_eq!(at("V.Sacral"), is("pelvis", "sacrum"));
        assert_eq!(at("M017"), None);
    }
}

//! Whose markers a recording holds: of several people in front of the cameras, one is analysed.
//!
//! Programs put the person before the label (`Anna:LASI`, sometimes `Anna_LASI`). Groups of labels
//! with the same names behind different prefixes are several people; prefixes whose labels are
//! other ones are objects (`Racket:tip`) and stay with the person's markers.

use crate::{Trial, TrialError, WarningKind, person_key};
use aloft_c3d::{C3dFile, split_subject};
use std::collections::{BTreeMap, BTreeSet};

/// Fewest labels that several prefixes before an underscore have in common if they are people:
/// markers of segments (`thigh_1`, `shank_1`) share fewer, and sides are told apart.
const OF_A_BODY: usize = 10;

/// The markers that are used, and of whom.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Chosen {
    /// Label of each marker that is used, or none, in the order of the stored labels.
    pub labels: Vec<Option<String>>,
    /// The person whose markers they are, if the labels or the file say so.
    pub person: Option<String>,
    /// Every person, if there are several.
    pub people: Vec<String>,
    /// Prefixes of the labels that are used.
    pub prefixes: Vec<String>,
}

impl Chosen {
    /// Notes the people in the trial; says whose markers are used.
    pub fn tell(&self, trial: &mut Trial) {
        trial.person = self.person.clone();
        trial.people.clone_from(&self.people);
        if self.prefixes.len() > 1 && (self.people.len() < 2 || self.person.is_some()) {
            let message = format!("labels of several subjects: {}; all are used", self.prefixes.join(", "));
            trial.warn(WarningKind::Labels, message);
        }
        if self.people.len() < 2 {
            return;
        }
        let all = self.people.join(", ");
        let message = match &self.person {
            Some(person) => format!("markers of several people ({all}): those of {person} are used"),
            None => format!("markers of several people ({all}): none of them is chosen"),
        };
        trial.warn(WarningKind::People, message);
    }
}

/// Refuses a recording of several people of whom none was chosen.
pub(crate) fn require_one(trial: &Trial) -> Result<(), TrialError> {
    match (&trial.person, trial.people.len()) {
        (None, 2..) => Err(TrialError::SeveralPeople { trial: trial.name.clone(), people: trial.people.join(", ") }),
        _ => Ok(()),
    }
}

/// People of SUBJECTS in a C3D file: name and prefix of labels (empty if none is stated).
pub(crate) fn stated_people(file: &C3dFile) -> Vec<(String, String)> {
    let words = |key: &str| file.groups.get("SUBJECTS", key).map(|p| p.strings()).unwrap_or_default();
    let prefixes = words("LABEL_PREFIXES");
    let prefix = |i: usize| prefixes.get(i).map_or("", |p| p.trim().trim_end_matches([':', '_'])).to_owned();
    let names = words("NAMES");
    let named = names.iter().enumerate().map(|(i, n)| (n.trim().to_owned(), prefix(i)));
    named.filter(|(n, _)| !n.is_empty()).collect()
}

/// Chooses the markers of one person. `stored` are the labels of the file, `wanted` the names by
/// which the person may be called, the surest first, `stated` what the file says about people.
pub(crate) fn choose(stored: &[String], strip: bool, wanted: &[String], stated: &[(String, String)]) -> Chosen {
    let split = split(stored, wanted, stated);
    let groups = groups(&split);
    let people = people_of(&groups);
    // the name that the file gives to a prefix
    let name = |prefix: &str| {
        let own = stated.iter().find(|(_, p)| !p.is_empty() && person_key(p) == person_key(prefix));
        own.map_or(prefix, |(name, _)| name).to_owned()
    };
    let is = |prefix: &str, wanted: &str| {
        let key = person_key(wanted);
        !key.is_empty() && (person_key(prefix) == key || person_key(&name(prefix)) == key)
    };
    let label = |(bare, prefix): &(String, Option<String>), stored: &String| match prefix {
        Some(_) if strip => bare.clone(),
        _ => stored.clone(),
    };
    if people.len() < 2 {
        let labels: Vec<Option<String>> = split.iter().zip(stored).map(|(s, l)| Some(label(s, l))).collect();
        let alone = match stated {
            [(name, _)] => Some(name.clone()),
            _ => groups.iter().find(|(p, own)| !p.is_empty() && 2 * own.len() > stored.len()).map(|(p, _)| name(p)),
        };
        let prefixes = groups.keys().filter(|p| !p.is_empty()).map(|p| (*p).to_owned()).collect();
        return match unnamed_people(&labels, stated) {
            Some(people) => Chosen { labels, person: None, people, prefixes },
            None => Chosen { labels, person: alone, people: Vec::new(), prefixes },
        };
    }
    let own = wanted.iter().find_map(|w| {
        let mut found = people.iter().filter(|p| is(p, w));
        found.next().filter(|_| found.next().is_none())
    });
    let keep = |(_, prefix): &(String, Option<String>)| {
        let prefix = prefix.as_deref().unwrap_or("");
        own.is_none_or(|own| own == prefix || !people.iter().any(|p| p == prefix))
    };
    // without a choice, for looking at a file, everything keeps its whole name
    let shown =
        |s: &(String, Option<String>), stored: &String| if own.is_some() { label(s, stored) } else { stored.clone() };
    let labels = split.iter().zip(stored).map(|(s, l)| keep(s).then(|| shown(s, l))).collect();
    let named = people.iter().map(|p| if p.is_empty() { "without a name".to_owned() } else { name(p) });
    let used = |p: &&&str| !p.is_empty() && (Some(**p) == own.map(String::as_str) || !people.iter().any(|o| o == **p));
    let prefixes = groups.keys().filter(used).map(|p| (*p).to_owned()).collect();
    Chosen { labels, person: own.map(|p| name(p)), people: named.collect(), prefixes }
}

/// Several people whose labels have no prefix: most labels are there twice.
fn unnamed_people(labels: &[Option<String>], stated: &[(String, String)]) -> Option<Vec<String>> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for label in labels.iter().flatten() {
        *counts.entry(label).or_default() += 1;
    }
    let repeated = counts.values().filter(|n| **n > 1).count();
    let most = counts.values().copied().max().unwrap_or(0);
    if repeated < OF_A_BODY || 2 * repeated <= counts.len() {
        return None;
    }
    let names: Vec<String> = stated.iter().map(|(name, _)| name.clone()).collect();
    Some(if names.len() > 1 { names } else { vec!["without names".to_owned(); most] })
}

/// Labels with the prefix of a person or object, if they have one.
fn split(stored: &[String], wanted: &[String], stated: &[(String, String)]) -> Vec<(String, Option<String>)> {
    let colon = |l: &String| {
        let (bare, prefix) = split_subject(l);
        (bare.to_owned(), prefix.map(str::to_owned))
    };
    let by_colon: Vec<_> = stored.iter().map(colon).collect();
    if by_colon.iter().any(|(_, prefix)| prefix.is_some()) {
        return by_colon;
    }
    let before = |l: &String| l.trim().split_once('_').map(|(p, rest)| (rest.to_owned(), Some(p.to_owned())));
    let by_underscore: Vec<_> = stored.iter().map(|l| before(l).unwrap_or((l.clone(), None))).collect();
    let known = |prefix: &str| {
        let key = person_key(prefix);
        let mut names = wanted.iter().chain(stated.iter().flat_map(|(name, prefix)| [name, prefix]));
        names.any(|n| !n.is_empty() && person_key(n) == key)
    };
    let found = groups(&by_underscore);
    let people = people_of(&found);
    let side = |p: &String| matches!(p.to_lowercase().as_str(), "l" | "r" | "left" | "right");
    let whole = |p: &String| found.get(p.as_str()).is_some_and(|own| own.len() >= OF_A_BODY);
    let named = people.iter().any(|p| known(p));
    if people.len() > 1
        && !people.iter().any(side)
        && people.iter().all(|p| !p.is_empty())
        && (named || people.iter().all(whole))
    {
        // other words before an underscore are part of the label
        let own = |(s, l): ((String, Option<String>), &String)| match s.1.as_ref().is_some_and(|p| people.contains(p)) {
            true => s,
            false => (l.clone(), None),
        };
        return by_underscore.into_iter().zip(stored).map(own).collect();
    }
    by_colon
}

/// The labels behind each prefix; those without one are behind the empty prefix.
fn groups(split: &[(String, Option<String>)]) -> BTreeMap<&str, BTreeSet<String>> {
    let mut out: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for (bare, prefix) in split.iter().filter(|(bare, _)| !bare.starts_with('*') && !bare.is_empty()) {
        out.entry(prefix.as_deref().unwrap_or("")).or_default().insert(bare.to_lowercase());
    }
    out
}

/// The prefix with the most labels, and those that share at least half of their labels with it.
fn people_of(groups: &BTreeMap<&str, BTreeSet<String>>) -> Vec<String> {
    let Some((first, body)) = groups.iter().max_by(|a, b| a.1.len().cmp(&b.1.len()).then(b.0.cmp(a.0))) else {
        return Vec::new();
    };
    let alike = |own: &BTreeSet<String>| 2 * own.intersection(body).count() >= own.len();
    groups.iter().filter(|(prefix, own)| *prefix == first || alike(own)).map(|(p, _)| (*p).to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BODY: [&str; 12] =
        ["LASI", "RASI", "LPSI", "RPSI", "LKNE", "RKNE", "LANK", "RANK", "LHEE", "RHEE", "LTOE", "RTOE"];

    fn labels(people: &[&str], mark: &str, n: usize) -> Vec<String> {
        people.iter().flat_map(|p| BODY[..n].iter().map(move |b| format!("{p}{mark}{b}"))).collect()
    }
    fn strings(list: &[&str]) -> Vec<String> {
        list.iter().map(|s| (*s).to_owned()).collect()
    }
    fn used(chosen: &Chosen) -> Vec<String> {
        chosen.labels.iter().flatten().cloned().collect()
    }

    #[test]
    fn of_several_people_the_one_that_is_called_by_name_is_used() {
        for mark in [":", "_"] {
            let stored = labels(&["Ben", "Anna", "Cleo"], mark, 12);
            for wanted in ["Anna", "ANNA", "anna "] {
                let chosen = choose(&stored, true, &strings(&["S01", wanted]), &[]);
                assert_eq!(chosen.person.as_deref(), Some("Anna"), "{mark}");
                assert_eq!(used(&chosen), strings(&BODY));
                assert!(chosen.labels[..12].iter().all(Option::is_none));
                assert_eq!(chosen.people, ["Anna", "Ben", "Cleo"]);
            }
            for wanted in [&["S01"][..], &[], &["An"]] {
                let chosen = choose(&stored, true, &strings(wanted), &[]);
                assert_eq!((chosen.person.clone(), chosen.people.len()), (None, 3), "{mark} {wanted:?}");
                assert_eq!(used(&chosen), stored);
            }
        }
    }

    #[test]
    fn a_marker_that_the_person_lacks_is_not_taken_from_another() {
        let mut stored = labels(&["Ben"], ":", 12);
        stored.extend(labels(&["Anna"], ":", 9));
        stored.extend(strings(&["Racket:tip", "Racket:grip", "wand"]));
        let chosen = choose(&stored, true, &strings(&["Anna"]), &[]);
        let mut expected = strings(&BODY[..9]);
        expected.extend(strings(&["tip", "grip", "wand"]));
        assert_eq!(used(&chosen), expected);
    }

    #[test]
    fn names_of_the_file_stand_for_their_prefixes() {
        let stated = [("Ben Ho".to_owned(), "P1".to_owned()), ("Anna Ek".to_owned(), "P2".to_owned())];
        for mark in [":", "_"] {
            let chosen = choose(&labels(&["P1", "P2"], mark, 12), true, &strings(&["anna ek"]), &stated);
            assert_eq!((chosen.person.as_deref(), used(&chosen)), (Some("Anna Ek"), strings(&BODY)), "{mark}");
        }
        // without prefixes nothing tells whose a label is
        let chosen = choose(&labels(&["", ""], "", 12), true, &strings(&["Anna Ek"]), &stated);
        assert_eq!((chosen.person, chosen.people), (None, strings(&["Ben Ho", "Anna Ek"])));
    }

    #[test]
    fn objects_sides_and_segments_are_no_people() {
        let mut stored = labels(&["Anna"], ":", 12);
        stored.extend(strings(&["Ball:Marker1", "Ball:Marker2", "Bat:Marker1", "Bat:Marker2"]));
        let chosen = choose(&stored, true, &strings(&["S01"]), &[]);
        assert_eq!((chosen.person.as_deref(), chosen.people.len(), used(&chosen).len()), (Some("Anna"), 0, 16));
        for mark in [("L", "R"), ("thigh", "shank")] {
            let stored = labels(&[mark.0, mark.1], "_", 4);
            let chosen = choose(&stored, true, &strings(&["S01"]), &[]);
            assert_eq!((chosen.people.len(), used(&chosen)), (0, stored));
        }
        let repeated = strings(&["LASI", "LASI", "RASI"]);
        assert_eq!(choose(&repeated, true, &[], &[]).people.len(), 0);
    }
}

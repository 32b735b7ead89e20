//! Columns of ground reactions: which column of a MOT or STO table is which component of which
//! plate, by the names that programs give them, or as the laboratory states it.
//!
//! OpenSim prescribes no names (a file beside the table says what its columns are), so every
//! program has its own: `ground_force_vx`, `ground_force_px`, `ground_torque_x`;
//! `1_ground_force_vx`; `ground_force_1_vx`, `ground_moment_1_mx`; `ground_force1_vx` (MOtoNMS);
//! `R_ground_force_vx` (OpenCap); `ground_force_calcn_l_vx` (AddBiomechanics); `force1_vx`,
//! `moment1_x`; `calcn_r_force_vx`; `grf_r_vx`; `FP1_Fx`; `f1_x`, `p1_x`, `m1_x` (the C3D adapter
//! of OpenSim); `Fx1`, `COPx1`, `Mz1`. All of them name a quantity, an axis and a plate in words;
//! this module reads the words, and what it cannot read is listed, never dropped in silence.

use crate::TrialError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Names of three columns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum ColumnNames {
    /// What stands before `x`, `y` and `z`, as in an ExternalLoads file of OpenSim.
    Before(String),
    /// The columns for x, y and z; none for a component that is zero.
    Each([Option<String>; 3]),
}

/// The columns of a plate, as the laboratory states them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlateNames {
    /// Force on the subject, N.
    pub force: ColumnNames,
    /// Point of application, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<ColumnNames>,
    /// Moment about that point, N·m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment: Option<ColumnNames>,
}

/// Quantity of a ground reaction column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Force,
    Point,
    Moment,
}

/// Columns of one plate.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PlateColumns {
    /// The plate's name.
    pub name: String,
    /// Columns of x, y and z of the force.
    pub force: [usize; 3],
    /// Those of the point of application.
    pub point: [Option<usize>; 3],
    /// Those of the moment about it.
    pub moment: [Option<usize>; 3],
}

/// Plates of a table, and the columns that belong to none of them.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Assigned {
    pub plates: Vec<PlateColumns>,
    /// Labels, in the order of the table.
    pub unused: Vec<String>,
}

/// Words that name a quantity or say that the label is about a plate at all.
const FORCE: [&str; 3] = ["force", "grf", "f"];
const POINT: [&str; 4] = ["point", "position", "cop", "p"];
const MOMENT: [&str; 6] = ["moment", "torque", "grm", "m", "t", "tau"];
const ABOUT_PLATES: [&str; 13] = [
    "ground",
    "reaction",
    "force",
    "grf",
    "grm",
    "moment",
    "torque",
    "cop",
    "fp",
    "plate",
    "platform",
    "forceplate",
    "forceplatform",
];
/// Words that do not name the plate.
const NOT_A_NAME: [&str; 4] = ["ground", "reaction", "free", "v"];
/// Words for the sum of several plates.
const SUM: [&str; 6] = ["total", "sum", "net", "combined", "both", "resultant"];
/// Words for a plate, which stay in its name.
const PLATE: [&str; 2] = ["fp", "plate"];
/// Words for a side of the body.
const SIDES: [&str; 4] = ["l", "r", "left", "right"];

/// A run of letters or of digits in a label, in lower case.
#[derive(Debug, Clone, PartialEq)]
struct Word {
    text: String,
    /// True if no other character separates it from the word before it.
    joined: bool,
}

impl Word {
    fn is(&self, list: &[&str]) -> bool {
        list.contains(&self.text.as_str())
    }
    fn is_number(&self) -> bool {
        self.text.starts_with(|c: char| c.is_ascii_digit())
    }
}

fn words(label: &str) -> Vec<Word> {
    let mut out: Vec<Word> = Vec::new();
    let mut before = ' ';
    for c in label.chars().flat_map(char::to_lowercase) {
        let goes_on = c.is_alphanumeric() && before.is_alphanumeric();
        match out.last_mut() {
            Some(word) if goes_on && c.is_ascii_digit() == before.is_ascii_digit() => word.text.push(c),
            _ if c.is_alphanumeric() => out.push(Word { text: c.to_string(), joined: goes_on }),
            _ => {}
        }
        before = c;
    }
    out
}

/// A word such as `vx`, `px`, `copx` or `x`: what stands before the axis, and the axis.
fn axis_word(word: &str) -> Option<(&str, usize)> {
    let axis = ["x", "y", "z"].iter().position(|a| word.ends_with(a))?;
    let before = &word[..word.len() - 1];
    let known = before.is_empty() || before == "v" || [&FORCE[..], &POINT, &MOMENT].iter().any(|l| l.contains(&before));
    known.then_some((before, axis))
}

/// Splits a label into the plate's name, the quantity and the axis.
fn parse_column(label: &str) -> Option<(String, Quantity, usize)> {
    let mut words = words(label);
    // the axis is the last word, save for the number or the side of a plate behind it (`Fx1`)
    let plain = |w: &Word| w.is_number() || w.is(&SIDES) || w.is(&PLATE);
    let behind = words.iter().rev().take_while(|w| plain(w)).count();
    let at = words.len().checked_sub(behind + 1)?;
    let (before, axis) = match axis_word(&words[at].text) {
        Some((before, axis)) => (before.to_owned(), axis),
        // `f1_1`, `f1_2`, `f1_3`: a plate, and the axis as a number
        None => {
            let [quantity, plate, number] = words.as_slice() else { return None };
            let short = quantity.is(&["f", "p", "m"]) && plate.is_number() && plate.joined && !number.joined;
            // none: a name that does not end in a number is of another family
            let axis = number.text.parse::<usize>().ok()?.checked_sub(1).filter(|a| *a < 3 && short)?;
            return Some((plate.text.clone(), quantity_of(&quantity.text, [false; 3])?, axis));
        }
    };
    words.remove(at);
    if let Some(next) = words.get_mut(at) {
        // `Fx1` and `Fx_1` are the same plate
        next.joined = false;
    }
    let has = |list: &[&str]| words.iter().any(|w| w.is(list));
    let quantity = quantity_of(&before, [has(&FORCE), has(&POINT), has(&MOMENT)])?;
    let about = has(&ABOUT_PLATES) || ABOUT_PLATES.contains(&before.as_str());
    let is_name = |w: &Word| !w.is(&NOT_A_NAME) && ![&FORCE[..], &POINT, &MOMENT].iter().any(|l| w.is(l));
    let name: Vec<&Word> = words.iter().filter(|w| is_name(w)).collect();
    // without such a word, only a label that holds nothing but quantity, axis and plate
    let plain = name.iter().all(|w| plain(w));
    let short = plain && (!before.is_empty() || has(&["f", "p", "m"])) && before != "v" && before != "t";
    // `contactHeel_r.ground.force.X` is a component of a model, not a plate
    let component = before.is_empty() && quantity == Quantity::Force && !plain;
    if !(about || short) || component {
        return None;
    }
    let mut key = String::new();
    for word in name {
        if !key.is_empty() && !word.joined {
            key.push('_');
        }
        key.push_str(&word.text);
    }
    Some((key, quantity, axis))
}

/// The quantity that the letters before the axis and the other words (force, point, moment) name;
/// none where they contradict each other.
fn quantity_of(before: &str, [force, point, moment]: [bool; 3]) -> Option<Quantity> {
    let quantity = match before {
        // `ground_torque_calcn_l_vx`: v only says that it is a vector
        "v" | "" if moment => Quantity::Moment,
        "" if point => Quantity::Point,
        "v" => Quantity::Force,
        "" if force => Quantity::Force,
        "" => return None,
        b if FORCE.contains(&b) => Quantity::Force,
        b if POINT.contains(&b) => Quantity::Point,
        _ => Quantity::Moment,
    };
    let contradiction = match quantity {
        Quantity::Force => moment || point,
        Quantity::Point => moment,
        Quantity::Moment => point,
    };
    (!contradiction).then_some(quantity)
}

/// Columns of the plates by the names of the columns. The first label is the time.
pub(crate) fn by_name(labels: &[String]) -> Assigned {
    let mut found: Vec<(String, [[Option<usize>; 3]; 3])> = Vec::new();
    for (column, label) in labels.iter().enumerate().skip(1) {
        let Some((key, quantity, axis)) = parse_column(label) else { continue };
        let slot = found.iter().position(|(known, _)| *known == key).unwrap_or_else(|| {
            found.push((key, [[None; 3]; 3]));
            found.len() - 1
        });
        // of two columns for the same component the later one is not used, and listed
        found[slot].1[quantity as usize][axis].get_or_insert(column);
    }
    let is_sum = |key: &str| words(key).iter().any(|w| w.is(&SUM));
    let parts = found.iter().filter(|(key, at)| at[0].iter().all(Option::is_some) && !is_sum(key)).count();
    found.retain(|(key, _)| parts == 0 || !is_sum(key));
    let plates = found.into_iter().filter_map(|(key, [force, point, moment])| {
        let [Some(x), Some(y), Some(z)] = force else { return None };
        let name = if key.is_empty() { "FP".to_owned() } else { key };
        Some(PlateColumns { name, force: [x, y, z], point, moment })
    });
    with_unused(labels, plates.collect())
}

/// Columns of the plates as the laboratory names them.
///
/// # Errors
/// A column that the table does not have.
pub(crate) fn as_stated(
    trial: &str,
    labels: &[String],
    stated: &BTreeMap<String, PlateNames>,
) -> Result<Assigned, TrialError> {
    let column = |plate: &str, name: &str| {
        let same = |l: &String| l == name;
        let alike = |l: &String| l.eq_ignore_ascii_case(name);
        labels.iter().position(same).or_else(|| labels.iter().position(alike)).ok_or_else(|| TrialError::ForceColumn {
            trial: trial.to_owned(),
            plate: plate.to_owned(),
            column: name.to_owned(),
            found: in_words(&labels[1..]),
        })
    };
    let three = |plate: &str, names: &ColumnNames| -> Result<[Option<usize>; 3], TrialError> {
        let mut out = [None; 3];
        for (axis, place) in out.iter_mut().enumerate() {
            let name = match names {
                ColumnNames::Before(before) => Some(format!("{before}{}", ["x", "y", "z"][axis])),
                ColumnNames::Each(names) => names[axis].clone(),
            };
            *place = name.map(|n| column(plate, &n)).transpose()?;
        }
        Ok(out)
    };
    let mut plates = Vec::new();
    for (name, names) in stated {
        let of = |names: &Option<ColumnNames>| names.as_ref().map_or(Ok([None; 3]), |n| three(name, n));
        let [Some(x), Some(y), Some(z)] = three(name, &names.force)? else {
            return Err(TrialError::ForceColumn {
                trial: trial.to_owned(),
                plate: name.clone(),
                column: "all of x, y and z of its force".to_owned(),
                found: "fewer".to_owned(),
            });
        };
        let (point, moment) = (of(&names.point)?, of(&names.moment)?);
        plates.push(PlateColumns { name: name.clone(), force: [x, y, z], point, moment });
    }
    Ok(with_unused(labels, plates))
}

fn with_unused(labels: &[String], plates: Vec<PlateColumns>) -> Assigned {
    let mut used = vec![false; labels.len()];
    for plate in &plates {
        let own = plate.force.iter().chain(plate.point.iter().flatten()).chain(plate.moment.iter().flatten());
        own.for_each(|c| used[*c] = true);
    }
    let unused = labels.iter().zip(&used).skip(1).filter(|(_, used)| !**used).map(|(label, _)| label.clone());
    Assigned { unused: unused.collect(), plates }
}

/// Labels in words, those that differ in the axis alone as one: `ground_torque1_x … z`.
pub(crate) fn in_words(labels: &[String]) -> String {
    const SHOWN: usize = 8;
    let stem = |l: &String| l.to_lowercase().strip_suffix(['x', 'y', 'z']).map(str::to_owned);
    let mut out: Vec<String> = Vec::new();
    let mut i = 0;
    while i < labels.len() {
        let same = stem(&labels[i]);
        let n = labels[i..].iter().take(3).take_while(|l| same.is_some() && stem(l) == same).count().max(1);
        let last = &labels[i + n - 1];
        out.push(match n {
            1 => format!("`{last}`"),
            _ => format!("`{}` to `{}`", labels[i], last.chars().next_back().unwrap_or('z')),
        });
        i += n;
    }
    let more = if out.len() > SHOWN { format!(" … ({} columns in all)", labels.len()) } else { String::new() };
    out.truncate(SHOWN);
    format!("{}{more}", out.join(", "))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    fn labels(names: &[&str]) -> Vec<String> {
        std::iter::once("time").chain(names.iter().copied()).map(str::to_owned).collect()
    }

    #[test]
    fn regress_column_names_of_many_programs() {
        let case = |label: &str| parse_column(label).map(|(key, quantity, axis)| (key, quantity as usize, axis));
        for (label, key, quantity, axis) in [
            ("ground_force_vx", "", 0, 0),
            ("1_ground_force_vy", "1", 0, 1),
            ("l_ground_force_pz", "l", 1, 2),
            ("ground_torque_y", "", 2, 1),
            ("1_ground_torque_z", "1", 2, 2),
            ("ground_force_2_vx", "2", 0, 0),
            ("ground_force_2_px", "2", 1, 0),
            ("ground_force_2_mz", "2", 2, 2),
            ("ground_moment_3_mx", "3", 2, 0),
            ("ground_torque_3_x", "3", 2, 0),
            ("ground_force_calcn_r_vy", "calcn_r", 0, 1),
            ("ground_torque_calcn_l_vx", "calcn_l", 2, 0),
            ("R_ground_force_vx", "r", 0, 0),
            ("R_ground_torque_x", "r", 2, 0),
            ("ground_force1_vx", "1", 0, 0),
            ("ground_force1_pz", "1", 1, 2),
            ("ground_torque1_x", "1", 2, 0),
            ("ground_force_left_vx", "left", 0, 0),
            ("ground_force_R_px", "r", 1, 0),
            ("ground_torque_R_z", "r", 2, 2),
            ("force1_vx", "1", 0, 0),
            ("force1_px", "1", 1, 0),
            ("moment1_x", "1", 2, 0),
            ("calcn_r_force_vx", "calcn_r", 0, 0),
            ("calcn_r_force_px", "calcn_r", 1, 0),
            ("calcn_r_torque_x", "calcn_r", 2, 0),
            ("grf_l_vx", "l", 0, 0),
            ("grf_l_torque_x", "l", 2, 0),
            ("FP1_ground_force_vz", "fp1", 0, 2),
            ("FP1_vx", "fp1", 0, 0),
            ("FP1_px", "fp1", 1, 0),
            ("FP1_tz", "fp1", 2, 2),
            ("FP1_Fx", "fp1", 0, 0),
            ("FP1.ForceX", "fp1", 0, 0),
            ("Fx_FP1", "fp1", 0, 0),
            ("f1_x", "1", 0, 0),
            ("p1_y", "1", 1, 1),
            ("m2_z", "2", 2, 2),
            ("f1_1", "1", 0, 0),
            ("m2_3", "2", 2, 2),
            ("Fx1", "1", 0, 0),
            ("Fx_1", "1", 0, 0),
            ("COPy2", "2", 1, 1),
            ("CoP_X_1", "1", 1, 0),
            ("Mz", "", 2, 2),
            ("Force:X", "", 0, 0),
            ("Force2:Z", "2", 0, 2),
            ("Right_GRF_x", "right", 0, 0),
        ] {
            assert_eq!(case(label), Some((key.to_owned(), quantity, axis)), "{label}");
        }
        for label in [
            "pelvis_tx",
            "pelvis_tx_force",
            "knee_angle_r",
            "hip_flexion_r_moment",
            "ground_force_totaly",
            "ground_force1_angle",
            "ankle_r_on_calcn_r_in_calcn_r_fx",
            "contactHeel_r.ground.force.X",
            "Ax",
            "EMG_1",
            "tx",
            "",
        ] {
            assert_eq!(case(label), None, "{label}");
        }
    }

    #[test]
    fn columns_that_belong_to_no_plate_are_listed_and_sums_are_not_counted_twice() {
        let table = labels(&[
            "ground_force_vx",
            "ground_force_vy",
            "ground_force_vz",
            "ground_torque_9_x",
            "ground_torque_9_y",
            "ground_torque_9_z",
            "total_force_vx",
            "total_force_vy",
            "total_force_vz",
            "Fz7",
            "emg",
            "ground_force_vx",
        ]);
        let found = by_name(&table);
        assert_eq!(found.plates.len(), 1);
        assert_eq!((found.plates[0].name.as_str(), found.plates[0].force), ("FP", [1, 2, 3]));
        assert_eq!(found.unused, table[4..]);
        assert_eq!(
            in_words(&found.unused),
            "`ground_torque_9_x` to `z`, `total_force_vx` to `z`, `Fz7`, `emg`, `ground_force_vx`"
        );
        let alone = by_name(&labels(&["total_force_vx", "total_force_vy", "total_force_vz"]));
        assert_eq!((alone.plates.len(), alone.unused.len()), (1, 0));
    }

    #[test]
    fn stated_columns_are_taken_and_one_that_is_not_there_is_an_error() {
        let table = labels(&["Ax", "Ay", "fa", "fb", "fc", "tz", "ta_x", "ta_y", "ta_z"]);
        let each = |names: [Option<&str>; 3]| ColumnNames::Each(names.map(|n| n.map(str::to_owned)));
        let mut stated = BTreeMap::new();
        let names = PlateNames {
            force: each([Some("fa"), Some("fb"), Some("FC")]),
            point: Some(each([Some("Ax"), None, Some("Ay")])),
            moment: Some(ColumnNames::Before("ta_".to_owned())),
        };
        stated.insert("FP1".to_owned(), names.clone());
        let found = as_stated("t", &table, &stated).unwrap();
        let point = [Some(1), None, Some(2)];
        let moment = [Some(7), Some(8), Some(9)];
        assert_eq!(found.plates, [PlateColumns { name: "FP1".into(), force: [3, 4, 5], point, moment }]);
        assert_eq!(found.unused, ["tz"]);
        stated.insert("FP2".to_owned(), PlateNames { force: ColumnNames::Before("zz".into()), ..names });
        let wrong = as_stated("jump", &table, &stated).unwrap_err().to_string();
        assert!(wrong.starts_with("jump: `import: {forces: …}` names `zzx` for the plate `FP2`"), "{wrong}");
    }
}

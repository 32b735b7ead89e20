//! The result for joints in words.

use super::result::JointFinding;
use crate::result::{Estimate, FEWEST_CLUSTERS, Found, Verdict};
use crate::wording::decimals;
use aloft_effects::effect;
use aloft_identify::half_of;

fn estimate(e: &Estimate) -> String {
    let half = half_of(e.ci95).unwrap_or(f64::NAN);
    let digits = decimals(half);
    match e.ci95 {
        Some(_) => format!("{} {:.digits$} ± {half:.digits$} {} (95 %)", e.name, e.value, e.unit),
        None => format!("{} {:.digits$} {}", e.name, e.value, e.unit),
    }
}

fn size(f: &Found) -> String {
    f.coefficients.iter().chain(&f.nonlinear).map(estimate).collect::<Vec<_>>().join(", ")
}

/// Error with its floor.
fn error(j: &JointFinding, value: f64) -> String {
    if j.noise_floor.is_finite() {
        format!("{value:.3} {} ({:.1} times the floor)", j.unit, value / j.noise_floor)
    } else {
        format!("{value:.3} {} (floor not known)", j.unit)
    }
}

/// One joint.
pub(super) fn joint(j: &JointFinding, found: &[Found], threshold: f64) -> String {
    let names = |ids: &[String]| ids.iter().map(|id| format!("`{id}[{}]`", j.joint)).collect::<Vec<_>>().join(" or ");
    let sizes = found.iter().map(|f| format!("`{}` ({})", f.key, size(f))).collect::<Vec<_>>().join(" and ");
    match j.verdict {
        Verdict::Supported => format!(
            "{sizes} missing: the held-out torque error falls from {} to {}",
            error(j, j.held_out_error),
            error(j, j.held_out_error_after)
        ),
        Verdict::OneOf => {
            let apart = j.effects.first().zip(j.effects.get(1)).and_then(|(a, b)| {
                // none: a law of the user's own is not in the catalogue
                let (a, b) = (effect(a).ok()?.about(), effect(b).ok()?.about());
                Some(format!("; they are told apart by {}", a.told_apart_by(&b)))
            });
            format!(
                "one of {} is missing, which these flights cannot tell apart: the held-out torque error falls from {} to {} with {sizes}{}",
                names(&j.effects),
                error(j, j.held_out_error),
                error(j, j.held_out_error_after),
                apart.unwrap_or_default()
            )
        }
        Verdict::Unexplained if found.is_empty() => {
            let best = j.candidates.first().map_or(String::new(), |c| {
                format!("; the best law, `{}`, leaves {:.0} % of it", c.key, 100.0 * c.held_out_ratio)
            });
            format!(
                "unexplained: the held-out torque error is {}, and no law explains it{best}",
                error(j, j.held_out_error)
            )
        }
        Verdict::Unexplained => format!(
            "unexplained: the held-out torque error is {}; {} removes part of it and leaves {}, so it is not shown to be the cause",
            error(j, j.held_out_error),
            found.iter().map(|f| format!("`{}`", f.key)).collect::<Vec<_>>().join(" and "),
            error(j, j.held_out_error_after)
        ),
        Verdict::NothingMissing => {
            let best = j.candidates.first().map_or(String::new(), |c| {
                format!(
                    "; the best law, `{}`, leaves {:.0} %, and less than {:.0} % would be believed",
                    c.key,
                    100.0 * c.held_out_ratio,
                    100.0 * threshold
                )
            });
            format!("nothing missing: the held-out torque error is {}{best}", error(j, j.held_out_error))
        }
        Verdict::NotDetectable if j.noise_floor.is_nan() => "its noise floor is not known: no law is named".to_owned(),
        Verdict::NotDetectable => format!("moves in fewer than {FEWEST_CLUSTERS} flights: too few to name a law"),
    }
}

/// Most joints whose reasons stand in the words of the whole.
const MOST_IN_WORDS: usize = 3;

/// All joints.
pub(super) fn all(joints: &[JointFinding], clusters: usize) -> String {
    if clusters < FEWEST_CLUSTERS {
        return format!("joint torques: {clusters} flights, fewer than {FEWEST_CLUSTERS}: too few to name a law");
    }
    let named: Vec<String> = joints
        .iter()
        .filter(|j| !matches!(j.verdict, Verdict::NothingMissing | Verdict::NotDetectable))
        .map(|j| format!("{}: {}", j.joint, j.words))
        .collect();
    let judged = joints.iter().filter(|j| j.verdict != Verdict::NotDetectable).count();
    if judged == 0 {
        return "no joint could be judged".to_owned();
    }
    if named.is_empty() {
        let worst = joints.iter().map(JointFinding::times_floor).filter(|t| t.is_finite()).fold(0.0, f64::max);
        return format!(
            "nothing missing in the torques of {judged} of {} joints: at most {worst:.1} times the floor",
            joints.len()
        );
    }
    if named.len() > MOST_IN_WORDS {
        let short: Vec<String> = joints
            .iter()
            .filter_map(|j| match j.verdict {
                Verdict::Supported | Verdict::OneOf => Some(format!("{} ({})", j.joint, j.effects.join(" or "))),
                Verdict::Unexplained => Some(format!("{} (unexplained)", j.joint)),
                Verdict::NothingMissing | Verdict::NotDetectable => None,
            })
            .collect();
        return format!("{} of {} joints lack something: {}", short.len(), joints.len(), short.join(", "));
    }
    named.join("; ")
}

//! What the torques of a robot's joints leave, and which law of a joint is missing.

use super::discovery::{verdict_light, verdict_word};
use super::wording::{number, plus_minus, unit};
use aloft_discover::{Estimate, JointDiscovery, JointFinding};
use aloft_page::{Block, Cell, Section, Table};

/// The section; `suffix` keeps the identifier unique if the page has several answers.
pub fn section(j: &JointDiscovery, suffix: &str) -> Section {
    let words = j.words.clone();
    let blocks = vec![Block::remark(verdict_light(j.verdict), words), table(j).into()];
    Section::new(
        format!("torques{suffix}"),
        "The torques of the joints",
        "Reflected inertia, viscous and Coulomb friction and the gain of each joint are estimated beside the body, without each flight (or \
         recording) in turn; the error is what they leave in it.",
        blocks,
    )
}

fn size(e: &Estimate) -> String {
    format!("{} {} {}", e.name.replace('_', " "), plus_minus(e.value, e.ci95), unit(&e.unit))
}

fn row(j: &JointDiscovery, f: &JointFinding) -> Vec<Cell> {
    let own = j.found.iter().filter(|k| k.key.ends_with(&format!("[{}]", f.joint)));
    let found: Vec<String> = own
        .map(|k| {
            let sizes: Vec<String> = k.coefficients.iter().chain(&k.nonlinear).map(size).collect();
            format!("{}: {}", k.effect, sizes.join(", "))
        })
        .collect();
    let finite = |x: f64| if x.is_finite() { number(x) } else { "–".to_owned() };
    let best = f.candidates.first().map_or("–".to_owned(), |c| format!("{} ({:.2})", c.effect, c.held_out_ratio));
    vec![
        f.joint.clone().into(),
        format!("{} {}", finite(f.held_out_error), f.unit).into(),
        if found.is_empty() { "–".to_owned() } else { finite(f.held_out_error_after) }.into(),
        finite(f.noise_floor).into(),
        finite(f.times_floor()).into(),
        verdict_word(f.verdict).into(),
        best.into(),
        if found.is_empty() { "–".to_owned() } else { found.join("; ") }.into(),
    ]
}

fn table(j: &JointDiscovery) -> Table {
    Table::new(
        "Joints",
        "Held-out error of the torque over windows of 0.12 s, and what a perfect model would leave: noise of encoders, base pose, inertial \
         unit and torque sensor. The best law with the share of the error that it leaves is named even where it is not believed.",
        &[
            "joint",
            "held-out error",
            "with what was found",
            "floor",
            "times floor",
            "verdict",
            "best law (ratio)",
            "found",
        ],
        j.joints.iter().map(|f| row(j, f)).collect(),
    )
}

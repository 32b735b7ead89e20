//! Output of the search beyond the catalogue as text.

use crate::args::PipelineArgs;
use crate::open::description_of;
use crate::render::{out, plus_minus, significant};
use crate::stop::Stop;
use aloft_discover::{Action, FoundLaw, OpenWorld};
use aloft_study::quote;

/// What the search found: where the error acts, laws as formulas, and how to add them.
pub fn laws(found: &OpenWorld, at: &PipelineArgs) -> Result<(), Stop> {
    out("beyond the catalogue")?;
    if let Some(d) = &found.diagnosis {
        out(format!("  where: {}", d.text))?;
        out(format!(
            "  by chance the best of {} combinations does as well with a probability of {:.3}",
            found.entries, d.family_wise_p
        ))?;
    }
    if found.laws.is_empty() {
        return out("  no law of these combinations brings the error near its floor");
    }
    for law in &found.laws {
        one(law)?;
    }
    if let Some(times) = found.times_floor_after {
        out(format!(
            "  held-out error with {}: {} N, {} times the noise floor",
            if found.laws.len() == 1 { "it" } else { "them" },
            significant(found.held_out_error_after, 3),
            significant(times, 3)
        ))?;
    }
    for law in &found.laws {
        let chosen = |flag: &str, names: &[String]| {
            names
                .iter()
                .flat_map(|n| quote::option(flag, n))
                .map(|w| format!(" {}", quote::word(&w)))
                .collect::<String>()
        };
        out(format!(
            "  add it: aloft effect add {} {}{}{}   (writes effects/{}.yaml beside the pipeline)",
            description_of(at),
            quote::word(&law.id),
            chosen("subject", &at.subject),
            chosen("session", &at.session),
            law.id
        ))?;
    }
    Ok(())
}

fn one(law: &FoundLaw) -> Result<(), Stop> {
    out(format!("  {}: {}", law.id, law.text))?;
    let unit = match law.action {
        Action::Force => "N",
        Action::Couple => "N·m",
    };
    out(format!("    strength ({unit}) = {}", law.strength))?;
    for e in law.coefficients.iter().chain(&law.parameters).chain(&law.point) {
        out(format!("    {} = {}{} {}", e.name, significant(e.value, 4), plus_minus(e.ci95, e.at_bound), e.unit))?;
    }
    Ok(())
}

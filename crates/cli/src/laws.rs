//! Output of the search beyond the catalogue as text.

use crate::render::{beside, half, out, significant, unit};
use crate::screen::{labelled, table};
use crate::stop::Stop;
use aloft_discover::{Action, FoundLaw, OpenWorld};

/// What the search found: where the error acts, and laws as formulas. `effect add` writes a law
/// into the folder `effects` beside the pipeline.
pub fn laws(found: &OpenWorld) -> Result<(), Stop> {
    out("beyond the catalogue")?;
    if let Some(d) = &found.diagnosis {
        out(labelled("  where: ", &d.text))?;
        out(labelled(
            "  ",
            &format!(
                "with random signs the best of {} combinations does as well with a probability of about {:.3}",
                found.entries, d.family_wise_p
            ),
        ))?;
    }
    if found.laws.is_empty() {
        return out(labelled("  ", "no law of these combinations brings the error near its floor"));
    }
    for law in &found.laws {
        one(law)?;
    }
    let right = match found.laws.len() {
        1 => "95 % interval if this law is the right one",
        _ => "95 % interval if these laws are the right ones, with all of them in the model",
    };
    out(labelled("  ±: ", right))?;
    if let Some(times) = found.times_floor_after {
        let it = if found.laws.len() == 1 { "it" } else { "them" };
        let words = format!(
            "held-out error with {it}: {} N, {} times the noise floor; `effect add` writes a file effects/NAME.yaml beside the pipeline",
            significant(found.held_out_error_after, 3),
            significant(times, 2)
        );
        out(labelled("  ", &words))?;
    }
    Ok(())
}

fn one(law: &FoundLaw) -> Result<(), Stop> {
    out(labelled(&format!("  {}: ", law.id), &law.text))?;
    let of = match law.action {
        Action::Force => "N",
        Action::Couple => "N·m",
    };
    out(labelled(&format!("    strength ({of}) = "), &law.strength.to_string()))?;
    let mut t = table(&["    constant", "value", "± 95 %", "unit"]).left(&[3]);
    let values = law.coefficients.iter().chain(&law.parameters).map(|e| (e, "–"));
    for (e, without) in values.chain(law.point.iter().map(|e| (e, "not determined along the force"))) {
        let half = match e.ci95 {
            _ if e.at_bound => "at its bound".to_owned(),
            Some(_) => half(e.ci95),
            None => without.to_owned(),
        };
        t.add_row([format!("    {}", e.name), beside(e.value, e.ci95), half, unit(&e.unit)]);
    }
    out(t)
}

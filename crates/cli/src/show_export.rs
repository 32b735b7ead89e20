//! What an export wrote, and what an audit of a model file found.

use crate::render::{note, out, table};
use crate::screen::labelled;
use crate::stop::Stop;
use aloft_analysis::{audit, export};
use aloft_study::quote::visible;

/// What was written, and what was not.
pub fn exported(done: &export::Exported) -> Result<(), Stop> {
    for remark in &done.remarks {
        note(format!("warning: {remark}"));
    }
    for (what, problem) in &done.failures {
        note(format!("failed: {what}: {problem}"));
    }
    let mut parts = Vec::new();
    for (count, word) in
        [(done.added, "new"), (done.changed, "changed"), (done.unchanged, "as before"), (done.removed, "removed")]
    {
        if count > 0 {
            parts.push(format!("{count} {word}"));
        }
    }
    note(format!("files: {}; README.md says what each is", parts.join(", ")));
    out(done.folder.display())
}

/// Whether a model file balances, by recording and by body.
pub fn audited(a: &audit::Audit) -> Result<(), Stop> {
    let figure = crate::errors::figure;
    out(labelled("model       ", &format!("{}: {:.2} kg in {} bodies", visible(&a.file), a.mass_kg, a.bodies.len())))?;
    let header = [
        "recording",
        "markers mm",
        "flights",
        "fall / g",
        "in flight N",
        "contact s",
        "in contact N",
        "plates / model",
    ];
    let mut t = table(&header);
    for r in &a.trials {
        t.add_row([
            visible(&r.trial),
            figure(r.marker_rms_mm),
            r.flights.to_string(),
            r.fall_over_gravity.map_or("–".to_owned(), |f| format!("{f:.3}")),
            figure(r.flight_error_n),
            format!("{:.2}", r.contact_s),
            figure(r.contact_error_n),
            r.load_ratio.map_or("–".to_owned(), |x| format!("{x:.3}")),
        ]);
    }
    out(t)?;
    if !a.segments.is_empty() {
        let mut t =
            table(&["body", "share of the error that changing only this body's inertia would remove"]).left(&[1]);
        for s in a.segments.iter().take(6) {
            t.add_row([s.link.clone(), format!("{:.0} %", 100.0 * s.inertia_share)]);
        }
        out(t)?;
    }
    for line in &a.words {
        out(labelled("- ", line))?;
    }
    out(labelled(
        "",
        "error: root mean square over windows of force, with moment over a lever of 0.1 m; there is no noise floor, since \
         coordinates in a file do not say how uncertain they are",
    ))
}

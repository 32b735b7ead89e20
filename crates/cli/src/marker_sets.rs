//! `aloft markerset`: checks and drafts marker sets.

use crate::Success;
use crate::args::MarkerSetAction;
use crate::render::{command, json, note, out};
use crate::screen::labelled;
use crate::stop::Stop;
use aloft_analysis::markerset;
use aloft_study::quote;
use aloft_workspace::error::PipelineError;

/// Carries out one of its actions.
pub fn marker_sets(action: MarkerSetAction) -> Result<Success, Stop> {
    match action {
        MarkerSetAction::Check { file, json: as_json } => {
            let found = markerset::check(&file)?;
            if as_json {
                json(&found)?;
            } else {
                let line = |f: &markerset::SetFinding, word: &str| {
                    let at = f.line.map_or(String::new(), |l| format!("line {l}: "));
                    let hint = f.hint.as_ref().map_or(String::new(), |h| format!("; {h}"));
                    out(labelled(&format!("{word}  "), &format!("{at}{}{hint}", f.problem)))
                };
                found.errors.iter().try_for_each(|f| line(f, "error "))?;
                found.remarks.iter().try_for_each(|f| line(f, "remark"))?;
            }
            if found.errors.is_empty() {
                note(format!(
                    "{}: {} markers for the model {}; the set can be used",
                    found.file, found.markers, found.model
                ));
                return Ok(Success::Full);
            }
            Err(PipelineError::request_hint(
                format!("{}: the marker set cannot be used: {} errors", found.file, found.errors.len()),
                "correct the lines that are named, and check it again",
            )
            .into())
        }
        MarkerSetAction::Draft { folder, out: target, json: as_json } => {
            let mut found = markerset::draft(&folder)?;
            if let Some(stem) = target.as_ref().and_then(|t| t.file_stem()) {
                found.name = stem.to_string_lossy().into_owned();
            }
            if as_json {
                json(&found)?;
                return Ok(Success::Full);
            }
            for why in &found.not_read {
                note(format!("warning: not read: {why}"));
            }
            let text = markerset::to_yaml(&found);
            match target {
                None => out(text.trim_end())?,
                Some(target) => {
                    markerset::write_new(&target, &text)?;
                    note(format!("wrote {}", target.display()));
                    command("next", &format!("aloft markerset check {}", quote::path(&target)));
                }
            }
            let doubts = found.markers.iter().filter(|m| m.link.is_none() || !m.doubts.is_empty()).count();
            note(format!("{} markers, {doubts} of them to be checked", found.markers.len()));
            Ok(Success::Full)
        }
    }
}

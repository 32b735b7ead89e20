//! Events: those of the group EVENT and the short ones of the header.

use crate::{FileEvent, HeaderEvent, Parameters, Warning, WarningKind};

/// The events of the group EVENT. TIMES holds minutes and seconds.
pub(crate) fn events_of_group(groups: &Parameters, warnings: &mut Vec<Warning>) -> Vec<FileEvent> {
    let Some(group) = groups.group("EVENT") else { return Vec::new() };
    let times = groups.merged_numbers("EVENT", "TIMES");
    let labels = groups.merged_strings("EVENT", "LABELS");
    let contexts = groups.merged_strings("EVENT", "CONTEXTS");
    let subjects = groups.merged_strings("EVENT", "SUBJECTS");
    let descriptions = groups.merged_strings("EVENT", "DESCRIPTIONS");
    let used = group.get("USED").and_then(|p| p.count());
    // minutes and seconds in rows of two; some writers give the same numbers one dimension, [2n]
    let flat = |p: &crate::Parameter| {
        let count = used.unwrap_or(labels.len());
        p.dimensions.len() == 1 && count > 0 && times.len() == 2 * count && labels.len() <= count
    };
    let pairs = group.get("TIMES").is_none_or(|p| p.dimensions.first().is_none_or(|d| *d == 2) || flat(p));
    let held = if pairs { times.len() / 2 } else { times.len() };
    let n = used.unwrap_or(held);
    if n > held {
        let message = format!("EVENT:USED is {n}, EVENT:TIMES holds {held}; the rest is left out");
        warnings.push(Warning::new(WarningKind::Events, message));
    }
    let text = |list: &[String], i: usize| list.get(i).cloned().unwrap_or_default();
    let mut events = Vec::with_capacity(n.min(held));
    for i in 0..n.min(held) {
        let time_s = if pairs { 60.0 * times[2 * i] + times[2 * i + 1] } else { times[i] };
        if !time_s.is_finite() {
            let message = format!("event {} ({}): time {time_s} s; left out", i + 1, text(&labels, i));
            warnings.push(Warning::new(WarningKind::Events, message));
            continue;
        }
        events.push(FileEvent {
            label: text(&labels, i),
            context: text(&contexts, i),
            time_s,
            subject: text(&subjects, i),
            description: text(&descriptions, i),
        });
    }
    events
}

/// Converts the events of the header to the form of the group's events.
pub(crate) fn events_of_header(events: &[HeaderEvent]) -> Vec<FileEvent> {
    let finite = events.iter().filter(|e| e.time_s.is_finite());
    finite.map(|e| FileEvent { label: e.label.clone(), time_s: f64::from(e.time_s), ..FileEvent::default() }).collect()
}

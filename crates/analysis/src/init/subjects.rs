//! Whose recordings are looked at: files of several subjects in one folder would become one body.

use super::InitOptions;
use super::look::Determination;
use aloft_pipeline::recording::abridged;
use aloft_study::quote;
use aloft_trial::person_key;
use aloft_workspace::error::PipelineError;
use std::collections::BTreeMap;
use std::path::Path;

/// The subjects that files name (SUBJECTS:NAMES), each with its number of files.
fn named(seen: &[Determination]) -> BTreeMap<String, (String, usize)> {
    let mut names: BTreeMap<String, (String, usize)> = BTreeMap::new();
    for name in seen.iter().filter_map(|s| s.stated.subject.as_ref()) {
        names.entry(person_key(name)).or_insert_with(|| (name.clone(), 0)).1 += 1;
    }
    names
}

/// The recordings of the subject that was asked for, and the names of the others.
///
/// # Errors
/// Files of several subjects where none was chosen; a name that no file states.
pub(super) fn chosen(
    folder: &Path,
    seen: Vec<Determination>,
    options: &InitOptions,
) -> Result<(Vec<Determination>, Vec<String>), PipelineError> {
    let names = named(&seen);
    let listed: Vec<String> = names.values().map(|(name, n)| format!("{name} ({})", files(*n))).collect();
    let Some(wanted) = &options.subject else {
        let (true, Some((first, _))) = (names.len() > 1 && !options.one_subject, names.values().next()) else {
            return Ok((seen, Vec::new()));
        };
        let of = quote::path(folder);
        let by_number = seen.iter().any(|s| s.stated.by_number);
        let (say, persons) = match by_number {
            true => ("are of", "persons (numbers in their names)"),
            false => ("name", "subjects (SUBJECTS:NAMES)"),
        };
        let one = quote::line(quote::option("subject", first));
        return Err(PipelineError::request_hint(
            format!("{}: the files {say} {} {persons}: {}", folder.display(), names.len(), abridged(&listed)),
            format!(
                "one of them: `aloft init {of} {one}`; one person under several names: `aloft init {of} --one-subject`; a study of all: \
                 a folder for each subject, and `aloft init` with the folder that holds them"
            ),
        ));
    };
    if !names.contains_key(&person_key(wanted)) {
        return Err(PipelineError::request_hint(
            format!("{}: no file names the subject `{wanted}` (SUBJECTS:NAMES)", folder.display()),
            if listed.is_empty() {
                "no file here names a subject; leave `--subject` out".to_owned()
            } else {
                format!("the files name {}", abridged(&listed))
            },
        ));
    }
    let own = |s: &Determination| s.stated.subject.as_ref().is_some_and(|n| person_key(n) == person_key(wanted));
    let (own, other): (Vec<_>, Vec<_>) = seen.into_iter().partition(own);
    let other = other.into_iter().map(|s| match s.stated.subject {
        Some(name) => format!("{} ({name})", s.relative),
        None => format!("{} (no subject name)", s.relative),
    });
    Ok((own, other.collect()))
}

fn files(n: usize) -> String {
    format!("{n} file{}", if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::init::facts::StatedFacts;

    fn of(name: Option<&str>, stem: &str) -> Determination {
        Determination {
            relative: format!("{stem}.c3d"),
            stem: stem.to_owned(),
            trial: aloft_trial::Trial::default(),
            unit: String::new(),
            stated: StatedFacts { subject: name.map(str::to_owned), ..StatedFacts::default() },
        }
    }

    fn folder() -> Vec<Determination> {
        vec![of(Some("Ann B"), "a1"), of(Some("ann_b"), "a2"), of(Some("Bo"), "b1"), of(None, "c1")]
    }

    #[test]
    fn several_subjects_are_refused_with_every_way_out_quoted() {
        let refused = chosen(Path::new("my lab"), folder(), &InitOptions::default());
        let Err(PipelineError::Request { problem, hint: Some(hint) }) = refused else { unreachable!("not refused") };
        assert!(problem.contains("2 subjects") && problem.contains("Ann B (2 files), Bo (1 file)"), "{problem}");
        assert!(hint.contains("`aloft init 'my lab' --subject 'Ann B'`"), "{hint}");
        assert!(hint.contains("`aloft init 'my lab' --one-subject`"), "{hint}");
    }

    #[test]
    fn one_subject_is_chosen_by_name_or_by_assurance() {
        let names = |found: &[Determination]| found.iter().map(|s| s.stem.clone()).collect::<Vec<_>>();
        let named = |subject: &str| InitOptions { subject: Some(subject.to_owned()), one_subject: false };
        let one = chosen(Path::new("lab"), folder(), &named("ann b")).map(|(own, other)| (names(&own), other));
        let expected =
            (vec!["a1".to_owned(), "a2".to_owned()], vec!["b1.c3d (Bo)".into(), "c1.c3d (no subject name)".into()]);
        assert_eq!(one.ok(), Some(expected));
        let all = chosen(Path::new("lab"), folder(), &InitOptions { one_subject: true, subject: None });
        assert_eq!(all.map(|(own, other)| (own.len(), other.len())).ok(), Some((4, 0)));
        let wrong = chosen(Path::new("lab"), folder(), &named("Cleo")).map(|_| ()).unwrap_err();
        assert!(matches!(wrong, PipelineError::Request { hint: Some(h), .. } if h.contains("Ann B (2 files), Bo")));
    }
}

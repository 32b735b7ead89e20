//! Recordings of one laboratory use the same marker labels. Before `init` writes one pipeline for a
//! folder, the recordings in it are grouped by their labels, so that those of two laboratories are
//! never mixed.

use std::collections::BTreeSet;

/// Share of the shorter list of labels that two recordings of one laboratory have in common.
/// Static trials have more markers than the others, damaged recordings fewer.
const ALIKE: f64 = 0.5;

/// Number of the group of each recording; the largest group is 0.
pub fn groups(labels: &[BTreeSet<String>]) -> Vec<usize> {
    let mut group: Vec<usize> = (0..labels.len()).collect();
    for i in 0..labels.len() {
        for j in 0..i {
            if group[i] != group[j] && alike(&labels[i], &labels[j]) {
                let (from, to) = (group[i].max(group[j]), group[i].min(group[j]));
                group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
            }
        }
    }
    let mut order: Vec<usize> = group.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
    let size = |g: usize| group.iter().filter(|other| **other == g).count();
    order.sort_by_key(|g| (std::cmp::Reverse(size(*g)), *g));
    group.iter().map(|g| order.iter().position(|o| o == g).unwrap_or(0)).collect()
}

fn alike(a: &BTreeSet<String>, b: &BTreeSet<String>) -> bool {
    let fewer = a.len().min(b.len());
    fewer > 0 && a.intersection(b).count() as f64 >= ALIKE * fewer as f64
}

/// A label as laboratories share it: without the subject's name before a colon, in lower case.
pub fn bare(label: &str) -> String {
    label.rsplit(':').next().unwrap_or(label).trim().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(labels: &[&str]) -> BTreeSet<String> {
        labels.iter().map(|l| bare(l)).collect()
    }

    #[test]
    fn laboratories_are_told_apart_by_their_labels() {
        let all = [
            set(&["top", "side"]),
            set(&["S1:LASI", "S1:RASI", "S1:LKNE", "S1:RKNE"]),
            set(&["LASI", "RASI", "LKNE", "RKNE", "LKNM", "RKNM"]),
            set(&["lasi", "lkne"]),
            set(&["top", "side", "end"]),
        ];
        assert_eq!(groups(&all), [1, 0, 0, 0, 1]);
        assert_eq!(groups(&[set(&["a"]), set(&["b"]), BTreeSet::new()]), [0, 1, 2]);
    }
}

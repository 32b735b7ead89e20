//! Reads plate descriptions from the group FORCE_PLATFORM.

use crate::{Parameters, PlateDescription, Warning, WarningKind};

/// Number of channels of a plate type; 0 for an unknown type.
pub(crate) fn channels_of_kind(kind: i32) -> usize {
    match kind {
        1 | 2 | 4 => 6,
        3 | 5 | 7 => 8,
        6 => 12,
        _ => 0,
    }
}

/// Reads all plates that FORCE_PLATFORM:USED announces and its lists describe.
pub(crate) fn read_plates(
    groups: &Parameters,
    n_channels: usize,
    warnings: &mut Vec<Warning>,
) -> Vec<PlateDescription> {
    let Some(group) = groups.group("FORCE_PLATFORM") else { return Vec::new() };
    let mut warn = |message: String| warnings.push(Warning::new(WarningKind::Plates, message));
    let kinds = group.get("TYPE").map(|p| p.numbers()).unwrap_or_default();
    let stated = group.get("USED").and_then(|p| p.count()).unwrap_or(kinds.len());
    let used = stated.min(kinds.len());
    if stated > used {
        warn(format!("FORCE_PLATFORM:USED is {stated}, TYPE holds {used}; the rest is left out"));
    }
    let corners = group.get("CORNERS").map(|p| p.numbers()).unwrap_or_default();
    let origins = group.get("ORIGIN").map(|p| p.numbers()).unwrap_or_default();
    let zero = group.get("ZERO").map(|p| p.numbers()).unwrap_or_default();
    let zero_frames = [0, 1].map(|i| zero.get(i).map_or(0, |z| *z as i32));
    let channels = group.get("CHANNEL").map(|p| (p.dimensions.clone(), p.counts())).unwrap_or_default();
    let per_plate = match channels.0.as_slice() {
        [] => channels.1.len(),
        // A vector for a single plate.
        [rows] => usize::from(*rows),
        [rows, ..] => usize::from(*rows),
    };
    let calibration = group.get("CAL_MATRIX").map(|p| (p.dimensions.clone(), p.numbers())).unwrap_or_default();

    let mut plates = Vec::with_capacity(used);
    for i in 0..used {
        let kind = kinds[i] as i32;
        let mut plate = PlateDescription { kind, zero_frames, ..PlateDescription::default() };
        match corners.get(12 * i..12 * i + 12) {
            Some(values) => {
                for (k, value) in values.iter().enumerate() {
                    plate.corners[k / 3][k % 3] = *value;
                }
            }
            None => warn(format!("plate {}: FORCE_PLATFORM:CORNERS ends before it", i + 1)),
        }
        match origins.get(3 * i..3 * i + 3) {
            Some(values) => plate.origin.copy_from_slice(values),
            None => warn(format!("plate {}: FORCE_PLATFORM:ORIGIN ends before it; taken as 0", i + 1)),
        }
        let listed = channels.1.get(per_plate * i..per_plate * (i + 1)).unwrap_or_default();
        let wanted = channels_of_kind(kind);
        let take = if wanted == 0 { listed.len() } else { wanted.min(listed.len()) };
        for channel in &listed[..take] {
            match channel.and_then(|c| c.checked_sub(1)).filter(|c| *c < n_channels) {
                Some(index) => plate.channels.push(index),
                // Zeros pad the list of a plate that has fewer channels than others.
                None if *channel == Some(0) => break,
                None => {
                    let shown = channel.map_or("not a number".to_owned(), |c| c.to_string());
                    warn(format!("plate {}: channel {shown}, the file holds {n_channels}", i + 1));
                    break;
                }
            }
        }
        if wanted == 0 {
            warn(format!("plate {}: type {kind} is not known; not calibrated", i + 1));
        } else if plate.channels.len() < wanted {
            warn(format!("plate {}: type {kind} needs {wanted} channels, {} are usable", i + 1, plate.channels.len()));
        }
        if kind >= 4 {
            plate.calibration = matrix_of(&calibration.0, &calibration.1, i);
            // One parameter contains the matrices of all plates, padded to the largest.
            if matches!(kind, 4 | 5) && plate.calibration.len() >= 6 {
                plate.calibration.truncate(6);
                plate.calibration.iter_mut().for_each(|row| row.truncate(wanted));
            }
        }
        if matches!(kind, 6 | 7) {
            warn(format!("plate {}: type {kind} is read but not calibrated", i + 1));
        }
        plates.push(plate);
    }
    plates
}

/// Matrix `index` of a three-dimensional parameter stored column by column.
fn matrix_of(dimensions: &[u8], values: &[f64], index: usize) -> Vec<Vec<f64>> {
    let [rows, columns, ..] = dimensions else { return Vec::new() };
    let (rows, columns) = (usize::from(*rows), usize::from(*columns));
    let size = rows * columns;
    if size == 0 {
        return Vec::new();
    }
    let Some(one) = values.get(size * index..size * (index + 1)) else { return Vec::new() };
    (0..rows).map(|r| (0..columns).map(|c| one[c * rows + r]).collect()).collect()
}

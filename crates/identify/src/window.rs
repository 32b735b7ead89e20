//! Chooses the window length of weak rows by held-out error on a common reference.
//!
//! Short windows let noise through (their second derivative is steep), long ones smooth out joint
//! motion and leave few rows. Every candidate identifies from all clusters but one and predicts the
//! rows of that one, always the same rows (the yardstick: fixed weights, one medium window), so
//! that lengths can be compared.

use crate::clusters::{Clusters, merge_groups};
use crate::system::System;
use crate::{ClusterBy, IdentifyError, Prior, Visible};
use aloft_regressor::Factor;
use serde::{Deserialize, Serialize};

/// One window length that was tried.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WindowTrial {
    /// Window length, s; 0 if it is chosen by the length of each stretch.
    pub window_s: f64,
    /// Root mean square of the yardstick's rows predicted from the other clusters.
    pub held_out_rms: f64,
    /// Number of rows.
    pub n_rows: usize,
}

/// The chosen window length and the alternatives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WindowChoice {
    /// The chosen window length, s; 0 if it is chosen by the length of each stretch.
    pub window_s: f64,
    /// All window lengths that were tried.
    pub tried: Vec<WindowTrial>,
    /// Reason, in words.
    pub words: String,
}

fn named(window_s: f64) -> String {
    if window_s > 0.0 { format!("{window_s:.2} s") } else { "by the length of each stretch".to_owned() }
}

/// Chooses among window lengths (0 stands for a length chosen for each stretch). `candidates` hold,
/// for each length, the factors of the same stretches in the same order as `yardstick`.
///
/// # Errors
/// [`IdentifyError::Length`] if stretches do not correspond, [`IdentifyError::TooFew`] without
/// candidates or with fewer than two clusters.
pub fn choose_window(
    candidates: &[(f64, Vec<Factor>)],
    yardstick: &[Factor],
    mass_kg: f64,
    prior: Option<&Prior>,
    cluster: ClusterBy,
) -> Result<WindowChoice, IdentifyError> {
    let (groups, names) = cluster.groups(yardstick);
    if names.len() < 2 {
        return Err(IdentifyError::TooFew { what: "clusters", needed: 2, found: names.len() });
    }
    let measured = merge_groups(yardstick, &groups)?;
    let mut tried = Vec::with_capacity(candidates.len());
    for (window_s, factors) in candidates {
        let same = factors.len() == yardstick.len()
            && factors.iter().zip(yardstick).all(|(a, b)| a.trial == b.trial && a.stretch == b.stretch);
        if !same {
            return Err(IdentifyError::Length {
                what: "stretches of a window's factors",
                expected: yardstick.len(),
                found: factors.len(),
            });
        }
        let visible = Visible::among(factors, prior.is_some())?;
        let factors = visible.reduce_all(factors)?;
        let merged = Factor::merge(&factors)?;
        let system = System::new(&merged, mass_kg, prior)?;
        let weight = if prior.is_some() { system.row_variance() } else { 0.0 };
        let solution = system.solve(weight);
        let groups = merge_groups(&factors, &groups)?;
        let clusters = Clusters::new(&groups, &merged, mass_kg, prior, weight, &solution.x)?;
        let (mut squares, mut rows) = (0.0, 0usize);
        for (x, factor) in clusters.leave_one_out().iter().zip(&measured) {
            squares += factor.sum_of_squares(&visible.whole(x.clone()));
            rows += factor.n_rows;
        }
        let held_out_rms = (squares / rows.max(1) as f64).sqrt();
        tried.push(WindowTrial { window_s: *window_s, held_out_rms, n_rows: merged.n_rows });
    }
    let best = tried.iter().min_by(|a, b| a.held_out_rms.total_cmp(&b.held_out_rms)).ok_or(IdentifyError::TooFew {
        what: "window lengths",
        needed: 1,
        found: 0,
    })?;
    let window_s = best.window_s;
    let words = format!(
        "{}: smallest error of a cluster predicted from the others ({:.3e}) among {}",
        named(window_s),
        best.held_out_rms,
        tried.iter().map(|t| format!("{} ({:.3e})", named(t.window_s), t.held_out_rms)).collect::<Vec<_>>().join(", ")
    );
    Ok(WindowChoice { window_s, tried, words })
}

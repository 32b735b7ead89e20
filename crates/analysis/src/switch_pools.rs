//! The rows of [`crate::switches`] merged for identification: of all trials, and of all but each
//! one. Each pool also holds its rows rotated ([`RotatedRows`]), from which the parameters for a
//! choice of effects follow within a millisecond.

use aloft_identify::RotatedRows;
use aloft_pipeline::stages::identify::{PointEstimate, Predicting};
use aloft_regressor::{Factor, StretchKind, leave_group_out};
use aloft_workspace::error::StageFailure;
use rayon::prelude::*;
use std::collections::HashMap;

fn stop(e: impl std::fmt::Display) -> StageFailure {
    StageFailure::new(e.to_string())
}

/// Merged factors of some trials: flights, and contact, which is weighted before both are merged.
#[derive(Clone)]
pub(crate) struct Merged {
    pub flights: Option<Factor>,
    pub contact: Option<Factor>,
}

impl Merged {
    /// Number of rows, of contact only if it has a weight.
    pub fn n_rows(&self, weight: Option<f64>) -> usize {
        self.flights.iter().chain(self.contact.iter().filter(|_| weight.is_some())).map(|f| f.n_rows).sum()
    }

    /// Flights and contact of this weight (none: flights only) with the columns of these effects.
    pub fn with_effects(&self, names: &[&str], weight: Option<f64>) -> Result<Factor, StageFailure> {
        let pick = |f: &Factor| f.with_effects(names).map_err(stop);
        let contact = self.contact.as_ref().zip(weight).map(|(c, w)| pick(c).map(|f| f.scaled(w))).transpose()?;
        match (&self.flights, contact) {
            (Some(f), None) => pick(f),
            (None, Some(c)) => Ok(c),
            (Some(f), Some(c)) => pick(f)?.merged_with(&c).map_err(stop),
            (None, None) => Err(stop("no flight is left to identify from")),
        }
    }
}

/// Rows of some trials, merged and rotated.
pub(crate) struct Pool {
    pub merged: Merged,
    /// None for an estimator of which they are no or nearly the estimate, or where nothing is left.
    rotated: Option<RotatedRows>,
    /// Place of each column among those of the rotated rows.
    places: HashMap<String, usize>,
}

impl Pool {
    fn of(merged: Merged, predicting: &Predicting, weight: Option<f64>, names: &[&str]) -> Self {
        let rotated = if predicting.rotates_nearly() {
            None
        } else {
            // none: the merged rows are solved instead, and name what fails
            merged.with_effects(names, weight).ok().and_then(|all| predicting.rotated(&all).ok().flatten())
        };
        let places = names.iter().enumerate().map(|(i, n)| ((*n).to_owned(), i)).collect();
        Self { merged, rotated, places }
    }

    /// The estimate with these columns from rotated rows; none where they cannot give it.
    pub fn estimate(&self, names: &[&str]) -> Option<PointEstimate> {
        let chosen = names.iter().map(|n| self.places.get(*n).copied()).collect::<Option<Vec<usize>>>()?;
        // none: as for the pool
        let found = self.rotated.as_ref()?.estimate(&chosen).ok()?;
        let named = names.iter().map(|n| (*n).to_owned()).zip(found.effects.iter().copied());
        Some((found.parameters, named.collect()))
    }
}

/// Rows of all trials, and of all but each one.
pub(crate) struct Pools {
    pub all: Pool,
    pub without: HashMap<String, Pool>,
}

impl Pools {
    /// Merges and rotates factors whose effects have these columns, with contact of this weight
    /// (none: flights only).
    pub fn of(
        factors: &[&Factor],
        predicting: &Predicting,
        weight: Option<f64>,
        columns: &[Vec<String>],
    ) -> Result<Self, StageFailure> {
        let names: Vec<&str> = columns.iter().flatten().map(String::as_str).collect();
        let (all, without) = merge_all(factors).map_err(stop)?;
        let pool = |(trial, merged): (String, Merged)| (trial, Pool::of(merged, predicting, weight, &names));
        Ok(Self {
            all: Pool::of(all, predicting, weight, &names),
            without: without.into_par_iter().map(pool).collect(),
        })
    }
}

/// Merged factors without and with contact, of all trials and of all but each one.
type MergedPools = (Merged, Vec<(String, Merged)>);

fn merge_all(factors: &[&Factor]) -> Result<MergedPools, aloft_regressor::RegressorError> {
    let mut trials: Vec<&str> = Vec::new();
    for f in factors {
        if !trials.contains(&f.trial.as_str()) {
            trials.push(&f.trial);
        }
    }
    let nothing = Merged { flights: None, contact: None };
    let (mut all, mut without) = (nothing.clone(), vec![nothing; trials.len()]);
    for contact in [false, true] {
        let own: Vec<Factor> =
            factors.iter().filter(|f| (f.kind == StretchKind::Contact) == contact).map(|f| (*f).clone()).collect();
        if own.is_empty() {
            continue;
        }
        let merged = Factor::merge(&own)?;
        // trials that have factors of this kind, numbered in the order of their first one
        let mut present: Vec<&str> = Vec::new();
        let groups: Vec<usize> = own
            .iter()
            .map(|f| {
                present.iter().position(|t| *t == f.trial).unwrap_or_else(|| {
                    present.push(&f.trial);
                    present.len() - 1
                })
            })
            .collect();
        let rest: Vec<Option<Factor>> = match present.len() {
            1 => vec![None],
            _ => leave_group_out(&own, &groups, |_, rest| Some(rest.clone()))?,
        };
        for (pool, trial) in without.iter_mut().zip(&trials) {
            let left = match present.iter().position(|t| t == trial) {
                Some(i) => rest[i].clone(),
                None => Some(merged.clone()),
            };
            *if contact { &mut pool.contact } else { &mut pool.flights } = left;
        }
        *if contact { &mut all.contact } else { &mut all.flights } = Some(merged);
    }
    Ok((all, trials.into_iter().map(str::to_owned).zip(without).collect()))
}

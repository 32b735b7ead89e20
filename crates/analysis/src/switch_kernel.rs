//! The switches of [`crate::switches`] as numbers from which a page computes the model with any
//! choice of effects by itself, without the program.
//!
//! For each trial there are the rows from which it is predicted (identified without it), rotated
//! ([`RotatedRows`]), and its weak windows in the same coordinates. A choice of effects is then a
//! small least squares, and the held-out error a norm. What is computed is what
//! [`Switches::model`] computes, with the same weights of prior and contact.

use crate::held_out::weight_n;
use crate::switch_contact::uses_contact;
use crate::switch_pools::Merged;
use crate::switch_rows::Judged;
use crate::switches::{LeftOut, Switch, Switched, Switches};
use aloft_compare::{Floor, Graded};
use aloft_identify::RotatedRows;
use aloft_workspace::error::{PipelineError, StageFailure};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Lever that converts moments into forces where both are added, 1/m (as in the held-out error).
const PER_LEVER: f64 = 10.0;

/// Windows of one trial and kind of motion in the coordinates of its rows.
#[derive(Debug, Clone)]
pub struct KernelWindows {
    /// Number of windows.
    pub windows: usize,
    /// Rows `[directions of the body | effects | 1]`; the sum of squares of their product with
    /// `[y', θ, 1]` is that of the force errors (N) and of the moment errors over a lever of 0.1 m.
    pub rows: DMatrix<f64>,
}

/// One trial of the comparison.
#[derive(Debug, Clone)]
pub struct KernelTrial {
    /// Its name.
    pub name: String,
    /// Rows without the trial; `None` if it is predicted from the rows of all trials.
    pub without: Option<RotatedRows>,
    /// Its windows in flight; none if they do not count.
    pub flight: Option<KernelWindows>,
    /// Its windows in contact; none if they do not count.
    pub contact: Option<KernelWindows>,
}

/// Switches as numbers.
#[derive(Debug, Clone)]
pub struct SwitchKernel {
    /// The switches, in their order, as far as they fit.
    pub switches: Vec<Switch>,
    /// Number of columns of each switch.
    pub columns: Vec<usize>,
    /// True for a switch whose models are identified from contact, too.
    pub with_contact: Vec<bool>,
    /// Whether a model without effects is identified from contact, too.
    pub always_contact: bool,
    /// True if the rows give other choices only nearly, so that the page shows those in `known`.
    pub only_known: bool,
    /// Whether contact is in the rows of this kernel. A choice of effects that needs it otherwise
    /// is not computed from them.
    pub contact: bool,
    /// Models of such choices: the present model with one such switch flipped, and what the
    /// discovery found.
    pub known: Vec<Switched>,
    /// Keys of effects that did not fit.
    pub left_out: Vec<String>,
    /// Keys of the present model's effects.
    pub present: Vec<String>,
    /// Base parameters: name and unit; none if their spread did not fit.
    pub base: Vec<(String, String)>,
    /// Rows of all trials.
    pub all: RotatedRows,
    /// Trials of the comparison.
    pub trials: Vec<KernelTrial>,
    /// Noise floor in flight.
    pub flight_floor: Option<Floor>,
    /// Noise floor in contact.
    pub contact_floor: Option<Floor>,
    /// The body's weight, N.
    pub weight_n: f64,
    /// The best grades that errors may have.
    pub best: Vec<Graded>,
}

/// How many numbers an upper trapezoid holds.
fn upper(rows: usize, columns: usize) -> usize {
    let rows = rows.min(columns);
    rows * columns - rows * rows.saturating_sub(1) / 2
}

/// Windows in flight and in contact of which a trial's error is made.
fn counted(t: &Judged, contact: bool) -> [bool; 2] {
    [t.in_flight, contact && t.in_contact]
}

impl Switches {
    /// The switches as at most `most` numbers: those of the model first, then the best of the
    /// discovery. Where not all fit, parameters of the body are left out first, then contact. None
    /// if not even the switches of the model and one more fit, or if the parameters come from an
    /// estimator that is no least squares.
    ///
    /// # Errors
    /// Rows that cannot be rotated.
    pub fn kernel(&self, most: usize) -> Result<Option<SwitchKernel>, PipelineError> {
        let failed = |f: StageFailure| PipelineError::Request { problem: f.problem, hint: f.hint };
        let all = self.columns.len();
        let least = (self.present.len() + 1).min(all);
        let columns = |n: usize| self.columns[..n].iter().map(Vec::len).sum::<usize>();
        for (contact, parameters) in [(true, true), (true, false), (false, false)] {
            let contact = contact && !self.reading_at_rest();
            let fits = (least..=all).take_while(|n| self.numbers(columns(*n), contact, parameters) <= most).last();
            // drop the base parameters before dropping switches
            match fits {
                Some(n) if n == all || !parameters => return self.kernel_of(n, contact, parameters).map_err(failed),
                _ => {}
            }
        }
        Ok(None)
    }

    /// Whether contact has no number at once, because the reading at rest of plates that were never
    /// unloaded follows from the model.
    fn reading_at_rest(&self) -> bool {
        self.trials.iter().any(|t| t.in_contact && t.offset.is_some())
    }

    /// How many numbers a kernel with `k` columns of effects holds. Triangles count half.
    fn numbers(&self, k: usize, contact: bool, parameters: bool) -> usize {
        let m = self.parameters.base.len() - 1;
        let n_rows = |m: &Merged| m.n_rows(self.present_weight());
        let of = |rows: usize| {
            let d = rows.min(m);
            (d, d * (k + 2) + upper(rows - d, k + 1))
        };
        let (own, all) = of(n_rows(&self.pools.all.merged));
        let each = self.trials.iter().map(|t| {
            let without = self.pools.without.get(&t.name).map_or(0, |pool| n_rows(&pool.merged));
            let (d, rows) = if without == 0 { (own, 0) } else { of(without) };
            let windows = |flying: bool| {
                let kinds = t.windows.iter().flat_map(|w| &w.in_flight);
                match (6 * kinds.filter(|f| **f == flying).count(), d + k + 1) {
                    (rows, columns) if rows > columns => upper(rows, columns),
                    (rows, columns) => rows * columns,
                }
            };
            let [flight, contact] = counted(t, contact);
            rows + if flight { windows(true) } else { 0 } + if contact { windows(false) } else { 0 }
        });
        all + if parameters { (m + 1) * own } else { 0 } + each.sum::<usize>()
    }

    /// The first `n` switches.
    fn kernel_of(&self, n: usize, contact: bool, parameters: bool) -> Result<Option<SwitchKernel>, StageFailure> {
        let names: Vec<&str> = self.columns[..n].iter().flatten().map(String::as_str).collect();
        let weight = self.present_weight();
        let rotated = |m: &Merged| self.predicting.rotated(&m.with_effects(&names, weight)?);
        let Some(all) = rotated(&self.pools.all.merged)? else { return Ok(None) };
        let trials: Result<Vec<KernelTrial>, StageFailure> = self
            .trials
            .par_iter()
            .map(|t| {
                let without = match self.pools.without.get(&t.name).map(|pool| &pool.merged) {
                    // a trial that alone identifies is predicted from itself, as the switches do
                    Some(m) if m.n_rows(weight) > 0 => rotated(m)?,
                    _ => None,
                };
                let rows = without.as_ref().unwrap_or(&all);
                let windows = |flying: bool| self.windows_of(t.windows.as_ref()?, rows, &names, flying);
                let [flight, contact] = counted(t, contact);
                let (flight, contact) =
                    (flight.then(|| windows(true)).flatten(), contact.then(|| windows(false)).flatten());
                Ok(KernelTrial { name: t.name.clone(), flight, contact, without })
            })
            .collect();
        let keys: Vec<String> = self.switches()[..n].iter().map(|s| s.key.clone()).collect();
        let known = self.known(&keys)?;
        let base = self.parameters.base.iter().map(|b| (b.name.clone(), b.unit.clone()));
        Ok(Some(SwitchKernel {
            switches: self.switches()[..n].to_vec(),
            columns: self.columns[..n].iter().map(Vec::len).collect(),
            with_contact: self.effects[..n].iter().map(|e| uses_contact(&self.session, vec![e.clone()])).collect(),
            always_contact: uses_contact(self.session(), Vec::new()),
            only_known: self.predicting.rotates_nearly(),
            contact: self.contact,
            known,
            left_out: self.effects[n..].iter().map(|e| e.key.clone()).collect(),
            present: self.present.clone(),
            base: if parameters { base.collect() } else { Vec::new() },
            all,
            trials: trials?,
            flight_floor: self.floor.as_ref().and_then(|f| f.flight_floor),
            contact_floor: self.floor.as_ref().and_then(|f| f.contact_floor),
            weight_n: weight_n(&self.session),
            best: self.best.clone(),
        }))
    }

    /// Models that the rows of the kernel do not give, because they use contact otherwise, or give
    /// only nearly: the present model, also with one switch flipped, and with all that the
    /// discovery found.
    fn known(&self, keys: &[String]) -> Result<Vec<Switched>, StageFailure> {
        let nearly = self.predicting.rotates_nearly();
        let flipped = keys.iter().map(|key| {
            let others = self.present.iter().filter(|k| *k != key).cloned();
            let added = Some(key.clone()).filter(|k| !self.present.contains(k));
            others.chain(added).collect::<Vec<String>>()
        });
        let found = keys.iter().filter(|k| self.present.contains(k) || self.found.contains(k)).cloned().collect();
        let mut choices: Vec<Vec<String>> = Vec::new();
        let present = self.present.iter().filter(|k| keys.contains(k)).cloned().collect();
        let mut out = Vec::new();
        for choice in flipped.chain([present, found]) {
            if choices.contains(&choice) {
                continue;
            }
            if self.changes_contact(&choice)? {
                out.push(self.model(&choice, &LeftOut::default())?);
            } else if nearly {
                // none: the page computes such a model itself and says if it cannot be evaluated
                out.extend(self.model(&choice, &LeftOut::default()).ok());
            }
            choices.push(choice);
        }
        Ok(out)
    }

    /// Windows of one kind in the coordinates of rotated rows, as a triangle where that is shorter.
    fn windows_of(
        &self,
        windows: &aloft_compare::WindowRows,
        rows: &RotatedRows,
        names: &[&str],
        flying: bool,
    ) -> Option<KernelWindows> {
        let chosen: Vec<usize> = (0..windows.in_flight.len()).filter(|w| windows.in_flight[*w] == flying).collect();
        if chosen.is_empty() {
            return None;
        }
        let lines: Vec<usize> = chosen.iter().flat_map(|w| 6 * w..6 * w + 6).collect();
        let mut own = windows.rows.select_rows(&lines);
        for (i, mut row) in own.row_iter_mut().enumerate() {
            if i % 6 >= 3 {
                row *= PER_LEVER;
            }
        }
        let p = rows.mean.len();
        let body = own.columns(0, p);
        let rest: DVector<f64> = body * &rows.mean - own.column(own.ncols() - 1);
        let turned = body * &rows.spread;
        let (d, k) = (turned.ncols(), names.len());
        let mut all = DMatrix::zeros(own.nrows(), d + k + 1);
        all.columns_mut(0, d).copy_from(&turned);
        for (i, name) in names.iter().enumerate() {
            if let Some(at) = windows.effects.iter().position(|e| e == name) {
                all.column_mut(d + i).copy_from(&own.column(p + at));
            }
        }
        all.column_mut(d + k).copy_from(&rest);
        if all.nrows() > all.ncols() {
            all = all.qr().r();
        }
        Some(KernelWindows { windows: chosen.len(), rows: all })
    }
}

//! The evidence: rows of every flight and contact stretch, and the data needed to compute columns
//! of any effect on them.
//!
//! First step of the data flow: recordings become a [`Session`], from which
//! columns for every effect, target and value of the nonlinear parameters are computed without
//! forming the regressor again.

use crate::DiscoverError;
use crate::by_stages::{ByStages, Compute};
use crate::draws::Drawn;
use crate::held_out::HeldOutResult;
use crate::problem::{Domain, Problem};
use crate::progress::{Counter, Tell};
use aloft_body::{BaseParameters, Model, Motion, Phi};
use aloft_effects::{Columns, Effect, PlateSeries, Scene, Series, Span, Target, TrialMotion};
use aloft_identify::Prior;
use aloft_regressor::weak_windows::{Origin, WeakRows, force_scale_n};
use aloft_regressor::{Acting, RegressorError, Stretch, StretchKind, WeakOptions, weak_rows};
use nalgebra::{DMatrix, DVector, Vector3, Vector6};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// One trial as delivered by the earlier stages.
#[derive(Debug, Clone, Copy)]
pub struct TrialInput<'a> {
    /// Unfiltered motion.
    pub motion: &'a Motion,
    /// Flights and contact stretches.
    pub stretches: &'a [Stretch],
    /// Wrench of all plates together at the frames, about the world origin; needed for contact
    /// stretches.
    pub measured: Option<&'a [Vector6<f64>]>,
    /// Wrench of each plate; empty where none measured.
    pub plates: &'a [PlateSeries],
    /// Group named by the laboratory (`loaded`, `unloaded` …).
    pub group: Option<&'a str>,
    /// Seconds from the start of the session to the first frame (0 where unknown).
    pub session_time_s: f64,
}

/// The body that was recorded.
#[derive(Debug, Clone, Copy)]
pub struct Body<'a> {
    /// The model, with the laboratory's gravity.
    pub model: &'a Model,
    /// Its base parameters.
    pub base: &'a BaseParameters,
    /// Link parameters of the prior (or of an earlier identification).
    pub phi: &'a [Phi],
    /// Prior of the base parameters; without one only the rows determine them.
    pub prior: Option<&'a Prior>,
    /// Mass from a scale, kg.
    pub mass_kg: f64,
    /// Centres of the plates, world, m.
    pub plate_centres_m: &'a [Vector3<f64>],
}

/// Rows of one stretch and the windows that they come from.
#[derive(Debug, Clone)]
pub(crate) struct Block {
    /// Index of the trial.
    pub trial: usize,
    /// Flight or contact.
    pub kind: StretchKind,
    /// Rows × base parameters, weighted.
    pub y: DMatrix<f64>,
    /// Measured side, weighted.
    pub w: DVector<f64>,
    /// Number of rows before reduction (a factor keeps fewer).
    pub n_rows: usize,
    pub windows: Windows,
    /// Orthonormal columns of a constant wrench of the plates whose zero is not known; it is taken
    /// out of all rows.
    pub zero: Option<DMatrix<f64>>,
    /// Inverse root of the covariance of the rows' errors, if `y` and `w` are in its units
    /// ([`Session::in_noise_units`]).
    pub white: Option<Arc<White>>,
}

/// Inverse root of the covariance of a block's rows.
#[derive(Debug)]
pub(crate) enum White {
    /// Axes have errors of their own: a triangle over the windows for each.
    ByAxis([DMatrix<f64>; 6]),
    /// All rows together.
    Whole(DMatrix<f64>),
}

impl White {
    /// Rows in units of their errors.
    pub fn times(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let axes = match self {
            Self::Whole(all) => return all * rows,
            Self::ByAxis(axes) => axes,
        };
        let mut out = DMatrix::zeros(rows.nrows(), rows.ncols());
        for (axis, lower) in axes.iter().enumerate() {
            for (from, to) in rows.column_iter().zip(out.column_iter_mut()) {
                let mut to = to;
                for (w, row) in lower.row_iter().enumerate() {
                    to[6 * w + axis] = (0..=w).map(|v| row[v] * from[6 * v + axis]).sum();
                }
            }
        }
        out
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Windows {
    pub half: usize,
    pub centres: Vec<usize>,
    psi: Vec<f64>,
    origin: Vec<Vec<Origin>>,
    force_weight: f64,
    moment_weight: f64,
}

/// All rows of one body.
#[derive(Debug, Clone)]
pub struct Session<'a> {
    pub(crate) scene: &'a Scene,
    /// Series of every trial: flights, contact.
    pub(crate) series: Arc<Vec<[Series<'a>; 2]>>,
    pub(crate) blocks: Vec<Block>,
    pub(crate) trials: Vec<String>,
    pub(crate) groups: Vec<Option<String>>,
    pub(crate) from_full: DMatrix<f64>,
    pub(crate) prior: Option<Prior>,
    pub(crate) mass_kg: f64,
    /// N per unit of a force row, N·m per unit of a moment row (per unit of the test function's
    /// mean).
    pub(crate) unit: [f64; 2],
    /// Results of a comparison, in flight and in contact.
    pub(crate) model_error: [Option<HeldOutResult>; 2],
    /// Draws of the errors of the recordings; empty without draws.
    pub(crate) drawn: Arc<Drawn>,
    /// The same rows along the motion with drawn errors added and subtracted, a pair for each draw.
    pub(crate) disturbed: Arc<Vec<[Session<'a>; 2]>>,
    /// What the plates tell of loads in each trial, once it was asked for.
    pub(crate) on_plates: Arc<OnceLock<Option<Vec<Option<bool>>>>>,
    pub(crate) warnings: Vec<String>,
    /// Why parts of the present answer could not be computed.
    pub(crate) failed: Arc<Mutex<BTreeSet<String>>>,
    pub(crate) counter: Counter<'a>,
    pub(crate) by_stages: ByStages<'a>,
}

/// Scene of a set of trials: the body, the plates, the volume of the flights.
pub fn scene_of(body: &Body<'_>, trials: &[TrialInput<'_>]) -> Scene {
    let mut state = aloft_body::State::new(body.model);
    let mut places = Vec::new();
    for trial in trials {
        for stretch in trial.stretches {
            for frame in (stretch.first_frame..stretch.end_frame.min(trial.motion.n_frames())).step_by(10) {
                if trial.motion.is_valid(frame) && trial.motion.nq == body.model.nq {
                    state.forward_position(body.model, trial.motion.q(frame));
                    places.push(state.centre_of_mass(body.phi).1);
                }
            }
        }
    }
    Scene::new(body.model, body.phi, body.plate_centres_m).with_volume(&places)
}

/// Length of the fixed weights, as the regressor sets it.
pub(crate) fn moment_length_m(body: &Body<'_>, options: &WeakOptions) -> f64 {
    options.moment_length_m.unwrap_or_else(|| aloft_regressor::weak::body_radius_m(body.model, body.phi))
}

impl<'a> Session<'a> {
    /// Forms the weak rows of all stretches. `scene` comes from [`scene_of`]. Stretches too short
    /// for a window are left out with a warning.
    ///
    /// # Errors
    /// [`DiscoverError::Regressor`] and [`DiscoverError::Effects`] for trials that do not fit the
    /// model, [`DiscoverError::TooFew`] without rows.
    pub fn new(
        body: &Body<'_>,
        scene: &'a Scene,
        trials: &[TrialInput<'_>],
        options: &WeakOptions,
    ) -> Result<Self, DiscoverError> {
        let of_kind = |t: &TrialInput<'_>, flight: bool| {
            let kept = t.stretches.iter().filter(|s| (s.kind == StretchKind::Flight) == flight);
            let spans: Vec<Span> =
                kept.map(|s| Span { first_frame: s.first_frame, end_frame: s.end_frame, flight }).collect();
            let trial =
                TrialMotion { motion: t.motion, spans: &spans, plates: t.plates, session_time_s: t.session_time_s };
            Series::new(scene, &trial)
        };
        let series: Vec<[Series<'a>; 2]> = trials
            .par_iter()
            .map(|t| Ok([of_kind(t, true)?, of_kind(t, false)?]))
            .collect::<Result<_, DiscoverError>>()?;
        let jobs: Vec<(usize, &Stretch)> =
            trials.iter().enumerate().flat_map(|(i, t)| t.stretches.iter().map(move |s| (i, s))).collect();
        let formed: Vec<Result<Block, RegressorError>> = jobs
            .par_iter()
            .map(|&(trial, stretch)| {
                let t = &trials[trial];
                let acting = Acting { measured: t.measured, effects: None };
                let rows = weak_rows(body.model, body.base, body.phi, t.motion, stretch, acting, options)?;
                Ok(Block::from_rows(trial, stretch, rows, moment_length_m(body, options)))
            })
            .collect();
        let mut blocks = Vec::new();
        let mut warnings = Vec::new();
        for ((_, stretch), block) in jobs.iter().zip(formed) {
            match block {
                Ok(block) => blocks.push(block),
                Err(RegressorError::TooShort { .. }) => warnings.push(format!(
                    "{} of `{}` (frames {} to {}) is too short",
                    stretch.kind.word(),
                    stretch.trial,
                    stretch.first_frame,
                    stretch.end_frame
                )),
                Err(e) => return Err(e.into()),
            }
        }
        if blocks.is_empty() {
            return Err(DiscoverError::TooFew { what: "stretches with rows", needed: 1, found: 0 });
        }
        let force_n = force_scale_n(body.phi.iter().map(|p| p[0]).sum(), scene.gravity());
        let mut out = Self {
            scene,
            series: Arc::new(series),
            blocks,
            trials: trials.iter().map(|t| t.motion.trial.clone()).collect(),
            groups: trials.iter().map(|t| t.group.map(str::to_owned)).collect(),
            from_full: body.base.from_full.clone(),
            prior: body.prior.cloned(),
            mass_kg: body.mass_kg,
            unit: [force_n, force_n * moment_length_m(body, options)],
            model_error: [None; 2],
            drawn: Arc::default(),
            counter: Counter::default(),
            by_stages: ByStages::default(),
            disturbed: Arc::default(),
            on_plates: Arc::default(),
            warnings,
            failed: Arc::default(),
        };
        // gravity acts at the body's centre of mass, which flights determine better than the prior
        let flying = out.blocks.iter().any(|b| b.kind == StretchKind::Flight);
        let domain = if flying { Domain::Flight } else { Domain::Contact };
        match Problem::new(&out, domain, &[], usize::MAX, 1.0) {
            Ok(problem) => {
                for series in Arc::make_mut(&mut out.series).iter_mut().flatten() {
                    series.set_centre_of_mass(body.base, problem.parameters.as_slice());
                }
            }
            Err(DiscoverError::TooFew { .. }) => {}
            Err(e) => return Err(e),
        }
        Ok(out)
    }

    /// What was computed. Too little evidence for it is no failure: nothing can be said. Any other
    /// failure leaves a part of the answer out and is kept, so that the answer names it.
    pub(crate) fn or_named<T>(&self, computed: Result<T, DiscoverError>) -> Option<T> {
        match computed {
            Ok(computed) => Some(computed),
            Err(DiscoverError::TooFew { .. }) => None,
            Err(e) => {
                self.failed.lock().unwrap_or_else(PoisonError::into_inner).insert(e.to_string());
                None
            }
        }
    }

    /// The failures kept so far, each once.
    pub(crate) fn failed(&self) -> BTreeSet<String> {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Adds an effect of a given size to the measurement, through its columns, to test the method
    /// on the user's own recordings.
    ///
    /// # Errors
    /// [`DiscoverError::Length`] if the number of coefficients differs from that of the effect,
    /// [`DiscoverError::Numeric`] if its columns cannot be formed.
    pub fn inject(
        &mut self,
        choice: &aloft_effects::EffectInstance<'_>,
        coefficients: &[f64],
    ) -> Result<(), DiscoverError> {
        let expected = choice.effect.coefficients(self.scene, choice.target).len();
        if coefficients.len() != expected {
            return Err(DiscoverError::Length { what: "coefficients to inject", expected, found: coefficients.len() });
        }
        let theta = DVector::from_column_slice(coefficients);
        let columns = self
            .columns_of(choice, Domain::Contact)
            .filter(|c| c.iter().all(|m| m.iter().all(|x| x.is_finite())))
            .ok_or_else(|| DiscoverError::Numeric(format!("`{}` has no columns here", choice.effect.id())))?;
        for (block, c) in self.blocks.iter_mut().zip(&columns) {
            block.w += c * &theta;
        }
        Ok(())
    }

    /// Sets the results of a comparison of the present model in flight and in contact, so that a
    /// discovery reports the same errors and the same floor. Ranking does not depend on it.
    #[must_use]
    pub fn with_model_error(mut self, flight: Option<HeldOutResult>, contact: Option<HeldOutResult>) -> Self {
        self.model_error = [flight, contact];
        self
    }

    /// Takes out of the contact rows of some trials what any constant wrench explains: the plates
    /// were never unloaded there, so that their zero is not known, and a constant says nothing of
    /// the model. Nothing changes if no other trial with contact would remain.
    #[must_use]
    pub fn with_unknown_zeros(mut self, trials: &[&str]) -> Self {
        let concerned = |b: &Block| b.kind == StretchKind::Contact && trials.contains(&self.trials[b.trial].as_str());
        let of: Vec<bool> = self.blocks.iter().map(concerned).collect();
        if !self.blocks.iter().zip(&of).any(|(b, of)| b.kind == StretchKind::Contact && !of) {
            return self;
        }
        for i in (0..self.blocks.len()).filter(|&i| of[i]) {
            let frames = self.series[self.blocks[i].trial][1].len();
            let wrench = |axis: usize| vec![std::array::from_fn(|k| f64::from(u8::from(k == axis))); frames];
            let constants: Vec<Vec<[f64; 6]>> = (0..6).map(wrench).collect();
            let zero = self.modulated(i, &constants, &vec![1.0; frames], 1, 1).qr().q();
            let block = &mut self.blocks[i];
            block.y -= &zero * zero.tr_mul(&block.y);
            block.w -= &zero * zero.tr_mul(&block.w);
            block.zero = Some(zero);
        }
        self
    }

    /// Adds the rows along the motion with drawn errors added and subtracted, a pair for each draw:
    /// what the errors of the motion do to columns.
    #[must_use]
    pub fn with_disturbed(mut self, pairs: Vec<[Session<'a>; 2]>) -> Self {
        let alike = |s: &Session<'_>| {
            s.blocks.len() == self.blocks.len()
                && s.blocks.iter().zip(&self.blocks).all(|(a, b)| a.y.shape() == b.y.shape())
        };
        self.disturbed = Arc::new(pairs.into_iter().filter(|pair| pair.iter().all(alike)).collect());
        self
    }

    /// Computes the error with the effects found by `compute` (flight, contact) instead of
    /// estimating it from the rows, before the verdict is given. Failures from now on are those of
    /// this session alone, not of the one that it was cloned from.
    #[must_use]
    pub fn with_stages(mut self, compute: Compute<'a>) -> Self {
        self.failed = Arc::new(Mutex::new(self.failed()));
        self.by_stages = ByStages::new(compute);
        self
    }

    /// Tells `tell` how far a discovery is, and what it knows already.
    #[must_use]
    pub fn with_progress(mut self, tell: Tell<'a>) -> Self {
        self.counter = Counter::new(tell);
        self
    }

    /// Data that were left out, with the reason, in words.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The constants that columns are built from.
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// Rows that an effect adds to each block, `−E` in the weights of the rows; `None` if they
    /// cannot be formed.
    pub(crate) fn columns(
        &self,
        effect: &dyn Effect,
        target: Target,
        nonlinear: &[f64],
        domain: Domain,
    ) -> Option<Vec<DMatrix<f64>>> {
        let coefficients = effect.coefficients(self.scene, target);
        let k = coefficients.len();
        let inertia = effect.inertia(self.scene, target, nonlinear).map(|changes| self.regrouped(&changes));
        let wrench = effect.has_wrench();
        let mut out: Vec<DMatrix<f64>> = self.blocks.iter().map(|b| DMatrix::zeros(b.y.nrows(), k)).collect();
        // one buffer for all trials: memory taken anew for each would cost more than the sums
        let mut made = Columns::zeros(0, k);
        for (trial, pair) in self.series.iter().enumerate().filter(|_| wrench) {
            for (of, series) in pair.iter().enumerate() {
                let its =
                    |b: &Block| b.trial == trial && usize::from(b.kind != StretchKind::Flight) == of && b.y.nrows() > 0;
                if (of == 1 && domain == Domain::Flight) || !self.blocks.iter().any(its) {
                    continue;
                }
                made.reset(series.len(), k);
                effect.evaluate(series, target, nonlinear, &mut made);
                for (block, rows) in self.blocks.iter().zip(&mut out).filter(|(b, _)| its(b)) {
                    block.windows.apply(series, &made, rows);
                }
            }
        }
        for (block, rows) in self.blocks.iter().zip(&mut out) {
            block.as_measured(rows);
            // the rows of the parameters are as measured already
            if let Some(change) = &inertia {
                *rows += &block.y * change;
            }
        }
        Some(out)
    }

    /// Of each series, in the order of [`series_of`](Self::series_of), whether any of its rows are
    /// in use.
    pub(crate) fn series_in_use(&self) -> Vec<bool> {
        let mut out = vec![false; 2 * self.series.len()];
        for (i, block) in self.blocks.iter().enumerate() {
            out[self.series_of(i)] |= block.y.nrows() > 0;
        }
        out
    }

    /// Place of a block's series among those of all trials: flights and contact of the first trial,
    /// of the second …
    pub(crate) fn series_of(&self, block: usize) -> usize {
        let b = &self.blocks[block];
        2 * b.trial + usize::from(b.kind != StretchKind::Flight)
    }

    /// The session with the rows of its flights only.
    pub(crate) fn in_flight(&self) -> Self {
        self.with_rows_of(&self.blocks.iter().map(|b| b.kind != StretchKind::Contact).collect::<Vec<_>>())
    }

    /// The session with the rows of some blocks only; the others keep their places, without rows.
    pub(crate) fn with_rows_of(&self, kept: &[bool]) -> Self {
        let blocks = self.blocks.iter().zip(kept).map(|(b, keep)| if *keep { b.clone() } else { b.without_rows() });
        let of_kept = |rows: &Vec<DVector<f64>>| -> Vec<DVector<f64>> {
            rows.iter().zip(kept).map(|(r, keep)| if *keep { r.clone() } else { DVector::zeros(0) }).collect()
        };
        let rows = self.drawn.rows.iter().map(of_kept).collect();
        Self {
            blocks: blocks.collect(),
            series: Arc::clone(&self.series),
            trials: self.trials.clone(),
            groups: self.groups.clone(),
            from_full: self.from_full.clone(),
            prior: self.prior.clone(),
            drawn: Arc::new(Drawn { rows, zeros: self.drawn.zeros.clone() }),
            disturbed: Arc::clone(&self.disturbed),
            on_plates: Arc::clone(&self.on_plates),
            warnings: Vec::new(),
            failed: Arc::clone(&self.failed),
            counter: self.counter.clone(),
            by_stages: self.by_stages,
            ..*self
        }
    }

    /// Rows that a choice adds to each block, zero in trials in which it does not act. An effect
    /// defined as a difference between groups that names no trials acts in all groups but the
    /// first.
    pub(crate) fn columns_of(
        &self,
        choice: &aloft_effects::EffectInstance<'_>,
        domain: Domain,
    ) -> Option<Vec<DMatrix<f64>>> {
        let mut columns = self.columns(choice.effect, choice.target, &choice.nonlinear, domain)?;
        let by_group = if choice.trials.is_empty() && choice.effect.about().by_group { self.loaded() } else { None };
        for (block, c) in self.blocks.iter().zip(&mut columns) {
            let acts = by_group.as_ref().map_or_else(|| choice.acts_in(&self.trials[block.trial]), |g| g[block.trial]);
            if !acts {
                c.fill(0.0);
            }
        }
        Some(columns)
    }

    /// True for trials of a group other than the first one named; `None` if the laboratory named no
    /// group or only one.
    pub(crate) fn loaded(&self) -> Option<Vec<bool>> {
        let first = self.groups.iter().flatten().next()?;
        let mask: Vec<bool> = self.groups.iter().map(|g| g.as_ref().is_some_and(|g| g != first)).collect();
        mask.contains(&true).then_some(mask)
    }

    /// Changes of φ converted to changes of the base parameters, one column each.
    fn regrouped(&self, changes: &[Vec<Phi>]) -> DMatrix<f64> {
        let n = self.from_full.ncols();
        let full = DMatrix::from_fn(n, changes.len(), |i, j| changes[j].get(i / 10).map_or(0.0, |phi| phi[i % 10]));
        &self.from_full * full
    }
}

impl Block {
    fn from_rows(trial: usize, stretch: &Stretch, mut rows: WeakRows, moment_length_m: f64) -> Self {
        rows.apply_fixed_weights(moment_length_m);
        let n = rows.matrix.nrows();
        let p = rows.matrix.ncols() - 1;
        let force_weight = 1.0 / (rows.force_scale_n * rows.test.integral_s());
        Self {
            trial,
            kind: stretch.kind,
            y: DMatrix::from_fn(n, p, |i, j| rows.matrix[(i, j)]),
            w: DVector::from_fn(n, |i, _| rows.matrix[(i, p)]),
            n_rows: n,
            windows: Windows {
                half: rows.test.half,
                centres: rows.centres,
                psi: rows.test.psi,
                origin: rows.origin,
                force_weight,
                moment_weight: force_weight / moment_length_m,
            },
            zero: None,
            white: None,
        }
    }

    /// Takes from rows of wrenches what the block's own rows do not have: the plates' zero, and the
    /// covariance of their errors.
    fn as_measured(&self, rows: &mut DMatrix<f64>) {
        if let Some(zero) = self.zero.as_ref().filter(|z| z.nrows() == rows.nrows()) {
            *rows -= zero * zero.tr_mul(rows);
        }
        if let Some(white) = self.white.as_ref().filter(|_| rows.nrows() > 0) {
            *rows = white.times(rows);
        }
    }

    /// The same for rows of another session with the same windows; none for a block without rows.
    pub(crate) fn as_measured_of(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        let mut out = rows.clone();
        self.as_measured(&mut out);
        out
    }

    fn without_rows(&self) -> Self {
        let windows = Windows { centres: Vec::new(), origin: Vec::new(), psi: Vec::new(), ..self.windows };
        let (y, w) = (DMatrix::zeros(0, self.y.ncols()), DVector::zeros(0));
        Self { y, w, n_rows: 0, windows, zero: None, white: None, ..*self }
    }

    /// True for force rows: weak rows come in sixes, force first.
    pub(crate) fn is_force(row: usize) -> bool {
        row % 6 < 3
    }
}

impl Session<'_> {
    /// Rows of a block for wrenches `unit[d] · weight[b]`, in the rows' weights; column `d · nb +
    /// b`. `unit[d]` holds force and moment about the world origin in every frame of the block's
    /// series, `weight` holds `nb` numbers a frame. Every `stride`-th frame of a window is
    /// used.
    pub(crate) fn modulated(
        &self,
        block: usize,
        unit: &[Vec<[f64; 6]>],
        weight: &[f64],
        nb: usize,
        stride: usize,
    ) -> DMatrix<f64> {
        let b = &self.blocks[block];
        let windows = &b.windows;
        let series = &self.series[b.trial][usize::from(b.kind != StretchKind::Flight)];
        let mut rows = DMatrix::zeros(b.y.nrows(), unit.len() * nb);
        let mut sums = vec![0.0; unit.len() * nb * 6];
        for (w, &centre) in windows.centres.iter().enumerate() {
            let first = centre - windows.half;
            let Some(start) = series.index_of(first) else { continue };
            sums.fill(0.0);
            let skip = (windows.half % stride).min(stride - 1);
            for (i, (psi, at)) in windows.psi.iter().zip(&windows.origin[w]).enumerate().skip(skip).step_by(stride) {
                let index = start + i;
                if index >= series.len() || series.motion_frames()[index] != first + i {
                    continue;
                }
                let psi = -psi * stride as f64;
                let weights = &weight[index * nb..(index + 1) * nb];
                for (d, wrenches) in unit.iter().enumerate() {
                    let h = &wrenches[index];
                    let force = Vector3::new(h[0], h[1], h[2]);
                    let moment = Vector3::new(h[3], h[4], h[5]) - at.position.cross(&force);
                    let (f, m) = (force * (psi * windows.force_weight), moment * (psi * windows.moment_weight));
                    let h = [f.x, f.y, f.z, m.x, m.y, m.z];
                    let sums = sums[d * nb * 6..].as_chunks_mut::<6>().0;
                    // two of the six functions of a curve are zero in every frame
                    for (x, sum) in weights.iter().zip(sums).filter(|(x, _)| **x != 0.0) {
                        for (a, b) in sum.iter_mut().zip(&h) {
                            *a += x * b;
                        }
                    }
                }
            }
            for (c, sum) in sums.chunks_exact(6).enumerate() {
                for (axis, x) in sum.iter().enumerate() {
                    rows[(6 * w + axis, c)] = *x;
                }
            }
        }
        b.as_measured(&mut rows);
        rows
    }
}

impl Windows {
    /// `−Σ ψ (f, n₀ − o × f)` in the rows' weights.
    fn apply(&self, series: &Series<'_>, columns: &Columns, rows: &mut DMatrix<f64>) {
        let frames = series.motion_frames();
        let mut sums = vec![[0.0; 6]; columns.k];
        for (w, (&centre, origin)) in self.centres.iter().zip(&self.origin).enumerate() {
            let first = centre - self.half;
            let Some(start) = series.index_of(first) else { continue };
            // frames ascend: the last one in its place means that none between is missing
            let is_whole = frames.get(start + self.psi.len() - 1) == Some(&(first + self.psi.len() - 1));
            let has = |i: usize| is_whole || frames.get(start + i) == Some(&(first + i));
            sums.fill([0.0; 6]);
            for (i, (psi, at)) in self.psi.iter().zip(origin).enumerate().filter(|(i, _)| has(*i)) {
                let o = &at.position;
                for (sum, h) in sums.iter_mut().zip(columns.wrenches(start + i)) {
                    let [x, y, z] = [h[0], h[1], h[2]];
                    let arm = [o.y * z - o.z * y, o.z * x - o.x * z, o.x * y - o.y * x];
                    for axis in 0..3 {
                        sum[axis] += h[axis] * psi;
                        sum[3 + axis] += (h[3 + axis] - arm[axis]) * psi;
                    }
                }
            }
            for (c, sum) in sums.iter().enumerate() {
                for axis in 0..3 {
                    rows[(6 * w + axis, c)] -= self.force_weight * sum[axis];
                    rows[(6 * w + 3 + axis, c)] -= self.moment_weight * sum[3 + axis];
                }
            }
        }
    }
}

/// Name of a kind of stretch.
pub(crate) trait Word {
    /// `flight`, `contact`, `merged`.
    fn word(&self) -> &'static str;
}

impl Word for StretchKind {
    fn word(&self) -> &'static str {
        match self {
            Self::Flight => "flight",
            Self::Contact => "contact",
            Self::Merged => "merged",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::White;
    use nalgebra::DMatrix;

    #[test]
    fn rows_in_units_of_their_errors_are_the_same_by_axis_and_together() {
        let windows = 4;
        let of = |axis: usize| {
            DMatrix::from_fn(windows, windows, |a, b| if b <= a { 1.0 + (axis + 3 * a + b) as f64 } else { 0.0 })
        };
        let axes = std::array::from_fn(of);
        let whole =
            DMatrix::from_fn(
                6 * windows,
                6 * windows,
                |i, j| {
                    if i % 6 == j % 6 { of(i % 6)[(i / 6, j / 6)] } else { 0.0 }
                },
            );
        let rows = DMatrix::from_fn(6 * windows, 3, |i, j| ((7 * i + 5 * j) % 11) as f64 - 4.0);
        let apart = White::ByAxis(axes).times(&rows) - White::Whole(whole).times(&rows);
        assert!(apart.amax() < 1e-12, "{apart}");
    }
}

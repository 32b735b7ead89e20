//! The acceleration of free flight, estimated without assuming its magnitude or direction.
//!
//! In flight the centre of mass has a constant acceleration. The stated gravity is the first guess,
//! but a wrong frame rate or unit of length scales it, a tilted frame rotates it and body-weight
//! support reduces it. Slow movement (a squat, standing) also has stretches of nearly constant
//! acceleration. Flights differ from these at their edges: at push-off, landing or release the
//! acceleration changes between free fall and full support within a few hundredths of a second,
//! whereas in a slow movement this change takes as long as the plateau itself. A plateau therefore
//! counts only if the acceleration quickly returns to rest (or beyond) at each edge that the
//! recording shows.

use crate::FlightOptions;
use crate::error::FlightError;
use aloft_body::Motion;
use aloft_signal::{
    Butterworth, CutoffCorrection, LowPass, SHORT_RUN_S, derivatives, finite_runs, parabola_of, runs_where,
};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::ops::Range;

/// Standard gravity, m/s²: reference for [`FlightOptions::max_duration_s`].
const STANDARD_MPS2: f64 = aloft_body::STANDARD_GRAVITY_MPS2;
/// Time within which support must appear at the edge of a flight, as a fraction of its length (a
/// fraction, because the rate may be wrong). A sinusoid that is cut at −30 % of the mean of its top
/// needs at least 0.16 of the plateau's length from there to [`SUPPORTED`].
const EDGE_SHARE: f64 = 0.13;
/// Fraction of a stretch between two loads of the plates that a flight must fill to be confirmed by
/// them.
const CONFIRMED: f64 = 0.7;
/// Free accelerations below this require the wider initial bands, m/s².
const WEAK_MPS2: f64 = 4.9;
/// Typical error of the acceleration from a prior during tumbling, m/s².
const PRIOR_ERROR_MPS2: f64 = 1.5;
/// Factor on the cut-off for weak accelerations.
pub(crate) const SLOW: f64 = 0.4;
/// Fraction of the free acceleration below which a body counts as supported.
const SUPPORTED: f64 = 0.3;
/// Largest root mean square deviation inside a flight, relative to its mean acceleration. Jumps of
/// a simulated woman and of a real subject have 0.05 to 0.14 before the fit of first moments, and a
/// trial has several; plateaus in squats and arm swings have 0.16 and more.
const STEADY: f64 = 0.12;
/// The same below [`WEAK`] times the stated gravity, where slow movements also have plateaus.
const STEADY_AND_WEAK: f64 = 0.08;
const WEAK: f64 = 0.3;
/// The same for plateaus longer than any on the ground with sharp edges, s (jumps in weak gravity).
const STEADY_AND_LONG: f64 = 0.25;
const LONG_S: f64 = 1.0;
/// The same before the fit of first moments, for stronger accelerations; [`STEADY`] must then hold
/// after the fit.
const STEADY_BEFORE_FIT: f64 = 0.3;
/// The same in a stretch bounded by plates in which no plate is loaded.
const STEADY_ON_PLATES: f64 = 0.35;
/// Largest number of candidate accelerations.
const CANDIDATES: usize = 64;

/// Search for an unknown free acceleration.
pub(crate) struct Search<'a> {
    /// Magnitude of the stated gravity, m/s².
    pub stated_mps2: f64,
    /// Shortest flight if confirmed by plates, frames.
    pub shortest: usize,
    /// Shortest flight otherwise, frames.
    pub shortest_alone: usize,
    /// Smallest acceleration considered, m/s².
    pub least_mps2: f64,
    /// Whether the first moments are still those of the prior and may have larger errors than usual
    /// for people.
    pub before_fit: bool,
    /// Frames between two successive loads of the plates.
    pub between_loads: &'a [Range<usize>],
    /// Frames that may be flight (no plate loaded).
    pub allowed: &'a dyn Fn(usize) -> bool,
}

/// Low-passed acceleration of the centre of mass, frame by frame.
pub(crate) struct Acceleration {
    /// m/s², world frame; NaN where the frame was not solved.
    pub mps2: Vec<Vector3<f64>>,
    /// Frame rate, Hz.
    pub rate_hz: f64,
}

impl Acceleration {
    /// Filters the path and differentiates it twice.
    ///
    /// `slowness` scales the cut-off ([`SLOW`] or one): where bodies fall more slowly, jumps take
    /// longer, and noise must not mask a weak acceleration.
    pub(crate) fn of(
        com_m: &[Vector3<f64>],
        motion: &Motion,
        options: &FlightOptions,
        slowness: f64,
    ) -> Result<Self, FlightError> {
        let cutoff_hz = options.com_cutoff_hz * slowness;
        let filter = LowPass { order: 2, cutoff_hz, correction: CutoffCorrection::None };
        let filter = Butterworth::design(filter, motion.rate_hz).map_err(|e| FlightError::Filter {
            trial: motion.trial.clone(),
            what: "centre of mass",
            problem: e.to_string(),
        })?;
        let mut mps2 = vec![Vector3::repeat(f64::NAN); com_m.len()];
        for axis in 0..3 {
            let mut channel: Vec<f64> = com_m.iter().map(|p| p[axis]).collect();
            let short = |run: &Range<usize>| run.len() as f64 <= SHORT_RUN_S * motion.rate_hz;
            let parabolas: Vec<(Range<usize>, Vec<f64>)> = finite_runs(&channel)
                .into_iter()
                .filter(short)
                .map(|run| (run.clone(), parabola_of(&channel[run])))
                .collect();
            let add = |channel: &mut [f64], sign: f64| {
                for (run, values) in &parabolas {
                    channel[run.clone()].iter_mut().zip(values).for_each(|(c, x)| *c += sign * x);
                }
            };
            add(&mut channel, -1.0);
            filter.filtfilt(&mut channel);
            add(&mut channel, 1.0);
            for (out, a) in mps2.iter_mut().zip(derivatives(&channel, motion.rate_hz).1) {
                out[axis] = a;
            }
        }
        Ok(Self { mps2, rate_hz: motion.rate_hz })
    }

    /// True if the run of solved frames around a stretch was filtered about its own parabola, so
    /// that its ends are as good as its middle.
    pub(crate) fn is_in_short_run(&self, stretch: &Range<usize>) -> bool {
        let solved = |f: &usize| self.mps2[*f].x.is_finite();
        let before = (0..stretch.start).rev().take_while(solved).count();
        let after = (stretch.end..self.mps2.len()).take_while(solved).count();
        (before + stretch.len() + after) as f64 <= SHORT_RUN_S * self.rate_hz
    }

    /// Stretches in which the acceleration is `free`, within a band of `widen` times the width in
    /// the options, with interruptions merged; `allowed` selects the frames that may belong to one.
    pub(crate) fn stretches(
        &self,
        free: &Vector3<f64>,
        options: &FlightOptions,
        widen: f64,
        allowed: impl Fn(usize) -> bool,
    ) -> Vec<Range<usize>> {
        let falls = |frame: usize| Self::within(&self.mps2[frame], free, options, widen);
        let merge = (options.merge_s * self.rate_hz).round() as usize;
        let mut merged: Vec<Range<usize>> = Vec::new();
        for run in runs_where(self.mps2.len(), |frame| falls(frame) && allowed(frame)) {
            match merged.last_mut() {
                Some(last)
                    if run.start - last.end <= merge
                        && last.len().max(run.len()) > merge
                        && (last.end..run.start).all(&allowed) =>
                {
                    last.end = run.end;
                }
                _ => merged.push(run),
            }
        }
        merged
    }

    /// True if an acceleration is `free`, within a band of `widen` times the width in the options.
    pub(crate) fn within(mps2: &Vector3<f64>, free: &Vector3<f64>, options: &FlightOptions, widen: f64) -> bool {
        let size = free.norm();
        let least = options.least_band_mps2.min(size * 2.0 / 3.0 / 1.6);
        // A prior that is wrong by centimetres in a rotating link gives an acceleration error of
        // metres per second squared, whatever the gravity. The first, wide searches before the fit
        // of first moments must tolerate this in weak gravity too.
        let wide = if size < WEAK_MPS2 { PRIOR_ERROR_MPS2 * (widen - 1.0) / 0.6 } else { 0.0 };
        let along = (options.vertical_band_g * size).max(least) * widen + wide;
        let across = (options.horizontal_band_g * size).max(least) * widen + wide;
        let off = mps2 - free;
        if size == 0.0 {
            return off.norm() < options.rest_band_mps2 * widen + 2.0 * wide;
        }
        let parallel = off.dot(free) / size;
        parallel.abs() < along && (off - free * (parallel / size)).norm() < across
    }

    /// Remaining fraction of the free acceleration in a frame, along it; NaN where not solved.
    fn share(&self, frame: usize, free: &Vector3<f64>) -> f64 {
        self.mps2[frame].dot(free) / free.norm_squared()
    }

    /// Whether the body is supported shortly outside both edges of a stretch. An edge at which the
    /// recording (or its solved part) ends gives no evidence; at least one edge must.
    pub(crate) fn is_sharp(&self, stretch: &Range<usize>, free: &Vector3<f64>) -> bool {
        let reach = (EDGE_SHARE * stretch.len() as f64).ceil() as usize;
        let solved = |frame: usize| self.mps2.get(frame).is_some_and(|a| a.x.is_finite());
        // True: supported soon; false: not supported; `None`: the recording ends before this is
        // known.
        let look = |frames: &mut dyn Iterator<Item = usize>| -> Option<bool> {
            for frame in frames {
                if !solved(frame) {
                    return None;
                }
                if self.share(frame, free) < SUPPORTED {
                    return Some(true);
                }
            }
            Some(false)
        };
        let start = stretch.start;
        let before = if start < reach {
            look(&mut (0..start).rev()).filter(|seen| *seen)
        } else {
            look(&mut (start - reach..start).rev())
        };
        let after = look(&mut (stretch.end..stretch.end + reach));
        !matches!((before, after), (Some(false), _) | (_, Some(false)) | (None, None))
    }

    /// Frames in stretches of this free acceleration that are steady, long enough, and have sharp
    /// edges.
    fn evidence(&self, free: &Vector3<f64>, options: &FlightOptions, search: &Search<'_>) -> Vec<Range<usize>> {
        let size = free.norm();
        let longest = longest_frames(size, self.rate_hz, options);
        let mut stretches = self.stretches(free, options, 1.0, search.allowed);
        let is_flight = |s: &Range<usize>| {
            let shared = |r: &Range<usize>| s.end.min(r.end).saturating_sub(s.start.max(r.start)) as f64;
            let confirmed = search.between_loads.iter().any(|r| shared(r) >= CONFIRMED * r.len().max(s.len()) as f64);
            let alone = (search.shortest_alone as f64 * flight_shortening(size)) as usize;
            let (shortest, steady) = match confirmed {
                true => (search.shortest, STEADY_ON_PLATES),
                false if s.len() as f64 > LONG_S * self.rate_hz => (alone, STEADY_AND_LONG),
                false if size < WEAK * search.stated_mps2 => (alone, STEADY_AND_WEAK),
                false if search.before_fit => (alone, STEADY_BEFORE_FIT),
                false => (alone, STEADY),
            };
            (shortest..=longest).contains(&s.len()) && self.spread(s) < steady && self.is_sharp(s, free)
        };
        stretches.retain(is_flight);
        stretches
    }

    /// Root mean square deviation of the acceleration from its mean inside a stretch, relative to
    /// the magnitude of the mean.
    fn spread(&self, stretch: &Range<usize>) -> f64 {
        let Some(mean) = self.mean(std::slice::from_ref(stretch)) else { return f64::INFINITY };
        let squares: Vec<f64> =
            inner(stretch).map(|f| (self.mps2[f] - mean).norm_squared()).filter(|x| x.is_finite()).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt() / mean.norm()
    }

    /// The free acceleration with the best evidence and the number of its frames; `None` if no
    /// acceleration has any.
    pub(crate) fn find(&self, options: &FlightOptions, search: &Search<'_>) -> Option<(Vector3<f64>, usize)> {
        let frames = |stretches: &[Range<usize>]| stretches.iter().map(Range::len).sum::<usize>();
        let (mut free, mut best) = (None, 0);
        for mut candidate in self.candidates(search) {
            // The second pass is centred on the mean found by the first.
            for _ in 0..2 {
                let stretches = self.evidence(&candidate, options, search);
                let found = frames(&stretches);
                if found > best {
                    (free, best) = (Some(candidate), found);
                }
                match self.mean(&stretches) {
                    Some(mean) if mean.norm() >= search.least_mps2 => candidate = mean,
                    _ => break,
                }
            }
        }
        free.map(|free| (free, best))
    }

    /// Number of frames in flights at a given free acceleration that pass the same tests.
    pub(crate) fn frames_at(&self, free: &Vector3<f64>, options: &FlightOptions, search: &Search<'_>) -> usize {
        self.evidence(free, options, search).iter().map(Range::len).sum()
    }

    /// Mean acceleration over the inner seven tenths of stretches.
    fn mean(&self, stretches: &[Range<usize>]) -> Option<Vector3<f64>> {
        let (mut sum, mut n) = (Vector3::zeros(), 0);
        for s in stretches {
            for frame in inner(s).filter(|f| self.mps2[*f].iter().all(|x| x.is_finite())) {
                sum += self.mps2[frame];
                n += 1;
            }
        }
        (n > 0).then(|| sum / f64::from(n))
    }

    /// Means of windows with nearly constant acceleration, grouped by magnitude and direction; the
    /// largest groups first.
    fn candidates(&self, search: &Search<'_>) -> Vec<Vector3<f64>> {
        let (n, window) = (self.mps2.len(), search.shortest);
        let step = (window / 4).max(1);
        let mut bins: BTreeMap<[i64; 4], (usize, Vector3<f64>)> = BTreeMap::new();
        let mut start = 0;
        while start + window <= n {
            let frames = start..start + window;
            start += step;
            if !frames.clone().all(|f| (search.allowed)(f) && self.mps2[f].iter().all(|x| x.is_finite())) {
                continue;
            }
            let mean = frames.clone().map(|f| self.mps2[f]).sum::<Vector3<f64>>() / window as f64;
            let spread = frames.map(|f| (self.mps2[f] - mean).norm_squared()).sum::<f64>() / window as f64;
            let size = mean.norm();
            if size < search.least_mps2 || spread.sqrt() > 0.35 * size {
                continue;
            }
            let toward = mean / size * 2.0;
            let key = [
                (size.ln() * 4.0).round() as i64,
                toward.x.round() as i64,
                toward.y.round() as i64,
                toward.z.round() as i64,
            ];
            let bin = bins.entry(key).or_insert((0, Vector3::zeros()));
            bin.0 += 1;
            bin.1 += mean;
        }
        let mut all: Vec<(usize, Vector3<f64>)> = bins.into_values().collect();
        all.sort_by_key(|bin| std::cmp::Reverse(bin.0));
        all.truncate(CANDIDATES);
        all.into_iter().map(|(count, sum)| sum / count as f64).collect()
    }
}

/// Factor on the length of flights where bodies appear to fall faster than on Earth (for example
/// because the stated rate is too high).
pub(crate) fn flight_shortening(free_mps2: f64) -> f64 {
    (STANDARD_MPS2 / free_mps2.max(STANDARD_MPS2)).sqrt().max(0.5)
}

/// A stretch without 15 % at both ends, where the low-pass mixes in contact.
pub(crate) fn inner(stretch: &Range<usize>) -> Range<usize> {
    let cut = stretch.len() * 15 / 100;
    stretch.start + cut..stretch.end - cut
}

/// Longest flight in frames at the free acceleration `free_mps2`: a jump takes longer in weak
/// gravity and has no end without it.
pub(crate) fn longest_frames(free_mps2: f64, rate_hz: f64, options: &FlightOptions) -> usize {
    if free_mps2 <= 0.0 {
        return usize::MAX;
    }
    (options.max_duration_s * (STANDARD_MPS2 / free_mps2).sqrt().max(1.0) * rate_hz) as usize
}

//! Tests whether nominal 95 % intervals contain the truth in 95 % of simulated sets. Noise and soft
//! tissue are drawn on the true motions of the fixtures, in memory; base parameters, links and
//! effect coefficients are counted separately.
//!
//! `ALOFT_COVERAGE_DRAWS=200` runs more sets than the default test, `ALOFT_COVERAGE_SEED` sets the
//! first seed, `ALOFT_IDENTIFY_DATA` names longer recordings.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests that print what they measured")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_body::subject::{PersonFacts, PriorSd};
use aloft_body::{LinkInertia, Motion, Subject};
use aloft_identify::{Estimator, IdentifyOptions, LinkPrior, Origin, Parameters, Symmetry, identify_with_errors};
use aloft_ik::{IkOptions, MarkerErrors};
use aloft_regressor::{
    Acting, CoordinateNoise, EffectColumns, Factor, Noise, RepeatedErrors, Seen, WeakOptions, weak_factor_with_repeated,
};
use aloft_trial::{Markers, Trial};
use common::{Truth, load};
use nalgebra::{DMatrix, Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const MARKER_SD_M: f64 = 0.3e-3;

/// Relation of a set's truth to its prior: the true body differs from the prior by ten numbers per
/// link (relative mass, three shifts of the centre of mass, three stretches and three shears of the
/// mass distribution), drawn from the normal distribution stated by the prior, mirrored limbs
/// together. Masses of the prior are scaled so that their sum is the true mass, which the program
/// knows.
fn prior(truth: &Truth, sd: PriorSd, symmetry: Option<&Symmetry>, seed: u64) -> LinkPrior {
    let n = truth.phi.len();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (m, c, r) = (sd.mass_rel, sd.com_m, sd.radius_rel);
    let size = [m, c, c, c, r, r, r, 0.5 * r, 0.5 * r, 0.5 * r];
    let mut numbers: Vec<[f64; 10]> =
        (0..n).map(|_| size.map(|s| s * Distribution::<f64>::sample(&StandardNormal, &mut rng))).collect();
    if let Some(symmetry) = symmetry {
        // shears 7 yz, 8 zx, 9 xy: those that contain the axis across the plane of symmetry are odd
        let odd = match symmetry.axis {
            0 => [1, 8, 9],
            1 => [2, 7, 9],
            _ => [3, 7, 8],
        };
        let own = (1.0 - symmetry.correlation.powi(2)).sqrt();
        for &i in &symmetry.midline {
            odd.iter().for_each(|k| numbers[i][*k] *= (1.0 - symmetry.correlation).sqrt());
        }
        for &(i, j) in &symmetry.pairs {
            for k in 0..10 {
                let sign = if odd.contains(&k) { -1.0 } else { 1.0 };
                numbers[j][k] = sign * symmetry.correlation * numbers[i][k] + own * numbers[j][k];
            }
        }
    }
    let mut links: Vec<LinkInertia> = truth
        .phi
        .iter()
        .zip(&numbers)
        .map(|(phi, x)| {
            let link = LinkInertia::from_phi(phi);
            let i = link.inertia_com_kgm2;
            let second = (Matrix3::identity() * (0.5 * i.trace()) - i) / link.mass_kg;
            let strain = Matrix3::new(x[4], x[9], x[8], x[9], x[5], x[7], x[8], x[7], x[6]);
            // the truth is the prior deformed by these numbers, so the prior is the truth with the
            // inverse deformation
            let back = (Matrix3::identity() + strain).try_inverse().unwrap();
            let mass_kg = link.mass_kg / (1.0 + x[0]);
            let second = back * second * back.transpose() * mass_kg;
            LinkInertia {
                mass_kg,
                com_m: link.com_m - Vector3::new(x[1], x[2], x[3]),
                inertia_com_kgm2: Matrix3::identity() * second.trace() - second,
            }
        })
        .collect();
    let scale = truth.mass() / links.iter().map(|l| l.mass_kg).sum::<f64>();
    for link in &mut links {
        link.mass_kg *= scale;
        link.inertia_com_kgm2 *= scale;
    }
    LinkPrior::new(&links, &vec![sd; n], symmetry).unwrap()
}

/// Left and right links of the simulated subjects, whose frames have y to the left.
fn symmetry(truth: &Truth) -> Symmetry {
    let names: Vec<&str> = truth.model.links.iter().map(|l| l.name.as_str()).collect();
    let (mut pairs, mut midline) = (Vec::new(), Vec::new());
    for (i, name) in names.iter().enumerate() {
        let left = name.strip_prefix('r').and_then(|stem| names.iter().position(|n| n.strip_prefix('l') == Some(stem)));
        match left {
            Some(j) => pairs.push((i, j)),
            None if !name.starts_with('l') => midline.push(i),
            None => {}
        }
    }
    Symmetry { pairs, midline, axis: 1, correlation: 0.9 }
}

/// A drag on the root link and a constant force at it, neither of which acts: both true
/// coefficients are zero. The drag's column comes from the noisy motion, like every effect column.
fn effects(truth: &Truth, motion: &Motion) -> EffectColumns {
    let n = motion.n_frames();
    let place = |f: usize| Vector3::new(motion.q(f)[0], motion.q(f)[1], motion.q(f)[2]);
    let wrench = (0..n)
        .map(|f| {
            let (a, b) = (f.saturating_sub(1), (f + 1).min(n - 1));
            let same = truth.flights.iter().any(|x| x[0] <= a && b < x[3]);
            let v = if same { (place(b) - place(a)) * (motion.rate_hz / (b - a) as f64) } else { Vector3::zeros() };
            let mut out = DMatrix::zeros(6, 2);
            for (c, force) in [v * -v.norm(), Vector3::x()].into_iter().enumerate() {
                out.fixed_view_mut::<3, 1>(0, c).copy_from(&force);
                out.fixed_view_mut::<3, 1>(3, c).copy_from(&place(f).cross(&force));
            }
            out
        })
        .collect();
    EffectColumns { names: vec!["drag".to_owned(), "push".to_owned()], wrench, ..EffectColumns::none() }
}

#[derive(Clone, Copy)]
struct Case {
    set: &'static str,
    soft_m: f64,
    window_s: f64,
    white: bool,
    estimator: Estimator,
    effects: bool,
    prior: PriorSd,
}

/// Motions with other errors of the markers, drawn as for a recording.
fn drawn(truth: &Truth, motion: &Motion, places: Vec<Vec<Vector3<f64>>>) -> Vec<Motion> {
    let n = motion.n_frames();
    let labels = truth.markers.iter().map(|m| m.label.clone()).collect();
    let markers = Markers { rate_hz: motion.rate_hz, first_frame: 1, n_frames: n, labels, trajectories: places };
    let subject = Subject {
        facts: PersonFacts { name: String::new(), sex: None, height_m: None, mass_kg: truth.mass() },
        model: truth.model.clone(),
        markers: truth.markers.clone(),
        prior: Vec::new(),
        prior_sd: Vec::new(),
        static_q: motion.q(0).to_vec(),
        provenance: Vec::new(),
        estimated: None,
        boxes: Vec::new(),
    };
    let options = IkOptions { marker_sd_m: MARKER_SD_M, ..IkOptions::default() };
    let errors = MarkerErrors::of(&subject, &Trial { markers, ..Trial::default() }, motion, &options).unwrap().unwrap();
    let flights = truth.stretches();
    let wanted = |_, f| flights.iter().any(|s| (s.first_frame..s.end_frame).contains(&f));
    errors.draw_each(motion, &wanted, 1, 0..24)
}

fn one(truth: &Truth, case: &Case, seed: u64) -> Parameters {
    let person = truth.phi.len() > 3;
    let sides = person.then(|| symmetry(truth));
    let prior = prior(truth, case.prior, sides.as_ref(), seed ^ 0x9e3d);
    let (motion, places) = truth.recorded(MARKER_SD_M, case.soft_m, seed);
    let columns = case.effects.then(|| effects(truth, &motion));
    let noise = Noise {
        slow: if person { 5.0 } else { 0.0 },
        ..Noise::white(CoordinateNoise::Markers { markers: &truth.markers, sd_m: MARKER_SD_M })
    };
    let options = WeakOptions { window_s: Some(case.window_s), ..WeakOptions::default() };
    let seen = if case.soft_m > 0.0 { drawn(truth, &motion, places) } else { Vec::new() };
    let seen = Seen { markers: &seen, geometry: &[] };
    let (factors, errors): (Vec<Factor>, Vec<RepeatedErrors>) = truth
        .stretches()
        .iter()
        .map(|s| {
            let acting = Acting { measured: None, effects: columns.as_ref() };
            let (phi, noise) = (prior.phi(), case.white.then_some(&noise));
            let (model, base) = (&truth.model, &truth.base);
            weak_factor_with_repeated(model, base, &phi, &motion, s, acting, &options, noise, &seen).unwrap()
        })
        .unzip();
    let options = IdentifyOptions { estimator: case.estimator, ..IdentifyOptions::default() };
    identify_with_errors(&truth.model, &truth.base, &factors, None, &errors, truth.mass(), Some(&prior), &options)
        .unwrap()
        .parameters
}

/// One parameter over all sets.
#[derive(Default, Clone)]
struct Count {
    name: String,
    hits: u32,
    sets: u32,
    /// Sum of squares of the error in half-widths.
    squares: f64,
    /// Sets in which the value is that of the table.
    from_table: u32,
}

impl Count {
    fn share(&self) -> f64 {
        f64::from(self.hits) / f64::from(self.sets)
    }
    fn by_motion(&self) -> bool {
        2 * self.from_table < self.sets
    }
}

/// Counts by parameter, and the share of hits of each set.
#[derive(Default)]
struct Counts(Vec<Count>, Vec<f64>);

impl Counts {
    fn add(&mut self, i: usize, name: &str, ci95: Option<[f64; 2]>, truth: f64, from: Origin) {
        if self.0.len() <= i {
            self.0.resize(i + 1, Count::default());
        }
        let c = &mut self.0[i];
        let [low, high] = ci95.unwrap();
        c.name = name.to_owned();
        c.hits += u32::from(low <= truth && truth <= high);
        c.sets += 1;
        c.squares += (2.0 * (0.5 * (high + low) - truth) / (high - low)).powi(2);
        c.from_table += u32::from(from != Origin::Motion);
    }
    fn share(&self) -> f64 {
        let (hits, all) = self.0.iter().fold((0, 0), |s, c| (s.0 + c.hits, s.1 + c.sets));
        f64::from(hits) / f64::from(all)
    }
    fn hits(&self) -> u32 {
        self.0.iter().map(|c| c.hits).sum()
    }
    /// Ends a set that began with `before` hits, and stores the set's own share.
    fn end_set(&mut self, before: u32) {
        if !self.0.is_empty() {
            self.1.push(f64::from(self.hits() - before) / self.0.len() as f64);
        }
    }
    /// Standard error of the share: parameters of one set have common errors, different sets are
    /// independent.
    fn share_se(&self) -> f64 {
        let (n, mean) = (self.1.len() as f64, self.share());
        (self.1.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>() / (n - 1.0) / n).sqrt()
    }
    /// 93 to 97 % over all parameters and 85 to 99.5 % for each, widened by three standard errors
    /// for the number of sets. The upper limit of single parameters is for those that motion
    /// determines: a value that keeps that of the table has an interval as wide as the table's
    /// spread, whatever the truth.
    fn check(&self, what: &str) {
        let (share, all) = (self.share(), self.0.iter().map(|c| f64::from(c.sets)).sum::<f64>());
        // few counts can agree by chance, so the spread among sets is at least binomial
        let margin = |p: f64| 3.0 * self.share_se().max((p * (1.0 - p) / all).sqrt());
        let enough = share >= 0.93 - margin(0.93) && share <= 0.97 + margin(0.97);
        assert!(enough, "{what}: {share:.3} ± {:.3}", self.share_se());
        for c in &self.0 {
            let allowance = |p: f64| 3.0 * (p * (1.0 - p) / f64::from(c.sets)).sqrt();
            let (name, share) = (&c.name, c.share());
            assert!(share >= 0.85 - allowance(0.85), "{what}, {name}: {share:.3} of {}", c.sets);
            assert!(!c.by_motion() || share <= 0.995 + allowance(0.995), "{what}, {name}: {share:.3} of {}", c.sets);
        }
    }
    fn describe(&self, what: &str) -> String {
        if self.0.is_empty() {
            return String::new();
        }
        let mut worst: Vec<&Count> = self.0.iter().collect();
        worst.sort_by_key(|c| c.hits);
        let range = |of: &[&Count]| match (of.first(), of.last()) {
            (Some(low), Some(high)) => {
                format!("{} from {:.1} to {:.1} %", of.len(), 100.0 * low.share(), 100.0 * high.share())
            }
            _ => "none".to_owned(),
        };
        // reported next to the share: the root mean square error in half-widths, about one half for
        // normal errors
        let named = |c: &&Count| {
            let table = if c.by_motion() { "" } else { ", from tables" };
            format!("{} {:.1} at {:.2}{table}", c.name, 100.0 * c.share(), (c.squares / f64::from(c.sets)).sqrt())
        };
        let few: Vec<String> = worst.iter().take(4).chain(worst.iter().rev().take(4)).map(named).collect();
        let above = |c: &&&Count| c.share() > 0.995;
        let (by_motion, of_table): (Vec<&Count>, Vec<&Count>) = worst.iter().partition(|c| c.by_motion());
        format!(
            "  {what}: {:.1} ± {:.1} %; by motion {}, from tables {}; above 99.5 %: {} and {} ({})\n",
            100.0 * self.share(),
            100.0 * self.share_se(),
            range(&by_motion),
            range(&of_table),
            by_motion.iter().filter(above).count(),
            of_table.iter().filter(above).count(),
            few.join("; ")
        )
    }
}

fn coverage(case: &Case, draws: u64, seed: u64) -> [Counts; 3] {
    let truth = load(case.set);
    let mut counts: [Counts; 3] = Default::default();
    let of_links: Vec<LinkInertia> = truth.phi.iter().map(LinkInertia::from_phi).collect();
    for draw in 0..draws {
        let found = one(&truth, case, seed + draw);
        let before: Vec<u32> = counts.iter().map(Counts::hits).collect();
        for (i, (b, t)) in found.base.iter().zip(truth.truth().iter()).enumerate().skip(1) {
            counts[0].add(i - 1, &b.name, b.ci95, *t, b.from);
        }
        for (j, (l, t)) in found.links.iter().zip(&of_links).enumerate() {
            let i = &t.inertia_com_kgm2;
            let inertia = [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(1, 2)], i[(2, 0)], i[(0, 1)]];
            let name = |what: &str| format!("{}.{what}", l.name);
            counts[1].add(10 * j, &name("mass"), l.ci95.mass_kg, t.mass_kg, l.from.mass_kg);
            for k in 0..3 {
                let name = name(["cx", "cy", "cz"][k]);
                counts[1].add(10 * j + 1 + k, &name, l.ci95.com_m[k], t.com_m[k], l.from.com_m);
            }
            for k in 0..6 {
                let name = name(["Ixx", "Iyy", "Izz", "Iyz", "Izx", "Ixy"][k]);
                counts[1].add(10 * j + 4 + k, &name, l.ci95.inertia_kgm2[k], inertia[k], l.from.inertia_kgm2);
            }
        }
        for (i, e) in found.effects.iter().enumerate() {
            counts[2].add(i, &e.name, e.ci95, 0.0, Origin::Motion);
        }
        counts.iter_mut().zip(before).for_each(|(c, before)| c.end_set(before));
    }
    let [base, links, effects] = &counts;
    println!(
        "{}, soft tissue {:.0} mm, whitened {}, {} sets\n{}{}{}",
        case.set,
        1000.0 * case.soft_m,
        case.white,
        draws,
        base.describe("base parameters"),
        links.describe("links"),
        effects.describe("effect coefficients")
    );
    counts
}

fn draws(usual: u64) -> u64 {
    std::env::var("ALOFT_COVERAGE_DRAWS").ok().and_then(|s| s.parse().ok()).unwrap_or(usual)
}

fn seed(usual: u64) -> u64 {
    std::env::var("ALOFT_COVERAGE_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(usual)
}

const OBJECT: PriorSd = PriorSd { mass_rel: 0.1, com_m: 0.005, radius_rel: 0.1, together: 0.0 };
const WIDE: PriorSd = PriorSd { mass_rel: 0.12, com_m: 0.02, radius_rel: 0.15, together: 0.0 };
const TABLE: PriorSd = PriorSd { mass_rel: 0.1, com_m: 0.01, radius_rel: 0.1, together: 0.0 };

#[test]
fn validate_intervals_of_chains() {
    for set in ["chain_p", "chain_a"] {
        for white in [false, true] {
            let case = Case {
                set,
                soft_m: 0.0,
                window_s: 0.4,
                white,
                estimator: Estimator::MassConstrained,
                effects: true,
                prior: OBJECT,
            };
            let counts = coverage(&case, draws(40), seed(40_000));
            for (c, what) in counts.iter().zip(["base parameters", "links", "effects"]) {
                c.check(&format!("{set}, whitened {white}, {what}"));
            }
        }
    }
}

#[test]
fn validate_intervals_of_people() {
    for (soft_m, white, prior) in
        [(0.003, false, TABLE), (0.0, false, TABLE), (0.003, true, TABLE), (0.003, false, WIDE)]
    {
        // the default test run covers the case that pipelines use; the others are for longer runs
        if draws(0) == 0 && (white || soft_m == 0.0 || prior == WIDE) {
            continue;
        }
        let case = Case {
            set: "subject_a",
            soft_m,
            window_s: 0.25,
            white,
            estimator: Estimator::Regularised { weight: None },
            effects: true,
            prior,
        };
        let counts = coverage(&case, draws(30), seed(50_000));
        for (c, what) in counts.iter().zip(["base parameters", "links", "effects"]) {
            c.check(&format!("soft tissue {soft_m} m, whitened {white}, {what}"));
        }
    }
}

/// Errors of the markers that are twice as large make the repeating part of the variance twice as
/// large (as a standard error), whatever the number of flights.
#[test]
fn soft_tissue_widens_intervals_by_the_size_that_markers_show() {
    let truth = load("subject_a");
    let case = |soft_m| Case {
        set: "subject_a",
        soft_m,
        window_s: 0.25,
        white: false,
        estimator: Estimator::Regularised { weight: Some(1.0) },
        effects: false,
        prior: TABLE,
    };
    let size = |soft_m: f64| {
        let (motion, places) = truth.recorded(MARKER_SD_M, soft_m, 7);
        let motions = drawn(&truth, &motion, places);
        let seen = Seen { markers: &motions, geometry: &[] };
        let options = WeakOptions { window_s: Some(0.25), ..WeakOptions::default() };
        let (model, base, nothing) = (&truth.model, &truth.base, Acting::nothing());
        let of = |s| weak_factor_with_repeated(model, base, &truth.phi, &motion, s, nothing, &options, None, &seen);
        truth.stretches().iter().map(|s| of(s).unwrap().1.markers).reduce(|a, b| a + b).unwrap().norm()
    };
    let (none, half, whole) = (size(0.0), size(0.0015), size(0.003));
    println!("errors of the rows with 0, 1.5 and 3 mm of soft tissue: {none:.4}, {half:.4}, {whole:.4}");
    assert!(none < 0.2 * whole && (whole / half - 2.0).abs() < 0.1);
    let mean = |p: &Parameters| p.base.iter().skip(1).map(|b| b.se / b.prior_sd.unwrap()).sum::<f64>();
    let (rigid, soft) = (one(&truth, &case(0.0), 7), one(&truth, &case(0.003), 7));
    assert!(mean(&soft) > 1.05 * mean(&rigid));
    assert!(soft.se_from.contains("random effect") && !rigid.se_from.contains("random effect"));
}

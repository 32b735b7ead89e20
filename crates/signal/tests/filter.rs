//! The filter compared with scipy's reference values (`tests/peers/signal_scipy.py`), and its fast
//! versions with the scalar one.
#![allow(clippy::unwrap_used, reason = "a golden that cannot be read fails the test")]

use aloft_signal::{Butterworth, CutoffCorrection, DesignError, LowPass};
use proptest::prelude::*;

fn golden(name: &str) -> serde_json::Value {
    let path = format!("{}/../../fixtures/goldens/{name}", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn numbers(v: &serde_json::Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn spec(order: usize, cutoff_hz: f64) -> LowPass {
    LowPass { order, cutoff_hz, correction: CutoffCorrection::None }
}

#[test]
fn validate_filtfilt_equals_scipy() {
    let golden = golden("signal_filtfilt.json");
    let (mut worst, mut n) = (0.0f64, 0);
    for case in golden["cases"].as_array().unwrap() {
        let order = case["order"].as_u64().unwrap() as usize;
        let (cutoff, rate) = (case["cutoff_hz"].as_f64().unwrap(), case["rate_hz"].as_f64().unwrap());
        let mut x = numbers(&case["x"]);
        let y = numbers(&case["y"]);
        assert_eq!(Butterworth::design(spec(order, cutoff), rate).unwrap().filtfilt(&mut x), 0);
        let error = x.iter().zip(&y).fold(0.0f64, |e, (a, b)| e.max((a - b).abs()));
        assert!(error < 1e-10, "order {order}, {cutoff} Hz at {rate} Hz, {} samples: {error:e}", x.len());
        worst = worst.max(error);
        n += 1;
    }
    println!("{n} signals, largest difference {worst:e}");
}

#[test]
fn validate_winter_design_cutoffs() {
    for case in golden("signal_winter.json")["cases"].as_array().unwrap() {
        let order = case["order"].as_u64().unwrap() as usize;
        let (cutoff, rate) = (case["cutoff_hz"].as_f64().unwrap(), case["rate_hz"].as_f64().unwrap());
        let facts = LowPass { correction: CutoffCorrection::Winter, ..spec(order, cutoff) }.describe(rate).unwrap();
        assert!((facts.design_cutoff_hz - case["design_cutoff_hz"].as_f64().unwrap()).abs() < 1e-10);
        assert!((facts.true_minus3db_hz - cutoff).abs() < 1e-10);
        assert_eq!(facts.effective_order, 2 * order);
    }
    // Published values for two passes of second order.
    let winter =
        |rate, cutoff| LowPass { correction: CutoffCorrection::Winter, ..spec(2, cutoff) }.describe(rate).unwrap();
    for (rate, cutoff, design) in [
        (100.0, 6.0, 7.43088),
        (200.0, 6.0, 7.46682),
        (200.0, 12.0, 14.86177),
        (100.0, 12.0, 14.59308),
        (250.0, 10.0, 12.42901),
    ] {
        assert!((winter(rate, cutoff).design_cutoff_hz - design).abs() < 1e-5);
    }
    let plain = spec(2, 6.0).describe(100.0).unwrap();
    assert!((plain.true_minus3db_hz - 4.8338).abs() < 5e-5);
    assert!((spec(2, 6.0).gain(plain.true_minus3db_hz, 100.0).unwrap() - 0.5f64.sqrt()).abs() < 1e-12);
}

#[test]
fn impossible_filters_are_refused() {
    for (order, cutoff, rate) in [(0, 6.0, 100.0), (13, 6.0, 100.0)] {
        assert!(matches!(Butterworth::design(spec(order, cutoff), rate), Err(DesignError::Order { .. })));
    }
    for (cutoff, rate) in
        [(50.0, 100.0), (0.0, 100.0), (-1.0, 100.0), (f64::NAN, 100.0), (6.0, f64::NAN), (6.0, f64::INFINITY)]
    {
        assert!(matches!(Butterworth::design(spec(3, cutoff), rate), Err(DesignError::Cutoff { .. })));
    }
}

#[test]
fn gaps_split_runs_and_short_runs_are_lost() {
    let filter = Butterworth::design(spec(3, 10.0), 100.0).unwrap();
    let wave = |i: usize| (i as f64 * 0.2).sin() + 0.01 * i as f64;
    let mut x: Vec<f64> = (0..100).map(wave).collect();
    x[30] = f64::NAN;
    x[43] = f64::NAN; // 12 samples between: not longer than the padding
    let mut parts: Vec<Vec<f64>> = vec![x[..30].to_vec(), x[44..].to_vec()];
    assert_eq!(filter.filtfilt(&mut x), 12);
    for part in &mut parts {
        filter.filtfilt(part);
    }
    assert_eq!(x[..30], parts[0]);
    assert!(x[30..44].iter().all(|v| v.is_nan()));
    assert_eq!(x[44..], parts[1]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Many channels at once, in both layouts, with and without gaps, equal the scalar filter bit
    /// for bit.
    #[test]
    fn prop_many_channels_equal_the_plain_filter(
        order in 1usize..=12,
        channels in 1usize..40,
        samples in 1usize..220,
        gaps in proptest::collection::vec((0usize..40, 0usize..220, 1usize..9), 0..4),
        common in any::<bool>(),
    ) {
        let filter = Butterworth::design(spec(order, 9.0), 100.0).unwrap();
        let mut data: Vec<f64> = (0..channels * samples).map(|i| (i as f64 * 0.31).sin() + (i as f64 * 0.011).cos()).collect();
        for (channel, start, length) in gaps {
            for c in 0..channels {
                if common || c == channel {
                    for f in start..(start + length).min(samples) {
                        data[c * samples + f] = f64::NAN;
                    }
                }
            }
        }
        let mut by_frame = vec![0.0; data.len()];
        for c in 0..channels {
            for f in 0..samples {
                by_frame[f * channels + c] = data[c * samples + f];
            }
        }
        let mut plain = data.clone();
        let lost: usize = plain.chunks_mut(samples).map(|x| filter.filtfilt(x)).sum();
        prop_assert_eq!(filter.filtfilt_channels(&mut data, samples), lost);
        prop_assert_eq!(filter.filtfilt_interleaved(&mut by_frame, channels), lost);
        for c in 0..channels {
            for f in 0..samples {
                let want = plain[c * samples + f].to_bits();
                prop_assert_eq!(data[c * samples + f].to_bits(), want);
                prop_assert_eq!(by_frame[f * channels + c].to_bits(), want);
            }
        }
    }
}

//! Factors: merging in any order, leaving out, storing, with any number of threads.
#![allow(clippy::unwrap_used, reason = "tests")]

use aloft_regressor::{Columns, Factor, RowKind, Stretch, StretchKind, leave_group_out, leave_one_out};
use faer::Mat;
use nalgebra::DVector;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn columns(p: usize, k: usize) -> Columns {
    Columns {
        parameters: (0..p).map(|i| format!("p{i}")).collect(),
        effects: (0..k).map(|i| format!("e{i}")).collect(),
        of_tables: Vec::new(),
    }
}

fn rows(seed: u64, m: usize, n: usize) -> Mat<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    Mat::from_fn(m, n, |_, j| rng.random_range(-1.0..1.0) * 10f64.powi(-(j as i32 % 4)))
}

fn factor(seed: u64, m: usize, p: usize, k: usize) -> Factor {
    let stretch = Stretch::flight(format!("t{}", seed / 3), (seed % 3) as usize, 0, m);
    Factor::from_rows(&stretch, RowKind::Weak, columns(p, k), rows(seed, m, p + k + 1).as_ref()).unwrap()
}

fn close(a: &Factor, b: &Factor) -> bool {
    let scale = a.values().iter().fold(0.0f64, |s, x| s.max(x.abs()));
    a.values().len() == b.values().len()
        && a.values().iter().zip(b.values()).all(|(x, y)| (x - y).abs() <= 1e-12 * scale)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn prop_a_factor_keeps_all_that_rows_say(seed in 0u64..1000, m in 1usize..60, p in 1usize..12, k in 0usize..4) {
        let n = p + k + 1;
        let a = rows(seed, m, n);
        let f = factor(seed, m, p, k);
        let x = DVector::from_fn(p + k, |i, _| (i as f64 + 1.0).sin());
        let direct: f64 = (0..m).map(|i| {
            let r: f64 = (0..p + k).map(|j| a[(i, j)] * x[j]).sum::<f64>() - a[(i, n - 1)];
            r * r
        }).sum();
        prop_assert!((f.sum_of_squares(&x) - direct).abs() <= 1e-12 * (1.0 + direct));
        prop_assert_eq!(f.height(), m.min(n));
    }

    #[test]
    fn prop_merging_in_any_order_gives_the_same(seed in 0u64..1000, sizes in prop::collection::vec(1usize..40, 2..20), rotate in 0usize..20) {
        // enough rows for R to be unique
        let mut factors: Vec<Factor> = sizes.iter().enumerate().map(|(i, &m)| factor(seed + i as u64, m, 9, 2)).collect();
        factors.push(factor(seed + 99, 40, 9, 2));
        let forward = Factor::merge(&factors).unwrap();
        let n = factors.len();
        factors.rotate_left(rotate % n);
        factors.reverse();
        let backward = Factor::merge(&factors).unwrap();
        prop_assert!(close(&forward, &backward));
        prop_assert_eq!(forward.n_rows, sizes.iter().sum::<usize>() + 40);
        let one_by_one = factors[1..].iter().fold(factors[0].clone(), |sum, f| sum.merged_with(f).unwrap());
        prop_assert!(close(&forward, &one_by_one));
    }
}

#[test]
fn leaving_out_equals_merging_the_others() {
    let factors: Vec<Factor> = (0..130).map(|i| factor(i, 5 + (i as usize * 7) % 30, 9, 1)).collect();
    let left = leave_one_out(&factors, |i, rest| (i, rest.clone())).unwrap();
    assert_eq!(left.len(), factors.len());
    for (i, rest) in &left {
        let others: Vec<&Factor> = factors.iter().enumerate().filter(|(j, _)| j != i).map(|(_, f)| f).collect();
        assert!(close(rest, &Factor::merge_refs(&others).unwrap()), "without {i}");
        assert_eq!(rest.n_rows, others.iter().map(|f| f.n_rows).sum::<usize>());
    }
    let groups: Vec<usize> = (0..130).map(|i| i / 3).collect();
    let left = leave_group_out(&factors, &groups, |g, rest| (g, rest.clone())).unwrap();
    assert_eq!(left.len(), 44);
    let others: Vec<&Factor> = factors.iter().zip(&groups).filter(|(_, g)| **g != 7).map(|(f, _)| f).collect();
    assert!(close(&left[7].1, &Factor::merge_refs(&others).unwrap()));
    assert!(leave_one_out(&factors[..1], |_, _| ()).is_err());
}

#[test]
fn the_result_is_the_same_on_any_number_of_threads() {
    let factors: Vec<Factor> = (0..100).map(|i| factor(i, 40, 20, 2)).collect();
    let on = |n: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(|| {
            let merged = Factor::merge(&factors).unwrap();
            let left = leave_one_out(&factors, |_, rest| rest.values().to_vec()).unwrap();
            (merged, left)
        })
    };
    assert_eq!(on(1), on(4));
}

#[test]
fn what_is_stored_comes_back() {
    for m in [3, 40] {
        let f = factor(5, m, 9, 2);
        let back =
            Factor::from_values(&f.as_stretch(), f.rows, f.columns.clone(), f.n_rows, f.values().to_vec()).unwrap();
        assert_eq!(f, back);
        let json: Factor = serde_json::from_str(&serde_json::to_string(&f).unwrap()).unwrap();
        assert_eq!(f, json);
        let mut cut = serde_json::to_value(&f).unwrap();
        cut["packed"].as_array_mut().unwrap().pop();
        assert!(serde_json::from_value::<Factor>(cut).is_err());
        assert!(
            Factor::from_values(&f.as_stretch(), f.rows, f.columns.clone(), f.n_rows, f.values()[1..].to_vec())
                .is_err()
        );
    }
}

#[test]
fn fewer_effects_are_the_same_rows() {
    for n_rows in [50, 12, 11, 7] {
        let f = factor(8, n_rows, 9, 3);
        let part = f.with_effects(&["e2", "e0"]).unwrap();
        let mut x = DVector::from_fn(12, |i, _| 0.3 * i as f64);
        x[10] = 0.0;
        let y = DVector::from_iterator(11, x.iter().take(9).copied().chain([x[11], x[9]]));
        assert!((f.sum_of_squares(&x) - part.sum_of_squares(&y)).abs() < 1e-12, "{n_rows}");
        assert_eq!(part.dense().nrows(), part.height());
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    assert!(Factor::merge(&[]).is_err());
    assert!(Factor::merge(&[factor(1, 10, 5, 0), factor(2, 10, 5, 1)]).is_err());
    let mut bad = rows(1, 10, 6);
    bad[(3, 3)] = f64::NAN;
    let stretch = Stretch { trial: "t".into(), index: 0, kind: StretchKind::Flight, first_frame: 0, end_frame: 10 };
    assert!(Factor::from_rows(&stretch, RowKind::Weak, columns(5, 0), bad.as_ref()).is_err());
    assert!(Factor::from_rows(&stretch, RowKind::Weak, columns(6, 0), rows(1, 10, 6).as_ref()).is_err());
}

#[test]
fn regress_a_thousand_flights_merge_in_a_second_and_leave_one_out_in_ten() {
    let factors: Vec<Factor> = (0..1000).map(|i| factor(i, 120, 128, 0)).collect();
    let start = std::time::Instant::now();
    let merged = Factor::merge(&factors).unwrap();
    let merging = start.elapsed();
    let start = std::time::Instant::now();
    let left = leave_one_out(&factors, |_, rest| rest.values()[0]).unwrap();
    let leaving = start.elapsed();
    println!("1000 flights of 120 rows × 129 columns: merged in {merging:?}, each left out in {leaving:?}");
    assert_eq!((merged.n_rows, left.len()), (120_000, 1000));
    // limits are 1 s and 10 s; busy machines get some tolerance
    assert!(merging.as_secs_f64() < 3.0 && leaving.as_secs_f64() < 30.0);
}

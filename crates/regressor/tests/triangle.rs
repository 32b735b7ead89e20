//! The reduction of many rows to a triangle, compared with double-double arithmetic and with the
//! library's QR, for conditions up to 1e14.
#![allow(clippy::unwrap_used, reason = "tests")]

use aloft_regressor::{Columns, Factor, RowKind, Stretch};
use faer::Mat;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn reduce(rows: &Mat<f64>) -> Mat<f64> {
    let n = rows.ncols();
    let columns =
        Columns { parameters: (1..n).map(|i| format!("p{i}")).collect(), effects: Vec::new(), of_tables: Vec::new() };
    let stretch = Stretch::flight("t", 0, 0, rows.nrows());
    let dense = Factor::from_rows(&stretch, RowKind::Weak, columns, rows.as_ref()).unwrap().dense();
    Mat::from_fn(dense.nrows(), n, |i, j| dense[(i, j)])
}

fn by_library(rows: &Mat<f64>) -> Mat<f64> {
    let qr = rows.qr();
    let r = qr.thin_R();
    Mat::from_fn(r.nrows(), r.ncols(), |i, j| if r[(i, i)] < 0.0 { -r[(i, j)] } else { r[(i, j)] })
}

fn random(rng: &mut ChaCha8Rng, m: usize, n: usize) -> Mat<f64> {
    Mat::from_fn(m, n, |_, _| rng.random_range(-1.0..1.0))
}

/// Rows with singular values from 1 down to 1/condition.
fn conditioned(rng: &mut ChaCha8Rng, m: usize, n: usize, condition: f64) -> Mat<f64> {
    let u = random(rng, m, n).qr().compute_thin_Q();
    let v = random(rng, n, n).qr().compute_thin_Q();
    let s = Mat::from_fn(n, n, |i, j| if i == j { condition.powf(-(i as f64) / (n as f64 - 1.0)) } else { 0.0 });
    u * s * v.transpose()
}

/// Unevaluated sum of two doubles (Dekker 1971), precise enough to measure the error of one double.
#[derive(Clone, Copy)]
struct Twofold(f64, f64);

impl Twofold {
    fn sum(a: f64, b: f64) -> Self {
        let s = a + b;
        let t = s - a;
        Self(s, (a - (s - t)) + (b - t))
    }
    fn plus(self, o: Self) -> Self {
        let Self(s, e) = Self::sum(self.0, o.0);
        Self::sum(s, e + self.1 + o.1)
    }
    fn times(self, o: Self) -> Self {
        let p = self.0 * o.0;
        let e = self.0.mul_add(o.0, -p);
        Self::sum(p, e + self.0 * o.1 + self.1 * o.0)
    }
    fn negative(self) -> Self {
        Self(-self.0, -self.1)
    }
    fn inverse(self) -> Self {
        let x = Self(1.0 / self.0, 0.0);
        let one = Self(1.0, 0.0);
        let error = one.plus(self.times(x).negative());
        x.plus(x.times(error))
    }
    fn root(self) -> Self {
        let x = Self(self.0.sqrt(), 0.0);
        let error = self.plus(x.times(x).negative());
        x.plus(error.times(Self(0.5 / x.0, 0.0)))
    }
}

/// R by modified Gram-Schmidt, every column twice, in double-double arithmetic.
fn reference(rows: &Mat<f64>) -> Mat<f64> {
    let (m, n) = (rows.nrows(), rows.ncols());
    let mut q: Vec<Vec<Twofold>> = (0..n).map(|j| (0..m).map(|i| Twofold(rows[(i, j)], 0.0)).collect()).collect();
    let mut r = Mat::zeros(n, n);
    let dot = |a: &[Twofold], b: &[Twofold]| a.iter().zip(b).fold(Twofold(0.0, 0.0), |s, (x, y)| s.plus(x.times(*y)));
    for j in 0..n {
        let mut total = vec![Twofold(0.0, 0.0); j];
        for _ in 0..2 {
            for k in 0..j {
                let (before, rest) = q.split_at_mut(j);
                let c = dot(&before[k], &rest[0]);
                total[k] = total[k].plus(c);
                for (x, y) in rest[0].iter_mut().zip(&before[k]) {
                    *x = x.plus(y.times(c.negative()));
                }
            }
        }
        let norm = dot(&q[j], &q[j]).root();
        let inverse = norm.inverse();
        q[j].iter_mut().for_each(|x| *x = x.times(inverse));
        for k in 0..j {
            r[(k, j)] = total[k].0;
        }
        r[(j, j)] = norm.0;
    }
    r
}

/// Largest error of R by columns: `max_j |R e_j − R̂ e_j| / |A e_j|`.
fn error(r: &Mat<f64>, exact: &Mat<f64>) -> f64 {
    (0..r.ncols()).map(|j| (r.col(j) - exact.col(j)).norm_l2() / exact.col(j).norm_l2()).fold(0.0, f64::max)
}

/// Root mean square difference of singular values, relative to the largest.
fn spectrum(r: &Mat<f64>, exact: &Mat<f64>) -> f64 {
    let (a, b) = (r.singular_values().unwrap(), exact.singular_values().unwrap());
    let sum: f64 = a.iter().zip(&b).map(|(x, y)| (x - y).powi(2)).sum();
    (sum / a.len() as f64).sqrt() / b[0]
}

#[test]
fn validate_r_is_as_accurate_as_the_librarys_at_any_condition() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    println!("condition   error of R: here, library    of singular values: here, library");
    for exponent in 0..=14 {
        let condition = 10f64.powi(exponent);
        let (mut ours, mut library) = ((0.0, 0.0), (0.0, 0.0));
        for _ in 0..3 {
            let rows = conditioned(&mut rng, 300, 27, condition);
            let exact = reference(&rows);
            let (r, l) = (reduce(&rows), by_library(&rows));
            ours = (f64::max(ours.0, error(&r, &exact)), f64::max(ours.1, spectrum(&r, &exact)));
            library = (f64::max(library.0, error(&l, &exact)), f64::max(library.1, spectrum(&l, &exact)));
        }
        println!(
            "1e{exponent:<2}        {:.1e} {:.1e}                {:.1e} {:.1e}",
            ours.0, library.0, ours.1, library.1
        );
        assert!(ours.0 <= 3.0 * library.0 + 1e-15, "condition {condition:e}: R {:e} against {:e}", ours.0, library.0);
        assert!(ours.1 <= 3.0 * library.1 + 1e-15, "condition {condition:e}: σ {:e} against {:e}", ours.1, library.1);
    }
}

#[test]
fn rows_of_any_shape_give_the_librarys_triangle() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for n in [1, 2, 7, 8, 9, 15, 16, 17, 24, 25, 33, 40, 64, 100, 128, 129, 131] {
        for m in [n, n + 1, 2 * n + 3, 255, 256, 257, 600] {
            let rows = random(&mut rng, m, n);
            let (r, l) = (reduce(&rows), by_library(&rows));
            assert_eq!((r.nrows(), r.ncols()), (m.min(n), n));
            let scale = (m as f64).sqrt();
            let worst = (&r - &l).norm_max();
            assert!(m < n || worst < 1e-12 * scale, "{m} × {n}: {worst:e}");
        }
    }
}

#[test]
fn columns_without_numbers_and_repeated_columns_lose_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut rows = random(&mut rng, 300, 40);
    for i in 0..300 {
        rows[(i, 0)] = 0.0;
        rows[(i, 20)] = 0.0;
        rows[(i, 30)] = rows[(i, 3)];
    }
    let r = reduce(&rows);
    assert!((r.transpose() * &r - rows.transpose() * &rows).norm_max() < 1e-12 * 300.0);
    assert_eq!(r[(0, 0)], 0.0);
    assert!((0..40).all(|i| r[(i, 20)] == 0.0));
}

#[test]
fn tall_rows_give_the_same_on_any_number_of_threads() {
    let mut rng = ChaCha8Rng::seed_from_u64(10);
    let rows = random(&mut rng, 70_001, 20);
    let on = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| reduce(&rows))
    };
    let one = on(1);
    assert_eq!(one, on(2));
    assert_eq!(one, on(5));
    assert!((&one - by_library(&rows)).norm_max() < 1e-11);
}

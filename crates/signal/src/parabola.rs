//! The least-squares parabola of a short run.
//!
//! A zero-phase filter continues a run by reflection about its ends. There a parabola, which is
//! what a body in free fall describes, loses its curvature: of a flight of twenty frames no frame
//! would have the right acceleration. A short run is therefore filtered about its own parabola.

/// Longest run that is filtered about its own parabola, s: flights are shorter, and in a longer run
/// the ends are few.
pub const SHORT_RUN_S: f64 = 1.0;

/// The least-squares parabola of values at equal steps, at the same steps; zero for fewer than
/// four.
pub fn parabola_of(values: &[f64]) -> Vec<f64> {
    let n = values.len();
    if n < 4 {
        return vec![0.0; n];
    }
    // orthogonal polynomials in x = −1 … 1
    let x = |i: usize| 2.0 * i as f64 / (n - 1) as f64 - 1.0;
    let mean_square = (0..n).map(|i| x(i).powi(2)).sum::<f64>() / n as f64;
    let basis = |i: usize| [1.0, x(i), x(i).powi(2) - mean_square];
    let (mut products, mut squares) = ([0.0; 3], [0.0; 3]);
    for (i, value) in values.iter().enumerate() {
        for (k, b) in basis(i).into_iter().enumerate() {
            products[k] += b * value;
            squares[k] += b * b;
        }
    }
    (0..n).map(|i| basis(i).iter().zip(products).zip(squares).map(|((b, p), s)| b * p / s).sum()).collect()
}

#[cfg(test)]
mod tests {
    use super::parabola_of;

    #[test]
    fn parabolas_are_their_own_and_others_are_nearest() {
        let of = |f: fn(f64) -> f64| (0..21).map(|i| f(f64::from(i))).collect::<Vec<f64>>();
        let exact = of(|t| 3.0 - 0.2 * t + 0.05 * t * t);
        assert!(parabola_of(&exact).iter().zip(&exact).all(|(a, b)| (a - b).abs() < 1e-12));
        // what is left is orthogonal to parabolas
        let cubic = of(|t| t.powi(3));
        let left: Vec<f64> = cubic.iter().zip(parabola_of(&cubic)).map(|(a, b)| a - b).collect();
        for k in 0..3 {
            let product: f64 = left.iter().enumerate().map(|(i, x)| x * (i as f64).powi(k)).sum();
            assert!(product.abs() < 1e-6, "{k}: {product}");
        }
        assert_eq!(parabola_of(&[1.0, 2.0]), [0.0, 0.0]);
    }
}

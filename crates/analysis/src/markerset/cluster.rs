//! Which markers move together: the variation of their distances.

use aloft_trial::Trial;
use nalgebra::DMatrix;

/// Frames of a recording that are looked at.
const FRAMES: usize = 250;
/// Fewest frames in which both markers are seen.
const LEAST: usize = 20;

/// Standard deviation of the distance of every pair of markers within recordings, pooled over them,
/// m; NaN where two are hardly seen together.
pub(super) fn distance_sd(labels: &[String], trials: &[&Trial]) -> DMatrix<f64> {
    let n = labels.len();
    let mut squares = DMatrix::<f64>::zeros(n, n);
    let mut counts = DMatrix::<f64>::zeros(n, n);
    for trial in trials {
        let index: Vec<Option<usize>> = labels.iter().map(|l| trial.markers.index(l)).collect();
        let step = trial.markers.n_frames.div_ceil(FRAMES).max(1);
        let frames: Vec<usize> = (0..trial.markers.n_frames).step_by(step).collect();
        for a in 0..n {
            let Some(i) = index[a] else { continue };
            for b in a + 1..n {
                let Some(j) = index[b] else { continue };
                let (mut count, mut sum, mut square) = (0.0, 0.0, 0.0);
                for &f in &frames {
                    if let (Some(p), Some(q)) = (trial.markers.position(i, f), trial.markers.position(j, f)) {
                        let d = (p - q).norm();
                        (count, sum, square) = (count + 1.0, sum + d, square + d * d);
                    }
                }
                if count >= LEAST as f64 {
                    squares[(a, b)] += (square - sum * sum / count).max(0.0);
                    counts[(a, b)] += count - 1.0;
                }
            }
        }
    }
    DMatrix::from_fn(n, n, |a, b| {
        let (a, b) = (a.min(b), a.max(b));
        if a == b {
            0.0
        } else if counts[(a, b)] > 0.0 {
            (squares[(a, b)] / counts[(a, b)]).sqrt()
        } else {
            f64::NAN
        }
    })
}

/// Groups of markers whose distances vary by less than `limit_m` on average, largest first:
/// agglomeration by the mean of all pairs.
pub(super) fn groups(sd: &DMatrix<f64>, members: &[usize], limit_m: f64) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = members.iter().map(|m| vec![*m]).collect();
    let between = |a: &[usize], b: &[usize]| {
        let known: Vec<f64> =
            a.iter().flat_map(|i| b.iter().map(move |j| sd[(*i, *j)])).filter(|x| x.is_finite()).collect();
        if known.is_empty() { f64::INFINITY } else { known.iter().sum::<f64>() / known.len() as f64 }
    };
    loop {
        let mut best: Option<(f64, usize, usize)> = None;
        for a in 0..groups.len() {
            for b in a + 1..groups.len() {
                let d = between(&groups[a], &groups[b]);
                if d < limit_m && best.is_none_or(|(least, ..)| d < least) {
                    best = Some((d, a, b));
                }
            }
        }
        let Some((_, a, b)) = best else { break };
        let mut joined = groups.swap_remove(b);
        groups[a].append(&mut joined);
    }
    groups.iter_mut().for_each(|g| g.sort_unstable());
    groups.sort_by(|a, b| b.len().cmp(&a.len()).then(a.cmp(b)));
    groups
}

/// Mean variation of the distances within a group, m.
pub(super) fn within(sd: &DMatrix<f64>, group: &[usize]) -> f64 {
    let pairs = group.iter().enumerate().flat_map(|(k, i)| group[..k].iter().map(move |j| sd[(*i, *j)]));
    let known: Vec<f64> = pairs.filter(|x| x.is_finite()).collect();
    known.iter().sum::<f64>() / known.len().max(1) as f64
}

/// Mean variation of a marker's distances to the members of a group, m.
pub(super) fn against(sd: &DMatrix<f64>, marker: usize, group: &[usize]) -> Option<f64> {
    let known: Vec<f64> =
        group.iter().filter(|g| **g != marker).map(|g| sd[(marker, *g)]).filter(|x| x.is_finite()).collect();
    (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
}

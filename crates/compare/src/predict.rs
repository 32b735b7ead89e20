//! Predicts the wrench from parameters, eight frames at a time.

use crate::Body;
use aloft_body::{FrameBatch, FrameBlock, LANES, Motion};
use nalgebra::{DMatrix, Vector6};
use std::array::from_fn;

/// `[column of parameters][frame]`: root axes about the root origin. The motion must have
/// derivatives in these frames.
pub(crate) fn wrenches(
    body: &Body<'_>,
    motion: &Motion,
    frames: &[usize],
    parameters: &DMatrix<f64>,
) -> Vec<Vec<Vector6<f64>>> {
    let mut out = vec![Vec::with_capacity(frames.len()); parameters.ncols()];
    let mut batch = FrameBatch::new(body.model);
    let mut rows: Vec<FrameBlock> = vec![[0.0; LANES]; 6 * body.base.len()];
    for group in frames.chunks(LANES) {
        // the last frame fills the unused lanes of the last batch
        let frame = |lane: usize| group[lane.min(group.len() - 1)];
        batch.forward_acceleration(
            body.model,
            &from_fn(|lane| motion.q(frame(lane))),
            &from_fn(|lane| motion.v(frame(lane))),
            &from_fn(|lane| motion.a(frame(lane))),
        );
        batch.base_wrench_rows(body.base, &mut rows);
        for (out, parameters) in out.iter_mut().zip(parameters.column_iter()) {
            let mut sums: [FrameBlock; 6] = [[0.0; LANES]; 6];
            for (columns, x) in rows.chunks_exact(6).zip(parameters.iter()) {
                for (sum, entries) in sums.iter_mut().zip(columns) {
                    for (s, e) in sum.iter_mut().zip(entries) {
                        *s += e * x;
                    }
                }
            }
            out.extend((0..group.len()).map(|lane| Vector6::from_fn(|axis, _| sums[axis][lane])));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use aloft_body::{BaseParameters, Model, ModelSpec, State};

    /// Batches of eight frames give the same result as single frames.
    #[test]
    fn batches_predict_what_single_frames_do() {
        let spec: ModelSpec = serde_yaml::from_str(include_str!("../../../configs/models/human34.yaml")).unwrap();
        let model = Model::from_spec(&spec).unwrap();
        let base = BaseParameters::of(&model);
        let prior = vec![Default::default(); model.n_links()];
        let body = Body { model: &model, base: &base, prior: &prior };
        let n = 21;
        let wave = |f: usize, k: usize| (0.3 * f as f64 + 1.7 * k as f64).sin();
        let mut motion = Motion { rate_hz: 200.0, nq: model.nq, nv: model.nv, ..Motion::default() };
        for f in 0..n {
            let mut q = model.neutral();
            let dv: Vec<f64> = (0..model.nv).map(|k| 0.4 * wave(f, k)).collect();
            model.integrate(&model.neutral(), &dv, &mut q);
            motion.q.extend(q);
            motion.v.extend((0..model.nv).map(|k| wave(f, k + 5)));
            motion.a.extend((0..model.nv).map(|k| 3.0 * wave(f, k + 9)));
        }
        let parameters = DMatrix::from_fn(base.len(), 2, wave);
        let frames: Vec<usize> = (0..n).filter(|f| f % 5 != 3).collect();
        let found = wrenches(&body, &motion, &frames, &parameters);
        let mut state = State::new(&model);
        let mut rows = DMatrix::zeros(6, base.len());
        for (i, &f) in frames.iter().enumerate() {
            state.forward_acceleration(&model, motion.q(f), motion.v(f), motion.a(f));
            state.base_wrench_rows(&model, &base, &mut rows);
            let plain = &rows * &parameters;
            for c in 0..2 {
                let gap = (found[c][i] - plain.column(c)).amax();
                assert!(gap < 1e-11 * plain.amax().max(1.0), "frame {f}: {gap}");
            }
        }
    }
}

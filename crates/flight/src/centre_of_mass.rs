//! The centre of mass along a motion, and its correction from the flights.
//!
//! Masses are not known when flights are first searched for. The centre of mass from a prior
//! follows a parabola only as accurately as the prior places the mass of each link: an error of d
//! metres in a link that turns at ω changes the acceleration by ω² d. In candidate flights the
//! centre of mass c = (Σ m_l p_l + R_l h_l) / M follows a parabola for the true first moments h_l,
//! and it is linear in h_l. The first moments are therefore fitted there, regularised by the prior,
//! and the search is repeated.

use crate::FlightError;
use aloft_body::{Model, Motion, Phi, State};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::ops::Range;

/// Centre of mass per frame, with the data needed to correct it.
#[derive(Clone)]
pub(crate) struct CentreOfMass {
    /// Position, m, world frame; NaN where the frame was not solved.
    pub position_m: Vec<Vector3<f64>>,
    /// `rotations[frame * n_links + link]`, world from link.
    rotations: Vec<Matrix3<f64>>,
    n_links: usize,
    mass_kg: f64,
    /// Mass of each link, kg: scales the allowed change of its first moment.
    link_mass_kg: Vec<f64>,
}

impl CentreOfMass {
    /// Computes the centre of mass along a motion from given inertias.
    pub(crate) fn new(model: &Model, phi: &[Phi], motion: &Motion) -> Result<Self, FlightError> {
        if motion.nq != model.nq || phi.len() != model.n_links() {
            return Err(FlightError::Mismatch {
                trial: motion.trial.clone(),
                model: model.name.clone(),
                found: motion.nq,
                found_phi: phi.len(),
                expected: model.nq,
                expected_phi: model.n_links(),
            });
        }
        let n_links = model.n_links();
        let n_frames = motion.n_frames();
        let mut state = State::new(model);
        let mut position_m = Vec::with_capacity(n_frames);
        let mut rotations = Vec::with_capacity(n_frames * n_links);
        for frame in 0..n_frames {
            if motion.is_valid(frame) {
                state.forward_position(model, motion.q(frame));
                position_m.push(state.centre_of_mass(phi).1);
                rotations.extend((0..n_links).map(|link| *state.rotation(link)));
            } else {
                position_m.push(Vector3::repeat(f64::NAN));
                rotations.extend(std::iter::repeat_n(Matrix3::zeros(), n_links));
            }
        }
        let link_mass_kg: Vec<f64> = phi.iter().map(|p| p[0]).collect();
        let mass_kg = link_mass_kg.iter().sum();
        Ok(Self { position_m, rotations, n_links, mass_kg, link_mass_kg })
    }

    fn is_valid(&self, frame: usize) -> bool {
        self.position_m[frame].iter().all(|x| x.is_finite())
    }

    /// Corrects the first moments so that the centre of mass follows a parabola with free constant
    /// acceleration in each of the stretches, regularised by the prior: standard deviation `sd_m`
    /// for each link's centre of mass, `noise_m` for positions. Returns the changes of the first
    /// moments, kg·m, or `None` if there is nothing to fit.
    pub(crate) fn refine(
        &mut self,
        stretches: &[Range<usize>],
        rate_hz: f64,
        sd_m: f64,
        noise_m: f64,
    ) -> Option<Vec<Vector3<f64>>> {
        let n = 3 * self.n_links;
        let mut normal = DMatrix::<f64>::zeros(n, n);
        let mut right = DVector::<f64>::zeros(n);
        let mut used = 0;
        for stretch in stretches {
            let frames: Vec<usize> = stretch.clone().filter(|&frame| self.is_valid(frame)).collect();
            if frames.len() < 8 {
                continue;
            }
            used += frames.len();
            // Complement of 1, t, t² on these frames.
            let basis = parabola_basis(&frames, rate_hz);
            for axis in 0..3 {
                let mut rows = DMatrix::<f64>::zeros(frames.len(), n);
                let mut measured = DVector::<f64>::zeros(frames.len());
                for (row, &frame) in frames.iter().enumerate() {
                    measured[row] = self.position_m[frame][axis];
                    for link in 0..self.n_links {
                        let rotation = &self.rotations[frame * self.n_links + link];
                        for k in 0..3 {
                            rows[(row, 3 * link + k)] = rotation[(axis, k)] / self.mass_kg;
                        }
                    }
                }
                let inside = &basis * (basis.transpose() * &rows);
                rows -= inside;
                let inside = &basis * (basis.transpose() * &measured);
                measured -= inside;
                normal.gemm_tr(1.0, &rows, &rows, 1.0);
                right.gemv_tr(-1.0, &rows, &measured, 1.0);
            }
        }
        if used == 0 {
            return None;
        }
        for link in 0..self.n_links {
            let sd = (sd_m * self.link_mass_kg[link].abs()).max(1e-4 * self.mass_kg * sd_m);
            for k in 0..3 {
                normal[(3 * link + k, 3 * link + k)] += (noise_m / sd).powi(2);
            }
        }
        let solution = normal.cholesky()?.solve(&right);
        if !solution.iter().all(|x| x.is_finite()) {
            return None;
        }
        let moves: Vec<Vector3<f64>> =
            (0..self.n_links).map(|link| solution.fixed_rows::<3>(3 * link).into()).collect();
        for frame in 0..self.position_m.len() {
            let mut shift = Vector3::zeros();
            for (link, by) in moves.iter().enumerate() {
                shift += self.rotations[frame * self.n_links + link] * by;
            }
            self.position_m[frame] += shift / self.mass_kg;
        }
        Some(moves)
    }
}

/// Orthonormal columns that span 1, t, t² on the frames (Gram-Schmidt, twice for rounding).
fn parabola_basis(frames: &[usize], rate_hz: f64) -> DMatrix<f64> {
    let n = frames.len();
    let centre = frames.iter().sum::<usize>() as f64 / n as f64;
    let mut basis = DMatrix::<f64>::from_fn(n, 3, |row, k| ((frames[row] as f64 - centre) / rate_hz).powi(k as i32));
    for column in 0..3 {
        for _ in 0..2 {
            for other in 0..column {
                let dot = basis.column(column).dot(&basis.column(other));
                let against = basis.column(other) * dot;
                let mut own = basis.column_mut(column);
                own -= against;
            }
        }
        let norm = basis.column(column).norm();
        if norm > 0.0 {
            basis.column_mut(column).unscale_mut(norm);
        }
    }
    basis
}

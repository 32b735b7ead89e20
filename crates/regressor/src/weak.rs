//! Factors from weak rows, with fixed weights or whitened, and with errors that repeat beside them.
//! The rows themselves are in [`crate::weak_windows`].

use crate::matrix_noise::{MatrixNoise, row_errors};
use crate::noise::{Noise, whiten};
use crate::repeated::{RepeatedErrors, Seen, error_rows};
use crate::stretch::Acting;
use crate::weak_windows::{WeakOptions, WeakRows, weak_rows};
use crate::{Columns, Factor, RegressorError, RowKind, Stretch};
use aloft_body::{BaseParameters, Model, Motion, Phi, State};
use faer::Mat;
use nalgebra::{DMatrix, Vector3};

/// Factor of one stretch from weak rows, with fixed weights or whitened by `noise`.
///
/// `prior` gives the path of the moment origin, the mass of the fixed weights and the propagation
/// of noise; rows are exact for any prior. The motion's coordinates should not be filtered; its
/// velocities are not used. Windows that contain a missing frame are left out.
///
/// # Errors
/// [`RegressorError::TooShort`] if no window fits, [`RegressorError::NoWrench`] for contact without
/// plates, [`RegressorError::Numeric`] if the noise covariance is singular.
pub fn weak_factor(
    model: &Model,
    base: &BaseParameters,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    acting: Acting<'_>,
    options: &WeakOptions,
    noise: Option<&Noise<'_>>,
) -> Result<Factor, RegressorError> {
    let rows = weak_rows(model, base, prior, motion, stretch, acting, options)?;
    let rows = weighted(model, prior, motion, stretch, rows, options, noise)?;
    Factor::from_rows(stretch, RowKind::Weak, columns_of(base, acting), rows.matrix.as_ref())
}

/// The same, with the triangle of the errors of the rows ([`mod@crate::matrix_noise`]) beside it,
/// in the same weights.
///
/// # Errors
/// As [`weak_factor`], and [`RegressorError::Length`] if the noise does not fit the model.
pub fn weak_factor_with_noise(
    model: &Model,
    base: &BaseParameters,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    acting: Acting<'_>,
    options: &WeakOptions,
    noise: Option<&Noise<'_>>,
    of_matrix: &MatrixNoise<'_>,
) -> Result<Factor, RegressorError> {
    let mut rows = weak_rows(model, base, prior, motion, stretch, acting, options)?;
    let errors = row_errors(model, base, prior, motion, stretch, acting, options, of_matrix)?;
    let (m, n) = (rows.matrix.nrows(), rows.matrix.ncols());
    if errors.iter().any(|e| (e.nrows(), e.ncols()) != (m, n)) {
        return Err(RegressorError::Numeric {
            trial: stretch.trial.clone(),
            stretch: stretch.index,
            problem: "the errors of the rows have another shape than the rows".to_owned(),
        });
    }
    // weighted together with the rows, so that both are whitened alike
    let plain = std::mem::replace(&mut rows.matrix, Mat::new());
    rows.matrix = Mat::zeros(m, n * (1 + errors.len()));
    for (part, matrix) in std::iter::once(&plain).chain(&errors).enumerate() {
        rows.matrix.subcols_mut(part * n, n).copy_from(matrix);
    }
    let rows = weighted(model, prior, motion, stretch, rows, options, noise)?;
    let mut stacked = Mat::zeros(m * errors.len(), n);
    for draw in 0..errors.len() {
        stacked.subrows_mut(draw * m, m).copy_from(rows.matrix.subcols((draw + 1) * n, n));
    }
    let columns = columns_of(base, acting);
    let errors = Factor::from_rows(stretch, RowKind::Weak, columns.clone(), stacked.as_ref())?;
    Factor::from_rows(stretch, RowKind::Weak, columns, rows.matrix.subcols(0, n))?.with_noise(errors)
}

/// The same, with what draws of errors that repeat from flight to flight do to the rows.
///
/// # Errors
/// As [`weak_factor`], and [`RegressorError::Numeric`] if a draw gives rows that are not finite.
pub fn weak_factor_with_repeated(
    model: &Model,
    base: &BaseParameters,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    acting: Acting<'_>,
    options: &WeakOptions,
    noise: Option<&Noise<'_>>,
    seen: &Seen<'_>,
) -> Result<(Factor, RepeatedErrors), RegressorError> {
    let mut rows = weak_rows(model, base, prior, motion, stretch, acting, options)?;
    let errors = error_rows(model, prior, motion, &rows, seen);
    let n = rows.matrix.ncols();
    // weighted together with the rows, so that both are whitened alike
    let plain = std::mem::replace(&mut rows.matrix, Mat::new());
    rows.matrix =
        Mat::from_fn(plain.nrows(), n + errors.ncols(), |i, j| if j < n { plain[(i, j)] } else { errors[(i, j - n)] });
    let rows = weighted(model, prior, motion, stretch, rows, options, noise)?;
    let (left, right) = (rows.matrix.subcols(0, n), rows.matrix.subcols(n, errors.ncols()));
    let factor = Factor::from_rows(stretch, RowKind::Weak, columns_of(base, acting), left)?;
    let products = left.subcols(0, n - 1).transpose() * right;
    if !products.col_iter().all(|c| c.iter().all(|x| x.is_finite())) {
        return Err(RegressorError::Numeric {
            trial: stretch.trial.clone(),
            stretch: stretch.index,
            problem: "errors of markers or geometry do not give finite rows".to_owned(),
        });
    }
    let draws = seen.markers.len();
    let markers = DMatrix::from_fn(n - 1, draws, |i, j| products[(i, j)]);
    let geometry = DMatrix::from_fn(n - 1, seen.geometry.len(), |i, j| products[(i, draws + j)]);
    Ok((factor, RepeatedErrors { markers, geometry }))
}

fn columns_of(base: &BaseParameters, acting: Acting<'_>) -> Columns {
    Columns {
        parameters: base.parameters.iter().map(|p| p.name.clone()).collect(),
        effects: acting.effects.map_or_else(Vec::new, |e| e.names.clone()),
        of_tables: acting.effects.map_or_else(Vec::new, |e| e.of_tables.clone()),
    }
}

/// Rows with fixed weights, or whitened by `noise`.
fn weighted(
    model: &Model,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    mut rows: WeakRows,
    options: &WeakOptions,
    noise: Option<&Noise<'_>>,
) -> Result<WeakRows, RegressorError> {
    match noise {
        None => {
            let length_m = options.moment_length_m.unwrap_or_else(|| body_radius_m(model, prior));
            if !(length_m > 0.0 && length_m.is_finite()) {
                return Err(RegressorError::Option { option: "moment_length_m", problem: format!("{length_m} m") });
            }
            rows.apply_fixed_weights(length_m);
        }
        Some(noise) => whiten(model, prior, motion, stretch, &mut rows, noise)?,
    }
    Ok(rows)
}

/// Root mean square distance of the prior's mass from its centre in the neutral posture, m: the
/// default length in the fixed weights. It does not depend on recordings, so that factors of
/// different days have the same weights.
pub fn body_radius_m(model: &Model, prior: &[Phi]) -> f64 {
    let mut state = State::new(model);
    state.forward_position(model, &model.neutral());
    let (mass, centre) = state.centre_of_mass(prior);
    let second: f64 = state
        .world_from_link
        .iter()
        .zip(prior)
        .map(|(pose, phi)| {
            let moment = pose.rotation * Vector3::new(phi[1], phi[2], phi[3]);
            let to_origin = pose.translation.vector - centre;
            0.5 * (phi[4] + phi[5] + phi[6]) + 2.0 * to_origin.dot(&moment) + phi[0] * to_origin.norm_squared()
        })
        .sum();
    (second / mass).max(0.0).sqrt()
}

//! Errors of a scenario and of its simulation.

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulateError {
    /// A value of the scenario that cannot be.
    #[error("scenario `{scenario}`: `{field}` is {found}; expected {expected}")]
    Value {
        #[doc(hidden)]
        scenario: String,
        #[doc(hidden)]
        field: String,
        #[doc(hidden)]
        found: String,
        #[doc(hidden)]
        expected: String,
    },
    /// A hidden effect names a link that the body does not have.
    #[error("scenario `{scenario}`: hidden effect `{effect}` names the link `{link}`; the body has {known}")]
    UnknownLink {
        #[doc(hidden)]
        scenario: String,
        #[doc(hidden)]
        effect: String,
        #[doc(hidden)]
        link: String,
        #[doc(hidden)]
        known: String,
    },
    /// A hidden effect names a plate that the laboratory does not have.
    #[error("scenario `{scenario}`: `{effect}` names plate {plate}; the laboratory has {n_plates}")]
    UnknownPlate {
        #[doc(hidden)]
        scenario: String,
        #[doc(hidden)]
        effect: String,
        #[doc(hidden)]
        plate: usize,
        #[doc(hidden)]
        n_plates: usize,
    },
    /// No motion was found that this body can make: the legs do not reach, or the landing was never
    /// met.
    #[error("scenario `{scenario}`, trial `{trial}`: no feasible motion after {attempts} attempts ({problem})")]
    Infeasible {
        #[doc(hidden)]
        scenario: String,
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        attempts: usize,
        #[doc(hidden)]
        problem: String,
    },
    /// A formula of a hidden law that is not understood.
    #[error("scenario `{scenario}`: {place} `{formula}`, character {position}: {problem}")]
    Formula {
        #[doc(hidden)]
        scenario: String,
        #[doc(hidden)]
        place: String,
        #[doc(hidden)]
        formula: String,
        #[doc(hidden)]
        position: usize,
        #[doc(hidden)]
        problem: String,
    },
    /// A formula of a hidden law that has no value where the body went: a root of a negative
    /// number, a division by zero.
    #[error("{place} `{formula}` is {found} at t = {time_s:.4} s, place {at_m:.3?} m; expected a finite number")]
    Undefined {
        #[doc(hidden)]
        place: String,
        #[doc(hidden)]
        formula: String,
        #[doc(hidden)]
        found: String,
        #[doc(hidden)]
        time_s: f64,
        #[doc(hidden)]
        at_m: [f64; 3],
    },
    /// The equations of motion could not be solved (a link without inertia, or a step far too
    /// long).
    #[error("the motion of `{model}` diverged at t = {time_s:.4} s; expected finite accelerations, found none")]
    Diverged {
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        time_s: f64,
    },
    /// The model is wrong in itself.
    #[error(transparent)]
    Body(#[from] aloft_body::BodyError),
    /// A recording could not be written as C3D.
    #[error("trial `{trial}`: {source}")]
    C3d {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        source: aloft_c3d::C3dError,
    },
    /// The truth could not be written as JSON.
    #[error("truth of scenario `{scenario}`: {source}")]
    Json {
        #[doc(hidden)]
        scenario: String,
        #[doc(hidden)]
        source: serde_json::Error,
    },
}

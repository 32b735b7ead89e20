//! Physical effects that may be missing from a model, one file each.
//!
//! Every effect gives columns: unit wrenches, to be multiplied by a coefficient, in each frame of a
//! recording. Added to the rows of a flight or contact phase they determine how much of the effect
//! the recording contains. This crate contains only the physics; `regressor` turns columns into
//! rows, `discover` ranks them.
//!
//! All effects have one interface, [`Effect`]: those of the catalogue ([`EFFECTS`], one file each)
//! and the formulas written by users in a pipeline or in a file ([`FormulaEffect`]). Other crates
//! use only the declarations of an effect ([`About`], [`ParameterKind`]); none of them refers to an
//! effect by name. `docs/effects.md` shows how to add one.
//!
//! ```
//! use aloft_effects::{EFFECTS, effect};
//!
//! assert!(EFFECTS.iter().any(|e| e.id() == "tether"));
//! println!("{}", effect("tether")?.about().documentation);
//! # Ok::<(), aloft_effects::EffectsError>(())
//! ```
//!
//! Columns of a trial, for the factors of its stretches ([`columns`] names them
//! `effect.coefficient` or `effect[target].coefficient`; the fields have the layout of the
//! regressor's effect columns):
//!
//! ```
//! # use aloft_body::{Model, Motion, Phi};
//! # use aloft_effects::{EffectInstance, EffectsError, Scene, Span, TrialMotion, columns};
//! # fn of_trial(model: &Model, phi: &[Phi], motion: &Motion) -> Result<(), EffectsError> {
//! let scene = Scene::new(model, phi, &[]);
//! let spans = [Span { first_frame: 20, end_frame: 140, flight: true }];
//! let trial = TrialMotion { motion, spans: &spans, plates: &[], session_time_s: 0.0 };
//! let choices = [EffectInstance::parse("quadratic_drag", &scene)?, EffectInstance::parse("flywheel[torso]", &scene)?];
//! let columns = columns(&scene, &trial, &choices)?;
//! assert_eq!(columns.names[0], "quadratic_drag.drag_area");
//! # Ok(())
//! # }
//! ```

mod about;
mod catalog;
mod columns;
mod displacement;
mod effect;
mod error;
mod formula;
#[cfg(test)]
mod inertia;
mod instance;
mod joint;
mod link_resistance;
mod scene;
mod series;
mod target;
#[cfg(test)]
mod tests;
mod unknown;

pub use about::{About, ActsIn, EffectKind, Family, Separation};
pub use catalog::EFFECTS;
pub use columns::{Applied, Columns};
pub use effect::Effect;
pub use error::{EffectsError, FormulaProblem};
pub use formula::{
    CompiledFormula, FormulaAxes, FormulaCoefficient, FormulaConstant, FormulaDefinition, FormulaEffect,
    FormulaParameter, FormulaPart, FormulaPoint, QuantityGroup, quantities,
};
pub use instance::{EffectInstance, WrenchColumns, columns, columns_about};
pub use joint::{JointSeries, SURE_OF_SIGN};
pub use scene::{AIR_DENSITY_KGPM3, Scene};
pub use series::{EffectFrame, LEAD_IN_S, LinkFrame, PlateFrame, PlateSeries, Series, Span, TrialMotion};
pub use target::Target;
pub use unknown::{Coefficient, NonlinearParameter, ParameterKind, Values};

/// Finds an effect of the catalogue by its identifier.
///
/// # Errors
/// [`EffectsError::Unknown`] with the available names.
pub fn effect(id: &str) -> Result<&'static dyn Effect, EffectsError> {
    EFFECTS.iter().copied().find(|e| e.is_called(id)).ok_or_else(|| EffectsError::Unknown {
        name: id.to_owned(),
        known: EFFECTS.iter().map(|e| e.id()).collect::<Vec<_>>().join(", "),
    })
}

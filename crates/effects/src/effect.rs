//! The common interface of all effects: those of the catalogue, and formulas written by users in a
//! pipeline or in a file.

use crate::{About, ActsIn, Coefficient, Columns, EffectKind, JointSeries, NonlinearParameter, Scene, Series, Target};
use aloft_body::Phi;

/// An effect that may be missing from a model: its properties, its unknowns, and the columns that
/// it adds to the rows.
pub trait Effect: Sync {
    /// Names and properties that do not depend on the body.
    fn about(&self) -> About<'_>;
    /// Possible targets; empty if it cannot act at all (a plate error without plates).
    fn targets(&self, scene: &Scene) -> Vec<Target>;
    /// Linear unknowns, one for each column.
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient>;
    /// Nonlinear unknowns.
    fn nonlinear(&self, _scene: &Scene, _target: Target) -> Vec<NonlinearParameter> {
        Vec::new()
    }
    /// Starting values of the nonlinear unknowns, in their order; at least one set.
    fn starts(&self, _scene: &Scene, _target: Target) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }
    /// True if it has a wrench (not only a change of inertia, or a torque of a joint).
    fn has_wrench(&self) -> bool {
        !self.acts().in_joints()
    }
    /// Adds the unit wrenches in every frame of a series to `out`: world force (N per unit) and
    /// moment about the world origin (N·m per unit), one column per coefficient. `nonlinear` holds
    /// the nonlinear unknowns' values ([`crate::Values`] reads them). Laws of joints add none.
    fn evaluate(&self, _series: &Series<'_>, _target: Target, _nonlinear: &[f64], _out: &mut Columns) {}
    /// Changes of inertia, a stack of φ (one per link; kg, kg·m, kg·m² per unit) for each
    /// coefficient; they add the wrench `−Y δφ` to the body. `None` if there is none.
    fn inertia(&self, _scene: &Scene, _target: Target, _nonlinear: &[f64]) -> Option<Vec<Vec<Phi>>> {
        None
    }

    /// Torque that a joint takes from its drive for a unit of each coefficient, N·m (N for a
    /// slide), in every frame of its series. Empty for effects that act on the body as a whole.
    fn torque(&self, _series: &JointSeries<'_>, _nonlinear: &[f64]) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// Identifier in YAML and JSON.
    fn id(&self) -> &str {
        self.about().id
    }
    /// True if `id` is the identifier of this effect or one of its other identifiers.
    fn is_called(&self, id: &str) -> bool {
        let about = self.about();
        about.id == id || about.other_ids.contains(&id)
    }
    /// Mass that the effect adds to the body's inertia at these coefficients, kg: the scale on
    /// which errors of the motion act.
    fn added_inertia_kg(&self, _coefficients: &[f64]) -> f64 {
        0.0
    }
    /// Effects that are not judged where this one is judged, and that would leave the same error
    /// there at these coefficients: nothing there can tell them from this one.
    fn looks_like(&self, _coefficients: &[f64]) -> &'static [&'static str] {
        &[]
    }
    /// Title in a few words.
    fn title(&self) -> &str {
        self.about().title
    }
    /// Physics or artefact.
    fn kind(&self) -> EffectKind {
        self.about().kind
    }
    /// Where it acts.
    fn acts(&self) -> ActsIn {
        self.about().acts
    }
}

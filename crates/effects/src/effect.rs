//! The one interface of effects: those of the catalogue, and formulas that users write in a
//! pipeline or in a file.

use crate::{About, ActsIn, Coefficient, Columns, EffectKind, NonlinearParameter, Scene, Series, Target};
use aloft_body::Phi;

/// An effect that a model may be missing: what it is, what is unknown of it, and the columns that
/// it adds to the rows.
pub trait Effect: Sync {
    /// Names and facts that do not depend on the body.
    fn about(&self) -> About<'_>;
    /// On what it may act; empty where it cannot act at all (a plate's fault without plates).
    fn targets(&self, scene: &Scene) -> Vec<Target>;
    /// Linear unknowns, one for each column.
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient>;
    /// Nonlinear unknowns.
    fn nonlinear(&self, _scene: &Scene, _target: Target) -> Vec<NonlinearParameter> {
        Vec::new()
    }
    /// Values of the nonlinear unknowns to start from, in their order; at least one set.
    fn starts(&self, _scene: &Scene, _target: Target) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }
    /// True when it has a wrench (and not a change of inertia alone).
    fn has_wrench(&self) -> bool {
        true
    }
    /// Adds the unit wrenches in every frame of a series to `out`: world force (N per unit) and
    /// moment about the world origin (N·m per unit), a column a coefficient. `nonlinear` holds the
    /// values of the nonlinear unknowns ([`crate::Values`] reads them).
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns);
    /// Changes of inertia, a stack of φ (a link each; kg, kg·m, kg·m² per unit) for each
    /// coefficient; the body then feels `−Y δφ` in addition. `None` where there is none.
    fn inertia(&self, _scene: &Scene, _target: Target, _nonlinear: &[f64]) -> Option<Vec<Vec<Phi>>> {
        None
    }

    /// Identifier in YAML and JSON.
    fn id(&self) -> &str {
        self.about().id
    }
    /// A few words.
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

//! One interface for effects of the catalogue and for those that users write.

use crate::definition::WrenchLaw;
use crate::{ActsIn, Coefficient, Columns, EffectDefinition, EffectKind, NonlinearParameter, Scene, Series, Target};
use aloft_body::Phi;

/// An effect that a ranking can try.
pub trait Effect: Sync {
    /// Identifier in YAML and JSON.
    fn id(&self) -> &str;
    /// A few words.
    fn title(&self) -> &str;
    /// Physics or artefact.
    fn kind(&self) -> EffectKind;
    /// Where it acts.
    fn acts(&self) -> ActsIn;
    /// What it cannot be told from; empty for none.
    fn class(&self) -> &str {
        ""
    }
    /// Effects that it generalises.
    fn contains(&self) -> &[&str] {
        &[]
    }
    /// True when it shows only as a difference between groups of trials.
    fn by_group(&self) -> bool {
        false
    }
    /// Markdown for people.
    fn documentation(&self) -> &str;
    /// On what it may act.
    fn targets(&self, scene: &Scene) -> Vec<Target>;
    /// Linear unknowns.
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient>;
    /// Nonlinear unknowns.
    fn nonlinear(&self, _scene: &Scene, _target: Target) -> Vec<NonlinearParameter> {
        Vec::new()
    }
    /// Values of the nonlinear unknowns to start from.
    fn starts(&self, _scene: &Scene, _target: Target) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }
    /// True when it has a wrench (and not a change of inertia alone).
    fn has_wrench(&self) -> bool {
        true
    }
    /// Unit wrenches in every frame of a series: world force and moment about the world origin, a column a coefficient.
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns);
    /// Changes of inertia, a stack of φ a coefficient; `None` where there is none.
    fn inertia(&self, _scene: &Scene, _target: Target, _nonlinear: &[f64]) -> Option<Vec<Vec<Phi>>> {
        None
    }
}

impl Effect for EffectDefinition {
    fn id(&self) -> &str {
        self.id
    }
    fn title(&self) -> &str {
        self.title
    }
    fn kind(&self) -> EffectKind {
        self.kind
    }
    fn acts(&self) -> ActsIn {
        self.acts
    }
    fn class(&self) -> &str {
        self.class
    }
    fn contains(&self) -> &[&str] {
        self.contains
    }
    fn by_group(&self) -> bool {
        self.by_group
    }
    fn documentation(&self) -> &str {
        self.documentation
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        (self.targets)(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        (self.coefficients)(scene, target)
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        (self.nonlinear)(scene, target)
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        (self.starts)(scene, target)
    }
    fn has_wrench(&self) -> bool {
        self.wrench.is_some()
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        match self.wrench {
            None => {}
            Some(WrenchLaw::Series(law)) => law(series, target, nonlinear, out),
            Some(WrenchLaw::Frame(law)) => {
                for i in 0..series.len() {
                    law(&series.frame(i), target, nonlinear, out, i);
                }
            }
        }
    }
    fn inertia(&self, scene: &Scene, target: Target, nonlinear: &[f64]) -> Option<Vec<Vec<Phi>>> {
        self.inertia.map(|law| law(scene, target, nonlinear))
    }
}

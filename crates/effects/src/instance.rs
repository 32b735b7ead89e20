//! An effect with its target and nonlinear parameters fixed, as stored in a model revision and used
//! for columns of a factor.

use crate::{Columns, Effect, EffectsError, Scene, Series, Target, TrialMotion, effect};
use aloft_body::{BaseParameters, Phi};
use nalgebra::DMatrix;

/// An effect, its target, and the values of its nonlinear parameters.
#[derive(Clone)]
pub struct EffectInstance<'a> {
    /// The effect.
    pub effect: &'a dyn Effect,
    /// Target of the effect.
    pub target: Target,
    /// Values of the nonlinear parameters, in the effect's order.
    pub nonlinear: Vec<f64>,
    /// Trials in which the effect acts (a payload); all if empty.
    pub trials: Vec<String>,
}

impl std::fmt::Debug for EffectInstance<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}{:?}{:?}", self.effect.id(), self.target, self.nonlinear)
    }
}

impl<'a> EffectInstance<'a> {
    /// An effect on a target, with the nonlinear parameters at their first start.
    pub fn new(effect: &'a dyn Effect, target: Target, scene: &Scene) -> Self {
        let nonlinear = effect.starts(scene, target).into_iter().next().unwrap_or_default();
        Self { effect, target, nonlinear, trials: Vec::new() }
    }

    /// The same, acting only in these trials.
    #[must_use]
    pub fn in_trials(mut self, trials: &[String]) -> Self {
        self.trials = trials.to_vec();
        self
    }

    /// True when the effect acts in a trial.
    pub fn acts_in(&self, trial: &str) -> bool {
        self.trials.is_empty() || self.trials.iter().any(|t| t == trial)
    }

    /// Key of an effect and target: `quadratic_drag`, `flywheel[torso]`, `plate_tare[plate1]`.
    pub fn key(&self, scene: &Scene) -> String {
        let target = self.target.label(scene);
        if target.is_empty() { self.effect.id().to_owned() } else { format!("{}[{target}]", self.effect.id()) }
    }

    /// Names of the columns: the key, a dot, the coefficient's name.
    pub fn names(&self, scene: &Scene) -> Vec<String> {
        let key = self.key(scene);
        self.effect.coefficients(scene, self.target).iter().map(|c| format!("{key}.{}", c.name)).collect()
    }
}

impl EffectInstance<'static> {
    /// Reads a key of an effect of the catalogue; the target may be omitted if the effect has only
    /// one.
    ///
    /// # Errors
    /// [`EffectsError::Unknown`] and [`EffectsError::Target`] with the available names.
    pub fn parse(key: &str, scene: &Scene) -> Result<Self, EffectsError> {
        let id = key.split('[').next().unwrap_or(key);
        Self::of(effect(id)?, key, scene)
    }
}

impl<'a> EffectInstance<'a> {
    /// Reads a key of one of the given effects; the target may be omitted if the effect has only
    /// one.
    ///
    /// # Errors
    /// [`EffectsError::Unknown`] and [`EffectsError::Target`] with the available names.
    pub fn among(key: &str, scene: &Scene, effects: &[&'a dyn Effect]) -> Result<Self, EffectsError> {
        let id = key.split('[').next().unwrap_or(key);
        let found = effects.iter().copied().find(|e| e.is_called(id)).ok_or_else(|| EffectsError::Unknown {
            name: id.to_owned(),
            known: effects.iter().map(|e| e.id()).collect::<Vec<_>>().join(", "),
        })?;
        Self::of(found, key, scene)
    }

    fn of(found: &'a dyn Effect, key: &str, scene: &Scene) -> Result<Self, EffectsError> {
        let wanted = key.split_once('[').map_or("", |(_, rest)| rest.trim_end_matches(']'));
        let targets = found.targets(scene);
        let target = targets.iter().copied().find(|t| t.label(scene) == wanted).or({
            match (targets.as_slice(), wanted) {
                ([only], "") => Some(*only),
                _ => None,
            }
        });
        // how it is written for each of its targets on this body
        let keys = || {
            let of = |t: &Target| match t.label(scene) {
                label if label.is_empty() => format!("`{}`", found.id()),
                label => format!("`{}[{label}]`", found.id()),
            };
            match targets.as_slice() {
                [] => "this body has no joint or plate that it could act on".to_owned(),
                all => format!("there are {}", all.iter().map(of).collect::<Vec<_>>().join(", ")),
            }
        };
        match target {
            Some(target) => Ok(Self::new(found, target, scene)),
            None if wanted.is_empty() => Err(EffectsError::NoTarget { effect: found.id().to_owned(), known: keys() }),
            None => {
                Err(EffectsError::Target { effect: found.id().to_owned(), target: wanted.to_owned(), known: keys() })
            }
        }
    }

    /// Sets a nonlinear parameter by name.
    ///
    /// # Errors
    /// [`EffectsError::Spec`] for a name that the effect does not have, [`EffectsError::Value`] out
    /// of bounds.
    pub fn set(&mut self, scene: &Scene, name: &str, value: f64) -> Result<(), EffectsError> {
        let parameters = self.effect.nonlinear(scene, self.target);
        let Some(k) = parameters.iter().position(|p| p.name == name) else {
            let known = parameters.iter().map(|p| format!("`{}`", p.name)).collect::<Vec<_>>().join(", ");
            return Err(EffectsError::Spec {
                effect: self.effect.id().to_owned(),
                problem: format!("there is no parameter `{name}`; there are {known}"),
            });
        };
        let p = &parameters[k];
        if !(p.lower..=p.upper).contains(&value) {
            return Err(EffectsError::Value {
                effect: self.effect.id().to_owned(),
                what: format!("{name} ({})", p.unit),
                found: value,
                expected: format!("{} to {}", p.lower, p.upper),
            });
        }
        self.nonlinear[k] = value;
        Ok(())
    }
}

/// Columns of a whole trial, in the layout of the regressor's effect columns.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WrenchColumns {
    /// Names of the columns.
    pub names: Vec<String>,
    /// One matrix per frame of the motion, 6 × k: world force (N per unit) and moment about the
    /// world origin (N·m per unit). Frames outside the spans are NaN, so that they give no rows.
    pub wrench: Vec<DMatrix<f64>>,
    /// Change of the parameters φ of all links (SI units) for a unit of each coefficient, for
    /// effects that change the body's inertia (payload, added mass, body mass) in this trial. It is
    /// no part of `wrench`: with rows `[Y | −E]` of the body it adds `Y δφ` to the column.
    pub inertia: Vec<Option<Vec<Phi>>>,
}

/// As [`columns_about`], about the centre of mass of the scene's parameters.
///
/// # Errors
/// As [`Series::new`].
pub fn columns(
    scene: &Scene,
    trial: &TrialMotion<'_>,
    choices: &[EffectInstance<'_>],
) -> Result<WrenchColumns, EffectsError> {
    columns_about(scene, trial, choices, None)
}

/// Unit wrenches of effects in every frame of a trial, with the body's centre of mass from base
/// parameters if given, and changes of inertia beside them.
///
/// # Errors
/// As [`Series::new`].
pub fn columns_about(
    scene: &Scene,
    trial: &TrialMotion<'_>,
    choices: &[EffectInstance<'_>],
    parameters: Option<(&BaseParameters, &[f64])>,
) -> Result<WrenchColumns, EffectsError> {
    let mut series = Series::new(scene, trial)?;
    if let Some((base, values)) = parameters {
        series.set_centre_of_mass(base, values);
    }
    let names: Vec<String> = choices.iter().flat_map(|c| c.names(scene)).collect();
    let k = names.len();
    let mut wrench = vec![DMatrix::from_element(6, k, f64::NAN); trial.motion.n_frames()];
    let mut inertia = Vec::with_capacity(k);
    let mut first = 0;
    for choice in choices {
        let width = choice.effect.coefficients(scene, choice.target).len();
        let mut out = Columns::zeros(series.len(), width);
        let acts = choice.acts_in(&trial.motion.trial);
        if acts {
            choice.effect.evaluate(&series, choice.target, &choice.nonlinear, &mut out);
        }
        let changes = choice.effect.inertia(scene, choice.target, &choice.nonlinear).filter(|_| acts);
        inertia.extend((0..width).map(|column| changes.as_ref()?.get(column).cloned()));
        for (i, &frame) in series.motion_frames().iter().enumerate() {
            wrench[frame].columns_mut(first, width).copy_from(&out.matrix(i));
        }
        first += width;
    }
    Ok(WrenchColumns { names, wrench, inertia })
}

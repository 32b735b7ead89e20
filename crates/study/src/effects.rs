//! The effects available to a study: those of the catalogue, and those that its pipeline defines or
//! names.

use crate::catalog;
use crate::config::PipelineConfig;
use crate::nearest;
use crate::place::{error_at, find, inside};
use crate::ranges;
use crate::recordings::lock_of_editor;
use crate::revision::ModelEffect;
use aloft_body::{Model, ModelSpec, Phi};
use aloft_effects::{CompiledFormula, EFFECTS, Effect, EffectInstance, EffectsError, FormulaEffect, Scene};
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use serde::ser::{SerializeMap, SerializeSeq};
use serde::{Serialize, Serializer};
use std::path::{Path, PathBuf};

/// A user-defined effect and where it is defined.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnEffect {
    /// The definition.
    pub spec: FormulaEffect,
    /// Name of the file as the user gave it.
    pub origin: String,
    /// Text of the file.
    text: String,
    /// Path of the effect within the file; empty if the file holds only this effect.
    path: String,
    /// True if it stands in the folder `effects`, which all pipelines beside it share.
    shared: bool,
}

impl OwnEffect {
    /// Reads a file that holds one effect, given as a name in `configs/effects/` or a path.
    pub fn read(name: &str, dir: &Path) -> Result<Self, PipelineError> {
        let source = catalog::find("effects", name, dir)?;
        let spec = ranges::parse(&source.origin, &source.text)?;
        Ok(Self { spec, origin: source.origin, text: source.text, path: String::new(), shared: false })
    }

    /// Reads a file that holds one effect, given by its path.
    pub fn read_file(path: &Path) -> Result<Self, PipelineError> {
        let text = input::text(path)?;
        let origin = path.display().to_string();
        let spec = ranges::parse(&origin, &text)?;
        Ok(Self { spec, origin, text, path: String::new(), shared: false })
    }

    /// An effect that is not in a file, as it would be read from one.
    pub fn described(spec: &FormulaEffect) -> Result<Self, PipelineError> {
        Ok(Self {
            spec: spec.clone(),
            origin: spec.id.clone(),
            text: Self::text_of(spec)?,
            path: String::new(),
            shared: false,
        })
    }

    /// A definition as the text of a file.
    pub fn text_of(spec: &FormulaEffect) -> Result<String, PipelineError> {
        serde_yaml::to_string(spec)
            .map_err(|e| PipelineError::request(format!("`{}` cannot be written as YAML: {e}", spec.id)))
    }

    /// Links at which it acts and that a body does not have.
    fn links_missing_in(&self, model: &ModelSpec) -> Vec<&str> {
        let there = |name: &str| ["body", "all"].contains(&name) || model.links.iter().any(|l| l.name == name);
        self.spec.links().filter(|name| !there(name)).collect()
    }

    /// Compiles its formulas; an error points at the character.
    pub fn compile(&self, scene: &Scene) -> Result<CompiledFormula, PipelineError> {
        self.spec.compile(scene).map_err(|e| self.shown(&e))
    }

    fn shown(&self, error: &EffectsError) -> PipelineError {
        let path = |place: &str| if self.path.is_empty() { place.to_owned() } else { format!("{}.{place}", self.path) };
        let (at, problem) = match error {
            EffectsError::Formula(f) => {
                let at = find(&self.text, &path(&f.entry)).map(|s| (inside(&self.text, s, &f.formula, f.position), 1));
                (at, format!("effect `{}`, {}: {}", f.effect, f.entry, f.problem))
            }
            EffectsError::Place { place, .. } => {
                let at = find(&self.text, &path(place));
                let length =
                    |at: usize| self.text[at..].find(['\n', ',', '}', ']']).unwrap_or(self.text.len() - at).max(1);
                (at.map(|a| (a, length(a))), error.to_string())
            }
            other => (None, other.to_string()),
        };
        error_at(&self.origin, &self.text, at, &problem, Some("see `aloft effect show sail` for an example".to_owned()))
    }
}

/// Folder beside a pipeline file whose files (`*.yaml`) each hold one effect.
pub const EFFECTS_FOLDER: &str = "effects";

/// Effects that the pipeline defines or names, and those in the folder `effects` beside it, each
/// with a unique identifier.
pub fn own_effects(
    config: &PipelineConfig,
    file: &str,
    text: &str,
    dir: &Path,
) -> Result<Vec<OwnEffect>, PipelineError> {
    let mut own: Vec<OwnEffect> = Vec::new();
    let add = |own: &mut Vec<OwnEffect>, one: OwnEffect, place: String| {
        if let Some(first) = own.iter().find(|o| o.spec.id == one.spec.id) {
            let problem =
                format!("two effects have the identifier `{}`; the first is in {}", one.spec.id, first.origin);
            return Err(error_at(file, text, find(text, &place).map(|at| (at, 1)), &problem, None));
        }
        own.push(one);
        Ok(())
    };
    for (i, name) in config.effects.files.iter().enumerate() {
        let place = format!("effects.files[{i}]");
        let one = OwnEffect::read(name, dir).map_err(|e| match e {
            PipelineError::Request { problem, hint } => {
                error_at(file, text, find(text, &place).map(|at| (at, name.len())), &problem, hint)
            }
            other => other,
        })?;
        add(&mut own, one, place)?;
    }
    for (i, spec) in config.effects.define.iter().enumerate() {
        let path = format!("effects.define[{i}]");
        let one = OwnEffect {
            spec: spec.clone(),
            origin: file.to_owned(),
            text: text.to_owned(),
            path: path.clone(),
            shared: false,
        };
        add(&mut own, one, format!("{path}.id"))?;
    }
    for path in effect_files(dir)? {
        let one = OwnEffect { shared: true, ..OwnEffect::read_file(&path)? };
        let named = |o: &OwnEffect| o.spec == one.spec;
        if own.iter().any(named) {
            continue;
        }
        if let Some(first) = own.iter().find(|o| o.spec.id == one.spec.id) {
            return Err(PipelineError::request_hint(
                format!(
                    "two effects have the identifier `{}`: one in {}, one in {}",
                    one.spec.id,
                    first.origin,
                    path.display()
                ),
                "give one of them another `id`, or move the file out of the folder `effects`",
            ));
        }
        own.push(one);
    }
    Ok(own)
}

/// Files of the folder `effects` beside a pipeline, sorted by name; none if there is no such
/// folder.
fn effect_files(dir: &Path) -> Result<Vec<PathBuf>, PipelineError> {
    let folder = dir.join(EFFECTS_FOLDER);
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(&folder).map_err(PipelineError::io("list", &folder))?;
    let mut out = Vec::new();
    for entry in entries {
        let path = entry.map_err(PipelineError::io("list", &folder))?.path();
        let locked = path.file_name().is_some_and(lock_of_editor);
        if path.extension().is_some_and(|e| e == "yaml" || e == "yml") && !locked {
            out.push(path);
        }
    }
    out.sort();
    Ok(out)
}

/// Divides effects into those that can act on a body and those of the folder `effects` that act on
/// links of another one, each with the link that this body does not have: pipelines of several
/// bodies may stand beside one folder.
pub fn for_body(own: Vec<OwnEffect>, model: &ModelSpec) -> (Vec<OwnEffect>, Vec<(OwnEffect, String)>) {
    let mut here = Vec::new();
    let mut elsewhere = Vec::new();
    for one in own {
        match one.links_missing_in(model).first().map(|l| (*l).to_owned()).filter(|_| one.shared) {
            Some(link) => elsewhere.push((one, link)),
            None => here.push(one),
        }
    }
    (here, elsewhere)
}

/// Compiles the formulas for the bare model, so that an error is reported before anything runs.
pub fn check_formulas(own: &[OwnEffect], model: &ModelSpec) -> Result<(), PipelineError> {
    if own.is_empty() {
        return Ok(());
    }
    // none: a model that cannot be built is reported elsewhere
    let Ok(model) = Model::from_spec(model) else { return Ok(()) };
    let phi = vec![Phi::zeros(); model.n_links()];
    let scene = Scene::new(&model, &phi, &[]);
    own.iter().try_for_each(|o| o.compile(&scene).map(|_| ()))
}

/// True for an effect that depends on when in the session a recording was made.
pub fn asks_session_time(id: &str) -> bool {
    // none: a law of the user's own does not depend on the session
    aloft_effects::effect(id).is_ok_and(|e| e.about().uses_session_time)
}

/// The effects of a model, with everything that their columns are computed from.
#[derive(Debug, Clone, Default)]
pub struct ModelEffects {
    /// The effects.
    pub model: Vec<ModelEffect>,
    /// Definitions of the user-defined ones.
    pub own: Vec<OwnEffect>,
    /// Base parameters of the model without effects, from which columns take the centre of mass;
    /// empty before they are known.
    pub about: Vec<f64>,
    /// Order of the session's recordings as listed by the laboratory, if an effect depends on it.
    pub recordings: Option<Vec<String>>,
}

impl Serialize for ModelEffects {
    /// As part of a cache key: an empty list for the model without effects.
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        if self.model.is_empty() {
            return to.serialize_seq(Some(0))?.end();
        }
        let bytes: Vec<u8> = self.about.iter().flat_map(|x| x.to_le_bytes()).collect();
        let own: Vec<&FormulaEffect> = self.own.iter().map(|o| &o.spec).collect();
        let mut map = to.serialize_map(None)?;
        map.serialize_entry("model", &self.model)?;
        map.serialize_entry("own", &own)?;
        map.serialize_entry("about", &blake3::hash(&bytes).to_hex().to_string())?;
        if let Some(recordings) = &self.recordings {
            map.serialize_entry("recording_order", recordings)?;
        }
        map.end()
    }
}

/// The effects of a study bound to a body, from which rankings and models choose.
#[derive(Debug)]
pub struct KnownEffects {
    formulas: Vec<CompiledFormula>,
}

impl KnownEffects {
    /// Compiles the study's own effects for a body.
    pub fn of(own: &[OwnEffect], scene: &Scene) -> Result<Self, PipelineError> {
        Ok(Self { formulas: own.iter().map(|o| o.compile(scene)).collect::<Result<_, _>>()? })
    }

    /// All effects, those of the catalogue first.
    pub fn all(&self) -> Vec<&dyn Effect> {
        let built_in = EFFECTS.iter().copied();
        built_in.chain(self.formulas.iter().map(|f| f as &dyn Effect)).collect()
    }

    /// An effect of a model, bound to a scene.
    pub fn choice(&self, scene: &Scene, effect: &ModelEffect) -> Result<EffectInstance<'_>, PipelineError> {
        let known: Vec<&str> = self.all().iter().map(|e| e.id()).collect();
        let fail = |e: EffectsError| match e {
            EffectsError::Unknown { name, .. } => PipelineError::request_hint(
                format!("there is no effect `{name}`"),
                nearest::hint(&name, &known, "there are"),
            ),
            other => PipelineError::request(other.to_string()),
        };
        let mut choice = EffectInstance::among(&effect.key, scene, &self.all()).map_err(fail)?;
        for (name, value) in &effect.nonlinear {
            choice.set(scene, name, *value).map_err(fail)?;
        }
        Ok(choice.in_trials(&effect.trials))
    }
}

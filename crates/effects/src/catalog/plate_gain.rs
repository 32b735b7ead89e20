//! A plate that reads too much or too little.

use crate::columns::axis;
use crate::{
    About, ActsIn, Coefficient, Columns, Effect, EffectFrame, EffectKind, Family, Scene, Separation, Series, Target,
};

const ABOUT: About<'static> = About {
    id: "plate_gain",
    title: "gain of a plate",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    family: Family::Plates,
    class: "body mass, where all plates err alike",
    aliases: &["body_mass"],
    separated_by: Separation::KnownWeight,
    shows_in_free_fall: true,
    documentation: "\
## Physics
An amplifier's gain is off, or sensitivities were typed in wrongly: the plate reads some per cent too much or too little.

## Equation
All plates: true wrench = (1 + `gain`) measured. One plate: each of its six components (world axes, moments about its centre) has its own gain; they are those of the plate's channels where its axes are parallel to the room's. \
Coefficients: relative (0.03 for a plate that reads 3 % too little).

## Identifiability
One gain for all plates is an exact alias of a wrongly stated body mass; a single plate, or a single component, is not. Standing with the weight on each plate in turn separates them.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

/// First columns of the gains of one plate's components.
const FORCE: usize = 0;
const MOMENT: usize = 3;

pub(super) struct PlateGain;

impl Effect for PlateGain {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::all_or_one_plate(scene)
    }
    fn coefficients(&self, _: &Scene, target: Target) -> Vec<Coefficient> {
        let within = |n: &str| Coefficient::within(n, "1", -0.5, 0.5);
        match target {
            Target::Plate(_) => ["gain_fx", "gain_fy", "gain_fz", "gain_mx", "gain_my", "gain_mz"].map(within).into(),
            _ => vec![within("gain")],
        }
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        for (i, f) in series.instants().filter(|(_, f)| !f.flight) {
            match target {
                Target::Plate(plate) => one_plate(&f, plate, out, i),
                _ => {
                    for here in f.plates {
                        out.add(i, 0, &here.force_n, &here.moment_nm);
                    }
                }
            }
        }
    }
}

/// Columns of every component of one plate.
fn one_plate(f: &EffectFrame<'_>, plate: usize, out: &mut Columns, i: usize) {
    let (Some(here), Some(centre)) = (f.plates.get(plate), f.scene.plate_centres_m.get(plate)) else { return };
    let about_centre = here.moment_nm - centre.cross(&here.force_n);
    for k in 0..3 {
        out.force_at(i, FORCE + k, &(axis(k) * here.force_n[k]), centre);
        out.couple(i, MOMENT + k, &(axis(k) * about_centre[k]));
    }
}

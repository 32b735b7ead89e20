//! Documentation, names, units, bounds; columns are finite and nonzero only where the effect acts.

use super::{Fixture, with_limbs};
use crate::*;

#[test]
fn every_effect_is_described_and_bounded() {
    let fixture = Fixture::new(true);
    let mut seen = Vec::new();
    for definition in EFFECTS.iter().copied() {
        assert!(!seen.contains(&definition.id()), "{} twice", definition.id());
        seen.push(definition.id());
        for heading in ["## Physics", "## Equation", "## Identifiability", "## References"] {
            assert!(definition.about().documentation.contains(heading), "{}: {heading}", definition.id());
        }
        for other in definition.about().contains {
            assert!(effect(other).is_ok(), "{} contains `{other}`", definition.id());
        }
        // some act on robots only, some only on bodies with limbs and markers
        let limbs = with_limbs();
        let scene = if definition.targets(&fixture.scene).is_empty() { &limbs } else { &fixture.scene };
        let targets = definition.targets(scene);
        assert!(!targets.is_empty(), "{}", definition.id());
        for target in targets {
            let coefficients = definition.coefficients(scene, target);
            assert!(!coefficients.is_empty());
            for c in &coefficients {
                assert!(c.lower < c.upper, "{} {}", definition.id(), c.name);
                let bounded = c.lower.is_finite() && c.upper.is_finite();
                assert!(
                    bounded || !definition.about().unbounded.is_empty(),
                    "{} {}: why no bound?",
                    definition.id(),
                    c.name
                );
                assert!(formula_unit_is_readable(&c.unit), "{} {}", definition.id(), c.unit);
            }
            let parameters = definition.nonlinear(scene, target);
            let starts = definition.starts(scene, target);
            assert!(!starts.is_empty());
            for start in starts {
                assert_eq!(start.len(), parameters.len(), "{}", definition.id());
                for (x, p) in start.iter().zip(&parameters) {
                    assert!((p.lower..=p.upper).contains(x), "{} {} {x}", definition.id(), p.name);
                }
            }
            let key = EffectInstance::new(definition, target, scene).key(scene);
            assert_eq!(EffectInstance::parse(&key, scene).unwrap().target, target, "{key}");
        }
    }
    assert_eq!(seen.len(), EFFECTS.len());
    assert!(matches!(effect("draught"), Err(EffectsError::Unknown { .. })));
}

/// One file per effect, named after its identifier, and one entry in the list.
#[test]
fn every_file_of_the_catalogue_is_an_effect_of_the_list() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/catalog");
    let mut files: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned())
        .filter(|stem| stem != "mod")
        .collect();
    let mut ids: Vec<&str> = EFFECTS.iter().map(|e| e.id()).collect();
    files.sort();
    ids.sort_unstable();
    assert_eq!(files, ids);
}

/// Names and kinds of unknowns agree: consecutive `…_x`, `…_y` are components, and no other names
/// are.
#[test]
fn components_of_places_and_vectors_state_their_kind() {
    use ParameterKind::{PointInWorld, PointOnLink, Scalar, VectorInWorld, VectorOnLink};
    let fixture = Fixture::new(true);
    let check = |id: &str, names: &[String], kinds: &[ParameterKind]| {
        for (i, kind) in kinds.iter().enumerate() {
            let (PointInWorld(k) | VectorInWorld(k) | PointOnLink(k) | VectorOnLink(k)) = *kind else {
                let component = names[i].strip_suffix("_x");
                let vector = component.is_some_and(|s| names.get(i + 1) == Some(&format!("{s}_y")));
                assert!(*kind == Scalar && !vector, "{id} {}", names[i]);
                continue;
            };
            let stem = names[i].strip_suffix(["_x", "_y", "_z"][k]).unwrap_or_else(|| panic!("{id} {}", names[i]));
            let first = kinds[i - k];
            assert_eq!(std::mem::discriminant(&first), std::mem::discriminant(kind), "{id} {}", names[i]);
            assert_eq!(names[i - k], format!("{stem}_x"), "{id}");
            let turned = first.begins_vector(kinds.get(i - k + 1).copied());
            assert_eq!(turned, matches!(first, VectorInWorld(_) | VectorOnLink(_)), "{id} {}", names[i]);
        }
    };
    let (mut directed, mut places) = (Vec::new(), Vec::new());
    for effect in EFFECTS {
        for target in effect.targets(&fixture.scene) {
            let linear = effect.coefficients(&fixture.scene, target);
            let nonlinear = effect.nonlinear(&fixture.scene, target);
            let names = |n: &mut dyn Iterator<Item = &String>| n.cloned().collect::<Vec<_>>();
            let of_linear: Vec<_> = linear.iter().map(|c| c.kind).collect();
            let of_nonlinear: Vec<_> = nonlinear.iter().map(|p| p.kind).collect();
            check(effect.id(), &names(&mut linear.iter().map(|c| &c.name)), &of_linear);
            check(effect.id(), &names(&mut nonlinear.iter().map(|p| &p.name)), &of_nonlinear);
            if of_linear.iter().chain(&of_nonlinear).any(|k| matches!(k, VectorInWorld(_) | VectorOnLink(_))) {
                directed.push(effect.id());
            }
            if of_nonlinear.iter().any(|k| matches!(k, PointInWorld(_))) {
                places.push(effect.id());
            }
        }
    }
    places.dedup();
    directed.dedup();
    for (id, list, is_in) in [
        ("tether", &places, true),
        ("crane", &places, true),
        ("wind", &places, false),
        ("wind", &directed, true),
        ("gravity_tilt", &directed, true),
        ("soft_tissue", &directed, true),
        ("quadratic_drag", &directed, false),
    ] {
        assert_eq!(list.contains(&id), is_in, "{id}");
    }
}

/// The recording that separates two effects: the one stated for the pair by either of them,
/// otherwise the one that takes precedence.
#[test]
fn two_effects_are_told_apart_as_their_files_say() {
    let words = |a: &str, b: &str| effect(a).unwrap().about().told_apart_by(&effect(b).unwrap().about());
    for (a, b, start) in [
        ("quadratic_drag", "linear_drag", "throws or jumps at speeds"),
        ("quadratic_drag", "gravity_scale", "a dropped ball"),
        ("gravity_tilt", "gravity_scale", "a dropped ball"),
        ("gravity_tilt", "wind", "a second orientation"),
        ("wind", "tether", "motion with and against"),
        ("crane", "rotor", "the same motion at other places"),
        ("flywheel", "payload", "spins in both senses"),
        ("payload", "soft_tissue", "trials with and without"),
        ("filter_attenuation", "plate_tare", "a motion without impacts"),
        ("body_mass", "thrust", "standing still on each plate"),
        ("rotational_drag", "linear_drag", "longer flights"),
    ] {
        assert!(words(a, b).starts_with(start), "{a} {b}: {}", words(a, b));
        assert_eq!(words(a, b), words(b, a));
    }
    for other in EFFECTS.iter().flat_map(|e| e.about().told_from.iter()) {
        assert!(effect(other.0).is_ok() && !other.1.is_empty());
    }
}

fn formula_unit_is_readable(unit: &str) -> bool {
    formula::unit_is_readable(unit)
}

/// Columns are finite for every target and start. Where an effect acts, each of its columns is
/// nonzero for some start (a line may be slack at others); elsewhere all are zero.
#[test]
fn columns_are_finite_and_act_where_they_say() {
    for flight in [true, false] {
        let fixture = Fixture::new(flight);
        fixture.with(|series| {
            for effect in EFFECTS {
                let acts = if flight { effect.acts().in_flight() } else { effect.acts().in_contact() };
                for target in effect.targets(&fixture.scene) {
                    let coefficients = effect.coefficients(&fixture.scene, target);
                    let mut size = vec![0.0; coefficients.len()];
                    for p in effect.starts(&fixture.scene, target) {
                        let columns = fixture.columns(series, *effect, target, &p);
                        for i in 0..series.len() {
                            for (k, size) in size.iter_mut().enumerate() {
                                let sum: f64 = columns.wrench(i, k).iter().map(|x| x.abs()).sum();
                                assert!(sum.is_finite(), "{} {target:?} {p:?}", effect.id());
                                *size += sum;
                            }
                        }
                        for (change, size) in effect.inertia(&fixture.scene, target, &p).iter().flatten().zip(&mut size)
                        {
                            let sum: f64 = change.iter().map(|phi| phi.abs().sum()).sum();
                            assert!(sum.is_finite(), "{} {target:?} {p:?}", effect.id());
                            *size += if acts { sum } else { 0.0 };
                        }
                    }
                    for (c, size) in coefficients.iter().zip(size) {
                        let (id, name) = (effect.id(), &c.name);
                        assert!(acts || size == 0.0, "{id} {target:?} {name} acts where it should not");
                        assert!(!acts || size > 0.0, "{id} {target:?} {name}: a column of zeros");
                    }
                }
            }
        });
    }
}

/// Laws of joints give a torque for each coefficient, finite, as long as the motion, and nowhere a
/// wrench.
#[test]
fn laws_of_joints_have_torques_and_no_wrench() {
    let fixture = Fixture::new(true);
    let n = 200;
    let of = |f: &dyn Fn(f64) -> f64| (0..n).map(|i| f(0.005 * f64::from(i))).collect::<Vec<f64>>();
    let (q, v, torque) =
        (of(&|t| 0.8 * (5.0 * t).sin()), of(&|t| 4.0 * (5.0 * t).cos()), of(&|t| 2.0 + 3.0 * (4.0 * t).sin()));
    let series = JointSeries { rate_hz: 200.0, q: &q, v: &v, torque: &torque };
    let laws: Vec<_> = EFFECTS.iter().filter(|e| e.acts().in_joints()).collect();
    assert!(!laws.is_empty());
    for law in laws {
        let targets = law.targets(&fixture.scene);
        assert!(!targets.is_empty(), "{} acts on no joint", law.id());
        for target in targets {
            assert!(matches!(target, Target::Joint(_)), "{} {target:?}", law.id());
            let coefficients = law.coefficients(&fixture.scene, target);
            for p in law.starts(&fixture.scene, target) {
                let columns = law.torque(&series, &p);
                assert_eq!(columns.len(), coefficients.len(), "{}", law.id());
                for column in columns {
                    assert!(column.len() == q.len() && column.iter().all(|x| x.is_finite()), "{}", law.id());
                    assert!(column.iter().any(|x| x.abs() > 1e-3), "{}: a column of zeros", law.id());
                }
            }
        }
    }
}

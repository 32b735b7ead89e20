//! Documentation, names, units, bounds; columns are finite and act where they say.

use super::Fixture;
use crate::*;

#[test]
fn prop_every_effect_is_described_and_bounded() {
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
        let targets = definition.targets(&fixture.scene);
        assert!(!targets.is_empty(), "{}", definition.id());
        assert!(definition.wrench.is_some() || definition.inertia.is_some());
        for target in targets {
            let coefficients = definition.coefficients(&fixture.scene, target);
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
            let parameters = definition.nonlinear(&fixture.scene, target);
            let starts = definition.starts(&fixture.scene, target);
            assert!(!starts.is_empty());
            for start in starts {
                assert_eq!(start.len(), parameters.len(), "{}", definition.id());
                for (x, p) in start.iter().zip(&parameters) {
                    assert!((p.lower..=p.upper).contains(x), "{} {} {x}", definition.id(), p.name);
                }
            }
            let key = Choice::new(definition, target, &fixture.scene).key(&fixture.scene);
            assert_eq!(Choice::parse(&key, &fixture.scene).unwrap().target, target, "{key}");
        }
    }
    assert_eq!(seen.len(), 27);
    assert!(matches!(effect("draught"), Err(EffectsError::Unknown { .. })));
}

fn formula_unit_is_readable(unit: &str) -> bool {
    formula::unit_is_readable(unit)
}

#[test]
fn prop_columns_are_finite_for_every_effect_target_and_start() {
    for flight in [true, false] {
        let fixture = Fixture::new(flight);
        fixture.with(|series| {
            for effect in EFFECTS {
                for target in effect.targets(&fixture.scene) {
                    for p in effect.starts(&fixture.scene, target) {
                        let columns = fixture.columns(series, *effect, target, &p);
                        let acts = if flight { effect.acts().in_flight() } else { effect.acts().in_contact() };
                        let mut size = 0.0;
                        for i in 0..series.len() {
                            for k in 0..columns.k {
                                let sum: f64 = columns.wrench(i, k).iter().map(|x| x.abs()).sum();
                                assert!(sum.is_finite(), "{} {target:?} {p:?}", effect.id());
                                size += sum;
                            }
                        }
                        assert!(acts || size == 0.0, "{} acts where it should not", effect.id());
                    }
                }
            }
        });
    }
}

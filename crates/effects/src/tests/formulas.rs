//! Effects written by users as formulas.

use super::{Fixture, model, phi};
use crate::*;
use nalgebra::Vector3;

fn sail() -> FormulaEffect {
    serde_json::from_str(
        r#"{"id": "sail", "point": {"link": "base", "position_m": [0.1, 0.2, 0.0]},
            "force": ["-c * speed * v_x", "-c*speed*v_y", "-c * speed * v_z"],
            "coefficients": [{"name": "c", "unit": "kg/m", "lower": 0}]}"#,
    )
    .unwrap()
}

#[test]
fn a_formula_gives_the_columns_of_its_law() {
    let fixture = Fixture::new(true);
    let compiled = sail().compile(&fixture.scene).unwrap();
    fixture.with(|series| {
        let columns = fixture.columns(series, &compiled, Target::Body, &[]);
        for i in (0..series.len()).step_by(7) {
            let link = &series.links(i)[0];
            let p = Vector3::new(0.1, 0.2, 0.0);
            let v = link.point_velocity(&p);
            let force = -v * v.norm();
            assert!((columns.force(i, 0) - force).norm() < 1e-12 * force.norm());
            assert!((columns.moment(i, 0) - link.point(&p).cross(&force)).norm() < 1e-9);
        }
    });
}

#[test]
fn formula_errors_point_at_the_character() {
    let fixture = Fixture::new(true);
    let cases = [
        ("-c * speed * v_w", 13, "nothing is called `v_w`"),
        ("-c * speed", 3, "the unit is"),
        ("-c * speed * (v_x + t)", 18, "units differ"),
        ("-c * speed * v_x +", 18, "something is missing"),
        ("-c * (speed * v_x", 5, "never closed"),
        ("-c * speed * v_x)", 16, "closes nothing"),
        ("-c * sin(speed) * v_x", 9, "takes a number without unit"),
        ("-abs(c) * speed * v_x", 5, "not linear"),
        ("-c * speed * v_x - mass * gravity", 1, "no coefficient"),
        ("-c * speed & v_x", 11, "has no meaning"),
        ("-c * speed * v_x ^ t", 19, "an exponent has no unit"),
        ("-c * speed v_x", 11, "an operator is missing"),
        ("-c * root(speed) * v_x", 5, "no function `root`"),
    ];
    for (text, place, words) in cases {
        let mut effect = sail();
        effect.force = Some([text.into(), "0".into(), "-c*speed*v_z".into()]);
        match effect.compile(&fixture.scene) {
            Err(EffectsError::Formula(found)) => {
                assert!(found.problem.contains(words), "{text}: {}", found.problem);
                assert_eq!((found.position, found.entry.as_str()), (place, "force[0]"), "{text}: {}", found.problem);
                let shown = found.to_string();
                assert_eq!(shown.lines().last().and_then(|l| l.find('^')), Some(place + 2), "{shown}");
            }
            other => panic!("{text}: {other:?}"),
        }
    }
}

#[test]
fn formulas_read_as_people_write() {
    let fixture = Fixture::new(true);
    // a minus before a power, powers of powers, link axes, joint angles, a bounded parameter
    let effect: FormulaEffect = serde_json::from_str(
        r#"{"id": "odd", "axes": "link", "point": {"link": "arm"},
            "force": ["-c * v_x^2", "0", "c * speed^2 * sin(q_arm + phase)"], "moment": ["k*omega_x*2^-1", "k * omega_y", "0*k*spin"],
            "coefficients": [{"name": "c", "unit": "kg/m"}, {"name": "k", "unit": "N*m*s/rad"}],
            "parameters": [{"name": "phase", "unit": "rad", "lower": -1, "upper": 1}]}"#,
    )
    .unwrap();
    let compiled = effect.compile(&fixture.scene).unwrap();
    assert_eq!(compiled.starts(&fixture.scene, Target::Body).len(), 5);
    fixture.with(|series| {
        let columns = fixture.columns(series, &compiled, Target::Body, &[0.3]);
        for i in (0..series.len()).step_by(7) {
            let f = series.frame(i);
            let link = &f.links[1];
            let v = link.point_velocity(&fixture.scene.link_com_m[1]);
            let own = link.rotation.tr_mul(&v);
            let force = Vector3::new(-own.x * own.x, 0.0, v.norm_squared() * (f.q[7] + 0.3).sin());
            assert!((columns.force(i, 0) - link.rotation * force).norm() < 1e-9);
            let spin = link.rotation.tr_mul(&link.omega);
            let about = columns.moment(i, 1);
            assert!((about - link.rotation * Vector3::new(0.5 * spin.x, spin.y, 0.0)).norm() < 1e-9);
        }
    });
}

/// A law with a delay has the formulas' values of the motion so much earlier, at the present point
/// and along the present axes; before what is known, those of the first frame that is known.
#[test]
fn a_delayed_law_follows_the_motion_of_an_earlier_frame() {
    let fixture = Fixture::new(true);
    let of = |text: &str| -> CompiledFormula {
        serde_json::from_str::<FormulaEffect>(text).unwrap().compile(&fixture.scene).unwrap()
    };
    let law = |axes: &str| {
        let law = format!(
            r#"{{"id": "late", "axes": "{axes}", "point": {{"link": "arm"}}, "delay": "late",
                 "force": ["c*v_x*speed", "c*v_y*speed", "c*q_arm*v_z*speed"],
                 "coefficients": [{{"name": "c", "unit": "kg/m"}}],
                 "parameters": [{{"name": "late", "unit": "s", "lower": 0, "upper": 0.4}}]}}"#
        );
        let at_once = law.replace(r#""delay": "late","#, "").replace("*q_arm", "*q_arm*cos(late/late)/cos(late/late)");
        (of(&law), of(&at_once))
    };
    fixture.with(|series| {
        for (axes, in_link) in [("world", false), ("link", true)] {
            let (late, at_once) = law(axes);
            let plain = fixture.columns(series, &at_once, Target::Body, &[0.1]);
            let components = |frame: usize| {
                let force = plain.force(frame, 0);
                if in_link { series.links(frame)[1].rotation.tr_mul(&force) } else { force }
            };
            // ten frames at 200 Hz, and a quarter of a frame more
            for (delay, back, share) in [(0.05, 10, 0.0), (0.05125, 10, 0.25), (0.0, 0, 0.0)] {
                let columns = fixture.columns(series, &late, Target::Body, &[delay]);
                for i in (12..series.len()).step_by(9) {
                    let then = components(i - back) * (1.0 - share) + components(i - back - 1) * share;
                    let now = &series.links(i)[1];
                    let force = if in_link { now.rotation * then } else { then };
                    assert!((columns.force(i, 0) - force).norm() < 1e-9 * force.norm(), "{axes} {delay} {i}");
                    let point = now.point(&fixture.scene.link_com_m[1]);
                    assert!((columns.moment(i, 0) - point.cross(&force)).norm() < 1e-9);
                }
            }
        }
        // of the frames before the span 20 are known
        let [(first, _), _] = series.earlier(3, 0.05);
        assert_eq!((first.frame, first.flight, first.plates.len()), (13, false, 0));
        let q = fixture.motion.q(13);
        assert_eq!(first.q, q);
        assert!((first.com - series.frame(0).com).norm() < 0.5);
        let [(oldest, share), (older, _)] = series.earlier(3, 0.4);
        assert_eq!((oldest.frame, older.frame, share), (0, 0, 1.0));
        let [(now, share), _] = series.earlier(3, f64::NAN);
        assert_eq!((now.frame, share), (23, 1.0));
    });
}

/// Where frames are missing, the motion is between the known frames on both sides.
#[test]
fn a_delay_reaches_across_missing_frames() {
    let mut fixture = Fixture::new(true);
    // a gap of six frames before the span, which begins at frame 20, and one of five within it
    let nq = fixture.motion.nq;
    for frame in (12..18).chain(60..65) {
        fixture.motion.q[frame * nq..(frame + 1) * nq].fill(f64::NAN);
    }
    fixture.with(|series| {
        let i = series.index_of(70).unwrap();
        // 40 ms are eight frames: 62 is between 59 and 65
        let [(before, first), (after, second)] = series.earlier(i, 0.04);
        assert_eq!((before.frame, after.frame), (59, 65));
        assert!((first - 0.5).abs() < 1e-9 && (second - 0.5).abs() < 1e-9, "{first} {second}");
        // before the span only the frames after its last gap are known
        let i = series.index_of(21).unwrap();
        let [(oldest, share), _] = series.earlier(i, 0.2);
        assert_eq!((oldest.frame, share), (18, 1.0));
    });
}

/// Times since take-off, since landing and until the end are not known of the motion before a span.
#[test]
fn a_delayed_law_cannot_depend_on_when_the_stretch_began() {
    let fixture = Fixture::new(true);
    for name in ["since_start", "since_landing", "to_end"] {
        let mut effect = sail();
        effect.force = Some([format!("-c*speed*v_x*exp(-{name}/late)"), "0".into(), "0".into()]);
        effect.constants.push(FormulaConstant { name: "late".into(), unit: "s".into(), value: 0.1 });
        assert!(effect.compile(&fixture.scene).is_ok());
        effect.delay = Some("late".into());
        let told = effect.compile(&fixture.scene).unwrap_err().to_string();
        assert!(told.contains(&format!("a law with a delay cannot depend on `{name}`")), "{told}");
    }
}

/// A law with definitions is the law with what they stand for.
#[test]
fn definitions_stand_for_their_formulas() {
    let fixture = Fixture::new(true);
    let with = |force: &str, definitions: &[(&str, &str)]| {
        let mut effect = sail();
        effect.force = Some([force.into(), "0".into(), "-c*speed*v_z".into()]);
        let named = definitions.iter();
        effect.definitions =
            named.map(|(name, f)| FormulaDefinition { name: (*name).into(), formula: (*f).into() }).collect();
        effect
    };
    let square = [("s", "v_x^2 + v_y^2"), ("flat", "sqrt(s)")];
    let short = with("-c * flat * v_x", &square).compile(&fixture.scene).unwrap();
    let long = with("-c * sqrt(v_x^2 + v_y^2) * v_x", &[]).compile(&fixture.scene).unwrap();
    fixture.with(|series| {
        let [a, b] = [&short, &long].map(|e| fixture.columns(series, e, Target::Body, &[]));
        for i in 0..series.len() {
            assert_eq!(a.matrix(i), b.matrix(i));
        }
    });
    // an error inside a definition is told with its place, one of its use with the law's
    for (force, definitions, entry, position, words) in [
        ("-c*flat*v_x", &[("flat", "sqrt(v_w)")][..], "definitions[0].formula", 5, "nothing is called `v_w`"),
        ("-c*b*v_x", &[("b", "sqrt(a)"), ("a", "speed")][..], "definitions[0].formula", 5, "nothing is called `a`"),
        ("-c*flat*v_x", &[("flat", "v_x + t")][..], "definitions[0].formula", 4, "units differ"),
        ("-c*flat*v_x", &[("flat", "v_x^2")][..], "force[0]", 7, "the unit is"),
        ("-flat*v_x", &[("flat", "abs(c)*speed")][..], "force[0]", 1, "not linear"),
    ] {
        match with(force, definitions).compile(&fixture.scene) {
            Err(EffectsError::Formula(found)) => {
                assert!(found.problem.contains(words), "{force}: {}", found.problem);
                assert_eq!((found.entry.as_str(), found.position), (entry, position), "{force} {definitions:?}");
            }
            other => panic!("{force}: {other:?}"),
        }
    }
    for (definitions, words) in [
        (&[("flat", "speed"), ("other", "speed")][..], "`other` stands in no formula"),
        (&[("flat", "speed"), ("flat", "speed")][..], "two things have the name"),
        (&[("flat", "speed"), ("v_x", "speed")][..], "cannot be a name here"),
        (&[("flat", "speed"), ("c", "speed")][..], "two things have the name"),
    ] {
        let told = with("-c*flat*v_x", definitions).compile(&fixture.scene).unwrap_err().to_string();
        assert!(told.contains(words), "{told}");
    }
}

/// Definitions that double in size each time end with an error instead of the memory.
#[test]
fn definitions_cannot_grow_without_bound() {
    let fixture = Fixture::new(true);
    let mut effect = sail();
    let doubled = |i: usize| format!("d{i}*d{i}/d{i}");
    effect.definitions = (0..64)
        .map(|i| FormulaDefinition {
            name: format!("d{i}"),
            formula: if i == 0 { "speed".into() } else { doubled(i - 1) },
        })
        .collect();
    effect.force = Some(["-c*d63*v_x".into(), "0".into(), "0".into()]);
    let told = effect.compile(&fixture.scene).unwrap_err().to_string();
    assert!(told.contains("more than 20000 parts"), "{told}");
}

/// Names give unknowns a direction: vectors among coefficients, known positions and winds among
/// parameters, and two coefficients of either sign if nothing else has one.
#[test]
fn names_of_a_formula_s_unknowns_give_them_a_direction() {
    use ParameterKind::{PointInWorld, Scalar, VectorInWorld, VectorOnLink};
    let fixture = Fixture::new(true);
    let kinds = |text: &str| {
        let effect: FormulaEffect = serde_json::from_str(text).unwrap();
        let compiled = effect.compile(&fixture.scene).unwrap();
        let linear = compiled.coefficients(&fixture.scene, Target::Body).iter().map(|c| c.kind).collect::<Vec<_>>();
        let bent = compiled.nonlinear(&fixture.scene, Target::Body).iter().map(|p| p.kind).collect::<Vec<_>>();
        (linear, bent)
    };
    let jet = r#"{"id": "jet", "axes": "link", "point": {"link": "arm"}, "force": ["f_x", "f_y", "f_z + k"],
        "coefficients": [{"name": "f_x", "unit": "N"}, {"name": "f_y", "unit": "N"}, {"name": "f_z", "unit": "N"},
                         {"name": "k", "unit": "N"}]}"#;
    assert_eq!(kinds(jet).0, [VectorOnLink(0), VectorOnLink(1), VectorOnLink(2), Scalar]);
    let spring = r#"{"id": "spring", "point": {"link": "arm"},
        "force": ["k * (anchor_x - r_x)", "k * (anchor_y - r_y)", "-d * v_z"],
        "coefficients": [{"name": "k", "unit": "N/m"}, {"name": "d", "unit": "N*s/m"}],
        "parameters": [{"name": "anchor_x", "unit": "m", "lower": -1, "upper": 1},
                       {"name": "anchor_y", "unit": "m", "lower": -1, "upper": 1}]}"#;
    assert_eq!(kinds(spring), (vec![Scalar; 2], vec![PointInWorld(0), PointInWorld(1)]));
    let lean = r#"{"id": "lean", "point": {"link": "base"}, "force": ["a", "b", "0"],
        "coefficients": [{"name": "a", "unit": "N"}, {"name": "b", "unit": "N"}]}"#;
    assert_eq!(kinds(lean).0, [VectorInWorld(0), VectorInWorld(1)]);
    assert_eq!(kinds(&lean.replace(r#""unit": "N"}]"#, r#""unit": "N", "lower": 0}]"#)).0, [Scalar; 2]);
}

#[test]
fn the_example_configuration_compiles() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/effects");
    let mut model = model([0.0, 0.2, 0.0]);
    (model.links[0].name, model.links[1].name) = ("link0".into(), "link1".into());
    let scene = Scene::new(&model, &phi(), &[]);
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let text = std::fs::read_to_string(entry.unwrap().path()).unwrap();
        let effect: FormulaEffect = serde_yaml::from_str(&text).unwrap();
        effect.compile(&scene).unwrap();
        count += 1;
    }
    assert!(count > 3);
}

#[test]
fn drag_written_as_a_formula_has_the_columns_of_the_catalogue() {
    let mut fixture = Fixture::new(true);
    for (link, name) in fixture.scene.model.links.iter_mut().zip(["link0", "link1"]) {
        link.name = name.into();
    }
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/effects");
    let read = |name: &str| -> FormulaEffect {
        serde_yaml::from_str(&std::fs::read_to_string(folder.join(name)).unwrap()).unwrap()
    };
    let (body, links) = (read("air_drag.yaml"), read("my_drag.yaml"));
    let (body, links) = (body.compile(&fixture.scene).unwrap(), links.compile(&fixture.scene).unwrap());
    let drag = effect("quadratic_drag").unwrap();
    let centres = drag.starts(&fixture.scene, Target::EveryLink).remove(0);
    fixture.with(|series| {
        let pairs = [
            (fixture.columns(series, &body, Target::Body, &[]), fixture.columns(series, drag, Target::Body, &[])),
            (
                fixture.columns(series, &links, Target::Body, &[]),
                fixture.columns(series, drag, Target::EveryLink, &centres),
            ),
        ];
        for (own, built_in) in &pairs {
            for i in 0..series.len() {
                let (a, b) = (own.matrix(i), built_in.matrix(i));
                assert!((&a - &b).norm() < 1e-12 * b.norm(), "{a} {b}");
            }
        }
    });
}

#[test]
fn what_is_wrong_outside_of_formulas_is_told_with_its_place() {
    let fixture = Fixture::new(true);
    type Change = fn(&mut FormulaEffect);
    fn constant(name: &str, unit: &str, value: f64) -> FormulaConstant {
        FormulaConstant { name: name.into(), unit: unit.into(), value }
    }
    let cases: [(Change, &str, &str); 12] = [
        (|e| e.id = "tether".into(), "id", "catalogue"),
        (|e| e.delay = Some("late".into()), "delay", "`late` is neither a parameter nor a constant"),
        (|e| e.delay = Some("c".into()), "delay", "`c` is neither a parameter nor a constant"),
        (
            |e| {
                e.constants.push(constant("late", "m", 0.1));
                e.delay = Some("late".into());
            },
            "delay",
            "`late` is 0.1 to 0.1 m; a delay is 0 to 0.4 s",
        ),
        (
            |e| {
                let (name, unit) = ("late".to_owned(), "s".to_owned());
                e.parameters.push(FormulaParameter { name, unit, lower: 0.0, upper: 0.5, start: None });
                e.delay = Some("late".into());
            },
            "delay",
            "`late` is 0 to 0.5 s; a delay is 0 to 0.4 s",
        ),
        (
            |e| e.point.as_mut().unwrap().link = "bse".into(),
            "point.link",
            "there is no link `bse`; there are `base`, `arm`",
        ),
        (|e| e.coefficients[0].unit = "lbf".into(), "coefficients[0].unit", "`lbf` is no SI unit"),
        (|e| e.coefficients[0].upper = Some(-1.0), "coefficients[0].lower", "bounds 0 to -1"),
        (
            |e| {
                e.coefficients.push(FormulaCoefficient { name: "d".into(), unit: "1".into(), lower: None, upper: None })
            },
            "coefficients[1].name",
            "stands in no formula",
        ),
        (|e| e.coefficients[0].name = "speed".into(), "coefficients[0].name", "it is a quantity"),
        (|e| e.point = None, "id", "neither a `point`"),
        (|e| e.constants.push(constant("c", "1", 2.0)), "constants[0].name", "two things"),
    ];
    for (change, at, words) in cases {
        let mut effect = sail();
        change(&mut effect);
        match effect.compile(&fixture.scene) {
            Err(EffectsError::Place { place, problem, .. }) => {
                assert_eq!(place, at, "{problem}");
                assert!(problem.contains(words), "{problem}");
            }
            other => panic!("{at}: {other:?}"),
        }
    }
}

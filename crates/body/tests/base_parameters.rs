//! Number, meaning and completeness of the structural base parameters.
#![allow(clippy::unwrap_used, clippy::panic)] // functions shared by tests may stop them

mod common;

use aloft_body::{BaseParameters, JointKind, Model, ModelSpec, Phi, State};
use common::{Random, close, human};
use nalgebra::{DMatrix, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Rank of base-wrench rows over random motion, columns scaled to unit length.
fn numeric_rank(model: &Model, random: &mut Random) -> (usize, f64) {
    let frames = 4 * model.n_links() + 8;
    let n = 10 * model.n_links();
    let mut stacked = DMatrix::zeros(6 * frames, n);
    let mut rows = DMatrix::zeros(6, n);
    let mut state = State::new(model);
    for frame in 0..frames {
        let (q, v, a) = (random.q(model), random.values(model.nv, 3.0), random.values(model.nv, 10.0));
        state.forward_acceleration(model, &q, &v, &a);
        state.base_wrench_regressor(model, &mut rows);
        stacked.rows_mut(6 * frame, 6).copy_from(&rows);
    }
    for mut column in stacked.column_iter_mut() {
        let norm = column.norm();
        column /= if norm > 0.0 { norm } else { 1.0 };
    }
    let mut sigma: Vec<f64> = stacked.singular_values().iter().copied().collect();
    sigma.sort_by(|a, b| b.total_cmp(a));
    let rank = sigma.iter().filter(|s| **s > 1e-11 * sigma[0]).count();
    let gap = sigma[rank - 1] / sigma.get(rank).copied().unwrap_or(f64::MIN_POSITIVE).max(f64::MIN_POSITIVE);
    (rank, gap)
}

#[test]
fn validate_ranks_of_shipped_models() {
    let two: ModelSpec = serde_yaml::from_str(include_str!("../../../configs/models/two_link.yaml")).unwrap();
    let mut two = Model::from_spec(&two).unwrap();
    two.links[1].joint.parent_from_joint.translation.vector = Vector3::new(0.1, 0.02, -0.03);
    let mut random = Random(1);
    for (model, expected) in [(two, 17), (human(), 128)] {
        assert_eq!(BaseParameters::of(&model).len(), expected);
        let (rank, gap) = numeric_rank(&model, &mut random);
        assert_eq!(rank, expected);
        assert!(gap > 1e3, "clear gap in the singular values: {gap:e}");
    }
}

#[test]
fn validate_ranks_of_random_trees() {
    for seed in 0..60 {
        let mut random = Random(seed);
        let n = 2 + random.below(5);
        let model = random.tree(n);
        let base = BaseParameters::of(&model);
        let (rank, _) = numeric_rank(&model, &mut random);
        let kinds: Vec<JointKind> = model.links.iter().map(|l| l.joint.kind).collect();
        assert_eq!(base.len(), rank, "seed {seed}: {kinds:?}");
    }
}

#[test]
fn validate_chain_truth() {
    // An object of the simulated laboratory: parameters in φ order, the hinge's pose, and the 17
    // base parameters given by its author (MuJoCo and a rank-revealing elimination).
    let mut spec: ModelSpec = serde_yaml::from_str(include_str!("../../../configs/models/two_link.yaml")).unwrap();
    spec.links[1].position_m = [0.0007795128044971894, -0.029984409743910055, 0.011988307307932542];
    let mut model = Model::from_spec(&spec).unwrap();
    let rotation = Matrix3::new(
        -0.019529812951179098,
        0.015594743507992998,
        0.9996876464081228,
        0.9993448009364916,
        -0.030169830709694145,
        0.019993752928162457,
        0.03047220450338252,
        0.9994231262532745,
        -0.014995314696121842,
    );
    model.links[1].joint.parent_from_joint.rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let phi = [
        Phi::from([
            0.612,
            -0.0030791503806684366,
            0.07558241699238663,
            0.0012306872557100257,
            0.01279973682288435,
            0.002293039684332464,
            0.012603811668173568,
            0.00016200618094210445,
            -0.0002457218364598162,
            0.00021365434328373008,
        ]),
        Phi::from([0.385, -0.0362, -0.0028, 0.00308, 0.00065, 0.00575, 0.0061, 0.0001, 0.0003, -0.0002]),
    ];
    let expected = [
        ("M", 0.997),
        ("MCx", 0.0003),
        ("MCy", 0.0641),
        ("MCz", 0.0058),
        ("Jxx", 0.0132),
        ("Jyy", 0.0081),
        ("Jzz", 0.0187),
        ("Jyz", 0.0003),
        ("Jzx", -0.0002),
        ("Jxy", 0.0002),
        ("link1.mcx", -0.0362),
        ("link1.mcy", -0.0028),
        ("link1.Ixx-Iyy", -0.0051),
        ("link1.Izz", 0.0061),
        ("link1.Iyz", 0.0001),
        ("link1.Izx", 0.0003),
        ("link1.Ixy", -0.0002),
    ];
    let base = BaseParameters::of(&model);
    let names: Vec<&str> = base.parameters.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, expected.map(|(name, _)| name));
    close("base parameters", base.regroup(&phi).as_slice(), &expected.map(|(_, value)| value), 1e-14);
}

#[test]
fn regress_formulas_of_the_chain() {
    let spec: ModelSpec = serde_yaml::from_str(include_str!("../../../configs/models/two_link.yaml")).unwrap();
    let base = BaseParameters::of(&Model::from_spec(&spec).unwrap());
    let text: Vec<String> =
        base.parameters.iter().map(|p| format!("{} [{}] = {}", p.name, p.unit, p.formula)).collect();
    let expected = "\
M [kg] = m0 + m1
MCx [kg·m] = mc0x + m1·p1x
MCy [kg·m] = mc0y + m1·p1y
MCz [kg·m] = mc0z + m1·p1z + mc1z
Jxx [kg·m²] = I0xx + m1·(p1y² + p1z²) + 2·mc1z·p1z + I1yy
Jyy [kg·m²] = I0yy + m1·(p1x² + p1z²) + 2·mc1z·p1z + I1yy
Jzz [kg·m²] = I0zz + m1·(p1x² + p1y²)
Jyz [kg·m²] = I0yz − m1·p1y·p1z − mc1z·p1y
Jzx [kg·m²] = I0zx − m1·p1z·p1x − mc1z·p1x
Jxy [kg·m²] = I0xy − m1·p1x·p1y
link1.mcx [kg·m] = mc1x
link1.mcy [kg·m] = mc1y
link1.Ixx-Iyy [kg·m²] = I1xx − I1yy
link1.Izz [kg·m²] = I1zz
link1.Iyz [kg·m²] = I1yz
link1.Izx [kg·m²] = I1zx
link1.Ixy [kg·m²] = I1xy";
    assert_eq!(text.join("\n"), expected);
}

#[test]
fn regress_formulas_of_the_human() {
    let base = BaseParameters::of(&human());
    let formula = |name: &str| base.parameters[base.index(name).unwrap()].formula.clone();
    assert_eq!(formula("M"), "m0 + m1 + m2 + m3 + m4 + m5 + m6 + m7 + m8 + m9 + m10 + m11 + m12 + m13 + m14");
    assert_eq!(
        formula("MCx"),
        "mc0x + M1·p1x + M9·p9x + M12·p12x; M1 = m1 + m2 + m3 + m4 + m5 + m6 + m7 + m8; M9 = m9 + m10 + m11; M12 = m12 + m13 + m14"
    );
    assert_eq!(formula("thigh_r.mcz"), "mc9z + M10·p10z + MC10z; M10 = m10 + m11; MC10z = mc10z + m11·p11z");
    assert_eq!(formula("shank_r.Ixx-Iyy"), "I10xx + m11·(p11y² + p11z²) − I10yy − m11·(p11x² + p11z²)");
    assert_eq!(formula("foot_l.Izx"), "I14zx");
}

#[test]
fn regress_formulas_of_every_joint() {
    let spec: ModelSpec = serde_yaml::from_str(
        "name: odd
links:
  - {name: a, joint: free}
  - {name: slider, parent: a, joint: prismatic_x, position_m: [1, 2, 3]}
  - {name: skew, parent: slider, joint: {revolute: [0, 0.6, 0.8]}, rpy_rad: [0.1, 0, 0]}
  - {name: bolt, parent: skew, joint: fixed, rpy_rad: [0, 0, 0.5]}
  - {name: plate, parent: a, joint: fixed}",
    )
    .unwrap();
    let base = BaseParameters::of(&Model::from_spec(&spec).unwrap());
    let formula = |name: &str| base.parameters[base.index(name).unwrap()].formula.clone();
    assert_eq!(formula("slider.m"), "m1 + m2 + m3");
    assert_eq!(
        formula("slider.mcy"),
        "mc1y + M2·p2y + MC2z'·a2y; M2 = m2 + m3; MC2z': of link 2 with what link 3 gives"
    );
    assert_eq!(
        formula("skew.Ixx'-Iyy'"),
        "J2xx' − J2yy'; J2xx': of link 2 with what link 3 gives; J2yy': of link 2 with what link 3 gives; \
         x' = (1.0000, 0.0000, 0.0000), y' = (0.0000, 0.8000, -0.6000), z' = (0.0000, 0.6000, 0.8000)"
    );
    assert_eq!(formula("MCx"), "mc0x + M1·p1x + m4·p4x + mc4x; M1 = m1 + m2 + m3");
}

/// Parses and evaluates a formula: sums of products of symbols, numbers, brackets and squares.
struct Reader<'a> {
    text: Vec<char>,
    at: usize,
    value_of: &'a dyn Fn(&str) -> f64,
}

impl Reader<'_> {
    fn peek(&mut self) -> Option<char> {
        while self.text.get(self.at) == Some(&' ') {
            self.at += 1;
        }
        self.text.get(self.at).copied()
    }
    fn sum(&mut self) -> f64 {
        let mut total = 0.0;
        loop {
            let sign = match self.peek() {
                Some('−') => {
                    self.at += 1;
                    -1.0
                }
                Some('+') => {
                    self.at += 1;
                    1.0
                }
                Some(')') | None => return total,
                Some(_) => 1.0,
            };
            total += sign * self.product();
        }
    }
    fn product(&mut self) -> f64 {
        let mut value = self.factor();
        while self.peek() == Some('·') {
            self.at += 1;
            value *= self.factor();
        }
        value
    }
    fn factor(&mut self) -> f64 {
        let mut value = if self.peek() == Some('(') {
            self.at += 1;
            let inner = self.sum();
            assert_eq!(self.peek(), Some(')'));
            self.at += 1;
            inner
        } else {
            let start = self.at;
            while self.text.get(self.at).is_some_and(char::is_ascii_alphanumeric) {
                self.at += 1;
            }
            let word: String = self.text[start..self.at].iter().collect();
            word.parse().unwrap_or_else(|_| (self.value_of)(&word))
        };
        if self.text.get(self.at) == Some(&'²') {
            self.at += 1;
            value *= value;
        }
        value
    }
}

/// The value of a symbol: a link's own parameter, a joint's position or axis, or a symbol defined
/// in the rest of the formula.
fn symbol(word: &str, model: &Model, phi: &[Phi], definitions: &[(&str, &str)]) -> f64 {
    if let Some((_, text)) = definitions.iter().find(|(name, _)| *name == word) {
        return evaluate(text, model, phi, definitions);
    }
    let letters = word.find(|c: char| c.is_ascii_digit()).unwrap();
    let digits = word[letters..].find(|c: char| !c.is_ascii_digit()).map_or(word.len(), |n| n + letters);
    let (kind, link, part) = (&word[..letters], word[letters..digits].parse::<usize>().unwrap(), &word[digits..]);
    let xyz = |part: &str| ["x", "y", "z"].iter().position(|x| *x == part).unwrap();
    let joint = &model.links[link].joint;
    match kind {
        "m" => phi[link][0],
        "mc" => phi[link][1 + xyz(part)],
        "I" => phi[link][4 + ["xx", "yy", "zz", "yz", "zx", "xy"].iter().position(|x| *x == part).unwrap()],
        "p" => joint.parent_from_joint.translation.vector[xyz(part)],
        "a" => match joint.kind {
            // The sign of a hinge's axis does not affect its contribution.
            JointKind::Revolute(axis) => (joint.parent_from_joint.rotation * axis.map(f64::abs))[xyz(part)],
            _ => panic!("axis of {word}"),
        },
        _ => panic!("unknown symbol {word}"),
    }
}

fn evaluate(text: &str, model: &Model, phi: &[Phi], definitions: &[(&str, &str)]) -> f64 {
    let value_of = |word: &str| symbol(word, model, phi, definitions);
    Reader { text: text.chars().collect(), at: 0, value_of: &value_of }.sum()
}

#[test]
fn formulas_say_what_is_computed() {
    let mut models = vec![human()];
    for seed in 0..200 {
        let mut random = Random(seed);
        let n = 2 + random.below(6);
        let mut model = random.tree(n);
        for link in &mut model.links {
            match &mut link.joint.kind {
                // Only axes x, y, z are written out element by element.
                JointKind::Revolute(axis) if axis.iter().filter(|x| **x != 0.0).count() > 1 => {
                    *axis = Vector3::x_axis();
                }
                JointKind::Fixed | JointKind::Prismatic(_) => {
                    link.joint.parent_from_joint.rotation = UnitQuaternion::identity();
                }
                _ => {}
            }
        }
        models.push(model);
    }
    for model in models {
        let phi = Random(9).phi(&model);
        let base = BaseParameters::of(&model);
        let values = base.regroup(&phi);
        for (parameter, value) in base.parameters.iter().zip(values.iter()) {
            let mut parts = parameter.formula.split("; ");
            let text = parts.next().unwrap();
            let definitions: Vec<(&str, &str)> = parts.filter_map(|part| part.split_once(" = ")).collect();
            let found = evaluate(text, &model, &phi, &definitions);
            assert!((found - value).abs() < 1e-12, "{} = {}: {found} {value}", parameter.name, parameter.formula);
        }
    }
}

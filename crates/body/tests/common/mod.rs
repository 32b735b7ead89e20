//! Random trees, bodies and motions, reproducible from a seed.
#![allow(dead_code)] // each test binary uses a part

use aloft_body::{JointSpec, LinkInertia, LinkSpec, Model, ModelSpec, Phi};
use nalgebra::{Matrix3, Vector3};

/// SplitMix64: sufficient for test inputs.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
    /// Uniform in (−scale, scale).
    pub fn symmetric(&mut self, scale: f64) -> f64 {
        ((self.next() >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0) * scale
    }
    pub fn vector(&mut self, scale: f64) -> Vector3<f64> {
        Vector3::new(self.symmetric(scale), self.symmetric(scale), self.symmetric(scale))
    }
    pub fn values(&mut self, n: usize, scale: f64) -> Vec<f64> {
        (0..n).map(|_| self.symmetric(scale)).collect()
    }
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    pub fn joint(&mut self) -> JointSpec {
        match self.below(10) {
            0 | 1 => JointSpec::Spherical,
            2 => JointSpec::Fixed,
            3 => JointSpec::RevoluteZ,
            4 => JointSpec::Revolute([1.0, 0.0, 0.0]),
            5 => JointSpec::Revolute([0.0, -1.0, 0.0]),
            6 | 7 => JointSpec::Revolute(self.vector(1.0).into()),
            8 => JointSpec::Prismatic([0.0, 1.0, 0.0]),
            _ => JointSpec::Prismatic(self.vector(1.0).into()),
        }
    }

    /// A tree of `n` links; half of the joint placements are without rotation, so that consecutive
    /// parallel axes occur.
    pub fn tree(&mut self, n: usize) -> Model {
        let links = (0..n)
            .map(|i| LinkSpec {
                name: format!("l{i}"),
                parent: (i > 0).then(|| format!("l{}", self.below(i))),
                joint: if i == 0 { JointSpec::Free } else { self.joint() },
                position_m: if i == 0 || self.below(5) == 0 { [0.0; 3] } else { self.vector(0.4).into() },
                rpy_rad: if i == 0 || self.below(2) == 0 { [0.0; 3] } else { self.vector(1.4).into() },
                inertia: None,
            })
            .collect();
        Model::from_spec(&ModelSpec::new("random".into(), links)).unwrap()
    }

    /// A body with positive density.
    pub fn inertia(&mut self) -> LinkInertia {
        let mass = 0.5 + self.symmetric(0.4);
        let a = Matrix3::from_fn(|_, _| self.symmetric(0.2));
        let sigma = (a * a.transpose() + Matrix3::from_diagonal_element(1e-3)) * mass;
        LinkInertia {
            mass_kg: mass,
            com_m: self.vector(0.2),
            inertia_com_kgm2: Matrix3::from_diagonal_element(sigma.trace()) - sigma,
        }
    }
    pub fn phi(&mut self, model: &Model) -> Vec<Phi> {
        (0..model.n_links()).map(|_| self.inertia().to_phi()).collect()
    }
    pub fn q(&mut self, model: &Model) -> Vec<f64> {
        let dv = self.values(model.nv, 1.8);
        let mut q = model.neutral();
        model.integrate(&model.neutral(), &dv, &mut q);
        q
    }
}

pub fn close(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}: number of values");
    let scale = expected.iter().fold(1e-3f64, |m, x| m.max(x.abs()));
    for (k, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!((f - e).abs() <= tolerance * scale, "{what}[{k}]: found {f:e}, expected {e:e} (scale {scale:e})");
    }
}

pub fn human() -> Model {
    let spec: ModelSpec = serde_yaml::from_str(include_str!("../../../../configs/models/human34.yaml")).unwrap();
    let mut model = Model::from_spec(&spec).unwrap();
    let mut random = Random(34);
    for link in model.links.iter_mut().skip(1) {
        link.joint.parent_from_joint.translation.vector = random.vector(0.4);
    }
    model
}

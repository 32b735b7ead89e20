//! Random draws: one ChaCha stream for each purpose, so that a change in one does not affect the
//! others.

use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// A stream of random numbers.
#[derive(Debug, Clone)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// The stream of `purpose` (for example `jump01/noise`) under a seed.
    pub fn new(seed: u64, purpose: &str) -> Self {
        // FNV-1a over the purpose, combined with the seed: distinct keys give independent ChaCha
        // streams
        let hash =
            purpose.bytes().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        let mut key = [0u8; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..16].copy_from_slice(&hash.to_le_bytes());
        Self(ChaCha8Rng::from_seed(key))
    }

    /// Uniform between two values.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }
    /// Uniform integer, both ends included.
    pub fn whole(&mut self, low: usize, high: usize) -> usize {
        low + ((self.0.random::<f64>() * (high.max(low) - low + 1) as f64) as usize).min(high.max(low) - low)
    }
    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }
    /// Normal, truncated at two and a half standard deviations.
    pub(crate) fn moderate(&mut self) -> f64 {
        loop {
            let x = self.normal();
            if x.abs() < 2.5 {
                return x;
            }
        }
    }
    /// Three truncated normals.
    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.moderate(), self.moderate(), self.moderate())
    }
    /// Three standard normals.
    pub fn noise(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }
    /// A direction, uniform on the sphere.
    pub fn direction(&mut self) -> Vector3<f64> {
        loop {
            let v = self.noise();
            if v.norm() > 1e-3 {
                return v.normalize();
            }
        }
    }
    /// A rotation, uniform over SO(3).
    pub fn rotation(&mut self) -> UnitQuaternion<f64> {
        loop {
            let q = nalgebra::Quaternion::new(self.normal(), self.normal(), self.normal(), self.normal());
            if q.norm() > 1e-3 {
                return UnitQuaternion::from_quaternion(q);
            }
        }
    }
    /// A phase, 0 to 2π.
    pub fn phase(&mut self) -> f64 {
        self.between(0.0, std::f64::consts::TAU)
    }
    /// Plus or minus one.
    pub fn sign(&mut self) -> f64 {
        if self.0.random::<bool>() { 1.0 } else { -1.0 }
    }
}

//! Columns of unit wrenches over the frames of a series.

use nalgebra::{DMatrix, Vector3};

/// Unit vector along axis `k`.
pub(crate) fn axis(k: usize) -> Vector3<f64> {
    Vector3::ith(k, 1.0)
}

/// 6 × k numbers per frame: world force (N per unit of the coefficient) and moment about the world
/// origin (N·m per unit).
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// Number of coefficients.
    pub k: usize,
    /// Number of frames.
    pub n: usize,
    data: Vec<f64>,
}

impl Columns {
    /// Columns of zeros.
    pub fn zeros(n: usize, k: usize) -> Self {
        Self { k, n, data: vec![0.0; 6 * n * k] }
    }
    /// Sets everything to zero.
    pub fn clear(&mut self) {
        self.data.fill(0.0);
    }
    /// The six numbers of a column in a frame.
    pub fn wrench(&self, frame: usize, column: usize) -> &[f64] {
        let at = 6 * (frame * self.k + column);
        &self.data[at..at + 6]
    }
    /// Force of a column in a frame.
    pub fn force(&self, frame: usize, column: usize) -> Vector3<f64> {
        Vector3::from_column_slice(&self.wrench(frame, column)[..3])
    }
    /// Moment about the world origin of a column in a frame.
    pub fn moment(&self, frame: usize, column: usize) -> Vector3<f64> {
        Vector3::from_column_slice(&self.wrench(frame, column)[3..])
    }
    /// Adds a wrench.
    pub fn add(&mut self, frame: usize, column: usize, force: &Vector3<f64>, moment_about_origin: &Vector3<f64>) {
        let at = 6 * (frame * self.k + column);
        let out = &mut self.data[at..at + 6];
        for axis in 0..3 {
            out[axis] += force[axis];
            out[3 + axis] += moment_about_origin[axis];
        }
    }
    /// Adds a force acting at a point in the world.
    pub fn force_at(&mut self, frame: usize, column: usize, force: &Vector3<f64>, point: &Vector3<f64>) {
        self.add(frame, column, force, &point.cross(force));
    }
    /// Adds a free moment.
    pub fn couple(&mut self, frame: usize, column: usize, moment: &Vector3<f64>) {
        self.add(frame, column, &Vector3::zeros(), moment);
    }
    /// The 6 × k matrix of a frame.
    pub fn matrix(&self, frame: usize) -> DMatrix<f64> {
        DMatrix::from_column_slice(6, self.k, &self.data[6 * frame * self.k..6 * (frame + 1) * self.k])
    }
}

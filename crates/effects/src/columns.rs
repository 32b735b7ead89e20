//! Columns of unit wrenches over the frames of a series.

use nalgebra::{DMatrix, Vector3};

/// Unit vector along axis `k`.
pub(crate) fn axis(k: usize) -> Vector3<f64> {
    Vector3::ith(k, 1.0)
}

/// A force or a free moment as an effect applied it, for drawing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Applied {
    /// Index of the frame in the series.
    pub frame: usize,
    /// Index of the coefficient.
    pub column: usize,
    /// Point of the world where the force acts, m; none for a free moment and for a wrench that is
    /// given about the world origin.
    pub at_m: Option<Vector3<f64>>,
    /// Force (N per unit), or free moment (N·m per unit) where there is no point.
    pub vector: Vector3<f64>,
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
    /// Forces and free moments in the order in which they were applied; none where nobody asked.
    applied: Option<Vec<Applied>>,
}

impl Columns {
    /// Columns of zeros.
    pub fn zeros(n: usize, k: usize) -> Self {
        Self { k, n, data: vec![0.0; 6 * n * k], applied: None }
    }
    /// Columns of zeros that also keep where each force acts.
    pub fn recording(n: usize, k: usize) -> Self {
        Self { applied: Some(Vec::new()), ..Self::zeros(n, k) }
    }
    /// Forces and free moments as they were applied; empty unless made by [`Columns::recording`].
    pub fn applied(&self) -> &[Applied] {
        self.applied.as_deref().unwrap_or_default()
    }
    /// Makes this as [`Columns::zeros`] does, in the memory that it has.
    pub fn reset(&mut self, n: usize, k: usize) {
        self.data.clear();
        self.data.resize(6 * n * k, 0.0);
        (self.n, self.k) = (n, k);
        self.applied.iter_mut().for_each(Vec::clear);
    }
    /// Sets everything to zero.
    pub fn clear(&mut self) {
        self.data.fill(0.0);
        self.applied.iter_mut().for_each(Vec::clear);
    }
    /// The six numbers of a column in a frame.
    #[inline]
    pub fn wrench(&self, frame: usize, column: usize) -> &[f64] {
        let at = 6 * (frame * self.k + column);
        &self.data[at..at + 6]
    }
    /// The six numbers of every column in a frame.
    #[inline]
    pub fn wrenches(&self, frame: usize) -> &[[f64; 6]] {
        self.data[6 * frame * self.k..6 * (frame + 1) * self.k].as_chunks().0
    }
    /// Force of a column in a frame.
    #[inline]
    pub fn force(&self, frame: usize, column: usize) -> Vector3<f64> {
        Vector3::from_column_slice(&self.wrench(frame, column)[..3])
    }
    /// Moment about the world origin of a column in a frame.
    #[inline]
    pub fn moment(&self, frame: usize, column: usize) -> Vector3<f64> {
        Vector3::from_column_slice(&self.wrench(frame, column)[3..])
    }
    /// Adds a wrench.
    #[inline]
    pub fn add(&mut self, frame: usize, column: usize, force: &Vector3<f64>, moment_about_origin: &Vector3<f64>) {
        let at = 6 * (frame * self.k + column);
        let out = &mut self.data[at..at + 6];
        for axis in 0..3 {
            out[axis] += force[axis];
            out[3 + axis] += moment_about_origin[axis];
        }
    }
    /// Adds a force acting at a point in the world.
    #[inline]
    pub fn force_at(&mut self, frame: usize, column: usize, force: &Vector3<f64>, point: &Vector3<f64>) {
        self.add(frame, column, force, &point.cross(force));
        self.keep(Applied { frame, column, at_m: Some(*point), vector: *force });
    }
    /// Adds a free moment.
    #[inline]
    pub fn couple(&mut self, frame: usize, column: usize, moment: &Vector3<f64>) {
        self.add(frame, column, &Vector3::zeros(), moment);
        self.keep(Applied { frame, column, at_m: None, vector: *moment });
    }
    #[inline]
    fn keep(&mut self, applied: Applied) {
        if let Some(list) = &mut self.applied {
            list.push(applied);
        }
    }
    /// The 6 × k matrix of a frame.
    pub fn matrix(&self, frame: usize) -> DMatrix<f64> {
        DMatrix::from_column_slice(6, self.k, &self.data[6 * frame * self.k..6 * (frame + 1) * self.k])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_applied_adds_up_to_the_columns() {
        let mut columns = Columns::recording(2, 1);
        let (force, at) = (Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.0, 1.0, 0.5));
        columns.force_at(1, 0, &force, &at);
        columns.couple(1, 0, &Vector3::z());
        let moment = columns
            .applied()
            .iter()
            .fold(Vector3::zeros(), |sum: Vector3<f64>, a| sum + a.at_m.map_or(a.vector, |p| p.cross(&a.vector)));
        assert_eq!((columns.force(1, 0), columns.moment(1, 0)), (force, moment));
        assert!(Columns::zeros(2, 1).applied().is_empty());
        columns.clear();
        assert!(columns.applied().is_empty());
    }
}

//! Motion and torque of one joint, from which effects of joints form their columns.

/// Rate below which the sign of a joint's motion is not sure, rad/s or m/s.
pub const SURE_OF_SIGN: f64 = 0.05;

/// One joint over the frames of a flight.
#[derive(Debug, Clone, Copy)]
pub struct JointSeries<'a> {
    /// Frames per second.
    pub rate_hz: f64,
    /// Coordinate, rad or m.
    pub q: &'a [f64],
    /// Rate, rad/s or m/s.
    pub v: &'a [f64],
    /// Measured torque at the motor's side, N·m or N.
    pub torque: &'a [f64],
}

impl JointSeries<'_> {
    /// Direction of the motion, −1 to 1, smooth within [`SURE_OF_SIGN`] of rest.
    pub(crate) fn directions(&self) -> impl Iterator<Item = f64> + '_ {
        self.v.iter().map(|v| (v / SURE_OF_SIGN).tanh())
    }

    /// A column from coordinate and rate.
    pub(crate) fn column(&self, of: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        self.q.iter().zip(self.v).map(|(q, v)| of(*q, *v)).collect()
    }
}

//! The classical Runge-Kutta step of fourth order for systems whose right-hand side may fail.

/// Workspace of the integrator for one length of state.
#[derive(Debug, Clone, Default)]
pub struct Rk4 {
    k: [Vec<f64>; 4],
    stage: Vec<f64>,
}

impl Rk4 {
    /// Workspace for states of length `n`.
    pub fn new(n: usize) -> Self {
        Self { k: std::array::from_fn(|_| vec![0.0; n]), stage: vec![0.0; n] }
    }

    /// Advances `y` from `t` to `t + h` under `rate(t, y, dy)`. Local error of fifth order in `h`.
    pub fn step<E>(
        &mut self,
        t: f64,
        h: f64,
        y: &mut [f64],
        mut rate: impl FnMut(f64, &[f64], &mut [f64]) -> Result<(), E>,
    ) -> Result<(), E> {
        rate(t, y, &mut self.k[0])?;
        for (i, (fraction, time)) in [(0.5, 0.5), (0.5, 0.5), (1.0, 1.0)].into_iter().enumerate() {
            for (s, (x, k)) in self.stage.iter_mut().zip(y.iter().zip(&self.k[i])) {
                *s = x + fraction * h * k;
            }
            rate(t + time * h, &self.stage, &mut self.k[i + 1])?;
        }
        let [k0, k1, k2, k3] = &self.k;
        for (i, x) in y.iter_mut().enumerate() {
            *x += h / 6.0 * (k0[i] + 2.0 * (k1[i] + k2[i]) + k3[i]);
        }
        Ok(())
    }
}

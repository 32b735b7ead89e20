//! Shades of maps: what a value means, in nine steps.

/// How values become shades.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Scale {
    /// From 0 to the largest value, in equal steps.
    #[default]
    ToLargest,
    /// From 0 to this value, in equal steps.
    To(f64),
    /// Multiples of a noise floor: no shade up to 1.25 times the floor, the darkest from 16 times
    /// on, in equal ratios between. What has no shade needs no explanation.
    TimesFloor,
}

/// Number of shades, the first one clear.
pub(crate) const SHADES: usize = 9;
/// Multiples of the floor at which each shade begins, the clear one excepted.
const FLOORS: [f64; SHADES - 1] = [1.25, 1.75, 2.5, 3.5, 5.0, 7.0, 10.0, 16.0];

impl Scale {
    /// Shade of a value, 0 (clear) to 8; `largest` is the largest value of the map. None if the
    /// value is missing.
    pub fn shade(self, value: f64, largest: f64) -> Option<usize> {
        if !value.is_finite() {
            return None;
        }
        let even = |top: f64| {
            let share = if top > 0.0 { (value / top).clamp(0.0, 1.0) } else { 0.0 };
            ((share * SHADES as f64) as usize).min(SHADES - 1)
        };
        Some(match self {
            Self::ToLargest => even(largest),
            Self::To(top) => even(top),
            Self::TimesFloor => FLOORS.iter().filter(|f| value >= **f).count(),
        })
    }

    /// Limits shown in the legend: text at the first and at the last shade.
    pub(crate) fn ends(self, largest: f64) -> [String; 2] {
        let end = |v: f64| super::html::short(v);
        match self {
            Self::ToLargest => ["0".into(), end(largest)],
            Self::To(top) => ["0".into(), end(top)],
            Self::TimesFloor => ["at the floor".into(), "16 times the floor".into()],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_at_the_floor_has_no_shade() {
        let at = |v: f64| Scale::TimesFloor.shade(v, f64::NAN);
        assert_eq!(
            [at(0.4), at(1.2), at(1.3), at(4.4), at(116.0), at(f64::NAN)],
            [Some(0), Some(0), Some(1), Some(4), Some(8), None]
        );
    }

    #[test]
    fn equal_steps_end_at_the_largest() {
        assert_eq!(Scale::ToLargest.shade(2.5, 2.5), Some(8));
        assert_eq!(Scale::ToLargest.shade(0.0, 0.0), Some(0));
        assert_eq!(Scale::To(1.0).shade(0.5, 0.5), Some(4));
    }
}

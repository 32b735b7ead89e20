//! Ratios of errors that count as evidence.

use crate::options::DiscoverOptions;
use crate::result::MANY_CLUSTERS;
use aloft_effects::{Effect, Family};

/// Errors whose ratio is above this count as equal: rigid bodies, and people, whose soft tissue
/// repeats.
pub(crate) const SAME: [f64; 2] = [0.98, 0.96];

/// Largest share of the error that an effect on a rigid body may leave, however many flights there
/// are; one that gains less would be dropped again beside others.
pub(crate) const SMALLEST: f64 = 0.97;

/// Largest ratio at which an effect can be accepted.
pub(crate) fn limit(effect: &dyn Effect, first_round: bool, options: &DiscoverOptions) -> f64 {
    match effect.about().family {
        Family::Kinematics if first_round => options.belief_kinematics,
        Family::Kinematics => 0.0,
        Family::Plates => options.belief_plates,
        Family::Forces | Family::Joints => options.belief,
    }
}

/// Largest ratio accepted with this number of flights or trials: with few of them only a strong
/// effect is accepted.
pub(crate) fn limit_by_number(clusters: usize, options: &DiscoverOptions) -> f64 {
    match clusters {
        0..5 => options.belief.min(0.80),
        5..MANY_CLUSTERS => options.belief.min(0.85),
        _ => options.belief,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Kinematic errors of the catalogue are named in a first round only; plate errors have a limit
    /// of their own.
    #[test]
    fn belief_has_a_limit_for_each_family() {
        let options = DiscoverOptions::default();
        let mut seen = [0; 4];
        for effect in aloft_effects::EFFECTS {
            let found = [true, false].map(|first| limit(*effect, first, &options));
            let (family, expected) = match effect.about().family {
                Family::Forces => (0, [options.belief; 2]),
                Family::Kinematics => (1, [options.belief_kinematics, 0.0]),
                Family::Plates => (2, [options.belief_plates; 2]),
                Family::Joints => (3, [options.belief; 2]),
            };
            assert_eq!(found, expected, "{}", effect.id());
            seen[family] += 1;
        }
        assert!(seen.iter().all(|n| *n > 0), "{seen:?}");
    }
}

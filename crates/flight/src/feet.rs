//! Feet on the ground and the plates below them, from markers alone.

use crate::FrameWrench;
use aloft_body::Subject;
use aloft_signal::{quantile_of_sorted, runs_where};
use aloft_trial::Trial;
use nalgebra::{Vector2, Vector3};
use std::ops::Range;

/// A link whose markers come this close to the floor is a foot (or a hand on the ground), m.
const NEAR_FLOOR_M: f64 = 0.15;
/// A foot is down while one of its markers is less than this above its lowest level, m …
const LOW_M: f64 = 0.025;
/// … and slower than this, m/s.
const SLOW_MPS: f64 = 0.4;
/// Distance from a plate at which a marker no longer belongs to a foot on its edge, m: markers sit
/// a centimetre or two beyond the sole.
const EDGE_M: f64 = 0.03;
/// Distance of the centre of pressure from a foot's markers within which it lies under the foot, m.
const UNDER_M: f64 = 0.12;
/// Shortest time on the ground that counts, s.
const SHORTEST_S: f64 = 0.04;

/// Markers of one foot.
struct Foot {
    /// Indices into the trajectories.
    markers: Vec<usize>,
    /// Lowest level of each marker, m.
    level_m: Vec<f64>,
}

/// The feet of a recording and the plates' places.
pub(crate) struct Feet<'a> {
    trial: &'a Trial,
    feet: Vec<Foot>,
    /// Height of the floor, m.
    floor_m: f64,
    /// Corners of each plate in the horizontal plane, m; empty where they are unknown.
    plates: Vec<Vec<Vector2<f64>>>,
}

/// Frames in which a foot is down and no plate is known to carry it.
pub(crate) struct Beside {
    pub frames: Range<usize>,
    /// True where the foot clearly stands outside of plates of known place.
    pub clear: bool,
}

impl<'a> Feet<'a> {
    /// Finds the feet: links with markers that come near the floor.
    pub fn of(trial: &'a Trial, subject: &Subject) -> Self {
        let level = |track: &[Vector3<f64>]| {
            let mut z: Vec<f64> = track.iter().map(|p| p.z).filter(|z| z.is_finite()).collect();
            z.sort_by(f64::total_cmp);
            quantile_of_sorted(&z, 5, 100)
        };
        let seen: Vec<(usize, usize, f64)> = subject
            .markers
            .iter()
            .filter_map(|m| {
                let index = trial.markers.index(&m.label)?;
                Some((m.link, index, level(&trial.markers.trajectories[index])?))
            })
            .collect();
        let corners: Vec<f64> = trial.plates.iter().flat_map(|p| p.corners_m.iter().map(|c| c.z)).collect();
        let floor_m = if corners.is_empty() {
            seen.iter().map(|s| s.2).fold(f64::INFINITY, f64::min).min(NEAR_FLOOR_M)
        } else {
            corners.iter().sum::<f64>() / corners.len() as f64
        };
        let mut links: Vec<usize> =
            seen.iter().filter(|s| s.2 < floor_m + NEAR_FLOOR_M && s.2 > floor_m - 0.1).map(|s| s.0).collect();
        links.sort_unstable();
        links.dedup();
        let feet = links
            .into_iter()
            .map(|link| {
                let of = |s: &&(usize, usize, f64)| s.0 == link && s.2 < floor_m + NEAR_FLOOR_M;
                let own: Vec<&(usize, usize, f64)> = seen.iter().filter(of).collect();
                Foot { markers: own.iter().map(|s| s.1).collect(), level_m: own.iter().map(|s| s.2).collect() }
            })
            .collect();
        let flat = |p: &Vector3<f64>| Vector2::new(p.x, p.y);
        let plates = trial.plates.iter().map(|p| p.corners_m.iter().map(flat).collect()).collect();
        Self { trial, feet, floor_m, plates }
    }

    /// Number of feet.
    pub fn len(&self) -> usize {
        self.feet.len()
    }

    /// Markers of a foot that are seen in a frame, with their height over their lowest level.
    fn seen(&self, foot: usize, frame: usize) -> impl Iterator<Item = (Vector3<f64>, f64, usize)> + '_ {
        let foot = &self.feet[foot];
        foot.markers
            .iter()
            .zip(&foot.level_m)
            .filter_map(move |(&m, level)| self.trial.markers.position(m, frame).map(|p| (p, p.z - level, m)))
    }

    fn is_down(&self, foot: usize, frame: usize) -> bool {
        let step = ((0.01 * self.trial.markers.rate_hz).round() as usize).max(1);
        let slow = |m: usize| {
            let (from, to) = (frame.saturating_sub(step), (frame + step).min(self.trial.markers.n_frames - 1));
            match (self.trial.markers.position(m, from), self.trial.markers.position(m, to)) {
                (Some(a), Some(b)) if to > from => {
                    (b - a).norm() * self.trial.markers.rate_hz / ((to - from) as f64) < SLOW_MPS
                }
                _ => false,
            }
        };
        self.seen(foot, frame).any(|(_, height, m)| height < LOW_M && slow(m))
    }

    /// Shares of the foot's low markers inside the plates: none where a corner is unknown.
    fn inside(&self, foot: usize, frame: usize) -> Option<f64> {
        if self.plates.iter().any(|p| p.len() < 3) {
            return None;
        }
        let (mut inside, mut all) = (0.0, 0.0);
        for (p, height, _) in self.seen(foot, frame) {
            if height < 2.0 * LOW_M {
                all += 1.0;
                let at = Vector2::new(p.x, p.y);
                if self.plates.iter().any(|plate| distance_to_polygon(&at, plate) < EDGE_M) {
                    inside += 1.0;
                }
            }
        }
        (all > 0.0).then(|| inside / all)
    }

    /// Distance of a point on the floor from a foot: from the nearest line between two of its
    /// markers, m.
    fn distance(&self, foot: usize, frame: usize, at: &Vector2<f64>) -> f64 {
        let seen: Vec<Vector2<f64>> = self.seen(foot, frame).map(|(p, ..)| Vector2::new(p.x, p.y)).collect();
        let pairs = seen.iter().enumerate().flat_map(|(i, a)| seen[i..].iter().map(move |b| (a, b)));
        pairs.map(|(a, b)| distance_to_segment(at, a, b)).fold(f64::INFINITY, f64::min)
    }

    /// Stretches in which the foot is down and no plate is known to carry it.
    pub fn beside(&self, foot: usize, plates: &[FrameWrench], threshold_n: f64) -> Vec<Beside> {
        let n = self.trial.markers.n_frames;
        // none: up or on a plate; some(true): clearly outside of all plates
        let state: Vec<Option<bool>> = (0..n)
            .map(|frame| {
                if !self.is_down(foot, frame) {
                    return None;
                }
                let inside = self.inside(foot, frame);
                if inside == Some(1.0) {
                    return None;
                }
                let pressed: Vec<Vector2<f64>> =
                    plates.iter().filter_map(|p| centre_of_pressure(p, frame, self.floor_m, threshold_n)).collect();
                let under = |foot: usize| pressed.iter().any(|c| self.distance(foot, frame, c) < UNDER_M);
                if under(foot) {
                    return None;
                }
                // a plate that both feet share has its centre of pressure between them
                let between = inside.is_none()
                    && pressed.iter().any(|c| (0..self.len()).all(|o| self.distance(o, frame, c) >= UNDER_M));
                (!between).then_some(inside == Some(0.0))
            })
            .collect();
        runs_where(n, |f| state[f].is_some())
            .into_iter()
            .filter(|r| r.len() as f64 >= SHORTEST_S * self.trial.markers.rate_hz)
            .map(|frames| {
                let outside = frames.clone().filter(|&f| state[f] == Some(true)).count();
                Beside { clear: 2 * outside > frames.len(), frames }
            })
            .collect()
    }
}

/// Centre of pressure of a plate in the plane of the floor; none below the threshold.
fn centre_of_pressure(plate: &FrameWrench, frame: usize, floor_m: f64, threshold_n: f64) -> Option<Vector2<f64>> {
    let (force, moment) = (plate.force_n.get(frame)?, plate.moment_nm.get(frame)?);
    (force.z > threshold_n && moment.iter().all(|x| x.is_finite()))
        .then(|| Vector2::new((floor_m * force.x - moment.y) / force.z, (moment.x + floor_m * force.y) / force.z))
}

fn distance_to_segment(at: &Vector2<f64>, a: &Vector2<f64>, b: &Vector2<f64>) -> f64 {
    let along = b - a;
    let length = along.norm_squared();
    let t = if length > 0.0 { ((at - a).dot(&along) / length).clamp(0.0, 1.0) } else { 0.0 };
    (at - (a + along * t)).norm()
}

/// Distance of a point from a convex polygon, 0 inside.
fn distance_to_polygon(at: &Vector2<f64>, corners: &[Vector2<f64>]) -> f64 {
    let n = corners.len();
    let side = |i: usize| {
        let (a, b) = (&corners[i], &corners[(i + 1) % n]);
        (b - a).perp(&(at - a))
    };
    let first = side(0).signum();
    if (1..n).all(|i| side(i).signum() == first) {
        return 0.0;
    }
    (0..n).map(|i| distance_to_segment(at, &corners[i], &corners[(i + 1) % n])).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_in_the_plane() {
        let square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| Vector2::new(x, y));
        assert_eq!(distance_to_polygon(&Vector2::new(0.5, 0.5), &square), 0.0);
        assert!((distance_to_polygon(&Vector2::new(1.3, 0.5), &square) - 0.3).abs() < 1e-12);
        assert!((distance_to_polygon(&Vector2::new(1.3, 1.4), &square) - 0.5).abs() < 1e-12);
        let back: Vec<Vector2<f64>> = square.iter().rev().copied().collect();
        assert_eq!(distance_to_polygon(&Vector2::new(0.1, 0.9), &back), 0.0);
    }

    #[test]
    fn a_force_at_a_place_has_its_centre_of_pressure_there() {
        let (force, at) = (Vector3::new(30.0, -20.0, 700.0), Vector3::new(0.4, -0.2, 0.05));
        let plate = FrameWrench { plate: "FP1".into(), force_n: vec![force], moment_nm: vec![at.cross(&force)] };
        let found = centre_of_pressure(&plate, 0, 0.05, 20.0);
        assert!(found.is_some_and(|c| (c - Vector2::new(0.4, -0.2)).norm() < 1e-12), "{found:?}");
        assert!(centre_of_pressure(&plate, 0, 0.05, 800.0).is_none());
    }
}

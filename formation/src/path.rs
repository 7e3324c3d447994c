//! A path through waypoints, driven at constant speed: two circular arcs (a biarc) between consecutive
//! waypoints.
//!
//! At each waypoint the change of direction from one leg to the next is divided between both legs, and the
//! shorter leg bends more. Between two waypoints at distance L the path leaves at the angle a from the chord
//! and arrives at the angle b. The two arcs meet in the direction -(a + b)/2 from the chord, and each of their
//! chords is L / (2 cos((b - a)/4)) long. The path passes through every waypoint, its direction is continuous,
//! its length is exact, and a unicycle drives it with piecewise constant (v, w). Its curvature is discontinuous
//! where arcs meet.

use std::f64::consts::FRAC_PI_2;

use serde::{Deserialize, Serialize};

use crate::Vec2;
use crate::desired::Target;
use crate::portable_math;
use crate::pose::{Pose, Twist, wrap_angle};
use crate::unicycle::integrate_arc;

/// Maximum number of waypoints. A path of this size is compiled in microseconds, and a point on it is found in
/// nine steps of a binary search.
pub const WAYPOINTS_MAX: usize = 256;
/// Minimum distance between consecutive waypoints, m. Closer waypoints are refused, because they define no
/// direction.
pub const WAYPOINT_DISTANCE_M_MIN: f64 = 1e-6;

/// Waypoints and the speed profile along them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Waypoints {
    /// Positions of the waypoints, m.
    pub points_m: Vec<[f64; 2]>,
    /// Speed along the path, m/s.
    pub speed_m_s: f64,
    /// Acceleration from rest at the start and deceleration to rest at the end, m/s^2.
    pub acceleration_m_s2: f64,
    /// `true` if the last waypoint is connected to the first, and the path is driven in an endless loop.
    pub closed: bool,
}

/// Reason why waypoints make no valid path. Waypoints are counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PathError {
    /// Number of waypoints, if it is less than 2 or more than [`WAYPOINTS_MAX`].
    #[error("there are {0} waypoints, expected 2 to {WAYPOINTS_MAX}")]
    WaypointCount(usize),
    /// Two consecutive waypoints that are closer than [`WAYPOINT_DISTANCE_M_MIN`].
    #[error("waypoints {0} and {1} coincide")]
    CoincidentWaypoints(usize, usize),
    /// A number that is not finite, or a speed or acceleration that is not positive.
    #[error("all numbers of the path must be finite, and its speed and acceleration above 0")]
    InvalidNumber,
}

/// A compiled path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Waypoints", into = "Waypoints")]
pub struct Path {
    waypoints: Waypoints,
    pieces: Vec<ArcSegment>,
    length_m: f64,
}

/// One circular arc of the path.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ArcSegment {
    /// Arc length from the start of the path to the start of this arc, m.
    start_arc_length_m: f64,
    /// Position and direction at the start of the arc.
    start: Pose,
    /// Curvature, 1/m, positive for a counter-clockwise arc.
    curvature_per_m: f64,
}

impl From<Path> for Waypoints {
    fn from(path: Path) -> Waypoints {
        path.waypoints
    }
}

impl TryFrom<Waypoints> for Path {
    type Error = PathError;

    fn try_from(waypoints: Waypoints) -> Result<Path, PathError> {
        let Waypoints { ref points_m, speed_m_s, acceleration_m_s2, closed } = waypoints;
        if !(2..=WAYPOINTS_MAX).contains(&points_m.len()) {
            return Err(PathError::WaypointCount(points_m.len()));
        }
        let is_positive = |number: f64| number.is_finite() && number > 0.0;
        let points: Vec<Vec2> = points_m.iter().map(|&point| point.into()).collect();
        if !points.iter().all(|point| point.norm_squared().is_finite())
            || ![speed_m_s, acceleration_m_s2, speed_m_s * speed_m_s / acceleration_m_s2]
                .into_iter()
                .all(is_positive)
        {
            return Err(PathError::InvalidNumber);
        }
        let legs = if closed { points.len() } else { points.len() - 1 };
        let next = |i: usize| (i + 1) % points.len();
        // Length and direction of the chord of each leg.
        let mut chords = Vec::with_capacity(legs);
        for i in 0..legs {
            let chord = points[next(i)] - points[i];
            if chord.norm() < WAYPOINT_DISTANCE_M_MIN {
                return Err(PathError::CoincidentWaypoints(i, next(i)));
            }
            chords.push((chord.norm(), portable_math::atan2(chord.y, chord.x)));
        }
        // Angle between the path's direction and each chord, at its start and its end.
        let mut start_angles = vec![None; legs];
        let mut end_angles = vec![None; legs];
        for leg in 0..legs {
            let previous = match (leg, closed) {
                (0, false) => continue,
                (0, true) => legs - 1,
                _ => leg - 1,
            };
            let (arrival, departure) = divide_direction_change(chords[previous], chords[leg]);
            end_angles[previous] = Some(arrival);
            start_angles[leg] = Some(departure);
        }
        let mut pieces = Vec::with_capacity(2 * legs);
        let mut length_m = 0.0;
        for leg in 0..legs {
            // The first and the last leg of an open path are single arcs.
            let (a, b) = match (start_angles[leg], end_angles[leg]) {
                (Some(a), Some(b)) => (a, b),
                (Some(a), None) => (a, -a),
                (None, Some(b)) => (-b, b),
                (None, None) => (0.0, 0.0),
            };
            let (chord_m, direction) = chords[leg];
            let half_m = chord_m / (2.0 * portable_math::cos((b - a) / 4.0));
            let meeting_angle = -(a + b) / 2.0;
            let mut from = points[leg];
            for (start_angle, end_angle) in [(a, meeting_angle), (meeting_angle, b)] {
                let turn = end_angle - start_angle;
                let piece_m = half_m * arc_to_chord_ratio(turn);
                let heading_rad = wrap_angle(direction + start_angle);
                pieces.push(ArcSegment {
                    start_arc_length_m: length_m,
                    start: Pose { x_m: from.x, y_m: from.y, heading_rad },
                    curvature_per_m: turn / piece_m,
                });
                length_m += piece_m;
                let (sin, cos) =
                    portable_math::sin_cos(direction + (start_angle + end_angle) / 2.0);
                from += half_m * Vec2::new(cos, sin);
            }
        }
        Ok(Path { waypoints, pieces, length_m })
    }
}

/// Divides the change of direction between two chords. Returns the angles of the path at their common waypoint
/// relative to the first and to the second chord. The longer chord gets the smaller angle, and neither angle
/// exceeds a right angle, so a path that doubles back makes a loop.
fn divide_direction_change(
    (length, direction): (f64, f64),
    (next_length, next_direction): (f64, f64),
) -> (f64, f64) {
    let turn = wrap_angle(next_direction - direction);
    let excess = turn.abs() - FRAC_PI_2;
    let first =
        (turn.abs() * next_length / (length + next_length)).clamp(excess.max(0.0), FRAC_PI_2);
    let first = first.copysign(turn);
    (first, first - turn)
}

/// Returns the ratio of arc length to chord length for an arc that turns by `turn`, rad, at most half a
/// revolution.
fn arc_to_chord_ratio(turn: f64) -> f64 {
    let half = turn / 2.0;
    if half.abs() < 1e-4 { 1.0 + half * half / 6.0 } else { half / portable_math::sin(half) }
}

impl Path {
    /// Returns the waypoints of the path.
    pub fn waypoints(&self) -> &Waypoints {
        &self.waypoints
    }

    /// Returns the length of the path, m. For a closed path it is the length of one lap.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Returns position and velocity at `t_s`. The motion starts from rest at the first waypoint. On an open
    /// path it stops at the last waypoint and stays there.
    pub fn target_at(&self, t_s: f64) -> Target {
        let (along_m, speed_m_s) = self.arc_length_and_speed(t_s);
        let pose = self.pose_at(along_m);
        let (sin, cos) = portable_math::sin_cos(pose.heading_rad);
        Target {
            position: Vec2::new(pose.x_m, pose.y_m),
            velocity: speed_m_s * Vec2::new(cos, sin),
        }
    }

    /// Returns the time at which the motion stops at the last waypoint, s, or `None` for a closed path.
    pub fn end_s(&self) -> Option<f64> {
        // The two ramps together add the time of one ramp.
        let end_at_speed =
            |speed_m_s| self.length_m / speed_m_s + speed_m_s / self.waypoints.acceleration_m_s2;
        (!self.waypoints.closed).then(|| end_at_speed(self.peak_speed_m_s()))
    }

    /// Returns the maximum speed reached, m/s.
    fn peak_speed_m_s(&self) -> f64 {
        let Waypoints { speed_m_s, acceleration_m_s2, closed, .. } = self.waypoints;
        match closed {
            true => speed_m_s,
            // A short open path is decelerated before it reaches its nominal speed.
            false => speed_m_s.min((acceleration_m_s2 * self.length_m).sqrt()),
        }
    }

    /// Returns the arc length driven by `t_s`, m, and the speed, m/s.
    fn arc_length_and_speed(&self, t_s: f64) -> (f64, f64) {
        let t_s = t_s.max(0.0);
        let Waypoints { acceleration_m_s2, closed, .. } = self.waypoints;
        let speed_m_s = self.peak_speed_m_s();
        let ramp_s = speed_m_s / acceleration_m_s2;
        let accelerate = |t_s: f64| (0.5 * acceleration_m_s2 * t_s * t_s, acceleration_m_s2 * t_s);
        if t_s < ramp_s {
            return accelerate(t_s);
        }
        // The two ramps together add the time of one ramp.
        let end_s = self.length_m / speed_m_s + ramp_s;
        let remaining_s = end_s - t_s;
        if closed || remaining_s > ramp_s {
            return (speed_m_s * (t_s - 0.5 * ramp_s), speed_m_s);
        }
        let (remaining_m, speed_m_s) = accelerate(remaining_s.max(0.0));
        (self.length_m - remaining_m, speed_m_s)
    }

    /// Returns position and direction at an arc length along the path.
    fn pose_at(&self, along_m: f64) -> Pose {
        let along_m = if self.waypoints.closed {
            along_m.rem_euclid(self.length_m)
        } else {
            along_m.clamp(0.0, self.length_m)
        };
        let piece = self
            .pieces
            .partition_point(|piece| piece.start_arc_length_m <= along_m)
            .saturating_sub(1);
        let piece = &self.pieces[piece];
        let twist = Twist::new(1.0, piece.curvature_per_m);
        integrate_arc(piece.start, twist, along_m - piece.start_arc_length_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    fn path(points_m: &[[f64; 2]], closed: bool) -> Result<Path, PathError> {
        let points_m = points_m.to_vec();
        Waypoints { points_m, speed_m_s: 0.5, acceleration_m_s2: 0.25, closed }.try_into()
    }

    /// Generates arbitrary waypoints without coincident neighbors, paths that double back included.
    fn paths() -> impl Strategy<Value = Path> {
        let point = [-4..5i32, -4..5i32].prop_map(|point| point.map(|x| 0.5 * f64::from(x)));
        let points = prop::collection::vec(point, 2..20);
        (points, any::<bool>())
            .prop_filter_map("coincident", |(points, closed)| path(&points, closed).ok())
    }

    fn waypoint_positions(path: &Path) -> Vec<Vec2> {
        path.waypoints.points_m.iter().map(|&point| point.into()).collect()
    }

    proptest! {
        #[test]
        fn velocity_is_the_derivative_of_position(path in paths(), t in 0.0..200.0f64) {
            let h = 1e-5;
            let slope = (path.target_at(t + h).position - path.target_at(t - h).position) / (2.0 * h);
            // Second-order accurate within one arc, first-order where arcs or ramps meet.
            let bend = path.pieces.iter().map(|p| p.curvature_per_m.abs()).fold(0.0, f64::max);
            let jump = h * (0.25 * bend + 0.25) + 1e-9;
            prop_assert!((slope - path.target_at(t).velocity).norm() < jump);
        }

        #[test]
        fn path_passes_through_every_waypoint_in_order(path in paths()) {
            for (piece, waypoint) in path.pieces.iter().step_by(2).zip(waypoint_positions(&path)) {
                let pose = path.pose_at(piece.start_arc_length_m);
                prop_assert!((Vec2::new(pose.x_m, pose.y_m) - waypoint).norm() < 1e-12);
            }
            let end = path.pose_at(path.length_m * (1.0 - 1e-15));
            let last = if path.waypoints.closed { waypoint_positions(&path)[0] } else { waypoint_positions(&path)[waypoint_positions(&path).len() - 1] };
            prop_assert!((Vec2::new(end.x_m, end.y_m) - last).norm() < 1e-12);
        }

        #[test]
        fn position_and_direction_are_continuous_between_arcs(path in paths()) {
            for (before, after) in path.pieces.iter().zip(&path.pieces[1..]) {
                let twist = Twist::new(1.0, before.curvature_per_m);
                let end = integrate_arc(before.start, twist, after.start_arc_length_m - before.start_arc_length_m);
                let gap = (end.x_m - after.start.x_m).hypot(end.y_m - after.start.y_m);
                prop_assert!(gap < 1e-12, "{gap}");
                let turn = wrap_angle(end.heading_rad - after.start.heading_rad);
                prop_assert!(turn.abs() < 1e-12, "{turn}");
            }
        }

        #[test]
        fn speed_between_ramps_is_the_requested_speed(path in paths(), t in 2.0..200.0f64) {
            let ramps_s = 2.0;
            let cruise_end_s = path.length_m / 0.5;
            if path.waypoints.closed || (ramps_s < cruise_end_s && t < cruise_end_s) {
                prop_assert!((path.target_at(t).velocity.norm() - 0.5).abs() < 1e-12);
            }
            prop_assert!(path.target_at(t).velocity.norm() < 0.5 + 1e-12);
        }

        #[test]
        fn open_path_starts_from_rest_and_stays_at_its_end(path in paths()) {
            prop_assert_eq!(path.target_at(0.0).velocity.norm(), 0.0);
            prop_assert!((path.target_at(0.0).position - waypoint_positions(&path)[0]).norm() < 1e-12);
            if !path.waypoints.closed {
                let end = path.target_at(1e4);
                prop_assert_eq!(end.velocity.norm(), 0.0);
                prop_assert!((end.position - waypoint_positions(&path)[waypoint_positions(&path).len() - 1]).norm() < 1e-12);
            }
        }
    }

    proptest! {
        #[test]
        fn turn_is_shared_and_the_shorter_leg_bends_more(
            lengths in [0.1..9.0f64, 0.1..9.0f64], directions in [-3.1..3.1f64, -3.1..3.1f64],
        ) {
            let turn = wrap_angle(directions[1] - directions[0]);
            let (first, second) =
                divide_direction_change((lengths[0], directions[0]), (lengths[1], directions[1]));
            prop_assert!((first - second - turn).abs() < 1e-12, "together they are the turn");
            prop_assert!(first * turn >= 0.0 && second * turn <= 0.0);
            prop_assert!(first.abs().max(second.abs()) <= FRAC_PI_2 + 1e-12);
            // In inverse proportion to the lengths, unless a leg would bend by more than a right angle.
            let fraction = turn.abs() * lengths[1] / (lengths[0] + lengths[1]);
            let bends_fully = fraction.max(turn.abs() - fraction) >= FRAC_PI_2;
            let largest = first.abs().max(second.abs());
            prop_assert!((first.abs() - fraction).abs() < 1e-12 || bends_fully);
            prop_assert!(!bends_fully || (largest - FRAC_PI_2).abs() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn open_path_begins_and_ends_with_single_arcs(path in paths()) {
            let legs: Vec<&[ArcSegment]> = path.pieces.chunks(2).collect();
            for leg in [legs[0], legs[legs.len() - 1]] {
                let [one, other] = [leg[0].curvature_per_m, leg[1].curvature_per_m];
                prop_assert!(path.waypoints.closed || (one - other).abs() < 1e-9);
            }
        }

        /// The motion is symmetric in time, also where the path is too short to reach the speed.
        #[test]
        fn open_path_motion_is_symmetric_in_time(
            length_m in 0.1..3.0f64, speed_m_s in 0.1..2.0f64, acceleration_m_s2 in 0.1..2.0f64,
            fraction in 0.0..1.0f64,
        ) {
            let points_m = vec![[0.0, 0.0], [length_m, 0.0]];
            let line = Waypoints { points_m, speed_m_s, acceleration_m_s2, closed: false };
            let line = Path::try_from(line).unwrap();
            let peak_m_s = speed_m_s.min((acceleration_m_s2 * length_m).sqrt());
            let end_s = length_m / peak_m_s + peak_m_s / acceleration_m_s2;
            let [forward, backward] = [fraction, 1.0 - fraction].map(|fraction| line.target_at(fraction * end_s));
            prop_assert!((forward.position.x + backward.position.x - length_m).abs() < 1e-9);
            prop_assert!((forward.velocity - backward.velocity).norm() < 1e-9);
            let ramp_m_s = acceleration_m_s2 * end_s * fraction.min(1.0 - fraction);
            prop_assert!((forward.velocity.x - peak_m_s.min(ramp_m_s)).abs() < 1e-9);
        }
    }

    #[test]
    fn arc_over_chord_is_exact_on_both_sides_of_its_series() {
        // Accurate up to the next term of the series, 7 a^4 / 360.
        for a in [0.0f64, 1e-9, 3e-5, 9.9e-5, 1.01e-4, 3e-4, 1e-3] {
            let expected = 1.0 + a * a / 6.0 + 7.0 * a.powi(4) / 360.0;
            assert!((arc_to_chord_ratio(2.0 * a) - expected).abs() < 5e-16, "{a}");
            assert_eq!(arc_to_chord_ratio(-2.0 * a), arc_to_chord_ratio(2.0 * a));
        }
    }

    #[test]
    fn waypoints_evenly_spaced_on_a_circle_give_that_circle() {
        let points: Vec<[f64; 2]> = (0..5)
            .map(|i| (TAU * f64::from(i) / 5.0).sin_cos())
            .map(|(s, c)| [2.0 * c, 2.0 * s])
            .collect();
        let circle = path(&points, true).unwrap();
        assert!((circle.length_m() - 2.0 * TAU).abs() < 1e-12);
        for t in [0.3, 7.0, 31.0, 100.0] {
            assert!((circle.target_at(t).position.norm() - 2.0).abs() < 1e-12);
        }
    }

    #[test]
    fn invalid_waypoints_are_refused() {
        assert_eq!(path(&[[0.0, 0.0]], false), Err(PathError::WaypointCount(1)));
        assert_eq!(path(&vec![[0.0, 0.0]; 257], false), Err(PathError::WaypointCount(257)));
        let twice = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]];
        assert_eq!(path(&twice, false), Err(PathError::CoincidentWaypoints(1, 2)));
        let back = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]];
        assert!(path(&back, false).is_ok());
        assert_eq!(path(&back, true), Err(PathError::CoincidentWaypoints(3, 0)));
        assert_eq!(path(&[[0.0, 0.0], [f64::NAN, 0.0]], false), Err(PathError::InvalidNumber));
        assert_eq!(path(&[[0.0, 0.0], [1e200, 0.0]], false), Err(PathError::InvalidNumber));
        let nearest = [[0.0, 0.0], [WAYPOINT_DISTANCE_M_MIN, 0.0]];
        assert!(path(&nearest, false).is_ok());
        // Speed and acceleration must be positive and finite, and the ramps must end.
        for (speed_m_s, acceleration_m_s2) in
            [(0.0, 1.0), (1.0, 0.0), (-1.0, 1.0), (f64::INFINITY, 1.0), (1e200, 1.0), (1.0, 1e-310)]
        {
            let points_m = vec![[0.0, 0.0], [1.0, 0.0]];
            let waypoints = Waypoints { points_m, speed_m_s, acceleration_m_s2, closed: false };
            assert_eq!(Path::try_from(waypoints), Err(PathError::InvalidNumber), "{speed_m_s}");
        }
        let path = path(&nearest, false).unwrap();
        assert_eq!(Waypoints::from(path.clone()), *path.waypoints());
    }
}

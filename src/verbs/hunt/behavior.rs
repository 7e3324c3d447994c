//! Behavior of a run as a set of small numbers. The search prefers runs with new numbers, like a fuzzer
//! that is guided by branch coverage.
//!
//! Each number encodes a transition of one robot between two modes, with the number of other robots that
//! are dead or frozen, and of other robots within [`NEAR_DISTANCE_FACTOR`] d, at that time.

use std::collections::BTreeSet;

use formation::front_point::front_point;
use protocol::message::TruthRow;

/// Speed of the front point below which a robot is at rest, m/s.
const REST_SPEED_M_S_MAX: f64 = 0.02;
/// Distance below which a robot is near, as a multiple of d.
const NEAR_DISTANCE_FACTOR: f64 = 2.0;
/// Maximum count that is distinguished; larger counts are clamped to it.
const DISTINGUISHED_COUNT_MAX: usize = 15;

/// Mode of a robot at one ground truth sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RobotMode {
    /// Dead or frozen.
    DeadOrFrozen,
    /// No command is in effect.
    WithoutCommand,
    AtRest,
    Moving,
}

/// Behavior of one run.
pub(super) struct BehaviorRecorder<'s> {
    front_point_offsets_m: &'s [f64],
    near_distance_m: f64,
    modes: Vec<RobotMode>,
    observed_events: BTreeSet<u16>,
}

impl BehaviorRecorder<'_> {
    /// Creates an empty record for robots with front points at these distances, m, and the minimum distance d, m.
    pub(super) fn new(front_point_offsets_m: &[f64], distance_min_m: f64) -> BehaviorRecorder<'_> {
        let modes = vec![RobotMode::WithoutCommand; front_point_offsets_m.len()];
        let near_distance_m = NEAR_DISTANCE_FACTOR * distance_min_m;
        BehaviorRecorder {
            front_point_offsets_m,
            near_distance_m,
            modes,
            observed_events: BTreeSet::new(),
        }
    }

    /// Adds a ground truth sample, and which robots were alive.
    pub(super) fn add_truth(&mut self, rows: &[TruthRow], alive: &[bool]) {
        let rows_and_offsets = || rows.iter().zip(self.front_point_offsets_m);
        let points: Vec<_> =
            rows_and_offsets().map(|(row, ell)| front_point(row.pose(), *ell)).collect();
        let modes: Vec<RobotMode> = rows_and_offsets()
            .zip(alive)
            .map(|((row, ell), alive)| robot_mode(row, *ell, *alive))
            .collect();
        let dead_or_frozen = modes.iter().filter(|mode| **mode == RobotMode::DeadOrFrozen).count();
        for (robot, (previous_mode, mode)) in self.modes.iter().zip(&modes).enumerate() {
            let other_dead = dead_or_frozen - usize::from(*mode == RobotMode::DeadOrFrozen);
            let near_count = points
                .iter()
                .filter(|point| (*point - points[robot]).norm() < self.near_distance_m);
            let near_count = near_count.count().saturating_sub(1).min(DISTINGUISHED_COUNT_MAX);
            let context = 16
                * (other_dead.min(DISTINGUISHED_COUNT_MAX) * (DISTINGUISHED_COUNT_MAX + 1)
                    + near_count);
            self.observed_events
                .insert((context + 4 * *previous_mode as usize + *mode as usize) as u16);
        }
        self.modes = modes;
    }

    /// Returns all transitions of the run.
    pub(super) fn into_observed_events(self) -> Vec<u16> {
        self.observed_events.into_iter().collect()
    }
}

fn robot_mode(row: &TruthRow, ell_m: f64, alive: bool) -> RobotMode {
    if !alive {
        RobotMode::DeadOrFrozen
    } else if row.commanded == 0 {
        RobotMode::WithoutCommand
    } else if row.v_m_s.abs().max(row.side_m_s.abs()).max(ell_m * row.w_rad_s.abs())
        < REST_SPEED_M_S_MAX
    {
        RobotMode::AtRest
    } else {
        RobotMode::Moving
    }
}

//! Behavior of a run as a set of small numbers. The search prefers runs with new numbers, like a fuzzer
//! that is guided by branch coverage.
//!
//! Each number encodes a transition of one robot between two modes, with the number of other robots that
//! are dead or frozen, and of other robots within [`NEAR_FACTOR`] d, at that time.

use std::collections::BTreeSet;

use formation::front_point::front_point;
use protocol::message::TruthRow;

/// Speed of the front point below which a robot is at rest, m/s.
const REST_M_S: f64 = 0.02;
/// Distance below which a robot is near, as a multiple of d.
const NEAR_FACTOR: f64 = 2.0;
/// Maximum count that is distinguished; larger counts are clamped to it.
const COUNT_MAX: usize = 15;

/// Mode of a robot at one ground truth sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    /// Dead or frozen.
    Away,
    /// No command is in effect.
    Silent,
    Rests,
    Moves,
}

/// Behavior of one run.
pub(super) struct Behavior<'s> {
    front_points_m: &'s [f64],
    near_m: f64,
    modes: Vec<Mode>,
    observed_events: BTreeSet<u16>,
}

impl Behavior<'_> {
    /// Creates an empty record for robots with front points at these distances, m, and the minimum distance d, m.
    pub(super) fn new(front_points_m: &[f64], distance_min_m: f64) -> Behavior<'_> {
        let modes = vec![Mode::Silent; front_points_m.len()];
        let near_m = NEAR_FACTOR * distance_min_m;
        Behavior { front_points_m, near_m, modes, observed_events: BTreeSet::new() }
    }

    /// Adds a ground truth sample, and which robots were alive.
    pub(super) fn truth(&mut self, rows: &[TruthRow], alive: &[bool]) {
        let both = || rows.iter().zip(self.front_points_m);
        let points: Vec<_> = both().map(|(row, ell)| front_point(row.pose(), *ell)).collect();
        let modes: Vec<Mode> =
            both().zip(alive).map(|((row, ell), alive)| mode(row, *ell, *alive)).collect();
        let away = modes.iter().filter(|mode| **mode == Mode::Away).count();
        for (robot, (before, now)) in self.modes.iter().zip(&modes).enumerate() {
            let others = away - usize::from(*now == Mode::Away);
            let near = points.iter().filter(|point| (*point - points[robot]).norm() < self.near_m);
            let near = near.count().saturating_sub(1).min(COUNT_MAX);
            let context = 16 * (others.min(COUNT_MAX) * (COUNT_MAX + 1) + near);
            self.observed_events.insert((context + 4 * *before as usize + *now as usize) as u16);
        }
        self.modes = modes;
    }

    /// Returns all transitions of the run.
    pub(super) fn traits(self) -> Vec<u16> {
        self.observed_events.into_iter().collect()
    }
}

fn mode(row: &TruthRow, ell_m: f64, alive: bool) -> Mode {
    if !alive {
        Mode::Away
    } else if row.commanded == 0 {
        Mode::Silent
    } else if row.v_m_s.abs().max(row.side_m_s.abs()).max(ell_m * row.w_rad_s.abs()) < REST_M_S {
        Mode::Rests
    } else {
        Mode::Moves
    }
}

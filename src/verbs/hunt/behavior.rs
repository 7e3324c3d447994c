//! What happened in a run, as a set of small numbers: whoever looks for runs that nobody has tried goes by them, as fuzzers
//! do by the branches that a program takes.
//!
//! Each is a change of one robot from one mode to another, with how many others are away and near at that moment.

use std::collections::BTreeSet;

use formation::front_point::front_point;
use protocol::message::TruthRow;

/// A front point that is slower is at rest, m/s.
const REST_M_S: f64 = 0.02;
/// Nearer than so many times d is near.
const NEAR: f64 = 2.0;
/// More count as so many.
const COUNT_MAX: usize = 15;

/// What robots do at one truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    /// Dead, or frozen.
    Away,
    /// Without a command in force.
    Silent,
    Rests,
    Moves,
}

/// A run that is looked at.
pub(super) struct Behavior<'s> {
    front_points_m: &'s [f64],
    near_m: f64,
    modes: Vec<Mode>,
    seen: BTreeSet<u16>,
}

impl Behavior<'_> {
    /// Of robots with front points so far ahead, m, that keep a distance of d.
    pub(super) fn new(front_points_m: &[f64], distance_min_m: f64) -> Behavior<'_> {
        let modes = vec![Mode::Silent; front_points_m.len()];
        let near_m = NEAR * distance_min_m;
        Behavior { front_points_m, near_m, modes, seen: BTreeSet::new() }
    }

    /// Takes in one truth, and who was alive at it.
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
            self.seen.insert((context + 4 * *before as usize + *now as usize) as u16);
        }
        self.modes = modes;
    }

    /// All that happened.
    pub(super) fn traits(self) -> Vec<u16> {
        self.seen.into_iter().collect()
    }
}

fn mode(row: &TruthRow, ell_m: f64, alive: bool) -> Mode {
    if !alive {
        Mode::Away
    } else if row.commanded == 0 {
        Mode::Silent
    } else if row.v_m_s.abs().max(ell_m * row.w_rad_s.abs()) < REST_M_S {
        Mode::Rests
    } else {
        Mode::Moves
    }
}

//! How near any robot came to a wall or obstacle, and where.
//!
//! The plant looks at the end of every arc and counts from the start, so that neither shorter arcs nor
//! lost truths hide anything.

use experiment::scenario::Scenario;
use formation::seconds;
use protocol::message::TruthHeader;
use serde::{Deserialize, Serialize};

/// A front point at its nearest to a wall.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Clearance {
    /// How near, m.
    pub distance_m: f64,
    /// Whose front point.
    pub robot: String,
    /// Which wall or obstacle: `wall 1`, counted in the scenario from 1.
    pub wall: String,
    /// Where the front point was, m.
    pub at_m: [f64; 2],
    /// When, s.
    pub t_s: f64,
}

impl Clearance {
    /// Who, to what, where and when, for people; `violations`: ticks at which somebody was too near.
    pub fn whereabouts(&self, violations: u64) -> String {
        let Clearance { robot, wall, at_m: [x, y], t_s, .. } = self;
        let too_near = match violations {
            0 => String::new(),
            ticks => format!(", too near at {ticks} ticks"),
        };
        format!("{robot} - {wall} at ({x:.2}, {y:.2}) m, {t_s:.3} s{too_near}")
    }
}

/// The smallest clearance so far.
pub(super) struct Clearances {
    robots: Vec<String>,
    /// Of each convex part.
    walls: Vec<String>,
    newest: Option<TruthHeader>,
}

impl Clearances {
    /// Nothing measured yet.
    pub(super) fn new(scenario: &Scenario) -> Clearances {
        Clearances {
            robots: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            walls: scenario.walls.iter().map(|wall| wall.name.clone()).collect(),
            newest: None,
        }
    }

    /// Takes in one truth.
    pub(super) fn truth(&mut self, header: &TruthHeader) {
        self.newest = Some(*header);
    }

    /// The smallest of all; `None` without walls.
    pub(super) fn smallest(&self) -> Option<Clearance> {
        let header = self.newest?;
        let [robot, wall] = header.clearance_between.map(|place| place as usize);
        Some(Clearance {
            distance_m: Some(header.clearance_m).filter(|m| m.is_finite())?,
            robot: self.robots.get(robot)?.clone(),
            wall: self.walls.get(wall)?.clone(),
            at_m: header.clearance_at_m,
            t_s: seconds(header.clearance_t_ns),
        })
    }

    /// Ticks (arcs' ends, in real time) at which some front point was too near.
    pub(super) fn violations(&self) -> u64 {
        self.newest.map_or(0, |header| header.clearance_violations)
    }
}

//! How near any robot came to a wall or obstacle, and where.
//!
//! The plant looks at the end of every arc and counts from the start, so that neither shorter arcs nor
//! lost truths hide anything.

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
    /// The smallest so far, as the plant saw it; `None` without walls. `walls`: of each convex part, which
    /// it belongs to.
    pub(super) fn seen_by_plant(
        header: &TruthHeader,
        robots: &[String],
        walls: &[String],
    ) -> Option<Clearance> {
        let [robot, wall] = header.clearance_between.map(|place| place as usize);
        Some(Clearance {
            distance_m: Some(header.clearance_m).filter(|m| m.is_finite())?,
            robot: robots.get(robot)?.clone(),
            wall: walls.get(wall)?.clone(),
            at_m: header.clearance_at_m,
            t_s: seconds(header.clearance_t_ns),
        })
    }

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

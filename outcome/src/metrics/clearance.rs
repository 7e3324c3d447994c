//! Smallest distance of a robot to a wall or obstacle.
//!
//! The plant evaluates the end of every arc from the start of the run on, so that neither shorter arcs nor lost
//! samples hide anything.

use formation::ns_to_seconds;
use protocol::message::TruthHeader;
use serde::{Deserialize, Serialize};

/// A front point at its smallest distance to a wall or obstacle.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Clearance {
    /// Smallest distance of the front point from the wall or obstacle, m.
    pub distance_m: f64,
    /// Name of the robot.
    pub robot: String,
    /// Name of the wall or obstacle, such as `wall 1`, counted in the scenario from 1.
    pub wall: String,
    /// Position of the front point, m.
    pub at_m: [f64; 2],
    /// Run time, s.
    pub t_s: f64,
}

impl Clearance {
    /// Returns the smallest distance that the plant has measured; `None` without walls. `walls` has the name of the
    /// wall for each convex part.
    pub(super) fn from_plant_header(
        header: &TruthHeader,
        robots: &[String],
        walls: &[String],
    ) -> Option<Clearance> {
        let [robot, wall] = header.clearance_between.map(|index| index as usize);
        Some(Clearance {
            distance_m: Some(header.clearance_m).filter(|m| m.is_finite())?,
            robot: robots.get(robot)?.clone(),
            wall: walls.get(wall)?.clone(),
            at_m: header.clearance_at_m,
            t_s: ns_to_seconds(header.clearance_t_ns),
        })
    }

    /// Formats robot, wall, position and time. `violations` is the number of ticks with too small a clearance.
    pub fn describe(&self, violations: u64) -> String {
        let Clearance { robot, wall, at_m: [x, y], t_s, .. } = self;
        let too_near = match violations {
            0 => String::new(),
            ticks => format!(", below the clearance at {ticks} ticks"),
        };
        format!("{robot} - {wall} at ({x:.2}, {y:.2}) m, {t_s:.3} s{too_near}")
    }
}

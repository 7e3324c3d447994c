//! Checks and theoretical analysis of a scenario, before anything runs.
//!
//! | file | question it answers |
//! |---|---|
//! | `finding` | what does an error or a warning consist of? |
//! | `findings` | which errors and warnings does a scenario have? |
//! | `braking` | how long and how far does a robot brake, and how fast may it be? |
//! | `reversals` | where does the leader turn around, and the formation with it? |
//! | `dead_ends` | which goals are behind walls? |
//! | `closed_cycles` | does a failure close a cycle of robots that use only each other? |
//! | `byzantine` | how many Byzantine robots does the graph tolerate? |
//! | `steady` | where do the robots settle, and which speeds do they need to stay there? |
//! | `cars` | do slots turn too tightly for a car, and are there too many cars? |
//! | `team` | is a team of different robots covered by the proof, and do its robots sense sizes? |
//! | `opening` | must the formation open while it forms, how far, and for how long? |
//! | `theory` | what follows from the chapter's theory: graph, matrices, bounds? |
//! | `report` | what does the text report contain? |

mod braking;
mod byzantine;
mod cars;
mod closed_cycles;
mod dead_ends;
mod finding;
mod findings;
mod opening;
mod report;
mod reversals;
mod steady;
mod team;
mod theory;

pub use braking::Braking;
pub use byzantine::LiarTolerance;
pub use finding::Finding;
pub use findings::check_scenario;
pub use opening::Opening;
pub use report::format_report;
pub use steady::PeakSpeeds;
pub(crate) use steady::{leader_motion_samples, planned_positions};
pub use theory::{
    AvoidanceParameters, ClosestRobots, ClosingParameters, EdgeCut, EpsilonRule,
    FailureConsequences, InNeighbor, MatrixProperties, RobotDistances, RobotFailure, RobotTheory,
    SpeedBounds, Theory, TopologyRepair, TrajectoryRates, TransientPeak, WallClearances,
};

use formation::Vec2;
use formation::front_point::front_point;

use crate::scenario::Robot;

/// Returns the front points at the start, m.
pub(crate) fn start_front_points(robots: &[Robot]) -> Vec<Vec2> {
    robots.iter().map(|robot| front_point(robot.start, robot.front_point_m)).collect()
}

/// Returns the largest number from 0 to `maximum` that fits, with 12 digits (bisection). If a number fits, all smaller
/// ones must fit, too.
fn bisect_largest(maximum: f64, fits: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, maximum);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        *if fits(middle) { &mut low } else { &mut high } = middle;
    }
    low
}

/// Returns `number` rounded down to four decimals.
fn format_rounded_down(number: f64) -> String {
    format!("{:.4}", (number * 1e4).floor() / 1e4)
}

/// Returns `number` rounded up to four decimals.
fn format_rounded_up(number: f64) -> String {
    format!("{:.4}", (number * 1e4 - 1e-6).ceil() / 1e4)
}

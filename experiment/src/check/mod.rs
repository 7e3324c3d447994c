//! Does a scenario make sense, and what does it amount to? All before anything runs.
//!
//! | file | question it answers |
//! |---|---|
//! | `finding` | what is said of something that is wrong? |
//! | `findings` | what is wrong with it, or worth knowing? |
//! | `braking` | how long and how far does a robot brake, and how fast may it be? |
//! | `reversals` | where does the leader turn around, and the formation with it? |
//! | `dead_ends` | which goals are behind walls? |
//! | `circles` | would a death leave robots that go by each other alone? |
//! | `liars` | how many liars does the graph bear? |
//! | `steady` | where does everybody settle, and how fast must it go to stay there? |
//! | `opening` | must the formation open while it forms, how far, and for how long? |
//! | `theory` | what does the chapter's theory make of it: graph, matrices, bounds? |
//! | `report` | how is all that shown to people? |

mod braking;
mod circles;
mod dead_ends;
mod finding;
mod findings;
mod liars;
mod opening;
mod report;
mod reversals;
mod steady;
mod theory;

pub use braking::Braking;
pub use finding::Finding;
pub use findings::check;
pub use liars::Liars;
pub use opening::Opening;
pub use report::report;
pub use steady::Peak;
pub(crate) use steady::{leader_course, places};
pub use theory::{
    Aftermath, ClosingFacts, Death, Distances, EdgeCut, Epsilon, Gap, Guard, Hears, MatrixFacts,
    Repair, RobotTheory, SpeedBounds, Theory, TrajectoryFacts, TransientPeak, WallFacts,
};

use formation::Vec2;
use formation::front_point::front_point;

use crate::scenario::Robot;

/// The front points at the start, m.
pub(crate) fn start_points(robots: &[Robot]) -> Vec<Vec2> {
    robots.iter().map(|robot| front_point(robot.start, robot.front_point_m)).collect()
}

/// The largest number up to `most`, from 0, that fits, where smaller ones do: to twelve digits.
fn largest(most: f64, fits: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, most);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        *if fits(middle) { &mut low } else { &mut high } = middle;
    }
    low
}

/// Four decimals, never more than `number`.
fn rounded_down(number: f64) -> String {
    format!("{:.4}", (number * 1e4).floor() / 1e4)
}

/// Four decimals, never less than `number`.
fn rounded_up(number: f64) -> String {
    format!("{:.4}", (number * 1e4 - 1e-6).ceil() / 1e4)
}

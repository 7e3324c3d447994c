//! Content of the picture of a run: the constant part (scene), and one instant (frame).
//!
//! Both are sent as JSON to the page, which draws finished runs and runs in progress alike. World frame: x forward,
//! y left, counter-clockwise positive.

use formation::obstacle::Obstacle;
use serde::Serialize;

/// Constant part of the picture of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Scene {
    /// Name of the scenario.
    pub name: String,
    /// Time mode: `lockstep` or `realtime`.
    pub pace: String,
    /// Duration of the run, s.
    pub duration_s: f64,
    /// Minimum distance d between two front points, m.
    pub distance_min_m: f64,
    /// Robots in scenario order. All indices of robots refer to this list.
    pub robots: Vec<SceneRobot>,
    /// Edges of the formation graph, on which robot `to` receives from robot `from`, followed by the edges from
    /// backup neighbors.
    pub edges: Vec<SceneEdge>,
    /// Convex parts of walls and obstacles.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub walls: Vec<Obstacle>,
    /// Known faults, in order of time.
    pub faults: Vec<SceneFault>,
    /// Number of faults, including faults that a page leaves out of `faults`; 0 in a scene that was not prepared
    /// for a page.
    pub faults_in_all: usize,
}

impl Scene {
    /// Returns whether the robots have different sizes, so that no distance is the minimum of all pairs.
    pub fn has_sizes(&self) -> bool {
        self.robots.iter().any(|robot| robot.keep_m.is_some())
    }
}

/// A robot of the scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SceneRobot {
    /// Name of the robot.
    pub name: String,
    /// Role: `main-leader`, `leader`, `formation` or `contained`.
    pub role: String,
    /// Distance from the axle midpoint to the front point, m.
    pub front_point_m: f64,
    /// Size of the robot (keep), m, in a team of robots with different sizes; otherwise half of d counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_m: Option<f64>,
}

/// An edge of the formation graph.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct SceneEdge {
    /// Index of the sending robot.
    pub from: usize,
    /// Index of the receiving robot.
    pub to: usize,
    /// Whether the edge leads from a backup neighbor, which replaces a lost one.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub spare: bool,
    /// Whether a follower uses the edge to keep the slot of a leader that it replaces.
    #[serde(skip)]
    pub for_place: bool,
    /// Whether the edge exists only while its ends are near each other.
    #[serde(skip)]
    pub by_distance: bool,
}

/// A fault of the scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SceneFault {
    /// Time at which the fault begins, s.
    pub t_s: f64,
    /// Time at which the fault ends, s; `None` if it does not end.
    pub until_s: Option<f64>,
    /// Description as on the command line: `kill r2`.
    pub what: String,
    /// Indices of the robots that the fault affects.
    pub robots: Vec<usize>,
    /// Index of the edge that the fault cuts: no beacon passes while it lasts.
    pub cuts: Option<usize>,
}

impl SceneFault {
    /// Returns whether the fault is active at this time, s.
    pub fn is_active_at(&self, t_s: f64) -> bool {
        self.t_s <= t_s && self.until_s.is_none_or(|until_s| t_s < until_s)
    }
}

/// One instant of the picture.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SceneFrame {
    /// Run time, s.
    pub t_s: f64,
    /// Robots in scenario order.
    pub robots: Vec<FrameRobot>,
    /// State of each edge, in the order of the scene.
    pub edges: Vec<EdgeState>,
    /// Smallest distance between two front points at this instant, m; `None` with fewer than two robots.
    pub distance_m: Option<f64>,
}

/// A robot at one instant.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct FrameRobot {
    /// x of the axle midpoint, m.
    pub x_m: f64,
    /// y of the axle midpoint, m.
    pub y_m: f64,
    /// Heading in (-pi, pi], rad.
    pub heading_rad: f64,
    /// Distance from the target, m; `None` without a target.
    pub error_m: Option<f64>,
    /// State of the robot's process.
    pub state: RobotState,
}

/// State of a robot's process.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RobotState {
    /// The process runs and sends commands.
    #[default]
    Moving,
    /// The process was stopped by SIGSTOP.
    Frozen,
    /// The process is dead and will not be restarted.
    Dead,
    /// A replacement was started and is not ready yet.
    Starting,
    /// The process runs, but no living leader reaches the robot although its role needs one.
    Orphaned,
}

impl RobotState {
    /// Returns whether the process runs and sends commands.
    pub fn can_move(self) -> bool {
        matches!(self, RobotState::Moving | RobotState::Orphaned)
    }
}

/// State of an edge.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum EdgeState {
    /// Beacons arrive.
    #[default]
    Fresh,
    /// The newest beacon is stale, and the position in it is extrapolated.
    Stale,
    /// The sender is timed out and no longer used.
    Lost,
    /// A fault cuts the edge: no beacon passes.
    Cut,
    /// The robot at one of the ends is dead.
    Dead,
    /// An unused edge from a backup neighbor.
    Closed,
}

impl EdgeState {
    /// Combines the reception state of an edge with the states of the robots at its ends, `[from, to]`, and with a
    /// cut.
    pub fn combine(self, [from, to]: [RobotState; 2], is_cut: bool) -> EdgeState {
        match (from, to) {
            _ if self == EdgeState::Closed => self,
            (RobotState::Dead, _) | (_, RobotState::Dead) => EdgeState::Dead,
            _ if is_cut => EdgeState::Cut,
            // A process that does not run receives nothing.
            (_, RobotState::Frozen | RobotState::Starting) => EdgeState::Lost,
            _ => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edge_of_dead_robot_is_dead_and_cut_edge_is_cut() {
        use RobotState::{Dead, Frozen, Moving, Starting};
        for reception in [EdgeState::Fresh, EdgeState::Stale, EdgeState::Lost] {
            for (end_states, is_cut, expected) in [
                ([Moving, Moving], false, reception),
                ([Frozen, Moving], false, reception),
                ([Moving, Frozen], false, EdgeState::Lost),
                ([Moving, Starting], false, EdgeState::Lost),
                ([Moving, Moving], true, EdgeState::Cut),
                ([Dead, Moving], false, EdgeState::Dead),
                ([Moving, Dead], false, EdgeState::Dead),
                ([Moving, Dead], true, EdgeState::Dead),
            ] {
                assert_eq!(
                    reception.combine(end_states, is_cut),
                    expected,
                    "{reception:?} {end_states:?} {is_cut}"
                );
            }
        }
    }
}

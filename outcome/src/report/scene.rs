//! What is in the picture of a run: what stays the same, and one instant.
//!
//! Both become JSON for the page, which draws a finished run and one under way alike. World frame:
//! x forward, y left, counter-clockwise positive.

use formation::obstacle::Obstacle;
use serde::Serialize;

/// What does not change during a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Scene {
    /// The scenario's name.
    pub name: String,
    /// `lockstep` or `realtime`.
    pub pace: String,
    /// When the run ends, s.
    pub duration_s: f64,
    /// d: no two front points shall be nearer to each other, m.
    pub distance_min_m: f64,
    /// In scenario order; everything else names robots by their place here, from 0.
    pub robots: Vec<SceneRobot>,
    /// The formation graph: robot `to` hears robot `from`; behind it the spares.
    pub edges: Vec<SceneEdge>,
    /// The convex parts of walls and obstacles.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub walls: Vec<Obstacle>,
    /// What goes wrong, as far as it is known; in order of time.
    pub faults: Vec<SceneFault>,
    /// Number of faults, also of those that a page leaves out of `faults`; 0 before a page bounds them.
    pub faults_in_all: usize,
}

/// One robot.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SceneRobot {
    /// Its name.
    pub name: String,
    /// `main-leader`, `leader`, `formation` or `contained`.
    pub role: String,
    /// Distance from the middle of the axle to the front point, m.
    pub front_point_m: f64,
}

/// One edge of the formation graph.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct SceneEdge {
    /// Who is heard.
    pub from: usize,
    /// Who hears.
    pub to: usize,
    /// Only in place of one who is lost.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub spare: bool,
    /// By this one a contained robot keeps the place of a leader that it takes.
    #[serde(skip)]
    pub for_place: bool,
}

/// Something that goes wrong.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SceneFault {
    /// When it begins, s.
    pub t_s: f64,
    /// When it ends, s; `None` if never.
    pub until_s: Option<f64>,
    /// As it is written on the command line: `kill r2`.
    pub what: String,
    /// Robots that it strikes.
    pub robots: Vec<usize>,
    /// Place of the edge that it cuts: while it lasts, nothing gets over it.
    pub cuts: Option<usize>,
}

impl SceneFault {
    /// Whether it lasts at this time, s.
    pub fn lasts_at(&self, t_s: f64) -> bool {
        self.t_s <= t_s && self.until_s.is_none_or(|until_s| t_s < until_s)
    }
}

/// One instant.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Frame {
    /// Run time, s.
    pub t_s: f64,
    /// In scenario order.
    pub robots: Vec<FrameRobot>,
    /// State of each edge, in the scene's order.
    pub edges: Vec<EdgeState>,
    /// The smallest distance of two front points at this instant, m; `None` with fewer than two.
    pub distance_m: Option<f64>,
}

/// One robot at one instant.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct FrameRobot {
    /// Of the middle of the axle, m.
    pub x_m: f64,
    /// Of the middle of the axle, m.
    pub y_m: f64,
    /// In (-pi, pi].
    pub heading_rad: f64,
    /// Distance from where it wants to be, m; `None` while it has no error.
    pub error_m: Option<f64>,
    /// What its process does.
    pub state: RobotState,
}

/// What a robot's process does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RobotState {
    /// It computes and commands.
    #[default]
    Moving,
    /// It was stopped by SIGSTOP.
    Frozen,
    /// It is dead, and no replacement is on its way.
    Dead,
    /// Its replacement was started and does not take part yet.
    Starting,
    /// It computes and commands, and needs a leader, but no living one reaches it any more.
    Orphaned,
}

impl RobotState {
    /// Whether it computes and commands.
    pub fn moves(self) -> bool {
        matches!(self, RobotState::Moving | RobotState::Orphaned)
    }
}

/// What gets over an edge.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum EdgeState {
    /// Heard lately.
    #[default]
    Fresh,
    /// Extrapolated.
    Stale,
    /// Not counted on any more.
    Lost,
    /// A fault cuts it: nothing gets over it.
    Cut,
    /// A robot at one of its ends is dead.
    Dead,
    /// A spare that replaces nobody.
    Closed,
}

impl EdgeState {
    /// The state of an edge from a robot in one state to a robot in another, as that one hears it.
    pub fn of(self, [from, to]: [RobotState; 2], cut: bool) -> EdgeState {
        match (from, to) {
            _ if self == EdgeState::Closed => self,
            (RobotState::Dead, _) | (_, RobotState::Dead) => EdgeState::Dead,
            _ if cut => EdgeState::Cut,
            // Whoever does not move hears nobody.
            (_, RobotState::Frozen | RobotState::Starting) => EdgeState::Lost,
            _ => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_at_the_dead_is_dead_and_one_that_is_cut_is_cut_whatever_was_heard_last() {
        use RobotState::{Dead, Frozen, Moving, Starting};
        for heard in [EdgeState::Fresh, EdgeState::Stale, EdgeState::Lost] {
            for (ends, cut, state) in [
                ([Moving, Moving], false, heard),
                ([Frozen, Moving], false, heard),
                ([Moving, Frozen], false, EdgeState::Lost),
                ([Moving, Starting], false, EdgeState::Lost),
                ([Moving, Moving], true, EdgeState::Cut),
                ([Dead, Moving], false, EdgeState::Dead),
                ([Moving, Dead], false, EdgeState::Dead),
                ([Moving, Dead], true, EdgeState::Dead),
            ] {
                assert_eq!(heard.of(ends, cut), state, "{heard:?} {ends:?} {cut}");
            }
        }
    }
}

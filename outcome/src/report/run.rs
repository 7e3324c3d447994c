//! Data of a finished run, as far as the report shows them: scene, record and summary.

pub use crate::metrics::summary::LatencyInterval;
use crate::metrics::summary::Summary;
use formation::Vec2;
use formation::front_point::front_point;
use formation::hull::{convex_hull, hull_distance};
use formation::pose::Pose;

use crate::report::scene::{EdgeState, FrameRobot, RobotState, Scene, SceneEdge, SceneFrame};

/// Target rate of the replay, instants per second of run time.
const FRAMES_HZ: f64 = 20.0;
/// Maximum number of instants of the replay, times robots. A longer run is replayed at a lower rate.
const FRAME_ROBOTS_MAX: f64 = 200_000.0;

/// A finished run, or the remaining data of a killed one.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedRun {
    /// Constant part of the picture.
    pub scene: Scene,
    /// Threshold of convergence, m.
    pub converged_error_m: f64,
    /// Age from which a neighbor is stale, s.
    pub stale_after_s: f64,
    /// Age from which a neighbor is lost (timed out), s.
    pub lost_after_s: f64,
    /// Time of each recorded instant, s.
    pub times_s: Vec<f64>,
    /// Samples of each robot, one for each instant.
    pub tracks: Vec<Vec<RobotSample>>,
    /// Reference m(t) of the main leader at each instant, m; empty without a main leader.
    pub leader_reference_m: Vec<[f64; 2]>,
    /// Decimation: only every n-th recorded instant was loaded, because the run is too long to draw.
    pub decimation: usize,
    /// Signals that control laws recorded.
    pub signals: Vec<SignalTrack>,
    /// State changes of robots and edges, in order of time.
    pub state_changes: Vec<StateChange>,
    /// Repair events in order of time: time, s, robot, and detail.
    pub repair_events: Vec<(f64, String, String)>,
    /// Summary of the run; `None` if the run was cut short before it was written.
    pub summary: Option<Summary>,
    /// Reason why no guarantee about distances holds although it usually would.
    pub missing_guarantee: Option<String>,
    /// Sentence about the run for the top of the page.
    pub introduction: Option<String>,
    /// Description of a file that differs from what the run wrote.
    pub damage: Option<String>,
    /// Entries of the manifest: names and values.
    pub manifest: Vec<(String, String)>,
    /// Latency distributions per interval of run time.
    pub latency_over_time: Vec<LatencyInterval>,
    /// Latency distributions over the run.
    pub latency_distributions: Vec<LatencyDistribution>,
}

/// A robot at one recorded instant.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RobotSample {
    /// x of the axle midpoint, m.
    pub x_m: f64,
    /// y of the axle midpoint, m.
    pub y_m: f64,
    /// Heading in (-pi, pi], rad.
    pub heading_rad: f64,
    /// Error |e|, m; `None` without a target.
    pub error_m: Option<f64>,
    /// Distance from the slot in the ideal formation, m; `None` if there is none, or if it was not recorded.
    pub ideal_error_m: Option<f64>,
    /// Error vector e, m; `None` if it cannot be determined.
    pub error_xy_m: Option<[f64; 2]>,
    /// Whether the process is alive.
    pub is_alive: bool,
}

/// Values of one signal.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SignalTrack {
    /// Name of the signal.
    pub name: String,
    /// Times, s, and values of each robot, in scenario order.
    pub values: Vec<Vec<(f64, f64)>>,
}

/// A state change of a robot or an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateChange {
    /// Time of the change, s.
    pub t_s: f64,
    /// New state.
    pub new_state: NewState,
}

/// New state of a robot or an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NewState {
    /// New state of the robot with this index.
    Robot(usize, RobotState),
    /// New state of the edge with this index.
    Edge(usize, EdgeState),
    /// Whether the deputy with this index leads.
    Leads(usize, bool),
}

/// Latency distribution of one stage at one robot or edge over the run.
#[derive(Debug, Clone, PartialEq)]
pub struct LatencyDistribution {
    /// Keyword of the stage.
    pub stage: String,
    /// Name of the robot, `r1`, or of the edge, `r1->r2`.
    pub robot_or_edge: String,
    /// Values, ns, with the fraction of samples above each; in order.
    pub exceedance: Vec<(u64, f64)>,
}

impl LoadedRun {
    /// Returns the end of the record, s.
    pub fn end_s(&self) -> f64 {
        let recorded_end_s = self.times_s.last().copied().unwrap_or(0.0);
        self.summary.as_ref().map_or(recorded_end_s, |summary| summary.t_s.max(recorded_end_s))
    }

    /// Returns the planned end of the run, s: `duration_s`, or the time reached if it ended early after convergence.
    pub fn duration_s(&self) -> f64 {
        let early_summary = self.summary.as_ref().filter(|summary| summary.ended_early);
        early_summary.map_or(self.scene.duration_s, |summary| summary.t_s)
    }

    /// Returns the front point of a robot at an instant, m.
    pub fn front_point(&self, robot: usize, instant: usize) -> Vec2 {
        let RobotSample { x_m, y_m, heading_rad, .. } = self.tracks[robot][instant];
        front_point(Pose { x_m, y_m, heading_rad }, self.scene.robots[robot].front_point_m)
    }

    /// Returns the followers, and the leaders whose convex hull they must be in; `None` if one of the two is
    /// missing.
    pub fn followers_and_leaders(&self) -> Option<(Vec<usize>, Vec<usize>)> {
        let robots = 0..self.scene.robots.len();
        let (contained, leaders): (Vec<usize>, Vec<usize>) =
            robots.partition(|&robot| self.scene.robots[robot].role == "contained");
        (!contained.is_empty() && !leaders.is_empty()).then_some((contained, leaders))
    }

    /// Returns the corners of the convex hull at an instant, of these leaders and of the robots that replace one.
    pub fn hull(&self, leaders: &[usize], instant: usize) -> Vec<Vec2> {
        convex_hull(&self.leader_points(leaders, instant))
    }

    /// Returns the distance of a robot from that hull at an instant, m; 0 inside.
    pub fn distance_from_hull(&self, robot: usize, leaders: &[usize], instant: usize) -> f64 {
        hull_distance(self.front_point(robot, instant), &self.leader_points(leaders, instant))
    }

    fn leader_points(&self, leaders: &[usize], instant: usize) -> Vec<Vec2> {
        let is_in_use = match self.scene.edges.iter().any(|edge| edge.for_place) {
            true => self.edges_in_use(self.times_s[instant]),
            false => Vec::new(),
        };
        let edges = self.scene.edges.iter().zip(is_in_use);
        let replacing_edges = edges.filter(|(edge, is_in_use)| edge.for_place && *is_in_use);
        let replacements =
            replacing_edges.map(|(edge, _)| edge.to).filter(|&i| self.tracks[i][instant].is_alive);
        let leaders = leaders.iter().copied().chain(replacements);
        leaders.map(|robot| self.front_point(robot, instant)).collect()
    }

    /// Returns the smallest distance between two front points at an instant, m.
    fn minimum_distance_m(&self, instant: usize) -> Option<f64> {
        let robots = self.scene.robots.len();
        let points: Vec<Vec2> = (0..robots).map(|robot| self.front_point(robot, instant)).collect();
        formation::closest::closest_pair(&points).map(|closest| closest.distance_m)
    }

    /// Returns the state of each edge at the start.
    fn initial_edge_states(&self) -> Vec<EdgeState> {
        let initial_state = |edge: &SceneEdge| match edge.spare || edge.by_distance {
            true => EdgeState::Closed,
            false => EdgeState::Fresh,
        };
        self.scene.edges.iter().map(initial_state).collect()
    }

    /// Returns for each edge whether it is in use at this time, s. An edge from a backup neighbor is in use while
    /// it replaces another.
    pub fn edges_in_use(&self, t_s: f64) -> Vec<bool> {
        let mut edge_states = self.initial_edge_states();
        for change in self.state_changes.iter().take_while(|change| change.t_s <= t_s) {
            if let NewState::Edge(edge, state) = change.new_state {
                edge_states[edge] = state;
            }
        }
        edge_states.into_iter().map(|state| state != EdgeState::Closed).collect()
    }

    /// Returns the frames of the replay.
    pub fn frames(&self) -> Vec<SceneFrame> {
        let robots = self.scene.robots.len();
        let end_s = self.end_s().max(1e-9);
        let rate_hz_max = FRAME_ROBOTS_MAX / robots.max(1) as f64 / end_s;
        let step_s = 1.0 / FRAMES_HZ.min(rate_hz_max);
        let mut states = vec![RobotState::Moving; robots];
        let mut edge_states = self.initial_edge_states();
        let mut changes = self.state_changes.iter().peekable();
        let mut frames = Vec::new();
        let mut next_frame_s = f64::NEG_INFINITY;
        for (instant, &t_s) in self.times_s.iter().enumerate() {
            let is_last = instant + 1 == self.times_s.len();
            // The tolerance absorbs rounding of recorded times.
            if t_s < next_frame_s - 1e-6 && !is_last {
                continue;
            }
            next_frame_s = ((t_s + 1e-6) / step_s).floor() * step_s + step_s;
            while let Some(change) = changes.next_if(|change| change.t_s <= t_s) {
                match change.new_state {
                    NewState::Robot(robot, state) => states[robot] = state,
                    NewState::Edge(edge, state) => edge_states[edge] = state,
                    NewState::Leads(..) => {}
                }
            }
            let frame_robot = |robot: usize| {
                let RobotSample { x_m, y_m, heading_rad, error_m, .. } =
                    self.tracks[robot][instant];
                // Dead robots have no target.
                let error_m = error_m.filter(|_| states[robot] != RobotState::Dead);
                FrameRobot { x_m, y_m, heading_rad, error_m, state: states[robot] }
            };
            let is_cut = |edge: usize| {
                let mut faults = self.scene.faults.iter().filter(|fault| fault.cuts == Some(edge));
                faults.any(|fault| fault.is_active_at(t_s))
            };
            let edge = |(index, edge): (usize, &SceneEdge)| {
                edge_states[index].combine([states[edge.from], states[edge.to]], is_cut(index))
            };
            frames.push(SceneFrame {
                t_s,
                robots: (0..robots).map(frame_robot).collect(),
                edges: self.scene.edges.iter().enumerate().map(edge).collect(),
                distance_m: self.minimum_distance_m(instant),
            });
        }
        frames
    }
}

//! What is known of a finished run: the picture, what was recorded, what came out.

pub use crate::metrics::summary::Stretch;
use crate::metrics::summary::Summary;
use formation::Vec2;
use formation::front_point::front_point;
use formation::hull::{convex_hull, hull_distance};
use formation::pose::Pose;

use crate::report::scene::{EdgeState, Frame, FrameRobot, RobotState, Scene, SceneEdge};

/// The replay has this many instants per second of run time, and no more of one robot in all than
/// the second number: what is longer is replayed at a lower rate.
const FRAMES_HZ: f64 = 20.0;
const FRAME_ROBOTS_MAX: f64 = 200_000.0;

/// A finished run, or what is left of one.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// What stays the same.
    pub scene: Scene,
    /// Errors below this count as converged, m.
    pub converged_error_m: f64,
    /// Older neighbors are stale, s.
    pub stale_after_s: f64,
    /// Older neighbors are lost, s.
    pub lost_after_s: f64,
    /// When each recorded instant was, s.
    pub times_s: Vec<f64>,
    /// Of each robot, one sample for each instant.
    pub tracks: Vec<Vec<Sample>>,
    /// m(t), where the main leader is to be, at each instant, m; empty if nobody leads.
    pub lead_m: Vec<[f64; 2]>,
    /// One of so many recorded instants is in here: a run of many hours has too many to draw.
    pub every: usize,
    /// What became of robots and edges, in order of time.
    pub changes: Vec<Change>,
    /// What robots said of those they go by, in order of time: when, s, who, and what.
    pub repairs: Vec<(f64, String, String)>,
    /// What came out; `None` if the run was cut short before it was summed up.
    pub summary: Option<Summary>,
    /// Why no promise about distances holds in it, if one otherwise would.
    pub unpromised: Option<String>,
    /// What happens in it, in one sentence, if somebody says so.
    pub about: Option<String>,
    /// Which of its files is not as the run wrote it, in words.
    pub damage: Option<String>,
    /// What was run, where and how: words and their values.
    pub manifest: Vec<(String, String)>,
    /// Latencies over time.
    pub over_time: Vec<Stretch>,
    /// How latencies are spread over the whole run.
    pub spreads: Vec<Spread>,
}

/// One robot at one recorded instant.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sample {
    /// Of the middle of the axle, m.
    pub x_m: f64,
    /// Of the middle of the axle, m.
    pub y_m: f64,
    /// In (-pi, pi].
    pub heading_rad: f64,
    /// |e|, m; `None` while it has none.
    pub error_m: Option<f64>,
    /// How far from its place in the ideal formation, m; `None` where it has none, or nobody
    /// measured it.
    pub ideal_error_m: Option<f64>,
    /// e, m; `None` where it cannot be told.
    pub error_xy_m: Option<[f64; 2]>,
    /// Its process lives.
    pub alive: bool,
}

/// Something that became of a robot or an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// When, s.
    pub t_s: f64,
    /// What.
    pub to: ChangedTo,
}

/// What became of what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChangedTo {
    /// A robot, by its place in the scene.
    Robot(usize, RobotState),
    /// An edge, by its place in the scene.
    Edge(usize, EdgeState),
    /// A deputy, by its place in the scene, leads, or no longer does.
    Leads(usize, bool),
}

/// How the values of one stage at one robot or edge are spread over the whole run.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Its stage.
    pub stage: String,
    /// `r1`, or `r1->r2` of an edge.
    pub of: String,
    /// Values, ns, and the share of samples above; in order.
    pub above: Vec<(u64, f64)>,
}

impl Run {
    /// When the record ends, s.
    pub fn end_s(&self) -> f64 {
        let recorded = self.times_s.last().copied().unwrap_or(0.0);
        self.summary.as_ref().map_or(recorded, |summary| summary.t_s.max(recorded))
    }

    /// How long it lasts if nothing cuts it short, s.
    pub fn lasts_s(&self) -> f64 {
        let early = self.summary.as_ref().filter(|summary| summary.ended_early);
        early.map_or(self.scene.duration_s, |summary| summary.t_s)
    }

    /// Where a robot's front point is at an instant, m.
    pub fn alpha(&self, robot: usize, instant: usize) -> Vec2 {
        let Sample { x_m, y_m, heading_rad, .. } = self.tracks[robot][instant];
        front_point(Pose { x_m, y_m, heading_rad }, self.scene.robots[robot].front_point_m)
    }

    /// The contained robots, and the leaders whose hull they are to be in.
    pub fn containment(&self) -> Option<(Vec<usize>, Vec<usize>)> {
        let robots = 0..self.scene.robots.len();
        let (contained, leaders): (Vec<usize>, Vec<usize>) =
            robots.partition(|&robot| self.scene.robots[robot].role == "contained");
        (!contained.is_empty() && !leaders.is_empty()).then_some((contained, leaders))
    }

    /// Corners of the hull of these leaders at an instant, and of those that take the place of one.
    pub fn hull(&self, leaders: &[usize], instant: usize) -> Vec<Vec2> {
        convex_hull(&self.leading_points(leaders, instant))
    }

    /// How far a robot is outside that hull at an instant, m.
    pub fn outside(&self, robot: usize, leaders: &[usize], instant: usize) -> f64 {
        hull_distance(self.alpha(robot, instant), &self.leading_points(leaders, instant))
    }

    fn leading_points(&self, leaders: &[usize], instant: usize) -> Vec<Vec2> {
        let gone_by = match self.scene.edges.iter().any(|edge| edge.for_place) {
            true => self.gone_by(self.times_s[instant]),
            false => Vec::new(),
        };
        let edges = self.scene.edges.iter().zip(gone_by);
        let takes = edges.filter(|(edge, gone_by)| edge.for_place && *gone_by);
        let living = takes.map(|(edge, _)| edge.to).filter(|&i| self.tracks[i][instant].alive);
        let leaders = leaders.iter().copied().chain(living);
        leaders.map(|robot| self.alpha(robot, instant)).collect()
    }

    /// The smallest distance of two front points at an instant, m.
    fn nearest(&self, instant: usize) -> Option<f64> {
        let robots = self.scene.robots.len();
        let points: Vec<Vec2> = (0..robots).map(|robot| self.alpha(robot, instant)).collect();
        formation::closest::closest_pair(&points).map(|closest| closest.distance_m)
    }

    /// How each edge is heard before anything changes.
    fn heard_at_first(&self) -> Vec<EdgeState> {
        let closed = |edge: &SceneEdge| match edge.spare {
            true => EdgeState::Closed,
            false => EdgeState::Fresh,
        };
        self.scene.edges.iter().map(closed).collect()
    }

    /// Whether each edge is gone by at this time, s: spares while they replace somebody.
    pub fn gone_by(&self, t_s: f64) -> Vec<bool> {
        let mut heard = self.heard_at_first();
        for change in self.changes.iter().take_while(|change| change.t_s <= t_s) {
            if let ChangedTo::Edge(edge, state) = change.to {
                heard[edge] = state;
            }
        }
        heard.into_iter().map(|state| state != EdgeState::Closed).collect()
    }

    /// The run as the replay shows it.
    pub fn frames(&self) -> Vec<Frame> {
        let robots = self.scene.robots.len();
        let seconds = self.end_s().max(1e-9);
        let most_hz = FRAME_ROBOTS_MAX / robots.max(1) as f64 / seconds;
        let step_s = 1.0 / FRAMES_HZ.min(most_hz);
        let mut states = vec![RobotState::Moving; robots];
        let mut heard = self.heard_at_first();
        let mut changes = self.changes.iter().peekable();
        let mut frames = Vec::new();
        let mut due_s = f64::NEG_INFINITY;
        for (instant, &t_s) in self.times_s.iter().enumerate() {
            let last = instant + 1 == self.times_s.len();
            // A recorded instant is not exactly a multiple of anything.
            if t_s < due_s - 1e-6 && !last {
                continue;
            }
            due_s = ((t_s + 1e-6) / step_s).floor() * step_s + step_s;
            while let Some(change) = changes.next_if(|change| change.t_s <= t_s) {
                match change.to {
                    ChangedTo::Robot(robot, state) => states[robot] = state,
                    ChangedTo::Edge(edge, state) => heard[edge] = state,
                    ChangedTo::Leads(..) => {}
                }
            }
            let robot = |robot: usize| {
                let Sample { x_m, y_m, heading_rad, error_m, .. } = self.tracks[robot][instant];
                // The dead want to be nowhere.
                let error_m = error_m.filter(|_| states[robot] != RobotState::Dead);
                FrameRobot { x_m, y_m, heading_rad, error_m, state: states[robot] }
            };
            let cut = |edge: usize| {
                let mut faults = self.scene.faults.iter().filter(|fault| fault.cuts == Some(edge));
                faults.any(|fault| fault.lasts_at(t_s))
            };
            let edge = |(place, edge): (usize, &SceneEdge)| {
                heard[place].of([states[edge.from], states[edge.to]], cut(place))
            };
            frames.push(Frame {
                t_s,
                robots: (0..robots).map(robot).collect(),
                edges: self.scene.edges.iter().enumerate().map(edge).collect(),
                distance_m: self.nearest(instant),
            });
        }
        frames
    }
}

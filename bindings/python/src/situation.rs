//! Input of a law as Python objects: copies of plain values, converted to Python objects on access.

use agent::laws::{self, Heard};
use formation::Vec2;
use formation::pose;
use protocol::brief::AgentBrief;
use protocol::message::Contact;
use pyo3::prelude::*;

/// Components x and y.
type Pair = (f64, f64);

/// A pose of the axle mid-point.
#[pyclass(frozen, get_all, skip_from_py_object, module = "phalanx")]
#[derive(Clone, Copy)]
pub struct Pose {
    x_m: f64,
    y_m: f64,
    heading_rad: f64,
}

impl From<pose::Pose> for Pose {
    fn from(pose: pose::Pose) -> Pose {
        let pose::Pose { x_m, y_m, heading_rad } = pose;
        Pose { x_m, y_m, heading_rad }
    }
}

#[pymethods]
impl Pose {
    fn __repr__(&self) -> String {
        format!("Pose(x_m={}, y_m={}, heading_rad={})", self.x_m, self.y_m, self.heading_rad)
    }
}

/// A twist of the body.
#[pyclass(frozen, get_all, skip_from_py_object, module = "phalanx")]
#[derive(Clone, Copy)]
pub struct Twist {
    v_m_s: f64,
    w_rad_s: f64,
}

impl From<pose::Twist> for Twist {
    fn from(twist: pose::Twist) -> Twist {
        let pose::Twist { v_m_s, w_rad_s } = twist;
        Twist { v_m_s, w_rad_s }
    }
}

#[pymethods]
impl Twist {
    fn __repr__(&self) -> String {
        format!("Twist(v_m_s={}, w_rad_s={})", self.v_m_s, self.w_rad_s)
    }
}

/// State of one neighbor, as known from its beacons.
#[pyclass(frozen, get_all, skip_from_py_object, module = "phalanx")]
#[derive(Clone)]
pub struct Neighbor {
    name: String,
    position: Pair,
    velocity: Pair,
    offset: Pair,
    offset_velocity: Pair,
    age_s: f64,
    contact: &'static str,
}

#[pymethods]
impl Neighbor {
    fn __repr__(&self) -> String {
        format!("Neighbor({}, {}, at {:?})", self.name, self.contact, self.position)
    }
}

/// Input of a law: what the robot knows at one odometry sample.
#[pyclass(frozen, get_all, module = "phalanx")]
pub struct Situation {
    error: Pair,
    desired_velocity: Pair,
    pose: Pose,
    front_point: Pair,
    twist: Twist,
    near: Vec<Pair>,
    t_s: f64,
    period_s: f64,
    neighbors: Vec<Neighbor>,
}

/// Sensor data and target of a robot, the input of a controller.
#[pyclass(frozen, get_all, module = "phalanx")]
pub struct Odometry {
    pose: Pose,
    twist: Twist,
    front_point: Pair,
    front_point_m: f64,
    near: Vec<Pair>,
    error: Pair,
    desired_velocity: Pair,
    period_s: f64,
}

impl Situation {
    /// Converts the input of a law. `names`: names of the in-neighbors.
    pub fn new(situation: &laws::Situation<'_>, names: &Names) -> Situation {
        Situation {
            error: pair(situation.error),
            desired_velocity: pair(situation.desired_velocity),
            pose: situation.pose.into(),
            front_point: pair(situation.front_point),
            twist: situation.twist.into(),
            near: near(situation),
            t_s: situation.t_s,
            period_s: situation.period_s,
            neighbors: neighbors(situation, names),
        }
    }
}

impl Odometry {
    pub fn new(situation: &laws::Situation<'_>) -> Odometry {
        let pose::Pose { x_m, y_m, .. } = situation.pose;
        Odometry {
            pose: situation.pose.into(),
            twist: situation.twist.into(),
            front_point: pair(situation.front_point),
            front_point_m: (situation.front_point - Vec2::new(x_m, y_m)).norm(),
            near: near(situation),
            error: pair(situation.error),
            desired_velocity: pair(situation.desired_velocity),
            period_s: situation.period_s,
        }
    }
}

/// Names of the in-neighbors of a robot, with their scenario indices from 1.
pub struct Names(Vec<(usize, String)>);

impl Names {
    /// Returns the names of the in-neighbors in a brief.
    pub fn read_in_neighbors(brief: &AgentBrief) -> Names {
        let neighbors = brief.senders();
        Names(neighbors.map(|neighbor| (neighbor.index, neighbor.name.clone())).collect())
    }

    /// Returns the number of in-neighbors.
    pub fn len(&self) -> usize {
        self.0.len()
    }
}

/// Returns the in-neighbors from which a beacon was received.
pub fn neighbors(situation: &laws::Situation<'_>, names: &Names) -> Vec<Neighbor> {
    let neighbor = |heard: &Heard| {
        let named = names.0.iter().find(|(place, _)| *place == heard.index);
        Neighbor {
            name: named.map_or(String::new(), |(_, name)| name.clone()),
            position: pair(heard.position),
            velocity: pair(heard.velocity),
            offset: pair(heard.offset.position),
            offset_velocity: pair(heard.offset.velocity),
            age_s: heard.age_s,
            contact: match heard.contact {
                Contact::Fresh => "fresh",
                Contact::Stale => "stale",
                Contact::Lost => "lost",
                // A neighbor without a received beacon is not in the list.
                Contact::Unheard => "unheard",
            },
        }
    };
    situation.heard.iter().map(neighbor).collect()
}

/// Returns the front points of the robots in sensing range, m.
fn near(situation: &laws::Situation<'_>) -> Vec<Pair> {
    situation.away.iter().map(|away| pair(situation.front_point - away)).collect()
}

fn pair(vector: Vec2) -> Pair {
    (vector.x, vector.y)
}

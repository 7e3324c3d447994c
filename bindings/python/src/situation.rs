//! What a law sees, as Python objects: copies of plain values, of which Python's objects are made when they are asked for.

use agent::laws::{self, Heard};
use formation::Vec2;
use formation::pose;
use protocol::brief::AgentBrief;
use protocol::message::Contact;
use pyo3::prelude::*;

/// x and y.
type Pair = (f64, f64);

/// A pose of the axle's mid-point.
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

/// What is known of one robot that was heard.
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

/// One instant as a law sees it.
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

/// What a robot senses and where it is to be, for a controller.
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
    /// `names`: of the robots that it hears.
    pub fn of(situation: &laws::Situation<'_>, names: &Names) -> Situation {
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
    pub fn of(situation: &laws::Situation<'_>) -> Odometry {
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

/// The names of those that a robot hears, by their places in the scenario, from 1.
pub struct Names(Vec<(usize, String)>);

impl Names {
    /// Those of the robots that the robot of this brief hears.
    pub fn of_those_heard(brief: &AgentBrief) -> Names {
        let neighbors = brief.senders();
        Names(neighbors.map(|neighbor| (neighbor.index, neighbor.name.clone())).collect())
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.0.len()
    }
}

/// Those heard, as a list.
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
                // Whoever was never heard is not among the heard.
                Contact::Unheard => "unheard",
            },
        }
    };
    situation.heard.iter().map(neighbor).collect()
}

/// Front points of the robots sensed near.
fn near(situation: &laws::Situation<'_>) -> Vec<Pair> {
    situation.away.iter().map(|away| pair(situation.front_point - away)).collect()
}

fn pair(vector: Vec2) -> Pair {
    (vector.x, vector.y)
}
